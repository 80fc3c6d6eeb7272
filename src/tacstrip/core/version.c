/* What a library says of itself, for src/tacstrip/core/library.py to ask. */

#include <float.h>

#include "core.h"

#if FLT_EVAL_METHOD != 0
#error "sums of doubles would be kept in longer registers, and results differ: add -msse2 -mfpmath=sse"
#endif
#ifdef __FAST_MATH__
#error "-ffast-math reorders sums: results would differ from machine to machine"
#endif

/* Of the sources and headers, as core/sources.py computes it; 0 where nobody said. */
#ifndef TACSTRIP_FINGERPRINT
#define TACSTRIP_FINGERPRINT 0
#endif

#define QUOTED(text) #text
#define NUMBER(macro) QUOTED(macro)
#define VERSION(major, minor) NUMBER(major) "." NUMBER(minor)

#if defined(__clang__)
#define COMPILER "clang " VERSION(__clang_major__, __clang_minor__)
#elif defined(__TINYC__)
#define COMPILER "tcc " NUMBER(__TINYC__)
#elif defined(__GNUC__)
#define COMPILER "gcc " VERSION(__GNUC__, __GNUC_MINOR__)
#else
#define COMPILER "another compiler"
#endif

#if defined(__AVX2__) && defined(__FMA__) && defined(__BMI2__)
#define LEVEL ", x86-64-v3"
#else
#define LEVEL ", baseline"
#endif

#ifdef TACSTRIP_DEBUG
#define CHECKED ", debug"
#else
#define CHECKED ""
#endif

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define SANITIZED ", sanitized"
#endif
#elif defined(__SANITIZE_ADDRESS__)
#define SANITIZED ", sanitized"
#endif
#ifndef SANITIZED
#define SANITIZED ""
#endif

EXPORTED const char *tacstrip_core_fingerprint(void);
EXPORTED const char *tacstrip_core_built(void);
EXPORTED int tacstrip_core_v3_runs(void);

int tacstrip_core_version(void) { return TACSTRIP_VERSION; }

/* The fingerprint of the sources that this was built from. */
const char *tacstrip_core_fingerprint(void) { return NUMBER(TACSTRIP_FINGERPRINT); }

/* Compiler, level of the instruction set, and which checks are in, as `tacstrip --version` shows them. */
const char *tacstrip_core_built(void) { return COMPILER LEVEL CHECKED SANITIZED; }

/* Whether this processor, and its operating system, run the x86-64-v3 build. */
int tacstrip_core_v3_runs(void) {
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__TINYC__)
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
         __builtin_cpu_supports("bmi2");
#else
  return 0;
#endif
}

/* Calls the core where there is no Python: another processor under an emulator, another C library. Prints a checksum
   of each case's results, which must be the same everywhere. Add a case: fill arrays with number(), call, and show(). */

#include <stdio.h>

#include "core.h"

static unsigned long long state = 1;

/* The next of a sequence in [0, 1) that is the same on every machine. */
static double number(void) {
  state = state * 6364136223846793005ULL + 1442695040888963407ULL;
  return (double)(state >> 11) / 9007199254740992.0;
}

/* Print a checksum (FNV-1a) of some bytes. */
static void show(const char *name, const void *bytes, unsigned long long count) {
  unsigned long long sum = 14695981039346656037ULL;
  for (unsigned long long i = 0; i < count; i++) sum = (sum ^ ((const unsigned char *)bytes)[i]) * 1099511628211ULL;
  printf("%s %016llx\n", name, sum);
}

/* The compiler's own part: a contracted or reordered sum shows here, and chaos makes much of it. */
static void chaos(void) {
  double value = number();
  for (int i = 0; i < 200; i++) value = 1.0 - 1.9 * value * value;
  show("chaos", &value, sizeof value);
}

int main(void) {
  int version = tacstrip_core_version();
  show("version", &version, sizeof version);
  chaos();
  return 0;
}

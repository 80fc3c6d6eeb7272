/* Four strips at a time. Lane j of every sum takes the strips j, j + 4, j + 8, ...; lanes are joined at the end, always
   in one order, so that the bits do not depend on how many lanes a CPU works at once: a Pack holds WIDTH of them. */

#ifndef TACSTRIP_LANES_H
#define TACSTRIP_LANES_H

#include "internal.h"

#if defined(__GNUC__) && !defined(__TINYC__)
#if defined(__AVX__)
#define WIDTH 4
#else
#define WIDTH 2
#endif
typedef double Pack __attribute__((vector_size(8 * WIDTH)));
typedef Int Mask __attribute__((vector_size(8 * WIDTH)));
typedef double Anywhere __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
static inline Pack load(const double *a) { return *(const Anywhere *)a; }
static inline void store(double *a, Pack v) { *(Anywhere *)a = v; }
static inline Pack all(double v) { return (Pack){0.0} + v; }
static inline Pack where(Mask yes, Pack a, Pack b) { return (Pack)((yes & (Mask)a) | (~yes & (Mask)b)); }
static inline int any(Mask yes) {
#if defined(__AVX__)
  return __builtin_ia32_movmskpd256((Pack)yes);
#elif defined(__SSE2__)
  return __builtin_ia32_movmskpd((Pack)yes);
#else
  return (yes[0] | yes[1]) != 0;
#endif
}
#if defined(__AVX__) /* a > b ? a : b and a < b ? a : b, one instruction each */
static inline Pack greater(Pack a, Pack b) { return __builtin_ia32_maxpd256(a, b); }
static inline Pack lesser(Pack a, Pack b) { return __builtin_ia32_minpd256(a, b); }
static inline Pack root(Pack a) { return __builtin_ia32_sqrtpd256(a); }
#else
static inline Pack root(Pack a) {
  double lane[WIDTH];
  store(lane, a);
  for (int i = 0; i < WIDTH; i++) lane[i] = sqrt(lane[i]);
  return load(lane);
}
static inline Pack greater(Pack a, Pack b) { return where(a > b, a, b); }
static inline Pack lesser(Pack a, Pack b) { return where(a < b, a, b); }
#endif
#else
#define WIDTH 1
typedef double Pack;
#define load(a) (*(a)) /* macros, for Tiny C inlines nothing */
#define store(a, v) (*(a) = (v))
#define all(v) ((Pack)(v))
#define where(yes, a, b) ((yes) ? (a) : (b))
#define any(yes) (yes)
#define root(a) sqrt(a)
#define greater(a, b) larger(a, b)
#define lesser(a, b) smaller(a, b)
typedef int Mask;
#endif

#define PACKS (LANES / WIDTH)

static inline double joined(const Pack *sum) {
  double lane[LANES];
  for (int j = 0; j < PACKS; j++) store(lane + j * WIDTH, sum[j]);
  return (lane[0] + lane[2]) + (lane[1] + lane[3]);
}

/* The strips of one step: where they are read, past the end the last strip again, without weight. */
typedef struct {
  const double *x, *k[2], *weight[2];
  double padded[5][LANES];
} Block;

static inline void read_block(const Problem *s, Int first, Int end, Block *block) {
  if (first + LANES <= end) {
    block->x = s->x + first;
    for (Int row = 0; row < s->signatures; row++) {
      block->k[row] = s->k + row * s->n + first;
      block->weight[row] = s->weight + row * s->n + first;
    }
    return;
  }
  block->x = block->padded[4];
  for (int j = 0; j < LANES; j++) block->padded[4][j] = s->x[first + j < end ? first + j : end - 1];
  for (Int row = 0; row < s->signatures; row++) {
    block->k[row] = block->padded[row];
    block->weight[row] = block->padded[2 + row];
    for (int j = 0; j < LANES; j++) {
      Int i = row * s->n + (first + j < end ? first + j : end - 1);
      block->padded[row][j] = s->k[i];
      block->padded[2 + row][j] = first + j < end ? s->weight[i] : 0.0;
    }
  }
}

#endif

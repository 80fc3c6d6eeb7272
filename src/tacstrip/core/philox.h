/* Numbers by counter: Philox4x32-10 (Salmon et al., 2011), eight blocks at a time, so that a scan's numbers depend on the
   seed and on the scan alone. */

#ifndef TACSTRIP_PHILOX_H
#define TACSTRIP_PHILOX_H

#include "lanes.h"

#define BLOCKS 8             /* of one call */
#define WORDS (4 * BLOCKS)   /* that it gives */
#define ROUNDS 10

typedef unsigned int Word32;
typedef unsigned long long Word64;

#define LOW_HALF 0xffffffffULL
#if WIDTH == 1
typedef Word64 Words, Anyword;
#define low_product(a, b) (((a) & LOW_HALF) * (b))
#else
typedef Word64 Words __attribute__((vector_size(8 * WIDTH)));
typedef Word64 Anyword __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
typedef int Halves __attribute__((vector_size(8 * WIDTH)));
#if defined(__AVX2__) && !defined(__clang__) /* gcc does not see that the upper halves are zero, and multiplies thrice */
#define low_product(a, b) ((Words)__builtin_ia32_pmuludq256((Halves)(a), (Halves)((Words){0} + (b))))
#elif defined(__SSE2__) && WIDTH == 2 && !defined(__clang__)
#define low_product(a, b) ((Words)__builtin_ia32_pmuludq128((Halves)(a), (Halves)((Words){0} + (b))))
#else
#define low_product(a, b) (((a) & LOW_HALF) * (b))
#endif
#endif

/* What each round adds of a key, in every lane. */
typedef struct {
  Words round[ROUNDS][2];
} Keys;

static inline void spread_key(const Word32 *key, Keys *keys) {
  for (Word64 i = 0; i < ROUNDS; i++) {
    keys->round[i][0] = (Words){0} + ((key[0] + i * 0x9E3779B9ULL) & LOW_HALF);
    keys->round[i][1] = (Words){0} + ((key[1] + i * 0xBB67AE85ULL) & LOW_HALF);
  }
}

/* Word w of block first + j to words[BLOCKS w + j], of a stream of a scan. */
static inline void philox(const Keys *keys, Word32 first, Word32 stream, Int scan, Word64 *words) {
  static const Word64 ascending[BLOCKS] = {0, 1, 2, 3, 4, 5, 6, 7};
  for (int j = 0; j < BLOCKS; j += WIDTH) {
    Anyword *to = (Anyword *)(words + j);
    Words zero = {0}, a = *(const Anyword *)(ascending + j) + first, b = zero + stream;
    Words c = zero + ((Word64)scan & LOW_HALF), d = zero + ((Word64)scan >> 32);
    /* Upper halves hold what is left of products: they are never multiplied, and are cut off at the end. */
    for (int round = 0; round < ROUNDS; round++) {
      Words p = low_product(a, 0xD2511F53ULL), q = low_product(c, 0xCD9E8D57ULL);
      a = (q >> 32) ^ b ^ keys->round[round][0];
      c = (p >> 32) ^ d ^ keys->round[round][1];
      b = q;
      d = p;
    }
    to[0] = a & LOW_HALF;
    to[BLOCKS / WIDTH] = b & LOW_HALF;
    to[2 * BLOCKS / WIDTH] = c & LOW_HALF;
    to[3 * BLOCKS / WIDTH] = d & LOW_HALF;
  }
}

#endif

/* Four strips at a time. Lane j of every sum takes the strips j, j + 4, j + 8, ...; lanes are joined at the end, always
   in one order, so that the bits do not depend on how many lanes a CPU works at once: a Pack holds WIDTH of them. */

#ifndef TACSTRIP_LANES_H
#define TACSTRIP_LANES_H

#include "core.h"

#define LANES 4

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
#else
#define WIDTH 1
typedef double Pack;
#define load(a) (*(a)) /* macros, for Tiny C inlines nothing */
#define store(a, v) (*(a) = (v))
#define all(v) ((Pack)(v))
#define where(yes, a, b) ((yes) ? (a) : (b))
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

/* terms: the sums over the signatures of g_l^2, g_l g_u, g_u^2, g_l r, g_u r and r^2, times the weight, with g_l and g_u
   the slopes of a reading by l and by u, and r what is measured less what l and u make. l > u costs extra. */
enum { LL, LU, UU, LR, UR, RR, TERMS };

#define LEAST_D 1e-3  /* of L: a metal sheet under a whole strip would divide by zero */
#define CROSSED 100.0 /* weight of l > u against a reading */
#define CROSSED_FROM 1e-9 /* of L: where both chains meet on a strip, a rounding error must not cross them */

double hyperbolic_tangent(double x);

/* Contacts from l to u as ideal ones: contact resistance eats t into each end (docs/decisions/, one closed form). */
typedef struct {
  Pack low, high, over, mix; /* l + t, u - t, 1 / D, dt/dw */
} Ideal;

static inline Ideal ideal(const Problem *s, Pack l, Pack u) {
  Pack w = u - l, t = all(0.0);
  Ideal contact;
  contact.mix = t;
  if (s->lam > 0.0) {
    double lane[WIDTH];
    store(lane, w);
    for (int i = 0; i < WIDTH; i++) lane[i] = hyperbolic_tangent(lane[i] / (2.0 * s->lam));
    Pack h = load(lane);
    t = s->lam * h;
    contact.mix = 0.5 * (1.0 - h * h);
  }
  Pack d = 1.0 - s->narrow * (w - 2.0 * t);
  contact.low = l + t;
  contact.high = u - t;
  contact.over = 1.0 / where(d > LEAST_D, d, all(LEAST_D));
  return contact;
}

/* The closed form (3.3)-(3.8). */
static inline Pack reading(double share, const Ideal *contact) {
  return ((1.0 - share) * contact->low + share * contact->high) * contact->over;
}

/* Pack j of a block, of contacts from l to u. */
static inline void closed_form(const Problem *s, const Block *block, int j, Pack l, Pack u, Pack *terms) {
  Pack w = u - l, none = all(0.0);
  Ideal contact = ideal(s, l, u);
  Pack over = contact.over, mix = contact.mix, keep = 1.0 - mix;
  for (int q = 0; q < TERMS; q++) terms[q] = none;
  for (Int row = 0; row < s->signatures; row++) {
    double share = s->share[row];
    Pack weight = load(block->weight[row] + j * WIDTH);
    Pack model = reading(share, &contact);
    Pack by_l = (1.0 - share - s->narrow * model) * over, by_u = (share + s->narrow * model) * over;
    Pack gl = by_l * keep + by_u * mix, gu = by_u * keep + by_l * mix;
    Pack r = load(block->k[row] + j * WIDTH) - model;
    Pack crossed = where(w < -CROSSED_FROM, CROSSED * weight, none), push = crossed * w;
    Pack wl = weight * gl, wu = weight * gu;
    terms[LL] += wl * gl + crossed;
    terms[LU] += wl * gu - crossed;
    terms[UU] += wu * gu + crossed;
    terms[LR] += wl * r + push;
    terms[UR] += wu * r - push;
    terms[RR] += weight * r * r + push * w;
  }
}

#endif

/* The closed form (3.3)-(3.8) and its derivatives, four strips at a time: what every fit is compared with. */

#ifndef TACSTRIP_CLOSED_FORM_H
#define TACSTRIP_CLOSED_FORM_H

#include "lanes.h"

/* terms: the sums over the signatures of g_l^2, g_l g_u, g_u^2, g_l r, g_u r and r^2, times the weight, with g_l and g_u
   the slopes of a reading by l and by u, and r what is measured less what l and u make. l > u costs extra. */
enum { LL, LU, UU, LR, UR, RR, TERMS };

#define CROSSED 100.0 /* weight of l > u against a reading */
#define CROSSED_FROM 1e-9 /* of L: where both chains meet on a strip, a rounding error must not cross them */

/* Contacts from l to u as ideal ones: contact resistance eats t into each end (docs/decisions/, one closed form). */
typedef struct {
  Pack low, high, over, mix; /* l + t, u - t, 1 / D, dt/dw */
} Ideal;

/* Contacts from l to u as ideal ones, t shorter at each end; mix is its slope by their length. */
static inline Ideal shortened(const Problem *s, Pack l, Pack u, Pack t, Pack mix) {
  Pack d = 1.0 - s->narrow * (u - l - 2.0 * t);
  Ideal contact = {l + t, u - t, 1.0 / where(d > LEAST_D, d, all(LEAST_D)), mix};
  return contact;
}

static inline Ideal ideal(const Problem *s, Pack l, Pack u) {
  if (!(s->lam > 0.0)) return shortened(s, l, u, all(0.0), all(0.0));
  double lane[WIDTH];
  store(lane, u - l);
  for (int i = 0; i < WIDTH; i++) lane[i] = hyperbolic_tangent(lane[i] / (2.0 * s->lam));
  Pack h = load(lane);
  return shortened(s, l, u, s->lam * h, 0.5 * (1.0 - h * h));
}

/* `ideal` with tanh a by Pade, [7/6]: off by 1e-4 at most, of a transfer length, and a third of the time. */
static inline Ideal nearly_ideal(const Problem *p, Pack l, Pack u) {
  if (!(p->lam > 0.0)) return ideal(p, l, u);
  Pack a = (u - l) / (2.0 * p->lam), z = a * a, above = 135135.0 + z * (17325.0 + z * (378.0 + z));
  Pack h = a * above / (135135.0 + z * (62370.0 + z * (3150.0 + z * 28.0)));
  return shortened(p, l, u, p->lam * lesser(h, all(1.0)), all(0.0));
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

/* A rigid outline at a pose, where strips cross it, and what they read: what rigid.c and hull.c share. */

#ifndef TACSTRIP_RIGID_H
#define TACSTRIP_RIGID_H

#include "internal.h"

#define STEEPEST 16.0   /* slope squared from which an edge's tolerance grows no more */
#define DAMPING 1e-3    /* of the diagonal, to begin with */
#define EASED 6.0       /* how much less after a step that helps, and more after one that does not */
#define LEAST 1e-9      /* damping at least, and what is added to the diagonal */
#define HOPELESS 1e8    /* damping that ends a descent */
#define TOUCHES 1e-12   /* an edge no longer than this in x is vertical */
#define AT_A_TIME 16    /* strips whose crossings are found together */
#define LARGE 1e150     /* a product of which the logarithm is taken */

typedef struct {
  double x[RIGID_CORNERS], y[RIGID_CORNERS], cos, sin;
  Int end[2]; /* the left-most and the right-most corner */
} Posed;

/* Where a strip's centre line crosses the outline lowest or highest. */
typedef struct {
  Int from, to; /* corners of the edge */
  double y, share, slope;
} Crossing;

/* Places of the results of one scan, or of all; a null `shape` leaves out what is about the corners. */
typedef struct {
  double *pose, *mixed, *shape, *pose_slope, *shape_slope; /* (3, 3), (3, 2 N), (2 N, 2 N), (3,), (2 N,) */
} Normal;

/* rigid.c: write the blocks of all scans, where there are any, and their costs (scans,); return the total. At `most` and above it
   is left unfinished: no scan costs less than nothing. */
HIDDEN double rigid_equations(const Scans *s, const Loss *loss, const double *corners, Int count, const double *poses,
                              double most, const Normal *n, double *costs);

/* rigid.c: solve the damped equations of `size` numbers of an outline with the poses eliminated (Schur's complement). Writes
   their steps and those of the poses (scans, 3); 0 where they are not positive definite. `least` is added to the diagonal,
   `pinned` holds the pose in the middle. */
HIDDEN int rigid_step(Int scans, Int size, const Normal *n, double damping, double least, double pinned, double *by_outline,
                      double *by_pose);

static inline void place(const double *corners, Int count, const double *pose, Posed *p) {
  p->cos = cosine(pose[2]);
  p->sin = sine(pose[2]);
  p->end[0] = p->end[1] = 0;
  for (Int i = 0; i < count; i++) {
    p->x[i] = p->cos * corners[2 * i] - p->sin * corners[2 * i + 1] + pose[0];
    p->y[i] = p->sin * corners[2 * i] + p->cos * corners[2 * i + 1] + pose[1];
    if (p->x[i] < p->x[p->end[0]]) p->end[0] = i;
    if (p->x[i] > p->x[p->end[1]]) p->end[1] = i;
  }
}

/* Where the centre lines x[0] to x[strips - 1], ascending and `pitch` apart, cross the outline lowest and highest. Beside the
   outline its end corner is read. */
static inline void cross(const Posed *p, Int count, const double *x, Int strips, double pitch, Crossing *low, Crossing *high) {
  Int after[RIGID_CORNERS]; /* the first line that is not left of a corner */
  int found[AT_A_TIME] = {0};
  CHECK(strips <= AT_A_TIME);
  for (Int i = 0; i < count; i++) {
    Int k = (Int)clip((p->x[i] - x[0]) / pitch, 0.0, (double)(strips - 1));
    while (k > 0 && x[k - 1] >= p->x[i]) k--;
    while (k < strips && x[k] < p->x[i]) k++;
    after[i] = k;
  }
  for (Int i = 0; i < count; i++) {
    Int j = i + 1 < count ? i + 1 : 0, begin = after[i] < after[j] ? after[i] : after[j];
    Int end = after[i] < after[j] ? after[j] : after[i];
    if (begin == end) continue;
    double from = p->x[i], width = p->x[j] - from, run = width, rise = p->y[j] - p->y[i];
    if (magnitude(run) < TOUCHES) run = run < 0.0 ? -TOUCHES : TOUCHES;
    Crossing here = {i, j, 0.0, 0.0, rise / run};
    for (Int k = begin; k < end; k++) {
      here.share = (x[k] - from) / width;
      here.y = p->y[i] + here.share * rise;
      if (!found[k] || here.y < low[k].y) low[k] = here;
      if (!found[k] || here.y > high[k].y) high[k] = here;
      found[k] = 1;
    }
  }
  for (Int k = 0; k < strips; k++)
    if (!found[k]) {
      Int i = p->end[magnitude(x[k] - p->x[p->end[1]]) < magnitude(x[k] - p->x[p->end[0]])];
      Crossing corner = {i, i, p->y[i], 0.0, 0.0};
      low[k] = high[k] = corner;
    }
}

/* dy of a crossing by the pose (3,) and by x and y of both corners (4,). */
static inline void slopes(const Posed *p, const double *pose, const Crossing *c, double *by_pose, double *by_corner) {
  double m = c->slope, ex = p->sin - m * p->cos, ey = m * p->sin + p->cos, keep = 1.0 - c->share;
  double turned_from = p->x[c->from] - pose[0] + m * (p->y[c->from] - pose[1]);
  double turned_to = p->x[c->to] - pose[0] + m * (p->y[c->to] - pose[1]);
  by_pose[0] = -m;
  by_pose[1] = 1.0;
  by_pose[2] = keep * turned_from + c->share * turned_to;
  by_corner[0] = keep * ex;
  by_corner[1] = keep * ey;
  by_corner[2] = c->share * ex;
  by_corner[3] = c->share * ey;
}

/* What residuals cost: a sum, and of Cauchy's loss a product, so that one logarithm serves many. */
typedef struct {
  double sum, product;
} Cost;

static const Cost FREE = {0.0, 1.0};

static inline double total_of(const Loss *loss, const Cost *cost) {
  return cost->product > 1.0 ? cost->sum + loss->cauchy * loss->cauchy * natural_log(cost->product) : cost->sum;
}

/* Add what a residual over sigma costs; *weight is multiplied by what Cauchy's loss leaves of its weight. */
static inline void add_loss(const Loss *loss, double residual, double *weight, Cost *cost) {
  double square = residual * residual;
  if (!(loss->cauchy > 0.0)) {
    cost->sum += square;
    return;
  }
  double more = 1.0 + square / (loss->cauchy * loss->cauchy);
  *weight /= more;
  cost->product *= more;
  if (cost->product < LARGE) return;
  cost->sum = total_of(loss, cost);
  cost->product = 1.0;
}

/* Ends of a contact on a strip over its length, and what readings follow from them by. */
typedef struct {
  double l, u, t, mix, over;
  int held_l, held_u; /* on the strip, not beyond its ends */
} Ends;

static inline Ends ends_of(const Scans *s, const Crossing *low, const Crossing *high) {
  Ends e;
  e.l = clip(low->y / s->length, 0.0, 1.0);
  e.u = clip(high->y / s->length, 0.0, 1.0);
  e.held_l = low->y > 0.0 && low->y < s->length;
  e.held_u = high->y > 0.0 && high->y < s->length;
  double w = e.u - e.l, h = s->lam > 0.0 ? hyperbolic_tangent(w / (2.0 * s->lam)) : 0.0;
  e.t = s->lam * h;
  e.mix = s->lam > 0.0 ? 0.5 * (1.0 - h * h) : 0.0;
  e.over = 1.0 / larger(1.0 - s->narrow * (w - 2.0 * e.t), LEAST_D);
  return e;
}

/* What a strip reads, and its slopes by the heights of both crossings [1/mm], were these not beyond its ends. */
static inline double reading(const Scans *s, double share, const Ends *e, double *by_l, double *by_u) {
  double model = ((1.0 - share) * (e->l + e->t) + share * (e->u - e->t)) * e->over, keep = 1.0 - e->mix;
  double by_low = (1.0 - share - s->narrow * model) * e->over, by_high = (share + s->narrow * model) * e->over;
  *by_l = (by_low * keep + by_high * e->mix) / s->length;
  *by_u = (by_high * keep + by_low * e->mix) / s->length;
  return model;
}

/* Add what the readings of one strip cost. */
static inline void strip(const Scans *s, const Loss *loss, const double *k, Int stride, const Crossing *low,
                         const Crossing *high, double *terms, Cost *cost) {
  Ends e = ends_of(s, low, high);
  double variance = s->sigma * s->sigma, weight = 1.0 / variance, root = sqrt(weight);
  for (int i = 0; i < 5; i++) terms[i] = 0.0;
  for (Int row = 0; row < s->signatures; row++) {
    double read = k[row * stride], by_l, by_u;
    if (!(read == read)) continue;
    double model = reading(s, s->share[row], &e, &by_l, &by_u);
    if (loss->tolerance > 0.0) {
      double rough_l = 1.0 + smaller(low->slope * low->slope, STEEPEST);
      double rough_u = 1.0 + smaller(high->slope * high->slope, STEEPEST);
      weight = 1.0 / (variance + loss->tolerance * loss->tolerance * (by_l * by_l * rough_l + by_u * by_u * rough_u));
      root = sqrt(weight);
    }
    double residual = read - model, own = weight;
    add_loss(loss, residual * root, &own, cost);
    by_l *= e.held_l;
    by_u *= e.held_u;
    terms[0] += own * by_l * by_l;
    terms[1] += own * by_l * by_u;
    terms[2] += own * by_u * by_u;
    terms[3] += own * by_l * residual;
    terms[4] += own * by_u * residual;
  }
}

#endif

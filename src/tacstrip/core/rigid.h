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

/* Beside the outline its end corner is read. */
static inline void cross(const Posed *p, Int count, double x, Crossing *low, Crossing *high) {
  int found = 0, first = p->x[0] <= x, left = first;
  for (Int i = 0; i < count; i++) {
    Int j = i + 1 < count ? i + 1 : 0;
    int before = left;
    left = j ? p->x[j] <= x : first;
    if (before == left) continue;
    double from = p->x[i], to = p->x[j];
    double share = (x - from) / (to - from), run = to - from;
    if (magnitude(run) < TOUCHES) run = run < 0.0 ? -TOUCHES : TOUCHES;
    Crossing here = {i, j, p->y[i] + share * (p->y[j] - p->y[i]), share, (p->y[j] - p->y[i]) / run};
    if (!found || here.y < low->y) *low = here;
    if (!found || here.y > high->y) *high = here;
    found = 1;
  }
  if (found) return;
  Int i = p->end[magnitude(x - p->x[p->end[1]]) < magnitude(x - p->x[p->end[0]])];
  Crossing corner = {i, i, p->y[i], 0.0, 0.0};
  *low = *high = corner;
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

/* Add what the readings of one strip cost. */
static inline void strip(const Scans *s, const Loss *loss, const double *k, Int stride, const Crossing *low,
                         const Crossing *high, double *terms, Cost *cost) {
  double l = clip(low->y / s->length, 0.0, 1.0), u = clip(high->y / s->length, 0.0, 1.0), w = u - l;
  double held_l = low->y > 0.0 && low->y < s->length, held_u = high->y > 0.0 && high->y < s->length;
  double h = s->lam > 0.0 ? hyperbolic_tangent(w / (2.0 * s->lam)) : 0.0, t = s->lam * h;
  double mix = s->lam > 0.0 ? 0.5 * (1.0 - h * h) : 0.0, keep = 1.0 - mix;
  double over = 1.0 / larger(1.0 - s->narrow * (w - 2.0 * t), LEAST_D);
  double rough_l = 1.0 + smaller(low->slope * low->slope, STEEPEST);
  double rough_u = 1.0 + smaller(high->slope * high->slope, STEEPEST);
  for (int i = 0; i < 5; i++) terms[i] = 0.0;
  for (Int row = 0; row < s->signatures; row++) {
    double read = k[row * stride], share = s->share[row];
    if (!(read == read)) continue;
    double model = ((1.0 - share) * (l + t) + share * (u - t)) * over;
    double by_low = (1.0 - share - s->narrow * model) * over, by_high = (share + s->narrow * model) * over;
    double by_l = (by_low * keep + by_high * mix) / s->length, by_u = (by_high * keep + by_low * mix) / s->length;
    double soft = loss->tolerance * loss->tolerance * (by_l * by_l * rough_l + by_u * by_u * rough_u);
    double weight = 1.0 / (s->sigma * s->sigma + soft), residual = read - model;
    add_loss(loss, residual * sqrt(weight), &weight, cost);
    by_l *= held_l;
    by_u *= held_u;
    terms[0] += weight * by_l * by_l;
    terms[1] += weight * by_l * by_u;
    terms[2] += weight * by_u * by_u;
    terms[3] += weight * by_l * residual;
    terms[4] += weight * by_u * residual;
  }
}

#endif

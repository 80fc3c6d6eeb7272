/* Levenberg-Marquardt for the polygon fit: from a start to the nearest least-squares polygon. */

#include "internal.h"

#define DAMPING 1e-3 /* of J'J's diagonal, at first */
#define STUCK 1e8    /* where a descent gives up */
#define ALWAYS 1e-9  /* damping that stays */
#define HOPE 2.0     /* a descent will not gain more than twice what its last step did */

#define FINE 40        /* steps of a last descent */
#define SETTLED 1e-4   /* the gain in chi square that ends it */
#define CLOSED 1e-12   /* of the strip length */

Int free_entries(const Polygon *p, Int *free) {
  Int n = 0;
  for (int side = 0; side < 2; side++) {
    if (!p->vertical[side]) free[n++] = 3 * side;
    free[n++] = 3 * side + 1;
    if (p->vertical[side]) free[n++] = 3 * side + 2;
  }
  for (Int i = END_ENTRIES; i < END_ENTRIES + 2 * p->m; i++) free[n++] = i;
  return n;
}

void sort_vertices(Polygon *p) {
  for (Int j = 1; j < p->m; j++) {
    double x = p->theta[END_ENTRIES + 2 * j], y = p->theta[END_ENTRIES + 2 * j + 1];
    Int upper = p->upper[j], i = j;
    for (; i > 0 && x < p->theta[END_ENTRIES + 2 * i - 2]; i--) {
      p->theta[END_ENTRIES + 2 * i] = p->theta[END_ENTRIES + 2 * i - 2];
      p->theta[END_ENTRIES + 2 * i + 1] = p->theta[END_ENTRIES + 2 * i - 1];
      p->upper[i] = p->upper[i - 1];
    }
    p->theta[END_ENTRIES + 2 * i] = x;
    p->theta[END_ENTRIES + 2 * i + 1] = y;
    p->upper[i] = upper;
  }
}

/* Write theta + step to trial, held to the sensor, to the ends' pitch and to the order on each chain: a vertex goes
   halfway to its neighbour at most, so that two that approach each other never pass. */
void move(const Polygon *p, const Int *free, Int n, const double *step, double pitch, double *trial) {
  const double *theta = p->theta;
  Int m = p->m;
  for (Int i = 0; i < END_ENTRIES + 2 * m; i++) trial[i] = theta[i];
  for (Int i = 0; i < n; i++) trial[free[i]] += step[i];
  trial[0] = clip(trial[0], -0.5 * pitch, 0.5 * pitch);
  trial[3] = clip(trial[3], 1.0 - 0.5 * pitch, 1.0 + 0.5 * pitch);
  if (m > 0) {
    double left = 0.5 * (theta[0] + theta[END_ENTRIES]) - 0.25 * pitch;
    double right = 0.5 * (theta[3] + theta[END_ENTRIES + 2 * m - 2]) + 0.25 * pitch;
    trial[0] = smaller(trial[0], larger(theta[0], left));
    trial[3] = larger(trial[3], smaller(theta[3], right));
  }
  for (int side = 0; side < 2; side++) {
    int l = 3 * side + 1, u = l + 1;
    trial[l] = clip(trial[l], 0.0, 1.0);
    trial[u] = p->vertical[side] ? clip(trial[u], 0.0, 1.0) : trial[l];
  }
  for (Int j = 0; j < m; j++) {
    Int at = END_ENTRIES + 2 * j;
    double here = theta[at], before = theta[0], after = theta[3];
    for (Int i = 0; i < j; i++) if (p->upper[i] == p->upper[j]) before = theta[END_ENTRIES + 2 * i];
    for (Int i = m - 1; i > j; i--) if (p->upper[i] == p->upper[j]) after = theta[END_ENTRIES + 2 * i];
    double low = here - larger(0.5 * (here - before) - 0.25 * pitch, 0.0);
    double high = here + larger(0.5 * (after - here) - 0.25 * pitch, 0.0);
    trial[at] = clip(trial[at], low, high);
    trial[at + 1] = clip(trial[at + 1], 0.0, 1.0);
  }
}

/* Leave out the entries at their bound that the gradient pushes on; return how many are left. */
static Int not_held(const Polygon *p, const double *gradient, double pitch, Int *free, Int n) {
  Int kept = 0;
  for (Int i = 0; i < n; i++) {
    Int at = free[i];
    double low = -INFINITE, high = INFINITE, value = p->theta[at];
    if (at == 0 || at == 3) {
      low = (double)(at / 3) - 0.5 * pitch;
      high = (double)(at / 3) + 0.5 * pitch;
    } else if (at < END_ENTRIES || at % 2 == 1) {
      low = 0.0;
      high = 1.0;
    }
    if ((value > low || gradient[at] > 0.0) && (value < high || gradient[at] < 0.0)) free[kept++] = at;
  }
  return kept;
}

double tacstrip_descend(const Problem *s, Polygon *p, Int steps, double least, double wanted) {
  Int size = END_ENTRIES + 2 * p->m, free[SIZE];
  Matrix one, two, small;
  double first[SIZE], second[SIZE], step[SIZE];
  double (*a)[SIZE] = one, (*other)[SIZE] = two, *g = first, *other_g = second, damping = DAMPING;
  Polygon trial;
  CHECK(0 <= p->m && p->m <= MAX_VERTICES && (s->signatures == 1 || s->signatures == 2));
  sort_vertices(p);
  double cost = normal_equations(s, p, a, g);
  trial.m = p->m;
  trial.vertical[0] = p->vertical[0];
  trial.vertical[1] = p->vertical[1];
  for (Int round = 0; round < steps; round++) {
    Int n = not_held(p, g, s->pitch, free, free_entries(p, free));
    for (Int i = 0; i < n; i++) {
      const double *row = a[free[i]];
      for (Int j = i; j < n; j++) small[i][j] = row[free[j]];
      small[i][i] += damping * small[i][i] + ALWAYS;
      step[i] = g[free[i]];
    }
    double gain = -1.0, now = 0.0;
    if (factor(small, n)) {
      solve(small, n, step);
      move(p, free, n, step, s->pitch, trial.theta);
      for (Int j = 0; j < p->m; j++) trial.upper[j] = p->upper[j];
      sort_vertices(&trial);
      now = normal_equations(s, &trial, other, other_g);
      gain = cost - now;
    }
    if (gain >= 0.0) {
      for (Int i = 0; i < size; i++) p->theta[i] = trial.theta[i];
      for (Int j = 0; j < p->m; j++) p->upper[j] = trial.upper[j];
      double (*swapped)[SIZE] = a, *swapped_g = g;
      a = other; other = swapped;
      g = other_g; other_g = swapped_g;
      cost = now;
      damping = larger(0.1 * damping, ALWAYS);
      if (gain < least || cost - HOPE * gain > wanted) break;
    } else {
      damping *= 8.0;
      if (damping > STUCK) break;
    }
  }
  p->cost = cost;
  return cost;
}

void tacstrip_refine(const Problem *s, Polygon *p) {
  for (;;) {
    int closed = 0;
    for (int side = 0; side < 2; side++) {
      double *l = p->theta + 3 * side + 1, *u = l + 1;
      if (!p->vertical[side] && *l != *u) *l = *u = 0.5 * (*l + *u);
    }
    tacstrip_descend(s, p, FINE, SETTLED, INFINITE);
    for (int side = 0; side < 2; side++) { /* an edge without height is a point, whose x is free */
      if (p->vertical[side] && p->theta[3 * side + 2] - p->theta[3 * side + 1] <= CLOSED) {
        p->vertical[side] = 0;
        closed = 1;
      }
    }
    if (!closed) return;
  }
}

/* The moves of the polygon search: a first vertex, one vertex more, one vertex less.

   A move makes starts of one kind, descends from each and keeps what is best. */

#include "internal.h"

#define ROUGH 12       /* steps of a descent */
#define ENOUGH 0.1     /* of chi square: a descent step that gains less is the last */
#define FIRST_PLACES 5 /* positions of a first vertex, on each chain */
#define ROUNDING 1e-3  /* of chi square */

/* Polygons of one vertex, each of which alone makes the reading where it is. */
static Int first_places(const Problem *s, const Polygon *p, Polygon *starts) {
  Int count = 0, last = s->n - 1;
  for (Int place = 0; place < FIRST_PLACES; place++) {
    Int i = s->n * (2 * place + 1) / (2 * FIRST_PLACES);
    if (i > last) i = last;
    double reading = (s->k[i > 0 ? i - 1 : 0] + s->k[i] + s->k[i < last ? i + 1 : last]) / 3.0;
    double by_u = s->share[0] + s->narrow * reading;
    for (int upper = 0; upper < 2; upper++) {
      Polygon *start = starts + count++;
      double opposite = p->theta[2 - upper] + (p->theta[5 - upper] - p->theta[2 - upper]) * s->x[i];
      double own = upper ? by_u : 1.0 - by_u;
      *start = *p;
      start->theta[END_ENTRIES] = s->x[i];
      start->theta[END_ENTRIES + 1] = clip((reading - (1.0 - own) * opposite) / larger(own, 1e-3), 0.0, 1.0);
      start->upper[0] = upper;
      start->m = 1;
    }
  }
  return count;
}

static Int without_each(const Polygon *p, Polygon *starts) {
  for (Int out = 0; out < p->m; out++) {
    Polygon *start = starts + out;
    *start = *p;
    start->m--;
    for (Int j = out; j < start->m; j++) {
      start->theta[END_ENTRIES + 2 * j] = p->theta[END_ENTRIES + 2 * j + 2];
      start->theta[END_ENTRIES + 2 * j + 1] = p->theta[END_ENTRIES + 2 * j + 3];
      start->upper[j] = p->upper[j + 1];
    }
  }
  return p->m;
}

/* How high a chain would be at a vertex if that were not on it. */
static double chord(const Polygon *p, Int vertex, int upper) {
  Int before = -1, after = -1;
  for (Int i = 0; i < vertex; i++) if (p->upper[i] == upper) before = i;
  for (Int i = p->m - 1; i > vertex; i--) if (p->upper[i] == upper) after = i;
  Line line = edge(p->theta, knot(p, before, upper, 0), knot(p, after, upper, 1));
  return line.y + line.slope * (p->theta[END_ENTRIES + 2 * vertex] - line.x);
}

/* Move each corner that turns inwards to the other chain, where it makes a kink of the same sign outwards. */
static int turned(Polygon *p) {
  int count = 0;
  for (Int j = 0; j < p->m; j++) {
    double *y = p->theta + END_ENTRIES + 2 * j + 1, lift = *y - chord(p, j, (int)p->upper[j]);
    if ((lift < 0.0) == (p->upper[j] == 1) && lift != 0.0) {
      *y = clip(chord(p, j, 1 - (int)p->upper[j]) + lift, 0.0, 1.0);
      p->upper[j] = 1 - p->upper[j];
      count++;
    }
  }
  return count;
}

/* Try one kind of move on the polygon of m vertices; return whether one of one more, or less, got better. */
int improve(const Problem *s, int kind, Polygon *best, Int m, int convex, double *workspace) {
  Polygon starts[2 * MAX_VERTICES], *goal = best + (kind == SHRINK ? m - 1 : m + 1);
  double wanted = goal->cost; /* for all starts alike, which may be taken at once or in any order */
  Int count;
  int better = 0;
  if (kind == FIRST) count = first_places(s, best, starts);
  else if (kind == GROW) count = tacstrip_places(s, best + m, convex, starts, workspace);
  else count = without_each(best + m, starts);
  for (Int t = 0; t < count; t++) {
    Polygon *start = starts + t;
    double cost = tacstrip_descend(s, start, ROUGH, ENOUGH, wanted);
    if (convex && cost < wanted && turned(start)) {
      cost = tacstrip_descend(s, start, ROUGH, ENOUGH, wanted);
      if (turned(start)) continue;
    }
    if (cost < goal->cost - ROUNDING) {
      better = 1;
      *goal = *start;
    }
  }
  return better;
}

/* The area that a convex polygon shares with a ring: the triangles from its first corner, with their signs, each cut along every
   edge (Sutherland and Hodgman). */

#include "internal.h"

static double turn(const double *a, const double *b, const double *c) {
  return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
}

/* Whether a polygon turns left only, and once. */
static int is_convex(const double *ring, Int corners) {
  Int changes = 0;
  if (corners < 3) return 0;
  for (Int i = 0; i < corners; i++) {
    const double *a = ring + 2 * i, *b = ring + 2 * ((i + 1) % corners), *c = ring + 2 * ((i + 2) % corners);
    if (!(turn(a, b, c) > 0.0)) return 0;
    changes += (b[0] > a[0]) != (c[0] > b[0]);
  }
  return changes <= 2;
}

/* The signed area that a convex polygon shares with a triangle; room (4 (corners + 3),). */
static double triangle_overlap(const double *convex, Int corners, const double *a, const double *b, const double *c, double *room) {
  double *now = room, *next = room + 2 * (corners + 3), area = 0.0;
  Int size = 3;
  for (int k = 0; k < 2; k++) {
    now[k] = a[k];
    now[2 + k] = b[k];
    now[4 + k] = c[k];
  }
  for (Int edge = 0; edge < corners && size; edge++) {
    const double *from = convex + 2 * edge, *to = convex + 2 * ((edge + 1) % corners);
    Int written = 0;
    for (Int i = 0; i < size; i++) {
      const double *p = now + 2 * i, *q = now + 2 * ((i + 1) % size);
      double of_p = turn(from, to, p), of_q = turn(from, to, q);
      if (of_p >= 0.0) {
        next[2 * written] = p[0];
        next[2 * written++ + 1] = p[1];
      }
      if ((of_p >= 0.0) == (of_q >= 0.0)) continue;
      for (int k = 0; k < 2; k++) next[2 * written + k] = p[k] + of_p / (of_p - of_q) * (q[k] - p[k]);
      written++;
    }
    double *spare = now;
    now = next;
    next = spare;
    size = written;
  }
  for (Int i = 1; i + 1 < size; i++) area += 0.5 * turn(now, now + 2 * i, now + 2 * i + 2);
  return area;
}

Int tacstrip_convex_overlap(const double *convex, Int corners, const double *ring, Int count, double *areas, double *workspace) {
  if (!is_convex(convex, corners)) return 0;
  areas[0] = areas[1] = areas[2] = 0.0;
  for (Int i = 1; i + 1 < corners; i++) areas[0] += 0.5 * turn(convex, convex + 2 * i, convex + 2 * i + 2);
  for (Int i = 1; i + 1 < count; i++) {
    areas[1] += 0.5 * turn(ring, ring + 2 * i, ring + 2 * i + 2);
    areas[2] += triangle_overlap(convex, corners, ring, ring + 2 * i, ring + 2 * i + 2, workspace);
  }
  for (int i = 1; i < 3; i++) areas[i] = magnitude(areas[i]);
  return 1;
}

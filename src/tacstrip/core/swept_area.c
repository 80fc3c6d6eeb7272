/* Outlines as a covariance scatters them, and the area that their edges sweep: whether a shape is known at all. */

#include "internal.h"

#define SINGULAR 1e-12 /* of a variance: what is left of it once others are known, which rounding may leave */

void tacstrip_swept_areas(const double *vertices, const double *covariance, Int count, const double *normal, Int draws,
                          double *off, double *areas, double *workspace) {
  Int size = 2 * count;
  double *root = workspace, *edge = workspace + size * size, *step = edge + count; /* lower triangle, (count,), (count + 1,) */
  for (Int j = 0; j < size; j++) {
    for (Int i = j; i < size; i++) {
      double left = covariance[i * size + j];
      for (Int k = 0; k < j; k++) left -= root[i * size + k] * root[j * size + k];
      root[i * size + j] = left;
    }
    double own = root[j * size + j], scale = own > SINGULAR * covariance[j * size + j] ? 1.0 / sqrt(own) : 0.0;
    for (Int i = j; i < size; i++) root[i * size + j] *= scale;
  }
  for (Int i = 0; i < count; i++) {
    const double *a = vertices + 2 * i, *b = vertices + 2 * (i + 1 < count ? i + 1 : 0);
    edge[i] = sqrt((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]));
  }
  for (Int draw = 0; draw < draws; draw++, normal += size, off += size) {
    for (Int i = 0; i < size; i++) {
      double sum = 0.0;
      for (Int j = 0; j <= i; j++) sum += root[i * size + j] * normal[j];
      off[i] = sum;
    }
    for (Int i = 0; i < count; i++) step[i] = sqrt(off[2 * i] * off[2 * i] + off[2 * i + 1] * off[2 * i + 1]);
    step[count] = step[0];
    areas[draw] = 0.0;
    for (Int i = 0; i < count; i++)
      areas[draw] += larger(step[i], step[i + 1]) * (edge[i] + step[i] + step[i + 1]);
  }
}

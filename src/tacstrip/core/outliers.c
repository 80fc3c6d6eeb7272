/* Readings that no contact makes: before a fit a reading is suspected that neither the strips on its left, nor those on
   its right, nor both together predict. After it one is left out that lies alone far from the polygon. */

#include "internal.h"

#define FAR 6.0          /* sigmas from what the neighbours predict */
#define FAR_AT_ENDS 14.0 /* from what the line through two strips on one side predicts, itself uncertain by 2.2 */
#define FAR_FROM_FIT 5.0       /* sigmas from the polygon */
#define MOST 0.1         /* of the strips: more are not outliers but a wrong model */
#define ALLOWED 4        /* suspects on few strips: a fault, and strips beside a corner, which the fit explains */

/* The place of the reading v (n,) at x (n,) that is furthest from the nearest of what its neighbours predict, and how
   far, over what is far. */
static Int furthest(const double *x, const double *v, Int n, double *off, double *far) {
  Int worst = 0;
  for (Int i = 0; i < n; i++) off[i] = INFINITE;
  for (Int i = 1; i < n - 1; i++) {
    double before = x[i] - x[i - 1], after = x[i + 1] - x[i];
    double bend = (v[i + 1] - v[i]) / after - (v[i] - v[i - 1]) / before;
    bend = magnitude(bend);
    off[i] = smaller(off[i], bend / (1.0 / after + 1.0 / before));
    off[i - 1] = smaller(off[i - 1], bend * before); /* off the line through the two strips on the right */
    off[i + 1] = smaller(off[i + 1], bend * after);
  }
  for (Int i = 0; i < n; i++) {
    off[i] /= i == 0 || i == n - 1 ? FAR_AT_ENDS : FAR;
    if (off[i] > off[worst]) worst = i;
  }
  *far = off[worst];
  return worst;
}

void tacstrip_spikes(const double *k, Int n, double sigma, unsigned char *out, double *workspace) {
  double *x = workspace, *v = x + n, *off = v + n, far;
  Int left = 0, rounds = (Int)(MOST * (double)n);
  for (Int i = 0; i < n; i++) {
    out[i] = !(k[i] - k[i] == 0.0); /* NaN or infinite */
    if (out[i]) continue;
    x[left] = (double)i;
    v[left++] = k[i];
  }
  for (Int round = 0; round <= (rounds > ALLOWED ? rounds : ALLOWED) && left >= 5; round++) {
    Int worst = furthest(x, v, left, off, &far);
    if (far <= sigma) return;
    out[(Int)x[worst]] = 1;
    left--;
    for (Int i = worst; i < left; i++) { x[i] = x[i + 1]; v[i] = v[i + 1]; }
  }
  if (left < 5) return;
  for (Int i = 0; i < n; i++) out[i] = !(k[i] - k[i] == 0.0); /* so many are no spikes: the signal itself is rough */
}

Int tacstrip_isolated_outliers(const double *residuals, Int signatures, Int n, unsigned char *out) {
  Int count = 0;
  for (Int row = 0; row < signatures; row++) for (Int i = 0; i < n; i++) {
    const double *r = residuals + row * n;
    double far = magnitude(r[i]), beside = i > 0 ? magnitude(r[i - 1]) : 0.0;
    if (i < n - 1) beside = larger(beside, magnitude(r[i + 1]));
    out[row * n + i] = far > FAR_FROM_FIT && beside < 0.5 * far;
    count += out[row * n + i];
  }
  if ((double)count <= larger(MOST * (double)n, 1.0)) return count;
  for (Int i = 0; i < signatures * n; i++) out[i] = 0;
  return 0;
}

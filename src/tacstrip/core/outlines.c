/* Points of a feasible set as outlines, and how they scatter about their mean. */

#include "internal.h"

#define ALIKE 0.1     /* of the points: if fewer are worth as much as all, they do not tell of vertices */
#define LEVEL 0.95    /* of a region */
#define NORMAL 1.959964 /* standard deviations to its edge */
#define FLAT 1e-15 /* of a scatter's greater axis: a lesser one is none */

static double line_at(const Lines *lines, const double *heights, Int line, double x) {
  const double *reach = lines->reach + 2 * line, *h = heights + 2 * line;
  return h[0] + (h[1] - h[0]) * (x - reach[0]) / (reach[1] - reach[0]);
}

/* Where two lines cross; not finite for parallel ones. */
static double cross(const Lines *lines, const double *heights, Int first, Int second) {
  double origin = lines->reach[2 * first];
  double gap = line_at(lines, heights, second, origin) - line_at(lines, heights, first, origin);
  double next = line_at(lines, heights, second, origin + 1.0) - line_at(lines, heights, first, origin + 1.0);
  return origin - gap / (next - gap);
}

static double slope_of(const Lines *lines, const double *heights, Int line) {
  return (heights[2 * line + 1] - heights[2 * line]) / (lines->reach[2 * line + 1] - lines->reach[2 * line]);
}

double line_chains(const Lines *lines, const double *heights, const double *vertical_x, double *lower, double *upper) {
  double ends[2], run = 1.0, turn = 1.0;
  for (int end = 0; end < 2; end++) {
    Int first = end ? lines->lower - 1 : 0, second = end ? lines->count - 1 : lines->lower;
    ends[end] = lines->vertical[end] ? vertical_x[end] : cross(lines, heights, first, second);
    if (!lines->vertical[end]) turn *= magnitude(slope_of(lines, heights, second) - slope_of(lines, heights, first));
  }
  for (int side = 0; side < 2; side++) {
    Int start = side ? lines->lower : 0, count = side ? lines->count - lines->lower : lines->lower;
    double *chain = side ? upper : lower;
    for (Int i = 0; i <= count; i++) {
      Int line = start + (i < count ? i : count - 1);
      double x = i == 0 ? ends[0] : i == count ? ends[1] : cross(lines, heights, line - 1, line);
      chain[2 * i] = x;
      chain[2 * i + 1] = line_at(lines, heights, line, x);
      if (i > 0) run *= larger(x - chain[2 * i - 2], 0.0);
      if (i > 0 && i < count)
        turn *= magnitude(slope_of(lines, heights, line) - slope_of(lines, heights, line - 1));
    }
  }
  Int last = lines->count - lines->lower;
  for (int i = 0; i < 2; i++) {
    if (!lines->vertical[0]) upper[i] = lower[i];
    if (!lines->vertical[1]) upper[2 * last + i] = lower[2 * lines->lower + i];
  }
  return run / turn;
}

Int tacstrip_outlines(const Lines *lines, const double *windows, double length, const double *points,
                      const double *vertical_x, Int count, double *lower, double *upper, double *workspace) {
  Int size = 2 * lines->count, own = 2 * (lines->lower + 1), other = size - own + 4;
  double *every = workspace, *weight = every + count * (own + other), most = -INFINITE, total = 0.0, squares = 0.0;
  for (Int k = 0; k < count; k++) {
    double *chain = every + k * (own + other);
    weight[k] = line_chains(lines, points + k * size, vertical_x + 2 * k, chain, chain + own);
    double left = chain[0], right = chain[own - 2]; /* a bound may have been too far to be met */
    if (left < windows[0] || left > windows[1] || right < windows[2] || right > windows[3]) weight[k] = 0.0;
    if (!(weight[k] < INFINITE)) return 0;
    most = larger(most, weight[k]);
  }
  if (!(most > 0.0)) return 0;
  for (Int k = 0; k < count; k++) {
    double share = weight[k] / most;
    total += share;
    squares += share * share;
    weight[k] = total;
  }
  if (total * total < ALIKE * (double)count * squares) return 0;
  for (Int k = 0, from = 0; k < count; k++) {
    double place = ((double)k + 0.5) / (double)count * total;
    while (from < count - 1 && weight[from] < place) from++;
    const double *chain = every + from * (own + other);
    for (Int i = 0; i < own; i++) lower[k * own + i] = i % 2 ? clip(chain[i], 0.0, length) : chain[i];
    for (Int i = 0; i < other; i++) upper[k * other + i] = i % 2 ? clip(chain[own + i], 0.0, length) : chain[own + i];
  }
  return 1;
}

/* The level's quantile of values (n,), which are moved about. */
static double quantile(double *values, Int n) {
  double place = (double)(n - 1) * LEVEL;
  Int below = (Int)place;
  double low = threshold(values, n, n - below), share = place - (double)below;
  return share > 0.0 ? low + (threshold(values, n, n - below - 1) - low) * share : low;
}

/* Write the moments of polygons v (V, 2, padded) about their estimate's centre: area and centroid, each (padded,); and
   xx - yy and 2 xy about the centroid. */
static void polygon_moments(const double *v, Int vertices, Int n, double *area, double *x, double *y, double *apart,
                            double *mixed) {
  for (Int k = 0; k < n; k++) area[k] = x[k] = y[k] = apart[k] = mixed[k] = 0.0;
  for (Int i = 0; i < vertices; i++) {
    const double *x0 = v + 2 * i * n, *y0 = x0 + n, *x1 = v + 2 * (i + 1 < vertices ? i + 1 : 0) * n, *y1 = x1 + n;
    for (Int k = 0; k < n; k++) {
      double cross = x0[k] * y1[k] - x1[k] * y0[k];
      area[k] += 0.5 * cross;
      x[k] += (x0[k] + x1[k]) * cross / 6.0;
      y[k] += (y0[k] + y1[k]) * cross / 6.0;
    }
  }
  for (Int k = 0; k < n; k++) {
    x[k] /= area[k];
    y[k] /= area[k];
  }
  for (Int i = 0; i < vertices; i++) {
    const double *px = v + 2 * i * n, *py = px + n, *qx = v + 2 * (i + 1 < vertices ? i + 1 : 0) * n, *qy = qx + n;
    for (Int k = 0; k < n; k++) {
      double x0 = px[k] - x[k], y0 = py[k] - y[k], x1 = qx[k] - x[k], y1 = qy[k] - y[k], cross = x0 * y1 - x1 * y0;
      apart[k] += (x0 * x0 + x0 * x1 + x1 * x1 - y0 * y0 - y0 * y1 - y1 * y1) * cross;
      mixed[k] += (x0 * y1 + 2.0 * x0 * y0 + 2.0 * x1 * y1 + x1 * y0) * cross;
    }
  }
}

void tacstrip_scatter(const double *lower, const double *upper, const Int *lower_at, const Int *upper_at, Int lowers,
                      Int uppers, const double *mean, Int vertices, Int count, double *covariance, double *radii,
                      double *deviations, double *workspace) {
  Int n = (count + LANES - 1) / LANES * LANES, coordinates = 2 * vertices;
  double *off = workspace, *sum = off + coordinates * n, *moment[6], times[2 * SIZE], centre[2] = {0.0, 0.0}, at[5];
  double over = 1.0 / (double)(count - 1);
  CHECK(vertices <= 2 * SIZE);
  for (int i = 0; i < 6; i++) moment[i] = sum + coordinates + i * n;
  for (Int i = 0; i < vertices; i++) {
    times[i] = 0.0;
    centre[0] += mean[2 * i] / (double)vertices;
    centre[1] += mean[2 * i + 1] / (double)vertices;
  }
  for (Int i = 0; i < coordinates * n; i++) off[i] = 0.0;
  for (int side = 0; side < 2; side++) {
    const double *chain = side ? upper : lower;
    const Int *place = side ? upper_at : lower_at;
    Int length = side ? uppers : lowers;
    for (Int i = 0; i < length; i++) {
      times[place[i]] += 1.0;
      for (int axis = 0; axis < 2; axis++) for (Int k = 0; k < count; k++)
        off[(2 * place[i] + axis) * n + k] += chain[2 * (k * length + i) + axis];
    }
  }
  /* Polygons of the sample, moved to about 0; then the estimate as one more. */
  for (Int i = 0; i < coordinates; i++) for (Int k = 0; k < count; k++)
    off[i * n + k] = off[i * n + k] / times[i / 2] - centre[i % 2];
  polygon_moments(off, vertices, n, moment[0], moment[1], moment[2], moment[3], moment[4]);
  for (Int i = 0; i < coordinates; i++) sum[i] = mean[i] - centre[i % 2];
  polygon_moments(sum, vertices, 1, at, at + 1, at + 2, at + 3, at + 4);
  for (int i = 0; i < 3; i++) {
    for (Int k = 0; k < count; k++) {
      double by = magnitude(moment[i][k] - at[i]);
      moment[5][k] = by == by ? by : INFINITE;
    }
    deviations[i] = quantile(moment[5], count) / NORMAL;
  }
  for (Int k = 0; k < count; k++) { /* half the angle between (xx - yy, 2 xy) and the estimate's, as its tangent */
    double along = moment[3][k] * at[3] + moment[4][k] * at[4];
    double across = magnitude(moment[3][k] * at[4] - moment[4][k] * at[3]);
    double below = sqrt(along * along + across * across) + along;
    moment[5][k] = arctangent(below > 0.0 ? across / below : INFINITE);
  }
  deviations[3] = quantile(moment[5], count) / NORMAL;
  for (Int i = 0; i < coordinates; i++) {
    double *own = off + i * n;
    double shift = mean[i] - centre[i % 2];
    sum[i] = 0.0;
    for (Int k = 0; k < count; k++) {
      own[k] -= shift;
      sum[i] += own[k];
    }
    for (Int k = count; k < n; k++) own[k] = 0.0;
  }
  for (Int i = 0; i < coordinates; i++) for (Int j = 0; j <= i; j++)
    covariance[i * coordinates + j] = covariance[j * coordinates + i] =
        (lane_product(off + i * n, off + j * n, n) - sum[i] * sum[j] / (double)count) * over;
  for (Int i = 0; i < vertices; i++) {
    const double *x = off + 2 * i * n, *y = x + n;
    double xx = lane_product(x, x, n) * over, xy = lane_product(x, y, n) * over, yy = lane_product(y, y, n) * over;
    double middle = 0.5 * (xx + yy), half = sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy);
    double great = middle + half, small = (xx * yy - xy * xy) / great;
    if (small > FLAT * great) {
      for (Int k = 0; k < count; k++)
        moment[5][k] = (yy * x[k] * x[k] - 2.0 * xy * x[k] * y[k] + xx * y[k] * y[k]) / (great * small);
    } else { /* along its one axis */
      double norm = great * great;
      for (Int k = 0; k < count; k++)
        moment[5][k] = great > 0.0 ? (xx * x[k] * x[k] + 2.0 * xy * x[k] * y[k] + yy * y[k] * y[k]) / norm : 0.0;
    }
    radii[i] = quantile(moment[5], count);
  }
}

/* Points of a set of bounds, and the least value of a linear form in it. */

#include "inside.h"

#define ROUNDING 1e-9
#define SLANTED 1e-7 /* a row less against the direction than this depends on the met ones; to pass it by is safe */

/* How far one can go while slack s1 - d r1 or s2 - d r2 is not below 0, from d = 0 on. */
static double held(double s1, double s2, double r1, double r2) {
  double s = larger(s1, s2), t = s1 < s2 ? s1 : s2, r = s1 < s2 ? r2 : r1, q = s1 < s2 ? r1 : r2;
  double reach = r > 0.0 ? larger(s, 0.0) / r : INFINITE;
  if (t >= 0.0) return larger(reach, q > 0.0 ? t / q : INFINITE);
  return q < 0.0 && t / q <= reach ? INFINITE : reach;
}

/* The largest and the smallest of row / (slack - cut), at least 0 and at most 0 but for a trace. */
static void steepest(const double *row, const double *slack, const double *cut, Int rows, double *up, double *down) {
  Pack high = all(1e-300), low = all(-1e-300);
  double highs[WIDTH], lows[WIDTH];
  Int i = 0;
  for (; i + WIDTH <= rows; i += WIDTH) {
    Pack q = load(row + i) / (load(slack + i) - load(cut + i));
    high = where(q > high, q, high);
    low = where(q < low, q, low);
  }
  store(highs, high);
  store(lows, low);
  *up = 1e-300;
  *down = -1e-300;
  for (int j = 0; j < WIDTH; j++) {
    *up = larger(*up, highs[j]);
    *down = smaller(*down, lows[j]);
  }
  for (; i < rows; i++) {
    double q = row[i] / (slack[i] - cut[i]);
    if (q > *up) *up = q;
    if (q < *down) *down = q;
  }
}

void tacstrip_walk(const double *a, double *slack, const double *edges, const double *pair_a, double *pair_slack,
                   const double *pair_edge, const double *draws, double *out, Int sweeps, Int rows, Int pairs, Int size,
                   double *workspace) {
  double *cut = workspace, *pair_cut = cut + rows, *z = pair_cut + pairs;
  for (Int j = 0; j < size; j++) z[j] = 0.0;
  for (Int sweep = 0; sweep < sweeps; sweep++) {
    const double *draw = draws + sweep * (rows + pairs + size);
    for (Int i = 0; i < rows; i++) cut[i] = draw[i] * smaller(edges[i], slack[i]);
    for (Int i = 0; i < pairs; i++) {
      double room = larger(pair_slack[2 * i], pair_slack[2 * i + 1]);
      pair_cut[i] = draw[rows + i] * smaller(pair_edge[i], room);
    }
    for (Int j = 0; j < size; j++) {
      const double *row = a + j * rows, *pair = pair_a + 2 * j * pairs;
      double up, down;
      steepest(row, slack, cut, rows, &up, &down);
      double high = 1.0 / up, low = 1.0 / down;
      for (Int i = 0; i < pairs; i++) {
        double s1 = pair_slack[2 * i] - pair_cut[i], s2 = pair_slack[2 * i + 1] - pair_cut[i];
        high = smaller(high, held(s1, s2, pair[2 * i], pair[2 * i + 1]));
        low = larger(low, -held(s1, s2, -pair[2 * i], -pair[2 * i + 1]));
      }
      double step = low + (high - low) * draw[rows + pairs + j];
      z[j] += step;
      for (Int i = 0; i < rows; i++) slack[i] -= step * row[i];
      for (Int i = 0; i < 2 * pairs; i++) pair_slack[i] -= step * pair[i];
    }
    for (Int j = 0; j < size; j++) out[sweep * size + j] = z[j];
  }
}

static double dot(const double *a, const double *b, Int n) {
  double sum = 0.0;
  for (Int i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

/* Write an orthonormal basis of the met rows (met, size), and R of a = R' basis, as columns of root (size, size). */
static void orthonormal(const double *a, const Int *active, Int met, Int size, double *basis, double *root) {
  for (Int q = 0; q < met; q++) {
    double *own = basis + q * size;
    for (Int p = 0; p < size; p++) own[p] = a[active[q] * size + p];
    for (Int r = 0; r < q; r++) root[r * size + q] = 0.0;
    for (int twice = 0; twice < 2; twice++) for (Int r = 0; r < q; r++) {
      double by = dot(basis + r * size, own, size);
      root[r * size + q] += by;
      for (Int p = 0; p < size; p++) own[p] -= by * basis[r * size + p];
    }
    double norm = sqrt(dot(own, own, size));
    root[q * size + q] = norm;
    for (Int p = 0; p < size; p++) own[p] /= norm;
  }
}

double tacstrip_lowest(const double *form, const double *a, const double *slack, double *at, Int *active, Int rows,
                       Int size, double *workspace) {
  double *basis = workspace, *root = basis + size * size, *direction = root + size * size, *multiplier = direction + size;
  double *is_met = multiplier + size, scale = 0.0;
  Int met = 0;
  for (Int i = 0; i < rows; i++) is_met[i] = 0.0;
  for (; met < size && active[met] >= 0; met++) {
    CHECK(active[met] < rows);
    is_met[active[met]] = 1.0;
  }
  for (Int p = 0; p < size; p++) scale = larger(scale, magnitude(form[p]));
  for (Int round = 0; round < 40 * size; round++) {
    orthonormal(a, active, met, size, basis, root);
    for (Int p = 0; p < size; p++) direction[p] = -form[p];
    for (Int q = 0; q < met; q++) {
      multiplier[q] = dot(basis + q * size, direction, size);
      for (Int p = 0; p < size; p++) direction[p] -= multiplier[q] * basis[q * size + p];
    }
    double length = 0.0;
    for (Int p = 0; p < size; p++) length = larger(length, magnitude(direction[p]));
    if (met == size || length <= ROUNDING * scale) {
      Int worst = -1;
      for (Int q = met - 1; q >= 0; q--) {
        for (Int r = q + 1; r < met; r++) multiplier[q] -= root[q * size + r] * multiplier[r];
        multiplier[q] /= root[q * size + q];
      }
      for (Int q = 0; q < met; q++)
        if (multiplier[q] < -ROUNDING * scale && (worst < 0 || multiplier[q] < multiplier[worst])) worst = q;
      if (worst < 0) {
        double value = 0.0; /* of the dual: a bound whatever the rounding of `at` */
        for (Int q = 0; q < met; q++) value -= larger(multiplier[q], 0.0) * slack[active[q]];
        return value;
      }
      is_met[active[worst]] = 0.0;
      for (Int q = worst; q < met - 1; q++) active[q] = active[q + 1];
      active[--met] = -1;
      continue;
    }
    double step = INFINITE;
    Int row = -1;
    for (Int i = 0; i < rows; i++) {
      if (is_met[i] != 0.0) continue;
      double along = dot(a + i * size, direction, size), room = larger(slack[i] - dot(a + i * size, at, size), 0.0);
      if (along > SLANTED * length && room < step * along) {
        step = room / along;
        row = i;
      }
    }
    if (row < 0) return -INFINITE;
    for (Int p = 0; p < size; p++) at[p] += step * direction[p];
    active[met++] = row;
    is_met[row] = 1.0;
  }
  return -INFINITE;
}

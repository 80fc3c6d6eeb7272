/* Linear programs over a polytope, and the analytic centre of what they find. A row is a column of a (size, rows), so
   that loops run over neighbouring rows and no sum depends on how many of them a CPU takes at once. */

#include "lanes.h"

#define ROUNDING 1e-9
#define SLANTED 1e-7 /* a row less against the direction than this depends on the met ones; to pass it by is safe */
#define ROUNDS 12    /* of adding the rows that are broken most */
#define FIRST_ROWS 6 /* rows to begin with, per dimension */
#define MORE_ROWS 2  /* rows to add in a round, per dimension */
#define FLAT 1e-8    /* of the scale: a polytope as thin has no inside */
#define NEAREST 24   /* rows per dimension that the centre keeps away from */
#define SELECTIONS 3
#define STEPS 10
#define CENTRED 1e-3 /* squared Newton decrement */
#define GAIN 1e-4    /* of the scale: a fall by less is none */
#define BLOCK 64     /* rows that are worked on while they are in the cache */

static double dot(const double *a, const double *b, Int n) {
  double sum = 0.0;
  for (Int i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

void row_products(const double *a, Int rows, Int size, const double *v, double *out) {
  for (Int first = 0; first < rows; first += 4 * BLOCK) {
    Int count = first + 4 * BLOCK < rows ? 4 * BLOCK : rows - first;
    double *own = out + first;
    for (Int i = 0; i < count; i++) own[i] = 0.0;
    for (Int p = 0; p < size; p++) {
      const double *row = a + p * rows + first, by = v[p];
      for (Int i = 0; i < count; i++) own[i] += by * row[i];
    }
  }
}

double threshold(double *values, Int n, Int count) {
  Int low = 0, high = n - 1, wanted = count - 1;
  while (low < high) {
    double pivot = values[(low + high) / 2];
    Int i = low, j = high;
    while (i <= j) {
      while (values[i] > pivot) i++;
      while (values[j] < pivot) j--;
      if (i <= j) {
        double swap = values[i];
        values[i++] = values[j];
        values[j--] = swap;
      }
    }
    if (wanted <= j) high = j;
    else if (wanted >= i) low = i;
    else break;
  }
  return values[wanted];
}

Int mark_largest(const double *values, Int n, Int count, double *marked, double *scratch) {
  Int above = 0, total = 0;
  double least = -INFINITE;
  if (count < n) {
    for (Int i = 0; i < n; i++) scratch[i] = values[i] == values[i] ? values[i] : -INFINITE;
    least = threshold(scratch, n, count);
    for (Int i = 0; i < n; i++) above += values[i] > least;
  }
  Int equal = count < n ? count - above : n;
  for (Int i = 0; i < n; i++) {
    if (count < n && !(values[i] > least) && !(values[i] == least && equal-- > 0)) continue;
    marked[i] = 1.0;
  }
  for (Int i = 0; i < n; i++) total += marked[i] != 0.0;
  return total;
}

/* Write an orthonormal basis of the met rows (met, size), and R of a = R' basis, as columns of root (size, size), from
   the met row `from` on. */
static void orthonormal(const double *a, Int rows, const Int *active, Int from, Int met, Int size, double *basis,
                        double *root) {
  for (Int q = from; q < met; q++) {
    double *own = basis + q * size;
    for (Int p = 0; p < size; p++) own[p] = a[p * rows + active[q]];
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
  double *is_met = multiplier + size, *room = is_met + rows, *along = room + rows, scale = 0.0;
  Int met = 0, known = 0;
  for (Int i = 0; i < rows; i++) is_met[i] = 0.0;
  for (; met < size && active[met] >= 0; met++) {
    CHECK(active[met] < rows);
    is_met[active[met]] = 1.0;
  }
  for (Int p = 0; p < size; p++) scale = larger(scale, magnitude(form[p]));
  row_products(a, rows, size, at, room);
  for (Int i = 0; i < rows; i++) room[i] = slack[i] - room[i];
  for (Int round = 0; round < 40 * size; round++) {
    orthonormal(a, rows, active, known, met, size, basis, root);
    known = met;
    for (Int p = 0; p < size; p++) direction[p] = -form[p];
    for (Int q = 0; q < met; q++) multiplier[q] = 0.0;
    /* Twice: a short rest leans on the met rows by the rounding of the whole form, and one that they carry is met anew. */
    for (int twice = 0; twice < 2; twice++) for (Int q = 0; q < met; q++) {
      double by = dot(basis + q * size, direction, size);
      multiplier[q] += by;
      for (Int p = 0; p < size; p++) direction[p] -= by * basis[q * size + p];
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
      known = worst;
      continue;
    }
    double step = INFINITE;
    Int row = -1;
    row_products(a, rows, size, direction, along);
    for (Int i = 0; i < rows; i++) {
      if (!(along[i] > SLANTED * length) || is_met[i] != 0.0) continue;
      double left = larger(room[i], 0.0);
      if (left < step * along[i]) {
        step = left / along[i];
        row = i;
      }
    }
    if (row < 0) return -INFINITE;
    for (Int p = 0; p < size; p++) at[p] += step * direction[p];
    for (Int i = 0; i < rows; i++) room[i] -= step * along[i];
    active[met++] = row;
    is_met[row] = 1.0;
  }
  return -INFINITE;
}

/* Write a at - b (rows,), and return the largest; NaN where there is one. */
static double violation(const double *a, const double *b, const double *at, Int rows, Int size, double *broken) {
  double worst = -INFINITE;
  row_products(a, rows, size, at, broken);
  for (Int i = 0; i < rows; i++) {
    broken[i] -= b[i];
    if (broken[i] > worst || broken[i] != broken[i]) worst = broken[i];
    if (worst != worst) break;
  }
  return worst;
}

Int tacstrip_minimax(const double *a, const double *b, double *at, double scale, Int rows, Int size, double *outside,
                     double *workspace) {
  Int active[SIZE + 1], deep = size + 1;
  double point[SIZE + 1], form[SIZE + 1];
  double *broken = workspace, *used = broken + rows, *scratch = used + rows, *lp = scratch + rows;
  CHECK(0 < size && size <= SIZE);
  double worst = violation(a, b, at, rows, size, broken);
  *outside = worst;
  if (worst < 0.0 || !(worst < INFINITE)) return !(worst < 0.0);
  for (Int i = 0; i < rows; i++) used[i] = 0.0;
  for (Int p = 0; p < deep; p++) form[p] = p == size;
  Int count = mark_largest(broken, rows, FIRST_ROWS * size, used, scratch) + 1;
  for (Int round = 0; round < ROUNDS; round++) {
    /* Least t with a at - t <= b over the rows in use, and t >= -scale. */
    double *slack = lp + deep * count;
    Int column = 0;
    for (Int i = 0; i < rows; i++) {
      if (used[i] == 0.0) continue;
      for (Int p = 0; p < size; p++) lp[p * count + column] = a[p * rows + i];
      lp[size * count + column] = -1.0;
      slack[column++] = -broken[i];
    }
    for (Int p = 0; p < deep; p++) lp[p * count + column] = -form[p];
    slack[column] = scale;
    for (Int p = 0; p < deep; p++) {
      point[p] = p == size ? worst : 0.0;
      active[p] = -1;
    }
    double least = tacstrip_lowest(form, lp, slack, point, active, count, deep, slack + count);
    if (!(least > -INFINITE)) return 0; /* rounding led it astray */
    for (Int p = 0; p < size; p++) at[p] += point[p];
    if (least > -FLAT * scale) {
      *outside = larger(worst, 0.0);
      return 1;
    }
    worst = *outside = violation(a, b, at, rows, size, broken);
    if (worst < 0.0 || worst != worst) return 0;
    count = mark_largest(broken, rows, MORE_ROWS * size, used, scratch) + 1;
  }
  return 0;
}

void forward_rows(Matrix u, const double *a, Int stride, Int rows, Int size, double *out) {
  for (Int p = 0; p < size; p++) {
    double *own = out + p * rows, over = 1.0 / u[p][p];
    for (Int i = 0; i < rows; i++) own[i] = a[p * stride + i];
    for (Int q = 0; q < p; q++) {
      const double *known = out + q * rows, by = u[q][p];
      for (Int i = 0; i < rows; i++) own[i] -= by * known[i];
    }
    for (Int i = 0; i < rows; i++) own[i] *= over;
  }
}

double lane_product(const double *a, const double *b, Int n) {
  Pack sum[PACKS];
  for (int j = 0; j < PACKS; j++) sum[j] = all(0.0);
  for (Int i = 0; i < n; i += LANES)
    for (int j = 0; j < PACKS; j++) sum[j] += load(a + i + j * WIDTH) * load(b + i + j * WIDTH);
  return joined(sum);
}

/* Write the rows that are marked over their slack (size, padded), the gradient of the barrier and its curvature. */
static void barrier(const double *a, const double *slack, const double *near, Int rows, Int size, Int padded,
                    double *scaled, double *gradient, double *curvature) {
  Int column = 0;
  for (Int i = 0; i < rows; i++) {
    if (near[i] == 0.0) continue;
    double over = 1.0 / slack[i];
    for (Int p = 0; p < size; p++) scaled[p * padded + column] = a[p * rows + i] * over;
    column++;
  }
  for (; column < padded; column++) for (Int p = 0; p < size; p++) scaled[p * padded + column] = 0.0;
  for (Int p = 0; p < size; p++) {
    double sum = 0.0;
    for (Int i = 0; i < padded; i++) sum += scaled[p * padded + i];
    gradient[p] = sum;
    for (Int q = 0; q <= p; q++)
      curvature[p * size + q] = curvature[q * size + p] = lane_product(scaled + p * padded, scaled + q * padded, padded);
  }
}

/* Factor a curvature whose diagonal is made 1; 0 where it is not positive definite. */
static int factor_scaled(const double *curvature, Int size, double *scale, Matrix u) {
  for (Int p = 0; p < size; p++) {
    if (!(curvature[p * size + p] > 0.0)) return 0;
    scale[p] = 1.0 / sqrt(curvature[p * size + p]);
  }
  for (Int p = 0; p < size; p++) {
    for (Int q = p; q < size; q++) u[p][q] = curvature[p * size + q] * scale[p] * scale[q];
    u[p][p] += 1e-13;
  }
  return factor(u, size);
}

void tacstrip_analytic_centre(const double *a, const double *b, double *at, double *curvature, Int rows, Int size,
                              double *workspace) {
  Matrix u;
  double scale[SIZE], gradient[SIZE], step[SIZE];
  double *slack = workspace, *near = slack + rows, *along = near + rows, *scratch = along + rows;
  double *block = scratch + rows, *scaled = block + BLOCK * size;
  CHECK(0 < size && size <= SIZE);
  row_products(a, rows, size, at, along);
  for (Int i = 0; i < rows; i++) {
    slack[i] = b[i] - along[i];
    along[i] = -slack[i];
    near[i] = 0.0;
  }
  Int count = mark_largest(along, rows, NEAREST * size, near, scratch);
  for (int selection = 0; selection < SELECTIONS; selection++) {
    Int padded = (count + LANES - 1) / LANES * LANES;
    for (int times = 0; times < STEPS; times++) {
      barrier(a, slack, near, rows, size, padded, scaled, gradient, curvature);
      if (!factor_scaled(curvature, size, scale, u)) return;
      for (Int p = 0; p < size; p++) step[p] = -gradient[p] * scale[p];
      solve(u, size, step);
      double decrement = 0.0, steepest = 1e-300, length, least = INFINITE;
      for (Int p = 0; p < size; p++) {
        step[p] *= scale[p];
        decrement -= gradient[p] * step[p];
      }
      row_products(a, rows, size, step, along);
      for (Int i = 0; i < rows; i++) if (along[i] > steepest * slack[i]) steepest = along[i] / slack[i];
      length = smaller(1.0, 0.7 / steepest);
      for (Int i = 0; i < rows; i++) {
        scratch[i] = slack[i] - length * along[i];
        least = smaller(least, scratch[i]);
      }
      if (!(least > 0.0)) break; /* as far as rounding lets one go */
      for (Int i = 0; i < rows; i++) slack[i] = scratch[i];
      for (Int p = 0; p < size; p++) at[p] += length * step[p];
      if (decrement < CENTRED) break;
    }
    /* Near is what is few steps of the barrier's own size away, in whichever direction. */
    barrier(a, slack, near, rows, size, padded, scaled, gradient, curvature);
    if (!factor_scaled(curvature, size, scale, u)) return;
    for (Int p = 0; p < size; p++) for (Int q = p; q < size; q++) u[p][q] /= scale[q];
    for (Int first = 0; first < rows; first += BLOCK) {
      Int some = first + BLOCK < rows ? BLOCK : rows - first;
      forward_rows(u, a + first, rows, some, size, block);
      for (Int i = 0; i < some; i++) {
        double square = 0.0;
        for (Int p = 0; p < size; p++) square += block[p * some + i] * block[p * some + i];
        along[first + i] = sqrt(square) / slack[first + i];
        near[first + i] = 0.0;
      }
    }
    count = mark_largest(along, rows, NEAREST * size, near, scratch);
  }
  barrier(a, slack, near, rows, size, (count + LANES - 1) / LANES * LANES, scaled, gradient, curvature);
}

Int tacstrip_feasible_part(const double *a, const double *b, const double *pair_a, const double *pair_b, double *at,
                           double *curvature, double scale, Int most, Int rows, Int pairs, Int size, double *workspace) {
  Int total = rows + pairs;
  double *part = workspace, *limit = part + total * size, *first = limit + total, *second = first + pairs;
  double *rest = second + pairs, before = INFINITE, outside;
  for (Int p = 0; p < size; p++) for (Int i = 0; i < rows; i++) part[p * total + i] = a[p * rows + i];
  for (Int i = 0; i < rows; i++) limit[i] = b[i];
  for (Int round = 1; round <= most; round++) {
    for (Int i = 0; i < pairs; i++) first[i] = second[i] = 0.0;
    for (Int p = 0; p < size; p++) for (Int i = 0; i < pairs; i++) {
      first[i] += at[p] * pair_a[2 * p * pairs + i];
      second[i] += at[p] * pair_a[(2 * p + 1) * pairs + i];
    }
    for (Int i = 0; i < pairs; i++) {
      Int kept = second[i] - pair_b[pairs + i] < first[i] - pair_b[i];
      for (Int p = 0; p < size; p++) part[p * total + rows + i] = pair_a[(2 * p + kept) * pairs + i];
      limit[rows + i] = pair_b[kept * pairs + i];
    }
    tacstrip_minimax(part, limit, at, scale, total, size, &outside, rest);
    if (outside < 0.0) {
      tacstrip_analytic_centre(part, limit, at, curvature, total, size, rest);
      return round;
    }
    if (pairs == 0 || !(outside <= before - GAIN * scale)) return -round;
    before = outside;
  }
  return -most;
}

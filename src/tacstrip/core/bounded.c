/* What the readings' bounds leave of a least-squares outline, in one call: its edges' lines, a point inside the set of their
   heights, a walk from there, and the mean and scatter of the outlines met. */

#include "closed_form.h"

#define REACH 4.0      /* standard errors of least squares within which a kink is looked for */
#define EFFORT 1500.0  /* for one outline */
#define DESCENTS 8     /* rounds of one */
#define SCALE 0.01     /* of the strip length: far outside */
#define BENT 0.05      /* of a reading's band: by how much the mean may leave it, as the set is not quite convex */
#define USED_ROWS 30   /* per dimension, that a minimax fit works on at most */
#define NEAREST 24     /* rows per dimension that the centre keeps away from */

/* A least-squares outline, as its lines; chains (count, 2). */
typedef struct {
  const double *chain[2];
  Int count[2];
  double reach[2 * SIZE], heights[SIZE], zones[2 * SIZE];
  Int turns[SIZE];
  Lines lines;
} Start;

static void lines_of(const double *lower, Int lowers, const double *upper, Int uppers, Start *start) {
  const double *chain[2] = {lower, upper};
  Int count[2] = {lowers, uppers}, line = 0, kink = 0;
  for (int side = 0; side < 2; side++) {
    double before = 0.0;
    start->chain[side] = chain[side];
    start->count[side] = count[side];
    for (Int i = 0; i + 1 < count[side]; i++, line++) {
      const double *a = chain[side] + 2 * i;
      double slope = (a[3] - a[1]) / (a[2] - a[0]);
      for (int end = 0; end < 2; end++) {
        start->reach[2 * line + end] = a[2 * end];
        start->heights[2 * line + end] = a[2 * end + 1];
      }
      if (i > 0) start->turns[kink++] = slope - before >= 0.0 ? 1 : -1;
      before = slope;
    }
  }
  start->lines.count = line;
  start->lines.lower = lowers - 1;
  start->lines.vertical[0] = lower[1] != upper[1];
  start->lines.vertical[1] = lower[2 * lowers - 1] != upper[2 * uppers - 1];
  start->lines.reach = start->reach;
  start->lines.turns = start->turns;
}

/* Zones about the kinks, that end halfway to the next kink of the chain and at the outer strips. */
static void zones_of(const Band *band, double pitch, const double *covariance, Start *start) {
  Int size = 2 * (start->count[0] + start->count[1] - !start->lines.vertical[0] - !start->lines.vertical[1]);
  Int last = start->count[0] + start->count[1] - 1 - !start->lines.vertical[1], kink = 0;
  double least = 0.5 * pitch, first = band->x[0], end = band->x[band->n - 1];
  for (int side = 0; side < 2; side++) {
    double before = 0.0;
    for (Int i = 1; i + 1 < start->count[side]; i++, kink++) {
      Int place = 2 * (side ? last - i : i);
      double x = clip(start->chain[side][2 * i], first + least, end - least);
      double error = sqrt(covariance[place * size + place]), *zone = start->zones + 2 * kink;
      double reach = error - error == 0.0 ? larger(REACH * error, least) : INFINITE;
      zone[0] = x - reach;
      zone[1] = x + reach;
      if (i > 1) {
        double middle = 0.5 * (x + before);
        zone[0] = larger(zone[0], middle);
        zone[-1] = smaller(zone[-1], middle);
      }
      before = x;
    }
  }
  for (Int i = 0; i < 2 * kink; i++) start->zones[i] = clip(start->zones[i], first, end);
}

/* The contact's length on each strip, thrice (3, n). */
static void widths_of(const Band *band, const double *lower, Int lowers, const double *upper, Int uppers, double *widths) {
  for (Int i = 0; i < band->n; i++) {
    double w = interpolated(upper, uppers, band->x[i]) - interpolated(lower, lowers, band->x[i]);
    for (int part = 0; part < 3; part++) widths[part * band->n + i] = larger(w, 0.0);
  }
}

static Int most(Int a, Int b) { return a > b ? a : b; }

/* Doubles that minimax, the centre, feasible_part and hit_and_run work in, whichever is more. */
static Int inner_room(Int rows, Int pairs, Int size) {
  Int total = rows + pairs, used = total < USED_ROWS * size ? total : USED_ROWS * size;
  Int near = total < NEAREST * size ? total : NEAREST * size;
  Int minimax = 3 * total + (size + 5) * (used + 1) + 2 * (size + 1) * (size + 2);
  Int centre = 4 * total + 64 * size + size * (near + 4);
  Int part = total * (size + 1) + 2 * pairs + most(minimax, centre);
  return most(part, 208 * size + most(rows, 2 * pairs) * (size + 4));
}

/* Draw points (sweeps, size) of the set; 0 where no part with an inside is found at once, negative: that much more is
   worked in. */
static Int drawn(const Start *start, const Band *band, const double *widths, double *left, double *points, Int sweeps,
                 double *workspace, Int room) {
  Int counts[2] = {0, 0}, n = band->n, size = 2 * start->lines.count, work = size * size, rows, pairs, need;
  double at[SIZE], middle[SIZE], curvature[SIZE * SIZE], outside, scale = SCALE * band->length;
  if (14 * n > room) return -14 * n;
  tacstrip_feasible_set(&start->lines, band, start->zones, widths, counts, 0, 0, 0, 0, 0, 0, workspace);
  rows = counts[0];
  pairs = counts[1];
  need = 14 * n + (size + 2) * rows + (2 * size + 3) * pairs + inner_room(rows, pairs, size);
  if (need > room) return -need;
  double *a = workspace + 14 * n, *b = a + size * rows, *edge = b + rows, *pair_a = edge + rows;
  double *pair_b = pair_a + 2 * size * pairs, *pair_edge = pair_b + 2 * pairs, *inner = pair_edge + pairs;
  tacstrip_feasible_set(&start->lines, band, start->zones, widths, counts, a, b, edge, pair_a, pair_b, pair_edge,
                        workspace);
  *left -= (double)work;
  if (*left < 0.0) return 0;
  for (Int i = 0; i < size; i++) middle[i] = start->heights[i];
  tacstrip_minimax(a, b, middle, scale, rows, size, &outside, inner);
  if (outside >= 0.0) return 0;
  for (int from = 0; from < 2; from++) {
    Int rounds = (Int)(*left / (double)work);
    if (*left < (double)work) return 0;
    for (Int i = 0; i < size; i++) at[i] = from ? middle[i] : start->heights[i];
    rounds = tacstrip_feasible_part(a, b, pair_a, pair_b, at, curvature, scale, rounds < DESCENTS ? rounds : DESCENTS,
                                    rows, pairs, size, inner);
    *left -= (double)((rounds < 0 ? -rounds : rounds) * work);
    if (rounds > 0)
      return tacstrip_hit_and_run(a, b, edge, pair_a, pair_b, pair_edge, at, curvature, points, sweeps, rows, pairs, size,
                                  inner);
  }
  return 0;
}

/* The mean of rows (count, size). */
static void mean_of(const double *rows, Int count, Int size, double *mean) {
  for (Int i = 0; i < size; i++) {
    mean[i] = 0.0;
    for (Int k = 0; k < count; k++) mean[i] += rows[k * size + i];
    mean[i] /= (double)count;
  }
}

/* Whether chains make an outline that the band allows. */
static int allowed(const Band *band, const double *lower, Int lowers, const double *upper, Int uppers) {
  Problem s = {0};
  const double *chain[2] = {lower, upper};
  Int count[2] = {lowers, uppers};
  s.narrow = band->narrow;
  s.lam = band->lam / band->length;
  for (int side = 0; side < 2; side++) for (Int i = 0; i < count[side]; i++) {
    const double *point = chain[side] + 2 * i;
    if (i > 0 && !(point[0] > point[-2])) return 0;
    if (!(interpolated(upper, uppers, point[0]) - interpolated(lower, lowers, point[0]) >= 0.0)) return 0;
  }
  if (lower[0] != upper[0] || lower[2 * lowers - 2] != upper[2 * uppers - 2]) return 0;
  for (Int first = 0; first < band->n; first += LANES) {
    double l[LANES], u[LANES], made[LANES];
    for (int j = 0; j < LANES; j++) {
      double x = clip(band->x[first + j < band->n ? first + j : band->n - 1], lower[0], lower[2 * lowers - 2]);
      l[j] = interpolated(lower, lowers, x) / band->length;
      u[j] = interpolated(upper, uppers, x) / band->length;
    }
    for (Int row = 0; row < band->signatures; row++) {
      for (int j = 0; j < LANES; j += WIDTH) {
        Ideal contact = ideal(&s, load(l + j), load(u + j));
        store(made + j, reading(band->share[row], &contact));
      }
      for (int j = 0; j < LANES && first + j < band->n; j++) {
        double low = band->low[row * band->n + first + j], high = band->high[row * band->n + first + j];
        double slack = BENT * (high - low);
        if (made[j] < low - slack || made[j] > high + slack) return 0;
      }
    }
  }
  return 1;
}

Int tacstrip_bounded(const Band *band, double pitch, const double *lower, Int lowers, const double *upper, Int uppers,
                     const double *covariance, const double *shuffled, Int sweeps, double *points, double *mean,
                     double *scatter, double *radii, double *deviations, double *workspace, Int room) {
  Start start;
  Int n = band->n, size = 2 * (lowers + uppers - 2), own = 2 * lowers, other = 2 * uppers, chains = sweeps * (own + other);
  /* Beside each other: widths, what draws need; and then x of vertical ends, chains, and what these are drawn in. */
  Int after = 2 * sweeps + chains + most(chains + sweeps, (own + other + 6) * (sweeps + 3) + own + other);
  double left = EFFORT;
  if (size > SIZE) return 0;
  if (3 * n + after > room) return -(3 * n + after);
  lines_of(lower, lowers, upper, uppers, &start);
  zones_of(band, pitch, covariance, &start);
  widths_of(band, lower, lowers, upper, uppers, workspace);
  for (int again = 0; again < (band->lam > 0.0 ? 2 : 1); again++) {
    if (again) { /* what contact resistance eats depends on the contact's length: once more, with a better one */
      double ends[2] = {0.5 * (band->windows[0] + band->windows[1]), 0.5 * (band->windows[2] + band->windows[3])};
      double chain[4 * SIZE];
      mean_of(points, sweeps, size, start.heights);
      line_chains(&start.lines, start.heights, ends, chain, chain + own);
      widths_of(band, chain, lowers, chain + own, uppers, workspace);
    }
    Int found = drawn(&start, band, workspace, &left, points, sweeps, workspace + 3 * n, room - 3 * n);
    if (found < 0) return found - 3 * n;
    if (!found) return 0;
  }
  double *vertical_x = workspace, *low = vertical_x + 2 * sweeps, *high = low + sweeps * own, *rest = high + sweeps * other;
  for (Int i = 0; i < 2 * sweeps; i++) {
    const double *window = band->windows + 2 * (i % 2);
    vertical_x[i] = window[0] + (shuffled[i] + 0.5) / (double)sweeps * (window[1] - window[0]);
  }
  if (!tacstrip_outlines(&start.lines, band->windows, band->length, points, vertical_x, sweeps, low, high, rest)) return 1;
  mean_of(low, sweeps, own, mean);
  mean_of(high, sweeps, other, mean + own);
  for (int end = 0; end < 2; end++) if (start.lines.vertical[end]) {
    double x = 0.5 * (band->windows[2 * end] + band->windows[2 * end + 1]);
    mean[end ? own - 2 : 0] = mean[own + (end ? other - 2 : 0)] = x;
  }
  if (!allowed(band, mean, lowers, mean + own, uppers)) return 1;
  double ring[4 * SIZE];
  Int lower_at[SIZE], upper_at[SIZE], vertices = 0;
  int joined_left = mean[1] == mean[own + 1], joined_right = mean[own - 1] == mean[own + other - 1];
  for (Int i = 0; i < lowers; i++) lower_at[i] = vertices++;
  for (Int i = uppers - 1; i >= 0; i--)
    upper_at[i] = i == uppers - 1 && joined_right ? lowers - 1 : i == 0 && joined_left ? 0 : vertices++;
  for (int side = 0; side < 2; side++) for (Int i = 0; i < (side ? uppers : lowers); i++)
    for (int axis = 0; axis < 2; axis++)
      ring[2 * (side ? upper_at : lower_at)[i] + axis] = mean[(side ? own : 0) + 2 * i + axis];
  tacstrip_scatter(low, high, lower_at, upper_at, lowers, uppers, ring, vertices, sweeps, scatter, radii, deviations, rest);
  return 2;
}

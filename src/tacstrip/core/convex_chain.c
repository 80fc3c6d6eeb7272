/* One end of a contact along the strips: the convex function nearest to it, the straight lines that explain it best, and where
   no convex function goes on. */

#include "internal.h"

#define SPARE 1e-9         /* of the largest gradient: none is left */
#define PER_LINE 3.0       /* of chi square, times the logarithm of the strips, and ... */
#define ALSO 8.0           /* ... beside it: what one more line costs */
#define CONTRADICTED 18.0  /* of chi square: by so much a convex chain explains the readings worse */
#define BESIDE 0.25        /* pitches beyond the strips at either side where lines that meet make a corner */
#define PER_STEP 4.0       /* of chi square, times the logarithm of a step in deviations */

#define ROUNDED 1e-9       /* of chi square: by so much the same lines may differ */

/* An end at n strips, and room: places (n + 1,), numbers (7 n + 7,). */
typedef struct {
  const double *x, *y, *weight;
  Int n, *places;
  double *room;
} End;

typedef struct {
  double height, slope, middle, total, spread; /* at the middle; sums of weights, and of weights times distance squared */
} Straight;

static End part(const End *e, Int a, Int b) {
  End found = {e->x + a, e->y + a, e->weight + a, b - a, e->places, e->room};
  return found;
}

/* Write the continuous function of straight lines between knots (count,), strips from the first to the last, that is nearest
   to y: fitted (n,), and how its slope changes at each knot but the outer ones, bend (count,). room (3 count,). */
static void fit_knots(const End *e, const Int *knot, Int count, double *fitted, double *bend, double *room) {
  double *own = room, *beside = own + count, *value = beside + count;
  for (Int j = 0; j < count; j++) own[j] = beside[j] = value[j] = 0.0;
  for (Int j = 0; j + 1 < count; j++) {
    Int a = knot[j], b = knot[j + 1];
    double run = e->x[b] - e->x[a];
    for (Int k = a + (j > 0); k <= b; k++) {
      double t = (e->x[k] - e->x[a]) / run, keep = 1.0 - t, w = e->weight[k];
      own[j] += w * keep * keep;
      beside[j] += w * keep * t;
      own[j + 1] += w * t * t;
      value[j] += w * keep * e->y[k];
      value[j + 1] += w * t * e->y[k];
    }
  }
  for (Int j = 1; j < count; j++) {
    double by = beside[j - 1] / own[j - 1];
    own[j] -= by * beside[j - 1];
    value[j] -= by * value[j - 1];
  }
  value[count - 1] /= own[count - 1];
  for (Int j = count - 2; j >= 0; j--) value[j] = (value[j] - beside[j] * value[j + 1]) / own[j];
  double before = 0.0;
  for (Int j = 0; j + 1 < count; j++) {
    Int a = knot[j], b = knot[j + 1];
    double slope = (value[j + 1] - value[j]) / (e->x[b] - e->x[a]);
    bend[j] = slope - before;
    before = slope;
    for (Int k = a; k <= b; k++) fitted[k] = value[j] + slope * (e->x[k] - e->x[a]);
  }
}

/* Lawson and Hanson's active set. */
static Int regress(const End *e, double sign, double *fitted) {
  Int n = e->n, *knot = e->places, count = 2;
  double *now = e->room, *bend = now + n, *room = bend + n, spare = 0.0;
  if (n < 3) {
    for (Int k = 0; k < n; k++) fitted[k] = e->y[k];
    return 0;
  }
  for (Int k = 0; k < n; k++) spare += magnitude(e->y[k]) * sqrt(e->weight[k]);
  spare = SPARE * larger(spare, 1e-300);
  knot[0] = 0;
  knot[1] = n - 1;
  fit_knots(e, knot, count, fitted, bend, room);
  for (Int round = 0; round < 3 * n; round++) {
    Int best = 0, at = count - 1;
    double most = spare, gradient = 0.0, sum = 0.0;
    for (Int i = n - 2; i > 0; i--) {
      sum += e->weight[i + 1] * (e->y[i + 1] - fitted[i + 1]);
      gradient += sum * (e->x[i + 1] - e->x[i]);
      while (knot[at] > i) at--;
      if (knot[at] != i && (sign * gradient > most || (best && sign * gradient == most))) {
        best = i;
        most = sign * gradient;
      }
    }
    if (!best) break;
    for (at = count; knot[at - 1] > best; at--) {
      knot[at] = knot[at - 1];
      now[at] = now[at - 1];
    }
    knot[at] = best;
    now[at] = 0.0;
    count++;
    for (;;) {
      double step = INFINITE;
      Int first = 0, kept = 1;
      fit_knots(e, knot, count, fitted, bend, room);
      for (Int j = 1; j + 1 < count; j++) {
        if (sign * bend[j] > 0.0) continue;
        if (!first) first = j;
        step = smaller(step, now[j] / larger(now[j] - sign * bend[j], 1e-300));
      }
      if (!first) break;
      int any = 0;
      for (Int j = 1; j + 1 < count; j++) {
        double value = now[j] + step * (sign * bend[j] - now[j]);
        if (!(sign * bend[j] > 0.0) && value <= 1e-15 + 1e-12 * magnitude(now[j])) any = 1;
      }
      for (Int j = 1; j + 1 < count; j++) {
        double value = now[j] + step * (sign * bend[j] - now[j]);
        int low = !(sign * bend[j] > 0.0) && value <= 1e-15 + 1e-12 * magnitude(now[j]);
        if (any ? low : j == first) continue;
        knot[kept] = knot[j];
        now[kept++] = value;
      }
      knot[kept++] = n - 1;
      count = kept;
    }
    for (Int j = 1; j + 1 < count; j++) now[j] = sign * bend[j];
  }
  return count - 2;
}

static double convex_cost(const End *e) {
  double *fitted = e->room + 6 * e->n, cost = 0.0;
  regress(e, 1.0, fitted);
  for (Int k = 0; k < e->n; k++) cost += e->weight[k] * (e->y[k] - fitted[k]) * (e->y[k] - fitted[k]);
  return cost;
}

/* Chi square of the nearest convex functions before and from a cut at c. */
static double costs_about(const End *e, Int a, Int c, Int b) {
  End left = part(e, a, c), right = part(e, c, b);
  return (c - a > 2 ? convex_cost(&left) : 0.0) + (b - c > 2 ? convex_cost(&right) : 0.0);
}

static double per_line(Int strips) { return PER_LINE * natural_log((double)(strips > 2 ? strips : 2)) + ALSO; }

/* Write where the lines begin, with the end of all, to begins (n + 1,), and return how many lines. */
static Int best_lines(const End *e, double price, double single, Int *begins, double *total) {
  Int n = e->n, *back = e->places;
  double *sums[6], *best = e->room + 6 * (n + 1), x_mean = 0.0, y_mean = 0.0;
  for (int i = 0; i < 6; i++) {
    sums[i] = e->room + i * (n + 1);
    sums[i][0] = 0.0;
  }
  for (Int k = 0; k < n; k++) {
    x_mean += e->x[k];
    y_mean += e->y[k];
  }
  x_mean /= (double)n;
  y_mean /= (double)n;
  for (Int k = 0; k < n; k++) {
    double x = e->x[k] - x_mean, y = e->y[k] - y_mean, w = e->weight[k];
    double terms[6] = {w, w * x, w * x * x, w * y, w * x * y, w * y * y};
    for (int i = 0; i < 6; i++) sums[i][k + 1] = sums[i][k] + terms[i];
  }
  best[0] = 0.0;
  for (Int stop = 1; stop <= n; stop++) {
    double least = INFINITE;
    for (Int a = 0; a < stop; a++) {
      double s = sums[0][stop] - sums[0][a], sx = sums[1][stop] - sums[1][a], sxx = sums[2][stop] - sums[2][a];
      double sy = sums[3][stop] - sums[3][a], sxy = sums[4][stop] - sums[4][a], syy = sums[5][stop] - sums[5][a];
      double own = s * sxx - sx * sx, both = s * sxy - sx * sy;
      double cost = syy - sy * sy / s - (own > 1e-12 * s * sxx ? both * both / (own * s) : 0.0);
      if (stop - a <= 2) cost = 0.0; /* exactly, or rounding chooses among lines of two strips */
      cost = best[a] + larger(cost, 0.0) - (a == stop - 1 ? single : 0.0);
      if (cost < least) {
        least = cost;
        back[stop] = a;
      }
    }
    best[stop] = least + price;
  }
  Int lines = 0;
  for (Int at = n; at > 0; at = back[at]) lines++;
  Int i = lines;
  for (Int at = n; i >= 0; at = back[at]) {
    begins[i--] = at;
    if (!at) break;
  }
  *total = best[n];
  return lines;
}

static Straight line_of(const End *e, Int a, Int b) {
  Straight found = {0.0, 0.0, 0.0, 0.0, 0.0};
  for (Int k = a; k < b; k++) {
    found.total += e->weight[k];
    found.middle += e->weight[k] * e->x[k];
    found.height += e->weight[k] * e->y[k];
  }
  found.middle /= found.total;
  found.height /= found.total;
  for (Int k = a; k < b; k++) {
    double x = e->x[k] - found.middle;
    found.spread += e->weight[k] * x * x;
    found.slope += e->weight[k] * x * e->y[k];
  }
  found.slope /= found.spread;
  return found;
}

static double height(const Straight *line, double x) { return line->height + line->slope * (x - line->middle); }

/* Whether the lines of strips a to c and c to b plainly meet in a convex corner between the two. */
static int goes_on(const End *e, Int a, Int c, Int b) {
  if (c - a < 2 || b - c < 2) return 0;
  Straight left = line_of(e, a, c), right = line_of(e, c, b);
  double beside = BESIDE * (e->x[c] - e->x[c - 1]), from = e->x[c - 1] - beside, to = e->x[c] + beside;
  return right.slope > left.slope && height(&right, from) < height(&left, from) && height(&right, to) > height(&left, to);
}

/* What explains strips a to b: their convex chain, and lines of it, an outer one that is steep by its step. begins (n + 1,) */
static double explained(const End *e, Int a, Int b, int right, double price, Int *begins) {
  End own = part(e, a, b);
  double cost, chi_square = convex_cost(&own);
  Int lines = best_lines(&own, price, price / 3.0, begins, &cost);
  if (lines > 1 && (right ? begins[lines] - begins[lines - 1] <= 2 : begins[1] <= 2)) {
    Int p = a + begins[right ? lines - 2 : 1], q = a + begins[right ? lines - 1 : 2], end = right ? b - 1 : a;
    double level = e->y[p];
    if (q - p > 1) {
      Straight next = line_of(e, p, q);
      level = height(&next, e->x[end]);
    }
    cost += PER_STEP * natural_log(1.0 + magnitude(e->y[end] - level) * sqrt(e->weight[end]));
  }
  return chi_square + cost;
}

Int tacstrip_convex_regression(const double *x, const double *y, const double *weight, Int n, double sign, double *fitted,
                               Int *places, double *workspace) {
  End e = {x, y, weight, n, places, workspace};
  CHECK(n > 0);
  return regress(&e, sign, fitted);
}

Int tacstrip_best_lines(const double *x, const double *y, const double *weight, Int n, double price, double single,
                        Int *begins, double *cost, Int *places, double *workspace) {
  End e = {x, y, weight, n, places, workspace};
  CHECK(n > 0);
  return best_lines(&e, price, single, begins, cost);
}

Int tacstrip_convex_cuts(const double *x, const double *y, const double *weight, Int n, Int *cuts, double *gains,
                         Int *places, double *workspace) {
  End e = {x, y, weight, n, places, workspace};
  Int *lines = places + n + 1, count = 1;
  double unused, price = per_line(n);
  CHECK(n > 0);
  Int found = best_lines(&e, price, 0.0, lines, &unused);
  cuts[0] = 0;
  for (Int i = 1; i < found; i++)
    if (!goes_on(&e, lines[i - 1], lines[i], lines[i + 1])) cuts[count++] = lines[i];
  cuts[count] = n;
  double *alone = workspace + 7 * n + 7, *joint = alone + n; /* of the stretch from a cut, and of the two about one */
  for (Int i = 0; i < count; i++) {
    alone[i] = joint[i] = -1.0;
  }
  for (;;) {
    Int least = 0;
    for (Int i = 0; i < count; i++) {
      End own = part(&e, cuts[i], cuts[i + 1]), both = part(&e, i ? cuts[i - 1] : 0, cuts[i + 1]);
      if (alone[i] < 0.0) alone[i] = convex_cost(&own);
      if (i && joint[i] < 0.0) joint[i] = convex_cost(&both);
    }
    for (Int i = 1; i < count; i++) {
      gains[i - 1] = joint[i] - alone[i - 1] - alone[i];
      if (!least || gains[i - 1] < gains[least - 1]) least = i;
    }
    if (!least || gains[least - 1] >= CONTRADICTED) break;
    alone[least - 1] = joint[least];
    for (Int i = least; i < count; i++) {
      cuts[i] = cuts[i + 1];
      alone[i] = i + 1 < count ? alone[i + 1] : -1.0;
      joint[i] = i + 1 < count ? joint[i + 1] : -1.0;
    }
    count--;
    joint[least - 1] = -1.0;
    if (least < count) joint[least] = -1.0;
  }
  for (Int i = 1; i < count; i++) {
    Int a = cuts[i - 1], b = cuts[i + 1], c = cuts[i], tries[3] = {c, c - 1, c + 1};
    double lowest = INFINITE;
    for (int j = 0; j < 3; j++) {
      if (tries[j] <= a || tries[j] >= b) continue;
      double cost = explained(&e, a, tries[j], 1, price, lines) + explained(&e, tries[j], b, 0, price, lines);
      if (cost < lowest - ROUNDED) {
        lowest = cost;
        cuts[i] = tries[j];
      }
    }
  }
  return count;
}

static double joint_cost(const End *e, Int a, Int b) {
  Straight line = line_of(e, a, b);
  double cost = 0.0;
  for (Int k = a; k < b; k++) {
    double off = e->y[k] - height(&line, e->x[k]);
    cost += e->weight[k] * off * off;
  }
  return cost;
}

Int tacstrip_convex_polyline(const double *x, const double *y, const double *weight, Int n, double pitch, double *borders,
                             double *lines, double *chi_square, Int *places, double *workspace) {
  End e = {x, y, weight, n, places, workspace};
  Int *cuts = places + n + 1;
  double unused;
  CHECK(n > 1);
  *chi_square = convex_cost(&e);
  Int count = best_lines(&e, per_line(n), 0.0, cuts, &unused);
  for (;;) {
    for (Int i = 0; i < count; i++) {
      Int a = cuts[i], b = cuts[i + 1];
      if (b - a < 2) {
        if (a) a--;
        else b++;
      }
      Straight line = line_of(&e, a, b);
      double row[5] = {line.height, line.slope, line.middle, 1.0 / line.total, 1.0 / line.spread};
      for (int j = 0; j < 5; j++) lines[5 * i + j] = row[j];
    }
    borders[0] = x[0] - 0.5 * pitch;
    borders[count] = x[n - 1] + 0.5 * pitch;
    int wrong = 0, late = 0;
    for (Int i = 1; i < count; i++) {
      const double *a = lines + 5 * (i - 1), *b = lines + 5 * i;
      double meet = ((b[1] * b[2] - b[0]) - (a[1] * a[2] - a[0])) / (b[1] - a[1]);
      borders[i] = meet;
      wrong |= !(b[1] - a[1] > 0.0) || !(magnitude(meet) < INFINITE);
    }
    for (Int i = 0; i < count; i++) late |= !(borders[i + 1] - borders[i] > 0.0);
    if (!wrong && !late) return count;
    /* Lines that make no convex chain are one: the pair that costs least. */
    Int gone = -1;
    double least = INFINITE;
    for (Int i = 1; i < count; i++) {
      const double *a = lines + 5 * (i - 1), *b = lines + 5 * i;
      int here = wrong ? !(b[1] - a[1] > 0.0) || !(magnitude(borders[i]) < INFINITE)
                       : !(borders[i] - borders[i - 1] > 0.0) || !(borders[i + 1] - borders[i] > 0.0);
      double cost = here ? joint_cost(&e, cuts[i - 1], cuts[i + 1]) : INFINITE;
      if (here && (gone < 0 || cost < least)) {
        gone = i;
        least = cost;
      }
    }
    for (Int i = gone; i < count; i++) cuts[i] = cuts[i + 1];
    count--;
  }
}

Int tacstrip_sure_strips(const double *x, const double *y, const double *weight, Int n, const Int *cuts, Int count, Int *sure,
                         Int *places, double *workspace) {
  End e = {x, y, weight, n, places, workspace};
  Int unsure = 0;
  for (Int k = 0; k < n; k++) sure[k] = 1;
  for (Int i = 1; i < count; i++) {
    Int a = cuts[i - 1], b = cuts[i + 1];
    double here = costs_about(&e, a, cuts[i], b);
    for (Int step = -1; step < 2; step += 2) {
      for (Int place = cuts[i] + step; a <= place && place <= b; place += step) {
        if (!(costs_about(&e, a, place, b) < here + CONTRADICTED)) break;
        unsure += sure[step < 0 ? place : place - 1];
        sure[step < 0 ? place : place - 1] = 0;
      }
    }
  }
  return n - unsure;
}

/* Write the lower (sign 1) or upper (-1) chain of the convex hull of points in `order`, ascending in x, and return how many. */
static Int half_hull(const double *points, const Int *order, Int n, double sign, double *hull) {
  Int count = 0;
  for (Int i = 0; i < n; i++) {
    double x = points[2 * order[i]], y = sign * points[2 * order[i] + 1];
    if (count && hull[2 * count - 2] == x) { /* of those on one x the lowest */
      if (y >= hull[2 * count - 1]) continue;
      count--;
    }
    while (count > 1) {
      const double *a = hull + 2 * (count - 2), *b = hull + 2 * (count - 1);
      if ((b[0] - a[0]) * (y - a[1]) > (x - a[0]) * (b[1] - a[1])) break;
      count--;
    }
    hull[2 * count] = x;
    hull[2 * count++ + 1] = y;
  }
  return count;
}

/* Sort places (n,) by the x of their points, keeping the order of those on one x; spare (n,). */
static void sort_by_x(const double *points, Int *order, Int n, Int *spare) {
  for (Int i = 0; i < n; i++) order[i] = i;
  for (Int width = 1; width < n; width *= 2) {
    for (Int start = 0; start < n; start += 2 * width) {
      Int middle = start + width < n ? start + width : n, stop = start + 2 * width < n ? start + 2 * width : n;
      Int i = start, j = middle;
      for (Int k = start; k < stop; k++)
        spare[k] = i < middle && (j == stop || points[2 * order[i]] <= points[2 * order[j]]) ? order[i++] : order[j++];
    }
    for (Int k = 0; k < n; k++) order[k] = spare[k];
  }
}

void tacstrip_hull_ends(const double *points, Int n, const double *x, Int strips, double *ends, double *workspace) {
  Int *order = (Int *)(workspace + 2 * n);
  Word nothing;
  nothing.bits = 0x7ff8000000000000LL; /* NaN */
  CHECK(n > 0);
  sort_by_x(points, order, n, order + n);
  for (int side = 0; side < 2; side++) {
    double sign = side ? -1.0 : 1.0, *hull = workspace;
    Int count = half_hull(points, order, n, sign, hull), j = 0;
    for (Int k = 0; k < strips; k++) {
      ends[side * strips + k] = nothing.value;
      if (!(x[k] >= hull[0] && x[k] <= hull[2 * count - 2])) continue;
      while (j + 1 < count && hull[2 * j + 2] <= x[k]) j++;
      const double *a = hull + 2 * j, *b = a + 2;
      ends[side * strips + k] = sign * (j + 1 < count ? (b[1] - a[1]) / (b[0] - a[0]) * (x[k] - a[0]) + a[1] : a[1]);
    }
  }
}

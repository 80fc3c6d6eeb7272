/* What bounded readings leave of an outline, as rows over the heights of its edges' lines. */

#include "internal.h"

#define LOST 2 /* the turn on a strip in two zones of one chain: any of three lines */

/* A strip: of the lower and the upper chain the lines that may be the edge, the weight of a line's second height, and how
   the lines turn where either may be the edge; then transfer length, its slope, its sag, and how far a bound fades. */
typedef struct {
  Int line[2][2], turn[2];
  double share[2][2], eaten, slope, bent, fade;
} Strip;
typedef struct {
  double room, by[2]; /* by[0] l + by[1] u <= room */
} Limit;
/* Where rows go: (size, count), of pairs (size, sides, count); without `a` they are counted only. */
typedef struct {
  Int used, count, sides;
  double *a, *b, *edge;
} Rows;

static double share_at(const Lines *lines, Int line, double x) {
  const double *reach = lines->reach + 2 * line;
  return (x - reach[0]) / (reach[1] - reach[0]);
}

/* The lines of crossing c, of which the first `kinks` are kinks, then come the left and the right end. */
static void crossing(const Lines *lines, Int c, Int *first, Int *second) {
  Int kinks = lines->count - 2;
  *first = c < lines->lower - 1 ? c : c < kinks ? c + 1 : c == kinks ? 0 : lines->lower - 1;
  *second = c < kinks ? *first + 1 : c == kinks ? lines->lower : lines->count - 1;
}

static void lines_at(const Lines *lines, const double *zones, int upper, double x, Strip *strip) {
  Int base = upper ? lines->lower : 0, begin = upper ? lines->lower - 1 : 0;
  Int end = upper ? lines->count - 2 : lines->lower - 1, inside = 0, first = base;
  strip->turn[upper] = 0;
  for (Int c = begin; c < end; c++) {
    if (zones[2 * c + 1] <= x) first++;
    else if (zones[2 * c] < x) {
      inside++;
      strip->turn[upper] = lines->turns[c];
    }
  }
  if (inside > 1) strip->turn[upper] = LOST;
  strip->line[upper][0] = first;
  strip->line[upper][1] = first + 1 < base + end - begin ? first + 1 : base + end - begin;
  for (int i = 0; i < 2; i++) strip->share[upper][i] = share_at(lines, strip->line[upper][i], x);
}

static double transfer_length(double w, double lam) {
  return lam > 0.0 ? lam * hyperbolic_tangent(w / (2.0 * lam)) : 0.0;
}

static void contact_at(const Band *band, double expected, double least, double greatest, Strip *strip) {
  double lam = band->lam, eaten = strip->eaten = transfer_length(expected, lam), slope = 0.0, low, high;
  strip->bent = 0.0;
  if (lam > 0.0) {
    slope = 0.5 * (1.0 - (eaten / lam) * (eaten / lam));
    low = transfer_length(least, lam) - eaten - slope * (least - expected);
    high = transfer_length(greatest, lam) - eaten - slope * (greatest - expected);
    strip->bent = smaller(low, high);
  }
  strip->slope = slope;
  /* A bound k L - c_l l - c_u u changes by D dk. */
  strip->fade = band->fade * (band->length - band->narrow * (expected - 2.0 * eaten));
}

/* Bound number `bound`, upper bounds of all signatures before lower ones, of strip i; 0 where there is none. */
static int limit_of(const Band *band, const double *widths, const Strip *strip, Int bound, Int i, Limit *limit) {
  Int row = bound % band->signatures;
  double sign = bound < band->signatures ? 1.0 : -1.0;
  double k = (bound < band->signatures ? band->high : band->low)[row * band->n + i];
  if (!(k - k == 0.0) || strip->turn[0] == LOST || strip->turn[1] == LOST) return 0;
  double c_u = band->narrow * k + band->share[row], c_l = 1.0 - c_u, apart = c_l - c_u;
  /* With contact resistance c_l (l + T) + c_u (u - T) <= k L, and T = eaten + slope (w - widths) + bent. */
  double lean = apart * strip->slope, fixed = k * band->length - apart * strip->eaten + lean * widths[i];
  limit->room = sign * fixed + larger(-sign * apart * strip->bent, 0.0);
  limit->by[0] = sign * (c_l - lean);
  limit->by[1] = sign * (c_u + lean);
  return 1;
}

/* Write a row, or one side of a pair: `by` times the heights of two lines of a strip. */
static void put(const Rows *rows, Int side, const Strip *strip, int lower, int upper, double by_l, double by_u) {
  Int which[2] = {lower, upper};
  double by[2] = {by_l, by_u};
  for (int chain = 0; chain < 2; chain++) {
    Int line = strip->line[chain][which[chain]];
    double share = strip->share[chain][which[chain]];
    rows->a[(2 * line * rows->sides + side) * rows->count + rows->used] = by[chain] * (1.0 - share);
    rows->a[((2 * line + 1) * rows->sides + side) * rows->count + rows->used] = by[chain] * share;
  }
}

/* Lower lines are not below 0, upper ones not above L, and the lower is not above the upper. */
static void bare_rows(const Band *band, const Strip *strips, Rows *rows) {
  static const double by[3][2] = {{-1.0, 0.0}, {0.0, 1.0}, {1.0, -1.0}};
  for (int part = 0; part < 3; part++) {
    int seen = part == 0 ? 1 : part == 1 ? 2 : 3, last = 0, own, next; /* which chains' turns count */
    for (Int i = 0; i < band->n; i++, last = own) {
      const Strip *strip = strips + i;
      own = (!(seen & 1) || !strip->turn[0]) && (!(seen & 2) || !strip->turn[1]);
      next = i + 1 < band->n && (!(seen & 1) || !strip[1].turn[0]) && (!(seen & 2) || !strip[1].turn[1]);
      if (!own || (last && next)) continue; /* first, last or beside a kink: there a line is lowest or highest */
      if (rows->a) {
        put(rows, 0, strip, 0, 0, by[part][0], by[part][1]);
        rows->b[rows->used] = part == 1 ? band->length : 0.0;
        rows->edge[rows->used] = 0.0;
      }
      rows->used++;
    }
  }
}

/* Two lines cross within their zone, and turn as they do. */
static void crossing_rows(const Lines *lines, const Band *band, const double *zones, Rows *rows) {
  for (int end = 0; end < 2; end++) for (Int c = 0; c < lines->count; c++) {
    Int kinks = lines->count - 2, line[2];
    if (c >= kinks && lines->vertical[c - kinks]) continue;
    if (rows->a) {
      double x = c < kinks ? zones[2 * c + end] : band->windows[2 * (c - kinks) + end];
      double turn = c < kinks ? (double)lines->turns[c] : c == kinks ? 1.0 : -1.0, sign = end ? -turn : turn;
      crossing(lines, c, line, line + 1);
      for (int i = 0; i < 2; i++, sign = -sign) {
        double share = share_at(lines, line[i], x);
        rows->a[2 * line[i] * rows->count + rows->used] = -sign * (1.0 - share);
        rows->a[(2 * line[i] + 1) * rows->count + rows->used] = -sign * share;
      }
      rows->b[rows->used] = rows->edge[rows->used] = 0.0;
    }
    rows->used++;
  }
}

/* A rising kink is the greater of two lines: an upper bound holds for both, a lower one for either. */
static void reading_rows(const Band *band, const double *widths, const Strip *strips, int i, int j, int paired, Rows *rows) {
  for (Int bound = 0; bound < 2 * band->signatures; bound++) for (Int at = 0; at < band->n; at++) {
    const Strip *strip = strips + at;
    Int sign = bound < band->signatures ? 1 : -1;
    int l_or = strip->turn[0] == -sign, u_or = strip->turn[1] == -sign;
    Limit limit;
    if ((i && !strip->turn[0]) || (j && !strip->turn[1])) continue; /* the same line as without */
    if (paired < 0 ? l_or || u_or : paired ? l_or || !u_or : u_or || !l_or) continue;
    if (!limit_of(band, widths, strip, bound, at, &limit)) continue;
    if (rows->a) {
      put(rows, 0, strip, paired == 0 ? 0 : i, paired == 1 ? 0 : j, limit.by[0], limit.by[1]);
      if (paired >= 0) put(rows, 1, strip, paired == 0 ? 1 : i, paired == 1 ? 1 : j, limit.by[0], limit.by[1]);
      for (Int side = 0; side < rows->sides; side++) rows->b[side * rows->count + rows->used] = limit.room;
      rows->edge[rows->used] = strip->fade;
    }
    rows->used++;
  }
}

void tacstrip_feasible_set(const Lines *lines, const Band *band, const double *zones, const double *widths, Int *counts,
                           double *a, double *b, double *edge, double *pair_a, double *pair_b, double *pair_edge,
                           double *workspace) {
  Strip *strips = (Strip *)workspace;
  Int n = band->n, size = 2 * lines->count;
  Rows rows = {0, counts[0], 1, a, b, edge}, pairs = {0, counts[1], 2, pair_a, pair_b, pair_edge};
  if (!a) for (Int i = 0; i < n; i++) {
    for (int upper = 0; upper < 2; upper++) lines_at(lines, zones, upper, band->x[i], strips + i);
    contact_at(band, widths[i], widths[n + i], widths[2 * n + i], strips + i);
  } else {
    for (Int i = 0; i < size * rows.count; i++) a[i] = 0.0;
    for (Int i = 0; i < 2 * size * pairs.count; i++) pair_a[i] = 0.0;
  }
  for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) reading_rows(band, widths, strips, i, j, -1, &rows);
  for (int i = 0; i < 2; i++) {
    reading_rows(band, widths, strips, 0, i, 0, &pairs);
    reading_rows(band, widths, strips, i, 0, 1, &pairs);
  }
  bare_rows(band, strips, &rows);
  crossing_rows(lines, band, zones, &rows);
  counts[0] = rows.used;
  counts[1] = pairs.used;
}

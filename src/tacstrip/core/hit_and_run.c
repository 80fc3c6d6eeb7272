/* A Gibbs walk through a set of bounds, in coordinates that make it round. */

#include "internal.h"

#define NEAREST 112      /* bounds that the walk can meet: all others are too far */
#define NEAREST_PAIRS 48 /* a multiple of LANES, as NEAREST is */
#define SETTLING 60      /* sweeps that forget where the walk began */
#define BLOCK 64

typedef unsigned long long Bits;

/* How far one can go before a slack is 0: up and down from 0. n is a multiple of LANES. */
static void reach_of_rows(const double *row, const double *room, Int n, double *high, double *low) {
  Pack most = all(1e-300), least = all(-1e-300);
  double mosts[WIDTH], leasts[WIDTH], up = 1e-300, down = -1e-300;
  for (Int i = 0; i < n; i += WIDTH) {
    Pack ratio = load(row + i) / load(room + i);
    most = where(ratio > most, ratio, most);
    least = where(ratio < least, ratio, least);
  }
  store(mosts, most);
  store(leasts, least);
  for (int j = 0; j < WIDTH; j++) {
    up = larger(up, mosts[j]);
    down = smaller(down, leasts[j]);
  }
  *high = 1.0 / up;
  *low = 1.0 / down;
}

/* The same of pairs of slacks, row (2, n) and room (2, n), of which one stays above 0. */
static void reach_of_pairs(const double *row, const double *room, Int n, double *high, double *low) {
  Pack up = all(*high), down = all(*low), none = all(0.0), far = all(INFINITE);
  double ups[WIDTH], downs[WIDTH];
  for (Int i = 0; i < n; i += WIDTH) {
    Pack s1 = load(room + i), s2 = load(room + n + i), r1 = load(row + i), r2 = load(row + n + i);
    Pack s = where(s1 < s2, s2, s1), t = where(s1 < s2, s1, s2), r = where(s1 < s2, r2, r1), q = where(s1 < s2, r1, r2);
    Pack longer = where(s > none, s, none) / r, other = t / q; /* the slack that is left, and the other */
    Pack reach = where(r > none, longer, far), second = where(q > none, other, far);
    Pack both = where(reach > second, reach, second);
    Pack bridged = where((q < none) & (other <= reach), far, reach);
    Pack limit = where(t >= none, both, bridged);
    up = where(limit < up, limit, up);
    reach = where(r < none, longer, -far);
    second = where(q < none, other, -far);
    both = where(reach < second, reach, second);
    bridged = where((q > none) & (other >= reach), -far, reach);
    limit = where(t >= none, both, bridged);
    down = where(limit > down, limit, down);
  }
  store(ups, up);
  store(downs, down);
  for (int j = 0; j < WIDTH; j++) {
    *high = smaller(*high, ups[j]);
    *low = larger(*low, downs[j]);
  }
}

/* Move by a step along one coordinate. */
static void advance(double *room, const double *row, double step, Int n) {
  for (Int i = 0; i < n; i++) room[i] -= step * row[i];
}

/* Rows in round coordinates, sides of each: out (size, sides, all). distance (all,): of the farther side. */
static void to_round(Matrix u, const double *a, const double *slack, Int sides, Int total, Int size, double *out,
                     double *distance) {
  forward_rows(u, a, sides * total, sides * total, size, out);
  for (Int i = 0; i < total; i++) for (Int side = 0; side < sides; side++) {
    double square = 0.0;
    for (Int p = 0; p < size; p++) {
      double value = out[(p * sides + side) * total + i];
      square += value * value;
    }
    double far = slack[side * total + i] / sqrt(square);
    if (side == 0 || far > distance[i]) distance[i] = far;
  }
}

/* Gather the nearest of rows that have `sides` sides, in their order: row (size, sides, padded), slack and edge. */
static Int gather(const double *all_rows, const double *all_slack, const double *all_edge, double *distance, Int sides,
                  Int total, Int size, Int most, double *row, double *slack, double *edge, double *scratch) {
  double *chosen = scratch + total;
  for (Int i = 0; i < total; i++) {
    distance[i] = -distance[i];
    chosen[i] = 0.0;
  }
  Int count = mark_largest(distance, total, most, chosen, scratch), padded = (count + LANES - 1) / LANES * LANES;
  Int column = 0;
  for (Int i = 0; i < total; i++) {
    if (chosen[i] == 0.0) continue;
    for (Int side = 0; side < sides; side++) {
      for (Int p = 0; p < size; p++) row[(p * sides + side) * padded + column] = all_rows[(p * sides + side) * total + i];
      slack[side * padded + column] = all_slack[side * total + i];
    }
    edge[column++] = all_edge[i];
  }
  for (; column < padded; column++) {
    for (Int side = 0; side < sides; side++) {
      for (Int p = 0; p < size; p++) row[(p * sides + side) * padded + column] = 0.0;
      slack[side * padded + column] = 1.0;
    }
    edge[column] = 0.0;
  }
  return padded;
}

Int tacstrip_hit_and_run(const double *a, const double *b, const double *edges, const double *pair_a,
                         const double *pair_b, const double *pair_edges, const double *middle, const double *curvature,
                         double *out, Int sweeps, Int rows, Int pairs, Int size, double *workspace) {
  Matrix u;
  double slack[NEAREST], edge[NEAREST], pair_slack[2 * NEAREST_PAIRS], pair_edge[NEAREST_PAIRS], z[SIZE];
  double cut[NEAREST], pair_cut[NEAREST_PAIRS];
  double *near = workspace, *near_pairs = near + NEAREST * size, *turned = near_pairs + 2 * NEAREST_PAIRS * size;
  Int widest = rows > 2 * pairs ? rows : 2 * pairs;
  double *slacks = turned + widest * size, *distance = slacks + widest, *scratch = distance + widest;
  CHECK(0 < size && size <= SIZE);
  for (Int p = 0; p < size; p++) {
    z[p] = 0.0;
    for (Int q = p; q < size; q++) u[p][q] = curvature[p * size + q];
  }
  if (!factor(u, size)) return 0;
  row_products(a, rows, size, middle, slacks);
  for (Int i = 0; i < rows; i++) slacks[i] = b[i] - slacks[i];
  to_round(u, a, slacks, 1, rows, size, turned, distance);
  Int n = gather(turned, slacks, edges, distance, 1, rows, size, NEAREST, near, slack, edge, scratch);
  row_products(pair_a, 2 * pairs, size, middle, slacks);
  for (Int i = 0; i < 2 * pairs; i++) slacks[i] = pair_b[i] - slacks[i];
  to_round(u, pair_a, slacks, 2, pairs, size, turned, distance);
  Int e = gather(turned, slacks, pair_edges, distance, 2, pairs, size, NEAREST_PAIRS, near_pairs, pair_slack, pair_edge,
                 scratch);
  for (Int sweep = -SETTLING; sweep < sweeps; sweep++) {
    Bits place = (Bits)(sweep + SETTLING) * (NEAREST + NEAREST_PAIRS + SIZE);
    for (Int i = 0; i < n; i++) {
      cut[i] = edge[i] > 0.0 ? uniform_draw(place + (Bits)i) * smaller(edge[i], slack[i]) : 0.0;
      slack[i] -= cut[i];
    }
    for (Int i = 0; i < e; i++) {
      double room = larger(pair_slack[i], pair_slack[e + i]);
      pair_cut[i] = pair_edge[i] > 0.0 ? uniform_draw(place + (Bits)(NEAREST + i)) * smaller(pair_edge[i], room) : 0.0;
      pair_slack[i] -= pair_cut[i];
      pair_slack[e + i] -= pair_cut[i];
    }
    for (Int j = 0; j < size; j++) {
      const double *row = near + j * n, *pair = near_pairs + 2 * j * e;
      double high, low;
      reach_of_rows(row, slack, n, &high, &low);
      reach_of_pairs(pair, pair_slack, e, &high, &low);
      double step = low + (high - low) * uniform_draw(place + (Bits)(NEAREST + NEAREST_PAIRS + j));
      z[j] += step;
      advance(slack, row, step, n);
      advance(pair_slack, pair, step, 2 * e);
    }
    for (Int i = 0; i < n; i++) slack[i] += cut[i];
    for (Int i = 0; i < e; i++) {
      pair_slack[i] += pair_cut[i];
      pair_slack[e + i] += pair_cut[i];
    }
    if (sweep < 0) continue;
    double *point = out + sweep * size;
    for (Int p = 0; p < size; p++) point[p] = z[p];
    solve_upper(u, size, point);
    for (Int p = 0; p < size; p++) point[p] += middle[p];
  }
  return 1;
}

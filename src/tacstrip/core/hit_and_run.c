/* A Gibbs walk through a set of bounds, in coordinates that make it round. */

#include "lanes.h"

#define NEAREST 112      /* bounds that the walk can meet: all others are too far */
#define NEAREST_PAIRS 48 /* a multiple of LANES, as NEAREST is */
#define SETTLING 60      /* sweeps that forget where the walk began */
#define BLOCK 64

typedef unsigned long long Bits;

/* How far one can go before a slack is 0: up and down from 0. n is a multiple of LANES. */
static void reach_of_rows(const double *row, const double *room, Int n, double *high, double *low) {
  Pack most[PACKS], least[PACKS];
  double mosts[LANES], leasts[LANES], up = 1e-300, down = -1e-300;
  for (int j = 0; j < PACKS; j++) {
    most[j] = all(up);
    least[j] = all(down);
  }
  for (Int i = 0; i < n; i += LANES)
    for (int j = 0; j < PACKS; j++) {
      Pack ratio = load(row + i + j * WIDTH) / load(room + i + j * WIDTH);
      most[j] = greater(ratio, most[j]);
      least[j] = lesser(ratio, least[j]);
    }
  for (int j = 0; j < PACKS; j++) {
    store(mosts + j * WIDTH, most[j]);
    store(leasts + j * WIDTH, least[j]);
  }
  for (int j = 0; j < LANES; j++) {
    up = larger(up, mosts[j]);
    down = smaller(down, leasts[j]);
  }
  *high = 1.0 / up;
  *low = 1.0 / down;
}

/* The same of pairs of slacks, row (2, n) and room (2, n), of which one stays above 0. Few pairs end the way that the
   rows leave: where a product says that neither way is shorter, by more than rounding, nothing is divided. */
static void reach_of_pairs(const double *row, const double *room, Int n, double *high, double *low) {
  Pack up = all(*high), down = all(*low), none = all(0.0), far = all(INFINITE), surely = all(1.0 + 1e-9);
  double ups[WIDTH], downs[WIDTH];
  for (Int i = 0; i < n; i += WIDTH) {
    Pack s1 = load(room + i), s2 = load(room + n + i), r1 = load(row + i), r2 = load(row + n + i);
    Mask swap = s1 < s2;
    Pack s = where(swap, s2, s1), r = where(swap, r2, r1), t = where(swap, s1, s2), q = where(swap, r1, r2);
    Pack above = up * surely, below = down * surely;
    if (!any(((above * r > s) & ((t < none) | (above * q > t))) | ((below * r > s) & ((t < none) | (below * q > t)))))
      continue;
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

/* Move by a step along one coordinate; n is a multiple of LANES. */
static void advance(double *room, const double *row, double step, Int n) {
  Pack by = all(step);
  for (Int i = 0; i < n; i += WIDTH) store(room + i, load(room + i) - by * load(row + i));
}

/* How far each bound is drawn in, of the room (n,) that the larger of two slacks leaves. */
static void draw_in(const double *edge, const double *slack, const double *other, Int n, Bits place, double *cut) {
  for (Int i = 0; i < n; i++)
    cut[i] = edge[i] > 0.0 ? uniform_draw(place + (Bits)i) * smaller(edge[i], larger(slack[i], other[i])) : 0.0;
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
    draw_in(edge, slack, slack, n, place, cut);
    draw_in(pair_edge, pair_slack, pair_slack + e, e, place + NEAREST, pair_cut);
    advance(slack, cut, 1.0, n);
    for (int side = 0; side < 2; side++) advance(pair_slack + side * e, pair_cut, 1.0, e);
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
    advance(slack, cut, -1.0, n);
    for (int side = 0; side < 2; side++) advance(pair_slack + side * e, pair_cut, -1.0, e);
    if (sweep < 0) continue;
    double *point = out + sweep * size;
    for (Int p = 0; p < size; p++) point[p] = z[p];
    solve_upper(u, size, point);
    for (Int p = 0; p < size; p++) point[p] += middle[p];
  }
  return 1;
}

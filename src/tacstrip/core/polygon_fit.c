/* What a fitted polygon leaves over, and how sure it is. */

#include "closed_form.h"

#define APART 1e-6 /* of the run: vertices of a chain */
#define TOLD 6.0   /* deviations of a strip's readings between two edges: less, and either explains them */
#define FIRM 1e-10 /* of a parameter's information, once the others are solved for: less is for a decomposition */

void tacstrip_residuals(const Problem *s, const Polygon *p, double *residuals) {
  Chain chain[2];
  Int e[2] = {0, 0};
  Block block;
  for (int upper = 0; upper < 2; upper++) chain_of(s, p, upper, chain + upper);
  for (Int first = 0; first < s->n; first += LANES) {
    double height[2][LANES], off[LANES];
    read_block(s, first, s->n, &block);
    for (int upper = 0; upper < 2; upper++) for (int j = 0; j < LANES; j++) {
      e[upper] = edge_of(chain + upper, first + j < s->n ? first + j : s->n - 1, e[upper]);
      Line line = chain[upper].line[e[upper]];
      height[upper][j] = line.y + line.slope * (clip(block.x[j], p->theta[0], p->theta[3]) - line.x);
    }
    for (Int row = 0; row < s->signatures; row++) {
      for (int j = 0; j < LANES; j += WIDTH) {
        Ideal contact = ideal(s, load(height[0] + j), load(height[1] + j));
        store(off + j, load(block.k[row] + j) - reading(s->share[row], &contact));
      }
      for (int j = 0; j < LANES && first + j < s->n; j++) {
        Int i = row * s->n + first + j;
        residuals[i] = off[j] * sqrt(s->weight[i]);
      }
    }
  }
}

/* Write one chain's points x, y (count, 2); return the count. */
static Int points_of(const Polygon *p, Int upper, double origin, double width, double length, double *points) {
  Int count = 0;
  for (Int j = -1; j <= p->m; j++) {
    if (j >= 0 && j < p->m && p->upper[j] != upper) continue;
    Int at = j < 0 ? 0 : j < p->m ? END_ENTRIES + 2 * j : 3;
    points[2 * count] = p->theta[at] * width + origin;
    points[2 * count++ + 1] = p->theta[at + (j < 0 || j == p->m ? 1 + upper : 1)] * length;
  }
  return count;
}

double interpolated(const double *points, Int count, double x) {
  Int i = 0;
  if (!(x < points[2 * count - 2])) return points[2 * count - 1];
  if (x < points[0]) return points[1];
  while (!(x < points[2 * i + 2])) i++;
  const double *a = points + 2 * i;
  return (a[3] - a[1]) / (a[2] - a[0]) * (x - a[0]) + a[1];
}

void tacstrip_chains(const Polygon *p, double origin, double width, double length, Int apart, double *lower, double *upper) {
  Int low = points_of(p, 0, origin, width, length, lower), high = points_of(p, 1, origin, width, length, upper);
  upper[1] = larger(upper[1], lower[1]);
  upper[2 * high - 1] = larger(upper[2 * high - 1], lower[2 * low - 1]);
  for (Int i = 1; apart && i < low - 1; i++)
    lower[2 * i + 1] = smaller(lower[2 * i + 1], interpolated(upper, high, lower[2 * i]));
  for (Int i = 1; apart && i < high - 1; i++)
    upper[2 * i + 1] = larger(upper[2 * i + 1], interpolated(lower, low, upper[2 * i]));
}

double greatest_height(const double *lower, Int low, const double *upper, Int high) {
  double most = -INFINITE;
  for (Int i = 0; i < low; i++) most = larger(most, interpolated(upper, high, lower[2 * i]) - lower[2 * i + 1]);
  for (Int i = 0; i < high; i++) most = larger(most, upper[2 * i + 1] - interpolated(lower, low, upper[2 * i]));
  return most;
}

/* The readings (signatures,) of a contact from l to u. */
static void readings_at(const Problem *s, double l, double u, double *k) {
  double low[LANES], high[LANES], made[LANES];
  for (int j = 0; j < LANES; j++) {
    low[j] = l;
    high[j] = u;
  }
  Ideal contact = ideal(s, load(low), load(high));
  for (Int row = 0; row < s->signatures; row++) {
    store(made, reading(s->share[row], &contact));
    k[row] = made[0];
  }
}

/* Write the place halfway from a strip to its neighbour `next` on an edge a (2, 2), lengthened, that explains the strip as
   the chains (count, 2) do; 0 where the readings contradict it. */
static int beside(const Problem *s, double chain[2][2 * MAX_VERTICES + 4], const Int *count, int side, const double *a,
                  Int strip, Int next, double *place) {
  double x = s->x[strip], to = 0.5 * (x + s->x[next]), end[2], there[2], then[2], squares = 0.0;
  if (!(a[0] < a[2])) return 0;
  double slope = (a[3] - a[1]) / (a[2] - a[0]);
  for (int i = 0; i < 2; i++) end[i] = interpolated(chain[i], count[i], x);
  readings_at(s, end[0], end[1], there);
  end[side] = a[1] + slope * (x - a[0]);
  readings_at(s, end[0], end[1], then);
  for (Int row = 0; row < s->signatures; row++) {
    double off = then[row] - there[row];
    squares += off * off * s->weight[row * s->n + strip];
  }
  if (!(sqrt(squares) < TOLD)) return 0;
  place[0] = to;
  place[1] = a[1] + slope * (to - a[0]);
  return 1;
}

/* Move the vertices of edges that may cross one strip or none to the middle of where they may be, in a copy of a polygon;
   return whether any was. */
static int loosen(const Problem *s, const Polygon *p, Polygon *loose) {
  double chain[2][2 * MAX_VERTICES + 4], points[2 * MAX_VERTICES + 4], moved[2 * MAX_VERTICES + 4];
  Int count[2] = {2, 2}, at[MAX_VERTICES + 2];
  int changed = 0;
  for (Int j = 0; j < p->m; j++) count[p->upper[j]]++;
  tacstrip_chains(p, 0.0, 1.0, 1.0, 0, chain[0], chain[1]);
  *loose = *p;
  for (int side = 0; side < 2; side++) {
    Int n = count[side];
    for (Int i = 0; i < n; i++) at[i] = first_from(s->x, s->n, chain[side][2 * i]);
    for (Int i = 0; i < 2 * n; i++) points[i] = chain[side][i];
    for (Int i = 0; i + 1 < n; i++) {
      Int crossed = at[i + 1] - at[i];
      int apart = 1;
      if (crossed < 2 || crossed > 3) continue;
      for (Int j = 0; j < 2 * n; j++) moved[j] = points[j];
      if (i > 0) crossed -= beside(s, chain, count, side, points + 2 * i - 2, at[i], at[i] + 1, moved + 2 * i);
      if (i + 2 < n)
        crossed -= beside(s, chain, count, side, points + 2 * i + 2, at[i + 1] - 1, at[i + 1] - 2, moved + 2 * i + 2);
      for (Int j = 1; j < n; j++) apart = apart && moved[2 * j] - moved[2 * j - 2] > APART;
      if (crossed <= 1 && apart) for (Int j = 0; j < 2 * n; j++) points[j] = moved[j];
    }
    for (Int j = 0, i = 1; j < p->m; j++) if (p->upper[j] == side) {
      for (int axis = 0; axis < 2; axis++) {
        double *own = loose->theta + END_ENTRIES + 2 * j + axis;
        changed = changed || *own != points[2 * i + axis];
        *own = points[2 * i + axis];
      }
      i++;
    }
  }
  sort_vertices(loose);
  return changed;
}

/* Mark the x of both knots of each edge that crosses one strip or none. */
static void steep(const Polygon *p, double origin, double width, const double *x_mm, Int strips, Int *known) {
  for (int upper = 0; upper < 2; upper++) {
    Knot a = knot(p, -1, upper, 0);
    for (Int j = 0; j <= p->m; j++) {
      if (j < p->m && p->upper[j] != upper) continue;
      Knot b = knot(p, j < p->m ? j : -1, upper, 1);
      Int before = first_from(x_mm, strips, p->theta[a.x] * width + origin);
      if (first_from(x_mm, strips, p->theta[b.x] * width + origin) - before <= 1) known[a.x] = known[b.x] = 1;
      a = b;
    }
  }
}

/* The entries of theta that are x and y of the vertices, counter-clockwise; returns how many. */
static Int ring(const Polygon *p, Int *entry) {
  Int n = 0;
  Knot left = knot(p, -1, 0, 0), right = knot(p, -1, 0, 1);
  entry[n++] = left.x;
  entry[n++] = left.y;
  for (Int j = 0; j < p->m; j++) if (!p->upper[j]) {
    entry[n++] = END_ENTRIES + 2 * j;
    entry[n++] = END_ENTRIES + 2 * j + 1;
  }
  entry[n++] = right.x;
  entry[n++] = right.y;
  if (p->vertical[1]) { entry[n++] = right.x; entry[n++] = right.y + 1; }
  for (Int j = p->m - 1; j >= 0; j--) if (p->upper[j]) {
    entry[n++] = END_ENTRIES + 2 * j;
    entry[n++] = END_ENTRIES + 2 * j + 1;
  }
  if (p->vertical[0]) { entry[n++] = left.x; entry[n++] = left.y + 1; }
  return n;
}

Int tacstrip_vertex_covariance(const Problem *s, const Polygon *p, Int loose, double origin, double width, double length,
                               const double *x_mm, Int strips, double *covariance) {
  Polygon moved;
  if (loose && loosen(s, p, &moved)) {
    Int own[SIZE + 2], other[SIZE + 2], places = ring(p, own);
    if (!tacstrip_vertex_covariance(s, &moved, 0, origin, width, length, x_mm, strips, covariance)) return 0;
    ring(&moved, other);
    for (Int i = 0; i < places; i++) for (Int j = i / 2 * 2; j < i / 2 * 2 + 2; j++)
      covariance[i * places + j] += (p->theta[own[i]] - moved.theta[other[i]]) * (i % 2 ? length : width) *
                                    ((p->theta[own[j]] - moved.theta[other[j]]) * (j % 2 ? length : width));
    return 1;
  }
  Matrix a, u, inverse;
  double gradient[SIZE], scale[SIZE], unit[SIZE], b[SIZE], pitch = s->pitch * width;
  Int size = END_ENTRIES + 2 * p->m, n = 0, at[SIZE], entry[SIZE + 2], known[SIZE] = {0};
  without_prior(s, p, a, gradient);
  known[0] = known[3] = 1;
  steep(p, origin, width, x_mm, strips, known);
  for (Int i = 0; i < size; i++) {
    if ((i == 2 && !p->vertical[0]) || (i == 5 && !p->vertical[1])) continue; /* the u of a pointed end */
    unit[n] = i == 0 || i == 3 || (i >= END_ENTRIES && i % 2 == 0) ? width : length;
    at[n++] = i;
  }
  for (Int i = 0; i < n; i++) {
    double own = a[at[i]][at[i]] / (unit[i] * unit[i]) + (known[at[i]] ? 12.0 / (pitch * pitch) : 0.0);
    if (!(own > 0.0 && own < 1e300)) return 0;
    scale[i] = 1.0 / sqrt(own);
  }
  for (Int i = 0; i < n; i++) {
    for (Int j = i; j < n; j++) u[i][j] = a[at[i]][at[j]] / (unit[i] * unit[j]) * scale[i] * scale[j];
    u[i][i] = 1.0;
  }
  if (!factor(u, n)) return 0;
  for (Int i = 0; i < n; i++) if (u[i][i] * u[i][i] < FIRM) return 0;
  for (Int i = 0; i < n; i++) {
    for (Int j = 0; j < n; j++) b[j] = i == j ? scale[i] : 0.0;
    solve(u, n, b);
    for (Int j = 0; j <= i; j++) inverse[at[i]][at[j]] = inverse[at[j]][at[i]] = b[j] * scale[j];
  }
  Int places = ring(p, entry);
  for (Int i = 0; i < places; i++)
    for (Int j = 0; j < places; j++) covariance[i * places + j] = inverse[entry[i]][entry[j]];
  return 1;
}

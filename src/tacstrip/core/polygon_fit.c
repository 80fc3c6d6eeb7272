/* What a fitted polygon leaves over, and how sure it is. */

#include "closed_form.h"

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

/* The height of a chain at x. */
static double interpolated(const double *points, Int count, double x) {
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

Int tacstrip_vertex_covariance(const Problem *s, const Polygon *p, double origin, double width, double length,
                               const double *x_mm, Int strips, double *covariance) {
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

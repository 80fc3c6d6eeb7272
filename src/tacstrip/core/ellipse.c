/* An ellipse as a rival of the polygon: l and u are c + s t -+ b sqrt(1 - t^2), t from -1 to 1 over the contact. */

#include "closed_form.h"

#define STEPS 25
#define ENOUGH 1e-2 /* the gain in chi square that ends a descent */
#define HOPE 4.0    /* a descent will not gain more than so many times what its last step did */
#define STEEP 0.03  /* sqrt(1 - t^2) of the place nearest to an end where the slope is taken */
#define NEAR 0.02   /* of half a pitch: nearer to the inner bound of its window an end may step onto it */
#define ALWAYS 1e-9 /* added to the normal matrix */

typedef double Square[5][5];

/* l and u at x, each with its slopes by the five numbers. */
static inline void heights(const double *p, Pack x, Pack *l, Pack *u, Pack *by_l, Pack *by_u) {
  double half = 0.5 * (p[1] - p[0]), middle = 0.5 * (p[1] + p[0]), root[WIDTH];
  Pack zero = all(0.0), one = all(1.0), t = (x - middle) / half;
  t = where(t > -1.0, t, -one);
  t = where(t < 1.0, t, one);
  store(root, 1.0 - t * t);
  for (int i = 0; i < WIDTH; i++) root[i] = sqrt(larger(root[i], 0.0));
  Pack r = load(root), bend = p[4] * t / where(r > STEEP, r, all(STEEP));
  Pack low = p[2] + p[3] * t - p[4] * r, high = p[2] + p[3] * t + p[4] * r;
  low = where(low > 0.0, low, zero);
  *l = low = where(low < 1.0, low, one);
  high = where(high > low, high, low);
  *u = where(high < 1.0, high, one);
  Pack left = (t - 1.0) * (0.5 / half), right = (-1.0 - t) * (0.5 / half);
  by_l[0] = (p[3] + bend) * left;
  by_u[0] = (p[3] - bend) * left;
  by_l[1] = (p[3] + bend) * right;
  by_u[1] = (p[3] - bend) * right;
  by_l[2] = by_u[2] = one;
  by_l[3] = by_u[3] = t;
  by_l[4] = -r;
  by_u[4] = r;
}

static double equations(const Problem *s, const double *p, Square a, double *g) {
  Pack sum[21][PACKS], l, u, by_l[5], by_u[5], terms[TERMS];
  Block block;
  int at = 0;
  for (int q = 0; q < 21; q++) for (int j = 0; j < PACKS; j++) sum[q][j] = all(0.0);
  for (Int i = 0; i < s->n; i += LANES) {
    read_block(s, i, s->n, &block);
    for (int j = 0; j < PACKS; j++) {
      heights(p, load(block.x + j * WIDTH), &l, &u, by_l, by_u);
      closed_form(s, &block, j, l, u, terms);
      at = 0;
      for (int m = 0; m < 5; m++) {
        Pack with_l = terms[LL] * by_l[m] + terms[LU] * by_u[m], with_u = terms[LU] * by_l[m] + terms[UU] * by_u[m];
        sum[15 + m][j] += terms[LR] * by_l[m] + terms[UR] * by_u[m];
        for (int n = 0; n <= m; n++, at++) sum[at][j] += with_l * by_l[n] + with_u * by_u[n];
      }
      sum[20][j] += terms[RR];
    }
  }
  at = 0;
  for (int m = 0; m < 5; m++) {
    g[m] = joined(sum[15 + m]);
    for (int n = 0; n <= m; n++, at++) a[m][n] = a[n][m] = joined(sum[at]);
  }
  double cost = joined(sum[20]), prior = 12.0 / (s->pitch * s->pitch);
  for (int i = 0; i < 2; i++) {
    double off = p[i] - (double)i;
    a[i][i] += prior;
    g[i] -= prior * off;
    cost += prior * off * off;
  }
  return cost;
}

/* Where a polygon is: its heights at five places, within what an ellipse is found from. */
static void begin(const Polygon *polygon, double *p) {
  double middle[5], rise, sum = 0.0, thick = 0.0;
  for (int i = 0; i < 5; i++) {
    double l = height_at(polygon, 0, 0.25 * (double)i), u = height_at(polygon, 1, 0.25 * (double)i);
    middle[i] = 0.5 * (l + u);
    sum += middle[i];
    thick = larger(thick, u - l);
  }
  rise = 0.5 * (middle[4] - middle[0]);
  p[0] = 0.0;
  p[1] = 1.0;
  p[2] = clip(sum / 5.0, 0.05, 0.95);
  p[3] = rise;
  p[4] = clip(0.5 * thick, 0.15, 0.4);
}

/* How near to the inner bound of its window an end may go: half of the way, and there when nearly there. Outer strips that
   the ellipse no longer covers would tell no more where it is. */
static double towards(double bound, double at, double half) {
  double middle = 0.5 * (at + bound);
  return magnitude(bound - middle) < NEAR * half ? bound : middle;
}

double tacstrip_fit_ellipse(const Problem *s, const Polygon *start, double wanted, double *p, double *information) {
  Square a, other;
  Matrix small;
  double g[5], other_g[5], step[5], trial[5], half = 0.5 * s->pitch, damping = 1e-3;
  if (start) begin(start, p);
  double cost = equations(s, p, a, g);
  for (int round = 0; round < STEPS; round++) {
    for (int i = 0; i < 5; i++) {
      step[i] = g[i];
      for (int j = i; j < 5; j++) small[i][j] = a[i][j];
      small[i][i] += damping * a[i][i] + ALWAYS;
    }
    for (int i = 0; i < 2; i++) {
      double from = (double)i - half, to = (double)i + half;
      if (g[i] < 0.0 ? p[i] > from : p[i] < to) continue;
      for (int j = 0; j < 5; j++) small[j < i ? j : i][j < i ? i : j] = 0.0;
      small[i][i] = 1.0;
      step[i] = 0.0;
    }
    if (!factor(small, 5)) break;
    solve(small, 5, step);
    for (int i = 0; i < 5; i++) trial[i] = p[i] + step[i];
    double left = trial[0], right = trial[1];
    trial[0] = clip(left, -half, towards(half, p[0], half));
    trial[1] = clip(right, towards(1.0 - half, p[1], half), 1.0 + half);
    int on_its_way = trial[0] != left || trial[1] != right;
    trial[2] = clip(trial[2], 0.0, 1.0);
    double room = smaller(trial[2], 1.0 - trial[2]);
    trial[3] = clip(trial[3], -room, room);
    trial[4] = clip(trial[4], 0.5 * p[4], 0.5);
    double now = equations(s, trial, other, other_g), gain = cost - now;
    if (gain >= 0.0) {
      for (int i = 0; i < 5; i++) {
        p[i] = trial[i];
        g[i] = other_g[i];
        for (int j = 0; j < 5; j++) a[i][j] = other[i][j];
      }
      cost = now;
      damping = larger(0.1 * damping, 1e-9);
      if (gain < ENOUGH || (cost - HOPE * gain > wanted && !on_its_way)) break;
    } else {
      damping *= 8.0;
      if (damping > 1e8) break;
    }
  }
  for (int i = 0; i < 5; i++) for (int j = 0; j < 5; j++) information[5 * i + j] = a[i][j];
  return cost;
}

void ellipse_residuals(const Problem *s, const double *p, double *residuals) {
  Pack l, u, by_l[5], by_u[5];
  Block block;
  for (Int first = 0; first < s->n; first += LANES) {
    read_block(s, first, s->n, &block);
    for (Int row = 0; row < s->signatures; row++) {
      double off[LANES];
      for (int j = 0; j < LANES; j += WIDTH) {
        heights(p, load(block.x + j), &l, &u, by_l, by_u);
        Ideal contact = ideal(s, l, u);
        store(off + j, load(block.k[row] + j) - reading(s->share[row], &contact));
      }
      for (int j = 0; j < LANES && first + j < s->n; j++) {
        Int i = row * s->n + first + j;
        residuals[i] = off[j] * sqrt(s->weight[i]);
      }
    }
  }
}

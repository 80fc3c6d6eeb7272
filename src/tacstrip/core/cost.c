/* The normal equations of the polygon fit: J'WJ, J'Wr and r'Wr by theta, in one pass over the strips.

   Between two neighbouring vertices, a section, l and u are straight, and depend on the heights at the ends of the
   edge below and of the edge above: four columns. With s and q from 0 to 1 along these edges every product of the
   columns follows from sums of the terms times 1, s, s^2, q, q^2 and s q. */

#include "closed_form.h"

/* Products of the columns lower left, lower right, upper left, upper right; of these with the residuals; the cost. */
static double section(const Problem *s, Int start, Int end, Line low, Line high, double (*product)[4], double *with_r) {
  Pack sum[15][PACKS], terms[TERMS];
  double total[15];
  Block block;
  CHECK(0 <= start && start < end && end <= s->n);
  for (int q = 0; q < 15; q++) for (int j = 0; j < PACKS; j++) sum[q][j] = all(0.0);
  for (Int i = start; i < end; i += LANES) {
    read_block(s, i, end, &block);
    for (int j = 0; j < PACKS; j++) {
      Pack x = load(block.x + j * WIDTH), dx = x - low.x, a = dx * low.run, l = low.y + low.slope * dx;
      dx = x - high.x;
      Pack b = dx * high.run, u = high.y + high.slope * dx;
      closed_form(s, &block, j, l, u, terms);
      Pack lla = terms[LL] * a, lub = terms[LU] * b, uub = terms[UU] * b;
      sum[0][j] += terms[LL];
      sum[1][j] += lla;
      sum[2][j] += lla * a;
      sum[3][j] += terms[LU];
      sum[4][j] += terms[LU] * a;
      sum[5][j] += lub;
      sum[6][j] += lub * a;
      sum[7][j] += terms[UU];
      sum[8][j] += uub;
      sum[9][j] += uub * b;
      sum[10][j] += terms[LR];
      sum[11][j] += terms[LR] * a;
      sum[12][j] += terms[UR];
      sum[13][j] += terms[UR] * b;
      sum[14][j] += terms[RR];
    }
  }
  for (int q = 0; q < 15; q++) total[q] = joined(sum[q]);
  product[1][1] = total[2];
  product[0][1] = product[1][0] = total[1] - total[2];
  product[0][0] = (total[0] - total[1]) - product[0][1];
  product[1][3] = product[3][1] = total[6];
  product[0][3] = product[3][0] = total[5] - total[6];
  product[1][2] = product[2][1] = total[4] - total[6];
  product[0][2] = product[2][0] = (total[3] - total[4]) - product[0][3];
  product[3][3] = total[9];
  product[2][3] = product[3][2] = total[8] - total[9];
  product[2][2] = (total[7] - total[8]) - product[2][3];
  with_r[0] = total[10] - total[11];
  with_r[1] = total[11];
  with_r[2] = total[12] - total[13];
  with_r[3] = total[13];
  return total[14];
}

Knot knot(const Polygon *p, Int vertex, int upper, int right) {
  Knot at;
  CHECK(vertex < p->m);
  if (vertex >= 0) { at.x = END_ENTRIES + 2 * vertex; at.y = at.x + 1; }
  else { at.x = right ? 3 : 0; at.y = at.x + (upper && p->vertical[right] ? 2 : 1); }
  return at;
}

Line edge(const double *theta, Knot a, Knot b) {
  Line line;
  line.x = theta[a.x];
  line.y = theta[a.y];
  line.run = 1.0 / larger(theta[b.x] - theta[a.x], 1e-12);
  line.slope = (theta[b.y] - theta[a.y]) * line.run;
  return line;
}

Int first_from(const double *x, Int n, double at) {
  Int low = 0, high = n;
  while (low < high) {
    Int middle = (low + high) / 2;
    if (x[middle] < at) low = middle + 1;
    else high = middle;
  }
  return low;
}

double height_at(const Polygon *p, int upper, double x) {
  Knot a = knot(p, -1, upper, 0), b = knot(p, -1, upper, 1);
  x = clip(x, p->theta[0], p->theta[3]);
  for (Int j = 0; j < p->m; j++) if (p->upper[j] == upper) {
    if (p->theta[END_ENTRIES + 2 * j] > x) { b = knot(p, j, upper, 0); break; }
    a = knot(p, j, upper, 0);
  }
  Line line = edge(p->theta, a, b);
  return line.y + line.slope * (x - line.x);
}

void chain_of(const Problem *s, const Polygon *p, int upper, Chain *chain) {
  Int last = 0;
  chain->at[0] = knot(p, -1, upper, 0);
  for (Int j = 0; j < p->m; j++) if (p->upper[j] == upper) chain->at[++last] = knot(p, j, upper, 0);
  chain->at[++last] = knot(p, -1, upper, 1);
  chain->edges = last;
  chain->first[0] = 0;
  for (Int e = 0; e < last; e++) {
    chain->line[e] = edge(p->theta, chain->at[e], chain->at[e + 1]);
    chain->first[e + 1] = e + 1 < last ? first_from(s->x, s->n, p->theta[chain->at[e + 1].x]) : s->n;
  }
}

Int edge_of(const Chain *chain, Int strip, Int e) {
  while (e + 1 < chain->edges && strip >= chain->first[e + 1]) e++;
  return e;
}

double without_prior(const Problem *s, const Polygon *p, Matrix a, double *g) {
  Int size = END_ENTRIES + 2 * p->m, left[2] = {-1, -1}, start = 0;
  double cost = 0.0, product[4][4], with_r[4];
  CHECK(0 <= p->m && p->m <= MAX_VERTICES);
  for (Int i = 0; i < size; i++) {
    g[i] = 0.0;
    for (Int j = 0; j < size; j++) a[i][j] = 0.0;
  }
  for (Int piece = 0; piece <= p->m; piece++) {
    Int end = s->n;
    if (piece > 0) left[p->upper[piece - 1]] = piece - 1;
    if (piece < p->m) {
      end = first_from(s->x, s->n, p->theta[END_ENTRIES + 2 * piece]);
      if (end < start) end = start;
    }
    if (end == start) continue;
    Line line[2];
    Knot at[4];
    double by_x[4]; /* a knot that moves in x moves the line as much as if its height changed so much less */
    for (int upper = 0; upper < 2; upper++) {
      Int right = piece;
      while (right < p->m && p->upper[right] != upper) right++;
      at[2 * upper] = knot(p, left[upper], upper, 0);
      at[2 * upper + 1] = knot(p, right < p->m ? right : -1, upper, 1);
      line[upper] = edge(p->theta, at[2 * upper], at[2 * upper + 1]);
      by_x[2 * upper] = by_x[2 * upper + 1] = -line[upper].slope;
    }
    cost += section(s, start, end, line[0], line[1], product, with_r);
    start = end;
    for (int i = 0; i < 4; i++) {
      g[at[i].y] += with_r[i];
      g[at[i].x] += by_x[i] * with_r[i];
      for (int j = 0; j < 4; j++) {
        double v = product[i][j];
        a[at[i].y][at[j].y] += v;
        a[at[i].y][at[j].x] += v * by_x[j];
        a[at[i].x][at[j].y] += v * by_x[i];
        a[at[i].x][at[j].x] += v * by_x[i] * by_x[j];
      }
    }
  }
  return cost;
}

/* With what the touched strips say of a pointed end: it lies within one pitch, variance pitch^2 / 12. */
double normal_equations(const Problem *s, const Polygon *p, Matrix a, double *g) {
  double cost = without_prior(s, p, a, g), weight = 12.0 / (s->pitch * s->pitch);
  for (int side = 0; side < 2; side++) if (!p->vertical[side]) {
    int i = 3 * side;
    double off = p->theta[i] - (double)side;
    a[i][i] += weight;
    g[i] -= weight * off;
    cost += weight * off * off;
  }
  return cost;
}

double tacstrip_normal_equations(const Problem *s, const Polygon *p, Int prior, double *matrix, double *gradient) {
  Matrix a;
  Int size = END_ENTRIES + 2 * p->m;
  double cost = prior ? normal_equations(s, p, a, gradient) : without_prior(s, p, a, gradient);
  for (Int i = 0; i < size; i++) for (Int j = 0; j < size; j++) matrix[i * size + j] = a[i][j];
  return cost;
}

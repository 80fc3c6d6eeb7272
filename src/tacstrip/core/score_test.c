/* Where one vertex more gains most: the score test of the polygon search.

   A new vertex lifts its chain by a hat: its feet are the neighbours on that chain, its top is the vertex. With v the
   readings' answer to the hat's height, r the residuals and J the slopes of what is fitted already, the fit gains
   (v'r)^2 / (v'v - v'J (J'J)^-1 J'v). A hat and every column of J are straight between knots, so all products follow
   from running sums over the strips of the terms times 1, x and x^2. */

#include "closed_form.h"

#define PLACES 48   /* positions that are tested */
#define NEAR 3      /* of them, within which two are one place */
#define FIRM 1e-6   /* of the diagonal of J'J, added to it */
#define LITTLE 1e-9 /* added plainly */
#define NEW 1e-5    /* of v'v: less of it is left where the hat is nothing new */

enum { SUM_LL = 0, SUM_LU = 3, SUM_UU = 6, SUM_LR = 9, SUM_UR = 11, SUMS = 13 }; /* times 1, x and, for the first, x^2 */

/* A hat over the strips start to end is a + b x there. */
typedef struct {
  Int start, end;
  double a, b;
} Ramp;

typedef struct {
  double score, height, shift[SIZE]; /* shift: how the rest answers, not yet solved for */
  Int strip;
  int upper;
} Place;

/* running (n + 1, SUMS): what the strips up to each one add up to. */
static void running_sums(const Problem *s, const Chain *chain, double *running) {
  Int e[2] = {0, 0};
  for (int q = 0; q < SUMS; q++) running[q] = 0.0;
  for (Int first = 0; first < s->n; first += LANES) {
    double height[2][LANES], terms[TERMS][LANES];
    Int end = first + LANES < s->n ? first + LANES : s->n;
    Block block;
    read_block(s, first, s->n, &block);
    for (int upper = 0; upper < 2; upper++) for (int j = 0; j < LANES; j++) {
      e[upper] = edge_of(chain + upper, first + j < s->n ? first + j : s->n - 1, e[upper]);
      Line line = chain[upper].line[e[upper]];
      height[upper][j] = line.y + line.slope * (block.x[j] - line.x);
    }
    for (int j = 0; j < PACKS; j++) {
      Pack found[TERMS];
      closed_form(s, &block, j, load(height[0] + j * WIDTH), load(height[1] + j * WIDTH), found);
      for (int q = 0; q < TERMS; q++) store(terms[q] + j * WIDTH, found[q]);
    }
    for (Int i = first; i < end; i++) {
      double *now = running + (i + 1) * SUMS, x = s->x[i];
      const double *before = now - SUMS;
      int j = (int)(i - first);
      for (int q = 0; q < 3; q++) {
        double v = terms[LL + q][j];
        now[3 * q] = before[3 * q] + v;
        v *= x;
        now[3 * q + 1] = before[3 * q + 1] + v;
        now[3 * q + 2] = before[3 * q + 2] + v * x;
      }
      for (int q = 0; q < 2; q++) {
        double v = terms[LR + q][j];
        now[SUM_LR + 2 * q] = before[SUM_LR + 2 * q] + v;
        now[SUM_LR + 2 * q + 1] = before[SUM_LR + 2 * q + 1] + v * x;
      }
    }
  }
}

static double over(const double *running, Int start, Int end, int sum) {
  return running[end * SUMS + sum] - running[start * SUMS + sum];
}

/* Add v'J by the knots of one chain to column (SIZE, LANES), lane `lane`; sum: of the terms of both chains. */
static void add_columns(const double *running, int sum, const Chain *chain, const Ramp *hat, double (*column)[LANES],
                        int lane) {
  for (Int e = edge_of(chain, hat[0].start, 0); e < chain->edges && chain->first[e] < hat[1].end; e++) {
    double plain = 0.0, by_x = 0.0;
    for (int side = 0; side < 2; side++) {
      Int start = hat[side].start, end = hat[side].end;
      if (chain->first[e] > start) start = chain->first[e];
      if (chain->first[e + 1] < end) end = chain->first[e + 1];
      if (end <= start) continue;
      double one = over(running, start, end, sum), x = over(running, start, end, sum + 1);
      double square = over(running, start, end, sum + 2);
      plain += hat[side].a * one + hat[side].b * x;
      by_x += hat[side].a * x + hat[side].b * square;
    }
    Line line = chain->line[e];
    double right = (by_x - line.x * plain) * line.run, left = plain - right;
    column[chain->at[e].y][lane] += left;
    column[chain->at[e].x][lane] -= line.slope * left;
    column[chain->at[e + 1].y][lane] += right;
    column[chain->at[e + 1].x][lane] -= line.slope * right;
  }
}

/* Near an earlier place on the same chain the better of both counts, else the worst gives way. */
static Place *slot_of(Place *found, int upper, Int strip, Int near) {
  Place *slot = found;
  for (int t = 0; t < TRIED; t++) {
    if (found[t].score > 0.0 && found[t].upper == upper && strip - found[t].strip <= near) return found + t;
    if (found[t].score < slot->score) slot = found + t;
  }
  return slot;
}

/* Put a vertex on a chain at x, `height` above it. */
static void add_vertex(Polygon *p, int upper, double x, double height) {
  const double *theta = p->theta;
  double before_x = theta[0], before_y = theta[1 + upper], after_x = theta[3], after_y = theta[4 + upper];
  for (Int j = 0; j < p->m; j++) if (p->upper[j] == upper) {
    double at_x = theta[END_ENTRIES + 2 * j], at_y = theta[END_ENTRIES + 2 * j + 1];
    if (at_x > x) { after_x = at_x; after_y = at_y; break; }
    before_x = at_x;
    before_y = at_y;
  }
  double line = before_y + (after_y - before_y) * (x - before_x) / (after_x - before_x);
  p->theta[END_ENTRIES + 2 * p->m] = x;
  p->theta[END_ENTRIES + 2 * p->m + 1] = clip(line + height, 0.0, 1.0);
  p->upper[p->m++] = upper;
}

typedef struct {
  Int strip[LANES];
  double with_r[LANES], square[LANES], column[SIZE][LANES]; /* v'r, v'v and v'J */
  int count;
} Batch;

/* Solve for what is new in each hat of a batch, and keep those that gain most. */
static void rate(Batch *b, Matrix u, const Int *free, Int n, int upper, Int stride, Place *found) {
  double c[SIZE][LANES], own[LANES];
  for (int j = 0; j < LANES; j += WIDTH) {
    Pack left = load(b->square + j), rest[SIZE];
    for (Int q = 0; q < n; q++) rest[q] = load(b->column[free[q]] + j);
    for (Int q = 0; q < n; q++) {
      Pack value = rest[q] / u[q][q];
      left -= value * value;
      store(c[q] + j, value);
      for (Int r = q + 1; r < n; r++) rest[r] -= u[q][r] * value;
    }
    store(own + j, left);
  }
  for (int j = 0; j < b->count; j++) {
    if (own[j] <= NEW * b->square[j]) continue;
    double score = b->with_r[j] * b->with_r[j] / own[j];
    Place *slot = slot_of(found, upper, b->strip[j], NEAR * stride);
    if (!(score > slot->score)) continue;
    slot->score = score;
    slot->height = b->with_r[j] / own[j];
    slot->strip = b->strip[j];
    slot->upper = upper;
    for (Int q = 0; q < n; q++) slot->shift[q] = c[q][j];
  }
  b->count = 0;
}

Int tacstrip_places(const Problem *s, const Polygon *p, Int convex, Polygon *starts, double *running) {
  Matrix a, u;
  double gradient[SIZE];
  Int free[SIZE], stride = s->n / PLACES > 1 ? s->n / PLACES : 1, size = END_ENTRIES + 2 * p->m, count = 0;
  Chain chain[2];
  Place found[TRIED];
  Batch batch;
  CHECK(s->n <= COARSEST && p->m < MAX_VERTICES);
  normal_equations(s, p, a, gradient);
  Int n = free_entries(p, free);
  for (Int i = 0; i < n; i++) {
    for (Int j = i; j < n; j++) u[i][j] = a[free[i]][free[j]];
    u[i][i] += FIRM * u[i][i] + LITTLE;
  }
  if (!factor(u, n)) return 0;
  for (int t = 0; t < TRIED; t++) found[t].score = 0.0;
  for (int upper = 0; upper < 2; upper++) chain_of(s, p, upper, chain + upper);
  running_sums(s, chain, running);
  for (int upper = 0; upper < 2; upper++) {
    const Chain *own = chain + upper;
    Int e = 0;
    batch.count = 0;
    for (Int i = stride; i < s->n - 1; i += stride) {
      double x = s->x[i];
      e = edge_of(own, i, e);
      double left = p->theta[own->at[e].x], right = p->theta[own->at[e + 1].x];
      if (x - left < s->pitch || right - x < s->pitch) continue;
      Int start = e > 0 ? own->first[e] : first_from(s->x, s->n, left);
      Int end = e + 1 < own->edges ? own->first[e + 1] : first_from(s->x, s->n, right);
      double rise = 1.0 / (x - left), fall = 1.0 / (right - x);
      Ramp hat[2] = {{start, i + 1, -left * rise, rise}, {i + 1, end, right * fall, -fall}};
      double with_r = 0.0, square = 0.0;
      int r = upper ? SUM_UR : SUM_LR, own_sum = upper ? SUM_UU : SUM_LL;
      for (int side = 0; side < 2; side++) {
        Ramp ramp = hat[side];
        with_r += ramp.a * over(running, ramp.start, ramp.end, r) + ramp.b * over(running, ramp.start, ramp.end, r + 1);
        square += ramp.a * ramp.a * over(running, ramp.start, ramp.end, own_sum) +
                  2.0 * ramp.a * ramp.b * over(running, ramp.start, ramp.end, own_sum + 1) +
                  ramp.b * ramp.b * over(running, ramp.start, ramp.end, own_sum + 2);
      }
      if (convex && (with_r > 0.0) != (upper == 1)) continue;
      if (batch.count == 0) for (Int q = 0; q < size; q++) for (int j = 0; j < LANES; j++) batch.column[q][j] = 0.0;
      int lane = batch.count++;
      if (lane == 0) for (int j = 0; j < LANES; j++) batch.square[j] = 0.0;
      batch.strip[lane] = i;
      batch.with_r[lane] = with_r;
      batch.square[lane] = square;
      add_columns(running, upper ? SUM_LU : SUM_LL, chain, hat, batch.column, lane);
      add_columns(running, upper ? SUM_UU : SUM_LU, chain + 1, hat, batch.column, lane);
      if (batch.count == LANES) rate(&batch, u, free, n, upper, stride, found);
    }
    if (batch.count) rate(&batch, u, free, n, upper, stride, found);
  }
  int worst = 0;
  for (int t = 0; t < TRIED; t++) if (found[t].score < found[worst].score) worst = t;
  for (int t = 0; t < TRIED; t++) {
    /* Two signatures tell the chain, and l and u are nearly linear in the readings: one place less is enough. */
    if (found[t].score <= 0.0 || (t == worst && !convex)) continue;
    Polygon *start = starts + count++;
    double *shift = found[t].shift;
    solve_upper(u, n, shift); /* what the others do meanwhile: -(J'J)^-1 J'v times the height */
    for (Int q = 0; q < n; q++) shift[q] *= -found[t].height;
    *start = *p;
    move(p, free, n, shift, s->pitch, start->theta);
    add_vertex(start, found[t].upper, s->x[found[t].strip], found[t].height);
  }
  return count;
}

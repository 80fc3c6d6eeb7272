/* Outlines as often as readings and prior make them likely: reversible-jump Markov chains over polygons of any count of
   vertices (Green 1995), tempered, that also move where the readings tell nothing.

   A reading of contact l to u stays the same along dl = -(s + n k) t, du = (1 - s - n k) t, with s the closed form's share
   and n its `narrow`: du - dl = t. With one signature chains move along that direction; with two nothing is free. */

#include "closed_form.h"

#define ROOM (COARSEST + LANES)
#define GRID 61         /* places where the free direction is known, over x from -.1 to 1.1 */
#define BEYOND 0.6      /* of the strip: so far beyond its ends vertices may lie */
#define APART 1e-9      /* in x, of two vertices of one chain */
#define LEAST_HEIGHT 1e-4
#define COARSE_STEP 0.1 /* mean heights of a new vertex over the edge it breaks */
#define FINE_STEP 0.01
#define COARSE_SHARE 0.4
#define PAIR_STEP 0.05  /* mean distance in x of the two vertices of a pair, and a tenth of that */
#define PAIR_LIFT 0.1   /* mean heights of a pair */
#define PAIR_FINE 0.02
#define PAIR_OFF 0.005  /* of its second vertex from the free direction */
#define END_FINE 0.03   /* mean height of a low upright end */
#define EVERY_SWAP 5
#define REFUSED (-1.0 / 0.0)

typedef unsigned long long Bits;

typedef struct {
  const Problem *problem;
  const OutlinePrior *prior;
  Int blocks, free; /* free: whether a direction is free */
  double x[ROOM], k[2][ROOM], weight[2][ROOM], none[ROOM];
  double share, narrow, level[GRID]; /* of the free direction, and the reading along x */
  Bits place;
} Sampler;

typedef struct {
  Outline outline;
  double squares, prior, sigma; /* sigma over that of the weights */
} State;

static double waiting(Sampler *s) { return -natural_log(next_uniform(&s->place) + 1e-300); }
static double scale(Sampler *s) { return exponential(-s->prior->finest * next_uniform(&s->place)); }

/* A height whose mean is a or, with the share p, b; and its density. One draw a statement: C leaves their order open. */
static double mixed_draw(Sampler *s, double a, double p, double b) {
  double mean = next_uniform(&s->place) < p ? b : a;
  return mean * waiting(s);
}
static double mixed_density(double h, double a, double p, double b) {
  double first = exponential(-smaller(h / a, 600.0)) / a, second = exponential(-smaller(h / b, 600.0)) / b;
  return (1.0 - p) * first + p * second;
}

static void copy(Outline *to, const Outline *from) {
  for (int c = 0; c < 2; c++) {
    Int n = to->count[c] = from->count[c];
    for (Int i = 0; i < n; i++) {
      to->x[c][i] = from->x[c][i];
      to->y[c][i] = from->y[c][i];
    }
  }
}

static double between(const Outline *o, int c, Int i, double x) {
  double slope = (o->y[c][i + 1] - o->y[c][i]) / (o->x[c][i + 1] - o->x[c][i]);
  return o->y[c][i] + slope * (x - o->x[c][i]);
}

static Int edge_at(const Outline *o, int c, double x) {
  Int i = 0;
  while (i < o->count[c] - 2 && o->x[c][i + 1] < x) i++;
  return i;
}

/* Heights of a chain at x[from .. to), ascending; outside as its outer edges go on. *edge: the first one there, then the last. */
static void heights(const Outline *o, int c, const double *x, Int from, Int to, Int *edge, double *out) {
  Int i = from, last = o->count[c] - 2;
  for (Int e = *edge; i < to; e++) {
    double ax = o->x[c][e], ay = o->y[c][e], next = o->x[c][e + 1], slope = (o->y[c][e + 1] - ay) / (next - ax);
    Int end = i;
    if (e == last) end = to;
    else while (end < to && x[end] < next) end++;
    for (; i < end; i++) out[i] = ay + slope * (x[i] - ax);
    *edge = e;
  }
}

/* Squared residuals times their weights; once they are more than `most` the rest does not matter. */
static double squares(const Sampler *s, const Outline *o, double most) {
  double l[ROOM], u[ROOM];
  const Problem *p = s->problem;
  Int edge[2] = {0, 0};
  Pack sum[PACKS], zero = all(0.0), one = all(1.0), far = all(1e15);
  for (int j = 0; j < PACKS; j++) sum[j] = zero;
  for (Int b = 0; b < s->blocks; b++) {
    if ((b & 3) == 0) { /* most outlines are refused by the first of their strips */
      Int from = b * LANES, to = (b + 4 < s->blocks ? b + 4 : s->blocks) * LANES;
      heights(o, 0, s->x, from, to, &edge[0], l);
      heights(o, 1, s->x, from, to, &edge[1], u);
    }
    for (int j = 0; j < PACKS; j++) {
      Int at = b * LANES + j * WIDTH;
      Pack low = load(l + at), high = load(u + at);
      sum[j] += where((high < zero) | (low > one) | (high < low), far, zero);
      low = where(low < zero, zero, low);
      high = where(high > one, one, high);
      Ideal contact = nearly_ideal(p, low, high);
      for (Int row = 0; row < p->signatures; row++) {
        Pack r = load(s->k[row] + at) - reading(p->share[row], &contact);
        sum[j] += load(s->weight[row] + at) * r * r;
      }
    }
    if ((b & 3) == 3 && joined(sum) > most) break;
  }
  return joined(sum);
}

static int upright(const Outline *o, int end) {
  return end ? o->y[0][o->count[0] - 1] < o->y[1][o->count[1] - 1] : o->y[0][0] < o->y[1][0];
}

static Int interior(const Outline *o) { return o->count[0] + o->count[1] - 4; }

/* Of a chain, held to 0 and 1. */
static double area_below(const Outline *o, int c) {
  double sum = 0.0;
  for (Int i = 0; i + 1 < o->count[c]; i++) {
    double run = o->x[c][i + 1] - o->x[c][i], a = o->y[c][i], b = o->y[c][i + 1];
    if (a > b) { double swap = a; a = b; b = swap; }
    if (b > 1.0) { /* what lies above 1 counts as 1 */
      if (a >= 1.0) { sum += run; continue; }
      sum += run * (b - 1.0) / (b - a);
      run *= (1.0 - a) / (b - a);
      b = 1.0;
    }
    if (a < 0.0) {
      if (b <= 0.0) continue;
      run *= b / (b - a);
      a = 0.0;
    }
    sum += 0.5 * run * (a + b);
  }
  return sum;
}

/* Whether the chains pass each other: at strips the readings would tell, but not between them. */
static int crosses(const Outline *o) {
  for (int c = 0; c < 2; c++) {
    for (Int i = 1; i < o->count[c] - 1; i++) {
      double other = between(o, 1 - c, edge_at(o, 1 - c, o->x[c][i]), o->x[c][i]);
      if (c ? o->y[c][i] < other : o->y[c][i] > other) return 1;
    }
  }
  return 0;
}

/* Log density but for a constant; REFUSED where there is no such outline. */
static double log_prior(const OutlinePrior *prior, const Outline *o) {
  Int last[2] = {o->count[0] - 1, o->count[1] - 1}, reflex = 0;
  double low = 10.0, high = -10.0, left = o->x[0][0], right = o->x[0][last[0]];
  if (!(left >= prior->window[0] && left <= prior->window[1])) return REFUSED;
  if (!(right >= prior->window[2] && right <= prior->window[3])) return REFUSED;
  if (o->y[0][0] > o->y[1][0] || o->y[0][last[0]] > o->y[1][last[1]]) return REFUSED;
  for (int c = 0; c < 2; c++) {
    double way = c ? -1.0 : 1.0, before = 0.0;
    for (Int i = 0; i <= last[c]; i++) {
      double y = o->y[c][i];
      if (!(y >= -BEYOND && y <= 1.0 + BEYOND)) return REFUSED;
      low = smaller(low, y);
      high = larger(high, y);
      if (i == 0) continue;
      double run = o->x[c][i] - o->x[c][i - 1], slope = (y - o->y[c][i - 1]) / run;
      if (!(run > APART)) return REFUSED;
      if (i > 1 && way * (slope - before) < 0.0) {
        if (prior->reflex == REFUSED) return REFUSED;
        reflex++;
      }
      before = slope;
    }
  }
  if (reflex && crosses(o)) return REFUSED; /* convex ones pass only where an end does */
  int ends[2] = {upright(o, 0), upright(o, 1)};
  Int vertices = interior(o) + 2 + ends[0] + ends[1];
  if (vertices < 3 || vertices > MOST_CORNERS) return REFUSED;
  double value = prior->vertices[ends[0] + ends[1]][vertices] + prior->ends[ends[0] + 2 * ends[1]];
  if (reflex) value += (double)reflex * prior->reflex;
  value -= (double)(vertices - 2) * natural_log(larger(high - low, LEAST_HEIGHT));
  if (prior->area_sigma > 0.0) {
    double off = (area_below(o, 1) - area_below(o, 0) - prior->area) / prior->area_sigma;
    value -= 0.5 * off * off;
  }
  return value;
}

/* The free direction at x: dl and du of t = 1. */
static void direction(const Sampler *s, double x, double *dl, double *du) {
  double g = clip((x + 0.1) / 1.2 * (GRID - 1), 0.0, GRID - 1.001);
  Int i = (Int)g;
  double k = s->level[i] + (g - (double)i) * (s->level[i + 1] - s->level[i]);
  *dl = -(s->share + s->narrow * k);
  *du = 1.0 + *dl;
}

/* Widen by `left` and `right` at the ends and, between them, by a tent of `middle` at the x of either chain. */
static void widen(const Sampler *s, Outline *o, double left, double right, double middle, double low_at, double high_at) {
  double from = o->x[0][0], to = o->x[0][o->count[0] - 1], run = 1.0 / (to - from);
  for (int c = 0; c < 2; c++) {
    double top = c ? high_at : low_at;
    for (Int i = 0; i < o->count[c]; i++) {
      double x = o->x[c][i], part = (x - from) * run, t = left * (1.0 - part) + right * part, dl, du;
      if (middle != 0.0) t += middle * (x <= top ? (x - from) / (top - from) : (to - x) / (to - top));
      direction(s, x, &dl, &du);
      o->y[c][i] += t * (c ? du : dl);
    }
  }
}

/* Of all interior vertices one: its chain and its place there. */
static Int pick(Sampler *s, const Outline *o, int *c) {
  Int j = next_below(&s->place, interior(o));
  *c = j >= o->count[0] - 2;
  return *c ? j - (o->count[0] - 2) + 1 : j + 1;
}

static void insert(Outline *o, int c, Int i, double x, double y) {
  for (Int j = o->count[c]++; j > i; j--) {
    o->x[c][j] = o->x[c][j - 1];
    o->y[c][j] = o->y[c][j - 1];
  }
  o->x[c][i] = x;
  o->y[c][i] = y;
}

static void leave_out(Outline *o, int c, Int i) {
  o->count[c]--;
  for (Int j = i; j < o->count[c]; j++) {
    o->x[c][j] = o->x[c][j + 1];
    o->y[c][j] = o->y[c][j + 1];
  }
}

/* Moves. Each changes an outline and returns the log of the Hastings ratio, its Jacobian included. */

static double move_vertex(Sampler *s, Outline *o) {
  if (interior(o) == 0) return REFUSED;
  int c;
  Int i = pick(s, o, &c);
  double size = scale(s), way = next_uniform(&s->place);
  if (way < 0.4) { /* along an edge, which keeps its line */
    Int other = next_uniform(&s->place) < 0.5 ? i - 1 : i + 1;
    double run = o->x[c][other] - o->x[c][i], dx = 0.3 * size * next_bell(&s->place), left = (run - dx) / run;
    if (!(left > 0.0)) return REFUSED;
    o->x[c][i] += dx;
    o->y[c][i] += dx * (o->y[c][other] - o->y[c][i]) / run;
    return natural_log(left); /* edges near the other vertex lie closer to each other */
  } else {
    if (way >= 0.7) o->x[c][i] += 0.3 * size * next_bell(&s->place);
    o->y[c][i] += 0.1 * size * next_bell(&s->place);
  }
  return 0.0;
}

/* An end goes out or in and its edges, or one of a point, keep their lines: between two strips nothing else is as likely. */
static double slide_end(Sampler *s, Outline *o, int end, int both, double dx) {
  int only = next_uniform(&s->place) < 0.5;
  if (!both) dx *= scale(s); /* the other edge turns */
  double y[2], x = 0.0, shrunk = 1.0;
  for (int c = 0; c < 2; c++) {
    Int i = end ? o->count[c] - 1 : 0, next = end ? i - 1 : 1;
    double run = o->x[c][next] - o->x[c][i], left = (run - dx) / run;
    if (!(left > 0.0)) return REFUSED;
    x = o->x[c][i] + dx;
    y[c] = o->y[c][i] + dx * (o->y[c][next] - o->y[c][i]) / run;
    if (both || c == only) shrunk *= left; /* lines lie closer to each other near the next vertex */
  }
  if (!both) y[1 - only] = y[only];
  for (int c = 0; c < 2; c++) {
    Int i = end ? o->count[c] - 1 : 0;
    o->x[c][i] = x;
    o->y[c][i] = y[c];
  }
  return natural_log(shrunk);
}

static double move_end(Sampler *s, Outline *o) {
  int end = next_uniform(&s->place) < 0.5, both = upright(o, end);
  Int at[2] = {end ? o->count[0] - 1 : 0, end ? o->count[1] - 1 : 0};
  if (next_uniform(&s->place) < 0.3) {
    double dx = s->problem->pitch * (next_uniform(&s->place) - 0.5);
    if (!s->free) return slide_end(s, o, end, both, dx);
    for (int c = 0; c < 2; c++) o->x[c][at[c]] += dx;
    return 0.0;
  }
  double size = 0.1 * scale(s), dl = size * next_bell(&s->place), du = dl;
  if (both) {
    double which = next_uniform(&s->place);
    if (which < 0.5) du = size * next_bell(&s->place);
    if (which < 0.3) dl = 0.0;
    else if (which < 0.4) { dl = du; du = 0.0; }
  }
  o->y[0][at[0]] += dl;
  o->y[1][at[1]] += du;
  return 0.0;
}

/* Both upright ends, and all between them, along the free direction. */
static double move_wedge(Sampler *s, Outline *o) {
  double size = scale(s), left = size * next_bell(&s->place), right = size * next_bell(&s->place), which = next_uniform(&s->place);
  if (!upright(o, 0) || which < 0.3) left = 0.0;
  if (!upright(o, 1) || (which >= 0.3 && which < 0.6)) right = 0.0;
  if (left == 0.0 && right == 0.0) return REFUSED;
  widen(s, o, left, right, 0.0, 0.5, 0.5);
  return 0.0;
}

static double move_tent(Sampler *s, Outline *o) {
  if (o->count[0] < 3 || o->count[1] < 3) return REFUSED;
  Int i = 1 + next_below(&s->place, o->count[0] - 2), j = 1 + next_below(&s->place, o->count[1] - 2);
  double size = 0.5 * scale(s);
  widen(s, o, 0.0, 0.0, size * next_bell(&s->place), o->x[0][i], o->x[1][j]);
  return 0.0;
}

/* The whole outline along the strips: moved, slanted, or stretched from one corner. */
static double move_whole(Sampler *s, Outline *o) {
  double which = next_uniform(&s->place), size = scale(s), t = size * next_bell(&s->place), fixed = o->y[0][0],
      stretch = exponential(0.5 * t);
  for (int c = 0; c < 2; c++) for (Int i = 0; i < o->count[c]; i++) {
    double *y = &o->y[c][i];
    if (which < 0.3) *y += 0.2 * t;
    else if (which < 0.6) *y += 0.4 * t * (o->x[c][i] - 0.5);
    else *y = fixed + (*y - fixed) * stretch;
  }
  return which < 0.6 ? 0.0 : 0.5 * t * (double)(interior(o) + 1 + upright(o, 0) + upright(o, 1));
}

/* The family that reads alike to the last bit: l' = l - c (s / n + l), u' = u + c ((1 - s) / n - u). */
static double move_family(Sampler *s, Outline *o) {
  if (!upright(o, 0) || !upright(o, 1)) return REFUSED;
  double size = 0.5 * scale(s), t = size * next_bell(&s->place), keep = exponential(-t), c = 1.0 - keep;
  for (Int i = 0; i < o->count[0]; i++) o->y[0][i] -= c * (s->share / s->narrow + o->y[0][i]);
  for (Int i = 0; i < o->count[1]; i++) o->y[1][i] += c * ((1.0 - s->share) / s->narrow - o->y[1][i]);
  return -t * (double)(o->count[0] + o->count[1]);
}

/* An end becomes upright or pointed, the others along the free direction, or all others as they are. */
static double turn_end(Sampler *s, Outline *o) {
  int end = next_uniform(&s->place) < 0.5, alone = !s->free || next_uniform(&s->place) < 0.3, was = upright(o, end);
  Int at[2] = {end ? o->count[0] - 1 : 0, end ? o->count[1] - 1 : 0};
  double h = was ? o->y[1][at[1]] - o->y[0][at[0]] : next_uniform(&s->place) < 0.5 ? next_uniform(&s->place) :
      END_FINE * waiting(s), way = was ? -h : h;
  double density = 0.5 * (h < 1.0) + 0.5 / END_FINE * exponential(-smaller(h / END_FINE, 600.0));
  if (alone) {
    double dl, du;
    direction(s, o->x[0][at[0]], &dl, &du);
    o->y[0][at[0]] += dl * way;
    o->y[1][at[1]] += du * way;
  } else widen(s, o, end ? 0.0 : way, end ? way : 0.0, 0.0, 0.5, 0.5);
  if (was) o->y[1][at[1]] = o->y[0][at[0]];
  return was ? natural_log(density) : -natural_log(density);
}

static double one_more_or_less(Sampler *s, Outline *o) {
  double width = o->x[0][o->count[0] - 1] - o->x[0][0], signs = s->prior->reflex == REFUSED ? 1.0 : 0.5;
  Int now = interior(o);
  if (next_uniform(&s->place) < 0.5) {
    int c = next_uniform(&s->place) < 0.5;
    if (o->count[c] >= KNOTS) return REFUSED;
    double x = o->x[0][0] + width * next_uniform(&s->place), h = mixed_draw(s, FINE_STEP, COARSE_SHARE, COARSE_STEP);
    double density = signs * mixed_density(h, FINE_STEP, COARSE_SHARE, COARSE_STEP),
        out = signs < 1.0 && next_uniform(&s->place) < 0.5 ? -h : h;
    Int i = edge_at(o, c, x);
    insert(o, c, i + 1, x, between(o, c, i, x) + (c ? out : -out));
    return -natural_log((double)(now + 1) * 0.5 * density / width);
  }
  if (now == 0) return REFUSED;
  int c;
  Int i = pick(s, o, &c);
  double x = o->x[c][i], y = o->y[c][i];
  leave_out(o, c, i);
  double h = (y - between(o, c, i - 1, x)) * (c ? 1.0 : -1.0);
  if (signs == 1.0 && h < 0.0) return REFUSED;
  return natural_log((double)now * 0.5 * signs * mixed_density(magnitude(h), FINE_STEP, COARSE_SHARE, COARSE_STEP) / width);
}

/* Two vertices, one on either chain, and all others along the free direction. */
static double pair_more_or_less(Sampler *s, Outline *o) {
  double from = o->x[0][0], to = o->x[0][o->count[0] - 1], width = to - from, dl, du, h, off, x[2];
  int more = next_uniform(&s->place) < 0.5;
  Int i, j, ways;
  if (more) {
    if (o->count[0] >= KNOTS || o->count[1] >= KNOTS) return REFUSED;
    x[0] = from + width * next_uniform(&s->place);
    double apart = mixed_draw(s, PAIR_STEP, 0.5, 0.1 * PAIR_STEP);
    x[1] = next_uniform(&s->place) < 0.5 ? x[0] - apart : x[0] + apart;
    h = mixed_draw(s, PAIR_LIFT, 0.5, PAIR_FINE);
    off = PAIR_OFF * waiting(s);
    if (next_uniform(&s->place) < 0.5) off = -off;
    if (!(x[1] > from && x[1] < to && x[0] > from)) return REFUSED;
    i = edge_at(o, 0, x[0]) + 1;
    j = edge_at(o, 1, x[1]) + 1;
    ways = (o->count[0] - 1) * (o->count[1] - 1);
  } else {
    if (o->count[0] < 3 || o->count[1] < 3) return REFUSED;
    i = 1 + next_below(&s->place, o->count[0] - 2);
    j = 1 + next_below(&s->place, o->count[1] - 2);
    x[0] = o->x[0][i];
    x[1] = o->x[1][j];
    h = off = 0.0;
    ways = (o->count[0] - 2) * (o->count[1] - 2);
  }
  double low = o->y[0][i], high = o->y[1][j]; /* of the pair that goes */
  if (!more) {
    leave_out(o, 0, i);
    leave_out(o, 1, j);
  }
  /* What a lift of 1 does to the chains where the pair is, without it. */
  double lift[2];
  for (int c = 0; c < 2; c++) {
    Int at = c ? j : i;
    double ends[2];
    for (int side = 0; side < 2; side++) {
      double place = o->x[c][at - 1 + side];
      direction(s, place, &dl, &du);
      ends[side] = (c ? du : dl) * (place <= x[c] ? (place - from) / (x[c] - from) : (to - place) / (to - x[c]));
    }
    lift[c] = ends[0] + (ends[1] - ends[0]) * (x[c] - o->x[c][at - 1]) / (o->x[c][at] - o->x[c][at - 1]);
  }
  direction(s, x[0], &dl, &du);
  double own = dl - lift[0];
  direction(s, x[1], &dl, &du);
  if (!(magnitude(own) > 1e-9)) return REFUSED;
  if (!more) { /* low = chord + own h, and so on */
    h = (low - between(o, 0, i - 1, x[0])) / own;
    if (!(h > 0.0)) return REFUSED;
    off = high - between(o, 1, j - 1, x[1]) - (du - lift[1]) * h;
  }
  double apart = magnitude(x[1] - x[0]);
  double density = 0.5 * mixed_density(apart, PAIR_STEP, 0.5, 0.1 * PAIR_STEP) * mixed_density(h, PAIR_LIFT, 0.5, PAIR_FINE) * 0.5 /
                   PAIR_OFF * exponential(-smaller(magnitude(off) / PAIR_OFF, 600.0)) / width;
  double ratio = natural_log((double)ways * larger(density, 1e-300) / magnitude(own));
  if (more) {
    double base[2] = {between(o, 0, i - 1, x[0]), between(o, 1, j - 1, x[1])};
    widen(s, o, 0.0, 0.0, h, x[0], x[1]);
    direction(s, x[0], &dl, &du);
    insert(o, 0, i, x[0], base[0] + dl * h);
    direction(s, x[1], &dl, &du);
    insert(o, 1, j, x[1], base[1] + du * h + off);
    return -ratio;
  }
  widen(s, o, 0.0, 0.0, -h, x[0], x[1]);
  return ratio;
}

static double propose(Sampler *s, Outline *o) {
  double which = next_uniform(&s->place);
  if (!s->free) return which < 0.42   ? move_vertex(s, o)
                       : which < 0.65 ? move_end(s, o)
                       : which < 0.70 ? move_whole(s, o)
                       : which < 0.80 ? turn_end(s, o)
                                      : one_more_or_less(s, o);
  return which < 0.23   ? move_vertex(s, o)
         : which < 0.28 ? move_whole(s, o)
         : which < 0.40 ? move_end(s, o)
         : which < 0.50 ? move_wedge(s, o)
         : which < 0.59 ? move_tent(s, o)
         : which < 0.62 ? move_family(s, o)
         : which < 0.72 ? turn_end(s, o)
         : which < 0.88 ? one_more_or_less(s, o)
                        : pair_more_or_less(s, o);
}

/* The reading along x, smoothed over a sixteenth of the strips. */
static void level(Sampler *s) {
  const Problem *p = s->problem;
  Int reach = p->n / 16;
  for (int g = 0; g < GRID; g++) {
    double x = clip(1.2 * g / (GRID - 1) - 0.1, 0.0, 1.0), sum = 0.0;
    Int at = first_from(p->x, p->n, x), low = at - 1 - reach, high = at + reach;
    if (low < 0) low = 0;
    if (high > p->n - 1) high = p->n - 1;
    for (Int i = low; i <= high; i++) sum += p->k[i];
    s->level[g] = clip(sum / (double)(high - low + 1), 0.005, 0.995);
  }
}

static void swap_states(State *a, State *b) {
  Outline o;
  copy(&o, &a->outline);
  copy(&a->outline, &b->outline);
  copy(&b->outline, &o);
  double v[3] = {a->squares, a->prior, a->sigma};
  a->squares = b->squares, a->prior = b->prior, a->sigma = b->sigma;
  b->squares = v[0], b->prior = v[1], b->sigma = v[2];
}

static void step(Sampler *s, State *now, double heat, double readings) {
  Outline trial;
  copy(&trial, &now->outline);
  double ratio = propose(s, &trial), variance = now->sigma * now->sigma;
  double prior = ratio == REFUSED ? REFUSED : log_prior(s->prior, &trial);
  if (prior != REFUSED) {
    double chance = prior - now->prior + ratio + waiting(s); /* of likelihood, what may be lost */
    double most = now->squares + 2.0 * heat * variance * chance;
    double cost = most < 0.0 ? INFINITE : squares(s, &trial, most);
    if (cost <= most) {
      copy(&now->outline, &trial);
      now->squares = cost;
      now->prior = prior;
    }
  }
  if (s->prior->sigma[0] < s->prior->sigma[1]) { /* log-uniform */
    double by = 0.3 * next_bell(&s->place), sigma = now->sigma * exponential(by);
    if (sigma >= s->prior->sigma[0] && sigma <= s->prior->sigma[1]) {
      double loss = readings * by + 0.5 * now->squares * (1.0 / (sigma * sigma) - 1.0 / variance);
      if (loss <= heat * waiting(s)) now->sigma = sigma;
    }
  }
}

static double energy(const State *s, double readings) {
  return 0.5 * s->squares / (s->sigma * s->sigma) + readings * natural_log(s->sigma);
}

Int tacstrip_sample_outlines(const Problem *problem, const OutlinePrior *prior, const Outline *starts, const double *heat,
                             Int temperatures, Int steps, Int kept, Int seed, Outline *samples, double *values) {
  Sampler s;
  State state[HOTTEST];
  double readings = 0.0;
  CHECK(problem->n > 0 && problem->n <= COARSEST && temperatures > 0 && temperatures <= HOTTEST);
  s.problem = problem;
  s.prior = prior;
  s.place = (Bits)seed << 40;
  s.free = problem->signatures == 1;
  s.share = problem->share[0];
  s.narrow = problem->narrow;
  s.blocks = (problem->n + LANES - 1) / LANES;
  for (Int i = 0; i < s.blocks * LANES; i++) {
    Int from = i < problem->n ? i : problem->n - 1;
    s.x[i] = problem->x[from];
    for (Int row = 0; row < problem->signatures; row++) {
      s.k[row][i] = problem->k[row * problem->n + from];
      s.weight[row][i] = i < problem->n ? problem->weight[row * problem->n + from] : 0.0;
      readings += s.weight[row][i] > 0.0;
    }
  }
  level(&s);
  for (Int t = 0; t < temperatures; t++) {
    copy(&state[t].outline, starts + t);
    state[t].prior = log_prior(prior, starts + t);
    if (state[t].prior == REFUSED) return 0;
    state[t].squares = squares(&s, starts + t, INFINITE);
    state[t].sigma = clip(1.0, prior->sigma[0], prior->sigma[1]);
  }
  Int burnt = steps / 4, done = 0;
  for (Int i = 0; i < steps; i++) {
    for (Int t = 0; t < temperatures; t++) step(&s, state + t, heat[t], readings);
    if (temperatures > 1 && i % EVERY_SWAP == 0) {
      Int t = next_below(&s.place, temperatures - 1);
      double gain = (energy(state + t, readings) - energy(state + t + 1, readings)) * (1.0 / heat[t] - 1.0 / heat[t + 1]);
      if (gain + waiting(&s) >= 0.0) swap_states(state + t, state + t + 1);
    }
    if (i >= burnt && done < kept && (i - burnt) * kept >= done * (steps - burnt)) {
      copy(samples + done, &state[0].outline);
      values[3 * done] = state[0].squares;
      values[3 * done + 1] = state[0].prior;
      values[3 * done + 2] = state[0].sigma;
      done++;
    }
  }
  return done;
}

/* l and u of outlines at x (places,), ascending, held to 0 and 1; both 0 outside. */
void tacstrip_outline_ends(const Outline *outlines, Int count, const double *x, Int places, double *ends) {
  for (Int k = 0; k < count; k++, ends += 2 * places) {
    const Outline *o = outlines + k;
    for (int c = 0; c < 2; c++) {
      Int edge = 0;
      heights(o, c, x, 0, places, &edge, ends + c * places);
    }
    for (Int i = 0; i < 2 * places; i++) {
      double at = x[i % places];
      int inside = at >= o->x[0][0] && at <= o->x[0][o->count[0] - 1];
      ends[i] = inside ? clip(ends[i], 0.0, 1.0) : 0.0;
    }
  }
}

/* Regular outlines that explain the readings of one signature: particles of each kind by sequential Monte Carlo (Del Moral,
   Doucet and Jasra 2006), which tells how likely the kind makes the readings, too.

   An outline is REGULAR_NUMBERS numbers from 0 to 1, see reconstruction/posterior/regular/kinds.py, whose shapes these are.
   y follows by linear least squares, for k (1 - n w) = l + a w is linear in l. */

#include "closed_form.h"

enum { DISC, ELLIPSE, SEGMENT, UPRIGHT, RECTANGLE, TRAPEZOID, TURNED };
enum { Z_LEFT, Z_RIGHT, Z_RATIO, Z_TURN, Z_FIRST, Z_SECOND, Z_PART, Z_BORDER };
enum { LOG_PRIOR, MISFIT, LOWEST };

#define VALUES REGULAR_VALUES
#define PI 3.14159265358979323846
#define LOG_FLATTEST -1.0498221244986778 /* log .35, ratio of the axes */
#define UPRIGHT_EDGE 1e-6                /* cosine of an edge that adds nothing to its ends */
#define LOW 0.02                         /* of an outline's height, over the strip */
#define HIGH 0.97
#define UNTOUCHED 1e3 /* half chi square of a strip that an outline misses; one may lie on an end */
#define NEVER -1e9    /* log prior and likelihood of what cannot be */
#define FIRST_DRAWN 4 /* particles to begin with, for one */
#define SWEEPS 6
#define LEVELS 60
#define ENOUGH 0.5 /* of the particles, that a level leaves */
#define SMALLEST 1e-12
#define HALVINGS 13
#define HOPELESS 8.0 /* of the log evidence, by which a kind is given up */
#define ROOM (REGULAR_STRIPS + LANES)

typedef struct {
  const Problem *problem;
  const RegularPlace *place;
  Int blocks;
  double x[ROOM], k[ROOM], weight[ROOM];
  unsigned long long drawn;
} Regular;

/* In its own units, and where it lies: own x = along x + offset, own y = (y + base) / rise. */
typedef struct {
  int family, border; /* border 0 to 3: over the first strip, the last one, the ground end, the other one; -1 none */
  double left, right, height, part, along, offset, rise, base;
  double c, s, square, flat, middle, cut;             /* ovals */
  double slope[4], level[4], begin[2], end[2], off[2]; /* edges of rectangles (two) and trapezoids */
  double radius_square, low[4], high[4];
} Shape;


static double axes_ratio(const double *z) { return exponential(LOG_FLATTEST * (1.0 - 2.0 * z[Z_RATIO])); }

typedef struct {
  double first, last, low, high;
} Box;

/* How far an oval reaches back and forth in the direction of these parts along and across its first axis. */
static void reach(const Shape *o, double along, double across, double *back, double *forth) {
  double far = sqrt(along * along + o->flat * across * (o->flat * across)), at = smaller(o->cut, 1.0);
  double chord = at * along, half = magnitude(o->flat * sqrt(1.0 - at * at) * across), tip = along / far;
  *back = -tip <= o->cut ? -far : chord - half;
  *forth = tip <= o->cut ? far : chord + half;
}

static Box oval(Int kind, const double *z, Shape *o) {
  double turn = PI * z[Z_TURN] * (kind == SEGMENT ? 2.0 : 1.0);
  Box box;
  o->cut = kind == SEGMENT ? -0.6 + 1.5 * z[Z_FIRST] : 2.0;
  o->flat = kind == ELLIPSE ? exponential(LOG_FLATTEST * z[Z_RATIO]) : 1.0;
  o->c = cosine(turn);
  o->s = sine(turn);
  o->square = o->c * o->c + o->flat * o->s * (o->flat * o->s);
  o->middle = o->c * o->s * (1.0 - o->flat * o->flat) / o->square;
  reach(o, o->c, -o->s, &box.first, &box.last);
  reach(o, o->s, o->c, &box.low, &box.high);
  return box;
}

/* What a disc sweeps over a core of half axes a, b about 0, the first one along (c, s). */
static Box rectangle(Int kind, const double *z, Shape *o) {
  double tall = axes_ratio(z), quarters = kind == RECTANGLE ? 4.0 * z[Z_TURN] : 0.0, turn = quarters - (double)(Int)quarters;
  int lies = turn + (double)((Int)quarters % 2) < 1.0;
  double c = cosine(0.5 * PI * turn), s = sine(0.5 * PI * turn);
  /* Corners are sharp in a quarter of the rectangles, and ends half discs in a few. */
  double radius = clip(1.5 * z[Z_FIRST] - 0.4, 0.0, 1.0) * smaller(1.0, tall);
  double a = (lies ? 1.0 : tall) - radius, b = (lies ? tall : 1.0) - radius;
  double x = b * s - a * c, y = -b * c - a * s; /* the lowest corner of the core */
  double along[2], rise[2];
  along[0] = c, rise[0] = s;
  along[1] = s, rise[1] = -c;
  o->begin[0] = x, o->end[0] = x + 2.0 * a * c, o->off[0] = radius * s;
  o->begin[1] = x - 2.0 * b * s, o->end[1] = x, o->off[1] = -radius * c;
  for (int i = 0; i < 2; i++) {
    o->slope[i] = along[i] > UPRIGHT_EDGE ? rise[i] / along[i] : 0.0;
    o->level[i] = y - o->slope[i] * x;
  }
  o->radius_square = radius * radius;
  Box box = {-(a * c + b * s + radius), a * c + b * s + radius, -(a * s + b * c + radius), a * s + b * c + radius};
  return box;
}

static Box trapezoid(Int kind, const double *z, Shape *o) {
  double tall = axes_ratio(z), top = 0.2 + 1.6 * z[Z_FIRST], quarters = 4.0 * z[Z_TURN];
  if (kind == TRAPEZOID) quarters = (double)(Int)quarters;
  double begin = -1.6 + (3.2 - top) * z[Z_SECOND], c = cosine(0.5 * PI * quarters), s = sine(0.5 * PI * quarters);
  double own[4], x[4], y[4];
  own[0] = -1.0, own[1] = 1.0, own[2] = begin + top, own[3] = begin;
  Box box = {INFINITE, -INFINITE, INFINITE, -INFINITE};
  for (int i = 0; i < 4; i++) {
    double up = i < 2 ? -tall : tall;
    x[i] = c * own[i] - s * up;
    y[i] = s * own[i] + c * up;
    box.first = smaller(box.first, x[i]), box.last = larger(box.last, x[i]);
    box.low = smaller(box.low, y[i]), box.high = larger(box.high, y[i]);
  }
  for (int i = 0; i < 4; i++) { /* edges that go on are lower ones, those that come back upper ones */
    double dx = x[(i + 1) % 4] - x[i], dy = y[(i + 1) % 4] - y[i];
    int steep = magnitude(dx) < UPRIGHT_EDGE * sqrt(dx * dx + dy * dy);
    o->slope[i] = steep ? 0.0 : dy / dx;
    o->low[i] = !steep && dx > 0.0 ? y[i] - o->slope[i] * x[i] : -INFINITE;
    o->high[i] = !steep && dx < 0.0 ? y[i] - o->slope[i] * x[i] : INFINITE;
  }
  return box;
}

static void placed(const Regular *r, Int kind, Int over, const double *z, Shape *o) {
  const double *window = r->place->window;
  Int borders = r->place->borders, which = (Int)(z[Z_BORDER] * (double)borders);
  o->family = kind < UPRIGHT ? 0 : kind < TRAPEZOID ? 1 : 2;
  o->border = over ? (int)r->place->border[which < borders ? which : borders - 1] : -1;
  o->left = window[0] + (window[1] - window[0]) * z[Z_LEFT];
  o->right = window[2] + (window[3] - window[2]) * z[Z_RIGHT];
  o->part = 0.1 + 0.4 * z[Z_PART];
  double whole = (o->right - o->left) / (1.0 - o->part);
  if (o->border == 0) o->left = o->right - whole;
  if (o->border == 1) o->right = o->left + whole;
  Box box = o->family == 0 ? oval(kind, z, o) : o->family == 1 ? rectangle(kind, z, o) : trapezoid(kind, z, o);
  o->along = (box.last - box.first) / (o->right - o->left);
  o->offset = box.first - o->along * o->left;
  o->rise = r->place->aspect / o->along;
  o->base = o->rise * box.low;
  o->height = o->rise * (box.high - box.low);
}

/* The lowest y of a rounded rectangle at its own x: on the disc about that point of a lower edge whose normal meets x, or
   about the nearer of its ends. */
static Pack rectangle_low(const Shape *o, Pack at) {
  Pack low = all(INFINITE), zero = all(0.0);
  for (int i = 0; i < 2; i++) {
    Pack middle = lesser(greater(at - o->off[i], all(o->begin[i])), all(o->end[i]));
    Pack half = o->radius_square - (at - middle) * (at - middle);
    Pack disc = o->slope[i] * middle + o->level[i] - root(greater(half, zero));
    low = lesser(low, where(half >= zero, disc, all(INFINITE)));
  }
  return low;
}

/* Lowest and highest y over the strip above the outline's lowest point, at x; low above high where it is not. */
static void ends_at(const Shape *o, Pack x, Pack *low, Pack *high) {
  Pack at = o->along * x + o->offset;
  if (o->family == 0) {
    Pack half = root(greater(o->square - at * at, all(0.0))) * (o->flat / o->square), middle = at * o->middle;
    *low = middle - half;
    *high = middle + half;
    if (magnitude(o->s) > 1e-6) {
      Pack line = (o->cut - at * o->c) / o->s;
      if (o->s < 0.0) *low = greater(*low, line);
      else *high = lesser(*high, line);
    }
  } else if (o->family == 1) {
    *low = rectangle_low(o, at);
    *high = -rectangle_low(o, -at);
  } else {
    *low = all(-INFINITE);
    *high = all(INFINITE);
    for (int i = 0; i < 4; i++) {
      *low = greater(*low, o->slope[i] * at + o->low[i]);
      *high = lesser(*high, o->slope[i] * at + o->high[i]);
    }
  }
  *low = o->rise * *low - o->base;
  *high = o->rise * *high - o->base;
}

/* Log prior, half chi square and the lowest point over the strip that the readings want. */
static void weigh(const Regular *r, Int kind, Int over, const double *z, double *values) {
  Shape o;
  double lower[ROOM], width[ROOM];
  const Problem *p = r->problem;
  double share = p->share[0];
  placed(r, kind, over, z, &o);
  values[LOG_PRIOR] = NEVER, values[MISFIT] = -NEVER, values[LOWEST] = 0.0;
  if (!(o.height > LOW && o.height < HIGH)) return;
  Pack sums[2][PACKS], zero = all(0.0), one = all(1.0);
  for (int j = 0; j < PACKS; j++) sums[0][j] = sums[1][j] = zero;
  int cut = o.border >= 2;
  for (Int at = 0; at < r->blocks * LANES; at += WIDTH) {
    Pack x = load(r->x + at), low, high;
    ends_at(&o, x, &low, &high);
    Mask there = (x >= all(o.left)) & (x <= all(o.right)) & (high >= low);
    low = where(there, low, zero);
    Pack w = where(there, high - low, zero);
    store(lower + at, low);
    store(width + at, w);
    if (cut) continue;
    Ideal contact = nearly_ideal(p, zero, w);
    Pack k = load(r->k + at), linear = load(r->weight + at) * contact.over * contact.over;
    Pack l = k / contact.over - (1.0 - share) * contact.low - share * contact.high - low;
    int j = (int)(at % LANES) / WIDTH;
    sums[0][j] += linear;
    sums[1][j] += linear * l;
  }
  double room = 1.0 - o.height, lowest, log = 0.0;
  if (cut) lowest = o.border == 2 ? -o.part * o.height : room + o.part * o.height;
  else {
    double total = joined(sums[0]);
    lowest = clip(joined(sums[1]) / total, 0.0, room);
    /* Places along the strip are as likely: their integral is that of the likelihood. */
    log = -0.5 * natural_log(total / (2.0 * PI)) - natural_log(larger(room, LOW));
  }
  Pack sum[PACKS], missed[PACKS];
  for (int j = 0; j < PACKS; j++) sum[j] = missed[j] = zero;
  for (Int at = 0; at < r->blocks * LANES; at += WIDTH) {
    int j = (int)(at % LANES) / WIDTH;
    Pack l = load(lower + at) + lowest, w = load(width + at), weight = load(r->weight + at);
    Pack u = lesser(greater(l + w, zero), one); /* what is beyond the strip touches nothing */
    l = lesser(greater(l, zero), one);
    Ideal contact = nearly_ideal(p, l, u);
    Pack off = load(r->k + at) - reading(share, &contact);
    sum[j] += weight * off * off;
    missed[j] += where((weight > zero) & (u <= l), one, zero);
  }
  double misses = joined(missed);
  values[LOG_PRIOR] = log;
  values[MISFIT] = 0.5 * joined(sum) + (misses > 1.0 ? UNTOUCHED * misses : 0.0);
  values[LOWEST] = lowest;
}

static void begin(Regular *r, const Problem *problem, const RegularPlace *place, Int seed) {
  CHECK(problem->n > 0 && problem->n <= REGULAR_STRIPS && problem->signatures == 1 && place->borders > 0);
  r->problem = problem;
  r->place = place;
  r->drawn = (unsigned long long)seed << 40;
  r->blocks = (problem->n + LANES - 1) / LANES;
  for (Int i = 0; i < r->blocks * LANES; i++) {
    Int from = i < problem->n ? i : problem->n - 1;
    r->x[i] = problem->x[from];
    r->k[i] = problem->k[from];
    r->weight[i] = i < problem->n ? problem->weight[from] : 0.0;
  }
}

/* Of outlines by kind (count,), whether over a border (count,), and numbers (count, 8): values (count, 3). */
void tacstrip_regular_values(const Problem *problem, const RegularPlace *place, const Int *kind, const Int *over,
                             const double *numbers, Int count, double *values) {
  Regular r;
  begin(&r, problem, place, 0);
  for (Int i = 0; i < count; i++) weigh(&r, kind[i], over[i], numbers + i * REGULAR_NUMBERS, values + i * VALUES);
}

typedef struct {
  double power, evidence;
  int running;
} Progress;

/* Log weights of particles when the likelihood's power rises by a step; `first`: the prior counts, too. Returns how many
   count, and writes the greatest log weight, and shares of it (count,). */
static double shares(const double *values, Int count, int first, double step, double *most, double *share) {
  double sum = 0.0, squares = 0.0;
  *most = -INFINITE;
  for (Int i = 0; i < count; i++) {
    share[i] = (first ? values[i * VALUES + LOG_PRIOR] : 0.0) - step * values[i * VALUES + MISFIT];
    *most = larger(*most, share[i]);
  }
  for (Int i = 0; i < count; i++) {
    share[i] = exponential(larger(share[i] - *most, -600.0));
    sum += share[i];
    squares += share[i] * share[i];
  }
  return sum * sum / squares;
}

static void copy_particle(const double *z, const double *values, Int from, double *to_z, double *to_values, Int to) {
  for (int i = 0; i < REGULAR_NUMBERS; i++) to_z[to * REGULAR_NUMBERS + i] = z[from * REGULAR_NUMBERS + i];
  for (int i = 0; i < VALUES; i++) to_values[to * VALUES + i] = values[from * VALUES + i];
}

/* Raise the power so that half of the particles to be kept count, and draw these from `count` by their weights. */
static void next_level(Regular *r, Progress *on, const double *z, const double *values, Int count, int first, double *share,
                       Int particles, double *to_z, double *to_values) {
  double step = 1.0 - on->power, wanted = ENOUGH * (double)particles, most, sum = 0.0, passed = 0.0;
  if (shares(values, count, first, step, &most, share) < wanted) {
    double low = natural_log(SMALLEST), high = natural_log(step);
    for (int i = 0; i < HALVINGS; i++) {
      double half = 0.5 * (low + high);
      if (shares(values, count, first, exponential(half), &most, share) >= wanted) low = half;
      else high = half;
    }
    step = exponential(low);
    shares(values, count, first, step, &most, share);
  }
  for (Int i = 0; i < count; i++) sum += share[i];
  on->evidence += most + natural_log(sum / (double)count);
  on->power = on->power + step < 1.0 - 1e-9 ? on->power + step : 1.0;
  double place = next_uniform(&r->drawn);
  for (Int i = 0, from = 0; i < particles; i++) {
    double at = sum * (place + (double)i) / (double)particles;
    while (from < count - 1 && passed + share[from] < at) passed += share[from++];
    copy_particle(z, values, from, to_z, to_values, i);
  }
}

/* Other numbers, by the difference of two other particles, or a few of them by any size. */
static void propose(Regular *r, const double *z, Int particles, Int of, double *moved) {
  const double *own = z + of * REGULAR_NUMBERS;
  int jump = next_uniform(&r->drawn) < 0.75;
  double size = jump ? exponential(natural_log(0.03) + natural_log(2.0 / 0.03) * next_uniform(&r->drawn))
                     : exponential(natural_log(1e-3) + natural_log(0.5 / 1e-3) * next_uniform(&r->drawn));
  const double *a = z + (of + 1 + next_below(&r->drawn, particles - 1)) % particles * REGULAR_NUMBERS;
  const double *b = z + (of + 1 + next_below(&r->drawn, particles - 1)) % particles * REGULAR_NUMBERS;
  for (int i = 0; i < REGULAR_NUMBERS; i++) {
    double v = own[i];
    if (jump) {
      double differ = a[i] - b[i];
      if (i == Z_TURN) differ -= differ > 0.5 ? 1.0 : differ < -0.5 ? -1.0 : 0.0;
      v += size * differ + 1e-5 * next_bell(&r->drawn);
    } else if (next_uniform(&r->drawn) < 0.3) v += size * next_bell(&r->drawn);
    if (i == Z_TURN || i == Z_BORDER) {
      v -= (double)(Int)v;
      if (v < 0.0) v += 1.0;
    } else { /* reflected */
      v = magnitude(v);
      v -= 2.0 * (double)(Int)(0.5 * v);
      v = smaller(v, 2.0 - v);
    }
    moved[i] = smaller(v, 1.0 - 1e-12);
  }
}

static void sweep(Regular *r, Int kind, Int over, double power, double *z, double *values, Int particles) {
  double moved[REGULAR_NUMBERS], found[VALUES];
  for (Int i = 0; i < particles; i++) {
    double *own = values + i * VALUES;
    propose(r, z, particles, i, moved);
    weigh(r, kind, over, moved, found);
    double gain = found[LOG_PRIOR] - own[LOG_PRIOR] - power * (found[MISFIT] - own[MISFIT]);
    if (natural_log(next_uniform(&r->drawn) + 1e-300) < gain) copy_particle(moved, found, 0, z, values, i);
  }
}

void tacstrip_sample_regular(const Problem *problem, const RegularPlace *place, Int particles, double best, Int seed,
                             double *numbers, double *values, double *evidence, Int *done, double *workspace) {
  static const double free[REGULAR_KINDS] = {2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 6.0}; /* numbers that make one */
  Regular r;
  Progress on[2 * REGULAR_KINDS];
  Int drawn = FIRST_DRAWN * particles;
  double *z = workspace, *own = z + drawn * REGULAR_NUMBERS, *share = own + drawn * VALUES;
  begin(&r, problem, place, seed);
  for (int level = 0; level < LEVELS; level++) {
    for (Int c = 0; c < 2 * REGULAR_KINDS; c++) {
      double *to_z = numbers + c * particles * REGULAR_NUMBERS, *to_own = values + c * particles * VALUES;
      if (level == 0) {
        on[c].power = on[c].evidence = 0.0;
        on[c].running = 1;
        for (Int i = 0; i < drawn * REGULAR_NUMBERS; i++) z[i] = next_uniform(&r.drawn);
        for (Int i = 0; i < drawn; i++) weigh(&r, c / 2, c % 2, z + i * REGULAR_NUMBERS, own + i * VALUES);
      } else {
        if (!on[c].running) continue;
        for (Int i = 0; i < particles; i++) copy_particle(to_z, to_own, i, z, own, i);
      }
      next_level(&r, on + c, z, own, level ? particles : drawn, level == 0, share, particles, to_z, to_own);
      if (on[c].evidence < 0.5 * NEVER) { /* none of them can be */
        on[c].running = 0;
        on[c].power = 0.0;
        continue;
      }
      for (int i = 0; i < SWEEPS; i++) sweep(&r, c / 2, c % 2, on[c].power, to_z, to_own, particles);
      if (on[c].power == 1.0) best = larger(best, on[c].evidence);
    }
    int running = 0;
    for (Int c = 0; c < 2 * REGULAR_KINDS; c++) {
      if (!on[c].running) continue;
      double least = INFINITE, left = 1.0 - on[c].power;
      for (Int i = 0; i < particles; i++) least = smaller(least, values[(c * particles + i) * VALUES + MISFIT]);
      /* What is left to gain: misfits are above their least by 1/2 a number at this temperature, here twice that. */
      double hope = on[c].evidence - left * larger(least - free[c / 2] / on[c].power, 0.0);
      on[c].running = left > 0.0 && hope > best - HOPELESS;
      running |= on[c].running;
    }
    if (!running) break;
  }
  for (Int c = 0; c < 2 * REGULAR_KINDS; c++) {
    double sum = 0.0;
    for (Int i = 0; i < particles; i++) sum += values[(c * particles + i) * VALUES + MISFIT];
    evidence[c] = on[c].evidence - (1.0 - on[c].power) * sum / (double)particles;
    done[c] = on[c].power == 1.0 && evidence[c] > best - HOPELESS;
  }
}

/* Many scans in one pass: shapes drawn, footprint, closed form, errors, converter. Each strip is by itself, so packs of any
   width give the same bits. */

#include "philox.h"

#define ON_LINE 1e-9    /* pitches: as near as that to a centre line lies on it */
#define SHAPE_STREAM 64 /* of the first object; errors have stream 0 */
#define JITTER 10       /* the first word of an object that places a corner */
#define COUNT_WORD 31   /* the word of the first object that says how many there are */

enum { NOTHING, POLYGON, CIRCLE, ELLIPSE };

#define ROUNDING 6755399441055744.0 /* 1.5 2^52: what is added to it is rounded to even */
#define rounded(v) (((v) + ROUNDING) - ROUNDING)

static const double LANE[LANES] = {0.0, 1.0, 2.0, 3.0};
#if WIDTH > 1
typedef float Singles __attribute__((vector_size(4 * WIDTH), aligned(4), may_alias));
#endif

/* NaN with the same bits everywhere: infinity less itself has another sign from a processor than from a compiler. */
static inline double not_a_number(void) {
  Word value;
  value.bits = 0x7ff8000000000000LL;
  return value.value;
}

/* Words less 2^31 - 1/2, and as numbers between 0 and 1, never either. */
static inline Pack centred(const Word64 *words) {
#if WIDTH == 1
  Word value;
  value.bits = (Int)(*words | 0x4330000000000000ULL); /* 2^52 and the word */
  return (value.value - 4503601774854144.0) + 0.5;
#else
  return ((Pack)(*(const Anyword *)words | 0x4330000000000000ULL) - 4503601774854144.0) + 0.5;
#endif
}
static inline Pack share_of(const Word64 *words) { return (centred(words) + 2147483648.0) * (1.0 / 4294967296.0); }
static inline double between(double share, const double *range) { return range[0] + (range[1] - range[0]) * share; }
static inline Int whole_between(double share, const Int *range) {
  return range[0] + (Int)(share * (double)(range[1] - range[0] + 1));
}

/* Sines and cosines of angles, by their series about the nearest quarter turn. */
static inline void turned(Pack angle, Pack *sine, Pack *cosine) {
  Pack k = rounded(angle * 0.63661977236758134308);
  Pack r = (angle - k * 1.57079632673412561417) - k * 6.07710050650619224932e-11, z = r * r;
  Pack s = all(-7.647163731819816e-13), c = all(4.779477332387385e-14);
  s = s * z + 1.605904383682161e-10;
  s = s * z - 2.505210838544172e-08;
  s = s * z + 2.7557319223985893e-06;
  s = s * z - 0.0001984126984126984;
  s = s * z + 0.008333333333333333;
  s = s * z - 0.16666666666666666;
  s = r + r * (z * s);
  c = c * z - 1.1470745597729725e-11;
  c = c * z + 2.08767569878681e-09;
  c = c * z - 2.755731922398589e-07;
  c = c * z + 2.48015873015873e-05;
  c = c * z - 0.001388888888888889;
  c = c * z + 0.041666666666666664;
  c = (1.0 - 0.5 * z) + z * (z * c);
  Pack half = 0.5 * k, even = rounded(half), turn = 2.0 * (half - even); /* k = 2 even + turn, a quarter more or less */
  Pack flip = even - 2.0 * rounded(0.5 * even), sign = 1.0 - 2.0 * flip * flip;
  *sine = sign * where(turn != 0.0, turn * c, s);
  *cosine = sign * where(turn != 0.0, -turn * s, c);
}

typedef struct {
  Int kind, corners;
  double radius, aspect, turn, spin, x[2], y[2]; /* at the beginning and the end of the way */
  double angle[SHAPE_CORNERS + LANES];           /* of the corners, seen from the centre of the circle that they lie on */
} Drawn;

static double within(double at, double low, double high) { return low + at * (high - low); }

/* Where centres may be: on the sensor with all of the object. */
static double placed(double at, const double *range, double radius, double extent) {
  return within(at, larger(range[0], radius), smaller(range[1], extent - radius));
}

static Int draw_scene(const BatchSensor *s, const ShapeLaws *laws, const Keys *keys, Int scene, Drawn *drawn) {
  double width = (double)s->strips * s->pitch, at[2][SHAPE_OBJECTS], room = width;
  Int objects = 1; /* the first one says how many there are */
  for (Int o = 0; o < objects; o++) {
    Word64 words[WORDS];
    double share[WORDS + LANES];
    philox(keys, 0, (Word32)(SHAPE_STREAM + o), scene, words);
    for (int i = 0; i < WORDS; i += WIDTH) store(share + i, share_of(words + i));
    if (o == 0) objects = whole_between(share[COUNT_WORD], laws->objects);
    Drawn *d = drawn + o;
    double kind = share[0];
    d->kind = kind < laws->polygons ? POLYGON : kind < laws->circles ? CIRCLE : ELLIPSE;
    d->corners = d->kind == POLYGON ? whole_between(share[1], laws->corners) : 0;
    d->radius = 0.5 * between(share[2], laws->size);
    d->aspect = d->kind == CIRCLE ? 1.0 : between(share[3], laws->aspect);
    d->turn = between(share[4], laws->turn);
    d->spin = laws->spin * (2.0 * share[9] - 1.0);
    double step = d->corners ? 6.28318530717958647693 / (double)d->corners : 0.0;
    for (Int i = 0; i < d->corners; i += WIDTH)
      store(d->angle + i, step * ((all((double)i) + load(LANE)) + laws->irregularity * (load(share + JITTER + i) - 0.5)));
    for (int end = 0; end < 2; end++) {
      at[end][o] = share[5 + 2 * end];
      d->y[end] = placed(share[6 + 2 * end], laws->y, d->radius, s->length);
    }
    room -= 2.0 * d->radius;
  }
  room -= laws->gap * (double)(objects - 1);
  for (int end = 0; end < 2; end++) {
    double before = 0.0;
    for (Int o = 1; laws->apart && o < objects; o++) {
      double v = at[end][o];
      Int i = o;
      for (; i > 0 && at[end][i - 1] > v; i--) at[end][i] = at[end][i - 1];
      at[end][i] = v;
    }
    for (Int o = 0; o < objects; o++) {
      Drawn *d = drawn + o;
      if (laws->apart && objects > 1) {
        d->x[end] = before + room * at[end][o] + d->radius;
        before += 2.0 * d->radius + laws->gap;
      } else d->x[end] = placed(at[end][o], laws->x, d->radius, width);
    }
  }
  return objects;
}

static inline Pack strip_coordinates(Pack x, double pitch) {
  Pack s = x / pitch - 0.5, nearest = rounded(s), off = s - nearest;
  return where((off < ON_LINE) & (off > -ON_LINE), nearest, s);
}

static inline double strip_coordinate(double x, double pitch) {
  double lane[LANES];
  store(lane, strip_coordinates(all(x), pitch));
  return lane[0];
}

/* Of strip coordinates that may be far off the sensor. */
static inline Int first_strip(double at) {
  if (!(at > 0.0)) return 0;
  Int i = (Int)smaller(at, 4e9);
  return (double)i < at ? i + 1 : i;
}
static inline Int last_strip(double at, Int strips) {
  return at < 0.0 ? -1 : at >= (double)strips ? strips - 1 : (Int)at;
}

/* Lower ends of the contact and upper ones less than 0 (strips,), so that both are the least of what is found, with room for
   BLOCKS more; inf where nothing touches, which is so before `first`, a multiple of BLOCKS, and from `end`, another. */
typedef struct {
  double *l, *minus_u;
  Int strips, first, end;
} Touch;

/* Count what lies between two strip coordinates among the touched. */
static void reach(Touch *touch, double low, double high) {
  Int first = first_strip(low), last = last_strip(high, touch->strips);
  if (first > last) return;
  first -= first % BLOCKS;
  last += BLOCKS - last % BLOCKS;
  if (touch->first >= touch->end || first < touch->first) touch->first = first;
  if (last > touch->end) touch->end = last;
}

static inline void lower(double *end, Mask there, Pack y) {
  store(end, lesser(where(there, y, all(INFINITE)), load(end)));
}

/* Lower `ends` of strips to an edge from s0, y0 to s1, y1. */
static inline void touch_edge(double *ends, Int strips, double s0, double y0, double s1, double y1) {
  double left = smaller(s0, s1), right = larger(s0, s1), rise = s0 == s1 ? 0.0 : (y1 - y0) / (s1 - s0);
  double from = s0 <= s1 ? y0 : y1, to = s0 <= s1 ? y1 : y0;
  Int first = first_strip(left), last = last_strip(right, strips);
  for (Int i = first - first % WIDTH; i <= last; i += WIDTH) {
    Pack at = all((double)i) + load(LANE), y = from + (at - left) * rise;
    lower(ends + i, (at >= left) & (at <= right), where(at == right, all(to), y));
  }
}

/* Lines from s, y on that rise by so much a strip. */
typedef struct {
  Int count;
  double s[SHAPE_CORNERS], y[SHAPE_CORNERS], rise[SHAPE_CORNERS];
} Sides;

/* The highest of them at BLOCKS places. */
static inline void highest(const Sides *sides, const Pack *at, Pack *most) {
  for (int j = 0; j < BLOCKS / WIDTH; j++) most[j] = all(-INFINITE);
  for (Int i = 0; i < sides->count; i++)
    for (int j = 0; j < BLOCKS / WIDTH; j++)
      most[j] = greater(sides->y[i] + (at[j] - sides->s[i]) * sides->rise[i], most[j]);
}

/* A convex polygon of `count` corners x, y [mm], counter-clockwise, with room for WIDTH more: it lies above the lines of
   its lower edges, which go to the right, and below those of its upper ones. */
static inline void touch_polygon(const Touch *touch, double pitch, double *x, double *y, Int count) {
  double s[SHAPE_CORNERS + 2 * LANES], rise[SHAPE_CORNERS + LANES], left, right;
  Sides below, above;
  for (Int i = 0; i < count; i += WIDTH) store(s + i, strip_coordinates(load(x + i), pitch));
  s[count] = left = right = s[0];
  y[count] = y[0];
  for (Int i = 0; i < count; i += WIDTH) store(rise + i, (load(y + i + 1) - load(y + i)) / (load(s + i + 1) - load(s + i)));
  below.count = above.count = 0;
  for (Int i = 0; i < count; i++) {
    Int to_right = below.count, to_left = above.count;
    below.s[to_right] = s[i];
    below.y[to_right] = y[i];
    below.rise[to_right] = rise[i];
    above.s[to_left] = s[i + 1];
    above.y[to_left] = -y[i + 1];
    above.rise[to_left] = -rise[i];
    below.count += s[i] < s[i + 1];
    above.count += s[i] > s[i + 1];
    left = smaller(left, s[i]);
    right = larger(right, s[i]);
  }
  Int first = first_strip(left), last = last_strip(right, touch->strips);
  for (Int i = first - first % BLOCKS; i <= last; i += BLOCKS) {
    Pack at[BLOCKS / WIDTH], l[BLOCKS / WIDTH], minus_u[BLOCKS / WIDTH];
    for (int j = 0; j < BLOCKS / WIDTH; j++) at[j] = all((double)(i + j * WIDTH)) + load(LANE);
    highest(&below, at, l);
    highest(&above, at, minus_u);
    for (int j = 0; j < BLOCKS / WIDTH; j++) {
      Mask there = (at[j] >= left) & (at[j] <= right);
      lower(touch->l + i + j * WIDTH, there, l[j]);
      lower(touch->minus_u + i + j * WIDTH, there, lesser(minus_u[j], -l[j])); /* never crossed by rounding */
    }
  }
}

/* An ellipse about x, y with semi-axes a and b, a turned by an angle of sine and cosine. */
static void touch_ellipse(const Touch *touch, double pitch, double x, double y, double a, double b, double sine,
                          double cosine) {
  double xx = a * cosine * (a * cosine) + b * sine * (b * sine), xy = (a - b) * (a + b) * (sine * cosine);
  double rise = xy / xx, half = a * b / xx, wide = sqrt(xx);
  double left = strip_coordinate(x - wide, pitch), right = strip_coordinate(x + wide, pitch);
  Int first = first_strip(left), last = last_strip(right, touch->strips);
  for (Int i = first - first % WIDTH; i <= last; i += WIDTH) {
    Pack at = all((double)i) + load(LANE), d = (at + 0.5) * pitch - x, room = xx - d * d, middle = y + rise * d;
    Pack h = half * root(greater(room, all(0.0)));
    Mask there = (at >= left) & (at <= right);
    lower(touch->l + i, there, middle - h);
    lower(touch->minus_u + i, there, -middle - h);
  }
}

/* Write `count` numbers as they are or as float. */
static inline void put(void *array, Int single, Int at, const double *values, Int count) {
  float *floats = (float *)array + at;
  double *doubles = (double *)array + at;
  if (single)
    for (Int i = 0; i < count; i++) floats[i] = (float)values[i];
  else
    for (Int i = 0; i < count; i++) doubles[i] = values[i];
}

/* Lay the objects of scan number `scan` on the strips, and write its labels to place `row` of the batch. */
static void touch_shapes(const BatchSensor *s, const ShapeLaws *laws, const Drawn *drawn, Int objects, Int scan, Int row,
                         const BatchResult *out, Touch *touch) {
  Int most = laws->objects[1], frame = laws->frames > 1 ? scan % laws->frames : 0;
  double share = frame ? laws->travel * (double)frame / (double)(laws->frames - 1) : 0.0, none = not_a_number();
  for (Int o = 0; o < most; o++) {
    Int place = row * most + o, kind = NOTHING, count = 0;
    double pose[5], x[SHAPE_CORNERS + LANES], y[SHAPE_CORNERS + LANES], corners[2 * SHAPE_CORNERS];
    for (int i = 0; i < 5; i++) pose[i] = none;
    if (o < objects) {
      const Drawn *d = drawn + o;
      double angle = d->turn + share * d->spin, a = d->radius, b = d->radius * d->aspect, lane[2][LANES];
      Pack sine, cosine;
      kind = d->kind;
      count = d->corners;
      pose[0] = within(share, d->x[0], d->x[1]);
      pose[1] = within(share, d->y[0], d->y[1]);
      pose[2] = angle;
      pose[3] = a;
      pose[4] = b;
      turned(all(angle), &sine, &cosine);
      for (Int i = 0; i < count; i += WIDTH) {
        Pack wave, other;
        turned(load(d->angle + i), &wave, &other);
        store(x + i, pose[0] + (a * other * cosine - b * wave * sine));
        store(y + i, pose[1] + (a * other * sine + b * wave * cosine));
      }
      reach(touch, (pose[0] - a) / s->pitch - 0.5 - ON_LINE, (pose[0] + a) / s->pitch - 0.5 + ON_LINE);
      store(lane[0], sine);
      store(lane[1], cosine);
      if (kind == POLYGON) touch_polygon(touch, s->pitch, x, y, count);
      else touch_ellipse(touch, s->pitch, pose[0], pose[1], a, b, lane[0][0], lane[1][0]);
    }
    if (!out->kind) continue;
    for (Int i = 0; i < laws->corners[1]; i++) {
      corners[2 * i] = i < count ? x[i] : none;
      corners[2 * i + 1] = i < count ? y[i] : none;
    }
    out->kind[place] = (signed char)kind;
    out->corners[place] = (signed char)count;
    put(out->pose, s->single, 3 * place, pose, 3);
    put(out->axes, s->single, 2 * place, pose + 3, 2);
    put(out->vertices, s->single, 2 * place * laws->corners[1], corners, 2 * laws->corners[1]);
  }
}

/* Where a scan is worked on, each with room for BLOCKS more than the strips. */
typedef struct {
  double *start, *left; /* (strips,) l and the length of the contact less what its ends do not short, where they do not */
  void *rows[4];        /* readings, l and u, as they are written; null where they are not */
  Word64 *words;
} Desk;

/* Contact resistance: current goes over within some lambda of each end. */
static void soften(const Touch *touch, double lam, const Desk *desk) {
  for (Int i = touch->first; i < touch->end; i++) {
    double w = -touch->minus_u[i] - touch->l[i], t = w >= 0.0 ? lam * hyperbolic_tangent(w / (2.0 * lam)) : 0.0;
    desk->start[i] = touch->l[i] + t;
    desk->left[i] = w - 2.0 * t;
  }
}

static inline void put_pack(void *row, Int single, Int i, Pack v) {
#if WIDTH == 1
  put(row, single, i, &v, 1);
#else
  if (single) *(Singles *)((float *)row + i) = __builtin_convertvector(v, Singles);
  else store((double *)row + i, v);
#endif
}

/* Readings as the converter has them: within 0 to 1, and in steps. Rounded to float, quotients of whole numbers below 2^24 are
   the same by the reciprocal: of an odd `top` none lies near the middle between two floats. */
static inline Pack digitised(Pack k, double top, double over_top) {
  k = lesser(all(1.0), greater(all(0.0), k));
  if (!(top > 0.0)) return k;
  k = rounded(k * top);
  return over_top > 0.0 ? k * over_top : k / top;
}

/* sqrt(-2 log p), the logarithm as natural_log has it. */
static inline Pack normal_radius(Pack p) {
#if WIDTH == 1
  return sqrt(-2.0 * natural_log(p));
#else
  Mask bits = (Mask)p;
  Pack m = (Pack)((bits & 0xfffffffffffffLL) | 0x3ff0000000000000LL);
  Pack k = (Pack)((bits >> 52) | 0x4330000000000000LL) - 4503599627371519.0;
  Mask large = m > 1.4142135623730951;
  m = where(large, m * 0.5, m);
  k = where(large, k + 1.0, k);
  Pack f = (m - 1.0) / (m + 1.0), z = f * f, sum = all(LOG_SERIES[0]);
  for (int i = 1; i < 12; i++) sum = sum * z + LOG_SERIES[i];
  return root(-2.0 * (k * LN2_HIGH + (2.0 * f * sum + k * LN2_LOW)));
#endif
}

/* Write what the touched strips read. The words of strips 8 v to 8 v + 7 are the eighths v D to v D + D - 1 of the scan's stream,
   where a strip takes D words. Of the two words of a normal pair p and q, as shares, it is sqrt(-2 log p) times cosine and sine
   (Box and Muller). What is constant is copied, for what is written might be it. */
static inline void read_as(const BatchSensor *sensor, const BatchErrors *e, const Keys *keys, Int scan, const Touch *touch,
                           const Desk *desk, Int signatures, Int single) {
  const BatchSensor s = *sensor;
  const Touch t = *touch;
  const Desk to = *desk;
  const double sigma = e->sigma, none = not_a_number();
  const double over_top = single && s.top > 0.0 && s.top < 16777216.0 ? 1.0 / s.top : 0.0;
  Int parts = 0, from = t.first / BLOCKS, end = t.end / BLOCKS;
  double scale[2];
  for (int i = 0; i < 2; i++)
    if (e->uniform[i] > 0.0) scale[parts++] = e->uniform[i] * (1.0 / 2147483648.0);
  Int each = parts * signatures + (sigma > 0.0 ? 2 : 0), call = from * each / 4, start = call;
  for (; 4 * call < end * each; call++) philox(keys, (Word32)(BLOCKS * call), 0, scan, to.words + WORDS * (call - start));
  if (s.lam > 0.0) soften(touch, s.lam, desk);
  for (Int i = t.first; i < t.end; i += WIDTH) {
    const Word64 *word = to.words + BLOCKS * (i / BLOCKS * each - 4 * start) + i % BLOCKS;
    const Word64 *pair = word + BLOCKS * parts * signatures;
    Pack l = load(t.l + i), u = -load(t.minus_u + i), from_l = l, left = u - l, radius = l, wave[2];
    Mask there = u >= l;
    if (s.lam > 0.0) {
      from_l = load(to.start + i);
      left = load(to.left + i);
    }
    if (sigma > 0.0) {
      turned(share_of(pair + BLOCKS) * 6.28318530717958647693, wave + 1, wave);
      radius = sigma * normal_radius(share_of(pair));
    }
    Pack below = s.length - s.narrow * left;
    for (Int row = 0; row < signatures; row++) {
      Pack k = (from_l + s.share[row] * left) / below;
      if (parts > 0) k += scale[0] * centred(word + BLOCKS * parts * row);
      if (parts > 1) k += scale[1] * centred(word + BLOCKS * (parts * row + 1));
      if (sigma > 0.0) k += radius * wave[row];
      put_pack(to.rows[row], single, i, where(there, digitised(k, s.top, over_top), all(none)));
    }
    if (!to.rows[2]) continue;
    put_pack(to.rows[2], single, i, where(there, l, all(none)));
    put_pack(to.rows[3], single, i, where(there, u, all(none)));
  }
}

static void read_strips(const BatchSensor *s, const BatchErrors *e, const Keys *keys, Int scan, const Touch *touch,
                        const Desk *desk) {
  if (s->signatures == 2) {
    if (s->single) read_as(s, e, keys, scan, touch, desk, 2, 1);
    else read_as(s, e, keys, scan, touch, desk, 2, 0);
  } else read_as(s, e, keys, scan, touch, desk, 1, s->single);
}

/* The first strip that metal joins to both its ends, -1 where there is none. */
static Int shorted(const Touch *touch, const void *row, Int single) {
  for (Int i = touch->first; i < touch->end; i++) {
    double k = single ? ((const float *)row)[i] : ((const double *)row)[i];
    if (k != k && touch->l[i] <= -touch->minus_u[i]) return i;
  }
  return -1;
}

static void clear(Touch *touch) {
  for (Int i = touch->first; i < touch->end; i += WIDTH) {
    store(touch->l + i, all(INFINITE));
    store(touch->minus_u + i, all(INFINITE));
  }
  touch->first = touch->end = 0;
}

/* Write NaN where nothing touches. */
static inline void blank(void *row, Int single, Int first, Int end) {
  double none = not_a_number();
  if (single)
    for (Int i = first; i < end; i++) ((float *)row)[i] = (float)none;
  else
    for (Int i = first; i < end; i++) ((double *)row)[i] = none;
}

static inline void copy(char *restrict to, const char *restrict from, Int bytes) {
  for (Int i = 0; i < bytes; i++) to[i] = from[i];
}

Int tacstrip_batch(const BatchSensor *s, const ShapeLaws *laws, const BatchErrors *errors, Int first, Int scans,
                   const double *l, const double *u, const BatchResult *out, double *workspace) {
  Int n = s->strips, padded = n + BLOCKS - n % BLOCKS, bad = -1, scene = -1, objects = 0;
  Int bytes = n * (Int)(s->single ? sizeof(float) : sizeof(double)), in_place = scans - BLOCKS / n - 1;
  double *at = workspace;
  Touch touch = {at, at + padded, n, 0, padded};
  Desk desk = {at + 2 * padded, at + 3 * padded, {0}, (Word64 *)(at + 8 * padded)};
  char *to[] = {out->readings[0], s->signatures > 1 ? out->readings[1] : 0, out->l, out->u};
  Drawn drawn[SHAPE_OBJECTS];
  Keys keys;
  CHECK(!laws || (laws->objects[1] <= SHAPE_OBJECTS && laws->corners[1] <= SHAPE_CORNERS && laws->frames >= 1));
  spread_key(errors->key, &keys);
  clear(&touch);
  for (Int row = 0; row < scans; row++) {
    if (laws) {
      Int now = laws->frames > 1 ? (first + row) / laws->frames : first + row;
      if (now != scene) objects = draw_scene(s, laws, &keys, now, drawn);
      scene = now;
      touch_shapes(s, laws, drawn, objects, first + row, row, out, &touch);
    } else {
      reach(&touch, 0.0, (double)n);
      for (Int i = 0; i < n; i++) {
        double low = l[row * n + i], high = u[row * n + i];
        touch.l[i] = low == low ? low : INFINITE;
        touch.minus_u[i] = high == high ? -high : INFINITE;
      }
    }
    /* What is written past the end of a row is written over by the next ones; the last ones are copied. */
    for (Int j = 0; j < 4; j++)
      desk.rows[j] = !to[j] ? 0 : row < in_place ? to[j] + row * bytes : (char *)(workspace + (4 + j) * padded);
    read_strips(s, errors, &keys, first + row, &touch, &desk);
    for (Int j = 0; j < 4; j++) {
      if (!to[j]) continue;
      blank(desk.rows[j], s->single, 0, touch.first);
      blank(desk.rows[j], s->single, touch.end, n);
      if (row >= in_place) copy(to[j] + row * bytes, desk.rows[j], bytes);
    }
    if (bad < 0 && s->narrow == 1.0) {
      Int strip = shorted(&touch, desk.rows[0], s->single);
      if (strip >= 0) bad = row * n + strip;
    }
    clear(&touch);
  }
  return bad;
}

void tacstrip_footprint(const double *points, const Int *ring, const Int *begin, Int contacts, double pitch, Int strips,
                        double *l, double *u) {
  double none = not_a_number();
  for (Int c = 0; c < contacts; c++, l += strips, u += strips) {
    for (Int i = 0; i < strips; i++) l[i] = INFINITE;
    for (Int i = 0; i < strips; i++) u[i] = INFINITE; /* less than 0 until the end */
    for (Int p = begin[c]; p + 1 < begin[c + 1]; p++) {
      if (ring[p] != ring[p + 1]) continue;
      double s0 = strip_coordinate(points[2 * p], pitch), s1 = strip_coordinate(points[2 * p + 2], pitch);
      double y0 = points[2 * p + 1], y1 = points[2 * p + 3];
      touch_edge(l, strips, s0, y0, s1, y1);
      touch_edge(u, strips, s0, -y0, s1, -y1);
    }
    for (Int i = 0; i < strips; i++) {
      int there = l[i] <= -u[i];
      l[i] = there ? l[i] : none;
      u[i] = there ? -u[i] : none;
    }
  }
}

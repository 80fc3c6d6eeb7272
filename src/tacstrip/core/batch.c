/* Many scans in one pass: shapes drawn, footprint, closed form, errors, converter. Loops over strips are plain, for each
   strip is by itself: a compiler makes lanes of them, and the bits stay. */

#include "internal.h"
#include "philox.h"

#define ON_LINE 1e-9    /* pitches: as near as that to a centre line lies on it */
#define SHAPE_STREAM 64 /* of the first object; errors have stream 0 */
#define JITTER 10       /* the first word of an object that places a corner */
#define COUNT_WORD 31   /* the word of the first object that says how many there are */

enum { NOTHING, POLYGON, CIRCLE, ELLIPSE };

#define ROUNDING 6755399441055744.0 /* 1.5 2^52: what is added to it is rounded to even */
static inline double rounded(double v) { return (v + ROUNDING) - ROUNDING; }

/* NaN with the same bits everywhere: infinity less itself has another sign from a processor than from a compiler. */
static inline double not_a_number(void) {
  Word value;
  value.bits = 0x7ff8000000000000LL;
  return value.value;
}

/* A word less 2^31 - 1/2, and as a number between 0 and 1, never either. */
static inline double centred(Word64 word) {
  Word value;
  value.bits = (Int)(word | 0x4330000000000000ULL); /* 2^52 and the word */
  return (value.value - 4503601774854144.0) + 0.5;
}
static inline double share_of(Word64 word) { return (centred(word) + 2147483648.0) * (1.0 / 4294967296.0); }
static inline double between(Word64 word, const double *range) {
  return range[0] + (range[1] - range[0]) * share_of(word);
}
static inline Int whole_between(Word64 word, const Int *range) {
  return range[0] + (Int)(share_of(word) * (double)(range[1] - range[0] + 1));
}

/* Sines and cosines of `count` angles, by their series about the nearest quarter turn. */
static void turned(const double *angle, Int count, double *sines, double *cosines) {
  for (Int i = 0; i < count; i++) {
    double k = rounded(angle[i] * 0.63661977236758134308);
    double r = (angle[i] - k * 1.57079632673412561417) - k * 6.07710050650619224932e-11, z = r * r;
    double s = -7.647163731819816e-13, c = 4.779477332387385e-14;
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
    double half = 0.5 * k, odd = half - rounded(half), even = rounded(half); /* k = 2 even + 2 odd */
    double flip = even - 2.0 * rounded(0.5 * even), sign = 1.0 - 2.0 * flip * flip;
    int swap = odd != 0.0;
    double turn = 2.0 * odd; /* a quarter more, or less */
    sines[i] = sign * (swap ? turn * c : s);
    cosines[i] = sign * (swap ? -turn * s : c);
  }
}

typedef struct {
  Int kind, corners;
  double radius, aspect, turn, spin, x[2], y[2]; /* at the beginning and the end of the way */
  double angle[SHAPE_CORNERS];                   /* of the corners, seen from the centre of the circle that they lie on */
} Drawn;

static double within(double at, double low, double high) { return low + at * (high - low); }

/* Where centres may be: on the sensor with all of the object. */
static double placed(double at, const double *range, double radius, double extent) {
  return within(at, larger(range[0], radius), smaller(range[1], extent - radius));
}

static Int draw_scene(const BatchSensor *s, const ShapeLaws *laws, const Word32 *key, Int scene, Drawn *drawn) {
  double width = (double)s->strips * s->pitch, at[2][SHAPE_OBJECTS], room = width;
  Int objects = 1; /* the first one says how many there are */
  for (Int o = 0; o < objects; o++) {
    Word64 words[WORDS];
    philox(key, 0, (Word32)(SHAPE_STREAM + o), scene, words);
    if (o == 0) objects = whole_between(words[COUNT_WORD], laws->objects);
    Drawn *d = drawn + o;
    double kind = share_of(words[0]), step;
    d->kind = kind < laws->polygons ? POLYGON : kind < laws->circles ? CIRCLE : ELLIPSE;
    d->corners = d->kind == POLYGON ? whole_between(words[1], laws->corners) : 0;
    d->radius = 0.5 * between(words[2], laws->size);
    d->aspect = d->kind == CIRCLE ? 1.0 : between(words[3], laws->aspect);
    d->turn = between(words[4], laws->turn);
    d->spin = laws->spin * (2.0 * share_of(words[9]) - 1.0);
    step = d->corners ? 6.28318530717958647693 / (double)d->corners : 0.0;
    for (Int i = 0; i < d->corners; i++)
      d->angle[i] = step * ((double)i + laws->irregularity * (share_of(words[JITTER + i]) - 0.5));
    for (int end = 0; end < 2; end++) {
      at[end][o] = share_of(words[5 + 2 * end]);
      d->y[end] = placed(share_of(words[6 + 2 * end]), laws->y, d->radius, s->length);
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

static double strip_coordinate(double x, double pitch) {
  double s = x / pitch - 0.5, nearest = rounded(s);
  return magnitude(s - nearest) < ON_LINE ? nearest : s;
}

/* Of strip coordinates that may be far off the sensor. */
static Int first_strip(double at) {
  if (!(at > 0.0)) return 0;
  Int i = (Int)smaller(at, 4e9);
  return (double)i < at ? i + 1 : i;
}
static Int last_strip(double at, Int strips) {
  return at < 0.0 ? -1 : at >= (double)strips ? strips - 1 : (Int)at;
}

/* l and u are inf and -inf where nothing touches, and set from `first`, a multiple of BLOCKS, to before `end`, another. */
typedef struct {
  double *l, *u; /* (strips,) and room for BLOCKS more */
  Int first, end;
} Touch;

/* Make room for what lies between two strip coordinates. */
static void reach(Touch *touch, Int strips, double low, double high) {
  Int first = first_strip(low), last = last_strip(high, strips);
  if (first > last) return;
  first -= first % BLOCKS;
  last += BLOCKS - last % BLOCKS;
  if (touch->first >= touch->end) touch->first = touch->end = first;
  for (Int i = first; i < touch->first; i++) touch->l[i] = INFINITE;
  for (Int i = first; i < touch->first; i++) touch->u[i] = -INFINITE;
  if (first < touch->first) touch->first = first;
  for (Int i = touch->end; i < last; i++) touch->l[i] = INFINITE;
  for (Int i = touch->end; i < last; i++) touch->u[i] = -INFINITE;
  if (last > touch->end) touch->end = last;
}

static void touch_edge(Touch *touch, Int strips, double s0, double y0, double s1, double y1) {
  Int first = first_strip(smaller(s0, s1)), last = last_strip(larger(s0, s1), strips);
  double run = s1 == s0 ? 1.0 : s1 - s0, *l = touch->l, *u = touch->u;
  for (int i = (int)first; i <= (int)last; i++) {
    double t = ((double)i - s0) / run, y = (1.0 - t) * y0 + t * y1;
    l[i] = y < l[i] ? y : l[i];
    u[i] = y > u[i] ? y : u[i];
  }
}

/* An ellipse about x, y with semi-axes a and b, a turned by an angle of sine and cosine. */
static void touch_ellipse(Touch *touch, const BatchSensor *s, double x, double y, double a, double b, double sine,
                          double cosine) {
  double xx = a * cosine * (a * cosine) + b * sine * (b * sine), xy = (a - b) * (a + b) * (sine * cosine);
  double rise = xy / xx, half = a * b / xx, wide = sqrt(xx), *l = touch->l, *u = touch->u;
  Int first = first_strip(strip_coordinate(x - wide, s->pitch)), last = last_strip(strip_coordinate(x + wide, s->pitch), s->strips);
  for (int i = (int)first; i <= (int)last; i++) {
    double d = ((double)i + 0.5) * s->pitch - x, left = xx - d * d, middle = y + rise * d;
    double h = half * sqrt(left > 0.0 ? left : 0.0), low = middle - h, high = middle + h;
    l[i] = low < l[i] ? low : l[i];
    u[i] = high > u[i] ? high : u[i];
  }
}

static void put(void *array, Int single, Int at, double value) {
  if (single) ((float *)array)[at] = (float)value;
  else ((double *)array)[at] = value;
}

/* Draw scan number `scan`, lay its objects on the strips, and write its labels to place `row` of the batch. */
static void touch_shapes(const BatchSensor *s, const ShapeLaws *laws, const Drawn *drawn, Int objects, Int scan, Int row,
                         const BatchResult *out, Touch *touch) {
  Int most = laws->objects[1], corners = laws->corners[1], frame = laws->frames > 1 ? scan % laws->frames : 0;
  double share = frame ? laws->travel * (double)frame / (double)(laws->frames - 1) : 0.0;
  for (Int o = 0; o < most; o++) {
    Int place = row * most + o;
    const Drawn *d = drawn + o;
    int there = o < objects;
    double x = 0.0, y = 0.0, angle = 0.0, a = 0.0, b = 0.0, corner[SHAPE_CORNERS][2];
    Int count = there ? d->corners : 0;
    if (there) {
      double sines[SHAPE_CORNERS + 1], cosines[SHAPE_CORNERS + 1], all[SHAPE_CORNERS + 1];
      x = within(share, d->x[0], d->x[1]);
      y = within(share, d->y[0], d->y[1]);
      angle = d->turn + share * d->spin;
      a = d->radius;
      b = d->radius * d->aspect;
      for (Int i = 0; i < count; i++) all[i] = d->angle[i];
      all[count] = angle;
      turned(all, count + 1, sines, cosines);
      double sine = sines[count], cosine = cosines[count];
      /* One loop each: of both together gcc 12 makes a fused multiply-add, contraction off or not. */
      for (Int i = 0; i < count; i++) corner[i][0] = x + (a * cosines[i] * cosine - b * sines[i] * sine);
      for (Int i = 0; i < count; i++) corner[i][1] = y + (a * cosines[i] * sine + b * sines[i] * cosine);
      reach(touch, s->strips, (x - a) / s->pitch - 0.5 - ON_LINE, (x + a) / s->pitch - 0.5 + ON_LINE);
      if (d->kind == POLYGON) {
        double at[SHAPE_CORNERS];
        for (Int i = 0; i < count; i++) at[i] = strip_coordinate(corner[i][0], s->pitch);
        for (Int i = 0; i < count; i++) {
          Int next = i + 1 < count ? i + 1 : 0;
          touch_edge(touch, s->strips, at[i], corner[i][1], at[next], corner[next][1]);
        }
      } else touch_ellipse(touch, s, x, y, a, b, sine, cosine);
    }
    if (!out->kind) continue;
    double none = not_a_number(), pose[5] = {x, y, angle, a, b};
    out->kind[place] = (signed char)(there ? d->kind : NOTHING);
    out->corners[place] = (signed char)count;
    for (int i = 0; i < 3; i++) put(out->pose, s->single, 3 * place + i, there ? pose[i] : none);
    for (int i = 0; i < 2; i++) put(out->axes, s->single, 2 * place + i, there ? pose[3 + i] : none);
    for (Int i = 0; i < corners; i++)
      for (int j = 0; j < 2; j++)
        put(out->vertices, s->single, 2 * (place * corners + i) + j, i < count ? corner[i][j] : none);
  }
}

/* Normal numbers, two of two words each (Box and Muller): sqrt(-2 log p) times cosine and sine; p and q, places of `count`
   words as shares, are written over. */
static void normal_pairs(double *p, double *q, Int count, double *sines, double *cosines) {
  for (Int i = 0; i < count; i++) p[i] = sqrt(-2.0 * natural_log(p[i]));
  for (Int i = 0; i < count; i++) q[i] *= 6.28318530717958647693;
  turned(q, count, sines, cosines);
}

/* Add errors to the readings k (signatures, padded): the words of strips 8 v to 8 v + 7 are the eighths v D to v D + D - 1
   of the scan's stream, where a strip takes D words. */
static void add_errors(const BatchSensor *s, const BatchErrors *e, Int scan, const Touch *touch, double *k, Int padded,
                       double *normal, Word64 *words) {
  Int parts = (e->uniform[0] > 0.0) + (e->uniform[1] > 0.0), each = parts * s->signatures + (e->sigma > 0.0 ? 2 : 0);
  Int from = touch->first / BLOCKS, to = touch->end / BLOCKS, call = from * each / 4, start = call;
  for (; 4 * call < to * each; call++)
    philox(e->key, (Word32)(BLOCKS * call), 0, scan, words + WORDS * (call - start));
  for (Int v = from; v < to; v++) {
    const Word64 *word = words + BLOCKS * (v * each - 4 * start);
    for (Int row = 0; row < s->signatures; row++) {
      double *at = k + row * padded + BLOCKS * v;
      for (int part = 0; part < 2; part++) {
        double scale = e->uniform[part] * (1.0 / 2147483648.0);
        if (!(scale > 0.0)) continue;
        for (int j = 0; j < BLOCKS; j++) at[j] += scale * centred(word[j]);
        word += BLOCKS;
      }
    }
    if (!(e->sigma > 0.0)) continue;
    for (int j = 0; j < BLOCKS; j++) normal[BLOCKS * v + j] = share_of(word[j]);
    for (int j = 0; j < BLOCKS; j++) normal[padded + BLOCKS * v + j] = share_of(word[BLOCKS + j]);
  }
  if (!(e->sigma > 0.0)) return;
  double *radius = normal + touch->first, *sines = radius + 2 * padded, *cosines = sines + padded;
  Int count = touch->end - touch->first;
  normal_pairs(radius, radius + padded, count, sines, cosines);
  for (Int row = 0; row < s->signatures; row++) {
    double *at = k + row * padded + touch->first, *wave = row ? sines : cosines;
    for (Int i = 0; i < count; i++) at[i] += e->sigma * (radius[i] * wave[i]);
  }
}

/* The closed form, as sensor/closed_form.py has it; NaN where nothing touches. */
static void closed_form_row(const BatchSensor *s, const Touch *touch, double share, double *k) {
  const double *l = touch->l, *u = touch->u;
  double length = s->length, narrow = s->narrow, lam = s->lam, none = not_a_number();
  Int first = touch->first, end = touch->end;
  if (lam > 0.0) {
    for (Int i = first; i < end; i++) {
      double w = u[i] - l[i], t = w >= 0.0 ? lam * hyperbolic_tangent(w / (2.0 * lam)) : 0.0, left = w - 2.0 * t;
      double value = (l[i] + t + share * left) / (length - narrow * left);
      value = value < 0.0 ? 0.0 : value;
      value = value > 1.0 ? 1.0 : value;
      k[i] = w >= 0.0 ? value : none;
    }
    return;
  }
  for (Int i = first; i < end; i++) {
    double w = u[i] - l[i], value = (l[i] + share * w) / (length - narrow * w);
    value = value < 0.0 ? 0.0 : value;
    value = value > 1.0 ? 1.0 : value;
    k[i] = w >= 0.0 ? value : none;
  }
}

/* As the converter has them: within 0 to 1, and in steps. */
static void digitise(const BatchSensor *s, Int first, Int end, double *k) {
  double top = s->top;
  for (Int i = first; i < end; i++) {
    double v = k[i];
    v = v < 0.0 ? 0.0 : v;
    v = v > 1.0 ? 1.0 : v;
    k[i] = v;
  }
  for (Int i = first; top > 0.0 && i < end; i++) k[i] = rounded(k[i] * top) / top;
}

/* One row of a result, NaN but where something touches. */
static void write_row(void *array, Int single, Int row, Int strips, const Touch *touch, const double *values) {
  double none = not_a_number();
  Int first = touch->first < strips ? touch->first : strips, end = touch->end < strips ? touch->end : strips;
  if (single) {
    float *to = (float *)array + row * strips, empty = (float)none;
    for (Int i = 0; i < first; i++) to[i] = empty;
    for (Int i = first; i < end; i++) to[i] = (float)values[i];
    for (Int i = end; i < strips; i++) to[i] = empty;
    return;
  }
  double *to = (double *)array + row * strips;
  for (Int i = 0; i < first; i++) to[i] = none;
  for (Int i = first; i < end; i++) to[i] = values[i];
  for (Int i = end; i < strips; i++) to[i] = none;
}

/* The first strip that metal joins to both its ends, -1 where there is none. */
static Int shorted(const Touch *touch, const double *k) {
  for (Int i = touch->first; i < touch->end; i++)
    if (k[i] != k[i] && touch->l[i] <= touch->u[i]) return i;
  return -1;
}

/* NaN for the ends of strips that nothing touches. */
static void only_touched(Touch *touch) {
  double none = not_a_number(), *l = touch->l, *u = touch->u;
  for (Int i = touch->first; i < touch->end; i++) {
    double low = l[i], high = u[i];
    int there = low <= high;
    l[i] = there ? low : none;
    u[i] = there ? high : none;
  }
}

Int tacstrip_batch(const BatchSensor *s, const ShapeLaws *laws, const BatchErrors *errors, Int first, Int scans,
                   const double *l, const double *u, const BatchResult *out, double *workspace) {
  Int n = s->strips, padded = n + BLOCKS, bad = -1, scene = -1, objects = 0;
  Touch touch = {workspace, workspace + padded, 0, 0};
  double *k = workspace + 2 * padded;
  Word64 *words = (Word64 *)(workspace + 8 * padded);
  Drawn drawn[SHAPE_OBJECTS];
  CHECK(!laws || (laws->objects[1] <= SHAPE_OBJECTS && laws->corners[1] <= SHAPE_CORNERS && laws->frames >= 1));
  for (Int row = 0; row < scans; row++) {
    touch.first = touch.end = 0;
    if (laws) {
      Int now = laws->frames > 1 ? (first + row) / laws->frames : first + row;
      if (now != scene) objects = draw_scene(s, laws, errors->key, now, drawn);
      scene = now;
      touch_shapes(s, laws, drawn, objects, first + row, row, out, &touch);
    } else {
      reach(&touch, n, 0.0, (double)n);
      for (Int i = 0; i < n; i++) {
        double low = l[row * n + i], high = u[row * n + i];
        touch.l[i] = low == low ? low : INFINITE;
        touch.u[i] = high == high ? high : -INFINITE;
      }
    }
    for (Int j = 0; j < s->signatures; j++) closed_form_row(s, &touch, s->share[j], k + j * padded);
    if (bad < 0 && s->narrow == 1.0) {
      Int strip = shorted(&touch, k);
      if (strip >= 0) bad = row * n + strip;
    }
    add_errors(s, errors, first + row, &touch, k, padded, workspace + 4 * padded, words);
    for (Int j = 0; j < s->signatures; j++) {
      digitise(s, touch.first, touch.end, k + j * padded);
      write_row(out->readings[j], s->single, row, n, &touch, k + j * padded);
    }
    if (!out->l) continue;
    only_touched(&touch);
    write_row(out->l, s->single, row, n, &touch, touch.l);
    write_row(out->u, s->single, row, n, &touch, touch.u);
  }
  return bad;
}

void tacstrip_footprint(const double *edges, const Int *begin, Int contacts, double pitch, Int strips, double *l,
                        double *u) {
  for (Int c = 0; c < contacts; c++) {
    Touch touch = {l + c * strips, u + c * strips, 0, strips};
    for (Int i = 0; i < strips; i++) touch.l[i] = INFINITE;
    for (Int i = 0; i < strips; i++) touch.u[i] = -INFINITE;
    for (const double *e = edges + 4 * begin[c]; e < edges + 4 * begin[c + 1]; e += 4)
      touch_edge(&touch, strips, strip_coordinate(e[0], pitch), e[1], strip_coordinate(e[2], pitch), e[3]);
    only_touched(&touch);
  }
}

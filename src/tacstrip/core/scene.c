/* Several polygons under crossed layers of strips: least squares of all their corners together.

   A strip reads the hull of all that touches it, so each end of its contact is on one edge of one polygon. Which strips are
   touched is certain: a polygon that ends short of a touched strip, or covers a silent one, is charged for the distance. */

#include "internal.h"

#define TOUCH_END 0.05     /* of the pitch: deviation of where touch begins and ends */
#define RIDGE 1e-4         /* 1/mm^2, of corners that no reading determines: they stay where they are */
#define SLACKENED 6.0      /* how much less damping after a step that helps */
#define TIGHTENED 8.0      /* and how much more after one that does not */
#define SLACKEST 1e-7      /* damping at least */
#define STUCK 1e6          /* damping that ends a descent */
#define GAINS 1e-3         /* a step that gains less than so much ends it, */
#define GAINS_SHARE 1e-5   /* or less than this share of the cost */
#define NOWHERE 1e-12

typedef struct {
  const CrossedLayer *layers;
  Int count, polygons, corners;
  const Int *sizes;
  double soft, reach;
} SceneFit;

typedef struct {
  double *matrix, *gradient;
} Sums;

/* An end of the contact on a strip: the corners of its edge, and dy by x and y of both in the whole. */
typedef struct {
  Int at[4];
  double y, by[4];
} HullEnd;

static void add(const Sums *s, Int size, double weight, const HullEnd *a, const HullEnd *b) {
  for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) s->matrix[a->at[i] * size + b->at[j]] += weight * a->by[i] * b->by[j];
}

static double lost(const SceneFit *f, double residual, double *weight) {
  double square = residual * residual;
  if (!(f->reach > 0.0)) return square;
  double scale = f->reach * f->reach, more = 1.0 + square / scale;
  *weight /= more;
  return scale * natural_log(more);
}

static void end_of(const CrossedLayer *s, const double *own, Int from, Int to, double x, HullEnd *end) {
  double run = own[2 * to] - own[2 * from], share = (x - own[2 * from]) / run;
  double slope = (own[2 * to + 1] - own[2 * from + 1]) / run;
  double across = s->rotation[1] - slope * s->rotation[0], along = s->rotation[3] - slope * s->rotation[2];
  Int at[4] = {2 * from, 2 * from + 1, 2 * to, 2 * to + 1};
  for (int i = 0; i < 4; i++) end->at[i] = at[i];
  end->by[0] = (1.0 - share) * across;
  end->by[1] = (1.0 - share) * along;
  end->by[2] = share * across;
  end->by[3] = share * along;
}

/* The readings of a strip whose contact has these ends. */
static double read_strip(const SceneFit *f, const CrossedLayer *s, Int strip, HullEnd *low, HullEnd *high, const Sums *sums) {
  Int size = 2 * f->corners;
  double l = clip(low->y / s->length, 0.0, 1.0), u = clip(high->y / s->length, 0.0, 1.0), w = u - l, cost = 0.0;
  double held_l = low->y >= 0.0 && low->y <= s->length, held_u = high->y >= 0.0 && high->y <= s->length;
  double h = s->lam > 0.0 ? hyperbolic_tangent(w / (2.0 * s->lam)) : 0.0, t = s->lam * h;
  double mix = s->lam > 0.0 ? 0.5 * (1.0 - h * h) : 0.0, keep = 1.0 - mix;
  double over = 1.0 / larger(1.0 - s->narrow * (w - 2.0 * t), LEAST_D), ll = 0.0, lu = 0.0, uu = 0.0, lr = 0.0, ur = 0.0;
  for (Int row = 0; row < s->signatures; row++) {
    double weight = s->weight[row * s->n + strip], share = s->share[row], soft = f->soft / s->length;
    if (!(weight > 0.0)) continue;
    weight /= 1.0 + weight * soft * soft;
    double model = ((1.0 - share) * (l + t) + share * (u - t)) * over;
    double by_low = (1.0 - share - s->narrow * model) * over, by_high = (share + s->narrow * model) * over;
    double by_l = held_l * (by_low * keep + by_high * mix) / s->length;
    double by_u = held_u * (by_high * keep + by_low * mix) / s->length;
    double residual = s->k[row * s->n + strip] - model;
    cost += lost(f, residual * sqrt(weight), &weight);
    ll += weight * by_l * by_l;
    lu += weight * by_l * by_u;
    uu += weight * by_u * by_u;
    lr += weight * by_l * residual;
    ur += weight * by_u * residual;
  }
  add(sums, size, ll, low, low);
  add(sums, size, lu, low, high);
  add(sums, size, lu, high, low);
  add(sums, size, uu, high, high);
  for (int i = 0; i < 4; i++) sums->gradient[low->at[i]] += lr * low->by[i];
  for (int i = 0; i < 4; i++) sums->gradient[high->at[i]] += ur * high->by[i];
  return cost;
}

/* A corner that has to go so far across the strips, up or down. */
static double push(const SceneFit *f, const CrossedLayer *s, Int corner, double away, double sign, const Sums *sums) {
  Int size = 2 * f->corners, at = 2 * corner;
  double deviation = TOUCH_END * s->pitch + f->soft, weight = 1.0 / (deviation * deviation);
  double cost = lost(f, away / deviation, &weight), by[2] = {sign * s->rotation[0], sign * s->rotation[2]};
  for (int i = 0; i < 2; i++) {
    for (int j = 0; j < 2; j++) sums->matrix[(at + i) * size + at + j] += weight * by[i] * by[j];
    sums->gradient[at + i] += weight * away * by[i];
  }
  return cost;
}

static double layer_equations(const SceneFit *f, const CrossedLayer *s, const double *corners, double *own, const Sums *sums) {
  double cost = 0.0;
  for (Int i = 0; i < f->corners; i++) {
    double dx = corners[2 * i] - s->origin[0], dy = corners[2 * i + 1] - s->origin[1];
    own[2 * i] = dx * s->rotation[0] + dy * s->rotation[2];
    own[2 * i + 1] = dx * s->rotation[1] + dy * s->rotation[3];
  }
  for (Int strip = 0; strip < s->n; strip++) {
    double x = s->x[strip], low = INFINITE, high = -INFINITE, short_by = INFINITE, short_sign = 0.0;
    Int low_edge[2] = {0, 0}, high_edge[2] = {0, 0}, short_corner = -1, first = 0;
    for (Int p = 0; p < f->polygons; p++) {
      Int left = first, right = first, last = first + f->sizes[p] - 1;
      for (Int i = first; i <= last; i++) {
        Int j = i < last ? i + 1 : first;
        double a = own[2 * i], b = own[2 * j];
        if (a < own[2 * left]) left = i;
        if (a > own[2 * right]) right = i;
        if (!((a <= x && x < b) || (b <= x && x < a))) continue;
        double y = own[2 * i + 1] + (own[2 * j + 1] - own[2 * i + 1]) * ((x - a) / (b - a));
        if (y < low) { low = y; low_edge[0] = i; low_edge[1] = j; }
        if (y > high) { high = y; high_edge[0] = i; high_edge[1] = j; }
      }
      double from_left = x - own[2 * left], from_right = own[2 * right] - x;
      if (s->touched[strip]) {
        if (-from_right >= 0.0 && -from_right < short_by) { short_by = -from_right; short_corner = right; short_sign = 1.0; }
        if (-from_left >= 0.0 && -from_left < short_by) { short_by = -from_left; short_corner = left; short_sign = -1.0; }
      } else if (from_left >= 0.0 && from_right >= 0.0) {
        int at_left = from_left < from_right;
        cost += push(f, s, at_left ? left : right, at_left ? from_left : from_right, at_left ? 1.0 : -1.0, sums);
      }
      first = last + 1;
    }
    if (!s->touched[strip]) continue;
    if (low <= high) {
      HullEnd ends[2];
      end_of(s, own, low_edge[0], low_edge[1], x, &ends[0]);
      end_of(s, own, high_edge[0], high_edge[1], x, &ends[1]);
      ends[0].y = low;
      ends[1].y = high;
      cost += read_strip(f, s, strip, &ends[0], &ends[1], sums);
    } else if (short_corner >= 0) cost += push(f, s, short_corner, short_by, short_sign, sums);
  }
  return cost;
}

static double equations(const SceneFit *f, const double *corners, double *own, const Sums *sums) {
  Int size = 2 * f->corners;
  double cost = 0.0;
  for (Int i = 0; i < size * size; i++) sums->matrix[i] = 0.0;
  for (Int i = 0; i < size; i++) sums->gradient[i] = 0.0;
  for (Int i = 0; i < f->count; i++) cost += layer_equations(f, f->layers + i, corners, own, sums);
  return cost;
}

/* Solve the damped equations; 0 where they are not positive definite. */
static int damped_step(Int size, const Sums *s, double damping, double *work, double *step) {
  for (Int i = 0; i < size * size; i++) work[i] = s->matrix[i];
  for (Int i = 0; i < size; i++) {
    work[i * size + i] += damping * s->matrix[i * size + i] + RIDGE;
    step[i] = s->gradient[i];
  }
  for (Int i = 0; i < size; i++) { /* U'U, row by row */
    double *row = work + i * size;
    if (!(row[i] > 0.0)) return 0;
    double root = sqrt(row[i]);
    for (Int j = i; j < size; j++) row[j] /= root;
    for (Int k = i + 1; k < size; k++) {
      double factor = row[k];
      if (factor == 0.0) continue;
      for (Int j = k; j < size; j++) work[k * size + j] -= factor * row[j];
    }
  }
  for (Int i = 0; i < size; i++) {
    step[i] /= work[i * size + i];
    for (Int j = i + 1; j < size; j++) step[j] -= work[i * size + j] * step[i];
  }
  for (Int i = size - 1; i >= 0; i--) {
    for (Int j = i + 1; j < size; j++) step[i] -= work[i * size + j] * step[j];
    step[i] /= work[i * size + i];
  }
  return 1;
}

double tacstrip_refine_scene(const CrossedLayer *layers, Int count, const Int *sizes, Int polygons, double soft, double reach,
                             Int steps, double damping, double longest, double *corners, double *matrix, double *gradient,
                             double *workspace) {
  SceneFit f = {layers, count, polygons, 0, sizes, soft, reach};
  for (Int i = 0; i < polygons; i++) f.corners += sizes[i];
  Int size = 2 * f.corners, square = size * size;
  double *own = workspace, *step = own + size, *trial = step + size, *work = trial + size;
  Sums now = {matrix, gradient}, other = {work + square, work + 2 * square};
  double cost = equations(&f, corners, own, &now);
  for (Int i = 0; i < steps && damping <= STUCK; i++) {
    double new_cost = INFINITE, most = NOWHERE;
    if (damped_step(size, &now, damping, work, step)) {
      for (Int j = 0; j < size; j++) most = larger(most, magnitude(step[j]));
      double share = smaller(1.0, longest / most);
      for (Int j = 0; j < size; j++) trial[j] = corners[j] + share * step[j];
      new_cost = equations(&f, trial, own, &other);
    }
    if (new_cost < cost) {
      int done = cost - new_cost < larger(GAINS, GAINS_SHARE * cost);
      for (Int j = 0; j < size; j++) corners[j] = trial[j];
      for (Int j = 0; j < size; j++) now.gradient[j] = other.gradient[j];
      for (Int j = 0; j < square; j++) now.matrix[j] = other.matrix[j];
      cost = new_cost;
      damping = larger(damping / SLACKENED, SLACKEST);
      if (done) break;
    } else damping *= TIGHTENED;
  }
  return cost;
}

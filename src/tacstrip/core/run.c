/* One run of strips from readings to a fit: its noise, its outliers, its polygons, and an ellipse as their rival. */

#include "internal.h"

#define BEYOND 0.5 /* a reading that noise may drive so far beyond 0 or 1 is still one */
#define ROUNDS 3   /* of leaving outliers out, and of estimating sigma anew */
#define SURER 0.3  /* so much less noise than first thought is worth another fit */
#define NEAR 6.0   /* spreads from the polygon that was made without it: no outlier */
#define BARELY 0.5 /* of the spread with all readings: few residuals can be small by chance */
#define ALONE 8    /* suspects at most that are left out one by one */
#define SPARE 1    /* readings beyond the numbers fitted, without which nothing can be tested */
#define LEAST_SCALE 1e-3 /* of sigma: a spread of residuals */
#define NORMAL_MAD 1.4826 /* standard deviation of normal errors over their median absolute deviation */

typedef unsigned char Flag;

/* What is fitted: `raw` has the readings as measured, `now` those of a fit, with weights. */
typedef struct {
  const Problem *raw;
  Problem now;
  Int all, known, max_vertices, n_vertices;
  double *k, *weight, *residuals, *scratch, *search;
  Flag *there;
} Fitter;

/* The median of values (n,), which are moved about. */
static double median(double *values, Int n) {
  double high = threshold(values, n, (n + 1) / 2);
  return n % 2 ? high : 0.5 * (high + threshold(values, n, n / 2 + 1));
}

/* A first idea of a signature's sigma: from second differences of readings, robustly. */
static double reading_noise(const double *k, const Flag *there, Int n, double *scratch) {
  double last[2] = {0.0, 0.0}, *second = scratch, *moved = scratch + n;
  Int seen = 0, count = 0;
  for (Int i = 0; i < n; i++) {
    if (!there[i]) continue;
    if (seen++ >= 2) second[count++] = (k[i] - last[1]) - (last[1] - last[0]);
    last[0] = last[1];
    last[1] = k[i];
  }
  if (count == 0) return 0.0;
  for (Int i = 0; i < count; i++) moved[i] = second[i];
  double middle = median(moved, count);
  for (Int i = 0; i < count; i++) moved[i] = magnitude(second[i] - middle);
  return NORMAL_MAD * median(moved, count) / sqrt(6.0);
}

/* Take the readings that are not `out` with this sigma. Starts read all strips, fits the used ones. */
static void pose(Fitter *f, const Flag *out, double sigma) {
  const Problem *raw = f->raw;
  Int n = raw->n;
  for (Int row = 0; row < raw->signatures; row++) {
    const double *values = raw->k + row * n, *x = raw->x;
    const Flag *left = out + row * n;
    Int before = -1, after = 0;
    for (Int i = 0; i < n; i++) {
      double k = 0.0;
      if (!left[i]) k = values[before = i];
      else {
        if (after <= i) for (after = i + 1; after < n && left[after]; after++) continue;
        if (before >= 0 && after < n)
          k = (values[after] - values[before]) / (x[after] - x[before]) * (x[i] - x[before]) + values[before];
        else if (before >= 0 || after < n) k = values[before >= 0 ? before : after];
      }
      f->k[row * n + i] = clip(k, -1.0, 2.0);
      f->weight[row * n + i] = left[i] ? 0.0 : 1.0 / (sigma * sigma);
    }
  }
}

/* The residuals' spread over the sigma that the fit was given: 1 if that is known. */
static double spread(const Fitter *f) {
  Int count = 0;
  if (f->known) return 1.0;
  for (Int i = 0; i < f->all; i++) if (f->weight[i] > 0.0) f->scratch[count++] = magnitude(f->residuals[i]);
  return count ? larger(NORMAL_MAD * median(f->scratch, count), LEAST_SCALE) : 1.0;
}

/* Fit without the readings `out`, and then without those that lie alone far from the polygon, which are added. Returns
   the residuals' spread. */
static double fit_without(Fitter *f, double sigma, Flag *out, Run *run) {
  Int few = 2 * f->raw->signatures + SPARE + (f->raw->signatures == 1 ? 2 : 0), picked[2];
  double scale = 1.0;
  Flag *new = f->there + f->all;
  for (Int i = 0; i < f->all; i++) out[i] |= !f->there[i];
  for (int round = 0; round < ROUNDS; round++) {
    pose(f, out, sigma);
    run->count = 0;
    if (readings_of(&f->now) < few) return 1.0;
    run->count = tacstrip_fit_counts(&f->now, f->known, f->max_vertices, f->n_vertices, 0, run->found, picked, f->search);
    run->best = picked[0];
    run->equal = picked[1];
    tacstrip_residuals(&f->now, run->found + run->best, f->residuals);
    scale = spread(f);
    for (Int i = 0; i < f->all; i++) f->residuals[i] /= scale;
    if (round == ROUNDS - 1) break;
    Int left = readings_of(&f->now) - tacstrip_isolated_outliers(f->residuals, f->raw->signatures, f->raw->n, new);
    /* Of corners that are told, more than the readings hold may explain them all. */
    if (left == readings_of(&f->now) || (f->n_vertices && left < few)) break;
    for (Int i = 0; i < f->all; i++) out[i] |= new[i];
  }
  return scale;
}

/* What vertices and readings left out cost, with the deviance at a spread of residuals. A reading left out costs as much
   as a vertex: a notch one strip wide has at least three, a fault one or two readings, and a corner cut off a whole side. */
static double penalised_cost(const Fitter *f, const Run *run, const Flag *out, double scale) {
  Int used = 0, excluded = 0;
  if (run->count == 0) return INFINITE;
  const Polygon *best = run->found + run->best;
  for (Int i = 0; i < f->all; i++) {
    used += !out[i];
    excluded += out[i] && f->there[i];
  }
  Int paid = best->m + best->vertical[0] + best->vertical[1] + excluded;
  return best->cost / (scale * scale) + per_vertex_penalty(used) * (double)paid;
}

static int differ(const Flag *a, const Flag *b, Int n) {
  for (Int i = 0; i < n; i++) if (a[i] != b[i]) return 1;
  return 0;
}

/* Mark readings of two signatures that lie on ground or Vref where the strip's other reading says that none can: k_h is
   never below k_l, so a k_h on ground, or a k_l on Vref, is a dead or saturated channel. */
static void on_the_wrong_rail(const Fitter *f, double sigma, Flag *certain) {
  Int n = f->raw->n;
  double near = NEAR * sigma;
  for (Int i = 0; i < f->all; i++) certain[i] = 0;
  if (f->raw->signatures != 2) return;
  for (Int i = 0; i < n; i++) {
    double high = f->raw->k[i], low = f->raw->k[n + i];
    if (!f->there[i] || !f->there[n + i] || !(high < low - 2.0 * near)) continue;
    certain[i] = high <= near;
    certain[n + i] = low >= 1.0 - near;
  }
}

/* Leave suspects out and fit. Corners and steep ends are not predicted by neighbours either: are polygons of more
   readings cheaper? Nor are a fault's neighbours: is it one of the suspects alone? */
static void fit_suspecting(Fitter *f, double sigma, Flag *out, Run *run) {
  enum { MOST = ALONE + 2 };
  Flag *suspected = f->there + 2 * f->all, *others[MOST];
  Int n = f->raw->n, any = 0, uncertain = 0, tries = 1;
  for (Int i = 0; i < MOST; i++) others[i] = suspected + (i + 1) * f->all;
  Flag *certain = others[0];
  on_the_wrong_rail(f, sigma, certain);
  for (Int row = 0; row < f->raw->signatures; row++) {
    double *own = f->scratch;
    for (Int i = 0; i < n; i++) {
      Int at = row * n + i;
      own[i] = f->there[at] && !certain[at] ? f->raw->k[at] : INFINITE;
    }
    tacstrip_spikes(own, n, sigma, suspected + row * n, f->scratch + n);
  }
  for (Int i = 0; i < f->all; i++) {
    suspected[i] = certain[i] || (suspected[i] && f->there[i]);
    out[i] = suspected[i];
    any += suspected[i];
    uncertain += suspected[i] && !certain[i];
  }
  double scale = fit_without(f, sigma, out, run), last = scale;
  if (!any) return;
  for (Int at = 0; any > 1 && at < f->all && tries <= ALONE && uncertain; at++) {
    if (!suspected[at] || certain[at]) continue;
    for (Int i = 0; i < f->all; i++) others[tries][i] = certain[i] || i == at;
    tries++;
  }
  if (run->count) {
    for (Int i = 0; i < f->all; i++) f->weight[i] = 1.0;
    f->now.k = f->raw->k;
    tacstrip_residuals(&f->now, run->found + run->best, f->residuals);
    f->now.k = f->k;
    for (Int i = 0; i < f->all; i++)
      others[tries][i] = suspected[i] && magnitude(f->residuals[i]) > NEAR * sigma * scale;
    tries++;
  }
  Run more[MOST];
  int made[MOST];
  for (Int i = 0; i < tries; i++) {
    made[i] = differ(others[i], suspected, f->all);
    if (made[i]) last = fit_without(f, sigma, others[i], more + i);
  }
  scale = larger(scale, last * BARELY);
  double least = penalised_cost(f, run, out, scale);
  Int chosen = -1;
  for (Int i = 0; i < tries; i++) {
    double cost = made[i] ? penalised_cost(f, more + i, others[i], scale) : INFINITE;
    if (!made[i] || !(cost <= least)) continue;
    least = cost;
    chosen = i;
  }
  if (chosen < 0) return;
  *run = more[chosen];
  for (Int i = 0; i < f->all; i++) out[i] = others[chosen][i];
}

/* Fit with a sigma, or a first idea of it; run->sigma is then what the residuals say. */
static void fit(Fitter *f, double sigma, Flag *out, Run *run) {
  fit_suspecting(f, sigma, out, run);
  pose(f, out, sigma);
  run->sigma = sigma;
  run->advantage = -INFINITE;
  for (Int i = 0; i < f->all; i++) f->residuals[i] = 0.0;
  if (run->count == 0) return;
  const Polygon *best = run->found + run->best;
  Int readings = readings_of(&f->now), taken = 2 * best->m + 2 + best->vertical[0] + best->vertical[1];
  if (f->n_vertices == 0 && best->m > 0) {
    double score = best->score - complexity_penalty(readings, 1, f->known);
    run->ellipse_cost =
        tacstrip_fit_ellipse(&f->now, best, f->known ? score : INFINITE, run->ellipse, run->information);
    run->advantage = score - deviance(run->ellipse_cost, readings, sigma_of(&f->now), f->known);
  }
  int round = run->advantage > 0.0;
  if (round) ellipse_residuals(&f->now, run->ellipse, f->residuals);
  else tacstrip_residuals(&f->now, best, f->residuals);
  if (f->known) return;
  double squares = 0.0;
  Int freedom = readings - (round ? 3 : taken);
  for (Int i = 0; i < f->all; i++) squares += f->residuals[i] * f->residuals[i];
  run->sigma = larger(sigma * sqrt(squares / (double)(freedom > 1 ? freedom : 1)), FLOOR);
  double factor = run->sigma / sigma;
  for (Int i = 0; i < f->all; i++) {
    f->weight[i] /= factor * factor;
    f->residuals[i] /= factor;
  }
}

/* Whether a corner of chains (count, 2), x ascending, turns inwards. */
static int turns_inward(const double *lower, Int low, const double *upper, Int high) {
  for (int side = 0; side < 2; side++) {
    const double *chain = side ? upper : lower;
    double sign = side ? -1.0 : 1.0, before = -INFINITE;
    for (Int i = 1; i < (side ? high : low); i++) {
      double slope = sign * ((chain[2 * i + 1] - chain[2 * i - 1]) / (chain[2 * i] - chain[2 * i - 2]));
      if (slope < before) return 1;
      before = slope;
    }
  }
  return 0;
}

/* The share of its area that NEARLY_ALL outlines sweep which a covariance allows, of a polygon (count, 2). */
static double swept_share(const double *corners, Int count, const double *covariance, const double *normal, Int draws,
                          double *workspace) {
  double *areas = workspace, *off = areas + draws, twice = 0.0;
  tacstrip_swept_areas(corners, covariance, count, normal, draws, off, areas, off + 2 * count * draws);
  for (Int i = 1; i + 1 < count; i++) {
    const double *a = corners + 2 * i;
    twice += (a[0] - corners[0]) * (a[3] - corners[1]) - (a[2] - corners[0]) * (a[1] - corners[1]);
  }
  return twice > 0.0 ? threshold(areas, draws, draws - (Int)(NEARLY_ALL * (double)draws)) / (0.5 * twice) : INFINITE;
}

/* Say what the fit leaves over, and in mm what the chosen polygon is. */
static void describe(const RunTask *task, const Problem *now, const double *const *normal, Int draws, double *workspace) {
  Run *run = task->run;
  const double *mm = task->mm, *r = task->residuals;
  double corners[SIZE + 2], unit[2 * MAX_VERTICES + 8];
  Int n = now->n, low = 2, count = 0;
  run->told = run->inward = 0;
  run->squares = run->pairs = 0.0;
  run->height = 0.0;
  run->swept = INFINITE;
  for (Int i = 0; i < now->signatures * n; i++) {
    run->squares += r[i] * r[i];
    if (i % n) run->pairs += r[i] * r[i - 1];
  }
  if (run->count == 0) return;
  const Polygon *best = run->found + run->best;
  for (Int j = 0; j < best->m; j++) low += !best->upper[j];
  Int high = best->m + 4 - low;
  double *lower = run->points, *upper = lower + 2 * low;
  tacstrip_chains(best, 0.0, 1.0, 1.0, 0, unit, unit + 2 * low);
  run->inward = turns_inward(unit, low, unit + 2 * low, high);
  tacstrip_chains(best, mm[0], mm[1], mm[2], 1, lower, upper);
  run->height = greatest_height(lower, low, upper, high);
  run->told = tacstrip_vertex_covariance(now, best, 1, mm[0], mm[1], mm[2], task->x_mm, task->strips, run->covariance);
  if (!run->told) return;
  for (Int i = 0; i < 2 * low; i++) corners[count++] = lower[i];
  for (Int i = high - 1 - !best->vertical[1]; i >= !best->vertical[0]; i--) {
    corners[count++] = upper[2 * i];
    corners[count++] = upper[2 * i + 1];
  }
  run->swept = swept_share(corners, count / 2, run->covariance, normal[count], draws, workspace);
}

static void fit_run(const RunTask *task, double step, Int max_vertices, Int n_vertices, const double *const *normal,
                    Int draws, double *workspace) {
  Fitter f;
  const Problem *raw = &task->problem;
  Int n = raw->n;
  CHECK(n > 0 && (raw->signatures == 1 || raw->signatures == 2));
  f.raw = raw;
  f.now = *raw;
  f.all = raw->signatures * n;
  f.now.k = f.k = task->k;
  f.now.weight = f.weight = task->weight;
  f.residuals = task->residuals;
  f.known = task->sigma > 0.0;
  f.max_vertices = max_vertices;
  f.n_vertices = n_vertices;
  f.search = workspace;
  f.scratch = workspace + SEARCH_WORKSPACE;
  f.there = (Flag *)(f.scratch + 4 * n);
  double squares = 0.0, start = task->sigma;
  for (Int i = 0; i < f.all; i++) f.there[i] = raw->k[i] >= -BEYOND && raw->k[i] <= 1.0 + BEYOND;
  if (!f.known) {
    for (Int row = 0; row < raw->signatures; row++) {
      double level = reading_noise(raw->k + row * n, f.there + row * n, n, f.scratch);
      squares += level * level;
    }
    start = larger(sqrt(squares / (double)raw->signatures), step);
  }
  start = larger(start, FLOOR);
  for (int round = 0; round < ROUNDS; round++) {
    fit(&f, start, task->excluded, task->run);
    if (f.known || task->run->sigma > SURER * start) break;
    start = task->run->sigma; /* curvature passed for noise, and made what is known of the ends weigh too much */
  }
  for (Int i = 0; i < f.all; i++) task->excluded[i] &= f.there[i];
  describe(task, &f.now, normal, draws, workspace);
}

void tacstrip_fit_runs(const RunTask *tasks, Int count, double step, Int max_vertices, Int n_vertices,
                       const double *const *normal, Int draws, double *workspace) {
  for (Int i = 0; i < count; i++) fit_run(tasks + i, step, max_vertices, n_vertices, normal, draws, workspace);
}

/* An outline that is a linear function of few numbers, on a path that is a spline of few knots: descents of both. */

#include "rigid.h"

#define ALWAYS 1e-6      /* added to the diagonal */
#define FIRST_DAMPING 1e-2
#define TIMES 8.0        /* how much less damping after a step that helps, and more after one that does not */
#define LEAST_DAMPING 1e-7
#define TRIES 6          /* of ever more damping */

/* What does not change in a descent. */
typedef struct {
  const Scans *scans;
  const Loss *loss;
  const OutlineBy *by;
  const double *basis; /* (T, K); null: each scan has a knot of its own */
  Int knots;
} Path;

static void clear(double *values, Int count) {
  for (Int i = 0; i < count; i++) values[i] = 0.0;
}

/* Write the equations of corners and poses, if any, and costs (T,); return the total with the prior's, or `most` and more.
   placed (2 N + 3 T,). */
static double equations(const Path *p, const double *outline, const double *knots, double most, const Normal *n,
                        double *costs, double *placed) {
  const OutlineBy *by = p->by;
  double *poses = placed + 2 * by->count;
  for (Int c = 0; c < 2 * by->count; c++) placed[c] = by->weight[c] * outline[by->which[c]];
  clear(poses, 3 * p->scans->scans);
  for (Int t = 0; t < p->scans->scans; t++)
    for (Int k = 0; k < p->knots; k++) {
      double share = p->basis ? p->basis[t * p->knots + k] : t == k;
      if (share != 0.0) for (int i = 0; i < 3; i++) poses[3 * t + i] += share * knots[3 * k + i];
    }
  double cost = rigid_equations(p->scans, p->loss, placed, by->count, poses, most, n, costs);
  for (Int i = 0; i < by->numbers; i++)
    for (Int j = 0; j < by->numbers; j++) cost += outline[i] * by->prior[i * by->numbers + j] * outline[j];
  return cost;
}

/* Write equations of the outline's numbers instead of its corners, with the prior. */
static void by_numbers(const Path *p, const Normal *n, const double *outline, const Normal *out) {
  const OutlineBy *by = p->by;
  Int size = 2 * by->count, few = by->numbers;
  clear(out->mixed, 3 * few * p->scans->scans);
  for (Int row = 0; row < 3 * p->scans->scans; row++)
    for (Int c = 0; c < size; c++) out->mixed[row * few + by->which[c]] += by->weight[c] * n->mixed[row * size + c];
  for (Int i = 0; i < few; i++) {
    out->shape_slope[i] = 0.0;
    for (Int j = 0; j < few; j++) {
      out->shape[i * few + j] = by->prior[i * few + j];
      out->shape_slope[i] -= by->prior[i * few + j] * outline[j];
    }
  }
  for (Int c = 0; c < size; c++) {
    Int i = by->which[c];
    out->shape_slope[i] += by->weight[c] * n->shape_slope[c];
    for (Int d = 0; d < size; d++) out->shape[i * few + by->which[d]] += by->weight[c] * by->weight[d] * n->shape[c * size + d];
  }
}

/* Write the equations of a path's knots, then its outline: matrix (M, M), its upper triangle, and slope (M,). */
static void by_knots(const Path *p, const Normal *n, double *matrix, double *slope) {
  Int knots = 3 * p->knots, few = p->by->numbers, all = knots + few;
  clear(matrix, all * all);
  clear(slope, all);
  for (Int t = 0; t < p->scans->scans; t++) {
    const double *pose = n->pose + 9 * t, *mixed = n->mixed + 3 * few * t, *own = n->pose_slope + 3 * t;
    for (Int k = 0; k < p->knots; k++) {
      double share = p->basis[t * p->knots + k];
      if (share == 0.0) continue;
      for (int i = 0; i < 3; i++) {
        double *row = matrix + (3 * k + i) * all;
        for (Int l = k; l < p->knots; l++) {
          double both = share * p->basis[t * p->knots + l];
          for (int j = 0; j < 3; j++) row[3 * l + j] += both * pose[3 * i + j];
        }
        for (Int c = 0; c < few; c++) row[knots + c] += share * mixed[i * few + c];
        slope[3 * k + i] += share * own[i];
      }
    }
  }
  for (Int i = 0; i < few; i++) {
    for (Int j = i; j < few; j++) matrix[(knots + i) * all + knots + j] = n->shape[i * few + j];
    slope[knots + i] = n->shape_slope[i];
  }
}

/* Solve damped equations (size, size), their upper triangle, by Cholesky's in work; 0 where they are not definite. */
static int damped_step(const double *matrix, const double *slope, Int size, double damping, double *work, double *step) {
  for (Int i = 0; i < size; i++) {
    for (Int j = i; j < size; j++) work[i * size + j] = matrix[i * size + j];
    work[i * size + i] += damping * work[i * size + i] + ALWAYS;
    step[i] = slope[i];
  }
  for (Int k = 0; k < size; k++) {
    double *row = work + k * size;
    if (!(row[k] > 0.0)) return 0;
    double root = sqrt(row[k]);
    for (Int j = k; j < size; j++) row[j] /= root;
    step[k] /= root;
    for (Int i = k + 1; i < size; i++) {
      double factor = row[i];
      if (factor == 0.0) continue;
      for (Int j = i; j < size; j++) work[i * size + j] -= factor * row[j];
      step[i] -= factor * step[k];
    }
  }
  for (Int i = size - 1; i >= 0; i--) {
    for (Int j = i + 1; j < size; j++) step[i] -= work[i * size + j] * step[j];
    step[i] /= work[i * size + i];
  }
  return 1;
}

/* Whether no number of an outline is below its share of their mean. */
static int allowed(const double *outline, Int count, double least) {
  double sum = 0.0, smallest = INFINITE;
  for (Int i = 0; i < count; i++) {
    sum += outline[i];
    smallest = smaller(smallest, outline[i]);
  }
  return smallest > least * sum / (double)count;
}

static double *taken(double **from, Int count) {
  double *found = *from;
  *from += count;
  return found;
}

double tacstrip_rigid_path(const Scans *s, const Loss *loss, const OutlineBy *by, double *outline, const double *basis,
                           Int knots, double *at_knots, Int steps, double enough, double least, double *costs,
                           double *workspace) {
  Path path = {s, loss, by, basis, knots};
  Int size = 2 * by->count, few = by->numbers, path_size = 3 * knots, all = basis ? path_size + few : 0, now = 0;
  double damping = FIRST_DAMPING;
  Normal n[2], less;
  CHECK(few <= size && (basis || (knots == s->scans && few <= SIZE)));
  for (int i = 0; i < 2; i++) {
    n[i].pose = taken(&workspace, 9 * s->scans);
    n[i].mixed = taken(&workspace, 3 * size * s->scans);
    n[i].shape = taken(&workspace, size * size);
    n[i].pose_slope = taken(&workspace, 3 * s->scans);
    n[i].shape_slope = taken(&workspace, size);
  }
  less.mixed = taken(&workspace, 3 * few * s->scans);
  less.shape = taken(&workspace, few * few);
  less.shape_slope = taken(&workspace, few);
  double *placed = taken(&workspace, size + 3 * s->scans), *new_costs = taken(&workspace, s->scans);
  double *step = taken(&workspace, path_size + few), *trial = taken(&workspace, path_size + few);
  double *matrix = taken(&workspace, all * all), *work = taken(&workspace, all * all), *slope = taken(&workspace, all);
  double cost = equations(&path, outline, at_knots, INFINITE, &n[0], costs, placed);
  for (Int round = 0; round < steps; round++) {
    double new_cost = INFINITE;
    less.pose = n[now].pose;
    less.pose_slope = n[now].pose_slope;
    by_numbers(&path, &n[now], outline, &less);
    if (basis) by_knots(&path, &less, matrix, slope);
    int better = 0;
    for (int i = 0; i < TRIES && !better; i++) {
      int solved = basis ? damped_step(matrix, slope, all, damping, work, step)
                         : rigid_step(s->scans, few, &less, damping, ALWAYS, 0.0, step + path_size, step);
      if (solved) {
        for (Int j = 0; j < path_size; j++) trial[j] = at_knots[j] + step[j];
        for (Int j = 0; j < few; j++) trial[path_size + j] = outline[j] + step[path_size + j];
        if (least < 0.0 || allowed(trial + path_size, few, least)) {
          new_cost = equations(&path, trial + path_size, trial, cost, round + 1 < steps ? &n[!now] : 0, new_costs, placed);
          better = new_cost < cost;
        }
      }
      if (!better) damping *= TIMES;
    }
    if (!better) break;
    double gain = cost - new_cost;
    for (Int j = 0; j < path_size; j++) at_knots[j] = trial[j];
    for (Int j = 0; j < few; j++) outline[j] = trial[path_size + j];
    for (Int j = 0; j < s->scans; j++) costs[j] = new_costs[j];
    damping = larger(damping / TIMES, LEAST_DAMPING);
    now = !now;
    cost = new_cost;
    if (gain < enough * cost) break;
  }
  return cost;
}

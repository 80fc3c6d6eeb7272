/* Several rigid outlines on the same strips: a strip reads from the lowest to the highest point of all that it crosses.
   The normal equations of all corners and poses, and descents of the poses of single scans. */

#include "rigid.h"

#define END_REACH 8.0 /* deviations of an end from a strip that it may or may not reach */

/* Slopes of one number by an object's pose and by both corners of an edge, and which entries these are. */
typedef struct {
  Int pose, corner[4];
  double by_pose[3], by_corner[4];
} Row;

/* Outlines of several objects, corners one after the other. */
typedef struct {
  Int objects, size; /* size: entries of all corners */
  const Int *counts;
  const double *corners;
} Outlines;

/* Places of the results of one scan; a null `shape` leaves out what is about the corners. */
typedef struct {
  Int poses, corners; /* entries */
  double *pose, *mixed, *shape, *pose_slope, *shape_slope;
} Blocks;

static void clear(double *values, Int count) {
  for (Int i = 0; i < count; i++) values[i] = 0.0;
}

static void add_product(const Blocks *n, double weight, const Row *a, const Row *b) {
  Int width = n->poses, size = n->corners;
  for (int i = 0; i < 3; i++) {
    double by = weight * a->by_pose[i];
    for (int j = 0; j < 3; j++) n->pose[(a->pose + i) * width + b->pose + j] += by * b->by_pose[j];
    if (!n->shape) continue;
    for (int j = 0; j < 4; j++) n->mixed[(a->pose + i) * size + b->corner[j]] += by * b->by_corner[j];
  }
  if (!n->shape) return;
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++) n->shape[a->corner[i] * size + b->corner[j]] += weight * a->by_corner[i] * b->by_corner[j];
}

static void add_gradient(const Blocks *n, double weight, const Row *a) {
  for (int i = 0; i < 3; i++) n->pose_slope[a->pose + i] += weight * a->by_pose[i];
  if (!n->shape) return;
  for (int i = 0; i < 4; i++) n->shape_slope[a->corner[i]] += weight * a->by_corner[i];
}

static Row row_of(Int object, Int first, const Posed *p, const double *pose, const Crossing *c) {
  Row row = {3 * object, {first + 2 * c->from, first + 2 * c->from + 1, first + 2 * c->to, first + 2 * c->to + 1},
             {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 0.0}};
  slopes(p, pose, c, row.by_pose, row.by_corner);
  return row;
}

/* An end corner that should be at x, for a strip there is touched and no outline crosses it, or the other way round. */
static double move_end(const Loss *loss, Int object, Int first, const Posed *p, const double *pose, int right, double x,
                       const Blocks *n) {
  Int i = p->end[right];
  double residual = x - p->x[i], weight = 1.0 / (loss->end * loss->end);
  Cost cost = FREE;
  add_loss(loss, residual / loss->end, &weight, &cost);
  Row row = {3 * object, {first + 2 * i, first + 2 * i + 1, first + 2 * i, first + 2 * i},
             {1.0, 0.0, pose[1] - p->y[i]}, {p->cos, -p->sin, 0.0, 0.0}};
  add_product(n, weight, &row, &row);
  add_gradient(n, weight * residual, &row);
  return total_of(loss, &cost);
}

/* What the readings of one strip cost. */
static double strip_cost(const Scans *s, const Loss *loss, const double *k, const Crossing *low, const Crossing *high,
                         double *terms) {
  Cost cost = FREE;
  strip(s, loss, k, s->strips, low, high, terms, &cost);
  return total_of(loss, &cost);
}

/* One object on one strip. */
typedef struct {
  Crossing low, high; /* where it is not crossed, both at the end corner that is nearer */
  int crossed, right; /* right: its right end is nearer */
  double far;         /* of that end */
} Lying;

/* The lowest and the highest crossing of all objects, one of them (`but`, or -1) taken for crossed where it is not, or the
   other way round. Returns 0 where there is none. */
static int hull_of(const Lying *lying, Int objects, Int but, Int *low_of, Int *high_of) {
  *low_of = *high_of = -1;
  for (Int j = 0; j < objects; j++) {
    if (lying[j].crossed == (j == but)) continue;
    if (*low_of < 0 || lying[j].low.y < lying[*low_of].low.y) *low_of = j;
    if (*high_of < 0 || lying[j].high.y > lying[*high_of].high.y) *high_of = j;
  }
  return *low_of >= 0;
}

/* Add one scan's part to the blocks and return its cost. Whether an object reaches a strip at its end decides over much:
   a strip takes that for true which explains it best, at the cost of the distance of the end. */
static double scan_equations(const Scans *s, const Loss *loss, const double *known, Int scan, const Outlines *o,
                             const double *present, const double *poses, const Blocks *n) {
  Posed p[HULL_OBJECTS];
  Lying lying[HULL_OBJECTS];
  Int first[HULL_OBJECTS], who[HULL_OBJECTS], at = 0, there = 0;
  double cost = 0.0, reach = smaller(END_REACH * loss->end, s->pitch);
  for (Int k = 0; k < o->objects; k++) {
    if (!present || present[k] > 0.0) {
      place(o->corners + at, o->counts[k], poses + 3 * k, &p[there]);
      first[there] = at;
      who[there++] = k;
    }
    at += 2 * o->counts[k];
  }
  if (!there) return cost;
  for (Int i = 0; i < s->strips; i++) {
    const double *k = s->k + scan * s->signatures * s->strips + i;
    double x = s->x[i], terms[5], best_terms[5], best = INFINITE, hinge = 0.0;
    Int low_of, high_of, moved = -1, near = 0;
    int touched = 0;
    for (Int row = 0; row < s->signatures; row++) touched |= k[row * s->strips] == k[row * s->strips];
    if (!touched && !(known[scan * s->strips + i] > 0.0)) continue;
    for (Int j = 0; j < there; j++) {
      Lying *a = &lying[j];
      cross(&p[j], o->counts[who[j]], &s->x[i], 1, s->pitch, &a->low, &a->high);
      a->right = magnitude(x - p[j].x[p[j].end[1]]) < magnitude(x - p[j].x[p[j].end[0]]);
      a->far = magnitude(x - p[j].x[p[j].end[a->right]]);
      a->crossed = a->low.from != a->low.to && a->high.y > 0.0 && a->low.y < s->length;
      if (a->far < lying[near].far) near = j;
      if (!touched && a->crossed) cost += move_end(loss, who[j], first[j], &p[j], poses + 3 * who[j], a->right, x, n);
    }
    if (!touched) continue;
    Int low = -1, high = -1;
    if (hull_of(lying, there, -1, &low_of, &high_of)) {
      low = low_of;
      high = high_of;
      best = strip_cost(s, loss, k, &lying[low].low, &lying[high].high, best_terms);
      for (Int j = 0; j < there; j++) {
        double weight = 1.0;
        if (!(lying[j].far < reach)) continue;
        if (!hull_of(lying, there, j, &low_of, &high_of) || (low_of == low && high_of == high)) continue;
        Cost end = FREE;
        add_loss(loss, lying[j].far / loss->end, &weight, &end);
        double far = total_of(loss, &end);
        double other = strip_cost(s, loss, k, &lying[low_of].low, &lying[high_of].high, terms) + far;
        if (other < best) {
          best = other;
          hinge = far;
          moved = j;
          for (int q = 0; q < 5; q++) best_terms[q] = terms[q];
        }
      }
      if (moved >= 0) {
        hull_of(lying, there, moved, &low, &high);
        best -= hinge;
      }
    } else {
      Int corner = p[near].end[lying[near].right];
      Crossing here = {corner, corner, p[near].y[corner], 0.0, 0.0};
      lying[near].low = lying[near].high = here;
      low = high = moved = near;
      best = strip_cost(s, loss, k, &here, &here, best_terms);
    }
    cost += best;
    if (moved >= 0)
      cost += move_end(loss, who[moved], first[moved], &p[moved], poses + 3 * who[moved], lying[moved].right, x, n);
    Row by_low = row_of(who[low], first[low], &p[low], poses + 3 * who[low], &lying[low].low);
    Row by_high = row_of(who[high], first[high], &p[high], poses + 3 * who[high], &lying[high].high);
    add_product(n, best_terms[0], &by_low, &by_low);
    add_product(n, best_terms[1], &by_low, &by_high);
    add_product(n, best_terms[1], &by_high, &by_low);
    add_product(n, best_terms[2], &by_high, &by_high);
    add_gradient(n, best_terms[3], &by_low);
    add_gradient(n, best_terms[4], &by_high);
  }
  return cost;
}

double tacstrip_hull_equations(const Scans *s, const Loss *loss, const double *known, Int objects, const Int *counts,
                               const double *corners, const double *present, const double *poses, double *pose,
                               double *mixed, double *shape, double *pose_slope, double *shape_slope, double *costs) {
  Int width = 3 * objects;
  double total = 0.0;
  Outlines o = {objects, 0, counts, corners};
  CHECK(1 <= objects && objects <= HULL_OBJECTS && 1 <= s->signatures && s->signatures <= 2);
  for (Int k = 0; k < objects; k++) o.size += 2 * counts[k];
  clear(pose, s->scans * width * width);
  clear(mixed, s->scans * width * o.size);
  clear(shape, o.size * o.size);
  clear(pose_slope, s->scans * width);
  clear(shape_slope, o.size);
  for (Int i = 0; i < s->scans; i++) {
    Blocks n = {width, o.size, pose + i * width * width, mixed + i * width * o.size, shape, pose_slope + i * width, shape_slope};
    costs[i] = scan_equations(s, loss, known, i, &o, present + i * objects, poses + i * width, &n);
    total += costs[i];
  }
  return total;
}

/* Of poses (width,) from where they are expected, and its part of the slope. */
static double from_prior(Int width, const double *poses, const double *expected, const double *weight) {
  double cost = 0.0;
  for (Int i = 0; i < width; i++) cost += weight[i] * (poses[i] - expected[i]) * (poses[i] - expected[i]);
  return cost;
}

/* The poses of one scan by themselves. */
static double descend_poses(const Scans *s, const Loss *loss, const double *known, Int scan, const Outlines *o,
                            double *poses, const double *expected, const double *weight, Int steps) {
  double blocks[2][9 * HULL_OBJECTS * HULL_OBJECTS], slope[2][3 * HULL_OBJECTS], trial[3 * HULL_OBJECTS];
  double damping = 10.0 * DAMPING;
  Int width = 3 * o->objects;
  int now = 0;
  Blocks n[2] = {{width, o->size, blocks[0], 0, 0, slope[0], 0}, {width, o->size, blocks[1], 0, 0, slope[1], 0}};
  clear(blocks[0], width * width);
  clear(slope[0], width);
  double cost = scan_equations(s, loss, known, scan, o, 0, poses, &n[0]) + from_prior(width, poses, expected, weight);
  for (Int step = 0; step < steps && damping < HOPELESS; step++) {
    Matrix a;
    double by[3 * HULL_OBJECTS], new_cost = INFINITE;
    for (Int i = 0; i < width; i++) {
      for (Int j = 0; j < width; j++) a[i][j] = blocks[now][i * width + j];
      a[i][i] += weight[i];
      a[i][i] += damping * a[i][i] + LEAST;
      by[i] = slope[now][i] + weight[i] * (expected[i] - poses[i]);
    }
    if (factor(a, width)) {
      solve(a, width, by);
      for (Int i = 0; i < width; i++) trial[i] = poses[i] + by[i];
      clear(blocks[!now], width * width);
      clear(slope[!now], width);
      new_cost = scan_equations(s, loss, known, scan, o, 0, trial, &n[!now]) + from_prior(width, trial, expected, weight);
    }
    if (new_cost < cost) {
      int done = cost - new_cost < 1e-3 * cost;
      for (Int i = 0; i < width; i++) poses[i] = trial[i];
      now = !now;
      cost = new_cost;
      damping = larger(damping / EASED, LEAST);
      if (done) break;
    } else damping *= EASED;
  }
  return cost;
}

void tacstrip_hull_poses(const Scans *s, const Loss *loss, const double *known, Int objects, const Int *counts,
                         const double *corners, double *poses, const double *expected, const double *weight, Int starts,
                         Int steps, double *costs) {
  Int width = 3 * objects;
  Outlines o = {objects, 0, counts, corners};
  CHECK(1 <= objects && objects <= HULL_OBJECTS);
  for (Int k = 0; k < objects; k++) o.size += 2 * counts[k];
  for (Int i = 0; i < s->scans; i++)
    for (Int j = 0; j < starts; j++) {
      Int at = i * starts + j;
      costs[at] = descend_poses(s, loss, known, i, &o, poses + at * width, expected + at * width, weight + at * width, steps);
    }
}

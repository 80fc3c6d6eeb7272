/* One rigid outline in many scans: the normal equations of its corners and of its pose in each, and descents by them.
   A strip reads the hull of the outline on its centre line, so that it may be concave. */

#include "rigid.h"

#define PINNED 1e12     /* weight of the pose that the frame is fixed to */

/* Add w a b' + w b a' over two, with a and b the slopes of two crossings, or one, to the blocks. */
static void add_product(const Normal *n, Int size, double weight, const Crossing *c, const double *pa, const double *ca,
                        const Crossing *d, const double *pb, const double *cb) {
  Int at_a[4] = {2 * c->from, 2 * c->from + 1, 2 * c->to, 2 * c->to + 1};
  Int at_b[4] = {2 * d->from, 2 * d->from + 1, 2 * d->to, 2 * d->to + 1};
  for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) n->pose[3 * i + j] += weight * pa[i] * pb[j];
  if (!n->shape) return;
  for (int i = 0; i < 3; i++) for (int j = 0; j < 4; j++) n->mixed[i * size + at_b[j]] += weight * pa[i] * cb[j];
  for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) n->shape[at_a[i] * size + at_b[j]] += weight * ca[i] * cb[j];
}

static void add_gradient(const Normal *n, double weight, const Crossing *c, const double *by_pose, const double *by_corner) {
  for (int i = 0; i < 3; i++) n->pose_slope[i] += weight * by_pose[i];
  if (!n->shape) return;
  for (int i = 0; i < 2; i++) n->shape_slope[2 * c->from + i] += weight * by_corner[i];
  for (int i = 0; i < 2; i++) n->shape_slope[2 * c->to + i] += weight * by_corner[2 + i];
}

/* An end corner lies between a strip that is touched and the next one, which is not: nothing more is known of it. */
static double gap(const Scans *s, const Loss *loss, const Posed *p, const double *pose, int right, Int touched,
                  const Normal *n, Int size) {
  Int i = p->end[right];
  double inner = s->x[touched], outer = right ? inner + s->pitch : inner - s->pitch, x = p->x[i], weight;
  int border = right ? touched == s->strips - 1 : touched == 0;
  double least = right ? inner : outer, most = right ? outer : inner;
  if (x >= least && x <= most) return 0.0;
  if (right ? x > most : x < least) {
    if (border || p->y[i] < 0.0 || p->y[i] > s->length) return 0.0; /* what lies over the border is not read */
  }
  double residual = (x < least ? least : most) - x;
  weight = 1.0 / (loss->end * loss->end);
  double cost = loss_of(loss, residual / loss->end, &weight);
  double by_pose[3] = {1.0, 0.0, pose[1] - p->y[i]}, by_corner[4] = {p->cos, -p->sin, 0.0, 0.0};
  Crossing corner = {i, i, p->y[i], 0.0, 0.0};
  add_product(n, size, weight, &corner, by_pose, by_corner, &corner, by_pose, by_corner);
  add_gradient(n, weight * residual, &corner, by_pose, by_corner);
  return cost;
}

/* Add one scan's part to the blocks and return its cost. */
static double scan_equations(const Scans *s, const Loss *loss, Int scan, const double *corners, Int count,
                             const double *pose, const Normal *n) {
  Posed p;
  Int size = 2 * count, first = -1, last = -1;
  double cost = 0.0, terms[5], low_pose[3], low_corner[4], high_pose[3], high_corner[4];
  place(corners, count, pose, &p);
  for (Int i = 0; i < s->strips; i++) {
    const double *k = s->k + scan * s->signatures * s->strips + i;
    int there = 0;
    for (Int row = 0; row < s->signatures; row++) there |= k[row * s->strips] == k[row * s->strips];
    if (!there) continue;
    if (first < 0) first = i;
    last = i;
    Crossing low, high;
    cross(&p, count, s->x[i], &low, &high);
    cost += strip(s, loss, k, s->strips, &low, &high, terms);
    slopes(&p, pose, &low, low_pose, low_corner);
    slopes(&p, pose, &high, high_pose, high_corner);
    add_product(n, size, terms[0], &low, low_pose, low_corner, &low, low_pose, low_corner);
    add_product(n, size, terms[1], &low, low_pose, low_corner, &high, high_pose, high_corner);
    add_product(n, size, terms[1], &high, high_pose, high_corner, &low, low_pose, low_corner);
    add_product(n, size, terms[2], &high, high_pose, high_corner, &high, high_pose, high_corner);
    add_gradient(n, terms[3], &low, low_pose, low_corner);
    add_gradient(n, terms[4], &high, high_pose, high_corner);
  }
  if (first >= 0) {
    cost += gap(s, loss, &p, pose, 0, first, n, size);
    cost += gap(s, loss, &p, pose, 1, last, n, size);
  }
  return cost;
}

static void clear(double *values, Int count) {
  for (Int i = 0; i < count; i++) values[i] = 0.0;
}

double tacstrip_rigid_equations(const Scans *s, const Loss *loss, const double *corners, Int count, const double *poses,
                                double *pose, double *mixed, double *shape, double *pose_slope, double *shape_slope,
                                double *costs) {
  Int size = 2 * count;
  double total = 0.0;
  CHECK(3 <= count && count <= RIGID_CORNERS && 1 <= s->signatures && s->signatures <= 2);
  clear(pose, 9 * s->scans);
  clear(mixed, 3 * size * s->scans);
  clear(shape, size * size);
  clear(pose_slope, 3 * s->scans);
  clear(shape_slope, size);
  for (Int i = 0; i < s->scans; i++) {
    Normal n = {pose + 9 * i, mixed + 3 * size * i, shape, pose_slope + 3 * i, shape_slope};
    costs[i] = scan_equations(s, loss, i, corners, count, poses + 3 * i, &n);
    total += costs[i];
  }
  return total;
}

/* One scan's pose by itself. */
static double descend_pose(const Scans *s, const Loss *loss, Int scan, const double *corners, Int count, double *pose,
                           Int steps) {
  double blocks[9], slope[3], trial_blocks[9], trial_slope[3], trial[3], damping = 10.0 * DAMPING;
  Normal n = {blocks, 0, 0, slope, 0}, other = {trial_blocks, 0, 0, trial_slope, 0};
  clear(blocks, 9);
  clear(slope, 3);
  double cost = scan_equations(s, loss, scan, corners, count, pose, &n);
  for (Int step = 0; step < steps && damping < HOPELESS; step++) {
    Matrix a;
    double by[3];
    for (int i = 0; i < 3; i++) {
      for (int j = 0; j < 3; j++) a[i][j] = blocks[3 * i + j];
      a[i][i] += damping * a[i][i] + LEAST;
      by[i] = slope[i];
    }
    double new_cost = INFINITE;
    if (factor(a, 3)) {
      solve(a, 3, by);
      for (int i = 0; i < 3; i++) trial[i] = pose[i] + by[i];
      clear(trial_blocks, 9);
      clear(trial_slope, 3);
      new_cost = scan_equations(s, loss, scan, corners, count, trial, &other);
    }
    if (new_cost < cost) {
      int done = cost - new_cost < 1e-3 * cost;
      for (int i = 0; i < 3; i++) pose[i] = trial[i];
      for (int i = 0; i < 9; i++) blocks[i] = trial_blocks[i];
      for (int i = 0; i < 3; i++) slope[i] = trial_slope[i];
      cost = new_cost;
      damping = larger(damping / EASED, LEAST);
      if (done) break;
    } else damping *= EASED;
  }
  return cost;
}

void tacstrip_rigid_poses(const Scans *s, const Loss *loss, const double *corners, Int count, double *poses, Int starts,
                          Int steps, double *costs) {
  for (Int i = 0; i < s->scans; i++)
    for (Int j = 0; j < starts; j++) {
      Int at = i * starts + j;
      costs[at] = descend_pose(s, loss, i, corners, count, poses + 3 * at, steps);
    }
}

int rigid_step(Int scans, Int size, const Normal *n, double damping, double least, double pinned, double *by_outline,
               double *by_pose) {
  Matrix a, b;
  CHECK(size <= SIZE);
  for (Int i = 0; i < size; i++) {
    for (Int j = 0; j < size; j++) a[i][j] = n->shape[i * size + j];
    a[i][i] += damping * a[i][i] + least;
    by_outline[i] = n->shape_slope[i];
  }
  for (Int s = 0; s < scans; s++) {
    const double *pose = n->pose + 9 * s, *mixed = n->mixed + 3 * size * s, *slope = n->pose_slope + 3 * s;
    double weighted[3][SIZE], residual[3];
    for (int i = 0; i < 3; i++) {
      for (int j = 0; j < 3; j++) b[i][j] = pose[3 * i + j];
      b[i][i] += damping * b[i][i] + least + (s == scans / 2 ? pinned : 0.0);
    }
    if (!factor(b, 3)) return 0;
    for (Int c = 0; c < size; c++) {
      double column[3] = {mixed[c], mixed[size + c], mixed[2 * size + c]};
      solve(b, 3, column);
      for (int i = 0; i < 3; i++) weighted[i][c] = column[i];
    }
    for (int i = 0; i < 3; i++) residual[i] = slope[i];
    for (Int c = 0; c < size; c++) {
      for (Int d = c; d < size; d++) {
        double sum = 0.0;
        for (int i = 0; i < 3; i++) sum += mixed[i * size + c] * weighted[i][d];
        a[c][d] -= sum;
      }
      for (int i = 0; i < 3; i++) by_outline[c] -= weighted[i][c] * residual[i];
    }
  }
  if (!factor(a, size)) return 0;
  solve(a, size, by_outline);
  for (Int s = 0; s < scans; s++) {
    const double *pose = n->pose + 9 * s, *mixed = n->mixed + 3 * size * s;
    for (int i = 0; i < 3; i++) {
      for (int j = 0; j < 3; j++) b[i][j] = pose[3 * i + j];
      b[i][i] += damping * b[i][i] + least + (s == scans / 2 ? pinned : 0.0);
      by_pose[3 * s + i] = n->pose_slope[3 * s + i];
      for (Int c = 0; c < size; c++) by_pose[3 * s + i] -= mixed[i * size + c] * by_outline[c];
    }
    if (!factor(b, 3)) return 0;
    solve(b, 3, by_pose + 3 * s);
  }
  return 1;
}

/* Add what is known of the corners to their equations, and return what they cost by it. */
static double add_prior(const CornerPrior *prior, Int size, const double *corners, const Normal *n) {
  double cost = 0.0;
  if (!prior) return cost;
  for (Int i = 0; i < size; i++) {
    double pull = prior->slope[i];
    for (Int j = 0; j < size; j++) {
      double weight = prior->information[i * size + j];
      n->shape[i * size + j] += weight;
      pull -= weight * (corners[j] - prior->about[j]);
    }
    n->shape_slope[i] += pull;
    cost -= (corners[i] - prior->about[i]) * (pull + prior->slope[i]);
  }
  return cost;
}

double tacstrip_rigid_descend(const Scans *s, const Loss *loss, const CornerPrior *prior, double *corners, Int count,
                              double *poses, Int steps, double enough, double *costs, double *workspace) {
  Int size = 2 * count, scans = s->scans, block = scans * (12 + 3 * size) + size * size + size;
  double *at = workspace + 2 * block, *trial_corners = at, *trial_poses = at + size, damping = DAMPING;
  double *by_corner = trial_poses + 3 * scans, *by_pose = by_corner + size, *trial_costs = by_pose + 3 * scans;
  double pinned = prior ? 0.0 : PINNED;
  Normal n[2];
  CHECK(size <= SIZE);
  for (int i = 0; i < 2; i++) {
    double *from = workspace + i * block;
    n[i].pose = from;
    n[i].mixed = from + 9 * scans;
    n[i].shape = n[i].mixed + 3 * size * scans;
    n[i].pose_slope = n[i].shape + size * size;
    n[i].shape_slope = n[i].pose_slope + 3 * scans;
  }
  int now = 0;
  double cost = tacstrip_rigid_equations(s, loss, corners, count, poses, n[0].pose, n[0].mixed, n[0].shape,
                                         n[0].pose_slope, n[0].shape_slope, costs);
  cost += add_prior(prior, size, corners, &n[0]);
  for (Int step = 0; step < steps && damping < HOPELESS; step++) {
    double new_cost = INFINITE;
    const Normal *o = &n[!now];
    if (rigid_step(scans, size, &n[now], damping, LEAST, pinned, by_corner, by_pose)) {
      for (Int i = 0; i < size; i++) trial_corners[i] = corners[i] + by_corner[i];
      for (Int i = 0; i < 3 * scans; i++) trial_poses[i] = poses[i] + by_pose[i];
      new_cost = tacstrip_rigid_equations(s, loss, trial_corners, count, trial_poses, o->pose, o->mixed, o->shape,
                                          o->pose_slope, o->shape_slope, trial_costs);
      new_cost += add_prior(prior, size, trial_corners, o);
    }
    if (new_cost < cost) {
      int done = cost - new_cost < enough * larger(1.0, 1e-4 * cost);
      for (Int i = 0; i < size; i++) corners[i] = trial_corners[i];
      for (Int i = 0; i < 3 * scans; i++) poses[i] = trial_poses[i];
      for (Int i = 0; i < scans; i++) costs[i] = trial_costs[i];
      cost = new_cost;
      now = !now;
      damping = larger(damping / EASED, LEAST);
      if (done) break;
    } else damping *= EASED;
  }
  return cost;
}

/* One rigid outline in many scans: the normal equations of its corners and of its pose in each, and descents by them.
   A strip reads the hull of the outline on its centre line, so that it may be concave. */

#include "rigid.h"

#define PINNED 1e12     /* weight of the pose that the frame is fixed to */

/* Add w a a', with a the slopes of a crossing, to the blocks. */
static void add_product(const Normal *n, Int size, double weight, const Crossing *c, const double *by_pose,
                        const double *by_corner) {
  Int at[4] = {2 * c->from, 2 * c->from + 1, 2 * c->to, 2 * c->to + 1};
  for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) n->pose[3 * i + j] += weight * by_pose[i] * by_pose[j];
  if (!n->shape) return;
  for (int i = 0; i < 3; i++) for (int j = 0; j < 4; j++) n->mixed[i * size + at[j]] += weight * by_pose[i] * by_corner[j];
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++) n->shape[at[i] * size + at[j]] += weight * by_corner[i] * by_corner[j];
}

static void add_gradient(const Normal *n, double weight, const Crossing *c, const double *by_pose, const double *by_corner) {
  for (int i = 0; i < 3; i++) n->pose_slope[i] += weight * by_pose[i];
  if (!n->shape) return;
  for (int i = 0; i < 2; i++) n->shape_slope[2 * c->from + i] += weight * by_corner[i];
  for (int i = 0; i < 2; i++) n->shape_slope[2 * c->to + i] += weight * by_corner[2 + i];
}

/* An end corner lies between a strip that is touched and the next one that is read, which is not: nothing more is known of it. */
static void gap(const Scans *s, const Loss *loss, const Posed *p, const double *pose, int right, Int touched,
                const Normal *n, Int size, Cost *cost) {
  Int i = p->end[right];
  double inner = s->x[touched], outer = right ? inner + s->gap[s->strips + touched] : inner - s->gap[touched];
  double x = p->x[i], weight;
  double least = right ? inner : outer, most = right ? outer : inner;
  if (x >= least && x <= most) return;
  if (right ? x > most : x < least) {
    if (p->y[i] < 0.0 || p->y[i] > s->length) return; /* what lies over the border is not read */
  }
  double residual = (x < least ? least : most) - x;
  weight = 1.0 / (loss->end * loss->end);
  add_loss(loss, residual / loss->end, &weight, cost);
  if (!n) return;
  double by_pose[3] = {1.0, 0.0, pose[1] - p->y[i]}, by_corner[4] = {p->cos, -p->sin, 0.0, 0.0};
  Crossing corner = {i, i, p->y[i], 0.0, 0.0};
  add_product(n, size, weight, &corner, by_pose, by_corner);
  add_gradient(n, weight * residual, &corner, by_pose, by_corner);
}

static inline void add_pair(double *to, double by, const double *pair) {
  double first = to[0] + by * pair[0], second = to[1] + by * pair[1];
  to[0] = first;
  to[1] = second;
}

/* Add what a strip reads, of which `terms` are what `strip` returns: J'WJ of both crossings, and J'Wr. */
static void add_strip(const Normal *n, Int size, const double *terms, const Crossing *low, const double *low_pose,
                      const double *low_corner, const Crossing *high, const double *high_pose, const double *high_corner) {
  double by_low[3], by_high[3];
  for (int i = 0; i < 3; i++) {
    by_low[i] = terms[0] * low_pose[i] + terms[1] * high_pose[i];
    by_high[i] = terms[1] * low_pose[i] + terms[2] * high_pose[i];
    n->pose_slope[i] += terms[3] * low_pose[i] + terms[4] * high_pose[i];
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) n->pose[3 * i + j] += by_low[i] * low_pose[j] + by_high[i] * high_pose[j];
  if (!n->shape) return;
  Int at_low[2] = {2 * low->from, 2 * low->to}, at_high[2] = {2 * high->from, 2 * high->to};
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 2; j++) {
      add_pair(n->mixed + i * size + at_low[j], by_low[i], low_corner + 2 * j);
      add_pair(n->mixed + i * size + at_high[j], by_high[i], high_corner + 2 * j);
    }
  for (int i = 0; i < 4; i++) {
    double *row = n->shape + (at_low[i / 2] + i % 2) * size, *other = n->shape + (at_high[i / 2] + i % 2) * size;
    double low_low = terms[0] * low_corner[i], low_high = terms[1] * low_corner[i];
    double high_low = terms[1] * high_corner[i], high_high = terms[2] * high_corner[i];
    for (int j = 0; j < 2; j++) {
      add_pair(row + at_low[j], low_low, low_corner + 2 * j);
      add_pair(row + at_high[j], low_high, high_corner + 2 * j);
      add_pair(other + at_low[j], high_low, low_corner + 2 * j);
      add_pair(other + at_high[j], high_high, high_corner + 2 * j);
    }
    n->shape_slope[at_low[i / 2] + i % 2] += terms[3] * low_corner[i];
    n->shape_slope[at_high[i / 2] + i % 2] += terms[4] * high_corner[i];
  }
}

static int is_touched(const Scans *s, const double *k) {
  int there = 0;
  for (Int row = 0; row < s->signatures; row++) there |= k[row * s->strips] == k[row * s->strips];
  return there;
}

/* Add one scan's part to the blocks, where there are any, and return its cost. */
static double scan_equations(const Scans *s, const Loss *loss, Int scan, const double *corners, Int count,
                             const double *pose, const Normal *n) {
  Posed p;
  Int size = 2 * count, first = 0, last = s->strips - 1;
  double terms[5], low_pose[3], low_corner[4], high_pose[3], high_corner[4];
  const double *readings = s->k + scan * s->signatures * s->strips;
  Cost cost = FREE;
  while (first < s->strips && !is_touched(s, readings + first)) first++;
  if (first == s->strips) return 0.0;
  while (!is_touched(s, readings + last)) last--;
  place(corners, count, pose, &p);
  for (Int begin = first; begin <= last; begin += AT_A_TIME) {
    Int strips = last + 1 - begin < AT_A_TIME ? last + 1 - begin : AT_A_TIME;
    Crossing low[AT_A_TIME], high[AT_A_TIME];
    cross(&p, count, s->x + begin, strips, s->pitch, low, high);
    for (Int i = 0; i < strips; i++) {
      const double *k = readings + begin + i;
      if (!is_touched(s, k)) continue;
      strip(s, loss, k, s->strips, &low[i], &high[i], terms, &cost);
      if (!n) continue;
      slopes(&p, pose, &low[i], low_pose, low_corner);
      slopes(&p, pose, &high[i], high_pose, high_corner);
      add_strip(n, size, terms, &low[i], low_pose, low_corner, &high[i], high_pose, high_corner);
    }
  }
  gap(s, loss, &p, pose, 0, first, n, size, &cost);
  gap(s, loss, &p, pose, 1, last, n, size, &cost);
  return total_of(loss, &cost);
}

static void clear(double *values, Int count) {
  for (Int i = 0; i < count; i++) values[i] = 0.0;
}

double rigid_equations(const Scans *s, const Loss *loss, const double *corners, Int count, const double *poses, double most,
                       const Normal *n, double *costs) {
  Int size = 2 * count;
  double total = 0.0;
  CHECK(3 <= count && count <= RIGID_CORNERS && 1 <= s->signatures && s->signatures <= 2);
  if (n) {
    clear(n->pose, 9 * s->scans);
    clear(n->mixed, 3 * size * s->scans);
    clear(n->shape, size * size);
    clear(n->pose_slope, 3 * s->scans);
    clear(n->shape_slope, size);
  }
  for (Int i = 0; i < s->scans && !(total >= most); i++) {
    Normal own;
    if (n) own = (Normal){n->pose + 9 * i, n->mixed + 3 * size * i, n->shape, n->pose_slope + 3 * i, n->shape_slope};
    costs[i] = scan_equations(s, loss, i, corners, count, poses + 3 * i, n ? &own : 0);
    total += costs[i];
  }
  return total;
}

double tacstrip_rigid_equations(const Scans *s, const Loss *loss, const double *corners, Int count, const double *poses,
                                double *pose, double *mixed, double *shape, double *pose_slope, double *shape_slope,
                                double *costs) {
  Normal n = {pose, mixed, shape, pose_slope, shape_slope};
  return rigid_equations(s, loss, corners, count, poses, INFINITE, &n, costs);
}

static void add_row(double *row, double by, const Crossing *c, const double *by_pose, const double *by_corner) {
  for (int i = 0; i < 3; i++) row[i] += by * by_pose[i];
  add_pair(row + 3 + 2 * c->from, by, by_corner);
  add_pair(row + 3 + 2 * c->to, by, by_corner + 2);
}

void tacstrip_rigid_linearised(const Scans *s, const double *corners, Int count, const double *poses, Int first, Int last,
                               double *model, double *rows) {
  Int size = 3 + 2 * count;
  double low_pose[3], low_corner[4], high_pose[3], high_corner[4], by_l, by_u;
  CHECK(3 <= count && count <= RIGID_CORNERS && 0 <= first && last <= s->strips);
  for (Int scan = 0; scan < s->scans; scan++) {
    const double *pose = poses + 3 * scan;
    Posed p;
    place(corners, count, pose, &p);
    for (Int begin = first; begin < last; begin += AT_A_TIME) {
      Int strips = last - begin < AT_A_TIME ? last - begin : AT_A_TIME;
      Crossing low[AT_A_TIME], high[AT_A_TIME];
      cross(&p, count, s->x + begin, strips, s->pitch, low, high);
      for (Int i = 0; i < strips; i++) {
        Ends e = ends_of(s, &low[i], &high[i]);
        slopes(&p, pose, &low[i], low_pose, low_corner);
        slopes(&p, pose, &high[i], high_pose, high_corner);
        for (Int signature = 0; signature < s->signatures; signature++) {
          Int at = (scan * s->signatures + signature) * s->strips + begin + i;
          double *row = rows + size * at;
          model[at] = reading(s, s->share[signature], &e, &by_l, &by_u);
          clear(row, size);
          add_row(row, by_l * e.held_l, &low[i], low_pose, low_corner);
          add_row(row, by_u * e.held_u, &high[i], high_pose, high_corner);
        }
      }
    }
  }
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
      new_cost = scan_equations(s, loss, scan, corners, count, trial, step + 1 < steps ? &other : 0);
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

/* Move one scan's pose, if that costs no more than so much above what it does. */
static void walk_pose(const Scans *s, const Loss *loss, Int scan, const double *corners, Int count, double *pose,
                      const double *step, double above, double *cost) {
  double trial[3];
  for (int i = 0; i < 3; i++) trial[i] = pose[i] + step[i];
  double new_cost = scan_equations(s, loss, scan, corners, count, trial, 0);
  if (!(new_cost < *cost + above)) return;
  for (int i = 0; i < 3; i++) pose[i] = trial[i];
  *cost = new_cost;
}

void tacstrip_rigid_walk(const Scans *s, const Loss *loss, double *corners, Int count, double *poses, double *costs,
                         const double *follow, const double *moves, const double *above, Int steps,
                         const double *pose_steps, const double *pose_above, Int rounds, double *walked,
                         double *workspace) {
  Int size = 2 * count, scans = s->scans;
  double *trial = workspace, *trial_poses = trial + size, *trial_costs = trial_poses + 3 * scans;
  CHECK(3 <= count && count <= RIGID_CORNERS);
  for (Int step = 0; step < steps; step++) {
    const double *move = moves + step * size;
    double most = above[step], new_cost = 0.0;
    for (Int i = 0; i < scans; i++) most += costs[i];
    for (Int i = 0; i < size; i++) trial[i] = corners[i] + move[i];
    for (Int i = 0; i < scans && new_cost < most; i++) {
      for (Int j = 3 * i; j < 3 * i + 3; j++) {
        trial_poses[j] = poses[j];
        for (Int k = 0; k < size; k++) trial_poses[j] -= follow[j * size + k] * move[k];
      }
      trial_costs[i] = scan_equations(s, loss, i, trial, count, trial_poses + 3 * i, 0);
      new_cost += trial_costs[i];
    }
    if (new_cost < most) {
      for (Int i = 0; i < size; i++) corners[i] = trial[i];
      for (Int i = 0; i < 3 * scans; i++) poses[i] = trial_poses[i];
      for (Int i = 0; i < scans; i++) costs[i] = trial_costs[i];
    }
    for (Int i = 0; i < scans; i++)
      for (Int j = 0; j < rounds; j++) {
        Int at = (step * rounds + j) * scans + i;
        walk_pose(s, loss, i, corners, count, poses + 3 * i, pose_steps + 3 * at, pose_above[at], costs + i);
      }
    for (Int i = 0; i < size; i++) walked[step * size + i] = corners[i];
  }
}

/* U'U of a damped block (3, 3), its diagonal by what divides. */
typedef struct {
  double by[3], u01, u02, u12;
} Root;

static int root_of(const double *pose, double damping, double least, Root *u) {
  double a = pose[0] + damping * pose[0] + least, b = pose[4] + damping * pose[4] + least;
  double c = pose[8] + damping * pose[8] + least;
  if (!(a > 0.0)) return 0;
  u->by[0] = 1.0 / sqrt(a);
  u->u01 = pose[1] * u->by[0];
  u->u02 = pose[2] * u->by[0];
  b -= u->u01 * u->u01;
  if (!(b > 0.0)) return 0;
  u->by[1] = 1.0 / sqrt(b);
  u->u12 = (pose[5] - u->u01 * u->u02) * u->by[1];
  c -= u->u02 * u->u02 + u->u12 * u->u12;
  if (!(c > 0.0)) return 0;
  u->by[2] = 1.0 / sqrt(c);
  return 1;
}

/* U'^-1 of a column, its entries `stride` apart. */
static void forward(const Root *u, const double *column, Int stride, double *out, Int out_stride) {
  double first = column[0] * u->by[0], second = (column[stride] - u->u01 * first) * u->by[1];
  out[0] = first;
  out[out_stride] = second;
  out[2 * out_stride] = (column[2 * stride] - u->u02 * first - u->u12 * second) * u->by[2];
}

int rigid_step(Int scans, Int size, const Normal *n, double damping, double least, double pinned, double *by_outline,
               double *by_pose) {
  Matrix a;
  Root u;
  CHECK(size <= SIZE);
  for (Int i = 0; i < size; i++) {
    for (Int j = 0; j < size; j++) a[i][j] = n->shape[i * size + j];
    a[i][i] += damping * a[i][i] + least;
    by_outline[i] = n->shape_slope[i];
  }
  for (Int s = 0; s < scans; s++) {
    const double *mixed = n->mixed + 3 * size * s;
    double rows[3][SIZE], slope[3];
    if (!root_of(n->pose + 9 * s, damping, least + (s == scans / 2 ? pinned : 0.0), &u)) return 0;
    for (Int c = 0; c < size; c++) forward(&u, mixed + c, size, rows[0] + c, SIZE);
    forward(&u, n->pose_slope + 3 * s, 1, slope, 1);
    for (Int c = 0; c < size; c++) {
      double x = rows[0][c], y = rows[1][c], z = rows[2][c];
      for (Int d = c; d < size; d++) a[c][d] -= x * rows[0][d] + y * rows[1][d] + z * rows[2][d];
      by_outline[c] -= x * slope[0] + y * slope[1] + z * slope[2];
    }
  }
  if (!factor(a, size)) return 0;
  solve(a, size, by_outline);
  for (Int s = 0; s < scans; s++) {
    const double *mixed = n->mixed + 3 * size * s;
    double *step = by_pose + 3 * s, rest[3];
    for (int i = 0; i < 3; i++) {
      rest[i] = n->pose_slope[3 * s + i];
      for (Int c = 0; c < size; c++) rest[i] -= mixed[i * size + c] * by_outline[c];
    }
    root_of(n->pose + 9 * s, damping, least + (s == scans / 2 ? pinned : 0.0), &u);
    forward(&u, rest, 1, step, 1);
    step[2] *= u.by[2];
    step[1] = (step[1] - u.u12 * step[2]) * u.by[1];
    step[0] = (step[0] - u.u01 * step[1] - u.u02 * step[2]) * u.by[0];
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
  double cost = rigid_equations(s, loss, corners, count, poses, INFINITE, &n[0], costs);
  cost += add_prior(prior, size, corners, &n[0]);
  for (Int step = 0; step < steps && damping < HOPELESS; step++) {
    double new_cost = INFINITE;
    const Normal *o = &n[!now];
    if (rigid_step(scans, size, &n[now], damping, LEAST, pinned, by_corner, by_pose)) {
      for (Int i = 0; i < size; i++) trial_corners[i] = corners[i] + by_corner[i];
      for (Int i = 0; i < 3 * scans; i++) trial_poses[i] = poses[i] + by_pose[i];
      /* without a prior no scan costs less than nothing, so that a trial is given up as soon as it is no better */
      new_cost = rigid_equations(s, loss, trial_corners, count, trial_poses, prior ? INFINITE : cost,
                               prior || step + 1 < steps ? o : 0, trial_costs);
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

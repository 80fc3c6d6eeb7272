/* How far a convex body may reach that holds a ring: each reading shuts out a cone behind itself, as seen from what is held. */

#include "internal.h"

#define RAYS 40        /* evenly around */
#define ROUNDS 3       /* of looking for corners between the rays */
#define PARALLEL 1e-12 /* of a direction: a ray that never meets a line */
#define SAME 1e-9      /* radians: a corner of which a ray is there */
#define MOST_RAYS (2 * RAYS << ROUNDS) /* each round adds at most one behind each ray, the tips at most as many as there are */

enum { WALLS = 4 };
static const double PI = 3.141592653589793;

/* Places behind `tip`, left and right of two lines: normal[i] y >= gap[i]. From the middle of the ring. */
typedef struct {
  double tip[2], normal[2][2], gap[2];
} Cone;

typedef struct {
  double theta, radius;
  Int cone, side; /* that stops it, and by which line */
} Ray;

static double angle(double y, double x) {
  double found = x != 0.0 ? arctangent(magnitude(y / x)) : 0.5 * PI;
  if (x < 0.0) found = PI - found;
  return y < 0.0 ? -found : found;
}

static double once_round(double theta) {
  while (theta < 0.0) theta += 2.0 * PI;
  while (theta >= 2.0 * PI) theta -= 2.0 * PI;
  return theta;
}

/* Write the cone behind a point, and return whether it is one: not where the ring surrounds the point. */
static int cone_behind(const double *point, const double *onward, const double *ring, Int corners, const double *middle,
                       Cone *cone) {
  double to[2] = {point[0] - middle[0], point[1] - middle[1]}, edge[2][2] = {{0.0, 0.0}, {0.0, 0.0}}, turns[2] = {0.0, 0.0};
  double sides[2] = {0.0, 0.0};
  for (Int i = 0; i <= corners; i++) {
    double x = i < corners ? point[0] - ring[2 * i] : onward[0], y = i < corners ? point[1] - ring[2 * i + 1] : onward[1];
    double across = to[0] * y - to[1] * x, along = to[0] * x + to[1] * y;
    double turn = across / (magnitude(across) + magnitude(along)); /* grows with the angle, -2 to 2 for -pi to pi */
    if (along < 0.0) turn = (across < 0.0 ? -2.0 : 2.0) - turn;
    for (int last = 0; last < 2; last++) {
      if (i && (last ? turn <= turns[1] : turn >= turns[0])) continue;
      turns[last] = turn;
      sides[last] = across;
      edge[last][0] = x;
      edge[last][1] = y;
    }
  }
  /* As seen from without, what is held takes less than half a turn. */
  if (!(sides[0] <= 0.0 && sides[1] >= 0.0 && turns[1] - turns[0] < 2.0)) return 0;
  Cone found = {{to[0], to[1]}, {{-edge[0][1], edge[0][0]}, {edge[1][1], -edge[1][0]}}, {0.0, 0.0}};
  for (int i = 0; i < 2; i++) found.gap[i] = found.normal[i][0] * to[0] + found.normal[i][1] * to[1];
  *cone = found;
  return 1;
}

/* Write how far a ray reaches until both lines of a cone hold it. */
static void send(Ray *ray, const Cone *cones, Int count) {
  double x = cosine(ray->theta), y = sine(ray->theta);
  ray->radius = INFINITE;
  ray->cone = ray->side = 0;
  for (Int i = 0; i < count; i++) {
    double enters[2] = {0.0, 0.0};
    int side, never = 0;
    for (side = 0; side < 2 && !never; side++) {
      double speed = cones[i].normal[side][0] * x + cones[i].normal[side][1] * y;
      never = !(speed > PARALLEL) || cones[i].gap[side] >= ray->radius * speed;
      if (!never) enters[side] = cones[i].gap[side] / speed;
    }
    if (never) continue;
    side = enters[1] > enters[0];
    ray->radius = enters[side];
    ray->cone = i;
    ray->side = side;
  }
}

/* Put a ray among those that are sorted, unless it is there. */
static Int put(Ray *rays, Int count, double theta, const Cone *cones, Int shut) {
  Int at = count;
  while (at && rays[at - 1].theta > theta) at--;
  if (at && rays[at - 1].theta == theta) return count;
  CHECK(count < MOST_RAYS);
  for (Int i = count; i > at; i--) rays[i] = rays[i - 1];
  rays[at].theta = theta;
  send(rays + at, cones, shut);
  return count + 1;
}

static double distance_to(const double *p, const double *a, const double *b) {
  double along[2] = {b[0] - a[0], b[1] - a[1]}, to[2] = {p[0] - a[0], p[1] - a[1]};
  double size = along[0] * along[0] + along[1] * along[1];
  double share = size > 0.0 ? clip((to[0] * along[0] + to[1] * along[1]) / size, 0.0, 1.0) : 0.0;
  double off[2] = {to[0] - share * along[0], to[1] - share * along[1]};
  return sqrt(off[0] * off[0] + off[1] * off[1]);
}

/* Keep, among those between two points, the ones that the line between what is kept would miss (Douglas and Peucker). */
static void keep_between(const double *points, Int count, Int from, Int to, double within, int *kept) {
  double furthest = within;
  Int at = from;
  for (Int i = from + 1; i < to; i++) {
    double off = distance_to(points + 2 * i, points + 2 * from, points + 2 * (to % count));
    if (off > furthest) {
      furthest = off;
      at = i;
    }
  }
  if (at == from) return;
  kept[at] = 1;
  keep_between(points, count, from, at, within, kept);
  keep_between(points, count, at, to, within, kept);
}

/* Leave out, in place, corners of a ring without which it lies as near as that; return how many stay. */
static Int simplify(double *points, Int count, double within) {
  int kept[MOST_RAYS];
  Int last = count - 1, second = 1, stay = 0;
  for (Int i = 0; i < count; i++) kept[i] = !i;
  keep_between(points, count, 0, count, within, kept);
  while (last > 0 && !kept[last]) last--;
  while (second < count - 1 && !kept[second]) second++;
  kept[0] = last - second < 2 || distance_to(points, points + 2 * last, points + 2 * second) > within;
  for (Int i = 0; i < count; i++) {
    if (!kept[i]) continue;
    points[2 * stay] = points[2 * i];
    points[2 * stay++ + 1] = points[2 * i + 1];
  }
  return stay;
}

Int tacstrip_convex_reach(const double *ring, Int corners, const double *points, Int below, Int above, Int bodies,
                          const double *edges, double within, double *reached, double *workspace) {
  Cone *cones = (Cone *)workspace;
  Ray rays[MOST_RAYS];
  double middle[2] = {0.0, 0.0}, box[4] = {edges[0], edges[1], edges[2], edges[3]};
  Int shut = 0, kept = 0, count = 0;
  CHECK(corners > 0);
  for (Int i = 0; i < corners; i++) {
    for (int j = 0; j < 2; j++) {
      middle[j] += ring[2 * i + j] / (double)corners;
      box[2 * j] = smaller(box[2 * j], ring[2 * i + j]);
      box[2 * j + 1] = larger(box[2 * j + 1], ring[2 * i + j]);
    }
  }
  for (Int i = 0; i < below + above + bodies; i++) {
    const double *point = points + 2 * i;
    double onward[2] = {0.0, i < below ? -1.0 : 1.0};
    if (i >= below + above)
      for (int j = 0; j < 2; j++) onward[j] = point[j] - ring[j];
    shut += cone_behind(point, onward, ring, corners, middle, cones + shut);
  }
  for (int wall = 0; wall < WALLS; wall++) {
    int axis = wall / 2, up = wall % 2;
    Cone *cone = cones + shut + wall;
    for (int i = 0; i < 2; i++) {
      cone->normal[i][axis] = up ? 1.0 : -1.0;
      cone->normal[i][1 - axis] = 0.0;
      cone->gap[i] = magnitude(box[wall] - middle[axis]);
    }
  }
  for (Int i = 0; i < RAYS; i++) {
    rays[i].theta = -PI + 2.0 * PI * (double)i / RAYS;
    send(rays + i, cones, shut + WALLS);
  }
  /* Of the cones those count that stop a ray; without the others it is the larger. */
  for (Int i = 0; i < shut + WALLS; i++) {
    int stops = i >= shut;
    for (Int k = 0; k < RAYS; k++) stops |= rays[k].cone == i;
    if (stops) cones[kept++] = cones[i];
  }
  for (; count < RAYS; count++) send(rays + count, cones, kept);
  for (Int i = 0; i < kept - WALLS; i++) count = put(rays, count, angle(cones[i].tip[1], cones[i].tip[0]), cones, kept);
  /* Where two lines bound what neighbouring rays reach, a corner is between, or several. */
  for (int round = 0; round < ROUNDS; round++) {
    double found[MOST_RAYS];
    Int more = 0;
    for (Int i = 0; i < count; i++) {
      const Ray *now = rays + i, *then = rays + (i + 1) % count;
      if (now->cone == then->cone && now->side == then->side) continue;
      const double *n = cones[now->cone].normal[now->side], *m = cones[then->cone].normal[then->side];
      double a = cones[now->cone].gap[now->side], b = cones[then->cone].gap[then->side], turn = n[0] * m[1] - n[1] * m[0];
      double sign = turn < 0.0 ? -1.0 : 1.0, width = once_round(then->theta - now->theta);
      double corner = angle((n[0] * b - m[0] * a) * sign, (a * m[1] - b * n[1]) * sign);
      double after = once_round(corner - now->theta);
      if (turn == 0.0 || !(after > SAME && after < width - SAME)) after = 0.5 * width;
      found[more++] = once_round(now->theta + after + PI) - PI;
    }
    for (Int i = 0; i < more; i++) count = put(rays, count, found[i], cones, kept);
  }
  Int written = 0;
  for (Int i = 0; i < count; i++) { /* of rays that one line stops, the outer ones */
    const Ray *ray = rays + i, *before = rays + (i ? i - 1 : count - 1), *next = rays + (i + 1) % count;
    if (before->cone == ray->cone && before->side == ray->side && next->cone == ray->cone && next->side == ray->side) continue;
    reached[2 * written] = middle[0] + ray->radius * cosine(ray->theta);
    reached[2 * written++ + 1] = middle[1] + ray->radius * sine(ray->theta);
  }
  return simplify(reached, written, within);
}

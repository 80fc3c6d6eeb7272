/* How deep points of a skin lie in objects, how far the skin yields to them there, and how far off they are. */

#include "internal.h"

#define UNDER 0.05    /* mm: depth that a point counts with which the object reaches under */
#define NOT_MET (-1e6) /* mm that the skin yields to what it does not meet */
#define PARALLEL 1e-9 /* cosine of a normal and a face's, below which they never meet */

enum { PLANE, SPHERE, CYLINDER, EDGE, BOX, CONE };
typedef struct {
  double x, y, z;
} Vector;

static inline Vector turned(const double *axes, double x, double y, double z) {
  Vector v = {axes[0] * x + axes[1] * y + axes[2] * z, axes[3] * x + axes[4] * y + axes[5] * z,
              axes[6] * x + axes[7] * y + axes[8] * z};
  return v;
}

static inline Vector place(const double *frame, const double *points, Int stride) {
  return turned(frame, points[0] - frame[9], points[stride] - frame[10], points[2 * stride] - frame[11]);
}

static inline double depth_of(Int kind, const double *size, Vector q) {
  if (kind == PLANE) return q.z;
  if (kind == EDGE) return size[0] * q.z - size[1] * magnitude(q.y);
  if (kind == CONE) return size[0] * q.z - size[1] * sqrt(q.x * q.x + q.y * q.y);
  if (kind == BOX)
    return smaller(smaller(0.5 * size[0] - magnitude(q.x), 0.5 * size[1] - magnitude(q.y)), smaller(q.z, size[2] - q.z));
  double z = q.z - size[0], square = q.y * q.y + z * z;
  return size[0] - sqrt(kind == SPHERE ? square + q.x * q.x : square);
}

/* A column of the skin is within a half-space from `into` to `out`. */
static inline void cut(double slack, double steep, double *into, double *out) {
  if (steep > PARALLEL) *out = smaller(*out, slack / steep);
  else if (steep < -PARALLEL) *into = larger(*into, slack / steep);
  else if (slack < 0.0) *into = INFINITE;
}

/* What of a column is within a cone, by the roots of A d^2 - 2 B d + C on its side of the tip. */
static inline double cone_yield(const double *size, double thickness, Vector q, Vector n) {
  double s = size[0] * size[0], c = size[1] * size[1];
  double A = s * n.z * n.z - c * (n.x * n.x + n.y * n.y), B = s * q.z * n.z - c * (q.x * n.x + q.y * n.y);
  double C = s * q.z * q.z - c * (q.x * q.x + q.y * q.y), square = B * B - A * C;
  if (!(square >= 0.0) || magnitude(A) < PARALLEL) return NOT_MET;
  double root = sqrt(square), low = (B - root) / A, high = (B + root) / A; /* low <= high where A > 0 */
  if (A < 0.0) return q.z - B / A * n.z > 0.0 && high < thickness ? low : NOT_MET;
  if (n.z > 0.0) return low;
  return high < thickness ? INFINITE : NOT_MET;
}

static inline double yield_of(Int kind, const double *size, double thickness, Vector q, Vector n) {
  if (kind == SPHERE || kind == CYLINDER) {
    double z = q.z - size[0], along = q.y * n.y + z * n.z, square = n.y * n.y + n.z * n.z;
    double beyond = q.y * q.y + z * z - size[0] * size[0];
    if (kind == SPHERE) along += q.x * n.x, square += n.x * n.x, beyond += q.x * q.x;
    double half = sqrt(larger(along * along - square * beyond, 0.0));
    if (!(half > 0.0 && along - half < thickness * square)) return NOT_MET;
    return along >= 0.0 ? (along + half) / square : beyond / (along - half); /* without cancellation */
  }
  if (kind == CONE) return cone_yield(size, thickness, q, n);
  double into = -INFINITE, out = INFINITE;
  if (kind == PLANE) cut(q.z, n.z, &into, &out);
  else if (kind == EDGE) {
    cut(size[0] * q.z + size[1] * q.y, size[0] * n.z + size[1] * n.y, &into, &out);
    cut(size[0] * q.z - size[1] * q.y, size[0] * n.z - size[1] * n.y, &into, &out);
  } else {
    cut(0.5 * size[0] + q.x, n.x, &into, &out);
    cut(0.5 * size[0] - q.x, -n.x, &into, &out);
    cut(0.5 * size[1] + q.y, n.y, &into, &out);
    cut(0.5 * size[1] - q.y, -n.y, &into, &out);
    cut(q.z, n.z, &into, &out);
    cut(size[2] - q.z, -n.z, &into, &out);
  }
  return into <= out && into < thickness ? out : NOT_MET;
}

void tacstrip_solid_touch(Int kind, const double *frames, Int count, const double *points, const double *normals,
                          Int own, Int n, double thickness, double *touch, double *yields) {
  Int stride = (own ? count : 1) * n;
  for (Int object = 0; object < count; object++, frames += SOLID_FRAME, touch += n) {
    const double *p = points + (own ? object * n : 0), *out = normals ? normals + (own ? object * n : 0) : 0;
    for (Int i = 0; i < n; i++) {
      Vector q = place(frames, p + i, stride);
      double depth = depth_of(kind, frames + 12, q), yield = NOT_MET;
      if (out && (yields || (kind != PLANE && depth <= 0.0 && depth > -thickness))) {
        yield = yield_of(kind, frames + 12, thickness, q, turned(frames, out[i], out[i + stride], out[i + 2 * stride]));
        if (kind != PLANE && depth <= 0.0 && yield > 0.0) depth = smaller(yield, UNDER);
      }
      touch[i] = depth;
      if (yields) yields[object * n + i] = depth > 0.0 ? yield : depth;
    }
  }
}

void tacstrip_solid_gap(Int kind, const double *frame, const double *points, const double *normals, Int n,
                        double steepest, double *gap) {
  const double *size = frame + 12;
  for (Int i = 0; i < n; i++) {
    Vector q = place(frame, points + i, n);
    double lead = 0.0, square = q.y * q.y + (kind == SPHERE ? q.x * q.x : 0.0);
    if (kind == EDGE) lead = size[1] / size[0] * magnitude(q.y);
    else if (kind == CONE) lead = size[1] / size[0] * sqrt(q.x * q.x + q.y * q.y);
    else if (kind == BOX) lead = magnitude(q.x) <= 0.5 * size[0] && magnitude(q.y) <= 0.5 * size[1] ? 0.0 : INFINITE;
    else if (kind != PLANE)
      lead = square <= size[0] * size[0] ? size[0] - sqrt(size[0] * size[0] - square) : INFINITE;
    int faces = turned(frame, normals[i], normals[i + n], normals[i + 2 * n]).z > steepest;
    gap[i] = faces ? lead - q.z : INFINITE;
  }
}

void tacstrip_patch_sums(const double *touch, const double *yields, const double *points, const double *normals,
                         Int rows, Int columns, const double *across, const double *up, double *sums) {
  Int all = rows * columns;
  for (int i = 0; i < 13; i++) sums[i] = 0.0;
  for (Int row = 0, i = 0; row < rows; row++, i++) {
    for (Int column = 0; column + 1 < columns; column++, i++) {
      double a = touch[i], b = touch[i + 1], high = larger(a, b);
      if (!(high > 0.0)) continue;
      double ya = larger(yields[i], 0.0), yb = larger(yields[i + 1], 0.0), most = larger(ya, yb);
      double share = 1.0, edge = smaller(ya, yb);
      if (!(a > 0.0 && b > 0.0)) share = high / magnitude(a - b), edge = most - smaller(high, most);
      double area = share * across[row] * up[column], weight = 0.5 * (most + edge) * area, p[3], n[3];
      for (int axis = 0; axis < 3; axis++) {
        p[axis] = 0.5 * (points[i + axis * all] + points[i + 1 + axis * all]);
        n[axis] = 0.5 * (normals[i + axis * all] + normals[i + 1 + axis * all]);
        sums[1 + axis] += area * p[axis];
        sums[4 + axis] += area * n[axis];
        sums[7 + axis] -= weight * n[axis];
      }
      sums[0] += area;
      for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        sums[10 + axis] -= weight * (p[next] * n[last] - p[last] * n[next]);
      }
    }
  }
}

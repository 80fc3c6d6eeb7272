/* Calls the core where there is no Python: another processor under an emulator, another C library. Prints a checksum
   of each case's results, which must be the same everywhere. Add a case: fill arrays with number(), call, and show(). */

#include <stdio.h>

#include "core.h"

static unsigned long long state = 1;

/* The next of a sequence in [0, 1) that is the same on every machine. */
static double number(void) {
  state = state * 6364136223846793005ULL + 1442695040888963407ULL;
  return (double)(state >> 11) / 9007199254740992.0;
}

/* Print a checksum (FNV-1a) of some bytes. */
static void show(const char *name, const void *bytes, unsigned long long count) {
  unsigned long long sum = 14695981039346656037ULL;
  for (unsigned long long i = 0; i < count; i++) sum = (sum ^ ((const unsigned char *)bytes)[i]) * 1099511628211ULL;
  printf("%s %016llx\n", name, sum);
}

/* The compiler's own part: a contracted or reordered sum shows here, and chaos makes much of it. */
static void chaos(void) {
  double value = number();
  for (int i = 0; i < 200; i++) value = 1.0 - 1.9 * value * value;
  show("chaos", &value, sizeof value);
}

enum { STRIPS = 90, EDGES = 4, HEIGHTS = 2 * EDGES, SWEEPS = 600, ROWS = 3000 };
#define LENGTH 60.0
static double x_mm[STRIPS], gap_mm[2 * STRIPS], readings[2 * STRIPS], workspace[200000];
static const double LOWER[3][2] = {{0.0, 30.0}, {35.2, 12.0}, {90.0, 33.0}};
static const double UPPER[3][2] = {{0.0, 30.0}, {58.7, 47.0}, {90.0, 33.0}};

static double height(const double chain[3][2], double x) {
  const double *a = chain[x > chain[1][0]], *b = a + 2;
  return a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0]);
}

/* Readings k_h and k_l of two equal strips under a quadrilateral, with an error up to `noise`. */
static void measure(double noise) {
  for (int i = 0; i < STRIPS; i++) {
    x_mm[i] = (double)i + 0.5;
    gap_mm[i] = i ? 1.0 : 1.0 / 0.0;
    gap_mm[STRIPS + i] = i < STRIPS - 1 ? 1.0 : 1.0 / 0.0;
    double l = height(LOWER, x_mm[i]) / LENGTH, w = height(UPPER, x_mm[i]) / LENGTH - l;
    readings[i] = (l + 0.5 * w) / (1.0 - 0.5 * w) + noise * (2.0 * number() - 1.0);
    readings[STRIPS + i] = l / (1.0 - 0.5 * w) + noise * (2.0 * number() - 1.0);
  }
}

/* A whole run: with sigma and without, with faults and without. */
static void runs(void) {
  static double x[STRIPS], k[2 * STRIPS], weight[2 * STRIPS], residuals[2 * STRIPS];
  static unsigned char excluded[2 * STRIPS];
  static Run run;
  static double normal[8 * (SIZE + 2)];
  const double *normals[SIZE + 3];
  for (int i = 0; i < 8 * (SIZE + 2); i++) normal[i] = number() - 0.5;
  for (int i = 0; i < SIZE + 3; i++) normals[i] = normal;
  for (int which = 0; which < 4; which++) {
    Problem problem = {STRIPS, 2, x, readings, weight, 1.0 / STRIPS, {0.5, 0.0}, 0.5, which == 1 ? 0.02 : 0.0};
    measure(0.004);
    for (int i = 0; i < STRIPS; i++) x[i] = x_mm[i] / STRIPS;
    if (which > 1) readings[20] = 0.9;
    if (which > 1) readings[STRIPS + 60] = 7.0;
    double sigma = which % 2 ? 0.0 : 0.004 / 1.7320508075688772;
    RunTask task = {problem, sigma, {0.0, STRIPS, LENGTH}, x_mm, STRIPS, &run, k, weight, residuals, excluded};
    tacstrip_fit_runs(&task, 1, 1e-5, MAX_VERTICES, 0, normals, 8, workspace);
    Polygon *best = run.found + run.best;
    show("run", best->theta, (END_ENTRIES + 2 * (unsigned)best->m) * sizeof(double));
    show("residuals", residuals, sizeof residuals);
    show("swept", &run.swept, sizeof run.swept);
    show("sums", &run.squares, 2 * sizeof run.squares);
    show("excluded", excluded, sizeof excluded);
    double low[2 * (MAX_VERTICES + 2)], high[2 * (MAX_VERTICES + 2)];
    Int above = 2;
    for (Int i = 0; i < best->m; i++) above += best->upper[i];
    tacstrip_chains(best, 0.0, STRIPS, LENGTH, 1, low, high);
    show("lower", low, 2 * (unsigned)(best->m + 4 - above) * sizeof(double));
    show("upper", high, 2 * (unsigned)above * sizeof(double));
    double covariance[4 * SIZE * SIZE];
    unsigned size = 2 * (unsigned)(best->m + 2 + best->vertical[0] + best->vertical[1]);
    problem.k = k;
    if (tacstrip_vertex_covariance(&problem, best, 1, 0.0, STRIPS, LENGTH, x_mm, STRIPS, covariance)) {
      double corners[SIZE + 2], off[8 * (SIZE + 2)], areas[8];
      show("covariance", covariance, size * size * sizeof(double));
      for (unsigned i = 0; i < size; i++) corners[i] = 60.0 * number();
      for (unsigned i = 0; i < 8 * size; i++) normal[i] = number() - 0.5;
      tacstrip_swept_areas(corners, covariance, size / 2, normal, 8, off, areas, workspace);
      show("off", off, 8 * size * sizeof(double));
      show("areas", areas, sizeof areas);
    }
  }
}

/* The set that a bound leaves: its rows, a point inside, a walk, outlines and their scatter. */
static void bounded(void) {
  static double low[2 * STRIPS], high[2 * STRIPS], widths[3 * STRIPS], a[HEIGHTS * ROWS], b[ROWS], edge[ROWS];
  static double pair_a[2 * HEIGHTS * ROWS], pair_b[2 * ROWS], pair_edge[ROWS], points[SWEEPS * HEIGHTS];
  static double vertical_x[2 * SWEEPS], lower[6 * SWEEPS], upper[6 * SWEEPS];
  double reach[HEIGHTS], at[HEIGHTS], zones[4] = {30.2, 40.2, 53.7, 63.7}, curvature[HEIGHTS * HEIGHTS];
  double mean[8], covariance[64], radii[4], deviations[4];
  Int turns[2] = {1, -1}, counts[2], lower_at[3] = {0, 1, 2}, upper_at[3] = {0, 3, 2};
  for (int line = 0; line < EDGES; line++) for (int end = 0; end < 2; end++) {
    const double *point = (line < 2 ? LOWER : UPPER)[line % 2 + end];
    reach[2 * line + end] = point[0];
    at[2 * line + end] = point[1];
  }
  for (int lam = 0; lam < 2; lam++) {
    Lines lines = {EDGES, 2, {0, 0}, reach, turns};
    Band band = {STRIPS, 2, x_mm, low, high, {0.5, 0.0}, 0.5, LENGTH, 0.01 * lam, 0.001, {-1.0, 0.5, 89.5, 91.0}};
    measure(0.003);
    for (int i = 0; i < 2 * STRIPS; i++) low[i] = readings[i] - 0.004;
    for (int i = 0; i < 2 * STRIPS; i++) high[i] = readings[i] + 0.004;
    for (int i = 0; i < 3 * STRIPS; i++) widths[i] = height(UPPER, x_mm[i % STRIPS]) - height(LOWER, x_mm[i % STRIPS]);
    tacstrip_feasible_set(&lines, &band, zones, widths, counts, 0, 0, 0, 0, 0, 0, workspace);
    show("counts", counts, sizeof counts);
    tacstrip_feasible_set(&lines, &band, zones, widths, counts, a, b, edge, pair_a, pair_b, pair_edge, workspace);
    show("rows", a, HEIGHTS * (unsigned long long)counts[0] * sizeof *a);
    show("pairs", pair_a, 2 * HEIGHTS * (unsigned long long)counts[1] * sizeof *a);
    Int rounds = tacstrip_feasible_part(a, b, pair_a, pair_b, at, curvature, 0.01 * LENGTH, 8, counts[0], counts[1],
                                        HEIGHTS, workspace);
    show("rounds", &rounds, sizeof rounds);
    show("centre", at, sizeof at);
    Int walked = rounds > 0 && tacstrip_hit_and_run(a, b, edge, pair_a, pair_b, pair_edge, at, curvature, points, SWEEPS,
                                                    counts[0], counts[1], HEIGHTS, workspace);
    show("walked", &walked, sizeof walked);
    if (!walked) continue;
    show("points", points, sizeof points);
    Int drawn = tacstrip_outlines(&lines, band.windows, LENGTH, points, vertical_x, SWEEPS, lower, upper, workspace);
    show("drawn", &drawn, sizeof drawn);
    if (!drawn) continue;
    for (int i = 0; i < 8; i++) mean[i] = 0.0;
    for (int k = 0; k < SWEEPS; k++) for (int i = 0; i < 6; i++) {
      mean[i] += lower[6 * k + i] / SWEEPS;
      if (i / 2 == 1) mean[4 + i] += upper[6 * k + i] / SWEEPS;
    }
    tacstrip_scatter(lower, upper, lower_at, upper_at, 3, 3, mean, 4, SWEEPS, covariance, radii, deviations, workspace);
    show("scatter", covariance, sizeof covariance);
    show("radii", radii, sizeof radii);
    show("deviations", deviations, sizeof deviations);
    double shuffled[2 * SWEEPS], own[64] = {0.0}, both[12];
    for (int i = 0; i < 2 * SWEEPS; i++) shuffled[i] = i % 2 ? SWEEPS - 1 - i / 2 : i / 2;
    for (int i = 0; i < 64; i += 9) own[i] = 0.1;
    Int told = tacstrip_bounded(&band, 1.0, LOWER[0], 3, UPPER[0], 3, own, shuffled, SWEEPS, points, both, covariance,
                                radii, deviations, workspace, sizeof workspace / sizeof *workspace);
    show("told", &told, sizeof told);
    if (told < 2) continue;
    show("mean", both, sizeof both);
    show("scatter", covariance, sizeof covariance);
  }
}

/* One outline in many scans: equations, poses by themselves, and all together. */
static void rigid(void) {
  enum { SCANS = 12, CORNERS = 4 };
  static double k[SCANS * 2 * STRIPS], pose[SCANS * 9], mixed[SCANS * 6 * CORNERS], costs[2 * SCANS], starts[SCANS * 6];
  double known[4 * CORNERS * CORNERS], pull[2 * CORNERS] = {0.1, 0.0, -0.2};
  double corners[2 * CORNERS] = {-30.0, -18.0, 28.0, -15.0, 25.0, 16.0, -22.0, 14.0}, poses[SCANS * 3];
  double shape[4 * CORNERS * CORNERS], pose_slope[SCANS * 3], shape_slope[2 * CORNERS];
  measure(0.004);
  for (int s = 0; s < SCANS; s++) {
    for (int i = 0; i < 2 * STRIPS; i++) k[s * 2 * STRIPS + i] = i % STRIPS < s ? 0.0 / 0.0 : readings[i];
    poses[3 * s] = 45.0 + 0.1 * s;
    poses[3 * s + 1] = 30.0;
    poses[3 * s + 2] = 0.1 * s - 0.5;
    for (int i = 0; i < 6; i++) starts[6 * s + i] = poses[3 * s + i % 3] + 0.3 * (i > 2);
  }
  for (int which = 0; which < 2; which++) {
    Scans scans = {SCANS, STRIPS, 2, x_mm, k, gap_mm, 0.004, 1.0, LENGTH, {0.5, 0.0}, 0.5, which ? 0.02 : 0.0};
    Loss loss = {which ? 0.5 : 0.0, which ? 3.0 : 0.0, 0.05};
    for (int i = 0; i < 4 * CORNERS * CORNERS; i++) known[i] = i % (2 * CORNERS + 1) ? 0.01 : 2.0;
    CornerPrior prior = {known, pull, corners};
    tacstrip_rigid_equations(&scans, &loss, corners, CORNERS, poses, pose, mixed, shape, pose_slope, shape_slope, costs);
    show("mixed", mixed, sizeof mixed);
    show("shape", shape, sizeof shape);
    show("slopes", pose_slope, sizeof pose_slope);
    tacstrip_rigid_poses(&scans, &loss, corners, CORNERS, starts, 2, 8, costs);
    show("starts", starts, sizeof starts);
    tacstrip_rigid_descend(&scans, &loss, which ? &prior : 0, corners, CORNERS, poses, 12, 1e-3, costs, workspace);
    show("corners", corners, sizeof corners);
    show("poses", poses, sizeof poses);
  }
}

/* An outline of four radii on a path of three knots, and one end of a contact. */
static void paths_and_chains(void) {
  enum { SCANS = 12, RADII = 4, KNOTTED = 3 };
  static double k[SCANS * 2 * STRIPS], basis[SCANS * KNOTTED], room[4000], costs[SCANS], prior[RADII * RADII], fitted[STRIPS];
  double radii[RADII] = {25.0, 22.0, 26.0, 24.0}, weight[2 * RADII] = {1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, -1.0}, end[STRIPS];
  double knots[3 * KNOTTED] = {45.0, 30.0, -0.5, 46.0, 30.0, 0.0, 47.0, 30.0, 0.5}, level[STRIPS], lines[5 * STRIPS], chi[1];
  Int which[2 * RADII], places[2 * STRIPS + 2], cuts[STRIPS + 1];
  measure(0.004);
  for (int s = 0; s < SCANS; s++) {
    double t = 2.0 * s / (SCANS - 1);
    for (int i = 0; i < 2 * STRIPS; i++) k[s * 2 * STRIPS + i] = i % STRIPS < s ? 0.0 / 0.0 : readings[i];
    for (int i = 0; i < KNOTTED; i++) basis[KNOTTED * s + i] = t > i - 1 && t < i + 1 ? (t < i ? t - i + 1 : i + 1 - t) : 0.0;
  }
  for (int i = 0; i < 2 * RADII; i++) which[i] = i / 2;
  for (int i = 0; i < RADII; i++) prior[(RADII + 1) * i] = 0.01;
  OutlineBy by = {RADII, RADII, which, weight, prior};
  Scans scans = {SCANS, STRIPS, 2, x_mm, k, gap_mm, 0.004, 1.0, LENGTH, {0.5, 0.0}, 0.5, 0.0};
  Loss loss = {0.5, 3.0, 0.25};
  tacstrip_rigid_path(&scans, &loss, &by, radii, basis, KNOTTED, knots, 6, 1e-3, 0.02, costs, room);
  show("radii", radii, sizeof radii);
  show("knots", knots, sizeof knots);
  for (int i = 0; i < STRIPS; i++) {
    end[i] = readings[i] + (i > STRIPS / 2 ? 0.2 : 0.0);
    level[i] = 1e4;
  }
  tacstrip_convex_regression(x_mm, end, level, STRIPS, 1.0, fitted, places, room);
  show("convex", fitted, sizeof fitted);
  Int stretches = tacstrip_convex_cuts(x_mm, end, level, STRIPS, cuts, lines, places, room);
  show("cuts", cuts, (stretches + 1) * sizeof *cuts);
  Int count = tacstrip_convex_polyline(x_mm, end, level, STRIPS, 1.0, fitted, lines, chi, places, room);
  show("lines", lines, 5 * count * sizeof *lines);
  Int sure[STRIPS];
  tacstrip_sure_strips(x_mm, end, level, STRIPS, cuts, stretches, sure, places, room);
  show("sure", sure, sizeof sure);
  double ends[2 * STRIPS], points[2 * STRIPS];
  for (int i = 0; i < STRIPS; i++) {
    points[2 * i] = x_mm[(7 * i) % STRIPS];
    points[2 * i + 1] = end[i];
  }
  tacstrip_hull_ends(points, STRIPS, x_mm, STRIPS, ends, room);
  show("ends", ends, sizeof ends);
}

/* How far a box may reach between readings. */
static void reach(void) {
  enum { POINTS = 2 * STRIPS + 1 };
  static double points[2 * POINTS], reached[2 * 640], room[8 * (POINTS + 4)];
  const double ring[8] = {40.0, 40.0, 50.0, 40.0, 50.0, 50.0, 40.0, 50.0}, edges[4] = {0.0, 100.0, 0.0, LENGTH};
  for (int i = 0; i < POINTS; i++) {
    points[2 * i] = i < 2 * STRIPS ? (i % STRIPS) * 100.0 / STRIPS : 60.0;
    points[2 * i + 1] = i < STRIPS ? 10.0 + i : i < 2 * STRIPS ? 80.0 - 0.5 * (i - STRIPS) : 55.0;
  }
  Int count = tacstrip_convex_reach(ring, 4, points, STRIPS, STRIPS, 1, edges, 1e-3, reached, room);
  show("reach", reached, 2 * count * sizeof *reached);
  double areas[3];
  tacstrip_convex_overlap(ring, 4, reached, count, areas, room);
  show("areas", areas, sizeof areas);
}

static const double BOX[8] = {-9.0, -9.0, 9.0, -9.0, 9.0, 9.0, -9.0, 9.0};

/* Three boxes on the same strips: their equations, and poses by themselves. */
static void hulls(void) {
  enum { SCANS = 6, OBJECTS = 3, CORNERS = 4 * OBJECTS, POSES = 3 * OBJECTS };
  static double k[SCANS * 2 * STRIPS], known[SCANS * STRIPS], mixed[SCANS * POSES * 2 * CORNERS], starts[2 * SCANS * POSES];
  double corners[2 * CORNERS], poses[SCANS * POSES], present[SCANS * OBJECTS], expected[2 * SCANS * POSES];
  double pose[SCANS * POSES * POSES], shape[4 * CORNERS * CORNERS], weight[2 * SCANS * POSES], costs[2 * SCANS];
  double pose_slope[SCANS * POSES], shape_slope[2 * CORNERS];
  Int counts[OBJECTS] = {4, 4, 4};
  measure(0.004);
  for (int i = 0; i < SCANS * 2 * STRIPS; i++) k[i] = i % STRIPS % 29 == 28 ? 0.0 / 0.0 : readings[i % (2 * STRIPS)];
  for (int i = 0; i < SCANS * STRIPS; i++) known[i] = i % 17 != 3;
  for (int i = 0; i < 2 * CORNERS; i++) corners[i] = BOX[i % 8] + number();
  for (int i = 0; i < SCANS * OBJECTS; i++) present[i] = i % 7 != 5;
  for (int i = 0; i < SCANS * POSES; i++) poses[i] = i % 3 == 0 ? 15.0 + 30.0 * (i % POSES / 3) + number() : i % 3 == 1 ? 30.0 : number();
  for (int i = 0; i < 2 * SCANS * POSES; i++) {
    starts[i] = expected[i] = poses[i / (2 * POSES) * POSES + i % POSES] + 0.5 * number();
    weight[i] = 0.1;
  }
  for (int which = 0; which < 2; which++) {
    Scans scans = {SCANS, STRIPS, 2, x_mm, k, gap_mm, 0.004, 1.0, LENGTH, {0.5, 0.0}, 0.5, which ? 0.02 : 0.0};
    Loss loss = {which ? 0.5 : 0.0, which ? 3.0 : 0.0, 0.05};
    tacstrip_hull_equations(&scans, &loss, known, OBJECTS, counts, corners, present, poses, pose, mixed, shape, pose_slope,
                            shape_slope, costs);
    show("hull poses", pose, sizeof pose);
    show("hull mixed", mixed, sizeof mixed);
    show("hull shape", shape, sizeof shape);
    tacstrip_hull_poses(&scans, &loss, known, OBJECTS, counts, corners, starts, expected, weight, 2, 4, costs);
    show("hull starts", starts, sizeof starts);
    show("hull costs", costs, sizeof costs);
  }
}

/* Scans of drawn shapes, and of given contacts: float and double, hard and soft, errors of both kinds. */
static void batches(void) {
  enum { SCANS = 40, MOST = 3, CORNERS = 7 };
  static double out[4][SCANS * STRIPS], vertices[SCANS * MOST * CORNERS * 2], pose[SCANS * MOST * 3], axes[SCANS * MOST * 2];
  static signed char kind[SCANS * MOST], corners[SCANS * MOST];
  for (int which = 0; which < 8; which++) {
    Int strips = which % 3 == 2 ? 5 : STRIPS;
    BatchSensor sensor = {strips, which == 5 ? 1 : 2, which % 2, 1.0, LENGTH, {0.5, 0.0}, 0.5, which & 4 ? 1.0 : 0.0,
                          which & 2 ? 0.0 : 4095.0};
    ShapeLaws laws = {0.5, 0.7, {3, CORNERS}, {1, strips > 5 ? MOST : 1}, which & 1 ? 4 : 1, 1, {1.0, strips > 5 ? 20.0 : 4.0},
                      {0.4, 1.0}, {-3.0, 3.0}, {0.0, (double)strips}, {0.0, LENGTH}, 0.6, 1.0, 0.5, 1.0};
    BatchErrors errors = {{7, 8}, {0.004, which & 1 ? 0.001 : 0.0}, which & 2 ? 0.002 : 0.0};
    BatchResult result = {{out[0], out[1]}, out[2], out[3], vertices, pose, axes, kind, corners};
    unsigned long long bytes = (unsigned long long)(SCANS * strips) * (which % 2 ? sizeof(float) : sizeof(double));
    unsigned long long objects = SCANS * (unsigned long long)laws.objects[1];
    Int bad = tacstrip_batch(&sensor, &laws, &errors, 3, SCANS, 0, 0, &result, workspace);
    show("bad", &bad, sizeof bad);
    for (int i = sensor.signatures < 2; i < 4; i++) show("batch", out[i == 1 && sensor.signatures < 2 ? 0 : i], bytes);
    show("kinds", kind, objects);
    show("vertices", vertices, objects * CORNERS * 2 * (which % 2 ? sizeof(float) : sizeof(double)));
    if (which % 2) continue;
    static double l[SCANS * STRIPS], u[SCANS * STRIPS];
    for (int i = 0; i < SCANS * strips; i++) l[i] = out[2][i], u[i] = out[3][i];
    result.l = result.u = result.kind = 0;
    tacstrip_batch(&sensor, 0, &errors, 3, SCANS, l, u, &result, workspace);
    show("given", out[0], bytes);
  }
}

/* A box and a triangle under two crossed layers of which each reads a quadrilateral, hard and soft. */
static void scenes(void) {
  enum { CORNERS = 7 };
  static unsigned char touched[STRIPS];
  static double weight[2 * STRIPS], matrix[4 * CORNERS * CORNERS], gradient[2 * CORNERS];
  double corners[2 * CORNERS] = {20.0, 20.0, 50.0, 18.0, 52.0, 45.0, 22.0, 40.0, 60.0, 20.0, 80.0, 25.0, 70.0, 45.0};
  Int sizes[2] = {4, 3};
  measure(0.004);
  for (int i = 0; i < STRIPS; i++) touched[i] = i % 31 != 30;
  for (int i = 0; i < 2 * STRIPS; i++) weight[i] = touched[i % STRIPS] / (0.004 * 0.004);
  for (int which = 0; which < 2; which++) {
    double lam = which ? 1.0 : 0.0;
    CrossedLayer layers[2] = {
        {STRIPS, 2, x_mm, readings, weight, touched, 1.0, LENGTH, {0.5, 0.0}, 0.5, lam, {1.0, 0.0, 0.0, 1.0}, {0.0, 0.0}},
        {STRIPS, 2, x_mm, readings, weight, touched, 1.0, LENGTH, {0.5, 0.0}, 0.5, lam, {0.0, 1.0, -1.0, 0.0}, {90.0, 0.0}}};
    double cost = tacstrip_refine_scene(layers, 2, sizes, 2, which ? 1.0 : 0.0, which ? 4.0 : 0.0, 10, 1e-3, 6.0, corners,
                                        matrix, gradient, workspace);
    show("scene", corners, sizeof corners);
    show("scene cost", &cost, sizeof cost);
    show("scene matrix", matrix, sizeof matrix);
    show("scene gradient", gradient, sizeof gradient);
  }
}

int main(void) {
  int version = tacstrip_core_version();
  show("version", &version, sizeof version);
  chaos();
  runs();
  bounded();
  rigid();
  paths_and_chains();
  reach();
  hulls();
  batches();
  scenes();
  return 0;
}

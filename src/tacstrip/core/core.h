/* The compiled core: what every exported function takes.

   C99 without the standard library but for sqrt, so that Tiny C builds it too. Nothing is kept between calls and
   nothing is locked: any number of threads may call at once, each with results and workspace of its own.

   Sums run in LANES fixed lanes and are joined in a fixed order, a * b + c is never contracted, and exp, tanh, log
   and arctan are our own: every compiler and every CPU gives the same bits. Build with -ffp-contract=off and never with
   -ffast-math. With -DTACSTRIP_DEBUG sizes are checked, and a wrong one stops the program.

   Units: x counts from 0 to 1 over the run of strips, y from 0 to 1 over the strip, readings are over Vref.
   Every core/<name>.py calls core/<name>.c, and has the same as readable NumPy; that of bounded, feasible_set and
   outlines is in reconstruction/set_membership/, that of run in reconstruction/polygon/. */

#ifndef TACSTRIP_CORE_H
#define TACSTRIP_CORE_H

#define TACSTRIP_VERSION 17 /* goes up whenever a function or a struct of this file changes */

#define MAX_VERTICES 16        /* interior vertices of a polygon */
#define END_ENTRIES 6          /* entries of theta before the first vertex */
#define SIZE (END_ENTRIES + 2 * MAX_VERTICES) /* entries of theta */
#define TRIED 3                /* places of one more vertex that a search tries */
#define COARSEST 200           /* strips that a search has left after averaging, at most */
#define SEARCH_WORKSPACE 3613  /* doubles that a search works in: 5 COARSEST, and 13 for each strip and one more */

#define NEARLY_ALL 0.95        /* of outlines that are drawn */

#define KNOTS 20               /* points of one chain of a sampled outline, both ends included */
#define MOST_CORNERS 26        /* vertices of a sampled outline */
#define HOTTEST 6              /* temperatures of a sampler */
#define REGULAR_STRIPS 32      /* that readings are averaged to, for regular outlines */
#define REGULAR_KINDS 7        /* of regular outlines */
#define REGULAR_NUMBERS 8      /* that make one */
#define REGULAR_VALUES 3       /* of one: log prior, half chi square, the lowest point over the strip */
#define SHAPE_CORNERS 16       /* of a drawn polygon */
#define SHAPE_OBJECTS 8        /* of a drawn scene */
#define RIGID_CORNERS 64       /* corners of an outline that keeps its shape, at most; 19 in a descent */
#define HULL_OBJECTS 8         /* objects on the same strips, at most */
#define SOLID_FRAME 15         /* numbers of an object: three axes, a place, three of its shape */

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef long long Int;

/* Readings of n neighbouring strips, of one signature or two. */
typedef struct {
  Int n, signatures;
  const double *x;      /* centre lines (n,), ascending */
  const double *k;      /* readings (signatures, n), finite */
  const double *weight; /* 1 / sigma^2 (signatures, n); 0 leaves a reading out */
  double pitch;         /* of the strips, in units of x */
  double share[2];      /* of the closed form: c_u of a contact without width, per signature */
  double narrow;        /* 1 - a */
  double lam;           /* decay length of the contact resistance over the strip length; 0: ideal contact */
} Problem;

/* An x-monotone polygon: theta = x_left, l_left, u_left, x_right, l_right, u_right, then x and y of each interior
   vertex, ascending in x. A pointed end has one height: its u follows its l. */
typedef struct {
  Int m;           /* interior vertices */
  Int vertical[2]; /* whether the left and the right end are vertical edges, 0 or 1 */
  Int upper[MAX_VERTICES]; /* whether a vertex is on the upper chain, 0 or 1 */
  double theta[SIZE];
  double cost;  /* squared residuals over sigma^2, and what the prior of the ends' x adds */
  double score; /* the criterion that counts are compared by */
} Polygon;

/* An x-monotone polygon as two chains of points, x ascending; both begin and end on one x. Heights beyond 0 and 1 mean that
   the contact passes over the end of the strips. */
typedef struct {
  Int count[2]; /* points of the lower and the upper chain, 2 to KNOTS */
  double x[2][KNOTS], y[2][KNOTS];
} Outline;

/* Where regular outlines may lie. */
typedef struct {
  double window[4]; /* the left end's x lies from the first to the second, the right end's from the third to the fourth */
  double aspect;    /* width of x from 0 to 1 over the length of the strips */
  Int borders, border[4]; /* those that one may lie over, of: first strip 0, last strip 1, ground end 2, other end 3 */
} RegularPlace;

/* What is known of an outline without readings. Densities are logs, of outlines whose heights are uniform. */
typedef struct {
  double window[4];   /* the left end's x lies from the first to the second, the right end's from the third to the fourth */
  double ends[4];     /* of pointed ends, an upright left one, an upright right one, and both */
  double reflex;      /* of a corner that turns inwards; -inf: there is none */
  double finest;      /* -log of the finest step, over the coarsest */
  double vertices[3][MOST_CORNERS + 1]; /* of so many vertices, with none, one or two upright ends */
  double area, area_sigma;           /* mean and standard deviation in units of x and y; sigma 0: not known */
  double sigma[2];    /* sigma over that of the weights is log-uniform between these; equal: it is known */
} OutlinePrior;
/* Readings of one object, scan by scan, lengths in mm. */
typedef struct {
  Int scans, strips, signatures;
  const double *x; /* centre lines (strips,), ascending */
  const double *k; /* readings (scans, signatures, strips), NaN where there is none */
  const double *gap; /* from each strip to the next one that is read, left and right (2, strips); infinite: there is none */
  double sigma;    /* of a reading */
  double pitch, length;
  double share[2], narrow, lam; /* as in Problem */
} Scans;

/* What one layer of crossed ones read; lengths in mm. */
typedef struct {
  Int n, signatures;
  const double *x;      /* centre lines in the layer (n,), ascending */
  const double *k;      /* readings (signatures, n), finite */
  const double *weight; /* 1 / sigma^2 (signatures, n); 0 leaves a reading out */
  const unsigned char *touched; /* which strips are touched (n,), 0 or 1 */
  double pitch, length;
  double share[2], narrow, lam; /* as in Problem */
  double rotation[4], origin[2]; /* directions of the layer in the whole (2, 2), and where its x = 0, y = 0 lies there */
} CrossedLayer;

/* How far readings may lie from what an outline makes. */
typedef struct {
  double tolerance; /* of edges, across them [mm]; adds to sigma */
  double cauchy;    /* scale of Cauchy's loss, in sigmas; 0: least squares */
  double end;       /* deviation of an end corner from the gap between strips that it lies in [mm] */
} Loss;

/* What is known of corners (N, 2) beside the scans: (c - about)' information (c - about) - 2 slope' (c - about). */
typedef struct {
  const double *information, *slope, *about; /* (2 N, 2 N), (2 N,), (2 N,) */
} CornerPrior;

/* Corners (count, 2) that are a linear function of some numbers, at most 2 count: each of their entries is one of these,
   times a weight; and what is known of the numbers: they cost v' prior v. */
typedef struct {
  Int count, numbers;
  const Int *which;             /* (2 count,) */
  const double *weight, *prior; /* (2 count,), (numbers, numbers) */
} OutlineBy;

/* A fit of a run of strips. */
typedef struct {
  Int count, best; /* polygons that were found, 0 where the readings are too few, and the chosen one's place */
  Int equal;       /* how many counts the criterion can hardly tell from the best */
  double sigma;    /* of a reading: as given, or what the residuals say [Vref] */
  double advantage; /* how much better the criterion of an ellipse is; -inf where none was fitted */
  double ellipse_cost, ellipse[5], information[25]; /* as fit_ellipse has them */
  double squares, pairs; /* sums of the residuals' squares, and of neighbouring ones' products */
  /* Of the chosen polygon: whether a corner turns inwards, whether the covariance is written, its greatest height [mm], and
     the share of its area that NEARLY_ALL outlines sweep which the covariance allows; then its lower and upper chain, as
     `chains` has them, and the covariance (2 V, 2 V), as vertex_covariance has it. */
  Int inward, told;
  double height, swept, points[2 * MAX_VERTICES + 8], covariance[(SIZE + 2) * (SIZE + 2)];
  Polygon found[MAX_VERTICES + 1]; /* ascending in m */
} Run;

/* The edges of an outline but its vertical ones, as lines: lower chain, then upper, each left to right. Heights (2 count,)
   say where they lie. */
typedef struct {
  Int count, lower; /* of both chains, and of the lower one */
  Int vertical[2];  /* whether the left and the right end are vertical edges, 0 or 1 */
  const double *reach; /* two abscissae per line (count, 2) [mm] */
  const Int *turns;    /* per kink, lower chain first, 1 where the slope rises and -1 where it falls (count - 2,) */
} Lines;

/* What the readings of n neighbouring strips, of one signature or two, allow. */
typedef struct {
  Int n, signatures;
  const double *x;          /* centre lines (n,) [mm], ascending */
  const double *low, *high; /* bounds (signatures, n) [Vref]; NaN leaves a reading out */
  double share[2];          /* as in Problem */
  double narrow;            /* 1 - a */
  double length, lam;       /* of the strips, and the decay length of the contact resistance [mm] */
  double fade;              /* width at either bound [Vref] over which a reading becomes less likely */
  double windows[4];        /* where the left and the right end of the contact lie [mm] */
} Band;

/* A sensor as batches of scans take it, lengths in mm. */
typedef struct {
  Int strips, signatures, single; /* single: results are float, else double */
  double pitch, length, share[2], narrow; /* share, narrow as in Problem */
  double lam; /* decay length of the contact resistance [mm] */
  double top; /* greatest code of the converter; 0: none */
} BatchSensor;

/* Errors of every reading by itself: half-widths of uniform ones, and the deviation of a normal one [Vref]. */
typedef struct {
  unsigned int key[2];
  double uniform[2], sigma;
} BatchErrors;

/* How shapes are drawn; pairs are the least and the greatest. */
typedef struct {
  double polygons, circles; /* share of polygons, and of these and circles; the rest are ellipses */
  Int corners[2], objects[2], frames, apart; /* up to SHAPE_CORNERS and SHAPE_OBJECTS; scans of a scene; kept apart in x */
  double size[2], aspect[2], turn[2], x[2], y[2]; /* diameter, short axis over long, angle, centres [mm, rad] */
  double irregularity, gap, travel, spin; /* of corners' angles, 0 to 1; in x; of the way; greatest turn on it */
} ShapeLaws;

/* Where a batch is written: readings, l and u (scans, strips), NaN where nothing touches; l may be null. Of drawn shapes
   kind and corners (scans, objects), pose (scans, objects, 3): x, y, angle; axes (scans, objects, 2): half the long and the
   short one; vertices (scans, objects, corners, 2); kind may be null, and then the others are not written. */
typedef struct {
  void *readings[2], *l, *u, *vertices, *pose, *axes;
  signed char *kind, *corners;
} BatchResult;

/* TACSTRIP_VERSION; a loader refuses a library of another version. */
EXPORTED int tacstrip_core_version(void);

/* Write J'WJ (size, size) and J'Wr (size,) by theta, size = END_ENTRIES + 2 m, and return the cost; with `prior`, what the
   touched strips say of the x of pointed ends is in all three. */
EXPORTED double tacstrip_normal_equations(const Problem *problem, const Polygon *polygon, Int prior, double *matrix,
                                          double *gradient);

/* Write measured minus fitted readings over sigma (signatures, n); left and right of the polygon the ends count. */
EXPORTED void tacstrip_residuals(const Problem *problem, const Polygon *polygon, double *residuals);

/* Write the covariance (2 V, 2 V) [mm^2] of the polygon's V vertices in mm, counter-clockwise from the left end's lower
   one: x, y of each. What the readings tell, and that the x of the ends and of both vertices of an edge that crosses one
   strip or none is known to within a pitch. With `loose` also of one that crosses two or three, where the edges beside it
   explain as many of them that one or none is left. x = 0 to 1 is width_mm from origin_mm on, y = 1 is length_mm; x_mm (strips,)
   [mm] are the centre lines of all strips of the sensor. Returns 0, and writes nothing of use, where a direction is
   hardly told: that needs a decomposition. */
EXPORTED Int tacstrip_vertex_covariance(const Problem *problem, const Polygon *polygon, Int loose, double origin_mm,
                                        double width_mm, double length_mm, const double *x_mm, Int strips,
                                        double *covariance);

/* Improve a polygon in place by Levenberg-Marquardt, and return its cost. It ends after `steps` steps, when one gains
   less than `least`, or when it is not on its way to cost less than `wanted`. */
EXPORTED double tacstrip_descend(const Problem *problem, Polygon *polygon, Int steps, double least, double wanted);

/* The least-squares polygon near a given one, in place. An end whose edge closed becomes a point. */
EXPORTED void tacstrip_refine(const Problem *problem, Polygon *polygon);

/* Write the chains of a polygon, lower (l + 2, 2) with l interior vertices and upper (m - l + 2, 2), x as width x + origin and
   y as length y; an upper end is no lower than the lower one, and with `apart` neither chain passes the other. */
EXPORTED void tacstrip_chains(const Polygon *polygon, double origin, double width, double length, Int apart, double *lower,
                              double *upper);

/* Write polygons of one vertex more to starts (TRIED,), where the score test gains most, and return how many. n is at
   most COARSEST. workspace (SEARCH_WORKSPACE,). */
EXPORTED Int tacstrip_places(const Problem *problem, const Polygon *polygon, Int convex, Polygon *starts,
                             double *workspace);

/* The best polygon of each count of vertices that the readings may hold.
   sigma_known: whether the weights are 1 / sigma^2, else only roughly so. max_vertices: interior vertices at most, up
   to MAX_VERTICES.
   n_vertices: vertices in all where that is known, else 0. every: all counts, not only the best one's neighbours.
   found (MAX_VERTICES + 1,): those fitted to all strips, ascending in m. picked (2,): the best one's place in found, and how
   many counts, of all that were searched, the criterion can hardly tell from the best.
   workspace (SEARCH_WORKSPACE,). Returns how many polygons were found. */
EXPORTED Int tacstrip_fit_counts(const Problem *problem, Int sigma_known, Int max_vertices, Int n_vertices, Int every,
                                 Polygon *found, Int *picked, double *workspace);

/* Fit an ellipse to the readings that a polygon was found for; where `start` is null, from the ellipse that is given.
   Writes ellipse (5,): left end, right end, height of the
   middle, rise from there to the right end, half-height; and J'WJ (5, 5), the prior of the ends' x included. Returns the
   cost, and ends early when it is not on its way to cost less than `wanted`. */
EXPORTED double tacstrip_fit_ellipse(const Problem *problem, const Polygon *start, double wanted, double *ellipse,
                                     double *information);

/* Improve the corners (2 M,) [mm] of polygons, sizes (polygons,), in place by Levenberg-Marquardt on what crossed layers read,
   and return the cost; matrix (2 M, 2 M) and gradient (2 M,) are J'WJ and J'Wr there. With 0 steps only that.
   soft: by so much [mm] more uncertain readings count; reach: deviations after which a residual counts ever less, 0: never;
   longest: a step of a corner at most [mm]. workspace (8 M + 8 M^2,). */
EXPORTED double tacstrip_refine_scene(const CrossedLayer *layers, Int count, const Int *sizes, Int polygons, double soft,
                                      double reach, Int steps, double damping, double longest, double *corners,
                                      double *matrix, double *gradient, double *workspace);

/* Mark the readings k (n,) that stand out from their neighbours in out (n,), 0 or 1; NaN counts as out.
   workspace (3 n,). */
EXPORTED void tacstrip_spikes(const double *k, Int n, double sigma, unsigned char *out, double *workspace);

/* Mark the residuals over sigma (signatures, n) that lie alone, far off, in out (signatures, n); none where they are
   many. Returns how many. */
EXPORTED Int tacstrip_isolated_outliers(const double *residuals, Int signatures, Int n, unsigned char *out);

/* One of the runs that fit_runs takes, and where it leaves what. problem.k are the readings as measured, of which those
   that are not finite or far outside 0..1 are left out, as outliers are; its weights are not read. sigma [Vref]: of a
   reading, or 0 where it is estimated. Written are the fit, and what it was made of: k and weight as in Problem, residuals
   over sigma, each (signatures, n), and the readings that were there but not used, excluded (signatures, n), 0 or 1.
   mm: where x = 0 lies, and the extent of x and y from 0 to 1; x_mm (strips,): centre lines of all strips of the sensor. */
typedef struct {
  Problem problem;
  double sigma, mm[3];
  const double *x_mm;
  Int strips;
  Run *run;
  double *k, *weight, *residuals;
  unsigned char *excluded;
} RunTask;

/* Whole runs (count,) from readings to fits, each by itself. A sigma that is estimated is `step` at least. max_vertices and
   n_vertices as for fit_counts. normal (SIZE + 3,): for polygons of so many coordinates where there are such, normal draws
   (draws, coordinates). workspace (SEARCH_WORKSPACE + (4 + 2 signatures) n,) for the longest of them, and at least
   ((SIZE + 2) (SIZE + 3 + draws) + draws + 1,). */
EXPORTED void tacstrip_fit_runs(const RunTask *tasks, Int count, double step, Int max_vertices, Int n_vertices,
                                const double *const *normal, Int draws, double *workspace);

/* Write the outlines within the band whose kinks lie in their zones (count - 2, 2) [mm], and turn as the lines do, as rows
   over the heights, and pairs of rows of which one holds: a (size, rows), b and edge (rows,), the slack over which
   an error becomes less likely; pair_a (size, 2, pairs), pair_b (2, pairs), pair_edge (pairs,); size is 2 count.
   widths (3, n) [mm]: length of the contact on each strip, expected, least and greatest. counts (2,): rows and pairs. With
   `a` null only they are written, and with it they are taken: call it twice. workspace (14 n,), kept between the two. */
EXPORTED void tacstrip_feasible_set(const Lines *lines, const Band *band, const double *zones, const double *widths,
                                    Int *counts, double *a, double *b, double *edge, double *pair_a, double *pair_b,
                                    double *pair_edge, double *workspace);

/* Write points (count, size) of such a set as chains lower (count, M, 2) and upper (count, N, 2) [mm], each as often as
   its vertices' places have room in the set, and held to 0 to length [mm]. windows (4,) [mm] as in Band; vertical_x
   (count, 2) [mm]: x of vertical ends. workspace (count (2 M + 2 N + 1),). Returns 0 where that is too unlike the room
   in heights for points drawn by heights to tell. */
EXPORTED Int tacstrip_outlines(const Lines *lines, const double *windows, double length, const double *points,
                               const double *vertical_x, Int count, double *lower, double *upper, double *workspace);

/* How such outlines scatter about their mean (vertices, 2) [mm], whose vertices lower_at (lowers,) and upper_at (uppers,) are
   the chains'; where one is of both, their middle counts. covariance (2 vertices, 2 vertices) [mm^2]; radii (vertices,): squared
   Mahalanobis distance within which 95 % have each vertex; deviations (4,): within 1.96 of them 95 % have area [mm^2],
   centroid x, y [mm] and orientation [rad]. workspace ((2 vertices + 6) (count + 3) + 2 vertices,). */
EXPORTED void tacstrip_scatter(const double *lower, const double *upper, const Int *lower_at, const Int *upper_at,
                               Int lowers, Int uppers, const double *mean, Int vertices, Int count, double *covariance,
                               double *radii, double *deviations, double *workspace);

/* All that the band leaves of a least-squares outline: chains lower (lowers, 2) and upper (uppers, 2) [mm], and the
   covariance of its vertices [mm^2]. Draws points (sweeps, size), size = 2 (lowers + uppers - 2), writes the outlines' mean,
   both chains one after the other (lowers + uppers, 2), and as of `scatter` how they scatter about it. pitch [mm] of the
   strips; shuffled (sweeps, 2): both columns 0 to sweeps - 1 in some order, that of vertical ends.
   workspace (room,). Returns 2; 1 where points are drawn and tell no mean; 0 where none are found in the first part of
   the set: look on step by step; negative where so much room is needed. */
EXPORTED Int tacstrip_bounded(const Band *band, double pitch, const double *lower, Int lowers, const double *upper,
                              Int uppers, const double *covariance, const double *shuffled, Int sweeps, double *points,
                              double *mean, double *scatter, double *radii, double *deviations, double *workspace,
                              Int room);

/* Polytopes: a z <= b in z (size,), size at most SIZE. The rows lie beside each other: a (size, rows), b (rows,). */

/* The least of form z (size,) where a z <= slack; -inf where none was found. By an active set: downhill
   along the rows that are met, which are given up where their multiplier is negative. at (size,) is a point inside and
   active (size,) its met rows, -1 for none; both are moved to the lowest point. size is at most SIZE + 1.
   workspace (2 size^2 + 2 size + 3 rows,). */
EXPORTED double tacstrip_lowest(const double *form, const double *a, const double *slack, double *at, Int *active,
                                Int rows, Int size, double *workspace);

/* Move `at` (size,) to where the row that is broken most is broken least, by linear programs over the rows that it takes
   to know. It ends at the first point inside, and looks no deeper than `scale`, in units of b. outside (1,): how far
   `at` is outside at most, negative inside. Returns whether there is no inside, or one thinner than rounding.
   workspace (3 rows + (size + 5) (used + 1) + 2 (size + 1) (size + 2),), used the lesser of rows and 30 size. */
EXPORTED Int tacstrip_minimax(const double *a, const double *b, double *at, double scale, Int rows, Int size,
                              double *outside, double *workspace);

/* Move `at` (size,) from a point strictly inside to where the product of the slacks of the nearest rows is largest, and
   write the curvature (size, size) of that barrier. workspace (4 rows + 64 size + size (near + 4),), near the lesser of
   rows and 24 size. */
EXPORTED void tacstrip_analytic_centre(const double *a, const double *b, double *at, double *curvature, Int rows,
                                       Int size, double *workspace);

/* The same of a convex part of a set where of each of some pairs of rows, pair_a (size, 2, pairs) and pair_b (2, pairs),
   one holds at least: of each the one that holds best at `at` is kept, the minimax found, and so on while that falls.
   scale is minimax's. Returns the rounds it took, negative where no part was found in `most`.
   workspace (total (size + 1) + 2 pairs,) with total = rows + pairs, and that of minimax or of the centre of total
   rows, whichever is more. */
EXPORTED Int tacstrip_feasible_part(const double *a, const double *b, const double *pair_a, const double *pair_b,
                                    double *at, double *curvature, double scale, Int most, Int rows, Int pairs,
                                    Int size, double *workspace);

/* Walk through such a set from `middle` (size,), along one coordinate after the other to a random place between the
   bounds, in coordinates in which `curvature` (size, size) is 1. out (sweeps, size) is the way; the same for the same
   set. edges (rows,) and pair_edges (pairs,): over how much slack an error becomes less likely.
   workspace (208 size + most (size + 4),), most the larger of rows and 2 pairs. Returns 0, and writes nothing, where the
   curvature is not positive definite. */
EXPORTED Int tacstrip_hit_and_run(const double *a, const double *b, const double *edges, const double *pair_a,
                                  const double *pair_b, const double *pair_edges, const double *middle,
                                  const double *curvature, double *out, Int sweeps, Int rows, Int pairs, Int size,
                                  double *workspace);

/* Log prior, half chi square and lowest point (count, 3) of regular outlines by kind (count,), over (count,), whether over
   a border, and numbers (count, 8). One signature of REGULAR_STRIPS strips at most. */
EXPORTED void tacstrip_regular_values(const Problem *problem, const RegularPlace *place, const Int *kind, const Int *over,
                                      const double *numbers, Int count, double *values);

/* Particles of each kind, inside and over a border: numbers (14, particles, 8) and values (14, particles, 3), and the log
   evidence (14,); where it is not done (14,) what it had reached when the kind was given up. `best`: log evidence that
   others have. workspace (48 particles,). */
EXPORTED void tacstrip_sample_regular(const Problem *problem, const RegularPlace *place, Int particles, double best, Int seed,
                                      double *numbers, double *values, double *evidence, Int *done,
                                      double *workspace);

/* Draw outlines as often as readings and prior make them likely, by Markov chains at some temperatures, 1 first, that
   exchange states. problem->n is at most COARSEST. starts (temperatures,): where each chain begins, allowed by the prior.
   heat (temperatures,), at most HOTTEST. Each chain does `steps` steps; after a quarter of them samples (kept,) are taken
   of the first, and values (kept, 3): squared residuals, log prior, sigma. The same seed gives the same samples. Returns
   how many were kept; 0 where a start is not allowed. */
EXPORTED Int tacstrip_sample_outlines(const Problem *problem, const OutlinePrior *prior, const Outline *starts,
                                      const double *heat, Int temperatures, Int steps, Int kept, Int seed,
                                      Outline *samples, double *values);

/* Write l and u of outlines (count,) at x (places,), ascending, held to 0 and 1, to ends (count, 2, places); both are 0
   outside. */
EXPORTED void tacstrip_outline_ends(const Outline *outlines, Int count, const double *x, Int places, double *ends);

/* The normal equations of an outline's corners (count, 2) [mm], in a frame of its own, and its poses (scans, 3): x, y
   [mm] and angle. Writes J'WJ in blocks, pose (scans, 3, 3), mixed (scans, 3, 2 count) and shape (2 count, 2 count), J'Wr as
   pose_slope (scans, 3) and shape_slope (2 count,), and what each scan costs, costs (scans,). Returns the total. */
EXPORTED double tacstrip_rigid_equations(const Scans *scans, const Loss *loss, const double *corners, Int count,
                                         const double *poses, double *pose, double *mixed, double *shape,
                                         double *pose_slope, double *shape_slope, double *costs);

/* Write what strips `first` to `last` - 1 read of corners (count, 2) [mm] at poses (scans, 3), model (scans, signatures, strips),
   and how that changes with pose and corners, rows (scans, signatures, strips, 3 + 2 count); the other strips stay as they are. */
EXPORTED void tacstrip_rigid_linearised(const Scans *scans, const double *corners, Int count, const double *poses, Int first,
                                        Int last, double *model, double *rows);

/* Move poses (scans, starts, 3) downhill, each by itself, and write what they cost, costs (scans, starts). */
EXPORTED void tacstrip_rigid_poses(const Scans *scans, const Loss *loss, const double *corners, Int count, double *poses,
                                   Int starts, Int steps, double *costs);

/* Metropolis' walk over corners (count, 2) and poses (scans, 3), which cost `costs` (scans,): each step tries to move the
   corners by moves (steps, count, 2) and with them the poses by -follow (scans, 3, 2 count) times that, then each pose by itself
   by pose_steps (steps, rounds, scans, 3). A trial is taken where it costs less than what it would take the place of and
   above (steps,), pose_above (steps, rounds, scans). Writes the corners after each step, walked (steps, count, 2); corners,
   poses and costs are those of the last. workspace (2 count + 4 scans,). */
EXPORTED void tacstrip_rigid_walk(const Scans *scans, const Loss *loss, double *corners, Int count, double *poses,
                                  double *costs, const double *follow, const double *moves, const double *above,
                                  Int steps, const double *pose_steps, const double *pose_above, Int rounds,
                                  double *walked, double *workspace);

/* Move corners (count, 2), at most SIZE / 2, and poses (scans, 3) downhill together until a step gains less than `enough`.
   Without a prior, null, the pose in the middle stays; a prior holds the frame too. Writes costs (scans,) and returns the
   total, with the prior's. workspace (scans (31 + 12 count) + 8 count^2 + 8 count,). */
EXPORTED double tacstrip_rigid_descend(const Scans *scans, const Loss *loss, const CornerPrior *prior, double *corners,
                                       Int count, double *poses, Int steps, double enough, double *costs,
                                       double *workspace);

/* Move the numbers of an outline, outline (numbers,), and a path, at_knots (knots, 3), downhill together until a step gains less
   than its share `enough` of the cost, or for so many steps. Poses are the path at basis (scans, knots); where that is null
   each scan has a knot, and there are at most SIZE numbers. No number gets below `least` of their mean; negative: it
   may. Writes costs (scans,) and returns the total, with the prior's. C = 2 count, M = 3 knots + numbers and, with a
   basis, A = M, else 0: workspace (scans (28 + 6 C + 3 numbers) + 2 C^2 + 3 C + numbers^2 + numbers + 2 M + 2 A^2 + A,). */
EXPORTED double tacstrip_rigid_path(const Scans *scans, const Loss *loss, const OutlineBy *by, double *outline,
                                    const double *basis, Int knots, double *at_knots, Int steps, double enough,
                                    double least, double *costs, double *workspace);

/* Write the convex function (sign 1; -1: concave) nearest to y (n,) at x (n,), ascending, to fitted (n,), by least squares with
   weights (n,), and return its kinks. Here and in the next four: places (2 n + 2,), workspace (9 n + 7,). */
EXPORTED Int tacstrip_convex_regression(const double *x, const double *y, const double *weight, Int n, double sign,
                                        double *fitted, Int *places, double *workspace);

/* Write where the straight lines begin that explain y best, with the end of all, to begins (n + 1,), and their cost; return
   how many. Each line costs `price`, of one strip `single` less. */
EXPORTED Int tacstrip_best_lines(const double *x, const double *y, const double *weight, Int n, double price,
                                 double single, Int *begins, double *cost, Int *places, double *workspace);

/* Write where convex stretches begin, with the end of all, to cuts (n + 1,), and what each cut between two of them gains to
   gains (n,); return how many stretches. */
EXPORTED Int tacstrip_convex_cuts(const double *x, const double *y, const double *weight, Int n, Int *cuts, double *gains,
                                  Int *places, double *workspace);

/* Write the convex polyline through two strips or more: borders (lines + 1,) of its lines, from half a pitch before the first
   strip to half a pitch after the last, lines (lines, 5): height at the middle, slope, middle, and variances of height and
   slope, and what the nearest convex function leaves over; return how many lines, at most n. */
EXPORTED Int tacstrip_convex_polyline(const double *x, const double *y, const double *weight, Int n, double pitch,
                                      double *borders, double *lines, double *chi_square, Int *places,
                                      double *workspace);

/* Write which strips belong to their stretch wherever the readings would allow the cuts (count + 1,), the ends among them, to
   sure (n,): 1 or 0; return how many do. */
EXPORTED Int tacstrip_sure_strips(const double *x, const double *y, const double *weight, Int n, const Int *cuts, Int count,
                                  Int *sure, Int *places, double *workspace);

/* Write the lower and the upper end of the convex hull of points (n, 2) at x (strips,), ascending, to ends (2, strips), NaN
   beside it. workspace (4 n,). */
EXPORTED void tacstrip_hull_ends(const double *points, Int n, const double *x, Int strips, double *ends, double *workspace);

/* Write up to where a convex body may reach that holds a ring (corners, 2), counter-clockwise, within edges (4,): left, right,
   bottom, top. It holds none of points (below + above + bodies, 2), nor a place straight below the first `below`, or above the
   next `above`. reached (640, 2), in the order of the angle as seen from the ring's middle, without corners that change it by
   `within` at most; returns how many. workspace (8 (below + above + bodies + 4),). */
EXPORTED Int tacstrip_convex_reach(const double *ring, Int corners, const double *points, Int below, Int above, Int bodies,
                                   const double *edges, double within, double *reached, double *workspace);

/* Write the areas (3,) of a convex polygon (corners, 2), counter-clockwise, of a ring (count, 2) that does not cross itself, and
   what both share; return 0 where the polygon is not convex. workspace (4 (corners + 3),). */
EXPORTED Int tacstrip_convex_overlap(const double *convex, Int corners, const double *ring, Int count, double *areas,
                                     double *workspace);

/* Move the vertices (count, 2) of a polygon by their covariance (2 count, 2 count) as normal (draws, 2 count) numbers say: off
   (draws, count, 2), and the area that its edges sweep at most, areas (draws,). A covariance may be singular.
   workspace (4 count^2 + 2 count + 1,). */
EXPORTED void tacstrip_swept_areas(const double *vertices, const double *covariance, Int count, const double *normal,
                                   Int draws, double *off, double *areas, double *workspace);

/* How deep n points of a skin lie in each of `count` objects, touch (count, n) [mm], by their frames (count, SOLID_FRAME).
   Kinds: 0 plane, 1 sphere, 2 cylinder (radius), 3 edge and 5 cone (sine and cosine of half the angle), 4 box (sides). points and
   normals are (3, n) of all or, own, (3, count, n); without normals depth is geometry alone, else a point that the object
   reaches under counts as a little deep. yields (count, n), or null: how far along the normal a skin of `thickness`
   yields, where it does not the depth. */
EXPORTED void tacstrip_solid_touch(Int kind, const double *frames, Int count, const double *points,
                                   const double *normals, Int own, Int n, double thickness, double *touch,
                                   double *yields);

/* How far one object must be moved on to touch each of points (3, n), gap (n,) [mm]; infinite where it never does, or the
   cosine of normals (3, n) with its way out is not above `steepest`. */
EXPORTED void tacstrip_solid_gap(Int kind, const double *frame, const double *points, const double *normals, Int n,
                                 double steepest, double *gap);

/* Sum over a patch what a grid (rows, columns) of the skin says: touch and yields of tacstrip_solid_touch, points and normals
   (3, rows, columns), and the sizes of cells, across (rows,) and up (columns - 1,). Along a row the depth is linear. sums (13,):
   area, it times place and normal, depth times -normal, and the moment of that. */
EXPORTED void tacstrip_patch_sums(const double *touch, const double *yields, const double *points, const double *normals,
                                  Int rows, Int columns, const double *across, const double *up, double *sums);

/* Simulate scans number first to first + scans - 1: of shapes drawn by laws, or where that is null of contacts from l to u
   (scans, strips) [mm]. Numbers depend on the key and the scan's number alone. Returns the place (scan, strip) of the first
   strip that a contact on metal shorts, -1 where there is none. workspace (14 strips + 512,). */
EXPORTED Int tacstrip_batch(const BatchSensor *sensor, const ShapeLaws *laws, const BatchErrors *errors, Int first,
                            Int scans, const double *l, const double *u, const BatchResult *out, double *workspace);

/* Write the hull l and u (contacts, strips) [mm] of areas, each with room for 4 more, NaN where nothing touches. points (P, 2)
   [mm] are the corners of closed rings (P,), the first one's last again; those of contact c are begin[c] to begin[c + 1] - 1. */
EXPORTED void tacstrip_footprint(const double *points, const Int *ring, const Int *begin, Int contacts, double pitch,
                                 Int strips, double *l, double *u);

/* The normal equations of several outlines on the same strips: corners (sum of counts, 2), one outline after the other, and
   poses (scans, objects, 3); present (scans, objects) leaves an object out where it is 0. known (scans, strips) is 0 where
   a strip without readings says nothing; elsewhere nothing touches it. Writes pose (scans, P, P), mixed (scans, P, C), shape
   (C, C), pose_slope (scans, P), shape_slope (C,) and costs (scans,), P = 3 objects and C all corners' numbers. Returns the total. */
EXPORTED double tacstrip_hull_equations(const Scans *scans, const Loss *loss, const double *known, Int objects,
                                        const Int *counts, const double *corners, const double *present,
                                        const double *poses, double *pose, double *mixed, double *shape,
                                        double *pose_slope, double *shape_slope, double *costs);

/* Move poses (scans, starts, objects, 3) downhill, those of a scan together, and write what they cost, costs (scans, starts),
   with what they are off from where they are expected, squared, times weight, both as poses. */
EXPORTED void tacstrip_hull_poses(const Scans *scans, const Loss *loss, const double *known, Int objects,
                                  const Int *counts, const double *corners, double *poses, const double *expected,
                                  const double *weight, Int starts, Int steps, double *costs);

#endif

/* What the core's files share among themselves: small helpers, and functions that are not exported. */

#ifndef TACSTRIP_INTERNAL_H
#define TACSTRIP_INTERNAL_H

#include "core.h"

#if defined(_WIN32) || defined(__TINYC__)
#define HIDDEN
#else
#define HIDDEN __attribute__((visibility("hidden")))
#endif

#define INFINITE (1.0 / 0.0)
#define LANES 4      /* of sums, see lanes.h */
#define LEAST_D 1e-3 /* of L: a metal sheet under a whole strip would divide by zero */

#ifdef TACSTRIP_DEBUG
void abort(void);
#define CHECK(condition) ((condition) ? (void)0 : abort())
#else
#define CHECK(condition) ((void)0)
#endif

double sqrt(double);

typedef double Matrix[SIZE][SIZE];

static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double magnitude(double v) { return v < 0.0 ? -v : v; }
static inline double clip(double v, double low, double high) { return smaller(larger(v, low), high); }

typedef union {
  double value;
  Int bits;
} Word;

static const double LN2_HIGH = 6.93147180369123816490e-01, LN2_LOW = 1.90821492927058770002e-10;

static const double LOG_SERIES[] = {1.0 / 23.0, 1.0 / 21.0, 1.0 / 19.0, 1.0 / 17.0, 1.0 / 15.0, 1.0 / 13.0,
                                    1.0 / 11.0, 1.0 / 9.0,  1.0 / 7.0,  1.0 / 5.0,  1.0 / 3.0,  1.0};

/* x = 2^k m with m about 1; log m = 2 artanh f, f = (m - 1) / (m + 1). x > 0. */
static inline double natural_log(double x) {
  Word word, power;
  word.value = x;
  power.bits = (Int)((unsigned long long)word.bits >> 52) | 0x4330000000000000LL; /* 2^52 and k + 1023 */
  word.bits = (word.bits & 0xfffffffffffffLL) | 0x3ff0000000000000LL;
  double m = word.value, k = power.value - 4503599627371519.0;
  int large = m > 1.4142135623730951;
  m = large ? m * 0.5 : m;
  k = large ? k + 1.0 : k;
  double f = (m - 1.0) / (m + 1.0), z = f * f, sum = LOG_SERIES[0];
  for (int i = 1; i < 12; i++) sum = sum * z + LOG_SERIES[i];
  return k * LN2_HIGH + (2.0 * f * sum + k * LN2_LOW);
}

/* Of a place in the one sequence of numbers from 0 to 1 (splitmix64). */
static inline double uniform_draw(unsigned long long place) {
  unsigned long long bits = (place + 1) * 0x9E3779B97F4A7C15ULL;
  bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ULL;
  bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBULL;
  bits ^= bits >> 31;
  return (double)(Int)(bits >> 11) * (1.0 / 9007199254740992.0);
}
/* Draws one after the other, from `place` on: uniform in 0..1, a whole number below n, a bell of variance 1. */
static inline double next_uniform(unsigned long long *place) { return uniform_draw((*place)++); }
static inline Int next_below(unsigned long long *place, Int n) {
  Int i = (Int)(next_uniform(place) * (double)n);
  return i < n ? i : n - 1;
}
static inline double next_bell(unsigned long long *place) {
  double sum = next_uniform(place);
  for (int i = 0; i < 3; i++) sum += next_uniform(place);
  return 1.7320508075688772 * (sum - 2.0);
}

/* mathematics.c */
HIDDEN double exponential(double x);        /* |x| < 700 */
HIDDEN double hyperbolic_tangent(double x); /* any x */
HIDDEN double arctangent(double x);         /* x >= 0 */
HIDDEN double sine(double x);               /* |x| < 1e6 */
HIDDEN double cosine(double x);

/* cholesky.c: the upper triangle of the leading n rows, U'U = a */
HIDDEN int factor(Matrix a, Int n); /* in place; 0 where a is not positive definite */
HIDDEN void solve(Matrix u, Int n, double *b);
HIDDEN void solve_upper(Matrix u, Int n, double *b); /* U b' = b */

/* cost.c */
typedef struct {
  double x, y, slope, run; /* one point, dy/dx, and 1 / extent in x */
} Line;
typedef struct {
  Int x, y; /* entries of theta */
} Knot;
HIDDEN Knot knot(const Polygon *p, Int vertex, int upper, int right); /* of a vertex, or where that is < 0 of an end */
HIDDEN Line edge(const double *theta, Knot a, Knot b);
HIDDEN Int first_from(const double *x, Int n, double at); /* the first strip whose x is not below `at` */
HIDDEN double normal_equations(const Problem *s, const Polygon *p, Matrix a, double *g);
HIDDEN double without_prior(const Problem *s, const Polygon *p, Matrix a, double *g);

/* Of one chain; left and right of the polygon as at its ends. */
HIDDEN double height_at(const Polygon *p, int upper, double x);
typedef struct {
  Int edges, first[MAX_VERTICES + 2]; /* edge e has the strips first[e] to first[e + 1] */
  Knot at[MAX_VERTICES + 2];
  Line line[MAX_VERTICES + 1];
} Chain;
HIDDEN void chain_of(const Problem *s, const Polygon *p, int upper, Chain *chain);
HIDDEN Int edge_of(const Chain *chain, Int strip, Int e); /* not before edge e */

/* search.c */
#define FLOOR 1e-7 /* of Vref: readings are never taken for more exact */
HIDDEN Int readings_of(const Problem *s); /* that count */
HIDDEN double sigma_of(const Problem *s); /* of the most certain reading */
/* What a vertex must gain in chi square to be believed: BIC's 2 ln n for its two numbers, and 4 for its place. */
HIDDEN double per_vertex_penalty(Int readings);
HIDDEN double complexity_penalty(Int readings, Int vertices, Int sigma_known);
HIDDEN double deviance(double cost, Int readings, double sigma, Int sigma_known);

/* polygon_fit.c: chains (count, 2), x ascending */
HIDDEN double interpolated(const double *points, Int count, double x); /* the height at x */
HIDDEN double greatest_height(const double *lower, Int low, const double *upper, Int high);

/* outlines.c. Write the chains of one point, (lower + 1, 2) and (count - lower + 1, 2), and return how much room in the
   vertices' places its heights have: the determinant of the vertices by the heights, but for a constant. */
HIDDEN double line_chains(const Lines *lines, const double *heights, const double *vertical_x, double *lower, double *upper);

/* ellipse.c */
HIDDEN void ellipse_residuals(const Problem *s, const double *p, double *residuals); /* as tacstrip_residuals */

/* descent.c */
HIDDEN Int free_entries(const Polygon *p, Int *free);
HIDDEN void sort_vertices(Polygon *p);
HIDDEN void move(const Polygon *p, const Int *free, Int n, const double *step, double pitch, double *trial);

/* polytope.c: rows beside each other, a (size, rows) */
HIDDEN double lane_product(const double *a, const double *b, Int n); /* in lanes; n is a multiple of LANES */
/* The value of which `count` are as large or larger; values (n,) are moved about. */
HIDDEN double threshold(double *values, Int n, Int count);
HIDDEN void row_products(const double *a, Int rows, Int size, const double *v, double *out); /* a' v, (rows,) */
HIDDEN void forward_rows(Matrix u, const double *a, Int stride, Int rows, Int size, double *out); /* U' out = a */
/* Mark the largest, of equal ones the first, in marked (n,) with 1, and return how many are marked. scratch (n,) */
HIDDEN Int mark_largest(const double *values, Int n, Int count, double *marked, double *scratch);

/* moves.c */
enum { FIRST, GROW, SHRINK };
HIDDEN int improve(const Problem *s, int kind, Polygon *best, Int m, int convex, double *workspace);

#endif

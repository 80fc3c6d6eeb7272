/* How many vertices the readings hold: the best polygon of each count, and the count with the best criterion.

   Counts grow until two past the best. Then every vertex is taken out in turn, and the shorter polygons grow again: a
   vertex that was right among few can be wrong among many. All this happens on averaged strips; the counts beside the
   best one are then fitted to all strips, and compared. */

#include "internal.h"

#define ROUGH 12          /* steps of a first descent on a stage */
#define ENOUGH 0.1        /* of chi square, the gain that ends it */
#define PAST 2            /* counts tried past the best */
#define COARSE 3e-4       /* of Vref: sigma that the search takes at least at first, */
#define FINER 30.0        /* and steps down from there */
#define HOPELESS 100.0    /* of chi square a reading: no polygon, so no finer stage */
#define FAR 40.0          /* of the criterion: a count that is so much worse on averaged strips is so on all */
#define EQUAL 8.0         /* of the criterion */
#define ROUNDS 2          /* of taking out and growing again */
#define STRIPS 100        /* the search makes longer runs as short as that */
#define TINY 2.3e-308

typedef struct {
  const Problem *whole;
  Problem now; /* the readings of this stage, averaged */
  Int sigma_known, two_signatures, top, max_vertices, atleast;
  Int readings; /* of this stage, that count */
  double sigma; /* of this stage */
  Polygon best[MAX_VERTICES + 1];
  int tried[3][MAX_VERTICES + 2];
  double *strips, *running;
} Search;

Int readings_of(const Problem *s) {
  Int count = 0;
  for (Int i = 0; i < s->signatures * s->n; i++) if (s->weight[i] != 0.0) count++;
  return count;
}

double sigma_of(const Problem *s) {
  double largest = TINY;
  for (Int i = 0; i < s->signatures * s->n; i++) largest = larger(largest, s->weight[i]);
  return 1.0 / sqrt(largest);
}

double per_vertex_penalty(Int readings) {
  return 2.0 * natural_log((double)(readings > 2 ? readings : 2)) + 4.0;
}

/* What so many vertices must gain together. Where sigma is not known few readings are soon fitted too well: the
   correction of small samples (AICc's) makes vertices dearer. */
double complexity_penalty(Int readings, Int vertices, Int sigma_known) {
  double price = per_vertex_penalty(readings) * (double)vertices;
  Int spare = readings - 2 * vertices - 3;
  return sigma_known ? price : price * (double)readings / (double)(spare > 1 ? spare : 1);
}

double deviance(double cost, Int readings, double sigma, Int sigma_known) {
  double n = (double)(readings > 1 ? readings : 1), floor = FLOOR / sigma;
  return sigma_known ? cost : n * natural_log(larger(cost / n, floor * floor));
}

static double criterion(const Polygon *p, Int readings, double sigma, Int sigma_known) {
  Int vertices = p->m + p->vertical[0] + p->vertical[1];
  return deviance(p->cost, readings, sigma, sigma_known) + complexity_penalty(readings, vertices, sigma_known);
}

/* Write the whole run with sigma times `factor` as at most COARSEST strips: neighbours are averaged as far as the noise
   hides that, then every so many are taken. Averaging over s pitches rounds a kink by its jump times s pitch / 8;
   jumps are about 1. */
static void thin(Search *t, double factor) {
  const Problem *s = t->whole;
  Problem *now = &t->now;
  double by = 1.0 / (factor * factor), *x = t->strips, *k = x + COARSEST, *weight = k + 2 * COARSEST;
  Int wanted = 2 * s->n >= 3 * STRIPS ? s->n / STRIPS : 1, size = 1;
  double hidden = 8.0 * sigma_of(s) * factor / s->pitch;
  while (size < wanted && (double)((size + 1) * (size + 1) * (size + 1)) <= hidden * hidden) size++;
  Int stride = wanted / size, blocks = (s->n + size - 1) / size, first = stride / 2;
  if (stride == 1) first = 0;
  *now = *s;
  now->n = first < blocks ? (blocks - first + stride - 1) / stride : 0;
  CHECK(now->n <= COARSEST);
  now->x = x;
  now->k = k;
  now->weight = weight;
  for (Int j = 0; j < now->n; j++) {
    Int start = (first + j * stride) * size, end = start + size < s->n ? start + size : s->n;
    double sum = 0.0;
    for (Int i = start; i < end; i++) sum += s->x[i];
    x[j] = sum / (double)(end - start);
    for (Int row = 0; row < s->signatures; row++) {
      const double *all_k = s->k + row * s->n, *all_weight = s->weight + row * s->n;
      double total = 0.0, weighted = 0.0, plain = 0.0;
      for (Int i = start; i < end; i++) {
        total += all_weight[i];
        weighted += all_k[i] * all_weight[i];
        plain += all_k[i];
      }
      k[row * now->n + j] = size == 1 ? plain : total > 0.0 ? weighted / total : plain / (double)(end - start);
      weight[row * now->n + j] = total * by;
    }
  }
  t->readings = readings_of(now);
  t->sigma = sigma_of(now);
}

static double score_of(const Search *t, Int m) {
  return deviance(t->best[m].cost, t->readings, t->sigma, t->sigma_known) +
         complexity_penalty(t->readings, m, t->sigma_known);
}

static Int best_of(const Search *t) {
  Int best = 0;
  for (Int m = 1; m <= t->top; m++) if (score_of(t, m) < score_of(t, best)) best = m;
  return best;
}

static void try_move(Search *t, int kind, Int m) {
  if (t->tried[kind][m]) return;
  t->tried[kind][m] = 1;
  if (improve(&t->now, kind, t->best, m, !t->two_signatures, t->running)) {
    Int to = kind == SHRINK ? m - 1 : m + 1;
    for (int other = FIRST; other <= SHRINK; other++) t->tried[other][to] = 0;
  }
}

static void count(Search *t) {
  for (;;) {
    Int past = best_of(t) + PAST;
    if (past < t->atleast) past = t->atleast;
    if (t->top >= (past < t->max_vertices ? past : t->max_vertices)) break;
    if (t->top == 0 && !t->two_signatures) try_move(t, FIRST, 0);
    try_move(t, GROW, t->top);
    if (!(t->best[t->top + 1].cost < INFINITE)) break;
    t->top++;
  }
  for (int round = 0; round < ROUNDS; round++) {
    for (Int m = t->top; m > 1; m--) try_move(t, SHRINK, m);
    for (Int m = 1; m < t->top; m++) try_move(t, GROW, m);
  }
}

/* x, l, u of both ends to begin with: as they read, or with both signatures a line through each. Between two pointed
   ends heights alone would begin without any width, where descents go astray. */
static void straight(const Problem *s, double *theta) {
  theta[0] = 0.0;
  theta[3] = 1.0;
  if (s->signatures == 1) {
    theta[1] = theta[2] = s->k[0];
    theta[4] = theta[5] = s->k[s->n - 1];
    return;
  }
  double middle = 0.0, square = 0.0, slope[2], mean[2];
  for (Int i = 0; i < s->n; i++) middle += s->x[i];
  middle /= (double)s->n;
  for (Int i = 0; i < s->n; i++) square += (s->x[i] - middle) * (s->x[i] - middle);
  for (int row = 0; row < 2; row++) {
    slope[row] = mean[row] = 0.0;
    for (Int i = 0; i < s->n; i++) {
      mean[row] += s->k[row * s->n + i];
      slope[row] += s->k[row * s->n + i] * (s->x[i] - middle);
    }
    mean[row] /= (double)s->n;
    slope[row] /= larger(square, 1e-12);
  }
  for (int side = 0; side < 2; side++) {
    double a = clip(mean[0] + slope[0] * ((double)side - middle), 0.0, 1.0);
    double b = clip(mean[1] + slope[1] * ((double)side - middle), 0.0, 1.0);
    theta[3 * side + 1] = smaller(a, b);
    theta[3 * side + 2] = larger(a, b);
  }
}

/* Search all counts, for readings without noise by stages; return the best. */
static Int run(Search *t) {
  double sigma = sigma_of(t->whole), level = larger(sigma, COARSE);
  for (;;) {
    thin(t, level / sigma);
    for (int kind = FIRST; kind <= SHRINK; kind++) for (int m = 0; m < MAX_VERTICES + 2; m++) t->tried[kind][m] = 0;
    for (Int m = 0; m <= MAX_VERTICES; m++) t->best[m].cost = INFINITE;
    for (Int m = 0; m <= t->top; m++) tacstrip_descend(&t->now, t->best + m, ROUGH, ENOUGH, INFINITE);
    count(t);
    Int best = best_of(t);
    if (level <= sigma || t->best[best].cost > HOPELESS * (double)t->readings) return best;
    level = larger(level / FINER, sigma);
  }
}

static Polygon with_vertical_ends(const Search *t, Int m, int left, int right) {
  Polygon p = t->best[m];
  p.vertical[0] = left;
  p.vertical[1] = right;
  return p;
}

/* Make the ends points where that explains the readings of the polygon of m vertices as well. */
static void settle_ends(const Search *t, Int m, Int *vertical) {
  double least = INFINITE, free = deviance(t->best[m].cost, t->readings, t->sigma, t->sigma_known);
  vertical[0] = vertical[1] = t->two_signatures;
  for (int ends = 0; ends < 4 && t->two_signatures; ends++) {
    Polygon p = with_vertical_ends(t, m, ends / 2, ends % 2);
    tacstrip_refine(&t->now, &p);
    double score = criterion(&p, t->readings, t->sigma, t->sigma_known);
    if (score < least) {
      least = score;
      vertical[0] = ends / 2;
      vertical[1] = ends % 2;
    }
    double own = deviance(p.cost, t->readings, t->sigma, t->sigma_known);
    if (ends == 0 && own - free < per_vertex_penalty(t->readings)) break;
  }
}

static Int n_vertices_of(const Polygon *p) { return p->m + 2 + p->vertical[0] + p->vertical[1]; }

/* The best polygon of so many vertices in all, or of as many as were found. */
static Polygon of_n_vertices(const Search *t, Int n_vertices) {
  Polygon found = t->best[0];
  Int least = -1;
  for (int ends = 0; ends < (t->two_signatures ? 4 : 1); ends++) {
    Int m = n_vertices - 2 - ends / 2 - ends % 2;
    Polygon p = with_vertical_ends(t, m < 0 ? 0 : m < t->top ? m : t->top, ends / 2, ends % 2);
    tacstrip_refine(t->whole, &p);
    Int off = n_vertices_of(&p) > n_vertices ? n_vertices_of(&p) - n_vertices : n_vertices - n_vertices_of(&p);
    if (least < 0 || off < least || (off == least && p.cost < found.cost)) {
      least = off;
      found = p;
    }
  }
  return found;
}

Int tacstrip_fit_counts(const Problem *s, Int sigma_known, Int max_vertices, Int n_vertices, Int every, Polygon *found,
                        Int *picked, double *workspace) {
  Search t;
  /* A count or a sigma that is to be found leaves a reading over to tell it by. */
  int told = n_vertices && sigma_known;
  Int whole = readings_of(s), holds = (whole - 2 * s->signatures - (told ? 0 : 1)) / 2, count = 0, vertical[2];
  double sigma = sigma_of(s);
  CHECK(s->n > 0 && (s->signatures == 1 || s->signatures == 2));
  t.whole = s;
  t.sigma_known = sigma_known;
  t.two_signatures = s->signatures > 1;
  t.top = 0;
  t.max_vertices = max_vertices < MAX_VERTICES ? max_vertices : MAX_VERTICES;
  if (t.max_vertices > holds) t.max_vertices = holds > 0 ? holds : 0;
  t.atleast = n_vertices ? n_vertices - 2 + PAST : 0;
  t.strips = workspace;
  t.running = workspace + 5 * COARSEST;
  for (Int m = 0; m <= MAX_VERTICES; m++) {
    t.best[m].m = m;
    t.best[m].vertical[0] = t.best[m].vertical[1] = t.two_signatures;
    t.best[m].score = INFINITE;
  }
  straight(s, t.best[0].theta);
  Int best = run(&t);
  picked[0] = 0;
  picked[1] = 1;
  if (n_vertices) {
    *found = of_n_vertices(&t, n_vertices);
    found->score = criterion(found, whole, sigma, sigma_known);
    return 1;
  }
  settle_ends(&t, best, vertical);
  double least = score_of(&t, best);
  for (Int m = 0; m <= t.top; m++) {
    int beside = m == best || ((m == best - 1 || m == best + 1) && score_of(&t, m) < least + FAR);
    if (!every && !beside) continue;
    Polygon *p = found + count;
    *p = with_vertical_ends(&t, m, (int)vertical[0], (int)vertical[1]);
    tacstrip_refine(s, p);
    p->score = criterion(p, whole, sigma, sigma_known);
    if (p->score < found[picked[0]].score) picked[0] = count;
    count++;
  }
  picked[1] = 0;
  for (Int m = 0; m <= t.top; m++) if (score_of(&t, m) <= least + EQUAL) picked[1]++;
  return count;
}

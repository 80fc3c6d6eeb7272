"""How many vertices a problem holds: the best fit of each count, and the count with the best criterion.

Counts grow until two past the best. Then every vertex is taken out in turn, and the shorter fits grow again: a
vertex that was right among few can be wrong among many. All this happens on averaged strips; the counts beside
the best one are then fitted to all strips, and compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import MAX_VERTICES, POLYGON, at, exported, search_workspace
from tacstrip.core.descent import descend
from tacstrip.core.model_selection import complexity_penalty, criterion, deviance, per_vertex_penalty
from tacstrip.core.moves import ENOUGH, FIRST, GROW, ROUGH, SHRINK, improve
from tacstrip.core.polygon_fit import PolygonFit, plain_refine
from tacstrip.core.problem import FitProblem

PAST = 2  # counts tried past the best
_COARSE, _FINER = 3e-4, 30.0  # of Vref: sigma of the first stage at least, and steps down from there
_HOPELESS = 100.0  # of chi square a reading: no polygon, so no finer stage
_FAR = 40.0  # of the criterion: a count that is so much worse on thinned strips is so on all
_EQUAL = 8.0  # of the criterion
_ROUNDS = 2  # of taking out and growing again
# Which ends are vertical edges.
_END_KINDS = [np.array(c, dtype=np.int64) for c in ((0, 0), (0, 1), (1, 0), (1, 1))]


@dataclass(frozen=True, eq=False)
class ModelSelection:
    """Polygons of several vertex counts, fitted to one run, and the one that the criterion chooses.

    Attributes
    ----------
    fits
        The counts that were compared on all strips, ascending.
    scores
        Their criterion, least is best.
    best
        The place of the chosen one.
    equal
        How many counts, of all that were searched, the criterion can hardly tell from the best: 1 for a polygon
        with clear n_vertices, more for a round contact.
    """

    fits: Sequence[PolygonFit]
    scores: tuple[float, ...]
    best: int
    equal: int

    @property
    def chosen(self) -> PolygonFit:
        """The fit with the least criterion."""
        return self.fits[self.best]


def fit_counts(
    problem: FitProblem,
    sigma_known: bool = True,
    max_vertices: int = MAX_VERTICES,
    every: bool = False,
    n_vertices: int | None = None,
) -> ModelSelection:
    """Fit polygons of several counts, and choose one.

    Parameters
    ----------
    problem
        Readings and weights.
    sigma_known
        Whether the weights are 1 / sigma^2; else they are so only roughly, and sigma counts as unknown.
    max_vertices
        Interior vertices at most; fewer where the readings do not hold as many.
    every
        Whether all counts that were searched are fitted to all strips, not only the best one's neighbours.
    n_vertices
        Vertices in all, where that is sigma_known: then there is one fit. Readings that do not hold as many give fewer.
    """
    core = exported("fit_counts")
    if core is None:
        return plain_fit_counts(problem, sigma_known, max_vertices, every, n_vertices)
    found, picked = np.empty(MAX_VERTICES + 1, POLYGON), np.empty(2, dtype=np.int64)
    options, workspace = (sigma_known, max_vertices, n_vertices or 0, every), search_workspace()
    count = core(problem.compiled, *options, at(found), at(picked), at(workspace))
    fits = tuple(PolygonFit.of_record(found[i : i + 1]) for i in range(count))
    return ModelSelection(fits, tuple(found["score"][:count].tolist()), int(picked[0]), int(picked[1]))


def plain_fit_counts(
    problem: FitProblem,
    sigma_known: bool = True,
    max_vertices: int = MAX_VERTICES,
    every: bool = False,
    n_vertices: int | None = None,
) -> ModelSelection:
    """Do as `fit_counts`, in NumPy."""
    most = most_vertices(problem, told=n_vertices is not None and sigma_known)
    search = _Search(problem, sigma_known, min(max_vertices, MAX_VERTICES, most), n_vertices)
    near = search.run()
    if n_vertices is not None:
        fit = search.of_n_vertices(n_vertices)
        return ModelSelection((fit,), (criterion(fit, problem, sigma_known),), 0, 1)
    search.settle_ends(near)
    fits, scores = [], []
    for m in range(search.top + 1) if every else search.near(near):
        fits.append(plain_refine(search.with_vertical_ends(m, search.vertical_ends), problem))
        scores.append(criterion(fits[-1], problem, sigma_known))
    return ModelSelection(tuple(fits), tuple(scores), int(np.argmin(scores)), search.equal())


def most_vertices(problem: FitProblem, told: bool = False) -> int:
    """Return how many interior vertices the readings hold; a count or a sigma not `told` needs one reading over."""
    return max((problem.readings - 2 * len(problem.k) - (0 if told else 1)) // 2, 0)


class _Search:
    """The best fit of each count so far, and which moves have been tried on it."""

    def __init__(
        self, whole: FitProblem, sigma_known: bool, max_vertices: int, n_vertices: int | None
    ) -> None:
        self.whole, self.sigma_known, self.max_vertices = whole, sigma_known, max_vertices
        self.least = 0 if n_vertices is None else n_vertices - 2 + PAST
        # Two signatures tell both heights of an end; one does not, and only convex shapes are told apart.
        self.two_signatures = len(whole.k) > 1
        self.vertical_ends = np.full(2, int(self.two_signatures), dtype=np.int64)
        self.fits = [PolygonFit(whole.straight(), np.empty(0, dtype=np.int64), self.vertical_ends, np.inf)]

    @property
    def top(self) -> int:
        """The most vertices so far."""
        return len(self.fits) - 1

    def run(self) -> int:
        """Search all counts, for readings without noise by stages; return the best."""
        sigma = self.whole.sigma
        level = max(sigma, _COARSE)
        while True:
            self.problem = self.whole.scaled(level / sigma).thinned()
            self.per_vertex_penalty = per_vertex_penalty(self.problem.readings)
            self.tried: set[tuple[int, int]] = set()
            self.fits = [self._descended(fit) for fit in self.fits]
            self._count()
            best = self._best()
            hopeless = self.fits[best].cost > _HOPELESS * self.problem.readings
            if level <= sigma or hopeless:
                return best
            level = max(level / _FINER, sigma)

    def _count(self) -> None:
        while self.top < min(self.max_vertices, max(self._best() + PAST, self.least)):
            m = self.top
            if m == 0 and not self.two_signatures:
                self._try(FIRST, 0)
            self._try(GROW, m)
            if self.top == m:
                break
        for _ in range(_ROUNDS):
            for m in range(self.top, 1, -1):
                self._try(SHRINK, m)
            for m in range(1, self.top):
                self._try(GROW, m)

    def settle_ends(self, m: int) -> None:
        """Make the ends points where that explains the readings of the fit of m vertices as well."""
        if not self.two_signatures:
            return
        best, free = np.inf, deviance(self.fits[m].cost, self.problem, self.sigma_known)
        for vertical_ends in _END_KINDS:
            fit = plain_refine(self.with_vertical_ends(m, vertical_ends), self.problem)
            score = criterion(fit, self.problem, self.sigma_known)
            if score < best:
                best, self.vertical_ends = score, vertical_ends
            gain = deviance(fit.cost, self.problem, self.sigma_known) - free
            if not vertical_ends.any() and gain < self.per_vertex_penalty:
                break

    def of_n_vertices(self, n_vertices: int) -> PolygonFit:
        """Return the best fit of so many vertices in all, or of as many as were found."""
        found = []
        for vertical_ends in _END_KINDS if self.two_signatures else _END_KINDS[:1]:
            m = min(max(n_vertices - 2 - int(vertical_ends.sum()), 0), self.top)
            found.append(plain_refine(self.with_vertical_ends(m, vertical_ends), self.whole))
        return min(found, key=lambda fit: (abs(fit.n_vertices - n_vertices), fit.cost))

    def with_vertical_ends(self, m: int, vertical_ends: IntArray) -> PolygonFit:
        """Return the fit of m vertices with other ends, not fitted."""
        return PolygonFit(self.fits[m].theta, self.fits[m].chain, vertical_ends, np.inf)

    def near(self, m: int) -> list[int]:
        """Return m and the counts beside it that may yet turn out better."""
        scores = self._scores()
        beside = range(max(m - 1, 0), min(m + 2, self.top + 1))
        return [j for j in beside if j == m or scores[j] < scores[m] + _FAR]

    def equal(self) -> int:
        """Count the counts whose criterion is near the best."""
        scores = self._scores()
        return int((scores <= scores.min() + _EQUAL).sum())

    def _best(self) -> int:
        return int(self._scores().argmin())

    def _scores(self) -> FloatArray:
        given = self.problem, self.sigma_known
        costs = [deviance(fit.cost, *given) for fit in self.fits]
        return np.array(costs) + [complexity_penalty(given[0], m, given[1]) for m in range(len(costs))]

    def _try(self, move: int, m: int) -> None:
        if (move, m) in self.tried:
            return
        self.tried.add((move, m))
        to = m - 1 if move == SHRINK else m + 1
        cost = self.fits[to].cost if to <= self.top else np.inf
        found = improve(move, self.fits[m], cost, not self.two_signatures, self.problem)
        if found is not None:
            self.fits[to : to + 1] = [found]
            self.tried -= {(other, to) for other in (FIRST, GROW, SHRINK)}

    def _descended(self, fit: PolygonFit) -> PolygonFit:
        batch = fit.theta[None], fit.chain[None], fit.vertical_ends
        found = descend(*batch, self.problem, ROUGH, ENOUGH, np.inf)
        return PolygonFit(found[0][0], found[1][0], fit.vertical_ends, float(found[2][0]))

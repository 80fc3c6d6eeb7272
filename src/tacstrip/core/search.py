"""How many vertices a signal holds: the best fit of each count, and the count with the best criterion.

Counts grow until two past the best. Then every vertex is taken out in turn, and the shorter fits grow again: a
vertex that was right among few can be wrong among many. All this happens on averaged strips; the counts beside
the best one are then fitted to all strips, and compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported, search_workspace
from tacstrip.core.criterion import charge, criterion, misfit, penalty
from tacstrip.core.descent import descend, plain_refine
from tacstrip.core.fit import MOST, POLYGON, Fit
from tacstrip.core.moves import ENOUGH, FIRST, GROW, ROUGH, SHRINK, improve
from tacstrip.core.problem import Signal

_PAST = 2  # counts tried past the best
_COARSE, _FINER = 3e-4, 30.0  # of Vref: sigma of the first stage at least, and steps down from there
_HOPELESS = 100.0  # of chi square a reading: no polygon, so no finer stage
_FAR = 40.0  # of the criterion: a count that is so much worse on thinned strips is so on all
_EQUAL = 8.0  # of the criterion
_ROUNDS = 2  # of taking out and growing again
_BLUNT = [
    np.array(c, dtype=np.int64) for c in ((0, 0), (0, 1), (1, 0), (1, 1))
]  # which ends are vertical edges


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of several counts to one signal.

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
        with clear corners, more for a round contact.
    """

    fits: tuple[Fit, ...]
    scores: tuple[float, ...]
    best: int
    equal: int

    @property
    def chosen(self) -> Fit:
        """The fit with the least criterion."""
        return self.fits[self.best]


def fit_counts(
    signal: Signal, known: bool = True, most: int = MOST, every: bool = False, corners: int | None = None
) -> Fits:
    """Fit polygons of several counts, and choose one.

    Parameters
    ----------
    signal
        Readings and weights.
    known
        Whether the weights are 1 / sigma^2; else they are so only roughly, and sigma counts as unknown.
    most
        Interior vertices at most; fewer where the readings do not hold as many.
    every
        Whether all counts that were searched are fitted to all strips, not only the best one's neighbours.
    corners
        Vertices in all, where that is known: then there is one fit. Readings that do not hold as many give fewer.
    """
    core = exported("fit_counts")
    if core is None:
        return plain_fit_counts(signal, known, most, every, corners)
    found, picked, workspace = np.empty(MOST + 1, POLYGON), np.empty(2, dtype=np.int64), search_workspace()
    count = core(signal.problem, known, most, corners or 0, every, at(found), at(picked), at(workspace))
    fits = tuple(Fit.of_record(found[i : i + 1]) for i in range(count))
    return Fits(fits, tuple(found["score"][:count].tolist()), int(picked[0]), int(picked[1]))


def plain_fit_counts(
    signal: Signal, known: bool = True, most: int = MOST, every: bool = False, corners: int | None = None
) -> Fits:
    """Do as `fit_counts`, in NumPy."""
    search = _Search(signal, known, min(most, MOST, _most(signal)), corners)
    near = search.run()
    if corners is not None:
        fit = search.of_corners(corners)
        return Fits((fit,), (criterion(fit, signal, known),), 0, 1)
    search.settle_ends(near)
    fits, scores = [], []
    for m in range(search.top + 1) if every else search.near(near):
        fits.append(plain_refine(search.with_ends(m, search.blunt), signal))
        scores.append(criterion(fits[-1], signal, known))
    return Fits(tuple(fits), tuple(scores), int(np.argmin(scores)), search.equal())


def _most(signal: Signal) -> int:
    """Return how many interior vertices leave readings over to test the fit by."""
    ends = 2 * len(signal.k)
    return max((signal.readings - ends - 1) // 2, 0)


class _Search:
    """The best fit of each count so far, and which moves have been tried on it."""

    def __init__(self, whole: Signal, known: bool, most: int, corners: int | None) -> None:
        self.whole, self.known, self.most = whole, known, most
        self.least = 0 if corners is None else corners - 2 + _PAST
        # Two signatures tell both heights of an end; one does not, and only convex shapes are told apart.
        self.double = len(whole.k) > 1
        self.blunt = np.full(2, int(self.double), dtype=np.int64)
        self.fits = [Fit(whole.straight(), np.empty(0, dtype=np.int64), self.blunt, np.inf)]

    @property
    def top(self) -> int:
        """The most vertices so far."""
        return len(self.fits) - 1

    def run(self) -> int:
        """Search all counts, for readings without noise by stages; return the best."""
        sigma = self.whole.sigma
        level = max(sigma, _COARSE)
        while True:
            self.signal = self.whole.scaled(level / sigma).thinned()
            self.penalty = penalty(self.signal.readings)
            self.tried: set[tuple[int, int]] = set()
            self.fits = [self._descended(fit) for fit in self.fits]
            self._count()
            best = self._best()
            hopeless = self.fits[best].cost > _HOPELESS * self.signal.readings
            if level <= sigma or hopeless:
                return best
            level = max(level / _FINER, sigma)

    def _count(self) -> None:
        while self.top < min(self.most, max(self._best() + _PAST, self.least)):
            m = self.top
            if m == 0 and not self.double:
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
        if not self.double:
            return
        best = np.inf
        for blunt in _BLUNT:
            fit = plain_refine(self.with_ends(m, blunt), self.signal)
            score = criterion(fit, self.signal, self.known)
            if score < best:
                best, self.blunt = score, blunt
            if not blunt.any() and self._pointed_will_do(fit, m):
                break

    def _pointed_will_do(self, fit: Fit, m: int) -> bool:
        free = misfit(self.fits[m].cost, self.signal, self.known)
        return misfit(fit.cost, self.signal, self.known) - free < self.penalty

    def of_corners(self, corners: int) -> Fit:
        """Return the best fit of so many vertices in all, or of as many as were found."""
        found = []
        for blunt in _BLUNT if self.double else _BLUNT[:1]:
            m = min(max(corners - 2 - int(blunt.sum()), 0), self.top)
            found.append(plain_refine(self.with_ends(m, blunt), self.whole))
        return min(found, key=lambda fit: (abs(fit.corners - corners), fit.cost))

    def with_ends(self, m: int, blunt: IntArray) -> Fit:
        """Return the fit of m vertices with other ends, not fitted."""
        return Fit(self.fits[m].theta, self.fits[m].chain, blunt, np.inf)

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
        signal, known = self.signal, self.known
        return np.array(
            [misfit(fit.cost, signal, known) + charge(signal, m, known) for m, fit in enumerate(self.fits)]
        )

    def _try(self, move: int, m: int) -> None:
        if (move, m) in self.tried:
            return
        self.tried.add((move, m))
        to = m - 1 if move == SHRINK else m + 1
        cost = self.fits[to].cost if to <= self.top else np.inf
        found = improve(move, self.fits[m], cost, not self.double, self.signal)
        if found is not None:
            self.fits[to : to + 1] = [found]
            self.tried -= {(other, to) for other in (FIRST, GROW, SHRINK)}

    def _descended(self, fit: Fit) -> Fit:
        found = descend(fit.theta[None], fit.chain[None], fit.blunt, self.signal, ROUGH, ENOUGH, np.inf)
        return Fit(found[0][0], found[1][0], fit.blunt, float(found[2][0]))

"""How many vertices a signal holds: the best fit of each count, and the count with the best criterion.

Counts grow until two past the best. Then every vertex is taken out in turn, and the shorter fits grow again: a
vertex that was right among few can be wrong among many. All this happens on averaged strips; the counts beside
the best one are then fitted to all strips, and compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import ENDS
from tacstrip.reconstruct.polygon_criterion import charge, criterion, misfit, penalty
from tacstrip.reconstruct.polygon_descent import descend
from tacstrip.reconstruct.polygon_fit import Fit, fit_of
from tacstrip.reconstruct.polygon_moves import ENOUGH, FIRST, GROW, MOST, ROUGH, SHRINK, improve
from tacstrip.reconstruct.polygon_signal import Signal

_FINE, _SETTLED = 40, 1e-4  # steps of a last descent, and the gain in chi square that ends it
_PAST = 2  # counts tried past the best
_COARSE, _FINER = (
    3e-4,
    30.0,
)  # of Vref: sigma that the search takes at least at first, and steps down from there
_HOPELESS = 100.0  # of chi square a reading: no polygon, so no finer stage
_CLOSED = 1e-12  # of the strip length
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
    search = _Search(signal, known, min(most, MOST, _most(signal)), corners)
    near = search.run()
    if corners is not None:
        fit = search.of_corners(corners)
        return Fits((fit,), (criterion(fit, signal, known),), 0, 1)
    search.settle_ends(near)
    fits, scores = [], []
    for m in range(search.top + 1) if every else search.near(near):
        fits.append(refine(fit_of(search.fits[m], search.kinds[m], m, search.blunt, 0.0), signal))
        scores.append(criterion(fits[-1], signal, known))
    return Fits(tuple(fits), tuple(scores), int(np.argmin(scores)), search.equal())


def refine(fit: Fit, signal: Signal) -> Fit:
    """Return the least-squares fit near a given one, on all strips: also the warm start of tracking."""
    theta, chain = fit.theta.copy(), fit.chain.copy()
    for side in (0, 1):
        if not fit.blunt[side] and theta[3 * side + 1] != theta[3 * side + 2]:
            theta[3 * side + 1 : 3 * side + 3] = theta[3 * side + 1 : 3 * side + 3].mean()
    cost = descend(theta, chain, fit.count, fit.blunt, signal.data, signal.model, _FINE, _SETTLED, np.inf)
    height = np.array([theta[2] - theta[1], theta[5] - theta[4]])
    closed = (fit.blunt == 1) & (height <= _CLOSED)
    if closed.any():  # a vertical edge without height is a point, whose x is free
        return refine(Fit(theta, chain, np.where(closed, 0, fit.blunt), cost), signal)
    return Fit(theta, chain, fit.blunt, cost)


def _most(signal: Signal) -> int:
    """Return how many interior vertices leave readings over to test the fit by."""
    ends = 2 * len(signal.k)
    return max((signal.readings - ends - 1) // 2, 0)


class _Search:
    """The best fit of each count so far, and which moves have been tried on it."""

    def __init__(self, whole: Signal, known: bool, most: int, corners: int | None) -> None:
        self.whole, self.known, self.most, self.top = whole, known, most, 0
        self.least = 0 if corners is None else corners - 2 + _PAST
        self.fits = np.zeros((MOST + 1, ENDS + 2 * MOST))
        self.kinds = np.zeros((MOST + 1, MOST), dtype=np.int64)
        # Two signatures tell both heights of an end; one does not, and only convex shapes are told apart.
        self.double = len(whole.k) > 1
        self.blunt = np.full(2, int(self.double), dtype=np.int64)
        self.fits[0, :ENDS] = whole.straight()

    def run(self) -> int:
        """Search all counts, for readings without noise by stages; return the best."""
        sigma = self.whole.sigma
        level = max(sigma, _COARSE)
        while True:
            self.signal = self.whole.scaled(level / sigma).thinned()
            self.penalty = penalty(self.signal.readings)
            self.tried = np.zeros((3, MOST + 2), dtype=bool)
            self.costs = np.full(MOST + 1, np.inf)
            for m in range(self.top + 1):
                self.costs[m] = self._descend(self.fits[m], self.kinds[m], m, self.blunt)
            self._count()
            hopeless = self.costs[self._best()] > _HOPELESS * self.signal.readings
            if level <= sigma or hopeless:
                return self._best()
            level = max(level / _FINER, sigma)

    def _count(self) -> None:
        while self.top < min(self.most, max(self._best() + _PAST, self.least)):
            if self.top == 0 and not self.double:
                self._try(FIRST, 0)
            self._try(GROW, self.top)
            if not self.costs[self.top + 1] < np.inf:
                break
            self.top += 1
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
            fit = refine(fit_of(self.fits[m], self.kinds[m], m, blunt, 0.0), self.signal)
            score = criterion(fit, self.signal, self.known)
            if score < best:
                best, self.blunt = score, blunt
            if not blunt.any() and self._pointed_will_do(fit, m):
                break

    def _pointed_will_do(self, fit: Fit, m: int) -> bool:
        free = misfit(self.costs[m], self.signal, self.known)
        return misfit(fit.cost, self.signal, self.known) - free < self.penalty

    def of_corners(self, corners: int) -> Fit:
        """Return the best fit of so many vertices in all, or of as many as were found."""
        found = []
        for blunt in _BLUNT if self.double else _BLUNT[:1]:
            m = min(max(corners - 2 - int(blunt.sum()), 0), self.top)
            found.append(refine(fit_of(self.fits[m], self.kinds[m], m, blunt, 0.0), self.whole))
        return min(found, key=lambda fit: (abs(fit.corners - corners), fit.cost))

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
        return np.array(
            [
                misfit(self.costs[m], self.signal, self.known) + charge(self.signal, m, self.known)
                for m in range(self.top + 1)
            ]
        )

    def _try(self, move: int, m: int) -> None:
        if self.tried[move, m]:
            return
        self.tried[move, m] = True
        signal = self.signal
        if improve(
            move, self.fits, self.kinds, self.costs, m, self.blunt, not self.double, signal.data, signal.model
        ):
            self.tried[:, m - 1 if move == SHRINK else m + 1] = False

    def _descend(self, theta: FloatArray, chain: IntArray, m: int, blunt: IntArray) -> float:
        found: float = descend(
            theta, chain, m, blunt, self.signal.data, self.signal.model, ROUGH, ENOUGH, np.inf
        )
        return found

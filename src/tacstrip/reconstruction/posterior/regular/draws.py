"""Regular outlines that explain the readings of one signature: discs, ellipses, segments, rectangles, trapezoids.

Polygons that read alike differ by their heights, for one signature is one number a strip. A regular outline keeps its
proportions: where a disc begins and ends tells how high it is. So outlines of each kind, inside the sensor and over its
border, are drawn as often as the readings make them likely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import REGULAR_STRIPS
from tacstrip.core.problem import FitProblem
from tacstrip.core.regular import sample_regular
from tacstrip.geometry.metrics import column_iou, pairwise_column_iou
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline
from tacstrip.reconstruction.posterior.regular.kinds import KINDS, Outlines
from tacstrip.reconstruction.posterior.regular.placement import Placement

_OVER = math.log(0.1)  # outlines over a border for one inside
_OCCAM = 25.0  # what a polygon's free corners cost it, of log likelihood
_PARTICLES = 256  # of each kind: their log evidence scatters by less than 1
_KEPT = 200
_DRAWN_AT = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 33))  # parts of the extent where curves have vertices
_STRAIGHT = 1e-3  # of the strip: a vertex that is off the line through its neighbours by less is none


@dataclass(frozen=True, eq=False)
class RegularDraws:
    """Regular outlines, as often as the readings make them likely.

    Attributes
    ----------
    ends
        l and u (K, 2, G) in the columns; both 0 outside.
    advantage
        Log evidence of the readings under all kinds, or what they had reached when they were given up, over the log
        likelihood of the best polygon; 0 would be much, for its free corners cost a polygon some `_OCCAM`.
    misfit
        Squared residuals over sigma^2 that the best one leaves, a reading: about 1 where noise explains them.
    """

    ends: FloatArray
    advantage: float
    misfit: float
    _placement: Placement
    _outlines: Outlines
    _lowest: FloatArray
    _half_chi_square: FloatArray

    def overlap(self, ends: FloatArray) -> FloatArray:
        """Return intersection over union (K,) of all with l and u (2, G)."""
        return column_iou(self.ends, ends)

    def commonest(self) -> int:
        """Return the outline that the others overlap best."""
        return int(np.argmax(pairwise_column_iou(self.ends).sum(axis=1)))

    def outline(self, best: int) -> FamilyOutline:
        """Return one of the outlines as a model; the others at the same parts of their extents tell how sure it is."""
        left, right = self._extents()
        corners = self._corners(best, float(left[best]), float(right[best]))
        part = np.unique(np.concatenate([_DRAWN_AT, corners]))
        x = left[:, None] + (right - left)[:, None] * part
        ends = self._placement.ends(self._outlines, self._lowest, x)
        ends[:, 0] = np.minimum(ends[:, 0], ends[:, 1])
        chains = []
        for y in (ends[:, 0], ends[:, 1]):
            keep = _vertices(part, y[best])
            chain = np.stack([x[:, keep], y[:, keep]], axis=-1)
            chains.append((chain[best], (chain - chain[best]) / math.sqrt(len(chain))))
        (lower, lower_off), (upper, upper_off) = chains
        cost = 2.0 * float(self._half_chi_square[best])
        return FamilyOutline(KINDS[self._outlines.kind[best]], lower, upper, lower_off, upper_off, cost)

    def _extents(self) -> tuple[FloatArray, FloatArray]:
        """Return between which x (K,) the outlines are seen, just within."""
        on, window = self._placement.placed(self._outlines, np.zeros(0)), self._placement.window
        left, right = np.maximum(on.left, window[0]), np.minimum(on.right, window[3])
        inside = 1e-7 * (right - left)
        return left + inside, right - inside

    def _corners(self, best: int, left: float, right: float) -> FloatArray:
        """Return at which parts of what is seen of an outline, from left to right, its edges begin and end."""
        x = self._placement.marks(self._outlines.at(np.array([best])))
        part = np.round((x - left) / (right - left), 6)
        return np.asarray(part[(part > 0.0) & (part < 1.0)])


def draw_regular(
    problem: FitProblem,
    window: tuple[float, float, float, float],
    columns: FloatArray,
    least_chi_square: float,
    seed: int = 0,
) -> RegularDraws | None:
    """Draw regular outlines that explain the readings of one signature; None without a compiled core.

    Parameters
    ----------
    problem
        One signature's readings.
    window
        Between which x the left end lies, and the right one.
    columns
        Places (G,) where l and u are wanted.
    least_chi_square
        Of polygons a reading: kinds that cannot do as well are given up.
    seed
        0 or more.
    """
    short, placement = averaged(problem), Placement.of(problem, window)
    readings = max(short.readings, 1)
    polygon = -0.5 * least_chi_square * readings
    drawn = sample_regular(short, placement.compiled, _PARTICLES, polygon - _OCCAM, seed)
    if drawn is None:
        return None
    kind, over = np.repeat(np.arange(len(KINDS)), 2), np.tile([False, True], len(KINDS))
    counts = drawn.done if drawn.done.any() else ~drawn.done
    evidence = np.where(counts, drawn.evidence + np.where(over, _OVER, 0.0), -np.inf)
    share = np.exp(evidence - evidence.max())
    log_evidence, share = float(np.log(share.sum()) + evidence.max()), share / share.sum()
    random = np.random.default_rng(seed)
    at = random.choice(len(kind), _KEPT, p=share), random.integers(_PARTICLES, size=_KEPT)
    kept, lowest = Outlines(kind[at[0]], over[at[0]], drawn.numbers[at]), drawn.lowest[at]
    misfit = 2.0 * float(drawn.misfit[counts].min()) / readings
    ends = placement.ends(kept, lowest, columns)
    return RegularDraws(ends, log_evidence - polygon, misfit, placement, kept, lowest, drawn.misfit[at])


def averaged(problem: FitProblem) -> FitProblem:
    """Return one signature's readings as those of `REGULAR_STRIPS` strips or fewer."""
    starts = np.arange(0, len(problem.x), -(-len(problem.x) // REGULAR_STRIPS))
    weight = np.add.reduceat(problem.weight, starts, axis=1)
    k = np.add.reduceat(problem.weight * problem.k, starts, axis=1) / np.where(weight > 0.0, weight, 1.0)
    x = np.add.reduceat(problem.x, starts) / np.diff(np.append(starts, len(problem.x)))
    return replace(problem, x=x, k=k, weight=weight)


def _vertices(x: FloatArray, y: FloatArray) -> IntArray:
    """Return which points of a chain are off the line through the ones kept before and next, or are its ends."""
    kept = [0]
    for i in range(1, len(x) - 1):
        a, b = kept[-1], i + 1
        line = y[a] + (y[b] - y[a]) * (x[i] - x[a]) / (x[b] - x[a])
        if abs(y[i] - line) > _STRAIGHT * (y.max() - y.min() + _STRAIGHT):
            kept.append(i)
    return np.array([*kept, len(x) - 1])

"""One end of the contact along the strips, cut where no convex chain goes on: jumps and inward corners.

Where convex objects share strips, l is the least of their lower chains and -u the least of the others turned over, so
that one function serves both. It is cut into straight lines by dynamic programming, and of the cuts those stay whose
removal the readings would contradict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.reconstruction.polygon.convexity import convex_regression

Kind: TypeAlias = Literal["begins", "ends", "corner"]

_PER_LINE, _ALSO = (
    3.0,
    8.0,
)  # of chi square, times the logarithm of the strips, and beside it: what one more line costs
_CONTRADICTED = 18.0  # of chi square: by so much a convex chain explains the readings worse
_JUMPS = 3.0  # deviations between two lines: less, and they may meet
_BESIDE = 0.25  # pitches beyond the strips at either side where lines that meet make a corner
_PER_STEP = 4.0  # of chi square, times the logarithm of a step in deviations: lower ones are likelier
_FEWEST = 3  # strips of a stretch that may lose one
_UNSURE = (
    1.0  # pitches by which a cut may be off: lines that cross so near leave open what begins or ends there
)
_BESIDE_ALONE = (
    5  # strips at either side of one that fits neither: of fewer it may be the first of another piece
)
_ROUNDS = 4  # of leaving single strips out


@dataclass(frozen=True, eq=False)
class Cut:
    """Where one convex chain ends and another one begins.

    Attributes
    ----------
    strip
        The first strip to its right, counted in the run.
    kind
        Whether a piece "begins" there, one "ends", or both chains meet in an inward "corner".
    rise
        How far the end jumps [mm]; of a corner the jump that may hide in it.
    gain
        Of chi square by the cut.
    """

    strip: int
    kind: Kind
    rise: float
    gain: float


@dataclass(frozen=True, eq=False)
class Stretch:
    """Strips along which an end is convex.

    Attributes
    ----------
    start, stop
        Its strips, counted in the run.
    before, after
        What cuts it off; None at the run's ends.
    x
        Borders of its lines (M + 1,) [mm], from half a pitch before its first strip to half a pitch after its last.
    lines
        Height at the middle of each, slope, and middle (M, 3).
    covariances
        Of height and slope (M, 2, 2).
    chi_square
        What it leaves of the readings.
    """

    start: int
    stop: int
    before: Cut | None
    after: Cut | None
    x: FloatArray
    lines: FloatArray
    covariances: FloatArray
    chi_square: float

    def at(self, x: FloatArray) -> FloatArray:
        """Return the chain's height at x (n,), lengthened by its outer lines: the highest line."""
        height, slope, middle = self.lines.T
        return np.asarray((height + slope * (np.asarray(x)[:, None] - middle)).max(axis=1))

    def split(self, strip: int, x: float) -> tuple[Stretch, Stretch]:
        """Return what lies left and right of x [mm], before `strip`, as if an inward corner lay there."""
        cut = Cut(strip, "corner", 0.0, math.inf)
        inner = self.x[1:-1]
        left, right = int((inner < x).sum()), int((inner <= x).sum())
        return (
            Stretch(
                self.start, strip, self.before, cut, np.append(self.x[: left + 1], x), self.lines[: left + 1],
                self.covariances[: left + 1], self.chi_square,
            ),
            Stretch(
                strip, self.stop, cut, self.after, np.append(x, self.x[right + 1 :]), self.lines[right:],
                self.covariances[right:], 0.0,
            ),
        )  # fmt: skip

    @property
    def corners(self) -> FloatArray:
        """Its corners, ends included (M + 1, 2)."""
        height, slope, middle = self.lines.T
        left = height + slope * (self.x[:-1] - middle)
        last = height[-1] + slope[-1] * (self.x[-1] - middle[-1])
        return np.column_stack([self.x, np.append(left, last)])


@dataclass(frozen=True, eq=False)
class Chain:
    """One end of the contact: its stretches from left to right, and strips left out (n,)."""

    stretches: tuple[Stretch, ...]
    left_out: BoolArray
    x: FloatArray
    y: FloatArray
    weight: FloatArray
    pitch: float

    def shed(self, right: bool, least: float) -> tuple[Stretch, Stretch] | None:
        """Return the outermost stretch without its outer strip, and that strip, if a jump may part them.

        An edge so steep that one strip shows it reads as a jump of `least` [mm] or more does.
        """
        whole = self.stretches[-1 if right else 0]
        own = np.arange(whole.start, whole.stop)
        own = own[np.isfinite(self.y[own]) & ~self.left_out[own]]
        if len(own) < _FEWEST:
            return None
        end, own = (own[-1], own[:-1]) if right else (own[0], own[1:])
        borders, lines, covariances, chi_square = self._polyline(own)
        rise = float(self.y[end] - _height(lines[-1 if right else 0], self.x[end]))
        if rise < least:
            return None
        alone = self._polyline(np.array([end]))
        kept = borders, lines, covariances, chi_square
        if right:
            cut = Cut(int(end), "ends", rise, 0.0)
            return Stretch(whole.start, int(end), whole.before, cut, *kept), Stretch(
                int(end), whole.stop, cut, whole.after, *alone
            )
        cut = Cut(int(own[0]), "begins", rise, 0.0)
        return Stretch(int(own[0]), whole.stop, cut, whole.after, *kept), Stretch(
            whole.start, int(own[0]), whole.before, cut, *alone
        )

    def _polyline(self, own: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        return _polyline(self.x[own], self.y[own], self.weight[own], self.pitch)


def split_chain(x: FloatArray, y: FloatArray, sigma: FloatArray, pitch: float) -> Chain:
    """Cut an end y (n,) at strips x (n,) [mm], of deviations sigma (n,), into convex stretches.

    A single strip that fits neither side is left out, be it a channel at fault, the edge of a piece on a wide strip, or
    a piece on that strip alone.
    """
    weight, used = 1.0 / sigma**2, np.isfinite(y)
    for _ in range(_ROUNDS):
        at = np.flatnonzero(used)
        cuts, gains = _cuts(x[at], y[at], weight[at])
        alone = _alone(x[at], y[at], weight[at], cuts)
        if alone is None:
            break
        used[at[alone]] = False
    stretches = _stretches(x, y, weight, pitch, at, cuts, gains)
    return Chain(stretches, ~used & np.isfinite(y), x, y, weight, pitch)


def _alone(x: FloatArray, y: FloatArray, weight: FloatArray, cuts: list[int]) -> int | None:
    """Return a strip that makes a stretch by itself, or a cut that is none without it."""
    for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True):
        if b - c == 1 and b < len(x):
            return c
        for strip in (c - 1, c):
            before, behind = y[strip] - y[strip - 1], y[strip] - y[min(strip + 1, b - 1)]
            odd = before * behind > 0.0 and abs(before - behind) < 0.5 * min(abs(before), abs(behind))
            if odd and a + _BESIDE_ALONE <= strip < b - _BESIDE_ALONE:
                kept = np.delete(np.arange(a, b), strip - a)
                parts = kept, kept[kept < c], kept[kept >= c]
                whole, left, right = (_convex_cost(x[part], y[part], weight[part]) for part in parts)
                if whole - left - right < _CONTRADICTED:
                    return strip
    return None


def _convex_cost(x: FloatArray, y: FloatArray, weight: FloatArray) -> float:
    return float((weight * (y - convex_regression(x, y, weight)[0]) ** 2).sum())


def _cuts(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[list[int], list[float]]:
    """Return where convex stretches begin, with the end of all, and the gain of each cut between two of them."""
    lines = straight_lines(x, y, weight)
    cuts = [
        0,
        *(
            c
            for a, c, b in zip(lines[:-2], lines[1:-1], lines[2:], strict=True)
            if not _goes_on(x, y, weight, a, c, b)
        ),
        len(x),
    ]
    cost: dict[tuple[int, int], float] = {}

    def chi_square(a: int, b: int) -> float:
        if (a, b) not in cost:
            cost[a, b] = _convex_cost(x[a:b], y[a:b], weight[a:b])
        return cost[a, b]

    while True:
        gains = {
            c: chi_square(a, b) - chi_square(a, c) - chi_square(c, b)
            for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True)
        }
        least = min(gains, key=lambda c: gains[c], default=None)
        if least is None or gains[least] >= _CONTRADICTED:
            break
        cuts.remove(least)

    # A convex chain takes the first strip of the next one for an edge so steep that one strip shows it: the strips
    # beside a cut go to the side that explains them with fewer lines, and lower steps.
    per_line = _per_line(len(x))

    def cost_of(a: int, b: int, right: bool) -> float:
        lines, cost = _best_lines(x[a:b], y[a:b], weight[a:b], per_line, per_line / 3.0)
        if len(lines) > 2 and lines[-1] - lines[-2] <= 2 if right else len(lines) > 2 and lines[1] <= 2:
            p, q = a + (lines[-3:-1] if right else lines[1:3])
            end = b - 1 if right else a
            level = _height(_line(x[p:q], y[p:q], weight[p:q])[0], x[end]) if q - p > 1 else y[p]
            cost += _PER_STEP * float(np.log1p(abs(y[end] - level) * np.sqrt(weight[end])))
        return chi_square(a, b) + cost

    for i in range(1, len(cuts) - 1):
        a, c, b = cuts[i - 1 : i + 2]
        costs = {at: cost_of(a, at, True) + cost_of(at, b, False) for at in (c, c - 1, c + 1) if a < at < b}
        cuts[i] = int(min(costs, key=lambda at: costs[at]))
    return cuts, list(gains.values())


def straight_lines(x: FloatArray, y: FloatArray, weight: FloatArray) -> IntArray:
    """Return the strips where the straight lines begin that explain y best (L + 1,), with the end of all.

    Every line costs its parameters; which ones, dynamic programming finds exactly.
    """
    return _best_lines(x, y, weight, _per_line(len(x)))[0]


def _per_line(strips: int) -> float:
    return float(_PER_LINE * np.log(max(strips, 2)) + _ALSO)


def _best_lines(
    x: FloatArray, y: FloatArray, weight: FloatArray, per_line: float, single: float = 0.0
) -> tuple[IntArray, float]:
    """Return where the best lines begin (L + 1,), with the end of all, and their cost; `single`: less for one strip."""
    n = len(x)
    x, y = x - x.mean(), y - y.mean()
    sums = np.zeros((6, n + 1))
    np.cumsum(weight * np.stack([np.ones(n), x, x * x, y, x * y, y * y]), axis=1, out=sums[:, 1:])
    best, back = np.zeros(n + 1), np.zeros(n + 1, dtype=np.int64)
    s, sx, sxx, sy, sxy, syy = (
        sums[:, None, :] - sums[:, :, None]
    )  # from the row's strip to before the column's
    with np.errstate(divide="ignore", invalid="ignore"):
        own = s * sxx - sx * sx
        cost = syy - sy * sy / s - np.where(own > 1e-12 * s * sxx, (s * sxy - sx * sy) ** 2 / (own * s), 0.0)
    for stop in range(1, n + 1):
        totals = best[:stop] + np.maximum(cost[:stop, stop], 0.0)
        totals[-1] -= single
        back[stop] = totals.argmin()
        best[stop] = totals[back[stop]] + per_line
    found = [n]
    while found[-1]:
        found.append(int(back[found[-1]]))
    return np.array(found[::-1]), float(best[-1])


def _line(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return height at the middle, slope and middle (3,) of the line through points, and its covariance (2, 2)."""
    total = weight.sum()
    middle = float(weight @ x / total)
    spread = float(weight @ (x - middle) ** 2)
    slope = float(weight @ ((x - middle) * y)) / spread
    return np.array([weight @ y / total, slope, middle]), np.diag([1.0 / total, 1.0 / spread])


def _goes_on(x: FloatArray, y: FloatArray, weight: FloatArray, a: int, c: int, b: int) -> bool:
    """Whether the lines of strips a to c and c to b plainly meet in a convex corner between the two."""
    if min(c - a, b - c) < 2:
        return False
    (left, _), (right, _) = _line(x[a:c], y[a:c], weight[a:c]), _line(x[c:b], y[c:b], weight[c:b])
    beside = _BESIDE * (x[c] - x[c - 1])
    differ = [_height(right, at) - _height(left, at) for at in (x[c - 1] - beside, x[c] + beside)]
    return bool(right[1] > left[1] and differ[0] < 0.0 < differ[1])


def _height(line: FloatArray, x: float) -> float:
    return float(line[0] + line[1] * (x - line[2]))


def _stretches(
    x: FloatArray,
    y: FloatArray,
    weight: FloatArray,
    pitch: float,
    at: IntArray,
    cuts: list[int],
    gains: list[float],
) -> tuple[Stretch, ...]:
    fitted = []
    for a, b in pairwise(cuts):
        own = at[a:b]
        fitted.append(_polyline(x[own], y[own], weight[own], pitch))
    between = [
        _cut(int(at[c]), x[at[c - 1]], x[at[c]], left[1:], right[1:], pitch, gain)
        for c, left, right, gain in zip(cuts[1:-1], fitted[:-1], fitted[1:], gains, strict=True)
    ]
    return tuple(
        Stretch(int(at[a]), int(at[b - 1]) + 1, before, after, *found)
        for a, b, before, after, found in zip(
            cuts[:-1], cuts[1:], [None, *between], [*between, None], fitted, strict=True
        )
    )


def _polyline(
    x: FloatArray, y: FloatArray, weight: FloatArray, pitch: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return borders, lines, covariances and chi square of the convex polyline through a stretch's strips."""
    fitted, _ = convex_regression(x, y, weight)
    chi_square = float((weight * (y - fitted) ** 2).sum())
    ends = x[[0, -1]] + [-0.5 * pitch, 0.5 * pitch]
    if len(x) == 1:
        flat = np.array([[y[0], 0.0, x[0]]])
        return ends, flat, np.array([np.diag([1.0 / weight[0], (y[0] / pitch) ** 2])]), chi_square
    cuts = list(straight_lines(x, y, weight))
    while True:
        found = []
        for a, b in pairwise(cuts):
            a, b = (a, b) if b - a > 1 else (a, b + 1) if a == 0 else (a - 1, b)
            found.append(_line(x[a:b], y[a:b], weight[a:b]))
        lines = np.stack([line for line, _ in found])
        height, slope, middle = lines.T
        with np.errstate(divide="ignore", invalid="ignore"):
            meet = np.diff(slope * middle - height) / np.diff(slope)
        borders = np.concatenate([ends[:1], meet, ends[1:]])
        wrong = np.flatnonzero((np.diff(slope) <= 0.0) | ~np.isfinite(meet))
        late = np.flatnonzero(~(np.diff(borders) > 0.0))
        if not len(wrong) and not len(late):
            return borders, lines, np.stack([covariance for _, covariance in found]), chi_square
        # Lines that make no convex chain are one: the pair that costs least.
        places = wrong if len(wrong) else np.unique(np.clip([late - 1, late], 0, len(meet) - 1))
        worse = [_joint_cost(x, y, weight, cuts[i], cuts[i + 2]) for i in places]
        del cuts[places[int(np.argmin(worse))] + 1]


def _joint_cost(x: FloatArray, y: FloatArray, weight: FloatArray, a: int, b: int) -> float:
    line, _ = _line(x[a:b], y[a:b], weight[a:b])
    return float((weight[a:b] * (y[a:b] - line[0] - line[1] * (x[a:b] - line[2])) ** 2).sum())


def _cut(
    strip: int,
    before: float,
    behind: float,
    left: tuple[FloatArray, FloatArray, float],
    right: tuple[FloatArray, FloatArray, float],
    pitch: float,
    gain: float,
) -> Cut:
    """Tell a jump between the strips at `before` and `behind` [mm] from a corner."""
    a, of_a, b, of_b = left[0][-1], left[1][-1], right[0][0], right[1][0]

    def rise(x: float) -> tuple[float, float]:
        """Return by how much the right line lies above the left one, and its deviation."""
        by_a, by_b = np.array([1.0, x - a[2]]), np.array([1.0, x - b[2]])
        return _height(b, x) - _height(a, x), float(np.sqrt(by_a @ of_a @ by_a + by_b @ of_b @ by_b))

    rises, sigmas = zip(*(rise(x) for x in (before - _UNSURE * pitch, behind + _UNSURE * pitch)), strict=True)
    if rises[0] * rises[1] > 0.0 and all(abs(r) >= _JUMPS * s for r, s in zip(rises, sigmas, strict=True)):
        return Cut(strip, "begins" if rises[0] < 0.0 else "ends", min(map(abs, rises)), gain)
    return Cut(strip, "corner", max(abs(rise(x)[0]) for x in (before, behind)), gain)

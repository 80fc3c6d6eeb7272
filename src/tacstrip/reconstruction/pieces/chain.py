"""One end of the contact along the strips, cut where no convex chain goes on: jumps and inward corners.

Where convex objects share strips, l is the least of their lower chains and -u the least of the others turned over, so
that one function serves both. It is cut into straight lines by dynamic programming, and of the cuts those stay whose
removal the readings would contradict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.convex_chain import CONTRADICTED, convex_cost, convex_cuts, height, polyline

Kind: TypeAlias = Literal["begins", "ends", "corner"]
# Borders, lines, variances and chi square.
_Polyline: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, float]

_JUMPS = 3.0  # deviations between two lines: less, and they may meet
_FEWEST = 3  # strips of a stretch that may lose one
# Pitches by which a cut may be off: lines that cross so near leave open what begins or ends there.
_UNSURE = 1.0
# Strips at either side of one that fits neither: of fewer it may be the first of another piece.
_BESIDE_ALONE = 5
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
    variances
        Of height and slope (M, 2).
    chi_square
        What it leaves of the readings.
    strips_x
        Where its strips are (stop - start,) [mm].
    """

    start: int
    stop: int
    before: Cut | None
    after: Cut | None
    x: FloatArray
    lines: FloatArray
    variances: FloatArray
    chi_square: float
    strips_x: FloatArray

    @cached_property
    def shown(self) -> FloatArray:
        """Height of the chain on its strips (stop - start,) [mm]."""
        return self.at(self.strips_x)

    def at(self, x: FloatArray) -> FloatArray:
        """Return the chain's height at x (n,), lengthened by its outer lines: the highest line."""
        height, slope, middle = self.lines.T[:, :, None]
        found = height + slope * (x - middle)  # (M, n)
        return np.asarray(found.max(axis=0) if len(found) > 1 else found[0])

    def split(self, strip: int, x: float) -> tuple[Stretch, Stretch]:
        """Return what lies left and right of x [mm], before `strip`, as if an inward corner lay there."""
        cut = Cut(strip, "corner", 0.0, math.inf)
        inner = self.x[1:-1]
        left, right = int((inner < x).sum()), int((inner <= x).sum())
        return (
            Stretch(
                self.start, strip, self.before, cut, np.append(self.x[: left + 1], x), self.lines[: left + 1],
                self.variances[: left + 1], self.chi_square, self.strips_x[: strip - self.start],
            ),
            Stretch(
                strip, self.stop, cut, self.after, np.append(x, self.x[right + 1 :]), self.lines[right:],
                self.variances[right:], 0.0, self.strips_x[strip - self.start :],
            ),
        )  # fmt: skip

    @cached_property
    def corners(self) -> FloatArray:
        """Its corners, ends included (M + 1, 2)."""
        height, slope, middle = self.lines.T
        found = np.empty((len(self.x), 2))
        found[:, 0] = self.x
        found[:-1, 1] = height + slope * (self.x[:-1] - middle)
        found[-1, 1] = height[-1] + slope[-1] * (self.x[-1] - middle[-1])
        return found


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
        kept = self._polyline(own)
        rise = float(self.y[end] - height(kept[1][-1 if right else 0], self.x[end]))
        if rise < least:
            return None
        alone = self._polyline(np.array([end]))
        if right:
            cut = Cut(int(end), "ends", rise, 0.0)
            return (
                self._stretch(whole.start, int(end), whole.before, cut, kept),
                self._stretch(int(end), whole.stop, cut, whole.after, alone),
            )
        cut = Cut(int(own[0]), "begins", rise, 0.0)
        return (
            self._stretch(int(own[0]), whole.stop, cut, whole.after, kept),
            self._stretch(whole.start, int(own[0]), whole.before, cut, alone),
        )

    def _polyline(self, own: IntArray) -> _Polyline:
        return polyline(self.x[own], self.y[own], self.weight[own], self.pitch)

    def _stretch(
        self, start: int, stop: int, before: Cut | None, after: Cut | None, found: _Polyline
    ) -> Stretch:
        return Stretch(start, stop, before, after, *found, self.x[start:stop])


def split_chain(x: FloatArray, y: FloatArray, sigma: FloatArray, pitch: float) -> Chain:
    """Cut an end y (n,) at strips x (n,) [mm], of deviations sigma (n,), into convex stretches.

    A single strip that fits neither side is left out, be it a channel at fault, the edge of a piece on a wide strip, or
    a piece on that strip alone.
    """
    weight, used = 1.0 / sigma**2, np.isfinite(y)
    for _ in range(_ROUNDS):
        at = np.flatnonzero(used)
        cuts, gains = convex_cuts(x[at], y[at], weight[at])
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
                whole, left, right = (convex_cost(x[part], y[part], weight[part]) for part in parts)
                if whole - left - right < CONTRADICTED:
                    return strip
    return None


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
        fitted.append(polyline(x[own], y[own], weight[own], pitch))
    between = [
        _cut(int(at[c]), float(x[at[c - 1]]), float(x[at[c]]), left, right, pitch, gain)
        for c, left, right, gain in zip(cuts[1:-1], fitted[:-1], fitted[1:], gains, strict=True)
    ]
    starts, stops = at[cuts[:-1]].tolist(), (at[np.array(cuts[1:]) - 1] + 1).tolist()
    return tuple(
        Stretch(start, stop, before, after, *found, x[start:stop])
        for start, stop, before, after, found in zip(
            starts, stops, [None, *between], [*between, None], fitted, strict=True
        )
    )


def _cut(
    strip: int,
    before: float,
    behind: float,
    left: _Polyline,
    right: _Polyline,
    pitch: float,
    gain: float,
) -> Cut:
    """Tell a jump between the strips at `before` and `behind` [mm] from a corner."""
    (a, of_a), (b, of_b) = ((found[1][i], found[2][i]) for found, i in ((left, -1), (right, 0)))

    def rise(x: float) -> tuple[float, float]:
        """Return by how much the right line lies above the left one, and its deviation."""
        variance = of_a[0] + of_a[1] * (x - a[2]) ** 2 + of_b[0] + of_b[1] * (x - b[2]) ** 2
        return height(b, x) - height(a, x), math.sqrt(variance)

    rises, sigmas = zip(*(rise(x) for x in (before - _UNSURE * pitch, behind + _UNSURE * pitch)), strict=True)
    if rises[0] * rises[1] > 0.0 and all(abs(r) >= _JUMPS * s for r, s in zip(rises, sigmas, strict=True)):
        return Cut(strip, "begins" if rises[0] < 0.0 else "ends", min(map(abs, rises)), gain)
    return Cut(strip, "corner", max(abs(rise(x)[0]) for x in (before, behind)), gain)

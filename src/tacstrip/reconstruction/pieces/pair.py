"""Two convex objects that share strips, or one concave one: which of both explains l and u, and how likely.

On every strip that two disjoint convex objects share, one lies above the other. So l and u are convex chains but for
two events: one object begins, or ends, beside the other. All ways to place these near inward corners of an outline are
tried; chains are convex regressions, and what is seen of both objects must lie apart and within the readings.

Where an object reaches a strip further than the other no inward corner shows it: a convex outline explains l and u too,
by an edge that is nearly along the strips and crosses just the outermost one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import TypeAlias

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import convex_regression, hull_ends
from tacstrip.reconstruction.result import Alternative

# Deviations by which what is seen of one object may reach into the other, or beyond the readings.
_SLACK = 3.0
# The prior: two objects are as likely as a concave one, of which so many have an overhang, or edges along the strips;
# that one of two begins, or ends, within a strip of the other has a probability of so much over the strips; a contact
# of one object is pointed there, by so many pitches a strip, as often as it has any other width.
_OVERHANG, _WITHIN_A_STRIP, _POINTED = 0.2, 2.0, 2.0
# From log odds by that prior to those of drawn pairs and concave shapes, as many of each: a constant, and what the
# logarithms of a gap (and so much), of the highest jump (and so much) and of the contact's proportion tell.
_CONSTANT, _BY_GAP, _TOUCHING, _BY_RISE, _FLAT, _BY_PROPORTION = 1.45, 0.85, 0.005, -0.53, 0.02, 3.5
# Log odds of a pair to one convex object, of which some four times as many are met, fitted to drawn ones: a constant,
# powers of an end's jump over the contact's breadth and of the width (at least so much) at the other side over its
# height, and what parallel sides tell, within so many deviations of chi square.
_OF_CONVEX, _BY_JUMP, _BY_WIDTH, _TIP = -0.25, 3.85, 1.45, 0.05
_BY_PARALLEL, _PARALLEL = -3.0, 3.0
# Of an outermost strip, where just one end jumps: pitches, deviations, and strips at least that tell a jump.
_SPIKE, _SURE, _LEAST_STRIPS = 2.0, 6.0, 4
_NORMAL = math.sqrt(2.0 * math.pi)
_LEAST = 0.01  # probability by that prior, from which two objects are told


Places: TypeAlias = tuple[tuple[int, int], tuple[int, int]]  # strips of the lower, and of the upper object
Chains: TypeAlias = tuple[
    list[FloatArray], ...
]  # of l and of -u: on the strips of its object, and on the others


@dataclass(frozen=True, eq=False)
class Pair:
    """Two convex objects that explain a run's l and u best.

    Attributes
    ----------
    lower, upper
        Outlines of what is seen of them (N, 2) [mm], counter-clockwise.
    probability
        Of two objects, if it is these or one concave object, and both are met as often.
    one_convex
        Whether it is one convex object else.
    advice
        What shows that they touch nowhere, in words; "" where nothing does.
    meeting_mm
        Of two beside each other: between which x they meet, where what each has of its end is not seen.
    shared
        Strips that both touch.
    """

    lower: FloatArray
    upper: FloatArray
    probability: float
    one_convex: bool = False
    advice: str = ""
    meeting_mm: tuple[float, float] | None = None
    shared: int = 1

    @property
    def alternative(self) -> Alternative:
        """Both, as an alternative to one object."""
        return Alternative(self.probability, self.lower, others=(self.upper,))

    def overlap(self, outline: FloatArray) -> float:
        """Return the IoU of an outline (N, 2) [mm] with both together."""
        own, both = (
            shapely.Polygon(outline).buffer(0.0),
            shapely.union(*map(shapely.Polygon, (self.lower, self.upper))),
        )
        return float(shapely.area(shapely.intersection(own, both)) / shapely.area(shapely.union(own, both)))


@dataclass(frozen=True, eq=False)
class Ends:
    """What strips read: x, and (2, n) l and u, with their deviations [mm]; pitch [mm]."""

    x: FloatArray
    y: FloatArray
    sigma: FloatArray
    pitch: float


@dataclass(frozen=True)
class Seen:
    """How convex pieces that explain a concave outline's readings look as wholes.

    Attributes
    ----------
    gap
        Least distance over the strips' length between what is seen of pieces; 0: they touch.
    rise
        By how much an end jumps at most where a piece begins or ends, over the contact's height.
    proportion
        The contact's height over its breadth. Of two objects that share strips one lies above the other, so that both
        together are rather higher than broad, as one object seldom is; less than 1 tells nothing.
    """

    gap: float
    rise: float
    proportion: float

    @property
    def log_odds(self) -> float:
        """What they tell of two objects against a concave one, which jumps one by one do not."""
        of_gap = _BY_GAP * math.log(self.gap + _TOUCHING)
        of_size = _BY_PROPORTION * math.log(max(self.proportion, 1.0))
        return _CONSTANT + of_gap + of_size + _BY_RISE * math.log(self.rise + _FLAT)


class ChainFits:
    """Convex regressions of a run's ends, which two objects and one are made of.

    Parameters
    ----------
    ends
        Of the run.
    corners
        Strips right of the inward corners of l, and of u, between which one object's chains are convex. None: it is.
    """

    def __init__(self, ends: Ends, corners: Sequence[Sequence[int]] | None) -> None:
        self._ends, self._corners, self._n = ends, corners, len(ends.x)
        self._y, self._weight = ends.y * [[1.0], [-1.0]], 1.0 / ends.sigma**2
        self._chains: dict[tuple[int, int, int, bool], tuple[FloatArray, float]] = {}
        self._least: dict[tuple[int, tuple[int, ...]], float] = {}

    def chain(self, side: int, begin: int, end: int, inside: bool) -> tuple[FloatArray, float]:
        """Return the convex chain of the strips from begin to end, or of the others, and its chi square."""
        found = self._chains.get((side, begin, end, inside))
        if found is None:
            own, y, weight = strips_from(self._n, begin, end) == inside, self._y[side], self._weight[side]
            fitted, chi_square = y[own], 0.0
            if own.any():  # else the other one's, of one that is on all strips
                fitted, _ = convex_regression(self._ends.x[own], fitted, weight[own])
                chi_square = float((weight[own] * (y[own] - fitted) ** 2).sum())
            found = self._chains[side, begin, end, inside] = fitted, chi_square
        return found

    def of_one(self, both: Places) -> float:
        """Return the chi square that one object leaves where two would be so placed."""
        total = 0.0
        for side, place in enumerate(both):
            cuts = tuple(i for i in place if 0 < i < self._n)
            if (side, cuts) not in self._least:
                self._least[side, cuts] = self._least_of(side, cuts)
            total += self._least[side, cuts]
        return total

    def _alone(self, side: int, cuts: Sequence[int]) -> float:
        """Return the chi square of one object's chain that is convex between cuts."""
        return sum(self.chain(side, a, b, True)[1] for a, b in pairwise(sorted({0, *cuts, self._n})))

    def _least_of(self, side: int, cuts: tuple[int, ...]) -> float:
        """Return what one object's chain leaves that rises before the same strips as a pair's.

        Its corner may lie a strip away, if that strip lies on the edge between: by a chance of its noise to the rise.
        """
        own = [] if self._corners is None else list(self._corners[side])
        found, y = self._alone(side, own), self._y[side]
        for cut in cuts:
            if near := [i for i in own if abs(i - cut) == 1]:
                on, rise = min(cut, near[0]), abs(y[cut] - y[cut - 1])
                chance = 2.0 * math.log(max(rise / (_NORMAL * self._ends.sigma[side, on]), 1.0))
                same = self._alone(side, [cut if i == near[0] else i for i in own])
                found += min(max(same - found, 0.0), chance)
        return found


def likeliest_pair(
    ends: Ends,
    places: Sequence[Sequence[int]],
    corners: Sequence[Sequence[int]] | None,
    seen: Seen | None = None,
) -> Pair | None:
    """Return the pair that is likeliest beside one object; None where none is possible, or likely at all.

    Parameters
    ----------
    ends
        Of the run.
    places
        Strips of l, and of u, before which an object may begin or end.
    corners
        Strips right of the inward corners of l, and of u: between them the concave object's chains are convex. None:
        the one object is convex.
    seen
        What pieces that explain the concave outline's readings tell.
    """
    n, best, found = len(ends.x), math.log(_LEAST / (1.0 - _LEAST)), None
    limit = math.inf if corners is None else math.log(4.0 / _OVERHANG)
    fits = ChainFits(ends, corners)
    for both in _places(n, places):
        # Where the lower object is, l is its; where the upper one is, u is its; elsewhere the other's.
        more = -fits.of_one(both)
        parts: tuple[list[FloatArray], ...] = ([], [])
        for (side, place), inside in product(enumerate(both), (True, False)):
            if limit - 0.5 * max(more, 0.0) <= best:
                break
            fitted, chi_square = fits.chain(side, *place, inside)
            parts[side].append(fitted)
            more += chi_square
        if limit - 0.5 * max(more, 0.0) <= best:
            continue
        prior = _log_odds_to_convex(ends, both) if corners is None else _log_odds(ends, both, parts)
        odds = prior - 0.5 * max(more, 0.0)
        if odds > best and (hulls := shown(ends, both, parts)) is not None:
            best, found = odds, hulls
    if found is None:
        return None
    odds = best if seen is None else best + seen.log_odds
    return Pair(*found, 1.0 / (1.0 + math.exp(-odds)), corners is None)


def pair_at_the_ends(ends: Ends) -> Pair | None:
    """Return the two objects that a convex outline may be, of which one reaches an outermost strip further.

    There one end jumps, and the other goes on. Where one object ends both come nearer to each other, unless an edge
    nearly along the strips crosses the outermost one.
    """
    n, y = len(ends.x), ends.y
    if n < _LEAST_STRIPS:
        return None
    bend = np.diff((y * [[1.0], [-1.0]])[:, [[2, 1, 0], [-3, -2, -1]]], n=2)[..., 0]
    alone = bend - np.maximum(bend[::-1], 0.0)
    jumps = alone > np.maximum(_SPIKE * ends.pitch, _SURE * ends.sigma[:, [0, -1]])
    if not jumps.any():
        return None
    near = [[at for at, jump in ((1, of[0]), (n - 1, of[1])) if jump] for of in jumps]
    return likeliest_pair(ends, near, None)


def strips_from(n: int, begin: int, end: int) -> BoolArray:
    """Return which of n strips are those from `begin` to before `end`."""
    own = np.zeros(n, dtype=np.bool_)
    own[begin:end] = True
    return own


def _places(n: int, corners: Sequence[Sequence[int]]) -> Iterator[Places]:
    """Yield the strips of the lower and of the upper object, together all, with no untouched one between."""
    whole, (of_l, of_u) = (0, n), corners
    for i in of_l:
        for j in of_u:
            if j <= i:
                yield (0, i), (j, n)
            if i <= j:
                yield (i, n), (0, j)
    for cuts, upper in ((of_l, False), (of_u, True)):
        ends = [
            *((a, n) for a in cuts),
            *((0, b) for b in cuts),
            *((a, b) for a in cuts for b in cuts if a < b),
        ]
        for place in ends:
            yield (whole, place) if upper else (place, whole)


def _log_odds_to_convex(ends: Ends, both: Places) -> float:
    """Return the log odds of two objects so placed to one convex one, of which an edge crosses just an outermost strip.

    One object is about as broad as it is high: that an edge rises far within a pitch is the rarer, the further it does
    so over the contact's breadth. Of two objects one begins at any height beside the other; at the side where they
    begin or end together the contact is wide, and that of one object often pointed. Sides of one are often parallel.
    """
    n, broad = len(ends.x), len(ends.x) * ends.pitch
    begins = [(side, strip) for side, place in enumerate(both) for strip in place if 0 < strip < n]
    jump = max(ends.pitch, *(abs(float(ends.y[side, i] - ends.y[side, i - 1])) for side, i in begins))
    together = [end for end, at in ((0, 1), (-1, n - 1)) if at not in (strip for _, strip in begins)]
    wide = min((float(np.ptp(ends.y[:, end]) / np.ptp(ends.y)) for end in together), default=1.0)
    odds = _OF_CONVEX + _BY_JUMP * math.log(jump / broad) + _BY_WIDTH * math.log(max(wide, _TIP))
    return odds + _BY_PARALLEL * _parallel(ends, both)


def _parallel(ends: Ends, both: Places) -> bool:
    """Whether parallel lines explain the lower object's l and the upper one's u."""
    own = np.stack([strips_from(len(ends.x), *place) for place in both])
    side, strip = np.nonzero(own)
    lines = np.column_stack([side == 0, side == 1, ends.x[strip] - ends.x.mean()]) / ends.sigma[own][:, None]
    target = ends.y[own] / ends.sigma[own]
    off = target - lines @ np.linalg.lstsq(lines, target, rcond=None)[0]
    freedom = len(target) - 3
    return float(off @ off) <= freedom + _PARALLEL * math.sqrt(2.0 * freedom)


def _log_odds(ends: Ends, both: Places, parts: Chains) -> float:
    """Return the log odds of two objects so placed to one concave one, but for what each leaves of the readings.

    Of two objects one begins at any height beside the other; that it does so within a strip is a coincidence. An edge
    of one object may have any direction: that it rises far within a pitch is one, unless the object overhangs.
    """
    n, height = len(ends.x), float(np.ptp(ends.y))
    of_two, of_one, overhang = 0.0, 0.0, 0.0
    for at, outermost in zip(zip(*both, strict=True), (max, min), strict=True):
        if abs(at[0] - at[1]) <= 1 and (min(at) == 0 or max(at) == n):
            strip = outermost(at) - (outermost is min)
            wide = float(ends.y[1, strip] - ends.y[0, strip])
            pointed = at_any_angle(wide, _POINTED * (1 + abs(at[0] - at[1])) * ends.pitch) * height
            of_two += math.log(min(_WITHIN_A_STRIP / n, 1.0)) - math.log(0.5 + 0.5 * pointed)
    for side, place in enumerate(both):
        for strip in place:
            if 1 < strip < n - 1:  # at the outer strip an edge of a concave one may be as steep
                of_two -= math.log(height)
                overhang -= math.log(height)
                of_one += math.log(at_any_angle(*_step(ends, side, strip, place, parts[side])))
    concave = np.logaddexp(math.log(1.0 - _OVERHANG) + of_one, math.log(_OVERHANG) + overhang)
    return of_two - float(concave)


def at_any_angle(rise: float, run: float) -> float:
    """Return the probability density of a rise over so long a run, of lines in all directions."""
    return 2.0 / math.pi * run / (run**2 + rise**2)


def _step(
    ends: Ends, side: int, strip: int, place: tuple[int, int], fitted: list[FloatArray]
) -> tuple[float, float]:
    """Return by how much an end rises before a strip beyond the chains beside it; and pitch with noise."""
    rises, run = rises_beyond(ends, side, strip, place, fitted)
    crossing = min(rises) < 0.0 < max(rises)  # of the lines: a corner
    return 0.0 if crossing else min(map(abs, rises)), run


def rises_beyond(
    ends: Ends, side: int, strip: int, place: tuple[int, int], fitted: list[FloatArray]
) -> tuple[list[float], float]:
    """Return by how much an end rises before a strip beyond each chain beside it that has a slope; pitch with noise."""
    n, x, y = len(ends.x), ends.x, np.empty(len(ends.x))
    inside = strips_from(n, *place)
    y[inside], y[~inside] = fitted
    slopes = np.diff(y) / np.diff(x)
    rise, run = y[strip] - y[strip - 1], x[strip] - x[strip - 1]
    beside = [i for i in (strip - 2, strip) if 0 <= i < n - 1 and inside[i] == inside[i + 1]]
    rises = [float(rise - slopes[i] * run) for i in beside] or [float(rise)]
    return rises, math.hypot(ends.pitch, *ends.sigma[side, [strip - 1, strip]])


def shown(ends: Ends, both: Places, parts: Chains) -> tuple[FloatArray, FloatArray] | None:
    """Return the hulls of what is seen of both, or None where they cannot be apart."""
    n, x, slack = len(ends.x), ends.x, _SLACK * ends.sigma
    low, high = (strips_from(n, *place) for place in both)
    (l_low, l_high), (u_high, u_low) = parts
    of_low = np.column_stack([np.concatenate([x[low], x[~high]]), np.concatenate([l_low, -u_low])])
    of_high = np.column_stack([np.concatenate([x[high], x[~low]]), np.concatenate([-u_high, l_high])])
    tops, bottoms = np.full(n, -np.inf), np.full(n, np.inf)
    tops[low], bottoms[high] = hull_ends(of_low, x[low])[1], hull_ends(of_high, x[high])[0]
    shared = low & high
    if (tops[shared] > bottoms[shared] + slack[:, shared].max(axis=0)).any():
        return None
    if (tops[~high] > slack[1, ~high] - u_low).any() or (bottoms[~low] < l_high - slack[0, ~low]).any():
        return None
    return _hull(of_low, ends.pitch), _hull(of_high, ends.pitch)


def _hull(points: FloatArray, pitch: float) -> FloatArray:
    """Return the convex hull of points (N, 2), counter-clockwise; of points on a line a sliver around it."""
    hull = shapely.convex_hull(shapely.multipoints(points))
    if hull.geom_type != "Polygon":
        hull = shapely.convex_hull(hull.buffer(0.1 * pitch))
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(hull))[:-1]
    return np.asarray(np.roll(ring, -int(np.lexsort((ring[:, 1], ring[:, 0]))[0]), axis=0))

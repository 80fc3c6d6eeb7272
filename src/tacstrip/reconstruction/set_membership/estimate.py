"""The outline and its vertices where the noise of a reading has a known bound.

All outlines that stay within the bound of every reading are equally good, and they are far fewer than a normal
distribution of the same variance would leave: the set shrinks with 1 / n, not 1 / sqrt(n). The estimate is the set's
mean, the covariance its scatter, and `Bounded.regions` holds what is guaranteed. If no outline with few vertices stays
within the bound, there are more; if none with any number does, the model or the bound is wrong.

For the guaranteed regions, kinks are looked for in zones somewhat wider than the set of outlines found. In a zone only
such bounds of readings are used as hold wherever in it the kink lies. What is left is a polytope that no such outline
is outside of, and linear programs give how far its crossings, and the edges beside them, reach.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.signature import signatures
from tacstrip.core.binding import at as address
from tacstrip.core.binding import exported
from tacstrip.core.hit_and_run import SWEEPS, hit_and_run
from tacstrip.core.polytope import largest, lowest
from tacstrip.errors import ContactError
from tacstrip.geometry.moments import LEVEL, MomentDeviations, axis_deviation
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds
from tacstrip.reconstruction.set_membership.feasible_set import Effort, feasible_point, feasible_set
from tacstrip.reconstruction.set_membership.outlines import draw_outlines, scatter, shuffled_ends

_MARGINS = (0.25, 0.5, 1.5, 4.0)  # of the found kinks' span: how much wider the zones are on either side
_MOST_BOUNDS = 240  # bounds that are used; leaving some out makes the regions larger, never wrong
_ROUNDING = 1e-6  # of the pitch: regions are larger by it than linear programs say
_STEPS = 20
_ROOM = 6  # what the core works in, of each height and each reading or outline
_EFFORT = 1_500.0  # for one outline
_REACH, _FURTHER = 4.0, 12.0  # standard errors of least squares within which a kink is looked for
_NORMAL = -2.0 * math.log(
    1.0 - LEVEL
)  # squared Mahalanobis distance that holds so much of a normal error in the plane
# The set's deviations are those of least squares times about the root of heights over readings. Where there are fewer
# corners than the object has, what the bound leaves is far less: at least so much of that is told.
_USUAL = 1.5
_NOTHING = 1e-30
_BENT = 0.05  # of a reading's band: by how much the mean may leave it, as the set is not quite convex


@dataclass(frozen=True, eq=False)
class Regions:
    """Convex polygons (K, 2) [mm]: of each kink, lower chain first, and of both vertices of the left and right end."""

    kinks: list[FloatArray]
    ends: list[tuple[FloatArray, FloatArray]]


def guaranteed(band: ReadingBounds, lines: EdgeLines, points: FloatArray) -> Regions | None:
    """Return a region for every vertex; None where the readings do not confine a kink.

    What is guaranteed: every outline (a) with these edges, turning the same way at each kink, (b) with its kinks in
    the zones searched, and (c) within the band, has its vertices in the regions. No such outline has a kink in a
    zone outside of its region, so that the set found is all there is from zone's end to zone's end. Outlines with more
    vertices, or kinks further off, are not covered. With contact resistance the contact's length on each strip is
    searched within a range in the same way.

    Parameters
    ----------
    band, lines
        The readings' bounds and the outline's edges.
    points
        Heights (K, P) [mm] of outlines in the set.
    """
    count = len(lines.turns)
    found = lines.cross(points)[:, :count]
    low, high = found.min(axis=0), found.max(axis=0)
    for margin in _MARGINS:
        spread = margin * (high - low) + 0.5 * band.sensor.pitch_mm
        zones = np.stack([low - spread, high + spread], axis=1)
        if not _apart(zones, lines, band):
            return None
        widths = _searched_widths(band, lines, zones, points, margin)
        try:
            search = _Search(band, lines, zones, widths, points)
            extents = search.extents()
            inside = np.all((extents[:count] > zones[:, :1]) & (extents[:count] < zones[:, 1:]))
            if inside and search.confirms(widths):
                # Nothing lies between the extents and the zones' ends: the zones may shrink.
                return _Search(band, lines, extents[:count], widths, points).regions()
        except (np.linalg.LinAlgError, ArithmeticError):
            return None  # a set too thin to compute with
    return None


def _apart(zones: FloatArray, lines: EdgeLines, band: ReadingBounds) -> bool:
    """Whether zones of one chain do not overlap, and lie between the outer strips."""
    inside = np.all(zones[:, 0] > band.x[0]) and np.all(zones[:, 1] < band.x[-1])
    split = lines.lower - 1
    return bool(inside and all(np.all(z[1:, 0] >= z[:-1, 1]) for z in (zones[:split], zones[split:])))


class _Search:
    """Linear programs over the polytope of given zones, in coordinates that make it round."""

    def __init__(
        self, band: ReadingBounds, lines: EdgeLines, zones: FloatArray, widths: FloatArray, points: FloatArray
    ) -> None:
        self.band, self.lines, self.points, self.pitch = band, lines, points, band.sensor.pitch_mm
        self.bounds = feasible_set(band, lines, zones, widths)
        self.middle = points.mean(axis=0)
        self.to_round = np.linalg.cholesky(np.cov(points, rowvar=False)).T  # h = middle + z @ to_round
        a = self.bounds.a @ self.to_round.T
        slack = self.bounds.b - self.bounds.a @ self.middle
        norm = np.linalg.norm(a, axis=1)
        a, slack = a / norm[:, None], slack / norm
        near = largest(-slack, _MOST_BOUNDS)
        self.a, self.slack = np.ascontiguousarray(a[near].T).T, slack[near]  # as the core takes it
        self._from_the_middle()

    def lowest(self, form: FloatArray) -> float:
        """Return the least of form h; `at` is where."""
        value = lowest(self.to_round @ form, self.a, self.slack, self.at, self.active)
        if not value > -np.inf:  # rounding can lead a warm start astray
            self._from_the_middle()
            value = lowest(self.to_round @ form, self.a, self.slack, self.at, self.active)
        if not value > -np.inf:
            raise ArithmeticError("no lowest point")
        return float(form @ self.middle + value)

    def _from_the_middle(self) -> None:
        self.at, self.active = np.zeros(len(self.middle)), np.full(len(self.middle), -1)

    def heights(self) -> FloatArray:
        """Return the heights where the last form was least."""
        return np.asarray(self.middle + self.at @ self.to_round)

    def extents(self) -> FloatArray:
        """Return how far each crossing reaches (C, 2) [mm]; a zone's end where it reaches that, or beyond."""
        pairs, turns = self.lines.crossings, np.concatenate([self.lines.turns, [1, -1]])
        given = [*([True] * len(self.lines.turns)), *(not b for b in self.lines.vertical)]
        found = self.bounds.zones.copy()
        seen = self.lines.cross(self.points)
        for c in np.flatnonzero(given):
            for end, start in ((0, seen[:, c].min()), (1, seen[:, c].max())):
                found[c, end] = self._reach(int(c), pairs[c], turns[c], end, float(start))
        return found

    def confirms(self, widths: FloatArray) -> bool:
        """Whether no outline has a length of contact at or beyond those searched."""
        if self.band.sensor.contact_lambda_mm == 0.0:
            return True
        x = self.band.x
        sure, l, u = _sure(self.band, self.lines, self.bounds.zones[: len(self.lines.turns)])
        # Between zones l and u are straight, so it is enough to look at the outer strips of each stretch.
        outer = np.flatnonzero(sure & ~(np.append(False, sure[:-1]) & np.append(sure[1:], False)))
        w, signs = u - l, (1.0, -1.0)
        least, most = (np.array([sign * self.lowest(sign * w[i]) for i in outer]) for sign in signs)
        low, high = np.interp(x[sure], x[outer], least), np.interp(x[sure], x[outer], most)
        allowed = (low > widths[1, sure]) | (widths[1, sure] == 0.0)
        return bool(np.all(allowed & (high < widths[2, sure])))

    def _reach(self, c: int, pair: IntArray, turn: float, end: int, x: float) -> float:
        """Move x outwards to where no crossing is beyond it."""
        out = 1.0 if end else -1.0
        limit = self.bounds.zones[c, end]
        for _ in range(_STEPS):
            x += out * _ROUNDING * self.pitch
            if out * (x - limit) >= 0.0:
                return float(limit)
            # Beyond its crossing the gap of two lines has one sign; least it must have it everywhere.
            second, first = self.lines.rows(pair[::-1], np.full(2, x))
            form = out * turn * (second - first)
            if self.lowest(form) >= 0.0:
                return x
            x = max(out * x, out * float(self.lines.cross(self.heights())[c])) * out
        return float(limit)

    def regions(self) -> Regions:
        """Return the regions of all vertices."""
        extents, pairs = self.extents(), self.lines.crossings
        count = len(self.lines.turns)
        kinks = [self._region(extents[c], pairs[c]) for c in range(count)]
        ends = []
        for c in (count, count + 1):
            if self.lines.vertical[c - count]:
                ends.append((self._region(extents[c], pairs[c][:1]), self._region(extents[c], pairs[c][1:])))
            else:
                both = self._region(extents[c], pairs[c])
                ends.append((both, both))
        return Regions(kinks, ends)

    def _region(self, x: FloatArray, lines: IntArray) -> FloatArray:
        """Return where lines pass between two x: a line's highest place is convex in x, so below its chord."""
        shape = None
        for line in lines:
            rows = self.lines.rows(np.full(2, line), x)
            slack = _ROUNDING * self.pitch
            (a, b), (d, e) = ([s * (self.lowest(s * row) - slack) for row in rows] for s in (1.0, -1.0))
            strip = shapely.Polygon([(x[0], a), (x[1], b), (x[1], e), (x[0], d)])
            shape = strip if shape is None else shapely.intersection(shape, strip)
        return np.asarray(shapely.get_coordinates(shape)[:-1])


def _searched_widths(
    band: ReadingBounds, lines: EdgeLines, zones: FloatArray, points: FloatArray, margin: float
) -> FloatArray:
    """Return expected, least and greatest length of contact on each strip (3, n) [mm]; in a zone, any."""
    if band.sensor.contact_lambda_mm == 0.0:
        return np.zeros((3, len(band.x)))
    sure, l, u = _sure(band, lines, zones)
    w = np.maximum(points @ (u - l).T, 0.0)  # (K, n)
    low, high = w.min(axis=0), w.max(axis=0)
    spread = margin * (high - low) + _ROUNDING * band.sensor.length_mm
    widths = np.array([w.mean(axis=0), np.zeros(len(band.x)), np.full(len(band.x), band.sensor.length_mm)])
    widths[1:, sure] = np.maximum(low - spread, 0.0)[sure], (high + spread)[sure]
    return widths


def _sure(
    band: ReadingBounds, lines: EdgeLines, zones: FloatArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return the strips outside of all zones (n,), and the rows of their l and u (n, P)."""
    x, split = band.x, lines.lower - 1
    sure = np.all((x <= zones[:, :1]) | (zones[:, 1:] <= x), axis=0)
    first = [(part[:, 1:] <= x).sum(axis=0) for part in (zones[:split], zones[split:])]
    return sure, lines.rows(first[0], x), lines.rows(lines.lower + first[1], x)


@dataclass(frozen=True, eq=False)
class Bounded:
    """What bounded noise leaves of an outline.

    Attributes
    ----------
    outline
        The mean of all outlines that stay within the band; the least-squares one where that is none of them, or
        where an edge crosses too few strips for a mean.
    covariance
        Their scatter (2 V, 2 V) [mm^2], in the order of `vertices.ravel()`, or that of least squares.
    radii
        Squared Mahalanobis distance within which 95 % of them have each vertex (V,): less than the 5.99 of a normal
        distribution, because the set has an end.
    deviations
        How far area, centroid and orientation of these outlines are from the mean's; None of least squares.
    band, points
        The readings' bounds, and heights of edges (K, P) [mm] of outlines in the set.
    fallback
        The same of least squares; None if this is it.
    """

    outline: Outline
    covariance: FloatArray
    radii: FloatArray
    deviations: MomentDeviations | None
    band: ReadingBounds
    points: FloatArray
    fallback: Bounded | None = None

    @cached_property
    def lines(self) -> EdgeLines:
        """The edges that points are heights of: those of the least-squares outline."""
        return EdgeLines.of(self.of_least_squares().outline)[0]

    def of_least_squares(self) -> Bounded:
        """Return the same set with the least-squares outline, covariance and all."""
        return self.fallback or self

    @cached_property
    def region_covariance(self) -> FloatArray:
        """The scatter, scaled so that a normal distribution's 95 % region of a vertex holds 95 % of the outlines."""
        scale = np.repeat(np.sqrt(self.radii / _NORMAL), 2)
        return self.covariance * np.outer(scale, scale)

    @cached_property
    def regions(self) -> list[FloatArray] | None:
        """Where each vertex is guaranteed to lie: a convex polygon (K, 2) [mm] each; None where none was found.

        See `regions.guaranteed` for what is guaranteed.
        """
        found = guaranteed(self.band, self.lines, self.points) if len(self.points) > 1 else None
        if found is None:
            return None
        lower, upper = self.outline.indices
        regions: list[FloatArray] = [np.empty((0, 2))] * len(self.outline.vertices)
        for vertex, region in zip((*lower[1:-1], *upper[1:-1]), found.kinks, strict=True):
            regions[vertex] = region
        for end, both in zip((0, -1), found.ends, strict=True):
            regions[lower[end]], regions[upper[end]] = both
            if lower[end] == upper[end]:  # one vertex where the set has two
                regions[lower[end]] = _hull(*both)
        return regions


def _hull(*regions: FloatArray) -> FloatArray:
    return np.asarray(shapely.get_coordinates(shapely.MultiPoint(np.concatenate(regions)).convex_hull)[:-1])


def refine(outline: Outline, covariance: FloatArray, band: ReadingBounds) -> Bounded | None:
    """Return what the band leaves of an outline; None where no outline of its kind stays within it.

    Parameters
    ----------
    outline
        A least-squares fit: it says how many vertices there are, on which chain, and which ends are vertical.
    covariance
        Its covariance (2 V, 2 V) [mm^2]: kinks are looked for within four standard errors, then within twelve.
    band
        The readings' bounds.
    """
    core = exported("bounded")
    told = None if core is None else in_one_call(core, outline, covariance, band)
    return plain_refine(outline, covariance, band) if told is None else told


def plain_refine(outline: Outline, covariance: FloatArray, band: ReadingBounds) -> Bounded | None:
    """Do as `refine`, step by step."""
    lines, heights = EdgeLines.of(outline)
    try:
        points = _points(outline, covariance, band, lines, heights, Effort(_EFFORT))
    except np.linalg.LinAlgError:  # there are some, in a set too thin to compute with
        return _least_squares(outline, covariance, band, heights[None])
    if points is None:
        return None
    least_squares = _least_squares(outline, covariance, band, points)
    chains = draw_outlines(points, lines, band)
    mean = None if chains is None else _mean(*chains, lines, band)
    if chains is None or mean is None:
        return least_squares
    return _judged(Bounded(mean, *scatter(mean, *chains), band, points, least_squares), least_squares)


def _least_squares(
    outline: Outline, covariance: FloatArray, band: ReadingBounds, points: FloatArray
) -> Bounded:
    return Bounded(outline, covariance, np.full(len(outline.vertices), _NORMAL), None, band, points)


def _judged(refined: Bounded, least_squares: Bounded) -> Bounded:
    """Return the mean and its scatter, no smaller than noise mostly leaves; least squares where the scatter is none."""
    if not np.isfinite(refined.region_covariance).all():
        return least_squares
    if refined.deviations is None or not np.isfinite(least_squares.covariance).all():
        return refined
    least = _USUAL * math.sqrt(refined.points.shape[1] / refined.band.count)
    size = _size(refined.region_covariance) / max(_size(least_squares.covariance), _NOTHING)
    more = max(1.0, least / max(size, _NOTHING))
    if more == 1.0:
        return refined
    area, centroid, turn = refined.deviations
    deviations = (more * area, more * centroid, axis_deviation(more * turn))
    return replace(refined, covariance=more**2 * refined.covariance, deviations=deviations)


def _size(covariance: FloatArray) -> float:
    """Return the standard deviation of a vertex's coordinates, by the geometric mean over vertices (2 V, 2 V)."""
    variance, off = np.diag(covariance), np.diag(covariance, 1)[::2]
    areas = variance[::2] * variance[1::2] - off**2
    return float(np.exp(0.25 * np.log(np.maximum(areas, _NOTHING)).mean()))


def in_one_call(
    core: Callable[..., int], outline: Outline, covariance: FloatArray, band: ReadingBounds
) -> Bounded | None:
    """Do as `refine` in one call of the core; None where it does not find points at once."""
    lower, upper = np.ascontiguousarray(outline.lower), np.ascontiguousarray(outline.upper)
    n = len(outline.vertices)
    split, both = len(lower), len(lower) + len(upper)
    size = 2 * (both - 2)
    covariance, shuffled = np.ascontiguousarray(covariance), shuffled_ends(SWEEPS)
    points, mean, found = np.empty((SWEEPS, size)), np.empty((both, 2)), np.empty(4 * n * n + n + 4)
    scattered = address(found), address(found) + 32 * n * n, address(found) + 8 * (4 * n * n + n)
    chains = address(lower), len(lower), address(upper), len(upper)
    given = band.compiled, band.sensor.pitch_mm, *chains
    out = address(covariance), address(shuffled), SWEEPS, address(points), address(mean), *scattered
    told, room = -1, _ROOM * (size + 10) * (len(band.low) * len(band.x) + SWEEPS)
    while told < 0:  # as much room as mostly does, then as much as it asks for
        workspace = np.empty(room)
        told = core(*given, *out, address(workspace), room)
        room = -told
    if told <= 0:
        return None
    least_squares = _least_squares(outline, covariance, band, points)
    if told == 1:
        return least_squares
    middle = Outline.held(mean[:split], mean[split:])
    v = len(middle.vertices)
    area, x, y, turn = found[4 * n * n + n :].tolist()
    deviations = (area, np.array([x, y]), axis_deviation(turn))
    scatter = found[: 4 * v * v].reshape(2 * v, 2 * v)
    radii = found[4 * n * n : 4 * n * n + v]
    return _judged(Bounded(middle, scatter, radii, deviations, band, points, least_squares), least_squares)


def _mean(lower: FloatArray, upper: FloatArray, lines: EdgeLines, band: ReadingBounds) -> Outline | None:
    """Return the mean of drawn chains; None where it is none that the readings allow: the set is not convex."""
    chains = lower.mean(axis=0), upper.mean(axis=0)
    for end, window in zip((0, -1), band.windows, strict=True):
        for chain in chains if lines.vertical[end] else ():
            chain[end, 0] = window.mean()
    try:
        mean = Outline(*chains)
    except ContactError:
        return None
    made = signatures(band.sensor, *mean.ends(np.clip(band.x, mean.lower[0, 0], mean.lower[-1, 0])))
    for name, low in band.low.items():
        slack = _BENT * (band.high[name] - low)
        if np.any((made[name] < low - slack) | (made[name] > band.high[name] + slack)):
            return None
    return mean


def fewest(
    candidates: Iterable[tuple[Outline, FloatArray]], band: ReadingBounds
) -> tuple[int, Bounded] | None:
    """Return the first of least-squares fits, fewest vertices first, that the band leaves something of, refined.

    None, where no fit stays within the band, is an alarm: the contact is not of this kind, or the bound is wrong.
    """
    for number, (outline, covariance) in enumerate(candidates):
        refined = refine(outline, covariance, band)
        if refined is not None:
            return number, refined
    return None


def _points(
    outline: Outline,
    covariance: FloatArray,
    band: ReadingBounds,
    lines: EdgeLines,
    heights: FloatArray,
    effort: Effort,
) -> FloatArray | None:
    """Return heights (K, P) [mm] of outlines in the set; None where none was found."""
    lower, upper = outline.indices
    kinks = [*lower[1:-1], *upper[1:-1]]
    error = np.sqrt(np.diag(covariance)[::2])[kinks]
    error = np.where(np.isfinite(error), error, np.inf)

    def drawn(zones: FloatArray, widths: FloatArray, heights: FloatArray) -> FloatArray | None:
        bounds = feasible_set(band, lines, zones, widths)
        found = feasible_point(bounds, band, lines, widths, heights, effort)
        return None if found is None else hit_and_run(bounds.rows, bounds.pairs, *found)

    for reach in (_REACH, _FURTHER):
        zones = within(lines, outline.vertices[kinks, 0], reach * error, band)
        points = drawn(zones, _widths(band, outline.lower, outline.upper), heights)
        if points is None:
            continue
        if not band.sensor.contact_lambda_mm:
            return points
        # What contact resistance eats depends on the contact's length: once more, with a better one.
        heights = points.mean(axis=0)
        again = drawn(zones, _widths(band, *lines.chains(heights, band.windows.mean(axis=1))), heights)
        return points if again is None else again
    return None


def within(lines: EdgeLines, x: FloatArray, reach: FloatArray, band: ReadingBounds) -> FloatArray:
    """Return zones (kinks, 2) [mm] about x, that end halfway to the next kink of the chain and at the outer strips."""
    least = 0.5 * band.sensor.pitch_mm
    x, reach = np.clip(x, band.x[0] + least, band.x[-1] - least), np.maximum(reach, least)
    zones = np.stack([x - reach, x + reach], axis=1)
    split = lines.lower - 1
    for part, at in ((zones[:split], x[:split]), (zones[split:], x[split:])):
        middle = 0.5 * (at[1:] + at[:-1])
        part[1:, 0] = np.maximum(part[1:, 0], middle)
        part[:-1, 1] = np.minimum(part[:-1, 1], middle)
    return np.clip(zones, band.x[0], band.x[-1])


def _widths(band: ReadingBounds, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the contact's length on each strip between two chains, thrice (3, n) [mm]: as expected, and no other."""
    w = np.interp(band.x, *upper.T) - np.interp(band.x, *lower.T)
    return np.tile(np.maximum(w, 0.0), (3, 1))

"""Where the vertices of an outline are guaranteed to lie, if every reading is off by no more than its bound.

Kinks are looked for in zones somewhat wider than the set of outlines found. In a zone only such bounds of readings
are used as hold wherever in it the kink lies. What is left is a polytope that no such outline is outside of, and
linear programs give how far its crossings, and the edges beside them, reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.polytope import largest, lowest
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds
from tacstrip.reconstruction.set_membership.feasible_set import feasible_set

_MARGINS = (0.25, 0.5, 1.5, 4.0)  # of the found kinks' span: how much wider the zones are on either side
_NEAREST = 240  # bounds that are used; leaving some out makes the regions larger, never wrong
_ROUNDING = 1e-6  # of the pitch: regions are larger by it than linear programs say
_STEPS = 20


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
        near = largest(-slack, _NEAREST)
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

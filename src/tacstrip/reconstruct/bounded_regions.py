"""Where the vertices of an outline are guaranteed to lie, if every reading is off by no more than its bound.

Kinks are looked for in zones somewhat wider than the set of outlines found. In a zone only such bounds of readings
are used as hold wherever in it the kink lies. What is left is a polytope that no such outline is outside of, and
linear programs give how far its crossings, and the edges beside them, reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.bounded_lines import Band, Lines
from tacstrip.reconstruct.bounded_set import feasible_set

_MARGINS = (0.5, 1.5, 4.0)  # of the found kinks' span: how much wider the zones are on either side
_NEAREST = 240  # bounds that are used; leaving some out makes the regions larger, never wrong
_ROUNDING = 1e-6  # of the pitch
_STEPS = 20


@dataclass(frozen=True, eq=False)
class Regions:
    """Convex polygons (K, 2) [mm]: of each kink, lower chain first, and of both vertices of the left and right end."""

    kinks: list[FloatArray]
    ends: list[tuple[FloatArray, FloatArray]]


def guaranteed(band: Band, lines: Lines, points: FloatArray) -> Regions | None:
    """Return a region for every vertex; None where the readings do not confine a kink.

    What is guaranteed: every outline (a) with these edges, turning the same way at each kink, (b) with its kinks in
    the zones searched, and (c) within the band, has its vertices in the regions. No such outline has a kink in a
    zone outside of its region, so that the set found is all there is from zone's end to zone's end. Outlines with more
    vertices, or kinks further off, are not covered.

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
        extents = _Search(band, lines, zones, points).extents()
        if np.all((extents[:count] > zones[:, :1]) & (extents[:count] < zones[:, 1:])):
            # Nothing lies between the extents and the zones' ends: the zones may shrink.
            narrow = _Search(band, lines, extents[:count], points)
            return narrow.regions()
    return None


def _apart(zones: FloatArray, lines: Lines, band: Band) -> bool:
    """Whether zones of one chain do not overlap, and lie between the outer strips."""
    inside = np.all(zones[:, 0] > band.x[0]) and np.all(zones[:, 1] < band.x[-1])
    split = lines.lower - 1
    return bool(inside and all(np.all(z[1:, 0] >= z[:-1, 1]) for z in (zones[:split], zones[split:])))


class _Search:
    """Linear programs over the polytope of given zones, in coordinates that make it round."""

    def __init__(self, band: Band, lines: Lines, zones: FloatArray, points: FloatArray) -> None:
        self.lines, self.points, self.pitch = lines, points, band.sensor.pitch_mm
        self.bounds = feasible_set(band, lines, zones, _widths(band, lines, zones, points))
        self.middle = points.mean(axis=0)
        self.to_round = np.linalg.cholesky(np.cov(points, rowvar=False)).T  # h = middle + z @ to_round
        a = self.bounds.a @ self.to_round.T
        slack = self.bounds.b - self.bounds.a @ self.middle
        norm = np.linalg.norm(a, axis=1)
        a, slack = a / norm[:, None], slack / norm
        near = np.argsort(slack)[:_NEAREST]
        self.a, self.slack = np.ascontiguousarray(a[near]), slack[near]
        self._from_the_middle()

    def lowest(self, form: FloatArray) -> float:
        """Return the least of form h; `at` is where."""
        from tacstrip.reconstruct.bounded_kernels import lowest

        value = lowest(self.to_round @ form, self.a, self.slack, self.at, self.active)
        if not value > -np.inf:  # rounding can lead a warm start astray
            self._from_the_middle()
            value = lowest(self.to_round @ form, self.a, self.slack, self.at, self.active)
        return float(form @ self.middle + value)

    def _from_the_middle(self) -> None:
        self.at, self.active = np.zeros(len(self.middle)), np.full(len(self.middle), -1)

    def heights(self) -> FloatArray:
        """Return the heights where the last form was least."""
        return np.asarray(self.middle + self.at @ self.to_round)

    def extents(self) -> FloatArray:
        """Return how far each crossing reaches (C, 2) [mm]; a zone's end where it reaches that, or beyond."""
        pairs, turns = self.lines.crossings, np.concatenate([self.lines.turns, [1, -1]])
        given = [*([True] * len(self.lines.turns)), *(not b for b in self.lines.blunt)]
        found = self.bounds.zones.copy()
        seen = self.lines.cross(self.points)
        for c in np.flatnonzero(given):
            for end, start in ((0, seen[:, c].min()), (1, seen[:, c].max())):
                found[c, end] = self._reach(c, pairs[c], turns[c], end, float(start))
        return found

    def _reach(self, c: int, pair: FloatArray, turn: float, end: int, x: float) -> float:
        """Move x outwards to where no crossing is beyond it."""
        out = 1.0 if end else -1.0
        limit = self.bounds.zones[c, end]
        for _ in range(_STEPS):
            x += out * _ROUNDING * self.pitch
            if out * (x - limit) >= 0.0:
                return float(limit)
            # Beyond its crossing the gap of two lines has one sign; least it must have it everywhere.
            form = out * turn * self._gap(pair, x)
            if self.lowest(form) >= 0.0:
                return x
            x = max(out * x, out * float(self.lines.cross(self.heights())[c])) * out
        return float(limit)

    def _gap(self, pair: FloatArray, x: float) -> FloatArray:
        at = np.full(1, x)
        return np.asarray((self.lines.rows(pair[1:], at) - self.lines.rows(pair[:1], at))[0])

    def regions(self) -> Regions:
        """Return the regions of all vertices."""
        extents, pairs = self.extents(), self.lines.crossings
        count = len(self.lines.turns)
        kinks = [self._region(extents[c], pairs[c]) for c in range(count)]
        ends = []
        for c in (count, count + 1):
            if self.lines.blunt[c - count]:
                ends.append((self._region(extents[c], pairs[c][:1]), self._region(extents[c], pairs[c][1:])))
            else:
                both = self._region(extents[c], pairs[c])
                ends.append((both, both))
        return Regions(kinks, ends)

    def _region(self, x: FloatArray, lines: FloatArray) -> FloatArray:
        """Return where lines pass between two x: a line's highest place is convex in x, so below its chord."""
        shape = None
        for line in lines:
            rows = self.lines.rows(np.full(2, line), x)
            (a, b), (d, e) = ([sign * self.lowest(sign * row) for row in rows] for sign in (1.0, -1.0))
            strip = shapely.Polygon([(x[0], a), (x[1], b), (x[1], e), (x[0], d)])
            shape = strip if shape is None else shapely.intersection(shape, strip)
        return shapely.get_coordinates(shape)[:-1]


def _widths(band: Band, lines: Lines, zones: FloatArray, points: FloatArray) -> FloatArray:
    return np.zeros((1, len(band.x)))

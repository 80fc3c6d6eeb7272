"""Strips as wide as they are: what their width adds to the readings of an outline, and takes from what ends tell.

The polygon fit sees a strip as its centre line. A strip of some width reads the mean height of its edges, and beyond it
where they are slanted (`contact.slant`); the last strips that read anything are covered in part. So the readings are
fitted, what the width adds to the outline found is taken from them, and what is left is fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.boundary_integrals import Charges
from tacstrip.contact.resistive_ends import ResistiveEnds
from tacstrip.contact.signature import signatures
from tacstrip.contact.slant import PARTS, edge_read
from tacstrip.contact.strip_width import closed_form_fits
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.spec import Sensor

_ENOUGH = 8  # strips: of fewer none is left out
_SAME = 1e-9  # of the width: closer to a side is on it; shorter edges are none
_STEP = 1e-3  # of the pitch, for differences
# What vertices may move by, of the width and of lambda, for ends off by some 1e-5 of L; and under ideal contact.
_NEAR, _NEAR_IDEAL = 0.02, 0.005
PARTIAL_STRIPS = 1  # strips at either end of a contact that may be covered in part


def fitted_strips(sensor: Sensor, strips: slice) -> tuple[slice, float]:
    """Return which strips of a contact are fitted, and how much further out its ends are expected [mm].

    Of wide strips the outer ones, which may be covered in part, are left out where enough are left.
    """
    if sensor.strip_width_mm is None or strips.stop - strips.start < _ENOUGH:
        return strips, 0.0
    return slice(strips.start + PARTIAL_STRIPS, strips.stop - PARTIAL_STRIPS), end_margin_mm(sensor)


def end_margin_mm(sensor: Sensor) -> float:
    """Return how much further out the ends are than the strips left, read at their centre lines, would say [mm]."""
    return PARTIAL_STRIPS * sensor.pitch_mm - 0.5 * sensor.strip_width


def counts_wide(sensor: Sensor) -> bool:
    """Whether the strips are taken as wide as the spec says; on a curved skin they count as their centre lines."""
    return sensor.strip_width_mm is not None and sensor.surface is None and sensor.kind.closed_form


def across(sensor: Sensor, x: FloatArray) -> FloatArray:
    """Return the lines that stand for strips at x (n,): their centre lines (n, 1), or lines across the width [mm]."""
    if not counts_wide(sensor):
        return x[:, None]
    return np.asarray(x[:, None] + sensor.strip_width * (np.arange(PARTS + 1) / PARTS - 0.5))


def touched(sensor: Sensor, outline: Outline, x: FloatArray) -> BoolArray:
    """Whether strips at x (n,) [mm] have any part of an outline on them."""
    if not counts_wide(sensor):
        return outline.touches(x)
    half = (0.5 - _SAME) * sensor.strip_width
    return np.asarray((x + half > outline.lower[0, 0]) & (x - half < outline.lower[-1, 0]))


def equivalent_ends(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the l and u (n,) [mm] that ideal contact would have where wide strips at x (n,) [mm] read the same."""
    lower, upper = (
        _edge(sensor, chain, x, sign) for chain, sign in ((outline.lower, -1.0), (outline.upper, 1.0))
    )
    lower = np.clip(lower, 0.0, sensor.length_mm)
    return lower, np.clip(upper, lower, sensor.length_mm)


class OnWideStrips:
    """An outline on wide strips at x (n,) [mm], resolved across their width where no closed form fits.

    That is where a corner lies on one, and where slanted edges are near each other or the border.

    Attributes
    ----------
    ends
        l and u (2, n) [mm] on thin strips that read the same.

    An outline `near` by leads on to this one by its slopes.
    """

    def __init__(
        self, sensor: Sensor, outline: Outline, x: FloatArray, near: OnWideStrips | None = None
    ) -> None:
        self._of = sensor, outline, x
        self.ends = np.stack(equivalent_ends(sensor, outline, x))
        self._resolved: _Resolved | None = None
        inexact = np.flatnonzero(~_by_closed_form(sensor, outline, x))
        if not len(inexact) or not shapely.is_valid(shapely.polygons(outline.vertices)):
            return
        if near is not None and near._resolved is not None and near._resolved.leads_to(outline, inexact):
            found = near._resolved
            moves = (outline.vertices - found.vertices).ravel()
            self.ends[:, found.cut.index] = found.ends + found.slopes @ moves
        else:
            found = _Resolved.of(sensor, outline.vertices, x, inexact)
            self.ends[:, found.cut.index] = found.ends
        self._resolved = found

    def slopes(self) -> FloatArray:
        """Return the slopes of the ends by `vertices.ravel()` (2, n, 2 V)."""
        found = np.stack(end_slopes(*self._of))
        if self._resolved is not None:
            found[:, self._resolved.cut.index] = self._resolved.slopes
        return found


@dataclass(frozen=True, eq=False)
class _Resolved:
    """Strips that are resolved under an outline's vertices (V, 2) [mm], and their ends (2, m) [mm]."""

    vertices: FloatArray
    cut: _Cut
    ends: FloatArray
    _solved: ResistiveEnds | list[Charges]
    _reach: float  # how far off vertices may be for the slopes to lead to them [mm]

    @classmethod
    def of(cls, sensor: Sensor, vertices: FloatArray, x: FloatArray, index: IntArray) -> _Resolved:
        """Resolve the strips `index` at x; not those on which charges are too near a bar."""
        width, lam = sensor.strip_width, sensor.contact_lambda_mm
        cut, length = _Cut.of(vertices, x, index, width), sensor.length_mm / width
        if lam > 0.0:
            solved = ResistiveEnds.on(cut.edges, length, lam / width)
            return cls(vertices, cut, width * solved.ends, solved, _NEAR * min(width, lam))
        every = [Charges.on(edges[own], length) for edges, own in zip(cut.edges, cut.within, strict=True)]
        charges = [one for one in every if one is not None]
        ends = width * np.array([one.ends for one in charges]).reshape(-1, 2).T
        return cls(
            vertices, cut.of_strips([one is not None for one in every]), ends, charges, _NEAR_IDEAL * width
        )

    def leads_to(self, outline: Outline, index: IntArray) -> bool:
        """Whether an outline is near enough for these slopes, and these are the strips to resolve."""
        same = outline.vertices.shape == self.vertices.shape and np.array_equal(index, self.cut.index)
        return same and float(np.abs(outline.vertices - self.vertices).max()) <= self._reach

    @cached_property
    def slopes(self) -> FloatArray:
        """The slopes of the ends by `vertices.ravel()` (2, m, 2 V)."""
        if isinstance(self._solved, ResistiveEnds):
            return self.cut.by_vertices(self._solved.slopes())
        by_edges = np.zeros((2, *self.cut.edges.shape))
        for i, charges in enumerate(self._solved):
            by_edges[:, i, self.cut.within[i]] = charges.slopes()
        return self.cut.by_vertices(by_edges)


@dataclass(frozen=True, eq=False)
class _Cut:
    """Edges over strips `index` (m,), over their width from their left side: (m, V, 2, 2), from vertex to next vertex.

    Where their ends are between these: shares (m, V, 2). What is not `within` a strip (m, V) has no length.
    """

    index: IntArray
    edges: FloatArray
    share: FloatArray
    within: BoolArray

    @classmethod
    def of(cls, vertices: FloatArray, x: FloatArray, index: IntArray, width: float) -> _Cut:
        across = (vertices[:, 0] - x[index, None]) / width + 0.5
        for side in (0.0, 1.0):
            across[np.abs(across - side) < _SAME] = side
        run = np.roll(across, -1, axis=1) - across
        upright = run == 0.0
        sides = np.stack([-across, 1.0 - across], axis=-1) / np.where(upright, 1.0, run)[..., None]
        share = np.sort(np.clip(sides, 0.0, 1.0), axis=-1)
        share[upright] = 0.0, 1.0
        begin = np.stack([across, np.broadcast_to(vertices[:, 1] / width, across.shape)], axis=-1)
        way = np.roll(begin, -1, axis=1) - begin
        length = np.hypot(way[..., 0], way[..., 1]) * (share[..., 1] - share[..., 0])
        within = (length > _SAME) & (~upright | ((across > 0.0) & (across < 1.0)))
        edges = begin[:, :, None] + share[..., None] * way[:, :, None]
        first = edges[np.arange(len(index)), within.argmax(axis=1), 0]
        edges = np.where(within[..., None, None], edges, first[:, None, None])
        return cls(index, edges, np.where(within[..., None], share, 0.0), within)

    def of_strips(self, which: list[bool]) -> _Cut:
        return _Cut(self.index[which], self.edges[which], self.share[which], self.within[which])

    def by_vertices(self, by_edges: FloatArray) -> FloatArray:
        """Return slopes by all vertices (2, m, 2 V) of those by the edges' ends (2, m, V, 2, 2)."""
        run, rise = np.moveaxis(self.edges[:, :, 1] - self.edges[:, :, 0], -1, 0)
        cut = (self.share > 0.0) & (self.share < 1.0)  # by a side: its end stays there
        steep = np.divide(rise, run, out=np.zeros_like(run), where=cut.any(axis=-1))
        by_x, by_y = by_edges[..., 0], by_edges[..., 1]
        by_end = np.stack([np.where(cut, -steep[..., None] * by_y, by_x), by_y], axis=-1)
        found = ((1.0 - self.share)[..., None] * by_end).sum(axis=-2)
        found += np.roll((self.share[..., None] * by_end).sum(axis=-2), 1, axis=2)
        return np.asarray(found.reshape(*found.shape[:2], -1))


def _by_closed_form(sensor: Sensor, outline: Outline, x: FloatArray) -> BoolArray:
    """Whether strips at x (n,) read as `equivalent_ends` says, or nothing."""
    corner = has_corner(sensor, outline.vertices, x).any(axis=1)
    sides = x[:, None] + 0.5 * sensor.strip_width * np.array([-1.0, 1.0])
    low, high = outline.ends(sides)
    fits = closed_form_fits(sensor, low, high)
    return np.asarray(~corner & (fits | ~np.isfinite(low).all(axis=-1)))


def has_corner(sensor: Sensor, vertices: FloatArray, x: FloatArray) -> BoolArray:
    """Whether strips at x (n,) have each of the vertices (V, 2) on them (n, V)."""
    return np.asarray(np.abs(x[:, None] - vertices[:, 0]) < 0.5 * sensor.strip_width)


def end_slopes(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the slopes of `equivalent_ends` by `vertices.ravel()`, each (n, 2 V), by differences."""
    step = _STEP * sensor.pitch_mm
    found = []
    for chain, index, sign in zip((outline.lower, outline.upper), outline.indices, (-1.0, 1.0), strict=True):
        moved = (
            chain
            + step * np.eye(chain.size).reshape(-1, *chain.shape) * np.array([-1.0, 1.0])[:, None, None, None]
        )
        ends = _edge(sensor, moved, x, sign)
        slopes = np.zeros((len(x), len(outline.vertices), 2))
        slopes[:, index] = ((ends[1] - ends[0]) / (2.0 * step)).T.reshape(len(x), *chain.shape)
        found.append(slopes.reshape(len(x), -1))
    return found[0], found[1]


def remove_width_effect(
    sensor: Sensor,
    outline: Outline,
    x: FloatArray,
    readings: Mapping[str, FloatArray],
    *,
    corners: bool = False,
) -> dict[str, FloatArray]:
    """Return readings (n,) over Vref without what the width adds to those of an outline.

    `corners` resolves strips that no closed form fits, those with a corner on them above all: it is off by up to 5e-3.
    """
    l, u = (np.interp(x, *chain.T) for chain in (outline.lower, outline.upper))
    ends = OnWideStrips(sensor, outline, x).ends if corners else equivalent_ends(sensor, outline, x)
    thin, wide = signatures(sensor, l, u), signatures(sensor, *ends)
    return {name: k - (wide[name] - thin[name]) for name, k in readings.items()}


def _edge(sensor: Sensor, chains: FloatArray, x: FloatArray, sign: float) -> FloatArray:
    """Return the ends (..., n) [mm] that chains (..., M, 2) [mm] read on strips at x (n,)."""
    borders = x[:, None] + sensor.strip_width * (np.arange(PARTS + 1) / PARTS - 0.5)
    each = chains.reshape(-1, *chains.shape[-2:])
    height = np.stack([np.interp(borders, *chain.T) for chain in each])
    read = edge_read(height, sensor.strip_width, sign, sensor.contact_lambda_mm)
    return read.reshape(*chains.shape[:-2], len(x))

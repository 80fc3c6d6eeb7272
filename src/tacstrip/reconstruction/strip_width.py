"""Strips as wide as they are: what their width adds to the readings of an outline, and takes from what ends tell.

The polygon fit sees a strip as its centre line. A strip of some width reads the mean height of its edges, and beyond it
where they are slanted (`sensor.slant`); the last strips that read anything are covered in part. So the readings are
fitted, what the width adds to the outline found is taken from them, and what is left is fitted again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.boundary_integrals import Charges
from tacstrip.contact.resolved_ends import resolved_ends
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.contact.strip_width import wide_ends
from tacstrip.geometry.outline import Outline
from tacstrip.network.strips.resistive_ends import ResistiveEnds
from tacstrip.sensor.slant import PARTS, edge_read
from tacstrip.sensor.spec import Sensor

_ENOUGH = 8  # strips: of fewer none is left out
_SAME = 1e-9  # of the width: closer to a side is on it; shorter edges are none
_STEP = 1e-3  # of the pitch, for differences
_RESOLVED_STEP = 5e-3  # of the width, for differences of boundary integrals
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


def across(sensor: Sensor, x: FloatArray) -> FloatArray:
    """Return the lines that stand for strips at x (n,): their centre lines (n, 1), or lines across the width [mm]."""
    if sensor.strip_width_mm is None or sensor.surface is not None or not sensor.kind.closed_form:
        return x[:, None]
    return np.asarray(x[:, None] + sensor.strip_width * (np.arange(PARTS + 1) / PARTS - 0.5))


def equivalent_ends(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the l and u (n,) [mm] that ideal contact would have where wide strips at x (n,) [mm] read the same."""
    lower, upper = (
        _edge(sensor, chain, x, sign) for chain, sign in ((outline.lower, -1.0), (outline.upper, 1.0))
    )
    lower = np.clip(lower, 0.0, sensor.length_mm)
    return lower, np.clip(upper, lower, sensor.length_mm)


class WithCorners:
    """An outline on wide strips at x (n,) [mm], exact where a corner is on one.

    Attributes
    ----------
    ends
        l and u (2, n) [mm] as by `equivalent_ends`.

    With contact resistance strips cost milliseconds; those of an outline `near` by lead on to this one by slopes.
    """

    def __init__(
        self, sensor: Sensor, outline: Outline, x: FloatArray, near: WithCorners | None = None
    ) -> None:
        self._of = sensor, outline, x
        self.ends = np.stack(equivalent_ends(sensor, outline, x))
        self._charged: list[tuple[_Strip, Charges]] = []
        self._resistive: dict[int, ResistiveEnds] = {}
        if not shapely.is_valid(shapely.polygons(outline.vertices)):
            return
        if sensor.contact_lambda_mm > 0.0:
            for i in np.flatnonzero(has_corner(sensor, outline.vertices, x).any(axis=1)).tolist():
                found = near._resistive.get(i) if near is not None else None
                ends = found.moved(outline.vertices) if found is not None else None
                if ends is None and (found := _resistive(sensor, outline.vertices, x[i])) is not None:
                    ends = found.ends
                if found is not None and ends is not None:
                    self._resistive[i], self.ends[:, i] = found, ends
            return
        for strip in _with_corner(sensor, outline, x):
            charges = Charges.on(strip.edges, sensor.length_mm / sensor.strip_width)
            if charges is not None:
                self._charged.append((strip, charges))
                self.ends[:, strip.index] = charges.ends * sensor.strip_width

    def slopes(self, counts: BoolArray) -> FloatArray:
        """Return the slopes of the ends by `vertices.ravel()` (2, n, 2 V), exact on strips that count (n,)."""
        sensor, outline, x = self._of
        found = np.stack(end_slopes(sensor, outline, x))
        for strip, charges in self._charged:
            if counts[strip.index]:
                by_edges = charges.slopes()
                found[:, strip.index] = [strip.by_vertices(own, len(outline.vertices)) for own in by_edges]
        for i, resistive in self._resistive.items():
            if counts[i]:
                found[:, i] = resistive.slopes
        return found


def _resistive(sensor: Sensor, vertices: FloatArray, x: float) -> ResistiveEnds | None:
    return ResistiveEnds.of(
        vertices, float(x), sensor.strip_width, sensor.length_mm, sensor.contact_lambda_mm
    )


@dataclass(frozen=True, eq=False)
class _Strip:
    """A strip with a corner on it: edges (P, 2, 2) over its width, from its left side.

    Where their ends are from vertex `first` (P,) to the next one: shares (P, 2).
    """

    index: int
    edges: FloatArray
    first: IntArray
    share: FloatArray

    def by_vertices(self, by_edges: FloatArray, count: int) -> FloatArray:
        """Return slopes by all vertices (2 V,) of those by the edges' ends (P, 2, 2)."""
        (x0, y0), (x1, y1) = self.edges[:, 0].T, self.edges[:, 1].T
        cut = (self.share > 0.0) & (self.share < 1.0)  # by a side: its end stays there
        rise = np.divide(y1 - y0, x1 - x0, out=np.zeros(len(x0)), where=cut.any(axis=1))
        by_x = np.where(cut, -rise[:, None] * by_edges[..., 1], by_edges[..., 0])
        by_end = np.stack([by_x, by_edges[..., 1]], axis=-1)
        found = np.zeros((count, 2))
        found[self.first] += ((1.0 - self.share)[..., None] * by_end).sum(axis=1)
        found[(self.first + 1) % count] += (self.share[..., None] * by_end).sum(axis=1)
        return found.ravel()


def _with_corner(sensor: Sensor, outline: Outline, x: FloatArray) -> Iterator[_Strip]:
    """Make the strips at x (n,) with a corner on them, where boundary integrals serve."""
    vertices, width = outline.vertices, sensor.strip_width
    index = np.flatnonzero(has_corner(sensor, vertices, x).any(axis=1))
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
    for strip, own in enumerate(within):
        yield _Strip(int(index[strip]), edges[strip, own], np.flatnonzero(own), share[strip, own])


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


def resolved_slopes(
    sensor: Sensor, outline: Outline, x: FloatArray
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Yield strips at x (n,) [mm] that no closed form fits, their ends (2,) and the ends' slopes (2, 2 V).

    Those that a corner lies on, that are covered in part, or that edges near each other cross: by boundary integrals
    and their differences, or with contact resistance by networks. Slopes are by `vertices.ravel()`.
    """
    exact = wide_ends(sensor, [Contact.polygon(outline.vertices)]).exact[0]
    vertices, half, step = outline.vertices, 0.5 * sensor.strip_width, _RESOLVED_STEP * sensor.strip_width
    near = np.stack([np.roll(vertices[:, 0], k) for k in (1, 0, -1)])
    for i in np.flatnonzero(~exact[np.abs(sensor.x_mm - x[:, None]).argmin(axis=1)]):
        if sensor.contact_lambda_mm > 0.0:
            if (found := _resistive(sensor, vertices, x[i])) is not None:
                yield int(i), found.ends, found.slopes
            continue
        ends = resolved_ends([shapely.Polygon(vertices)], x[i], 2.0 * half, sensor.length_mm)
        over = (near.min(axis=0) < x[i] + half) & (near.max(axis=0) > x[i] - half)
        slopes = np.zeros((2, vertices.size))
        for at in np.flatnonzero(np.repeat(over, 2)):
            move = step * (np.arange(vertices.size) == at).reshape(vertices.shape)
            ahead, behind = (
                resolved_ends([shapely.Polygon(vertices + sign * move)], x[i], 2.0 * half, sensor.length_mm)
                for sign in (1.0, -1.0)
            )
            if ends is None or ahead is None or behind is None:
                break
            slopes[:, at] = np.subtract(ahead, behind) / (2.0 * step)
        else:
            if ends is not None:
                yield int(i), np.array(ends), slopes


def remove_width_effect(
    sensor: Sensor,
    outline: Outline,
    x: FloatArray,
    readings: Mapping[str, FloatArray],
    *,
    corners: bool = False,
) -> dict[str, FloatArray]:
    """Return readings (n,) over Vref without what the width adds to those of an outline.

    `corners` solves for each strip with a corner on it, which the closed form has off by up to 5e-3.
    """
    l, u = (np.interp(x, *chain.T) for chain in (outline.lower, outline.upper))
    ends = WithCorners(sensor, outline, x).ends if corners else equivalent_ends(sensor, outline, x)
    thin, wide = signatures(sensor, l, u), signatures(sensor, *ends)
    return {name: k - (wide[name] - thin[name]) for name, k in readings.items()}


def _edge(sensor: Sensor, chains: FloatArray, x: FloatArray, sign: float) -> FloatArray:
    """Return the ends (..., n) [mm] that chains (..., M, 2) [mm] read on strips at x (n,)."""
    borders = x[:, None] + sensor.strip_width * (np.arange(PARTS + 1) / PARTS - 0.5)
    each = chains.reshape(-1, *chains.shape[-2:])
    height = np.stack([np.interp(borders, *chain.T) for chain in each])
    read = edge_read(height, sensor.strip_width, sign, sensor.contact_lambda_mm)
    return read.reshape(*chains.shape[:-2], len(x))

"""A strip resolved across its width: where the nodes of its sheets lie, and where the contact's edge cuts between.

The strip is cut into cells of equal width, with columns of nodes on its sides and between cells, and into rows that are
close together where the contact's edge crosses the strip. Beyond a strip width (or lambda) from there the rows grow
further apart: differences across the width die out with exp(-pi y / b), those across the contact with exp(-y / lambda).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.network.grid import shares

_SAME = 1e-9  # of a cell: closer positions are one node
_STEEP = 8  # an edge that runs further along the strip than this many widths gets longer cells


@dataclass(frozen=True, eq=False)
class Cells:
    """Nodes of one sheet of a strip: (rows, columns), the first and the last row being the electrode bars.

    Attributes
    ----------
    x
        Columns (columns,), the first and the last on the strip's sides [mm].
    y
        Rows (rows,), from 0 to the strip's length [mm].
    """

    x: FloatArray
    y: FloatArray

    @property
    def widths(self) -> FloatArray:
        """Widths of the columns' cells (columns,) [mm]."""
        return np.diff(_between(self.x))

    @property
    def heights(self) -> FloatArray:
        """Heights of the rows' cells (rows,) [mm]."""
        return np.diff(_between(self.y))

    def shares(self, area: BaseGeometry) -> FloatArray:
        """Return how much of an area falls to each node's cell (rows, columns) [mm^2]."""
        side, level = _between(self.x), _between(self.y)[:, None]
        boxes = shapely.box(side[:-1], level[:-1], side[1:], level[1:])
        return shares(area, boxes)


def _between(places: FloatArray) -> FloatArray:
    """Return where one node's cell ends and the next one's begins (N + 1,); the first and last cells are halves."""
    return np.concatenate([places[:1], 0.5 * (places[1:] + places[:-1]), places[-1:]])


@dataclass(frozen=True, eq=False)
class Chains:
    """Nodes along parallel lines, those of the grid and those where the contact's edge cuts between them.

    Attributes
    ----------
    line
        Line of each node (N,), ascending.
    at
        Its position along the line (N,) [mm], ascending on each.
    node
        Its number on the grid, row * columns + column (N,); -1 where the edge cuts.
    touched
        Whether it lies in the contact, edges included (N,).
    """

    line: IntArray
    at: FloatArray
    node: IntArray
    touched: BoolArray


def cells(
    contact: BaseGeometry, x_mm: float, width: float, length: float, across: int, decay: float
) -> Cells:
    """Cut a strip with its centre line at `x_mm` into `across` cells, and into rows by the contact on it.

    `decay` is the distance from the edge over which rows keep their distance [mm].
    """
    h = width / across
    rows = _rows(_zones(contact, x_mm, width), length, h, decay, _STEEP * across)
    inside = 0.5 - _SAME  # a contact that ends at the strip's side covers the side's nodes, rounded or not
    return Cells(x_mm + width * np.linspace(-inside, inside, across + 1), rows)


def on_strip(shapes: Sequence[BaseGeometry], x_mm: float, width: float, length: float) -> BaseGeometry:
    """Cut shapes to a strip; empty where none is on it. What only grazes the strip's side is off it."""
    whole, inner = (_band(x_mm, part * width, 0.0, length) for part in (1.0, 1.0 - 2.0 * _SAME))
    parts = []
    for shape in shapes:
        size = shapely.area if shape.area > 0.0 else shapely.length
        cut = shapely.get_parts(shapely.intersection(shape, whole))
        parts.append(cut[size(shapely.intersection(cut, inner)) > 0.0])
    return shapely.union_all(np.concatenate(parts))


def _band(x_mm: float, width: float, low: float, high: float) -> BaseGeometry:
    return shapely.box(x_mm - 0.5 * width, low, x_mm + 0.5 * width, high)


def chains(contact: BaseGeometry, cells: Cells, along: bool) -> Chains:
    """Lay the contact on the grid's lines, along the strip (one per column) or across it (one per row)."""
    places, lines = (cells.y, cells.x) if along else (cells.x, cells.y)
    ends = np.array([[places[0], places[-1]]] * len(lines))
    levels = np.repeat(lines[:, None], 2, axis=1)
    xy = np.stack([levels, ends] if along else [ends, levels], axis=-1)
    met = shapely.intersection(shapely.linestrings(xy), contact)
    parts, line = shapely.get_parts(met, return_index=True)
    there = ~shapely.is_empty(parts)
    bounds, line = shapely.bounds(parts[there]), line[there]
    low, high = (bounds[:, 1], bounds[:, 3]) if along else (bounds[:, 0], bounds[:, 2])
    low, high = _snapped(low, places), _snapped(high, places)
    grid = np.arange(len(lines) * len(places))
    every_line, every_at = np.divmod(grid, len(places))
    ends_at = np.stack([np.concatenate([line, line]), np.concatenate([low, high])])
    cut = np.unique(ends_at[:, ~np.isin(ends_at[1], places)], axis=1)
    where = np.concatenate([every_line, cut[0].astype(np.int64)])
    at = np.concatenate([places[every_at], cut[1]])
    node = np.concatenate([grid, np.full(cut.shape[1], -1)])
    if along:
        node = np.where(node < 0, node, node % len(places) * len(lines) + node // len(places))
    order = np.lexsort((at, where))
    where, at, node = where[order], at[order], node[order]
    # A node is touched while more pieces have begun than ended before it: the lines put end to end.
    step = 2.0 * (places[-1] - places[0]) + 1.0
    key, begin, end = where * step + at, np.sort(line * step + low), np.sort(line * step + high)
    touched = np.searchsorted(begin, key, side="right") > np.searchsorted(end, key, side="left")
    return Chains(where, at, node, touched)


def _snapped(at: FloatArray, places: FloatArray) -> FloatArray:
    """Move positions that lie on a node but for rounding onto it."""
    after = np.searchsorted(places, at).clip(1, len(places) - 1)
    before = places[after - 1]
    nearest = np.where(at - before < places[after] - at, before, places[after])
    return np.asarray(np.where(np.abs(at - nearest) < _SAME * (places[after] - before), nearest, at))


def _zones(contact: BaseGeometry, x_mm: float, width: float) -> FloatArray:
    """Return where along the strip the contact's edge crosses it: (zones, 2), ascending, apart [mm]."""
    parts = shapely.get_parts(contact)
    rims = np.where(shapely.area(parts) > 0.0, shapely.boundary(parts), parts)
    _, bottom, _, top = contact.bounds
    # An edge along the strip's own side crosses nothing.
    inside = shapely.intersection(rims, _band(x_mm, (1.0 - 2.0 * _SAME) * width, bottom - 1.0, top + 1.0))
    pieces = shapely.get_parts(inside)
    bounds = shapely.bounds(pieces[~shapely.is_empty(pieces)])[:, [1, 3]]
    low, high = bounds[np.argsort(bounds[:, 0])].T
    first = np.flatnonzero(np.append(True, low[1:] > np.maximum.accumulate(high)[:-1]))
    return np.stack([low[first], np.maximum.reduceat(high, first)], axis=1)


def _rows(zones: FloatArray, length: float, h: float, decay: float, most: int) -> FloatArray:
    """Return rows h apart in the zones, and further and further apart away from them."""
    rows = []
    for low, high in zones:
        count = max(2, int(np.ceil((high - low) / h)))  # a row within, however small the contact
        rows.append(np.linspace(low, high, min(count, most) + 1))
    rows.append(zones[0, 0] - _steps(zones[0, 0], h, decay))
    rows.append(zones[-1, 1] + _steps(length - zones[-1, 1], h, decay))
    for below, above in zip(zones[:-1, 1], zones[1:, 0], strict=True):
        half = _steps(0.5 * (above - below), h, decay)
        rows += [below + half, above - half]
    y = np.unique(np.clip(np.concatenate([[0.0, length], *rows]), 0.0, length))
    return np.asarray(y[np.concatenate([[True], np.diff(y) > 1e-6 * h])])


def _steps(distance: float, h: float, decay: float) -> FloatArray:
    """Return places from 0 up to a distance, h apart up to `decay`, then growing with the distance."""
    if distance <= 0.0:
        return np.zeros(1)
    near = np.arange(0.0, decay + h, h)
    growth = 1.0 + h / decay
    count = max(0, int(np.ceil(np.log(max(distance / near[-1], 1.0)) / np.log(growth))))
    places = np.concatenate([near, near[-1] * growth ** np.arange(1, count + 1)])
    last = int(np.searchsorted(places, distance * (1.0 - 1e-12)))
    return np.asarray(places[: last + 1] * (distance / places[last]))

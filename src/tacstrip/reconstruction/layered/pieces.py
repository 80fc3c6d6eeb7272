"""Where objects can lie: what both layers' strips leave, cut into connected pieces, and polygons to begin with."""

from __future__ import annotations

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.scene import LayerReadings, SceneProblem

_GRID = 160  # cells across the sensor
_LEAST_CELLS = 4
_CUT_ANGLES, _CUT_SHARES = 8, (0.35, 0.5, 0.65)


def possible(problem: SceneProblem) -> list[FloatArray]:
    """Return the connected pieces of what no strip excludes, as points of a grid (P, 2) [mm], the largest first.

    Every object lies within one piece; a piece may hold none, one or several.
    """
    corners = np.concatenate([part.layer.corners_mm for part in problem.layers])
    low, high = corners.min(axis=0), corners.max(axis=0)
    step = float((high - low).max()) / _GRID
    shape = np.ceil((high - low) / step).astype(int)
    cells = np.indices(tuple(shape.tolist()))
    points = low + (np.moveaxis(cells, 0, -1) + 0.5) * step  # (X, Y, 2)
    open_to = np.ones(shape, dtype=bool)
    for part in problem.layers:
        open_to &= _within(part, points, step)
    labels = _connected(open_to)
    pieces = [points[labels == label] for label in np.unique(labels[open_to])]
    return sorted((p for p in pieces if len(p) >= _LEAST_CELLS), key=len, reverse=True)


def _connected(open_to: BoolArray) -> IntArray:
    """Return one and the same number above 0 for cells that hang together, corners counted, 0 for closed ones.

    Every cell takes the highest number around it until none changes; scipy.ndimage takes longer to import.
    """
    labels = np.where(open_to, np.arange(1, open_to.size + 1).reshape(open_to.shape), 0)
    while True:
        padded = np.pad(labels, 1)
        rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
        grown = np.where(open_to, np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:]), 0)
        if (grown == labels).all():
            return grown
        labels = grown


def _within(part: LayerReadings, points: FloatArray, slack: float) -> BoolArray:
    """Tell which points (..., 2) [mm] lie within the hull that a layer's strips read."""
    sensor = part.layer.sensor
    own = part.layer.to_layer(points)
    l, u = part.bounds_mm
    at = own[..., 0] / sensor.pitch_mm - 0.5
    nearest = np.clip(np.round(at).astype(int), 0, sensor.strips - 1)
    first = np.clip(np.floor(at).astype(int), 0, max(sensor.strips - 2, 0))
    share = np.clip(at - first, 0.0, 1.0)
    second = np.minimum(first + 1, sensor.strips - 1)
    between = [(1.0 - share) * e[first] + share * e[second] for e in (l, u)]
    low, high = (np.where(np.isfinite(b), b, e[nearest]) for b, e in zip(between, (l, u), strict=True))
    y = own[..., 1]
    return np.asarray((y >= low - slack) & (y <= high + slack))  # NaN, a silent strip: no


def outline(piece: FloatArray, corners: int) -> FloatArray | None:
    """Return the convex hull of a piece's points with so many corners at most (N, 2) [mm]; None without an area."""
    hull = shapely.convex_hull(shapely.MultiPoint(piece))
    if hull.geom_type != "Polygon" or hull.area <= 0.0:
        return None
    ring: FloatArray = shapely.get_coordinates(hull)[:-1][::-1]
    while len(ring) > corners:
        ring = np.delete(ring, int(_corner_areas(ring).argmin()), axis=0)
    return ring


def _corner_areas(ring: FloatArray) -> FloatArray:
    """Return twice the area that each corner cuts off (N,)."""
    before, after = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
    return np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])


def cuts(piece: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the ways to cut a piece in two by a straight line."""
    found = []
    for angle in np.pi * np.arange(_CUT_ANGLES) / _CUT_ANGLES:
        along = piece @ np.array([np.cos(angle), np.sin(angle)])
        for at in np.quantile(along, _CUT_SHARES):
            left = along <= at
            if _LEAST_CELLS <= left.sum() <= len(piece) - _LEAST_CELLS:
                found.append((piece[left], piece[~left]))
    return found

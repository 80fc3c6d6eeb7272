"""Strips as wide as they are: what their width adds to the readings of an outline, and takes from what ends tell.

The polygon fit sees a strip as its centre line. A strip of some width reads the mean height of its edges, and beyond it
where they are slanted (`sensor.slant`); the last strips that read anything are covered in part. So the readings are
fitted, what the width adds to the outline found is taken from them, and what is left is fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.resolved_ends import resolved_ends
from tacstrip.contact.signature import signatures
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.slant import PARTS, edge_read
from tacstrip.sensor.spec import Sensor

_ENOUGH = 8  # strips: of fewer none is left out
_STEP = 1e-3  # of the pitch, for differences
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


def with_corners(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `equivalent_ends`, those of strips with a corner on them exact under ideal contact."""
    l, u = equivalent_ends(sensor, outline, x)
    contact = shapely.Polygon(outline.vertices)
    if sensor.contact_lambda_mm > 0.0 or not contact.is_valid:
        return l, u
    for i in np.flatnonzero(has_corner(sensor, outline.vertices, x).any(axis=1)):
        ends = resolved_ends([contact], float(x[i]), sensor.strip_width, sensor.length_mm)
        if ends is not None:
            l[i], u[i] = ends
    return l, u


def has_corner(sensor: Sensor, vertices: FloatArray, x: FloatArray) -> BoolArray:
    """Whether strips at x (n,) have each of the vertices (V, 2) on them (n, V)."""
    return np.asarray(np.abs(x[:, None] - vertices[:, 0]) < 0.5 * sensor.strip_width)


def end_slopes(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the slopes of `equivalent_ends` by `vertices.ravel()`, each (n, 2 V), by differences."""
    step = _STEP * sensor.pitch_mm
    found = []
    for index, sign in zip(outline.indices, (-1.0, 1.0), strict=True):
        slopes = np.zeros((len(x), 2 * len(outline.vertices)))
        for place in range(slopes.shape[1]):
            if place // 2 in index:
                ends = []
                for by in (-step, step):
                    moved = outline.vertices.copy()
                    moved.flat[place] += by
                    ends.append(_edge(sensor, moved[index], x, sign))
                slopes[:, place] = (ends[1] - ends[0]) / (2.0 * step)
        found.append(slopes)
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

    `corners` takes a millisecond for each strip with a corner on it, which the closed form has off by up to 5e-3.
    """
    l, u = (np.interp(x, *chain.T) for chain in (outline.lower, outline.upper))
    ends = (with_corners if corners else equivalent_ends)(sensor, outline, x)
    thin, wide = signatures(sensor, l, u), signatures(sensor, *ends)
    return {name: k - (wide[name] - thin[name]) for name, k in readings.items()}


def _edge(sensor: Sensor, chain: FloatArray, x: FloatArray, sign: float) -> FloatArray:
    borders = x[:, None] + sensor.strip_width * (np.arange(PARTS + 1) / PARTS - 0.5)
    height = np.interp(borders, *chain.T)
    return edge_read(height, sensor.strip_width, sign, sensor.contact_lambda_mm)

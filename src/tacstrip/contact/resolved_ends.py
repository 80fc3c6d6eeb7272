"""Where ideal contact on a thin strip would end that reads like a shape on a wide strip, by boundary integrals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import FloatArray
from tacstrip.contact.boundary_integrals import BAR, Charges

_SAME = 1e-9  # of the width: closer to a side is on it; shorter pieces of the edge are none


def resolved_ends(
    shapes: Sequence[BaseGeometry], x_mm: float, width_mm: float, length_mm: float
) -> tuple[float, float] | None:
    """Return l and u [mm] of the ideal contact on a thin strip that reads the same, within 1e-3 of the width.

    Parameters
    ----------
    shapes
        What lies on the sensor, polygons that touch ideally.
    x_mm, width_mm, length_mm
        Of the strip: its centre line, width and length.

    Returns
    -------
    tuple or None
        None where nothing touches, or this way does not serve: lines, contacts that reach a bar, hundreds of corners.

    Examples
    --------
    An edge at 45 degrees reads ln 2 / pi of the width beyond its middle:

    >>> import shapely
    >>> slanted = shapely.Polygon([(0, 35), (10, 45), (10, 80), (0, 80)])
    >>> [round(end, 2) for end in resolved_ends([slanted], 5.0, 10.0, 100.0)]
    [37.79, 80.0]
    """
    half = 0.5 * width_mm
    strip = shapely.box(x_mm - half, 0.0, x_mm + half, length_mm)
    parts = shapely.get_parts(shapely.union_all(shapely.intersection(np.array(shapes, dtype=object), strip)))
    origin = np.array([x_mm - half, 0.0])
    rings = [(shapely.get_coordinates(p.exterior) - origin) / width_mm for p in parts if p.area > 0.0]
    pieces, length = _pieces(rings), length_mm / width_mm
    if any(p.area == 0.0 and p.length > 0.0 for p in parts):
        return None
    y = pieces[..., 1]
    across = len(pieces) > 0 and np.all(np.abs(np.diff(pieces, axis=1)) == (1.0, 0.0))
    if across and (y.min() >= BAR or y.max() <= length - BAR):
        return float(y.min()) * width_mm, float(y.max()) * width_mm  # straight across: as on a thin strip
    charges = Charges.on(pieces, length)
    if charges is None:
        return None
    l, u = (charges.ends * width_mm).tolist()
    return l, u


def _pieces(rings: Sequence[FloatArray]) -> FloatArray:
    """Return the straight pieces of edges (pieces, 2, 2), from x = 0 to 1, but for those along the strip's sides."""
    found = []
    for ring in rings:
        x = ring[:, 0]
        x[np.abs(x) < _SAME], x[np.abs(x - 1.0) < _SAME] = 0.0, 1.0
        ends = np.stack([ring[:-1], ring[1:]], axis=1)
        side = (ends[:, 0, 0] == ends[:, 1, 0]) & np.isin(ends[:, 0, 0], (0.0, 1.0))
        found.append(ends[~side & (np.hypot(*(ends[:, 1] - ends[:, 0]).T) > _SAME)])
    return np.concatenate(found) if found else np.zeros((0, 2, 2))

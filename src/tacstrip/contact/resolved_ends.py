"""Where ideal contact on a thin strip would end that reads like a shape on a wide strip, by boundary integrals.

Without contact resistance the difference of both layers' potentials is 0 under the contact and obeys Laplace's
equation beside it; it is even along either bar, and no current leaves the sides. So it is y plus what charges on the
contact's edge add, by the Green's function of the strip: mirrored in its sides, -(ln|2 sinh(pi (z - z') / 2)| +
ln|2 sinh(pi (z + z'*) / 2)|) / 2 pi with z = y + ix over the width, and once more in the bars. On each straight piece
of the edge the charge is a series of Chebyshev polynomials over sqrt(1 - t^2), whose logarithmic integrals are known
(J. C. Mason and D. C. Handscomb, Chebyshev Polynomials (2003), 9.5.2), so corners and tips need no finer mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import FloatArray

_SAME = 1e-9  # of the width: closer to a side is on it; shorter pieces of the edge are none
_BAR = 0.02  # widths: nearer to a bar the charges and their images are too near for the quadrature
_FAR = 3.0  # widths: an image beyond a bar adds exp(-2 pi) to the power of this
_FEWEST, _BY_LENGTH, _MOST = 8, 6.0, 64  # terms of a piece: so many, and more for each width that it is long
_UNKNOWNS = 800
_FINER = 4  # quadrature nodes a term
_DIGITS = 7  # of widths: fewer than rounding leaves alike on all machines, whatever their threads (1e-13)


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
    if not 0 < len(pieces) <= _UNKNOWNS // _FEWEST or any(p.area == 0.0 and p.length > 0.0 for p in parts):
        return None
    y = pieces[..., 1]
    bars = y.min() < _BAR, y.max() > length - _BAR
    if not all(bars) and np.all(np.abs(np.diff(pieces, axis=1)) == (1.0, 0.0)):
        return float(y.min()) * width_mm, float(y.max()) * width_mm  # straight across: as on a thin strip
    if any(bars):
        return None
    l, u = (round(end, _DIGITS) for end in _solved(pieces, length))
    return l * width_mm, max(l, u) * width_mm


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


def _solved(pieces: FloatArray, length: float) -> tuple[float, float]:
    """Return l and u of pieces on a strip of width 1."""
    middle, reach = pieces.mean(axis=1), 0.5 * (pieces[:, 1] - pieces[:, 0])
    most = max(_FEWEST, min(_MOST, _UNKNOWNS // len(pieces)))
    terms = np.clip(_FEWEST + _BY_LENGTH * 2.0 * np.hypot(*reach.T), _FEWEST, most).astype(int)
    t, s = ([np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in many] for many in (terms, _FINER * terms))
    at, charge = (
        np.concatenate([m + r * each[:, None] for m, r, each in zip(middle, reach, nodes, strict=True)])
        for nodes in (t, s)
    )
    x, y = at.T[..., None]
    by_x, by_y = charge.T
    ends = np.cumsum(terms)
    rows = [slice(end - n, end) for end, n in zip(ends, terms, strict=True)]
    nodes = [slice(_FINER * one.start, _FINER * one.stop) for one in rows]
    # No node of t is one of s, for there are four of the latter to each.
    free = _log(x - by_x, y - by_y)
    for row, node, at_t, at_s in zip(rows, nodes, t, s, strict=True):
        free[row, node] -= np.log(np.abs(at_t[:, None] - at_s))
    images = _log(x + by_x, y - by_y)
    near = by_y.min() < _FAR, by_y.max() > length - _FAR
    for mirrored in (bar - by_y for bar, counts in zip((0.0, 2.0 * length), near, strict=True) if counts):
        images -= _log(x - by_x, y - mirrored) + _log(x + by_x, y - mirrored)
    kernel = -0.5 * np.abs(y - by_y) - (free + images) / (2.0 * np.pi)
    matrix, moments = np.empty((len(y), len(y))), np.empty(len(y))
    for row, node, at_t, at_s in zip(rows, nodes, t, s, strict=True):
        order = np.arange(len(at_t))
        weight = np.cos(order * np.arccos(at_s)[:, None]) * (np.pi / len(at_s))  # of T_k over sqrt(1 - t^2)
        log_of_term = -np.pi * np.where(order == 0, np.log(2.0), 1.0 / np.maximum(order, 1))
        matrix[:, row], moments[row] = kernel[:, node] @ weight, by_y[node] @ weight
        matrix[row, row] -= np.cos(order * np.arccos(at_t)[:, None]) * log_of_term / (2.0 * np.pi)
    # What goes into the contact comes out of it: the charges sum to 0. A constant is left open instead.
    total = np.zeros(len(y))
    total[[row.start for row in rows]] = np.pi
    system = np.block([[matrix, np.ones((len(matrix), 1))], [total[None], np.zeros((1, 1))]])
    found = np.linalg.solve(system, np.append(-y.ravel(), 0.0))
    moment = 0.5 * float(found[:-1] @ moments)
    return moment - float(found[-1]), -moment - float(found[-1])


def _log(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return ln|2 sinh(pi (y + ix) / 2)| - pi |y| / 2, which vanishes far away."""
    decay = -np.pi * np.abs(y)
    return np.asarray(0.5 * np.log(np.expm1(decay) ** 2 + 4.0 * np.exp(decay) * np.sin(0.5 * np.pi * x) ** 2))

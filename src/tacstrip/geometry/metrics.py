"""How well a recovered polygon matches the original (thesis 5.3), and modern companions.

The mismatch coefficient (M.C.) compares normalised turning functions theta(s) and knows only shape; the
absolute orientation and position errors (A.O.E., A.P.E.) compare reference lines and centroids.

In this file a point is the complex number x + iy, and a polygon the array (N,) of its corners.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from tacstrip.errors import ContactError, OptionError, one_of

if TYPE_CHECKING:
    from tacstrip.arrays import FloatArray

CentroidKind: TypeAlias = Literal["area", "vertices"]
_Polygon: TypeAlias = npt.NDArray[np.complex128]

_SAME = 1e-9  # relative: corners nearer than this part of the polygon's size are one
_STRAIGHT = 1e-9  # [rad] a corner that turns less is none
_FIX = "give its corners in their order along the boundary"
_CHUNK = 300_000  # numbers in one work array [8 bytes each]; about ten such arrays live at once


@dataclass(frozen=True)
class Mismatch:
    """What separates a recovered polygon from the original; all zero (and `iou` 1) for a perfect match.

    Attributes
    ----------
    mc
        Mismatch coefficient M.C. [rad]: the difference in shape, see `mismatch_coefficient`.
    mc_length
        The same un-normalised: `mc` times the mean of the two perimeters [rad mm], as in chapter 6.
    aoe
        Absolute orientation error A.O.E. [rad], 0 to pi: the angle between the two reference lines, each
        from the centroid to a corner. The original's corner is the one farthest from its centroid (the
        first of equals). Its partner: with equally many corners, the one that the cyclic pairing with the
        least sum of squared distances gives, centroids laid together; otherwise the nearest corner.
    ape
        Absolute position error A.P.E. [mm]: the distance between the centroids.

    Examples
    --------
    >>> import tacstrip as ts
    >>> square = [(0, 0), (10, 0), (10, 10), (0, 10)]
    >>> moved = ts.mismatch(square, [(x + 1, y) for x, y in square])
    >>> round(moved.mc, 9), round(moved.ape, 9), round(moved.iou, 4)
    (0.0, 1.0, 0.8182)
    """

    mc: float
    mc_length: float
    aoe: float
    ape: float
    _original: _Polygon = field(repr=False, compare=False)
    _recovered: _Polygon = field(repr=False, compare=False)

    @cached_property
    def iou(self) -> float:
        """Intersection over union of the two areas, 0 to 1; an area that overlaps itself counts once."""
        import shapely

        both = [shapely.Polygon(_coordinates(p)) for p in (self._original, self._recovered)]
        a, b = shapely.make_valid(both, method="structure", keep_collapsed=False)
        return float(shapely.intersection(a, b).area / shapely.union(a, b).area)

    @cached_property
    def hausdorff(self) -> float:
        """Hausdorff distance of the two boundaries [mm].

        Taken at the corners and at 99 points between them on every side: never above the true value, and
        below it by 1/200 of the longest side at most.
        """
        import shapely

        a, b = (shapely.LinearRing(_coordinates(p)) for p in (self._original, self._recovered))
        return float(shapely.hausdorff_distance(a, b, densify=0.01))


def mismatch(
    original: npt.ArrayLike,
    recovered: npt.ArrayLike,
    *,
    centroid: CentroidKind = "area",
    around_mm: float | None = None,
) -> Mismatch:
    """Compare a recovered polygon with the original.

    Parameters
    ----------
    original, recovered
        Corners (N, 2) [mm] along the boundary in either direction, closed or not; repeated points and points
        on a straight side do not count.
    centroid
        Centroid for A.O.E. and A.P.E.: "area", of the enclosed area, or "vertices", the mean of the corners.
    around_mm
        Circumference of a closed tube, where x of either may count any number of rounds; None: a plane.

    Raises
    ------
    ContactError
        One of the two is no polygon: see `clean_polygon`.

    Examples
    --------
    >>> import tacstrip as ts
    >>> square = [(0, 0), (10, 0), (10, 10), (0, 10)]
    >>> ts.mismatch(square, square).iou
    1.0
    """
    a, b = _clean(original, "the original polygon"), _clean(recovered, "the recovered polygon")
    center_a, center_b = _centroid(a, centroid), _centroid(b, centroid)
    if around_mm is not None:
        rounds = around_mm * round((center_a - center_b).real / around_mm)
        b, center_b = b + rounds, center_b + rounds
    mc = float(_turning_distance(a, b))
    perimeters = np.abs(_sides(a)).sum() + np.abs(_sides(b)).sum()
    aoe = _orientation_error(a - center_a, b - center_b)
    return Mismatch(mc, mc * 0.5 * float(perimeters), float(aoe), float(abs(center_b - center_a)), a, b)


def errors_of_many(original: npt.ArrayLike, recovered: FloatArray) -> FloatArray:
    """Return M.C. [rad], A.O.E. [rad] and A.P.E. [mm] (K, 3) of polygons (K, N, 2) [mm], as `mismatch` does one.

    NaN where a polygon is none: its sides cross, or it has no area.
    """
    a, z = _clean(original, "the original polygon"), recovered[..., 0] + 1j * recovered[..., 1]
    z = np.where((_area(z) < 0.0)[:, np.newaxis], z[:, ::-1], z)
    turn, size = np.abs(_turns(z)), np.abs(z - z[:, :1]).max(axis=1)
    sound = (turn > _STRAIGHT).all(axis=1) & (turn <= np.pi - _STRAIGHT).all(axis=1)
    sound &= (np.abs(_sides(z)).min(axis=1) > _SAME * size) & (_area(z) > _SAME * size**2)
    sound &= np.abs(_turns(z).sum(axis=1) - 2.0 * np.pi) <= 1e-3
    errors = np.full((len(z), 3), np.nan)
    if sound.any():
        b, center_a = z[sound], _centroid(a, "area")
        center_b = _centroid(b, "area")
        aoe = _orientation_error(a - center_a, b - center_b[:, np.newaxis])
        errors[sound] = np.stack((_turning_distance(a, b), aoe, np.abs(center_b - center_a)), axis=-1)
    for k in np.flatnonzero(~sound):  # corners that do not count, or no polygon
        with suppress(ContactError):
            m = mismatch(original, recovered[k])
            errors[k] = m.mc, m.aoe, m.ape
    return errors


def mismatch_coefficient(a: npt.ArrayLike, b: npt.ArrayLike) -> float:
    """Return M.C. [rad]: the L1 distance of the normalised turning functions, least over start and rotation.

    Exact, and a metric on shapes: place, size, direction and first corner do not matter. Time grows with
    m n (m + n) for m and n corners, 0.1 ms for 6 and 6, 1 s for 2,000 and 6, ten minutes for 2,000 and 2,000.
    """
    return float(_turning_distance(_clean(a, "polygon a"), _clean(b, "polygon b")))


def clean_polygon(vertices: npt.ArrayLike) -> FloatArray:
    """Return a polygon's corners (N, 2) counter-clockwise, each once, none on a straight side or a spike.

    Raises
    ------
    ContactError
        Not an (N, 2) array, a number that is not finite, fewer than three distinct corners, no area, or a
        total turning other than 2 pi, which tells of sides that cross. (Sides
        can cross and still turn by 2 pi; the turning function is then sound, and the polygon is let through.)
    """
    return _coordinates(_clean(vertices, "the polygon"))


def _points(vertices: npt.ArrayLike, name: str) -> _Polygon:
    try:
        xy = np.asarray(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(f"{name} is not an (N, 2) array of numbers [mm]: {error}") from error
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise ContactError(f"{name} is an array of shape {xy.shape}; give its corners as (N, 2) [mm]")
    bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(bad):
        raise ContactError(f"{name} has corner {bad[0]} at {xy[bad[0]]}; remove it or give finite numbers")
    return np.asarray(xy[:, 0] + 1j * xy[:, 1], dtype=np.complex128)


def _clean(vertices: npt.ArrayLike, name: str) -> _Polygon:
    z = _points(vertices, name)
    size = np.abs(z - z[:1]).max(initial=0.0)
    z = z[np.abs(_sides(z)) > _SAME * size]
    if len(z) < 3:
        raise ContactError(f"{name} has fewer than three distinct corners; give at least three")
    enclosed = _area(z)
    if abs(enclosed) <= _SAME * size**2:
        raise ContactError(f"{name} has no area: its corners lie on one line, or its sides cross; {_FIX}")
    if enclosed < 0.0:
        z = z[::-1]
    turn = _turns(z)
    while np.any(spikes := np.abs(turn) > np.pi - _STRAIGHT):
        z = z[~spikes]
        z = z[np.abs(_sides(z)) > _SAME * size]  # a spike's foot may stand there twice now
        turn = _turns(z)
    if abs(turn.sum() - 2.0 * np.pi) > 1e-3:
        raise ContactError(f"{name} turns by {turn.sum() / np.pi:.3g} pi, not 2 pi: its sides cross; {_FIX}")
    return np.compress(np.abs(turn) > _STRAIGHT, z)


def _coordinates(z: _Polygon) -> FloatArray:
    return np.stack((z.real, z.imag), axis=-1)


def _after(z: _Polygon) -> _Polygon:
    return np.concatenate((z[..., 1:], z[..., :1]), axis=-1)


def _sides(z: _Polygon) -> _Polygon:
    return _after(z) - z


def _turns(z: _Polygon) -> FloatArray:
    """Return by how much the boundary turns at each corner [rad], -pi to pi."""
    side = _sides(z)
    before = np.concatenate((side[..., -1:], side[..., :-1]), axis=-1)
    return np.angle(side * before.conj())


def _area(z: _Polygon) -> FloatArray:
    r = z - z[..., :1]  # from the first corner: far from the origin the products would lose digits
    return np.asarray(0.5 * (r.conj() * _after(r)).imag.sum(axis=-1))


def _centroid(z: _Polygon, kind: str) -> Any:
    if kind not in get_args(CentroidKind):
        raise OptionError(one_of("centroid", kind, get_args(CentroidKind)))
    if kind == "vertices":
        return z.mean(axis=-1)
    r = z - z[..., :1]
    cross = (r.conj() * _after(r)).imag  # (..., N) twice the area of each triangle from the first corner
    return z[..., 0] + ((r + _after(r)) * cross).sum(axis=-1) / (3.0 * cross.sum(axis=-1))


def _orientation_error(a: _Polygon, b: _Polygon) -> FloatArray:
    """Return A.O.E. (...,) [rad] of a polygon (M,) and others (..., N), all with their centroids at the origin."""
    distance = np.abs(a)
    reference = int(np.argmax(distance >= (1.0 - _SAME) * distance.max()))
    n = b.shape[-1]
    if len(a) == n:
        # sum |b[k + shift] - a[k]|^2 is least where the real part of sum b[k + shift] conj(a[k]) is greatest.
        twice = np.concatenate((b, b[..., :-1]), axis=-1)
        shifted = sliding_window_view(twice, n, axis=-1)  # (..., shifts, n)
        partner = (reference + (shifted @ a.conj()).real.argmax(axis=-1)) % n
    else:
        partner = np.abs(b - a[reference]).argmin(axis=-1)
    found = np.take_along_axis(b, partner[..., np.newaxis], axis=-1)[..., 0]
    return np.asarray(np.abs(np.angle(found / a[reference])))


def _turning_function(z: _Polygon) -> tuple[FloatArray, FloatArray]:
    """Return where the corners lie, in parts of the perimeter, and their turns [rad], for two rounds."""
    s = np.cumsum(np.abs(_sides(z)), axis=-1)
    s /= s[..., -1:]
    turn = _turns(_after(z))  # the first side ends at the second corner
    return np.concatenate((s, s + 1.0), axis=-1), np.concatenate((turn, turn), axis=-1)


def _turning_distance(a: _Polygon, b: _Polygon) -> FloatArray:
    """Return the least L1 distance (...,) [rad] of the turning functions of a polygon (M,) and others (..., N).

    For a fixed rotation it is piecewise linear in the start, with kinks where a corner of a meets one of b.
    So the least lies at one of these m n starts, with its best rotation. Let W(x) be the part of the boundary
    where theta_a - theta_b <= x: the median is best, and leaves the integral of min(W, 1 - W) over x.
    """
    (s_a, turn_a), (s_b, turn_b) = _turning_function(a), _turning_function(b)
    m, (*many, n) = len(a), b.shape
    starts = max(1, _CHUNK // (math.prod(many) * (m + n)))  # in one chunk
    least = np.full(many, np.inf)
    for first in range(0, m * n, starts):
        i, j = np.divmod(np.arange(first, min(first + starts, m * n))[:, np.newaxis], n)
        at_a, at_b = i + np.arange(m), j + np.arange(n)
        s = _joined(s_a[at_a] - s_a[i], s_b[..., at_b] - s_b[..., j])  # (..., starts, m + n)
        jump = _joined(turn_a[at_a], -turn_b[..., at_b])  # of theta_a - theta_b
        order = np.argsort(s, axis=-1, kind="stable")
        length = np.diff(np.take_along_axis(s, order, axis=-1), axis=-1, append=1.0)
        difference = np.cumsum(np.take_along_axis(jump, order, axis=-1), axis=-1)  # up to a constant
        order = np.argsort(difference, axis=-1)
        W = np.cumsum(np.take_along_axis(length, order, axis=-1), axis=-1)[..., :-1]
        dx = np.diff(np.take_along_axis(difference, order, axis=-1), axis=-1)
        least = np.minimum(least, (np.minimum(W, 1.0 - W) * dx).sum(axis=-1).min(axis=-1))
    return np.asarray(np.maximum(least, 0.0))


def _joined(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a (S, M), the same for each, beside b (..., S, N): (..., S, M + N)."""
    return np.concatenate((np.broadcast_to(a, (*b.shape[:-1], a.shape[-1])), b), axis=-1)


def column_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return intersection over union (...,) of contacts, l and u in columns (..., 2, G)."""
    over = np.minimum(a[..., 1, :], b[..., 1, :]) - np.maximum(a[..., 0, :], b[..., 0, :])
    both = np.maximum(over, 0.0).sum(axis=-1)
    either = (a[..., 1, :] - a[..., 0, :]).sum(axis=-1) + (b[..., 1, :] - b[..., 0, :]).sum(axis=-1) - both
    return np.asarray(both / np.maximum(either, 1e-12))


def pairwise_column_iou(ends: FloatArray) -> FloatArray:
    """Return `column_iou` (K, K) of all contacts (K, 2, G) with each other.

    Row by row and each pair once: what is at hand stays in the cache, four times as fast as all of it at once.
    """
    l, u = np.ascontiguousarray(ends.swapaxes(0, 1))
    both = np.empty((len(ends), len(ends)))
    for i in range(len(ends)):
        over = np.minimum(u[i], u[i:])
        over -= np.maximum(l[i], l[i:])
        both[i, i:] = both[i:, i] = np.maximum(over, 0.0, out=over).sum(axis=-1)
    width = (u - l).sum(axis=-1)
    return np.asarray(both / np.maximum(width[:, None] + width - both, 1e-12))

"""How well a recovered polygon matches the original (thesis 5.3), and modern companions.

Problem: two polygons agree in shape, in place and in direction, each to its own degree. Solution: three
numbers. The mismatch coefficient (M.C.) compares normalised turning functions theta(s) and knows only shape;
the absolute orientation and position errors (A.O.E., A.P.E.) compare reference lines and centroids.

Inside this file a point is the complex number x + iy, and a polygon an array of corners (N,), counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ContactError, OptionError, one_of

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

CentroidKind: TypeAlias = Literal["area", "vertices"]
_Polygon: TypeAlias = npt.NDArray[np.complex128]

_CENTROIDS = ("area", "vertices")
_SAME = 1e-9  # of the polygon's size: corners nearer than this are one corner
_STRAIGHT = 1e-9  # [rad] a corner that turns less is none
_TIE = 1e-9  # relative: corners this equally far from the centroid are equally far
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
    """

    mc: float
    mc_length: float
    aoe: float
    ape: float
    _original: _Polygon = field(repr=False, compare=False)
    _recovered: _Polygon = field(repr=False, compare=False)

    @cached_property
    def iou(self) -> float:
        """Intersection over union of the two areas, 0 to 1; a polygon that crosses itself is made valid first."""
        import shapely

        a, b = _valid(self._original), _valid(self._recovered)
        return float(shapely.intersection(a, b).area / shapely.union(a, b).area)

    @cached_property
    def hausdorff(self) -> float:
        """Hausdorff distance of the two boundaries [mm].

        Taken at the corners and at 99 points between them on every side, so at most 1/200 of the longest
        side below the true value, and never above it.
        """
        import shapely

        a, b = (shapely.LinearRing(_coordinates(p)) for p in (self._original, self._recovered))
        return float(shapely.hausdorff_distance(a, b, densify=0.01))


def mismatch(
    original: npt.ArrayLike, recovered: npt.ArrayLike, *, centroid: CentroidKind = "area"
) -> Mismatch:
    """Compare a recovered polygon with the original.

    Parameters
    ----------
    original, recovered
        Corners (N, 2) [mm] along the boundary in either direction, closed or not; repeated points and points
        on a straight side do not count.
    centroid
        Centroid for A.O.E. and A.P.E.: "area", of the enclosed area, or "vertices", the mean of the corners.

    Raises
    ------
    ContactError
        One of the two is no polygon: see `clean_polygon`.
    """
    a, b = _clean(original, "the original polygon"), _clean(recovered, "the recovered polygon")
    center_a, center_b = _centroid(a, centroid), _centroid(b, centroid)
    mc = _turning_distance(a, b)
    mean_perimeter = 0.5 * float(np.abs(_sides(a)).sum() + np.abs(_sides(b)).sum())
    return Mismatch(
        mc=mc,
        mc_length=mc * mean_perimeter,
        aoe=_orientation_error(a - center_a, b - center_b),
        ape=abs(center_b - center_a),
        _original=a,
        _recovered=b,
    )


def mismatch_coefficient(a: npt.ArrayLike, b: npt.ArrayLike) -> float:
    """Return M.C. [rad]: the L1 distance of the normalised turning functions, least over start and rotation.

    Exact, and a metric on shapes: place, size, direction and first corner do not matter. Time grows with
    m n (m + n) for m and n corners: a profile of 2,000 against 6 corners takes seconds.
    """
    return _turning_distance(_clean(a, "polygon a"), _clean(b, "polygon b"))


def area(vertices: npt.ArrayLike) -> float:
    """Return the signed area [mm^2] of corners (N, 2) [mm], positive where they run counter-clockwise."""
    return _area(_points(vertices, "the polygon"))


def centroid(vertices: npt.ArrayLike, kind: CentroidKind = "area") -> FloatArray:
    """Return the centroid (2,) [mm] of a polygon's area, or with kind "vertices" the mean of its corners."""
    return _coordinates(_centroid(_clean(vertices, "the polygon"), kind))


def clean_polygon(vertices: npt.ArrayLike) -> FloatArray:
    """Return a polygon's corners (N, 2) counter-clockwise, each once and none on a straight side.

    Raises
    ------
    ContactError
        Not an (N, 2) array, a number that is not finite, fewer than three distinct corners, no area, a side
        that runs back on itself, or a total turning other than 2 pi, which tells of sides that cross. (Sides
        can cross and still turn by 2 pi; the turning function is then sound, and the polygon is let through.)
    """
    return _coordinates(_clean(vertices, "the polygon"))


def _points(vertices: npt.ArrayLike, name: str) -> _Polygon:
    try:
        xy = np.asarray(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(
            f"{name} is not an array of numbers ({error}); give its corners as (N, 2) [mm]"
        ) from error
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise ContactError(f"{name} is an array of shape {xy.shape}; give its corners as (N, 2) [mm]")
    bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(bad):
        x, y = xy[bad[0]]
        raise ContactError(f"{name} has corner {bad[0]} at ({x}, {y}); remove it or give it finite numbers")
    return xy[:, 0] + 1j * xy[:, 1]


def _clean(vertices: npt.ArrayLike, name: str) -> _Polygon:
    z = _points(vertices, name)
    size = np.abs(z - z[:1]).max(initial=0.0)
    z = z[np.abs(_sides(z)) > _SAME * size]
    if len(z) < 3:
        raise ContactError(f"{name} has fewer than three distinct corners; give at least three")
    signed = _area(z)
    if abs(signed) <= _SAME**2 * size**2:
        raise ContactError(
            f"{name} has no area: its corners lie on one line, or its sides cross; "
            "give corners that enclose an area, in their order along the boundary"
        )
    if signed < 0.0:
        z = z[::-1]
    turns = _turns(z)
    spikes = np.flatnonzero(np.abs(turns) > np.pi - _STRAIGHT)
    if len(spikes):
        tip = z[spikes[0]]
        raise ContactError(
            f"{name} runs back on itself at ({tip.real:.6g}, {tip.imag:.6g}); remove that corner"
        )
    total = turns.sum()
    if abs(total - 2.0 * np.pi) > 1e-3:
        raise ContactError(
            f"{name} turns by {total / np.pi:.3g} pi in total instead of 2 pi, so its sides cross; "
            "give its corners in their order along the boundary"
        )
    return z[np.abs(turns) > _STRAIGHT]


def _coordinates(z: npt.NDArray[np.complex128] | complex) -> FloatArray:
    return np.stack((np.real(z), np.imag(z)), axis=-1)


def _after(values: _Polygon) -> _Polygon:
    """Return, for each corner, the value at the next one."""
    return np.concatenate((values[1:], values[:1]))


def _sides(z: _Polygon) -> _Polygon:
    return _after(z) - z


def _turns(z: _Polygon) -> FloatArray:
    """Return by how much the boundary turns at each corner [rad], -pi to pi."""
    side = _sides(z)
    before = np.concatenate((side[-1:], side[:-1]))
    return np.angle(side * before.conj())


def _area(z: _Polygon) -> float:
    r = z - z[:1]  # from the first corner: far from the origin the products would lose digits
    return 0.5 * float((r.conj() * _after(r)).imag.sum())


def _centroid(z: _Polygon, kind: str) -> complex:
    if kind not in _CENTROIDS:
        raise OptionError(one_of("centroid", kind, _CENTROIDS))
    if kind == "vertices":
        return complex(z.mean())
    r = z - z[:1]
    following = _after(r)
    doubled = (r.conj() * following).imag  # of the triangles from the first corner
    return complex(z[0] + ((r + following) * doubled).sum() / (3.0 * doubled.sum()))


def _orientation_error(a: _Polygon, b: _Polygon) -> float:
    """Return A.O.E. [rad] of two polygons with their centroids at the origin."""
    distance = np.abs(a)
    reference = int(np.argmax(distance >= (1.0 - _TIE) * distance.max()))
    if len(a) == len(b):
        # The least sum of |b[k + shift] - a[k]|^2 is the greatest real part of the sum of b[k + shift] conj(a[k]).
        match = np.correlate(np.concatenate((b, b[:-1])), a, mode="valid").real  # (shifts,)
        partner = (reference + int(match.argmax())) % len(b)
    else:
        partner = int(np.abs(b - a[reference]).argmin())
    return abs(float(np.angle(b[partner] * a[reference].conj())))


def _turning_distance(a: _Polygon, b: _Polygon) -> float:
    """Return the least L1 distance of two turning functions [rad].

    For a fixed rotation the distance is piecewise linear in the start, with kinks where a corner of `a` meets
    a corner of `b`: the least lies at one of these m n starts, with the rotation that is best there. At such a
    start let W(x) be the part of the boundary where theta_a - theta_b is at most x. The best rotation is the
    weighted median, and the distance there is the integral of min(W, 1 - W) over x.
    """
    (s_a, turn_a), (s_b, turn_b) = _turning_function(a), _turning_function(b)
    least = np.inf
    for i, j in _meetings(len(a), len(b)):
        # Corners of both from the meeting on; theta_a - theta_b rises at those of a and falls at those of b.
        at_a, at_b = i[:, np.newaxis] + np.arange(len(a)), j[:, np.newaxis] + np.arange(len(b))
        s = np.hstack((s_a[at_a] - s_a[at_a[:, :1]], s_b[at_b] - s_b[at_b[:, :1]]))  # (starts, m + n)
        order = np.argsort(s, axis=1, kind="stable")
        s = np.take_along_axis(s, order, axis=1)
        length = np.diff(s, axis=1, append=1.0)
        jump = np.take_along_axis(np.hstack((turn_a[at_a], -turn_b[at_b])), order, axis=1)
        difference = np.cumsum(jump, axis=1)  # up to a constant, which the rotation takes
        order = np.argsort(difference, axis=1)
        x = np.take_along_axis(difference, order, axis=1)
        W = np.cumsum(np.take_along_axis(length, order, axis=1), axis=1)[:, :-1]
        distance = (np.minimum(W, 1.0 - W) * np.diff(x, axis=1)).sum(axis=1)  # (starts,)
        least = min(least, float(distance.min()))
    return max(least, 0.0)


def _turning_function(z: _Polygon) -> tuple[FloatArray, FloatArray]:
    """Return where corners lie, 0 to 1 along the boundary, and their turns [rad], both for two rounds."""
    s = np.cumsum(np.abs(_sides(z)))
    s /= s[-1]
    turn = np.concatenate((_turns(z)[1:], _turns(z)[:1]))
    return np.concatenate((s, s + 1.0)), np.concatenate((turn, turn))


def _meetings(m: int, n: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Pair every corner of m with every corner of n, in chunks that keep memory small."""
    rows = max(1, _CHUNK // (m + n))
    for first in range(0, m * n, rows):
        pair = np.arange(first, min(first + rows, m * n))
        yield pair // n, pair % n


def _valid(z: _Polygon) -> BaseGeometry:
    import shapely

    polygon = shapely.Polygon(_coordinates(z))
    return (
        polygon if polygon.is_valid else shapely.make_valid(polygon, method="structure", keep_collapsed=False)
    )

"""Area, centroid and orientation of a polygon, and how the uncertainty of its vertices reaches them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray

# Of area, of the centroid's x and y, of orientation.
MomentDeviations: TypeAlias = tuple[float, FloatArray, float]
LEVEL = 0.95  # a region's probability
_NORMAL = 1.959964  # standard deviations within which a normal error lies with that probability
_STEP = 1e-30  # of the complex step: its square vanishes beside any area
# Deviation of the axes' difference, over it, up to which it tells how they lie whatever is likely.
_CLEAR = 0.05
UNKNOWN_ANGLE = math.pi / math.sqrt(12.0)  # standard deviation of an axis that can lie anyhow [rad]


def moments(vertices: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return area [mm^2], centroid (2,) [mm] and central second moments xx, yy, xy (3,) [mm^4].

    Vertices (N, 2) [mm] are counter-clockwise. Without area the centroid is the vertices' mean, without
    vertices NaN.
    """
    if not len(vertices):
        return 0.0, np.full(2, np.nan), np.zeros(3)
    origin = vertices.mean(axis=0)
    area, first, second = _sums(vertices - origin)
    if area == 0.0:
        return 0.0, origin, np.zeros(3)
    x, y = first / area
    return float(area), origin + np.array([x, y]), second - area * np.array([x * x, y * y, x * y])


def area(vertices: FloatArray) -> float:
    """Return a polygon's area alone [mm^2]; arguments as of `moments`."""
    if not len(vertices):
        return 0.0
    x, y = (vertices - vertices[0]).T
    return 0.5 * float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())


def orientation(vertices: FloatArray) -> float:
    """Return the angle of the longer principal axis from x, in (-pi/2, pi/2] [rad]; NaN without vertices."""
    return principal_angle(moments(vertices)[2]) if len(vertices) else math.nan


def principal_angle(second: FloatArray) -> float:
    """Return the angle of the longer principal axis from x, in (-pi/2, pi/2] [rad], from `moments`' xx, yy, xy."""
    xx, yy, xy = second.tolist()
    return 0.5 * math.atan2(2.0 * xy, xx - yy)


def moment_jacobian(vertices: FloatArray) -> FloatArray:
    """Return the slopes of area, the centroid's x and y, and xx - yy and 2 xy by `vertices.ravel()` (5, 2 N).

    In mm, 1 and mm^3; the last two are of the central second moments, and their angle is twice the orientation. Without
    area the centroid has none, NaN.
    """
    area, centroid, _ = moments(vertices)
    found = np.full((5, vertices.size), np.nan)
    # About the centroid the first moments vanish, so the central moments' slopes are the plain ones'.
    found[0], by_x, by_y, by_xx, by_yy, by_xy = _slopes(vertices - centroid)
    if area:
        found[1:3] = by_x / area, by_y / area
    found[3:] = by_xx - by_yy, 2.0 * by_xy
    return found


def deviations(vertices: FloatArray, covariance: FloatArray, uniform: Sequence[int] = ()) -> MomentDeviations:
    """Return the standard deviations of area [mm^2], centroid (2,) [mm] and orientation [rad].

    Parameters
    ----------
    vertices
        Corners (N, 2) [mm], counter-clockwise.
    covariance
        Theirs (2 N, 2 N) [mm^2], in the order of `vertices.ravel()`.
    uniform
        Places in `vertices.ravel()` whose error is uniform, not normal: x of ends of which only a window is known.

    Returns
    -------
    tuple
        By the delta method; of the orientation, which jumps to the other axis where both are nearly alike, by draws of
        the second moments, with the axes' difference as likely to be small as large. 1.96 of them to either side hold
        95 %, so that they are less than the root of the variance where an error is uniform. What the covariance leaves
        open is inf; an orientation that is not known at all has the deviation of an axis that can lie anyhow,
        `UNKNOWN_ANGLE`.
    """
    slopes, at, drawn = moment_jacobian(vertices), list(uniform), _errors()
    with np.errstate(invalid="ignore"):
        every = slopes @ covariance @ slopes.T
        spread = slopes @ covariance[:, at] / np.sqrt(covariance[at, at])
    variance = every.diagonal()
    sigma = np.sqrt(np.where(np.isnan(variance), np.inf, np.maximum(variance, 0.0)))
    off = spread @ drawn[2 : 2 + len(at)]
    for i in np.flatnonzero(np.isfinite(sigma[:3])) if at else ():
        rest = math.sqrt(max(float(sigma[i] ** 2 - spread[i] @ spread[i]), 0.0))
        sigma[i] = _half_width(off[i] + rest * drawn[0]) / _NORMAL
    turn, (xx, yy, xy) = UNKNOWN_ANGLE, moments(vertices)[2].tolist()
    if (axes := complex(xx - yy, 2.0 * xy)) and np.isfinite(sigma[3:]).all():
        value, vector = np.linalg.eigh((every - spread @ spread.T)[3:, 3:])
        x, y = off[3:] + vector * np.sqrt(np.maximum(value, 0.0)) @ drawn[:2]
        drawn_axes = axes + x + 1j * y
        near = (x * x + y * y).mean() > (_CLEAR * abs(axes)) ** 2
        turned = 0.5 * np.angle(drawn_axes * axes.conjugate())
        turn = axis_deviation(_half_width(turned, 1.0 / np.abs(drawn_axes) if near else None) / _NORMAL)
    return float(sigma[0]), sigma[1:3], turn


def axis_deviation(turn: float) -> float:
    """Return the standard deviation of an axis [rad]: `turn`, or that of an unknown axis if its 95 % region is wider.

    For such a region is of two axes at right angles, and has to hold both.
    """
    return turn if turn < LEVEL * 0.5 * math.pi / _NORMAL else UNKNOWN_ANGLE


def _half_width(errors: FloatArray, weight: FloatArray | None = None) -> float:
    """Return within what of 0 drawn errors (K,), each with a weight (K,), lie with that probability."""
    off = np.abs(errors)
    if weight is None:
        return float(np.quantile(off, LEVEL))
    return float(np.quantile(off, LEVEL, weights=weight, method="inverted_cdf"))


@cache
def _errors() -> FloatArray:
    """Return draws (4, 8000) of two normal and of two uniform errors, each of variance 1."""
    random = np.random.default_rng(0)
    uniform = math.sqrt(3.0) * random.uniform(-1.0, 1.0, (2, 8000))
    return np.vstack([random.standard_normal((2, 8000)), uniform])


def sample_deviations(vertices: FloatArray, drawn: FloatArray) -> MomentDeviations:
    """Return the deviations of a polygon's area, centroid and orientation from a sample of what it may be.

    Parameters
    ----------
    vertices
        The estimate (N, 2) [mm], counter-clockwise.
    drawn
        Polygons (K, N, 2) [mm], each as likely as the others.
    """
    at, among = _of_moments(vertices), _of_moments(drawn)
    off = among - at
    off[:, 3] = np.remainder(off[:, 3] + 0.5 * math.pi, math.pi) - 0.5 * math.pi
    area, x, y, turn = np.quantile(np.abs(off), LEVEL, axis=0) / _NORMAL
    return float(area), np.array([x, y]), axis_deviation(float(turn))


def _of_moments(v: FloatArray) -> FloatArray:
    """Return area, centroid and orientation of polygons (..., N, 2) that have an area: (..., 4)."""
    origin = v.mean(axis=-2, keepdims=True)
    area, first, _ = _sums(v - origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        centroid = origin[..., 0, :] + first / np.asarray(area)[..., None]
        second = _sums(v - centroid[..., None, :])[2]
    turn = 0.5 * np.arctan2(2.0 * second[..., 2], second[..., 0] - second[..., 1])
    return np.stack([area, centroid[..., 0], centroid[..., 1], turn], axis=-1)


def _sums(v: npt.NDArray[Any]) -> tuple[Any, Any, Any]:
    """Return area (...,), first moments (..., 2) and second moments xx, yy, xy (..., 3) about the origin.

    Of polygons (..., N, 2), real or complex.
    """
    w = np.concatenate([v[..., 1:, :], v[..., :1, :]], axis=-2)
    cross = v[..., :1] * w[..., 1:] - w[..., :1] * v[..., 1:]  # (..., N, 1)
    squares, both = v * v + w * w, v + w
    mixed = both[..., :1] * both[..., 1:] + v[..., :1] * v[..., 1:] + w[..., :1] * w[..., 1:]
    terms = np.concatenate([both / 6.0, (squares + v * w) / 12.0, mixed / 24.0], axis=-1) * cross
    sums = terms.sum(axis=-2)
    return cross.sum(axis=(-2, -1)) / 2.0, sums[..., :2], sums[..., 2:]


def _slopes(v: FloatArray) -> FloatArray:
    """Return the slopes of area, the two first and the three second moments of `_sums` (6, 2 N).

    By the complex step: the imaginary part of a polynomial after a tiny imaginary step is its slope, to rounding.
    """
    stepped = v + 1j * _STEP * np.eye(v.size).reshape(v.size, *v.shape)
    return np.asarray(np.column_stack(_sums(stepped)).imag.T / _STEP)

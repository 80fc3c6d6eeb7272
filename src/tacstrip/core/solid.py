"""How deep points of a skin lie in objects, how far the skin yields to them there, and how far off they are.

Objects of one kind are frames (M, 15): their axes, a row each, where they are, and three numbers of their shape: the
radius of a sphere or cylinder, a box's sides, sine and cosine of half an edge's or cone's angle. Points and normals
(3, M, K) have their components first; (3, 1, K) are those of all objects.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at, exported

KINDS = ("plane", "sphere", "cylinder", "edge", "box", "cone")
_UNDER = 0.05  # mm: depth that a point counts with which the object reaches under
_NOT_MET = -1e6  # mm that the skin yields to what it does not meet
_PARALLEL = 1e-9  # cosine of a normal and a face's, below which they never meet


def solid_touch(
    kind: str, frames: FloatArray, points: FloatArray, normals: FloatArray | None, thickness_mm: float
) -> FloatArray:
    """Return how deep points lie in objects (M, K) [mm]; with normals, a little where it reaches under them."""
    return _touch(kind, frames, points, normals, thickness_mm, None)


def solid_yields(
    kind: str, frames: FloatArray, points: FloatArray, normals: FloatArray, thickness_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Return the same, and how far the skin yields along its normals (M, K) [mm]: the depth where it is not touched."""
    yields = np.empty((len(frames), points.shape[2]))
    return _touch(kind, frames, points, normals, thickness_mm, yields), yields


def _touch(
    kind: str, frames: FloatArray, points: FloatArray, normals: FloatArray | None, thickness_mm: float,
    yields: FloatArray | None,
) -> FloatArray:  # fmt: skip
    touch = np.empty((len(frames), points.shape[2]))
    core = exported("solid_touch")
    if core is None:
        for i, frame in enumerate(frames):
            p, n = (v if v is None or v.shape[1] == 1 else v[:, i : i + 1] for v in (points, normals))
            assert p is not None
            touch[i], found = plain_touch(kind, frame, p[:, 0], None if n is None else n[:, 0], thickness_mm)
            if yields is not None:
                yields[i] = found
        return touch
    own, p, n = (None if v is None else np.ascontiguousarray(v) for v in (frames, points, normals))
    assert own is not None
    assert p is not None
    core(
        KINDS.index(kind), at(own), len(own), at(p), None if n is None else at(n), p.shape[1] > 1, p.shape[2],
        thickness_mm, at(touch), None if yields is None else at(yields),
    )  # fmt: skip
    return touch


def solid_gap(
    kind: str, frame: FloatArray, points: FloatArray, normals: FloatArray, steepest: float
) -> FloatArray:
    """Return how far one object (15,) must be moved on to touch points (3, K) [mm].

    inf where it never does, or the cosine between the skin's normal and its way out is not above `steepest`.
    """
    core = exported("solid_gap")
    if core is None:
        return plain_gap(kind, frame, points, normals, steepest)
    gap = np.empty(points.shape[1])
    own, p, n = (np.ascontiguousarray(v) for v in (frame, points, normals))
    core(KINDS.index(kind), at(own), at(p), at(n), len(gap), steepest, at(gap))
    return gap


def plain_touch(
    kind: str, frame: FloatArray, points: FloatArray, normals: FloatArray | None, thickness_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Do as `solid_yields` of one object (15,) and points (3, K), in NumPy; without normals as `solid_touch`."""
    axes, q = _own_frame(frame, points)
    depth = _depth(kind, frame[12:], q)
    if normals is None:
        return depth, depth
    yields = _yields(kind, frame[12:], q, axes @ normals, thickness_mm)
    beside = (depth <= 0.0) & (yields > 0.0) & (kind != "plane")
    depth = np.where(beside, np.minimum(yields, _UNDER), depth)
    return depth, np.where(depth > 0.0, yields, depth)


def plain_gap(
    kind: str, frame: FloatArray, points: FloatArray, normals: FloatArray, steepest: float
) -> FloatArray:
    """Do as `solid_gap`, in NumPy."""
    (axes, (x, y, z)), size = _own_frame(frame, points), frame[12:]
    if kind == "plane":
        lead = np.zeros_like(z)
    elif kind == "edge":
        lead = size[1] / size[0] * np.abs(y)
    elif kind == "cone":
        lead = size[1] / size[0] * np.hypot(x, y)
    elif kind == "box":
        lead = np.where((np.abs(x) <= 0.5 * size[0]) & (np.abs(y) <= 0.5 * size[1]), 0.0, np.inf)
    else:
        left = size[0] ** 2 - y**2 - (x**2 if kind == "sphere" else 0.0)
        lead = np.where(left >= 0.0, size[0] - np.sqrt(np.maximum(left, 0.0)), np.inf)
    return np.where(axes[2] @ normals > steepest, lead - z, np.inf)


def _own_frame(frame: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    axes = frame[:9].reshape(3, 3)
    return axes, np.asarray(axes @ (points - frame[9:12, None]))


def _depth(kind: str, size: FloatArray, q: FloatArray) -> FloatArray:
    x, y, z = q
    if kind == "plane":
        return np.asarray(z)
    if kind == "edge":
        return np.asarray(size[0] * z - size[1] * np.abs(y))
    if kind == "cone":
        return np.asarray(size[0] * z - size[1] * np.hypot(x, y))
    if kind == "box":
        beside = np.minimum(0.5 * size[0] - np.abs(x), 0.5 * size[1] - np.abs(y))
        return np.asarray(np.minimum(beside, np.minimum(z, size[2] - z)))
    square = y**2 + (z - size[0]) ** 2 + (x**2 if kind == "sphere" else 0.0)
    return np.asarray(size[0] - np.sqrt(square))


def _yields(kind: str, size: FloatArray, q: FloatArray, n: FloatArray, thickness_mm: float) -> FloatArray:
    """Return how far the column of skin under points (3, K) lies in the object; `_NOT_MET` where it does not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind in ("sphere", "cylinder"):
            counted = slice(0 if kind == "sphere" else 1, 3)
            e, n = (q - [[0.0], [0.0], [size[0]]])[counted], n[counted]
            along, square = (e * n).sum(axis=0), (n * n).sum(axis=0)
            beyond = (e * e).sum(axis=0) - size[0] ** 2
            half = np.sqrt(np.maximum(along**2 - square * beyond, 0.0))
            met = (half > 0.0) & (along - half < thickness_mm * square)
            # the further root, without cancellation
            out = np.where(along >= 0.0, (along + half) / square, beyond / (along - half))
            return np.where(met, out, _NOT_MET)
        if kind == "cone":
            return _cone_yields(size, q, n, thickness_mm)
        faces, offsets = _half_spaces(kind, size)
        slack, steep = faces @ q + offsets[:, None], faces @ n
        cut = slack / steep
    out = np.where(steep > _PARALLEL, cut, np.inf).min(axis=0)
    beside = np.where((slack < 0.0) & (steep <= _PARALLEL), np.inf, -np.inf)
    into = np.where(steep < -_PARALLEL, cut, beside).max(axis=0)
    return np.where((into <= out) & (into < thickness_mm), out, _NOT_MET)


def _cone_yields(size: FloatArray, q: FloatArray, n: FloatArray, thickness_mm: float) -> FloatArray:
    """Return what of columns is within a cone, by the roots of a d^2 - 2 b d + c on its side of the tip."""
    s, c = size[0] ** 2, size[1] ** 2
    a, b, c = (s * u[2] * v[2] - c * (u[0] * v[0] + u[1] * v[1]) for u, v in ((n, n), (q, n), (q, q)))
    root = np.sqrt(b * b - a * c)  # NaN: not met
    low, high = (b - root) / a, (b + root) / a  # low <= high where a > 0
    flat = np.where((q[2] - b / a * n[2] > 0.0) & (high < thickness_mm), low, _NOT_MET)
    steep = np.where(n[2] > 0.0, low, np.where(high < thickness_mm, np.inf, _NOT_MET))
    found = np.where(a < 0.0, flat, steep)
    return np.where(np.isfinite(root) & (np.abs(a) >= _PARALLEL), found, _NOT_MET)


def _half_spaces(kind: str, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what a plane, edge or box is made of: offset + normal . point >= 0 within."""
    if kind == "plane":
        return np.array([[0.0, 0.0, 1.0]]), np.zeros(1)
    if kind == "edge":
        return np.array([[0.0, size[1], size[0]], [0.0, -size[1], size[0]]]), np.zeros(2)
    half = np.array([0.5 * size[0], 0.5 * size[0], 0.5 * size[1], 0.5 * size[1], 0.0, size[2]])
    return np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], half


def patch_sums(
    touch: FloatArray,
    yields: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    across: FloatArray,
    up: FloatArray,
) -> FloatArray:
    """Sum over a patch what a grid of the skin says of it.

    Parameters
    ----------
    touch, yields
        As of `solid_yields` (A, U). Along `up` the depth is linear between samples: edges are cut where they are. Where
        the skin yields by more than its place is deep, the object ends beside it, with a step.
    points, normals
        Of the skin (A, U, 3).
    across, up
        Sizes of the grid's cells (A,) and (U - 1,), whose product is an area.

    Returns
    -------
    FloatArray
        Area; it times place, and normal; depth times -normal, and the moment of that about the origin (13,).
    """
    at_points, out = (np.ascontiguousarray(v.transpose(2, 0, 1)) for v in (points, normals))
    core = exported("patch_sums")
    if core is None:
        return plain_patch_sums(touch, yields, at_points, out, across, up)
    depth, deep, aside, along = (np.ascontiguousarray(v) for v in (touch, yields, across, up))
    sums = np.empty(13)
    core(at(depth), at(deep), at(at_points), at(out), *touch.shape, at(aside), at(along), at(sums))
    return sums


def plain_patch_sums(
    touch: FloatArray,
    yields: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    across: FloatArray,
    up: FloatArray,
) -> FloatArray:
    """Do as `patch_sums` of components first (3, A, U), in NumPy."""
    a, b = touch[:, :-1], touch[:, 1:]
    high, both = np.maximum(a, b), (a > 0.0) & (b > 0.0)
    cut = (high > 0.0) & ~both
    share = np.where(cut, high / np.where(cut, np.abs(a - b), 1.0), both)
    positive = np.maximum(yields, 0.0)
    most = np.maximum(positive[:, :-1], positive[:, 1:])
    edge = np.where(both, np.minimum(positive[:, :-1], positive[:, 1:]), most - np.minimum(high, most))
    area = share * across[:, None] * up
    weight = np.where(share > 0.0, 0.5 * (most + edge), 0.0) * area
    p, n = ((0.5 * (v[..., :-1] + v[..., 1:])).reshape(3, -1) for v in (points, normals))
    area, weight = area.ravel(), weight.ravel()
    moment = -np.cross(p.T, n.T).T @ weight
    return np.concatenate([[area.sum()], p @ area, n @ area, -n @ weight, moment])

"""Outlines as a covariance scatters them, and the area that their edges sweep: whether a shape is known at all."""

from __future__ import annotations

import ctypes
import math
from functools import cache

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import SIZE, at, exported
from tacstrip.geometry.moments import area

DRAWS, NEARLY_ALL = 64, 0.95
_SINGULAR = 1e-12  # of a variance: what is left of it once others are known, which rounding may leave


def swept_areas(vertices: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draw outlines near a polygon, always by the same normal numbers.

    Parameters
    ----------
    vertices, covariance
        Of the polygon (V, 2) [mm], and finite, of `vertices.ravel()` (2 V, 2 V) [mm^2].

    Returns
    -------
    off
        By how much the vertices move (K, V, 2) [mm].
    areas
        The area that edges sweep at most (K,) [mm^2].
    """
    normal, count = _normal(vertices.size), len(vertices)
    core = exported("swept_areas")
    if core is None:
        return plain_swept_areas(vertices, covariance)
    off, areas = np.empty((DRAWS, count, 2)), np.empty(DRAWS)
    own, theirs = np.ascontiguousarray(vertices), np.ascontiguousarray(covariance)
    workspace = np.empty(vertices.size**2 + 2 * count + 1)
    core(at(own), at(theirs), count, at(normal), DRAWS, at(off), at(areas), at(workspace))
    return off, areas


def plain_swept_areas(vertices: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Do as `swept_areas`, in NumPy."""
    root = np.zeros_like(covariance)
    for j in range(len(root)):
        root[j:, j] = covariance[j:, j] - root[j:, :j] @ root[j, :j]
        own = root[j, j]
        root[j:, j] *= 1.0 / np.sqrt(own) if own > _SINGULAR * covariance[j, j] else 0.0
    off = (_normal(vertices.size) @ root.T).reshape(DRAWS, -1, 2)
    after = np.arange(1, len(vertices) + 1) % len(vertices)
    edge = np.hypot(*(vertices[after] - vertices).T)
    step = np.hypot(off[..., 0], off[..., 1])
    longer, both = np.maximum(step, step[:, after]), step + step[:, after]
    return off, np.asarray((longer * (edge + both)).sum(axis=1))


def swept_share(vertices: FloatArray, covariance: FloatArray) -> float:
    """Return the share of its area that nearly all outlines sweep; arguments as of `swept_areas`.

    inf without an area. Where the core fits runs, it says this of their polygons too.
    """
    own = area(vertices)
    most = np.sort(swept_areas(vertices, covariance)[1])[int(NEARLY_ALL * DRAWS)]
    return float(most) / own if own > 0.0 else math.inf


@cache
def draws_by_size() -> tuple[ctypes.Array[ctypes.c_void_p], tuple[FloatArray, ...]]:
    """Return where the draws for so many coordinates lie (SIZE + 3,), null where no polygon has so many; and these."""
    sizes = range(4, SIZE + 3, 2)
    drawn = tuple(_normal(size) for size in sizes)
    addresses = (ctypes.c_void_p * (SIZE + 3))()
    for size, one in zip(sizes, drawn, strict=True):
        addresses[size] = at(one)
    return addresses, drawn


@cache
def _normal(size: int) -> FloatArray:
    """Return normal draws (K, size), the same each time."""
    return np.random.default_rng(0).normal(size=(DRAWS, size))

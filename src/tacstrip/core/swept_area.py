"""Outlines as a covariance scatters them, and the area that their edges sweep: whether a shape is known at all."""

from __future__ import annotations

from functools import cache

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at, exported

DRAWS = 64
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


@cache
def _normal(size: int) -> FloatArray:
    """Return normal draws (K, size), the same each time."""
    return np.random.default_rng(0).normal(size=(DRAWS, size))

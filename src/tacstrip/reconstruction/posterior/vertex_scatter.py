"""The covariance of a polygon's vertices where slopes at the estimate do not tell how far off it may be.

With one signature a weak corner may as well lie far along its edge, or another edge may lean another way: outlines of
as many vertices explain the readings in places that no step from the estimate reaches. Their scatter about it counts.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.posterior.draws import Draws

_SLOPES = (
    60.0  # so many draws are slopes worth: what some hundred that follow on each other tell is not exact
)


def vertex_scatter(outline: Outline, covariance: FloatArray, drawn: Draws) -> FloatArray:
    """Return mean squares (2 V, 2 V) [mm^2] of the draws with the outline's vertices about it, averaged with slopes.

    Parameters
    ----------
    outline
        The estimate: how many vertices each chain has, and which ends are upright.
    covariance
        By slopes, of `outline.vertices.ravel()` (2 V, 2 V) [mm^2].
    drawn
        Outlines that explain the readings: the more of them have these vertices, the more they count.
    """
    if not np.isfinite(covariance).all():
        return covariance
    problem, indices, drawn_of = drawn.problem, outline.indices, drawn.samples.outlines
    x, y, count = (drawn_of[name] for name in ("x", "y", "count"))
    each, last = np.arange(len(count)), count - 1
    alike = drawn.weight[: len(count)] > 0.0
    for chain, index in enumerate(indices):
        beyond = (np.arange(y.shape[2]) < count[:, chain, None]) & ((y[:, chain] < 0.0) | (y[:, chain] > 1.0))
        alike &= (count[:, chain] == len(index)) & ~beyond.any(axis=1)
    heights = y[each[:, None], (0, 1), 0], y[each[:, None], (0, 1), last]
    for (lower, upper), end in zip((h.T for h in heights), (0, -1), strict=True):
        alike &= (lower == upper) == (indices[0][end] == indices[1][end])
    places = np.empty((int(alike.sum()), len(outline.vertices), 2))
    for chain, index in enumerate(indices):
        places[:, index, 0] = x[alike, chain, : len(index)] * problem.width_mm + problem.origin_mm
        places[:, index, 1] = y[alike, chain, : len(index)] * problem.length_mm
    off = (places - outline.vertices).reshape(len(places), outline.vertices.size)
    return np.asarray((_SLOPES * covariance + off.T @ off) / (_SLOPES + len(off)))

"""The covariance of a polygon's vertices where slopes do not tell how far off they may be.

With one signature a weak corner may as well lie far along its edge, or another edge may lean another way: outlines of
as many vertices explain the readings in places that slopes at the estimate do not reach. How they scatter about it
counts where it is clearly more.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.posterior.draws import Draws

# Times the squares that slopes say: less is what some hundred draws that follow on each other miss.
_FURTHER = 3.0
_FEW = 20.0  # draws that count by half
_SINGULAR = 1e-10  # of the greatest eigenvalue: vertices of an upright end have one x


def vertex_scatter(outline: Outline, covariance: FloatArray, drawn: Draws) -> FloatArray:
    """Return the covariance (2 V, 2 V) [mm^2] by slopes, larger in directions in which draws lie further off.

    Parameters
    ----------
    outline
        The estimate: how many vertices each chain has, and which ends are upright.
    covariance
        By slopes, of `outline.vertices.ravel()` (2 V, 2 V) [mm^2].
    drawn
        Outlines that explain the readings: those with these vertices count.
    """
    scale = np.sqrt(covariance.diagonal())
    if not np.isfinite(covariance).all() or scale.min() == 0.0:
        return covariance
    off = (_alike(outline, drawn) - outline.vertices.ravel()) / scale
    value, vector = np.linalg.eigh(covariance / np.outer(scale, scale))
    known = value > _SINGULAR * value[-1]
    root, vector = np.sqrt(value[known]), vector[:, known]
    off = off @ vector / root  # of variance 1 by slopes
    squares, along = np.linalg.eigh(off.T @ off / max(len(off), 1))
    more = np.where(squares > _FURTHER, squares - 1.0, 0.0) * len(off) / (len(off) + _FEW)
    way = scale[:, None] * ((vector * root) @ along) * np.sqrt(more)
    return np.asarray(covariance + way @ way.T)


def _alike(outline: Outline, drawn: Draws) -> FloatArray:
    """Return the vertices [mm] of the draws that have as many on each chain as an outline, and such ends (K, 2 V)."""
    problem, indices, outlines = drawn.problem, outline.indices, drawn.samples.outlines
    x, y, count = (outlines[name] for name in ("x", "y", "count"))
    alike = drawn.weight[: len(count)] > 0.0
    for chain, index in enumerate(indices):
        beyond = (np.arange(y.shape[2]) < count[:, chain, None]) & ((y[:, chain] < 0.0) | (y[:, chain] > 1.0))
        alike &= (count[:, chain] == len(index)) & ~beyond.any(axis=1)
    last = y[np.arange(len(count))[:, None], (0, 1), count - 1]
    for heights, end in ((y[:, :, 0], 0), (last, -1)):
        alike &= (heights[:, 0] == heights[:, 1]) == (indices[0][end] == indices[1][end])
    places = np.empty((int(alike.sum()), len(outline.vertices), 2))
    for chain, index in enumerate(indices):
        places[:, index, 0] = x[alike, chain, : len(index)] * problem.width_mm + problem.origin_mm
        places[:, index, 1] = y[alike, chain, : len(index)] * problem.length_mm
    return places.reshape(len(places), outline.vertices.size)

"""A fitted polygon in millimetres: how sure it is, and that its chains do not cross."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported
from tacstrip.core.equations import information
from tacstrip.core.fit import END_ENTRIES, PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import covariance_with_x_priors
from tacstrip.sensor.spec import Sensor


def fitted_covariance(fit: PolygonFit, outline: Outline, problem: FitProblem, sensor: Sensor) -> FloatArray:
    """Return the covariance of the outline's vertices (2 V, 2 V) [mm^2], see `covariance_with_x_priors`."""
    core = exported("vertex_covariance")
    if core is not None:
        record, covariance, x_mm = fit.record, np.empty((2 * fit.n_vertices, 2 * fit.n_vertices)), sensor.x_mm
        of_mm = (problem.origin_mm, problem.width_mm, problem.length_mm)
        if core(problem.compiled, at(record), *of_mm, at(x_mm), len(x_mm), at(covariance)):
            return covariance
    return covariance_with_x_priors(outline, sensor, information_root(fit, problem))


def information_root(fit: PolygonFit, problem: FitProblem) -> FloatArray:
    """Return R (2 V, 2 V) with R'R = J'J, J the slopes of all readings over sigma by `vertices.ravel()` [mm]."""
    flat = _entries(fit)
    second = np.zeros(len(flat), dtype=bool)
    for end, place in ((1, 2 * (fit.chain == 0).sum() + 4), (0, len(flat) - 2)):
        if fit.vertical_ends[end]:
            second[place] = True  # the upper vertex of a vertical edge has the lower one's x
    scale = np.tile([problem.width_mm, problem.length_mm], len(flat) // 2)
    told = np.outer(~second, ~second)
    value, vector = np.linalg.eigh(np.where(told, information(fit, problem)[np.ix_(flat, flat)], 0.0))
    return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T / scale)


def _entries(fit: PolygonFit) -> IntArray:
    """Return the entries of theta that are the outline's `vertices.ravel()` (2 V,)."""
    lower, upper = (END_ENTRIES + 2 * np.flatnonzero(fit.chain == side) for side in (0, 1))
    x = np.array(
        [0, *lower, 3, *[3] * int(fit.vertical_ends[1]), *upper[::-1], *[0] * int(fit.vertical_ends[0])]
    )
    y = x + 1
    if fit.vertical_ends[1]:
        y[len(lower) + 2] = 5
    if fit.vertical_ends[0]:
        y[-1] = 2
    return np.stack([x, y], axis=1).ravel()


def uncrossed(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both chains (M, 2), (N, 2) with no part of the lower one above the upper one: noise can cross them."""
    lower, upper = lower.copy(), upper.copy()
    lower[1:-1, 1] = np.minimum(lower[1:-1, 1], np.interp(lower[1:-1, 0], *upper.T))
    upper[1:-1, 1] = np.maximum(upper[1:-1, 1], np.interp(upper[1:-1, 0], *lower.T))
    return lower, upper


def max_height(lower: FloatArray, upper: FloatArray) -> float:
    """Return the greatest distance in y between both chains."""
    x = np.concatenate([lower[:, 0], upper[:, 0]])
    return float((np.interp(x, *upper.T) - np.interp(x, *lower.T)).max())

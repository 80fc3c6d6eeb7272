"""A fitted polygon in millimetres: how sure it is, and that its chains do not cross."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.equations import information
from tacstrip.core.fit import ENDS, Fit
from tacstrip.core.signal import Signal


def information_root(fit: Fit, signal: Signal) -> FloatArray:
    """Return R (2 V, 2 V) with R'R = J'J, J the slopes of all readings over sigma by `vertices.ravel()` [mm]."""
    matrix = information(fit, signal)
    interior = [ENDS + 2 * np.flatnonzero(fit.chain == side) for side in (0, 1)]
    x_of_upper_end = -1  # it has the lower one's x
    places = [(0, 1), *((i, i + 1) for i in interior[0]), (3, 4)]
    places += [(x_of_upper_end, 5)] * int(fit.blunt[1])
    places += [(i, i + 1) for i in interior[1][::-1]]
    places += [(x_of_upper_end, 2)] * int(fit.blunt[0])
    flat = np.array(places).ravel()
    scale = np.tile([signal.width_mm, signal.length_mm], len(places))
    told = np.outer(flat >= 0, flat >= 0)
    value, vector = np.linalg.eigh(np.where(told, matrix[np.ix_(flat, flat)], 0.0))
    return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T / scale)


def untangled(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both chains (M, 2), (N, 2) with no part of the lower one above the upper one: noise can cross them."""
    lower, upper = lower.copy(), upper.copy()
    lower[1:-1, 1] = np.minimum(lower[1:-1, 1], np.interp(lower[1:-1, 0], *upper.T))
    upper[1:-1, 1] = np.maximum(upper[1:-1, 1], np.interp(upper[1:-1, 0], *lower.T))
    return lower, upper


def thickness(lower: FloatArray, upper: FloatArray) -> float:
    """Return the greatest distance in y between both chains."""
    x = np.union1d(lower[:, 0], upper[:, 0])
    return float((np.interp(x, *upper.T) - np.interp(x, *lower.T)).max())

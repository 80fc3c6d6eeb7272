"""Readings that no contact makes: a stuck channel, a dead strip. They are found, named and left out.

Before a fit a reading is suspected that neither the strips on its left, nor those on its right, nor both together
predict; whether it stays out is for the fit to say. After it one is left out that lies alone far from the polygon.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import at, exported

_FAR = 6.0  # sigmas from what the neighbours predict
_FAR_AT_ENDS = 14.0  # from what the line through two strips on one side predicts, itself uncertain by 2.2
_FAR_FROM_FIT = 5.0  # sigmas from the polygon
_MOST = 0.1  # of the strips: more are not outliers but a wrong model
_ALLOWED = 4  # suspects on few strips: a fault, and strips beside a corner, which the fit explains


def spikes(k: FloatArray, sigma: float) -> BoolArray:
    """Find the readings (n,) that stand out from their neighbours, the worst first, each then left out.

    Parameters
    ----------
    k
        One signature over neighbouring strips (n,); NaN is left out.
    sigma
        Standard deviation of a reading.
    """
    core = exported("spikes")
    if core is None:
        return plain_spikes(k, sigma)
    k, n = np.ascontiguousarray(k), len(k)
    found, workspace = np.empty(n, dtype=np.bool_), np.empty(3 * n)
    core(at(k), n, sigma, at(found), at(workspace))
    return found


def plain_spikes(k: FloatArray, sigma: float) -> BoolArray:
    """Do as `spikes`, in NumPy."""
    out = ~np.isfinite(k)
    left = np.flatnonzero(~out)
    for _ in range(max(int(_MOST * len(k)), _ALLOWED) + 1):
        if len(left) < 5:
            break
        off = _prediction_errors(left.astype(float), k[left])
        worst = int(off.argmax())
        if off[worst] <= sigma:
            return out
        out[left[worst]] = True
        left = np.delete(left, worst)
    # So many are no spikes: the problem itself is rough, or sigma far too small.
    return out if len(left) < 5 else ~np.isfinite(k)


def isolated_outliers(residuals: FloatArray) -> BoolArray:
    """Find the readings (S, n) that lie alone, by their residuals over sigma; none where they are many."""
    core = exported("isolated_outliers")
    if core is None:
        return plain_isolated_outliers(residuals)
    residuals = np.ascontiguousarray(residuals)
    out = np.empty(residuals.shape, dtype=np.bool_)
    core(at(residuals), *residuals.shape, at(out))
    return out


def plain_isolated_outliers(residuals: FloatArray) -> BoolArray:
    """Do as `isolated_outliers`, in NumPy."""
    far = np.abs(residuals)
    beside = np.zeros_like(far)
    beside[:, 1:] = far[:, :-1]
    beside[:, :-1] = np.maximum(beside[:, :-1], far[:, 1:])
    out = (far > _FAR_FROM_FIT) & (beside < 0.5 * far)
    return out if out.sum() <= max(_MOST * far.shape[1], 1.0) else np.zeros_like(out)


def _prediction_errors(x: FloatArray, v: FloatArray) -> FloatArray:
    """Return how far each reading is from the nearest of what its neighbours predict, over what is far (n,)."""
    off = np.full(len(v), np.inf)
    apart = np.diff(x)  # of strips that are left, above 1 where some are not
    bend = np.abs(np.diff(np.diff(v) / apart))
    off[1:-1] = bend / (1.0 / apart[1:] + 1.0 / apart[:-1])
    off[:-2] = np.minimum(off[:-2], bend * apart[:-1])  # from the line through the two strips on the right
    off[2:] = np.minimum(off[2:], bend * apart[1:])
    off[1:-1] /= _FAR
    off[[0, -1]] /= _FAR_AT_ENDS
    return off

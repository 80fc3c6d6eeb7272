"""Creep: rubber under a held contact yields with the logarithm of time, and the contact seems to grow.

A reading of a held contact is k = k_1 + c ln((t + 1 s) / 2 s), t from the first touch on and k_1 the reading after one
second. Only a change that follows the logarithm better than time itself, on most of the channels, is creep: a contact
that moves is none.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray

_LEAST_S = 5.0  # a shorter press shows none
# Means over even steps of the logarithm, which correlated noise hardly correlates.
_BLOCKS, _LEAST_BLOCKS = 12, 8
_SURE = 5.0  # standard deviations of a channel's rate
_MOST = 0.05  # of Vref, over the press: more is motion


def log_age(age_s: FloatArray) -> FloatArray:
    """Return the factor of the rate at an age of the press [s]: 0 after one second."""
    return np.log((np.maximum(age_s, 0.0) + 1.0) / 2.0)


def creep_rate(age_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return by how much each channel's reading grows per unit of `log_age` (channels,); 0 where it does not creep.

    Parameters
    ----------
    age_s
        Time since the first touch [s], rising (scans,).
    values
        Readings of a held contact (scans, channels), NaN where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> age = np.arange(0.0, 60.0, 0.1)
    >>> noise = np.random.default_rng(0).normal(0.0, 0.0005, (600, 2))
    >>> creep_rate(age, 0.4 + 0.003 * log_age(age)[:, None] + noise).round(4).tolist()
    [0.003, 0.003]
    """
    channels = values.shape[1]
    if not len(age_s) or age_s[-1] < _LEAST_S:
        return np.zeros(channels)
    x = log_age(age_s)
    block = np.minimum(((x - x[0]) / (x[-1] - x[0]) * _BLOCKS).astype(int), _BLOCKS - 1)
    known = np.isfinite(values).all(axis=1)
    used = np.unique(block[known])
    if len(used) < _LEAST_BLOCKS:
        return np.zeros(channels)
    rows = [known & (block == b) for b in used]
    mean = np.array([values[r].mean(axis=0) for r in rows])
    rate, error, left = _line(np.array([x[r].mean() for r in rows]), mean)
    linear = _line(np.array([age_s[r].mean() for r in rows]), mean)[2]
    creeps = (np.abs(rate) > _SURE * error) & (left < linear) & (np.abs(rate) * (x[-1] - x[0]) < _MOST)
    return np.where(creeps, rate, 0.0) if 2 * creeps.sum() >= channels else np.zeros(channels)


def _line(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return slopes of y (points, channels) over x, their standard deviations, and the squares that are left."""
    x = x - x.mean()
    slope = x @ y / (x @ x)
    left = ((y - y.mean(axis=0) - x[:, None] * slope) ** 2).sum(axis=0)
    return slope, np.sqrt(left / (len(x) - 2) / (x @ x)), left

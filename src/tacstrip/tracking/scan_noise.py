"""The noise that scans show by themselves, whatever shape made them: how far readings are off those around in time.

Third differences of a channel are free of a motion that is smooth over four scans (Gasser, Sroka and Jennen-Steinmetz,
Biometrika 73, 1986, use second ones). An object that jumps from scan to scan makes them larger, errors that follow each
other smaller.
"""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.robust import robust_sigma

_SQUARES = 20.0  # sum of the squared coefficients of a third difference, 1, -3, 3, -1
_PAIRS = 2.31  # times the variance of their mean square, over that of independent ones
# Deviations beyond which a difference is a corner that passes a strip; the variance that normal ones have within these.
_WITHIN, _LEFT = 2.5, 0.911
_ROUNDS = 3
_FEWEST = 60  # differences that tell the noise
_ABSORBED = 1.3  # times what fits leave over: errors that strips share, poses take up in part
SURE, _CORRELATED = 2.0, 3.0  # deviations of it, and of a correlation


def noise_between_scans(k: FloatArray) -> tuple[float, float]:
    """Return sigma of readings k (T, S, n) in the order of time [Vref], and how uncertain its square is, relatively.

    Infinity both where the scans are too few.
    """
    d = _third_differences(k)
    d = d[np.isfinite(d)]
    if len(d) < _FEWEST:
        return math.inf, math.inf
    sigma, kept = float(robust_sigma(d)), d
    for _ in range(_ROUNDS):
        kept = d[np.abs(d) <= _WITHIN * sigma]
        sigma = math.sqrt(float((kept**2).mean()) / _LEFT)
    return sigma, math.sqrt(2.0 * _PAIRS / len(kept))


def correlation_of_strips(k: FloatArray, sigma: float) -> float:
    """Return how errors of neighbouring strips correlate, of readings k (T, S, n) in the order of time.

    0 where that is not sure, or where scans differ by more than noise of about sigma makes them: the object moves.
    """
    shown, unsure = noise_between_scans(k)
    if not shown < _ABSORBED * sigma * math.sqrt(1.0 + SURE * unsure):
        return 0.0
    d = _third_differences(k)
    a, b = (np.clip(part, -_WITHIN * shown, _WITHIN * shown) for part in (d[..., :-1], d[..., 1:]))
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
    r = float((a * b).sum() / max(math.sqrt(float((a * a).sum() * (b * b).sum())), 1e-300))
    return r if r > _CORRELATED * math.sqrt(_PAIRS / max(len(a), 1)) else 0.0


def _third_differences(k: FloatArray) -> FloatArray:
    """Return those over time, as uncertain as a reading."""
    return np.diff(k, 3, axis=0) / math.sqrt(_SQUARES)

"""Whether a contact moved to and fro."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray

_BACK = 3  # times: twice may be one movement to and fro
_PAUSE = 1  # other places between two visits
_RANGE = 0.3  # over Vref: a contact that sways shows little else than its shape


def median_crossings(values: FloatArray, least: float) -> int:
    """Count how often values cross their median, going beyond it by `least` on both sides."""
    deviation = values - np.median(values)
    return int(np.count_nonzero(np.diff(np.sign(deviation[np.abs(deviation) > least]))))


def moved_to_and_fro(level: FloatArray, sigma: float, least: float = _RANGE) -> bool:
    """Whether a contact moved along the strips, over heights (places,) in order of time, three times, `least` far."""
    low, high = np.percentile(level, [5.0, 95.0])
    return bool(high - low >= least and median_crossings(level, max(0.01, 3.0 * sigma)) >= _BACK)


def passes(rows: IntArray) -> int:
    """Return how many times a contact came, from the places (rows,) where it was there."""
    return int(np.count_nonzero(np.diff(rows) > _PAUSE)) + 1 if len(rows) else 0

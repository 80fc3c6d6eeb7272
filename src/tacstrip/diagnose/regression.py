"""Whether a contact moved to and fro, and across."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from tacstrip.arrays import BoolArray, FloatArray, IntArray

_BACK = 3  # times: twice may be one movement to and fro
_PAUSE = 1  # other places between two visits
_RANGE = 0.3  # over Vref: a contact that sways shows little else than its shape
_NEAREST = 5  # places in height
_ELSEWHERE = 1.0  # strips, twice what a contact's middle differs by at one height


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


def moved_across(there: BoolArray, level: FloatArray) -> bool:
    """Whether a contact lay elsewhere across the strips when it came back to the same heights.

    Where it repeats one movement, its shape and its place across are functions of the height, as a fault may be.

    Parameters
    ----------
    there
        Strips in touch (places, strips).
    level
        Heights over Vref (places,).
    """
    order = np.argsort(level, kind="stable")
    ends = there.argmax(axis=1) - there[:, ::-1].argmax(axis=1)
    ordered = ends[order].astype(float)
    return bool(np.std(ordered - uniform_filter1d(ordered, _NEAREST)) > _ELSEWHERE)

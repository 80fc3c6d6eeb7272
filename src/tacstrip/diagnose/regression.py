"""Whether a contact moved to and fro, and whether it did more than one movement."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray

_BACK = 3  # times: twice may be one movement to and fro
_PAUSE = 1  # other places between two visits
_RANGE = 0.3  # over Vref: a contact that sways shows little else than its shape
_MOST = 150  # places that are compared with each other
# Over Vref and deviations; channels at a contact's rim that come and go.
_LIKE, _LIKE_NOISE, _FLICKER = 0.015, 8.0, 4
_NEXT = 4  # places
_COMPARED = 6  # channels: fewer are alike at other places, too
_LATER = 0.04  # of the recording: another time


def most_of(values: FloatArray) -> tuple[float, float]:
    """Return the 5th and the 95th percentile of values (n,), n > 0; some ten times faster than `np.percentile`."""
    last = len(values) - 1
    low, high = np.interp((0.05 * last, 0.95 * last), np.arange(last + 1), np.sort(values))
    return float(low), float(high)


def correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of values (n,) that differ; some ten times faster than `np.corrcoef`."""
    one, other = one - one.mean(), other - other.mean()
    return float(one @ other / np.sqrt((one @ one) * (other @ other)))


def median_crossings(values: FloatArray, least: float) -> int:
    """Count how often values cross their median, going beyond it by `least` on both sides."""
    deviation = values - np.median(values)
    return int(np.count_nonzero(np.diff(np.sign(deviation[np.abs(deviation) > least]))))


def moved_to_and_fro(level: FloatArray, sigma: float, least: float = _RANGE) -> bool:
    """Whether a contact moved along the strips, over heights (places,) in order of time, three times, `least` far."""
    low, high = most_of(level)
    return bool(high - low >= least and median_crossings(level, max(0.01, 3.0 * sigma)) >= _BACK)


def passes(rows: IntArray) -> int:
    """Return how many times a contact came, from the places (rows,) where it was there."""
    return int(np.count_nonzero(np.diff(rows) > _PAUSE)) + 1 if len(rows) else 0


def repeats(values: FloatArray, rows: IntArray, sigma: float) -> bool:
    """Whether a contact does one movement again and again: most places have their like at another time.

    Its shape and its place across are functions of the height then, as a fault may be, however often it comes.

    Parameters
    ----------
    values
        Readings of all channels over Vref (all places, channels), NaN where untouched.
    rows
        The places that are looked at (places,), in order of time.
    sigma
        Standard deviation of a reading.
    """
    step = max(len(rows) // _MOST, 1)
    one = rows[::step]
    read = values[one]
    known = np.isfinite(read)
    both = (known.astype(float) @ known.T).astype(int)
    differ = known.sum(axis=1)[:, None] + known.sum(axis=1)[None] - 2 * both
    alike = (differ <= np.minimum(_FLICKER, both // 4)) & (both >= _COMPARED)
    alike &= np.abs(one[:, None] - one[None]) > len(values) * _LATER
    i, j = np.nonzero(alike)
    apart = np.fmax.reduce(np.abs(read[i] - read[j]), axis=1)
    alike[i, j] = apart < max(_LIKE, _LIKE_NOISE * sigma)
    # What comes next is alike there, too, on the way there or back: other ways only cross.
    on = max(_NEXT // step, 1)
    there, back = alike[:-on, :-on] & alike[on:, on:], alike[:-on, on:] & alike[on:, :-on]
    return bool(there.size) and float((there.any(axis=1) | back.any(axis=1)).mean()) > 0.5

"""Whether numbers can be what a sensor reads: contacts of neighbouring strips that move, k_h above k_l."""

from __future__ import annotations

import itertools

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray

_AT_ONCE = 0.99  # of the strips: both ends of one have a contact, or none has
_SIDE_BY_SIDE = 0.9  # of the scans: touched strips are neighbours
_ABOVE = 0.97  # of the touched strips: k_h is above k_l
_APART = 0.004  # of the largest reading: so far may noise take k_h below k_l
_OFTEN = 0.05  # of the numbers: one that is as often the least or greatest stands for no contact
# Of the largest reading, the noise of open inputs; and how far it is from all others.
_NARROW, _GAP = 0.02, 3.0
_FEW_TOUCHED, _FEW_SCANS = 6, 3
ROUGH = 0.6  # of the distance of any two readings: that of neighbours, at most


def roughness(values: FloatArray) -> float | None:
    """Return how far readings (scans, strips, channels) of neighbours are apart, over that of any two of them.

    None where no sensor can have read them.

    Examples
    --------
    >>> scan, strip = np.ogrid[:20, :5]
    >>> y = np.where(abs(scan / 5 - strip) < 2, 0.2 + 0.02 * scan + 0.01 * strip, np.nan)
    >>> roughness(np.stack([y + 0.1, y], axis=2)), roughness(np.stack([y, y + 0.1], axis=2))
    (..., None)
    """
    idle: BoolArray = _idle(values)
    touched = np.asarray(~idle.all(axis=2))
    if touched.mean() > 1.0 - _OFTEN or len(np.unique(touched, axis=0)) < _FEW_SCANS:
        return None  # without contacts that begin or end, nothing tells the strips
    if touched.sum() < _FEW_TOUCHED or touched.any(axis=1).sum() < _FEW_SCANS:
        return None
    if (idle.any(axis=2) == idle.all(axis=2)).mean() < _AT_ONCE:
        return None
    runs = [int((np.diff(np.concatenate([[0], row])) == 1).sum()) for row in touched.astype(int) if row.any()]
    if np.mean(np.array(runs) == 1) < _SIDE_BY_SIDE:
        return None
    there = np.where(touched[:, :, None], values, np.nan)
    largest = float(np.nanmax(np.abs(there)))
    if there.shape[2] == 2:
        apart = (there[:, :, 0] - there[:, :, 1])[touched]
        if np.mean(apart >= -_APART * largest) < _ABOVE or np.median(apart) <= 0.0:
            return None
    return max(_rough(there[:, :, c]) for c in range(there.shape[2]))


def _rough(values: FloatArray) -> float:
    there = values[np.isfinite(values)]
    every = (
        np.abs(there[:, None] - there[None, :])
        if len(there) < 400
        else np.abs(there - np.roll(there, len(there) // 3))
    )
    spread = float(np.mean(every))
    steps = [np.abs(np.diff(values, axis=axis)) for axis in (0, 1)]
    near = [float(np.nanmean(s)) for s in steps if np.isfinite(s).any()]
    return min(near) / spread if near and spread > 0.0 else np.inf


def _idle(values: FloatArray) -> BoolArray:
    """Return where nothing touches: no number, or what stands apart as the least or greatest one."""
    idle = ~np.isfinite(values)
    there = np.sort(values[~idle])
    if len(there) < 2 or there[0] == there[-1]:
        return idle
    width = _NARROW * max(abs(there[0]), abs(there[-1]))
    ends = [(there[0], there[there > there[0]][0]), (there[-1], there[there < there[-1]][-1])]
    often = [
        (end, near) for end, near in ends if np.mean(values == end) > _OFTEN and (values == end).sum() > 1
    ]
    if far := [end for end, near in often if abs(near - end) > width]:
        return np.asarray(idle | (values == far[0]))
    for (k, step), top in itertools.product(enumerate(np.diff(there), 1), (False, True)):
        noise = there[k:] if top else there[:k]
        apart = step > _GAP * (noise[-1] - noise[0]) and step > width
        if apart and noise[-1] - noise[0] <= width and len(noise) > _OFTEN * values.size:
            return np.asarray(idle | (values >= there[k] if top else values < there[k]))
    return np.asarray(idle | (values == often[0][0])) if often else idle

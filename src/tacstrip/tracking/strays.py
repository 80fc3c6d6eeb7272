"""Readings that stray: no object moves so that one channel reads something else in a single scan."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.outliers import spikes
from tacstrip.core.rigid import RigidScans, fit_poses, linearised, loss
from tacstrip.tracking.rigid.corners import Fit, bad_scans, explained, jiggles

_BLOCK = 100  # scans that are looked at together: of a channel at most a tenth may stray
_GROSS = 2.5  # times what is a spike among neighbouring strips: smaller strays disturb no search, the fit tells them
_FAR = 6.0  # standard deviations from what an outline makes of the scan's other readings
_CAUCHY = 2.0
_MOST = 0.1  # of the scans: where more do not fit, the outline is wrong, or there is no rigid one
_STEPS = 12


def strays_over_time(k: FloatArray, sigma: float) -> BoolArray:
    """Find the readings k (T, S, n) that those of their channel before, after and on both sides do not predict.

    They lie alone: where both signatures of a strip change, or one for three scans, the object moved. None of a channel
    that changes anyhow from scan to scan, as of presses at random.
    """
    found: BoolArray = np.zeros(k.shape, dtype=bool)
    for start in range(0, len(k), _BLOCK):
        part = k[start : start + _BLOCK]
        for s, i in np.argwhere(np.isfinite(part).any(axis=0)):
            found[start : start + _BLOCK, s, i] = spikes(part[:, s, i], _GROSS * sigma)
    found &= np.isfinite(k)
    lasting = np.zeros(k.shape, dtype=bool)
    three = found[:-2] & found[1:-1] & found[2:]
    for shift in range(3):
        lasting[shift : len(k) - 2 + shift] |= three
    if k.shape[1] > 1:
        lasting |= found.all(axis=1, keepdims=True)
    return found & ~lasting


def strays_from_fit(scans: RigidScans, fit: Fit) -> BoolArray:
    """Find the readings (T, S, n) without which a fit's outline explains the scans that it does not explain with them.

    One of a scan, and of few scans.
    """
    found: BoolArray = np.zeros(scans.k.shape, dtype=bool)
    bad = bad_scans(scans, fit)
    if fit.basis is not None or not 0 < len(bad) <= max(_MOST * len(fit.poses), 1.0):
        return found
    few, good = scans.of(bad), np.setdiff1d(np.arange(len(fit.poses)), bad)
    near = np.stack([np.interp(bad, good, p) for p in np.unwrap(fit.poses[good], axis=0).T], axis=1)
    starts = np.concatenate(
        [p[:, None] + jiggles(scans.sensor.pitch_mm) for p in (near, fit.poses[bad])], axis=1
    )
    poses, costs = fit_poses(few, fit.corners, starts, loss(few, cauchy=_CAUCHY), _STEPS)
    best = poses[np.arange(len(bad)), costs.argmin(axis=1)]
    far = np.abs(np.nan_to_num(few.k - linearised(few, fit.corners, best).model)) / scans.sigma
    worst = far.reshape(len(bad), -1).argmax(axis=1)
    out = np.asarray(np.arange(far[0].size) == worst[:, None]).reshape(far.shape)
    left = np.where(out, 0.0, far**2).sum(axis=(1, 2))
    alone = (far > _FAR).sum(axis=(1, 2)) == 1
    found[bad] = out & np.asarray(alone & explained(left, few.readings - 1))[:, None, None]
    return found


def set_aside(k: FloatArray, strays: BoolArray) -> FloatArray:
    """Return readings (T, S, n) without those that stray.

    But where nothing else tells that their strips were touched, neither another signature nor strips on both sides.
    """
    kept = np.where(strays, np.nan, k)
    known: BoolArray = np.asarray(np.isfinite(kept).any(axis=1))
    known[:, 1:-1] |= known[:, :-2] & known[:, 2:]
    return np.where(known[:, None], kept, k)

"""Whether an outline that explains its scans as a rigid one strains over time: a score test.

Free poses, and offsets of channels, take up much of a strain, so that chi square of a rigid outline may be content.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import IntArray
from tacstrip.core.rigid import RigidScans, linearised_blocks
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import UPRIGHT, information, without_poses
from tacstrip.tracking.rigid.offsets import Offsets, with_offsets

_MODES = 3  # growth, stretch and shear; the rotation is the pose's
_SEEN = 1e-6  # of what the readings tell of a mode were all else known: less is none


def strain_share(scans: RigidScans, fit: Fit, offsets: Offsets | None) -> float:
    """Return the share of what a fit leaves of scans in order of time, beyond noise, that such a strain explains."""
    gain = strain_gain(scans, fit, offsets, np.arange(len(scans.k)))
    return gain / max(fit.cost - fit.freedom(scans), 1.0)


def strain_gain(scans: RigidScans, fit: Fit, offsets: Offsets | None, times: IntArray) -> float:
    """Return by how much chi square would fall if the outline strained evenly over time, corners and poses following.

    To first order at the fit. Of a rigid object it is distributed as chi square of three degrees of freedom.

    Parameters
    ----------
    scans, fit
        The readings without offsets, and what was fitted to them.
    offsets
        That were found along, which follow too; None: there are none.
    times
        Of the scans (T,), in any unit.
    """
    own, size, many = scans.channels, fit.corners.size, len(fit.poses)
    found = information(scans, fit.corners, fit.poses)
    cross = np.zeros((size, _MODES))
    if offsets is not None:
        found = with_offsets(scans, fit, found, offsets.deviation)
        found.shape_slope[size:] -= offsets.values.ravel()[own] / offsets.deviation**2
        cross = np.zeros((size + len(own), _MODES))
    around = fit.corners - fit.corners.mean(axis=0)
    modes = np.stack([around.ravel(), (around * [1.0, -1.0]).ravel(), around[:, ::-1].ravel()], axis=1)
    share = (times - times.mean()) / max(float(np.ptp(times)), 1.0)
    by_pose, known, slope = np.zeros((many, 3, _MODES)), np.zeros((_MODES, _MODES)), np.zeros(_MODES)
    for some, part, here in linearised_blocks(scans, fit.corners, fit.poses):
        rows = here.rows.reshape(len(some), -1, 3 + size)[:, own]
        left = (part.k - here.model).reshape(len(some), -1)[:, own] / scans.sigma
        there = np.isfinite(left) & (np.abs(rows[..., 0]) <= UPRIGHT / scans.sensor.length_mm)
        rows *= there[..., None] / scans.sigma
        strained = rows[..., 3:] @ modes * share[some, None, None]
        by_pose[some] = rows[..., :3].transpose(0, 2, 1) @ strained
        cross[:size] += np.einsum("tmc,tmk->ck", rows[..., 3:], strained)
        if offsets is not None:
            cross[size:] += strained.sum(axis=0) / scans.sigma
        known += np.einsum("tmk,tml->kl", strained, strained)
        slope += np.einsum("tm,tmk->k", np.where(there, left, 0.0), strained)
    found = replace(
        found,
        mixed=np.concatenate([found.mixed, by_pose], axis=2),
        shape=np.block([[found.shape, cross], [cross.T, known]]),
        shape_slope=np.concatenate([found.shape_slope, slope]),
    )
    matrix, slope, _, _ = without_poses(found, fit.basis)
    follow = matrix[-_MODES:, :-_MODES] @ np.linalg.pinv(matrix[:-_MODES, :-_MODES], hermitian=True)
    scale = 1.0 / np.sqrt(np.maximum(known.diagonal(), 1e-300))
    rest = (matrix[-_MODES:, -_MODES:] - follow @ matrix[:-_MODES, -_MODES:]) * np.outer(scale, scale)
    asked = (slope[-_MODES:] - follow @ slope[:-_MODES]) * scale
    value, vector = np.linalg.eigh(rest)
    along, seen = asked @ vector, value > _SEEN
    return float((along[seen] ** 2 / value[seen]).sum())

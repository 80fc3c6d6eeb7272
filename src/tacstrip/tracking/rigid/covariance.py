"""How sure an outline's corners and its poses are: the bound that all scans together leave."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, equations, loss, reduced

_NEVER = 1e6  # pitches: what touched strips tell of the ends is left out, for inside the gap it is nothing


def covariances(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of corners (N, 2) about their mean, (2 N, 2 N) [mm^2], and of the poses (T, 3, 3).

    The frame lies where the corners' errors neither move nor turn them as a whole; the poses take that up.
    """
    found = equations(scans, corners, poses, loss(scans, end=_NEVER))
    matrix, _, inverse = reduced(found)
    value, vector = np.linalg.eigh(matrix)
    anywhere = float(np.ptp(corners, axis=0).max()) ** 2  # what the readings do not hold at all
    pinned = vector / np.maximum(value, 1.0 / anywhere) @ vector.T
    rigid = np.zeros((corners.size, 3))
    rigid[::2, 0] = rigid[1::2, 1] = 1.0
    rigid[::2, 2], rigid[1::2, 2] = -corners[:, 1], corners[:, 0]
    as_motion = np.linalg.pinv(rigid)  # (3, 2 N): of a change of the corners
    inner = np.eye(corners.size) - rigid @ as_motion
    turned = np.zeros((len(poses), 3, 3))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1], turned[:, 2, 2] = (
        cos,
        -sin,
        sin,
        cos,
        1.0,
    )
    by_corners = turned @ as_motion - inverse @ found.mixed
    of_poses = inverse + by_corners @ pinned @ by_corners.transpose(0, 2, 1)
    return np.asarray(inner @ pinned @ inner.T), np.asarray(of_poses)

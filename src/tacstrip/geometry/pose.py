"""Corners in a frame of their own, and on the sensor at a pose: x, y and angle."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray


def placed(corners: FloatArray, pose: FloatArray) -> FloatArray:
    """Return corners (N, 2) of a frame at a pose (3,) on the sensor."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def in_frame(corners: FloatArray, pose: FloatArray) -> FloatArray:
    """Return corners (N, 2) on the sensor as the frame at a pose (3,) has them."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((corners - pose[:2]) @ np.array([[cos, -sin], [sin, cos]]))

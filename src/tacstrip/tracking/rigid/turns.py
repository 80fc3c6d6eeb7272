"""How well an outline explains scans whatever its angles were: what fits of free angles make of noise counts little."""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, equations, loss
from tacstrip.geometry.pose import placed
from tacstrip.tracking.rigid.corners import Fit

_ANGLES = 120  # of a turn, that are summed over
_STEPS = 2  # of descents of x and y at each angle
# Of the angle from scan to scan, in these steps: how fast it turns on, and deviations from that; or it is any angle.
_DRIFTS, _WANDERS = np.arange(-6.0, 6.5, 0.5), (0.5, 1.0, 2.0, 4.0, 8.0)


def cost_at_all_angles(scans: RigidScans, fit: Fit) -> float:
    """Return -2 log of the mean likelihood of scans in order of time over the angles that an outline may have.

    The angle goes on evenly but for a random walk, the rate and the walk's deviation being any of a grid, or is any one
    in each scan, all as likely beforehand: a sum over a hidden Markov chain. x and y are the best at each angle.
    """
    costs, cell = _by_angle(scans, fit), 2.0 * math.pi / _ANGLES
    least = costs.min(axis=1)
    likely = np.exp(-0.5 * (costs - least[:, None]))
    frequency = 2.0 * math.pi * np.fft.rfftfreq(_ANGLES)
    wander, drift = (v.reshape(-1, 1) for v in np.meshgrid(_WANDERS, _DRIFTS))
    free = np.where(frequency == 0.0, 1.0, 0.0)[None]
    way = np.concatenate([np.exp(-0.5 * (wander * frequency) ** 2 - 1j * frequency * drift), free])
    turned = (
        np.diff(fit.poses[:, 2], prepend=fit.poses[0, 2]) / cell
    )  # each scan's grid begins at its own angle
    now, log = np.full((len(way), _ANGLES), 1.0 / _ANGLES), np.zeros(len(way))
    for here, by in zip(likely, turned, strict=True):
        ahead = np.fft.irfft(np.fft.rfft(now) * way * np.exp(1j * frequency * by), _ANGLES)
        now = np.maximum(ahead, 0.0) * here
        total = now.sum(axis=1) + 1e-300
        now, log = now / total[:, None], log + np.log(total)
    best = float(log.max())
    return float(least.sum()) - 2.0 * (best + math.log(float(np.exp(log - best).mean())))


def _by_angle(scans: RigidScans, fit: Fit) -> FloatArray:
    """Return what scans cost with the outline turned about its middle from where it is (T, A), all round."""
    every, middle = np.repeat(np.arange(len(fit.poses)), _ANGLES), fit.corners.mean(axis=0)
    many, own = scans.of(every), fit.corners - middle
    poses = np.array([[*placed(middle[None], pose)[0], pose[2]] for pose in fit.poses])[every]
    poses[:, 2] += np.tile(np.arange(_ANGLES), len(fit.poses)) * (2.0 * math.pi / _ANGLES)
    least, farthest = np.full(len(every), np.inf), scans.sensor.pitch_mm
    for _ in range(_STEPS + 1):
        found = equations(many, own, poses, loss(scans))
        least = np.minimum(least, found.costs)
        held = found.pose[:, :2, :2] + 1e-9 * np.eye(2)
        step = np.linalg.solve(held, found.pose_slope[:, :2, None])[..., 0]
        poses[:, :2] += np.clip(step, -farthest, farthest)  # where readings hold a scan's x hardly at all
    return least.reshape(len(fit.poses), _ANGLES)

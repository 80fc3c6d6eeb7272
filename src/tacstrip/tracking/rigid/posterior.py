"""How far the corners of an outline may be off, by a walk over outlines that explain the readings.

The bound at the best fit is that of a straight line through it. The corner of a notch that few strips read may lie in a
long bent valley, or at a kink of it where a strip passes the corner: there the bound is much too small.
"""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, fit_poses, loss
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import covariances, information

# Of the walk, the first third of it dropped; when its steps follow it.
_STEPS, _DROPPED, _ADAPTED = 800, 3, (130, 260)
_SIZES, _SHARES = (0.35, 1.0, 3.0), (0.3, 0.5, 0.2)  # of steps over the usual one, and how often
_USUAL = 2.4  # deviations of a step over the root of how many numbers it has
_POSES = 3  # steps of each scan's pose on a new outline
_FARTHEST = 0.2  # of the outline's extent: deviation of steps, at most
_KEEP = 0.3  # of the first steps' covariance, in what the walk has learned


def scatter(scans: RigidScans, fit: Fit) -> float:
    """Return how far a fit's least certain corner may be off [mm]: root of the mean square.

    Metropolis' walk over the corners, with the poses that fit best, each scan's by itself.
    """
    random, how = np.random.default_rng(0), loss(scans)
    size = float(np.ptp(fit.corners, axis=0).max())
    known = covariances(information(scans, fit.corners, fit.poses), fit.corners, fit.poses)[0]
    first = root = _root(known, _FARTHEST * size)
    corners, poses, cost = fit.corners, fit.poses, fit.cost
    here = own = _onto(corners, corners)
    walked = np.empty((_STEPS, *corners.shape))
    for i in range(_STEPS):
        step = random.choice(_SIZES, p=_SHARES) * _USUAL / math.sqrt(root.shape[1])
        trial = corners + step * (root @ random.normal(size=root.shape[1])).reshape(-1, 2)
        moved, costs = fit_poses(scans, trial, poses[:, None], how, _POSES)
        if math.log(1.0 - random.random()) < 0.5 * (cost - costs.sum()):
            corners, poses, cost = trial, moved[:, 0], float(costs.sum())
            here = _onto(corners, fit.corners)
        walked[i] = here
        if i in _ADAPTED:
            learned = np.cov(walked[i // 2 : i + 1].reshape(-1, corners.size).T)
            root = _root(learned + _KEEP * first @ first.T, _FARTHEST * size)
    off = ((walked[_STEPS // _DROPPED :] - own) ** 2).sum(axis=2).mean(axis=0)
    return math.sqrt(float(off.max()))


def _root(covariance: FloatArray, most: float) -> FloatArray:
    """Return a root (2 N, 2 N - 3) of a covariance of corners' shape: moved and turned as a whole it is the same."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector[:, 3:] * np.sqrt(np.clip(value[3:], 0.0, most**2)))


def _onto(corners: FloatArray, to: FloatArray) -> FloatArray:
    """Return corners about their mean, turned onto others about theirs."""
    a, b = corners - corners.mean(axis=0), to - to.mean(axis=0)
    turn = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    cos, sin = math.cos(turn), math.sin(turn)
    return np.asarray(a @ np.array([[cos, sin], [-sin, cos]]))

"""How far the corners of an outline may be off, by a walk over outlines that explain the readings.

The bound at the best fit is that of a straight line through it. The corner of a notch that few strips read may lie in a
long bent valley, or at a kink of it where a strip passes the corner: there the bound is much too small.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, walk
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import covariances, information

# Of the walk, the first third of it dropped; when its steps follow it.
_STEPS, _DROPPED, _ADAPTED = 800, 3, (131, 261)
_SIZES, _SHARES = (0.35, 1.0, 3.0), (0.3, 0.5, 0.2)  # of steps over the usual one, and how often
_USUAL = 2.4  # deviations of a step over the root of how many numbers it has
_POSES = 3  # steps of each scan's pose on a new outline
_FARTHEST = 0.2  # of the outline's extent: deviation of steps, at most
_KEEP = 0.3  # of the first steps' covariance, in what the walk has learned


def scatter(scans: RigidScans, fit: Fit) -> float:
    """Return how far a fit's least certain corner may be off [mm]: root of the mean square.

    Metropolis' walk over the corners, with the poses that fit best, each scan's by itself.
    """
    random, count = np.random.default_rng(0), len(fit.corners)
    size = float(np.ptp(fit.corners, axis=0).max())
    known = covariances(information(scans, fit.corners, fit.poses), fit.corners, fit.poses)[0]
    first = root = _root(known, _FARTHEST * size)
    numbers = root.shape[1]
    steps = random.choice(_SIZES, size=(_STEPS, 1), p=_SHARES) * _USUAL / math.sqrt(numbers)
    draws = steps * random.normal(size=(_STEPS, numbers))
    above = -2.0 * np.log1p(-random.random(_STEPS))
    corners, poses, cost, here = fit.corners, fit.poses, fit.cost, np.empty((0, count, 2))
    for begin, end in itertools.pairwise((0, *_ADAPTED, _STEPS)):
        if begin:
            learned = np.cov(here[begin // 2 :].reshape(-1, 2 * count).T)
            root = _root(learned + _KEEP * first @ first.T, _FARTHEST * size)
        moves = (draws[begin:end] @ root.T).reshape(-1, count, 2)
        walked, poses, cost = walk(scans, corners, poses, cost, moves, above[begin:end], _POSES)
        corners, here = walked[-1], np.concatenate([here, _onto(walked, fit.corners)])
    off = (here[_STEPS // _DROPPED :] - (fit.corners - fit.corners.mean(axis=0))) ** 2
    return math.sqrt(float(off.sum(axis=2).mean(axis=0).max()))


def _root(covariance: FloatArray, most: float) -> FloatArray:
    """Return a root (2 N, 2 N - 3) of a covariance of corners' shape: moved and turned as a whole it is the same."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector[:, 3:] * np.sqrt(np.clip(value[3:], 0.0, most**2)))


def _onto(walked: FloatArray, to: FloatArray) -> FloatArray:
    """Return outlines (M, N, 2) about their means, turned onto another about its mean."""
    a, b = walked - walked.mean(axis=1, keepdims=True), to - to.mean(axis=0)
    turn = np.arctan2((a[..., 0] * b[:, 1] - a[..., 1] * b[:, 0]).sum(axis=1), (a * b).sum(axis=(1, 2)))
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return np.stack([cos * a[..., 0] - sin * a[..., 1], sin * a[..., 0] + cos * a[..., 1]], axis=2)

"""Outlines that explain the readings, as likely as they are with all their poses, by a walk over both.

The best fit is the best of outlines each with its best poses. Where a strip passes a corner or a side that is nearly
upright, a pose has a kink: one that explains the scan may lie in a place so narrow that it is hardly likely, and an
outline that puts many scans there fits best and is wrong. What an outline is worth is its likelihood over all poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import LEAST, RigidScans, fit_poses, loss, walk
from tacstrip.tracking.rigid.corners import Fit, best_of, explained, poses_around
from tacstrip.tracking.rigid.covariance import covariances, information
from tacstrip.tracking.rigid.pose_spread import first_guess

_SIZES, _SHARES = (0.1, 0.35, 1.0), (0.3, 0.4, 0.3)  # of steps over the usual one, and how often
_USUAL = 2.4  # deviations of a step over the root of how many numbers it has
_POSE_SIZES, _POSE_TRIES = (0.3, 1.0, 3.0), 2  # of a pose's steps in its deviations; tries of each after one of corners
_FARTHEST = 0.2  # of the outline's extent: deviation of steps, at most
_KEEP = 0.1  # of the bound at the walk's place, in the covariance of its steps beside what it has learned
_GAP = 12.0  # pitches^-2: what is known of an end anywhere within a gap
_NO_LESS_MM2 = 1e-10  # of a pose's covariance: exact readings leave hardly any


@dataclass
class Walk:
    """A walk over outlines and poses, from a fit on.

    Attributes
    ----------
    scans, fit
        What it is to explain, and where it began.
    corners, poses, costs
        Where it is: (N, 2) [mm], (T, 3) and chi square of each scan (T,).
    outlines
        Those of its last stage, about their means and turned onto the fit's (M, N, 2).
    """

    scans: RigidScans
    fit: Fit
    corners: FloatArray
    poses: FloatArray
    costs: FloatArray
    outlines: FloatArray
    random: np.random.Generator
    learned: FloatArray | None = None

    @classmethod
    def of(cls, scans: RigidScans, fit: Fit) -> Walk:
        costs = fit_poses(scans, fit.corners, fit.poses[:, None], loss(scans), 0)[1][:, 0]
        return cls(scans, fit, fit.corners, fit.poses, costs, np.empty((0, *fit.corners.shape)), np.random.default_rng(0))

    def look_around(self) -> None:
        """Take scans that the walk does not explain to a better pose farther away, which it may not find by itself."""
        poses, costs = best_of(*poses_around(self.scans, Fit(self.corners, self.poses, self.costs)), 1)
        better = (costs[:, 0] < self.costs - 8.0) & (self.costs > self.scans.readings + 2.0 * np.sqrt(self.scans.readings))
        self.poses = np.where(better[:, None], poses[:, 0], self.poses)
        self.costs = np.where(better, costs[:, 0], self.costs)

    def go(self, steps: int) -> None:
        """Go on by so many steps."""
        scans, corners, poses = self.scans, self.corners, self.poses
        size, total = float(np.ptp(corners, axis=0).max()), len(poses)
        known = covariances(information(scans, corners, poses), corners, poses)[0]
        root = _root(known if self.learned is None else self.learned + _KEEP * known, _FARTHEST * size)
        numbers, random = root.shape[1], self.random
        size_of = random.choice(_SIZES, size=(steps, 1), p=_SHARES) * _USUAL / np.sqrt(numbers)
        moves = ((size_of * random.normal(size=(steps, numbers))) @ root.T).reshape(steps, *corners.shape)
        roots = np.stack([
            np.linalg.cholesky(bound + _NO_LESS_MM2 * np.eye(3)) for bound in first_guess(scans, Fit(corners, poses, self.costs))
        ])  # (2, T, 3, 3)
        shape = (steps, _POSE_TRIES, total)
        draws = random.normal(size=(*shape, 3)) * random.choice(_POSE_SIZES, size=(*shape, 1))
        which = random.random((*shape, 1)) < 0.5
        by = np.where(which, *(np.einsum("tij,nktj->nkti", r, draws, optimize=True) for r in roots))
        tries = moves, -2.0 * np.log1p(-random.random(steps)), by, -2.0 * np.log1p(-random.random(shape))
        walked, self.poses, self.costs = walk(scans, corners, poses, self.costs, _follow(scans, corners, poses), tries)
        self.corners, self.outlines = walked[-1], _onto(walked, self.fit.corners)
        self.learned = np.cov(self.outlines[steps // 3 :].reshape(-1, corners.size).T)


def _follow(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> FloatArray:
    """Return how poses follow corners (T, 3, 2 N), their ends anywhere within the gaps that they lie in."""
    found, rows, free = information(scans, corners, poses), np.arange(len(poses)), _GAP / scans.sensor.pitch_mm**2
    pose, mixed = found.pose + LEAST * np.eye(3), found.mixed.copy()
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = np.outer(cos, corners[:, 0]) - np.outer(sin, corners[:, 1])
    for i in (x.argmin(axis=1), x.argmax(axis=1)):
        y = sin * corners[i, 0] + cos * corners[i, 1]
        by_pose = np.stack([np.ones_like(y), np.zeros_like(y), -y], axis=1)
        pose += free * by_pose[:, :, None] * by_pose[:, None]
        mixed[rows, :, 2 * i] += free * cos[:, None] * by_pose
        mixed[rows, :, 2 * i + 1] -= free * sin[:, None] * by_pose
    return np.asarray(np.linalg.solve(pose, mixed))


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


def scatter(scans, fit):
    w = Walk.of(scans, fit)
    every = []
    for _ in range(4):
        w.go(200)
        every.append(w.outlines)
    off = (np.concatenate(every[1:]) - (fit.corners - fit.corners.mean(axis=0))) ** 2
    return float(np.sqrt(off.sum(axis=2).mean(axis=0).max()))

"""Outlines that explain the readings, each as likely as it is with all its poses, by a walk over both.

The best fit is that of outlines each with its best poses. Where a strip passes a corner, or a side that is nearly
upright, a pose has a kink: one that explains its scan may lie in so narrow a place that it is hardly likely. An outline
that needs such poses in many scans may fit best and be wrong (as where structural and incidental parameters are fitted
together: Neyman and Scott 1948), and the bound at the best fit is that of a straight line through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import LEAST, RigidScans, fit_poses, loss, walk
from tacstrip.tracking.rigid.corners import Fit, best_of, posed, poses_around, reflex
from tacstrip.tracking.rigid.covariance import FREE, covariances, information
from tacstrip.tracking.rigid.pose_spread import NO_LESS_MM2, bounds_beside

_STAGES, _STEPS = 4, 200  # of a walk, after each of which it has learned; the first one is dropped
# Stages until it is where the outlines are likely, and there, of so many steps.
_NEARING, _LASTING, _LONG = 5, 6, 500
_LEAVES, _ELSEWHERE = 2.5, 3.0  # deviations of the walk's mean from the fit: it goes on, and leads elsewhere
# Logarithm of the volume of poses beside the fit's over that of its own, in the mean: the walk goes on, too; and
# deviations from which on it leads elsewhere, for the bound at such a fit is that of a kink.
_KINKED, _FROM_KINKS = 1.0, 1.0
_STUCK = 0.02  # share of trials taken: the walk is held where it began
_LOST = 8.0  # of chi square, by which a scan's other pose has to be better to be jumped to
_SIZES, _SHARES = (0.1, 0.35, 1.0), (0.3, 0.4, 0.3)  # of steps over the usual one, and how often
_USUAL = 2.4  # deviations of a step over the root of how many numbers it has
_POSE_SIZES = (0.3, 1.0, 3.0)  # deviations of a pose's steps
_FARTHEST = 0.2  # of the outline's extent: deviation of steps, at most
_KEEP = 0.1  # of the bound where the walk is, in the covariance of its steps beside what it has learned


@dataclass(frozen=True, eq=False)
class Likely:
    """The outlines that are likely.

    Attributes
    ----------
    fit
        Their mean, with its best poses.
    best
        The fit that explains the scans best, and is not among them.
    covariance
        Of its corners (2 N, 2 N) [mm^2], that of so long a walk included.
    """

    fit: Fit
    best: Fit
    covariance: FloatArray


def over_all_poses(scans: RigidScans, fit: Fit) -> tuple[float, Likely | None]:
    """Return how far a fit's least certain corner may be off [mm], root of the mean square; what is likely elsewhere.

    None where the fit is among the outlines that are likely, and of concave ones: how deep a notch is, few scans tell.
    """
    way, walked = _Walk.of(scans, fit), list[FloatArray]()
    for _ in range(_STAGES):
        walked.append(way.go(_STEPS))
    middle = fit.corners - fit.corners.mean(axis=0)
    found = np.concatenate(walked[1:])
    loosest = float(np.sqrt(((found - middle) ** 2).sum(axis=2).mean(axis=0).max()))
    known = covariances(information(scans, fit.corners, fit.poses), fit.corners, fit.poses)[0]
    stuck = (np.diff(found, axis=0) != 0.0).any(axis=(1, 2)).mean() < _STUCK
    kinked = _kinked(scans, fit) > _KINKED
    leaves = stuck or kinked or _off(found.mean(axis=0) - middle, known) > _LEAVES
    if reflex(fit.corners).any() or not leaves:
        return loosest, None
    for _ in range(_NEARING):
        way.look_around()
        way.go(_STEPS)
    parts = np.stack([way.go(_LONG) for _ in range(_LASTING)])
    mean = parts.mean(axis=(0, 1))
    if _off(mean - middle, known) <= (_FROM_KINKS if kinked else _ELSEWHERE):
        return loosest, None
    every, means = parts.reshape(-1, mean.size), parts.mean(axis=1).reshape(len(parts), -1)
    outline = Fit(mean + fit.corners.mean(axis=0), way.poses, way.costs)
    poses, costs = best_of(*poses_around(scans, posed(scans, outline)), 1)
    outline = Fit(outline.corners, poses[:, 0], costs[:, 0])
    return loosest, Likely(outline, fit, np.cov(every.T) + np.cov(means.T))


def _kinked(scans: RigidScans, fit: Fit) -> float:
    """Return how much narrower poses are at the fit than beside it: logarithm of their volumes' ratio, in the mean."""
    own, beside = (np.linalg.slogdet(bound)[1] for bound in bounds_beside(scans, fit))
    return 0.5 * float((beside - own).mean())


def _off(step: FloatArray, covariance: FloatArray) -> float:
    """Return how large a change of shape (N, 2) is along the axes of a covariance, in deviations, at most."""
    value, vector = np.linalg.eigh(covariance)
    return float((np.abs(step.ravel() @ vector)[3:] / np.sqrt(value[3:])).max())


@dataclass
class _Walk:
    """A walk of Metropolis' over outlines and poses.

    Attributes
    ----------
    scans, fit
        What it is to explain, and where it began.
    corners, poses, costs
        Where it is: (N, 2) [mm], (T, 3) and chi square of each scan (T,).
    learned
        Covariance of the corners in its last stage (2 N, 2 N).
    """

    scans: RigidScans
    fit: Fit
    corners: FloatArray
    poses: FloatArray
    costs: FloatArray
    random: np.random.Generator
    learned: FloatArray | None = None

    @classmethod
    def of(cls, scans: RigidScans, fit: Fit) -> _Walk:
        """Return it at a fit."""
        costs = fit_poses(scans, fit.corners, fit.poses[:, None], loss(scans), 0)[1][:, 0]
        return cls(scans, fit, fit.corners, fit.poses, costs, np.random.default_rng(0))

    def look_around(self) -> None:
        """Put scans at poses farther away that explain them better, which the walk may not find by itself."""
        poses, costs = best_of(*poses_around(self.scans, Fit(self.corners, self.poses, self.costs)), 1)
        better = costs[:, 0] < self.costs - _LOST
        self.poses = np.where(better[:, None], poses[:, 0], self.poses)
        self.costs = np.where(better, costs[:, 0], self.costs)

    def go(self, steps: int) -> FloatArray:
        """Go on by so many steps, and return the outlines about their means, turned onto the fit's (steps, N, 2)."""
        scans, corners, poses, random = self.scans, self.corners, self.poses, self.random
        known = covariances(information(scans, corners, poses), corners, poses)[0]
        known = known if self.learned is None else self.learned + _KEEP * known
        root = _root(known, _FARTHEST * float(np.ptp(corners, axis=0).max()))
        numbers = root.shape[1]
        sizes = random.choice(_SIZES, size=(steps, 1), p=_SHARES) * _USUAL / np.sqrt(numbers)
        moves = ((sizes * random.normal(size=(steps, numbers))) @ root.T).reshape(steps, *corners.shape)
        # Of each pose two steps: as at a kink, then as beside it.
        bounds = np.stack(bounds_beside(scans, Fit(corners, poses, self.costs)))  # (2, T, 3, 3)
        roots = np.linalg.cholesky(bounds + NO_LESS_MM2 * np.eye(3))
        tries, total = bounds.shape[:2]
        each = (steps, tries, total)
        draws = random.normal(size=(tries, total, 3, steps))
        draws *= random.choice(_POSE_SIZES, size=(tries, total, 1, steps))
        above, pose_above = (-2.0 * np.log1p(-random.random(size)) for size in (steps, each))
        walked, self.poses, self.costs = walk(
            scans, corners, poses, self.costs, _follow(scans, corners, poses),
            (moves, above, (roots @ draws).transpose(3, 0, 1, 2), pose_above),
        )  # fmt: skip
        self.corners, outlines = walked[-1], _onto(walked, self.fit.corners)
        self.learned = np.cov(outlines[steps // 3 :].reshape(-1, corners.size).T)
        return outlines


def _follow(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> FloatArray:
    """Return how poses follow corners (T, 3, 2 N), their ends anywhere within the gaps that they lie in."""
    found = information(scans, corners, poses)
    rows, free = np.arange(len(poses)), FREE / scans.sensor.pitch_mm**2
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

"""A disc or an ellipse in many scans: one or two numbers explain what no count of corners fits well."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import Loss
from tacstrip.core.rigid import RigidScans, equations, fit_poses, loss
from tacstrip.core.rigid_path import OnPath, OutlineNumbers, descend_path
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import NEVER
from tacstrip.tracking.rigid.search import within_noise
from tacstrip.tracking.rigid.smooth_path import centres

_POINTS = 60  # that draw it
_ANGLES = 6  # of half a turn, at which a scan's pose is looked for
_STEPS = 20
_TOLERANCE, _CAUCHY = 0.02, 3.0  # of the larger half-axis, while it is only roughly known
_TELLING = 3.0  # standard deviations by which numbers lower chi square more than noise lets them
_ENOUGH = 1e-4  # of the cost: a smaller gain ends a descent


@dataclass(frozen=True, eq=False)
class RigidEllipse:
    """An ellipse and its poses, drawn by corners that hold its area.

    Attributes
    ----------
    fit
        The drawn outline, its larger axis along x, and the poses.
    by
        How the corners follow the half-axes, of a disc its radius.
    """

    fit: Fit
    by: OutlineNumbers

    @property
    def kind(self) -> str:
        """What it is called."""
        return "disc" if len(self.by.prior) == 1 else "ellipse"

    def criterion(self, scans: RigidScans) -> float:
        """Return what it is compared by with polygons, `Fit.criterion`, whose corners count where they lie, too."""
        return self.fit.cost + (3.0 + len(self.by.prior)) * math.log(scans.readings.sum())

    def freedom(self, scans: RigidScans) -> int:
        """Return the readings beyond the numbers fitted; a disc has no angle."""
        numbers = (2 if self.kind == "disc" else 3) * len(self.fit.poses) + len(self.by.prior)
        return max(int(scans.readings.sum()) - numbers, 1)

    def covariances(self, scans: RigidScans) -> tuple[FloatArray, FloatArray]:
        """Return the covariances of the drawn corners (2 N, 2 N) [mm^2] and of the poses (T, 3, 3)."""
        found = equations(scans, self.fit.corners, self.fit.poses, loss(scans, end=NEVER))
        linear = np.zeros((len(self.by.which), len(self.by.prior)))
        linear[np.arange(len(self.by.which)), self.by.which] = self.by.weight
        own, mixed = found.pose.copy(), found.mixed @ linear
        if self.kind == "disc":  # what tells an angle are the corners that draw it
            own[:, 2] = own[:, :, 2] = mixed[:, 2] = 0.0
        own[:, 2, 2] += 12.0 / math.pi**2  # of half a turn nothing is known before
        inverse = np.linalg.inv(own)
        follow = inverse @ mixed
        known = linear.T @ found.shape @ linear - np.einsum("tip,tiq->pq", mixed, follow)
        of_numbers = np.linalg.inv(known)
        return linear @ of_numbers @ linear.T, inverse + follow @ of_numbers @ follow.transpose(0, 2, 1)


def rigid_ellipse(scans: RigidScans, start: Fit, chosen: IntArray, distribution: str) -> RigidEllipse | None:
    """Return the disc or ellipse that explains the scans better than a polygon does; None where none does.

    Parameters
    ----------
    scans, start
        All of them, and the polygon that explains them best: its poses are about right.
    chosen
        Scans that the half-axes are fitted to (K,); the others have their poses fitted.
    distribution
        Of the readings' errors.
    """
    middle, half, angle = _moments(start.corners)
    cos, sin = np.cos(start.poses[:, 2]), np.sin(start.poses[:, 2])
    turned = np.stack([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1]], axis=1)
    poses = np.column_stack([start.poses[:, :2] + turned, start.poses[:, 2] + angle])
    ellipse = _descended(scans, half, poses, chosen)
    disc = _descended(scans, np.array([math.sqrt(half.prod())]), ellipse.fit.poses, chosen)
    best = disc if not _lower(disc.fit.cost - ellipse.fit.cost, len(poses) + 1) else ellipse
    rigid = within_noise(best.fit.costs, best.freedom(scans), distribution)
    polygon = within_noise(start.costs, start.freedom(scans), distribution)
    simpler = best.criterion(scans) < start.criterion(scans) and not _lower(
        best.fit.cost - start.cost, start.corners.size - 5
    )
    return best if rigid and (simpler or not polygon) else None


def _lower(gain: float, numbers: int) -> bool:
    """Whether so many numbers more lower chi square by more than noise lets them."""
    return gain > numbers + _TELLING * math.sqrt(2.0 * numbers)


def _descended(scans: RigidScans, numbers: FloatArray, poses: FloatArray, chosen: IntArray) -> RigidEllipse:
    """Return where a descent of half-axes and poses ends, poses looked for at all angles."""
    by, few, free = _drawn(len(numbers)), scans.of(chosen), np.eye(len(chosen))
    soft = loss(scans, _TOLERANCE * float(numbers.max()), _CAUCHY)
    numbers = descend_path(few, by, OnPath(numbers, poses[chosen]), free, soft, _STEPS, _ENOUGH).outline
    poses = _looked_for(scans, by.corners(numbers), poses, soft)
    numbers = descend_path(
        few, by, OnPath(numbers, poses[chosen]), free, loss(scans), _STEPS, _ENOUGH
    ).outline
    corners = by.corners(numbers)
    settled, costs = fit_poses(scans, corners, poses[:, None], loss(scans), _STEPS)
    return RigidEllipse(Fit(corners, settled[:, 0], costs[:, 0]), by)


def _looked_for(scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss) -> FloatArray:
    """Return poses (T, 3) after descents from about them and from the contact's middle, at all angles."""
    starts = np.repeat(poses[:, None], 2 * _ANGLES, axis=1)
    starts[:, :, 2] += np.arange(2 * _ANGLES) * math.pi / _ANGLES
    starts[:, _ANGLES:, :2] = centres(scans)[0][:, None]
    tried, costs = fit_poses(scans, corners, starts, how)
    return np.asarray(tried[np.arange(len(poses)), costs.argmin(axis=1)])


def _drawn(numbers: int) -> OutlineNumbers:
    """Return how corners that hold its area follow one or two half-axes."""
    step = 2.0 * math.pi / _POINTS
    angle = step * np.arange(_POINTS)
    weight = math.sqrt(step / math.sin(step)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return OutlineNumbers(np.arange(2 * _POINTS) % numbers, weight.ravel(), np.zeros((numbers, numbers)))


def _moments(corners: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return centroid, half-axes (2,) and angle of the ellipse with the moments of an outline (N, 2)."""
    after = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]
    area = 0.5 * cross.sum()
    middle = ((corners + after) * cross[:, None]).sum(axis=0) / (6.0 * area)
    a, b = corners - middle, after - middle
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    both = np.einsum("n,ni,nj->ij", cross, a + b, a + b) + np.einsum("n,ni,nj->ij", cross, a, a)
    second = (both + np.einsum("n,ni,nj->ij", cross, b, b)) / (24.0 * area)
    value, vector = np.linalg.eigh(second)
    return middle, 2.0 * np.sqrt(np.maximum(value[::-1], 1e-9)), math.atan2(vector[1, 1], vector[0, 1])

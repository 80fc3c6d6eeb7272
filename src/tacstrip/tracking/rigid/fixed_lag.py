"""A known shape from scan to scan: the last scans have free poses, those before are a normal distribution of corners.

Scans share nothing but the corners, so that a scan which leaves takes its pose with it: Schur's complement of its own
block is what it adds to the information about the corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import Prior, RigidScans, descend, equations, fit_poses, loss, reduced
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.rigid.corners import explained, jiggles, poses_all_round
from tacstrip.tracking.rigid.covariance import NEVER, covariances, information, rigid_motions

LAG = 20  # scans that keep free poses
_TOGETHER = 5  # scans after which corners and poses are fitted together
_STEPS, _POSE_STEPS = 6, 8  # of descents for a scan that surprises, of a new pose
_MOST_STEP = 0.1  # pitches that corners and poses move at once
# Scans that a velocity is taken over, and how much further than between the last two.
_WAY, _FARTHEST = 5, 3.0
_ALARM = 6.0  # deviations of chi square: of the scans in the window, and of all


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a shape.

    Attributes
    ----------
    corners
        (N, 2) [mm], in their own frame.
    beside
        Information of the scans that have left the window (2 N, 2 N).
    window, poses
        Those in it, and their poses (T, 3).
    wider
        What other outlines that explain the scans add to the bound, over the bound's trace (2 N, 2 N).
    """

    corners: FloatArray
    beside: FloatArray
    window: RigidScans
    poses: FloatArray
    wider: FloatArray

    @cached_property
    def bound(self) -> FloatArray:
        """Least covariance of the corners, of their shape alone (2 N, 2 N) [mm^2]."""
        found = information(self.window, self.corners, self.poses)
        return covariances(found, self.corners, self.poses, beside=self.beside)[0]

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the corners, of their shape alone (2 N, 2 N) [mm^2]."""
        return np.asarray(self.bound + np.trace(self.bound) * self.wider)

    @property
    def corner_deviation_mm(self) -> float:
        """Standard deviation of the corner that is known least [mm]."""
        return math.sqrt(float(self.covariance.diagonal().reshape(-1, 2).sum(axis=1).max()))

    def pose_covariance(self, scan: RigidScans, pose: FloatArray) -> FloatArray:
        """Return that of the pose (3,) of a scan beside these (3, 3)."""
        # What is left of a motion as a whole in the covariance must not hold the pose.
        inner = np.linalg.qr(rigid_motions(self.corners), mode="complete")[0][:, 3:]
        rest = np.asarray(inner @ np.linalg.inv(inner.T @ self.covariance @ inner) @ inner.T)
        found = information(scan, self.corners, pose[None])
        return np.asarray(covariances(found, self.corners, pose[None], beside=rest)[1][0])


class FixedLag:
    """Corners and the poses of the last scans.

    Parameters
    ----------
    sensor, names, sigma
        As of `RigidScans`.
    corners
        (N, 2) [mm], in a frame of their own.
    lag
        How many scans keep free poses.
    distribution
        Of the readings' errors.

    Attributes
    ----------
    corners
        At present.
    scans
        Number of scans that told of them.
    pose
        Of the last one (3,), NaN before the first.
    """

    def __init__(
        self,
        sensor: Sensor,
        names: tuple[str, ...],
        sigma: float,
        corners: FloatArray,
        lag: int = LAG,
        distribution: str = "normal",
    ) -> None:
        self.sensor, self.names, self.sigma, self.lag = sensor, names, sigma, lag
        self.distribution = distribution
        self.corners, self.scans, self.pose = corners, 0, np.full(3, np.nan)
        size = corners.size
        motions = np.linalg.qr(rigid_motions(corners))[0]
        self._still = motions @ motions.T  # of which scans whose poses are free know nothing
        self._prior = Prior(np.zeros((size, size)), np.zeros(size), corners)
        self._held = self._prior  # the same with a hold of the corners' frame
        self._beside, self._wider = np.zeros((size, size)), np.zeros((size, size))
        self._k: list[FloatArray] = []
        self._poses, self._costs = np.empty((0, 3)), np.empty(0)
        self._freedoms = np.empty(0)
        self._way: list[tuple[float, FloatArray]] = []  # the last times and poses
        self._left = np.zeros(2)  # chi square and freedom of the scans that have left
        self._alone = 0  # scans since the last common descent
        self._lost = False  # the last scan was not explained
        self._known: Known | None = None

    def of(self, k: FloatArray) -> RigidScans:
        """Return readings (T, S, n) as scans of this object."""
        return RigidScans(self.sensor, self.names, k, self.sigma)

    def absorb(self, k: FloatArray, poses: FloatArray) -> None:
        """Take scans with known poses for good."""
        scans = self.of(k)
        added, slope, costs = _eliminated(scans, self.corners, poses)
        prior, off = self._prior, (self.corners - self._prior.about).ravel()
        slope = prior.slope + slope + added @ off
        self._prior = Prior(prior.information + added, slope, prior.about)
        weight = max(float(np.trace(self._prior.information)) / len(slope), 1.0 / self.sensor.pitch_mm**2)
        self._held = replace(self._prior, information=self._prior.information + weight * self._still)
        self._beside = self._beside + _eliminated(scans, self.corners, poses, NEVER)[0]
        self._left = self._left + np.array([costs.sum(), _freedom(scans)])
        self._known = None

    def begin(self, k: FloatArray, poses: FloatArray) -> None:
        """Begin with scans and their poses."""
        self.absorb(k, poses)
        self.scans, self.pose, self._way = self.scans + len(k), poses[-1], []

    def widen(self, covariance: FloatArray) -> None:
        """Take the covariance (2 N, 2 N) [mm^2] that a search found; it falls with the bound from now on."""
        value, vector = np.linalg.eigh(covariance - self.known.bound)
        more = vector * np.maximum(value, 0.0) @ vector.T
        self._wider, self._known = more / np.trace(self.known.bound), None

    def add(self, k: FloatArray, time_s: float = math.nan) -> bool:
        """Take the next scan (S, n); return whether the shape explains it.

        A scan that it does not explain, even where that may move the corners, is not taken.
        """
        time_s = time_s if math.isfinite(time_s) else math.nan
        one, guesses = self.of(k[None]), self._guesses(time_s)
        pose, cost = self._posed(one, guesses)
        if not explained(cost, one.readings)[0]:
            pose, cost = self._posed(one, guesses[-1] + jiggles(self.sensor.pitch_mm))
        before = self.corners, self._k, self._poses, self._costs
        self._k = [*self._k, k]
        self._poses, self._costs = np.vstack([self._poses, pose]), np.append(self._costs, cost)
        if surprising := not explained(cost, one.readings)[0]:
            self._search()
            if not explained(self._costs[-1:], one.readings)[0]:
                self.corners, self._k, self._poses, self._costs = before
                if not self._jumped(one):
                    self._lost = True
                    return False
        self._lost = False
        self._freedoms = np.append(self._freedoms, float(one.readings[0] - 3))
        self.scans, self._alone = self.scans + 1, self._alone + 1
        if surprising or self._alone >= _TOGETHER:
            self._update()
            self._alone = 0
        elif (
            len(self._k) > self.lag and self._alone == 1
        ):  # not in the same update, which would take twice as long
            self._let_go(len(self._k) - self.lag)
        self.pose, self._known = self._poses[-1], None
        self._way = [*self._way[1 - _WAY :], (time_s, self.pose)]
        return True

    def _posed(self, scan: RigidScans, starts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the best pose (3,) of a scan that descents from some (G, 3) end at, and its cost (1,)."""
        poses, costs = fit_poses(scan, self.corners, starts[None], loss(scan), _POSE_STEPS)
        best = int(costs[0].argmin())
        return poses[0, best], costs[0, best : best + 1]

    def _jumped(self, scan: RigidScans) -> bool:
        """Take a scan that the shape explains far from where it was; return whether it does.

        Of scans that it does not explain in turn the first is asked only: one that deforms would cost a search each.
        """
        if self._lost:
            return False
        (poses,), (cost,) = poses_all_round(scan, self.corners, 0.05 * self.sensor.pitch_mm, kept=1)
        if not explained(cost, scan.readings)[0]:
            return False
        self._k, self._way = [*self._k, scan.k[0]], []
        self._poses, self._costs = np.vstack([self._poses, poses]), np.append(self._costs, cost)
        return True

    @property
    def passed_s(self) -> float:
        """Time over the last scans [s]; below 0 where the clock went back from one to the next, NaN: not known."""
        if len(self._way) < 2:
            return math.nan
        steps = np.diff([time_s for time_s, _ in self._way])
        return float(steps.min() if (steps < 0.0).any() else steps.sum())

    @property
    def velocity(self) -> FloatArray:
        """Of the pose over the last scans (3,); NaN where their times do not tell."""
        passed = self.passed_s
        return (
            np.asarray((self._way[-1][1] - self._way[0][1]) / passed) if passed > 0.0 else np.full(3, np.nan)
        )

    @property
    def window_readings(self) -> list[FloatArray]:
        """Those of the scans that keep free poses."""
        return list(self._k)

    def _guesses(self, time_s: float) -> FloatArray:
        """Return poses to begin with (G, 3): that of the last scan, and as far on as it went."""
        if len(self._way) < 2:
            return self.pose[None]
        (before_s, before), (last_s, last) = self._way[-2:]
        passed = last_s - before_s
        times = (time_s - last_s) / passed if passed > 0.0 else 1.0
        return np.stack(
            [last, last + np.clip(times if times == times else 1.0, 0.0, _FARTHEST) * (last - before)]
        )

    @property
    def known(self) -> Known:
        """What is known of the shape at present."""
        if self._known is None:
            count = len(self._k)
            self._known = Known(
                self.corners, self._beside, self.of(self._stacked(count)), self._poses[:count], self._wider
            )
        return self._known

    @property
    def rigid(self) -> bool:
        """Whether the scans in the window, and all together, are explained as well as noise allows."""
        window = np.array([self._costs.sum(), self._freedoms.sum()])
        return all(
            chi_square_score(np.sqrt(both[:1]), int(both[1]), self.distribution) <= _ALARM
            for both in (window, window + self._left)
        )

    def _stacked(self, count: int) -> FloatArray:
        strips = self.sensor.strips
        return np.stack(self._k[:count]) if count else np.empty((0, len(self.names), strips))

    def _search(self) -> None:
        """Fit corners and poses of the window together, downhill."""
        scans = self.of(self._stacked(len(self._k)))
        self.corners, self._poses, self._costs = descend(
            scans, self.corners, self._poses, loss(scans), _STEPS, self._held
        )

    def _update(self) -> None:
        """Move corners and poses of the window by Gauss and Newton's step.

        It is taken even uphill: where a corner passes a strip the cost of single scans has kinks, which would stop it.
        """
        scans = self.of(self._stacked(len(self._k)))
        found = equations(scans, self.corners, self._poses, loss(scans))
        matrix, slope, inverse = reduced(found, pinned=0.0)
        step = np.linalg.solve(matrix + self._held.information, slope + self._held.at(self.corners)[0])
        turn = np.einsum("tpq,tq->tp", inverse, found.pose_slope - found.mixed @ step)
        most = _MOST_STEP * self.sensor.pitch_mm
        share = min(1.0, most / max(float(np.abs(step).max()), float(np.abs(turn[:, :2]).max())))
        self.corners = self.corners + share * step.reshape(-1, 2)
        self._poses, self._costs = self._poses + share * turn, found.costs

    def _let_go(self, old: int) -> None:
        """Take the oldest scans out of the window."""
        self.absorb(self._stacked(old), self._poses[:old])
        self._k, self._poses = self._k[old:], self._poses[old:]
        self._costs, self._freedoms = self._costs[old:], self._freedoms[old:]


def _eliminated(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, end: float = 0.05
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what scans tell of the corners alone, information and slope, and their costs (T,)."""
    found = equations(scans, corners, poses, loss(scans, end=end))
    return *reduced(found, pinned=0.0)[:2], found.costs


def _freedom(scans: RigidScans) -> int:
    return int(scans.readings.sum()) - 3 * len(scans.k)

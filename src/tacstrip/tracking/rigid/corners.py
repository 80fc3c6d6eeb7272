"""Corners of a rigid outline and its poses: how many corners the readings hold, and poses that do not fit yet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.rigid import MOST_CORNERS, Equations, RigidScans, descend, fit_poses, loss
from tacstrip.tracking.rigid.covariance import covariances, information
from tacstrip.tracking.rigid.smooth_path import centres, fit_corners

FEWEST, FIRST, _FIRST_TIED = 3, 9, 12  # corners; from how many a rough outline is pruned
_TRIED = 3  # corners that are taken away by turns
# Price of a corner for the ten places where one too many may fit the noise.
PLACES = 2.0 * float(np.log(10.0))
_SURE = 8.0  # times what a corner must gain: there is no need to try without it
# Times the best criterion, and more: a cost of fewer corners that ends the pruning.
_HOPELESS, _MARGIN = 3.0, 300.0
_ANGLES, _KEPT = 36, 6  # of a pose of which nothing is known: starts all round, and how many are refined
_JIGGLES = np.array([(0, 0, 0), (0.5, 0, 0.02), (-0.5, 0, -0.02), (0, 0.5, -0.03), (0, -0.5, 0.03)])
# Farther steps, all signs and along each axis: of .1 pitch, and 1.5 times as far of the outline's corners.
_AROUND = 0.1 * np.vstack([2.0 * np.eye(3), -2.0 * np.eye(3), np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1])
_ROUNDS = 4
_SHARES, _BENT = (0.25, 0.75), 0.03  # of an edge: where a corner more may be, and how far outside it begins
_CUT = 0.3  # of the edges beside a corner that is cut off
_BAD, _SPREAD = 6.0, 5.0  # chi square of a scan beyond its readings, and times its deviation
# Rounds, descents of each that are settled: the best, and with unlike ones.
_EXPLORED, _BEST, _SETTLED = 5, 4, 7
_FAR = 2.5  # times a short move
# Directions that the readings tell least, deviations along them, and how far at most, of the outline's extent.
_OPEN, _DEVIATIONS, _FARTHEST = 4, (-10.0, -4.0, 4.0, 10.0), 0.2
_ORDERS = (2, 4, 3)  # parts of a turn that may bring an outline onto itself
_SMOOTH = 0.35  # radians from scan to scan, in the median: an object that moves on
_JUMP = 12.0  # of chi square: what a jump between such poses has to explain
MOST_BAD = 0.8  # of all scans: with more the shape is wrong, not the poses


@dataclass(frozen=True, eq=False)
class Fit:
    """An outline and its poses.

    Attributes
    ----------
    corners
        (N, 2) [mm], in a frame of their own.
    poses
        x, y [mm] and angle of every scan (T, 3).
    costs
        Squared residuals over sigma^2 of every scan (T,).
    basis
        Of the spline that the poses are (T, K); None: they are free.
    """

    corners: FloatArray
    poses: FloatArray
    costs: FloatArray
    basis: FloatArray | None = None

    @property
    def cost(self) -> float:
        """Of all scans."""
        return float(self.costs.sum())

    def of(self, scans: IntArray) -> Fit:
        """Return it of some of the scans."""
        basis = None if self.basis is None else self.basis[scans]
        return Fit(self.corners, self.poses[scans], self.costs[scans], basis)

    def criterion(self, scans: RigidScans) -> float:
        """Return what fits are compared by: extended BIC, of corners that could be at any of some places."""
        knots = 0 if self.basis is None else 3 * self.basis.shape[1]
        numbers = 2.0 * len(self.corners) + knots
        return self.cost + numbers * float(np.log(scans.readings.sum())) + PLACES * len(self.corners)

    def freedom(self, scans: RigidScans) -> int:
        """Return the readings beyond the numbers fitted."""
        many = len(self.poses) if self.basis is None else self.basis.shape[1]
        return max(int(scans.readings.sum()) - 3 * many - 2 * len(self.corners) + 3, 1)


def fitted(
    scans: RigidScans,
    corners: FloatArray,
    poses: FloatArray,
    steps: int = 40,
    tolerance_mm: float = 0.0,
    cauchy: float = 0.0,
    basis: FloatArray | None = None,
) -> Fit:
    """Return the fit where a descent of corners and poses ends; with a basis, of poses that are a spline."""
    how = loss(scans, tolerance_mm, cauchy)
    if basis is None:
        return Fit(*descend(scans, corners, poses, how, steps))
    knots = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0], dtype=np.float64)
    corners, knots, costs = fit_corners(scans, corners, knots, basis, how, steps)
    return Fit(corners, basis @ knots, costs, basis)


def pruned(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, basis: FloatArray | None = None
) -> list[Fit]:
    """Return fits of ever fewer corners, from a rough outline of many, down to counts that are out of the question.

    One that explains hardly a scan with many corners is out of the question with fewer. Poses that are tied to a spline
    cannot make up for corners that were taken away too early: there it is begun with more.
    """
    while len(corners) > (FIRST if basis is None else _FIRST_TIED):
        corners = np.delete(corners, int(_areas(corners).argmin()), axis=0)
    soft = 0.05 * scans.sensor.pitch_mm
    fit = fitted(scans, corners, poses, 8, soft, 5.0, basis)
    fit = fitted(scans, fit.corners, fit.poses, 8, cauchy=5.0, basis=basis)
    found: list[Fit] = []
    while True:
        fit = fitted(scans, fit.corners, fit.poses, 12, basis=basis)
        found.append(fit)
        least = min(f.criterion(scans) for f in found)
        hopeless = len(found) > 3 and fit.criterion(scans) > _HOPELESS * least + _MARGIN
        hopeless |= len(found) == 1 and len(bad_scans(scans, fit)) > MOST_BAD * len(fit.poses)
        if len(fit.corners) == FEWEST or hopeless:
            return found
        tries = [without(scans, fit, corner, 5) for corner in faintest(fit.corners)]
        fit = min(tries, key=lambda f: f.cost)


def settled(scans: RigidScans, fit: Fit, rounds: int = 4) -> Fit:
    """Return the fit after descents of single poses from about where they are, and of all together, in turn.

    Kinks of one scan, where a corner passes a strip, do not stop the others then.
    """
    if fit.basis is not None:
        return fitted(scans, fit.corners, fit.poses, 15, basis=fit.basis)
    for _ in range(rounds):
        new = fitted(scans, fit.corners, posed(scans, fit).poses, 15)
        if not new.cost < fit.cost - 0.5:
            break
        fit = new
    return fit


def posed(scans: RigidScans, fit: Fit) -> Fit:
    """Return the fit after descents of single poses from about where they are."""
    starts = fit.poses[:, None] + jiggles(scans.sensor.pitch_mm)
    poses, costs = fit_poses(scans, fit.corners, starts, loss(scans), 10)
    best, rows = costs.argmin(axis=1), np.arange(len(poses))
    return Fit(fit.corners, poses[rows, best], costs[rows, best])


def jiggles(pitch_mm: float) -> FloatArray:
    """Return steps of a pose (5, 3) to begin descents at, about where it is: a kink that stops one stops not all."""
    return np.asarray(_JIGGLES * (0.05 * pitch_mm, 0.05 * pitch_mm, 1.0))


def unstuck(scans: RigidScans, fit: Fit) -> Fit:
    """Return the fit after descents of single poses from farther away, and of all together, in turn.

    A scan's pose may rest where a corner is on the wrong side of a strip; one such scan keeps the outline wrong.
    """
    for _ in range(_ROUNDS if fit.basis is None else 0):
        poses, costs = best_of(*poses_around(scans, fit), 1)
        if not costs.sum() < fit.cost - 0.5:
            break
        new = settled(scans, fitted(scans, fit.corners, poses[:, 0], 15), 2)
        if not new.cost < fit.cost - 0.5:
            break
        fit = new
    return fit


def poses_around(scans: RigidScans, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return where descents of single poses end, from near and farther away (T, K, 3), and their costs (T, K)."""
    radius = float(np.hypot(*(fit.corners - fit.corners.mean(axis=0)).T).max())
    far = _AROUND * scans.sensor.pitch_mm * np.array([1.0, 1.0, 1.5 / radius])
    starts = fit.poses[:, None] + np.concatenate([jiggles(scans.sensor.pitch_mm), far])
    return fit_poses(scans, fit.corners, starts, loss(scans))


def recounted(scans: RigidScans, fit: Fit) -> tuple[Fit, list[Fit]]:
    """Return the fit with as many corners as the criterion wants, and the best of one corner fewer and of one more."""
    while True:
        other = [f for f in (_fewer(scans, fit), _more(scans, fit)) if f is not None]
        best = min(other, key=lambda f: f.criterion(scans), default=fit)
        if best.criterion(scans) >= fit.criterion(scans):
            return continued(scans, fit), other
        fit = best


def continued(scans: RigidScans, fit: Fit) -> Fit:
    """Return the fit with poses of which each has turned on least from the one before.

    A part of a turn brings a rectangle, and nearly a long hexagon, onto itself: which of these poses is a scan's, its
    readings hardly tell, but the scans beside it do. Not so of an object that lies anyhow from scan to scan.
    """
    angle = fit.poses[:, 2]
    steps = _within_half(np.diff(angle), 2.0 * np.pi)
    for order in _ORDERS if fit.basis is None and len(angle) > 1 else ():
        least = _within_half(steps, 2.0 * np.pi / order)
        jumps = int((np.abs(steps - least) > 0.1).sum())
        if not jumps or np.median(np.abs(least)) > _SMOOTH:
            continue
        own, poses = _centroid(fit.corners), fit.poses.copy()
        poses[:, 2] = angle[0] + np.concatenate([[0.0], np.cumsum(least)])
        poses[:, :2] += _turned(own, angle) - _turned(own, poses[:, 2])
        new = settled(scans, posed(scans, Fit(fit.corners, poses, fit.costs)))
        if new.cost < fit.cost + _JUMP * jumps:
            return new
    return fit


def _within_half(angle: FloatArray, period: float) -> FloatArray:
    """Return angles less whole periods, from minus half of one to half of one."""
    return np.asarray(angle - period * np.round(angle / period))


def _turned(point: FloatArray, angle: FloatArray) -> FloatArray:
    """Return a point (2,) turned by angles (T,) about the origin (T, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]], axis=1)


def _fewer(scans: RigidScans, fit: Fit) -> Fit | None:
    """Return the best fit of one corner fewer, without a corner or without an edge; None where all are sure."""
    if len(fit.corners) == FEWEST:
        return None
    unsure = not_sure(scans, fit, information(scans, fit.corners, fit.poses))
    tries = [without(scans, fit, int(i), 8) for i in unsure]
    for corners in edges_removed(fit.corners)[:_TRIED]:
        rough = fitted(scans, corners, fit.poses, 8, cauchy=8.0, basis=fit.basis)
        if rough.cost < fit.cost + _SURE * _price(scans):
            tries.append(rough)
    near = sorted(tries, key=lambda f: f.cost)[:_TRIED]
    ends = [settled(scans, fitted(scans, f.corners, f.poses, basis=f.basis)) for f in near]
    return unstuck(scans, min(ends, key=lambda f: f.cost)) if ends else None


def _more(scans: RigidScans, fit: Fit) -> Fit | None:
    """Return the best fit of one corner more, from all edges; of tied poses from all corners, each cut off."""
    if len(fit.corners) == MOST_CORNERS:
        return None
    starts = edges_bent(fit.corners) if fit.basis is None else corners_cut(fit.corners)
    tries = [fitted(scans, start, fit.poses, 15, basis=fit.basis) for start in starts]
    near = sorted(tries, key=lambda f: f.cost)[:_TRIED]
    return min((unstuck(scans, settled(scans, f, 2)) for f in near), key=lambda f: f.cost)


def edges_bent(corners: FloatArray) -> list[FloatArray]:
    """Return outlines with a corner more, a little outside of an edge, near the one and near the other end of it."""
    along = np.roll(corners, -1, axis=0) - corners
    x, y = corners.T
    outside = _BENT * np.sign((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    out = outside * np.stack([along[:, 1], -along[:, 0]], axis=1)
    return [
        np.insert(corners, i + 1, corners[i] + share * along[i] + out[i], axis=0)
        for i in range(len(corners))
        for share in _SHARES
    ]


def corners_cut(corners: FloatArray) -> list[FloatArray]:
    """Return outlines with an edge in place of a corner, of each by turns."""
    found = []
    for i, here in enumerate(corners):
        ends = here + _CUT * (corners[[i - 1, (i + 1) % len(corners)]] - here)
        found.append(np.concatenate([corners[:i], ends, corners[i + 1 :]]))
    return found


def edges_removed(corners: FloatArray) -> list[FloatArray]:
    """Return outlines without an edge, whose neighbours go on until they meet; those first that change least."""
    found: list[tuple[float, FloatArray]] = []
    for i in range(len(corners)):
        a, b, c, d = (corners[(i + k) % len(corners)] for k in (-1, 0, 1, 2))
        (p, q), (r, s), (u, v) = b - a, d - c, c - b
        cross = p * s - q * r
        on = (u * s - v * r) / cross if cross else np.inf  # of the edge before, beyond its end
        if 0.0 < on < _FAR:
            apex = b + on * (b - a)
            kept = np.delete(corners, (i + 1) % len(corners), axis=0)
            kept[min(i, len(kept) - 1)] = apex
            change = abs(u * (apex - b)[1] - v * (apex - b)[0])
            found.append((float(change), kept))
    return [kept for _, kept in sorted(found, key=lambda pair: pair[0])]


def explored(scans: RigidScans, fit: Fit) -> list[Fit]:
    """Return an outline's fits from beside it, where few strips read it: its cost has kinks, and other best fits.

    The best first, the fit or a better one; the others are ends of descents that stayed elsewhere. The outline is
    moved along what the readings tell least and, if it is concave (few scans read what lies deep in a notch), corners
    along their edges and edges across themselves, by little and by much; again from wherever that is better.
    """
    ends, soft = list[Fit](), 0.05 * scans.sensor.pitch_mm
    for _ in range(_EXPLORED):
        starts = _open_starts(scans, fit)
        if reflex(fit.corners).any():
            starts += _moved(fit.corners, scans)
        tries = [fitted(scans, start, fit.poses, 8, soft, 5.0, fit.basis) for start in starts]
        tries = [fitted(scans, f.corners, f.poses, 6, basis=fit.basis) for f in tries]
        near = [settled(scans, f, 2) for f in _unlike(sorted(tries, key=lambda f: f.cost), scans)]
        ends += near
        best = min(near, key=lambda f: f.cost)
        if not best.cost < fit.cost - 0.5:
            break
        ends.append(fit)
        fit = best
    return [fit, *sorted(ends, key=lambda f: f.cost)]


def _unlike(fits: list[Fit], scans: RigidScans) -> list[Fit]:
    """Return the first ones of fits, and of the others some that are unlike these."""
    kept = fits[:_BEST]
    for fit in fits[_BEST:]:
        if fit.cost > _HOPELESS * fits[0].cost or len(kept) == _SETTLED:
            break
        apart = [np.abs(fit.corners - k.corners).max() for k in kept]  # frames stay about where they are
        if min(apart) > 0.1 * scans.sensor.pitch_mm:
            kept.append(fit)
    return kept


def _moved(corners: FloatArray, scans: RigidScans) -> list[FloatArray]:
    """Return an outline with a corner moved along one of its edges, or an edge across itself, everywhere by turns."""
    after = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*after.T)
    along = after / np.maximum(length, 1e-9)[:, None]
    step = max(0.1 * scans.sensor.pitch_mm, 0.05 * float(np.ptp(corners, axis=0).max()))
    found = []
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        across = np.array([-along[i, 1], along[i, 0]])
        for by in (step, -step, _FAR * step, -_FAR * step):
            if abs(by) > 0.8 * length[i]:
                continue
            for at, direction in (([i], along[i]), ([j], along[i]), ([i, j], across)):
                moved = corners.copy()
                moved[at] += by * direction
                found.append(moved)
    return found


def _open_starts(scans: RigidScans, fit: Fit) -> list[FloatArray]:
    """Return a fit's outline moved by little and by much along what the readings tell least of it."""
    found = information(scans, fit.corners, fit.poses)
    return along_the_open(fit.corners, covariances(found, fit.corners, fit.poses, fit.basis)[0])


def along_the_open(corners: FloatArray, covariance: FloatArray) -> list[FloatArray]:
    """Return an outline moved by little and by much along what its covariance says is told least."""
    value, vector = np.linalg.eigh(covariance)
    farthest = _FARTHEST * float(np.ptp(corners, axis=0).max())
    return [
        corners + np.clip(by * np.sqrt(value[-i]), -farthest, farthest) * vector[:, -i].reshape(-1, 2)
        for i in range(1, min(_OPEN, len(value) - 3) + 1)
        for by in _DEVIATIONS
    ]


def edges_and_turns(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how long an outline's edges are, and by how much it turns at corners [rad], below 0 inwards (N,)."""
    edge = np.roll(corners, -1, axis=0) - corners
    heading = np.arctan2(edge[:, 1], edge[:, 0])
    x, y = corners.T
    way = np.sign((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    return np.hypot(*edge.T), way * _within_half(heading - np.roll(heading, 1), 2.0 * np.pi)


def reflex(corners: FloatArray) -> BoolArray:
    """Return which corners of an outline turn inwards (N,)."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    x, y = corners.T
    return np.asarray(np.sign((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) * turn < 0.0)


def not_sure(scans: RigidScans, fit: Fit, found: Equations) -> IntArray:
    """Return the corners that may gain too little in chi square: there is no need to try without the others.

    That is roughly their height over their neighbours, over sigma. The equations may have offsets of channels.
    """
    before, after = np.roll(fit.corners, 1, axis=0), np.roll(fit.corners, -1, axis=0)
    height = _areas(fit.corners) / np.maximum(np.hypot(*(after - before).T), 1e-9)
    covariance = covariances(found, fit.corners, fit.poses, fit.basis)[0]
    variance = covariance.diagonal().reshape(-1, 2).sum(axis=1)
    return np.flatnonzero(height**2 / np.maximum(variance, 1e-12) < _SURE * _price(scans))


def _price(scans: RigidScans) -> float:
    """Return what a corner costs by `Fit.criterion`."""
    return 2.0 * float(np.log(scans.readings.sum())) + PLACES


def poses_all_round(
    scans: RigidScans, corners: FloatArray, tolerance_mm: float, angles: int = _ANGLES, kept: int = _KEPT
) -> tuple[FloatArray, FloatArray]:
    """Return poses (T, kept, 3) of a known outline, the best first, where nothing is known of them, and their costs."""
    starts = starts_all_round(scans, corners, angles)
    poses, costs = fit_poses(scans, corners, starts, loss(scans, 2.0 * tolerance_mm, 3.0, 0.15), 5)
    poses = best_of(poses, costs, kept)[0]
    for tolerance, cauchy, steps in ((tolerance_mm, 5.0, 8), (0.0, 0.0, 12)):
        poses, costs = fit_poses(scans, corners, poses, loss(scans, tolerance, cauchy), steps)
    return best_of(poses, costs, kept)


def starts_all_round(scans: RigidScans, corners: FloatArray, angles: int) -> FloatArray:
    """Return poses (T, angles, 3) of an outline over the contact's middle, turned by even steps."""
    middle, _ = centres(scans)
    own = _centroid(corners)
    angle = np.asarray(np.arange(angles) * (2.0 * np.pi / angles), dtype=np.float64)
    starts = np.empty((len(middle), angles, 3))
    starts[..., :2], starts[..., 2] = middle[:, None] - _turned(own, angle), angle
    return starts


def bad_scans(scans: RigidScans, fit: Fit) -> IntArray:
    """Return the scans whose readings the fit does not explain."""
    return np.flatnonzero(~explained(fit.costs, scans.readings))


def explained(costs: FloatArray, readings: IntArray) -> BoolArray:
    """Return whether what scans cost (T,) is what as many readings (T,) may."""
    return np.asarray(costs <= readings + _SPREAD * np.sqrt(readings) + _BAD)


def rescued(scans: RigidScans, fit: Fit, rounds: int = 2) -> Fit:
    """Return the fit after a search all round for the poses of scans that it does not explain."""
    for _ in range(rounds if fit.basis is None else 0):
        bad = bad_scans(scans, fit)
        if not len(bad) or len(bad) > MOST_BAD * len(fit.poses):
            break
        poses, costs = poses_all_round(scans.of(bad), fit.corners, 0.05 * scans.sensor.pitch_mm)
        better = costs[:, 0] < fit.costs[bad]
        trial = fit.poses.copy()
        trial[bad[better]] = poses[better, 0]
        new = fitted(scans, fit.corners, trial, 10, cauchy=5.0)
        new = fitted(scans, new.corners, new.poses)
        if new.cost >= fit.cost - 1.0:
            break
        fit = new
    return fit


def faintest(corners: FloatArray) -> IntArray:
    """Return the corners that an outline would change least without."""
    return np.argsort(_areas(corners))[:_TRIED]


def without(scans: RigidScans, fit: Fit, corner: int, steps: int) -> Fit:
    """Return the fit without one of its corners, after some steps."""
    return fitted(
        scans, np.delete(fit.corners, corner, axis=0), fit.poses, steps, cauchy=8.0, basis=fit.basis
    )


def best_of(poses: FloatArray, costs: FloatArray, kept: int) -> tuple[FloatArray, FloatArray]:
    """Return the best of poses (T, K, 3) of each scan and their costs (T, K), the best first."""
    order = np.argsort(costs, axis=1, kind="stable")[:, :kept]
    rows = np.arange(len(poses))[:, None]
    return poses[rows, order], costs[rows, order]


def _areas(corners: FloatArray) -> FloatArray:
    """Return twice the area of every corner with its two neighbours (N,)."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return np.asarray(np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]))


def _centroid(corners: FloatArray) -> FloatArray:
    after = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]
    return np.asarray(((corners + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))

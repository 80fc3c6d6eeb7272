"""Discs, ellipses and rounded polygons in many scans: few numbers explain what no count of corners fits well."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import Loss
from tacstrip.core.rigid import LEAST, RigidScans, equations, fit_poses, loss, reduced
from tacstrip.geometry.moments import area, moments, principal_angle
from tacstrip.tracking.rigid.corners import FEWEST, PLACES, Fit, edges_removed, posed, reflex
from tacstrip.tracking.rigid.covariance import information, of_numbers
from tacstrip.tracking.rigid.found import within_noise
from tacstrip.tracking.rigid.offsets import Offsets, not_ruled_out, taken_off, with_offsets
from tacstrip.tracking.rigid.search import FEW_STRIPS
from tacstrip.tracking.rigid.smooth_path import centres
from tacstrip.tracking.rigid.turns import cost_at_all_angles

DISC, ELLIPSE, ROUNDED = "disc", "ellipse", "rounded"
_POINTS, _OF_ARCS = 60, 36  # that draw an oval, and all arcs together
_ANGLES = 6  # of half a turn, at which a scan's pose is looked for
_MOST_ROUNDED, _ROUND = 6, 0.1  # corners that are rounded; their radius at first, of the size
_STEPS, _DAMPING, _EASED, _HOPELESS = 25, 1e-3, 6.0, 1e6
# Of the larger half-axis, while it is only roughly known; what it then costs at most, of its readings.
_TOLERANCE, _CAUCHY, _ROUGHLY = 0.02, 3.0, 2.0
_PRICE = 4.0  # of the criterion: what an outline that is no polygon has to gain
_ENOUGH = 1e-4  # of the cost: a smaller gain ends a descent
_LOOKED_AT, _HOPE = 6, 4.0  # steps after which a descent goes on only below so many times its readings


@dataclass(frozen=True, eq=False)
class RigidCurve:
    """A curved outline, drawn by corners, and its poses.

    Attributes
    ----------
    kind
        "disc", "ellipse" or "rounded".
    numbers
        Its radius, its half-axes along x and y, or the radius and the centres of its arcs (P,) [mm].
    poses, costs
        Of every scan (T, 3) and (T,).
    """

    kind: str
    numbers: FloatArray
    poses: FloatArray
    costs: FloatArray

    @property
    def fit(self) -> Fit:
        """The drawn outline and its poses."""
        return Fit(_drawn(self.kind, self.numbers)[0], self.poses, self.costs)

    @property
    def angles(self) -> int:
        """Scans that have an angle: none of a disc has."""
        return 0 if self.kind == DISC else len(self.poses)

    @property
    def shape_numbers(self) -> int:
        """Numbers of its shape; moved and turned, arcs are the same."""
        return len(self.numbers) - (3 if self.kind == ROUNDED else 0)

    def price(self, scans: RigidScans) -> float:
        """Return what its numbers cost, as corners do in `Fit.criterion`."""
        places = PLACES * (len(self.numbers) // 2) if self.kind == ROUNDED else 0.0
        return (3.0 + self.shape_numbers) * math.log(scans.readings.sum()) + places

    def criterion(self, scans: RigidScans) -> float:
        """Return what those of one kind are compared by: `Fit.criterion`."""
        return float(self.costs.sum()) + self.price(scans)

    def evidence(self, scans: RigidScans, chosen: IntArray) -> float:
        """Return what it is compared by with others, of some of the scans that it is a fit of, whatever its angles."""
        fit = self.fit.of(chosen)
        return self.price(scans) + (fit.cost if self.kind == DISC else cost_at_all_angles(scans, fit))

    def freedom(self, scans: RigidScans) -> int:
        """Return the readings beyond the numbers fitted."""
        return max(int(scans.readings.sum()) - 2 * len(self.poses) - self.angles - self.shape_numbers, 1)

    def explains(self, scans: RigidScans, distribution: str) -> bool:
        """Whether it leaves no more of the readings than noise does."""
        return within_noise(self.costs, self.freedom(scans), distribution)

    def covariances(self, scans: RigidScans, offsets: Offsets | None) -> tuple[FloatArray, FloatArray]:
        """Return the covariances of the drawn corners (2 N, 2 N) [mm^2] and of the poses (T, 3, 3).

        `offsets`: that were taken off the channels; without, those that the readings do not rule out are allowed for.
        """
        fit, by = self.fit, _drawn(self.kind, self.numbers)[1]
        found = information(scans, fit.corners, self.poses)
        deviation = offsets.upper if offsets else not_ruled_out(scans, fit, by)
        if deviation:
            found = with_offsets(scans, fit, found, deviation)
        found = of_numbers(found, by)
        own, mixed = found.pose.copy(), found.mixed.copy()
        if self.kind == DISC:  # what tells an angle are the corners that draw it
            own[:, 2] = own[:, :, 2] = mixed[:, 2] = 0.0
        own[:, 2, 2] += 12.0 / math.pi**2  # of half a turn nothing is known before
        inverse = np.linalg.inv(own + LEAST * np.eye(3))  # a scan may tell nothing of x
        follow = inverse @ mixed
        known = found.shape - np.einsum("tip,tiq->pq", mixed, follow)
        value, vector = np.linalg.eigh(known)
        free = len(self.numbers) - self.shape_numbers  # moved and turned it is the same
        spread = vector[:, free:] / value[free:] @ vector[:, free:].T
        own_numbers = spread[: len(self.numbers), : len(self.numbers)]
        return by @ own_numbers @ by.T, inverse + follow @ spread @ follow.transpose(0, 2, 1)


def rigid_curve(
    scans: RigidScans, start: Fit, chosen: IntArray, distribution: str, offsets: Offsets | None = None
) -> RigidCurve | None:
    """Return the curved outline that explains the scans better than a polygon does; None where none does.

    A disc may leave more than noise where the polygon does not: its angles take noise up.

    Parameters
    ----------
    scans, start
        All of them, and the polygon that explains them best: its poses are about right.
    chosen
        Scans that the outline is fitted to (K,); the others have their poses fitted.
    distribution
        Of the readings' errors.
    offsets
        Of channels, that the polygon explains the readings with; the curved outline has none.
    """
    explained, few = within_noise(start.costs, start.freedom(scans), distribution), scans.of(chosen)
    tries = _rounded(scans, start, chosen)
    if len(start.corners) >= _MOST_ROUNDED or not explained:
        tries += _ovals(scans, start, chosen)
    good = [o for o in tries if o.explains(scans, distribution) or (explained and o.kind == DISC)]
    if explained and good:
        polygon = start.of(chosen)
        numbers = polygon.criterion(few) - polygon.cost + (offsets.cost if offsets else 0.0)
        most = cost_at_all_angles(taken_off(few, offsets), polygon) + numbers - _PRICE
    else:
        most = math.inf
    least, best = min(
        ((one.evidence(few, chosen), one) for one in good), key=lambda pair: pair[0], default=(most, None)
    )
    return best if least < most else None


def _rounded(scans: RigidScans, start: Fit, chosen: IntArray) -> list[RigidCurve]:
    """Return polygons of round corners, of ever fewer ones: a corner may stand for a part of an arc."""
    found, corners = list[RigidCurve](), start.corners
    few = len(scans.read) == 1 and scans.strips_touched < FEW_STRIPS  # a scan tells hardly more than a pose
    if few or reflex(corners).any():
        return found
    if area(corners) < 0.0:
        corners = corners[::-1]
    while True:
        if len(corners) <= _MOST_ROUNDED:
            radius = _ROUND * float(np.ptp(corners, axis=0).max())
            inner = shapely.Polygon(corners).buffer(-radius, join_style="mitre")
            ring = shapely.get_coordinates(inner)[:-1] if inner.geom_type == "Polygon" else corners[:0]
            if len(ring) == len(corners):
                centres_of_arcs = ring if area(ring) > 0.0 else ring[::-1]
                numbers = np.concatenate([[radius], centres_of_arcs.ravel()])
                one = _descended(scans, RigidCurve(ROUNDED, numbers, start.poses, start.costs), chosen)
                if one and one.numbers[0] > 0.0:
                    found.append(one)
                if found and (one is None or one.costs.sum() > _ROUGHLY * scans.readings.sum()):
                    return found
        if len(corners) == FEWEST:
            return found
        fewer = edges_removed(corners)
        if not fewer:
            return found
        corners = fewer[0]


def _ovals(scans: RigidScans, start: Fit, chosen: IntArray) -> list[RigidCurve]:
    """Return the ellipse and the disc that explain the scans best."""
    middle, half, angle = _as_ellipse(start.corners)
    cos, sin = np.cos(start.poses[:, 2]), np.sin(start.poses[:, 2])
    turned = np.stack([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1]], axis=1)
    poses = np.column_stack([start.poses[:, :2] + turned, start.poses[:, 2] + angle])
    ellipse = _descended(scans, RigidCurve(ELLIPSE, half, poses, start.costs), chosen)
    if ellipse is None:  # nor is it a disc
        return []
    radius = np.array([math.sqrt(half.prod())])
    disc = _descended(scans, RigidCurve(DISC, radius, ellipse.poses, start.costs), chosen)
    return [ellipse] if disc is None else [ellipse, disc]


def _descended(scans: RigidScans, one: RigidCurve, chosen: IntArray) -> RigidCurve | None:
    """Return where a descent of an outline and its poses ends, poses of an oval looked for at all angles.

    None of an oval that is far from the readings while only roughly known.
    """
    few, poses = scans.of(chosen), one.poses
    if one.kind != ROUNDED:
        soft = loss(scans, _TOLERANCE * float(one.numbers.max()), _CAUCHY)
        rough = _descent(few, replace(one, poses=poses[chosen]), soft)
        if rough.costs.sum() > _ROUGHLY * few.readings.sum():
            return None
        one = replace(one, numbers=rough.numbers)
        poses = _looked_for(scans, _drawn(one.kind, one.numbers)[0], poses, soft)
    numbers = _descent(few, replace(one, poses=poses[chosen]), loss(scans)).numbers
    corners = _drawn(one.kind, numbers)[0]
    settled = posed(scans, Fit(corners, poses, one.costs))
    return replace(one, numbers=numbers, poses=settled.poses, costs=settled.costs)


def _descent(scans: RigidScans, now: RigidCurve, how: Loss) -> RigidCurve:
    """Return where Levenberg and Marquardt's descent of numbers and poses ends."""
    damping, (corners, by) = _DAMPING, _drawn(now.kind, now.numbers)
    found = equations(scans, corners, now.poses, how)
    now = replace(now, costs=found.costs)
    for i in range(_STEPS):
        if i == _LOOKED_AT and now.costs.sum() > _HOPE * scans.readings.sum():
            break
        followed = of_numbers(found, by)
        matrix, slope, inverse = reduced(followed, damping, 0.0)
        step = np.linalg.solve(matrix, slope)
        turn = np.einsum("tpq,tq->tp", inverse, found.pose_slope - followed.mixed @ step)
        numbers, poses = now.numbers + step, now.poses + turn
        corners, trial_by = _drawn(now.kind, numbers)
        trial = equations(scans, corners, poses, how)
        gain = float(now.costs.sum() - trial.costs.sum())
        if gain > 0.0:
            now, found, by = replace(now, numbers=numbers, poses=poses, costs=trial.costs), trial, trial_by
            damping /= _EASED
            if gain < _ENOUGH * trial.costs.sum():
                break
        else:
            damping *= _EASED
            if damping > _HOPELESS:
                break
    return now


def _looked_for(scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss) -> FloatArray:
    """Return poses (T, 3) after descents from about them and from the contact's middle, at all angles."""
    starts = np.repeat(poses[:, None], 2 * _ANGLES, axis=1)
    starts[:, :, 2] += np.arange(2 * _ANGLES) * math.pi / _ANGLES
    starts[:, _ANGLES:, :2] = centres(scans)[0][:, None]
    tried, costs = fit_poses(scans, corners, starts, how)
    return np.asarray(tried[np.arange(len(poses)), costs.argmin(axis=1)])


def _drawn(kind: str, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the corners (N, 2) that draw an outline, and how their entries follow its numbers (2 N, P).

    An oval's hold its area. Arcs go from the normal of one straight edge to that of the next.
    """
    if kind == ROUNDED:
        arcs = numbers[1:].reshape(-1, 2)
        edge = np.roll(arcs, -1, axis=0) - arcs
        normal = np.arctan2(-edge[:, 0], edge[:, 1])
        first = np.roll(normal, 1)
        each = _OF_ARCS // len(arcs)
        turn = (normal - first) % (2.0 * np.pi)
        angle = np.asarray(first[:, None] + turn[:, None] * np.linspace(0.0, 1.0, each), dtype=np.float64)
        out = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 2)
        centre = np.kron(np.repeat(np.eye(len(arcs)), each, axis=0), np.eye(2))
        by = np.column_stack([out.ravel(), centre])
    else:
        step = 2.0 * math.pi / _POINTS
        angle = np.asarray(step * np.arange(_POINTS), dtype=np.float64)
        weight = math.sqrt(step / math.sin(step)) * np.column_stack([np.cos(angle), np.sin(angle)])
        by = np.zeros((2 * _POINTS, len(numbers)))
        by[np.arange(2 * _POINTS), np.arange(2 * _POINTS) % len(numbers)] = weight.ravel()
    return (by @ numbers).reshape(-1, 2), by


def _as_ellipse(corners: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return centroid, half-axes (2,) and angle of the ellipse with the moments of an outline (N, 2)."""
    size, middle, second = moments(corners)
    xx, yy, xy = about = second / size
    squares = np.linalg.eigvalsh(np.array([[xx, xy], [xy, yy]]))[::-1]
    return middle, 2.0 * np.sqrt(np.maximum(squares, 1e-9)), principal_angle(about)

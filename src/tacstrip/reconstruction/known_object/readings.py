"""What strips read of a known outline at many poses at once, and descents (Levenberg-Marquardt) from these.

A strip reads the hull of the outline on its centre line: the least l and the greatest u, so that the outline may be
concave. As in the polygon fit, the strips that are touched tell both ends' x with a variance of pitch^2 / 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.contact.slant import edge_read
from tacstrip.errors import ContactError
from tacstrip.reconstruction.noise_covariance import signature_jacobians
from tacstrip.reconstruction.strip_width import across
from tacstrip.sensor.spec import Sensor

STARTS = 48  # angles
_TURNS, _TURNED = 12, 2  # turns by which an outline is compared with itself; poses that are tried turned
GUESS = 0.005  # of Vref: noise of a search where none is given
_COARSE_STRIPS = 60  # of the search; the poses found are refined on all strips
_NEAR = 4.0  # spreads within which two descents ended in one pose
_SETTLED, _SETTLED_SHARE = 1e-3, 1e-4  # gain in chi square that ends a descent, and of what it has left
_PROMISE = 4.0  # times what a descent's step would gain: no worse than this it may end
_RAIL = 0.05  # of Vref: nearer to ground or Vref the contact may lie over the border
_PARTLY = 0.1  # of the width: how far off a strip is modelled that a corner or a steep edge lies on
# Where x's deviation is so many times less than half a pitch, places on either side and descents there; moments so
# many times the variance count.
_FURTHER, _PLACES, _PLACE_STEPS, _WIDER = 4.0, 16, 4, 2.0
_LEAST_NOISE = 2e-4  # of Vref: sensors that read better are compared with that


def corners_of(outline: npt.ArrayLike | Contact) -> FloatArray:
    """Return the corners (N, 2) [mm] about their centroid, counter-clockwise."""
    if isinstance(outline, Contact) and [s.geom_type for s in outline.shapes] != ["Polygon"]:
        raise ContactError(f"a known object's outline must be one polygon, and not {outline!r:.200}")
    try:
        given = outline.vertices if isinstance(outline, Contact) else np.asarray(outline, dtype=float)
    except (TypeError, ValueError):
        raise ContactError(
            "a known object's outline needs corners (x, y), such as [(0, 0), (50, 0), (30, 40)], or a ts.Contact"
        ) from None
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < 3 or not np.isfinite(given).all():
        raise ContactError("a known object's outline needs three or more finite corners (x, y)")
    shape = shapely.Polygon(given)
    if not shape.is_valid or shape.area <= 0.0:
        raise ContactError("a known object's outline must be one polygon with an area, and not cross itself")
    ring = shapely.get_coordinates(shapely.remove_repeated_points(shapely.geometry.polygon.orient(shape)))[
        :-1
    ]
    return np.asarray(ring - shapely.get_coordinates(shape.centroid))


def posed_at(corners: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the corners (B, N, 2) [mm] at poses x, y, angle, growth (B, 4)."""
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x, y = corners.T
    return np.stack([cos * x - sin * y + poses[:, :1], sin * x + cos * y + poses[:, 1:2]], axis=-1)


@dataclass(frozen=True, eq=False)
class PoseFit:
    """One contact's readings k (S, n) and their weights 1 / sigma (S, n), 0 where there is none, and what is fitted."""

    sensor: Sensor
    corners: FloatArray
    run: slice
    x_mm: FloatArray
    names: tuple[str, ...]
    k: FloatArray
    weight: FloatArray
    edge_mm: float
    silent: BoolArray  # strips that are left out (strips of the sensor,)
    wide: bool = False  # whether strips read over their width, or on their centre lines
    log_size: float = (
        0.0  # standard deviation of the logarithm of how many times as large it is; edges are hard then
    )

    @property
    def parameters(self) -> int:
        """x, y, angle, and with soft edges the outline's growth, or the logarithm of its size."""
        return 4 if self.edge_mm or self.log_size else 3

    def posed(self, poses: FloatArray) -> FloatArray:
        """Return the corners (B, N, 2) [mm] at poses x, y, angle, growth or size (B, 4)."""
        posed = posed_at(self.corners, poses)
        if not self.log_size:
            return posed
        about = poses[:, None, :2]
        return np.asarray(about + np.exp(poses[:, 3])[:, None, None] * (posed - about))

    def ends(self, poses: FloatArray) -> tuple[FloatArray, ...]:
        """Return l and u (B, n) [mm], their slopes by the pose (B, n, 4), and the corners (B, N, 2)."""
        posed = self.posed(poses)
        lines = across(self.sensor, self.x_mm) if self.wide else self.x_mm[:, None]
        every = lines.ravel()
        ax, ay = posed[..., 0, None], posed[..., 1, None]  # (B, N, 1)
        bx, by = (np.concatenate([v[:, 1:], v[:, :1]], axis=1) for v in (ax, ay))
        low, high = ax.min(axis=1), ax.max(axis=1)
        slack = 1e-9 * (high - low)
        x = np.clip(every, low + slack, high - slack)  # (B, lines): beside the outline its end corner is read
        there = (x == every).reshape(len(poses), *lines.shape)
        there |= ~there.any(axis=-1, keepdims=True)
        off = x[:, None] - ax  # (B, N, lines)
        missed = off * (x[:, None] - bx) > 0.0
        steep = (by - ay) / np.where(np.abs(bx - ax) < 1e-12, 1e-12, bx - ax)
        y, steep = ay + steep * off, steep[..., 0]
        pose, line = np.arange(len(poses))[:, None], np.arange(len(every))
        found: list[FloatArray] = []
        slopes: list[FloatArray] = []
        for sign in (1.0, -1.0):
            edge = np.where(missed, np.inf, sign * y).argmin(axis=1)
            at = y[pose, edge, line]
            slope = np.where(x == every, steep[pose, edge], 0.0)
            out = np.hypot(1.0, slope)
            growth, further = sign * poses[:, 3:] * out, -sign * out
            if self.log_size:
                growth, further = 0.0 * growth, at - poses[:, 1:2] - slope * (x - poses[:, :1])
            turned = x - poses[:, :1] + slope * (at - poses[:, 1:2] - growth)
            by_pose = np.stack([-slope, np.ones_like(slope), turned, further], axis=-1)
            grown, by_pose = self._over_the_width(at - growth, by_pose, there, -sign)
            held = np.clip(grown, 0.0, self.sensor.length_mm)
            found.append(held)
            slopes.append(by_pose * (held == grown)[..., None])
        found[1] = np.maximum(found[0], found[1])
        return found[0], found[1], slopes[0], slopes[1], posed

    def _over_the_width(
        self, height: FloatArray, slopes: FloatArray, there: BoolArray, sign: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what strips read of an edge on their lines (B, n * lines), (B, n), and its slopes (B, n, 4)."""
        if there.shape[-1] == 1:
            return height, slopes
        height = np.where(there, height.reshape(there.shape), np.nan)
        mean = (slopes.reshape(*there.shape, 4) * there[..., None]).sum(axis=2) / there.sum(axis=-1)[
            ..., None
        ]
        read = edge_read(height, self.sensor.strip_width, sign, self.sensor.contact_lambda_mm)
        return np.where(np.isfinite(read), read, np.nanmean(height, axis=-1)), mean

    def rows(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals over their sigma (B, M) and the model's slopes by the pose (B, M, 4)."""
        l, u, l_slope, u_slope, posed = self.ends(poses)
        with np.errstate(invalid="ignore", divide="ignore"):
            read = signatures(self.sensor, l, u)
            jacobians = signature_jacobians(self.sensor, l, u, read)
        residuals, slopes = [], []
        for row, name in enumerate(self.names):
            by_l, by_u = jacobians[name]
            weight = np.where(self.weight[row] > 0.0, self.weight[row], 0.0)
            with np.errstate(invalid="ignore"):
                off = np.where(weight > 0.0, self.k[row] - read[name], 0.0)
                slope = by_l[..., None] * l_slope + by_u[..., None] * u_slope
            residuals.append(_finite(off * weight, 1e3))
            slopes.append(_finite(slope * weight[:, None]))
        for end, gap in enumerate(self.gaps):
            if gap < math.inf:
                off, slope = self._end(posed, poses, end)
                residuals.append(off)
                slopes.append(slope)
        if prior := self.edge_mm or self.log_size:
            residuals.append(-poses[:, 3:] / prior)
            slopes.append(np.broadcast_to([0.0, 0.0, 0.0, 1.0 / prior], (len(poses), 1, 4)))
        return np.concatenate(residuals, axis=1), np.concatenate(slopes, axis=1)

    @cached_property
    def gaps(self) -> tuple[float, float]:
        """How far beyond the run's first and last strip the next one lies that is read, and not touched [mm].

        Infinite at the sensor's border.
        """
        after = np.flatnonzero(~self.silent[self.run.stop :])
        before = np.flatnonzero(~self.silent[: self.run.start][::-1])
        left, right = (float(at[0] + 1) if len(at) else math.inf for at in (before, after))
        return left * self.sensor.pitch_mm, right * self.sensor.pitch_mm

    @property
    def _half_width(self) -> float:
        """How far inside a strip's border its centre line lies: wide strips are touched up to there [mm]."""
        return 0.0 if self.sensor.strip_width_mm is None else 0.5 * self.sensor.strip_width

    def _end(self, posed: FloatArray, poses: FloatArray, end: int) -> tuple[FloatArray, FloatArray]:
        sign = 1.0 if end else -1.0
        gap = self.gaps[end]
        corner = (sign * posed[..., 0]).argmax(axis=1)
        x, y = posed[np.arange(len(posed)), corner].T
        beyond = 0.5 * gap - self._half_width
        expected = self.sensor.x_mm[self.run.stop - 1 if end else self.run.start] + sign * beyond
        weight = math.sqrt(12.0 / (gap**2 + 12.0 * self.edge_mm**2))
        one, zero = np.ones_like(x), np.zeros_like(x)
        growth, further = (0.0, x - poses[:, 0]) if self.log_size else (poses[:, 3], sign * one)
        slope = np.stack([one, zero, poses[:, 1] - y, further], axis=-1)
        off = expected - x - sign * growth
        return off[:, None] * weight, slope[:, None] * weight

    def descend(self, poses: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
        """Return where descents from poses (B, 4) end, and their costs (B,)."""
        p = self.parameters
        ended, least = poses.copy(), np.full(len(poses), np.inf)
        going, poses = np.arange(len(poses)), poses.copy()
        residual, slope = self.rows(poses)
        cost, damping = (residual**2).sum(axis=1), np.full(len(poses), 1e-3)
        for _ in range(steps):
            j = slope[..., :p]
            normal, gradient = np.einsum("bmi,bmj->bij", j, j), np.einsum("bmi,bm->bi", j, residual)
            size = np.einsum("bii->bi", normal)
            ridge = damping[:, None] * size + 1e-12 * (1.0 + size.max(axis=1))[:, None]
            normal[:, range(p), range(p)] += ridge
            step = np.linalg.solve(normal, gradient[..., None])[..., 0]
            promised = (step * (gradient + ridge * step)).sum(axis=1)  # the gain, were readings linear
            trial = poses.copy()
            trial[:, :p] += step
            new_residual, new_slope = self.rows(trial)
            new = (new_residual**2).sum(axis=1)
            better = new < cost
            poses[better], cost[better] = trial[better], new[better]
            residual[better], slope[better] = new_residual[better], new_slope[better]
            damping = np.clip(np.where(better, 0.2 * damping, 6.0 * damping), 1e-9, 1e9)
            ended[going], least[going] = poses, cost
            on = promised > np.maximum(_SETTLED, _SETTLED_SHARE * cost)
            on &= better | (damping <= 1e4)
            if not (on & (cost - _PROMISE * promised <= worth(least))).any():
                break
            if not on.all():
                going, poses, cost, damping = going[on], poses[on], cost[on], damping[on]
                residual, slope = residual[on], slope[on]
        return ended, least

    def covariance(self, pose: FloatArray) -> FloatArray:
        """Return the covariance (P, P) of a pose (4,)."""
        return np.asarray(self.covariances(pose[None])[0])

    def covariances(self, poses: FloatArray) -> FloatArray:
        """Return the covariances (B, P, P) of poses (B, 4)."""
        j = self.rows(poses)[1][..., : self.parameters]
        return np.asarray(np.linalg.pinv(j.swapaxes(1, 2) @ j, rcond=1e-13, hermitian=True))

    def starts(self) -> FloatArray:
        """Return poses (B, 4) to begin with: angles all round, x by the touched strips, y by the mean reading."""
        angle = np.arange(STARTS) * (2.0 * np.pi / STARTS)
        poses = np.zeros((STARTS, 4))
        poses[:, 2] = angle
        posed = posed_at(self.corners, poses)
        low, high = posed[..., 0].min(axis=1), posed[..., 0].max(axis=1)
        known = self.gaps[0] < math.inf, self.gaps[1] < math.inf
        before, beyond = (
            0.5 * (gap if gap < math.inf else self.sensor.pitch_mm) - self._half_width for gap in self.gaps
        )
        x = self.sensor.x_mm
        left, right = x[self.run.start] - before - low, x[self.run.stop - 1] + beyond - high
        by_end = {(True, False): [left], (False, True): [right], (True, True): [0.5 * (left + right)]}
        places = by_end.get(known, [left, 0.5 * (left + right), right])
        used = self.weight > 0.0
        middle = float(self.k[used].mean()) * self.sensor.length_mm
        rails = self.k[used].min() < _RAIL or self.k[used].max() > 1.0 - _RAIL
        border = len(self.names) == 1 or rails  # over the bottom or top only what lies on the strips is read
        half_height = 0.5 * np.ptp(posed[..., 1], axis=1)
        made = []
        for place in places:
            for shift in (-0.5, 0.0, 0.5) if border else (0.0,):
                poses[:, 0], poses[:, 1] = place, middle + shift * half_height
                made.append(poses.copy())
        return np.concatenate(made)

    def thinned(self) -> PoseFit:
        """Return the fit on the centre lines of some of many strips, each for its neighbours."""
        stride = -(-len(self.x_mm) // _COARSE_STRIPS)
        if stride == 1:
            return replace(self, wide=False)
        kept = slice(stride // 2, None, stride)
        weight = self.weight[:, kept] * math.sqrt(stride)
        return replace(self, x_mm=self.x_mm[kept], k=self.k[:, kept], weight=weight, wide=False)

    def with_sigma(self, sigma: float, pose: FloatArray | None = None) -> PoseFit:
        """Return the fit with a reading's sigma [Vref], and with what soft edges add to it at a pose (4,)."""
        covered = _PARTLY * self.sensor.strip_width / self.sensor.length_mm if self.wide else 0.0
        variance = np.full(self.k.shape, sigma**2 + covered**2)
        if pose is not None and self.edge_mm:
            l, u = (end[0] for end in self.ends(pose[None])[:2])
            of = signature_jacobians(self.sensor, l, u)
            added = [(of[n][0] ** 2 + of[n][1] ** 2) * self.edge_mm**2 for n in self.names]
            variance = variance + np.nan_to_num(np.stack(added))
        return replace(self, weight=np.where(self.weight > 0.0, 1.0 / np.sqrt(variance), 0.0))


def _finite(values: FloatArray, nan: float = 0.0) -> FloatArray:
    return values if np.isfinite(values).all() else np.nan_to_num(values, nan=nan)


def readings_left(fit: PoseFit, pose: FloatArray) -> FloatArray:
    """Return the readings' residuals over sigma (S, n), 0 where there is none."""
    return np.asarray(fit.rows(pose[None])[0][0, : fit.k.size].reshape(fit.k.shape))


def noise_left(fit: PoseFit, pose: FloatArray) -> float:
    """Return the standard deviation [Vref] of what a pose leaves over."""
    used = fit.weight > 0.0
    left = readings_left(fit, pose)[used] / fit.weight[used]
    return math.sqrt(float((left**2).sum()) / max(freedom_of(fit), 1))


def worth(cost: FloatArray) -> float:
    """Return the cost up to which poses are kept, of what descents cost (B,)."""
    return float(cost.min() + max(25.0, 0.5 * cost.min()))


def distinct(fit: PoseFit, poses: FloatArray, cost: FloatArray) -> FloatArray:
    """Return the different poses (M, 4) among those where descents ended, the best first; poor ones are left out."""
    kept: list[FloatArray] = []
    size = float(np.linalg.norm(fit.corners, axis=1).max())
    units = np.array([size, size, 1.0])
    poses = poses[np.argsort(cost, kind="stable")][: np.sum(cost <= worth(cost))]
    own = np.sqrt(np.maximum(np.einsum("bii->bi", fit.covariances(poses))[:, :3], 0.0))
    for pose, near in zip(poses, np.minimum(_NEAR * own, 0.1 * units) + 1e-3 * units, strict=True):
        if len(kept) < STARTS and not any((np.abs(_difference(pose, other)) <= near).all() for other in kept):
            kept.append(pose)
    return np.array(kept)


def across_upright_edges(fit: PoseFit, pose: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance (P, P) of a pose (4,), or its second moments where x may lie much further off than it says.

    Where a strip grazes an upright edge the slope by x is steep on one side only: off it x may be anything up to the
    next strip. So the other numbers are fitted at places in x up to half a pitch off, and the posterior is summed up.
    """
    p, deviation = fit.parameters, math.sqrt(covariance[0, 0])
    far = 0.5 * fit.sensor.pitch_mm
    if not 0.0 < _FURTHER * deviation < far:
        return covariance
    off = np.geomspace(0.25 * deviation, far, _PLACES)
    off = np.concatenate([-off[::-1], [0.0], off])
    poses = pose + np.outer(off, [1.0, 0.0, 0.0, 0.0])
    for step in range(_PLACE_STEPS + 1):
        residual, slope = fit.rows(poses)
        others = slope[..., 1:p]
        normal = np.einsum("bmi,bmj->bij", others, others)
        normal += 1e-12 * np.einsum("bii->b", normal)[:, None, None] * np.eye(p - 1)
        if step < _PLACE_STEPS:
            gradient = np.einsum("bmi,bm->bi", others, residual)
            poses[:, 1:p] += np.linalg.solve(normal, gradient[..., None])[..., 0]
    log_weight = -0.5 * ((residual**2).sum(axis=1) + np.linalg.slogdet(normal)[1])
    weight = np.exp(log_weight - log_weight.max()) * np.gradient(off)
    weight /= weight.sum()
    away = (poses - pose)[:, :p]
    moments = np.einsum("b,bi,bj->ij", weight, away, away)
    moments[1:, 1:] += np.einsum("b,bij->ij", weight, np.linalg.inv(normal))
    return np.asarray(moments) if moments[0, 0] > _WIDER * covariance[0, 0] else covariance


def turned_alike(fit: PoseFit, poses: FloatArray) -> FloatArray:
    """Return the first of poses (B, 4), turned by half a circle and where the outline is most like itself.

    They lie in the same box. Of two such poses that read nearly alike descents from all round may find one only.
    """
    turns = np.zeros((_TURNS, 4))
    turns[:, 2] = np.arange(1, _TURNS + 1) * (
        np.pi / _TURNS
    )  # the other way round it overlaps itself as much
    one, others = shapely.Polygon(fit.corners), shapely.polygons(posed_at(fit.corners, turns))
    common = shapely.area(shapely.intersection(one, others))
    peak = common[1:-1] >= np.maximum(common[:-2], common[2:])
    angle = turns[1:-1, 2][peak]
    angle = np.concatenate([angle, -angle, [np.pi]])
    poses = np.repeat(poses[:_TURNED], len(angle), axis=0)
    found = poses.copy()
    found[:, 2] += np.resize(angle, len(found))
    before, after = (posed_at(fit.corners, p) for p in (poses, found))
    found[:, :2] += 0.5 * (before.min(axis=1) + before.max(axis=1) - after.min(axis=1) - after.max(axis=1))
    return found


def from_beside(fit: PoseFit, poses: FloatArray, steps: int) -> FloatArray:
    """Return the poses (M, 4) where descents from half a pitch to either side of poses (B, 4) end, the best first.

    An upright edge may keep descents on the wrong side of a strip.
    """
    shifts = np.outer(np.linspace(-0.5, 0.5, 11) * fit.sensor.pitch_mm, [1.0, 0.0, 0.0, 0.0])
    return distinct(fit, *fit.descend((poses + shifts[:, None]).reshape(-1, 4), steps))


def _difference(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array([a[0] - b[0], a[1] - b[1], math.remainder(a[2] - b[2], 2.0 * math.pi)])


def cost_of(fit: PoseFit, pose: FloatArray) -> float:
    """Return the squares that a pose (4,) leaves, over their variances."""
    return float((fit.rows(pose[None])[0] ** 2).sum())


def least_noise(sensor: Sensor) -> float:
    """Return the least standard deviation [Vref] that noise which nobody knows is taken to have."""
    return max(_LEAST_NOISE, sensor.adc_step / math.sqrt(12.0))


def least_cost(fit: PoseFit) -> float:
    """Return the squares that the least noise leaves."""
    return least_noise(fit.sensor) ** 2 * float((fit.weight**2).sum())


def freedom_of(fit: PoseFit) -> int:
    """Return readings beyond the numbers fitted; what touched strips tell of the ends counts for one number."""
    return int(np.count_nonzero(fit.weight)) - 3 + int(min(fit.gaps) < math.inf)

"""The pose of a known rigid outline: x, y and angle from all strips, with covariance and the poses that remain.

A strip reads the hull of the outline on its centre line: the least l and the greatest u, so that the outline may be
concave. Descents (Levenberg-Marquardt, all at once) begin at angles all round; what they end in are the poses that the
readings leave, weighed by their posterior (Laplace). As in the polygon fit, the strips that are touched tell both ends'
x with a variance of pitch^2 / 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.core.problem import FLOOR
from tacstrip.errors import ContactError, OptionError
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    CorrelatedErrors,
    correlated,
    fit_sigma,
    reading_covariance,
    signature_advice,
    signature_jacobians,
)
from tacstrip.reconstruction.on_surface import refuse_stretched
from tacstrip.reconstruction.polygon.goodness_of_fit import autocorrelation_score, chi_square_score
from tacstrip.reconstruction.polygon.run import fit_run
from tacstrip.reconstruction.result import Alternative, Pose, Reconstruction, RecoveredObject, Status
from tacstrip.reconstruction.seam import unrolled
from tacstrip.reconstruction.strip_width import PARTIAL_STRIPS, across
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.slant import edge_read
from tacstrip.sensor.spec import Sensor

_STARTS = 48  # angles
_COARSE_STRIPS = 60  # of the search; the poses found are refined on all strips
_STEPS, _FINE_STEPS = 30, 20  # of the descents
_SETTLED = 1e-3  # gain in chi square that ends a descent
_BRIDGED = 3  # strips that may be missing inside a contact
_ALARM = 3.5  # standard deviations of a test's statistic
_UNLIKELY = 1e-3  # weight below which an alternative is not named
_OVERLAP, _PROBABLE = 0.8, 0.9  # IoU with the truth that "ok" promises, and its least probability
_DRAWS = 64  # of the posterior, for that probability
_NEAR = 4.0  # spreads within which two descents ended in one pose
# Of Vref: sigma of noise of 2 %, and its estimate's error; what fits worse is another object.
_CEILING = 0.014
_FEWEST_READINGS = 6  # of one signature, below which ...
# ... or above which level (P.U. profile I, estimated) [Vref] another object may explain it.
_PLAUSIBLE = 0.0035
_RAIL = 0.05  # of Vref: nearer to ground or Vref the contact may lie over the border
_GUESS = 0.005  # of Vref: noise of the search where none is given
_CHANCE, _LEAST_FREEDOM = 1e-3, 3  # of the F test, and of a polygon that it is made with
_LEAST_NOISE = 2e-4  # of Vref: sensors that read better are compared with that
_WIDTH_READ = 0.2  # of the width: by how much wide strips read other than their centre lines
_NEIGHBOURS = 0.4  # correlation of soft edges' errors on neighbouring strips, measured on pressed rubber
_PARTLY = 0.1  # of the width: how far off a strip is modelled that a corner or a steep edge lies on
_ENOUGH = 4  # wide strips: of fewer none is left out
_SUSPECTS = 8  # readings that are left out by turns where no pose explains all


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def fit_object(
    scan: Scan,
    sensor: Sensor,
    outline: npt.ArrayLike | Contact,
    noise: Noise | None = None,
    *,
    edge_mm: float = 0.0,
) -> Reconstruction:
    """Find where a known rigid object lies: the pose of its outline, with covariance.

    Parameters
    ----------
    scan, sensor
        What was measured, with what; both signatures or one. Where the spec gives `strip_width_mm`, strips read over
        it, roughly where a corner lies on them: "likely" at best.
    outline
        The object's corners (N, 2) [mm] in a frame of its own, convex or concave, either way round; or a contact of
        one polygon. It is turned and moved, not mirrored.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fit leaves over. Parts that
        strips share or that last are in the covariance.
    edge_mm
        Standard deviation of where soft edges end [mm]: of the whole outline's growth, which is fitted along, and of
        every end. 0: hard edges. With a noise given, ends of neighbouring strips err alike: over its
        `edge_correlation_mm`, or with a correlation of .4.

    Returns
    -------
    Reconstruction
        An object per contact, with the posed outline as vertices, its covariance, `pose`, and `poses`: others that
        the readings leave, each with its weight. "doubtful": the outline overlaps the truth by IoU .8 or more with a
        probability below 90 %, or no pose explains the readings, as where it is another object.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, or the construction has no closed form.
    ContactError
        The outline is no polygon with an area.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(0, 0), (50, 0), (30, 40)])
    >>> pressed = shape.turned(0.4).placed(50, 45)
    >>> found = ts.fit_object(ts.simulate(sensor, pressed), sensor, shape).objects[0]
    >>> [round(v, 2) for v in (found.pose.x_mm, found.pose.y_mm, found.pose.angle)]
    [50.0, 45.0, 0.4]
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "fit_object")
    refuse_stretched(sensor, "fit_object")
    if not isinstance(edge_mm, int | float | np.number) or not 0.0 <= edge_mm < math.inf:
        raise OptionError(f"edge_mm = {edge_mm!r}: must be 0 (hard edges) or more")
    corners = _corners(outline)
    reach = 2.0 * float(np.linalg.norm(corners, axis=1).max())
    runs: list[slice] = []
    laid_out, surface = unrolled(scan, sensor, _BRIDGED)
    silent = np.resize(left_out_wholly(sensor), surface.strips)  # of a closed tube, in both rounds
    for run in laid_out.runs():
        between = silent[runs[-1].stop : run.start] if runs else silent[:0]
        joint = runs and (len(between) <= _BRIDGED or between.all())
        if joint and (run.stop - runs[-1].start - 1) * sensor.pitch_mm <= reach:
            run = slice(runs.pop().start, run.stop)
        runs.append(run)
    noise = sensor.noise if noise is None else noise
    objects = tuple(
        _placed(laid_out.read_on(run), surface, corners, run, silent, noise, edge_mm, sensor.strips)
        for run in runs
    )
    return doubt_implausible(Reconstruction("object", objects, scan.time_s), scan, sensor)


def pose_covariance(
    sensor: Sensor, outline: npt.ArrayLike | Contact, pose: tuple[float, float, float], sigma: float
) -> FloatArray:
    """Return the Cramer-Rao bound (3, 3) of x [mm], y [mm] and angle [rad] of an outline at a pose.

    `sigma` [Vref] is a reading's standard deviation; the touched strips tell both ends as in `vertex_covariance`.
    """
    corners = _corners(outline)
    at = np.array([[*pose, 0.0]])
    x = _posed(corners, at)[0, :, 0]
    strips = np.flatnonzero((sensor.x_mm >= x.min()) & (sensor.x_mm <= x.max()))
    if not len(strips):
        raise ContactError("the outline touches no strip at this pose")
    run = slice(int(strips[0]), int(strips[-1]) + 1)
    none = np.zeros((len(sensor.signatures), len(strips)))
    fit = _Fit(
        sensor, corners, run, sensor.x_mm[run], sensor.signatures, none, np.full_like(none, 1.0 / sigma), 0.0,
        left_out_wholly(sensor),
    )  # fmt: skip
    jacobian = fit.rows(at)[1][0, :, :3]
    return np.asarray(np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-13, hermitian=True))


def _corners(outline: npt.ArrayLike | Contact) -> FloatArray:
    """Return the corners (N, 2) [mm] about their centroid, counter-clockwise."""
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
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(shape))[:-1]
    return np.asarray(ring - shapely.get_coordinates(shape.centroid))


def _posed(corners: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the corners (B, N, 2) [mm] at poses x, y, angle, growth (B, 4)."""
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x, y = corners.T
    return np.stack([cos * x - sin * y + poses[:, :1], sin * x + cos * y + poses[:, 1:2]], axis=-1)


@dataclass(frozen=True, eq=False)
class _Fit:
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

    @property
    def parameters(self) -> int:
        """x, y, angle, and with soft edges the outline's growth."""
        return 4 if self.edge_mm else 3

    def ends(self, poses: FloatArray) -> tuple[FloatArray, ...]:
        """Return l and u (B, n) [mm], their slopes by the pose (B, n, 4), and the corners (B, N, 2)."""
        posed = _posed(self.corners, poses)
        lines = across(self.sensor, self.x_mm) if self.wide else self.x_mm[:, None]
        every = lines.ravel()
        ax, ay = posed[..., 0, None], posed[..., 1, None]  # (B, N, 1)
        bx, by = np.roll(ax, -1, axis=1), np.roll(ay, -1, axis=1)
        low, high = ax.min(axis=1), ax.max(axis=1)
        slack = 1e-9 * (high - low)
        x = np.clip(every, low + slack, high - slack)  # (B, lines): beside the outline its end corner is read
        there = (x == every).reshape(len(poses), *lines.shape)
        there |= ~there.any(axis=-1, keepdims=True)
        run = np.where(np.abs(bx - ax) < 1e-12, 1e-12, bx - ax)
        share = (x[:, None] - ax) / run  # (B, N, lines)
        crossed = (share >= 0.0) & (share <= 1.0)
        y = ay + share * (by - ay)
        found: list[FloatArray] = []
        slopes: list[FloatArray] = []
        for sign in (1.0, -1.0):
            edge = np.where(crossed, sign * y, np.inf).argmin(axis=1)[:, None]
            at = np.take_along_axis(y, edge, axis=1)[:, 0]
            slope = np.take_along_axis((by - ay) / run, edge, axis=1)[:, 0]
            slope = np.where(x == every, slope, 0.0)
            out = np.hypot(1.0, slope)
            growth = sign * poses[:, 3:] * out
            turned = x - poses[:, :1] + slope * (at - poses[:, 1:2] - growth)
            by_pose = np.stack([-slope, np.ones_like(slope), turned, -sign * out], axis=-1)
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
            read, jacobians = signatures(self.sensor, l, u), signature_jacobians(self.sensor, l, u)
        residuals, slopes = [], []
        for row, name in enumerate(self.names):
            by_l, by_u = jacobians[name]
            weight = np.where(self.weight[row] > 0.0, self.weight[row], 0.0)
            with np.errstate(invalid="ignore"):
                off = np.where(weight > 0.0, self.k[row] - read[name], 0.0)
                slope = by_l[..., None] * l_slope + by_u[..., None] * u_slope
            residuals.append(np.nan_to_num(off * weight, nan=1e3))
            slopes.append(np.nan_to_num(slope * weight[:, None]))
        for end, gap in enumerate(self.gaps):
            if gap < math.inf:
                off, slope = self._end(posed, poses, end)
                residuals.append(off)
                slopes.append(slope)
        if self.edge_mm:
            residuals.append(-poses[:, 3:] / self.edge_mm)
            slopes.append(np.broadcast_to([0.0, 0.0, 0.0, 1.0 / self.edge_mm], (len(poses), 1, 4)))
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
        x, y = np.take_along_axis(posed, corner[:, None, None], axis=1)[:, 0].T
        beyond = 0.5 * gap - self._half_width
        expected = self.sensor.x_mm[self.run.stop - 1 if end else self.run.start] + sign * beyond
        weight = math.sqrt(12.0 / (gap**2 + 12.0 * self.edge_mm**2))
        one, zero = np.ones_like(x), np.zeros_like(x)
        slope = np.stack([one, zero, poses[:, 1] - y, sign * one], axis=-1)
        off = expected - x - sign * poses[:, 3]
        return off[:, None] * weight, slope[:, None] * weight

    def descend(self, poses: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
        """Return where descents from poses (B, 4) end, and their costs (B,)."""
        p = self.parameters
        poses = poses.copy()
        residual, slope = self.rows(poses)
        cost, damping = (residual**2).sum(axis=1), np.full(len(poses), 1e-3)
        for _ in range(steps):
            j = slope[..., :p]
            normal, gradient = np.einsum("bmi,bmj->bij", j, j), np.einsum("bmi,bm->bi", j, residual)
            size = np.einsum("bii->bi", normal)
            normal[:, range(p), range(p)] += (
                damping[:, None] * size + 1e-12 * (1.0 + size.max(axis=1))[:, None]
            )
            trial = poses.copy()
            trial[:, :p] += np.linalg.solve(normal, gradient[..., None])[..., 0]
            new_residual, new_slope = self.rows(trial)
            new = (new_residual**2).sum(axis=1)
            better = new < cost
            gain = np.where(better, cost - new, 0.0)
            poses[better], cost[better] = trial[better], new[better]
            residual[better], slope[better] = new_residual[better], new_slope[better]
            damping = np.clip(np.where(better, 0.2 * damping, 6.0 * damping), 1e-9, 1e9)
            if not (gain > _SETTLED).any() and (better | (damping > 1e4)).all():
                break
        return poses, cost

    def covariance(self, pose: FloatArray) -> FloatArray:
        """Return the covariance (P, P) of a pose (4,)."""
        return np.asarray(self.covariances(pose[None])[0])

    def covariances(self, poses: FloatArray) -> FloatArray:
        """Return the covariances (B, P, P) of poses (B, 4)."""
        j = self.rows(poses)[1][..., : self.parameters]
        return np.asarray(np.linalg.pinv(j.swapaxes(1, 2) @ j, rcond=1e-13, hermitian=True))

    def starts(self) -> FloatArray:
        """Return poses (B, 4) to begin with: angles all round, x by the touched strips, y by the mean reading."""
        angle = np.arange(_STARTS) * (2.0 * np.pi / _STARTS)
        poses = np.zeros((_STARTS, 4))
        poses[:, 2] = angle
        posed = _posed(self.corners, poses)
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

    def thinned(self) -> _Fit:
        """Return the fit on the centre lines of some of many strips, each for its neighbours."""
        stride = -(-len(self.x_mm) // _COARSE_STRIPS)
        if stride == 1:
            return replace(self, wide=False)
        kept = slice(stride // 2, None, stride)
        weight = self.weight[:, kept] * math.sqrt(stride)
        return replace(self, x_mm=self.x_mm[kept], k=self.k[:, kept], weight=weight, wide=False)

    def with_sigma(self, sigma: float, pose: FloatArray | None = None) -> _Fit:
        """Return the fit with a reading's sigma [Vref], and with what soft edges add to it at a pose (4,)."""
        covered = _PARTLY * self.sensor.strip_width / self.sensor.length_mm if self.wide else 0.0
        variance = np.full(self.k.shape, sigma**2 + covered**2)
        if pose is not None and self.edge_mm:
            l, u = (end[0] for end in self.ends(pose[None])[:2])
            of = signature_jacobians(self.sensor, l, u)
            added = [(of[n][0] ** 2 + of[n][1] ** 2) * self.edge_mm**2 for n in self.names]
            variance = variance + np.nan_to_num(np.stack(added))
        return replace(self, weight=np.where(self.weight > 0.0, 1.0 / np.sqrt(variance), 0.0))


def _placed(
    scan: Scan,
    sensor: Sensor,
    corners: FloatArray,
    run: slice,
    silent: BoolArray,
    noise: Noise | None,
    edge_mm: float,
    around: int,
) -> RecoveredObject:
    """Return the object of one run of strips; round a tube their numbers begin again after `around`."""
    averaging = Averaging.of(scan)
    hard = (
        noise if noise is None or not edge_mm else replace(noise, edge_mm=0.0, blur_mm=0.0)
    )  # counted by strip
    known = None if hard is None else max(fit_sigma(hard, sensor, averaging), FLOOR)
    distribution = noise.distribution if noise is not None and noise.independent else "normal"
    k = np.stack([scan[name][run] for name in scan.signatures])
    there = np.isfinite(k)
    wide = sensor.strip_width_mm is not None
    if wide and k.shape[1] >= _ENOUGH:  # the outer ones may be covered in part
        there[:, :PARTIAL_STRIPS] = there[:, -PARTIAL_STRIPS:] = False
    x, read, used = sensor.x_mm[run], np.where(there, k, 0.0), there.astype(float)
    fit = _Fit(sensor, corners, run, x, scan.signatures, read, used, edge_mm, silent, wide)
    fit = fit.with_sigma(known or max(_GUESS, sensor.adc_step))
    coarse = fit.thinned()
    if wide:  # centre lines are as far off as that
        coarse = coarse.with_sigma(max(known or _GUESS, _WIDTH_READ * sensor.strip_width / sensor.length_mm))
    poses, cost = coarse.descend(coarse.starts(), _STEPS)
    poses = _distinct(coarse, poses, cost)
    if edge_mm:
        fit = fit.with_sigma(known or _GUESS, poses[0])
    poses, cost = fit.descend(poses, _FINE_STEPS)
    before = fit.weight > 0.0
    fit, poses = _without_outlier(fit, poses[np.argsort(cost)], known, distribution)
    out = before & ~(fit.weight > 0.0)
    if known is None:
        fit = fit.with_sigma(max(_noise(fit, poses[0]), FLOOR, sensor.adc_step / math.sqrt(12.0)), poses[0])
    poses, cost = fit.descend(poses, _FINE_STEPS)
    poses = _distinct(fit, poses, cost)
    cost = (fit.rows(poses)[0] ** 2).sum(axis=1)
    errors = [_errors(fit, pose, noise, averaging) for pose in poses]
    spread = [
        fit.covariance(pose) * _of_student(fit, known)
        if shared is None
        else shared.propagated(fit.covariance(pose))
        for pose, shared in zip(poses, errors, strict=True)
    ]
    volume = np.array([math.sqrt(max(float(np.linalg.det(c)), 1e-300)) for c in spread])
    weight = np.exp(-0.5 * (cost - cost.min())) * volume
    weight /= weight.sum()
    order = np.argsort(-weight, kind="stable")
    order = order[weight[order] >= _UNLIKELY]
    found = [_pose(poses[i], spread[i]) for i in order]
    sure = _probability(corners, poses[order], [spread[i] for i in order], weight[order])
    status, advice = _judge(fit, poses[order[0]], known, distribution, sure, errors[order[0]])
    vertices, covariance = _vertices(corners, poses[order[0]], spread[order[0]])
    l, u = (end[0] for end in fit.ends(poses[order[:1]])[:2])
    alternatives = tuple(
        Alternative(float(weight[i]), _vertices(corners, poses[i], spread[i])[0], found[j])
        for j, i in enumerate(order)
        if j
    )
    notes = [advice]
    if out.any():
        where = (np.flatnonzero(out.any(axis=0)) + run.start) % around + sensor.strip_base
        names = ", ".join(map(str, where))
        notes.append(f"strip {names} does not fit the object and was left out: is a channel stuck?")
    return RecoveredObject(
        run, vertices, (fit.x_mm, l, u), covariance, status, "; ".join(n for n in notes if n),
        confidence=None if status != "ok" and sure >= _PROBABLE else sure,  # it takes the readings for explained
        alternatives=alternatives, pose=found[0],
    )  # fmt: skip


def _pose(pose: FloatArray, covariance: FloatArray) -> Pose:
    angle = math.remainder(float(pose[2]), 2.0 * math.pi)
    return Pose(float(pose[0]), float(pose[1]), angle, covariance[:3, :3])


def _distinct(fit: _Fit, poses: FloatArray, cost: FloatArray) -> FloatArray:
    """Return the different poses (M, 4) among those where descents ended, the best first; poor ones are left out."""
    kept: list[FloatArray] = []
    size = float(np.linalg.norm(fit.corners, axis=1).max())
    units = np.array([size, size, 1.0])
    poses = poses[np.argsort(cost, kind="stable")][: np.sum(cost <= cost.min() + max(25.0, 0.5 * cost.min()))]
    own = np.sqrt(np.maximum(np.einsum("bii->bi", fit.covariances(poses))[:, :3], 0.0))
    for pose, near in zip(poses, np.minimum(_NEAR * own, 0.1 * units) + 1e-3 * units, strict=True):
        if len(kept) < _STARTS and not any(
            (np.abs(_difference(pose, other)) <= near).all() for other in kept
        ):
            kept.append(pose)
    return np.array(kept)


def _difference(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array([a[0] - b[0], a[1] - b[1], math.remainder(a[2] - b[2], 2.0 * math.pi)])


def _readings_left(fit: _Fit, pose: FloatArray) -> FloatArray:
    """Return the readings' residuals over sigma (S, n), 0 where there is none."""
    return np.asarray(fit.rows(pose[None])[0][0, : fit.k.size].reshape(fit.k.shape))


def _noise(fit: _Fit, pose: FloatArray) -> float:
    """Return the standard deviation [Vref] of what a pose leaves over."""
    used = fit.weight > 0.0
    left = _readings_left(fit, pose)[used] / fit.weight[used]
    return math.sqrt(float((left**2).sum()) / max(_freedom(fit), 1))


def _freedom(fit: _Fit) -> int:
    """Return readings beyond the numbers fitted; what touched strips tell of the ends counts for one number."""
    return int(np.count_nonzero(fit.weight)) - 3 + int(min(fit.gaps) < math.inf)


def _of_student(fit: _Fit, known: float | None) -> float:
    """Return how much larger the variance is where sigma is itself estimated: Student's."""
    freedom = max(_freedom(fit), 3)
    return 1.0 if known else freedom / (freedom - 2.0)


def _without_outlier(
    fit: _Fit, poses: FloatArray, known: float | None, distribution: str
) -> tuple[_Fit, FloatArray]:
    """Return the fit, and its poses, without the one reading that no pose explains while one does all others."""

    def explained(trial: _Fit, pose: FloatArray) -> bool:
        level = _noise(trial, pose)
        return level <= _CEILING and (
            known is None
            or chi_square_score(_readings_left(trial, pose), _freedom(trial), distribution) <= _ALARM
        )

    if explained(fit, poses[0]) or _freedom(fit) < 2:
        return fit, poses
    found = (fit, poses)
    least = math.inf
    for at in np.argsort(-np.abs(_readings_left(fit, poses[0])), axis=None)[:_SUSPECTS]:
        weight = fit.weight.copy()
        weight.flat[at] = 0.0
        trial = replace(fit, weight=weight)
        ended, cost = trial.descend(poses, _FINE_STEPS)
        best = int(cost.argmin())
        if cost[best] < least and explained(trial, ended[best]):
            least, found = cost[best], (trial, _distinct(trial, ended, cost))
    return found


def _vertices(corners: FloatArray, pose: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the posed outline (N, 2) [mm], counter-clockwise from the left-most, and its covariance (2N, 2N)."""
    posed = _posed(corners, pose[None])[0]
    posed = np.roll(posed, -int(np.lexsort((posed[:, 1], posed[:, 0]))[0]), axis=0)
    slope = np.zeros((len(posed), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1.0
    slope[:, 0, 2], slope[:, 1, 2] = pose[1] - posed[:, 1], posed[:, 0] - pose[0]
    flat = slope.reshape(-1, 3)
    return posed, np.asarray(flat @ covariance[:3, :3] @ flat.T)


def _errors(
    fit: _Fit, pose: FloatArray, noise: Noise | None, averaging: Averaging
) -> CorrelatedErrors | None:
    """Return the readings' errors at a pose, over their weights, where they are not independent."""
    if noise is not None and fit.edge_mm:  # the growth of all ends is fitted along
        apart = noise.edge_correlation_mm or -fit.sensor.pitch_mm / math.log(_NEIGHBOURS)
        noise = replace(noise, edge_mm=fit.edge_mm, edge_correlation_mm=apart, blur_mm=0.0)
    if noise is None or not correlated(noise, averaging):
        return None
    used, ends = fit.weight > 0.0, fit.ends(pose[None])[:2]
    matrix = reading_covariance(noise, fit.sensor, fit.x_mm, (ends[0][0], ends[1][0]), fit.names, averaging)
    at, weight = used.ravel(), fit.weight[used]
    residuals, slopes = (rows[0, : at.size][at] for rows in fit.rows(pose[None]))
    matrix = matrix[np.ix_(at, at)] * np.outer(weight, weight)
    return CorrelatedErrors(matrix, 1.0, slopes[:, : fit.parameters], residuals, used)


def _beyond_polygon(fit: _Fit, pose: FloatArray) -> bool:
    """Whether a free polygon explains the readings so much better (F test) that they are of another object."""
    from scipy.special import fdtrc

    k = np.where(fit.weight > 0.0, fit.k, np.nan)
    free = fit_run(fit.sensor, fit.x_mm, dict(zip(fit.names, k, strict=True)))
    if free.model is None or free.freedom < _LEAST_FREEDOM or free.excluded.any():
        return False
    least = max(free.sigma, _LEAST_NOISE, fit.sensor.adc_step / math.sqrt(12.0)) ** 2
    more = _freedom(fit) - free.freedom
    gain = _noise(fit, pose) ** 2 * _freedom(fit) - least * free.freedom
    return more > 0 and gain > 0.0 and float(fdtrc(more, free.freedom, gain / more / least)) < _CHANCE


def _judge(
    fit: _Fit,
    pose: FloatArray,
    known: float | None,
    distribution: str,
    sure: float,
    errors: CorrelatedErrors | None,
) -> tuple[Status, str]:
    left = _readings_left(fit, pose)
    readings = int(np.count_nonzero(fit.weight))
    freedom = max(readings + sum(gap < math.inf for gap in fit.gaps) - 3, 1)
    level = _noise(fit, pose)
    if errors is not None:
        left, freedom = errors.whitened(fit.covariance(pose))
    if (
        chi_square_score(left, freedom, distribution) > _ALARM
        or (readings > 6 and autocorrelation_score(left, readings) > _ALARM)
        or (known is None and (level > _CEILING or (not fit.edge_mm and _beyond_polygon(fit, pose))))
    ):
        return "doubtful", (
            f"at the best pose the readings are {100.0 * level:.2g} % of Vref from this object's: it is another "
            "object, pressed in part, or the noise is larger than given"
        )
    x = _posed(fit.corners, pose[None])[0, :, 0]
    beyond = max(x.min() - fit.x_mm[0], fit.x_mm[-1] - x.max())
    missing = max(fit.x_mm[0] - x.min() - fit.gaps[0], x.max() - fit.x_mm[-1] - fit.gaps[1])
    if max(beyond, missing) > fit.sensor.pitch_mm:
        return "doubtful", (
            f"this object ends {max(beyond, missing):.3g} mm from where the touched strips say: it is another object, "
            "or there are two"
        )
    if known is None and len(fit.names) == 1 and (readings < _FEWEST_READINGS or level > _PLAUSIBLE):
        return "doubtful", (
            f"the readings are {100.0 * level:.2g} % of Vref from this object's on {readings} strips: one signature "
            "does not tell noise from another object; give the noise (noise=, --positional, or [noise] in "
            f"the spec), or {signature_advice(fit.sensor)}"
        )
    if sure < _PROBABLE:
        return "doubtful", (
            f"the pose is not certain: the outline overlaps the object by 80 % with a probability of {sure:.2g}; see "
            "the alternatives, turn the object a little, average more scans, or "
            f"{signature_advice(fit.sensor) if len(fit.names) == 1 else 'use finer strips'}"
        )
    if fit.wide:
        return "likely", (
            "a strip that a corner or a steep edge lies on is modelled roughly: the pose may be off by a part of "
            "strip_width_mm, or turned"
        )
    return "ok", ""


def _probability(
    corners: FloatArray, poses: FloatArray, covariances: list[FloatArray], weight: FloatArray
) -> float:
    """Return the probability that the first pose's outline overlaps the truth by `_OVERLAP`."""
    random = np.random.default_rng(0)
    which = np.searchsorted(np.cumsum(weight) / weight.sum(), (np.arange(_DRAWS) + 0.5) / _DRAWS)
    draws = poses[which].copy()
    for i, at in enumerate(which):
        value, vector = np.linalg.eigh(covariances[at][:3, :3])
        draws[i, :3] += vector @ (np.sqrt(np.maximum(value, 0.0)) * random.standard_normal(3))
    first, *others = shapely.polygons(_posed(corners, np.concatenate([poses[:1], draws])))
    common = shapely.area(shapely.intersection(first, others))
    return float((common >= _OVERLAP * (first.area + shapely.area(others) - common)).mean())

"""A solid over time: its pose in every scan, and one radius of a sphere or cylinder from all of them.

Every scan has its own likelihood; what all share is the radius. Over a few radii each scan's best poses, with how far
they scatter (Laplace), give its likelihood of the radius, and their product the radius and how well it is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import patch_load
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ReadingError, figures
from tacstrip.reconstruction.pressed.agreement import explains, noise_scale
from tacstrip.reconstruction.pressed.descent import jacobian, radii_within, refined
from tacstrip.reconstruction.pressed.fit import descended
from tacstrip.reconstruction.pressed.judged import RADIUS_OPEN
from tacstrip.reconstruction.pressed.poses import Poses, cap
from tacstrip.reconstruction.result import Status
from tacstrip.scan import Scan, time_goes_back
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor

_RADII, _ROUNDS, _FINE = 11, 8, 801
_LEAST, _WIDEST = 4e-3, 1.5  # half a grid, of the radius' logarithm
_ENOUGH, _NEAR, _TOO_FAR = 9.0, 16.0, 60.0  # -2 log likelihood at its ends: at least, about, and at most
_AT_MOST = 3.0  # deviations by which a radius may lie further off than `RADIUS_OPEN`, else it is open
_STEP = 1e-3  # of differences: mm, rad, or a logarithm
_UNLIKE = 4.0  # standard deviations of chi square by which scans disagree about the radius
_OPEN = 0.125  # relative deviation from which on a radius is open
_UNTOLD = 0.5  # relative deviation of a radius that is not told


@dataclass(frozen=True, eq=False)
class SolidTrack:
    """A solid over time; from `track_solid`.

    Attributes
    ----------
    status, advice
        "ok"; "doubtful": some scans are not explained, or disagree about the radius; "no contact". In words, why.
    solids
        The object at its pose in every scan; None where nothing is touched.
    times_s
        Of the scans (T,) [s].
    radius_mm, radius_sigma_mm
        Of a sphere or cylinder, from all scans; NaN where they do not tell it.
    radius_sigmas_mm
        How well the scans up to each one tell the radius (T,) [mm].
    radius_interval_mm
        What it lies within with 95 %.
    directions, axes
        From the skin into the object (T, 3), and along a cylinder's axis or an edge's ridge (T, 3), unit vectors; NaN
        where nothing is touched, axes also of other solids.
    area_mm2, area_sigma_mm2, force_n, force_sigma_n
        Of the patches (T,), with standard deviations; the force by the skin's stiffness, NaN where it is not told.
    explained
        Whether the object explains each scan (T,); True where nothing is touched.

    Examples
    --------
    See `track_solid`.
    """

    status: Status
    advice: str
    solids: tuple[Solid | None, ...]
    times_s: FloatArray
    radius_mm: float
    radius_sigma_mm: float
    radius_sigmas_mm: FloatArray
    radius_interval_mm: tuple[float, float]
    directions: FloatArray
    axes: FloatArray
    area_mm2: FloatArray
    area_sigma_mm2: FloatArray
    force_n: FloatArray
    force_sigma_n: FloatArray
    explained: BoolArray

    def __repr__(self) -> str:
        radius = f", radius {self.radius_mm:.4g} +- {figures(self.radius_sigma_mm)} mm"
        told = radius if math.isfinite(self.radius_mm) else ""
        return f"<SolidTrack: {self.status}, {len(self.solids)} scans{told}>"


@takes(sensor=Sensor, solid=Solid, noise=Noise)
def track_solid(
    scans: Sequence[Scan],
    sensor: Sensor,
    solid: Solid,
    noise: Noise | None = None,
    *,
    known_size: bool = False,
) -> SolidTrack:
    """Follow a solid that moves on a skin, and tell the radius of a sphere or cylinder from all scans together.

    Parameters
    ----------
    scans, sensor
        What was measured, in the order of time, and with what: of any skin, curved or flat.
    solid
        The family, as of `fit_solid`: its kind counts; its radius is where the search begins.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fits leave over.
    known_size
        True: the radius is the one given.

    Returns
    -------
    SolidTrack
        A pose for every scan, area and force, and one radius for all, with status and advice.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        There is no scan, they are not in order or not of this sensor, or the construction has no closed form.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.005)
    >>> pen, scans = ts.Solid.cylinder(4.0), []
    >>> for i, turn in enumerate(np.linspace(0.4, 1.2, 5)):
    ...     at = pen.at((20, 0, 20), toward=(-1, 0, -1), turn_rad=turn)
    ...     patch = ts.press(fingertip, at, depth_mm=1.5)
    ...     scans.append(ts.simulate(fingertip, patch, noise, rng=i, time_s=0.01 * i))
    >>> found = ts.track_solid(scans, fingertip, ts.Solid.cylinder(6.0), noise)
    >>> found.status, bool(abs(found.radius_mm - 4.0) < 3 * found.radius_sigma_mm)
    ('ok', True)
    >>> bool(found.radius_sigmas_mm[-1] < found.radius_sigmas_mm[0])
    True
    """
    check_closed_form(sensor.kind, "track_solid")
    read = [scan.checked(sensor) for scan in scans]
    if not read:
        raise ReadingError("there is no scan: give those of a recording, in the order of time")
    times = np.array([scan.time_s for scan in read])
    if told := time_goes_back(times):
        raise ReadingError(told)
    noise = sensor.noise if noise is None else noise
    last: Solid | None = None
    seen: list[_Seen | None] = []
    for scan in read:
        if not scan.touched.any():
            last = None
            seen.append(None)
            continue
        poses = Poses.of(scan, sensor, solid, noise, known_size)
        ends, _, along = descended(poses, last)
        (last,) = poses.solids(ends[:1])
        seen.append(_Seen(poses, ends[0], along[0]))
    there = [one for one in seen if one is not None]
    if not there:
        return _summary(
            "no contact", ["no strip reads a contact; press harder"], seen, times, None, 1.0, False
        )
    squares = sum(one.squares for one in there)
    shares = "log_radius" in there[0].poses.names
    freedom = sum(one.poses.readings - len(one.values) + shares for one in there) - shares
    scale = noise_scale(squares, freedom, noise is None)
    alike = solid.kind == "sphere" and cap(there[0].poses.skin) and not known_size
    radius, notes = None, []
    if shares:
        radius = _Radius.of(there, scale)
        if radius.unlike > _UNLIKE:
            notes.append("the scans disagree about the radius: it is another object, or its radius changes")
        if radius.sigma > _OPEN or radius.furthest > RADIUS_OPEN:
            notes.append(
                "the scans leave the radius open: take more of them, press harder, or across more strips"
            )
        at = iter(radius.poses)
        seen = [one and replace(one, values=next(at)) for one in seen]
    unexplained = [
        i for i, one in enumerate(seen) if one is not None and not explains(one.poses, one.values[None])
    ]
    if unexplained:
        shown = ", ".join(map(str, unexplained[:5])) + (", ..." if len(unexplained) > 5 else "")
        notes.append(
            f"no such object explains {len(unexplained)} of {len(there)} scans ({shown}): it is another one, there are "
            "several, or the noise is larger"
        )
    status: Status = "doubtful" if notes else "ok"
    if alike or (radius is not None and radius.sigma > _UNTOLD):
        notes.append(
            "the radius and the force cannot be told from these contacts: give a known radius with known_size=True"
        )
    return _summary(status, notes, seen, times, radius, scale, alike)


@dataclass(frozen=True, eq=False)
class _Seen:
    """A scan's poses, the best of them (P,), and the best with other radii (N, P)."""

    poses: Poses
    values: FloatArray
    others: FloatArray

    @property
    def squares(self) -> float:
        """Sum of squares of what is left over of the readings."""
        return float(np.square(self.poses.residuals(self.values[None])[0, : self.poses.readings]).sum())

    def normal(self, values: FloatArray) -> FloatArray:
        """Return J'J (M, P, P) at parameters (M, P)."""
        slopes = jacobian(self.poses.residuals, values, self.poses.residuals(values))
        return np.asarray(np.einsum("mrp,mrq->mpq", slopes, slopes))

    def information(self, scale: float) -> float:
        """Return what the scan tells of the radius' logarithm: one over its variance."""
        normal, at = self.normal(self.values[None])[0] / scale, self.poses.column("log_radius")
        assert at is not None
        rest = np.delete(np.arange(len(normal)), at)
        aside = np.linalg.solve(normal[np.ix_(rest, rest)], normal[rest, at])
        return float(max(normal[at, at] - normal[at, rest] @ aside - self.poses.pull**2 / scale, 0.0))

    def likelihood(self, near: FloatArray, logs: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
        """Return -2 log likelihood of radii (M,) with the poses (M, P) that are best with them, and these.

        `near` (N, P) are poses to begin from, each with a radius near it.
        """
        at = self.poses.column("log_radius")
        assert at is not None
        values = near[np.abs(near[:, at] - logs[:, None]).argmin(axis=1)]
        values[:, at] = logs
        values, costs = refined(self.poses, values, "log_radius")
        pull = self.poses.pull * (logs - math.log(self.poses.solid.size[0]))  # counts for no scan
        return (costs - pull**2) / scale, values


@dataclass(frozen=True, eq=False)
class _Radius:
    """What all scans tell of the radius' logarithm, each scan's pose with it (P,), and how unlike they are.

    Likelihoods are those of the best poses. Added up over all poses, as with every pose alike beforehand, each scan
    would prefer radii that have more of them: twenty scans by three times what they tell.
    """

    mean: float
    sigma: float
    interval: tuple[float, float]
    poses: list[FloatArray]
    information: FloatArray
    unlike: float
    furthest: float

    @classmethod
    def of(cls, seen: Sequence[_Seen], scale: float) -> _Radius:
        """Return it from scans."""
        at = seen[0].poses.column("log_radius")
        assert at is not None
        own, told = (
            np.array([one.values[at] for one in seen]),
            np.array([one.information(scale) for one in seen]),
        )
        centre = float(np.average(own, weights=told + 1e-9))
        half, near = _WIDEST, [one.others for one in seen]
        for _ in range(_ROUNDS):
            logs = np.linspace(centre - half, centre + half, _RADII)
            each, poses = zip(
                *(one.likelihood(its, logs, scale) for one, its in zip(seen, near, strict=True)), strict=True
            )
            near = [np.concatenate([new, its]) for new, its in zip(poses, near, strict=True)]
            total = np.sum(each, axis=0)
            best = int(total.argmin())
            ends = min(total[0], total[-1]) - total[best]
            if best in (0, _RADII - 1):
                centre = float(logs[best])
            elif ends > _TOO_FAR and half > _LEAST:
                low, high = radii_within(logs, total, math.sqrt(_NEAR))
                centre, half = 0.5 * (low + high), min(max(0.5 * (high - low), _LEAST), 0.6 * half)
            elif ends < _ENOUGH and half < _WIDEST:
                centre, half = float(logs[best]), 1.7 * half
            else:
                break
        from scipy.interpolate import PchipInterpolator  # does not overshoot beside a steep rise

        fine = np.linspace(logs[0], logs[-1], _FINE)
        curve = PchipInterpolator(logs, total)(fine)
        weight = np.exp(-0.5 * (curve - curve.min()))
        weight /= weight.sum()
        mean = float(weight @ fine)
        low, high = np.interp((0.025, 0.975), np.cumsum(weight), fine)
        rises = sum(float(PchipInterpolator(logs, one)(mean) - one.min()) for one in each)
        freedom = max(len(seen) - 1, 1)
        nearest = int(np.abs(logs - mean).argmin())
        held = []
        for one, values in zip(seen, poses, strict=True):
            start = values[nearest : nearest + 1].copy()
            start[:, at] = mean
            held.append(refined(one.poses, start, "log_radius")[0][0])
        return cls(
            mean, math.sqrt(float(weight @ np.square(fine - mean))), (float(low), float(high)), held, told,
            (rises - freedom) / math.sqrt(2.0 * freedom) if len(seen) > 1 else 0.0,
            float(np.abs(np.array(radii_within(fine, curve, _AT_MOST)) - mean).max()),
        )  # fmt: skip


def _summary(
    status: Status, notes: list[str], seen: list[_Seen | None], times: FloatArray, radius: _Radius | None,
    scale: float, alike: bool,
) -> SolidTrack:  # fmt: skip
    """Put together what was found."""
    area, by_area, force, by_force = (np.full(len(seen), np.nan) for _ in range(4))
    (directions, axes), solids = np.full((2, len(seen), 3), np.nan), list[Solid | None]()
    explained, told, information = np.ones(len(seen), dtype=bool), 0.0, np.full(len(seen), np.nan)
    scans = iter(() if radius is None else radius.information)
    for i, one in enumerate(seen):
        if radius is not None:
            told += 0.0 if one is None else next(scans)
            information[i] = told
        if one is None:
            solids.append(None)
            continue
        every = np.concatenate([one.values[None], one.values + _STEP * np.eye(len(one.values))])
        at = one.poses.solids(every)
        loads = np.array(
            [(p.area_mm2, p.force_n) for p in (patch_load(one.poses.skin, s, limited=False) for s in at)]
        )
        slopes = (loads[1:] - loads[0]) / _STEP  # (P, 2)
        known = _covariance(one, 0.0 if radius is None else radius.sigma, scale)
        area[i], force[i] = loads[0]
        by_area[i], by_force[i] = np.sqrt(np.einsum("pa,pq,qa->a", slopes, known, slopes))
        axes[i] = np.nan if at[0].axis is None else at[0].axis
        directions[i], explained[i] = -at[0].toward, explains(one.poses, one.values[None])
        solids.append(at[0])
    mean = sigma = math.nan
    interval = (math.nan, math.nan)
    if radius is not None and radius.sigma <= _UNTOLD:
        mean = math.exp(radius.mean)
        sigma, interval = mean * radius.sigma, (math.exp(radius.interval[0]), math.exp(radius.interval[1]))
    elif radius is not None or alike:
        force, by_force = (np.full(len(seen), np.nan) for _ in range(2))
    with np.errstate(divide="ignore"):
        sigmas = mean / np.sqrt(information)
    return SolidTrack(
        status, "; ".join(notes), tuple(solids), times, mean, sigma, sigmas, interval, directions, axes, area, by_area,
        force, by_force, explained,
    )  # fmt: skip


def _covariance(one: _Seen, radius_sigma: float, scale: float) -> FloatArray:
    """Return the covariance (P, P) of a scan's parameters, the radius as well known as all scans tell it."""
    normal, at = one.normal(one.values[None])[0], one.poses.column("log_radius")
    if at is None:
        return np.asarray(np.linalg.inv(normal) * scale)
    rest = np.delete(np.arange(len(normal)), at)
    own = np.linalg.inv(normal[np.ix_(rest, rest)])
    follows = np.zeros(len(normal))
    follows[at], follows[rest] = 1.0, -own @ normal[rest, at]
    known = radius_sigma**2 * np.outer(follows, follows)
    known[np.ix_(rest, rest)] += own * scale
    return known

"""Objects over time from many scans: one rigid outline each, known better than from any single scan, and its poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.problem import FLOOR
from tacstrip.core.rigid import RigidScans
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import refuse_surface
from tacstrip.reconstruction.result import Alternative, RecoveredObject, Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode, episodes, spanned
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import covariances, information
from tacstrip.tracking.rigid.offsets import taken_off, with_offsets
from tacstrip.tracking.rigid.search import (
    FEW_STRIPS,
    LEAST_STRIPS,
    Found,
    content,
    recognised,
    search,
    with_all_poses,
)
from tacstrip.tracking.single_scans import SingleScans

FEWEST = 5  # scans of one stretch that a shape is searched in
MOST = 200  # scans that a shape is fitted to; the others only have their poses fitted
GUESS, _CEILING = 0.003, 0.02 / math.sqrt(3.0)  # of sigma that is not known [Vref]
_ALIKE = 1.25  # times a guess of sigma: found again, it is believed
_ROUNDS = 3  # of finding sigma
_TOLD, _OF_SIZE = 0.1, 0.01  # of the pitch, and of the outline's extent, and ...
_TELLING = 4.0  # ... deviations of the least certain corner: shapes that differ by more are not the same
_MAY_BE_OFF, _DEVIATIONS = (
    0.05,
    2.0,
)  # of the extent, by which no corner may be off, and within how many deviations
_MOVED = 0.5  # pitches that corners must move where few strips are touched
NOT_RIGID = (
    "no rigid outline explains all scans: {times:.3g} times the noise is left over; the object deforms or rolls, two "
    "are taken for one, or the noise is larger than given: read the scans one by one (`single`)"
)
_NOT_TOLD = (
    "the motion does not tell the shape: outlines that differ by {spread:.2g} mm explain all scans; turn the object, "
    "or slide it across the strips by more than half a pitch"
)
_HARDLY_MOVED = (
    "in {n} scans it hardly moved across the strips or turned, so that they tell little more of the shape than one: "
    "turn the object, or slide it across the strips by more than half a pitch"
)
_SMALL = (
    "most scans touch no more than two strips, which tell hardly more than where it lies: the outline is one of many; "
    "finer strips would tell it"
)
_LOOSE = (
    "the scans leave a corner uncertain by {far:.2g} mm (two standard deviations): read both signatures, turn the "
    "object further, or slide it across the strips"
)
_CONCAVE = "the outline is concave: one object, or several that keep together"
_SHORT = "{n} scans show it, too few for a shape over time: the outline is that of the scan that tells most"
STANDS = "the clock stands still: no velocity"


@dataclass(frozen=True, eq=False)
class Track:
    """One object over time.

    Attributes
    ----------
    id
        Its number, counted from 1 in the order of appearance.
    outline
        Corners (N, 2) [mm], counter-clockwise, in the object's frame: about their mean, not turned in the first
        scan that shows it.
    covariance
        Of `outline.ravel()` (2 N, 2 N) [mm^2], of the shape alone: moved and turned as a whole it is the same shape.
    poses
        x, y [mm] and angle [rad] in every scan (T, 3), NaN where it is absent: a point p of the outline lies at
        R(angle) p + (x, y) on the sensor.
    pose_covariances
        Of the poses (T, 3, 3) [mm, mm, rad].
    times_s
        Of the scans (T,) [s].
    velocities
        Of the poses (T, 3) [mm/s, mm/s, rad/s]; NaN where it is absent or the clock stands still.
    status
        "ok", "doubtful" (read the advice), or that of the single scan which showed most of it.
    advice
        In words; empty when all is well.
    alternatives
        Other outlines that explain the scans as well, in this object's frame.
    joint
        Scans in which it shared strips with another object, and has no pose.
    motion
        What the shape takes for granted of the motion: "free" where each scan has a pose of its own, or which smooth
        path; one signature takes the smoothest that explains the readings.
    offsets
        By signature, what each channel reads beside the truth (strips,) [Vref], where the readings of the whole
        recording ask for it; else empty. 0 where the object never was.
    by_scan
        Where no rigid outline explains the scans, or they are too few for one: how `single` is found; else None.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)])
    >>> scans = [ts.simulate(sensor, shape.turned(0.05 * i).placed(50, 50), time_s=0.01 * i) for i in range(12)]
    >>> (one,) = ts.track(scans, sensor)
    >>> round(one.area_mm2), int(one.present.sum()), one.placed(0).shape
    (1850, 12, (4, 2))
    """

    id: int
    outline: FloatArray
    covariance: FloatArray | None
    poses: FloatArray
    pose_covariances: FloatArray
    times_s: FloatArray
    velocities: FloatArray
    status: Status
    advice: str = ""
    alternatives: tuple[Alternative, ...] = ()
    joint: tuple[int, ...] = field(default=())
    motion: str = "free"
    offsets: dict[str, FloatArray] = field(default_factory=dict)
    by_scan: SingleScans | None = field(default=None, repr=False)

    @property
    def present(self) -> FloatArray:
        """Whether each scan shows it (T,)."""
        return np.asarray(np.isfinite(self.poses[:, 0]))

    @property
    def area_mm2(self) -> float:
        """Of the outline [mm^2]."""
        return moments(self.outline)[0]

    @property
    def area_deviation_mm2(self) -> float:
        """Standard deviation of the area [mm^2]; NaN where none is known."""
        if self.covariance is None:
            return math.nan
        return deviations(self.outline, self.covariance)[0]

    @property
    def single(self) -> tuple[RecoveredObject | None, ...]:
        """What each scan shows by itself (T,), None where it is absent, if no rigid outline explains them; else empty.

        Found when first asked for, in some 5 ms a scan.
        """
        return () if self.by_scan is None else self.by_scan.all()

    def placed(self, scan: int) -> FloatArray:
        """Return the corners (N, 2) [mm] on the sensor in one scan; NaN where it is absent.

        They are the rigid outline's or, where none explains the scans, those of this scan by itself.
        """
        alone = None if self.by_scan is None else self.by_scan[scan]
        return placed(self.outline, self.poses[scan]) if alone is None or not alone.found else alone.vertices


@takes(scans=(Scan,), sensor=Sensor, noise=Noise)
def track(scans: Sequence[Scan], sensor: Sensor, noise: Noise | None = None) -> list[Track]:
    """Find the objects of a whole recording: one rigid outline each, and where it lies in every scan.

    Fifty scans of an object that slides or turns tell ten times more of its shape than one does. What does not move
    across the strips or turn stays as unknown as in a single scan, and that is said.

    Parameters
    ----------
    scans
        Of one sensor, in the order of time.
    sensor
        That made them, of a construction with a closed form.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fits leave over.

    Returns
    -------
    list of Track
        In the order of appearance. An object that is lifted and pressed again keeps its number where its shape is
        recognised.

    Raises
    ------
    ReadingError
        There is no scan, one is not of this sensor, or they are not in the order of time; the message names it.
    SignatureError
        The construction has no closed form.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape, noise = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)]), ts.Noise(positional=0.002)
    >>> scans = [
    ...     ts.simulate(sensor, shape.turned(0.02 * i).placed(40 + 0.5 * i, 50), noise, rng=100 + i, time_s=0.01 * i)
    ...     for i in range(30)
    ... ]
    >>> (one,) = ts.track(scans, sensor, noise)
    >>> one.status, len(one.outline), bool(abs(one.poses[-1, 2] - one.poses[0, 2] - 0.58) < 0.02)
    ('ok', 4, True)
    """
    check_closed_form(sensor.kind, "track")
    refuse_surface(sensor, "track", "reconstruct scan by scan, by ts.reconstruct or ts.fit_solid")
    read = [_checked(i, scan, sensor) for i, scan in enumerate(scans)]
    if not read:
        raise ReadingError("there is no scan: give those of a recording, in the order of time")
    times = np.array([scan.time_s for scan in read])
    if len(back := np.flatnonzero(np.diff(times) < 0.0)):
        i = int(back[0]) + 1
        raise ReadingError(
            f"scan {i} is from {times[i]:.6g} s, before scan {i - 1} from {times[i - 1]:.6g} s: sort the scans by time"
        )
    names = read[0].signatures
    for i, scan in enumerate(read):
        if scan.signatures != names:
            raise ReadingError(
                f"scan {i} has {' and '.join(scan.signatures)}, and scan 0 {' and '.join(names)}: give scans alike"
            )
    noise = sensor.noise if noise is None else noise
    k = np.stack([np.stack([scan[name] for name in names]) for scan in read])
    sigma = None if noise is None else max(fit_sigma(noise, sensor, Averaging.of(read[0])), FLOOR)
    distribution = "normal" if noise is None or not noise.independent else noise.distribution
    seen_once = episodes(k, sensor.closed)
    skin = Skin(sensor, spanned(seen_once, sensor.strips))
    left = sorted(seen_once, key=lambda e: -len(e.scans))
    tracks: list[tuple[int, Track]] = []
    while left:
        one = left.pop(0)
        seen = searched(one, k, skin, names, sigma, distribution)
        if seen is None:
            found = _of_one_scan(one, read, sensor, noise)
        else:
            for other in [e for e in left if not set(e.scans) & set(seen.shown)]:
                again = _recognise(seen, other, k, skin, distribution)
                if again is not None:
                    seen = again
                    left.remove(other)
            found = summarised(seen, read, skin, noise, distribution)
        tracks.append(
            (one.scans[0], replace(found, times_s=times, velocities=_velocities(found.poses, times)))
        )
    standing = len(times) > 1 and not np.diff(times).any()
    return [
        replace(t, id=i, advice="; ".join(filter(None, [t.advice, STANDS if standing else ""])))
        for i, (_, t) in enumerate(sorted(tracks, key=lambda pair: pair[0]), 1)
    ]


@dataclass(frozen=True)
class Skin:
    """The strips that contacts lie on: a closed tube's are laid out for as many turns as contacts go on."""

    sensor: Sensor
    span: slice

    @property
    def laid_out(self) -> Sensor:
        """A sensor of these strips."""
        if not self.sensor.closed:
            return self.sensor
        strips = self.span.stop - self.span.start
        assert self.sensor.radius_mm is not None
        radius = 2.0 * self.sensor.radius_mm * strips / self.sensor.strips
        return replace(self.sensor, strips=strips, radius_mm=radius, calibration=None)


@dataclass(frozen=True, eq=False)
class Object:
    """The scans that show one object, its readings there, and what was found."""

    shown: list[int]
    joint: list[int]
    runs: list[slice]
    scans: RigidScans
    found: Found


def _checked(number: int, scan: Scan, sensor: Sensor) -> Scan:
    try:
        return scan.checked(sensor)
    except (ReadingError, SignatureError) as error:
        raise type(error)(f"scan {number}: {error}") from None


def searched(
    episode: Episode,
    k: FloatArray,
    skin: Skin,
    names: tuple[str, ...],
    sigma: float | None,
    distribution: str,
    *,
    offsets: bool = True,
) -> Object | None:
    """Return the object of an episode; None where its scans are too few for a shape over time."""
    if len(episode.scans) < FEWEST:
        return None
    sensor = skin.sensor
    level = sigma or max(GUESS, sensor.adc_step)
    every = RigidScans(skin.laid_out, names, episode.readings(k, skin.span), level)
    few = np.unique(np.linspace(0, len(every.k) - 1, min(len(every.k), MOST)).astype(int))
    least = max(sensor.adc_step / math.sqrt(12.0), FLOOR)
    for _ in range(_ROUNDS):
        found = search(every.of(few), distribution, offsets=offsets)
        left = level * math.sqrt(found.fit.cost / found.fit.freedom(every.of(few)))
        if sigma or level / _ALIKE < left < level * _ALIKE:
            break
        level = float(np.clip(left, least, _CEILING))
        every = every.with_sigma(level)
    every = taken_off(every, found.offsets)
    found = replace(found, fit=with_all_poses(every, few, found.fit), chosen=few[found.chosen])
    return Object(episode.scans, episode.joint, episode.runs, every, found)


def _recognise(one: Object, other: Episode, k: FloatArray, skin: Skin, distribution: str) -> Object | None:
    """Return the object with another stretch of scans too, where its shape explains them; else None."""
    if one.found.fit.basis is not None or not content(one.scans, one.found.fit, distribution):
        return None
    more = taken_off(replace(one.scans, k=other.readings(k, skin.span)), one.found.offsets)
    fit = recognised(one.scans, one.found.fit, more, distribution)
    if fit is None:
        return None
    every = replace(one.scans, k=np.concatenate([one.scans.k, more.k]))
    few, kept = one.scans.of(one.found.chosen), []
    for rival, worse in one.found.rivals if one.found.spread_mm > _TOLD * one.scans.sensor.pitch_mm else ():
        if recognised(few, rival, more, distribution) is not None:
            kept.append((rival, worse))
    found = replace(one.found, fit=fit, rivals=tuple(kept))
    return Object(one.shown + other.scans, one.joint + other.joint, one.runs + other.runs, every, found)


def summarised(one: Object, scans: list[Scan], skin: Skin, noise: Noise | None, distribution: str) -> Track:
    """Return what is known of an object over time."""
    fit, sensor, total = one.found.fit, skin.sensor, len(scans)
    if _signed_area(fit.corners) < 0.0:
        fit = replace(fit, corners=fit.corners[::-1])
    corners, first = fit.corners, int(np.argmin(one.shown))
    middle, angle = corners.mean(axis=0), float(fit.poses[first, 2])
    outline, spin = _turned(corners - middle, angle), _turned(np.eye(2), angle)
    where = np.stack([placed(middle[None], p)[0] for p in fit.poses])
    rows = np.column_stack([where, fit.poses[:, 2] - angle])
    equations = information(one.scans, corners, fit.poses)
    if one.found.offsets is not None:
        equations = with_offsets(one.scans, fit, equations, one.found.offsets.deviation)
    shape, of_poses = covariances(equations, corners, fit.poses, fit.basis)
    all_spin, by = np.kron(np.eye(len(corners)), spin.T), np.tile(np.eye(3), (len(rows), 1, 1))
    shape = np.asarray(all_spin @ shape @ all_spin.T)
    by[:, 0, 2], by[:, 1, 2] = fit.poses[:, 1] - where[:, 1], where[:, 0] - fit.poses[:, 0]
    of_poses = np.asarray(by @ of_poses @ by.transpose(0, 2, 1))
    poses, spreads = np.full((total, 3), np.nan), np.full((total, 3, 3), np.nan)
    poses[one.shown], spreads[one.shown] = rows, of_poses
    poses[:, 0] += skin.span.start * sensor.pitch_mm
    advice, note, alone = "", "", None
    explained = content(one.scans, fit, distribution)
    if one.scans.strips_touched < LEAST_STRIPS:
        advice = _SMALL
    elif not explained:
        times = math.sqrt(fit.cost / fit.freedom(one.scans))
        advice = NOT_RIGID.format(times=times)
    if not explained:
        alone = SingleScans(scans, dict(zip(one.shown, one.runs, strict=True)), sensor, noise)
    loosest = math.sqrt(float(shape.diagonal().reshape(-1, 2).sum(axis=1).max()))
    spread = one.found.spread_mm
    size = float(np.ptp(outline, axis=0).max())
    unsure = max(_TOLD * sensor.pitch_mm, _MAY_BE_OFF * size)
    told = spread <= max(_TOLD * sensor.pitch_mm, _OF_SIZE * size, min(_TELLING * loosest, unsure))
    if not advice and not told:
        advice = _NOT_TOLD.format(spread=spread)
    elif not advice and _hardly_moved(one, outline, rows):
        told, advice = False, _HARDLY_MOVED.format(n=len(one.shown))
    elif not advice and _DEVIATIONS * loosest > unsure:
        told, advice = False, _LOOSE.format(far=_DEVIATIONS * loosest)
    elif not advice and _reflex(outline):
        note = _CONCAVE
    others = tuple(Alternative(weight, _turned(o - middle, angle)) for o, weight in one.found.others)
    status: Status = "doubtful" if advice else "likely" if note else "ok"
    return Track(
        0, outline, shape, poses, spreads, np.empty(0), np.empty(0), status, advice or note, () if told else others,
        tuple(one.joint), _motion(fit), _offsets(one, skin), alone,
    )  # fmt: skip


def _hardly_moved(one: Object, outline: FloatArray, poses: FloatArray) -> bool:
    """Whether few strips read the outline at always the same places."""
    x = np.stack([placed(outline, pose)[:, 0] for pose in poses])
    few = one.scans.strips_touched < FEW_STRIPS
    return bool(few and np.median(np.ptp(x, axis=0)) < _MOVED * one.scans.sensor.pitch_mm)


def _reflex(corners: FloatArray) -> bool:
    """Whether a corner of an outline, counter-clockwise, turns inwards."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return bool((before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0.0).any())


def _motion(fit: Fit) -> str:
    """Say what is taken for granted of the motion."""
    if fit.basis is None:
        return "free"
    return (
        f"smooth: x, y and angle are cubic splines of {fit.basis.shape[1]} knots over {len(fit.poses)} scans"
    )


def _offsets(one: Object, skin: Skin) -> dict[str, FloatArray]:
    """Return the offsets of the sensor's channels by signature, where there are any."""
    if one.found.offsets is None:
        return {}
    found = {}
    own = np.arange(skin.span.start, skin.span.stop) % skin.sensor.strips
    for name, values in zip(one.scans.names, one.found.offsets.values, strict=True):
        found[name] = np.zeros(skin.sensor.strips)
        np.add.at(found[name], own, values)
    return found


def _of_one_scan(one: Episode, scans: list[Scan], sensor: Sensor, noise: Noise | None) -> Track:
    """Return the track of an object that too few scans show: the shape of the one in which it touches most strips."""
    widest = max(range(len(one.scans)), key=lambda i: one.runs[i].stop - one.runs[i].start)
    alone = SingleScans(scans, dict(zip(one.scans, one.runs, strict=True)), sensor, noise)
    shape = alone[one.scans[widest]]
    assert shape is not None
    poses, spreads = np.full((len(scans), 3), np.nan), np.full((len(scans), 3, 3), np.nan)
    outline = shape.vertices
    if len(outline):
        middle = outline.mean(axis=0)
        outline, poses[one.scans[widest]] = outline - middle, (*middle, 0.0)
    advice = "; ".join(filter(None, [_SHORT.format(n=len(one.scans)), shape.advice]))
    return Track(
        0, outline, shape.covariance, poses, spreads, np.empty(0), np.empty(0), shape.status, advice,
        shape.alternatives, tuple(one.joint), by_scan=alone,
    )  # fmt: skip


def _velocities(poses: FloatArray, times: FloatArray) -> FloatArray:
    """Return the slopes (T, 3) of poses by time, by neighbouring scans; NaN where there are none."""
    found = np.full(poses.shape, np.nan)
    at = np.flatnonzero(np.isfinite(poses[:, 0]))
    for stretch in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        if len(stretch) > 1 and (np.diff(times[stretch]) > 0.0).all():
            found[stretch] = np.gradient(poses[stretch], times[stretch], axis=0)
    return found


def _turned(corners: FloatArray, angle: float) -> FloatArray:
    return placed(corners, np.array([0.0, 0.0, angle]))


def _signed_area(corners: FloatArray) -> float:
    x, y = corners.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2.0

"""Objects over time from many scans: one rigid outline each, known better than from any single scan, and its poses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.hull import available
from tacstrip.core.problem import FLOOR
from tacstrip.core.rigid import RigidScans
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.geometry.moments import deviations, moments
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import Alternative, Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode, episodes
from tacstrip.tracking.rigid.corners import Fit, posed
from tacstrip.tracking.rigid.covariance import covariances
from tacstrip.tracking.rigid.search import Found, content, placed, recognised, search, with_all_poses
from tacstrip.tracking.shared_strips.lone_ends import lone_ends
from tacstrip.tracking.shared_strips.scene import Alone, Shared, follow

_FEWEST = 5  # scans of one stretch that a shape is searched in
_MOST = 200  # scans that a shape is fitted to; the others only have their poses fitted
_GUESS, _CEILING = 0.003, 0.02 / math.sqrt(3.0)  # of sigma that is not known [Vref]
_ALIKE = 1.25  # times a guess of sigma: found again, it is believed
_ROUNDS = 3  # of finding sigma
_TOLD, _OF_SIZE = 0.1, 0.01  # of the pitch, and of the outline's extent, and ...
_TELLING = 4.0  # ... deviations of the least certain corner: shapes that differ by more are not the same
_MOVED, _FEW_STRIPS = 0.5, 12  # pitches that corners must move where fewer strips than that are touched
_NOT_RIGID = (
    "no rigid outline explains all scans: {times:.3g} times the noise is left over; the object deforms or rolls, two "
    "are taken for one, or the noise is larger than given: reconstruct the scans one by one"
)
_NOT_TOLD = (
    "the motion does not tell the shape: outlines that differ by {spread:.2g} mm explain all scans; turn the object, "
    "or slide it across the strips by more than half a pitch"
)
_HARDLY_MOVED = (
    "in {n} scans it hardly moved across the strips or turned, so that they tell little more of the shape than one: "
    "turn the object, or slide it across the strips by more than half a pitch"
)
_CONCAVE = "the outline is concave: one object, or several that keep together"
_SHORT = "{n} scans show it, too few for a shape over time: the outline is that of the scan that tells most"
_UNEXPLAINED = (
    "in the scans in which it shares strips the known objects do not explain the readings: another is there that is "
    "never alone, or one outline is that of two"
)
_STANDS = "the clock stands still: no velocity"


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
        Scans in which it shared strips with another object. It has a pose there where the objects that are known from
        other scans explain the readings.

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

    def placed(self, scan: int) -> FloatArray:
        """Return the corners (N, 2) [mm] on the sensor in one scan; NaN where it is absent."""
        return placed(self.outline, self.poses[scan])


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
        In the order of appearance, from left to right. An object that is lifted and pressed again keeps its number
        where its shape is recognised, and one that shares strips with others where it was alone before or after.

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
    ...     ts.simulate(sensor, shape.turned(0.02 * i).placed(40 + 0.5 * i, 50), noise, rng=i, time_s=0.01 * i)
    ...     for i in range(30)
    ... ]
    >>> (one,) = ts.track(scans, sensor, noise)
    >>> one.status, len(one.outline), bool(abs(one.poses[-1, 2] - one.poses[0, 2] - 0.58) < 0.02)
    ('ok', 4, True)
    """
    check_closed_form(sensor.kind, "track")
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
    stretches = episodes(k)
    read_as = _Reading(k, sensor, names, sigma, distribution)
    left, unlike, objects = sorted(stretches, key=lambda e: -len(e.scans)), list[Episode](), list[_Object]()
    while left:
        one = left.pop(0)
        seen = _search(one, read_as, thorough=any(e.joint for e in one.group))
        if seen is None or not content(seen.scans, seen.found.fit, distribution):
            unlike.append(one)
            continue
        for other in [e for e in left if not set(e.scans) & set(seen.shown)]:
            again = _recognise(seen, other, read_as)
            if again is not None:
                seen = again
                left.remove(other)
        objects.append(seen)
    objects, unlike = _together(objects, unlike, stretches, read_as)
    tracks: list[tuple[int, Track]] = []
    for one in unlike:
        seen = _search(one, read_as)
        if seen is None:
            found = _of_one_scan(one, read, sensor, noise)
            tracks.append(((one.scans or one.joint)[0], found))
        else:
            objects.append(seen)
    for each in objects:
        found = _track(each, len(read), distribution)
        tracks.append((int(np.argmax(found.present)), found))
    tracks = [
        (first, replace(found, times_s=times, velocities=_velocities(found.poses, times)))
        for first, found in tracks
    ]
    standing = len(times) > 1 and not np.diff(times).any()
    return [
        replace(t, id=i, advice="; ".join(filter(None, [t.advice, _STANDS if standing else ""])))
        for i, (_, t) in enumerate(sorted(tracks, key=lambda pair: (pair[0], pair[1].poses[pair[0], 0])), 1)
    ]


@dataclass(frozen=True, eq=False)
class _Object:
    """The scans that show one object by itself, its readings there, and what was found; and with others."""

    shown: list[int]
    joint: list[int]
    scans: RigidScans
    found: Found
    shared: tuple[Shared, ...] = ()

    @property
    def alone(self) -> Alone:
        """What is known of it for scans in which it shares strips."""
        order = np.argsort(self.shown)
        fit = self.found.fit
        return Alone(
            fit.corners,
            [self.shown[i] for i in order],
            fit.poses[order],
            self.scans.k[order],
            tuple(o for o, _ in self.found.others)
            if self.found.spread_mm > _TOLD * self.scans.sensor.pitch_mm
            else (),
        )

    @property
    def unexplained(self) -> _Object:
        """It with the advice that what it shares strips with is not known."""
        return replace(self, shared=(*self.shared, Shared(self.found.fit.corners, {}, advice=_UNEXPLAINED)))

    def until(self, scan: int) -> _Object:
        """Return what is known of it before a scan."""
        kept = [i for i, s in enumerate(self.shown) if s < scan]
        fit = self.found.fit
        fit = Fit(fit.corners, fit.poses[kept], fit.costs[kept])
        return _Object(
            [self.shown[i] for i in kept], [], self.scans.of(kept), Found(fit, np.arange(len(kept)))
        )

    def with_shared(self, more: Shared) -> _Object:
        """Return it with scans in which it shares strips, and the outline that they sharpened."""
        last = self.found.fit.poses
        start = np.stack([more.again.get(s, p) for s, p in zip(self.shown, last, strict=True)])
        fit = posed(self.scans, Fit(more.corners, start, np.full(len(start), np.inf)))
        rivals = tuple(
            (replace(fit, corners=o, poses=fit.poses[self.found.chosen]), w) for o, w in more.rivals
        )
        return replace(self, found=replace(self.found, fit=fit, rivals=rivals), shared=(*self.shared, more))


@dataclass(frozen=True, eq=False)
class _Reading:
    """All readings (T, S, n), and what is known of them; sigma None: not known."""

    k: FloatArray
    sensor: Sensor
    names: tuple[str, ...]
    sigma: float | None
    distribution: str


def _checked(number: int, scan: Scan, sensor: Sensor) -> Scan:
    try:
        return scan.checked(sensor)
    except (ReadingError, SignatureError) as error:
        raise type(error)(f"scan {number}: {error}") from None


def _search(episode: Episode, read: _Reading, thorough: bool = True) -> _Object | None:
    """Return the object of an episode; None where its scans are too few for a shape over time."""
    if len(episode.scans) < _FEWEST:
        return None
    level, step = read.sigma or max(_GUESS, read.sensor.adc_step), read.sensor.adc_step
    every = RigidScans(read.sensor, read.names, episode.readings(read.k), level)
    few = np.unique(np.linspace(0, len(every.k) - 1, min(len(every.k), _MOST)).astype(int))
    least = max(step / math.sqrt(12.0), FLOOR)
    for _ in range(_ROUNDS):
        found = search(every.of(few), read.distribution, thorough)
        left = level * math.sqrt(found.fit.cost / found.fit.freedom(every.of(few)))
        if read.sigma or level / _ALIKE < left < level * _ALIKE:
            break
        level = float(np.clip(left, least, _CEILING))
        every = every.with_sigma(level)
    return _Object(
        episode.scans, episode.joint, every, replace(found, fit=with_all_poses(every, few, found.fit))
    )


def _recognise(one: _Object, other: Episode, read: _Reading) -> _Object | None:
    """Return the object with another stretch of scans too, where its shape explains them; else None."""
    if not other.scans or not content(one.scans, one.found.fit, read.distribution):
        return None
    more = replace(one.scans, k=other.readings(read.k))
    fit = recognised(one.scans, one.found.fit, more, read.distribution)
    if fit is None:
        return None
    every = replace(one.scans, k=np.concatenate([one.scans.k, more.k]))
    few, kept = one.scans.of(one.found.chosen), []
    for rival, worse in one.found.rivals if one.found.spread_mm > _TOLD * one.scans.sensor.pitch_mm else ():
        if recognised(few, rival, more, read.distribution) is not None:
            kept.append((rival, worse))
    found = Found(fit, one.found.chosen, tuple(kept))
    return _Object(one.shown + other.scans, one.joint + other.joint, every, found)


def _together(
    objects: list[_Object], unlike: list[Episode], stretches: list[Episode], read: _Reading
) -> tuple[list[_Object], list[Episode]]:
    """Return objects with what scans add in which they share strips, and the episodes that remain unexplained."""
    if not available():
        return objects, unlike
    touched = np.asarray(np.isfinite(read.k).any(axis=1))
    for group in {id(e.group): e.group for e in stretches}.values():
        bent = [e for e in unlike if any(e is g for g in group) and len(e.scans) >= _FEWEST]
        if not (bent or (objects and any(e.joint for e in group))):
            continue
        parts = [part for e in bent for part in _parts(e, read)]
        readings = _readings(group, read.k)
        first = min((s for e in group for s in e.joint), default=0)
        for known in _suppositions(objects, parts, group, first, read):
            sigma = max(one.scans.sigma for one in known)
            found = follow(
                [o.alone for o in known], readings, touched, read.sensor, read.names, sigma, read.distribution
            )
            if found is not None:
                objects = [o if f is None else o.with_shared(f) for o, f in zip(known, found, strict=True)]
                unlike = [e for e in unlike if not any(e is g for g in group)]
                break
        else:
            mine = {s for e in group for s in e.scans}
            objects = [o.unexplained if mine & set(o.shown) else o for o in objects]
    return objects, unlike


def _suppositions(
    objects: list[_Object], parts: list[_Object], group: list[Episode], first: int, read: _Reading
) -> Iterator[list[_Object]]:
    """Yield what may be known of the objects of a group that comes together in its scan `first`, most likely first.

    Parts of episodes may be objects that are known already, and stretches that were taken for the same may be of two
    that look alike: then only those before the first joint scan count, and the others follow from the motion.
    """
    if parts:
        yield _with_parts(objects, parts, read, True)
        yield _with_parts(objects, parts, read, False)
    elif objects:
        yield objects
        before = [o.until(first) for o in objects if min(o.shown) < first]
        if len(before) > 1 and any(
            len(b.shown) < len(o.shown) for b, o in zip(before, objects, strict=False)
        ):
            yield before
        # objects that come together and are lifted one after the other: the last of them is alone at the end
        stretches = {tuple(e.joint): e.joint_runs for e in group if len(e.joint) >= _FEWEST}
        ends = [Episode(list(joint), runs) for joint, runs in stretches.items()]
        last = [part for e in ends for part in _parts(e, read, (True,))]
        if last:
            yield _with_parts(objects, last, read, True)


def _parts(episode: Episode, read: _Reading, ends: tuple[bool, ...] = (False, True)) -> list[_Object]:
    """Return the objects that the first (False) and the last scans of an episode show by themselves."""
    every = RigidScans(read.sensor, read.names, episode.readings(read.k), read.sigma or _GUESS)
    return [
        _Object([episode.scans[i] for i in some], [], every.of(np.array(some)), found)
        for some, found in lone_ends(every, read.distribution, ends)
    ]


def _with_parts(objects: list[_Object], parts: list[_Object], read: _Reading, again: bool) -> list[_Object]:
    """Return objects with those of parts of episodes, where wanted as the same if a shape is recognised."""
    known = list(objects)
    for part in parts:
        for i, one in enumerate(known) if again else ():
            fit = None
            if not set(part.shown) & set(one.shown):
                fit = recognised(one.scans, one.found.fit, part.scans, read.distribution)
            if fit is not None:
                every = replace(one.scans, k=np.concatenate([one.scans.k, part.scans.k]))
                known[i] = replace(
                    one, shown=one.shown + part.shown, scans=every, found=replace(one.found, fit=fit)
                )
                break
        else:
            known.append(part)
    return known


def _readings(group: list[Episode], k: FloatArray) -> dict[int, FloatArray]:
    """Return the readings of a group of episodes, scan by scan (S, n), NaN where others touch."""
    found: dict[int, FloatArray] = {}
    for one in group:
        for scan, run in zip([*one.scans, *one.joint], [*one.runs, *one.joint_runs], strict=True):
            own = found.setdefault(scan, np.full(k.shape[1:], np.nan))
            own[:, run] = k[scan][:, run]
    return found


def _track(one: _Object, total: int, distribution: str) -> Track:
    """Return what is known of an object over time."""
    fit, sensor = one.found.fit, one.scans.sensor
    corners, first = fit.corners, int(np.argmin(one.shown))
    middle, angle = corners.mean(axis=0), float(fit.poses[first, 2])
    outline = _turned(corners - middle, angle)
    rows = _reframed(fit.poses, middle, angle)
    if _signed_area(outline) < 0.0:
        outline = outline[::-1]
    shape, of_poses = covariances(one.scans, outline, rows)
    poses, spreads = np.full((total, 3), np.nan), np.full((total, 3, 3), np.nan)
    poses[one.shown], spreads[one.shown] = rows, of_poses
    for more in one.shared:
        poses[more.scans] = _reframed(more.poses, middle, angle)
        spreads[more.scans] = more.covariances
    advice = note = ""
    if not content(one.scans, fit, distribution):
        times = math.sqrt(fit.cost / fit.freedom(one.scans))
        advice = _NOT_RIGID.format(times=times)
    loosest = math.sqrt(float(shape.diagonal().reshape(-1, 2).sum(axis=1).max()))
    spread = one.found.spread_mm
    size = float(np.ptp(outline, axis=0).max())
    told = spread <= max(_TOLD * sensor.pitch_mm, _OF_SIZE * size, _TELLING * loosest)
    if not advice and not told:
        advice = _NOT_TOLD.format(spread=spread)
    elif not advice and _hardly_moved(one, outline, poses[np.isfinite(poses[:, 0])]):
        told, advice = False, _HARDLY_MOVED.format(n=len(one.shown))
    elif not advice and _reflex(outline):
        note = _CONCAVE
    shared = "; ".join(dict.fromkeys(more.advice for more in one.shared if more.advice))
    advice = "; ".join(filter(None, [advice, shared]))
    others = tuple(Alternative(weight, _turned(o - middle, angle)) for o, weight in one.found.others)
    status: Status = "doubtful" if advice else "likely" if note else "ok"
    return Track(
        0, outline, shape, poses, spreads, np.empty(0), np.empty(0), status, advice or note, () if told else others,
        tuple(sorted({*one.joint, *(s for more in one.shared for s in more.joint)})),
    )  # fmt: skip


def _reframed(poses: FloatArray, middle: FloatArray, angle: float) -> FloatArray:
    """Return poses (M, 3) of a frame about a point of the old one, turned."""
    moved = np.array([placed(middle[None], p)[0] for p in poses]).reshape(-1, 2)
    return np.column_stack([moved, poses[:, 2] - angle])


def _hardly_moved(one: _Object, outline: FloatArray, poses: FloatArray) -> bool:
    """Whether few strips read the outline at always the same places."""
    strips = np.median(np.isfinite(one.scans.k).any(axis=1).sum(axis=1))
    x = np.stack([placed(outline, pose)[:, 0] for pose in poses])
    return bool(strips < _FEW_STRIPS and np.median(np.ptp(x, axis=0)) < _MOVED * one.scans.sensor.pitch_mm)


def _reflex(corners: FloatArray) -> bool:
    """Whether a corner of an outline, counter-clockwise, turns inwards."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return bool((before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0.0).any())


def _of_one_scan(one: Episode, scans: list[Scan], sensor: Sensor, noise: Noise | None) -> Track:
    """Return the track of an object that too few scans show: the shape of the one in which it touches most strips."""
    widest = max(range(len(one.scans)), key=lambda i: one.runs[i].stop - one.runs[i].start)
    scan, run = scans[one.scans[widest]], one.runs[widest]
    mine = np.arange(sensor.strips)
    inside = (mine >= run.start) & (mine < run.stop)
    kept: dict[str, Any] = {name: np.where(inside, scan[name], np.nan) for name in scan.signatures}
    alone = replace(scan, **kept)
    shape = fit_polygon(alone, sensor, noise, bounded=False).objects[0]
    poses, spreads = np.full((len(scans), 3), np.nan), np.full((len(scans), 3, 3), np.nan)
    outline = shape.vertices
    if len(outline):
        middle = outline.mean(axis=0)
        outline, poses[one.scans[widest]] = outline - middle, (*middle, 0.0)
    advice = "; ".join(filter(None, [_SHORT.format(n=len(one.scans)), shape.advice]))
    return Track(
        0, outline, shape.covariance, poses, spreads, np.empty(0), np.empty(0), shape.status, advice,
        shape.alternatives, tuple(one.joint),
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

"""Objects over time from many scans: one rigid outline each, known better than from any single scan, and its poses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.hull import available
from tacstrip.core.problem import FLOOR
from tacstrip.core.rigid import RigidScans
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.pose import placed
from tacstrip.notebook import BLUE, VERMILION, Drawn, SvgPath
from tacstrip.reconstruction.implausible import doubted, scale_hint
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import refuse_stretched
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import Alternative, RecoveredObject, Status
from tacstrip.reconstruction.seam import BRIDGED, opened
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode, episodes, only, spanned
from tacstrip.tracking.rigid.corners import FIRST, Fit, posed, reflex
from tacstrip.tracking.rigid.covariance import covariances, following, information
from tacstrip.tracking.rigid.offsets import not_ruled_out, taken_off, with_offsets
from tacstrip.tracking.rigid.posterior import scatter
from tacstrip.tracking.rigid.rivals import beside_rivals, poses_beside_rivals, with_a_corner_cut
from tacstrip.tracking.rigid.search import (
    FEW_STRIPS,
    LEAST_STRIPS,
    Found,
    compared_again,
    content,
    counted_among_followers,
    freer_spline,
    recognised,
    search,
    with_all_poses,
)
from tacstrip.tracking.shared_strips.follow import follow
from tacstrip.tracking.shared_strips.known import Alone, Shared
from tacstrip.tracking.shared_strips.lone_ends import lone_ends
from tacstrip.tracking.single_scans import SingleScans

FEWEST = 5  # scans of one stretch that a shape is searched in
MOST = 200  # scans that a shape is fitted to; the others only have their poses fitted
GUESS, _CEILING = 0.003, 0.02 / math.sqrt(3.0)  # of sigma that is not known [Vref]
_ALIKE = 1.25  # times a guess of sigma: found again, it is believed
_ROUNDS = 3  # of finding sigma
_TOLD, _OF_SIZE = 0.1, 0.01  # of the pitch, and of the outline's extent, and ...
_TELLING = 4.0  # ... deviations of the least certain corner: shapes that differ by more are not the same
_MAY_BE_OFF = 0.05  # of the extent, by which no corner may be off ...
_DEVIATIONS = 2.0  # ... within so many deviations
_LOOKS = 3  # single scans that are asked whether strips between touched ones are dead
# Squared errors of outlines with offsets over their covariance, as measured: so loose, their cost has small minima at
# kinks, of which the readings prefer none.
_KINKED = 1.2
_DRAWN = 6  # outlines of a track in a notebook
_COUNTED = 0.05  # pitches, by which an outline of another count is off, for the count to matter
_MOVED = 0.5  # pitches that corners must move where few strips are touched
NOT_RIGID = (
    "no rigid outline explains all scans: {times:.3g} times the noise is left over; the object deforms or rolls, two "
    "are taken for one, or the noise is larger than given: read the scans one by one (`single`)"
)
_NOT_TOLD = (
    "the motion does not tell the shape: outlines that differ by {spread:.2g} mm explain all scans; turn the object, "
    "or slide it across the strips by more than half a pitch"
)
_COUNT = (
    "the number of corners is open: an outline of {n} explains the scans nearly as well; turn the object further, or "
    "take more scans"
)
_HARDLY_MOVED = (
    "its corners stay over the same strips in all {n} scans, which so tell little more of the shape than one: turn the "
    "object further, or slide it across the strips by more than half a pitch"
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
_SMOOTH = (
    "one signature on few strips tells the shape only as far as the motion is smooth: corners and poses may be off by "
    "more than their regions say"
)
_NO_PATH = (
    "one signature on few strips, and no smooth motion explains the scans: the poses take up most of what the scans "
    "tell of the shape; read both signatures, or move the object smoothly"
)
_CURVED = (
    "an outline of {n} corners stands for a curve, and with one signature on few strips a wrong motion may look like "
    "one: read both signatures"
)
_WANDERS = (
    "errors of channels follow each other from scan to scan: many scans are worth fewer, and a corner may be made of "
    "such errors; regions of the shape are {times:.2g} times as wide. Calibrate, or let the unit warm up"
)
_SHORT = "{n} scans show it, too few for a shape over time: the outline is that of the scan that tells most"
_UNEXPLAINED = (
    "in the scans in which it shares strips the known objects do not explain the readings: another is there that is "
    "never alone, or one outline is that of two"
)
_LOOKS_ALIKE = "another that it shared strips with looks like it: after they parted each may be the other"
STANDS = "the clock stands still: no velocity"


@dataclass(frozen=True, eq=False)
class Track(Drawn):
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
        "ok", "likely" or "doubtful" (read the advice), or that of the single scan which showed most of it.
    advice
        In words; empty when all is well.
    alternatives
        Other outlines that explain the scans as well, in this object's frame.
    joint
        Scans in which it shared strips with another object. It has a pose there where the objects that are known from
        other scans explain the readings.
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

    def __repr__(self) -> str:
        corners = f"{len(self.outline)} corners, {self.area_mm2:.4g} mm2"
        return f"<Track {self.id}: {self.status}, {corners}, in {int(self.present.sum())} of {len(self.poses)} scans>"

    def _paths(self) -> list[SvgPath]:
        seen = np.flatnonzero(self.present)
        shown = seen[np.unique(np.linspace(0, len(seen) - 1, _DRAWN).astype(int))] if len(seen) else seen
        outlines = [SvgPath(self.placed(int(i)), stroke=VERMILION, fill=VERMILION, width=1.0) for i in shown]
        return [*outlines, SvgPath(self.centroids, stroke=BLUE, closed=False)]

    @property
    def present(self) -> FloatArray:
        """Whether each scan shows it (T,)."""
        return np.asarray(np.isfinite(self.poses[:, 0]))

    @property
    def centroids(self) -> FloatArray:
        """Centroid of the rigid outline on the sensor in every scan (T, 2) [mm]; NaN where it is absent."""
        if not len(self.outline):
            return np.full((len(self.poses), 2), np.nan)
        own, (cos, sin) = moments(self.outline)[1], (np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2]))
        turned = np.stack([cos * own[0] - sin * own[1], sin * own[0] + cos * own[1]], axis=1)
        return np.asarray(self.poses[:, :2] + turned)

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
    ...     ts.simulate(sensor, shape.turned(0.02 * i).placed(40 + 0.5 * i, 50), noise, rng=100 + i, time_s=0.01 * i)
    ...     for i in range(30)
    ... ]
    >>> (one,) = ts.track(scans, sensor, noise)
    >>> one.status, len(one.outline), bool(abs(one.poses[-1, 2] - one.poses[0, 2] - 0.58) < 0.02)
    ('ok', 4, True)
    """
    check_closed_form(sensor.kind, "track")
    refuse_stretched(sensor, "track")
    scans = list(scans)
    read = [_checked(i, scan, sensor) for i, scan in enumerate(scans)]
    if not read:
        raise ReadingError("there is no scan: give those of a recording, in the order of time")
    times = np.array([scan.time_s for scan in read])
    if len(back := np.flatnonzero(np.diff(times) < 0.0)):
        i = int(back[0]) + 1
        raise ReadingError(
            f"scan {i} is from {times[i]:.12g} s, before scan {i - 1} from {times[i - 1]:.12g} s: sort the scans "
            "by time"
        )
    own = scans[0].signatures
    for i, scan in enumerate(scans):
        if scan.signatures != own:
            raise ReadingError(
                f"scan {i} has {' and '.join(scan.signatures)}, and scan 0 {' and '.join(own)}: give scans alike"
            )
    # a scan that touches only strips whose other channel is left out lacks a signature that others have
    names = tuple(name for name in own if any(np.isfinite(scan.reading(name)).any() for scan in read)) or own
    noise = sensor.noise if noise is None else noise
    k = np.stack([np.stack([scan.reading(name) for name in names]) for scan in read])
    sigma = None if noise is None else max(fit_sigma(noise, sensor, Averaging.of(read[0])), FLOOR)
    distribution = "normal" if noise is None or not noise.independent else noise.distribution
    stretches = episodes(k, sensor.closed, _silent(read, sensor, noise))
    readings = Readings(k, Skin(sensor, spanned(stretches, sensor.strips)), names, sigma, distribution)
    left, unlike, objects = sorted(stretches, key=lambda e: -len(e.scans)), list[Episode](), list[Object]()
    tried: dict[int, Object | None] = {}
    while left:
        one = left.pop(0)
        hurried = readings.followable and not any(e.joint for e in one.group)
        seen = searched(one, readings, thorough=not hurried)
        if seen is None or not content(seen.scans, seen.found.fit, distribution):
            unlike.append(one)
            tried[id(one)] = seen
        else:
            new = _with_stretches(seen, one, left, readings)
            objects = _explained_too(new, objects, readings)
    objects, unlike = _together(objects, unlike, stretches, readings)
    tracks: list[tuple[int, Track]] = []
    while unlike:
        one = unlike.pop(0)
        seen = tried[id(one)]
        if seen is not None and seen.begun is not None:
            seen = searched(one, readings, begun=seen.begun)
        if seen is None:
            tracks.append((one.scans[0], _of_one_scan(one, read, sensor, noise)))
        else:
            objects.append(_with_stretches(seen, one, unlike, readings))
    for each in objects:
        found = summarised(each, read, readings, noise)
        tracks.append((int(np.argmax(found.present)), found))
    standing = STANDS if len(times) > 1 and not np.diff(times).any() else ""
    outlines = [placed(t.outline, t.poses[i]) for _, t in tracks for i in np.flatnonzero(t.present)]
    scale = scale_hint(read, outlines, sensor)
    done = []
    for i, (_, t) in enumerate(sorted(tracks, key=lambda pair: (pair[0], pair[1].poses[pair[0], 0])), 1):
        status, advice = doubted(t.status, t.advice, scale)
        advice = "; ".join(filter(None, [advice, standing]))
        velocities = _velocities(t.poses, times)
        done.append(replace(t, id=i, times_s=times, velocities=velocities, status=status, advice=advice))
    return done


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
        return opened(self.sensor, self.span.stop - self.span.start)


@dataclass(frozen=True, eq=False)
class Object:
    """The scans that show one object by itself, its readings there, and what was found; and with others.

    `alike`: one of those that share strips with it has its shape. `begun`: what a search that was not thorough found.
    """

    shown: list[int]
    joint: list[int]
    runs: list[slice]
    scans: RigidScans
    found: Found
    shared: tuple[Shared, ...] = ()
    alike: bool = False
    begun: Found | None = field(default=None, repr=False)

    @property
    def places(self) -> set[tuple[int, int]]:
        """Scans that show it by itself, and its first strip there."""
        return {(scan, run.start) for scan, run in zip(self.shown, self.runs, strict=True)}

    @property
    def followable(self) -> bool:
        """Whether it can be followed where it shares strips: there channels have no offsets and poses no spline."""
        return (
            self.found.offsets is None
            and self.found.fit.basis is None
            and self.scans.strips_touched >= LEAST_STRIPS
        )

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
            tuple(
                (f.corners, f.poses[order])
                for f in self.found.unlike(self.scans, _TOLD * self.scans.sensor.pitch_mm)
            ),
        )

    @property
    def unexplained(self) -> Object:
        """It with the advice that what it shares strips with is not known."""
        return replace(self, shared=(*self.shared, Shared(self.found.fit.corners, {}, advice=_UNEXPLAINED)))

    def without(self, places: set[tuple[int, int]]) -> Object | None:
        """Return what is known of it without some scans and places; None where nothing is left."""
        at = zip(self.shown, self.runs, strict=True)
        kept = [i for i, (scan, run) in enumerate(at) if (scan, run.start) not in places]
        if not kept:
            return None
        fit = self.found.fit
        fit = Fit(fit.corners, fit.poses[kept], fit.costs[kept])
        shown, runs = [self.shown[i] for i in kept], [self.runs[i] for i in kept]
        return Object(shown, [], runs, self.scans.of(kept), Found(fit, np.arange(len(kept))))

    def with_shared(self, more: Shared) -> Object:
        """Return it with scans in which it shares strips, and the outline that they sharpened."""
        last = self.found.fit.poses
        start = np.stack([more.again.get(s, p) for s, p in zip(self.shown, last, strict=True)])
        fit = posed(self.scans, Fit(more.corners, start, np.full(len(start), np.inf)))
        rivals = tuple(
            (replace(fit, corners=o, poses=fit.poses[self.found.chosen]), w) for o, w in more.rivals
        )
        return replace(self, found=replace(self.found, fit=fit, rivals=rivals), shared=(*self.shared, more))


@dataclass(frozen=True, eq=False)
class Readings:
    """All readings (T, S, n), and what is known of them; sigma None: not known."""

    k: FloatArray
    skin: Skin
    names: tuple[str, ...]
    sigma: float | None
    distribution: str

    @property
    def followable(self) -> bool:
        """Whether objects can be followed where they share strips: with both signatures, and compiled."""
        return available() and len(self.names) > 1

    @property
    def touched(self) -> BoolArray:
        """Strips of the skin that are touched (T, n)."""
        span = self.skin.span
        own = np.arange(span.start, span.stop) % self.k.shape[2]
        return np.asarray(np.isfinite(self.k).any(axis=1))[:, own]


def _silent(scans: list[Scan], sensor: Sensor, noise: Noise | None) -> BoolArray:
    """Return the strips of which nothing is known (n,): those left out as a whole, and dead ones within a contact.

    A few neighbours that no scan touches may be dead, or lie between two objects: single scans tell which.
    """
    silent, n = left_out_wholly(sensor).copy(), sensor.strips
    touched = np.stack([scan.touched for scan in scans])
    ever = touched.any(axis=0)
    at = np.flatnonzero(ever)
    for i, left in enumerate(at):
        right = at[i + 1] if i + 1 < len(at) else at[0] + n if sensor.closed else left
        gap = np.arange(left + 1, right) % n
        if not 0 < len(gap) <= BRIDGED or silent[gap].all():
            continue
        both = np.flatnonzero(touched[:, left] & touched[:, right % n])
        some = (
            both[np.unique(np.linspace(0, max(len(both) - 1, 0), _LOOKS).astype(int))] if len(both) else both
        )
        fits = (fit_polygon(scans[j], sensor, noise, bounded=False, assessment="none") for j in some)
        across = [
            any(np.isin(gap, np.arange(*o.strips.indices(2 * n)) % n).all() for o in f.objects) for f in fits
        ]
        silent[gap] |= 2 * sum(across) > len(across)
    return silent


def _checked(number: int, scan: Scan, sensor: Sensor) -> Scan:
    try:
        return scan.checked(sensor)
    except (ReadingError, SignatureError) as error:
        raise type(error)(f"scan {number}: {error}") from None


def searched(
    episode: Episode,
    read: Readings,
    *,
    offsets: bool = True,
    thorough: bool = True,
    begun: Found | None = None,
) -> Object | None:
    """Return the object of an episode; None where its scans are too few for a shape over time.

    `begun`: what a search that was not thorough ended with, `Object.begun`.
    """
    if len(episode.scans) < FEWEST:
        return None
    step = read.skin.sensor.adc_step
    level = read.sigma or max(GUESS, step)
    if begun is not None and begun.starts is not None:
        level = begun.starts.scans.sigma
    every = RigidScans(read.skin.laid_out, read.names, episode.readings(read.k, read.skin.span), level)
    few = np.unique(np.linspace(0, len(every.k) - 1, min(len(every.k), MOST)).astype(int))
    least = max(step / math.sqrt(12.0), FLOOR)
    for _ in range(_ROUNDS):
        ended = search(every.of(few), read.distribution, offsets=offsets, thorough=thorough, begun=begun)
        left = level * math.sqrt(ended.fit.cost / ended.fit.freedom(every.of(few)))
        if read.sigma or level / _ALIKE < left < level * _ALIKE:
            break
        level, begun = float(np.clip(left, least, _CEILING)), None
        every = every.with_sigma(level)
    rest = taken_off(every.of(few), ended.offsets)
    if ended.fit.basis is None and content(rest, ended.fit, read.distribution):
        ended = counted_among_followers(rest, ended, read.distribution)
    every = taken_off(every, ended.offsets)
    fit = with_all_poses(every, few, ended.fit)
    found = replace(ended, fit=fit, chosen=few[ended.chosen], starts=None)
    kept = None if thorough else ended
    return Object(episode.scans, episode.joint, episode.runs, every, found, begun=kept)


def _with_stretches(one: Object, start: Episode, left: list[Episode], read: Readings) -> Object:
    """Return the object with those of other stretches that its shape explains, which are taken away."""
    others = (e for e in start.group if e is not start and set(e.scans) & set(one.shown))
    one = joined = replace(one, alike=any(_recognise(one, e, read) is not None for e in others))
    for other in list(left):
        again = None if set(other.scans) & set(joined.shown) else _recognise(joined, other, read)
        if again is not None:
            joined = again
            left.remove(other)
    return one if joined is one else _counted_again(joined, one.found, read)


def _explained_too(new: Object, objects: list[Object], read: Readings) -> list[Object]:
    """Return the objects and a new one, which takes in those that its shape explains: theirs were too little told."""
    kept, joined = list[Object](), new
    for other in objects:
        apart = not (set(other.shown) & set(joined.shown) or other.joint or joined.joint)
        again = _recognise(joined, Episode(other.shown, other.runs), read) if apart else None
        joined, kept = (joined, [*kept, other]) if again is None else (again, kept)
    return [*kept, new if joined is new else _counted_again(joined, new.found, read)]


def _recognise(one: Object, other: Episode, read: Readings) -> Object | None:
    """Return the object with another stretch of scans too, where its shape explains them; else None."""
    if one.found.fit.basis is not None or not content(one.scans, one.found.fit, read.distribution):
        return None
    more = taken_off(replace(one.scans, k=other.readings(read.k, read.skin.span)), one.found.offsets)
    fit = recognised(one.scans, one.found.fit, more, read.distribution)
    if fit is None:
        return None
    every = replace(one.scans, k=np.concatenate([one.scans.k, more.k]))
    return replace(
        one,
        shown=one.shown + other.scans,
        joint=one.joint + other.joint,
        runs=one.runs + other.runs,
        scans=every,
        found=replace(one.found, fit=fit),
    )


def _counted_again(one: Object, before: Found, read: Readings) -> Object:
    """Return an object of several stretches with its corners counted over all of them, and what rivals remain.

    `before`: what was found of the first.
    """
    order = np.argsort(one.shown)
    scans, fit = one.scans.of(order), one.found.fit
    fit = replace(fit, poses=fit.poses[order], costs=fit.costs[order])
    few = np.unique(np.linspace(0, len(order) - 1, min(len(order), MOST)).astype(int))
    some = scans.of(few)
    begun = replace(fit, poses=fit.poses[few], costs=fit.costs[few])
    found = compared_again(some, before, begun, read.distribution)
    found = replace(
        counted_among_followers(some, found, read.distribution), chosen=few, offsets=before.offsets
    )
    if len(few) < len(order):
        found = replace(found, fit=posed(scans, replace(fit, corners=found.fit.corners)))
    shown, runs = [one.shown[i] for i in order], [one.runs[i] for i in order]
    return replace(one, shown=shown, runs=runs, scans=scans, found=found)


def _together(
    objects: list[Object], unlike: list[Episode], stretches: list[Episode], read: Readings
) -> tuple[list[Object], list[Episode]]:
    """Return objects with what scans add in which they share strips, and the episodes that remain unexplained."""
    if not read.followable:
        return objects, unlike
    aside, objects = [o for o in objects if not o.followable], [o for o in objects if o.followable]
    touched, laid_out = read.touched, read.skin.laid_out
    for group in {id(e.group): e.group for e in stretches}.values():
        bent = [e for e in unlike if any(e is g for g in group) and len(e.scans) >= FEWEST]
        if not (bent or (objects and any(e.joint for e in group))):
            continue
        mine = {(s, run.start) for e in group for s, run in zip(e.scans, e.runs, strict=True)}
        if not bent and any(mine & o.places for o in aside):
            continue
        both = not objects and len(bent) == 1  # one object by itself shares strips with none
        parts = [part for e in bent for part in _parts(e, read, both=both)]
        readings = _of_group(group, read)
        first = min((s for e in group for s in e.joint), default=0)
        later = {place for place in mine if place[0] >= first}
        for known in _suppositions(objects, parts, group, later, read):
            if len(known) < 2:  # one by itself shares strips with none
                continue
            sigma = max(one.scans.sigma for one in known)
            alone = [o.alone for o in known]
            found = follow(alone, readings, touched, laid_out, read.names, sigma, read.distribution)
            # Objects that take turns without a scan in common are one that deforms.
            if found is not None and any(f is not None and f.joint for f in found):
                objects = [o if f is None else o.with_shared(f) for o, f in zip(known, found, strict=True)]
                unlike = [e for e in unlike if not any(e is g for g in group)]
                break
        else:
            objects = [o.unexplained if mine & o.places else o for o in objects]
    return [*objects, *aside], unlike


def _suppositions(
    objects: list[Object],
    parts: list[Object],
    group: list[Episode],
    later: set[tuple[int, int]],
    read: Readings,
) -> Iterator[list[Object]]:
    """Yield what may be known of the objects of a group that comes together, most likely first.

    Parts of episodes may be objects that are known already, and stretches that were taken for the same may be of two
    that look alike: then `later` places, after they first came together, do not count, and follow from the motion.
    """
    if parts:
        came = {episode.scans[0] for episode in group}
        begun = [part for part in parts if part.shown[0] in came]
        if objects and len(begun) < len(parts):  # what nobody saw come may be known objects, side by side
            yield _with_parts(objects, begun, read, True)
        together = _with_parts(objects, parts, read, True)
        yield together
        if len(together) < len(objects) + len(parts):
            yield _with_parts(objects, parts, read, False)
    elif objects:
        before = [b for o in objects if (b := o.without(later) if o.places & later else o) is not None]
        shortened = any(o.places & later for o in objects)
        if not (shortened and any(o.alike for o in objects if o.places & later)):
            yield objects
        if shortened and len(before) > 1:
            yield before
        # objects that come together and are lifted one after the other: the last of them is alone at the end
        stretches = {tuple(e.joint): e.joint_runs for e in group if len(e.joint) >= FEWEST}
        ends = [Episode(list(joint), runs) for joint, runs in stretches.items()]
        last = [part for e in ends for part in _parts(e, read, (True,))]
        if last:
            yield _with_parts(objects, last, read, True)


def _parts(
    episode: Episode, read: Readings, ends: tuple[bool, ...] = (False, True), *, both: bool = False
) -> list[Object]:
    """Return the objects that the first (False) and the last scans of an episode show by themselves."""
    every = RigidScans(
        read.skin.laid_out, read.names, episode.readings(read.k, read.skin.span), read.sigma or GUESS
    )
    if every.strips_touched < LEAST_STRIPS:
        return []
    return [
        Object(
            [episode.scans[i] for i in some],
            [],
            [episode.runs[i] for i in some],
            every.of(np.array(some)),
            found,
        )
        for some, found in lone_ends(every, read.distribution, ends, both=both)
    ]


def _with_parts(objects: list[Object], parts: list[Object], read: Readings, again: bool) -> list[Object]:
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
                    one,
                    shown=one.shown + part.shown,
                    runs=one.runs + part.runs,
                    scans=every,
                    found=replace(one.found, fit=fit),
                )
                break
        else:
            known.append(part)
    return known


def _of_group(group: list[Episode], read: Readings) -> dict[int, FloatArray]:
    """Return the readings of a group of episodes, scan by scan (S, strips of the skin), NaN where others touch."""
    found: dict[int, FloatArray] = {}
    for one in group:
        for scan, run in zip([*one.scans, *one.joint], [*one.runs, *one.joint_runs], strict=True):
            own = only(read.k[scan], run, read.skin.span)
            found[scan] = np.where(np.isfinite(own), own, found.get(scan, np.nan))
    return found


def summarised(one: Object, scans: list[Scan], read: Readings, noise: Noise | None) -> Track:
    """Return what is known of an object over time."""
    fit, skin, total = one.found.fit, read.skin, len(scans)
    sensor = skin.sensor
    if _signed_area(fit.corners) < 0.0:
        fit = replace(fit, corners=fit.corners[::-1])
    corners, first = fit.corners, int(np.argmin(one.shown))
    middle, angle = corners.mean(axis=0), float(fit.poses[first, 2])
    outline, spin = _turned(corners - middle, angle), _turned(np.eye(2), angle)
    equations = information(one.scans, corners, fit.poses)
    offsets = one.found.offsets
    deviation = offsets.upper if offsets else not_ruled_out(one.scans, fit)
    if deviation:
        equations = with_offsets(one.scans, fit, equations, deviation)
    shape, of_poses = covariances(equations, corners, fit.poses, freer_spline(fit.basis))
    order = np.argsort(one.shown)
    wider = following(one.scans.of(order), corners, fit.poses[order])
    of_poses = poses_beside_rivals(one.scans, one.found, of_poses)
    shape = wider**2 * beside_rivals(one.scans, one.found, shape, deviation)
    if offsets and fit.basis is None and one.scans.strips_touched < FEW_STRIPS:
        shape *= _KINKED
    all_spin = np.kron(np.eye(len(corners)), spin.T)
    shape = np.asarray(all_spin @ shape @ all_spin.T)
    poses, spreads = np.full((total, 3), np.nan), np.full((total, 3, 3), np.nan)
    poses[one.shown], spreads[one.shown] = _reframed(fit.poses, of_poses, middle, angle)
    for more in one.shared:
        poses[more.scans], spreads[more.scans] = _reframed(more.poses, more.covariances, middle, angle)
    poses[:, 0] += skin.span.start * sensor.pitch_mm
    poses[:, 2] = _less_than_half_turns(poses[:, 2])
    advice, note, alone = "", "", None
    explained = content(one.scans, fit, read.distribution)
    if one.scans.strips_touched < LEAST_STRIPS and not one.shared:
        advice = _SMALL
    elif not explained:
        times = math.sqrt(fit.cost / fit.freedom(one.scans))
        advice = NOT_RIGID.format(times=times)
    if not explained:
        alone = SingleScans(scans, dict(zip(one.shown, one.runs, strict=True)), sensor, noise)
    concave, few = bool(reflex(outline).any()), one.scans.strips_touched < FEW_STRIPS
    loosest = math.sqrt(float(shape.diagonal().reshape(-1, 2).sum(axis=1).max()))
    spread = one.found.spread_mm
    size = float(np.ptp(outline, axis=0).max())
    unsure = max(_TOLD * sensor.pitch_mm, _MAY_BE_OFF * size)
    told = spread <= max(_TOLD * sensor.pitch_mm, _OF_SIZE * size, min(_TELLING * loosest, unsure))
    if not advice and not told:
        advice = _NOT_TOLD.format(spread=spread)
    elif not advice and _hardly_moved(one, outline, poses[np.isfinite(poses[:, 0])]):
        told, advice = False, _HARDLY_MOVED.format(n=len(one.shown))
    elif not advice and fit.basis is None and len(one.scans.read) == 1 and few:
        told, advice = False, _NO_PATH
    elif not advice and fit.basis is not None and few and len(outline) >= FIRST:
        told, advice = False, _CURVED.format(n=len(outline))
    if not advice and concave and fit.basis is None:
        loosest = max(loosest, scatter(one.scans, fit))
    if not advice and _DEVIATIONS * loosest > unsure:
        told, advice = False, _LOOSE.format(far=_DEVIATIONS * loosest)
    elif not advice and (other := one.found.of_other_count(_COUNTED * sensor.pitch_mm)):
        told, advice = False, _COUNT.format(n=other)
    elif not advice and (cut := _with_a_corner_cut(one)):
        told, advice, one = False, _COUNT.format(n=len(outline) + 1), cut
    elif not advice:
        tied = fit.basis is not None and few
        wander = [_WANDERS.format(times=wider)] * (wider > 1.0)
        note = "; ".join([_CONCAVE] * concave + [_SMOOTH] * tied + wander)
    parted = bool(one.joint) and max(one.shown) > min(one.joint)
    more_advice = (
        [_LOOKS_ALIKE] if one.alike and parted and not one.shared else [m.advice for m in one.shared]
    )
    advice = "; ".join(dict.fromkeys(filter(None, [advice, *more_advice])))
    others = tuple(Alternative(weight, _turned(o - middle, angle)) for o, weight in one.found.others)
    status: Status = "doubtful" if advice else "likely" if note else "ok"
    joint = tuple(sorted({*one.joint, *(s for more in one.shared for s in more.joint)}))
    return Track(
        0, outline, shape, poses, spreads, np.empty(0), np.empty(0), status, advice or note, () if told else others,
        joint, _motion(fit), _offsets(one, skin), alone,
    )  # fmt: skip


def _with_a_corner_cut(one: Object) -> Object | None:
    """Return the object with the rival of which a corner is two, where few strips or one signature allow that."""
    fit, chosen = one.found.fit, one.found.chosen
    few = one.scans.strips_touched < FEW_STRIPS or len(one.scans.read) == 1
    part = fit.basis is not None and len(chosen) < len(fit.poses)
    shared = bool(one.shared)  # scans that it shares strips in have sharpened it, and are not among these
    if shared or not few or part or len(fit.corners) + 1 >= FIRST or reflex(fit.corners).any():
        return None
    some, fit = one.scans.of(chosen), replace(fit, poses=fit.poses[chosen], costs=fit.costs[chosen])
    cut = with_a_corner_cut(some, fit, _COUNTED * some.sensor.pitch_mm)
    if cut is None:
        return None
    rival = (cut, cut.criterion(some) - fit.criterion(some))
    return replace(one, found=replace(one.found, rivals=(*one.found.rivals, rival)))


def _reframed(
    poses: FloatArray, spreads: FloatArray, middle: FloatArray, angle: float
) -> tuple[FloatArray, FloatArray]:
    """Return poses (M, 3) and their covariances of a frame about a point of the old one, turned."""
    where = np.array([placed(middle[None], p)[0] for p in poses]).reshape(-1, 2)
    by = np.tile(np.eye(3), (len(poses), 1, 1))
    by[:, 0, 2], by[:, 1, 2] = poses[:, 1] - where[:, 1], where[:, 0] - poses[:, 0]
    moved = np.column_stack([where, poses[:, 2] - angle])
    return moved, np.asarray(by @ spreads @ by.transpose(0, 2, 1))


def _hardly_moved(one: Object, outline: FloatArray, poses: FloatArray) -> bool:
    """Whether few strips read the outline at always the same places."""
    x = np.stack([placed(outline, pose)[:, 0] for pose in poses])
    few = one.scans.strips_touched < FEW_STRIPS
    return bool(few and np.median(np.ptp(x, axis=0)) < _MOVED * one.scans.sensor.pitch_mm)


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


def _less_than_half_turns(angles: FloatArray) -> FloatArray:
    """Return angles (T,) [rad], NaN where absent, that go on by less than half a turn from one scan to the next."""
    found, present = angles.copy(), np.isfinite(angles)
    found[present] = np.unwrap(angles[present])
    return found


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

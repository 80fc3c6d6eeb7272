"""One contact while its scans come: what is kept of them, when its shape is searched for, and what is known of it."""

from __future__ import annotations

import math
from collections import deque
from concurrent.futures import Executor, Future
from concurrent.futures import wait as futures_wait
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, equations, loss
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.result import Alternative, Status
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode
from tacstrip.tracking.live_search import Contact, KnownShape, find_shape, moved
from tacstrip.tracking.objects import GUESS
from tacstrip.tracking.result import STANDS
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.fixed_lag import FixedLag, Known
from tacstrip.tracking.rigid.pose_spread import beyond_the_bound
from tacstrip.tracking.rigid.rivals import apart_mm
from tacstrip.tracking.rigid.search import FEW_STRIPS
from tacstrip.tracking.stretches import MOST
from tacstrip.tracking.summary import DEVIATIONS, tolerated_mm
from tacstrip.tracking.tracker import SEARCHED_AGAIN

_FIRST = 10  # scans of a contact before its shape is searched for
_LATER = 1.5  # times as many, before it is searched for again
_LOST = 5  # scans in turn that the shape does not explain
# Scans that came during a search: so many are taken with each new one; if there are more, they are where it ran.
_CAUGHT_UP, _FAR_BEHIND = 2, 8
_WAITING = 1024  # such scans; of more only every other is kept
_REMEMBERED = 8  # objects that were lifted or lost
_PROOF = 20  # scans that a shape found after an alarm must explain to be believed; twice as many after the next alarm
_NOT_RIGID = (
    "the shape that explained {scans} scans explains the last ones no more: the object deforms or rolls, another has "
    "taken its place, or two were taken for one; believe single scans until a shape is found"
)
_NOT_FOUND = "no shape explains its scans so far: believe single scans"
_UNPROVEN = "a shape found after an alarm has explained {scans} scans so far, and is believed after {proof}"
_JOINT = "it shares strips with another object, so that this scan does not tell its pose"
_EITHER = "it is object {which}: they shared strips, and the readings do not tell which is which"
_UNEXPLAINED = "the shape that explains the other scans does not explain this one"
_PLACE = "this scan leaves a corner's place open: it may lie anywhere within a gap between strips"
_BACK = "the clock went back: no velocity"
_WIDE = 0.01  # of the length: on wider strips outlines over time are off by too much to be likely
_LINES = (
    "strips are {width:g} mm wide, which an outline over time leaves out: its corners may be off by half of that, "
    "and by more than their regions say"
)


@dataclass(frozen=True, eq=False)
class LiveTrack:
    """One object over time, as of the last scan.

    Attributes
    ----------
    id
        Its number, counted from 1. One that is lifted and pressed again keeps it where its shape is recognised; what
        its shape explains no more has a new one, as have objects after they met that may be each other.
    outline
        Corners (N, 2) [mm], counter-clockwise, in the object's frame; none where no shape is known.
    pose
        x, y [mm] and angle [rad] (3,): a point p of the outline lies at R(angle) p + (x, y) on the sensor. NaN where
        the last scan does not tell.
    velocity
        Of the pose (3,) [mm/s, mm/s, rad/s]; NaN where the clock stands still.
    time_s
        Of the scan [s].
    scans
        How many tell of the outline.
    status
        "ok", "likely" or "doubtful" (read the advice); with `strip_width_mm` "likely" at best.
    advice
        In words; empty when all is well.
    alternatives
        Other outlines that explain the scans as well, in this object's frame.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape, noise = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)]), ts.Noise(positional=0.002)
    >>> live = ts.LiveTracks(sensor, noise)
    >>> for i in range(30):
    ...     placed = shape.turned(0.04 * i).placed(35 + 0.8 * i, 50)
    ...     tracks = live.update(ts.simulate(sensor, placed, noise, rng=i, time_s=0.01 * i))
    >>> tracks[0].status, tracks[0].scans, tracks[0].placed.shape
    ('ok', 30, (4, 2))
    """

    id: int
    outline: FloatArray
    pose: FloatArray
    velocity: FloatArray
    time_s: float
    scans: int
    status: Status
    advice: str = ""
    alternatives: tuple[Alternative, ...] = ()
    _known: Known | None = field(default=None, repr=False)
    _scan: RigidScans | None = field(default=None, repr=False)

    @property
    def placed(self) -> FloatArray:
        """The corners (N, 2) [mm] on the sensor; NaN where the last scan does not tell."""
        return placed(self.outline, self.pose)

    @property
    def covariance(self) -> FloatArray | None:
        """Of `outline.ravel()` (2 N, 2 N) [mm^2], of the shape alone; None where no shape is known."""
        return None if self._known is None else self._known.covariance

    @cached_property
    def pose_covariance(self) -> FloatArray:
        """Of the pose (3, 3) [mm, mm, rad], with all poses that explain the scan; NaN where it is not known."""
        if self._known is None or self._scan is None or not np.isfinite(self.pose[0]):
            return np.full((3, 3), np.nan)
        pose, scan = self.pose[None], self._scan
        fit = Fit(self.outline, pose, equations(scan, self.outline, pose, loss(scan)).costs)
        return np.asarray(self._known.pose_covariance(scan, self.pose) + beyond_the_bound(scan, fit)[0])

    @property
    def _place_deviation_mm(self) -> float:
        """Standard deviation of the corner whose place the pose tells least [mm], were the shape known."""
        x, y = (self.placed - self.pose[:2]).T
        none, all_ = np.zeros(len(x)), np.ones(len(x))
        by_pose = np.stack([[all_, none, -y], [none, all_, x]])  # (2, 3, N)
        return math.sqrt(float(np.einsum("ipn,pq,iqn->n", by_pose, self.pose_covariance, by_pose).max()))

    @property
    def corner_deviation_mm(self) -> float:
        """Standard deviation of the corner that is known least [mm]; NaN where no shape is known."""
        return math.nan if self._known is None else self._known.corner_deviation_mm

    @property
    def area_mm2(self) -> float:
        """Of the outline [mm^2]; NaN where no shape is known."""
        return moments(self.outline)[0] if len(self.outline) else math.nan

    @property
    def area_deviation_mm2(self) -> float:
        """Standard deviation of the area [mm^2]; NaN where no shape is known."""
        c = self.covariance
        return math.nan if c is None else deviations(self.outline, c)[0]


@dataclass
class Stream:
    """What all contacts of a stream share.

    Attributes
    ----------
    sensor, names, distribution, lag, executor
        As of `LiveTracks`; the signatures of its scans.
    sigma
        Of a reading; None: not known yet.
    lifted
        Objects that are not on the sensor, or were lost there, the last one first.
    searches
        Number of searches so far.
    numbers
        How many numbers objects have got so far.
    """

    sensor: Sensor
    names: tuple[str, ...]
    distribution: str
    lag: int
    executor: Executor | None
    sigma: float | None
    lifted: list[KnownShape] = field(default_factory=list)
    searches: int = 0
    numbers: int = 0

    def number(self) -> int:
        """Return the number of the next object."""
        self.numbers += 1
        return self.numbers

    def remember(self, shape: KnownShape | None) -> None:
        """Remember an object that is gone, where its shape is known."""
        if shape is not None:
            self.lifted[:] = [shape, *self.lifted[: _REMEMBERED - 1]]


class History:
    """Scans of a contact from its first to its last, at most `MOST`: ever fewer of those between."""

    def __init__(
        self, k: list[FloatArray] | None = None, poses: list[FloatArray] | None = None, stride: int = 1
    ):
        self.k, self.poses, self.stride, self._left = k or [], poses or [], stride, 0

    def add(self, k: FloatArray, pose: FloatArray) -> None:
        """Keep a scan (S, n) and its pose, NaN where that is not known."""
        self._left -= 1
        if self._left > 0:
            return
        if len(self.k) >= MOST:
            self.k, self.poses, self.stride = self.k[::2], self.poses[::2], 2 * self.stride
        self._left = self.stride
        self.k.append(k)
        self.poses.append(pose)

    def forget_unposed(self) -> None:
        """Forget scans whose pose is not known."""
        kept = [i for i, pose in enumerate(self.poses) if np.isfinite(pose[0])]
        self.k, self.poses = [self.k[i] for i in kept], [self.poses[i] for i in kept]


@dataclass
class _Newcomer:
    """A shape that was found, while it takes the scans that came since it was searched for.

    Attributes
    ----------
    shape, history
        Itself, and the scans that tell of it.
    bad
        Scans in turn that it does not explain.
    """

    shape: KnownShape
    history: History
    bad: int = 0

    @property
    def lost(self) -> bool:
        """Whether it does not explain what came."""
        return self.bad >= _LOST or not self.shape.lag.rigid


def _caught_up(one: _Newcomer, scans: list[tuple[FloatArray, float]]) -> _Newcomer:
    """Return a shape that has taken some more scans and their times."""
    for k, time_s in scans:
        if one.lost:
            break
        if one.shape.lag.add(k, time_s):
            one.history.add(k, one.shape.lag.pose)
            one.bad = 0
        else:
            one.bad += 1
    return one


class LiveContact:
    """A contact from when it appears until it is lifted.

    Parameters
    ----------
    episode
        Where it is.
    stream
        What it shares with the others.

    Attributes
    ----------
    id, episode
        Its number, a new one where its shape is lost, until it is recognised; and where it is.
    """

    def __init__(self, episode: Episode, stream: Stream) -> None:
        self.id, self.episode, self._stream = stream.number(), episode, stream
        self._history, self._seen, self._due, self._searched = History(), 0, _FIRST, 0
        self._task: Future[KnownShape | None] | None = None
        self._waiting: deque[tuple[FloatArray, float]] = deque()
        self._found: Future[_Newcomer] | _Newcomer | None = None
        self._shape: KnownShape | None = None
        self._bad: list[FloatArray] = []
        self._proof, self._since, self._alarm = 0, 0, ""
        self._met: list[LiveContact] = []  # that it shares strips with
        # It may be one of them; and then its shape, or scans, may not be its own.
        self._alike = self._unlike = False
        # Numbers that it may be, of those before it met others like it; and once it parts from them.
        self._either, self._mixed = set[int](), set[int]()
        self._doubted = False  # the shape explains no more what comes; a search tells whether another does

    @property
    def known_shape(self) -> KnownShape | None:
        """Its shape, for when it is pressed again; None where it has none."""
        if self._shape is None:
            return None
        self._history.forget_unposed()
        k, poses = self._history.k, self._history.poses
        return replace(self._shape, id=self.id, k=np.stack(k), poses=np.stack(poses)) if k else None

    @property
    def searching(self) -> bool:
        """Whether a shape is searched for, or takes the scans that came meanwhile."""
        return self._task is not None or self._found is not None

    def step(self, k: FloatArray, time_s: float, wait: bool = False) -> LiveTrack | None:
        """Take its readings of the next scan (S, n); return the object, None where nothing is known of it yet.

        With `wait`, searches are waited for, and no scan is to come.
        """
        if self._task is not None and self._task.done():
            task, self._task = self._task, None
            self._answered(task.result())
        if self._alike:  # which is which their readings do not tell
            self.id = self._stream.number()
            self._either = self._mixed
            if self._unlike:
                self._begin_anew([])
        self._met, self._alike, self._unlike, self._mixed = [], False, False, set()
        taken = self._followed(k, time_s)
        self._catch_up()
        self._search_if_due()
        if wait:
            self._finish()
        return self._track(k, time_s, "" if taken else _UNEXPLAINED)

    def shared(
        self, k: FloatArray, time_s: float, others: list[LiveContact], wait: bool = False
    ) -> LiveTrack | None:
        """Return the object of a scan in which it shares its strips with others; `wait` as of `step`."""
        for other in others:
            if other not in self._met:
                self._met.append(other)
                self._compare_with(other)
        if wait:
            self._finish()
        return self._track(k, time_s, _JOINT)

    def _compare_with(self, other: LiveContact) -> None:
        """Note whether it may be another that it met: what has no shape yet may look like anything."""
        if self._shape is None or other._shape is None:
            self._unlike = self._unlike or self._shape is None
            self._mix_with(other)
            return
        sensor, lags = self._stream.sensor, (self._shape.lag, other._shape.lag)
        off = apart_mm(lags[0].corners, lags[1].corners)
        deviations = [lag.known.corner_deviation_mm for lag in lags]
        each = zip(lags, deviations, strict=True)
        if off < sum(max(tolerated_mm(sensor, lag.corners), DEVIATIONS * far) for lag, far in each):
            self._unlike = self._unlike or off > DEVIATIONS * math.hypot(*deviations)
            self._mix_with(other)

    def _mix_with(self, other: LiveContact) -> None:
        """Note that it may be another, or whatever either may have been before."""
        self._alike = True
        self._mixed |= (self._either or {self.id}) | (other._either or {other.id})

    def _finish(self) -> None:
        """Wait for what is searched for; where no scan is to come and no shape is known, search once more in all."""
        self._wait()
        if self._shape is None and self._searched < self._seen:
            self._due = self._seen
            self._search_if_due()
            self._wait()

    def _wait(self) -> None:
        """Wait until a search has ended, and what it found has taken the scans that came meanwhile."""
        while self.searching:
            if self._task is not None:
                task, self._task = self._task, None
                self._answered(task.result())
            elif isinstance(self._found, Future):
                futures_wait([self._found])
            self._catch_up()

    def _followed(self, k: FloatArray, time_s: float) -> bool:
        """Take a scan by the present shape; return whether that explains it, or there is none."""
        self._seen += 1
        if self.searching:
            self._keep(k, time_s)
        if self._shape is None:
            self._history.add(k, np.full(3, np.nan))
            return True
        shape = self._shape
        taken = shape.lag.add(k, time_s)
        if taken:
            self._bad, self._since = [], self._since + 1
            self._history.add(k, shape.lag.pose)
        else:
            self._bad.append(k)
            if shape.status == "doubtful" and not self._doubted:  # it is the shape that may be wrong
                self._history.add(k, np.full(3, np.nan))
        wrong = len(self._bad) >= _LOST or not shape.lag.rigid
        if self._doubted and self._since >= _LOST and not wrong:
            self._doubted, self._task = False, None
            self._history.forget_unposed()
        elif wrong and self._history.stride > 1:
            self._raise_alarm(shape.lag)
        elif wrong and not self._doubted:
            self._doubted, self._since, self._due = True, 0, self._seen
            for bad in self._bad if shape.status != "doubtful" else ():
                self._history.add(bad, np.full(3, np.nan))
        return taken

    def _keep(self, k: FloatArray, time_s: float) -> None:
        """Keep a scan for the shape that is searched for, every other one where they are very many."""
        self._waiting.append((k, time_s))
        if len(self._waiting) > _WAITING:
            self._waiting = deque(list(self._waiting)[::2])

    def _raise_alarm(self, lag: FixedLag) -> None:
        """Begin anew with the last scans: the shape does not explain them."""
        self._alarm = _NOT_RIGID.format(scans=lag.scans)
        self._proof = 2 * self._proof or _PROOF
        self._stream.remember(self.known_shape)
        self.id, self._either = self._stream.number(), set()  # what is there now may be another
        self._begin_anew(self._bad or lag.window_readings)

    def _begin_anew(self, scans: list[FloatArray]) -> None:
        """Forget the shape: these scans are the first of what is there now."""
        self._shape, self._found, self._task = None, None, None
        self._waiting.clear()
        self._doubted, self._bad = False, []
        self._history, self._seen, self._due, self._searched = History(), len(scans), _FIRST, 0
        for k in scans:
            self._history.add(k, np.full(3, np.nan))

    def _search_if_due(self) -> None:
        stream, shape, history = self._stream, self._shape, self._history
        growing = self._doubted or shape is None or shape.status != "ok" or history.stride == 1
        if self.searching or not growing or self._seen < self._due:
            return
        k = np.stack(history.k)
        if not moved(k, stream.sigma or GUESS):
            self._due = self._seen + max(_FIRST, self._seen // 4)
            return
        self._due, self._searched = math.ceil(_LATER * self._seen), self._seen
        known = () if shape else tuple(stream.lifted)
        angle = float(shape.lag.pose[2]) if shape and not self._bad else math.nan
        contact = Contact(
            self.id, stream.sensor, stream.names, k, stream.sigma, stream.distribution, stream.lag, angle, known
        )  # fmt: skip
        stream.searches += 1
        if stream.executor is None:
            self._answered(find_shape(contact))
            self._catch_up()
        else:
            self._task = stream.executor.submit(find_shape, contact)

    def _answered(self, found: KnownShape | None) -> None:
        """Take what a search ended with."""
        stream = self._stream
        if found is None or (
            found.again and found.id != self.id and all(o.id != found.id for o in stream.lifted)
        ):
            self._waiting.clear()
            return
        if not found.explains:
            self._waiting.clear()
            if self._shape is None:  # perhaps the last scans alone are explained
                self._alarm = self._alarm or found.advice or _NOT_FOUND
                half = len(self._history.k) // 2
                self._history = History(
                    self._history.k[half:], self._history.poses[half:], self._history.stride
                )
            elif self._doubted:
                self._raise_alarm(self._shape.lag)
            else:
                self._shape = replace(self._shape, status="doubtful", advice=found.advice)
            return
        stream.sigma = stream.sigma or found.lag.sigma
        stride = 2 if found.again else self._history.stride  # 1: all scans are in it
        self._found = _Newcomer(found, History(list(found.k), list(found.poses), stride))

    def _catch_up(self) -> None:
        """Give the shape that was found the scans that came meanwhile; it is in force when it has taken them all."""
        one = self._found
        if isinstance(one, Future):
            if not one.done():
                return
            one = one.result()
        if one is None:
            return
        executor, behind = self._stream.executor, len(self._waiting)
        far = executor is not None and behind > _FAR_BEHIND
        scans = [self._waiting.popleft() for _ in range(behind if far else min(_CAUGHT_UP, behind))]
        if executor is not None and far and not one.lost:
            self._found = executor.submit(_caught_up, one, scans)
            return
        self._found = one = _caught_up(one, scans)
        if one.lost:
            self._found, self._due = None, self._seen + _FIRST
            self._waiting.clear()
            return
        if self._waiting:
            return
        found = one.shape
        if found.again and found.id != self.id:
            self.id, self._either = found.id, set()
            self._stream.lifted[:] = [o for o in self._stream.lifted if o.id != found.id]
        if self._shape is None:
            self._since = 0 if self._proof else found.lag.scans
        self._shape, self._history, self._found = found, one.history, None
        self._alarm, self._bad, self._doubted = "", [], False

    def _track(self, k: FloatArray, time_s: float, trouble: str) -> LiveTrack | None:
        """Return the object as of this scan."""
        nowhere = np.full(3, np.nan)
        if (shape := self._shape) is None:
            if not self._alarm:
                return None
            return LiveTrack(self.id, np.empty((0, 2)), nowhere, nowhere, time_s, 0, "doubtful", self._alarm)
        lag, status, advice = shape.lag, shape.status, [shape.advice]
        if self._since < self._proof:
            advice.append(_UNPROVEN.format(scans=self._since, proof=self._proof))
        if self._doubted:
            advice.append(SEARCHED_AGAIN)
        if trouble:
            advice.append(trouble)
        if len(advice) > 1:  # more than what the search said
            status = "doubtful"
        if self._either:
            advice.append(_EITHER.format(which=" or ".join(map(str, sorted(self._either)))))
        passed = lag.passed_s
        if passed <= 0.0:
            advice.append(STANDS if passed == 0.0 else _BACK)
        if (width := lag.sensor.strip_width_mm) is not None:
            advice.append(_LINES.format(width=width))
            thin = status != "doubtful" and width <= _WIDE * lag.sensor.length_mm
            status = "likely" if thin else "doubtful"
        pose = nowhere if trouble else lag.pose
        one = LiveTrack(
            self.id, lag.corners, pose, nowhere if trouble else lag.velocity, time_s, lag.scans, status,
            "; ".join(filter(None, advice)), shape.alternatives, lag.known, lag.of(k[None]),
        )  # fmt: skip
        if status == "doubtful" or np.isfinite(k).any(axis=0).sum() >= FEW_STRIPS:
            return one
        if DEVIATIONS * one._place_deviation_mm <= tolerated_mm(lag.sensor, lag.corners):
            return one
        return replace(one, status="doubtful", advice="; ".join(filter(None, [_PLACE, one.advice])))

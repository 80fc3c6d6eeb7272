"""Objects over time while their scans come: as good and as honest as all scans at once, and what must be said."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from rigid_scenes import CORNERS, at, distance, pressed, sliding, ten_strips
from studies.holdout.readings import Unit, white
from studies.holdout.tracks_live_set import EVENTS, outlines
from tacstrip.arrays import FloatArray
from tacstrip.core.binding import exported
from tacstrip.tracking import live_contact, live_search
from tacstrip.tracking.episodes import Episode
from tacstrip.tracking.live_contact import LiveContact, Stream
from tacstrip.tracking.live_search import Contact, KnownShape, find_shape
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import covariances, information, rigid_motions
from tacstrip.tracking.rigid.fixed_lag import FixedLag

NOISE = ts.Noise(positional=0.005)
SIGMA = 0.005 / np.sqrt(3.0)
NAMES = ("kh", "kl")
OWN = CORNERS - CORNERS.mean(axis=0)

pytestmark = pytest.mark.skipif(exported("rigid_descend") is None, reason="NumPy takes minutes")


class Later(Executor):
    """Runs what was submitted when it is told to."""

    def __init__(self) -> None:
        self.asked: list[tuple[Future[Any], Callable[[], Any]]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        task: Future[Any] = Future()
        self.asked.append((task, lambda: fn(*args, **kwargs)))
        return task

    def run(self) -> None:
        for task, work in self.asked:
            task.set_result(work())
        self.asked = []


def readings(scans: list[ts.Scan]) -> FloatArray:
    return np.stack([np.stack([scan[name] for name in NAMES]) for scan in scans])


def of_mean(poses: FloatArray) -> FloatArray:
    """Return poses of `CORNERS` as those of `OWN`."""
    return np.array([(*at(CORNERS, pose).mean(axis=0), pose[2]) for pose in poses])


def test_scans_one_by_one_tell_what_all_at_once_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search ends after some more scans have come, which are taken where it ran, and the last two at once."""
    monkeypatch.setattr(live_contact, "_FIRST", 30)
    sensor, poses, later = ten_strips(), sliding(44), Later()
    scans = pressed(sensor, CORNERS, poses, NOISE, 3)
    live = ts.LiveTracks(sensor, NOISE, executor=later)
    searching = []

    def update(scan: ts.Scan) -> tuple[ts.LiveTrack, ...]:
        found = live.update(scan)
        searching.append(live.searching)
        return found

    assert [update(scan) for scan in scans[:38]] == [()] * 38
    later.run()
    found = [update(scan) for scan in scans[38:40]]
    later.run()
    found += [update(scan) for scan in scans[40:]]
    assert [len(f) for f in found] == [0, 0, 1, 1, 1, 1]
    assert searching == [0] * 29 + [1] * 11 + [0] * 4
    (first,), (one,) = found[2], found[-1]
    assert [first.scans, one.scans, one.status, one.id] == [41, 44, "ok", 1]
    (batch,) = ts.track(scans, sensor, NOISE)
    assert distance(one.outline, CORNERS) < 0.2  # mm; of one scan 2.2
    assert batch.covariance is not None
    widest = np.sqrt(batch.covariance.diagonal().reshape(-1, 2).sum(axis=1).max())
    assert one.corner_deviation_mm == pytest.approx(widest, rel=0.2)
    assert one.area_mm2 == pytest.approx(batch.area_mm2, abs=4.0 * one.area_deviation_mm2)
    near = np.linalg.norm(one.placed[:, None] - at(CORNERS, poses[-1]), axis=2).min(axis=1)
    assert near.max() < 1.5
    sigma = np.sqrt(np.diag(one.pose_covariance))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(batch.pose_covariances[-1])), rtol=0.2)
    assert one.velocity[0] == pytest.approx(15.0 / 0.43, rel=0.5)
    for times, said in (
        ([0.43] * 4, "clock stands still"),
        ([0.2] * 4, "went back"),
        ([0.5, 0.7, 0.6, 0.8], "went back"),
    ):
        for time_s in times:
            (one,) = live.update(replace(scans[-1], time_s=time_s))
        assert said in one.advice
    assert one.status == "ok"
    assert np.isnan(one.velocity).all()
    assert np.isfinite(one.pose).all()


def test_a_shape_is_recognised_and_its_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lifted, pressed again elsewhere, another thing in its place without a scan between."""
    monkeypatch.setattr(live_contact, "_FIRST", 25)
    sensor, triangle = ten_strips(), np.array([(-25.0, -20.0), (25.0, -20.0), (0.0, 28.0)])
    silent = ts.Scan(kh=np.full(10, np.nan), kl=np.full(10, np.nan))
    again = sliding(28, -12.0, -10.0, 0.8) + np.array([4.0, -6.0, 2.5])
    scans = [
        *pressed(sensor, CORNERS, sliding(28), NOISE, 1), silent,
        *pressed(sensor, CORNERS, again, NOISE, 2), *pressed(sensor, triangle, again[::-1][:8], NOISE, 3),
    ]  # fmt: skip
    live = ts.LiveTracks(sensor, NOISE)
    found = [live.update(replace(scan, time_s=0.01 * i)) for i, scan in enumerate(scans)]
    assert [len(f) for f in found] == [0] * 24 + [1] * 4 + [0] * 25 + [1] * 12
    known = [f[0] for f in found if f]
    assert [(one.id, one.scans) for one in known[:8]] == [(1, 25 + i) for i in (0, 1, 2, 3, 27, 28, 29, 30)]
    assert distance(known[7].outline, CORNERS) < 0.3
    assert known[7].status == "ok"
    assert [one.status for one in known[8:]] == ["doubtful"] * 8
    assert "does not explain this one" in known[8].advice
    assert np.isnan(known[8].pose).all()
    assert [one.id for one in known[8:]] == [1] * 4 + [3] * 4


@pytest.mark.parametrize(
    ("event", "seed", "number", "scans", "said"),
    [("goes on", 802, 4, 15, "leave a corner uncertain"), ("lifted, another", 891, 1, 10, "may be cut off")],
)
def test_a_young_shape_that_scans_leave_open_is_not_believed(
    event: str, seed: int, number: int, scans: int, said: str
) -> None:
    """Both had a corner of six too few, and were `ok`: 13.6 mm off at a kink, and 4.8 in a gap that no strip read."""
    random = np.random.default_rng([78, EVENTS.index(event), seed, number])
    sensor, shown = ten_strips(), outlines(event, random)[:scans]
    unit, k = Unit(NAMES, 10, 10.0, 100.0), list[FloatArray]()
    for true in shown:
        assert true is not None
        read = unit.read(*unit.touched([true]))
        k.append(read + white(read.shape, 0.005, "uniform", random))
    found = find_shape(Contact(1, sensor, NAMES, np.stack(k), SIGMA, "normal", 20, np.nan, ()))
    assert found is not None
    assert found.status == "doubtful"
    assert said in found.advice


def test_a_scan_that_leaves_a_corner_anywhere_in_a_gap_is_doubted() -> None:
    """Both ends of a bar lie between two strips, where its long edges read the same."""
    sensor = ten_strips()
    bar = np.array([(-21.5, -8.0), (17.5, -8.0), (21.5, 8.0), (-17.5, 8.0)])
    poses = np.column_stack(
        [np.linspace(45.0, 60.0, 40), np.linspace(48.0, 52.0, 40), np.linspace(-1.0, 1.0, 40)]
    )
    lag = FixedLag(sensor, NAMES, SIGMA, bar)
    lag.begin(readings(pressed(sensor, bar, poses, NOISE, 6)), poses)
    stream = Stream(sensor, NAMES, "normal", 20, None, SIGMA)
    said = []
    for x, number in ((52.5, 0), (50.0, 1), (55.5, 2)):
        one = LiveContact(Episode([], []), stream)
        one._shape = KnownShape(1, copy(lag), np.empty(0), np.empty(0), "ok")
        one._shape.lag.pose = pose = np.array([x, 50.0, 0.0])
        (k,) = readings(pressed(sensor, bar, pose[None], NOISE, number))
        track = one.step(k, 0.0)
        assert track is not None
        said.append((track.status, "anywhere within a gap" in track.advice))
    assert said == [("doubtful", True), ("doubtful", True), ("ok", False)]


def test_a_motion_left_in_the_covariance_does_not_hold_the_pose() -> None:
    """Corners that moved on since a search leave some of a turn in what it found; of the shape it says nothing."""
    poses = of_mean(sliding(25))
    lag = FixedLag(ten_strips(), NAMES, SIGMA, OWN)
    k = readings(pressed(ten_strips(), OWN, poses, NOISE, 3))
    lag.begin(k, poses)
    known, scan = lag.known, lag.of(k[-1:])
    turn = rigid_motions(known.corners)[:, 2:]
    turned = replace(known, wider=known.wider + 1e-12 * turn @ turn.T)
    own, with_turn = (one.pose_covariance(scan, poses[-1]) for one in (known, turned))
    assert np.sqrt(own[2, 2]) > 1e-3  # radians
    np.testing.assert_allclose(with_turn, own, rtol=1e-6)


def known_contact(stream: Stream, corners: FloatArray) -> LiveContact:
    """Return a contact of which the shape is known from 12 scans."""
    lag = FixedLag(ten_strips(), NAMES, SIGMA, corners)
    k, poses = readings(pressed(ten_strips(), corners, sliding(12), NOISE, 6)), sliding(12)
    lag.begin(k, poses)
    one = LiveContact(Episode([], []), stream)
    one._shape = KnownShape(one.id, lag, k, poses, "ok")
    return one


def test_objects_that_look_alike_and_met_get_new_numbers() -> None:
    """Each may be the other after they parted; what looks otherwise keeps its number."""
    stream = Stream(ten_strips(), NAMES, "normal", 20, None, SIGMA)
    turned, triangle = (
        at(OWN, np.array([0.0, 0.0, 2.0])),
        np.array([(-25.0, -20.0), (25.0, -20.0), (0.0, 28.0)]),
    )
    one, twin, other = (known_contact(stream, corners) for corners in (OWN, turned, triangle))
    (k,) = readings(pressed(ten_strips(), OWN, sliding(13)[-1:], NOISE, 1))
    every, said = [one, twin, other], list[tuple[int, int, int]]()
    for partners in ([one, other], [twin, other], every, [one, twin]):
        for c in partners:
            shared = c.shared(k, 0.0, [p for p in partners if p is not c])
            assert shared is not None
            assert "shares strips" in shared.advice
        found = [c.step(k, 0.0) for c in partners]
        said.append((one.id, twin.id, other.id))
        either = ["it is object 1 or 2: they" in one.advice for one in found if one is not None]
        assert either == [len(said) > 2 and c is not other for c in partners]
    assert said == [(1, 2, 3), (1, 2, 3), (4, 5, 3), (6, 7, 3)]


@pytest.mark.parametrize(
    ("partner", "number", "known"),
    [("unknown", 3, True), ("a corner more", 3, True), ("larger", 3, False), ("other", 1, True)],
)
def test_what_may_be_the_other_after_they_met_is_said(partner: str, number: int, known: bool) -> None:
    """Also where its shape is not known yet or has another count of corners; one that may be the other's is left."""
    stream = Stream(ten_strips(), NAMES, "normal", 20, None, SIGMA)
    shapes = {
        "unknown": OWN,
        "a corner more": np.insert(OWN, 1, 0.5 * (OWN[0] + OWN[1]) + 0.05, axis=0),
        "larger": 1.06 * OWN,
        "other": np.array([(-25.0, -20.0), (25.0, -20.0), (0.0, 28.0)]),
    }
    one, two = known_contact(stream, OWN), known_contact(stream, shapes[partner])
    if partner == "unknown":
        two._shape = None
    (k,) = readings(pressed(ten_strips(), OWN, sliding(13)[-1:], NOISE, 1))
    one.shared(k, 0.0, [two])
    found = one.step(k, 0.1)
    assert (one.id, found is not None) == (number, known)


def test_a_shape_is_as_uncertain_as_its_search_said() -> None:
    """More than by the bound alone; further scans make both surer alike."""
    sensor, poses = ten_strips(), of_mean(sliding(40))
    k = readings(pressed(sensor, OWN, poses, NOISE, 4))
    lag = FixedLag(sensor, NAMES, SIGMA, OWN)
    lag.begin(k[:20], poses[:20])
    bound, scan = lag.known.bound, lag.of(k[20:21])
    before = lag.known.pose_covariance(scan, poses[20])
    lag.widen(9.0 * bound)
    np.testing.assert_allclose(lag.known.covariance, 9.0 * bound, atol=1e-9)
    after = lag.known.pose_covariance(scan, poses[20])
    assert np.linalg.eigvalsh(after - before).min() > 0.0
    assert all(lag.add(row) for row in k[20:])
    assert np.trace(lag.known.covariance) == pytest.approx(9.0 * np.trace(lag.known.bound), rel=1e-6)
    assert np.trace(lag.known.bound) < 0.8 * np.trace(bound)


def test_an_outline_of_another_count_is_not_the_known_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    """A contact that only an outline with a corner more explains, with the scans before, is searched for anew."""
    sensor, poses = ten_strips(), sliding(12)
    k, own = readings(pressed(sensor, CORNERS, poses, NOISE, 6)), of_mean(poses)
    lag = FixedLag(sensor, NAMES, SIGMA, OWN)
    lag.begin(k, own)
    contact = Contact(2, sensor, NAMES, k, SIGMA, "normal", 20, np.nan, (KnownShape(1, lag, k, own, "ok"),))
    known = find_shape(contact)
    assert known is not None
    assert (known.id, known.again) == (1, True)
    joint = Fit(np.insert(OWN, 1, 0.0, axis=0), np.concatenate([own, own]), np.zeros(24))
    monkeypatch.setattr(live_search, "recognised", lambda *_: joint)
    found = find_shape(contact)
    assert found is not None
    assert (found.id, found.again) == (2, False)


def test_a_jump_is_followed_and_another_shape_is_not() -> None:
    """A recording in a loop: the object is back where it began, half round, from one scan to the next."""
    sensor, poses = ten_strips(), sliding(40)
    back = poses[:6] + np.array([0.0, 0.0, np.pi])
    k = readings(pressed(sensor, CORNERS, np.concatenate([poses, back]), NOISE, 4))
    fused = FixedLag(sensor, NAMES, SIGMA, OWN)
    fused.begin(k[:30], of_mean(poses)[:30])
    assert all(fused.add(row, 0.01 * i) for i, row in enumerate(k[30:]))
    off = fused.pose - of_mean(back)[-1]
    assert np.hypot(*off[:2]) < 1.0  # mm; the way back is 13
    assert abs(np.angle(np.exp(1j * off[2]))) < 0.03
    assert np.abs(fused.velocity[:2]).max() < 100.0  # mm/s; over the jump it would be 300
    triangle = np.array([(-25.0, -20.0), (25.0, -20.0), (0.0, 28.0)])
    others = readings(pressed(sensor, triangle, back, NOISE, 5))
    assert not any(fused.add(row) for row in others)


@pytest.mark.parametrize("lag", [5, 20])
def test_what_left_the_window_makes_no_shape_too_sure(lag: int) -> None:
    """Over scenes: normalised errors are those of chi square, and the spread is that of all scans at once."""
    sensor, poses = ten_strips(), sliding(70)
    squares, many = [], 6
    for seed in range(many):
        k = readings(pressed(sensor, CORNERS, poses, NOISE, seed))
        fused = FixedLag(
            sensor, NAMES, SIGMA, OWN + np.random.default_rng(seed).normal(0, 0.05, OWN.shape), lag
        )
        fused.begin(k[:30], of_mean(poses)[:30])
        assert all(fused.add(row) for row in k[30:])
        b, a = OWN, fused.corners - fused.corners.mean(axis=0)
        u, _, v = np.linalg.svd(b.T @ a)
        off, c = (a - b @ (u @ v)).ravel(), fused.known.covariance
        value, vector = np.linalg.eigh(c)
        kept = value > 1e-9 * value.max()
        assert kept.sum() == c.shape[0] - 3
        squares.append(float(((off @ vector[:, kept]) ** 2 / value[kept]).sum()))
    assert 0.6 < np.mean(squares) / kept.sum() < 1.5  # its deviation is .22
    own = of_mean(poses)
    whole = covariances(information(fused.of(k), OWN, own), OWN, own)[0]
    assert np.sqrt(np.trace(c) / np.trace(whole)) == pytest.approx(1.0, abs=0.1)

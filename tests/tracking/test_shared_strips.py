"""Objects on the same strips: poses from what all read together, who comes and goes, and what is not held."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from rigid_scenes import at, ten_strips
from studies.holdout.shared_strips_set import SETS, draw, score
from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.cli import cli
from tacstrip.core.hull import available
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.found import Found
from tacstrip.tracking.rigid.starts import Starts
from tacstrip.tracking.shared_strips import lone_ends

pytestmark = pytest.mark.skipif(not available(), reason="compiled only")

NOISE = ts.Noise(positional=0.005)
TRIANGLE = np.array([(-10.0, -9.0), (11.0, -8.0), (0.0, 12.0)])
QUAD = np.array([(-12.0, -8.0), (10.0, -10.0), (12.0, 7.0), (-9.0, 10.0)])


def passing(scans: int = 50) -> FloatArray:
    """Return poses (T, 2, 3) of two objects that pass each other on the same strips."""
    found, side = np.empty((scans, 2, 3)), np.linspace(-30.0, 30.0, scans)
    for k, sign in enumerate((1.0, -1.0)):
        found[:, k, 0] = 50.0 + sign * side
        found[:, k, 1] = 50.0 - 14.0 * sign + 2.0 * np.sin(np.linspace(0.0, 4.0, scans) + k)
        found[:, k, 2] = 0.5 * k + sign * np.linspace(0.0, 0.8, scans)
    return found


def pressed(
    sensor: ts.Sensor, shapes: list[FloatArray], poses: FloatArray, there: BoolArray
) -> list[ts.Scan]:
    """Return scans of shapes at poses (T, K, 3), of those that are there (T, K), 20 ms apart."""
    found = []
    for i, (pose, present) in enumerate(zip(poses, there, strict=True)):
        parts = [
            ts.Contact.polygon(at(s, p)).shapes[0] for s, p, t in zip(shapes, pose, present, strict=True) if t
        ]
        found.append(ts.simulate(sensor, ts.Contact(tuple(parts)), NOISE, rng=i, time_s=0.02 * i))
    return found


def off(track: ts.Track, shape: FloatArray, poses: FloatArray, scans: IntArray) -> FloatArray:
    """Return how far the farthest corner is from the true ones in some scans [mm]."""
    return np.array(
        [
            np.linalg.norm(track.placed(int(i))[:, None] - at(shape, poses[i]), axis=2).min(axis=1).max()
            for i in scans
        ]
    )


def test_two_that_pass_each_other_keep_their_poses_and_numbers() -> None:
    sensor, poses = ten_strips(strips=32), passing()
    tracks = ts.track(pressed(sensor, [TRIANGLE, QUAD], poses, np.ones((50, 2), dtype=bool)), sensor, NOISE)
    assert [(t.status, len(t.outline), int(t.present.sum())) for t in tracks] == [
        ("ok", 3, 50),
        ("ok", 4, 50),
    ]
    both = np.flatnonzero(np.abs(poses[:, 0, 0] - poses[:, 1, 0]) < 18.0)
    for k, (track, shape) in enumerate(zip(tracks, (TRIANGLE, QUAD), strict=True)):
        assert set(both) <= set(track.joint)
        assert np.median(off(track, shape, poses[:, k], both)) < 0.5
        sigma = np.sqrt(np.diagonal(track.pose_covariances[both], axis1=1, axis2=2))
        assert 0.0 < np.median(sigma[:, 0]) < 0.3


def test_two_that_only_touch_neighbouring_strips_are_followed_there() -> None:
    """They share no strip, but a run of touched ones."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    poses, t, there = np.empty((30, 2, 3)), np.linspace(0.0, 1.0, 30), np.ones((30, 2), dtype=bool)
    poses[:, 0] = np.stack([25.0 + 9.0 * t, 45.0 + 4.0 * t, 0.3 * t], axis=1)
    poses[:, 1] = np.stack([68.0 - 9.0 * t, 50.0 - 5.0 * t, 0.7 * t], axis=1)
    scans = pressed(sensor, [1.2 * QUAD, 1.2 * TRIANGLE], poses, there)
    both = np.flatnonzero([len(scan.runs()) == 1 for scan in scans])
    tracks = ts.track(scans, sensor, NOISE)
    assert len(both) > 1
    assert len(tracks) == 2
    for one, shape, own in zip(tracks, (1.2 * QUAD, 1.2 * TRIANGLE), poses.transpose(1, 0, 2), strict=True):
        assert "share" not in one.advice
        assert off(one, shape, own, both).max() < 2.0


def test_two_that_look_alike_are_told_by_their_ways() -> None:
    sensor, poses = ten_strips(strips=32), passing(40)
    tracks = ts.track(pressed(sensor, [QUAD, QUAD], poses, np.ones((40, 2), dtype=bool)), sensor, NOISE)
    assert len(tracks) == 2
    for k, track in enumerate(tracks):
        assert np.median(off(track, QUAD, poses[:, k], np.arange(40))) < 0.5


def test_who_comes_and_goes_on_shared_strips_is_found(tmp_path: Path) -> None:
    """One is alone, another is put down beside it, the first is lifted: no strip is ever between them."""
    sensor, poses, there = ten_strips(strips=32), passing(45), np.ones((45, 2), dtype=bool)
    poses[:, :, 0] = 50.0 + 0.3 * (poses[:, :, 0] - 50.0)
    there[:15, 1] = there[30:, 0] = False
    scans = pressed(sensor, [TRIANGLE, QUAD], poses, there)
    (tmp_path / "s.toml").write_text(sensor.to_toml())
    ts.write_readings(tmp_path / "r.csv", sensor, scans)
    files = [str(tmp_path / name) for name in ("s.toml", "r.csv", "t.geojson", "t.png")]
    done = CliRunner().invoke(
        cli, ["track", *files[:2], "-o", files[2], "--plot", files[3], "--positional", "0.005"]
    )
    assert done.exit_code == 0, done.output
    assert "15 of them on strips shared with others" in done.stderr
    features = json.loads((tmp_path / "t.geojson").read_text())["features"]
    for k, feature in enumerate(features):
        assert [p["scan"] for p in feature["properties"]["poses"]] == np.flatnonzero(there[:, k]).tolist()
        assert feature["properties"]["joint_scans"] == list(range(15, 30))


def test_a_jump_that_a_quick_search_stays_short_of_is_searched_thoroughly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sixteen scans, of which the first eight show one object; in the sixth a corner passes a strip."""
    asked = []

    def stretch(starts: Starts, distribution: str, effort: int = 0) -> str | None:
        asked.append((len(starts.scans.k), effort))
        return "found" if len(starts.scans.k) <= (8 if effort else 5) else None

    monkeypatch.setattr(lone_ends, "rigid_stretch", stretch)
    k = np.where(np.arange(16)[:, None, None] < 8, 0.3, 0.6) + np.zeros((16, 2, 10))
    k[5:, 0, 4] += 0.05
    found = lone_ends.lone_ends(RigidScans(ten_strips(), ("kh", "kl"), k, 0.003), "uniform", (False,))
    assert [(some, str(one)) for some, one in found] == [(range(8), "found")]
    assert asked == [(5, 1), (8, 0), (8, 1)]


def test_where_nothing_comes_or_goes_no_end_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """One object that deforms changes the readings smoothly; what is put down beside one makes them jump."""
    asked = []

    def stretch(starts: Starts, distribution: str, effort: int = 0) -> None:
        asked.append((len(starts.scans.k), effort))

    monkeypatch.setattr(lone_ends, "rigid_stretch", stretch)
    smooth = 0.3 + 0.2 * np.linspace(0.0, 1.0, 18)[:, None, None] ** 2 + np.zeros((18, 2, 10))
    smooth[:, :, 8:] = np.nan
    smooth[:10, :, 7] = np.nan  # one strip more is touched than before
    jumps, spreads, opens = smooth.copy(), smooth.copy(), smooth.copy()
    jumps[9:, 1, 3] += 0.1
    spreads[9:, :, :] = 0.4
    opens[10, :, 7] = 0.1  # by an edge nearly along it, that is over it in the next scan

    def searched(k: FloatArray, *, both: bool = False) -> list[tuple[int, int]]:
        asked.clear()
        lone_ends.lone_ends(RigidScans(ten_strips(), ("kh", "kl"), k, 0.003), "uniform", both=both)
        return asked.copy()

    assert searched(smooth) == searched(opens) == []
    # all scans before and after it show one object, or there are none such
    assert searched(jumps) == [(9, 1), (9, 1), (9, 2), (9, 2)]
    assert searched(spreads)[:2] == [(6, 1), (9, 1)]  # up to the jump where the shortest stretch fails
    # both ends are needed: none is searched where one has no promise, nor further where both fail, nor the second one
    # where the first has no hope
    for promising, hopeless, efforts in (
        (True, False, [(9, 1), (9, 1)]),
        (True, True, [(9, 1)]),
        (False, False, []),
    ):
        monkeypatch.setattr(Starts, "promising", promising)
        monkeypatch.setattr(Starts, "hopeless", hopeless)
        assert searched(jumps, both=True) == efforts


def test_where_a_first_change_comes_too_late_the_jumps_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second object comes without a sudden change in the tenth of thirty scans, and something else jumps later."""

    def stretch(starts: Starts, distribution: str, effort: int = 0) -> str | None:
        return "found" if len(starts.scans.k) <= 10 else None

    monkeypatch.setattr(lone_ends, "rigid_stretch", stretch)
    monkeypatch.setattr(lone_ends, "_jumps", lambda scans: [10, 14])
    k = 0.3 + np.zeros((30, 2, 10))
    k[14:, 0, 4] += 0.2
    found = lone_ends.lone_ends(RigidScans(ten_strips(), ("kh", "kl"), k, 0.003), "uniform", (False,))
    assert [some for some, _ in found] == [range(10)]


def test_two_that_stay_beside_each_other_are_not_one_that_replaces_them() -> None:
    """Of three objects two are left at the end, whose contact one outline of nine corners explains as well.

    An edge lies along a strip's centre line, where its slope is no bound.
    """
    random = np.random.default_rng([31, list(SETS).index("three"), 1])
    scene = draw("three", random)
    tracks = ts.track(scene.scans(random), scene.unit.sensor, NOISE)
    assert len(tracks) == 3
    assert all(one.solved for one in score(scene, tracks))


def test_scans_with_another_about_decide_what_is_left_open() -> None:
    """Of ten strips lone scans and the least cost leave shapes and ways open.

    Hidden for the most part, one may turn by 70 degrees more, but not as smoothly as alone.
    """
    random = np.random.default_rng([60, list(SETS).index("ten"), 9])
    scene = draw("ten", random)
    tracks = ts.track(scene.scans(random), scene.unit.sensor, NOISE)
    assert all(one.solved for one in score(scene, tracks))


def test_a_way_that_only_loose_motion_allows_is_no_doubt() -> None:
    """Where motion may be rough another way explains as well: as smooth as theirs it ends in theirs."""
    random = np.random.default_rng([33, list(SETS).index("unknown"), 18])
    scene = draw("unknown", random)
    tracks = ts.track(scene.scans(random), scene.unit.sensor, NOISE)
    assert all(one.solved for one in score(scene, tracks))
    assert [t.status for t in tracks] == ["ok"] * len(scene.outlines)


def test_rivals_that_are_alike_are_named_once() -> None:
    """Outlines of a square: moved by 2 mm, by 2.1 mm, by 4 mm, and as it is found; those most unlike first."""
    square, poses = 20.0 * np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), np.zeros((3, 3))

    def wider(by: float) -> Fit:
        return Fit(square + np.array([(0.0, 0.0), (by, 0.0), (by, 0.0), (0.0, 0.0)]), poses, np.zeros(3))

    rivals = ((wider(2.1), 3.0), (wider(2.0), 1.0), (wider(4.0), 9.0), (wider(0.1), 0.0))
    scans = RigidScans(ten_strips(), ("kh", "kl"), np.full((3, 2, 10), 0.3), 0.003)
    far, near = Found(wider(0.0), np.arange(3), rivals).unlike(scans, 0.5)
    assert np.ptp(far.corners, axis=0) == pytest.approx((24.0, 20.0))
    assert np.ptp(near.corners, axis=0)[0] in (pytest.approx(22.0), pytest.approx(22.1))
    assert far.poses.shape == (3, 3)

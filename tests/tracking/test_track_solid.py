"""A solid that moves on a skin: its poses, and its radius from all scans."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tacstrip as ts

TIP, NOISE = ts.Sensor.load("fingertip"), ts.Noise(positional=0.005)
NOTHING = ts.Scan(kh=np.full(16, np.nan), kl=np.full(16, np.nan), time_s=0.0)


def rolled(radii: list[float], seed: int) -> tuple[list[ts.Patch], list[ts.Scan]]:
    """Return patches and scans of a cylinder that rolls over the fingertip, of a radius in each."""
    random, patches, scans = np.random.default_rng(seed), [], []
    for i, radius in enumerate(radii):
        polar, around = 0.45 + 0.02 * i, 0.3 + 0.05 * i
        out = np.array(
            [math.sin(polar) * math.cos(around), math.sin(polar) * math.sin(around), math.cos(polar)]
        )
        pen = ts.Solid.cylinder(radius).at(10.0 * out, -out, 0.5 + 0.05 * i)
        patches.append(ts.press(TIP, pen, depth_mm=1.4))
        scans.append(ts.simulate(TIP, patches[-1], NOISE, rng=random, time_s=0.01 * (i + 1)))
    return patches, scans


def test_a_rolled_pen_has_one_radius_known_better_from_all_scans_than_from_one() -> None:
    patches, scans = rolled([4.5] * 6, seed=1)
    found = ts.track_solid([NOTHING, *scans], TIP, ts.Solid.cylinder(7.0), NOISE)
    assert (found.status, found.advice) == ("ok", "")
    assert abs(found.radius_mm - 4.5) < 3.0 * found.radius_sigma_mm < 0.3
    low, high = found.radius_interval_mm
    assert low < found.radius_mm < high
    assert found.radius_sigmas_mm[-1] < 0.6 * found.radius_sigmas_mm[1]
    assert found.solids[0] is None
    assert np.isnan(found.area_mm2[0])
    assert found.explained.all()
    right = np.array([(p.area_mm2, p.force_n) for p in patches])
    for values, deviations, truth in (
        (found.area_mm2, found.area_sigma_mm2, right[:, 0]), (found.force_n, found.force_sigma_n, right[:, 1]),
    ):  # fmt: skip
        off = (values[1:] - truth) / deviations[1:]
        assert np.abs(off).max() < 3.5
        assert np.sqrt(np.square(off).mean()) < 1.8
        assert (deviations[1:] < 0.1 * truth).all()
    along = np.abs(np.einsum("ij,ij->i", found.axes[1:], [p.solid.axes[0] for p in patches]))
    into = np.einsum("ij,ij->i", found.directions[1:], [-p.solid.toward for p in patches])
    assert min(along.min(), into.min()) > math.cos(math.radians(2.5))


def test_scans_of_different_radii_are_not_one_object() -> None:
    _, scans = rolled([3.0, 8.0], seed=2)
    found = ts.track_solid(scans, TIP, ts.Solid.cylinder(5.0), NOISE)
    assert found.status == "doubtful"
    assert "the scans disagree about the radius" in found.advice


def test_what_cannot_be_followed_gets_a_sentence() -> None:
    found = ts.track_solid([NOTHING], TIP, ts.Solid.plane(), NOISE)
    assert (found.status, found.advice) == ("no contact", "no strip reads a contact; press harder")
    with pytest.raises(ts.ReadingError, match="there is no scan"):
        ts.track_solid([], TIP, ts.Solid.plane(), NOISE)
    _, scans = rolled([4.0, 4.0], seed=3)
    with pytest.raises(ts.ReadingError, match="sort the scans by time, or split the recording"):
        ts.track_solid(scans[::-1], TIP, ts.Solid.cylinder(4.0), NOISE)


def test_a_ball_on_a_ball_is_followed_without_its_radius() -> None:
    ball = ts.Solid.sphere(6.0).at((9, 2, 8), toward=(-9, -2, -8))
    patch = ts.press(TIP, ball, depth_mm=1.2)
    found = ts.track_solid([ts.simulate(TIP, patch, NOISE, rng=4)], TIP, ts.Solid.sphere(8.0), NOISE)
    assert found.status == "ok"
    assert "known_size=True" in found.advice
    assert np.isnan([found.radius_mm, found.force_n[0]]).all()
    assert abs(found.area_mm2[0] - patch.area_mm2) < 3.0 * found.area_sigma_mm2[0]


def test_a_ball_on_a_tube_has_no_radius_of_which_it_is_falsely_sure() -> None:
    surface = ts.Surface(kind="cylinder", radius_mm=25.0, height_mm=100.0, along="parallels", around_deg=355)
    tube = ts.Sensor(
        construction="crs-crs", strips=100, surface=surface, pitch_mm=surface.pitch_mm(100),
        length_mm=surface.length_mm(100),
    )  # fmt: skip
    scans = []
    for i in range(4):
        around = 0.02 * i
        toward = np.array([np.cos(around), -np.sin(around), 0.0])
        ball = ts.Solid.sphere(8.0).at(-25.0 * toward + [0.0, 0.0, 47.0 + 0.5 * i], toward=toward)
        scans.append(ts.simulate(tube, ts.press(tube, ball, depth_mm=1.5), NOISE, rng=i, time_s=0.05 * i))
    found = ts.track_solid(scans, tube, ts.Solid.sphere(5.0), NOISE)
    assert found.radius_interval_mm[0] < 8.0 < found.radius_interval_mm[1]
    assert found.status == "doubtful"
    assert "the scans leave the radius open" in found.advice

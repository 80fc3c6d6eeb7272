"""From strips to space and back, and how much of a tube a flat object touches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from strategies import FIXED, sensors
from tacstrip.arrays import FloatArray
from tacstrip.errors import SpecError
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.cylinder import from_cartesian, strip_angle, strips_under_flat, to_cartesian

FLAT = Sensor(construction="crs-crs", strips=10, pitch_mm=5.0, length_mm=100.0)
TUBE = Sensor(
    construction="cyl-crs-m", strips=5, pitch_mm=4.0, length_mm=100.0, radius_mm=9.0, strip_width_mm=3.0
)


def covered(strips: int, strip_width: float = 1.0) -> Sensor:
    """Return a tube with strips of 1 mm pitch all round."""
    return Sensor(
        construction="cyl-crs-m",
        strips=strips,
        pitch_mm=1.0,
        length_mm=50.0,
        radius_mm=strips / (2.0 * np.pi),
        strip_width_mm=strip_width,
    )


def test_places_on_a_plane() -> None:
    points = to_cartesian(FLAT, np.array([0.0, 3.0, 9.5]), np.array([0.0, 40.0, 100.0]))
    np.testing.assert_allclose(points, [(2.5, 0.0, 0.0), (17.5, 40.0, 0.0), (50.0, 100.0, 0.0)], rtol=1e-15)


def test_places_on_a_tube() -> None:
    # Eight strips round: centre lines at odd multiples of 22.5 degrees, the first strip's edge at 0.
    tube, r = covered(8), 8 / (2.0 * np.pi)
    np.testing.assert_allclose(strip_angle(tube, np.arange(8.0)), np.pi / 8 * np.arange(1, 16, 2), rtol=1e-14)
    points = to_cartesian(tube, np.array([-0.5, 1.5, 3.5, 5.5]), np.array([0.0, 1.0, 2.0, 3.0]))
    np.testing.assert_allclose(points, [(r, 0, 0), (0, r, 1), (-r, 0, 2), (0, -r, 3)], atol=1e-14)


@settings(FIXED, max_examples=50)
@given(sensors(), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5), st.floats(-2.0, 2.0))
def test_space_returns_strip_and_y(sensor: Sensor, parts: list[float], y: float) -> None:
    strip = np.array(parts) * (sensor.strips - 1)  # from the first centre line to the last
    y_mm = np.linspace(0.0, y * sensor.length_mm, len(parts))
    points = to_cartesian(sensor, strip, y_mm)
    assert points.shape == (len(parts), 3)
    back_strip, back_y = from_cartesian(sensor, points)
    np.testing.assert_allclose(back_strip, strip, atol=1e-12 * sensor.strips)
    np.testing.assert_array_equal(back_y, y_mm)


@settings(FIXED, max_examples=25)
@given(sensors("cyl-crs-m", most_strips=500), st.floats(0.01, 100.0))
def test_points_off_a_tube_are_taken_along_the_normal(sensor: Sensor, times: float) -> None:
    strip, y = np.linspace(0.0, sensor.strips - 1.0, 7), np.linspace(0.0, sensor.length_mm, 7)
    points = to_cartesian(sensor, strip, y) * (times, times, 1.0)
    back_strip, back_y = from_cartesian(sensor, points)
    np.testing.assert_allclose(back_strip, strip, atol=1e-12 * sensor.strips)
    np.testing.assert_array_equal(back_y, y)


def test_points_off_a_plane_are_taken_along_the_normal() -> None:
    strip, y = from_cartesian(FLAT, np.array([[(17.5, 40.0, -3.0)], [(2.5, -1.0, 8.0)]]))
    np.testing.assert_allclose(strip, [[3.0], [0.0]], atol=1e-14)
    np.testing.assert_array_equal(y, [[40.0], [-1.0]])


def test_the_seam_lies_opposite_the_strips() -> None:
    # 5 strips of 4 mm on 56.5 mm: their middle is strip 2, and half a round from there is the seam.
    half_round = np.pi * 9.0 / 4.0  # in pitches
    inside = np.array([2.0 - half_round + 1e-9, -3.0, -0.5, 4.5, 7.0, 2.0 + half_round - 1e-9])
    np.testing.assert_allclose(
        from_cartesian(TUBE, to_cartesian(TUBE, inside, np.zeros(6)))[0], inside, atol=1e-12
    )
    beyond, _ = from_cartesian(TUBE, to_cartesian(TUBE, np.array([2.0 + half_round + 0.25]), np.zeros(1)))
    np.testing.assert_allclose(beyond, 2.0 - half_round + 0.25, atol=1e-12)


def test_across_the_seam_of_a_covered_tube_the_last_strip_meets_the_first() -> None:
    tube = covered(12)
    ends = to_cartesian(tube, np.array([-0.5, 11.5]), np.array([7.0, 7.0]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-14)
    strip, _ = from_cartesian(tube, to_cartesian(tube, np.array([-0.49, 11.49]), np.zeros(2)))
    np.testing.assert_allclose(strip, [-0.49, 11.49], atol=1e-12)


# A flat object on a tube.


def touched_in_every_turn(sensor: Sensor, depth: float) -> FloatArray:
    """Count the strips that a plane, sunk in by a depth, touches in 400 turns within a pitch."""
    assert sensor.radius_mm is not None
    r = sensor.radius_mm
    turn = np.arange(400)[:, np.newaxis] / 400.0 * sensor.pitch_mm / r
    angle = strip_angle(sensor, np.arange(float(sensor.strips))) - turn
    away = np.abs(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
    nearest = np.maximum(away - 0.5 * sensor.strip_width / r, 0.0)  # the strip's point nearest to the object
    return np.asarray((r * np.cos(nearest) >= r - depth).sum(axis=1), dtype=float)


@settings(FIXED, max_examples=50)
@given(st.integers(4, 40), st.floats(0.05, 1.0), st.floats(0.0, 1.0))
def test_strips_under_flat_are_those_counted(strips: int, strip_width: float, part: float) -> None:
    tube = covered(strips, strip_width)
    assert tube.radius_mm is not None
    depth = part * tube.radius_mm
    # The reach of object and strip, in pitches; near a whole number 400 turns may miss a count.
    reach = strips / np.pi * np.arccos(1.0 - part) + strip_width
    assume(abs(reach - round(reach)) > 0.01)
    counts = touched_in_every_turn(tube, depth)
    assert strips_under_flat(tube, depth) == (counts.min(), counts.max())


@pytest.mark.parametrize(("depth", "expected"), [(0.0, (0, 1)), (0.5, (2, 3)), (9.0, (5, 5))])
def test_strips_under_flat_of_the_prototype(depth: float, expected: tuple[int, int]) -> None:
    # At 0.5 mm the arc is 18 acos(17/18) = 6.03 mm long: 9.03 mm with a strip's width, 2.26 pitches.
    assert strips_under_flat(TUBE, depth) == expected


@pytest.mark.parametrize("strips", [12, 17, 30, 41])
def test_strips_without_gaps_meet_at_their_edges(strips: int) -> None:
    # An object that covers just so many pitches ends on the edges of strips, and touches those beyond.
    tube = covered(strips)
    assert tube.radius_mm is not None
    for pitches in range(strips // 2 - 1):
        depth = tube.radius_mm * (1.0 - np.cos(np.pi * pitches / strips))
        assert strips_under_flat(tube, depth) == (pitches + 1, pitches + 2)


@FIXED
@given(sensors("cyl-crs-m", most_strips=100), st.lists(st.floats(0.0, 1.0), min_size=2, max_size=9))
def test_a_deeper_object_touches_no_fewer_strips(sensor: Sensor, parts: list[float]) -> None:
    assert sensor.radius_mm is not None
    counts = np.array([strips_under_flat(sensor, part * sensor.radius_mm) for part in sorted(parts)])
    assert (np.diff(counts, axis=0) >= 0).all()
    assert (counts[:, 1] >= counts[:, 0]).all()
    assert (counts <= sensor.strips).all()


# Errors.


@pytest.mark.parametrize("depth", [-0.1, 9.1, float("nan")])
def test_impossible_depths(depth: float) -> None:
    with pytest.raises(SpecError) as caught:
        strips_under_flat(TUBE, depth)
    assert str(caught.value) == f"depth_mm = {depth}: must lie between 0 and the radius, 9.0 mm"


def test_a_flat_sensor_has_no_angle_and_no_depth() -> None:
    message = "^a crs-crs sensor is flat and has no radius_mm; use cyl-crs-m$"
    with pytest.raises(SpecError, match=message):
        strip_angle(FLAT, np.zeros(1))
    with pytest.raises(SpecError, match=message):
        strips_under_flat(FLAT, 1.0)

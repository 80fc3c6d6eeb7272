"""The polygon fit that is told how many vertices there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polygons import DRAWN, SURE, WHY, many_fits
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError
from tacstrip.geometry.metrics import mismatch
from tacstrip.geometry.moments import moments
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.thesis.shapes import SHAPES, SIMULATED

CRS = Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
SQUARE = Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
NOISE = Noise(positional=0.005)


@pytest.mark.parametrize("names", [("kh", "kl"), ("kl",)])
@pytest.mark.parametrize("noise", [NOISE, None])
def test_the_right_count_gives_what_is_found_without_it(names: tuple[str, ...], noise: Noise | None) -> None:
    scan = simulate(CRS, SQUARE, NOISE, rng=1)
    scan = Scan(time_s=0.0, **{n: scan[n] for n in names})
    found, told = (fit_polygon(scan, CRS, noise, vertices=n).objects[0] for n in (None, 4))
    assert told.status == ("ok" if len(names) > 1 else SURE)
    # Of one signature, with a noise that nobody gave, it is not sure enough without the count (.66).
    assert found.status == told.status or (len(names) == 1 and noise is None)
    np.testing.assert_allclose(told.vertices, found.vertices, atol=0.2)


@pytest.mark.parametrize("count", [3, 5, 6, 9])
@pytest.mark.parametrize("names", [("kh", "kl"), ("kh",)])
def test_as_many_as_told(count: int, names: tuple[str, ...]) -> None:
    scan = simulate(CRS, SQUARE, NOISE, rng=1)
    told = fit_polygon(Scan(time_s=0.0, **{n: scan[n] for n in names}), CRS, NOISE, vertices=count).objects[0]
    assert len(told.vertices) == count
    if count < 4:
        assert told.status == "doubtful"
        assert "times as far" in told.advice


def test_a_corner_with_a_vertical_edge_counts_two() -> None:
    rectangle = Contact.polygon([(20.5, 30), (70.5, 30), (70.5, 60), (20.5, 60)])
    told = fit_polygon(simulate(CRS, rectangle, NOISE, rng=4), CRS, NOISE, vertices=4).objects[0]
    assert len(told.vertices) == 4
    assert mismatch(rectangle.vertices, told.vertices).iou > 0.95


@many_fits
def test_weak_corners_are_worth_telling() -> None:
    """The hexagon at position 5: noise hides some of its kinks in k, and the outline without them is another."""
    sensor, hexagon = SIMULATED["crs-m"], SHAPES["hexagon"].contact(4)
    noise = Noise(quantisation=0.001, positional=0.005)
    overlap = np.array(
        [
            [
                mismatch(hexagon.vertices, o.vertices).iou
                for n in (None, 6)
                for o in fit_polygon(
                    simulate(sensor, hexagon, noise, rng=seed), sensor, noise, vertices=n, assessment="none"
                ).objects  # the fits themselves: what the posterior makes of them hides little
            ]
            for seed in range(12)
        ]
    )
    without, told = np.median(overlap, axis=0)
    assert 1.0 - told < 0.7 * (1.0 - without)


def test_more_than_the_strips_can_hold() -> None:
    few = Contact.polygon([(20, 30), (27, 50), (22, 60)])
    told = fit_polygon(simulate(CRS, few, NOISE, rng=2), CRS, NOISE, vertices=16).objects[0]
    assert len(told.vertices) < 16
    assert told.status == "doubtful"


@pytest.mark.parametrize("count", [-1, 0, 2, 19])
def test_no_polygon_has_so_many(count: int) -> None:
    with pytest.raises(OptionError, match="3 or more, and here 18 at most"):
        fit_polygon(simulate(CRS, SQUARE, NOISE, rng=1), CRS, NOISE, vertices=count)


def test_garbage() -> None:
    random, sensor = np.random.default_rng(0), replace(CRS, strips=40)
    for count in (3, 4, 18):
        values = random.uniform(size=(2, sensor.strips))
        values[:, random.uniform(size=sensor.strips) < 0.1] = np.nan
        scan = Scan(kh=values[0], kl=values[1])
        for o in fit_polygon(scan, sensor, NOISE, vertices=count, assessment="fast").objects:
            assert o.status == "ok" or o.advice
            assert not o.found or (o.vertices[:, 1].min() >= 0.0 and o.vertices[:, 1].max() <= 100.0)


COARSE = Sensor(construction="crs-m", strips=10, pitch_mm=9.0, length_mm=100.0)
TETRAGON = Contact.polygon([(19.1, 29.1), (63.8, 24.3), (74.5, 54.1), (40.8, 75.2)])


def test_six_readings_hold_four_corners_that_are_told() -> None:
    """Two numbers a corner leave none of six over: enough to fit, and no reason to leave a reading out."""
    noise = Noise(positional=0.002)
    found = fit_polygon(simulate(COARSE, TETRAGON, noise, rng=0), COARSE, noise, vertices=4).objects[0]
    assert len(found.vertices) == 4
    assert (found.status, WHY in found.advice) == ("doubtful" if DRAWN else "likely", True)
    assert "left out" not in found.advice
    assert "vertices, not the" not in found.advice
    assert mismatch(TETRAGON.vertices, found.vertices).iou > 0.75
    assert all(len(other.vertices) == 4 for other in found.alternatives)


def test_too_few_readings_are_said_where_corners_cannot_be_told_from_faults() -> None:
    found = fit_polygon(simulate(COARSE, TETRAGON, rng=0), COARSE).objects[0]
    assert found.status == "doubtful"
    drawn = "others explain the readings too: use finer strips or two signatures"
    assert (drawn if DRAWN else "more corners than 6 readings can tell") in found.advice


@pytest.mark.skipif(not DRAWN, reason="only the compiled core samples")
@pytest.mark.parametrize("noise", [None, Noise(positional=0.005)])
def test_the_outline_shown_has_the_corners_told_and_explains_the_readings(noise: Noise | None) -> None:
    """Of five readings the fit holds three corners, which explain none of them to better than 2 % of Vref."""
    sensor = Sensor(construction="crs-m", strips=9, pitch_mm=10.0, length_mm=100.0)
    contact = Contact.polygon([(22, 48), (45, 26), (70, 52), (40, 78)])
    scan = simulate(sensor, contact, Noise(positional=0.01), rng=1)
    found = fit_polygon(scan, sensor, noise, vertices=4).objects[0]
    assert (found.status, len(found.vertices)) == ("doubtful", 4)
    assert "the readings hold 3 vertices, not the 4 that were given" in found.advice
    assert "other outlines with 4 explain them" in found.advice
    assert "best outline" not in found.advice
    read = simulate(sensor, Contact.polygon(found.vertices))
    np.testing.assert_allclose(read["k"], scan["k"], atol=0.006)  # NaN at the same strips


@pytest.mark.skipif(not DRAWN, reason="only the compiled core samples")
def test_the_area_moves_the_outline_of_a_known_count() -> None:
    noise, area = Noise(positional=0.005), moments(TETRAGON.vertices)[0]
    scan = simulate(COARSE, TETRAGON, noise, rng=0)
    off = [
        abs(
            moments(fit_polygon(scan, COARSE, noise, vertices=4, area_mm2=given).objects[0].vertices)[0]
            - area
        )
        for given in (None, (area, 0.05 * area))
    ]
    assert off[1] < 0.1 * area < off[0]

"""Tracked objects are those that a search finds, keep their numbers, and are searched for where they change."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.tracking import Tracker
from tacstrip.tracking.tracker import SEARCH_INTERVAL_S, SEARCHED_AGAIN

FINE = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
NOISE = ts.Noise(positional=0.002)
TETRAGON = ts.Contact.polygon([(25, 35), (60, 22), (78, 56), (45, 76)])
ROUND = ts.Contact.polygon([(50 + 25 * math.cos(a), 50 + 16 * math.sin(a)) for a in np.linspace(0, 6.2, 60)])
TWO = ts.Contact.polygon([(8, 30), (30, 20), (35, 60)]) + ts.Contact.polygon([(60, 30), (84, 20), (90, 60)])


def _scan(contact: ts.Contact, number: int, sensor: ts.Sensor = FINE) -> ts.Scan:
    return ts.simulate(sensor, contact, NOISE, rng=number, time_s=number * 1e-3)


@pytest.mark.parametrize(("contact", "many"), [(TETRAGON, 1), (ROUND, 1), (TWO, 2)])
def test_followed_objects_are_those_that_a_search_finds(contact: ts.Contact, many: int) -> None:
    tracker = Tracker(FINE)
    count = 200
    for i in range(count):
        moved = contact.moved(0.0, 0.03 * i).turned(0.0005 * i)
        scan = _scan(moved, i)
        found = tracker.update(scan)
        assert [one.id for one in found] == list(range(1, many + 1))
    assert tracker.searches <= 3
    for one, shape in zip(found, moved.shapes, strict=True):
        truth = np.array(shape.exterior.coords[:-1])
        assert ts.mismatch(truth, one.shape.vertices).iou > 0.97
        assert one.shape.profile is not None
        assert one.shape.strips in scan.runs()


def test_a_followed_polygon_is_as_good_as_the_searched_one() -> None:
    from tacstrip.reconstruction.polygon.estimate import fit_polygon

    tracker = Tracker(FINE)
    errors = []
    for i in range(60):
        moved = TETRAGON.moved(0.02 * i, 0.01 * i)
        scan = _scan(moved, i)
        (one,) = tracker.update(scan, detail=True)
        found = (one.shape, fit_polygon(scan, FINE).objects[0])
        if all(len(shape.vertices) == 4 for shape in found):
            errors.append([np.abs(shape.vertices - moved.vertices).mean() for shape in found])
            assert one.shape.covariance is not None
            assert one.shape.covariance.shape == (8, 8)
    followed, searched = np.mean(errors, axis=0)
    assert len(errors) > 40
    assert followed < 1.1 * searched


def test_numbers_stay_with_objects_that_come_and_go() -> None:
    tracker = Tracker(FINE)
    left, right = (ts.Contact((shape,)) for shape in TWO.shapes)
    scenes = (left, left, TWO, TWO, right, right, TWO)
    ids = [[one.id for one in tracker.update(_scan(scene, i))] for i, scene in enumerate(scenes)]
    assert ids == [[1], [1], [1, 2], [1, 2], [2], [2], [3, 2]]
    untouched = ts.Scan(kh=np.full(100, np.nan), kl=np.full(100, np.nan), time_s=1.0)
    assert tracker.update(untouched) == ()


def test_an_outline_that_no_longer_explains_the_readings_is_searched_again() -> None:
    tracker = Tracker(FINE)
    for i in range(300, 304):
        tracker.update(_scan(TETRAGON, i))
    dented = ts.Contact.polygon([(25, 35), (50, 45), (60, 22), (78, 56), (45, 76)])
    told = [tracker.update(_scan(dented, i))[0].shape for i in range(304, 420)]
    assert told[0].status == "doubtful"
    assert told[0].advice == SEARCHED_AGAIN
    assert told[-1].advice != SEARCHED_AGAIN
    assert len(told[-1].vertices) == 5
    assert tracker.searches < 6


def test_a_corner_that_is_gone_is_dropped_within_half_a_second() -> None:
    tracker = Tracker(FINE)
    cut = ts.Contact.polygon([(25, 35), (60, 22), (70, 42), (78, 56), (68, 62), (45, 76)])
    scenes = [cut] * 3 + [TETRAGON] * int(1000 * SEARCH_INTERVAL_S + 1)
    counts = [len(tracker.update(_scan(scene, i))[0].shape.vertices) for i, scene in enumerate(scenes)]
    assert counts[-1] == 4


@pytest.mark.parametrize("method", ["profile", "vertex"])
def test_other_methods_keep_numbers_too(method: str) -> None:
    tracker = Tracker(FINE, method)
    assert [[o.id for o in tracker.update(_scan(TWO, i))] for i in range(3)] == [[1, 2]] * 3


def test_on_a_curved_skin_numbers_stay_across_the_seam() -> None:
    tip = ts.Sensor.load("fingertip")
    tracker = Tracker(tip, noise=ts.Noise(positional=0.002))
    ball = ts.Solid.sphere(6.0)
    for i, around in enumerate(np.radians([-25.0, -8.0, 8.0, 25.0])):
        out = np.array([0.7 * math.cos(around), 0.7 * math.sin(around), 0.714])
        patch = ts.press(tip, ball.at(20.0 * out, -out), depth_mm=1.5)
        (one,) = tracker.update(ts.simulate(tip, patch, ts.Noise(positional=0.002), rng=i, time_s=0.01 * i))
        assert one.id == 1
        assert one.shape.on_skin is None or one.shape.on_skin.area_mm2 == pytest.approx(
            patch.area_mm2, rel=0.25
        )


def test_an_object_goes_on_to_strips_whose_other_channel_is_left_out() -> None:
    """There a scan has one signature, where it had two before; in live use the doctor may do so at any time."""
    sensor = replace(FINE, without=tuple(f"{i}:v_l" for i in range(50)))
    tracker = Tracker(sensor)
    for i, x in enumerate((75.0, 74.0, 25.0, 24.0, 25.0, 75.0)):
        (one,) = tracker.update(
            _scan(ts.Contact.polygon([(-20, -20), (20, -25), (15, 20)]).placed(x, 50), i, sensor)
        )
    assert one.shape.centroid[0] == pytest.approx(75.0, abs=0.5)


def test_a_guarantee_is_of_the_scan_that_was_searched() -> None:
    """Regions that hold for certain what lay there when it was searched for hold nothing once it has moved."""
    sensor = ts.Sensor(construction="crs-crs", strips=30, pitch_mm=3.0, length_mm=100.0)
    tracker = Tracker(sensor, noise=NOISE)
    (one,) = tracker.update(_scan(TETRAGON, 0, sensor))
    assert one.shape.guarantee is not None
    (one,) = tracker.update(_scan(TETRAGON.moved(1.0, 1.0), 1, sensor))
    assert tracker.searches == 1
    assert (one.shape.status, one.shape.guarantee) == ("ok", None)


def test_what_no_longer_explains_the_readings_has_no_confidence() -> None:
    tracker = Tracker(FINE, executor=_Never())
    assert tracker.update(_scan(TETRAGON, 0))[0].shape.confidence is not None
    bent = ts.Contact.polygon([(25, 35), (60, 22), (78, 56), (56, 86), (45, 76), (30, 58)])
    (one,) = tracker.update(_scan(bent, 1))
    assert (one.shape.status, one.shape.advice, one.shape.confidence) == ("doubtful", SEARCHED_AGAIN, None)


class _Never(Executor):
    """Searches that never end."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        return Future()

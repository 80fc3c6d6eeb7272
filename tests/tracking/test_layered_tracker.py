"""Objects on two layers from scan to scan."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.tracking import LayeredTracker

SENSOR = ts.LayeredSensor.crossed(
    ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0, adc_bits=12)
)
NOISE = ts.Noise(positional=0.005)
PAIR = ts.Contact.polygon([(20, 20), (45, 25), (30, 50)]), ts.Contact.polygon([(35, 60), (70, 55), (60, 80)])
THIRD = ts.Contact.polygon([(70, 12), (88, 15), (80, 35)])
SECOND_S = 0.6  # later than the interval between two searches


class Later(Executor):
    """Searches whose result comes when the test says so."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Any]] = []

    def submit(self, function: Any, /, *words: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, lambda: function(*words)))
        return future

    def run(self) -> None:
        future, work = self.waiting.pop()
        future.set_result(work())


def scan(contact: ts.Contact, number: int, time_s: float) -> ts.Scan:
    return ts.simulate(SENSOR, contact, NOISE, rng=number, time_s=time_s)


def off(shape: ts.RecoveredObject, true: ts.Contact) -> float:
    """Return how far the farthest corner is from the nearest found one [mm]."""
    apart = np.linalg.norm(shape.vertices[:, None] - true.vertices, axis=2)
    return float(apart.min(axis=0).max())


@pytest.mark.parametrize("noise", [NOISE, None], ids=["noise known", "estimated"])
def test_two_that_pass_each_other_keep_their_numbers(noise: ts.Noise | None) -> None:
    tracker = LayeredTracker(SENSOR, noise)
    for i in range(40):
        now = PAIR[0].moved(0.5 * i, 0.0), PAIR[1].moved(-0.5 * i, 0.0)
        found = {one.id: one.shape for one in tracker.update(scan(now[0] + now[1], i, 0.01 * i))}
        assert {found[k + 1].status for k in range(2)} <= {"ok", "likely"}
        assert max(off(found[k + 1], now[k]) for k in range(2)) < 1.2 * SENSOR.layers[0].sensor.pitch_mm
    assert tracker.searches < 8  # the rest was followed
    (left, right) = tracker.update(scan(now[0] + now[1], 99, SECOND_S))  # a thorough search is due
    assert (left.shape.status, right.shape.status) == ("ok", "ok")
    assert {left.id, right.id} == {1, 2}


def test_what_no_longer_explains_is_doubted_until_a_search_has_found_more() -> None:
    later = Later()
    tracker = LayeredTracker(SENSOR, NOISE, later)
    (first,) = tracker.update(scan(PAIR[0] + PAIR[1], 0, 0.0))
    assert (first.shape.found, first.shape.advice) == (False, "what touches is being searched for")
    for i in range(1, 20):
        tracker.update(scan(PAIR[0].moved(0.2 * i, 0.0) + PAIR[1], i, 0.01 * i))
    later.run()  # of the first scan: what came since is followed
    found = tracker.update(scan(PAIR[0].moved(4.0, 0.0) + PAIR[1], 20, 0.2))
    assert [one.id for one in found] == [1, 2]
    assert off(found[0].shape, PAIR[0].moved(4.0, 0.0)) < 1.5
    three = PAIR[0].moved(4.0, 0.0) + PAIR[1] + THIRD
    found = tracker.update(scan(three, 21, 0.21), detail=True)
    assert [one.shape.status for one in found] == ["doubtful"] * 2
    assert found[0].shape.confidence is None
    later.run()
    found = tracker.update(scan(three, 22, 0.22), detail=True)
    assert [(one.id, len(one.shape.vertices)) for one in found] == [(1, 3), (2, 3), (3, 3)]
    assert found[2].shape.covariance is not None
    nothing = ts.Scan(kh=np.full(64, np.nan), kl=np.full(64, np.nan), time_s=0.3)
    assert tracker.update(nothing) == ()
    (again,) = tracker.update(scan(PAIR[0], 23, 0.31))
    assert again.id == 4

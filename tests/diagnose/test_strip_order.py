"""Two strips in each other's places, in recordings too short for the doctor's other signs: asked about, or said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from studies.exchanged_strips import exchanged, numbers, said, sound_log, unchecked_strips
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.exchanged import told_by_slope
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.strip_order import compared_orders

SLIDES, HARDLY = 105, 103  # a contact that slides over ten places, and one that changes its strips once


@pytest.mark.parametrize("pair", [(11, 12), (13, 18)])
def test_strips_exchanged_are_asked_about(pair: tuple[int, int]) -> None:
    report = diagnose(exchanged(sound_log(SLIDES)[0], *pair))
    (question,) = report.questions
    assert question.strips == pair
    assert question.causes[0] == "swapped-strips"
    assert not report.findings  # no other fault is made of them


def test_of_sound_strips_nothing_is_asked_and_what_would_go_unnoticed_is_said() -> None:
    log = sound_log(SLIDES)[0]
    report = diagnose(log)
    assert not report.findings
    assert not report.questions
    (reason,) = (text for text in report.unchecked if text.startswith("strips exchanged, of strips"))
    assert "an exchange would go unnoticed" in reason
    assert "11-12" not in reason  # of which an exchange is asked about, see above


def test_an_exchange_that_is_not_seen_is_not_passed_over() -> None:
    assert said(diagnose(exchanged(sound_log(HARDLY)[0], 11, 12)), (11, 12)) == "not checked"


def test_every_two_orders_are_compared_alike_from_both_sides() -> None:
    """What makes an order the better one makes the other one the worse, once the two are exchanged."""
    log = sound_log(SLIDES)[0]
    straight, turned = (
        compared_orders(places(working_copy(one, 0.004))) for one in (log, exchanged(log, 11, 12))
    )
    at = {tuple(pair): n for n, pair in enumerate(straight.pairs.tolist())}[11, 12]
    assert straight.worse[at]
    assert turned.better[at]
    assert turned.gain[at] == pytest.approx(-straight.gain[at])
    assert not straight.better.any()
    assert told_by_slope(places(working_copy(log, 0.004))) == set()


def test_strips_that_the_spec_leaves_out_are_not_listed() -> None:
    log = sound_log(HARDLY)[0]
    touched = sorted(unchecked_strips(diagnose(log)) & set(np.flatnonzero(log.touched.any(axis=0)).tolist()))
    strip = touched[len(touched) // 2]
    (reason,) = (text for text in _without(log, strip) if text.startswith("strips exchanged, of strips"))
    assert strip not in numbers(reason)


def _without(log: Log, strip: int) -> tuple[str, ...]:
    sensor = replace(log.sensor, without=(str(strip + log.sensor.strip_base),))
    return diagnose(Log.of(sensor, log.time_s, log.raw)).unchecked


def test_the_work_grows_with_the_strips() -> None:
    """A bar over most of 200 strips: of 19900 pairs those near each other, and those of the roughest, also far ones."""
    sensor = ts.Sensor(construction="crs-m", strips=200, pitch_mm=2.0, length_mm=200.0)
    scan, strip = np.arange(40)[:, None], np.arange(200)[None]
    k = np.where(strip < scan // 4, np.nan, 0.5 + (scan - 19.5) / 40.0 * (strip / 200.0 - 0.4))
    log = Log.of(sensor, 0.02 * np.arange(40.0), {"k": k})
    for pair in ((40, 160), (90, 98)):
        orders = compared_orders(places(working_copy(exchanged(log, *pair), 0.004)))
        assert len(orders.pairs) < 12 * sensor.strips
        best = np.argmax(np.where(orders.better, orders.gain, -1.0))
        assert tuple(orders.pairs[best].tolist()) == pair

"""With one signature a channel's fault is told from an inward corner's readings, where it can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.binding import exported
from tacstrip.reconstruction.polygon.lone_fault import at_a_rail, beyond_outline
from tacstrip.reconstruction.polygon.run import RunFit, fit_run
from tacstrip.reconstruction.result import RecoveredObject

SENSOR = ts.Sensor(construction="crs-m", strips=40, pitch_mm=2.5, length_mm=100.0)
NOISE = ts.Noise(positional=0.003)
CONTACT = ts.Contact.polygon([(15, 35), (60, 15), (88, 50), (40, 85)])
STRIP = 20  # l = .29, u = .79; it reads .45


def fitted(*faults: tuple[int, float]) -> tuple[RunFit, dict[str, np.ndarray]]:
    scan = ts.simulate(SENSOR, CONTACT, NOISE, rng=5)
    k, touched = scan["k"].copy(), scan.touched
    for strip, value in faults:
        k[strip] = value
    readings = {"k": k[touched]}
    return fit_run(SENSOR, SENSOR.x_mm[touched], readings, 0.003 / np.sqrt(3.0)), readings


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
@pytest.mark.parametrize(("value", "named"), [(0.0, True), (1.0, True), (0.95, False)])
def test_a_reading_that_no_notch_makes_costs_no_confidence(value: float, named: bool) -> None:
    """It had cost as much as a reading at an inward corner does: .82 -> .67."""
    k = ts.simulate(SENSOR, CONTACT, NOISE, rng=5)["k"].copy()
    found: list[RecoveredObject] = []
    for reading in (value, np.nan, 0.5):  # the last one a notch may make
        k[STRIP] = reading
        found += ts.fit_polygon(ts.Scan(k=k.copy()), SENSOR, NOISE, assessment="fast").objects
    faulty, without, notched = found
    assert faulty.faulty == ((f"{STRIP}:v_out",) if named else ())
    assert without.confidence is not None
    assert notched.confidence is not None
    assert faulty.confidence == pytest.approx(without.confidence, abs=0.01)
    assert notched.faulty == ()
    odds = [c / (1.0 - c) for c in (notched.confidence, without.confidence)]
    assert odds[0] < 0.5 * odds[1]


@pytest.mark.parametrize(
    ("faults", "beyond"),
    [
        ([(STRIP, 0.95)], [STRIP]),
        ([(STRIP, 0.1)], [STRIP]),
        ([(STRIP, 0.6)], []),  # a notch
        ([(STRIP, 0.95), (STRIP + 6, 0.95)], []),  # not alone
        ([], []),
    ],
)
def test_only_one_reading_off_the_outline_is_surely_a_fault(
    faults: list[tuple[int, float]], beyond: list[int]
) -> None:
    run, readings = fitted(*faults)
    first = int(np.searchsorted(SENSOR.x_mm, run.problem.origin_mm))
    assert run.excluded.sum() == len(faults)
    assert (np.flatnonzero(beyond_outline(run, readings)) + first).tolist() == beyond
    assert not at_a_rail(run, readings).any()


@pytest.mark.parametrize(("value", "found"), [(0.0, [4]), (1.0, [4]), (0.95, [])])
def test_of_few_readings_only_ground_and_vref_are_sure(value: float, found: list[int]) -> None:
    few = replace(SENSOR, strips=16, pitch_mm=6.25)
    scan = ts.simulate(few, CONTACT, NOISE, rng=1)
    k = scan["k"][scan.touched].copy()
    k[4] = value
    run = fit_run(few, few.x_mm[scan.touched], {"k": k}, 0.003 / np.sqrt(3.0))
    assert not run.checked
    assert np.flatnonzero(run.excluded).tolist() == [4]
    assert np.flatnonzero(beyond_outline(run, {"k": k})).tolist() == found


def test_at_either_end_nothing_is_sure() -> None:
    run, readings = fitted()
    for i in (0, len(readings["k"]) - 1):
        off = readings["k"].copy()
        off[i] = 0.95
        out = np.zeros_like(run.excluded)
        out[0, i] = True
        assert not beyond_outline(replace(run, excluded=out), {"k": off}).any()
    assert at_a_rail(run, {"k": np.array([0.0, 0.5, 1.0, np.nan])}).tolist() == [[True, False, True, False]]

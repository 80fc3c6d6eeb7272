"""Units of resistor ladders, apart from the package's forms: what a calibration leaves, and whether its ranges hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from studies import calibration_units as units
from tacstrip.arrays import FloatArray
from tacstrip.calibrate.plan import plan
from tacstrip.calibrate.residuals import residuals
from tacstrip.calibrate.unit import Calibrated

CONSTRUCTIONS = ("crs-crs", "crs-m")


def planned_places(sensor: ts.Sensor, wanted: float = 0.2, uneven: bool = False) -> FloatArray:
    made = plan(sensor, wanted, ts.Noise(positional=0.002), uneven=uneven)
    return np.array([(l, w) for l, w, times in made.contacts for _ in range(times)])


def left_percent(unit: units.Unit, done: Calibrated) -> float:
    """Return what 95 % of other readings lie within [% of Vref]."""
    off = residuals(done.sensor, units.other_readings(unit, np.random.default_rng(7), 20))
    return float(100.0 * np.quantile(np.concatenate([np.abs(v[np.isfinite(v)]) for v in off.values()]), 0.95))


def deviations(unit: units.Unit, done: Calibrated) -> list[float]:
    """Return errors of the printed parameters over their printed deviations."""
    found = []
    for p in done.parameters:
        part, *rest = p.name.split()
        strip = p.strip or 0
        if part in ("offset", "gain"):
            own = (unit.offset if part == "offset" else unit.gain)[rest[0]][strip]
            true = float(own) * (unit.sensor.vref_volt if part == "offset" else 1.0)
        else:
            true = unit.lambda_mm if part == "contact" else float(unit.sensing[strip].mean())
        found.append((p.value - true) / p.sigma)
    return found


@pytest.mark.parametrize("construction", CONSTRUCTIONS)
def test_planned_presses_leave_less_than_three_tenths(construction: str) -> None:
    """However often each is repeated."""
    rng, repeats = np.random.default_rng(11), {"crs-crs": 4, "crs-m": 1}[construction]
    unit = units.draw(rng, construction, strips=6, own_ratio=0.03)
    places = planned_places(unit.sensor, 1.0)
    runs = units.press(unit, places, rng, 0.002, repeats=repeats, place_mm=0.1)
    done = ts.calibrate_unit(unit.sensor, runs)
    assert done.status == "ok"
    assert left_percent(unit, done) < 0.3


def test_uneven_rubber_is_planned_for_and_described() -> None:
    rng = np.random.default_rng(3)
    unit = units.draw(rng, "crs-crs", strips=4, uneven=0.06, clamp=0.004)
    few, many = (planned_places(unit.sensor, uneven=uneven) for uneven in (False, True))
    assert len(few) < len(many) < 60
    poor, good = (
        ts.calibrate_unit(unit.sensor, units.press(unit, places, rng, 0.001), model=model)
        for places, model in ((few, "offset+gain+ratio+lambda"), (many, "auto"))
    )
    assert good.status == "ok"
    assert "profile" in good.model  # the two layers' own unevenness
    assert "warp16" in good.model
    assert left_percent(unit, good) < good.accuracy_percent < 0.2
    assert left_percent(unit, poor) > 0.3


def test_printed_ranges_hold_where_places_are_uncertain() -> None:
    """Places off by half a millimetre, told: drawn for each row, each press and each place."""
    every: list[float] = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        unit = units.draw(rng, CONSTRUCTIONS[seed % 2], strips=5)
        places = np.repeat(planned_places(unit.sensor, 0.1), 2, axis=0)
        l, w = (np.repeat(places[:, i : i + 1], 5, axis=1) for i in (0, 1))
        size = [(len(l), 5), (len(l), 1), (len(l) // 2, 1)][seed % 3]
        move = rng.normal(0.0, 0.5, (2, *size))
        move = np.repeat(move, len(l) // size[0], axis=1) * np.ones((1, 1, 5))
        raw = unit.read(np.maximum(l + move[0], 0.0), np.where(w > 0.0, w + move[1], 0.0))
        line = np.arange(l.size).reshape(l.shape) + 2
        runs = ts.Runs(l, w, unit.convert(raw, 0.0005, rng, uniform=False), line, {})
        told = replace(runs, l_sd_mm=np.full(l.shape, 0.5), w_sd_mm=np.where(w > 0.0, 0.5, 0.0))
        every += deviations(unit, ts.calibrate_unit(unit.sensor, told))
    inside = float(np.mean(np.abs(every) <= 2.0))
    assert 0.85 <= inside <= 1.0  # of some 55, three standard errors
    assert 0.7 < float(np.sqrt(np.mean(np.square(every)))) < 1.35


def test_a_named_model_heeds_uncertain_places() -> None:
    """Before, it passed their standard deviations over, and ranges were those of exact places."""
    rng = np.random.default_rng(3)
    unit = units.draw(rng, "crs-m", strips=4)
    exact = units.press(unit, planned_places(unit.sensor), rng, 0.001)
    told = replace(
        exact, l_sd_mm=np.full(exact.l_mm.shape, 2.0), w_sd_mm=np.where(exact.w_mm > 0.0, 2.0, 0.0)
    )
    known, unsure = (
        ts.calibrate_unit(unit.sensor, r, model="offset+gain+lambda").parameters for r in (exact, told)
    )
    assert all(b.sigma > 2.0 * a.sigma for a, b in zip(known, unsure, strict=True))


def test_runs_of_another_unit_are_said_where_the_spec_is_calibrated() -> None:
    rng = np.random.default_rng(5)
    one, other = (units.draw(rng, "crs-m", strips=4, offset=0.02) for _ in range(2))
    other = replace(other, sensor=one.sensor)
    places = planned_places(one.sensor)
    done = ts.calibrate_unit(one.sensor, units.press(one, places, rng, 0.001))
    assert done.advice == ""
    again = ts.calibrate_unit(done.sensor, units.press(one, places, rng, 0.001))
    assert again.advice == ""
    swapped = ts.calibrate_unit(done.sensor, units.press(other, places, rng, 0.001))
    assert "are the runs of another unit?" in swapped.advice


def test_few_presses_of_two_units_are_doubted_by_the_press_that_is_far_off() -> None:
    rng = np.random.default_rng(9)
    one, other = (units.draw(rng, "crs-m", strips=9, offset=0.05) for _ in range(2))
    other = replace(other, sensor=one.sensor)
    places = np.unique(planned_places(one.sensor, 1.0), axis=0)
    runs, strange = (units.press(unit, places, rng, 0.001) for unit in (one, other))
    assert ts.calibrate_unit(one.sensor, runs).status == "ok"
    theirs = np.arange(len(places))[:, None] % 2 == 0
    mixed = {name: np.where(theirs, strange.raw[name], v) for name, v in runs.raw.items()}
    done = ts.calibrate_unit(one.sensor, replace(runs, raw=mixed))
    assert done.status == "doubtful"
    assert done.advice.startswith("the press that begins in line")

"""Runs on the way of which something changed: a strip, the ruler, the readings' level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.calibrate.place_errors import place_numbers

STRIPS, LENGTH = 6, 200.0
SENSOR = ts.Sensor(construction="crs-m", strips=STRIPS, pitch_mm=6.0, length_mm=LENGTH)


def runs(seed: int) -> ts.Runs:
    """Return points and bars of 30 mm pressed twice, in the order of a person who begins at ground; line 2 on."""
    random = np.random.default_rng(seed)
    l, w = np.meshgrid(np.linspace(15.0, 145.0, 6), [0.0, 30.0])
    l, w = (np.repeat(np.repeat(v.ravel(), 2)[:, None], STRIPS, axis=1) for v in (l, w))
    moved = l + random.uniform(-0.1, 0.1, (len(l), 1))
    k = ts.signatures(SENSOR, moved, moved + w)["k"]
    k = k + random.uniform(-0.03, 0.03, STRIPS) + random.uniform(-0.002, 0.002, l.shape)
    return ts.Runs(l, w, {"k": k}, line=np.arange(2, 2 + l.size).reshape(l.shape), rest={})


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sound_runs_are_not_doubted(seed: int) -> None:
    result = ts.calibrate_unit(SENSOR, runs(seed))
    assert result.status == "ok"
    assert not result.goodness.changed


def test_a_strip_that_reads_otherwise_from_some_row_on_is_named_with_the_row() -> None:
    """Before, the rows of the smaller half were excluded, and the calibration was of no unit."""
    sound = runs(4)
    k = sound.raw["k"].copy()
    k[15:, 2] -= 0.02
    result = ts.calibrate_unit(SENSOR, replace(sound, raw={"k": k}))
    assert result.status == "doubtful"
    assert result.advice.startswith(f"strip 2 reads otherwise from line {sound.line[15, 2]} on, by -2 %")


def test_a_strip_whose_rows_contradict_each_other_is_named_with_them() -> None:
    sound = runs(5)
    k = sound.raw["k"].copy()
    k[[3, 8, 13, 18], 4] += [0.03, -0.05, 0.04, -0.03]
    result = ts.calibrate_unit(SENSOR, replace(sound, raw={"k": k}))
    assert result.status == "doubtful"
    assert result.advice.startswith(
        f"4 of 24 rows of strip 4 contradict its others (lines {sound.line[3, 4]}, "
    )


def test_one_slip_on_a_strip_is_left_out_and_doubts_nothing() -> None:
    sound = runs(6)
    k = sound.raw["k"].copy()
    k[7, 1] += 0.1
    result = ts.calibrate_unit(SENSOR, replace(sound, raw={"k": k}))
    assert result.status == "ok"
    assert [(row.line, row.strip) for row in result.excluded] == [(sound.line[7, 1], 1)]


def test_a_ruler_that_slips_on_the_way_is_told_with_row_and_distance() -> None:
    sound = runs(7)
    said = sound.l_mm.copy()
    said[8:] -= 1.5
    result = ts.calibrate_unit(SENSOR, replace(sound, l_mm=said))
    assert result.status == "doubtful"
    assert f"from line {sound.line[8].min()} on all strips read as if contacts lay +1." in result.advice


@pytest.mark.parametrize(("rail", "end"), [(0.0, "supply"), (1.0, "ground")])
def test_a_supply_or_ground_that_sags_on_the_way_is_told(rail: float, end: str) -> None:
    """Exit code 0 before, "within +-0.28 %", where new readings were .9 % off: an outside tester's."""
    sound = runs(8)
    k = sound.raw["k"].copy()
    k[9:] += 0.015 * (rail - k[9:])
    result = ts.calibrate_unit(SENSOR, replace(sound, raw={"k": k}))
    assert result.status == "doubtful"
    assert f"from line {sound.line[9].min()} on all strips read as if their {end}" in result.advice


def test_strips_share_what_a_slanted_bar_is_off_by() -> None:
    """Taken strip by strip, it told an offset as surely as a bar for each strip."""
    straight = runs(8)
    l = straight.l_mm.copy()
    l[5] = np.linspace(30.0, 170.0, STRIPS)
    number = place_numbers(replace(straight, l_mm=l))
    assert (number == number[:, :1]).all()
    assert number[5, 0] not in np.delete(number[:, 0], 5)


@pytest.mark.parametrize("longer", [1.0, 0.0])
def test_bars_that_are_all_longer_than_written_are_asked_about(longer: float) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=6, pitch_mm=6.0, length_mm=200.0)
    true = replace(sensor, contact_lambda_mm=1.5)
    place = np.array([(l, w) for w in (0.0, 30.0, 60.0) for l in (20.0, 60.0, 100.0, 120.0)])
    l_mm, w_mm = (np.repeat(v[:, None], 6, axis=1) for v in place.T)
    real = np.where(w_mm > 0.0, w_mm + longer, 0.0)
    random = np.random.default_rng(3)
    raw = {
        n: k + random.normal(0.0, 5e-4, k.shape) for n, k in ts.signatures(true, l_mm, l_mm + real).items()
    }
    runs = ts.Runs(l_mm, w_mm, raw, line=np.arange(2, 2 + l_mm.size).reshape(l_mm.shape), rest={})
    done = ts.calibrate_unit(sensor, runs)
    assert done.longer_mm == pytest.approx(longer, abs=0.1)
    assert ("longer than written" in done.advice) == (longer != 0.0)
    assert done.sensor.contact_lambda_mm == pytest.approx(1.5, abs=0.15)

"""What can be read but is probably not meant is told, and what is meant is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.diagnose import read_log
from tacstrip.io.input_checks import (
    half_read,
    over_vref,
    unfinished,
    unlikely_contact,
    unlikely_lengths,
    unlikely_times,
)
from tacstrip.io.readings import read_unchecked
from tacstrip.sensor.exchanged import exchanged, read_twice

SENSOR_KEYS = {"format": 1, "construction": "crs-crs", "strips": 24, "pitch_mm": 4.0, "length_mm": 120.0}
SENSOR = ts.Sensor.from_dict(SENSOR_KEYS)
SHAPE = [(20, 30), (70, 25), (60, 80), (30, 90)]


def _scan(noise: float = 0.0, seed: int = 0, shape: object = SHAPE) -> ts.Scan:
    return ts.simulate(SENSOR, ts.Contact.polygon(shape), ts.Noise(positional=noise), rng=seed)  # type: ignore[arg-type]


def _exchanged(*scans: ts.Scan) -> str:
    return exchanged({name: np.stack([s[name] for s in scans]) for name in scans[0].signatures})


@pytest.mark.parametrize(
    ("strips", "pitch", "length", "told"),
    [
        (24, 4.0, 120.0, ""),
        (24, 0.5, 60.0, ""),
        (24, 0.004, 0.12, "mm, not m?"),
        (24, 4.0, 0.12, "shorter"),
        (24, 4000.0, 120000.0, "not micrometres? All lengths in a spec are millimetres; if so, write pitch_mm = 4,"),
        (24, 0.4, 12.0, "not cm? All lengths in a spec are millimetres; if so, write pitch_mm = 4, length_mm = 120"),
        (20, 0.8, 9.0, "if so, write pitch_mm = 8, length_mm = 90"),
        (20, 0.5, 10.0, "if so, write pitch_mm = 5, length_mm = 100"),
    ],
)  # fmt: skip
def test_a_spec_in_other_units(strips: int, pitch: float, length: float, told: str) -> None:
    keys = {"strips": strips, "pitch_mm": pitch, "length_mm": length}
    said = unlikely_lengths(ts.Sensor.from_dict(SENSOR_KEYS | keys))
    assert told in said if told else said == ""


def test_a_contact_in_other_units() -> None:
    """In centimetres all of the sensor is its corner at x = y = 0, where few contacts lie."""
    assert unlikely_contact(ts.Contact.polygon(SHAPE), SENSOR) == ""
    assert unlikely_contact(ts.Contact.points([(0.02, 0.03)]), SENSOR) == ""  # has no size
    for unit, factor in (("metres", 1000.0), ("centimetres", 10.0)):
        small = ts.Contact.polygon(np.array(SHAPE) / factor)
        assert f"is it in {unit}? Coordinates are millimetres" in unlikely_contact(small, SENSOR)
    assert unlikely_contact(ts.Contact.polygon(np.array(SHAPE) / 10.0).moved(40.0, 0.0), SENSOR) == ""


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
def test_exchanged_signatures(noise: float) -> None:
    for seed in range(20):
        scan = _scan(noise, seed)
        assert _exchanged(scan) == ""
        swapped = ts.Scan(kh=scan["kl"], kl=scan["kh"])
        assert _exchanged(swapped).endswith(
            "of 13 strips: are the columns exchanged? Then exchange their names, or the two wires. Or are all readings "
            "measured from Vref down? Then `tacstrip import` turns them: --answer exchanged=from_vref"
        )
    assert "of scan 1, and so in 1 scan(s) more" in _exchanged(scan, swapped, swapped)
    assert _exchanged(scan, scan, swapped) == ""


def test_one_channel_in_both_columns() -> None:
    scan = _scan(0.005)
    both = {"kh": np.stack([scan["kh"]] * 2), "kl": np.stack([scan["kh"]] * 2)}
    assert read_twice(both).startswith("v_h is v_l to the last digit in 26 of 26 readings")
    assert read_twice({name: scan[name] for name in scan.signatures}) == read_twice({"kh": scan["kh"]}) == ""
    found = ts.reconstruct(ts.Scan(kh=scan["kh"], kl=scan["kh"]), SENSOR)
    assert found.status == "doubtful"
    assert "are both columns of one channel" in found.objects[0].advice


def test_a_line_under_noise_is_not_exchanged() -> None:
    """Where k_h and k_l are the same, noise puts one of them below the other."""
    line = ts.Contact.line([(10.0, 60.0), (90.0, 60.0)])
    for seed in range(50):
        scan = ts.simulate(SENSOR, line, ts.Noise(positional=0.01), rng=seed)
        assert _exchanged(scan) == ""


def test_one_signature_or_nothing_touched_is_not_exchanged() -> None:
    assert _exchanged(ts.Scan(kl=np.full(24, 0.5))) == ""
    nothing = ts.Scan(kh=np.full(24, np.nan), kl=np.full(24, np.nan))
    assert _exchanged(nothing) == ""


def test_half_read() -> None:
    assert half_read("r.csv", SENSOR, ("kh", "kl")) == ""
    assert half_read("r.csv", SENSOR, ("electrodes",)) == ""
    assert half_read("r.csv", SENSOR, ("kh",)) == "using v_h only: r.csv has no v_l (or code_l)"


@pytest.mark.parametrize(
    ("step", "told"),
    [
        (5.0, "ms"),
        (10.0, "ms"),
        (20.0, "ms"),
        (33.0, "ms"),
        (100.0, "ms"),
        (20000.0, "us"),
        (60.0, ""),
        (3600.0, ""),
    ],
)
def test_whole_seconds_that_may_be_another_unit(step: float, told: str) -> None:
    """Nor do scans that are left out, or one without a time, change that."""
    time_s = step * np.array([0, 1, 2, 4, np.nan, 6, 7, 8])
    said = unlikely_times("r.csv", time_s)
    assert f"time_unit={told}" in said if told else said == ""
    assert unlikely_times("r.csv", np.where(np.arange(8) == 5, 6 * step + 0.5, time_s)) == ""
    uneven = 60.0 * np.arange(8) + (np.arange(8) == 3)  # as of a clock, not of somebody who sets minutes
    assert "time_unit=ms" in unlikely_times("r.csv", uneven)


def test_readings_over_vref(tmp_path: Path) -> None:
    file = tmp_path / "r.csv"
    file.write_text("scan,time_s,strip,v_h,v_l\n")
    assert "are they over Vref?" in over_vref(file, SENSOR, 0.2)
    assert over_vref(file, SENSOR, 0.21) == ""  # 1.05 V
    assert over_vref(file, SENSOR, 0.0) == ""  # nothing touches
    low = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=4.0, length_mm=120.0, vref_volt=1.8)
    assert over_vref(file, low, 0.2) == ""
    codes = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=4.0, length_mm=120.0, adc_bits=12)
    file.write_text("scan,time_s,strip,code_h,code_l\n")
    assert over_vref(file, codes, 0.2) == ""


def test_a_number_that_is_cut_is_told(tmp_path: Path) -> None:
    file = tmp_path / "r.csv"
    lines = [f"0,0,{i},{2.0 + 0.1 * i:.4f},{1.0 + 0.1 * i:.4f}" for i in range(24)]
    for text, cut in (
        ("\n".join(lines), ""),  # whole, but for its last line end
        ("\n".join(lines)[:-2] + "\n", ""),  # somebody rounded it
        ("\n".join(lines)[:-2], "its last number, 3.30, fewer digits than the others: is the file cut off?"),
        ("\n".join(lines)[:-5], "its last number, 3"),
        ("\n".join(lines[:5])[:-2], "its last number, 1.40"),  # the column beside tells, too
        ("\n".join(lines[:4])[:-2], ""),  # too few to say
        ("\n".join(f"0,{i}.0,{i}.5,{1.0 + 0.1 * i:.4f}" for i in range(5))[:-2], ""),  # other digits beside
        ("", ""),
    ):
        file.write_text(f"scan,time_s,strip,v_h,v_l\n{text}")
        assert unfinished(file) == "" if not cut else cut in unfinished(file)


def test_positions_that_contradict_the_strips_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "r.csv"

    def read(step: float, start: float = 0.0) -> list[ts.Scan]:
        rows = [f"{s},0,{i},{start + step * i:.6g},3,2\n" for s in range(2) for i in range(24)]
        file.write_text("scan,time_s,strip,x_mm,v_h,v_l\n" + "".join(rows))
        return ts.read_readings(file, SENSOR)

    assert len(read(4.0, 2.0)) == len(read(4.02)) == len(read(1.0)) == len(read(0.0)) == 2
    with pytest.raises(ts.ReadingError, match=r"x_mm falls from 94 to 2 while .*in the order of x_mm"):
        read(-4.0, 94.0)
    with pytest.raises(ts.ReadingError, match=r"x_mm rises by 0\.4 .*pitch_mm is 4: is x_mm in centimetres"):
        read(0.4, 0.2)
    with pytest.raises(ts.ReadingError, match=r"is x_mm in metres\? All lengths are millimetres"):
        read(0.004)
    with pytest.raises(ts.ReadingError, match="is pitch_mm in the spec in centimetres"):
        read(40.0)
    assert read_log(file, ts.Sensor.from_dict(SENSOR_KEYS | {"pitch_mm": 40.0})).time_s.tolist() == [0.0, 0.0]


def test_python_is_warned_of_what_the_command_line_says(tmp_path: Path) -> None:
    """Readings over Vref, and one channel of a strip empty; each warning at the caller's line."""
    file = tmp_path / "readings.csv"
    file.write_text("scan,time_s,strip,v_h,v_l\n0,0,0,0.5,0.2\n0,0,1,0.5,\n")
    sensor = ts.Sensor(construction="crs-crs", strips=2, pitch_mm=4.0, length_mm=120.0, vref_volt=5.0)
    with pytest.warns(ts.ReadingWarning) as told:
        ts.read_readings(file, sensor)
    assert ["empty where the strip's other" in str(w.message) for w in told] == [True, False]
    assert "are they over Vref?" in str(told[1].message)
    assert {w.filename for w in told} == {__file__}
    in_cm = ts.Sensor(construction="crs-crs", strips=2, pitch_mm=0.4, length_mm=12.0, vref_volt=0.5)
    with pytest.warns(ts.ReadingWarning) as told:
        ts.read_readings(file, in_cm)
    assert "mm, not cm" in str(told[0].message)


def test_a_reading_beyond_vref_by_rounding_is_vref(tmp_path: Path) -> None:
    """Half a step of the converter is rounding, more is not."""
    file = tmp_path / "r.csv"

    def read(volts: float, bits: int | None) -> list[ts.Scan]:
        rows = [f"0,0,{i},{volts:.9g},2\n" for i in range(24)]
        file.write_text("scan,time_s,strip,v_h,v_l\n" + "".join(rows))
        return read_unchecked(file, ts.Sensor.from_dict(SENSOR_KEYS | ({"adc_bits": bits} if bits else {})))

    for bits, step in ((10, 5.0 / 1023.0), (12, 5.0 / 4095.0), (None, 5.0 / 65535.0)):
        assert set(read(5.0 + 0.49 * step, bits)[0]["kh"]) == {1.0}
        assert set(read(-0.49 * step, bits)[0]["kh"]) == {0.0}
        for volts in (5.0 + 0.51 * step, -0.51 * step):
            with pytest.raises(ts.ReadingError, match="outside 0 to 5 V"):
                read(volts, bits)

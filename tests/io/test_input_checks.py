"""What can be read but is probably not meant is told, and what is meant is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.input_checks import (
    contact_in_metres,
    exchanged,
    half_read,
    in_metres,
    largest,
    over_vref,
)

SENSOR = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=4.0, length_mm=120.0)
SHAPE = [(20, 30), (70, 25), (60, 80), (30, 90)]


def _scan(noise: float = 0.0, seed: int = 0, shape: object = SHAPE) -> ts.Scan:
    return ts.simulate(SENSOR, ts.Contact.polygon(shape), ts.Noise(positional=noise), rng=seed)  # type: ignore[arg-type]


def test_a_spec_in_metres() -> None:
    assert in_metres(SENSOR) == ""
    assert "mm, not m?" in in_metres(
        ts.Sensor(construction="crs-m", strips=3, pitch_mm=0.004, length_mm=0.12)
    )
    for pitch, length in ((8.0, 0.3), (8.0, 3.0)):  # one of both in metres or the like
        mixed = ts.Sensor(construction="crs-m", strips=3, pitch_mm=pitch, length_mm=length)
        assert "mm, not m?" in in_metres(mixed)


def test_a_contact_in_metres() -> None:
    assert contact_in_metres(ts.Contact.polygon(SHAPE), SENSOR) == ""
    assert contact_in_metres(ts.Contact.points([(0.02, 0.03)]), SENSOR) == ""  # has no size
    metres = ts.Contact.polygon(np.array(SHAPE) / 1000.0)
    assert "is it in metres? Coordinates are millimetres" in contact_in_metres(metres, SENSOR)


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
def test_exchanged_signatures(noise: float) -> None:
    for seed in range(20):
        scan = _scan(noise, seed)
        assert exchanged([scan]) == ""
        swapped = ts.Scan(kh=scan["kl"], kl=scan["kh"])
        assert exchanged([swapped]).endswith("of 13 strips: are the columns exchanged?")
    assert "of scan 1, and so in 1 scan(s) more" in exchanged([scan, swapped, swapped])


def test_a_line_under_noise_is_not_exchanged() -> None:
    """Where k_h and k_l are the same, noise puts one of them below the other."""
    line = ts.Contact.line([(10.0, 60.0), (90.0, 60.0)])
    for seed in range(50):
        scan = ts.simulate(SENSOR, line, ts.Noise(positional=0.01), rng=seed)
        assert exchanged([scan], ts.Noise(positional=0.01)) == ""


def test_one_signature_or_nothing_touched_is_not_exchanged() -> None:
    assert exchanged([ts.Scan(kl=np.full(24, 0.5))]) == ""
    nothing = ts.Scan(kh=np.full(24, np.nan), kl=np.full(24, np.nan))
    assert exchanged([nothing]) == ""
    assert largest([nothing]) == 0.0


def test_half_read() -> None:
    assert half_read("r.csv", SENSOR, ("kh", "kl")) == ""
    assert half_read("r.csv", SENSOR, ("electrodes",)) == ""
    assert half_read("r.csv", SENSOR, ("kh",)) == "using v_h only: r.csv has no v_l (or code_l)"


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

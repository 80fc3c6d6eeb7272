"""A converter with wide codes: corrected, measured, written into the spec, and counted in the uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from polygons import SURE
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.sensor import Converter
from tacstrip.stream import decode, encode

BITS, TOP = 12, 4095
PICO = Converter(wide_codes=(512, 1536, 2560, 3584), widths_lsb=(9.5, 9.0, 10.0, 8.5))
SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, adc_bits=BITS)
UNIT = ts.Sensor(
    construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, adc_bits=BITS, converter=PICO
)


def _read(volts: FloatArray) -> FloatArray:
    """Return what such a converter reads of voltages over Vref, code by code, without a word of ours."""
    widths = np.full(2**BITS, (2**BITS - sum(PICO.widths_lsb)) / (2**BITS - 4))
    widths[list(PICO.wide_codes)] = PICO.widths_lsb
    edges = np.concatenate([[0.0], np.cumsum(widths)]) / 2**BITS
    return np.clip(np.searchsorted(edges, volts, side="right") - 1, 0, TOP).astype(float)


def test_voltages_come_back_within_half_a_code() -> None:
    volts = np.random.default_rng(3).uniform(0.0, 1.0, 200_000)
    codes = _read(volts)
    wide = np.isin(codes, PICO.wide_codes)
    before, after = (
        np.abs(k * TOP - (volts * 2**BITS - 0.5)) for k in (codes / TOP, PICO.correct(codes / TOP, BITS))
    )
    assert before[~wide].max() > 3.5  # steps
    assert after[~wide].max() < 0.51
    assert after[wide].max() == pytest.approx(5.0, abs=0.05)
    spread = PICO.sigma(codes / TOP, BITS) * TOP
    assert np.sqrt(np.mean((after / spread) ** 2)) == pytest.approx(1.0, abs=0.02)
    assert np.sqrt(np.mean((after[wide] / spread[wide]) ** 2)) == pytest.approx(1.0, abs=0.05)
    assert np.mean(after**2) * 12.0 == pytest.approx(PICO.mean_square(BITS), rel=0.03)
    np.testing.assert_allclose(
        PICO.distort(PICO.correct(codes / TOP, BITS), BITS), codes / TOP, atol=0.005 / TOP
    )


def test_the_table_is_measured_from_an_uneven_sweep() -> None:
    at = np.linspace(0.0, 1.0, 2_000_000)
    found = Converter.measured(_read(at + 0.1 * np.sin(3.0 * at) * (1.0 - at)).astype(np.uint16))
    assert found.wide_codes == PICO.wide_codes
    np.testing.assert_allclose(found.widths_lsb, PICO.widths_lsb, rtol=0.03)
    with pytest.raises(ts.ReadingError, match="sweep the whole range more slowly"):
        Converter.measured(_read(at * 0.9).astype(np.uint16))
    with pytest.raises(ts.ReadingError, match="give the converter's bits"):
        Converter.measured([5000])


def test_codes_of_the_unit_are_decoded_with_it(tmp_path: Path) -> None:
    UNIT.save(tmp_path / "sensor.toml")
    unit = ts.Sensor.load(tmp_path / "sensor.toml")
    assert unit == UNIT
    scan = ts.simulate(SENSOR, ts.Contact.polygon([(6, 30), (94, 40), (48, 85)]))
    back = decode(encode(scan, unit), unit)
    for name in scan.signatures:
        wide = np.isin(encode(scan, unit).codes[name], PICO.wide_codes)
        assert np.nanmax(np.abs(back[name] - scan[name]) * TOP - 5.0 * wide) < 0.51


def test_wide_codes_count_in_the_uncertainty() -> None:
    noise = ts.Noise()
    ratio = reading_sigma(noise, UNIT) / reading_sigma(noise, SENSOR)
    assert ratio == pytest.approx(np.sqrt(PICO.mean_square(BITS)))
    assert 1.25 < ratio < 1.45
    assert UNIT.adc_bound == pytest.approx(5.0 / TOP)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('wide_codes = "512"\n', "must be a list of numbers"),
        ("wide_codes = [512]\n", "1 wide_codes and 0 widths_lsb"),
        ("wide_codes = [512, 12]\nwidths_lsb = [9, 9]\n", "must ascend"),
        ("wide_codes = [512]\nwidths_lsb = [-1]\n", "must be above 0, to 64"),
        ("wide_codes = [5000]\nwidths_lsb = [9]\n", "must be codes of adc_bits = 12"),
        ("codes = [512]\n", "unknown key 'codes'; its keys are: wide_codes, widths_lsb"),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path: Path, table: str, said: str) -> None:
    file = tmp_path / "sensor.toml"
    file.write_text(SENSOR.to_toml() + "\n[adc]\n" + table, encoding="utf-8")
    with pytest.raises(ts.SpecError, match=said):
        ts.Sensor.load(file)


def test_with_the_table_outlines_explain_the_readings_and_without_they_do_not() -> None:
    """Quadrangles on ten strips, without other errors than the converter's."""
    random = np.random.default_rng(5)
    n_ok = {UNIT: 0, SENSOR: 0}
    for _ in range(5):
        angle = np.arange(4) * np.pi / 2 + random.uniform(0.0, 1.2, 4)
        corners = np.column_stack([50 + 38 * np.cos(angle), 50 + 35 * np.sin(angle)])
        raw = encode(ts.simulate(SENSOR, ts.Contact.polygon(corners)), UNIT)
        for sensor in n_ok:
            n_ok[sensor] += ts.fit_polygon(decode(raw, sensor), sensor, ts.Noise()).status == SURE
    assert n_ok[UNIT] == 5
    assert n_ok[SENSOR] <= 2

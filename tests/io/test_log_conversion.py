"""What the lines around a log's readings say of their volts: asked where it contradicts the spec, else held to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

VREF = 3.3
TWO = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=VREF, adc_bits=12)
K = np.stack([0.5 + 0.01 * np.arange(24), 0.3 + 0.01 * np.arange(24)], axis=1).reshape(8, 3, 2)


def log(
    above: str, full: float = 4095.0, zero: float = 0.0, columns: str = "code_h,code_l", form: str = ".0f"
) -> str:
    """Return a log of K as codes, or volts, between a zero and full scale above it."""
    rows = [
        f"{n / 10},{s}," + ",".join(format(zero + full * k, form) for k in K[n, s])
        for n in range(8)
        for s in range(3)
    ]
    return "\n".join([f"# {above}", f"time_s,strip,{columns}", *rows]) + "\n"


def imported(text: str, sensor: ts.Sensor, tmp_path: Path, *answers: str) -> np.ndarray:
    """Return K as `tacstrip import` reads it, and again by the mapping that it wrote."""
    (tmp_path / "log.csv").write_text(text)
    sensor.save(tmp_path / "s.toml")
    found = []
    out = tmp_path / "out.csv"
    for given in (
        [part for a in answers for part in ("--answer", a)],
        ["--mapping", str(tmp_path / "map.toml")],
    ):
        run = CliRunner().invoke(
            cli,
            [
                "import",
                str(tmp_path / "log.csv"),
                str(tmp_path / "s.toml"),
                "-o",
                str(out),
                "--force",
                *given,
            ],
        )
        assert run.exit_code == 0, run.output
        read = [(s.kh, s.kl) for s in ts.read_readings(out, sensor)]
        found.append(np.array(read, dtype=float).transpose(0, 2, 1))
        if not given or given[0] == "--answer":
            (tmp_path / "out.mapping.toml").rename(tmp_path / "map.toml")
    assert np.array_equal(found[0], found[1])
    return found[0]


def asked(text: str, sensor: ts.Sensor = TWO, **answers: str) -> dict[str, tuple[str, ...]]:
    with pytest.raises(Unanswered) as questions:
        propose(of_text(text), sensor, answers)
    return {q.key: q.choices for q in questions.value.questions}


@pytest.mark.parametrize(
    ("comment", "choices"),
    [
        ("voltages are behind a 2:1 divider, multiply by 2", ("1", "2")),
        ("amplifier gain 4", ("1", "0.25")),
        ("voltage divider fitted", ("1", "2")),
    ],
)
def test_a_comment_that_states_a_factor_is_asked(comment: str, choices: tuple[str, ...]) -> None:
    text = log(comment, 0.5 * VREF, columns="v_h,v_l", form=".4f")
    assert asked(text) == {"scale": choices}
    assert propose(of_text(text), TWO, {"scale": "2"}).mapping.scale == 2.0


@pytest.mark.parametrize("comment", ["gain: 1.0", "multiplexed, multiple strips", "k = v divided by Vref"])
def test_a_comment_without_a_factor_is_not(comment: str) -> None:
    assert propose(of_text(log(comment, VREF, columns="v_h,v_l", form=".4f")), TWO).mapping.scale == 1.0


def test_volts_behind_a_divider_are_read_with_its_factor(tmp_path: Path) -> None:
    text = log("behind a 2:1 divider", 0.5 * VREF, columns="v_h,v_l", form=".4f")
    np.testing.assert_allclose(imported(text, TWO, tmp_path, "scale=2"), K, atol=1e-4)


def test_codes_of_another_gain_are_read_with_its_factor(tmp_path: Path) -> None:
    text = log("PGA gain 2", 2.0 * 2047.0)
    np.testing.assert_allclose(imported(text, TWO, tmp_path, "scale=0.5"), 0.5 * K, atol=3e-4)


def test_a_resolution_that_changes_is_refused() -> None:
    ten, twelve = (log("", full).split("\n")[2:-1] for full in (1023.0, 4095.0))
    text = "\n".join(
        [
            "# analogReadResolution(10)",
            "time_s,strip,code_h,code_l",
            *ten[:12],
            "# analogReadResolution(12)",
            *twelve[12:],
        ]
    )
    with pytest.raises(ts.ReadingError, match=r"line 1 says .* and line 15 "):
        asked(text + "\n")


@pytest.mark.parametrize(
    "comment", ["analogReadResolution(10)", "1023 = 3.3 V", "full scale 0x3FF", "1023 is Vref"]
)
def test_another_resolution_than_the_specs_is_asked(comment: str) -> None:
    assert asked(log(comment, 1023.0)) == {"adc_bits": ("10", "12")}
    assert propose(of_text(log(comment, 1023.0)), replace(TWO, adc_bits=10)).mapping.unit == "code"


@pytest.mark.parametrize(
    ("comment", "zero", "answers"),
    [
        ("16 bit, two's complement", 0.0, ("coding=signed",)),
        ("16 bit, two's complement, 0x7FFF = Vref", 0.0, ()),
        ("offset binary", 32768.0, ("coding=offset",)),
        ("0x8000 = 0 V, 0xFFFF = Vref", 32768.0, ()),
    ],
)
def test_codes_with_a_sign(comment: str, zero: float, answers: tuple[str, ...], tmp_path: Path) -> None:
    sensor, text = replace(TWO, adc_bits=16), log(comment, 32767.0, zero)
    if answers:
        assert "coding" in asked(text, sensor)
    np.testing.assert_allclose(imported(text, sensor, tmp_path, *answers), K, atol=3e-5)


def test_codes_below_the_zero_of_an_offset_are_refused() -> None:
    with pytest.raises(ts.OptionError, match="reach 2989, below 32768, which would be 0 V"):
        propose(of_text(log("offset binary")), replace(TWO, adc_bits=16), {"coding": "offset"})


def test_the_volts_of_a_code_that_contradict_the_spec_are_asked(tmp_path: Path) -> None:
    sensor = replace(TWO, adc_bits=16)
    text = log("signed 16 bit, 0.125 mV/LSB", VREF / 0.125e-3)
    assert asked(text, sensor, coding="signed") == {"scale": ("1.24117", "1")}
    np.testing.assert_allclose(
        imported(text, sensor, tmp_path, "coding=signed", "scale=1.24117"), K, atol=5e-5
    )
    assert asked(log("4095 = 5 V")) == {"scale": ("1.51515", "1")}


def test_a_scale_of_0_in_a_mapping_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    ColumnMapping({"v": "out"}, "V", 3).save(file)
    file.write_text("scale = 0.0\n" + file.read_text())
    with pytest.raises(ts.OptionError, match="scale = 0; it must be above 0"):
        ColumnMapping.load(file)


def test_an_offset_is_taken_off_numbers_but_not_words() -> None:
    table = of_text("t_ms,s1,s2\n0,33000,-\n50,33001,33100\n")
    mapping = ColumnMapping(
        {"s1": "1:out", "s2": "2:out"}, "code", 2, 1, time="t_ms", time_unit="ms", zero=32768.0
    )
    values = [scan.values[:, 0].tolist() for scan in scans(table, mapping)]
    np.testing.assert_equal(values, [[232.0, np.nan], [233.0, 332.0]])

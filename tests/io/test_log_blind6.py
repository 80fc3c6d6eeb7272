"""What six-and-thirty blind logs taught: names that are not lost, fields that are missing, clocks that disagree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.decoding import decoded
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

TWO = ts.Sensor(construction="crs-crs", strips=5, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0, adc_bits=10)
ONE = ts.Sensor(construction="crs-m", strips=5, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
SCANS = range(8)
H = np.array([[0, 600 + 7 * n, 640 + 5 * n, 655 + 4 * n, 0] for n in SCANS])
L = np.array([[0, 400 + 3 * n, 420 + 6 * n, 431 + 5 * n, 0] for n in SCANS])
V = np.where(H > 0, H * 5.0 / 1023.0, np.nan)


def row(values: np.ndarray, form: str = ".0f", by: str = " ") -> str:
    """Return values as fields; what is nan is empty."""
    return by.join("" if np.isnan(v) else format(v, form) for v in values)


def read(text: str, sensor: ts.Sensor, **answers: str) -> Proposal:
    """Return what the log is read as."""
    return propose(of_text(text), sensor, answers)


def asked(text: str, sensor: ts.Sensor, **answers: str) -> dict[str, tuple[str, ...]]:
    """Return the keys of what is asked, and the answers that are offered."""
    with pytest.raises(Unanswered) as error:
        read(text, sensor, **answers)
    return {q.key: q.choices for q in error.value.questions}


def values(found: Proposal) -> np.ndarray:
    """Return the readings as they stand in the log, by scan, strip and channel."""
    return np.stack([s.values for s in found.scans])


@pytest.mark.parametrize(
    ("form", "swapped"),
    [
        ("H: {h} | L: {l}", False),
        ("L: {l} | H: {h}", False),
        ("High: {h} ; Low: {l}", False),
        ("A: {l} | B: {h}", True),
    ],
)
def test_the_first_name_of_a_line_is_not_lost(form: str, swapped: bool) -> None:
    lines = [f"12:31:0{n}.100 -> " + form.format(h=row(H[n]), l=row(L[n])) for n in SCANS]
    found = read("\n".join(lines) + "\n", TWO)
    assert np.array_equal(np.nan_to_num(values(found)), np.stack([H, L], axis=2))
    assert [s.time_s for s in found.scans] == pytest.approx(list(SCANS))


def test_a_temperature_behind_readings_is_no_time() -> None:
    lines = [f"12:31:0{n}.100 -> H: {row(H[n])} | L: {row(L[n])} | T: {24.1 + 0.1 * n:.1f}" for n in SCANS]
    found = read("\n".join(lines) + "\n", TWO)
    assert [s.time_s for s in found.scans] == pytest.approx(list(SCANS))
    assert any(d.startswith("T: does not run as the times before the lines") for d in found.doubts)
    bare = "\n".join(line.partition("-> ")[2] for line in lines) + "\n"
    told = read(bare, TWO, rate_hz="40")
    assert told.scans[-1].time_s == pytest.approx(7 / 40.0)
    assert any("'T' rises by 0.1" in d for d in told.doubts)


def test_a_rising_column_between_others_is_no_time() -> None:
    lines = [f"Frame {n}: {row(H[n])} / {row(L[n])}" for n in SCANS]
    found = read("\n".join(lines) + "\n", TWO)
    assert not found.mapping.timed
    assert any("the log has no time" in doubt for doubt in found.doubts)
    found = read("\n".join(lines) + "\n", TWO, rate_hz="10")
    assert np.array_equal(np.nan_to_num(values(found)), np.stack([H, L], axis=2))


@pytest.mark.parametrize("mark", ["", "# "])
def test_fewer_fields_than_names_in_all_lines_are_asked_about(mark: str) -> None:
    names = f"{mark}time_s,s0_V,s1_V,s2_V,s3_V,s4_V,batt_V"
    lines = [f"{n / 10},{row(V[n, 1:], '.3f', ',')},3.9" for n in SCANS]  # the column of strip 0 is lost
    text = "\n".join([names, *lines]) + "\n"
    assert asked(text, ONE)["batt_V"] == ("skip",)


def test_a_remark_that_is_missing_in_all_lines_is_a_warning() -> None:
    full = np.where(np.isnan(V), 0.004, V)
    lines = [f"{n / 10},{row(full[n], '.3f', ',')}" for n in SCANS]
    text = "\n".join(["time_s,s4_V,s3_V,s2_V,s1_V,s0_V,note", *lines]) + "\n"
    found = read(text, ONE, untouched="none")
    assert values(found)[:, ::-1, 0] == pytest.approx(np.round(full, 3))
    assert any("as if note were missing" in d for d in found.doubts)


def test_codes_at_half_of_full_scale_are_asked_about() -> None:
    codes = np.where(np.isnan(V), 32768, 32768 + 32767 * V / 5.0)
    text = "\n".join(
        [
            "time_s,s0_raw,s1_raw,s2_raw,s3_raw,s4_raw",
            *(f"{n / 10},{row(codes[n], '.0f', ',')}" for n in SCANS),
        ]
    )
    assert asked(text, ONE)["coding"] == ("offset", "unsigned")
    found = read(text, ONE, coding="offset", adc_bits="16", untouched="0")
    assert values(found)[:, 1:4, 0] * 5.0 / 32767.0 == pytest.approx(V[:, 1:4], abs=2e-4)


def test_volts_of_a_code_and_names_in_a_sentence() -> None:
    sensor = replace(ONE, rest_volt=0.0, touch_volt=0.05)
    codes = np.where(np.isnan(V), 1, V / 1.875e-4)
    above = [
        "// ADS1115, PGA +-6.144 V, 1 LSB = 0.1875 mV",
        "// columns: micros, AIN0..AIN4 = strips 0..4 (raw int16)",
    ]
    found = read("\n".join([*above, *(f"{8000 * n} {row(codes[n])}" for n in SCANS)]) + "\n", sensor)
    assert found.mapping.unit == "V"
    assert found.mapping.scale == pytest.approx(1.875e-4)
    assert values(found)[:, 1:4, 0] * found.mapping.scale == pytest.approx(V[:, 1:4], abs=1e-4)
    assert found.scans[1].time_s - found.scans[0].time_s == pytest.approx(0.008)


def test_what_only_size_tells_of_a_clock_is_warned_of() -> None:
    text = (
        "\n".join(["t,s0_V,s1_V,s2_V,s3_V,s4_V", *(f"{20 * n},{row(V[n], '.3f', ',')}" for n in SCANS)])
        + "\n"
    )
    found = read(text, ONE)
    assert found.scans[1].time_s == pytest.approx(0.02)
    assert any("nothing says its unit" in d for d in found.doubts)
    assert not read(text, ONE, rate_hz="50").doubts


def test_clocks_and_units_that_disagree_are_warned_of() -> None:
    lines = [f"{0.13 * n:.2f},{100 * n},{row(V[n], '.3f', ',')}" for n in SCANS]
    found = read("\n".join(["t_pc_s,t_mcu_ms,s0_V,s1_V,s2_V,s3_V,s4_V", *lines]), ONE)
    assert any("'t_mcu_ms' by 0.7 s" in d for d in found.doubts)
    lines = [f"{n / 10},{row(1000 * V[n], '.0f', ',')}" for n in SCANS]
    found = read("\n".join(["time_s,s0_mV,s1_mV,s2_mV,s3_mV,s4_mV", "s,V,V,V,V,V", *lines]), ONE)
    assert any("stands above the unit 'V'" in d for d in found.doubts)


def test_messages_among_a_loggers_lines() -> None:
    volts = [f"h_V=[{row(H[n] / 205, '.3f')}] l_V=[{row(L[n] / 205, '.3f')}]" for n in SCANS]
    lines = [f"2024-05-01 12:00:0{n},250 INFO rig: frame {n} {volts[n]}" for n in SCANS]
    fails = ["Traceback (most recent call last):", '  File "io.py", line 88, in poll', "TimeoutError"]
    text = (
        "\n".join([*lines[:4], "2024-05-01 12:00:03,900 WARNING rig: late by 12 ms", *fails, *lines[4:]])
        + "\n"
    )
    found = read(text, TWO, untouched="0")
    assert len(found.scans) == len(SCANS)
    assert any("messages among the readings" in r and "Traceback" in r for r in found.reasons)


def test_columns_of_one_name_are_named_as_the_pair() -> None:
    lines = [f"{n / 10},{row(V[n], '.3f', ',')}" for n in SCANS]
    # That strip 3 then lacks a column is asked in the same round.
    assert {*asked("\n".join(["time_s,s0_V,s1_V,s2_V,s2_V,s4_V", *lines]), ONE)} == {
        "s2_V (column 5)",
        "missing",
    }


@pytest.mark.parametrize(
    ("encoding", "said"),
    [
        ("euc_kr", "\uc13c\uc11c \uc77c\uacf1, \ubc14\ub2e5"), ("cp932", "\u30bb\u30f3\u30b5\u30fc\u306e\u51fa\u529b"),
        ("gb18030", "\u5b9e\u9a8c\u6570\u636e\u7b2c\u4e00\u7ec4"),
        ("big5", "\u6e2c\u91cf\u5099\u8a3b\u7528\u624b\u6307"),
        ("cp1252", "Gr\xf6\xdfe, d\xe9j\xe0, \xc4\xd6\xdc \xe4\xf6\xfc \xdf, \xb0C"),
    ],
)  # fmt: skip
def test_letters_of_one_script_tell_their_encoding(tmp_path: Path, encoding: str, said: str) -> None:
    log = tmp_path / "log.csv"
    log.write_bytes(f"{said}\n0,1.5,2.5\n".encode(encoding))
    assert decoded(log).startswith(said)


def test_encodings_of_other_scripts(tmp_path: Path) -> None:
    head = "\u65f6\u95f4(\u79d2),\u6761\u5e26\u7f16\u53f7,\u7535\u538b(V)"
    lines = [f"{n / 10},{s},{0.5 + 0.1 * s + 0.01 * n:.3f}" for n in SCANS for s in range(5)]
    log = tmp_path / "log.csv"
    log.write_bytes("\n".join([head, *lines]).encode("gb18030"))
    assert decoded(log).startswith(head)
    greek = (
        "\u03c7\u03c1\u03cc\u03bd\u03bf\u03c2,\u03c4\u03b1\u03b9\u03bd\u03af\u03b1,\u03c4\u03ac\u03c3\u03b7"
    )
    log.write_bytes("\n".join([greek, *lines]).encode("iso8859-7"))
    with pytest.raises(Unanswered, match="looks garbled"):
        read(decoded(log), ONE)

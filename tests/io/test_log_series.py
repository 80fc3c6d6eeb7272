"""Loggers' own signs, lines of other series, names in labels and comments, logs of two sensors."""
# ruff: noqa: E501 (a line is a log's)

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

ONE = ts.Sensor(construction="crs-m", strips=4, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12)
TWO = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12)
N = range(12)
HIGH = np.array([[np.nan, 2.113 - 0.05 * i, 2.2 + 0.03 * i, np.nan] for i in N])
BOTH = np.stack([HIGH, HIGH - 0.6], axis=2)
CODES = np.round(BOTH * 1000.0)


def text_of(value: float, form: str = ".3f", nothing: str = "") -> str:
    return nothing if np.isnan(value) else format(value, form)


def check(lines: list[str], sensor: ts.Sensor, truth: np.ndarray, **answers: str) -> tuple[str, ...]:
    found = propose(of_text("\n".join(lines) + "\n"), sensor, answers, frozenset({"vref_volt", "strip_base"}))
    read = np.stack([s.values for s in found.scans])
    np.testing.assert_allclose(read.reshape(truth.shape), truth, atol=6e-4)
    np.testing.assert_allclose([s.time_s for s in found.scans], 0.02 * np.arange(len(truth)), atol=1e-6)
    return (*found.reasons, *found.doubts)


def asked(lines: list[str], sensor: ts.Sensor, **answers: str) -> dict[str, tuple[str, ...]]:
    with pytest.raises(Unanswered) as raised:
        propose(of_text("\n".join(lines) + "\n"), sensor, answers)
    return {q.key: q.choices for q in raised.value.questions}


def test_a_cut_topic_is_no_other_series() -> None:
    lines = [
        f'bench/skin/strip/{s} {{"t_ms":{20 * i},"vh":{text_of(h, nothing="null")},"vl":{text_of(low, nothing="null")}}}'
        for i in N
        for s, (h, low) in enumerate(BOTH[i])
    ]
    lines[9] = "bench/skin/stri 2.5"
    found = propose(of_text("\n".join(lines) + "\n"), TWO)
    kept = [n for n in N if n != 9 // len(BOTH[0])]
    np.testing.assert_allclose(np.stack([s.values for s in found.scans]), BOTH[kept], atol=6e-4)
    assert any("left out: line 10 " in doubt for doubt in found.doubts)


@pytest.mark.parametrize("over", ["+++++++", "OL", "BURNOUT"])
def test_signs_blanks_and_levels_of_a_logger(over: str) -> None:
    begun = np.where(
        (np.arange(4) == 2) & (np.arange(12)[:, None] < 3), np.nan, HIGH - 0.4 * (np.arange(4) == 2)
    )
    body = [
        f"{i + 1},2026/11/23 09:00:00,{20 * i:3d},"
        + ",".join(text_of(v, "+.3f", over).replace("+2", "+  2").replace("+1", "+  1") for v in begun[i])
        + ",LHLLLLLLLL,LLLL"
        for i in N
    ]
    lines = [
        "Vendor,Nobody",
        "Model,X1",
        "Number,Date&Time,ms,CH1,CH2,CH3,CH4,Alarm1-10,AlarmOut",
        "NO.,Time,ms,V,V,V,V,A1234567890,A1234",
        *body,
    ]
    said = check(lines, replace(ONE, strip_base=1), begun)
    assert not any("in the log, so from" in s for s in said)
    commas = [line.replace(",", ";").replace(".", ",") for line in lines]
    check(commas, replace(ONE, strip_base=1), begun)


def test_over_range_of_large_readings_is_asked() -> None:
    rows = [
        f"{20 * i},OL,{2.0 + 0.1 * i:.3f},{'OL' if i > 5 else f'{2.4 + 0.1 * i:.3f}'},OL" for i in range(12)
    ]
    assert asked(["t_ms,v0,v1,v2,v3", *rows], ONE)["untouched"] == ("OL",)


def test_over_range_within_a_contact_is_asked_and_no_text_with_a_number_is_offered() -> None:
    rows = [f"{20 * i},,{text_of(HIGH[i, 1])},{'OL' if i > 5 else 2.2},{2.1 - 0.01 * i:.3f}" for i in N]
    assert asked(["t_ms,v0,v1,v2,v3", *rows], ONE)["untouched"] == ("OL",)
    rows[4] = "80,,2.1,2.2!1.9,2.1"
    assert asked(["t_ms,v0,v1,v2,v3", *rows], ONE) == {"broken_lines": ("skip",), "untouched": ("OL",)}


def test_labels_above_an_instruments_channels_name_the_strips() -> None:
    names = [f"{end}{s + 1}" for s in range(4) for end in ("low ", "high ")]
    rows = [
        f"{i / 50:.3e},"
        + ",".join(f"{v:.4f}" for pair in np.nan_to_num(BOTH[i], nan=0.003)[:, ::-1] for v in pair)
        for i in N
    ]
    lines = ["Model,X2", "Label," + ",".join(names), "TIME," + ",".join(f"CH{n}" for n in range(1, 9)), *rows]
    said = check(
        lines,
        replace(TWO, strip_base=1, rest_volt=0.0, touch_volt=0.05),
        np.where(np.isnan(BOTH), 0.003, BOTH),
    )
    assert any("strips are numbered from 1" in s for s in said)
    assert not any("in the log, so from" in s for s in said)


def test_order_is_that_in_which_no_pair_is_exchanged() -> None:
    noise = 0.004 * np.sin(np.arange(96.0)).reshape(12, 4, 2)  # of open inputs, around 0
    rows = [
        ",".join(f"{v:.4f}" for v in [i / 50, *np.where(np.isnan(BOTH[i]), noise[i], BOTH[i]).ravel()])
        for i in N
    ]
    lines = ["TIME," + ",".join(f"CH{n}" for n in range(1, 9)), *rows]
    found = propose(of_text("\n".join(lines)), replace(TWO, strip_base=1, rest_volt=0.0, touch_volt=0.05))
    read = np.stack([s.values for s in found.scans])
    np.testing.assert_allclose(read[:, 1:3], BOTH[:, 1:3], atol=6e-4)
    assert not found.doubts


@pytest.mark.parametrize(
    "header",
    [
        "# scan epoch strip end volts   (strips that nothing touches are not sent)",
        "# columns: scan epoch strip end volts",
    ],
)
def test_names_in_a_comment_with_words_around(header: str) -> None:
    lines = [
        header,
        *(
            f"{i} {1.7e9 + i / 50:.3f} {s} {end} {v:.4f}"
            for i in N
            for s in (1, 2)
            for end, v in zip("HL", BOTH[i, s], strict=True)
        ),
    ]
    check(lines, TWO, BOTH, strip_base="0")
    assert {"scan", "which", "strip", "time"} <= set(asked(lines[1:], replace(TWO, strips=5))["column 1"])


def test_codes_called_k() -> None:
    lines = [
        "ms," + ",".join(f"k{s}" for s in range(4)),
        *(f"{20 * i}," + ",".join(text_of(v, ".0f", "-") for v in CODES[i, :, 0]) for i in N),
    ]
    check(lines, ONE, CODES[:, :, 0])
    with pytest.raises(ReadingError, match="the most that there can be in fraction"):
        check([lines[0].replace("k", "ratio k"), *lines[1:]], ONE, CODES[:, :, 0])


@pytest.mark.parametrize("form", ["S{s}:H={h} L={l}", "ch{s}: H={h} L={l}", "strip{s}:h:{h} l:{l}"])
def test_hexadecimal_groups_behind_their_strip(form: str) -> None:
    def of(value: float) -> str:
        return "----" if np.isnan(value) else f"0x{int(value):03X}"

    lines = [
        f"t={20 * i}ms "
        + " ".join(form.format(s=s, h=of(h), l=of(low)) for s, (h, low) in enumerate(CODES[i]))
        for i in N
    ]
    check(["*** log opened 2026-11-23 09:00 ***", *lines], TWO, CODES)


def test_a_comment_settles_the_order_and_the_units() -> None:
    rows = [";".join(text_of(v, ".0f", "4095") for v in CODES[i, :, 0]) for i in N]
    above = ["% fs = 50 Hz", "% adc: 12 bit"]
    full = np.where(np.isnan(CODES[:, :, 0]), 4095.0, CODES[:, :, 0])
    rest = replace(ONE, rest_volt=3.3, touch_volt=0.1)
    check([*above, "% order: strip 0 ... strip 3", *rows], rest, full)
    for said in ("strip 0 is the last, strip 3 the first", "strip 3 is the last, strip 0 the first"):
        assert "strip_order" in asked([*above, f"% order: {said}", *rows], rest)
    rate = asked(
        ["# sampled at 50 Hz", "t_ms,v0,v1,v2,v3", *(f"{i / 50:.2f},,2.1,{2 + i / 90:.3f}," for i in N)], ONE
    )
    assert "time_unit" in rate


@pytest.mark.parametrize("word", ["pad", "robot"])
def test_of_two_sensors_one_is_asked_for(word: str, tmp_path: Path) -> None:
    body = [
        f"{i / 50:.2f},{side},{s},{text_of(h)},{text_of(low)}"
        for i in N
        for side, add in (("left", 0.0), ("right", 0.2))
        for s, (h, low) in enumerate(BOTH[i] + add)
    ]
    lines = [f"time_s,{word},strip,v_h,v_l", *body]
    assert asked(lines, TWO) == {word: ("left", "right")}
    check(lines, TWO, BOTH, **{word: "left"})
    check(lines, TWO, BOTH + 0.2, **{word: "right"})
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines))
    propose(read_table(log), TWO, {word: "right"}).mapping.save(tmp_path / "map.toml")
    again = scans(read_table(log), ColumnMapping.load(tmp_path / "map.toml"))
    np.testing.assert_allclose(np.stack([s.values for s in again]), BOTH + 0.2, atol=6e-4)


def test_two_sensors_in_turn_are_never_one() -> None:
    lines = [
        "time_s,pad,v0,v1,v2,v3",
        *(f"{i / 50:.2f},{'AB'[i % 2]}," + ",".join(map(text_of, HIGH[i])) for i in N),
    ]
    assert asked(lines, ONE)["pad"] == ("A", "B", "skip")


def test_units_that_are_offered_are_taken() -> None:
    lines = [
        "time_s,strip,v_h [mV],v_l [mV]",
        *(f"{i / 50:.2f},{s},{text_of(h)},{text_of(low)}" for i in N for s, (h, low) in enumerate(BOTH[i])),
    ]
    offered = asked(lines, TWO)["unit"]
    assert offered == ("V",)
    check(lines, TWO, BOTH, unit="V")

"""Logs of a blind tester: rest at full scale, a data logger's heading, shifted readings, answers that cannot apply."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import OptionError
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
N = 8
HIGH = np.array([[560.0 + 9 * s + 4 * n for s in range(4)] for n in range(N)])
LOW = HIGH - 150.0 - 12.0 * np.arange(4)
IDLE = np.array([[n < 2 or s == 3 or (s == 0 and n > 5) for s in range(4)] for n in range(N)])


def read(text: str, **answers: str) -> np.ndarray:
    """Return the readings, by scan, strip and channel."""
    if answers.get("unit") == "code":
        answers.setdefault("adc_bits", "10")
    return np.stack([s.values for s in propose(of_text(text), PAD, answers).scans])


def rows(high: np.ndarray, low: np.ndarray, step: float = 50.0) -> str:
    """Return a log of codes."""
    lines = ["t_ms," + ",".join(f"h{s},l{s}" for s in range(4))]
    for n in range(len(high)):
        cells = [f"{v:g}" for pair in zip(high[n], low[n], strict=True) for v in pair]
        lines.append(",".join([f"{step * n:g}", *cells]))
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("bits", "noise", "top"), [(10, 3, True), (10, 3, False), (12, 9, True), (12, 9, False), (16, 100, True)]
)
def test_noise_at_either_end_is_no_contact(bits: int, noise: int, top: bool) -> None:
    full = 2**bits - 1
    rng = np.random.default_rng(3)
    times = (full + 1) // 1024
    rest = rng.integers(0, noise, (2, N, 4))
    rest = full - rest if top else rest
    found = read(
        rows(*(np.where(IDLE, r, times * v) for r, v in zip(rest, (HIGH, LOW), strict=True))),
        unit="code",
        adc_bits=str(bits),
    )
    np.testing.assert_array_equal(np.isnan(found), np.repeat(IDLE[:, :, None], 2, axis=2))


def test_one_channel_alone_at_full_scale_is_asked_about() -> None:
    high, low = (np.where(IDLE, 1022.0, v) for v in (HIGH, LOW))
    high[4:, 2] = 1023.0
    with pytest.raises(Unanswered, match="at once: is that where"):
        read(rows(high, low), unit="code")
    assert np.isnan(read(rows(high[:, :4], low), untouched="1022", unit="code")).any()


def test_an_answer_that_cannot_apply_is_an_error() -> None:
    high, low = (np.where(IDLE, 1022.0, v) for v in (HIGH, LOW))
    for answer in ("banana", "1032", ">many"):
        with pytest.raises(OptionError, match="stands in no column of readings"):
            read(rows(high, low), untouched=answer, unit="code")
    for answer in (">1020", "1022"):
        np.testing.assert_array_equal(
            np.isnan(read(rows(high, low), untouched=answer, unit="code"))[:, :, 0], IDLE
        )


@pytest.mark.parametrize("extra", [True, False])
def test_names_of_a_data_logger_stand_above_units_and_processing(extra: bool) -> None:
    order = [3, 2, 1, 0]
    names = ["TIMESTAMP", "RECORD", *(f"{e}({s + 1})" for e in ("Upper", "Lower") for s in order)]
    units, made = ["TS", "RN", *8 * ["mV"]], ["", "", *8 * ["Smp"]]
    if extra:
        names, units, made = [*names, "BattV"], [*units, "Volts"], [*made, "Min"]
    lines = [",".join(f'"{c}"' for c in row) for row in (["TOA5", "bench"], names, units, made)]
    for n in range(N):
        cells = [f"{3.0 * v[n, s]:.1f}" for v in (HIGH, LOW) for s in order]
        lines.append(f'"2026-11-12 10:00:{n:02d}",{n + 70},' + ",".join([*cells, "12.6"][: 8 + extra]))
    found = read("\n".join(lines))
    np.testing.assert_allclose(found[:, :, 0], 3.0 * HIGH)
    np.testing.assert_allclose(found[:, :, 1], 3.0 * LOW)


@pytest.mark.parametrize("answers", [{}, {"column 1": "time", "column 2": "which"}])
def test_lines_of_two_named_ends_without_names_of_columns(answers: dict[str, str]) -> None:
    lines = [
        f"{40 * n} {end} " + " ".join("." if i else f"{v:g}" for i, v in zip(IDLE[n], values[n], strict=True))
        for n in range(N) for end, values in (("TOP", HIGH), ("BOT", LOW))
    ]  # fmt: skip
    found = read("\n".join(lines), unit="code", **answers)
    np.testing.assert_allclose(found, np.where(IDLE[:, :, None], np.nan, np.stack([HIGH, LOW], axis=2)))


@pytest.mark.parametrize(
    "line",
    ["# every value minus 0.1 V offset", "# inverted: 5 V minus pin voltage", "# offset of 20 mV subtracted",
     "# Offset 0,1 V abgezogen", "# logged is Vref - reading"],
)  # fmt: skip
def test_what_shifts_or_inverts_readings_is_asked_about(line: str) -> None:
    with pytest.raises(Unanswered, match="no factor takes that back"):
        read(line + "\n" + rows(HIGH, LOW), unit="code")
    assert np.isfinite(read(line + "\n" + rows(HIGH, LOW), unit="code", scale="1")).all()


@pytest.mark.parametrize(
    "line",
    ["# supply 5 V, minus on GND", "# non-inverting amplifier removed, 5 V", "# offset calibrated, Vref 5 V",
     "# display inverted", "# range 0 V - 5 V"],
)  # fmt: skip
def test_what_shifts_nothing_is_not_asked_about(line: str) -> None:
    assert np.isfinite(read(line + "\n" + rows(HIGH, LOW), unit="code", scale="1")).all()
    asked = []
    try:
        read(line + "\n" + rows(HIGH, LOW), unit="code")
    except Unanswered as error:
        asked = [q.text for q in error.questions]
    assert not any("no factor" in text for text in asked)


def test_numpy_scalars_in_lists_are_numbers() -> None:
    def shown(values: np.ndarray) -> str:
        return "[" + ", ".join("nan" if np.isnan(v) else f"np.float64({v:g})" for v in values) + "]"

    high, low = (np.where(IDLE, np.nan, v) for v in (HIGH, LOW))
    lines = [f"2026-11-12 10:00:{n:02d},000 high={shown(high[n])} low={shown(low[n])}" for n in range(N)]
    np.testing.assert_allclose(read("\n".join(lines), unit="code"), np.stack([high, low], axis=2))

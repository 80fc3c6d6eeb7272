"""Logs as data loggers, monitors and frames write them, and what may not be lost or mirrored on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
SHEET = ts.Sensor(construction="crs-m", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0, adc_bits=10)
N = 8
OUT = np.array([[1.2 + 0.1 * s + 0.17 * n for s in range(4)] for n in range(N)])
HIGH, LOW = OUT + 0.8, OUT + 0.1 * np.arange(4)
OPEN = np.array([[abs(1.0 + n / 4 - s) > 1.3 for s in range(4)] for n in range(N)])


def read(text: str, sensor: ts.Sensor = PAD, **answers: str) -> tuple[np.ndarray, np.ndarray]:
    """Return readings (scans, strips, channels) in volts, and times [s] from the first scan on."""
    scans = propose(of_text(text), sensor, answers).scans
    return np.stack([s.values for s in scans]), np.array([s.time_s for s in scans]) - scans[0].time_s


def rows(by: str = ",", nothing: str = "", step: float = 0.1) -> list[str]:
    """Return a row for each scan, with the time [s] first."""
    cells = [[nothing if o else f"{v:.3f}" for v, o in zip(OUT[n], OPEN[n], strict=True)] for n in range(N)]
    return [by.join([f"{step * n:.1f}", *cells[n]]) for n in range(N)]


def is_out(values: np.ndarray) -> bool:
    """Return whether readings are those of `OUT`."""
    return bool(np.allclose(values[..., 0], np.where(OPEN, np.nan, OUT), atol=1e-3, equal_nan=True))


@pytest.mark.parametrize("name", ["Instant (s)", "Zeit 1 - Messrate [s]"])
def test_a_unit_of_time_and_even_steps_tell_the_time(name: str) -> None:
    values, times = read("\n".join([f"{name};S1;S2;S3;S4", *rows(";")]), SHEET)
    assert is_out(values)
    np.testing.assert_allclose(times, 0.1 * np.arange(N), atol=1e-9)


@pytest.mark.parametrize("mark", ["*******", "\u221e", "9.99999E+99"])
def test_over_range_marks_of_open_inputs(mark: str) -> None:
    values, _ = read("\n".join(["time [s],S1 [V],S2 [V],S3 [V],S4 [V]", *rows(",", mark)]), SHEET)
    assert is_out(values)


def test_rows_with_a_rarer_word_above_the_usual_ones_are_asked_about() -> None:
    """They stood above the first line of the usual form, and were set aside with a remark."""
    lines = [r.replace("0.0;", "0.0;ERRX;", 1) if n == 0 else r for n, r in enumerate(rows(";", "1.000"))]
    head = ["Maker;Logger 3", "Model;LX", "Channel;A;B;C;D", "Kind;U;U;U;U"]
    first = lines[0].split(";")
    lines[0] = ";".join([first[0], "ERRX", *first[3:]])
    with pytest.raises(Unanswered, match="ERRX"):
        read("\n".join([*head, *lines]), SHEET)


def test_a_log_that_begins_within_a_scan_counted_behind_a_mark() -> None:
    lines = ["4 H=", "S4 H=open L=open"]
    for n in range(N):
        lines += ["", f"#{n + 42} @ {100 * n + 10500} ms"]
        lines += [
            f"S{s + 1} H=open L=open" if OPEN[n, s] else f"S{s + 1} H={HIGH[n, s]:.3f}V L={LOW[n, s]:.3f}V"
            for s in range(4)
        ]
    found = propose(of_text("\n".join(lines)), PAD)
    assert len(found.scans) == N
    assert any("above the first '#'" in d for d in found.doubts)
    np.testing.assert_allclose(np.diff([s.time_s for s in found.scans]), 0.1, atol=1e-9)


def test_sentences_with_decimal_commas_and_commas_between() -> None:
    lines = ["Lectura"]
    for n in range(N):
        lines += ["", f"Tiempo: {0.5 * n:.1f} s".replace(".", ",")]
        for s in range(4):
            pair = f"arriba: {HIGH[n, s]:.2f} V; abajo: {LOW[n, s]:.2f} V".replace(".", ",").replace(";", ",")
            lines.append(f"Tira {s + 1} -> {'sin contacto' if OPEN[n, s] else pair}")
    values, times = read("\n".join(lines))
    assert times[-1] == pytest.approx(0.5 * (N - 1))
    np.testing.assert_allclose(values[..., 0], np.where(OPEN, np.nan, HIGH), atol=0.006)


def test_a_settings_table_with_gains_of_one_asks_nothing() -> None:
    gains = ["Channel,Function,Range,Gain,Offset", *(f"{101 + s},DC voltage,10 V,1,0" for s in range(4))]
    names = "time [s]," + ",".join(f"{101 + s} <S{s + 1}> (VDC)" for s in range(4))
    assert is_out(read("\n".join([*gains, "", names, *rows()]), SHEET)[0])
    amplified = [line.replace("V,1,0", "V,2,0") for line in gains]
    with pytest.raises(Unanswered, match="multiplied"):
        read("\n".join([*amplified, "", names, *rows()]), SHEET)


@pytest.mark.parametrize(
    "said", ["// wiring: A0 = strip 3 ... A3 = strip 0", "# A0: strip 4\n# A1: strip 3\n# A2: strip 2"]
)
def test_pins_are_of_the_strips_that_a_line_gives_them_in_the_opposite_order_too(said: str) -> None:
    codes = [
        ",".join(
            [f"{100 * n}", *("-" if o else f"{200 * v:.0f}" for v, o in zip(OUT[n], OPEN[n], strict=True))]
        )
        for n in range(N)
    ]
    text = "\n".join([said, "ms,A0,A1,A2,A3", *codes])
    found = propose(of_text(text), SHEET, {"unit": "code"})
    turned = np.stack([s.values for s in found.scans])
    assert any("as of the strips that the log says" in doubt for doubt in found.doubts)
    plain, _ = read(text.replace(said, "# bench"), SHEET, unit="code")
    np.testing.assert_array_equal(turned, plain[:, ::-1])


def test_inputs_are_of_the_strips_that_a_list_gives_them() -> None:
    codes = [
        ",".join(
            [
                f"{100 * n}",
                *(
                    "-,-" if o else f"{200 * v:.0f},{100 * v:.0f}"
                    for v, o in zip(OUT[n], OPEN[n], strict=True)
                ),
            ]
        )
        for n in range(N)
    ]
    names = ",".join(f"C{s}H,C{s}L" for s in range(4))
    log = "\n".join(["# mux channel = strip (1..4): C0=3, C1=1, C2=4, C3=2", f"ms,{names}", *codes])
    pad = replace(PAD, adc_bits=10)
    wired, _ = read(log, pad, unit="code")
    plain, _ = read(log.partition("\n")[2], pad, unit="code")
    np.testing.assert_array_equal(wired[:, [2, 0, 3, 1]], plain)
    with pytest.raises(Unanswered, match="mux order"):
        read(
            log.replace("channel = strip (1..4): C0=3, C1=1, C2=4, C3=2", "order: 3 1 4 2"), pad, unit="code"
        )


def test_two_ends_are_told_apart_where_strips_are_touched() -> None:
    noise = np.random.default_rng(0).uniform(0.001, 0.02, (N, 4, 2))
    cells = np.where(OPEN[..., None], noise, np.stack([HIGH, LOW], axis=2))
    names = ",".join(f"S{s} {end} (V)" for s in range(4) for end in ("upper", "lower"))
    log = [
        f"time (s),{names}",
        *(f"{0.1 * n:.1f}," + ",".join(f"{v:.4f}" for v in cells[n].flat) for n in range(N)),
    ]
    rested = replace(PAD, rest_volt=0.0, touch_volt=0.06)
    values, _ = read("\n".join(log), rested)
    np.testing.assert_allclose(values, cells, atol=1e-4)


def test_a_sheet_of_two_ends_under_headings_in_percent_beside_one_of_notes(tmp_path: Path) -> None:
    """A reading of 75 % was taken for a row of quartiles."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Pad 2, 14 March"])
    sheet = book.create_sheet("run")
    sheet.append([None, "Upper end, % of Vref", *[None] * 4, "Lower end (ground side), %"])
    sheet.append(["t / s", *"ABCD", None, *"ABCD"])
    high, low = (np.where(OPEN, np.nan, np.round(v / 5.0, 3)) for v in (HIGH, LOW))
    high[np.isfinite(high) & (high > 0.7)] = 0.75
    for n in range(N):
        cells = [[None if np.isnan(v) else float(v) for v in end[n]] for end in (high, low)]
        sheet.append([0.1 * n, *cells[0], None, *cells[1]])
        for cell in sheet[sheet.max_row][1:]:
            cell.number_format = "0.0%"
    book.save(tmp_path / "log.xlsx")
    scans = propose(read_table(tmp_path / "log.xlsx"), PAD).scans
    np.testing.assert_allclose([s.values / 100.0 for s in scans], np.stack([high, low], axis=2), atol=1e-9)


def test_points_of_thousands_beside_decimal_commas() -> None:
    lines = [r.replace(".", ",").partition(";")[2] for r in rows(";")]
    times = [f"{120 * n:,}".replace(",", ".") for n in range(N)]
    log = [
        "Zeit [ms];S1 [V];S2 [V];S3 [V];S4 [V]",
        *(f"{t};{r}" for t, r in zip([*times[:-1], "1.080"], lines, strict=True)),
    ]
    values, at = read("\n".join(log), SHEET)
    assert is_out(values)
    np.testing.assert_allclose(at[-1], 1.08)


def test_letters_of_strips_may_leave_out_those_that_look_like_others() -> None:
    names = ",".join(f"{c} [V]" for c in "ABCDEFGHIK")
    lines = [",".join(f"{v:.1f}" for v in (0.1 * n, *(s + 0.1 * n for s in range(10)))) for n in range(N)]
    sensor = replace(SHEET, strips=10, vref_volt=12.0)
    values, _ = read("\n".join([f"t [s],{names}", *lines]), sensor, untouched="none")
    np.testing.assert_allclose(values[1, :, 0], np.arange(10) + 0.1)


def test_sums_of_conversions_are_divided_by_how_many_the_log_says() -> None:
    sums = 8 * np.round(np.stack([200 * HIGH, 100 * LOW], axis=2)).astype(int)
    said = "# each number is the sum of 8 conversions"
    log = [said, "# scan, strip, sum upper end, sum lower end"]
    for n, s in np.ndindex(N, 4):
        log.append(f"{n},{s + 1}," + ("x,x" if OPEN[n, s] else "{},{}".format(*sums[n, s])))
    found = propose(of_text("\n".join(log)), replace(PAD, adc_bits=10), {"rate_hz": "10"})
    assert (found.mapping.unit, found.mapping.scale) == ("code", 0.125)
    with pytest.raises(Unanswered, match="codes reach"):
        read("\n".join(log).replace(said, "# bench"), replace(PAD, adc_bits=10), rate_hz="10")

"""What sessions at a bench leave in a log: words around tables, resets, topics, sheets of notes, other units."""
# ruff: noqa: E501 (a line is a log's)

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.decoding import decoded
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

ONE = ts.Sensor(construction="crs-m", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3)
TWO = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3)
N = range(8)
VOLTS = np.array([[1.2 + 0.07 * i, 2.013 - 0.05 * i, np.nan if i < 3 else 1.5 + 0.01 * i] for i in N])
BOTH = np.stack([VOLTS, VOLTS - 0.6], axis=2)
CSV = [
    "time_s,v0,v1,v2",
    *(f"{i / 50:.2f},{','.join('' if np.isnan(v) else f'{v:.3f}' for v in VOLTS[i])}" for i in N),
]


def sent(form: str) -> list[str]:
    return [
        form.format(i=20 * i, s=s, h=f"{h:.3f}".replace("nan", "null"), l=f"{low:.3f}".replace("nan", "null"))
        for i in N
        for s, (h, low) in enumerate(BOTH[i])
    ]


def check(text: str, sensor: ts.Sensor = ONE, truth: np.ndarray = VOLTS, **answers: str) -> tuple[str, ...]:
    found = propose(of_text(text), sensor, answers)
    read = np.stack([s.values for s in found.scans])
    np.testing.assert_allclose(read.reshape(truth.shape), truth, atol=6e-4)
    np.testing.assert_allclose([s.time_s for s in found.scans], 0.02 * np.arange(len(truth)), atol=1e-6)
    return found.doubts


@pytest.mark.parametrize(
    "lines",
    [
        [*CSV, "min 0.312 V, max 2.950 V over 8 scans", "saved to run_07.csv in 0.3 s"],
        ["x-axis,1,2,3", "second,Volt,Volt,Volt", *CSV[1:]],
        ["Channel\tTime\tA0\tA1\tA2", "Unit\ts\tV\tV\tV", "Samples\t8\t8\t8\t8",
         *(f"{n}\t" + row.replace(",", "\t") for n, row in enumerate(CSV[1:], 1))],
        ['"Zeit [s]","U0","U1","U2"', *(",".join(f'"{c.replace(".", ",")}"' for c in row.split(",")) for row in CSV[1:])],
        ["boot, 3 strips, 12 bit", *CSV[:5], "boot, 3 strips, 12 bit", CSV[0], *CSV[5:]],
        [*(f"2026-03-14T09:26:53.{20 * i:03d}+0100 pad/volts [{', '.join(map(str, row))}]" for i, row in zip(N, VOLTS, strict=True))],
        ["MPY: soft reboot", *(f"{{'t_ms': {20 * i}, 'v': {[None if np.isnan(v) else float(v) for v in row]}}}" for i, row in zip(N, VOLTS, strict=True)),
         "Traceback (most recent call last):", '  File "main.py", line 17, in <module>', "KeyboardInterrupt: "],
    ],
    ids=["footer", "axis", "unit row", "quoted", "boots", "topic", "lists"],
)  # fmt: skip
def test_words_around_a_table_cost_nothing(lines: list[str]) -> None:
    assert not check("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    "form",
    [
        '2026-03-14T09:26:53.{i:03d}Z lab/strip/{s} {{"vh": {h}, "vl": {l}}}',
        "[2026-03-14 09:26:53.{i:03d}] lab/skin/{s}: {h},{l}",
    ],
)
def test_a_topic_behind_a_time_numbers_strips(form: str) -> None:
    check("\n".join(sent(form)).replace(": null,null", ": nan,nan"), TWO, BOTH)


def test_rows_of_numbers_above_are_never_set_aside_unsaid() -> None:
    log = "\n".join(
        ["time_ms,thumb,index,palm", *CSV[1:]]
    )  # the first have fewer fields filled than the others
    with pytest.raises(Unanswered, match=r"thumb\.\.palm"):
        propose(of_text(log), ONE)
    check(log.replace("time_ms", "time_s"), ONE, readings="thumb..palm")


def test_a_last_line_without_an_end_may_be_cut() -> None:
    assert any("left out: line 9" in d for d in propose(of_text("\n".join(CSV)[:-5]), ONE).doubts)
    check("\n".join(CSV)[:-5], ONE, VOLTS[:-1], broken_lines="skip")


def test_zeros_of_a_reset_board_are_said(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("\n".join([*CSV[:4], "\0" * 30, *CSV[4:]]) + "\n\0\0\0")
    assert "line 5 holds bytes of 0" in check(decoded(file))[0]
    file.write_text("\n".join([*CSV[:-1], CSV[-1].replace("1.", "1\0\0", 1)]))
    with pytest.raises(Unanswered, match=r"line\(s\) 9 .* leave them out"):
        propose(of_text(decoded(file)), ONE)
    file.write_bytes(bytes(range(256)).replace(b"\r", b"\0") * 9)
    with pytest.raises(ts.ReadingError, match="not a text file"):
        decoded(file)


@pytest.mark.parametrize("form", ["v={h}kPa", "v={h} kPa", "p={h} kPa"])
def test_units_of_other_quantities_are_named(form: str) -> None:
    lines = [f"t={20 * i} strip={s} " + form.format(h=VOLTS[i, s]) for i in range(3, 8) for s in range(3)]
    with pytest.raises(ts.ReadingError, match="'kPa' is no unit of readings"):
        propose(of_text("\n".join(lines)), ONE)
    with pytest.raises(ts.ReadingError, match=r"'kPa', as in '1\.1kPa', is no unit"):
        of_text("t,v\n" + "".join(f"x,1.{n}kPa\n" for n in range(1, 6)))


def test_a_value_without_a_number_beside_as_many_as_strips_is_another() -> None:
    rows = [f"{i / 50:.2f},3.301,{','.join(f'{v:.3f}' for v in VOLTS[i])}" for i in N]
    check("\n".join(["time_s,voltage,voltage1,voltage2,voltage3", *rows]), replace(ONE, strip_base=1))


def test_series_after_series_of_touched_strips_are_scans() -> None:
    rows = [f"{20 * i},{s},{VOLTS[i, s]:.3f}" for s in range(3) for i in N if not np.isnan(VOLTS[i, s])]
    check("\n".join(["t_ms,strip,volts", *rows]), missing="untouched")


def test_a_sheet_of_notes_and_words_below_a_table_are_passed_over(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Notes"])
    book.active.append(["Pressed by hand, 2 people"])
    sheet = book.create_sheet("Data")
    for row in [
        ["t [s]", "v0", "v1", "v2"],
        *([i / 50, *(None if np.isnan(v) else v for v in VOLTS[i])] for i in N),
    ]:
        sheet.append(row)
    sheet.append(["checked: JK"])
    other = book.create_sheet("Chart")
    other.append(["x", "y"])
    other.append([1, 2])
    book.save(tmp_path / "a.xlsx")
    found = propose(read_table(tmp_path / "a.xlsx"), ONE, {})
    np.testing.assert_allclose(np.stack([s.values[:, 0] for s in found.scans]), VOLTS, atol=1e-9)

"""What instruments, loggers and archives put around readings: uncertainties, prefixes, flags, zones, damage."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import import containers
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.delimiters import without_prefix
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

ONE = ts.Sensor(construction="crs-m", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
TWO = replace(ONE, construction="crs-crs")
V = np.array([[1.5 + 0.11 * i + 0.2 * s for s in range(3)] for i in range(8)])  # (scans, strips) [V]
N = range(8)


def read(lines: list[str] | str, sensor: ts.Sensor = ONE, **answers: str) -> Proposal:
    text = lines if isinstance(lines, str) else "\n".join(lines) + "\n"
    return propose(of_text(text), sensor, answers)


def check(found: Proposal, step_s: float = 0.5, atol: float = 1e-6, scale: float = 1.0) -> None:
    values = np.stack([scan.values for scan in found.scans])
    np.testing.assert_allclose(values[:, :, 0] * scale, V, atol=atol)
    if values.shape[2] == 2:
        np.testing.assert_allclose(values[:, :, 1] * scale, V - 0.5, atol=atol)
    np.testing.assert_allclose([scan.time_s for scan in found.scans], step_s * np.arange(8), atol=1e-6)


def wide(head: str, form: str = "{:.3f}", mark: str = ",") -> list[str]:
    return [head, *(mark.join([f"{0.5 * i:.1f}", *map(form.format, V[i])]) for i in N)]


@pytest.mark.parametrize("form", ["{:.3f} \u00b1 0.004", "{:.3f}\u00b10.004", "{:.3f} +/- 0.004 V"])
def test_what_stands_behind_a_number_as_its_uncertainty_is_no_reading(form: str) -> None:
    check(read(wide("t (s)\tS0\tS1\tS2", form, "\t")))


def test_whole_numbers_with_uncertainties_between_commas() -> None:
    rows = [f"{500 * i}," + ",".join(f"{1000 * v:.0f}\u00b13" for v in V[i]) for i in N]
    check(read(["t_ms,S0 (mV),S1 (mV),S2 (mV)", *rows]), scale=1e-3)


@pytest.mark.parametrize(
    ("own", "beside"), [("U{}/V", "\u00b1U{}/V"), ("S{}_mean", "S{}_std"), ("S{} (V)", "+/- S{} (V)")]
)
def test_columns_of_uncertainties_are_passed_over(own: str, beside: str) -> None:
    head = "t/s;" + ";".join(f"{own.format(s)};{beside.format(s)}" for s in range(3))
    check(read([head, *(f"{0.5 * i};" + ";".join(f"{v:.3f};0.004" for v in V[i]) for i in N)]))


def test_thousands_by_narrow_no_break_spaces_are_within_a_number() -> None:
    head = "Temps (s)\tVoie 1 (mV)\tVoie 2 (mV)\tVoie 3 (mV)"
    french = str.maketrans(",.", "\u202f,")
    rows = ["\t".join([f"{0.5 * i:.1f}", *(f"{1000 * v:,.1f}" for v in V[i])]).translate(french) for i in N]
    check(read([head, *rows]), scale=1e-3)


@pytest.mark.parametrize(
    ("before", "step_s"),
    [
        ("2026-03-09 14:05:{:06.3f} - pad.reader - INFO - ", 0.5),
        ("I ({:.0f}) pad: ", 0.5e-3),
        ("[17730651{:06.3f}] rx ", 0.5),
    ],
)
def test_records_behind_a_loggers_prefix(before: str, step_s: float) -> None:
    times = [10 + 0.5 * i if step_s == 0.5 else 100 + i for i in N]
    rows = [f'{before.format(times[i])}{{"h": {V[i].tolist()}, "l": {(V[i] - 0.5).tolist()}}}' for i in N]
    check(read(rows, TWO), step_s if step_s == 0.5 else 1e-3)


def test_a_record_that_is_given_to_a_name_has_no_prefix() -> None:
    text = "row 1 = {1: 2}\nrow 2 = {1: 3}"
    assert without_prefix(text) == text


def test_clocks_follow_their_zone_into_summer_time() -> None:
    winter = [f"2026-03-29T01:59:{58 + 0.5 * i:04.1f}+01:00" for i in range(4)]
    times = [*winter, *(f"2026-03-29T03:00:{0.5 * i:04.1f}+02:00" for i in range(4))]
    rows = [f"{times[i]}," + ",".join(f"{v:.3f}" for v in V[i]) for i in N]
    check(read(["time,S0,S1,S2", *rows]))


def test_the_step_of_a_header_of_national_instruments_is_in_seconds() -> None:
    head = [
        "X_Dimension\tTime\tTime\tTime",
        "X0\t0,0\t0,0\t0,0",
        "Delta_X\t0,5\t0,5\t0,5",
        "***End_of_Header***",
        "ai0\tai1\tai2",
    ]
    check(read([*head, *("\t".join(f"{v:.3f}".replace(".", ",") for v in row) for row in V)]))


def test_every_segment_of_a_file_of_labview_is_read() -> None:
    rows = ["\t".join([f"{0.5 * i:.6f}", *(f"{v:.3f}" for v in V[i])]) for i in N]
    head = ["", "Channels\t3", "Samples" + "\t4" * 3, "***End_of_Header***", "X_Value\tS0\tS1\tS2"]
    check(read(["LabVIEW Measurement", "***End_of_Header***", *head, *rows[:4], *head, *rows[4:]]))


def test_names_above_columns_without_a_name_are_not_set_aside() -> None:
    head = [",high,high,high,low,low,low", "finger,index,middle,ring,index,middle,ring", "t_s,,,,,,"]
    rows = [f"{0.5 * i:.1f}," + ",".join(f"{v - d:.3f}" for d in (0.0, 0.5) for v in V[i]) for i in N]
    with pytest.raises((ts.ReadingError, Unanswered)):  # in which order the fingers lie nothing tells
        read([*head, *rows], TWO)


def test_a_column_of_a_multiplexer_tells_the_channels() -> None:
    rows = [f"{500 * i},{c},{s},{V[i, s] - 0.5 * (c == 0):.3f}" for i in N for c in (0, 1) for s in range(3)]
    found = read(["ms,mux,strip,volt", *rows], TWO)
    check(found)
    assert found.mapping.which_h == "1"


def test_a_flag_of_touch_tells_that_missing_values_are_no_contact() -> None:
    rows = [
        f"pad,strip={s} " + (f"v={V[i, s]:.3f},touched=t" if s != 1 else "touched=f") + f" {1773065133 + i}000000000"
        for i in N for s in range(3)
    ]  # fmt: skip
    values = np.stack([scan.values[:, 0] for scan in read(rows).scans])
    assert np.isnan(values[:, 1]).all()
    np.testing.assert_allclose(values[:, 2], V[:, 2])


def test_dates_named_start_are_no_readings() -> None:
    rows = [
        f"2026-03-09T14:00:00Z,2026-03-09T14:05:{0.5 * i:04.1f}Z,{V[i, s]:.3f},{s}"
        for i in N
        for s in range(3)
    ]
    check(read(["_start,_time,_value,strip", *rows]))


def test_a_ratio_above_1_is_in_percent() -> None:
    found = read(
        ["t_s,ratio 0,ratio 1,ratio 2", *(f"{0.5 * i}," + ",".join(f"{20 * v:.2f}" for v in V[i]) for i in N)]
    )
    assert found.mapping.unit == "percent"


def test_a_record_of_yaml_that_ends_within_its_last_number_is_broken() -> None:
    docs = [f"t_s: {0.5 * i}\nv:\n" + "".join(f"- {v:.3f}\n" for v in V[i]) for i in N]
    text = "---\n".join(docs)
    check(read(text))
    found = read(text[:-4])
    assert len(found.scans) == len(N) - 1
    assert any("the last record" in doubt for doubt in found.doubts)


def damaged(kind: str) -> bytes:
    """Return a file of a form that is read here, damaged: cut, or another kind of file."""
    out = io.BytesIO()
    if kind == "xlsx":
        book = openpyxl.Workbook()
        book.active.append(["t (s)", "S0", "S1"])
        book.save(out)
    elif kind == "npz":
        np.savez(out, t=np.arange(8.0), v=V)
    else:
        pq.write_table(pa.table({"t": np.arange(8.0), "v": V[:, 0]}), out)
    return out.getvalue()


@pytest.mark.parametrize("kind", ["xlsx", "npz", "parquet"])
@pytest.mark.parametrize("damage", ["cut", "empty", "text", "zip", "flipped"])
def test_a_damaged_file_is_refused_in_one_line(kind: str, damage: str, tmp_path: Path) -> None:
    whole = damaged(kind)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as packed:
        packed.writestr("word/document.xml", "<x/>")
    head = len(whole) // 5
    flipped = whole[:head] + bytes(255 - b for b in whole[head : 4 * head]) + whole[4 * head :]
    data = {
        "cut": whole[: len(whole) // 2],
        "empty": b"",
        "text": b"t,v\n1,2\n",
        "zip": out.getvalue(),
        "flipped": flipped,
    }
    file = tmp_path / f"log.{kind}"
    file.write_bytes(data[damage])
    with pytest.raises(ts.ReadingError, match=f"no .{kind} file, or a damaged one|is empty") as refused:
        read_table(file)
    assert "\n" not in str(refused.value)


def test_what_would_unpack_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(containers, "_MOST_UNPACKED", 2**10)
    monkeypatch.setattr(containers, "_MOST_NUMBERS", 10)
    for kind in ("xlsx", "npz"):
        (tmp_path / f"a.{kind}").write_bytes(damaged(kind) if kind == "xlsx" else zipped(bytes(2000)))
        with pytest.raises(ts.ReadingError, match="unpacked; cut it into pieces"):
            read_table(tmp_path / f"a.{kind}")
    (tmp_path / "a.parquet").write_bytes(damaged("parquet"))
    with pytest.raises(ts.ReadingError, match="more than 10 numbers"):
        read_table(tmp_path / "a.parquet")


@pytest.mark.parametrize("run", ["1", "x", "\u0663", "F0", "(", "["])
def test_a_line_without_an_end_is_refused_and_takes_no_time(run: str) -> None:
    """The time of several patterns grows with its square: 200,000 digits took minutes."""
    rows = "".join(f"{i}, 0.{i}, 0.{i + 1}\n" for i in range(1, 9))
    with pytest.raises(ReadingError, match=r"line 9: 10+ characters and more without"):
        of_text(rows + 200_000 * run)


def zipped(data: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("v.npy", data)
    return out.getvalue()


def test_a_sheet_that_states_a_larger_size_than_it_has(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in [["t (s)", "S0", "S1", "S2"], *([0.5 * i, *V[i].tolist()] for i in N)]:
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    with zipfile.ZipFile(tmp_path / "a.xlsx") as packed:
        parts = {name: packed.read(name) for name in packed.namelist()}
    with zipfile.ZipFile(tmp_path / "b.xlsx", "w") as packed:
        for name, part in parts.items():
            packed.writestr(name, part.replace(b'ref="A1:D9"', b'ref="A1:XFD1048576"'))
    check(propose(read_table(tmp_path / "b.xlsx"), ONE))

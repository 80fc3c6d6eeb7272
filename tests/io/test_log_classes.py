"""Logs of the classes that fresh sets failed on: named arrays, torn beginnings, nulls in lists, remarks in tables."""
# ruff: noqa: E501 (a line is a log's)

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.decoding import decoded
from tacstrip.io.log_import.fields import clock_seconds
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

TWO = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3)
N = range(24)


def _scan(i: int) -> list[tuple[float, float] | None]:
    """Return the readings of a contact that moves over the strips and is gone in some scans; None: untouched."""
    at = i / 5.0 - 0.5
    return [
        (2.0 + 0.02 * i - 0.2 * abs(s - at), 1.2 + 0.03 * i + 0.1 * abs(s - at))
        if abs(s - at) < 1.2 and i % 11
        else None
        for s in range(4)
    ]


SCANS = [_scan(i) for i in N]
TRUTH = np.array([[pair or (np.nan, np.nan) for pair in scan] for scan in SCANS])


def _read(
    text: str, kept: list[int] | None = None, *, timed: bool = True, sensor: ts.Sensor = TWO
) -> tuple[str, ...]:
    """Check that a text is read right without an answer; return what is said of it."""
    return _right(
        propose(of_text(text), sensor, {}, frozenset({"vref_volt", "strip_base"})), kept, timed=timed
    )


def _right(found: Proposal, kept: list[int] | None = None, *, timed: bool = True) -> tuple[str, ...]:
    rows = [*N] if kept is None else kept
    scale = {"mV": 1e-3}.get(found.mapping.unit, 1.0)
    np.testing.assert_allclose(scale * np.stack([s.values for s in found.scans]), TRUTH[rows], atol=6e-4)
    if timed:
        times = np.array([s.time_s for s in found.scans])
        np.testing.assert_allclose(times - times[0], 0.05 * (np.array(rows) - rows[0]), atol=1e-3)
    return (*found.reasons, *found.doubts)


def _cells(scan: list[tuple[float, float] | None], nothing: str, form: str = ".3f") -> list[str]:
    return [nothing if pair is None else format(value, form) for pair in scan for value in pair or (0.0, 0.0)]


def _h5dump(name: str, values: np.ndarray) -> str:
    shape = ", ".join(map(str, values.shape))
    flat = values.reshape(len(values), -1)
    rows = ",\n".join(
        f"   ({n}{',0' * (values.ndim - 1)}): " + ", ".join(f"{v:.6g}" for v in row)
        for n, row in enumerate(flat)
    )
    return f'DATASET "{name}" {{\n DATATYPE  H5T_IEEE_F64LE\n DATASPACE  SIMPLE {{ ( {shape} ) / ( {shape} ) }}\n DATA {{\n{rows}\n }}\n}}\n'


def _waves(name: str, values: np.ndarray) -> str:
    size = ",".join(map(str, values.shape))
    rows = "\r".join("\t" + "\t".join("NaN" if np.isnan(v) else f"{v:.6g}" for v in row) for row in values)
    return f'WAVES/D/N=({size})\t{name}\rBEGIN\r{rows}\rEND\rX SetScale/P x 0,0.05,"s", {name}; SetScale d 0,0,"V", {name}\r'


TIMES = 0.05 * np.arange(len(N))


@pytest.mark.parametrize(
    "text",
    [
        'HDF5 "run.h5" {\nGROUP "/" {\n' + _h5dump("time_s", TIMES) + _h5dump("v_high", TRUTH[..., 0]) + _h5dump("v_low", TRUTH[..., 1]) + "}\n}\n",
        'HDF5 "run.h5" {\nGROUP "/" {\n' + _h5dump("t", TIMES) + _h5dump("volts", TRUTH) + "}\n}\n",
        "IGOR\r" + _waves("v_high", TRUTH[..., 0]) + _waves("v_low", TRUTH[..., 1]),
    ],
)  # fmt: skip
def test_named_arrays_with_their_sizes(text: str) -> None:
    _read(text)


def test_a_named_array_that_is_cut_is_refused() -> None:
    text = _waves("v_high", TRUTH[..., 0]) + _waves("v_low", TRUTH[..., 1]).replace("\tNaN", "", 1)
    with pytest.raises(ts.ReadingError, match="v_low is said to be of"):
        _read("IGOR\r" + text)


@pytest.mark.parametrize("banner", ["", "# boot 3 of the rig\n", "=~=~= PuTTY log 2025.02.18 =~=~=\n"])
def test_a_log_that_begins_within_a_line(banner: str) -> None:
    names = [f"{end}{s}" for s in range(4) for end in ("hi", "lo")]
    lines = [
        "\t".join(f"{n}:{v}" for n, v in zip(names, _cells(scan, "0.00"), strict=True)) for scan in SCANS
    ]
    text = banner + "\n".join([lines[0][lines[0].index("lo1") + 1 :], *lines[1:]]) + "\n"
    assert any("left out: line" in said for said in _read(text, [*N][1:], timed=False))


def test_a_first_row_of_fewer_fields_is_no_torn_beginning() -> None:
    rows = [",".join([f"{0.05 * i:.2f}", *_cells(scan, "")]) for i, scan in enumerate(SCANS)]
    head = "t_s," + ",".join(f"v{end}{s}" for s in range(4) for end in "hl")
    with pytest.raises(Unanswered, match="are not like the others"):
        _read("\n".join([head, "0.00,2.111,1.222", *rows[1:]]) + "\n")


@pytest.mark.parametrize("named", ["id", ""])
def test_nulls_in_a_list_of_records_stand_for_untouched_strips(named: str) -> None:
    rows = []
    for i, scan in enumerate(SCANS):
        strips = [
            pair
            and ({named: s + 1} if named else {})
            | {"hi_mV": round(1e3 * pair[0], 1), "lo_mV": round(1e3 * pair[1], 1)}
            for s, pair in enumerate(scan)
        ]
        rows.append(json.dumps({"t_ms": 50 * i, "strips": strips}))
    _read("\n".join(rows) + "\n")
    said = _read(
        "\n".join(
            [*rows[:5], "curl: (28) Operation timed out after 2001 milliseconds with 0 bytes", *rows[5:]]
        )
        + "\n"
    )
    assert not any("left out" in one for one in said)


def test_strips_named_in_lists_some_of_which_are_empty() -> None:
    frames = [
        {"ts": 1706612345000 + 50 * i, "strips": [{"name": f"S{s:02}", "upper_mV": round(1e3 * pair[0], 1), "lower_mV": round(1e3 * pair[1], 1)} for s, pair in enumerate(scan) if pair]}
        for i, scan in enumerate(SCANS)
    ]  # fmt: skip
    found = propose(of_text(json.dumps({"data": frames}, indent=1)), TWO, {}, frozenset({"vref_volt"}))
    _right(found)


def test_a_column_that_says_the_same_as_the_key_is_no_other_strip() -> None:
    rows = [
        f"{1 + 8 * i + k},{101 + k},S{1 + k // 2}_{'HL'[k % 2]},{cell},V,{0.05 * i:.2f}"
        for i, scan in enumerate(SCANS)
        for k, cell in enumerate(_cells(scan, "9.9E+37"))
    ]
    _read("\n".join(["Index,Channel,Label,Reading,Unit,Time [s]", *rows]) + "\n")


def _with(head: list[str], foot: list[str], nothing: str = "--") -> str:
    names = "\t".join(["t", *(f"Strip {s} {end}" for end in ("upper", "lower") for s in range(1, 5))])
    units = "\t".join(["s", *["V"] * 8])
    rows = [
        "\t".join([f"{0.05 * i:.2f}", *(cells := _cells(scan, nothing))[::2], *cells[1::2]])
        for i, scan in enumerate(SCANS)
    ]
    return "\n".join([names, units, *head, *rows, *foot]) + "\n"


def test_a_remark_that_stands_below_each_name_hides_none() -> None:
    _read(_with(["\t".join(["Comments", *["test 21, pen"] * 8])], []))


def test_a_sheet_of_notes_and_a_signature_below_the_table_are_no_readings(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.title = "Info"
    for row in (["Group", "B4 (Ann, Bob)"], ["Date", "3 May"], ["Supply", 5.02], ["Room", 22.5]):
        book.active.append(row)
    sheet = book.create_sheet("Run 1")
    sheet.append(["Time", *(f"Strip {s} {end} (V)" for s in range(1, 5) for end in ("high", "low"))])
    for i, scan in enumerate(SCANS):
        sheet.append(
            [f"14:05:{10 + 0.05 * i:05.2f}", *(c if c == "-" else float(c) for c in _cells(scan, "-"))]
        )
    sheet.append([])
    sheet.append(["Signed:", None, "AB"])
    book.save(tmp_path / "log.xlsx")
    _right(propose(read_table(tmp_path / "log.xlsx"), TWO))


def _pairs(scan: list[tuple[float, float] | None], *, every: bool) -> list[str]:
    both = ["---/---" if pair is None else f"{pair[0]:.3f}/{pair[1]:.3f}" for pair in scan]
    return [f"S{s}: {pair}" for s, pair in enumerate(both) if every or "-" not in pair]


def test_blank_lines_and_remarks_behind_a_time_are_no_scans() -> None:
    lines = [
        f"12:00:{10 + 0.05 * i:06.3f} -> {'  '.join(_pairs(scan, every=True))}"
        for i, scan in enumerate(SCANS)
    ]
    lines[7] = lines[7][:50]
    text = "\n".join(["12:00:09.500 -> ", *lines[:12], "12:00:10.580 -> [hand lifted]", *lines[12:]])
    assert any("left out: line 9 " in said for said in _read(text + "\n", [i for i in N if i != 7]))


def test_a_scan_said_to_be_without_contact_among_pairs_of_touched_strips() -> None:
    lines = [
        f"12:00:{10 + 0.05 * i:06.3f} pad[81]: frame {i} " + (" | ".join(["|", *of])[2:] if (of := _pairs(scan, every=False)) else "(no touch)")
        for i, scan in enumerate(SCANS)
    ]  # fmt: skip
    _read("\n".join(lines) + "\n")


@pytest.mark.parametrize("clock", ["2025/6/3 9:0:{}", "'25-06-03 09:00:{:02}"])
def test_times_of_day_without_leading_zeros_or_behind_an_apostrophe(clock: str) -> None:
    assert clock_seconds(clock.format(7)) == clock_seconds("2025-06-03 09:00:07")
    assert clock_seconds(clock.format(75)) is None


def test_letters_of_central_europe_are_told_by_marks_within_words(tmp_path: Path) -> None:
    row = ";".join
    text = (
        row(["Czas [s]", *(f"Pasek {s} {end} [V]" for s in range(1, 5) for end in ("górne", "dolne"))]) + "\n"
    )
    text += "".join(row([f"{0.05 * i:.2f}", *_cells(scan, "brak")]) + "\n" for i, scan in enumerate(SCANS))
    text = "Prowadzący: dr inż. Żak;;;;;;;;\n" + (text + row(["Średnia", *["2.11"] * 8])).replace(".", ",")
    (tmp_path / "log.csv").write_bytes(text.encode("cp1250"))
    _right(propose(read_table(tmp_path / "log.csv"), TWO))
    (tmp_path / "log.csv").write_bytes("Größe cm³ L’été".encode("cp1252"))
    assert decoded(tmp_path / "log.csv") == "Größe cm³ L’été"


def test_rows_of_all_strips_are_not_taken_for_strips_in_turn() -> None:
    names = ",".join(
        f"{100 + n} <Zone {s} {end}>,Alarm {100 + n}"
        for n, (s, end) in enumerate((s, e) for s in "ABCD" for e in ("p", "q"))
    )
    rows = [",".join([str(i), *(f"{c},0" for c in _cells(scan, "0.0001"))]) for i, scan in enumerate(SCANS)]
    assert of_text(f"n,{names}\n" + "\n".join(rows) + "\n").of_content(4, 2) is None


def test_a_series_of_each_strip_and_end_within_one_record() -> None:
    series = [
        {"metric": {"channel": end, "job": "skin", "strip": str(s)}, "values": values}
        for k, end in enumerate(("high", "low"))
        for s in range(4)
        if (
            values := [
                [1706000000 + i, f"{pair[k]:.3f}"] for i, scan in enumerate(SCANS) if (pair := scan[s])
            ]
        )
    ]
    text = json.dumps({"status": "success", "data": {"resultType": "matrix", "result": series}})
    found = propose(of_text(text), TWO, {"strip_base": "0"}, frozenset({"vref_volt"}))
    touched = [i for i, scan in enumerate(SCANS) if any(scan)]
    _right(found, touched, timed=False)


def test_numbers_apart_below_the_rows_cost_no_scan() -> None:
    rows = [
        f"{0.05 * i:.2f},{s},{p[0]:.3f},{p[1]:.3f}"
        for i, scan in enumerate(SCANS)
        for s, p in enumerate(scan)
        if p
    ]
    found = propose(
        of_text("\n".join(["t_s,strip,v_h,v_l", *rows, "", "ans =", "", "   1.2360", ""])),
        TWO,
        {"strip_base": "0"},
    )
    _right(found, [i for i, scan in enumerate(SCANS) if any(scan)])


@pytest.mark.parametrize("word", ["sensor", "channel", "taxel", "electrode", "probe"])
def test_a_logger_that_numbers_its_own_part_hides_no_strip(word: str) -> None:
    """Which of two numbers says how many there are hung on the order of a set, another in each run."""
    text = "".join(
        f"[12:{i:02}:10][D][{word}:094]: 'Skin strip {s}': Sending state {1.0 + 0.1 * s + 0.01 * i:.3f} V, 3 decimals\n"
        for i in N for s in (1, 2, 3)
    )  # fmt: skip
    assert {word, "strip"} <= {*of_text(text, "log.txt").names}

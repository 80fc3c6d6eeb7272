"""Logs within what other programs put around them, and readings that words, registers or sheets stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.containers import SeveralSheets, read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_STRIPS, _SCANS = 4, 6
_SENSOR = ts.Sensor(construction="crs-crs", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
_VALUES = np.array(
    [
        [
            [2.6 + 0.031 * n + 0.12 * s, 1.6 + 0.023 * n - 0.07 * s] if s not in (0, n % 5) else [np.nan] * 2
            for s in range(_STRIPS)
        ]
        for n in range(_SCANS)
    ]
).round(3)


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_read(found: Proposal, step: float = 0.5, scale: float = 1.0) -> None:
    assert not found.doubts
    assert np.stack([scan.values for scan in found.scans]) * scale == pytest.approx(_VALUES, nan_ok=True)
    times = np.array([scan.time_s for scan in found.scans])
    assert times - times[0] == pytest.approx(step * np.arange(_SCANS), abs=1e-3)


def _lines(touched: str, untouched: str, head: str = "") -> str:
    """Return a line per strip; in `head` and both others `{n}` is the scan, `{s}` the strip, `{t}` the time."""
    made = []
    for n, scan in enumerate(_VALUES):
        for s, (h, low) in enumerate(scan):
            form = head + (untouched if np.isnan(h) else touched)
            made.append(form.format(n=n, s=s, t=0.5 * n, h=h, l=low))
    return "\n".join(made) + "\n"


@pytest.mark.parametrize(
    ("touched", "untouched"),
    [
        ("t={t} [S{s}] hi:{h} lo:{l}", "t={t} [S{s}] not pressed"),
        ("t={t} strip={s} high={h}V low={l}V", "t={t} strip={s} idle"),
        ("time {t} s, strip {s}: high {h}, low {l}", "time {t} s, strip {s}: kein Kontakt"),
        ("t={t} S{s} H={h} L={l}", "t={t} S{s} sin contacto"),
        ("t={t} strip {s} -> top {h}, bottom {l} (volts)", "t={t} strip {s} -> top nil, bottom nil (volts)"),
        ("t={t} strip {s} h={h} l={l}", "t={t} strip {s} no finger there"),
        ("{t} {s} {h} {l}", "{t} {s} nicht gedr\u00fcckt"),
    ],
)
def test_untouched_said_in_words_in_place_of_readings(touched: str, untouched: str) -> None:
    _assert_read(_read(_lines(touched, untouched), time_unit="s"))


@pytest.mark.parametrize(
    "words",
    [
        "sensor fault",
        "disconnected",
        "overload",
        "not connected",
        "sat",
        "err",
        "Fehler",
        "satur\u00e9",
        "timeout",
    ],
)
@pytest.mark.parametrize(
    "untouched", ["t={t} strip={s} WORDS", "[{t}] S{s} WORDS", "t={t} strip={s} high=WORDS low=WORDS"]
)
def test_words_of_a_fault_in_place_of_readings_are_asked(words: str, untouched: str) -> None:
    if " " in words and "high" in untouched:
        words = words.replace(" ", "_")
    touched = "[{t}] S{s} h={h} l={l}" if "[" in untouched else "t={t} strip={s} high={h} low={l}"
    with pytest.raises(Unanswered) as asked:
        _read(_lines(touched, untouched.replace("WORDS", words)), time_unit="s")
    said = next(q.text for q in asked.value.questions if q.key == "untouched")
    assert words.replace(" ", "_") in said


def test_an_unknown_word_in_place_of_readings_is_a_doubt() -> None:
    text = _lines("t={t} strip={s} high={h} low={l}", "t={t} strip={s} quiet")
    assert any("'quiet'" in doubt for doubt in _read(text, time_unit="s").doubts)


def test_a_cut_row_is_not_taken_for_words() -> None:
    text = _lines("{t};{s};{h};{l}", "{t};{s};-;-").replace("0.5;2;", "0.5;2;x", 1)
    with pytest.raises((Unanswered, ReadingError)):
        _read(text)


@pytest.mark.parametrize("letter", ["D", "d", "Q"])
def test_fortrans_exponents(letter: str) -> None:
    def fortran(x: float) -> str:
        return "NaN" if np.isnan(x) else f"{x / 10:.5f}{letter}+01"

    rows = [
        f"{fortran(0.5 * n):>14} {s} {fortran(h):>14} {fortran(low):>14}"
        for n, scan in enumerate(_VALUES) for s, (h, low) in enumerate(scan)
    ]  # fmt: skip
    _assert_read(_read("\n".join(["TIME(S) ISTRIP VHI(V) VLO(V)", *rows]) + "\n"))


def test_readings_below_two_dashes_are_no_signature() -> None:
    rows = [f"> {line}" for line in _lines("{t};{s};{h};{l}", "{t};{s};;").splitlines()]
    text = "\n".join(["From: a@b.example", "Subject: x", "> t_s;strip;v_h;v_l", *rows[:20], "--", *rows[20:]])
    _assert_read(_read(text))


def _system_log(kind: str) -> str:
    made = []
    for k, line in enumerate(_lines("strip={s} high={h} low={l}", "strip={s} high=- low=-").splitlines()):
        second = f"{3 + k // 8:02}.{500 * (k // 4 % 2) + k % 4:03}"
        if kind == "logcat":
            made.append(f"11-20 10:15:{second}  4821  4850 D Skin: {line}")
        else:
            made.append(f"2026-11-20 10:15:{second}+0100 SkinApp[1234:{5678 + k % 4}] [ble] {line}")
    between = {
        "logcat": "11-20 10:15:04.900  4821  4821 I Choreographer: Skipped 31 frames!",
        "console": "2026-11-20 10:15:04.900112+0100 SkinApp[1234:5671] [ui] Unable to satisfy 3 constraints.",
    }
    return "\n".join([*made[:16], between[kind], *made[16:]]) + "\n"


@pytest.mark.parametrize("kind", ["logcat", "console"])
def test_lines_of_a_systems_log(kind: str) -> None:
    found = _read(_system_log(kind))
    assert np.stack([s.values for s in found.scans]) == pytest.approx(_VALUES, nan_ok=True)
    assert np.diff([s.time_s for s in found.scans]) == pytest.approx(0.5, abs=1e-3)


def test_julias_frame() -> None:
    rows = [
        f"  {k + 1:2} \u2502 {0.5 * (k // 4):7.2f}  {k % 4:5}  "
        + "  ".join(f"{v if v == v else 'missing':>8}" for v in pair)
        for k, pair in enumerate(_VALUES.reshape(-1, 2))
    ]
    head = [
        "24\u00d74 DataFrame",
        " Row \u2502   t_s    strip       v_h       v_l", "     \u2502 Float64  Int64  Float64?  Float64?",
        "\u2500\u2500\u2500\u2500\u2500\u253c\u2500\u2500\u2500\u2500",
    ]  # fmt: skip
    _assert_read(_read("\n".join(["julia> df", *head, *rows]) + "\n", untouched="missing"))


def test_a_line_cut_within_its_last_number_is_doubted() -> None:
    rows = [
        f"{0.5 * n:.3f},{s},{2.601 + 0.03 * n + 0.12 * s:.3f},{1.604 + 0.023 * n - 0.07 * s:.3f}"
        for n in range(_SCANS) for s in range(_STRIPS)
    ]  # fmt: skip
    assert not _read("\n".join(["t_s,strip,v_h,v_l", *rows]) + "\n").doubts
    rows[9] = rows[9][:-2]
    found = _read("\n".join(["t_s,strip,v_h,v_l", *rows]) + "\n")
    assert any("line 11 ('" in d and "cut there" in d for d in found.doubts)
    # Of a logger that leaves zeros out, as many numbers of other columns are shorter, too.
    plain = [",".join(f"{float(f):g}" for f in row.split(",")) for row in rows]
    assert not any("cut there" in d for d in _read("\n".join(["t_s,strip,v_h,v_l", *plain]) + "\n").doubts)


def _workbook(path: Path, titles: list[str], timed: bool = False) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for n, title in enumerate(titles):
        sheet = book.create_sheet(title)
        sheet.append([*(["t (s)"] if timed else []), "strip", "Vh (V)", "Vl (V)"])
        for s, (h, low) in enumerate(_VALUES[n]):
            pair = ["none", "none"] if np.isnan(h) else [float(h), float(low)]
            sheet.append([*([0.0] if timed else []), s, *pair])
    book.save(path)
    return path


def test_sheets_that_are_scans_in_turn(tmp_path: Path) -> None:
    path = _workbook(tmp_path / "a.xlsx", [f"Press {n + 1}" for n in range(_SCANS)])
    _assert_read(propose(read_table(path), _SENSOR, {"rate_hz": "2"}))


@pytest.mark.parametrize(
    "titles", [["Pad 1", "Pad 2"], ["east", "west"], ["Anna", "Ben"], ["press 1", "press 3"]]
)
def test_sheets_of_one_form_that_may_be_anything_are_asked(tmp_path: Path, titles: list[str]) -> None:
    path = _workbook(tmp_path / "a.xlsx", titles)
    with pytest.raises(SeveralSheets, match="all"):
        read_table(path)
    found = propose(read_table(path, "all"), _SENSOR, {"rate_hz": "2"})
    assert np.stack([s.values for s in found.scans]) == pytest.approx(_VALUES[: len(titles)], nan_ok=True)
    one = propose(read_table(path, titles[1]), _SENSOR, {"rate_hz": "2"})
    assert one.scans[0].values == pytest.approx(_VALUES[1], nan_ok=True)


def test_sheets_whose_times_begin_anew_are_not_joined(tmp_path: Path) -> None:
    path = _workbook(tmp_path / "a.xlsx", ["Press 1", "Press 2"], timed=True)
    with pytest.raises(SeveralSheets) as asked:
        read_table(path)
    assert "all" not in str(asked.value)
    with pytest.raises(ReadingError, match="do not follow"):
        read_table(path, "all")


def test_sheets_that_are_runs_follow_each_other_with_a_warning(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for run in range(2):
        sheet = book.create_sheet(f"Run {run + 1}")
        sheet.append(["t (s)", *(f"S{s} {end} (V)" for s in range(_STRIPS) for end in ("high", "low"))])
        for n, scan in enumerate(_VALUES[3 * run : 3 * run + 3]):
            sheet.append([0.5 * n, *(None if np.isnan(v) else float(v) for v in scan.ravel())])
    book.save(tmp_path / "a.xlsx")
    found = propose(read_table(tmp_path / "a.xlsx"), _SENSOR)
    assert np.stack([s.values for s in found.scans]) == pytest.approx(_VALUES, nan_ok=True)
    assert [s.time_s for s in found.scans] == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    assert any("another sheet begins" in doubt for doubt in found.doubts)


def test_a_scan_that_says_how_many_strips_follow_may_have_none() -> None:
    made: list[str] = []
    for n, scan in enumerate([*_VALUES[:3], np.full((_STRIPS, 2), np.nan), _VALUES[4]]):
        rows = [f"  strip {s} hi {h} V lo {low} V" for s, (h, low) in enumerate(scan) if not np.isnan(h)]
        made += [f"SCAN {n} t={500 * n}ms touched={len(rows)}", *rows]
    found = _read("\n".join(made) + "\n", strip_base="0", missing="untouched")
    values = np.stack([scan.values for scan in found.scans])
    assert np.isnan(values[3]).all()
    assert values[[0, 1, 2, 4]] == pytest.approx(_VALUES[[0, 1, 2, 4]], nan_ok=True)
    for lost in (2, len(made) - 1):  # a line of a scan in the middle, and the last line
        with pytest.raises((ReadingError, Unanswered), match="not like the others"):
            _read("\n".join(made[:lost] + made[lost + 1 :]) + "\n")


def test_inputs_are_of_the_strips_that_lines_above_say() -> None:
    pins = [(4, 1), (0, 6), (7, 3), (2, 5)]
    head = [f"# strip {s}: high A{h}, low A{low}" for s, (h, low) in enumerate(pins)]
    rows = ["t_s,A0,A1,A2,A3,A4,A5,A6,A7"]
    for n, scan in enumerate(_VALUES):
        fields = {p: v for pair, of in zip(pins, scan, strict=True) for p, v in zip(pair, of, strict=True)}
        rows.append(
            ",".join([f"{0.5 * n}", *("x" if np.isnan(fields[p]) else str(fields[p]) for p in range(8))])
        )
    _assert_read(_read("\n".join([*head, *rows]) + "\n", unit="V"))
    with pytest.raises(ReadingError, match="not so of each"):
        _read("\n".join([*head[:-1], *rows]) + "\n", unit="V", order="blocks")

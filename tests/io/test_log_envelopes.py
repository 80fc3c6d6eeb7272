"""Logs within what other programs put around them, and readings that words, registers or sheets stand for."""

from __future__ import annotations

import json
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
        ("{t};{s};{h};{l}", "{t};{s};not touched"),
        ("{t} {s} {h} {l}", "{t} {s} nicht gedr\u00fcckt"),
        ("{t}\t{s}\t{h}\t{l}", "{t}\t{s}\tpas de contact"),
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


_PSQL = [
    f" 2026-03-02 10:00:0{n // 2}.{5 * (n % 2)}12+01 | {s} | "
    + (" | " if np.isnan(h) else f"{h:>6} | {low:>6}")
    for n, scan in enumerate(_VALUES) for s, (h, low) in enumerate(scan)
]  # fmt: skip


@pytest.mark.parametrize(
    "typed", ["skin=> select at, strip, v_high from r;", "lab=# table r;", "pi@lab:~$ psql"]
)
def test_a_prompt_names_no_columns(typed: str) -> None:
    names = "           at             | strip | v_high | v_low \n--------------------------+-------+--------+-------"
    text = "\n".join([typed, names, *_PSQL, f"({len(_PSQL)} rows)", "", typed.split()[0] + " \\q"])
    _assert_read(_read(text))


@pytest.mark.parametrize(
    ("head", "mark"),
    [
        ("*** {} . row ***", ":"),
        ("-[ RECORD {} ]--+------", "|"),
        ("=== record {} ===", "="),
        ("--- Zeile {} ---", ":"),
    ],
)
def test_records_below_lines_that_number_them(head: str, mark: str) -> None:
    made: list[str] = []
    for n, scan in enumerate(_VALUES):
        for s, (h, low) in enumerate(scan):
            fields = {"id": 700 + len(made), "t_ms": 500 * n, "strip": s, "v_high": h, "v_low": low}
            body = [f"{k:>8} {mark} {'NULL' if v != v else v}" for k, v in fields.items()]
            made.append("\n".join([head.format(len(made) + 1).replace(" .", "."), *body]))
    text = "\n".join(made)
    _assert_read(_read(text + f"\n{len(made)} rows in set (0.00 sec)\n"))
    # One that lacks a field is not filled up in silence.
    cut = text.replace(made[9], "\n".join(made[9].split("\n")[:-1]))
    with pytest.raises(Unanswered, match="not like the others"):
        _read(cut)


@pytest.mark.parametrize(
    "signature", ["Pia Lund, Room 204, tel. 555 0199", "Dr. P. Lund\n+46 8 555 0199 17\nSE-11122"]
)
def test_a_log_in_a_mail(signature: str) -> None:
    body = _lines("  strip {s}: {h}/{l}", "  strip {s}: -", "").splitlines()
    scans = ["\n".join([f"scan {n}, t = {0.5 * n} s", *body[4 * n : 4 * n + 4]]) for n in range(_SCANS)]
    quoted = "\n".join("> " + line for line in "\n".join(scans).splitlines())
    head = "From: Pia <p@example.org>\nTo: mk\nSubject: pad\n\nupper/lower end of each strip, V_H/V_L\n\n"
    text = f"{head}{quoted}\n\nBest,\nPia\n"
    _assert_read(_read(f"{text}-- \n{signature}\n", missing="untouched", strip_base="0"))


def test_readings_below_two_dashes_are_no_signature() -> None:
    rows = [f"> {line}" for line in _lines("{t};{s};{h};{l}", "{t};{s};;").splitlines()]
    text = "\n".join(["From: a@b.example", "Subject: x", "> t_s;strip;v_h;v_l", *rows[:20], "--", *rows[20:]])
    _assert_read(_read(text))


def test_registers_that_the_log_describes() -> None:
    def block(n: int, scan: np.ndarray) -> str:
        raw = ["65535" if np.isnan(v) else f"{1e3 * v:.0f}" for v in (*scan[:, 0], *scan[:, 1])]
        return "\n".join([f"time = {0.5 * n} s", *(f"{40001 + k} = {v}" for k, v in enumerate(raw))])

    said = "Registers 40001..40004 = upper ends of strips {}, 40005..40008 = lower ends, in mV; 65535 = open"
    text = "\n\n".join(block(n, scan) for n, scan in enumerate(_VALUES))
    found = _read(said.format("1..4") + "\n\n" + text, unit="mV")
    _assert_read(found, scale=1e-3)
    # The same registers, the other way round.
    values = np.stack([scan.values for scan in _read(said.format("4..1") + "\n\n" + text, unit="mV").scans])
    assert values[:, ::-1] * 1e-3 == pytest.approx(_VALUES, nan_ok=True)
    with pytest.raises((Unanswered, ReadingError)):  # nothing says what they are
        _read(text, unit="mV")


def _system_log(kind: str) -> str:
    made = []
    for k, line in enumerate(_lines("strip={s} high={h} low={l}", "strip={s} high=- low=-").splitlines()):
        second = f"{3 + k // 8:02}.{500 * (k // 4 % 2) + k % 4:03}"
        if kind == "logcat":
            made.append(f"11-20 10:15:{second}  4821  4850 D Skin: {line}")
        elif kind == "console":
            made.append(f"2026-11-20 10:15:{second}+0100 SkinApp[1234:{5678 + k % 4}] [ble] {line}")
        else:
            stamp = round(1e3 * (1795166100 + float(second)))
            made.append(json.dumps({"__REALTIME_TIMESTAMP": f"{stamp}000", "_PID": "512", "MESSAGE": line}))
    between = {
        "logcat": "11-20 10:15:04.900  4821  4821 I Choreographer: Skipped 31 frames!",
        "console": "2026-11-20 10:15:04.900112+0100 SkinApp[1234:5671] [ui] Unable to satisfy 3 constraints.",
    }
    return "\n".join([*made[:16], *([between[kind]] if kind in between else []), *made[16:]]) + "\n"


@pytest.mark.parametrize("kind", ["logcat", "console", "journald"])
def test_lines_of_a_systems_log(kind: str) -> None:
    found = _read(_system_log(kind))
    assert np.stack([s.values for s in found.scans]) == pytest.approx(_VALUES, nan_ok=True)
    assert np.diff([s.time_s for s in found.scans]) == pytest.approx(0.5, abs=1e-3)


def test_another_path_between_those_of_strips() -> None:
    made = []
    for n, scan in enumerate(_VALUES):
        made.append(f"lab.psu.temperature 31.{n} {1772460000 + n}")
        made += [
            f"lab.skin.strip{s:02}.{end}_volts {'nan' if np.isnan(v) else v} {1772460000 + n}"
            for s, pair in enumerate(scan) for end, v in zip(("high", "low"), pair, strict=True)
        ]  # fmt: skip
    _assert_read(_read("\n".join(made) + "\n"), 1.0)


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

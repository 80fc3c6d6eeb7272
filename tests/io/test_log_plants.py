"""Logs as plants and services export them: newest first, a quality beside each line, a time beside each channel."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
N = range(8)


def _high(n: int, s: int) -> float:
    return 2.5 + 0.05 * n + 0.2 * s


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), PAD, answers)


def _assert_scans(found: Proposal, many: int = 8, step_s: float = 1.0) -> None:
    truth = [[[_high(n, s), _high(n, s) - 1.0] for s in range(3)] for n in range(many)]
    assert np.stack([scan.values for scan in found.scans]) == pytest.approx(np.array(truth), abs=1e-3)
    assert [scan.time_s for scan in found.scans] == pytest.approx([step_s * n for n in range(many)])


def _rows(stamp: str = "2026-11-20 10:15:{:02d} UTC", end: str = "") -> list[str]:
    return [
        f"{stamp.format(10 + n)},{s},{_high(n, s):.3f},{_high(n, s) - 1.0:.3f}{end}"
        for n in N
        for s in range(3)
    ]


@pytest.mark.parametrize("within", ["as they were", "backwards"])
@pytest.mark.parametrize("stamp", ["2026-11-20 10:15:{:02d} UTC", "10:15:{:02d}", "{}"])
def test_a_log_that_begins_with_the_newest_line_is_put_in_order_and_told(stamp: str, within: str) -> None:
    rows = _rows(stamp)
    blocks = [rows[n : n + 3] for n in range(0, len(rows), 3)][::-1]
    lines = [row for block in blocks for row in (block if within == "as they were" else block[::-1])]
    head = "t_s" if stamp == "{}" else "created_at"
    text = "\n".join([f"{head},strip,v_h,v_l", *lines])
    found = _read(text)
    _assert_scans(found)
    told = found.doubts if stamp == "{}" else found.reasons
    assert any("the newest stands first" in t for t in told)
    again = scans(of_text(text), found.mapping)
    assert [scan.time_s for scan in again] == [scan.time_s for scan in found.scans]


def test_a_time_that_falls_where_scans_count_up_is_refused() -> None:
    rows = [f"{n},{-n},{s},2.5,1.5" for n in N for s in range(3)]
    with pytest.raises(ReadingError, match="the time falls"):
        _read("\n".join(["scan,t_s,strip,v_h,v_l", *rows]))


def test_a_scan_that_lost_a_line_is_left_out_of_a_log_of_the_newest_first_too() -> None:
    lines = _rows("{}")[::-1]
    lines[10] = "2?,x9,0.1"
    found = _read("\n".join(["t_s,strip,v_h,v_l", *lines]), broken_lines="skip", missing="untouched")
    assert len(found.scans) == 7
    assert any("1 scan(s) left out" in d for d in found.doubts)


@pytest.mark.parametrize(
    "name",
    ["\u041a\u0430\u0447\u0435\u0441\u0442\u0432\u043e", "Qualit\u00e4t", "quality", "calidad", "is_valid"],
)
def test_a_quality_that_differs_is_asked(name: str) -> None:
    rows = _rows(end=",192")
    text = "\n".join([f"time,strip,v_h,v_l,{name}", *rows])
    _assert_scans(_read(text))
    with pytest.raises(Unanswered, match="readings are void"):
        _read(text.replace("192", "0", 4))


@pytest.mark.parametrize(
    "form",
    [
        "U \u0432\u0435\u0440\u0445, {0};U \u043d\u0438\u0437, {0}",
        "U high [{0}];U low [{0}]",
        "h ({0});l ({0})",
    ],
)
def test_a_unit_in_cyrillic_letters_is_read(form: str) -> None:
    rows = [f"{n};{s};{1000 * _high(n, s):.0f};{1000 * _high(n, s) - 1000:.0f}" for n in N for s in range(3)]
    found = _read("\n".join(["t [\u0441];strip;" + form.format("\u043c\u0412"), *rows]))
    assert found.mapping.unit == "mV"
    assert found.scans[1].time_s == 1.0


def _with_own_times(lag: int) -> str:
    names = "\t".join(f"t [ms]\th{s}\tName ({s})\tl{s}" for s in range(3))
    rows = [
        "\t".join(
            f"{10 * n}\t{_high(n, s):.3f}\t{10 * n + lag * (s == 1)}\t{_high(n, s) - 1.0:.3f}"
            for s in range(3)
        )
        for n in N
    ]
    return "\n".join([names, *rows])


def test_a_channels_own_time_that_lags_is_a_doubt() -> None:
    assert not _read(_with_own_times(0)).doubts
    _assert_scans(_read(_with_own_times(0)), step_s=0.01)
    assert any("'Name (1)' rises as" in doubt for doubt in _read(_with_own_times(20)).doubts)


def test_words_and_a_time_below_the_readings_are_left_out_with_a_warning() -> None:
    text = "\n".join(
        ["time,strip,v_h,v_l", *_rows(), "(24 rows affected)", "Completed at: 2026-11-20T11:02:41.55+01:00"]
    )
    found = _read(text)
    _assert_scans(found)


def test_a_last_line_that_is_cut_and_names_a_strip_is_still_asked_or_told() -> None:
    lines = [
        f"t={n} strip={s} v_h={_high(n, s):.3f} v_l={_high(n, s) - 1.0:.3f}" for n in N for s in range(3)
    ]
    text = "\n".join([*lines[:-1], "t=7 strip=2 v_h="])
    try:
        found = _read(text)
    except (Unanswered, ReadingError):
        return
    assert found.doubts

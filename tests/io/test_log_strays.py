"""A few lines that are not of a log's form: set aside and named, asked about where they may hold readings."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

ONE = ts.Sensor(construction="crs-m", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
TWO = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
TABLE = [
    "     time  strip    volt",
    *(f"{n:<3} {n // 3 / 10:5}  {n % 3:5}  {1.2 + 0.1 * (n % 7):6.3f}" for n in range(30)),
]
TOUCHED = [
    f"{i / 10};{s};{2500.5 + 9 * i};{1500.5 + 7 * i};" for i in range(8) for s in ((0, 1), (1, 2))[i > 3]
]


def values(text: str, sensor: ts.Sensor, **answers: str) -> np.ndarray:
    return np.stack([one.values for one in propose(of_text(text), sensor, answers).scans])


def test_lines_around_a_table_are_set_aside_and_named() -> None:
    found = propose(of_text("\n".join(["> head(df, 30)", *TABLE, "> "])), ONE)
    np.testing.assert_array_equal(np.stack([s.values for s in found.scans]), values("\n".join(TABLE), ONE))
    assert any("line 1 ('> head(df, 30)')" in reason for reason in found.reasons)


def test_stray_lines_with_numbers_are_one_question() -> None:
    rows = [
        f"[10:00:0{i}.{c}00] {c} 2{i}0 31{i} 3{i}5".replace("] 1", "] H").replace("] 2", "] L")
        for i in range(8)
        for c in "12"
    ]
    text = "\n".join(["[10:00:00.000] 0 512", *rows, "[10:00:09.000] H 1"])
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text.replace(" L 2", " L 1")), TWO)
    assert {q.key for q in asked.value.questions} <= {"unit", "adc_bits"}
    answers = {q.key: q.choices[0] for q in asked.value.questions}
    assert any("line 18" in d for d in propose(of_text(text.replace(" L 2", " L 1")), TWO, answers).doubts)


def test_names_are_no_stray_line() -> None:
    text = "\n".join(
        ["frame;time/s;E1;L1;E2;L2;E3;L3;ok?", *(f"{i};{i / 10};3;2;3.{i};2;4;3;yes" for i in range(8))]
    )
    with pytest.raises(Unanswered, match=r"'E1', \.\.\. are as many as the strips"):
        propose(of_text(text), TWO)
    assert np.nanmax(values(text, TWO, E1="h", unit="V")) == 4.0
    both = values(text.replace("E", "R"), TWO, unit="V")
    assert both[0, 0].tolist() == [3.0, 2.0]


def test_a_scan_of_which_a_line_is_left_out_is_left_out() -> None:
    text = "\n".join(["t [s];strip;h [mV];l [mV];note", *TOUCHED[:2], "0.1;0;25;x9;1;5", *TOUCHED[3:]])
    whole = values("\n".join(["t [s];strip;h [mV];l [mV];note", *TOUCHED]), TWO)
    found = propose(of_text(text), TWO, {"broken_lines": "skip", "missing": "untouched"})
    left = np.stack([one.values for one in found.scans])
    assert any("2 scan(s) left out, from line(s) 2, 5" in doubt for doubt in found.doubts)
    np.testing.assert_array_equal(left, whole[2:])


def test_noise_is_found_beside_strips_without_a_column() -> None:
    rows = [f"{20 * i},{i % 3},{(i + 1) % 2},{350 + 9 * i},{280 + 7 * i}" for i in range(12)]
    found = values("# 10 bit\nt_ms,h0,l0,h1,l1\n" + "\n".join(rows), TWO, missing="untouched", adc_bits="10")
    np.testing.assert_array_equal(np.isnan(found).all(axis=(0, 2)), [True, False, True])


def test_a_date_in_a_column_of_its_own_counts() -> None:
    days = [f"{20 + (i > 3)}/11/2026,14:0{i}:00,1.1,1.{i},1.3" for i in range(8)]
    scans = propose(of_text("Date,Time,s0 [V],s1 [V],s2 [V]\n" + "\n".join(days)), ONE).scans
    assert scans[4].time_s == 86400.0 + 240.0


def test_a_lost_point_is_refused_whatever_is_untouched() -> None:
    rows = [f"{i / 10},{1.111 + 0.1 * i:.3f},1.222,1.333" for i in range(80)]
    text = "t [s],s0,s1,s2\n" + "\n".join(rows).replace("1.911,1.222", "1.911,1222")
    for answers in ({}, {"untouched": "none"}):
        with pytest.raises(ts.ReadingError, match="line 10, s1: 1222"):
            propose(of_text(text), ONE, answers)


def test_quoted_rows_above_the_first_whole_one_are_no_heading() -> None:
    rows = [",".join(f'"{n / 50 + s:.3f}"'.replace(".", ",") for s in range(4)) for n in range(12)]
    rows[:3] = [row[: row.rindex('"', 0, -1)] + '""' for row in rows[:3]]  # nothing touches the last strip
    rows[0] = rows[0].replace(",000", ",x00", 1)
    text = "\n".join(['"t [s]","s0 [V]","s1 [V]","s2 [V]"', *rows])
    with pytest.raises(Unanswered, match=r"line\(s\) 2, 3 "):
        propose(of_text(text), ONE, {})


def test_a_log_that_ends_before_the_first_number_of_a_line_is_cut() -> None:
    rows = [
        f"tactile,strip={s} volt={1.2 + s / 10} {1770000000 + n}000000000" for n in range(6) for s in range(3)
    ]
    found = propose(of_text("\n".join([*rows, "tactile,strip="])), ONE, {})
    assert len(found.scans) == len(rows) // 3
    assert any("line 19" in doubt for doubt in found.doubts)


def test_a_whole_row_beside_a_remark_is_not_set_aside_in_silence() -> None:
    rows = [f"{i / 100:.2f}\t1.{i}11\t1.222\t1.333" for i in range(8)]
    text = "\n".join(["log of bench 3", rows[0] + "\tpress starts\tby hand", *rows[1:]])
    with pytest.raises(Unanswered, match=r"line\(s\) 2 \('0.00.*press.* as many numbers: mend it"):
        propose(of_text(text), ONE)


def test_a_last_line_of_as_many_numbers_is_not_offered_to_be_left_out() -> None:
    rows = ["t,s0,s1,s2", *(f"{i / 100:.2f},1.{i}11,1.222,1.333" for i in range(8)), "0.08,1.2,1.2,1.3,7"]
    with pytest.raises(Unanswered, match="10 holds as many numbers: mend it, or take it out") as error:
        propose(of_text("\n".join(rows)), ONE)
    assert [q.choices for q in error.value.questions if q.key == "broken_lines"] == [()]


def _named_anew(names: str) -> str:
    rows = [f"{i // 3 / 10},{i % 3},{2 + i / 100:.2f},{1 + i / 100:.2f}" for i in range(24)]
    turned = [",".join([*row.split(",")[:2], *row.split(",")[:1:-1]]) for row in rows[12:]]
    return "\n".join(["time_s,strip,v_h,v_l", *rows[:12], names, *turned])


@pytest.mark.parametrize("border", ["", "|"])
def test_below_names_in_another_order_columns_are_read_by_these(border: str) -> None:
    text = _named_anew("time_s,strip,v_l,v_h")
    if border:  # a table in Markdown, with decimal commas and a note between
        text = "\n".join(f"|{line.replace(',', '|').replace('.', ',')}|" for line in text.split("\n"))
        text = text.replace("|time_s|strip|v_l", "\n*pausa, nota alle 10:42*\n\n|time_s|strip|v_l")
    found = propose(of_text(text), TWO)
    assert np.allclose([s.values[:, 0] - s.values[:, 1] for s in found.scans], 1.0)
    assert any("in another order" in reason for reason in found.reasons)


def test_other_names_anew_are_refused() -> None:
    with pytest.raises(ts.ReadingError, match="line 14 names the columns"):
        propose(of_text(_named_anew("time_s,strip,v_l,temp")), TWO)

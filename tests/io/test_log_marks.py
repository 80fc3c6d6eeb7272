"""Marks in the place of readings keep the places of the others; comments that only name a sensor are asked about."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.headed import decimal_mark
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.separators import fields_of
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=5, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0, adc_bits=10)
HIGH, LOW = (
    [[623, 629, 600], [621, 638, 616], [619, 640, 630]],
    [[326, 283, 288], [341, 284, 278], [350, 290, 270]],
)


def values(text: str, **answers: str) -> np.ndarray:
    """Return the readings, by scan, strip and channel."""
    return np.stack([s.values for s in propose(of_text(text), PAD, answers).scans])


def rows(mark: str, form: str) -> str:
    """Return a log with rows of high and low readings of five strips, of which the outer two are untouched."""
    return "".join(
        form.format(
            t=0.04 * n, h=" ".join([mark, *map(str, h), mark]), l=" ".join([mark, *map(str, low), mark])
        )
        for n, (h, low) in enumerate(zip(HIGH, LOW, strict=True))
    )


@pytest.mark.parametrize("mark", [".", "...", "\u2026", "-", "--", "\u2013", "nan"])
@pytest.mark.parametrize(
    "form", ["[{t:.2f}] H: {h}\n[{t:.2f}] L: {l}\n", "t={t:.2f} s\nhigh: {h}\nlow: {l}\n"]
)
def test_marks_for_nothing_hold_the_places_of_a_row(mark: str, form: str) -> None:
    found = values(rows(mark, form))
    assert np.isnan(found[:, [0, 4]]).all()
    assert found[:, 1:4, 0].tolist() == HIGH
    assert found[:, 1:4, 1].tolist() == LOW


@pytest.mark.parametrize("mark", ["*", "?", "__"])
def test_marks_that_may_mean_anything_are_never_passed_over(mark: str) -> None:
    with pytest.raises((Unanswered, ReadingError)):
        values(rows(mark, "t={t:.2f} s\nhigh: {h}\nlow: {l}\n"), missing="untouched", unit="code")


def test_rows_behind_the_word_for_an_end() -> None:
    found = values(rows("0", "{t:.2f} s H {h} | L {l}\n"), missing="untouched")
    assert found[:, 1:4, 0].tolist() == HIGH
    assert found[:, 1:4, 1].tolist() == LOW


def test_empty_quotes_between_spaces_are_a_field() -> None:
    lines = ['"time" "strip" "vH" "vL" "note"']
    for n in range(3):
        for s in range(5):
            v = f"{2 + 0.1 * s:.4f} {1.1 + 0.1 * n:.4f}" if 0 < s < 4 else "NA NA"
            lines.append(f'"{5 * n + s + 1}" {0.1 * n:.2f} "S{s}" {v} "{"press" if n > 1 else ""}"')
    found = values("\n".join(lines) + "\n")
    assert found.shape == (3, 5, 2)
    assert np.isnan(found[:, [0, 4]]).all()


@pytest.mark.parametrize("note", ["# pad 2", "# Sensor: B", "; board no. 3"])
def test_a_comment_that_names_a_sensor_is_asked_about(note: str) -> None:
    lines = [f"{20 * n},{s},{500 + 9 * s + n},{300 + 5 * s + n}" for n in range(6) for s in range(5)]
    text = "\n".join(["time_ms,strip,high,low", *lines[:15], note, *lines[15:]]) + "\n"
    with pytest.raises(Unanswered) as error:
        values(text, unit="code")
    assert [q.key for q in error.value.questions] == ["part"]
    assert len(values(text.replace(note, "# press 2"), unit="code")) == 6


@pytest.mark.parametrize(
    ("said", "times"), [("10k/10k", {"2"}), ("10 kOhm and 20 kOhm", {"3", "1.5"}), ("1:4", {"4"})]
)
def test_the_resistors_of_a_divider_give_its_factor(said: str, times: set[str]) -> None:
    lines = [
        f"{20 * n},{s},{1.5 + 0.01 * s + 0.1 * n:.3f},{0.7 + 0.1 * n:.3f}" for n in range(6) for s in range(5)
    ]
    text = "\n".join([f"# behind a divider of {said}", "time_ms,strip,high_V,low_V", *lines]) + "\n"
    with pytest.raises(Unanswered) as error:
        values(text)
    (question,) = [q for q in error.value.questions if q.key == "scale"]
    assert {*question.choices} == {"1", *times}


def test_separators_in_the_last_column_of_remarks_are_its_own() -> None:
    lines = [f"{20 * n},{s},{500 + 9 * s + n},{300 + 5 * s + n},mug" for n in range(3) for s in range(5)]
    text = "\n".join(["time_ms,strip,high,low,Remark", *lines]) + "\n"
    whole = values(text, unit="code")
    assert whole.shape == (3, 5, 2)
    assert np.array_equal(
        values(text.replace("519,311,mug", "519,311,mug, again, harder"), unit="code"), whole
    )
    with pytest.raises(Unanswered) as error:  # a value too many
        values(text.replace("519,311,mug", "519,311,5,mug"), unit="code")
    assert [q.key for q in error.value.questions] == ["broken_lines"]


def test_cells_of_html_span_no_more_columns_than_browsers_let_them() -> None:
    cells = [(0.1 * n, s, 2.5 + 0.1 * s, 1.5 + 0.1 * n) for n in range(3) for s in range(5)]
    rows_ = "".join("<tr>" + "".join(f"<td>{c:g}</td>" for c in row) + "</tr>" for row in cells)
    head = "<tr><th>t</th><th>strip</th><th>high</th><th>low</th></tr>"
    table = of_text(f"<table><tr><th colspan=100000>pad</th></tr>{head}{rows_}</table>")
    assert table.names == ("t", "strip", "high", "low")
    assert len(table.rows) == 15


ROWS = [(20 * n, *(v for s in range(5) for v in (500 + 9 * s + n, 300 + 5 * s + 2 * n))) for n in range(6)]
WIDE = ",".join(["t_ms", *(f"{c}{s}" for s in range(5) for c in "hl")])
TRUTH = np.array(ROWS, dtype=float)[:, 1:].reshape(6, 5, 2)


@pytest.mark.parametrize("before", ["RX: ", "DATA: ", "- "])
def test_a_word_or_a_dash_before_each_line_is_no_sign_and_no_field(before: str) -> None:
    text = "\n".join([WIDE, *(before + ",".join(map(str, row)) for row in ROWS)]) + "\n"
    assert np.array_equal(values(text, unit="code"), TRUTH)


@pytest.mark.parametrize("between", [": ", " ", "  ", ",", " = "])
@pytest.mark.parametrize("column", ["10{} (ADC)", "CH10{}", "10{}"])
def test_labels_above_say_what_numbered_columns_are(between: str, column: str) -> None:
    order = [2, 0, 3, 1, 4, 6, 5, 7, 8, 9]  # of the readings, in the log's columns
    labels = [f"10{n}{between}strip {k // 2 + 1} {('high', 'low')[k % 2]}" for n, k in enumerate(order)]
    names = ",".join(["time_ms", *(column.format(n) for n in range(10))])
    lines = [",".join(map(str, [row[0], *(row[1 + k] for k in order)])) for row in ROWS]
    found = values("\n".join([*labels, "", names, *lines]) + "\n", unit="code", strip_base="1")
    assert np.array_equal(found, TRUTH)


def test_a_row_that_numbers_columns_is_no_scan() -> None:
    text = "\n".join([",".join(map(str, range(11))), *(",".join(map(str, row)) for row in ROWS)]) + "\n"
    with pytest.raises((Unanswered, ReadingError)):
        values(text, unit="code")


def test_thousands_apart_do_not_make_a_comma_of_three_digits_another_mark() -> None:
    rows = [["2 756,600", "1 001,200"], ["3 001,200", "1 002,400"]]
    assert decimal_mark(rows) == ","
    with pytest.raises(ts.ReadingError, match="decimal points"):
        decimal_mark([["2 756.600"], ["1,500"]])


def test_an_empty_quote_at_the_start_is_empty() -> None:
    assert fields_of('"" 512 ""', " ") == ["", "512", ""]

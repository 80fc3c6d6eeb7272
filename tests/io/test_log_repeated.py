"""Logs whose lines are of one form that nobody knew, arrays that are given names, and that nothing is lost in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import of_columns, read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0, adc_bits=12)
SHEET = ts.Sensor(construction="crs-m", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
N, S = range(9), range(4)
HIGH = np.array([[3100 - 61 * s + 47 * n for s in S] for n in N]) + 0.0
LOW = HIGH - np.array([[700 + 31 * s - 17 * n for s in S] for n in N])
OPEN = np.array([[s > 1 + n // 3 or s < n // 4 for s in S] for n in N])
HIGH[OPEN] = LOW[OPEN] = np.nan


def read(text: str, sensor: ts.Sensor = PAD, **answers: str) -> Proposal:
    return propose(of_text(text), sensor, answers)


def assert_codes(found: Proposal, step_s: float = 0.02) -> None:
    values = np.stack([s.values for s in found.scans])
    np.testing.assert_array_equal(values, np.stack([HIGH, LOW], axis=-1))
    assert [s.time_s - found.scans[0].time_s for s in found.scans] == pytest.approx([step_s * n for n in N])


def truth(n: int) -> np.ndarray:
    return np.stack([HIGH[n], LOW[n]], axis=-1)


def pair(n: int, s: int, form: str = "d", between: str = "/", nothing: str = "--") -> str:
    if OPEN[n, s]:
        return f"{nothing}{between}{nothing}"
    return f"{int(HIGH[n, s]):{form}}{between}{int(LOW[n, s]):{form}}"


FORMS = {
    "letters": lambda n: f"{20 * n} ms > " + " ".join(f"{s + 1}=H{pair(n, s, nothing='x', between='L')}" for s in S),
    "hexadecimal": lambda n: f"T={300 + 20 * n:08X} D=" + " ".join(pair(n, s, "03X", ":", "---") for s in S),
    "frames": lambda n: f"12:00:00.{20 * n:03d} <" + "|".join(pair(n, s, "03X", "/", "---") for s in S) + ">",
    "answers": lambda n: f"[0.{20 * n:03d} s] > READ? (@1:4)\n< " + " ".join(pair(n, s, nothing="*") for s in S),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_lines_of_one_form_are_read_whatever_it_is(form: str) -> None:
    lines = ["# 12 bit codes, upper/lower", *map(FORMS[form], N)]
    assert_codes(read("\n".join(lines), unit="code"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("where", [0, 4])
def test_of_such_lines_none_is_lost_unasked(form: str, where: int) -> None:
    lines = "\n".join(FORMS[form](n) for n in N).split("\n")
    at = len(lines) // 2 + where % 2
    for damaged in (
        [*lines[:at], lines[at][:-7], *lines[at + 1 :]],
        [*lines[:at], lines[at][3:], *lines[at + 1 :]],
    ):
        try:
            found = read("\n".join(damaged), unit="code")
        except (Unanswered, ts.ReadingError):
            continue
        if len(found.scans) == len(N):
            assert_codes(found)
            continue
        # A line that is torn is left out with its scan, and named; all other scans are as they were.
        kept = [n for n in N if any(np.array_equal(truth(n), s.values, equal_nan=True) for s in found.scans)]
        assert len(kept) == len(found.scans) == len(N) - 1
        assert any("left out: " in doubt and f"line {at + 1} " in doubt for doubt in found.doubts)


def test_an_answer_that_is_missing_is_named() -> None:
    lines = "\n".join(FORMS["answers"](n) for n in N).split("\n")
    found = read("\n".join([*lines[:9], *lines[10:]]), unit="code")
    assert [round(50.0 * s.time_s) for s in found.scans] == [n for n in N if n != 4]
    assert any("left out: line 9 " in doubt for doubt in found.doubts)


def logfmt(nothing: str) -> str:
    return "\n".join(
        f"ts=2026-03-14T09:26:53.{20 * n:03d}Z level=info strip={s} "
        + (nothing if OPEN[n, s] or n == 5 else f"v_high={HIGH[n, s] / 1000}V v_low={LOW[n, s] / 1000}V")
        for n in N
        for s in S
    )


@pytest.mark.parametrize("nothing", ["state=open", "touched=false", "contact: none"])
def test_strips_that_only_a_word_says_to_be_untouched(nothing: str) -> None:
    found = read(logfmt(nothing))
    values = np.stack([s.values for s in found.scans])
    expected = np.stack([HIGH, LOW], axis=-1) / 1000
    expected[5] = np.nan  # a scan in which nothing touches
    np.testing.assert_allclose(values, expected)


def test_strips_of_which_a_word_says_something_else_are_refused() -> None:
    with pytest.raises((Unanswered, ts.ReadingError)):
        read(logfmt("state=stuck"))


def rows(table: np.ndarray, form: str, row: str, by: str = ", ", nothing: str = "NAN") -> str:
    return form.format(
        row.join("{" + by.join(nothing if np.isnan(v) else f"{v / 1000}" for v in r) + "}" for r in table)
    )


def arrays(kind: str) -> str:
    t = ", ".join(f"{0.02 * n:.2f}" for n in N)
    if kind == "C":
        return f"/* s, V */\nstatic float t[9] = {{{t}}};\n" + "".join(
            f"float {name}[9][4] = {{\n" + rows(a, "{}", ",\n") + "};\n"
            for name, a in (("vh", HIGH), ("vl", LOW))
        )
    if kind == "Python":
        text = f"import numpy as np\nt = np.array([{t}])\n" + "".join(
            f"{name} = np.array([" + rows(a, "{}", ",\n  ", nothing="nan") + "])\n"
            for name, a in (("vh", HIGH), ("vl", LOW))
        )
        return text.replace("{", "[").replace("}", "]")
    text = f'netcdf x {{\ndimensions:\n\tscan = 9 ;\nvariables:\n\tdouble t(scan) ;\n\t\tt:units = "s" ;\ndata:\n t = {t} ;\n'  # noqa: E501
    for name, a in (("vh", HIGH), ("vl", LOW)):
        text += (
            f" {name} =\n" + rows(a, "{}", ",\n  ", nothing="_").replace("{", "").replace("}", "") + " ;\n"
        )
    return text + "}\n"


def test_a_line_for_each_of_twice_as_many_inputs_as_strips() -> None:
    ends = [HIGH, LOW]
    order = [(s, e) for s in S for e in (0, 1)]
    lines = [
        f"{20 * n},{k},{4095 if OPEN[n, s] else int(ends[e][n, s])}"
        for n in N
        for k, (s, e) in enumerate(order)
    ]
    assert_codes(read("\n".join(["ms,ch,code", *lines])))
    with pytest.raises((Unanswered, ts.ReadingError)):
        read("\n".join(["ms,ch,code", *lines[:11], *lines[12:]]))


def test_columns_are_of_the_strips_that_a_line_wires_to_them() -> None:
    lines = [
        f"{20 * n}\t" + "\t".join("-" if OPEN[n, s] else f"{HIGH[n, s] / 1000}" for s in (2, 0, 3, 1))
        for n in N
    ]
    said = "# strip 2 on A0, strip 0 on A1, strip 3 on A2, strip 1 on A3"
    found = read("\n".join([said, "ms\tA0\tA1\tA2\tA3", *lines, ""]), SHEET)
    np.testing.assert_allclose(np.stack([s.values[:, 0] for s in found.scans]), HIGH / 1000)
    assert any("strip 2 on A0" in doubt for doubt in found.doubts)
    partly = said.rpartition(",")[0]
    with pytest.raises(ts.ReadingError, match="give them the strips' numbers"):
        read("\n".join([partly, "ms\tA0\tA1\tA2\tA3", *lines, ""]), SHEET)


def test_one_number_far_above_what_a_sensor_reads_is_no_contact() -> None:
    cells = [
        "\t".join("1000000" if OPEN[n, s] else f"{v[n, s] / 1000}" for s in S for v in (HIGH, LOW)) for n in N
    ]
    head = "\t".join(f"S{s + 1} {end} [V]" for s in S for end in ("high", "low"))
    found = read("\n".join([f"t [s]\t{head}", *(f"{n / 50:g}\t{cells[n]}" for n in N)]))
    np.testing.assert_allclose(
        np.stack([s.values for s in found.scans]), np.stack([HIGH, LOW], axis=-1) / 1000
    )


def test_parts_of_paths_say_what_columns_are() -> None:
    columns = {"fields.v_high": HIGH.ravel() / 1000, "fields.v_low": LOW.ravel() / 1000}
    columns |= {"tags.strip": np.tile(S, 9), "timestamp": np.repeat(np.arange(9) / 10 + 1795789328, 4)}
    found = propose(of_columns(columns), PAD, {})
    np.testing.assert_allclose(
        np.stack([s.values for s in found.scans]), np.stack([HIGH, LOW], axis=-1) / 1000
    )


def test_feather(tmp_path: Path) -> None:
    feather, pyarrow = pytest.importorskip("pyarrow.feather"), pytest.importorskip("pyarrow")
    columns = {"t_s": [n / 50 for n in N]} | {
        f"S{s} {e} [V]": v[:, s] / 1000 for s in S for e, v in (("h", HIGH), ("l", LOW))
    }
    feather.write_feather(pyarrow.table(columns), str(tmp_path / "a.feather"))
    found = propose(read_table(tmp_path / "a.feather"), PAD, {})
    np.testing.assert_allclose(
        np.stack([s.values for s in found.scans]), np.stack([HIGH, LOW], axis=-1) / 1000
    )
    (tmp_path / "b.feather").write_bytes((tmp_path / "a.feather").read_bytes()[:300])
    with pytest.raises(ts.ReadingError, match="damaged"):
        read_table(tmp_path / "b.feather")

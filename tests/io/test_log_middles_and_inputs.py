"""Logs of middles and differences, of strips by name in columns, of more inputs than strips, of changes alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.by_content import of_content
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.table import ContradictionError
from tacstrip.io.log_import.text import of_text

STRIPS, SCANS = 6, 30
TWO = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=8.0, length_mm=150.0, vref_volt=5.0)
ONE = ts.Sensor(construction="crs-m", strips=STRIPS, pitch_mm=8.0, length_mm=150.0, vref_volt=5.0)
N, S = np.ogrid[:SCANS, :STRIPS]
OFF = (N * (STRIPS + 3.0) / SCANS - 2.0 - S) / 2.2  # a disc moves over all strips
OPEN = np.abs(OFF) >= 0.95
CHORD = np.sqrt(np.clip(1.0 - OFF**2, 0.0, None))
MIDDLE = 2.0 + 0.03 * N + 0.05 * S
HIGH = np.where(OPEN, np.nan, np.round(MIDDLE + 0.5 * CHORD, 4))
LOW = np.where(OPEN, np.nan, np.round(MIDDLE - 0.5 * CHORD, 4))
BOTH = np.stack([HIGH, LOW], axis=2)


def proposed(log: str, sensor: ts.Sensor = TWO, **answers: str) -> Proposal:
    return propose(of_text(log), sensor, answers)


def values(found: Proposal) -> np.ndarray:
    return np.stack([scan.values for scan in found.scans])


def text(value: float, none: str = "", form: str = ".4f") -> str:
    return none if np.isnan(value) else format(value, form)


def wide(names: str, first: np.ndarray, second: np.ndarray, none: str = "") -> str:
    """Return a log with a column of each strip and end, by names such as "mean_{s}, diff_{s}"."""
    head = ",".join(names.format(s=s) for s in range(STRIPS))
    rows = (
        ",".join(
            [f"{n * 0.05:.2f}", *(text(v[n, s], none, ".6f") for s in range(STRIPS) for v in (first, second))]
        )
        for n in range(SCANS)
    )
    return "\n".join([f"t_s,{head}", *rows, ""])


@pytest.mark.parametrize(
    "names", ["mean_{s},diff_{s}", "Mitte {s} [V],Breite {s} [V]", "S{s}_center_V,S{s}_width_V"]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_middle_and_a_difference_give_both_ends(names: str, sign: float) -> None:
    found = proposed(wide(names, (HIGH + LOW) / 2.0, sign * (HIGH - LOW)))
    np.testing.assert_allclose(values(found), BOTH, atol=1e-6)
    assert "the middle of both ends and their difference" in found.doubts[0]


def test_a_middle_beside_something_else_is_asked_about() -> None:
    with pytest.raises(Unanswered, match=r"'mean_0' is called neither a reading nor an end"):
        proposed(wide("mean_{s},sigma_{s}", (HIGH + LOW) / 2.0, HIGH - LOW))


FINGERS = ("index", "little", "middle", "palm", "ring", "thumb")


def of_fingers(head: str, first: np.ndarray, second: np.ndarray) -> str:
    """Return a log with names such as "index mean,index diff" above its columns."""
    return "\n".join(
        ["t_s," + ",".join(head.format(f=f) for f in FINGERS), wide("{s}", first, second).partition("\n")[2]]
    )


def test_the_middle_finger_has_a_middle_and_a_difference_too() -> None:
    log = of_fingers("{f} mean,{f} diff", (HIGH + LOW) / 2.0, HIGH - LOW)
    with pytest.raises(Unanswered) as asked:
        proposed(log)
    assert [q.key for q in asked.value.questions] == ["strip_order"]
    np.testing.assert_allclose(values(proposed(log, strip_order=",".join(FINGERS))), BOTH, atol=1e-6)


def test_a_word_of_a_middle_without_its_difference_leaves_all_as_they_are() -> None:
    """By content, middles and differences would be both ends: what their names say goes first."""
    log = of_fingers("{f} mean,{f} diff", (HIGH + LOW) / 2.0, HIGH - LOW).replace(
        "middle diff", "middle d", 1
    )
    with pytest.raises(Unanswered, match="which 12 are the readings"):
        proposed(log)
    found = proposed(log, readings="index mean..thumb diff")
    assert any("are they a middle of both and a difference?" in doubt for doubt in found.doubts)


@pytest.mark.parametrize(
    ("names", "read"),
    [("{f} mean,{f} diff", False), ("{f} center,{f} width", False), ("mean {f} top,mean {f} bottom", True)],
)
def test_names_of_what_is_made_of_readings_are_heeded_by_content(names: str, read: bool) -> None:
    assert (of_content(of_fingers(names, HIGH, LOW), STRIPS, 2) is not None) == read


@pytest.mark.parametrize(("first", "doubted"), [(HIGH, False), ((HIGH + LOW) / 2.0, True)])
def test_what_is_read_by_content_is_doubted_where_contacts_would_be_hollow(
    first: np.ndarray, doubted: bool
) -> None:
    second = HIGH - LOW if doubted else LOW
    log = "\n".join(
        f"<{n * 0.05:.2f} s> "
        + " ".join(f"{text(first[n, s], 'x')}~{text(second[n, s], 'x')}" for s in range(STRIPS))
        for n in range(SCANS)
    )
    found = proposed(log)
    assert any("no other assignment" in doubt for doubt in found.doubts)
    assert any("'h_0' and 'l_0' are taken for v_h and v_l" in doubt for doubt in found.doubts) == doubted


@pytest.mark.parametrize("lacks", [0, 1])
def test_half_a_pair_gives_no_end(lacks: int) -> None:
    ends = [(HIGH + LOW) / 2.0, HIGH - LOW]
    n, s = np.argwhere(~OPEN)[20]
    ends[lacks][n, s] = np.nan
    found = proposed(wide("mean_{s},diff_{s}", ends[0], ends[1]))
    expected = BOTH.copy()
    expected[n, s] = np.nan
    np.testing.assert_allclose(values(found), expected, atol=1e-6)
    assert any(f"line {n + 2} ('{('mean', 'diff')[lacks]}_{s}')" in doubt for doubt in found.doubts)


def test_an_answer_about_another_column_leaves_middles_what_they_are() -> None:
    log = wide("mean_{s},diff_{s}", (HIGH + LOW) / 2.0, HIGH - LOW).split("\n")
    log = [f"{log[0]},valid", *(f"{row},{n % 7 > 0:d}" for n, row in enumerate(log[1:-1]))]
    with pytest.raises(Unanswered) as asked:
        proposed("\n".join(log))
    assert [q.key for q in asked.value.questions] == ["valid"]
    np.testing.assert_allclose(values(proposed("\n".join(log), valid="skip")), BOTH, atol=1e-6)
    with pytest.raises(Unanswered, match="diff_0"):  # what is told of a middle holds
        proposed("\n".join(log), valid="skip", mean_0="h")


def test_a_mapping_of_middles_by_name_is_read_again(tmp_path: Path) -> None:
    TWO.save(tmp_path / "s.toml")
    log, out = tmp_path / "fingers.csv", tmp_path / "r.csv"
    log.write_text(of_fingers("{f} mean,{f} diff", (HIGH + LOW) / 2.0, HIGH - LOW))
    words = ["import", str(log), str(tmp_path / "s.toml"), "-o"]
    done = CliRunner().invoke(cli, [*words, str(out), "--answer", f"strip_order={','.join(FINGERS)}"])
    assert done.exit_code == 0, done.output
    again = CliRunner().invoke(
        cli, [*words, str(tmp_path / "again.csv"), "--mapping", str(tmp_path / "r.mapping.toml")]
    )
    assert again.exit_code == 0, again.output
    assert (tmp_path / "again.csv").read_text() == out.read_text()
    for one in (done, again):
        assert "taken for the middle of both ends and their difference" in one.stderr


def test_columns_of_one_channel_are_not_exchanged() -> None:
    log = "\n".join(
        ["t_s," + ",".join(f"v_out{s}" for s in range(STRIPS))]
        + [",".join([f"{n * 0.05:.2f}", *(text(HIGH[n, s]) for s in range(STRIPS))]) for n in range(SCANS)]
    )
    proposed(log, ONE)
    with pytest.raises(ts.OptionError, match="exchanged=yes: the log has one channel"):
        proposed(log, ONE, exchanged="yes")


def test_names_that_say_nothing_are_doubted_where_contacts_would_be_hollow() -> None:
    plain = proposed(wide("a{s},b{s}", HIGH, LOW))
    np.testing.assert_allclose(values(plain), BOTH, atol=1e-6)
    assert not any("difference" in doubt for doubt in plain.doubts)
    assert any(
        "difference" in doubt for doubt in proposed(wide("a{s},b{s}", (HIGH + LOW) / 2.0, HIGH - LOW)).doubts
    )


def test_strips_by_name_in_columns_are_asked_for_their_order() -> None:
    order = [2, 0, 4, 1, 5, 3]  # of these along the skin
    head = ",".join(f"{FINGERS[s]} high,{FINGERS[s]} low" for s in np.argsort(order))
    below = wide("{s}", HIGH[:, np.argsort(order)], LOW[:, np.argsort(order)]).partition("\n")[2]
    log = f"t_s,{head}\n{below}"
    with pytest.raises(Unanswered) as asked:
        proposed(log)
    assert [q.key for q in asked.value.questions] == ["strip_order"]
    told = ",".join(FINGERS)  # in their true order
    np.testing.assert_allclose(values(proposed(log, strip_order=told)), BOTH, atol=1e-6)


def _of_inputs(inputs: int, first: int) -> str:
    rows = ["sample,ts_ms,mux_ch,mv"]
    for n in range(SCANS):
        for i in range(inputs):
            value = HIGH[n, i - first] if 0 <= i - first < STRIPS else np.nan
            rows.append(f"{n},{n * 50},{i},{text(1000.0 * value, form='.0f')}")
    return "\n".join([*rows, ""])


def test_of_more_inputs_than_strips_the_first_strip_is_asked() -> None:
    log = _of_inputs(8, 1)
    assert np.isfinite(HIGH).any(axis=0).all()
    np.testing.assert_allclose(values(proposed(log, ONE))[:, :, 0], np.round(1000.0 * HIGH))  # all are read
    narrow = ts.Sensor(construction="crs-m", strips=STRIPS + 1, pitch_mm=8.0, length_mm=150.0, vref_volt=5.0)
    with pytest.raises(Unanswered) as asked:
        proposed(log, narrow)
    assert [(q.key, q.choices) for q in asked.value.questions] == [("strip_base", ("0", "1"))]
    made = values(proposed(log, narrow, strip_base="1"))[:, :, 0]
    np.testing.assert_allclose(made[:, :STRIPS], np.round(1000.0 * HIGH))


def test_empty_fields_of_a_log_of_changes_are_as_before() -> None:
    at_rest = np.stack([np.where(OPEN, 0.0, np.round(end, 1)) for end in (HIGH, LOW)], axis=2).reshape(
        SCANS, -1
    )
    rows = [
        ",".join(
            [
                f"{n * 0.05:.2f}",
                *("" if n and v == last else f"{v:.1f}" for v, last in zip(now, before, strict=True)),
            ]
        )
        for n, (now, before) in enumerate(zip(at_rest, [at_rest[0], *at_rest[:-1]], strict=True))
    ]
    head = ",".join(f"h{s},l{s}" for s in range(STRIPS))
    log = "\n".join([f"t,{head}", *rows, ""])
    assert ",," in log
    found = proposed(log)
    np.testing.assert_array_equal(np.nan_to_num(values(found)).reshape(SCANS, -1), at_rest)
    assert any("as the last one above" in doubt for doubt in found.doubts)


def test_all_lines_of_one_end_may_stand_before_those_of_the_other() -> None:
    rows = [
        f"{end},{n * 0.05:.2f},{s},{text(v[n, s], '-')}"
        for end, v in (("H", HIGH), ("L", LOW)) for n in range(SCANS) for s in range(STRIPS)
    ]  # fmt: skip
    np.testing.assert_allclose(values(proposed("\n".join(["end,t_s,strip,volt", *rows]))), BOTH, atol=1e-4)


def test_a_title_says_that_readings_are_places() -> None:
    parts = ["Position = U/Vref * strip length (15.0 cm);;;;;;"]
    for title, end in (("Upper edge (cm)", HIGH), ("Lower edge (cm)", LOW)):
        parts += [";;;;;;", f"{title};;;;;;", "t (s);" + ";".join(f"Strip {s + 1}" for s in range(STRIPS))]
        parts += [
            ";".join([f"{n * 0.05:.2f}", *(text(end[n, s] * 3.0, "free") for s in range(STRIPS))])
            for n in range(SCANS)
        ]
    found = proposed("\n".join(parts))
    assert found.mapping.unit == "fraction"
    np.testing.assert_allclose(values(found) * found.mapping.scale * 5.0, BOTH, atol=1e-3)


@pytest.mark.parametrize(
    "log",
    [
        json.dumps({"t": list(range(9)), "high": [[2.5, 2.0]] * 9, "low": [[1.5, 1.0]] * 9}),
        f"high = np.array({[[2.5, 2.0]] * 9})\nlow = np.array({[[1.5, 1.0]] * 9})\n",
        "Vh = [\n" + "2.5 2.0;\n" * 9 + "];\nVl = [\n" + "1.5 1.0;\n" * 9 + "];\n",
    ],
)
def test_a_log_that_ends_within_its_second_array_says_so(log: str) -> None:
    of_text(log)
    with pytest.raises(ContradictionError, match=r"the log ends within '(low|Vl)', .*: is the file cut\?"):
        of_text(log[: int(0.85 * len(log))])


@pytest.mark.parametrize(
    "above",
    [
        "# note: (left pad",
        "# zone: (A",
        "label: [OK",
        "# strips: [0, 8) left to right",
        "# h = [2, 3",
        "at: [3",
    ],
)
def test_a_bracket_without_its_end_is_no_cut_array(above: str) -> None:
    rows = [
        json.dumps({"t": 0.05 * n, "h": [*np.nan_to_num(HIGH[n])], "l": [*np.nan_to_num(LOW[n])]})
        for n in range(SCANS)
    ]
    found = proposed("\n".join([above, *rows]), untouched="0")
    np.testing.assert_allclose(values(found), BOTH)


def test_arrays_in_fields_over_several_lines() -> None:
    sensor = ts.Sensor(
        construction="crs-crs", strips=2 * STRIPS, pitch_mm=8.0, length_mm=150.0, vref_volt=5.0
    )
    ends = [np.hstack([end, np.full_like(end, np.nan)]) for end in (HIGH, LOW)]
    rows = [
        f"{n},{n * 0.05:.2f}," + ",".join(f'"{np.array2string(end[n], max_line_width=60)}"' for end in ends)
        for n in range(SCANS)
    ]
    log = "\n".join([",t_s,v_high,v_low", *rows, ""])
    assert log.count("\n") > SCANS + 2
    made = values(proposed(log, sensor))
    np.testing.assert_allclose(made[:, :STRIPS], BOTH, atol=1e-4)
    assert np.isnan(made[:, STRIPS:]).all()


BOOT = {
    "esp-idf": "I (31) boot: ESP-IDF v5.1.2\nI (330) skin: 6 strips [0..5], Vref 5 V\n",
    "zephyr": "*** Booting Zephyr OS build v3.4.0 ***\n",
}


def tagged(kind: str, k: int) -> str:
    """Return what stands before a line, k ms after the first."""
    return f"I ({1000 + k}) skin: " if kind == "esp-idf" else f"[00:00:{1 + k / 1000:06.3f},250] <inf> skin: "


@pytest.mark.parametrize("kind", [*BOOT])
def test_tags_of_a_program_and_how_many_strips_are_touched(kind: str) -> None:
    log = BOOT[kind]
    for n in range(SCANS):
        there = np.flatnonzero(~OPEN[n])
        log += f"{tagged(kind, 50 * n)}scan {n}: {len(there)} touched\n"
        for i, s in enumerate(there):
            log += f"{tagged(kind, 50 * n + i)}[{s}] hi={HIGH[n, s]:.3f} lo={LOW[n, s]:.3f} V\n"
    np.testing.assert_allclose(values(proposed(log, strip_base="0")), BOTH, atol=1e-3)


def test_a_torn_line_is_of_the_scan_whose_heading_stands_above_it() -> None:
    rows: list[str] = []
    for n in range(SCANS):
        there = np.flatnonzero(~OPEN[n])
        rows += [f"--- frame {n} @ 10:11:{10 + n / 20:06.3f}"] if len(there) else []
        rows += [f"  strip {s}: high {HIGH[n, s]:.3f} V  low {LOW[n, s]:.3f} V" for s in there]
    last = next(n for n in range(len(rows) // 2, len(rows)) if rows[n + 1].startswith("---"))
    found = proposed("\n".join([*rows[:last], rows[last][:20], *rows[last + 1 :]]), strip_base="0")
    assert len(found.scans) == sum(row.startswith("---") for row in rows) - 1


def test_names_of_columns_in_a_json_header_beside_digital_ones() -> None:
    head = {
        "00:07:80": {"column": ["nSeq", "O1", *(f"A{s + 1}" for s in range(STRIPS))], "sampling rate": 50}
    }
    rows = [
        "\t".join([str(n % 16), "0", *(text(1000.0 * HIGH[n, s], "0", ".0f") for s in range(STRIPS)), ""])
        for n in range(SCANS)
    ]
    found = proposed(
        "\n".join(["# OpenSignals", f"# {json.dumps(head)}", "# EndOfHeader", *rows, ""]),
        ONE,
        unit="mV",
        untouched="0",
    )
    np.testing.assert_array_equal(
        np.nan_to_num(values(found)[:, :, 0]), np.nan_to_num(np.round(1000.0 * HIGH))
    )
    assert [scan.time_s for scan in found.scans[:3]] == [0.0, 0.02, 0.04]


@pytest.mark.parametrize(("step", "unit"), [(20, "ms"), (20_000, ""), (0.02, ""), (2, "")])
def test_milliseconds_in_a_column_of_seconds_are_doubted(step: float, unit: str) -> None:
    rows = [
        f"{n},{n * step:g},{s},{text(HIGH[n, s])},{text(LOW[n, s])}"
        for n in range(SCANS)
        for s in range(STRIPS)
    ]
    log = "\n".join(["scan,time_s,strip,v_h,v_l", *rows])
    if step > 3600:
        with pytest.raises(Unanswered, match="would rise by 20000 s"):
            proposed(log)
        return
    doubts = [doubt for doubt in proposed(log).doubts if "is the time in milliseconds?" in doubt]
    assert len(doubts) == bool(unit)
    assert not unit or proposed(log, time_unit=unit).scans[1].time_s == 0.001 * step


def test_a_tick_may_be_a_part_of_a_second() -> None:
    log = wide("h{s},l{s}", HIGH, LOW).replace("t_s", "tick", 1).split("\n")
    log[1:-1] = [f"{16 * n},{row.partition(',')[2]}" for n, row in enumerate(log[1:-1])]
    with pytest.raises(Unanswered, match=r"0\.1ms, or 1/1024s of a clock of 1024 Hz"):
        proposed("\n".join(log))
    found = proposed("\n".join(log), time_unit="1/1024s")
    assert found.scans[1].time_s == 16 / 1024
    assert found.mapping.time_unit == "1/1024s"

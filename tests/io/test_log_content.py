"""Logs of which no name and no known form tells what they hold: what a sensor can have read does."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.by_content import of_content
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.plausible import roughness
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=5, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
ROW = ts.Sensor(construction="crs-m", strips=5, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
N, S = range(14), range(5)
HIGH = np.array([[round(3.1 + 0.6 * np.sin(0.5 * n) - 0.09 * s * s / 4, 3) for s in S] for n in N])
LOW = np.round(HIGH - 0.5 + 0.03 * np.arange(5), 3)
OPEN = np.array([[abs(s - 2.0 - 1.9 * np.sin(0.45 * n)) > 1.3 for s in S] for n in N])
HIGH[OPEN] = LOW[OPEN] = np.nan


def field(value: float, nothing: str) -> str:
    return nothing if np.isnan(value) else f"{value:.3f}"


def wide(nothing: str = "oo", between: str = "~") -> list[str]:
    return [
        f"kelo> <{0.1 * n:.1f} s> "
        + " ".join(f"{field(HIGH[n, s], nothing)}{between}{field(LOW[n, s], nothing)}" for s in S)
        for n in N
    ]


def a_line_each(form: str = "ruga> 10:00:{t:06.3f} vaze#{s} {end} = {v}", nothing: str = "NA") -> list[str]:
    return [
        form.format(t=0.1 * n, s=s, end=end, v=field(values[n, s], nothing))
        for n in N for s in S for end, values in (("hi", HIGH), ("lo", LOW))
    ]  # fmt: skip


def blocks() -> list[str]:
    return [
        line
        for n in N
        for line in (f"== tomi {n} {100 * n} ms", *(f"  lera {s} {field(HIGH[n, s], '--')}" for s in S))
    ]


def read(lines: list[str], sensor: ts.Sensor = PAD, **answers: str) -> Proposal:
    return propose(of_text("\n".join(lines) + "\n"), sensor, answers)


def check(found: Proposal, channels: int = 2) -> None:
    values = np.stack([scan.values for scan in found.scans])
    np.testing.assert_allclose(values, np.stack([HIGH, LOW][:channels], axis=2))
    assert [s.time_s - found.scans[0].time_s for s in found.scans] == pytest.approx([0.1 * n for n in N])


@pytest.mark.parametrize("lines", [wide("x"), wide("nan", "|"), a_line_each()], ids=["wide", "bars", "ends"])
def test_a_form_of_no_known_name_is_read_by_what_it_holds(lines: list[str]) -> None:
    check(read(["tude vaze v9.4 ready", "toduna in volts", *lines]))


def test_labels_of_scans_above_their_lines_are_columns_of_these() -> None:
    check(read(["# volts", *blocks()], ROW), 1)


def test_lines_of_one_end_are_no_messages_between_those_of_the_other() -> None:
    lines = a_line_each()
    found = read(["all in volts", *lines])
    assert found.mapping.channels == ("h", "l")


def test_what_is_read_by_its_content_is_told() -> None:
    text = "\n".join(["in volts", *wide("x")])
    table = of_content(text, 5, 2)
    assert table is not None
    assert table.names[:3] == ("time [s]", "h_0 [V]", "l_0 [V]")
    assert "line 2 ('kelo> <0.0 s>" in table.doubts[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda row: np.nan_to_num(row, nan=3.0),  # no contact begins or ends
        lambda row: (
            row[::-1] if np.isfinite(row).sum() > 2 else row
        ),  # no strip is beside the same one for long
    ],
)
def test_what_no_sensor_reads_alone_is_not_taken(change: object) -> None:
    assert callable(change)
    rows = [change(row) for row in HIGH]
    lines = [
        " ".join(f"{0.1 * n:.1f} {'k' * (n % 3)}".split()) + f" {row[0]:.3f}"
        for n, row in zip(N, rows, strict=True)
    ]
    assert of_content("\n".join(lines), 5, 1) is None


def test_columns_of_a_like_size_beside_the_strips_leave_it_open() -> None:
    lines = [
        " ".join(field(v, "nan") for v in (*HIGH[n], 3.0 + 0.01 * (n % 5), 2.9 - 0.02 * (n % 4))) for n in N
    ]
    assert of_content("\n".join(lines), 5, 1) is None


def test_a_line_above_that_numbers_the_strips_otherwise_leaves_it_open() -> None:
    lines = [f"{0.1 * n:.1f};" + ";".join(field(v, "nan") for v in HIGH[n]) for n in N]
    assert of_content("\n".join(["t;a0;a1;a2;a3;a4", *lines]), 5, 1) is not None
    assert of_content("\n".join(["t;a3;a0;a1;a4;a2", *lines]), 5, 1) is None


def test_exchanged_ends_and_scattered_strips_are_not_plausible() -> None:
    assert (roughness(np.stack([HIGH, LOW], axis=2)) or 1.0) < 0.5
    assert roughness(np.stack([LOW, HIGH], axis=2)) is None
    assert roughness(np.stack([HIGH, LOW], axis=2)[:, [0, 2, 4, 1, 3]]) is None


def test_a_line_of_something_else_among_whole_scans_is_set_aside_with_a_warning() -> None:
    lines = [
        "t_s,strip,v_h,v_l",
        *(f"{0.1 * n:.1f},{s},{field(HIGH[n, s], '')},{field(LOW[n, s], '')}" for n in N for s in S),
    ]
    lines.insert(23, "supply: 4.98 V, strip heater 31")
    found = read(lines)
    check(found)
    assert any("line 24 ('supply: 4.98 V" in d for d in found.doubts)
    lost = read([*lines[:30], "0.5,?x", *lines[31:]])  # this one leaves a gap
    assert len(lost.scans) == len(found.scans) - 1
    assert any("line 31 ('0.5,?x')" in d for d in lost.doubts)


def test_strips_that_float_near_0_without_a_gap_are_asked() -> None:
    rng = np.random.default_rng(3)
    rows = np.where(OPEN, rng.uniform(0.0, 0.13, OPEN.shape), 2.0 * (HIGH - HIGH[~OPEN].min()) + 0.07)
    lines = [
        "t_s," + ",".join(f"V{s}" for s in S),
        *(f"{0.1 * n:.1f}," + ",".join(f"{v:.3f}" for v in rows[n]) for n in N),
    ]
    with pytest.raises(Unanswered, match="untouched="):
        read(lines, ROW)


@pytest.mark.parametrize("before", ["[{} ms]", "<2026-11-28T10:02:{:06.3f}>"])
def test_a_word_for_no_contact_in_a_list_behind_a_name_shifts_no_strip(before: str) -> None:
    lines = [f"@rek: {before.format(100 * n if 'ms' in before else 0.1 * n)} " for n in N]
    lines = [line + "rek " + " ".join(field(v, "x") for v in HIGH[n]) for n, line in enumerate(lines)]
    check(read(["# volts", *lines], ROW), 1)


def touched_only(stamp: str, form: str, decimal: str = ".") -> list[str]:
    """Lines of touched strips only, each with its scan's time: a contact that moves down begins below the last one."""
    return [
        f"{stamp.format(10 + 0.1 * n)} {form.format(s=s, end=end, v=f'{values[n, s]:.3f}'.replace('.', decimal))}"
        for n in N for s in S for end, values in (("up", HIGH), ("down", LOW)) if not OPEN[n, s]
    ]  # fmt: skip


@pytest.mark.parametrize(
    "lines",
    [
        touched_only("[26.06.2026 18:30:{:06.3f}]", "strip{s}.{end}: {v}", ","),
        touched_only("2026-06-26T18:30:{:06.3f}", "pad/{s}/{end} {v}"),
        ["t,strip,end,V", *(x.replace(" ", ",") for x in touched_only("{:.1f}", "{s} {end} {v}"))],
    ],
    ids=["named", "paths", "table"],
)
def test_scans_that_share_a_time_are_parted_by_it(lines: list[str]) -> None:
    check(read(lines))


def lists() -> list[str]:
    ends = (("hi", HIGH), ("lo", LOW))
    return [";volts", ";OL = open"] + [
        f"{0.1 * n:.1f} {end}: " + ", ".join(field(v, "OL") for v in values[n])
        for n in N
        for end, values in ends
    ]


def sentences() -> list[str]:
    names = ",".join(f"H{s},L{s}" for s in S)
    rows = [",".join(f"{field(HIGH[n, s], '*')},{field(LOW[n, s], '*')}" for s in S) for n in N]
    return [f"# $TAC,seq,ms,{names}*checksum  volts, * = open"] + [
        f"$TAC,{n},{100 * n},{row}*4D" for n, row in enumerate(rows)
    ]


def named() -> list[str]:
    return [
        f"> t={0.1 * n:.1f}; "
        + "; ".join(f"S{s} (upper)={field(HIGH[n, s], '-')}; S{s} (lower)={field(LOW[n, s], '-')}" for s in S)
        for n in N
    ]


@pytest.mark.parametrize(
    "lines",
    [lists(), a_line_each("10:00:{t:06.3f}: {end} of vako {s} is {v}", "-"), sentences(), named()],
    ids=["lists", "words", "sum", "mark"],
)
def test_marks_and_names_are_told_by_the_log_itself(lines: list[str]) -> None:
    check(read(lines))


def test_strips_may_count_down() -> None:
    check(read([
        line for n in N for line in (
            f"== tomi {n} {100 * n} ms",
            *(f"  lera {s} {field(HIGH[n, s], '--')} {field(LOW[n, s], '--')}" for s in S[::-1]),
        )
    ]))  # fmt: skip


def test_names_that_count_down_are_not_passed_over() -> None:
    names = "$TAC,seq,s," + ",".join(f"{end}{s}" for end in ("upper", "lower") for s in S[::-1])
    rows = [
        f"$TAC,{100 + n},{0.1 * n:.1f},"
        + ",".join(field(values[n, s], "none") for values in (HIGH, LOW) for s in S[::-1])
        for n in N
    ]
    check(read([names, "unit = V", *rows], s="time"))


def test_a_strip_that_is_never_logged_beside_ones_that_always_are_is_asked() -> None:
    rows = [f"{0.1 * n:.1f},{s},{2.0 + 0.1 * s + 0.02 * n:.3f}" for n in N for s in range(4)]
    with pytest.raises(Unanswered, match="no line for strip 4: are strips that are not there untouched"):
        read(["t_s,strip,V_out", *rows], ROW)


def pair(n: int, s: int, between: str = " ", nothing: str = "nan") -> str:
    return f"{field(HIGH[n, s], nothing)}{between}{field(LOW[n, s], nothing)}"


RECORDS = {
    "two converters": lambda n: [
        f"{0.1 * n:.3f} mux{part} " + " ".join(pair(n, s) for s in strips)
        for part, strips in ((1, (0, 1, 2)), (2, (3, 4)))
    ],
    "arrays over two lines": lambda n: [
        f"t={0.1 * n:.1f} "
        + " ".join(
            f"{name}=array([{', '.join(field(a[n, s], 'nan') for s in range(3))},\n    "
            f"{', '.join(field(a[n, s], 'nan') for s in (3, 4))}])"
            for name, a in (("upper", HIGH), ("lower", LOW))
        )
    ],
    "a line for each strip, the last first": lambda n: [
        f"[{0.1 * n:.1f}s]", *(f"  taxel{s + 1}  {pair(n, s)}" for s in reversed(S))
    ],
    "letters and digits": lambda n: [
        f"{0.1 * n:.2f} " + ";".join(f"S{s:02d}H{field(HIGH[n, s], '-----')}L{field(LOW[n, s], '-----')}" for s in S)
    ],
}  # fmt: skip


@pytest.mark.parametrize("form", RECORDS)
@pytest.mark.parametrize("noise", [(), ("heap 21344", "wifi: reconnect")])
def test_lines_that_come_again_in_turn_are_one_record(form: str, noise: tuple[str, ...]) -> None:
    records = ["\n".join(RECORDS[form](n)) for n in N]
    for n, line in enumerate(noise):
        records.insert(3 + 4 * n, line)
    found = propose(of_text("\n".join(["# unit: V", *records])), PAD, {"broken_lines": "skip"})
    values = np.stack([scan.values for scan in found.scans])
    np.testing.assert_allclose(values, np.stack([HIGH, LOW], axis=2))
    np.testing.assert_allclose([scan.time_s for scan in found.scans], 0.1 * np.arange(len(N)), atol=1e-9)


def test_blocks_below_each_other_are_the_two_ends() -> None:
    blocks = [["\t".join(field(v, "NaN") for v in row) for row in a] for a in (HIGH, LOW)]
    text = "\n".join(["# volts, 20 scans/s", "BEGIN", *blocks[0], "END", "BEGIN", *blocks[1], "END"])
    found = propose(of_text(text), PAD)
    np.testing.assert_allclose(np.stack([scan.values for scan in found.scans]), np.stack([HIGH, LOW], axis=2))
    assert found.mapping.rate_hz == 20.0


def test_a_scan_of_touched_strips_that_has_none_is_a_scan() -> None:
    lines = [
        f"t={20 * n} " + (" ".join(f"{s}:{pair(n, s, '/')}" for s in S if not OPEN[n, s]) or "-") for n in N
    ]
    lines[5] = "t=100 -"
    found = propose(of_text("\n".join(lines)), PAD, {"missing": "untouched", "unit": "V", "time_unit": "ms"})
    assert len(found.scans) == len(N)
    assert np.isnan(found.scans[5].values).all()


def test_strips_in_turn_are_one_scan_whatever_their_times_are() -> None:
    lines = [f"I ({1200 + 30 * n + s // 4}) skin: s={s} h={pair(n, s, ' l=')}" for n in N for s in S]
    found = propose(of_text("\n".join(lines)), PAD, {"unit": "V"})
    np.testing.assert_allclose(np.stack([scan.values for scan in found.scans]), np.stack([HIGH, LOW], axis=2))

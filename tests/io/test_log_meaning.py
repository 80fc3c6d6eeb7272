"""What the columns of a log mean: strips by names, senders, units of which nothing is said, and the one question."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.json_records import of_values
from tacstrip.io.log_import.neighbours import order_of_neighbours
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.table import Table
from tacstrip.io.log_import.text import of_text

STRIPS, SCANS = 5, 24
TWO = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=8.0, length_mm=120.0, vref_volt=5.0)
ONE = ts.Sensor(construction="crs-m", strips=STRIPS, pitch_mm=8.0, length_mm=120.0, vref_volt=5.0)
PLC = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=8.0, length_mm=120.0, vref_volt=10.0)
N, S = np.ogrid[:SCANS, :STRIPS]
OPEN = np.abs(N * (STRIPS + 1.0) / SCANS - 1.0 - S) > 1.2  # a contact moves over all strips
LOW = np.where(OPEN, np.nan, 1.0 + 0.07 * N + 0.11 * S + 0.02 * (S % 2))
HIGH = LOW + 0.3 + 0.02 * S
BOTH = np.stack([HIGH, LOW], axis=2)


def read(log: str | Table, sensor: ts.Sensor = TWO, **answers: str) -> np.ndarray:
    """Return readings (scans, strips, channels) in the log's unit."""
    table = log if isinstance(log, Table) else of_text(log)
    return np.stack([scan.values for scan in propose(table, sensor, answers).scans])


def asked(log: str | Table, sensor: ts.Sensor = TWO) -> dict[str, tuple[str, ...]]:
    """Return the questions' keys, and the answers offered."""
    with pytest.raises(Unanswered) as open_:
        read(log, sensor)
    return {q.key: q.choices for q in open_.value.questions}


def of_json(log: dict[str, object]) -> Table:
    """Return the table of a log in JSON."""
    table = of_values(json.loads(json.dumps(log)), "log")
    assert table is not None
    return table


def lines(of: Callable[[int, int], str], order: tuple[int, ...] = tuple(range(STRIPS))) -> list[str]:
    """Return a line for each touched strip of each scan, strips in an order."""
    return [of(n, s) for n in range(SCANS) for s in order if not OPEN[n, s]]


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("t_s,scan,wire,v_h,v_l", lambda n, w, h, lo: f"{n / 20:.2f},{n},{w},{h},{lo}"),
        ("scan;Leitung;oben [V];unten [V]", lambda n, w, h, lo: f"{n};{w};{h};{lo}"),
    ],
)
def test_strips_called_by_the_colours_of_wires_are_put_where_neighbours_are_touched_together(
    head: str, row: Callable[[int, str, str, str], str]
) -> None:
    names = ("rot", "blau", "weiss", "gelb", "lila")
    said = lines(lambda n, s: row(n, names[s], f"{HIGH[n, s]:.3f}", f"{LOW[n, s]:.3f}"), (3, 0, 4, 2, 1))
    choices = asked("\n".join([head, *said]))
    assert choices == {"strip_order": (",".join(names), ",".join(names[::-1]))} or choices == {
        "strip_order": (",".join(names[::-1]), ",".join(names))
    }
    values = read("\n".join([head, *said]), strip_order=",".join(names))
    np.testing.assert_allclose(values, BOTH[~OPEN.all(axis=1)], atol=1e-3)
    with pytest.raises(ts.OptionError, match="list each of"):
        read("\n".join([head, *said]), strip_order="rot,blau")


def test_columns_called_by_the_colours_of_wires_are_offered_in_both_orders() -> None:
    names = ["red", "blue", "white", "grey", "pink", "LIMIT"]
    rows = [
        ",".join([*(f"{0.0002 if OPEN[n, s] else LOW[n, s]:.4f}" for s in range(STRIPS)), "1"])
        for n in range(SCANS)
    ]
    text = "\n".join(["time_s," + ",".join(names), *(f"{n / 10:.1f},{row}" for n, row in enumerate(rows))])
    assert asked(text, ONE)["readings"][:2] == ("red..pink", "pink..red")
    there = read(text, ONE, readings="pink..red", untouched="<0.5")
    np.testing.assert_allclose(there[..., 0], LOW[:, ::-1], atol=1e-3)


@pytest.mark.parametrize("words", [("left", "middle", "right"), ("links", "Mitte", "rechts")])
def test_three_strips_called_left_and_right_and_another(words: tuple[str, ...]) -> None:
    sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=8.0, length_mm=120.0, vref_volt=5.0)
    rows = [",".join("" if OPEN[n, s] else f"{LOW[n, s]:.3f}" for s in (1, 2, 0)) for n in range(SCANS)]
    head = ",".join(["time_s", *(f"strip {words[s]}" for s in (1, 2, 0)), "noise"])
    text = "\n".join([head, *(f"{n / 10:.1f},{row},{40 + n * 7 % 5}" for n, row in enumerate(rows))])
    np.testing.assert_allclose(read(text, sensor, unit="V")[..., 0], LOW[:, :3], atol=1e-3)


def test_order_of_neighbours_keeps_strips_that_nothing_tells_apart() -> None:
    assert order_of_neighbours(np.full((4, 3, 1), np.nan)) == [0, 1, 2]


@pytest.mark.parametrize("form", ["glove/{}/strip{}/{}", "lab7/{}/skin/{}/v{}"])
def test_topics_of_several_senders_are_one_question(form: str) -> None:
    said = [
        f"2026-03-04T10:00:{n:02d}+0100 {form.format(hand, s, end)} {'nan' if OPEN[n, s] else f'{v[n, s] + more:.3f}'}"
        for n in range(SCANS) for hand, more in (("left", 0.0), ("right", 0.5))
        for s in range(STRIPS) for end, v in (("h", HIGH), ("l", LOW))
    ]  # fmt: skip
    assert asked("\n".join(said))["source"][:2] == ("left", "right")
    np.testing.assert_allclose(read("\n".join(said), source="left"), BOTH, atol=1e-3)


@pytest.mark.parametrize("haut", ["Haut_Streifen{:02d}_U{}", "Top_Strip{}_v{}"])
def test_a_word_of_an_end_that_all_names_have_says_nothing(haut: str) -> None:
    said = [
        f"{haut.format(s + 1, end)};2026-03-04 10:00:{n:02d};"
        + ("0;0" if OPEN[n, s] else f"{v[n, s]:.3f};1".replace(".", ","))
        for n in range(SCANS) for s in range(STRIPS) for end, v in (("H", HIGH), ("L", LOW))
    ]  # fmt: skip
    values = read("\n".join(["VarName;TimeString;VarValue;Validity", *said]))
    np.testing.assert_allclose(values, BOTH, atol=1e-3)


def test_a_flag_that_changes_where_something_touches_is_asked() -> None:
    said = lines(lambda n, s: f"{n / 10:.1f},{s},{HIGH[n, s]:.3f},{LOW[n, s]:.3f},{int(n != 9)}")
    assert "Validity" in asked("\n".join(["time_s,strip,v_h,v_l,Validity", *said]))


def test_labels_in_angle_brackets_tell_the_strips_and_not_the_inputs() -> None:
    names = [f"{101 + n} <Strip {'ABCDE'[n // 2]} {('hi', 'lo')[n % 2]}> (VDC)" for n in range(2 * STRIPS)]
    rows = [
        ",".join([f"{n / 2:.1f}", *("" if np.isnan(v) else f"{v:.4f}" for v in BOTH[n].ravel())])
        for n in range(SCANS)
    ]
    np.testing.assert_allclose(read("\n".join([",".join(["Time (s)", *names]), *rows])), BOTH, atol=1e-3)


def test_dated_lines_are_put_in_the_order_of_time_and_left_out_where_they_stand_twice() -> None:
    said = lines(lambda n, s: f"2026-03-04 10:00:{n:02d}.000,{s},{HIGH[n, s]:.3f},{LOW[n, s]:.3f}")
    for n in range(3, len(said) - 9, 6):
        said[n], said[n + 4] = said[n + 4], said[n]
    said.insert(20, said[11])
    found = propose(of_text("\n".join(["ts,strip,v_h,v_l", *said])), TWO, {"strip_base": "0"})
    np.testing.assert_allclose(
        np.stack([s.values for s in found.scans]), BOTH[~OPEN.all(axis=1)], atol=1e-3, equal_nan=True
    )
    assert any("order of time" in d for d in found.doubts)
    assert any("again" in d for d in found.doubts)


@pytest.mark.parametrize("named", ["y_low [{}]|y_high [{}]", "from_{}|to_{}"])
def test_places_along_the_strip_by_a_formula_and_the_length_beside_it(named: str) -> None:
    low, high = named.format("cm", "cm").split("|")
    frames = [
        {"t_ms": 50 * n, "touches": [
            {"strip": s, low: LOW[n, s] * 2.4, high: HIGH[n, s] * 2.4} for s in range(STRIPS) if not OPEN[n, s]
        ]}
        for n in range(SCANS)
    ]  # fmt: skip
    settings = {"length_cm": 12.0, "note": "cm = V / Vref * length"}
    found = propose(of_json({"settings": settings, "frames": frames}), TWO, {"strip_base": "0"})
    np.testing.assert_allclose(
        np.stack([s.values for s in found.scans]) * found.mapping.scale * 5.0, BOTH, atol=1e-3
    )
    assert "unit" in asked(of_json({"settings": settings | {"length_cm": 15.0}, "frames": frames}))


def test_a_time_that_runs_as_dates_do_in_one_unit_only_is_in_it() -> None:
    rows = [",".join("" if np.isnan(v) else f"{v:.3f}" for v in BOTH[n].ravel()) for n in range(SCANS)]
    head = "Time_ms,Date," + ",".join(f"S{s} {e}" for s in range(STRIPS) for e in "hl")
    said = [f"{4.5e10 + 2 * n / 0.0864:.4f},2026-03-04 10:00:{2 * n:02d},{row}" for n, row in enumerate(rows)]
    found = propose(of_text("\n".join([head, *said])), TWO)
    np.testing.assert_allclose(np.diff([s.time_s for s in found.scans]), 2.0, atol=1e-3)
    assert any("86.4ms" in d for d in found.doubts)


def test_ticks_and_full_scales_are_offered_as_they_are_in_use() -> None:
    codes = np.where(OPEN, 0, np.nan_to_num(LOW)) / 3.2 * 25000
    head = "tick," + ",".join(f"AI_{e}{s + 1}" for s in range(STRIPS) for e in "HL")
    said = [
        f"{2 * n}," + ",".join(f"{round(c + e)}" for c in codes[n] for e in ((900, 0) if c else (0, 0)))
        for n in range(SCANS)
    ]
    choices = asked("\n".join([head, *said]), PLC)
    assert choices["time_unit"] == ("ms", "10ms")
    assert choices["unit"][:2] == ("16bit", "1/27648")
    found = propose(of_text("\n".join([head, *said])), PLC, {"time_unit": "10ms", "unit": "1/27648"})
    assert found.mapping.unit == "fraction"
    assert found.mapping.scale == pytest.approx(1 / 27648)


@pytest.mark.parametrize("gain", ["gain 1 (+-4.096 V)", "gain: x1, 128 SPS"])
def test_a_gain_of_one_multiplies_nothing(gain: str) -> None:
    said = lines(lambda n, s: f"{n / 10:.1f},{s},{HIGH[n, s]:.3f},{LOW[n, s]:.3f}")
    text = "\n".join([f"# ADS1115 {gain}", "time_s,strip,v_h [V],v_l [V]", *said])
    np.testing.assert_allclose(read(text, strip_base="0"), BOTH[~OPEN.all(axis=1)], atol=1e-3)
    assert "scale" in asked(text.replace("1 (+", "2 (+").replace("x1", "x2"))


def test_ends_that_are_little_apart_are_told_by_their_sign() -> None:
    rows = [
        ",".join(
            "" if OPEN[n, s] else f"{LOW[n, s] + d:.4f}"
            for s in range(STRIPS)
            for d in (0.004 + 0.001 * s, 0)
        )
        for n in range(SCANS)
    ]
    head = "time_s," + ",".join(f"pasek {s + 1} U{e} [V]" for s in range(STRIPS) for e in "gd")
    values = read("\n".join([head, *(f"{n / 10:.1f},{row}" for n, row in enumerate(rows))]))
    np.testing.assert_allclose(values[..., 1], LOW, atol=1e-3)


def test_a_daemon_that_starts_again_says_the_same_again() -> None:
    head = "Nov 14 10:12:0{}.5 rpi skind[{}]: opening the port, 5 strips, Vref 5.000 V"
    said = [
        f"{n / 10:.1f},{s},{HIGH[n, s]:.3f},{LOW[n, s]:.3f}"
        for n in range(SCANS)
        for s in range(STRIPS)
        if not OPEN[n, s]
    ]
    text = "\n".join(
        [head.format(1, 812), "time_s,strip,v_h,v_l", *said[:30], head.format(7, 1071), *said[30:]]
    )
    assert "part" not in of_text(text).names


def test_a_row_without_a_time_is_no_scan_though_another_row_stands_twice() -> None:
    rows = [
        f"{n / 10:.1f}," + ",".join("" if np.isnan(v) else f"{v:.3f}" for v in BOTH[n].ravel())
        for n in range(SCANS)
    ]
    rows = [*rows[:9], *rows[8:], "," + ",".join(["1.700", "1.200"] * STRIPS)]
    head = "time_s," + ",".join(f"S{s} {e} [V]" for s in range(STRIPS) for e in "hl")
    with pytest.raises(Unanswered, match="leave them out"):
        read("\n".join([head, *rows]))
    np.testing.assert_allclose(read("\n".join([head, *rows]), broken_lines="skip"), BOTH, atol=1e-3)

"""Logs of several runs, of scans among each other, of a unit that changes, and of scans in a table of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
N, S = range(8), range(4)
HIGH = np.array([[2.9 + 0.061 * s - 0.047 * n for s in S] for n in N])
LOW = HIGH - np.array([[0.7 + 0.031 * s - 0.017 * n for s in S] for n in N])
OPEN = np.array([[n in (0, 7) or s > 1 + n // 3 or s < n // 5 for s in S] for n in N])
HIGH[OPEN] = LOW[OPEN] = np.nan


def volts(value: float, nothing: str = "", times: float = 1.0) -> str:
    return nothing if np.isnan(value) else f"{times * value:.3f}"


def read(text: str, sensor: ts.Sensor = PAD, **answers: str) -> Proposal:
    return propose(of_text(text + "\n"), sensor, answers)


def assert_read(found: Proposal, step_s: float = 0.1) -> None:
    values = np.stack([s.values for s in found.scans])
    np.testing.assert_allclose(values, np.stack([HIGH, LOW], axis=-1), atol=6e-4)
    times = np.array([s.time_s for s in found.scans])
    np.testing.assert_allclose(times - times[0], step_s * np.arange(len(N)), atol=1e-9)


WIDE = "t [s]," + ",".join(f"h{s} [V],l{s} [V]" for s in S)
LONG = "scan,t [s],strip,vh [V],vl [V]"


def wide(n: int, at: float, times: float = 1.0) -> str:
    return f"{at:g}," + ",".join(volts(v, "", times) for s in S for v in (HIGH[n, s], LOW[n, s]))


def test_a_run_below_names_that_come_again_goes_on_with_a_warning() -> None:
    found = read("\n".join(x for n in N for x in ([WIDE] if n in (0, 5) else []) + [wide(n, 0.1 * (n % 5))]))
    assert_read(found)
    assert any("begins anew" in doubt for doubt in found.doubts)


def test_lines_of_scans_among_each_other_are_sorted_by_their_number() -> None:
    rows = [(n, s) for n in N for s in S]
    rows = [rows[i] for i in np.argsort([4 * n + 3 * s for n, s in rows], kind="stable")]
    body = [f"{n},{0.1 * n:g},{s},{volts(HIGH[n, s])},{volts(LOW[n, s])}" for n, s in rows]
    assert_read(read("\n".join([LONG, *body])))


def test_a_unit_that_a_line_says_to_change_is_taken_with_a_warning() -> None:
    lines = [wide(n, 0.1 * n, 1.0 if n < 4 else 1000.0) for n in N]
    head = ["# volts", WIDE.replace(" [V]", "")]
    found = read("\n".join([*head, *lines[:4], "# now in millivolts, new sketch", *lines[4:]]))
    assert_read(found)
    assert any("below it are taken in mV" in doubt for doubt in found.doubts)


def test_means_beside_extremes_are_the_readings() -> None:
    head = "t [s],strip," + ",".join(f"{e}_{k} [V]" for e in ("vh", "vl") for k in ("mean", "min", "max"))
    body = [
        f"{0.1 * n:g},{s},"
        + ",".join(volts(v + d) for v in (HIGH[n, s], LOW[n, s]) for d in (0, -0.01, 0.01))
        for n in N
        for s in S
    ]
    assert_read(read("\n".join([head, *body])))


def test_readings_refer_to_scans_in_a_table_of_their_own(tmp_path: Path) -> None:
    scans = "\n".join(f"INSERT INTO scan VALUES({90 + n},{100 * n});" for n in N)
    rows = [(n, s, e, v) for n in N for s in S for e, v in (("top", HIGH), ("bottom", LOW)) if not OPEN[n, s]]
    body = "\n".join(
        f"INSERT INTO r VALUES({i},{90 + n},{s},'{e}',{v[n, s]:.3f});" for i, (n, s, e, v) in enumerate(rows)
    )
    made = "CREATE TABLE scan (id INTEGER, t_ms INTEGER);\n{}\n"
    made += "CREATE TABLE r (id INTEGER, scan INTEGER, strip INTEGER, side TEXT, volts REAL);\n{}\n"
    path = tmp_path / "log.sql"
    path.write_text(made.format(scans, body))
    assert_read(propose(read_table(path), PAD, {}))


@pytest.mark.parametrize("nothing", ["--mV", "-- mV"])
def test_a_mark_with_a_unit_is_no_scan_that_is_lost(nothing: str) -> None:
    lines = [
        f"I ({100 * n}) PAD: S{s} top={volts(HIGH[n, s], nothing, 1000) + 'mV' * (not OPEN[n, s])}"
        f" bot={volts(LOW[n, s], nothing, 1000) + 'mV' * (not OPEN[n, s])}"
        for n in N
        for s in S
    ]
    found = read("\n".join(lines))
    assert len(found.scans) == len(N)


def test_strips_are_listed_in_the_order_of_their_wires() -> None:
    order = (2, 0, 3, 1)
    head = "t [s]," + ",".join(f"C{k}_{e} [V]" for k in S for e in "hl")
    lines = [f"{0.1 * n:g}," + ",".join(volts(v[n, s]) for s in order for v in (HIGH, LOW)) for n in N]
    assert_read(read("\n".join(["# mux order as on the board", head, *lines]), strip_order="2,0,3,1"))
    with pytest.raises(ts.OptionError, match="each of 4 strips once"):
        read("\n".join([head, *lines]), strip_order="2,0,3,3")

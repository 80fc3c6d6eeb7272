"""Tables on their side, cells over several rows, what a database prints around them, series and tagged lines."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.decoding import decoded
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
SCANS = range(6)
V = np.array([[[2.0 + 0.3 * s + 0.01 * n, 1.0 + 0.2 * s + 0.01 * n] for s in range(4)] for n in SCANS])
V[:, 0] = np.nan
V[0, 3] = np.nan


def cell(value: float, empty: str = "") -> str:
    """Return a value as a field."""
    return empty if np.isnan(value) else f"{value:.3f}"


def read(text: str, **answers: str) -> tuple[np.ndarray, list[float]]:
    """Return the readings, by scan, strip and channel, and the times."""
    found = propose(of_text(text), PAD, answers).scans
    return np.stack([s.values for s in found]), [s.time_s for s in found]


@pytest.mark.parametrize(
    ("times", "label", "by"),
    [
        ("t={s:.2f}s", "strip {s} {e} [V]|H|L", ","), ("T{ms}ms", "bande {s} {e} (V)|haut|bas", ";"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("grouped", [False, True])
def test_a_table_on_its_side_is_turned(times: str, label: str, by: str, grouped: bool) -> None:
    word, *ends = label.split("|")
    at = [(s, e) for e in (0, 1) for s in range(4)] if grouped else [(s, e) for s in range(4) for e in (0, 1)]
    lines = [by.join(["channel [V]", *(times.format(ms=50 * n, s=0.05 * n) for n in SCANS)])]
    lines += [
        by.join([word.format(s=s + 1, e=ends[e]), *(cell(V[n, s, e], "open") for n in SCANS)]) for s, e in at
    ]
    found, at_s = read("Notes" + by + "lab 2\n" + "\n".join(lines) + "\n")
    assert found == pytest.approx(V, nan_ok=True)
    assert at_s == pytest.approx([0.05 * n for n in SCANS])


def test_columns_that_do_not_rise_are_no_times() -> None:
    text = "channel,5 ms,3 ms,4 ms,9 ms\n" + "".join(
        f"strip {s} {e},1,2,1,2\n" for s in range(4) for e in "HL"
    )
    with pytest.raises((Unanswered, ts.ReadingError)):
        read(text)


@pytest.mark.parametrize("over", ["time", "strip"])
def test_cells_that_span_rows_are_filled_down(over: str) -> None:
    rows = []
    for a in SCANS if over == "time" else range(4):
        for k, b in enumerate(range(4) if over == "time" else SCANS):
            n, s = (a, b) if over == "time" else (b, a)
            both = (
                "<td colspan=2>-</td>"
                if np.isnan(V[n, s, 0])
                else "".join(f"<td>{cell(v)}</td>" for v in V[n, s])
            )
            lead, own = (f"{0.05 * n:.2f}", str(s + 1)) if over == "time" else (str(s + 1), f"{0.05 * n:.2f}")
            many = 4 if over == "time" else len(SCANS)
            rows.append(
                "<tr>"
                + (f'<td rowspan="{many}">{lead}</td>' if k == 0 else "")
                + f"<td>{own}</td>{both}</tr>"
            )
    first, second = ("t [s]", "strip") if over == "time" else ("strip", "t [s]")
    text = f"<table><tr><th>{first}</th><th>{second}</th><th>high [V]</th><th>low [V]</th></tr>{''.join(rows)}</table>"
    found, at_s = read(text)
    assert found == pytest.approx(V, nan_ok=True)
    assert at_s == pytest.approx([0.05 * n for n in SCANS])


def test_series_of_which_the_first_has_one_line_are_sorted() -> None:
    lines = ["time,value,end,strip"]
    for e, end in enumerate(("high", "low")):
        for s in (3, 1, 2):
            at = SCANS if s < 3 else (2,)
            lines += [f"{0.05 * n:.2f},{V[n, s, e]:.3f},{end},{s + 1}" for n in at]
    found, at_s = read("\n".join(lines) + "\n", missing="untouched")
    assert found[:, 1:3] == pytest.approx(V[:, 1:3])
    assert np.isfinite(found[:, 3]).all(axis=1).tolist() == [n == 2 for n in SCANS]
    assert at_s == pytest.approx([0.05 * n for n in SCANS])


def test_two_tags_that_number_strips_are_not_merged() -> None:
    lines = []
    for n in SCANS:
        for tag, more in (("LEFT", 0.0), ("RIGHT", 0.5)):
            lines += [f"{tag},{50 * n},{s},{2.5 + more + 0.01 * n:.3f},{1.5 + more:.3f}" for s in range(4)]
    with pytest.raises((Unanswered, ts.ReadingError)):
        read("\n".join(lines) + "\n")


def test_words_of_central_europe_tell_their_encoding(tmp_path: object) -> None:
    path = tmp_path / "log.csv"  # type: ignore[operator]
    path.write_bytes("kanał;góra;dół\n".encode("cp1250"))
    assert decoded(path) == "kanał;góra;dół\n"
    path.write_bytes("Fläche 5 cm³; dò³\n".encode("cp1252"))
    assert "cm³" in decoded(path)

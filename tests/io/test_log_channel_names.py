"""Channels that are named in a row or a table above the readings, in whichever order."""

from __future__ import annotations

import json

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
SCANS = range(6)
V = np.array([[[2.0 + 0.3 * s + 0.01 * n, 1.0 + 0.2 * s + 0.01 * n] for s in range(4)] for n in SCANS])
ORDERS = {
    "up": [(s, e) for s in range(4) for e in (0, 1)],
    "down": [(s, e) for s in (3, 2, 1, 0) for e in (0, 1)],
    "mixed": [(s, e) for e in (1, 0) for s in (2, 0, 3, 1)],
}
HEADS = {
    "row": "Recorder,X\nTag,{names}\nCh,{channels}\n\nt [s],{channels}\n",
    "row, units": '"Comment",{names}\n"Range",{ranges}\n\n"t [s]",{units}\n',
    "row alone": "Channel,{channels}\nDescription,{names}\nunit_string,{volts}\n\n",
    "table": "Channel,Name,Function,Range,Scale,Gain\n{table}\n\nt [s],{numbered}\n",
    "comments": "# wiring\n{comments}\nt [s],{channels}\n",
}


def log(head: str, order: str, word: str = "strip {s} {e}", ends: tuple[str, str] = ("top", "bottom")) -> str:
    """Return a log whose columns stand in an order that only lines above tell."""
    at = ORDERS[order]
    names = [word.format(s=s + 1, e=ends[e]) for s, e in at]
    channels = [f"CH{n + 1}" for n in range(8)]
    text = HEADS[head].format(
        names=",".join(names), channels=",".join(channels), ranges=",".join(["10 V"] * 8), volts=",".join(["V"] * 8),
        units=",".join(f"{c} [V]" for c in channels), numbered=",".join(f"{n + 101} (VDC)" for n in range(8)),
        table="\n".join(f"{n + 101},{name},DC Voltage,10 V,No,1" for n, name in enumerate(names)),
        comments="\n".join(f"# {c}: {name}" for c, name in zip(channels, names, strict=True)),
    )  # fmt: skip
    return text + "".join(
        f"{0.1 * n:.1f}," + ",".join(f"{V[n, s, e]:.3f}" for s, e in at) + "\n" for n in SCANS
    )


def values(text: str, **answers: str) -> np.ndarray:
    """Return the readings, by scan, strip and channel."""
    return np.stack([s.values for s in propose(of_text(text), PAD, answers).scans])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("head", HEADS)
def test_channels_have_the_names_that_stand_above(head: str, order: str) -> None:
    answers = {"rate_hz": "10"} if head == "row alone" else {}
    assert values(log(head, order), **answers) == pytest.approx(V)


@pytest.mark.parametrize(
    ("word", "ends"),
    [
        ("Streifen {s} {e}", ("oben", "unten")), ("bande {s} {e}", ("haut", "bas")), ("{s}.{e}", ("H", "L")),
        ("pasek {s} {e}", ("góra", "dół")), ("条{s}{e}", ("上", "下")), ("U_{e}{s}", ("hi", "lo")),
    ],
)  # fmt: skip
def test_names_are_of_any_language(word: str, ends: tuple[str, str]) -> None:
    assert values(log("row, units", "down", word, ends)) == pytest.approx(V)
    assert values(log("table", "mixed", word, ends)) == pytest.approx(V)


def test_names_above_the_readings_that_tell_strips_stay() -> None:
    named = ",".join(f"h{s + 1},l{s + 1}" for s, e in ORDERS["up"] if not e)
    text = "t [s]," + named + "\n" + "".join(log("row", "up").splitlines(keepends=True)[5:])
    assert values("Note," + named.replace("h1,l1", "h4,l4") + "\n" + text) == pytest.approx(V)


def test_strips_told_of_channels_that_are_not_to_be_matched_are_a_doubt() -> None:
    text = "".join(f"Kanal {n} = Streifen {5 - n} oben\n" for n in range(1, 5)) + "(unten ebenso)\nt [s],"
    text += ",".join(f"Kanal {n} {e} [V]" for e in "ou" for n in range(1, 5)) + "\n"
    for n in SCANS:
        text += f"{n / 10}," + ",".join(f"{v:.3f}" for v in V[n].T.ravel()) + "\n"
    assert any("Kanal 1 = Streifen 4" in d for d in propose(of_text(text), PAD).doubts)


_HEAD = "t," + ",".join(f"AI{n} (V)" for n in range(8)) + "\n"
_FOUR = _HEAD + "".join(
    f"{0.1 * n:.1f}," + ",".join(f"{2.0 + 0.1 * n + 0.01 * s:.3f}" for s in range(4)) + ","
    + ",".join(f"{1.0 + 0.1 * n + 0.01 * s:.3f}" for s in range(4)) + "\n" for n in range(5)
)  # fmt: skip


@pytest.mark.parametrize(
    ("note", "told"),
    [
        ("AI0-AI3 = upper ends of strips 4-1, AI4-AI7 = lower ends of strips 4-1", True),
        ("AI0-AI3: obere Enden der Streifen 4 bis 1", True),
        ("AI0 = upper end of strip 4; AI3 = upper end of strip 1", True),
        ("AI0/AI4 = strip 3 upper/lower; AI1/AI5 = strip 1 upper/lower; AI2/AI6 = strip 4 upper/lower", True),
        ("AI0-AI3 = upper ends of strips 1-4, AI4-AI7 = lower ends of strips 1-4", False),
        ("AI0/AI4 = strip 1 upper/lower; AI1/AI5 = strip 2 upper/lower", False),
        ("Range AI0: channel 4 mode 1", False),
    ],
)
def test_an_order_of_strips_that_only_a_note_tells_is_a_doubt(note: str, told: bool) -> None:
    table = of_text(f"Logger\nNotes: {note}\n{_FOUR}")
    doubts = [d for d in table.doubts if "strips are taken in the order of the columns" in d]
    assert len(doubts) == told


def test_names_of_fields_in_another_part_of_a_document_name_the_columns() -> None:
    fields = {f"field{n + 1}": f"strip {4 - n // 2} {('high', 'low')[n % 2]}" for n in range(8)}
    feeds = [
        {"t": 0.1 * n} | {f"field{i + 1}": 2.0 + 0.1 * n - 0.5 * (i % 2) for i in range(8)} for n in range(4)
    ]
    table = of_text(json.dumps({"channel": fields, "feeds": feeds}))
    assert table.names == ("t", *fields.values())

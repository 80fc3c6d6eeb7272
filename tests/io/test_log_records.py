"""Records within records: what is empty has the parts of its neighbours, and a small text makes no large table."""

from __future__ import annotations

import json

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.table import flattened, of_records
from tacstrip.io.log_import.text import of_text


def test_what_is_empty_has_the_parts_of_its_neighbours_only() -> None:
    records = [
        {"a": {"0": {"h": 2.0, "l": {"v": 1}}, "1": {"h": None, "l": None}, "2": None}, "b": {"3": {"x": 1}}}
    ]
    table = of_records([flattened("", r) for r in records], [1])
    assert table.names == ("a.0.h", "a.0.l.v", "a.1.h", "a.1.l", "a.2.h", "a.2.l", "a.2.l.v", "b.3.x")
    assert table.rows == [["2", "1", "", "", "", "", "", "1"]]


def test_empty_places_do_not_multiply_the_names_of_other_lists() -> None:
    scan = {str(n): {"h": 2, "l": 1} if n < 5 else None for n in range(8)}
    found = of_records([flattened("", [{"t": n, "s": scan} for n in range(40)])], [1])
    assert len(found.names) == 40 * (1 + 8 * 2)


def _within(levels: int) -> object:
    return {"f": _within(levels - 1), **{f"h{n}": None for n in range(9)}} if levels else 1


@pytest.mark.parametrize(
    ("records", "said"),
    [
        ([{f"{n / 50}": [2.1, 1.0]} for n in range(1500)], "nearly empty"),
        ([{"t": n, "s": _within(9)} for n in range(3)], "nearly empty"),
        (
            [{"t": n, "s": [None] * 700 + [{f"k{n}": 1 for n in range(700)}]} for n in range(2)],
            "nearly empty",
        ),
        ([{"t": n, "s": json.loads("[" * 60 + "1" + "]" * 60)} for n in range(2)], "32 levels"),
    ],
    ids=["a name of its own each", "nested", "of two lengths", "deep"],
)
def test_a_small_text_of_many_names_is_refused(records: list[object], said: str) -> None:
    with pytest.raises(ts.ReadingError, match=said):
        of_text("\n".join(map(json.dumps, records)))


@pytest.mark.parametrize("word", ["untouched", "released", "no contact", "open", "none", "free"])
def test_words_in_place_of_all_named_values(word: str) -> None:
    two = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
    lines = [
        f"scan={i} strip={s} " + (f"h/Vref=0.{46 + i} l/Vref=0.{31 + s}" if s < 2 else word)
        for i in range(6)
        for s in range(3)
    ]
    found = propose(of_text("\n".join(lines)), two, {"rate_hz": "10"}).scans
    np.testing.assert_allclose(found[5].values, [[0.51, 0.31], [0.51, 0.32], [np.nan, np.nan]])


@pytest.mark.parametrize(
    ("said", "turned"), [("high end, low end", False), ("low end, high end", True), ("", False)]
)
def test_groups_of_a_strip_and_two_values(said: str, turned: bool) -> None:
    two = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
    pairs = [[(2.5 + i / 10, 1.5 + s / 10)[:: -1 if turned else 1] for s in range(3)] for i in range(6)]
    lines = [
        f"{20 * i}ms | " + " | ".join(f"{s}: {a:.3f}V {b:.3f}V" for s, (a, b) in enumerate(row))
        for i, row in enumerate(pairs)
    ]
    answers = {} if said else {"order": "alternating"}
    found = propose(of_text("\n".join([f"# per strip: {said}"] * bool(said) + lines)), two, answers).scans
    np.testing.assert_allclose(found[3].values, [[2.8, 1.5], [2.8, 1.6], [2.8, 1.7]])
    assert found[3].time_s == pytest.approx(0.06)

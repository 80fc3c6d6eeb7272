"""A column that tells several sensors apart, whose lines are in one log: which is meant is asked."""

from __future__ import annotations

import itertools
import re
from collections import Counter

from tacstrip.io.log_import.fields import clock_seconds, is_date, number_of
from tacstrip.io.log_import.names import (
    Meaning,
    is_other_unit,
    meaning,
    pair_of,
)
from tacstrip.io.log_import.questions import ROLES, Clues
from tacstrip.io.log_import.table import CLOCK, PART, ROW, SHEET
from tacstrip.io.log_import.words import names_of

_ALONE = 0.9  # of the readings of one end: so many have the other beside them
_SENSORS = frozenset(names_of("sensors"))
# What names the sender of a line or message, or its kind.
_SOURCES = frozenset(names_of("senders"))
_SIZES = frozenset(names_of("sizes"))
_QUANTITY = re.compile(r"([-+]?\d+(?:[.,]\d+)?)\s?([^\s\d]\S{0,7})")
_MOST_SENSORS, _FEW_COUNTED = 12, 2


def ask_for_sensor(clues: Clues, known: dict[str, Meaning]) -> None:
    """Ask which sensor's lines are meant, where a column names several: "pad", or one that tells equal lines apart."""
    table = clues.table
    one = {m.channel for m in known.values() if m.role == "reading"}
    single = clues.expected == ("out",) or {"h", "l"} <= one or bool(len(one) == 2 and pair_of(one))
    pairs = {n: there for n in table.names if len(there := {*table.column(n)}) == 2}
    ends = [n for n, there in pairs.items() if {meaning(f).channel for f in there} == {"h", "l"}]
    single |= bool(ends)
    named = {n for n, m in known.items() if m.role in ("time", "scan", "strip") and n != CLOCK}
    numbered = any(m.role == "strip" or m.strip is not None for m in known.values())
    of = [n for n in table.names if n in named]
    keys = list(zip(*(table.column(n) for n in of), strict=True)) if of else []
    when = list(zip(*(table.column(n) for n in of if known[n].role != "strip"), strict=True))
    read = [table.places[n] for n, m in known.items() if m.role == "reading"]
    holds = [
        any(row[p] for p in read) for row in table.rows
    ]  # else lines of another device, which is no choice
    for name in table.names:
        fields = table.column(name)
        values = sorted({f for f, there in zip(fields, holds, strict=True) if there or not read})
        worded = not any(number_of(v, table.decimal) is not None for v in values)
        if (
            known[name].role in ("time", "strip", "position", "skip") or (known[name].role == "scan" and not worded)
            or name in (*clues.answers, ROW, CLOCK, PART, SHEET)
            or not 1 < len(values) <= _MOST_SENSORS or not all(values) or {*values} & {*ROLES}
            or (known[name].role == "reading" and known[name].strip is not None)
            or all(clock_seconds(v) is not None or is_date(v) for v in values)
            or _rise_with_scans(fields, when) or _are_quantities(values)
            or name in ends
        ):  # fmt: skip
            continue
        each = Counter(zip(keys, fields, strict=True)) if keys else Counter()
        apart = (
            bool(each) and set(each.values()) == {1} and len(each) >= _ALONE * len(values) * len(set(keys))
        )
        words = set(re.findall(r"[a-z]+", name.casefold()))
        called = _SENSORS & words or (_SOURCES & words and meaning(name).role != "strip")
        called = called and not _SIZES & words
        if single and numbered and (called or (worded and (apart or _come_in_turn(fields)))):
            lines = [table.lines[fields.index(v)] for v in values[:2]]
            clues.ask(
                name,
                f"{name!r} is {values[0]!r} on line {lines[0]} and {values[1]!r} on line {lines[1]}: are these of "
                f"{len(values)} sensors? Then which one's lines are meant",
                *values, *([] if apart else ["skip"]),
            )  # fmt: skip
            clues.stop()


def _rise_with_scans(fields: list[str], when: list[tuple[str, ...]]) -> bool:
    """Return whether numbers rise from scan to scan, never to come again: no sensors are called so."""
    runs = [number_of(value) for value, _ in itertools.groupby(fields)]
    rising = all(a is not None and b is not None and a < b for a, b in itertools.pairwise(runs))
    scans = {*zip(fields, when, strict=True)} if when else set()
    return len(runs) > _FEW_COUNTED and rising and len(scans) == len({*fields})


def _are_quantities(values: list[str]) -> bool:
    """Return whether all are numbers in one unit, none a reading's, as temperatures: they name no sensor.

    Examples
    --------
    >>> _are_quantities(["31.0 \u00b0C", "31.5 \u00b0C"]), _are_quantities(["1A", "2A"]), _are_quantities(["pad 1"])
    (True, False, False)
    """
    found = [_QUANTITY.fullmatch(v) for v in values]
    units = {m[2] for m in found if m}
    measured = any(m[1].strip("+-").isdigit() is False for m in found if m) or any(len(u) > 1 for u in units)
    return None not in found and len(units) == 1 and measured and all(map(is_other_unit, units))


def _come_in_turn(fields: list[str]) -> bool:
    """Return whether a few words come in turn, again and again, as of senders that take turns."""
    turn = len({*fields})
    return len(fields) > 2 * turn and all(a == b for a, b in zip(fields, fields[turn:], strict=False))

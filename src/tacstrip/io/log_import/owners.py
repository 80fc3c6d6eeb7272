"""Labels in words that take turns above blocks of readings, as "--- left pad ---": which sensor is meant is asked."""

from __future__ import annotations

import bisect
import re
from collections import Counter
from dataclasses import replace

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import SIDES, meaning
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import Table

OWNER = "source"  # the column's name, as elsewhere of who sent a line
_LABEL = re.compile(r"[\W_]*((?:[^\W\d_][\w'-]*)(?:[ ._#-]{1,3}\w+){0,4})[\W_]*")
_TOUCH = re.compile(
    r"touch|press|releas|contact|down|up\b|begin|end\b|start|stop|ber\u00fchr|kontakt|ok\b", re.IGNORECASE
)
_SIDES = frozenset(["", "a", "b", "l", *sum(SIDES, ())])  # which a sensor may be, too; "l" beside "r"
_MOST = 4  # sensors
_OFTEN = 2  # times that each comes
_LONGEST = 40  # characters


def with_owners(table: Table, text: str) -> Table:
    r"""Return a table with a column of the label that stands above each row, where a few of these take turns.

    Examples
    --------
    >>> text = "Board A:\n0,2.5\n1,2.4\nBoard B:\n0,2.1\n1,2.2\n" * 2
    >>> rows = Table(("strip", "h"), [["0", ""], ["1", ""]] * 4, [2, 3, 5, 6, 8, 9, 11, 12])
    >>> with_owners(rows, text).column("source")[:3]
    ['Board A', 'Board A', 'Board B']
    """
    rows = sorted({*table.lines})
    if not rows or OWNER in table.names:
        return table
    there = {*rows}
    found = {n: label for n, line in numbered(text) if n not in there and (label := _label(line))}
    many = Counter(found.values())
    found = {n: label for n, label in found.items() if many[label] >= _OFTEN}
    labels = list(dict.fromkeys(found.values()))
    places = sorted(found)
    ends = [*places[1:], rows[-1] + 1]
    sizes = [
        bisect.bisect_left(rows, b) - bisect.bisect_left(rows, a) for a, b in zip(places, ends, strict=False)
    ]
    if {"l", "h"} <= {label.casefold() for label in labels}:
        return table
    if not 1 < len(labels) <= _MOST or min(sizes) < 1 or rows[0] < places[0]:
        return table
    by = [{s for s, n in zip(sizes, places, strict=True) if found[n] == label} for label in labels]
    if not set.intersection(*by) and min(sizes) < max(sizes) / _MOST:
        return table  # sections of other kinds
    above = [found[places[bisect.bisect_left(places, i) - 1]] for i in table.lines]
    made = [[label, *row] for label, row in zip(above, table.rows, strict=True)]
    said = ", ".join(f"{label!r} on line {next(n for n in places if found[n] == label)}" for label in labels)
    return replace(
        table,
        names=(OWNER, *table.names),
        rows=made,
        remarks=(*table.remarks, f"labels take turns above the readings: {said}"),
    )


def _label(line: str) -> str:
    """Return the words of a line that may name a sensor; "" where they name what readings are, or a touch."""
    m = _LABEL.fullmatch(line.strip())
    if m is None or len(line.strip()) > _LONGEST or _TOUCH.search(line) or says_nothing(m[1]):
        return ""
    words = re.findall(r"[^\W\d_]+", m[1])
    ends = {meaning(word).channel for word in words} - _SIDES
    whole = meaning(m[1])
    counted = re.search(r"\d", m[1])
    if ends or whole.role in ("time", "scan") or whole.unit or (counted and whole.role == "reading"):
        return ""
    return m[1].strip()

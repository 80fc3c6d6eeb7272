"""Columns of strips that have names in place of numbers, as "index high" of a finger: a row for each strip."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace

from tacstrip.io.log_import.middles import with_ends_of_middles
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.table import Table

_WORD = re.compile(r"[^\W\d_]+")
_FEW = 3  # strips: of fewer, words may be anything


def in_ends_of_strips(
    table: Table, strips: int, answered: Collection[str] = ()
) -> tuple[Table, str, tuple[str, ...]]:
    """Return a table with columns of both ends in place of middles and differences, and a row for each named strip.

    Parameters
    ----------
    table
        A log's.
    strips
        Of its sensor; 0 where it is not known.
    answered
        Columns of which it has been told what they are: they stay.

    Returns
    -------
    tuple
        The table; a reason, and doubts, if it is another.
    """
    table, doubts = with_ends_of_middles(table, answered)
    long = with_named_strips_as_rows(table, strips, answered)
    return long, "" if long is table else long.remarks[-1], doubts


def with_named_strips_as_rows(table: Table, strips: int, answered: Collection[str] = ()) -> Table:
    """Return a table with a row for each strip, where columns of both ends are named by as many words as strips.

    Where one of these columns is `answered`, the table is returned as it is.

    Examples
    --------
    >>> names = ("t", *(f"{finger} {end}" for end in ("high", "low") for finger in ("index", "ring", "thumb")))
    >>> long = with_named_strips_as_rows(Table(names, [list("0246135")], [2]), 3)
    >>> long.names, long.rows
    (('t', 'strip', 'high', 'low'), [['0', 'index', '2', '1'], ['0', 'ring', '4', '3'], ['0', 'thumb', '6', '5']])
    """
    of: dict[str, dict[str, str]] = {}  # strip -> what its columns are called without it -> column
    for name in table.names:
        words = _WORD.findall(name)
        ends = [w for w in words if meaning(w).channel in ("h", "l")]
        for word in words if len(ends) == 1 and not re.search(r"\d", name) else ():
            plain = re.sub(rf"(?<![^\W_]){word}(?![^\W_])", "", name).strip(" _-./")
            if word not in ends and _WORD.search(plain):
                of.setdefault(word, {})[re.sub(r"[\s_]+", " ", plain)] = name
    of = {word: columns for word, columns in of.items() if len(columns) == 2}
    kinds = {frozenset(columns) for columns in of.values()}
    if not _FEW <= strips == len(of) or len(kinds) != 1:
        return table
    said = {meaning(w).channel: kind for kind in min(kinds) for w in _WORD.findall(kind)}
    high, low = said.get("h", ""), said.get("l", "")
    used = {n for columns in of.values() for n in columns.values()}
    others = [n for n in table.names if n not in used]
    if (
        used & {*answered}
        or not (high and low)
        or len(used) != 2 * strips
        or {"strip", high, low} & {*others}
    ):
        return table
    places = table.places
    rows = [
        [*(row[places[n]] for n in others), word, row[places[columns[high]]], row[places[columns[low]]]]
        for row in table.rows for word, columns in of.items()
    ]  # fmt: skip
    lines = [line for line in table.lines for _ in of]
    told = f"{', '.join(of)}: the strips, each with columns of its own"
    return replace(
        table, names=(*others, "strip", high, low), rows=rows, lines=lines, remarks=(*table.remarks, told)
    )  # fmt: skip

"""Columns of a middle and a difference of both ends: v_h and v_l are computed from them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import meaning, unit_in
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.table import Table
from tacstrip.io.log_import.words import names_of

_MIDDLES, _WIDTHS = frozenset(names_of("middles")), frozenset(names_of("widths"))
_WORD = re.compile(r"[^\W\d_]+")
_PLACE = "\0"  # of that word
_SAME_SIGN = 0.98  # of the differences
_SHOWN = 3  # lines
_FEW, _MOSTLY = 10, 0.8  # strips between two others that are touched, and part of them


def with_ends_of_middles(table: Table, answered: Collection[str] = ()) -> tuple[Table, tuple[str, ...]]:
    """Return a table with v_h and v_l in the place of columns of their middle and their difference, and doubts.

    Columns go together that are named the same but for that word, in one unit. A table that has no such columns, or
    others with such a word or readings beside them, is returned as it is, with no doubt; so is one where one of them
    is `answered`: what it is has been told.

    Examples
    --------
    >>> table, doubts = with_ends_of_middles(Table(("t", "mean_3 [V]", "diff_3 [V]"), [["0", "2", "0.5"]], [2]))
    >>> table.names, table.rows
    (('t', 'h_3 [V]', 'l_3 [V]'), [['0', '2.25', '1.75']])
    """
    pairs = _pairs(table.names)
    paired = {n for pair in pairs.values() for n in pair.values()}
    others = any(meaning(n).channel in ("h", "l", "out") for n in table.names if n not in paired)
    if not pairs or others or paired & {*answered}:
        return table, ()
    columns = {n: list(table.column(n)) for n in table.names}
    halved: list[str] = []  # where one of both is missing
    for pair in pairs.values():
        read = [[number_of(f, table.decimal) for f in columns[pair[end]]] for end in "hl"]
        widths = np.array([w for m, w in zip(*read, strict=True) if m is not None and w is not None])
        sign = -1.0 if len(widths) and np.median(widths) < 0.0 else 1.0
        if len(widths) and (sign * widths < 0.0).mean() > 1.0 - _SAME_SIGN:
            return table, ()
        for n, (m, w) in enumerate(zip(*read, strict=True)):
            if m is not None and w is not None:
                ends = tuple(f"{m + part * sign * w:.9g}".replace(".", table.decimal) for part in (0.5, -0.5))
            elif m is w:
                continue
            else:
                lacks = pair["h"] if m is None else pair["l"]
                halved.append(f"line {table.lines[n]} ({lacks!r})")
                ends = (columns[lacks][n],) * 2  # as what is there alone is no end
            columns[pair["h"]][n], columns[pair["l"]][n] = ends
    called = {n: rest.replace(_PLACE, end) for rest, pair in pairs.items() for end, n in pair.items()}
    first = next(iter(pairs.values()))
    doubts = [
        f"{first['h']!r} and {first['l']!r} are taken for the middle of both ends and their difference: "
        "v_h = middle + difference / 2, v_l = middle - difference / 2"
    ]
    if halved:
        more = f", and {len(halved) - _SHOWN} more" if len(halved) > _SHOWN else ""
        doubts.append(
            f"{', '.join(halved[:_SHOWN])}{more}: the middle or the difference is missing, and the other alone gives "
            "no end: read as neither"
        )
    names = tuple(called.get(n, n) for n in table.names)
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    return replace(table, names=names, rows=rows), tuple(doubts)


def _pairs(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return the middle ("h") and the difference ("l") by what both are called without that word.

    A name may have two such words, as that of the middle finger: the one counts by which it is one of two. There is
    none where a name with such a word is not one of just two.
    """
    words = {n: [w for w in _WORD.findall(n) if w.casefold() in _MIDDLES | _WIDTHS] for n in names}
    found: dict[str, dict[str, list[str]]] = {}
    for name, some in words.items():
        for word in some if "half" not in name.casefold() else ():
            end = "h" if word.casefold() in _MIDDLES else "l"
            rest = re.sub(rf"(?<![^\W\d_]){word}(?![^\W\d_])", _PLACE, name, count=1)
            found.setdefault(rest, {}).setdefault(end, []).append(name)
    pairs = {
        rest: {end: of[0] for end, of in ends.items()}
        for rest, ends in found.items()
        if [*map(len, ends.values())] == [1, 1] and len({*map(unit_in, (of[0] for of in ends.values()))}) == 1
    }
    used = Counter(n for pair in pairs.values() for n in pair.values())
    return pairs if all(used[n] == 1 for n, some in words.items() if some) else {}


def doubt_middles(clues: Clues, columns: Mapping[str, str], high: FloatArray, low: FloatArray) -> None:
    """Note where two channels (scans, strips) that no name tells apart look like a middle and a difference.

    Between its ends a contact that is nowhere hollow is never narrower than the line from one end to the other, and so
    v_h - v_l is seldom. Where it nearly always is, and one channel alone nearly never, that one is the difference.
    """
    bend = [np.diff(values, 2, axis=1) for values in (high - low, low)]
    there = np.isfinite(bend[0])
    if (
        there.sum() < _FEW
        or (bend[0][there] > 0.0).mean() < _MOSTLY
        or (bend[1][there] < 0.0).mean() < _MOSTLY
    ):
        return
    named = [next((repr(n) for n, w in columns.items() if w.endswith(end)), f"channel {end}") for end in "hl"]
    clues.doubt(
        f"{' and '.join(named)} are taken for v_h and v_l, and contacts would be narrower within than at their "
        "ends: are they a middle of both and a difference? Then name them so, as mean_0 and diff_0"
    )

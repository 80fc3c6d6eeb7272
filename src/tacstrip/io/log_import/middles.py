"""Columns of a middle and a difference of both ends: v_h and v_l are computed from them."""

from __future__ import annotations

import re
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
_FEW, _MOSTLY = 10, 0.8  # strips between two others that are touched, and part of them


def with_ends_of_middles(table: Table) -> tuple[Table, str]:
    """Return a table with v_h and v_l in the place of columns of their middle and their difference, and a doubt.

    Columns go together that are named the same but for that word, in one unit. A table that has no such columns, or
    other readings beside them, is returned as it is, with no doubt.

    Examples
    --------
    >>> table, doubt = with_ends_of_middles(Table(("t", "mean_3 [V]", "diff_3 [V]"), [["0", "2", "0.5"]], [2]))
    >>> table.names, table.rows
    (('t', 'h_3 [V]', 'l_3 [V]'), [['0', '2.25', '1.75']])
    """
    found: dict[str, tuple[str, str]] = {}  # name -> (which of both, the name without that word)
    for name in table.names:
        words = [w for w in _WORD.findall(name) if w.casefold() in _MIDDLES | _WIDTHS]
        if len(words) == 1 and "half" not in name.casefold():
            end = "h" if words[0].casefold() in _MIDDLES else "l"
            found[name] = end, name.replace(words[0], _PLACE, 1)
    pairs = {rest: {end: n for n, (end, r) in found.items() if r == rest} for _, rest in found.values()}
    whole = all(len(pair) == 2 and len({*map(unit_in, pair.values())}) == 1 for pair in pairs.values())
    others = any(meaning(n).channel in ("h", "l", "out") for n in table.names if n not in found)
    if not found or not whole or len(found) != 2 * len(pairs) or others:
        return table, ""
    columns = {n: list(table.column(n)) for n in table.names}
    for pair in pairs.values():
        read = [[number_of(f, table.decimal) for f in columns[pair[end]]] for end in "hl"]
        widths = np.array([w for m, w in zip(*read, strict=True) if m is not None and w is not None])
        sign = -1.0 if len(widths) and np.median(widths) < 0.0 else 1.0
        if len(widths) and (sign * widths < 0.0).mean() > 1.0 - _SAME_SIGN:
            return table, ""
        for n, (m, w) in enumerate(zip(*read, strict=True)):
            if m is not None and w is not None:
                ends = (f"{m + part * sign * w:.9g}".replace(".", table.decimal) for part in (0.5, -0.5))
                columns[pair["h"]][n], columns[pair["l"]][n] = ends
    names = tuple(found[n][1].replace(_PLACE, found[n][0]) if n in found else n for n in table.names)
    first = next(iter(pairs.values()))
    doubt = (
        f"{first['h']!r} and {first['l']!r} are taken for the middle of both ends and their difference: "
        "v_h = middle + difference / 2, v_l = middle - difference / 2"
    )
    return replace(table, names=names, rows=[list(r) for r in zip(*columns.values(), strict=True)]), doubt


def doubt_middles(clues: Clues, names: list[str], high: FloatArray, low: FloatArray) -> None:
    """Note where two channels (scans, strips), which no name tells apart, look like a middle and a difference.

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
    clues.doubt(
        f"{names[0]!r} and {names[1]!r} are taken for v_h and v_l, and contacts would be narrower within than at their "
        "ends: are they a middle of both and a difference? Then name them so, as mean_0 and diff_0"
    )

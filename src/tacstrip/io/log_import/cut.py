"""Lines that are cut within a number: the last of a log, or one in the middle of it."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.table import ContradictionError, Table

_COMMENTS = re.compile(r"(?m)^[ \t]*(?:#|%|//|!).*")
# An array with a name before it, and numbers, or none, in it, as far as these go.
_ARRAY = re.compile(
    r"(?:\"(?P<quoted>[^\"\n]{1,40})\"|'(?P<single>[^'\n]{1,40})'|(?<![\w.])(?P<plain>[A-Za-z_]\w{0,39}))\s*[:=]\s*"
    r"(?:(?:np|numpy)\.)?(?:array)?\s*\(?\s*"
    r"(?P<array>\[(?:[\[\]\s,;.\d+-]++|[eE](?=[-+\d]|\Z)|(?i:nan|null|none|inf|na)(?!\w)|[A-Za-z]{1,4}\Z)*)"
)
_FEW_LINES = 4  # of fewer, the length of the last number tells nothing
_RARE = 0.05  # of the lines: more that are shorter are no accident
_SHOWN = 5


def without_cut_end(table: Table, text: str) -> Table:
    """Return a table whose last line is a broken one, if the log ends within its last number."""
    if text.endswith(("\n", "\r")) or len(table.rows) < _FEW_LINES:
        return table
    lines = re.split(r"\r\n|\r\r\n|\n|\r", text)
    *padded, end_line = [lines[i - 1] for i in table.lines]
    *others, last = [row[-1] for row in table.rows]
    longer = [len(cell) for cell in others if cell]
    if last or any(m.role == "strip" for m in meanings(table.names).values()):
        cut = bool(last and longer) and len(last) < min(longer)
    else:  # empty at the end, where the line before is not
        end = len(list(itertools.takewhile(lambda cell: not cell, reversed(table.rows[-1]))))
        cut = any(table.rows[-2][-end:])
    # Where blanks fill each line up to one width, a shorter one is cut, even behind a whole number.
    filled = len({*map(len, padded)}) == 1 and any("  " in line for line in padded)
    if not cut and not (filled and len(end_line) < len(padded[0])):
        return table
    broken = (*table.broken, table.lines[-1])
    return replace(table, rows=table.rows[:-1], lines=table.lines[:-1], broken=broken)


def refuse_cut_array(text: str, path: str | Path) -> None:
    r"""Refuse a text that ends within a named array, where another array is whole: which scans it lacks is not known.

    Of records that come again, each with arrays of the same names, only the last one is cut, as a line may be.

    Raises
    ------
    ContradictionError
        It ends so.

    Examples
    --------
    >>> refuse_cut_array("high = [2.5, 2.4, 2.3]\nlow = [1.5, 1.4", "x.txt")
    Traceback (most recent call last):
    tacstrip.io.log_import.table.ContradictionError: x.txt: the log ends within 'low', which begins on line 2: ...
    """
    if text.count("[") <= text.count("]"):
        return
    text = _COMMENTS.sub("", text)
    found = [*_ARRAY.finditer(text)]
    names = [m["quoted"] or m["single"] or m["plain"] for m in found]
    kinds = [re.sub(r"\d+", "0", name) for name in names]  # as of scans that are counted
    is_open = [m["array"].count("[") > m["array"].count("]") for m in found]
    whole = {kind for kind, so in zip(kinds, is_open, strict=True) if not so}
    if not whole or not is_open[-1] or found[-1].end() < len(text) or kinds[-1] in whole:
        return
    named, at = names[-1], found[-1].start()
    raise ContradictionError(
        f"{path}: the log ends within {named!r}, which begins on line {text.count(chr(10), 0, at) + 1}: is the file "
        "cut? An array needs as many scans as the others; save it again, or shorten the others to as many"
    )


def without_cut_units(table: Table) -> Table:
    """Return a table whose rows are broken that end in a number without the unit that all others in it have.

    Examples
    --------
    >>> rows = [["51.2%", "49.1%"]] * 30 + [["51.2%", "49"]]
    >>> without_cut_units(Table(("h", "l"), rows, [*range(31)])).broken
    (30,)
    """
    number = re.compile(rf"[-+]?\d+(?:{re.escape(table.decimal)}\d*)?\s?(%|[m\u00b5]?V)?")
    said = [[m[1] for row in table.rows if (m := number.fullmatch(row[p]))] for p in range(len(table.names))]
    marked = {p for p, of in enumerate(said) if 2 * sum(map(bool, of)) > len(of)}
    units = {unit for p in marked for unit in said[p] if unit}
    last = [max((p for p, cell in enumerate(row) if cell), default=0) for row in table.rows]
    ends = [number.fullmatch(row[p]) for p, row in zip(last, table.rows, strict=True)]
    cut = [n for n, m in enumerate(ends) if m and not m[1] and last[n] in marked]
    if len(units) != 1 or not cut or len(cut) > max(1, _RARE * len(table.rows)):
        return table
    table = replace(table, broken=tuple(sorted({*table.broken, *(table.lines[n] for n in cut)})))
    return table.of_rows(n for n in range(len(table.rows)) if n not in cut)


def with_cut_lines_doubted(table: Table) -> Table:
    """Return a table with a doubt where lines end within a number: with fewer decimals than all other numbers have.

    That tells only where numbers are written with as many decimals each, in every column of readings.
    """
    said = meanings(table.names)
    if len(table.rows) < _FEW_LINES or said[table.names[-1]].role != "reading":
        return table
    places = [table.places[n] for n, m in said.items() if m.role == "reading"]
    number = re.compile(rf"[-+]?\d*\{table.decimal}(\d*)")
    decimals = [
        [len(m[1]) if (m := number.fullmatch(row[p])) else None for p in places] for row in table.rows
    ]
    others = {d for row in decimals for d in row[:-1] if d is not None}
    last = Counter(row[-1] for row in decimals if row[-1] is not None)
    usual = max(last, key=lambda d: last[d], default=0)
    short = [n for n, row in enumerate(decimals) if row[-1] is not None and row[-1] < usual]
    whole = [n for n, row in enumerate(table.rows) if re.fullmatch(r"[-+]?\d+", row[-1])]
    short = sorted({*short, *whole})
    if others != {usual} or usual < 2 or not short or len(short) > max(1, _RARE * len(table.rows)):
        return table
    shown = ", ".join(f"line {table.lines[n]} ({table.rows[n][-1]!r})" for n in short[:_SHOWN])
    said_of = f"{shown}: the last number has fewer decimals than all others: cut there? Taken as it stands"
    return replace(table, doubts=(*table.doubts, said_of))

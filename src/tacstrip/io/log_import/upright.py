"""Tables whose columns are scans, or whose lines begin with their names, as rows of scans."""

from __future__ import annotations

import re
from dataclasses import replace

from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import TIME_UNITS, meaning
from tacstrip.io.log_import.table import ROW, Table

_CORNER = re.compile(r"(\w+)\s*[\\/|]\s*(t|time|zeit)\s*(?:[\[(]?(\w+)[\])]?)?", re.I)
_SCAN_IN_NAME = re.compile(r"\W*(t|time|zeit|scan|frame|sample)\W*([+-]?\d+(?:\.\d+)?)\s*(\w*)\W*\Z", re.I)

_FEW_NAMES = 3  # of lines


def upright(table: Table) -> Table:
    """Turn a table whose columns are scans, named by their times or numbers, into one of rows."""
    if (turned := _turned(table)) is not None:
        return turned
    corner = next((m for n in table.names if (m := _CORNER.fullmatch(n))), None)
    if corner and table.named:  # as in "strip \\ t(s), 0.0, 0.5, ..."
        plain = [
            corner[1] if n == corner[0] else f"t={n} {corner[3] or ''}" if number_of(n) is not None else n
            for n in table.names
        ]
        table = replace(table, names=tuple(plain))
    scans = {n: m for n in table.names if (m := _SCAN_IN_NAME.match(n))}
    others = [n for n in table.names if n not in scans and n != ROW]
    if len(scans) < 2 or not 1 <= len(others) <= 2 or len(scans) < len(others):
        return table
    word, _, unit = next(iter(scans.values())).groups()
    if any(m[1] != word or m[3] != unit or (unit and unit not in TIME_UNITS) for m in scans.values()):
        return table
    named = f"{word} [{unit}]" if unit else word
    return _with_scans_as_rows(table, {n: m[2] for n, m in scans.items()}, named, others, "value")


def _turned(table: Table) -> Table | None:
    """Return a table whose lines each begin with a name of their own as one with these names; None of another.

    Examples
    --------
    >>> rows = [["t (s)", "0.0", "0.1"], ["strip 1", "2.5", ""], ["strip 2", "2.4", "2.2"]]
    >>> turned = _turned(Table(("column 1", "column 2", "column 3"), rows, [1, 2, 3], named=False))
    >>> turned.names, turned.rows
    (('t (s)', 'strip 1', 'strip 2'), [['0.0', '2.5', '2.4'], ['0.1', '', '2.2']])
    """
    names = [row[0] for row in table.rows]
    if (
        table.named
        or len({*names}) < len(names)
        or len(names) < _FEW_NAMES
        or any(number_of(n) is not None for n in names)
    ):
        return None
    said = [meaning(n) for n in names]
    strips = {(m.strip, m.channel) for m in said if m.strip is not None and m.role == "reading"}
    if len(strips) < 2 or len(strips) + sum(m.role in ("time", "scan") for m in said) < len(names):
        return None
    rows = [list(row) for row in zip(*(row[1:] for row in table.rows), strict=True)]
    said_of = (*table.remarks, f"{names[0]!r}, ...: each line begins with a name: the columns are scans")
    return replace(
        table, names=tuple(names), rows=rows, lines=[table.lines[0]] * len(rows), named=True, remarks=said_of
    )


def _with_scans_as_rows(
    table: Table, scans: dict[str, str], word: str, others: list[str], value: str
) -> Table:
    """Return a row for each row of each column that is a scan, with its time or number."""
    places = [table.places[n] for n in others]
    rows, lines = [], []
    for name, at in scans.items():
        place = table.places[name]
        for line, row in zip(table.lines, table.rows, strict=True):
            rows.append([at.replace(".", table.decimal), *(row[p] for p in places), row[place]])
            lines.append(line)
    said = (*table.remarks, f"{next(iter(scans))} ...: the columns are scans")
    return replace(table, names=(word, *others, value), rows=rows, lines=lines, remarks=said)

"""Tables whose columns are scans, or whose lines begin with their names, as rows of scans."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np

from tacstrip.io.log_import.channel_names import tell_strips
from tacstrip.io.log_import.fields import number_of, quantity
from tacstrip.io.log_import.names import READING_UNITS, TIME_UNITS, UNITS, meaning, meanings, unit_in
from tacstrip.io.log_import.table import ROW, Table

_CORNER = re.compile(r"(\w+)\s*[\\/|]\s*(t|time|zeit)\s*(?:[\[(]?(\w+)[\])]?)?", re.I)
_SCAN_IN_NAME = re.compile(r"\W*(t|time|zeit|scan|frame|sample)\W*([+-]?\d+(?:\.\d+)?)\s*(\w*)\W*\Z", re.I)
_TIME_AS_NAME = re.compile(
    r"(?:at |@ ?|after |nach |bei )?([+-]?\d+(?:[.,]\d+)?)\s*([a-z\u00b5]*)\s*(?:[\[(/]\s*(\w+)\s*[\])]?)?",
    re.I,
)
_FEW = 4  # fields of a row of times
_EVEN = 0.02  # of a step: so much may the others differ


def of_several_scans(table: Table) -> Table:
    """Put scans that stand beside each other in a line, each with its time before the same names, below each other."""
    plain = [re.sub(r" \((?:column )?\d+\)\Z", "", name) for name in table.names]
    width = next((n for n in range(2, len(plain) // 2 + 1) if plain[n + 1 : 2 * n] == plain[1:n]), 0)
    if not table.named or not width or len(plain) % width:
        return table
    starts = range(0, len(plain), width)
    times = [meaning(re.sub(r"(?<=[^\W\d_])_?\d+(?=_|\b)", "", plain[n], count=1)) for n in starts]
    if any(plain[n + 1 : n + width] != plain[1:width] for n in starts):
        return table
    if any(m.role != "time" or m.unit != times[0].unit for m in times):
        return table
    rows = [row[n : n + width] for row in table.rows for n in starts]
    at = [number_of(row[0], table.decimal) for row in rows]
    if any(a is None or b is None or b <= a for a, b in itertools.pairwise(at)):
        return table
    lines = [line for line in table.lines for _ in starts]
    name = f"time [{times[0].unit}]" if times[0].unit else "time"
    said = (
        *table.remarks,
        f"{', '.join(plain[n] for n in starts)}: {len(starts)} scans in each line, one after another",
    )
    return replace(table, names=(name, *plain[1:width]), rows=rows, lines=lines, remarks=said)


def transposed(table: Table) -> Table:
    """Turn a table whose lines begin with their names, perhaps of several fields, each of other values."""
    table = _under_times(table)
    joined = _with_labels_in_one(table)
    names = joined.column(joined.names[0])
    roles = [meaning(name).role for name in names]
    if table.named or len(joined.names) < 3 or not all(roles) or any(number_of(n) is not None for n in names):
        return table
    if len(set(names)) < len(names) or len(names) < 2 or "reading" not in roles:
        return table
    rows = [list(row) for row in zip(*(row[1:] for row in joined.rows), strict=True)]
    told = (*table.remarks, "the first field of each line is its name, so scans are columns")
    lines = [table.lines[0]] * len(rows)
    return replace(table, names=tuple(names), rows=rows, lines=lines, named=True, remarks=told)


def _with_labels_in_one(table: Table) -> Table:
    """Join the words with which lines begin, as "V_H [V]" and "strip 3", where the first line is of times."""
    top = table.rows[0]
    first = next((n for n, cell in enumerate(top) if number_of(cell, table.decimal) is not None), 0)
    times = [number_of(cell, table.decimal) for cell in top[first:]]
    if table.named or first < 2 or meaning(top[0]).role != "time" or len(times) < 2 or None in times:
        return table
    if any(b <= a for a, b in itertools.pairwise(times)):  # type: ignore[operator]
        return table
    labels = [row[:first] for row in table.rows[1:]]
    if any(not cell or number_of(cell) is not None for row in labels for cell in row):
        return table
    joined = [top[0], *(" ".join(row) for row in labels)]
    rows = [[name, *row[first:]] for name, row in zip(joined, table.rows, strict=True)]
    return replace(table, names=(table.names[0], *table.names[first:]), rows=rows)


def upright(table: Table) -> Table:
    """Turn a table whose columns are scans, named by their times or numbers, into one of rows."""
    corner = next((m for n in table.names if (m := _CORNER.fullmatch(n))), None)
    if corner and table.named:  # as in "strip \\ t(s), 0.0, 0.5, ..."
        plain = [
            corner[1] if n == corner[0] else f"t={n} {corner[3] or ''}" if number_of(n) is not None else n
            for n in table.names
        ]
        table = replace(table, names=tuple(plain))
    scans = {n: m for n in table.names if (m := _SCAN_IN_NAME.match(n))}
    if not scans and table.named and (upright := _of_bare_times(table)):
        return upright
    others = [n for n in table.names if n not in scans and n != ROW]
    if len(scans) < 2 or not 1 <= len(others) <= 2 or len(scans) < len(others):
        return table
    word, _, unit = next(iter(scans.values())).groups()
    if any(m[1] != word or m[3] != unit or (unit and unit not in TIME_UNITS) for m in scans.values()):
        return table
    named = f"{word} [{unit}]" if unit else word
    return _with_scans_as_rows(table, {n: m[2] for n, m in scans.items()}, named, others, "value")


def _under_times(table: Table) -> Table:
    """Return a table without names whose first row is of rising times in one unit with these as its names."""
    top = table.rows[0]
    times = [quantity(cell, table.decimal) for cell in top[1:]]
    rising = [q[0] for q in times if q is not None and q[1] in ("", *TIME_UNITS)]
    if table.named or len(top) < _FEW or len(rising) < len(times) or len({q[1] for q in times if q}) > 1:
        return table
    if (
        number_of(top[0]) is not None
        or meaning(top[0]).role in ("time", "scan")
        or any(b <= a for a, b in itertools.pairwise(rising))
    ):
        return table
    if not tell_strips([row[0] for row in table.rows[1:]]):
        return table
    return replace(table, names=tuple(top), rows=table.rows[1:], lines=table.lines[1:], named=True)


def _of_bare_times(table: Table) -> Table | None:
    """Turn a table whose columns are named by nothing but times, as "100 ms", beside a column of the strip.

    Numbers without a unit count if they rise evenly; those that go up by one are numbers of scans. None where there
    are no such columns.
    """
    found = {n: m for n in table.names if (m := _TIME_AS_NAME.fullmatch(n.strip()))}
    others = [n for n in table.names if n not in found and n != ROW]
    strip = any(m.role == "strip" for m in meanings(others).values())
    if len(found) < 2 or not (strip or _holds_keys(table, others)):
        return None
    units = {UNITS.get(m[2], UNITS.get(m[2].lower(), "?")) if m[2] else "" for m in found.values()}
    of_values = {m[3] or "" for m in found.values()}
    times = [float(m[1].replace(",", ".")) for m in found.values()]
    steps = np.diff(times)
    if len(units) > 1 or len(of_values) > 1 or not (steps > 0.0).all():
        return None
    unit, of_value = units.pop(), of_values.pop()
    if (unit and unit not in TIME_UNITS) or (of_value and UNITS.get(of_value.lower()) not in READING_UNITS):
        return None
    if not unit and (len(steps) < 2 or np.ptp(steps) > _EVEN * steps.min()):
        return None
    word = f"time [{unit}]" if unit else "scan" if (steps == 1.0).all() else "time"
    of_value = of_value or next((u for n in others if (u := unit_in(n)) in READING_UNITS), "")
    value = f"value [{of_value}]" if of_value else "value"
    scans = {n: m[1].replace(",", ".") for n, m in found.items()}
    return _with_scans_as_rows(table, scans, word, others, value)


def _holds_keys(table: Table, names: list[str]) -> bool:
    """Return whether a column holds strip and channel in one, such as "3H"."""
    kinds = [meanings(sorted({*table.column(n)})).values() for n in names]
    return any(len(k) > 1 and all(m.strip is not None and m.channel for m in k) for k in kinds)


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

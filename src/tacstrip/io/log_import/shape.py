"""The normal form of a table: a number in a field, a unit in a column, strip and channel in columns of their own."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import array_of, clock_seconds, is_date, number_of, quantity, says_nothing
from tacstrip.io.log_import.names import (
    CHANNELS,
    IN_VOLTS,
    READING_UNITS,
    TIME_UNITS,
    UNITS,
    meaning,
    meanings,
)
from tacstrip.io.log_import.table import ROW, Table, flattened

_ARRAYS = 0.5  # of a column's fields that say something: then it is one of arrays
_WHOLE_SECONDS = r"(?:[\d/.-]+[T ])?\d{1,2}:\d\d:\d\d"
_UNITS_COLUMN = re.compile(
    r"(?:\w+[ _.])?(?:units?|einheit(?:en)?|unit\u00e9s?|unidad|unit\u00e0)(?:[ _.]\w+)?", re.I
)
_FEW_KEYS, _SHOWN = 3, 5  # names of strips in a column; lines that are quoted
_FEW_BLANKS = 0.25  # of the rows: where more have no time, cells are merged
_CLOCK_PARTS = (
    r"hours?|hh|stunden?|heures?|horas?|ore?", r"min(?:ute[ns]?|utos?|uti)?|mm",
    r"s(?:ec(?:ond[ieos]*)?|ek(?:unden?)?)?|ss",
    r"ms|millis(?:econds?)?|msec",
)  # fmt: skip
_CORNER = re.compile(r"(\w+)\s*[\\/|]\s*(t|time|zeit)\s*(?:[\[(]?(\w+)[\])]?)?", re.I)
_SCAN_IN_NAME = re.compile(r"\W*(t|time|zeit|scan|frame|sample)\W*([+-]?\d+(?:\.\d+)?)\s*(\w*)\W*\Z", re.I)


def in_normal_form(table: Table) -> Table:
    """Return a table in normal form; each change is told in its remarks.

    Arrays in fields become columns, units in fields go to the column's name, a column such as "3H" or "vh[3]" becomes
    two, merged cells are filled, a column that only counts the rows is left out, and columns of scans become rows.
    """
    steps: tuple[Callable[[Table], Table], ...] = (
        _without_empty, _of_several_scans, _of_clock_parts, _of_day_and_clock, _of_one_clock, _of_two_numbers,
        _transposed, _spread, _without_units, _of_strips_only, _of_unit_column, _in_one_unit, _upright, _split_keys,
        _filled, _without_index,
    )  # fmt: skip
    for step in steps:
        table = step(table) if table.rows else table
    return table


def _with(table: Table, columns: dict[str, list[str]], *remarks: str) -> Table:
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    return replace(table, names=tuple(columns), rows=rows, remarks=(*table.remarks, *remarks))


def _without_empty(table: Table) -> Table:
    """Leave out columns without a name and without a field, as where lines end with several separators."""
    columns = {n: table.column(n) for n in table.names}
    kept = {n: f for n, f in columns.items() if any(f) or not re.fullmatch(r"column \d+", n)}
    return _with(table, kept) if table.named and 0 < len(kept) < len(columns) else table


def _of_several_scans(table: Table) -> Table:
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


def _of_day_and_clock(table: Table) -> Table:
    """Put dates that stand in a column of their own, and are not all one, before the times of day."""
    dates = [n for n in table.names if len(fields := {*table.column(n)}) > 1 and all(map(is_date, fields))]
    clocks = [
        n for n in table.names
        if n not in dates and all(":" in f and clock_seconds(f) is not None for f in table.column(n))
    ]  # fmt: skip
    if len(dates) != 1 or len(clocks) != 1 or clock_seconds(f"{table.column(dates[0])[0]} 0:00:00") is None:
        return table
    columns = {n: table.column(n) for n in table.names if n != dates[0]}
    days = table.column(dates[0])
    columns[clocks[0]] = [f"{d.strip()} {t}" for d, t in zip(days, columns[clocks[0]], strict=True)]
    return _with(table, columns, f"{dates[0]} and {clocks[0]}: a date and a time of day")


def _of_clock_parts(table: Table) -> Table:
    """Put hours, minutes and seconds that stand in columns of their own, perhaps with milliseconds, into one clock."""
    found = [[n for n in table.names if re.fullmatch(word, n.strip(), re.I)] for word in _CLOCK_PARTS]
    if any(len(names) != 1 for names in found[:3]) or len(found[3]) > 1:
        return table
    names = [names[0] for names in found if names]
    fields = [table.column(n) for n in names]
    if not all(re.fullmatch(r"\d{1,2}", f) for column in fields[:2] for f in column):
        return table
    if not all(re.fullmatch(r"\d{1,2}([.,]\d+)?", f) for f in fields[2]) or not all(
        f.isdigit() for column in fields[3:] for f in column
    ):
        return table
    clock = [
        f"{h}:{m:0>2}:{s if s[1:2].isdigit() else '0' + s}{'.' + rest[0].zfill(3) if rest else ''}"
        for h, m, s, *rest in zip(*fields, strict=True)
    ]
    columns = {"clock": clock} | {n: table.column(n) for n in table.names if n not in names}
    return _with(table, columns, f"{', '.join(names)}: parts of one clock")


def _of_one_clock(table: Table) -> Table:
    """Put milliseconds that stand in a column of their own behind the seconds of a clock."""
    clocks = [n for n in table.names if all(re.fullmatch(_WHOLE_SECONDS, f) for f in table.column(n))]
    for name in [n for n in table.names if re.fullmatch(r"frac\w*[ _]sec\w*", n, re.I)]:
        columns = {n: table.column(n) for n in table.names if n != name}
        if len(clocks) == 1 and all(re.fullmatch(r"0?\.\d+|0", f) for f in table.column(name)):
            columns[clocks[0]] = [
                f"{a}.{b.partition('.')[2] or 0}"
                for a, b in zip(columns[clocks[0]], table.column(name), strict=True)
            ]
            return _with(table, columns, f"{clocks[0]} and {name}: a clock and the parts of its seconds")
    for name in [n for n in table.names if (m := meaning(n)).role == "time" and m.unit in ("ms", "us")]:
        digits, fields = {"ms": 3, "us": 6}[meaning(name).unit], table.column(name)
        if len(clocks) != 1 or not all(f.isdigit() and len(f) <= digits for f in fields):
            continue
        columns = {n: table.column(n) for n in table.names if n != name}
        columns[clocks[0]] = [f"{a}.{b:0>{digits}}" for a, b in zip(columns[clocks[0]], fields, strict=True)]
        times = [clock_seconds(f) or 0.0 for f in columns[clocks[0]]]
        if not any(b < a for a, b in itertools.pairwise(times)):
            return _with(table, columns, f"{clocks[0]} and {name}: a clock and the parts of its seconds")
    return table


def _of_two_numbers(table: Table) -> Table:
    """Put nanoseconds that stand in a column of their own behind the seconds, as ROS writes a time."""
    parts = {
        n: m for n in table.names if (m := re.fullmatch(r"(.*?)n(?:ano)?_?sec(?:ond)?s?", n, re.IGNORECASE))
    }
    for name, found in parts.items():
        whole = [
            n for n in table.names if re.fullmatch(re.escape(found[1]) + r"sec(?:ond)?s?", n, re.IGNORECASE)
        ]
        if len(whole) != 1 or not all(f.isdigit() for n in (whole[0], name) for f in table.column(n)):
            continue
        columns = {n: table.column(n) for n in table.names if n != name}
        columns[whole[0]] = [
            f"{a}{int(b):09d}" for a, b in zip(columns[whole[0]], table.column(name), strict=True)
        ]
        columns = {f"{n} [ns]" if n == whole[0] else n: f for n, f in columns.items()}
        return _with(table, columns, f"{whole[0]} and {name}: seconds and their parts")
    return table


def _transposed(table: Table) -> Table:
    """Turn a table whose lines begin with their names, perhaps of several fields, each of other values."""
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


def _in_one_unit(table: Table) -> Table:
    """Bring readings in millivolts to volts where others are in volts."""
    units = {name: m.unit for name, m in meanings(table.names).items() if m.role == "reading"}
    if {"V", "mV"} - set(units.values()):
        return table
    columns = {}
    for name in table.names:
        key, fields = name, table.column(name)
        if units.get(name) == "mV":
            read = [number_of(f, table.decimal) for f in fields]
            fields = [
                f if v is None else f"{v * 1e-3:.15g}".replace(".", table.decimal)
                for f, v in zip(fields, read, strict=True)
            ]
            key = re.sub(r"[\s_]*[\[(]?mV[\])]?", "", name) + " [V]"
        columns[key] = fields
    told = "millivolts beside volts: all in volts"
    return _with(table, columns, told) if len(columns) == len(table.names) else table


def _spread(table: Table) -> Table:
    """Give arrays in fields a column for each element."""
    columns: dict[str, list[str]] = {}
    told = []
    for name in table.names:
        fields = table.column(name)
        arrays = [array_of(f) for f in fields] if any(f[:1] in ("[", "(") for f in fields) else []
        said = [a for a, f in zip(arrays, fields, strict=False) if f]
        if not said or sum(a is not None for a in said) < _ARRAYS * len(said):
            columns[name] = fields
            continue
        spread = [flattened(name, a) if a is not None else {} for a in arrays]
        keys = tuple(dict.fromkeys(key for row in spread for key in row))
        columns |= {key: [row.get(key, "") for row in spread] for key in keys}
        told.append(f"{name}: arrays of {len(keys)}")
    if not told:
        return table
    return _with(table, columns, *told)


def _without_units(table: Table) -> Table:
    """Move a unit that stands in the fields of a column to its name."""
    columns, told = {}, []
    for name in table.names:
        fields = columns[name] = table.column(name)
        if not any(f[-1:].isalpha() or f[-1:] in ("%", "‰") for f in fields):
            continue
        found = [quantity(f, table.decimal) for f in fields]
        units = {q[1] for q in found if q and q[1]}
        if not units or any(q and not q[1] and q[0] != 0.0 for q in found):  # of some nothing is said
            continue
        if len(units) == 1:
            (unit,), scale = units, dict.fromkeys(units, 1.0)
        elif units <= {*IN_VOLTS}:
            unit, scale = "V", IN_VOLTS
        elif units <= {*TIME_UNITS}:
            unit, scale = "s", TIME_UNITS
        else:
            continue
        del columns[name]
        named = name if meaning(name).unit else f"{name} [{unit}]"
        columns[named] = [
            f if q is None else f"{q[0] * scale.get(q[1], 1.0):.15g}".replace(".", table.decimal)
            for q, f in zip(found, fields, strict=True)
        ]
        told.append(f"{name}: its fields say {' and '.join(sorted(units))}")
    return _with(table, columns, *told) if told else table


def _of_strips_only(table: Table) -> Table:
    """Leave out rows whose key names no strip, such as TEMP among 2H, 2L, ..., or S1, S2, ...; with a doubt."""
    for name in table.names:
        fields = table.column(name)
        kinds = meanings(sorted({*fields}))
        others = {f for f, m in kinds.items() if m.strip is None}
        if not others or len(kinds) - len(others) < _FEW_KEYS or meaning(name).role in ("time", "scan"):
            continue
        words = all(
            re.fullmatch(r"[^\W\d]{2,}(?:[ _.-][^\W\d]+)*", f) and not says_nothing(f) for f in others
        )
        out = [n for n, f in enumerate(fields) if f in others]
        strips = all(m.role == "reading" for f, m in kinds.items() if f not in others)
        worded = strips and not any(number_of(f) is not None for f in kinds)
        if (
            not (worded and words)
            or any(kinds[f].channel in CHANNELS for f in others)
            or 2 * len(out) > len(fields)
        ):
            continue
        kept = [n for n in range(len(fields)) if fields[n] not in others]
        said = f"line(s) {', '.join(str(table.lines[n]) for n in out[:_SHOWN])}{', ...' if len(out) > _SHOWN else ''}"
        return replace(
            table, rows=[table.rows[n] for n in kept], lines=[table.lines[n] for n in kept],
            doubts=(*table.doubts, f"{said}: {name} is {', '.join(sorted(others))}, no strip's number; passed over"),
        )  # fmt: skip
    return table


def _of_unit_column(table: Table) -> Table:
    """Give readings the unit that a column of units says, and bring those of several to volts."""
    named = [n for n in table.names if _UNITS_COLUMN.fullmatch(n.strip()) and any(table.column(n))]
    if len(named) != 1:
        return table
    said = [UNITS.get(f) or UNITS.get(f.lower(), "") for f in table.column(named[0])]
    units = {u for u, f in zip(said, table.column(named[0]), strict=True) if f}
    readings = [
        n for n, m in meanings(table.names).items() if m.role == "reading" and not m.unit and n != named[0]
    ]
    volts = units <= {*IN_VOLTS}
    if not readings or not (units <= {*READING_UNITS} and (volts or len(units) == 1)):
        if len(set(table.column(named[0]))) == 1:
            return table
        n = next((i for i, u in enumerate(said) if u != said[0]), 0)
        raise ReadingError(
            f"line {table.lines[n]}: {named[0]} is {table.column(named[0])[n]!r}, and {table.column(named[0])[0]!r} on "
            f"line {table.lines[0]}; save all readings in one unit"
        )
    unit = units.copy().pop() if len(units) == 1 else "V"
    columns = {}
    for name in (n for n in table.names if n != named[0]):
        fields = table.column(name)
        if name in readings and len(units) > 1:
            read = [number_of(f, table.decimal) for f in fields]
            if lack := [
                i for i, v, u in zip(table.lines, read, said, strict=True) if v is not None and not u
            ]:
                raise ReadingError(f"line {lack[0]}: no {named[0]} is said, as on other lines")
            fields = [
                f if v is None else f"{v * IN_VOLTS[u]:.15g}".replace(".", table.decimal)
                for f, v, u in zip(fields, read, said, strict=True)
            ]
        columns[f"{name} [{unit}]" if name in readings else name] = fields
    return _with(table, columns, f"{named[0]}: the readings are in {' and '.join(sorted(units))}")


def _upright(table: Table) -> Table:
    """Turn a table whose columns are scans, named by their times or numbers, into one of rows."""
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
    places = [table.places[n] for n in others]
    names = (f"{word} [{unit}]" if unit else word, *others, "value")
    rows, lines = [], []
    for name, found in scans.items():
        place = table.places[name]
        for line, row in zip(table.lines, table.rows, strict=True):
            rows.append([found[2].replace(".", table.decimal), *(row[p] for p in places), row[place]])
            lines.append(line)
    said = (*table.remarks, f"{next(iter(scans))} ...: the columns are scans")
    return replace(table, names=names, rows=rows, lines=lines, remarks=said)


def _split_keys(table: Table) -> Table:
    """Split a column of names such as "3H", "vh[3]" or "S01 high" into strip and channel."""
    for name in table.names:
        fields = table.column(name)
        if meaning(name).role == "time" or any(number_of(f) is not None for f in {*fields}):
            continue
        kinds = meanings(sorted(set(fields)))
        if len(kinds) < 2 or any(
            m.role != "reading" or m.strip is None or not m.channel for m in kinds.values()
        ):
            continue
        if len({(m.strip, m.channel) for m in kinds.values()}) < len(kinds):
            continue
        columns = {n: table.column(n) for n in table.names if n != name}
        columns["strip"] = [str(kinds[f].strip) for f in fields]
        columns["channel"] = [kinds[f].channel for f in fields]
        if len(columns) < len(table.names) + 1:  # there is such a column already
            continue
        return _with(table, columns, f"{name}: strip and channel in one, such as {fields[0]!r}")
    return table


def _filled(table: Table) -> Table:
    """Fill a time or a scan's number down, where cells are merged or only the first line of a scan has it."""
    columns, told = {}, []
    for name in table.names:
        fields = columns[name] = table.column(name)
        blank = sum(not f for f in fields)
        role = meaning(name).role
        if not blank or not fields[0] or role not in ("time", "scan"):
            continue
        if role == "scan" and any(
            (number_of(f, table.decimal) or 0.0) % 1.0 for f in fields
        ):  # it counts nothing
            continue
        strips = any(meaning(n).role == "strip" for n in table.names)
        if (
            not strips
            and role == "time"
            and blank <= _FEW_BLANKS * len(fields)
            and len(set(fields)) > len(fields) - blank
        ):
            kept = [bool(f) for f in fields]
            rows = [row for row, k in zip(table.rows, kept, strict=True) if k]
            lines = [i for i, k in zip(table.lines, kept, strict=True) if k]
            out = [
                (i, " ".join(row)) for i, row, k in zip(table.lines, table.rows, kept, strict=True) if not k
            ]
            broken = tuple(sorted({*table.broken, *(i for i, _ in out)}))
            return _filled(
                replace(table, rows=rows, lines=lines, broken=broken, quotes={**table.quotes, **dict(out)})
            )
        last, filled = "", []
        for field in fields:
            last = field or last
            filled.append(last)
        columns[name] = filled
        told.append(f"{name}: empty fields are filled with the one above")
    return _with(table, columns, *told) if told else table


def _without_index(table: Table) -> Table:
    """Leave out a column without a name of its own that only counts the rows, as pandas writes it."""
    first = table.names[0]
    index = re.fullmatch(r"column 1|unnamed: ?\d+|index", first, re.IGNORECASE)
    if not (table.named and index and len(table.names) > 2):
        return table
    if clock_seconds(table.rows[0][0]) is not None:
        return table
    numbers = [number_of(f) for f in table.column(first)]
    if None in numbers or len(numbers) < 2 or (np.diff(np.array(numbers, dtype=float)) != 1.0).any():
        return table
    columns = {n: table.column(n) for n in table.names[1:]}
    return _with(table, columns, f"{first}: only counts the lines")

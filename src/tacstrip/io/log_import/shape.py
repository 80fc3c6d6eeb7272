"""The normal form of a table: a number in a field, a unit in a column, strip and channel in columns of their own."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.clocks import of_day_and_clock, of_one_clock, of_two_numbers
from tacstrip.io.log_import.fields import (
    array_of,
    clock_seconds,
    number_of,
    quantity,
    says_nothing,
)
from tacstrip.io.log_import.names import (
    CHANNELS,
    IN_VOLTS,
    READING_UNITS,
    TIME_UNITS,
    UNITS,
    is_other_unit,
    meaning,
    meanings,
)
from tacstrip.io.log_import.table import Table, flattened
from tacstrip.io.log_import.upright import upright

_ARRAYS = 0.5  # of a column's fields that say something: then it is one of arrays
_UNITS_COLUMN = re.compile(
    r"(?:\w+[ _.])?(?:units?|einheit(?:en)?|unit\u00e9s?|unidad|unit\u00e0)(?:[ _.]\w+)?", re.I
)
_PAIR = re.compile(r"[\[(<]?\s*(\S+?)(\s*[/|:;~&]\s*|\s+)(\S+?)\s*[\])>]?")  # of the two ends
_FEW_PAIRED = 4  # rows or columns: of fewer, what is alike may be so by chance
_FEW_KEYS, _SHOWN = 3, 5  # names of strips in a column; lines that are quoted
_MOSTLY_ONCE = 0.9  # of the rows: so many times are those of one row each, where some may stand twice
_FEW_BLANKS = 0.25  # of the rows: where more have no time, cells are merged


def in_normal_form(table: Table) -> Table:
    """Return a table in normal form; each change is told in its remarks.

    Arrays in fields become columns, units in fields go to the column's name, a column such as "3H" or "vh[3]" becomes
    two, merged cells are filled, a column that only counts the rows is left out, and columns of scans become rows.
    """
    steps: tuple[Callable[[Table], Table], ...] = (
        _without_empty, of_day_and_clock, of_one_clock, of_two_numbers, _spread, upright, _without_units,
        _of_halves, _held, _of_strips_only, _of_senders, _of_unit_column, _in_one_unit, _split_keys, _of_nothing,
        _filled, _without_index,
    )  # fmt: skip
    for step in steps:
        table = step(table) if table.rows else table
    return table


def _without_empty(table: Table) -> Table:
    """Leave out columns without a name and without a field, as where lines end with several separators."""
    columns = {n: table.column(n) for n in table.names}
    kept = {n: f for n, f in columns.items() if any(f) or not re.fullmatch(r"column \d+", n)}
    return table.with_columns(kept) if table.named and 0 < len(kept) < len(columns) else table


def _of_halves(table: Table) -> Table:
    """Put the lines of one end, which all stand below those of the other, beside these, where all else is the same."""
    half = len(table.rows) // 2
    for place, name in enumerate(table.names):
        words = [{row[place] for row in rows} for rows in (table.rows[:half], table.rows[half:])]
        if [*map(len, words)] != [1, 1] or 2 * half != len(table.rows) or half < _FEW_PAIRED:
            continue
        first, second = (of.pop() for of in words)
        apart = [
            n for n in range(len(table.names))
            if n != place and any(a[n] != b[n] for a, b in zip(table.rows[:half], table.rows[half:], strict=True))
        ]  # fmt: skip
        if {meaning(first).channel, meaning(second).channel} != {"h", "l"} or len(apart) != 1:
            continue
        kept = [n for n in range(len(table.names)) if n not in (place, *apart)]
        named = table.names[apart[0]] if table.named else ""
        rows = [
            [*(a[n] for n in kept), a[apart[0]], b[apart[0]]]
            for a, b in zip(table.rows[:half], table.rows[half:], strict=True)
        ]
        return replace(
            table, names=(*(table.names[n] for n in kept), f"{named} {first}".strip(), f"{named} {second}".strip()),
            rows=rows, lines=table.lines[:half],
            remarks=(*table.remarks, f"{name}: all lines of {first}, and then those of {second}: put side by side"),
        )  # fmt: skip
    return table


def _held(table: Table) -> Table:
    """Fill what is empty with what stood there before, where only changes are written: no value ever stands twice.

    So the first row is whole, and what comes again in it, which is no contact, is written where contacts end.
    """
    columns = {n: table.column(n) for n in table.names}
    holes = {n: fields for n, fields in columns.items() if not all(fields) and any(fields[1:])}
    if len(holes) < _FEW_PAIRED or not all(fields[0] for fields in holes.values()):
        return table
    written = {n: [f for f in fields if f] for n, fields in holes.items()}
    common, many = Counter(fields[0] for fields in holes.values()).most_common(1)[0]
    ends = sum(fields[1:].count(common) for fields in written.values())
    if (
        many < 2
        or ends < 2
        or any(a == b for fields in written.values() for a, b in itertools.pairwise(fields))
    ):
        return table
    for n, fields in holes.items():
        columns[n] = fields[:1]
        for field in fields[1:]:
            columns[n].append(field or columns[n][-1])
    told = "empty fields are as the last one above them: none is written that is as before"
    return replace(table.with_columns(columns), doubts=(*table.doubts, told))


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
    return table.with_columns(columns, told) if len(columns) == len(table.names) else table


def _spread(table: Table) -> Table:
    """Give arrays in fields a column for each element."""
    columns: dict[str, list[str]] = {}
    told = []
    for name in table.names:
        fields = table.column(name)
        arrays = [array_of(f) for f in fields] if any(f[:1] in ("[", "(") for f in fields) else _pairs(fields)
        said = [a for a, f in zip(arrays, fields, strict=False) if not says_nothing(f)]
        if not said or sum(a is not None for a in said) < _ARRAYS * len(said):
            columns[name] = fields
            continue
        spread = [flattened(name, a) if a is not None else {} for a in arrays]
        keys = tuple(dict.fromkeys(key for row in spread for key in row))
        columns |= {key: [row.get(key, "") for row in spread] for key in keys}
        told.append(f"{name}: arrays of {len(keys)}")
    if not told:
        return table
    return table.with_columns(columns, *told)


def _pairs(fields: list[str]) -> list[list[str] | None]:
    """Return fields such as "2.51 / 1.80" as pairs, if all that say something are; else none.

    Examples
    --------
    >>> _pairs(["--", "2.51 / 1.80"]), _pairs(["3/4/2026"]), _pairs(["12:05", "-"])
    ([None, ['2.51', '1.80']], [], [])
    """
    found = [None if says_nothing(f) else _PAIR.fullmatch(f) for f in fields]
    there = [m for m, f in zip(found, fields, strict=True) if not says_nothing(f)]
    halves = {h for m in there if m for h in (m[1], m[3])}
    if not there or None in there or len({m[2].strip() for m in there if m}) > 1:
        return []
    if not all(says_nothing(h) or any(number_of(h, mark) is not None for mark in ".,") for h in halves):
        return []
    if any(clock_seconds(f) is not None for f in fields):
        return []
    return [[m[1], m[3]] if m else None for m in found]


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
    return table.with_columns(columns, *told) if told else table


def _of_strips_only(table: Table) -> Table:
    """Leave out rows whose key names no strip, such as TEMP among 2H, 2L, ..., or S1, S2, ...; with a doubt."""
    for name in table.names:
        fields = table.column(name)
        kinds = meanings(sorted({*fields}))
        others = {f for f, m in kinds.items() if m.strip is None}
        if not others or len(kinds) - len(others) < _FEW_KEYS or meaning(name).role in ("time", "scan"):
            continue
        words = all(re.fullmatch(r"\D*[^\W\d_]{2}\D*", f) and not says_nothing(f) for f in others)
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
            table.of_rows(kept),
            doubts=(*table.doubts, f"{said}: {name} is {', '.join(sorted(others))}, no strip's number; passed over"),
        )  # fmt: skip
    return table


def _of_senders(table: Table) -> Table:
    """Give the senders in topics such as "glove/left/strip0/vh" a column, if all send of the same strips and ends."""
    for name in table.names:
        fields = table.column(name)
        topics = {f: f.split("/") for f in {*fields}}
        lengths = {len(parts) for parts in topics.values()}
        for place in range(lengths.pop() - 1) if len(lengths) == 1 else ():
            senders: dict[str, set[str]] = {}
            for parts in topics.values():
                senders.setdefault(parts[place], set()).add("/".join(parts[:place] + parts[place + 1 :]))
            rest = meanings(sorted(set().union(*senders.values())))
            told = {(m.strip, m.channel) for m in rest.values() if m.strip is not None and m.channel}
            if len(senders) < 2 or len(told) < len(rest) or any(s != {*rest} for s in senders.values()):
                continue
            columns = {n: table.column(n) for n in table.names}
            columns["source"] = [topics[f][place] for f in fields]
            columns[name] = ["/".join(topics[f][:place] + topics[f][place + 1 :]) for f in fields]
            if len(columns) > len(table.names):
                return table.with_columns(columns, f"{name}: topics of {len(senders)} senders")
    return table


def _of_unit_column(table: Table) -> Table:
    """Give readings the unit that a column of units says, and bring those of several to volts."""
    named = [n for n in table.names if _UNITS_COLUMN.fullmatch(n.strip()) and any(table.column(n))]
    if len(named) != 1:
        return table
    table = _without_other_quantities(table, named[0])
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
    return table.with_columns(columns, f"{named[0]}: the readings are in {' and '.join(sorted(units))}")


def _without_other_quantities(table: Table, units: str) -> Table:
    """Leave out rows in another quantity's unit, such as degrees, of channels that have no reading; with a doubt."""
    fields = table.column(units)
    out = {n for n, f in enumerate(fields) if f and is_other_unit(f)}
    kept = [n for n in range(len(fields)) if n not in out]
    for name in table.names if out and kept else ():
        column = table.column(name)
        own = {column[n] for n in out}
        if (
            name == units
            or own & {column[n] for n in kept}
            or not all(re.search(r"[^\W\d_]", f) for f in own)
        ):
            continue
        said = f"{', '.join(sorted(own))} in {', '.join(sorted({fields[n] for n in out}))}"
        return replace(
            table.of_rows(kept),
            remarks=(*table.remarks, f"{name}: {said} is another quantity than the readings; passed over"),
        )  # fmt: skip
    return table


def _of_nothing(table: Table) -> Table:
    """Return rows of a scan that names no strip, in a log of a line per strip, as of one without contact.

    Where others of the same time name strips, such a row is of something else, and left out.
    """
    known = meanings(table.names)
    strips = [n for n, m in known.items() if m.role == "strip"]
    read = [n for n, m in known.items() if m.role == "reading"]
    if len(strips) == 1 and not read:  # else what is filled where the strip is, and only there
        there = [bool(f) for f in table.column(strips[0])]
        read = [n for n in table.names if n not in strips and [bool(f) for f in table.column(n)] == there]
    if len(strips) != 1 or not read:
        return table
    columns = [table.column(n) for n in (*strips, *read)]
    void = {n for n, fields in enumerate(zip(*columns, strict=True)) if all(map(says_nothing, fields))}
    void = {n for n in void if any(table.rows[n])}
    if not void or 2 * len(void) > len(table.rows):
        return table
    clocks = [table.column(n) for n, m in known.items() if m.role in ("time", "scan")]
    at = [*zip(*clocks, strict=True)] if clocks else [(n,) for n in range(len(table.rows))]
    touched = {at[n] for n in range(len(table.rows)) if n not in void}
    rows = [n for n in range(len(table.rows)) if n not in void or at[n] not in touched]
    whole = all(f for n, fields in enumerate(zip(*columns, strict=True)) if n not in void for f in fields)
    table = replace(
        table.of_rows(rows),
        absent=0 if whole else table.absent,
    )
    columns = [table.column(n) for n in strips]
    void = {k for k, n in enumerate(rows) if n in void}
    if not void:
        return table
    shown = next(f for k, f in enumerate(columns[0]) if k not in void)
    filled = [shown if n in void else f for n, f in enumerate(columns[0])]
    told = f"{len(void)} scan(s) without a strip: nothing touches in them"
    table = table.with_columns({n: filled if n == strips[0] else table.column(n) for n in table.names}, told)
    return replace(table, empty=table.empty | {table.lines[n] for n in void})


def _split_keys(table: Table) -> Table:
    """Split a column of names such as "3H", "vh[3]" or "S01 high" into strip and channel; take the strips of "S01"."""
    for name in table.names:
        fields = table.column(name)
        if meaning(name).role == "time" or any(
            number_of(f) is not None or clock_seconds(f) is not None for f in {*fields}
        ):
            continue
        kinds = meanings(sorted({*fields} - {""}))
        if len(kinds) < 2 or any(m.role != "reading" or m.strip is None for m in kinds.values()):
            continue
        ends = {m.channel for m in kinds.values()}
        if len({(m.strip, m.channel) for m in kinds.values()}) < len(kinds):
            continue
        # What is another one with each of these says the same.
        same = [n for n in table.names if n != name and _are_one_to_one(table.column(n), fields)]
        columns = {n: table.column(n) for n in table.names if n not in (name, *same)}
        others = meanings(tuple(columns)).values()
        if any(m.role == "strip" or m.strip is not None for m in others) or "channel" in columns:
            continue  # there is such a column already
        columns["strip"] = ["" if not f else str(kinds[f].strip) for f in fields]
        if "" not in ends and all(fields):
            columns["channel"] = [kinds[f].channel for f in fields]
            return table.with_columns(columns, f"{name}: strip and channel in one, such as {fields[0]!r}")
        if (
            ends == {""}
            and meaning(name).role != "strip"
            and len(kinds) >= _FEW_KEYS
            and any(m.channel for m in others)
        ):
            return table.with_columns(columns, f"{name}: the strip, as in {next(filter(None, fields))!r}")
    return table


def _are_one_to_one(one: list[str], other: list[str]) -> bool:
    return len({*zip(one, other, strict=True)}) == len({*one}) == len({*other})


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
            and len(set(fields)) > _MOSTLY_ONCE * (len(fields) - blank)
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
    return table.with_columns(columns, *told) if told else table


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
    return table.with_columns(columns, f"{first}: only counts the lines")

"""Times that stand in several columns, as one."""

from __future__ import annotations

import itertools
import re

from tacstrip.io.log_import.fields import clock_seconds, is_date
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.table import Table

_WHOLE_SECONDS = r"(?:[\d/.-]+[T ])?\d{1,2}:\d\d:\d\d"

_FEW, _LONG = 2, 6  # columns; digits of a part of a second: more are of nanoseconds


def of_day_and_clock(table: Table) -> Table:
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
    return table.with_columns(columns, f"{dates[0]} and {clocks[0]}: a date and a time of day")


def of_one_clock(table: Table) -> Table:
    """Put milliseconds that stand in a column of their own behind the seconds of a clock."""
    clocks = [n for n in table.names if all(re.fullmatch(_WHOLE_SECONDS, f) for f in table.column(n))]
    for name in [n for n in table.names if re.fullmatch(r"frac\w*[ _]sec\w*", n, re.I)]:
        columns = {n: table.column(n) for n in table.names if n != name}
        if len(clocks) == 1 and all(re.fullmatch(r"0?\.\d+|0", f) for f in table.column(name)):
            columns[clocks[0]] = [
                f"{a}.{b.partition('.')[2] or 0}"
                for a, b in zip(columns[clocks[0]], table.column(name), strict=True)
            ]
            return table.with_columns(
                columns, f"{clocks[0]} and {name}: a clock and the parts of its seconds"
            )
    for name in [n for n in table.names if (m := meaning(n)).role == "time" and m.unit in ("ms", "us")]:
        digits, fields = {"ms": 3, "us": 6}[meaning(name).unit], table.column(name)
        if len(clocks) != 1 or not all(f.isdigit() and len(f) <= digits for f in fields):
            continue
        columns = {n: table.column(n) for n in table.names if n != name}
        columns[clocks[0]] = [f"{a}.{b:0>{digits}}" for a, b in zip(columns[clocks[0]], fields, strict=True)]
        times = [clock_seconds(f) or 0.0 for f in columns[clocks[0]]]
        if not any(b < a for a, b in itertools.pairwise(times)):
            return table.with_columns(
                columns, f"{clocks[0]} and {name}: a clock and the parts of its seconds"
            )
    return table


def of_two_numbers(table: Table) -> Table:
    """Put nanoseconds that stand in a column of their own behind the seconds, as ROS writes a time."""
    first = table.names[:2] if not table.named and len(table.names) > _FEW else ()
    if first and all(re.fullmatch(r"1\d{9}", f) for f in table.column(first[0])):
        rest = table.column(first[1])
        if all(re.fullmatch(r"\d{1,9}", f) for f in rest) and any(len(f) > _LONG for f in rest):
            columns = {n: table.column(n) for n in table.names if n != first[1]}
            columns[first[0]] = [f"{a}{b:0>9}" for a, b in zip(columns[first[0]], rest, strict=True)]
            return table.with_columns(
                columns, f"{first[0]} and {first[1]}: seconds since 1970 and nanoseconds"
            )
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
        return table.with_columns(columns, f"{whole[0]} and {name}: seconds and their parts")
    return table

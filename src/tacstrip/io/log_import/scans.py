"""The scans of a log whose columns are known, as numbers; whatever is not clear stops with the line."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import TIME_UNITS, meaning
from tacstrip.io.log_import.table import NOTHING, Table, number_of

_DAY_S = 86400.0
_FEW_SCANS = 4  # of fewer, equal times tell nothing
_DATES = (
    "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S",
    "%m/%d/%Y %H:%M:%S.%f",
    "%m/%d/%Y %H:%M:%S",
    "%d/%m/%Y %H:%M:%S",
)


@dataclass(eq=False)
class LogScan:
    """A scan: time [s], values (strips, channels) in the log's unit, NaN for untouched strips, first line."""

    time_s: float
    values: FloatArray
    line: int


def clock_seconds(text: str) -> float | None:
    """Return a time of day or a date with time in seconds; None where it is neither."""
    if found := re.fullmatch(r"(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+)?))?", text.strip()):
        return int(found[1]) * 3600.0 + int(found[2]) * 60.0 + float((found[3] or "0").replace(",", "."))
    for form in ("", *_DATES):
        try:
            when = (
                datetime.strptime(text.strip().replace(",", "."), form)
                if form
                else datetime.fromisoformat(text.strip())
            )
        except ValueError:
            continue
        return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    return None


def field_value(text: str, decimal: str, untouched: frozenset[str] = frozenset()) -> float:
    """Return a reading, NaN where nothing touches; `ValueError` where it is neither."""
    if text.casefold() in NOTHING or text in untouched:
        return float("nan")
    value = number_of(text, decimal)
    if value is None or not np.isfinite(value):
        raise ValueError(text)
    return float("nan") if f"{value:g}" in untouched else value


def scans(table: Table, mapping: ColumnMapping) -> list[LogScan]:
    """Return a log's scans.

    Raises
    ------
    ReadingError
        A line that is broken, lacks a strip or a time, or holds something else than a reading; the message names it.
    """
    lack = [
        n
        for n in (*mapping.columns, mapping.time, mapping.scan, mapping.strip, mapping.which)
        if n and n not in table.names
    ]
    if lack:
        raise ReadingError(
            f"column {lack[0]!r} of the mapping is not in the log; it has: {', '.join(table.names)}"
        )
    if table.broken and mapping.broken_lines != "skip":
        raise ReadingError(
            f'line {table.broken[0]} is not like the others; leave such lines out with broken_lines = "skip"'
        )
    times = _times(table, mapping)
    found = list((_wide if mapping.wide else _long)(table, mapping, times))
    if not found:
        raise ReadingError("the log has no readings")
    for before, after in itertools.pairwise(found):
        if after.time_s < before.time_s:
            raise ReadingError(
                f"line {after.line}: the time falls from {before.time_s:.6g} s to "
                f"{after.time_s:.6g} s; sort the log by time, "
                "or cut it where the clock begins anew"
            )
    _check_repeated(found)
    return found


def _check_repeated(found: list[LogScan]) -> None:
    """Refuse a log in which one scan stands twice: the same time and readings, where all other times differ."""
    same = [(a, b) for a, b in itertools.pairwise(found) if a.time_s == b.time_s]
    if len(same) != 1 or len(found) < _FEW_SCANS:
        return
    before, after = same[0]
    if np.array_equal(before.values, after.values, equal_nan=True):
        raise ReadingError(
            f"line {after.line} has the time and the readings of line {before.line}: take one of them out"
        )


def _times(table: Table, mapping: ColumnMapping) -> FloatArray | None:
    """Return each row's time from the first on [s]; None where the log has none."""
    if not mapping.time:
        return None
    values = np.empty(len(table.rows))
    for n, (line, text) in enumerate(zip(table.lines, table.column(mapping.time), strict=True)):
        seconds = clock_seconds(text) if mapping.time_unit == "clock" else number_of(text, table.decimal)
        if seconds is None:
            raise ReadingError(f"line {line}: {mapping.time} is {text!r}, not a time")
        values[n] = seconds
    if mapping.time_unit != "clock":
        return np.asarray((values - values[0]) * TIME_UNITS[mapping.time_unit])
    days = np.cumsum(np.diff(values, prepend=values[0]) < -0.5 * _DAY_S)  # midnight
    return np.asarray(np.round(values - values[0] + days * _DAY_S, 6))  # seconds since 1970 hold no more


def _value(
    table: Table, mapping: ColumnMapping, n: int, name: str, place: int, untouched: frozenset[str]
) -> float:
    text = table.rows[n][place]
    try:
        return field_value(text, table.decimal, untouched)
    except ValueError:
        raise ReadingError(
            f"line {table.lines[n]}: {name} is {text!r}, not a number; if it stands for no "
            f"contact, --answer untouched={text}"
        ) from None


def _wide(table: Table, mapping: ColumnMapping, times: FloatArray | None) -> Iterator[LogScan]:
    untouched, channels = frozenset(mapping.untouched), mapping.channels
    places = []
    for name, what in mapping.columns.items():
        number, _, channel = what.rpartition(":")
        places.append(
            (name, table.names.index(name), int(number) - mapping.strip_base, channels.index(channel))
        )
        if not 0 <= places[-1][2] < mapping.strips:
            last = mapping.strip_base + mapping.strips - 1
            raise ReadingError(
                f"column {name!r} is of strip {number}, and strips are numbered {mapping.strip_base} to {last}"
            )
    there = {(strip, end) for _, _, strip, end in places}
    for strip in range(mapping.strips):
        for end, channel in enumerate(channels):
            if (strip, end) not in there:
                raise ReadingError(f"no column is of channel {channel} of strip {strip + mapping.strip_base}")
    if len(there) < len(places):
        raise ReadingError("two columns are of the same strip and channel")
    for n, line in enumerate(table.lines):
        values = np.full((mapping.strips, len(channels)), np.nan)
        for name, place, strip, end in places:
            values[strip, end] = _value(table, mapping, n, name, place, untouched)
        yield LogScan(_time(times, n, n, mapping), values, line)


def _time(times: FloatArray | None, row: int, scan: int, mapping: ColumnMapping) -> float:
    if times is not None:
        return float(times[row])
    return scan / mapping.rate_hz if mapping.rate_hz else 0.0


def _long(table: Table, mapping: ColumnMapping, times: FloatArray | None) -> Iterator[LogScan]:
    untouched, channels = frozenset(mapping.untouched), mapping.channels
    strips = _placed(strip_numbers(table, mapping.strip), table, mapping)
    which = (
        [_which(t, n) for n, t in zip(table.lines, table.column(mapping.which), strict=True)]
        if mapping.which
        else None
    )
    number = table.column(mapping.scan) if mapping.scan else None
    scan: LogScan | None = None
    seen: dict[tuple[int, int], int] = {}
    count = last = -1
    for n, line in enumerate(table.lines):
        names = mapping.columns.items()
        targets = [
            (name, table.names.index(name), channels.index(which[n] if which else what))
            for name, what in names
        ]
        again = any((strips[n], end) in seen for _, _, end in targets)
        if number is not None:
            new = last < 0 or number[n] != number[last]
        elif times is not None and scan is not None and not again:
            new = bool(times[n] != times[last]) and strips[n] <= strips[last] and not which
        else:
            new = last < 0 or again
        if new:
            if scan is not None:
                yield _complete(scan, seen, mapping)
            count += 1
            scan, seen = (
                LogScan(
                    _time(times, n, count, mapping), np.full((mapping.strips, len(channels)), np.nan), line
                ),
                {},
            )
        elif again:
            earlier = seen[strips[n], targets[0][2]]
            raise ReadingError(
                f"line {line}: strip {table.column(mapping.strip)[n]} is already on line "
                f"{earlier} of the same scan"
            )
        assert scan is not None
        for name, place, end in targets:
            scan.values[strips[n], end] = _value(table, mapping, n, name, place, untouched)
            seen[strips[n], end] = line
        last = n
    cut = bool(table.broken) and scan is not None and table.broken[-1] > scan.line
    if scan is not None and not (cut and len({strip for strip, _ in seen}) < mapping.strips):
        yield _complete(scan, seen, mapping)


def _complete(scan: LogScan, seen: dict[tuple[int, int], int], mapping: ColumnMapping) -> LogScan:
    there = {strip for strip, _ in seen}
    if len(there) < mapping.strips and mapping.missing != "untouched":
        lack = next(s for s in range(mapping.strips) if s not in there) + mapping.strip_base
        raise ReadingError(
            f"the scan from line {scan.line} has no line for strip {lack}; if only touched "
            f"strips have lines, --answer missing=untouched"
        )
    return scan


def strip_numbers(table: Table, column: str) -> list[int]:
    """Return the strip of each line as the log numbers it: "3", "S3", "strip 03".

    Raises
    ------
    ReadingError
        A field is none, or two of them, as 3H and 3L, would be the same strip.
    """
    found: list[int] = []
    texts: dict[int, str] = {}
    for line, text in zip(table.lines, table.column(column), strict=True):
        digits, named = re.findall(r"\d+", text), bool(re.search("[A-Za-z]", text))
        value = (
            number_of(text, table.decimal) if not named else float(digits[0]) if len(digits) == 1 else None
        )
        if value is None or value != int(value):
            raise ReadingError(f"line {line}: {column} is {text!r}, not a strip's number")
        first = texts.setdefault(int(value), text)
        if first != text and (named or re.search("[A-Za-z]", first)):
            raise ReadingError(
                f"line {line}: {column} is {text!r}, and {first!r} elsewhere: both strip {int(value)}? Put the channel "
                "into a column of its own"
            )
        found.append(int(value))
    return found


def _placed(strips: list[int], table: Table, mapping: ColumnMapping) -> list[int]:
    """Return strips counted from 0."""
    first, last = mapping.strip_base, mapping.strip_base + mapping.strips - 1
    for line, strip in zip(table.lines, strips, strict=True):
        if not first <= strip <= last:
            raise ReadingError(f"line {line}: strip {strip} is out of range {first} to {last}")
    return [strip - first for strip in strips]


def _which(text: str, line: int) -> str:
    channel = meaning(text).channel
    if channel not in ("h", "l"):
        raise ReadingError(f"line {line}: {text!r} names neither of the channels h and l")
    return channel

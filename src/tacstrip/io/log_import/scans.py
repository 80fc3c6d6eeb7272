"""The scans of a log whose columns are known, as numbers; whatever is not clear stops with the line."""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import clock_times, is_date, is_of_two, number_of, says_nothing
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import CLOCKS, meaning, seconds_of
from tacstrip.io.log_import.table import NoTableError, Table

_DAY_S = 86400.0
_HALF_HOUR_S = 1800.0
_FEW_FALLS = 0.34  # of the scans: where the time falls more often, the log is unsorted
_FEW_ODD = 0.05  # of a column's numbers: more are no slip of single fields
_FEW_CYCLES = 3  # of all strips in their turn
_FEW_STEPS = 2  # of a time that falls: fewer may be a clock that begins anew
_FEW_SCANS = 4  # of fewer, equal times tell nothing
_LONG_AGO = 1e8  # of any unit: a time that does not count from the log's start
_HEADED = 0.9  # of the scans: so many have a line above their rows that is none
_A_PERIOD = 0.97  # of the time from scan to scan: lines of one scan, each with its own time, are less apart
_ON_PLACE = 0.05  # of the pitch: so near a strip's place is its position
_EXPONENT = re.compile(r"(?<=\d)[.,]\d+[eE][+-]?\d+\s*\Z")  # as numpy writes whole numbers, too
BOUND = re.compile(r"[<>]\d+(?:\.\d+)?(?:e[+-]?\d+)?")  # readings below, or above, stand for no contact


@dataclass(eq=False)
class LogScan:
    """A scan: time [s], values (strips, channels) in the log's unit, NaN for untouched strips, first line."""

    time_s: float
    values: FloatArray
    line: int


def field_value(text: str, decimal: str, untouched: frozenset[str] = frozenset(), zero: float = 0.0) -> float:
    """Return a reading above `zero`, NaN where nothing touches; `ValueError` where it is neither."""
    if says_nothing(text) or text in untouched:
        return float("nan")
    value = number_of(text, decimal)
    if value is None or not math.isfinite(value):
        raise ValueError(text)
    value -= zero
    if not untouched:
        return value
    bounds = [u for u in untouched if BOUND.fullmatch(u)]
    beyond = any(value < float(u[1:]) if u[0] == "<" else value > float(u[1:]) for u in bounds)
    return float("nan") if f"{value:g}" in untouched or beyond else value


def scans(table: Table, mapping: ColumnMapping, dropped: list[int] | None = None) -> list[LogScan]:
    """Return a log's scans; to `dropped` go the first lines of those that broken lines may have been of.

    Raises
    ------
    ReadingError
        A line that is broken, lacks a strip or a time, or holds something else than a reading; the message names it.
    """
    lack = [
        n
        for n in (*mapping.columns, mapping.time, mapping.scan, mapping.strip, mapping.which)
        if n and n not in table.places
    ]
    if lack:
        raise NoTableError(
            f"column {lack[0]!r} of the mapping is not in the log; it has: {', '.join(table.names)}"
        )
    if table.broken and mapping.broken_lines != "skip":
        raise ReadingError(
            f'line {table.broken[0]} is not like the others; leave such lines out with broken_lines = "skip"'
        )
    if table.absent and mapping.missing != "untouched":
        raise ReadingError(
            f"line {table.absent} lacks a value that others have; if it is no contact, --answer missing=untouched"
        )
    table = _without_idle_inputs(table.where(mapping.only), mapping)
    _check_digits(table, mapping)
    sort = _oldest_first if is_newest_first(table, mapping) else _by_number
    table = _by_date(sort(table, mapping), mapping)
    ordered, times = _in_order(table, _times(table, mapping), mapping)
    found = list(_scans(ordered, times, mapping, [] if dropped is None else dropped, ordered is not table))
    if not found:
        raise ReadingError("the log has no readings")
    found = _from_one_clock(found, mapping)
    _check_repeated(found)
    if mapping.strip_order == "descending":
        found = [replace(s, values=s.values[::-1]) for s in found]
    if listed := mapping.order_of_strips("strip_order"):
        found = [replace(s, values=s.values[np.argsort(listed)]) for s in found]
    return in_turn(found, mapping.turn)


def _without_idle_inputs(table: Table, mapping: ColumnMapping) -> Table:
    """Return a table without the lines of inputs beyond the strips that never have a reading, where more are listed."""
    if not mapping.strip or mapping.strip_names or mapping.strip_step:
        return table
    numbers = strip_numbers(table, mapping)
    if len({*numbers}) <= mapping.strips:
        return table
    there = range(mapping.strip_base, mapping.strip_base + mapping.strips)
    out = {*numbers} - {*there} - {*inputs_read(table, mapping.strip, [*mapping.columns])}
    return table.of_rows(n for n, number in enumerate(numbers) if number not in out) if out else table


def inputs_read(table: Table, strip: str, columns: Sequence[str]) -> set[float | None]:
    """Return the numbers of inputs, in the column of the strip, of which some line has a reading."""
    fields = zip(table.column(strip), *map(table.column, columns), strict=True)
    return {number_of(number) for number, *read in fields if any(f and not says_nothing(f) for f in read)}


def in_turn(scans: list[LogScan], turn: str) -> list[LogScan]:
    """Return the scans of a turn such as "1/2", all where it is ""; times begin with the first of them."""
    if not turn:
        return scans
    place, _, many = turn.partition("/")
    taken = scans[int(place) - 1 :: int(many)]
    return [LogScan(s.time_s - taken[0].time_s, s.values, s.line) for s in taken]


def _from_one_clock(found: list[LogScan], mapping: ColumnMapping) -> list[LogScan]:
    """Return scans in the order of time, where the clock began anew as the mapping says."""
    anew = [n for n, (a, b) in enumerate(itertools.pairwise(found), 1) if b.time_s < a.time_s]
    if not anew:
        return found
    few = len(anew) <= _FEW_FALLS * len(found)
    if mapping.restart == "error" or not few:
        before, after = found[anew[0] - 1 : anew[0] + 1]
        raise ReadingError(
            f"line {after.line}: the time falls from {before.time_s:.6g} s to {after.time_s:.6g} s; sort the log"
            + (", or say restart=continue, first or last" if few else "")
        )
    if mapping.restart in ("first", "last"):
        part = found[: anew[0]] if mapping.restart == "first" else found[anew[-1] :]
        return [LogScan(s.time_s - part[0].time_s, s.values, s.line) for s in part]
    steps = np.diff([s.time_s for s in found])
    usual = float(np.median(steps[steps >= 0.0])) if (steps >= 0.0).any() else 0.0
    shift, moved = 0.0, [found[0]]
    for n, scan in enumerate(found[1:], 1):
        if n in anew:
            shift += found[n - 1].time_s - scan.time_s + usual
        moved.append(LogScan(scan.time_s + shift, scan.values, scan.line))
    return moved


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


def _check_digits(table: Table, mapping: ColumnMapping) -> None:
    """Refuse few numbers in digits of another script, or base 16, than all others of their column."""
    for name in filter(None, (mapping.time, *mapping.columns)):
        texts = table.column(name)
        if not any("0x" in text or "0X" in text or not text.isascii() for text in texts):
            continue
        read = [(n, text, _digits(text)) for n, text in enumerate(texts) if any(c.isdigit() for c in text)]
        usual = Counter(digits for *_, digits in read).most_common(1)[0][0] if read else ""
        odd = [(n, text) for n, text, digits in read if digits != usual and text.strip() != "0"]
        if len(read) > 2 and 0 < len(odd) <= max(1.0, _FEW_ODD * len(read)):
            n, text = odd[0]
            raise ReadingError(
                f"line {table.lines[n]}, {name}: {text.strip()!r} is in other digits than the other numbers there; is "
                "it one? Mend it, or empty it"
            )


def _digits(text: str) -> str:
    """Return what a number is written in: "0x", or the 0 of its script."""
    if text.strip().casefold().startswith("0x"):
        return "0x"
    digit = next(c for c in text if c.isdigit())
    return chr(ord(digit) - unicodedata.digit(digit))


def raw_times(table: Table, mapping: ColumnMapping) -> FloatArray:
    """Return each row's time in the unit of its column, seconds of a clock."""
    values = np.empty(len(table.rows))
    fields = table.column(mapping.time)
    clock = mapping.time_unit in CLOCKS
    colons = Counter(text.count(":") for text in fields)
    if clock and len(colons) > 1:  # minutes and seconds among hours
        usual = colons.most_common(1)[0][0]
        line, text = next((i, f) for i, f in zip(table.lines, fields, strict=True) if f.count(":") != usual)
        raise ReadingError(f"line {line}: {mapping.time} is {text!r}, and of another form on other lines")
    minutes = 60.0 if mapping.time_unit == "hh:mm" and all(is_of_two(text) for text in fields) else 1.0
    read = clock_times(fields) if clock else [number_of(text, table.decimal) for text in fields]
    for n, (line, text, time) in enumerate(zip(table.lines, fields, read, strict=True)):
        if time is None:
            raise ReadingError(f"line {line}: {mapping.time} is {text!r}, not a time")
        values[n] = time * minutes
    return values


def is_newest_first(table: Table, mapping: ColumnMapping) -> bool:
    """Return whether the time falls all through a log, as where the newest line stands first, and no scans count up."""
    if mapping.scan:
        counts = [number_of(f, table.decimal) or 0.0 for f in table.column(mapping.scan)]
        if any(b > a for a, b in itertools.pairwise(counts)):
            return False
    steps = np.diff(raw_times(table, mapping)) if mapping.time and len(table.rows) > 1 else np.zeros(1)
    return bool((steps <= 0.0).all() and (steps < 0.0).sum() >= _FEW_STEPS)


def _oldest_first(table: Table, mapping: ColumnMapping) -> Table:
    """Return a table whose newest line stands first in the order of time, lines of one time as they stand."""
    times = raw_times(table, mapping)
    order = np.argsort(times, kind="stable")
    if (
        len({*times.tolist()}) < len(times) and mapping.strip
    ):  # where strips fall within a scan, these are backwards, too
        order = np.arange(len(times))[::-1] if _strips_fall(table, mapping, times) else order
    return table.of_rows(order)


def _by_number(table: Table, mapping: ColumnMapping) -> Table:
    """Return rows in the order of their scans' numbers, where lines of several scans stand among each other."""
    numbers = [number_of(f, table.decimal) for f in table.column(mapping.scan)] if mapping.scan else [None]
    columns = [table.column(n) for n in (mapping.scan, mapping.strip, mapping.which) if n]
    if None in numbers or not mapping.time or len({*zip(*columns, strict=True)}) < len(table.rows):
        return table
    order = np.argsort(np.array(numbers, dtype=float), kind="stable")
    if (np.diff(raw_times(table, mapping)[order]) < 0.0).any():  # as where a counter begins anew
        return table
    return table.of_rows(order)


def is_unsorted(table: Table, mapping: ColumnMapping) -> bool:
    """Return whether lines of a strip each, with dates, are not in the order of time, and no strip twice in a scan."""
    keys = [n for n in (mapping.time, mapping.strip, mapping.which) if n]
    if mapping.time_unit != "clock" or not (mapping.time and mapping.strip):
        return False
    dated = all(is_date(f.strip().replace("T", " ").split(" ")[0]) for f in table.column(mapping.time))
    falls = (np.diff(raw_times(table, mapping)) < 0.0).sum() if dated else 0
    runs = [*itertools.groupby(table.column(mapping.strip))]
    return (
        falls > _FEW_STEPS
        and len(runs) > 2 * len({*table.column(mapping.strip)})  # else one strip stands below another
        and len({*zip(*(table.column(n) for n in keys), strict=True)}) == len(table.rows)
    )


def _by_date(table: Table, mapping: ColumnMapping) -> Table:
    if not is_unsorted(table, mapping):
        return table
    return table.of_rows(np.argsort(raw_times(table, mapping), kind="stable"))


def _strips_fall(table: Table, mapping: ColumnMapping, times: FloatArray) -> bool:
    steps = np.diff(strip_numbers(table, mapping))[np.diff(times) == 0.0]
    return bool((steps <= 0).all() and (steps < 0).any())


def _times(table: Table, mapping: ColumnMapping) -> FloatArray | None:
    """Return each row's time from the first on [s]; None where the log has none."""
    if not mapping.time:
        return None
    values = raw_times(table, mapping)
    falls = np.diff(values, prepend=values[0])
    if mapping.time_unit in CLOCKS:
        if mapping.time_unit != "hh:mm" and not any(
            text.count(":") > 1 for text in table.column(mapping.time)
        ):
            values = values + 2.0 * _HALF_HOUR_S * np.cumsum(falls < -_HALF_HOUR_S)
        days = np.cumsum((falls < -0.5 * _DAY_S) & (falls > -_DAY_S))  # midnight
        return np.asarray(np.round(values - values[0] + days * _DAY_S, 6))  # seconds since 1970 hold no more
    if mapping.time_bits:
        full = 2.0**mapping.time_bits
        values = values + full * np.cumsum(falls < -0.5 * full)
    elif abs(values[0]) > _LONG_AGO:  # since 1970: the first is taken off before digits are lost
        fields = table.column(mapping.time)
        if all(re.fullmatch(r"\d+(?:\.\d+)?", f) for f in fields):
            first = Fraction(fields[0])
            values = np.array([float(Fraction(f) - first) for f in fields])
    return np.asarray((values - values[0]) * seconds_of(mapping.time_unit))


def _in_order(
    table: Table, times: FloatArray | None, mapping: ColumnMapping
) -> tuple[Table, FloatArray | None]:
    """Return rows by time, where they stand strip after strip, each through all times."""
    if times is None or not (mapping.strip or mapping.which):
        return table, times
    keys = [n for n in (mapping.strip, mapping.which) if n]
    groups: dict[tuple[str, ...], list[int]] = {}
    for n, key in enumerate(zip(*(table.column(k) for k in keys), strict=True)):
        groups.setdefault(key, []).append(n)
    runs = list(groups.values())
    alike = len({tuple(times[run]) for run in runs}) == 1
    apart = all(run[-1] - run[0] == len(run) - 1 for run in runs)  # each stands in one piece
    rising = all((np.diff(times[run]) > 0.0).all() for run in runs)
    if (
        (np.diff(times) >= 0.0).all()
        or len(runs) < 2
        or max(map(len, runs)) < 2
        or not (rising and (alike or apart))
    ):
        return table, times
    times = times if alike else _by_scan(times, runs)
    order = [n for _, _, n in sorted((times[n], place, n) for place, run in enumerate(runs) for n in run)]
    rows, lines = [table.rows[n] for n in order], [table.lines[n] for n in order]
    return replace(table, rows=rows, lines=lines), times[order] - times[order[0]]


def _by_scan(times: FloatArray, runs: Sequence[Sequence[int]]) -> FloatArray:
    """Return each row's time as that of its scan's first where each strip, or its channel, has a time of its own.

    Rows are of one scan that are nearer to each other than half the usual time from one row of a run to its next; the
    times stay as they are where that would put two rows of a run into one scan.
    """
    apart = 0.5 * float(np.median(np.concatenate([np.diff(times[run]) for run in runs])))
    first, shared = -np.inf, times.copy()
    for n in np.argsort(times, kind="stable"):
        first = times[n] if times[n] - first >= apart else first
        shared[n] = first
    distinct = all(len({*shared[run]}) == len(run) for run in runs)
    return shared if distinct else times


def _scans(
    table: Table, times: FloatArray | None, mapping: ColumnMapping, dropped: list[int], by_time: bool = False
) -> Iterator[LogScan]:
    """Yield scans: a new one begins with the next number or time, or when a strip comes again.

    Of lines that were put in order `by_time`, those of one time are a scan, as where scans share theirs.

    One that lacks strips is dropped if a broken line may have been of it: what it said of them is not known.
    """
    untouched, channels = frozenset(mapping.untouched), mapping.channels
    strips = _placed(strip_numbers(table, mapping), table, mapping) if mapping.strip else None
    which = which_channels(table, mapping) if mapping.which else None
    columns = _targets(table, mapping)
    targets = [
        [
            (name, place, strips[n] if strips else strip, channels.index(which[n]) if which else end)
            for name, place, strip, end in columns
        ]
        for n in range(len(table.lines))
    ]
    places = [[(strip, end) for *_, strip, end in of] for of in targets]
    begins = [*_begins(table, times, mapping, strips, which, places, by_time)]
    parts = [*itertools.pairwise([*begins, len(table.lines)])]
    backwards = not by_time and table.lines[0] > table.lines[-1]  # the newest stood first
    broken = _broken_beside(table, parts)
    headings = frozenset() if backwards else _headings(table, parts)
    ended = np.inf if backwards else 0.0
    for count, (first, after) in enumerate(parts):
        time = float(times[first]) if times is not None else count / (mapping.rate_hz or np.inf)
        scan = LogScan(time, np.full((mapping.strips, len(channels)), np.nan), table.lines[first])
        seen: dict[tuple[int, int], int] = {}
        for n in range(first, after):
            for name, place, strip, end in targets[n]:
                text, line = table.rows[n][place], table.lines[n]
                try:
                    scan.values[strip, end] = field_value(text, table.decimal, untouched, mapping.zero)
                except ValueError:
                    raise ReadingError(
                        f"line {line}: {name} is {text!r}, not a number; if it stands for no contact, "
                        f"--answer untouched={text}"
                    ) from None
                seen[strip, end] = line
        until = table.lines[after] if after < len(table.lines) else 0.0 if backwards else np.inf
        low, high = (until, ended) if backwards else (ended, until)
        if (above := scan.line - 1) in headings:
            low = above
        lacks = (mapping.strip or mapping.which) and len(seen) < scan.values.size
        if lacks and (mapping.missing == "skip" or any(low < b < high for b in broken)):
            dropped.append(scan.line)
        else:
            yield _complete(scan, seen, mapping)
        ended = table.lines[after - 1]


def _broken_beside(table: Table, parts: Sequence[tuple[int, int]]) -> list[int]:
    """Return the broken lines that may have been of a scan of which others are read; `parts` are scans' rows.

    What stands below the rows with something else in between is of none. Where lines hold several strips, and each
    scan is one line, a broken one is a scan of its own.
    """
    every = {*table.lines}
    if len(every) < len(table.lines) and all(table.lines[a] == table.lines[b - 1] for a, b in parts):
        return []
    consecutive = max(every) - min(every) == len(every) - 1
    return [b for b in table.broken if not (consecutive and b > max(every) + 1)]


def _headings(table: Table, parts: Sequence[tuple[int, int]]) -> frozenset[int]:
    """Return the lines above scans that are no rows, if nearly all have one: nothing above them is of a scan below."""
    rows = {*table.lines, *table.broken}
    above = [line - 1 for first, _ in parts if (line := table.lines[first]) - 1 not in rows]
    return frozenset(above) if len(above) >= _HEADED * len(parts) else frozenset()


def _begins(
    table: Table, times: FloatArray | None, mapping: ColumnMapping, strips: list[int] | None,
    which: Sequence[str] | None, places: Sequence[Sequence[tuple[int, int]]], by_time: bool,
) -> Iterator[int]:  # fmt: skip
    """Yield the rows with which scans begin; `places` are the strip and the channel of each value of each row."""
    period = _A_PERIOD * _period(times, strips) if times is not None and strips else np.inf
    if times is not None and strips is not None:
        keys = list(zip(strips, which or [""] * len(strips), strict=True))
        by_time = by_time or are_of_one_time(times.tolist(), keys)
    number = table.column(mapping.scan) if mapping.scan else None
    seen: dict[tuple[int, int], int] = {}
    for n, line in enumerate(table.lines):
        last = n - 1
        again = any(place in seen for place in places[n])
        twice = again and strips and mapping.strips > 1 and strips[n] == strips[last] and len(seen) > 1
        if n and not table.empty.isdisjoint((line, table.lines[last])):
            new = line != table.lines[last]
        elif number is not None and n:
            new = number[n] != number[last]
        elif by_time and times is not None and n:
            new = bool(times[n] != times[last])
        elif twice and times is not None and times[n] == times[last] and not which:
            new = False
        elif times is not None and n and strips and not again:
            later = strips[n] <= strips[last] or times[n] - times[last] > period
            new = bool(times[n] != times[last]) and later and not which
        else:
            new = not n or again
        if new:
            yield n
            seen = {}
        elif again:
            strip, end = next(place for place in places[n] if place in seen)
            raise NoTableError(
                f"line {line}: strip {strip + mapping.strip_base} is already on line {seen[strip, end]} of its scan"
            )
        seen |= dict.fromkeys(places[n], line)


def are_of_one_time(times: Sequence[object], keys: Sequence[tuple[object, object]]) -> bool:
    """Return whether lines of one scan have one time: those of a time are of several strips, and of none twice.

    Parameters
    ----------
    times, keys
        Of each line: its time, and the strip and channel that it is of.

    Examples
    --------
    >>> keys = [(4, "h"), (5, "h"), (3, "h"), (4, "h")]
    >>> are_of_one_time([0, 0, 1, 1], keys), are_of_one_time([0, 1, 2, 3], keys), are_of_one_time([0, 0, 0, 0], keys)
    (True, False, False)
    """
    runs = [
        [key for _, key in run] for _, run in itertools.groupby(zip(times, keys, strict=True), lambda z: z[0])
    ]
    cycle = keys[: len({*keys})]
    strips = [strip for strip, _ in cycle]
    in_order = strips in (sorted(strips), sorted(strips, reverse=True))  # type: ignore[type-var]
    if (
        in_order
        and len(keys) >= _FEW_CYCLES * len(cycle)
        and all(key == cycle[n % len(cycle)] for n, key in enumerate(keys))
    ):
        return False  # each strip comes in its turn, which tells a scan whatever the times are
    several = sum(len({strip for strip, _ in run}) > 1 for run in runs)
    return 2 * several > len(runs) and all(len({*run}) == len(run) for run in runs)


def _period(times: FloatArray, strips: list[int]) -> float:
    """Return the usual time from one line of a strip to its next; inf where no strip has two times."""
    at: dict[int, float] = {}
    steps = []
    for time, strip in zip(times.tolist(), strips, strict=True):
        steps += [time - at[strip]] if at.get(strip, time) < time else []
        at[strip] = time
    return float(np.median(steps)) if steps else np.inf


def _targets(table: Table, mapping: ColumnMapping) -> list[tuple[str, int, int, int]]:
    """Return name, place, strip and channel of the columns; what another column says of a row is 0 here."""
    channels, first = mapping.channels, mapping.strip_base
    targets = []
    for name, what in mapping.columns.items():
        number, _, channel = what.rpartition(":")
        strip = 0 if mapping.strip else int(number or first) - first
        end = 0 if mapping.which else channels.index(channel)
        targets.append((name, table.places[name], strip, end))
        if not 0 <= strip < mapping.strips:
            last = first + mapping.strips - 1
            raise ReadingError(
                f"column {name!r} is of strip {number}, and strips are numbered {first} to {last}"
            )
    there = {(strip, end) for _, _, strip, end in targets}
    if len(there) < len(targets):
        raise ReadingError("two columns are of the same strip and channel")
    if not mapping.strip:
        listed = (
            {strip for strip, _ in there} if mapping.missing == "untouched" else set(range(mapping.strips))
        )
        for strip in sorted(listed):
            for end, channel in enumerate(("",) if mapping.which else channels):
                if (strip, end) not in there:
                    raise NoTableError(
                        f"no column is of{' channel ' + channel + ' of' if channel else ''} strip {strip + first}"
                    )
    return targets


def _complete(scan: LogScan, seen: dict[tuple[int, int], int], mapping: ColumnMapping) -> LogScan:
    there = {strip for strip, _ in seen}
    if mapping.which and len(seen) < 2 * len(there):
        strip, end = next((s, e) for s in there for e in (0, 1) if (s, e) not in seen)
        raise ReadingError(
            f"the scan from line {scan.line} has no line for channel {'hl'[end]} of strip {strip + mapping.strip_base}"
        )
    if len(there) < mapping.strips and mapping.missing != "untouched":
        lack = next(s for s in range(mapping.strips) if s not in there) + mapping.strip_base
        raise ReadingError(
            f"the scan from line {scan.line} has no line for strip {lack}; if only touched "
            f"strips have lines, --answer missing=untouched"
        )
    return scan


def strip_numbers(table: Table, mapping: ColumnMapping) -> list[int]:
    """Return the strip of each line as the log numbers it: "3", "S3", "#3", "strip 03", or where it lies.

    Raises
    ------
    ReadingError
        A field is none, or two of them, as 3H and 3L, would be the same strip.
    """
    found: list[int] = []
    texts: dict[int, str] = {}
    column = mapping.strip
    if names := [n.casefold() for n in mapping.strip_names]:
        fields = table.column(column)
        if odd := [n for n, f in enumerate(fields) if f.casefold() not in names]:
            raise NoTableError(
                f"line {table.lines[odd[0]]}: {column} is {fields[odd[0]]!r}, not a strip's name"
            )
        return [names.index(f.casefold()) for f in fields]
    for line, text in zip(table.lines, table.column(column), strict=True):
        digits, named = re.findall(r"\d+", text), bool(re.search("[A-Za-z#]", _EXPONENT.sub("", text)))
        letter = re.fullmatch(r"(?:\w{2,}[\s_-]+)?([A-Za-z])", text.strip())
        if letter:
            value: float | None = ord(letter[1].casefold()) - 97.0
        else:
            value = (
                number_of(text, table.decimal)
                if not named
                else float(digits[0])
                if len(digits) == 1
                else None
            )
        if value is not None and mapping.strip_step:
            value = value / mapping.strip_step
            value -= 0.5 * (abs(value % 1.0 - 0.5) < _ON_PLACE)  # the middle of a strip
            value = round(value) + mapping.strip_base if abs(value - round(value)) < _ON_PLACE else None
        if value is None or value != int(value):
            raise NoTableError(f"line {line}: {column} is {text!r}, not a strip's number")
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


def which_channels(table: Table, mapping: ColumnMapping) -> list[str]:
    """Return of which channel each row is, "h" or "l"; `ReadingError` where a field names neither."""
    fields = table.column(mapping.which)
    if mapping.which_h:
        other = next((f for f in fields if f != mapping.which_h), "")
        known = {mapping.which_h: "h", other: "l"}
    else:
        known = {f: meaning(f).channel for f in set(fields)}
    for line, text in zip(table.lines, fields, strict=True):
        if known.get(text) not in ("h", "l"):
            raise ReadingError(f"line {line}: {text!r} names neither of the channels h and l")
    return [known[text] for text in fields]

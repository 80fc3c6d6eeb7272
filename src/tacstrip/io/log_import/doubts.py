"""What speaks against reading a log as its names and sizes suggest: each doubt is asked or refused, with its place."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.input_checks import counted_down
from tacstrip.io.log_import.fields import clock_seconds, number_of
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import CLOCKS, TIME_UNITS, meanings, seconds_of, unknown_unit
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import field_value, is_newest_first, raw_times
from tacstrip.io.log_import.supply import ask_for_vref
from tacstrip.io.log_import.table import CLOCK, ROW, Table
from tacstrip.io.log_import.words import all_are

_APART = 5.0  # times: nothing lies between numbers of two units, or around one that lost its point
_RATIOS = (30.0, 3000.0)  # of the medians of two such groups
_AS_FAR = 2.0  # times: so far the one group, multiplied, may reach beyond the other
_NO_VOLTS = 24.0  # nothing that large is in volts
_FEW = 0.05  # of the readings: more are no slip of single fields
_NEAR = 0.5  # of the least of the others: what may be as it stands
_ALIKE = 8  # readings of a column: as many tell how its numbers are written
_SHOWN = 3
# Of an oscilloscope, which as a rule has done it.
_ATTENUATED = re.compile(
    r"\battenuat\w+|(?<!\w)(?:[x\u00d7] ?\d+|\d+ ?[x\u00d7]|1:\d+|\d+:1) ?probe|\bprobes?\W{0,3}"
    r"(?:[x\u00d7] ?\d|\d+ ?[x\u00d7]|\d+:1)",
    re.IGNORECASE,
)
_LONGEST = 100  # characters of a comment that are quoted
_DIGITS_NEAR = 0.25  # of a reading: so much it may move from scan to scan where one between is cut
_DRIFT = 0.05  # of the time: clocks that differ by less may drift


def raise_doubts(clues: Clues, mapping: ColumnMapping) -> None:
    """Ask for, or refuse, what contradicts the mapping.

    Raises
    ------
    ReadingError
        Readings of two units in one log, columns of a unit that is none of readings, another Vref than the spec's.
    """
    if "unit" not in clues.answers:
        noise = "untouched" in {*clues.answers, *(q.key for q in clues.questions)}  # small ones may be that
        _of_one_unit(clues, mapping, only_lost=noise)
        _of_known_units(clues, mapping)
    _written_alike(clues, mapping)
    _cut_codes(clues, mapping)
    ask_for_vref(clues)
    _attenuated(clues)
    _two_clocks(clues, mapping)
    used = {*mapping.columns, mapping.time, mapping.scan, mapping.strip, mapping.which}
    for name in clues.table.names:
        if name in used or name in clues.answers or not all_are(name.replace("_", " "), "validity"):
            continue
        fields = clues.table.column(name)
        at = dict(zip(clues.table.lines, fields, strict=True))
        # One that only says where nothing touches is the same in all lines with readings.
        if len({at[line] for line, *_ in _readings(clues, mapping)}) > 1:
            line = clues.table.lines[next(n for n, f in enumerate(fields) if f != fields[0])]
            clues.ask(
                name,
                f"{name!r} is {fields[0]!r} on line {clues.table.lines[0]} and another on line {line}: if it says that "
                "readings are void, empty these; or pass it over",
                "skip",
            )


def _readings(clues: Clues, mapping: ColumnMapping) -> Iterator[tuple[int, str, str, float]]:
    """Yield line, column, text and value of each reading of more than 0."""
    void = frozenset(mapping.untouched)
    for name in mapping.columns:
        for line, text in zip(clues.table.lines, clues.table.column(name), strict=True):
            try:
                value = field_value(text, clues.table.decimal, void)
            except ValueError:
                continue
            if value > 0.0:
                yield line, name, text, value


def _of_one_unit(clues: Clues, mapping: ColumnMapping, only_lost: bool) -> None:
    """Refuse numbers of two sizes with nothing between, one about 100 or 1000 times the other and written otherwise.

    Perhaps only those that have lost their point.
    """
    read = sorted(_readings(clues, mapping), key=lambda r: r[3])
    values = np.array([r[3] for r in read])
    if len(values) < 2:
        return
    with np.errstate(over="ignore"):
        steps = values[1:] / values[:-1]
    places = [_places(r[2], clues.table.decimal) for r in read]
    # A few far above all others, alone without decimals: these have lost a point.
    tops = [n + 1 for n in np.flatnonzero(steps >= _APART) if n + 1 >= (1.0 - _FEW) * len(values)]
    lost = next((n for n in tops if not any(places[n:]) and min(places[:n]) > 0), 0)
    if only_lost and not lost:
        return
    cut = lost or int(np.argmax(steps)) + 1
    low, high = values[:cut], values[cut:]
    ratio = float(np.median(high)) / float(np.median(low))
    few = len(high) <= _FEW * len(values)
    if not lost and (high[0] < _APART * low[-1] or not _RATIOS[0] <= ratio <= _RATIOS[1]):
        return
    odd, others = (read[cut:], low) if len(high) <= len(low) else (read[:cut], high)
    small, large = max(places[:cut]), max(places[cut:])
    scales = {1000.0} | ({100.0} if few or low[-1] <= 1.0 else set())  # fractions beside percent
    # The larger numbers of two units have fewer decimals; else small ones are by the grounded end.
    if not lost and (high[-1] < _NO_VOLTS or not (few or small > large <= 1)):
        return
    up = 1.0 if odd[0][3] > others[0] else -1.0
    moved = [np.array([r[3] for r in odd]) * scale**-up for scale in scales]
    if not lost and not any(
        m.min() >= others[0] / _AS_FAR and m.max() <= _AS_FAR * others[-1] for m in moved
    ):
        return
    odd = sorted(odd)
    shown = "; ".join(f"line {line}, {name}: {text}" for line, name, text, _ in odd[:_SHOWN])
    more = f" and {len(odd) - _SHOWN} more" if len(odd) > _SHOWN else ""
    raise ReadingError(
        f"{shown}{more}: the other readings lie from {others[0]:g} to {others[-1]:g}; is a decimal point lost, or are "
        "these in another unit? Mend them, or say --answer unit=V (mV, code, ...) if all are in it as they stand"
    )


def _written_alike(clues: Clues, mapping: ColumnMapping) -> None:
    """Doubt a number that is written otherwise than all others of its column: a digit of it is lost, or another mark.

    All have as many decimals, or significant digits, or a digit before the mark. That numbers are not shortened is told
    by a 0 at the end of some.
    """
    decimal = clues.table.decimal
    bare = not any(text.lstrip("+-").startswith(f"0{decimal}") for *_, text, _ in _readings(clues, mapping))
    columns: dict[str, list[tuple[int, str]]] = {}
    for line, name, text, _ in _readings(clues, mapping):
        columns.setdefault(name, []).append((line, text.strip().lstrip("+-")))
    for name, read in columns.items():
        whole = [number_of(text, decimal) or 0.0 for _, text in read if text[0].isdigit()]
        least = _NEAR * min(whole, default=0.0)
        usual, _ = Counter(_places(text, decimal) for _, text in read).most_common(1)[0]
        fixed = usual > 1 and any(text.endswith("0") and _places(text, decimal) == usual for _, text in read)
        figures = {_figures(text) for _, text in read if _places(text, decimal) == usual}
        odd = [
            (line, text) for line, text in read
            if (text.startswith(decimal) and not (bare and float(f"0.{text[1:]}") > least))
            or (fixed and _places(text, decimal) != usual and figures != {_figures(text)})
        ]  # fmt: skip
        if len(read) >= _ALIKE and 0 < len(odd) <= max(1.0, _FEW * len(read)):
            line, text = odd[0]
            clues.doubt(
                f"line {line}, {name}: {text} is not written as the other numbers there, such as "
                f"{next(t for x in read if (t := x[1]) not in [o[1] for o in odd])}: is a digit lost?"
            )


def _cut_codes(clues: Clues, mapping: ColumnMapping) -> None:
    """Doubt a whole number that ends a line and is the beginning of one like those before and after it of its strip."""
    table = clues.table
    name = max(mapping.columns, key=table.places.__getitem__)
    if table.places[name] != len(table.names) - 1:
        return
    strips = table.column(mapping.strip) if mapping.strip else [""] * len(table.rows)
    read = {line: text for line, column, text, _ in _readings(clues, mapping) if column == name}
    for strip in dict.fromkeys(strips):
        rows = [line for line, s in zip(table.lines, strips, strict=True) if s == strip and line in read]
        for before, line, after in zip(rows, rows[1:], rows[2:], strict=False):
            around, text = (read[before], read[after]), read[line]
            if all(map(str.isdecimal, (*around, text))) and len(text) < min(map(len, around)):
                longer = len(around[0]) - len(text)
                near = all(_is_near(int(text) * 10**longer, int(a), 10**longer) for a in around)
                if near and len(around[0]) == len(around[1]):
                    clues.doubt(
                        f"line {line} ({text!r}): the last number has fewer digits than before and after it "
                        f"({' and '.join(around)}): cut there? Taken as it stands"
                    )


def _is_near(least: int, value: int, width: int) -> bool:
    """Return whether some of the numbers from `least`, as many as `width`, are near a value."""
    return (1.0 - _DIGITS_NEAR) * value <= least + width and least <= (1.0 + _DIGITS_NEAR) * value


def _attenuated(clues: Clues) -> None:
    """Doubt readings of which a comment says that a probe attenuates them."""
    for line in clues.table.preamble:
        text = " ".join(line.split()).lstrip("#%/! ")
        numbers = [float(n) for n in re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.])", text)]
        if _ATTENUATED.search(text) and not (numbers and {*numbers} == {1.0}):
            clues.doubt(
                f"the log says {text[:_LONGEST]!r}: readings are taken as they stand; "
                "if they must be scaled, do it first"
            )


def _two_clocks(clues: Clues, mapping: ColumnMapping) -> None:
    """Doubt the time where another column is a time, too, of day or in a known unit, and runs at another rate."""
    if not mapping.time or not mapping.time_unit:
        return
    own = raw_times(clues.table, mapping)
    unit = 1.0 if mapping.time_unit in CLOCKS else seconds_of(mapping.time_unit)
    span = (own[-1] - own[0]) * unit
    steps = np.diff(own)
    step = float(np.median(steps[steps > 0.0])) * unit if (steps > 0.0).any() else 0.0
    _own_times(clues, mapping, own, span)
    for name, said in meanings(clues.table.names).items():
        if said.role != "time" or name == mapping.time or name in clues.answers:
            continue
        first, last = (clues.table.column(name)[n] for n in (0, -1))
        ends = [
            clock_seconds(t) if (v := number_of(t, clues.table.decimal)) is None else v for t in (first, last)
        ]
        of_day = number_of(first, clues.table.decimal) is None
        if None in ends or (said.unit not in TIME_UNITS and not of_day):
            continue
        other = (float(ends[1] or 0.0) - float(ends[0] or 0.0)) * (1.0 if of_day else TIME_UNITS[said.unit])
        slack = _DRIFT * span + step + (1.0 if of_day and not re.search(r"[.,]\d", first) else 0.0)
        if span > 0.0 and other > 0.0 and abs(other - span) > slack:
            clues.doubt(
                f"{mapping.time!r} rises by {span:g} s over the log, and {name!r} by {other:g} s: {mapping.time!r} is "
                f"taken; else --answer {name!r}=time"
            )


def _own_times(clues: Clues, mapping: ColumnMapping, own: FloatArray, span: float) -> None:
    """Doubt a column of no known meaning that rises with the time, row by row as much, but lies apart from it."""
    steps = np.diff(own)
    taken = {*mapping.columns, mapping.time, mapping.scan, mapping.strip, mapping.which, CLOCK, ROW}
    for name in clues.table.names:
        if name in taken or name in clues.answers or mapping.time_unit in CLOCKS or not (steps > 0.0).any():
            continue
        other = np.array([np.nan if v is None else v for v in clues.values(name)])
        unit = seconds_of(mapping.time_unit or "s")
        apart = np.abs(other - own) * unit
        counts = {*steps.tolist()} <= {0.0, 1.0}  # as may any index
        step = float(np.median(steps[steps > 0.0]))
        alike = np.allclose(np.diff(other), steps, rtol=0.0, atol=_DRIFT * step)
        if alike and not counts and 0.5 * step * unit < apart.max() < span:
            clues.doubt(
                f"{name!r} rises as {mapping.time!r} does, {apart.max():g} s apart: if it is the time of some of the "
                f"readings, these are not of one scan; all are taken at {mapping.time!r}"
            )


def _figures(text: str) -> int:
    """Return the significant digits that a number is written with."""
    return len(re.sub(r"\D", "", text).lstrip("0"))


def _places(text: str, decimal: str) -> int:
    """Return the decimals that a number is written with."""
    return len(re.match(r"\d*", text.partition(decimal)[2]).group())  # type: ignore[union-attr]


def _of_known_units(clues: Clues, mapping: ColumnMapping) -> None:
    """Refuse columns that name a unit, or a factor, which is not known for readings."""
    if "unit" in {q.key for q in clues.questions}:  # of lengths, that is asked
        return
    said = {name: unknown_unit(name) for name in mapping.columns}
    strange = [name for name in said if said[name]]
    if (
        2 * len(strange) >= len(said) and len({said[name] for name in strange}) == 1
    ):  # else they are numbers of strips
        raise ReadingError(
            f"column {strange[0]!r}: {said[strange[0]]!r} is no unit of readings that is known; save them in "
            "V, mV, codes or over Vref, or say --answer unit=V (mV, code, ...) if the numbers are in that"
        )


def backwards(table: Table, mapping: ColumnMapping) -> list[str]:
    """Return a warning where the first scan's lines count its strips down, and the log's scans are not counted so."""
    if mapping.strips < 2 or mapping.strip not in table.places or is_newest_first(table, mapping):
        return []
    strips = [*dict.fromkeys(map(number_of, table.column(mapping.strip)))][: mapping.strips]
    last = mapping.strip_base + mapping.strips - 1
    down = strips == [*range(last, mapping.strip_base - 1, -1)]
    return [counted_down(mapping.strip_base, last)] if down else []

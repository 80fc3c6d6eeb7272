"""Which columns are the time, the scan, the strip and the name of the channel."""

from __future__ import annotations

import itertools
import re

import numpy as np

from tacstrip.io.log_import.column_blocks import answered_block
from tacstrip.io.log_import.contents import (
    are_times,
    are_whole,
    comes_again,
    count_strips,
    counts_up,
    names_strips,
    rises_as_a_clock,
    rises_evenly,
)
from tacstrip.io.log_import.fields import clock_seconds, number_of, says_nothing
from tacstrip.io.log_import.names import (
    LENGTHS_MM,
    TIME_UNITS,
    Meaning,
    meaning,
    pair_of,
    unit_in,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import inputs_read
from tacstrip.io.log_import.table import CLOCK, ROW

# So far, and s, two clocks may differ, of which one is read when a line has come.
_AS_LONG, _LATE_S = 0.25, 0.1
_CYCLES = 3  # of all inputs
_OFTEN = 10  # times that a number of a unit of time rises, if not evenly
_ON_PITCH = 0.02  # of the pitch

_NUMBER = re.compile(r"n|nr|no|num|number|id|idx|index|i|k|nummer|numero|numer", re.IGNORECASE)


def channel_column(clues: Clues, known: dict[str, Meaning]) -> str:
    """Return the column that says of which channel a line is."""
    if answered := [n for n, a in clues.answers.items() if a == "which" and n in known]:
        return answered[0]
    if clues.expected == ("out",):
        return ""
    strips = [n for n, m in known.items() if m.role == "strip"]
    for name, m in known.items():
        fields = set(clues.table.column(name))
        if len(fields) != 2 or name in clues.answers or m.role in ("time", "position"):
            continue
        if are_channels(fields) or (
            pair_of(_channels(fields)) and (m.role == "which" or (m.role == "strip" and len(strips) > 1))
        ):
            return name
    return ""


def _channels(fields: set[str]) -> set[str]:
    return {meaning(f).channel or f.casefold() for f in fields}


def are_channels(fields: set[str]) -> bool:
    """Return whether two words are the names of the two channels.

    Examples
    --------
    >>> are_channels({"TOP", "BOT"}), are_channels({"h", "l"}), are_channels({"1", "2"}), are_channels({"ok", "h"})
    (True, True, False, False)
    """
    channels = _channels(fields)
    worded = len(fields) == 2 and not any(number_of(f) is not None for f in fields)
    return worded and (channels == {"h", "l"} or bool(pair_of(channels)))


def with_time_by_unit(clues: Clues, known: dict[str, Meaning]) -> dict[str, Meaning]:
    """Return what columns are: the time is the only one of no known word in a unit of time that rises evenly.

    Or an index that rises and is not of whole numbers.
    """
    if any(m.role == "time" for m in known.values()):
        return known
    found = [
        n for n, m in known.items()
        if m.role in ("", "scan") and unit_in(n) in TIME_UNITS and n not in clues.answers
        and rises_as_a_clock(clues.values(n))
        and (rises_evenly(clues.values(n)) or (len(unit_in(n)) > 1 and len({*clues.values(n)}) >= _OFTEN))
    ]  # fmt: skip
    found = found or [
        n for n, m in known.items()
        if m.role == "scan" and n not in clues.answers and rises_as_a_clock(clues.values(n))
        and not are_whole(clues.values(n))
    ]  # fmt: skip
    return known | {n: Meaning("time", unit=unit_in(n)) for n in found if len(found) == 1}


def time_column(clues: Clues, known: dict[str, Meaning]) -> str:
    """Return the column of the time: that which never falls and says the most."""
    there = []
    dated = {n for n in known if n not in (ROW, *clues.answers) and are_times(clues.table.column(n))}
    for n in [name for name, m in known.items() if m.role == "time" or name in dated]:
        fields = clues.table.column(n)
        numbers = [number_of(f, clues.table.decimal) for f in fields]
        times = numbers if None not in numbers else [clock_seconds(f) for f in fields]
        if None in times:
            if n in clues.answers or (clock_seconds(fields[0]) or numbers[0]) is not None:
                there.append((n, True, 0))
            continue
        falls = any(b < a for a, b in itertools.pairwise(times) if a is not None and b is not None)
        there.append((n, not falls, len(set(times))))
    if (
        not there
        and (clues.table.named or "readings" in clues.answers)
        and not any(m.role == "time" for m in known.values())
    ):
        block = answered_block(clues) if "readings" in clues.answers else []
        nameless = [
            n
            for n in clues.table.names
            if re.fullmatch(r"column \d+", n) and n not in (*clues.answers, *block)
        ]
        wide = clues.sensor.strips * len(clues.expected) if clues.sensor else 0
        ends = {*nameless[:1], *nameless[-1:]} if len(nameless) != wide else set()  # else all are readings
        if any(m.role == "reading" for m in known.values()):
            ends = {*nameless}
        rising = [n for n in nameless if n in ends and rises_as_a_clock(clues.values(n))]
        for n in sorted(rising, key=lambda n: (are_whole(clues.values(n)), counts_up(clues.values(n))))[:1]:
            clues.because(f"{n}: has no name, and rises from line to line, so it is the time")
            there.append((n, True, len(set(clues.table.column(n)))))
    own = [n for n, rises, _ in there if n != CLOCK and rises]
    for name in [n for n in own if _contradicts_the_stamps(clues, n, known[n].unit)]:
        own.remove(name)
        there = [t for t in there if t[0] != name]
        clues.doubt(
            f"{name}: does not run as the times before the lines do, in no unit, so these are the time (if {name} is: "
            f"--answer {name}=time)"
        )
    if own:  # the device's own clock is better than a monitor's
        there = [t for t in there if t[0] != CLOCK]
    there = [t for t in there if t[2] > 1 or len(clues.table.rows) < 2] or there[:1]
    most = max((t[2] for t in there), default=0)  # one that never falls, but hardly ever rises, says little
    return (
        max(there, key=lambda t: (t[0] in clues.answers, t[1] and 2 * t[2] > most, t[2]))[0] if there else ""
    )


def _contradicts_the_stamps(clues: Clues, name: str, unit: str) -> bool:
    """Return whether a column of no known unit, such as T, spans in none what the times before the lines do."""
    if unit in TIME_UNITS or CLOCK not in clues.table.names or name in clues.answers:
        return False
    ends = [[clock_seconds(clues.table.column(CLOCK)[n]), clues.values(name)[n]] for n in (0, -1)]
    if any(v is None for row in ends for v in row):
        return False
    (stamp, own) = (float(last) - float(first) for first, last in zip(*ends, strict=True))
    stamp %= TIME_UNITS["days"]
    slack = _AS_LONG * stamp + (_LATE_S if "." in clues.table.column(CLOCK)[0] else 1.0)
    return stamp > slack and own >= 0.0 and not any(abs(own * u - stamp) < slack for u in TIME_UNITS.values())


def scan_column(clues: Clues, known: dict[str, Meaning], time: str) -> str:
    """Return the column of the scan's number: one that is not another on each line."""
    there = {n: len(set(clues.table.column(n))) for n, m in known.items() if m.role == "scan"}
    there = {
        n: c
        for n, c in there.items()
        if n in clues.answers or all(v is None or v % 1.0 == 0.0 for v in clues.values(n))
    }
    many = len(clues.table.rows)
    fit = {n: count for n, count in there.items() if n in clues.answers or 1 < count < many}
    return max(fit, key=lambda n: (n in clues.answers, fit[n])) if fit else ""


def strip_column(clues: Clues, known: dict[str, Meaning], which: str, wide: list[str]) -> tuple[str, float]:
    """Return the column of the strip, and from strip to strip where it says where that lies."""
    there = [n for n, m in known.items() if m.role == "strip" and n != which]
    there = [n for n in there if len(set(clues.table.column(n))) > 1 or n in clues.answers] or there[:1]
    if wide and there and not any(n in clues.answers for n in there):
        one = clues.sensor is not None and clues.sensor.strips == 1
        there = [n for n in there if len(set(clues.table.column(n))) > 1 and not one and len(wide) <= 2]
    if len(there) > 1 and not {*there} & {
        *clues.answers
    }:  # one that stays while another counts numbers the scans
        there = [n for n in there if not any(_counts_within(clues, o, n) for o in there if o != n)] or there
    if len(there) > 1 and not {*there} & {*clues.answers}:
        there = [n for n in there if _may_number_strips(clues, n)] or there
    if len(there) > 1:
        clues.ask(
            there[1],
            f"both {there[0]!r} and {there[1]!r} look like the strip: which is not?",
            "skip",
            of_form=True,
        )
    if there:
        return there[0], 0.0
    if wide:
        return "", 0.0
    if inner := _number_within_strips(clues, known):
        clues.because(f"{inner}: the number of a strip, beside its readings")
        return inner, 0.0
    for name, m in known.items():
        if m.role == "position" and (step := _pitches(clues, name, m.unit)):
            return name, step
    strips = clues.sensor.strips if clues.sensor else 0
    for name in [n for n, m in known.items() if m.role == "" and n != ROW]:
        words = {*clues.table.column(name)}
        if len(words) == strips and count_strips(words):
            clues.because(f"{name}: {strips} names that count, as many as strips, such as {min(words)!r}")
            return name, 0.0
    for name in [n for n, m in known.items() if m.role in ("", "which") and n not in (ROW, which)]:
        if names_strips(clues, name):
            clues.because(f"{name}: {strips} names, as many as strips, each once in a scan")
            return name, 0.0
    for name in clues.table.names:
        fields = clues.table.column(name)
        if name == ROW and (not strips or len(set(fields)) == strips):
            clues.because("each block has a line for each strip, in their order")
            return name, 0.0
        unknown = known[name].role in ("", "scan", "which") and name not in (ROW, which)
        if unknown and strips > 1 and comes_again(clues.values(name)) and len(set(fields)) == strips:
            clues.because(f"{name}: {strips} whole numbers that come again and again, as many as strips")
            return name, 0.0
        if (
            unknown
            and strips > 1
            and comes_again(clues.values(name))
            and _are_inputs(clues, name, len(set(fields)))
        ):
            clues.because(
                f"{name}: whole numbers that come again and again, of which some never have a reading"
            )
            return name, 0.0
    return "", 0.0


def _are_inputs(clues: Clues, name: str, many: int) -> bool:
    """Return whether `many` numbers are more than strips, and columns that are empty at times are so for the others."""
    some = [n for n in clues.table.names if n != name and any(map(says_nothing, clues.table.column(n)))]
    read = [v for v in inputs_read(clues.table, name, some) if v is not None]
    strips = clues.sensor.strips if clues.sensor else 0
    again = len(clues.table.rows) > _CYCLES * many  # else it may count the scans
    return strips < many and again and bool(read) and max(read) - min(read) < strips


def _may_number_strips(clues: Clues, name: str) -> bool:
    """Return whether a column's numbers lie within as many in a row as the sensor has strips."""
    numbers = [v for v in clues.values(name) if v is not None]
    return not numbers or clues.sensor is None or max(numbers) - min(numbers) < clues.sensor.strips


def _counts_within(clues: Clues, inner: str, outer: str) -> bool:
    """Return whether one column has each of its values once, in turn, while another one stays."""
    many = len({*clues.table.column(inner)})
    pairs = zip(clues.table.column(outer), clues.table.column(inner), strict=True)
    runs = [{i for _, i in run} for _, run in itertools.groupby(pairs, key=lambda pair: pair[0])]
    return many > 1 and len(runs) * many == len(clues.table.rows) and all(len(run) == many for run in runs)


def _number_within_strips(clues: Clues, known: dict[str, Meaning]) -> str:
    """Return the column such as "strips.n", a whole number in the same records as all readings; "" where none is."""
    parents = {n.rpartition(".")[0] for n, m in known.items() if m.role == "reading"}
    parent = parents.pop() if len(parents) == 1 else ""
    if meaning(parent.rpartition(".")[2]).role != "strip":
        return ""
    found = [
        n for n in clues.table.names
        if n.rpartition(".")[0] == parent and _NUMBER.fullmatch(n.rpartition(".")[2])
        and all(v is not None and v == int(v) for v in clues.values(n))
    ]  # fmt: skip
    return found[0] if len(found) == 1 else ""


def _pitches(clues: Clues, name: str, unit: str) -> float:
    """Return from strip to strip where a column's positions are those of the sensor's strips; else 0."""
    values = clues.values(name)
    if clues.sensor is None or any(v is None for v in values):
        return 0.0
    places = np.unique([v for v in values if v is not None])
    for scale in [LENGTHS_MM[unit]] if unit else LENGTHS_MM.values():
        step = clues.sensor.pitch_mm / scale
        numbers = places / step
        if np.abs(numbers % 1.0 - 0.5).max() < _ON_PITCH:  # the middle of each strip
            numbers = numbers - 0.5
        whole = (
            np.abs(numbers - np.round(numbers)) < _ON_PITCH
        ).all() and numbers.max() - numbers.min() >= 1.0
        if whole and numbers.min() > -0.5 and numbers.max() <= clues.sensor.strips - 0.5:
            clues.because(
                f"{name}: multiples of the pitch, {clues.sensor.pitch_mm:g} mm, so they are the strips"
            )
            return step
    return 0.0

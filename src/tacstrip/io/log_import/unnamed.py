"""Which columns are readings where their names do not say it: by what they hold, and how many there are."""

from __future__ import annotations

import re
from dataclasses import replace

from tacstrip.io.log_import import conversion
from tacstrip.io.log_import.column_blocks import ask_for_block, by_neighbours, readings_of_block
from tacstrip.io.log_import.contents import (
    comes_again,
    count_strips,
    counts_up,
    is_numeric,
    names_strips,
    rises_as_a_clock,
    rises_evenly,
)
from tacstrip.io.log_import.ends import strip_too
from tacstrip.io.log_import.fields import clock_seconds, says_nothing
from tacstrip.io.log_import.names import (
    SIDES,
    Meaning,
    derived_words,
    is_strip_word,
    meaning,
    numbered_groups,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.roles import are_channels
from tacstrip.io.log_import.table import CLOCK, PART, ROW

_OF_SIDES = 3  # strips: a left one, a right one, and one between
_FEW_STATES = 4  # distinct numbers of a flag
_MOST_ASKED = 6  # columns, of each of which is asked what it is


def readings_by_contents(
    clues: Clues, known: dict[str, Meaning], taken: set[str], given: dict[str, str]
) -> dict[str, Meaning]:
    """Return as readings the columns of numbers that are left, if there are as many as channels; else ask."""
    left = [
        n
        for n, m in known.items()
        if n not in taken
        and n not in given
        and m.role in ("", "which", "position")
        and n != ROW
        and is_numeric(clues, n)
    ]
    which = next((n for n in taken if n in known and known[n].role == "which"), "")
    many = (1,) if which or clues.expected == ("out",) else (2,) if clues.expected else (1, 2)
    wide = clues.sensor.strips * many[0] if clues.sensor else 0
    some = [n for n, m in known.items() if n not in {*taken, *given, ROW} and m.role not in ("time", "strip")]
    if sum(known[n].role != "scan" for n in some) == wide:
        some = [n for n in some if known[n].role != "scan"]
    some = [n for n in some if is_numeric(clues, n) or all(map(says_nothing, clues.table.column(n)))]
    if len(some) > wide > 1:
        some = _without_flags(clues, some, wide)
    if len(some) >= wide > 1:
        if len(some) == wide and all(re.fullmatch(r"column \d+", n) for n in some):
            clues.because(f"{wide} columns without names are the strips in their order")
            return readings_of_block(clues, some, known, which)
        block = ask_for_block(clues, "no name says of which strip a column is", some, wide)
        return readings_of_block(clues, block, known, which)
    if len(left) > many[-1]:
        left = _without_flags(clues, left, 1)
    if len(left) in many and taken - {""}:
        _ask_for_derived(clues, left)
        clues.because(f"{' and '.join(left)}: the only numbers that are left, so they are the readings")
        channels = ("1", "2") if len(left) == 2 else ("",)
        return {n: Meaning("reading", c, unit=known[n].unit) for n, c in zip(left, channels, strict=True)}
    shown = ", ".join(clues.table.names[:8]) + (", ..." if len(clues.table.names) > 8 else "")
    text = f"no column's name says that it holds readings (they are: {shown}); say it, of each that does"
    free = [n for n in clues.table.names if n not in {*taken, *given, ROW, CLOCK}]
    for name in (left or free or list(clues.table.names))[-_MOST_ASKED:]:
        clues.ask(
            name, text, *(clues.expected or ("h", "l", "out")), "skip", *strip_too(clues, name), of_form=True
        )
        text = "or of this one"
    clues.stop()
    raise AssertionError


def _ask_for_derived(clues: Clues, names: list[str]) -> None:
    """Ask for the first column whose name says that it holds something made of readings."""
    summed = {"sum"} if conversion.summed(clues.table.preamble) else set()
    odd = [n for n in names if derived_words(n) - summed]
    if odd:
        clues.ask(
            odd[0], f"{odd[0]!r} is called neither a reading nor an end of a strip: which is it? (A middle, a width or "
            "a difference of two ends is no reading)", *(clues.expected or ("h", "l", "out")), "skip",
        )  # fmt: skip
        clues.stop()


def readings_by_words(clues: Clues, known: dict[str, Meaning], taken: set[str]) -> dict[str, Meaning]:
    """Return as readings the columns whose names are the same but for one word, if these are as many as strips.

    Of three that are left, right and another, the left one is the first strip; the order of others is asked.
    """
    if clues.expected != ("out",) or not clues.sensor or clues.sensor.strips < _OF_SIDES:
        return {}
    groups: dict[tuple[str, ...], dict[str, str]] = {}
    for name in [n for n in known if n not in taken and is_numeric(clues, n)]:
        words = re.findall(r"[^\W\d_]+|\d+", name.casefold())
        for n in range(len(words)):
            groups.setdefault((*words[:n], "", *words[n + 1 :]), {})[words[n]] = name
    found = [
        g for rest, g in groups.items() if len(g) == clues.sensor.strips and any(map(is_strip_word, rest))
    ]
    if len(found) != 1 or all(w.isdecimal() for w in found[0]):
        return {}
    words, block = [*found[0]], [*found[0].values()]
    if len(block) == _OF_SIDES and any({left, right} < {*words} for left, right in SIDES):
        left, right = next(pair for pair in SIDES if {*pair} < {*words})
        block.sort(key=lambda n: (n != found[0][left]) + (n == found[0][right]))
        clues.because(f"{', '.join(block)}: the strips from the left")
    else:
        clues.ask(
            "readings", f"the strips are called {', '.join(block)}: in which order do they lie, from the first one on?",
            *by_neighbours(clues, block),
        )  # fmt: skip
    return readings_of_block(clues, block, known, "")


def _without_flags(clues: Clues, names: list[str], least: int) -> list[str]:
    """Return columns without those of a few whole numbers, as of states, if at least so many are left."""
    there = {n: {v for v in clues.values(n) if v is not None} for n in names}
    left = [n for n, found in there.items() if len(found) > _FEW_STATES or any(v % 1.0 for v in found)]
    return left if len(left) >= least else names


def readings_by_number(clues: Clues, known: dict[str, Meaning], taken: set[str]) -> dict[str, Meaning]:
    """Return as readings the columns whose names are the same but for a number, if these are as many as strips."""
    groups = [
        group
        for group in numbered_groups(
            [n for n, m in known.items() if n not in taken and m.role in ("", "which")]
        )
        if all(is_numeric(clues, n) or all(map(says_nothing, clues.table.column(n))) for n in group.values())
        and any(len(set(clues.table.column(n))) > 1 for n in group.values())
        and (not clues.sensor or len(group) == clues.sensor.strips)
    ]
    if (
        len(groups) not in ((1, 2) if not clues.expected else (len(clues.expected),))
        or len({*map(len, groups)}) != 1
    ):
        return {}
    if len(groups) == 2:
        _ask_for_derived(clues, [g[min(g)] for g in groups if g[min(g)] not in clues.answers])
    clues.because(f"{' and '.join(g[min(g)] for g in groups)}, ...: the only names that count as strips do")
    channels = ("1", "2") if len(groups) == 2 else ("",)
    return {
        name: Meaning("reading", channel, number, unit=known[name].unit)
        for channel, group in zip(channels, groups, strict=True)
        for number, name in group.items()
    }


def with_other_end(
    clues: Clues, known: dict[str, Meaning], readings: dict[str, Meaning], taken: set[str]
) -> dict[str, Meaning]:
    """Return readings of one end with the only other columns that count as these do: R1 beside L1; others are asked."""
    ends = {m.channel for m in readings.values()}
    strips = {m.strip for m in readings.values()}
    if clues.expected != ("h", "l") or len(ends) != 1 or not ends <= {"h", "l"} or None in strips:
        return readings
    left = [n for n, m in known.items() if n not in {*readings, *taken, *clues.answers} and m.role == ""]
    groups = [
        g for g in numbered_groups(left) if {*g} == strips and all(is_numeric(clues, n) for n in g.values())
    ]
    groups = [g for g in groups if any(len(set(clues.table.column(n))) > 1 for n in g.values())]
    lack = "l" if ends == {"h"} else "h"
    for group in groups:
        first, one = group[min(group)], next(iter(readings))
        if (
            len(groups) == 1
            and ends == {"l"}
            and re.match(r"[Rr]\W*\d", first)
            and re.match(r"[Ll]\W*\d", one)
        ):
            clues.because(f"{one} and {first}, ...: left and right are the two ends")
            sides = {n: replace(m, channel="left") for n, m in readings.items()}
            return sides | {
                n: Meaning("reading", "right", i, known[n].unit or readings[one].unit)
                for i, n in group.items()
            }
        clues.ask(
            first, f"{first!r}, ... are as many as the strips, as are {one!r}, ... (v_{min(ends)}): are they v_{lack}?",
            lack, "skip",
        )  # fmt: skip
    if groups:
        clues.stop()
    return readings


def roles_without_names(clues: Clues) -> dict[str, Meaning]:
    """Say what the columns of a table without names are, from their number and how they rise."""
    sensor, names = clues.sensor, [n for n in clues.table.names if n not in (CLOCK, ROW, PART)]
    found = {n: Meaning("") for n in clues.table.names}
    labels = [n for n in names if not n.startswith("column ")]  # of lines between blocks
    found |= {n: meaning(n) for n in labels}
    texts = {n: set(clues.table.column(n)) for n in names}
    which = [n for n in names if are_channels(texts[n])]
    which = [n for n in which if {meaning(t).channel for t in texts[n]} == {"h", "l"}] or which
    which = [n for n in names if clues.answers.get(n) == "which"] or which
    if sensor and not which and len(names) - len(labels) == sensor.strips and len(clues.expected) == 2:
        which = [n for n in (ROW,) if n in clues.table.names and {*clues.table.column(n)} == {"0", "1"}]
    constant = [
        n for n in names if len(texts[n]) == 1 and not (is_numeric(clues, n) or says_nothing(*texts[n]))
    ]
    names = [n for n in names if n not in (*labels, *which, *constant)]
    found |= {n: Meaning("which") for n in which}
    values = {n: clues.values(n) for n in names}
    channels = 1 if which else max(len(clues.expected), 1)
    wide = channels * sensor.strips if sensor else 0
    clocks = [n for n in names if all(clock_seconds(t) is not None for t in texts[n])]
    rising = [n for n in names if rises_as_a_clock(values[n]) or n in clocks]
    spare = len(names) - wide - len(set(rising) & set(names[:2]))
    if sensor and spare > 0 and not any(clues.table.column(names[-1])):  # each line ends with a separator
        names = names[:-1]
    extra, rest = names[: len(names) - wide], names[len(names) - wide :]
    clear = (
        len(extra) < 2 or extra[0] in clocks or counts_up(values[extra[0]])
    )  # else one may be a strip, and the last not
    clear = clear and (not extra or extra[-1] in clocks or rises_evenly(values[extra[-1]]))
    if sensor and len(extra) <= 2 and clear and set(rising) >= set(extra) and len(rest) == wide:
        found |= {n: Meaning("scan") for n in extra[:-1]} | {n: Meaning("time") for n in extra[-1:]}
        if extra:
            clues.because(f"{extra[-1]}: rises from line to line, so it is the time")
        found |= readings_of_block(clues, rest, found, "".join(which[:1]))
        clues.because(f"{wide} columns without names are the {sensor.strips} strips in their order")
        return found
    if found_long := _of_lines_per_strip(clues, found, names, values, rising, clocks, channels):
        return found_long
    if len(names) > wide > 1 and not labels:
        block = ask_for_block(
            clues, f"the {len(names)} columns have no names", names[names[0] in rising :], wide
        )
        found |= {n: Meaning("time") for n in rising[:1] if n not in block}
        return found | readings_of_block(clues, block, found, "".join(which[:1]))
    first = (names or list(clues.table.names))[0]
    nameless = sum(n.startswith("column ") for n in clues.table.names)
    clues.ask(
        first,
        f"the {nameless} columns have no names: say what each is (which: the channel's name)"
        + ("" if sensor else "; or name the SENSOR, whose strips may tell"),
        "time", "scan", "strip", "which", *(clues.expected or ("h", "l"))[:2], of_form=True,
    )  # fmt: skip
    clues.stop()
    raise AssertionError


def _of_lines_per_strip(
    clues: Clues, found: dict[str, Meaning], names: list[str], values: dict[str, list[float | None]],
    rising: list[str], clocks: list[str], channels: int,
) -> dict[str, Meaning]:  # fmt: skip
    """Return what columns are where one has the strips in turn, and as many as channels are left; else none."""
    cycles = [
        n for n in names
        if comes_again(values[n]) or count_strips({*clues.table.column(n)}) or names_strips(clues, n)
    ]  # fmt: skip
    rest = [n for n in names if n not in cycles and n not in rising]
    told = ROW in clues.table.names or "strip" in {m.role for m in found.values()}
    placed = len(cycles) == 1 or (not cycles and told)
    if not placed or len(rest) not in (1, 2) or (clues.sensor and len(rest) != channels):
        return {}
    ends = "ab" if len(rest) == 2 else ("",)
    found = found | {n: Meaning("reading", c) for n, c in zip(rest, ends, strict=True)}
    found |= {n: Meaning("time" if n == rising[-1] or n in clocks else "scan") for n in rising}
    for name in cycles:
        found[name] = Meaning("strip")
        clues.because(f"{name}: numbers or names that come again and again, so they are the strips")
    return found

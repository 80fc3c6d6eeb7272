"""What a column holds, whatever its name: numbers that rise, that come again and again, times of day, labels."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from tacstrip.io.log_import.fields import clock_seconds, number_of, says_nothing
from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.questions import Clues

CLOCK_BITS = (16, 32)
_STEADY, _MOSTLY = 0.1, 0.7  # so far are steps of a clock from the usual one, and so many of them
_FEW_SCANS = 3
_WORD = re.compile(r"[^\W\d_]{2}")
_SEVERAL = 1.5  # lines of a scan, in the mean
_FEW_WORDS = 2  # among numbers: one may stand for no contact, which is asked


def are_whole(values: list[float | None]) -> bool:
    """Return whether all numbers are whole."""
    return all(v is None or v == round(v) for v in values)


def are_times(fields: list[str]) -> bool:
    """Return whether all fields are times of day or dates."""
    return all(number_of(f) is None and clock_seconds(f) is not None for f in fields)


def may_label_strips(clues: Clues, name: str) -> bool:
    """Return whether a column may say which strip a line is of: a few labels or whole numbers that come again."""
    fields = clues.table.column(name)
    numbers = [v for v in clues.values(name) if v is not None]
    return 1 < len(set(fields)) <= len(fields) // 2 and all(v == int(v) for v in numbers)


def names_strips(clues: Clues, name: str) -> bool:
    """Return whether a column has as many words as the sensor has strips, each but once among lines of one scan.

    Not words that count, or of an end. A scan ends before the first word that comes again.
    """
    fields = clues.table.column(name)
    words = {*fields}
    strips = clues.sensor.strips if clues.sensor else 0
    if (
        len(words) != strips
        or strips < _FEW_SCANS
        or any(re.search(r"[\d,]", w) or not _WORD.search(w) for w in words)
    ):
        return False
    if any(m.strip is not None or m.channel for m in meanings(sorted(words)).values()):
        return False
    begins, seen = [0], set[str]()
    for n, field in enumerate(fields):
        if field in seen:
            begins.append(n)
            seen = set()
        seen.add(field)
    return len(fields) > _SEVERAL * len(begins) > _SEVERAL * _FEW_SCANS


def counts_strips(clues: Clues, name: str, same: Sequence[str]) -> bool:
    """Return whether a column counts up or down by one on lines of one scan, which are alike in other columns (`same`).

    From another number in some scans: else it may only count their lines.
    """
    numbers = [-1.0 if v is None else v for v in clues.values(name)]
    keys = [*zip(*map(clues.table.column, same), strict=True)]
    lines = zip(keys, numbers, strict=True)
    scans = [[v for _, v in of] for _, of in itertools.groupby(lines, lambda line: line[0])] if keys else []
    steps = {b - a for scan in scans for a, b in itertools.pairwise(scan)}
    return (
        min(numbers) >= 0.0
        and steps in ({1.0}, {-1.0})
        and sum(len(scan) > 1 for scan in scans) >= _FEW_SCANS
        and len({scan[0] for scan in scans}) > 1 < len({scan[-1] for scan in scans})
    )


def is_numeric(clues: Clues, name: str) -> bool:
    """Return whether a column is of numbers, but for what says that nothing touches."""
    fields = [f for f in clues.table.column(name) if not says_nothing(f)]
    words = {f for f in fields if number_of(f, clues.table.decimal) is None}
    numbers = sum(f not in words for f in fields)
    return (
        4 * numbers > len(fields) and len(words) < _FEW_WORDS and not any(re.search(r"\d", f) for f in words)
    )


def count_strips(texts: set[str]) -> bool:
    """Return whether words count strips, as "/skin/0", "/skin/1", ..."""
    kinds = meanings(sorted(texts))
    named = all(m.role == "reading" and m.strip is not None and not m.channel for m in kinds.values())
    worded = not any(number_of(t) is not None for t in texts)
    return worded and named and len({m.strip for m in kinds.values()}) == len(texts) > 2


def counts_up(values: list[float | None]) -> bool:
    """Return whether numbers go up by one, or stay."""
    return set(np.diff([np.nan if v is None else v for v in values]).tolist()) <= {0.0, 1.0}


def rises_evenly(values: list[float | None]) -> bool:
    """Return whether numbers go up as a clock's do: by steps that are mostly alike."""
    steps = np.diff([np.nan if v is None else v for v in values])
    steps = steps[steps > 0.0]
    usual = np.median(steps) if len(steps) else 0.0
    return len(steps) > 0 and bool((np.abs(steps - usual) <= _STEADY * usual).mean() >= _MOSTLY)


def rises_as_a_clock(values: list[float | None]) -> bool:
    """Return whether numbers never fall, but where the bits of a clock are full."""
    numbers = [v for v in values if v is not None]
    steps = np.diff(numbers)
    if len(numbers) < len(values) or len(numbers) < 2:
        return False
    falls = steps[steps < 0.0]
    if (
        len(falls) == 1 and len(steps) > 2 and all(v % 1.0 == 0.0 for v in numbers)
    ):  # a clock whose bits are full
        over = [falls[0] + 2.0**bits for bits in CLOCK_BITS if max(numbers) < 2.0**bits]
        return any(0.0 < o <= 2.0 * steps.max() for o in over)
    return bool((steps >= 0.0).all()) and numbers[-1] > numbers[0]


def comes_again(values: list[float | None]) -> bool:
    """Return whether these are whole numbers from 0 or 1 on, all as often, in runs that begin anew."""
    if any(v is None or v != int(v) for v in values) or len(values) < 4:
        return False
    numbers = [int(v) for v in values if v is not None]
    many = Counter(numbers)
    distinct = sorted(many)
    return (
        len(distinct) > 1
        and distinct == list(range(distinct[0], distinct[0] + len(distinct)))
        and distinct[0] in (0, 1)
        and len(set(many.values())) == 1
        and (numbers[: len(distinct)] == distinct or numbers[: len(distinct)] == distinct[::-1])
    )

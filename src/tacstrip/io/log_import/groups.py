"""Lines that list only the touched strips, a group of fields for each: a row for each group."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.tokens import VALUE, Line

_MOSTLY = 0.9  # of the lines that hold values have the form
_LONGEST = 40  # marks and fields of a group, and of what stands before the first
_BETWEEN = 5  # marks between two groups
_FEW_LINES = 4


def in_groups(lines: Sequence[Line], values: int) -> tuple[list[Line], list[int]] | None:
    """Return a row for each group of `values` numbers, and the lines that have none, with an empty row; else None.

    What stands before the first group belongs to each. Lines must hold different numbers of groups.

    Examples
    --------
    >>> from tacstrip.io.log_import.tokens import parted
    >>> log = ["20 [(3, 612, 430), (4, 630, 445)]", "40 [(3, 615, 433)]", "60 []"] * 2
    >>> rows, empty = in_groups([parted(n, line) for n, line in enumerate(log)], 3)
    >>> [" ".join(r.texts) for r in rows[:3]], len(empty)
    (['20 [ ( 3 , 612 , 430', '20 [ ( 4 , 630 , 445', '40 [ ( 3 , 615 , 433'], 2)
    """
    there = [line for line in lines if VALUE in line.form]
    forms = Counter(line.form for line in there)
    if len(there) < _FEW_LINES or len(forms) < 2:
        return None
    longest = max((f for f, many in forms.items() if many > 1), key=len, default=max(forms, key=len))
    for head in range(min(_LONGEST, len(longest))):
        for size in range(values, min(_LONGEST, len(longest) - head) + 1):
            unit = longest[head : head + size]
            if unit[-1] != VALUE or unit.count(VALUE) != values:
                continue
            for gap in range(_BETWEEN + 1):
                between = longest[head + size : head + size + gap]
                if VALUE in between or len(between) < gap:
                    break
                found = [_groups(line, longest[:head], unit, between) for line in there]
                found = [
                    0 if n is None and _is_void(line, longest[:head], forms) else n
                    for n, line in zip(found, there, strict=True)
                ]
                fits = [n for n in found if n is not None]
                if len(fits) >= _MOSTLY * len(there) and len({*fits}) > 1 and max(fits) > 1:
                    return _rows(there, found, head, size, gap)
    return None


def _groups(line: Line, head: str, unit: str, between: str) -> int | None:
    """Return how many groups a line has, one or more; None where it has none."""
    if not line.texts[-1]:  # it is cut behind a separator
        return None
    many, rest = divmod(len(line.form) + len(between) - len(head), len(unit) + len(between))
    return many if many and not rest and line.form == head + between.join([unit] * many) else None


def _is_void(line: Line, head: str, forms: Mapping[str, int]) -> bool:
    """Return whether a line begins as others do, and holds no number behind, as several do, or says so in words.

    Else it may be cut.
    """
    first = head.find(VALUE) + 1
    numbers = [t for f, t in zip(line.form, line.texts, strict=True) if f == VALUE][1:]
    if not first or line.form[:first] != head[:first] or not all(map(says_nothing, numbers)):
        return False
    return forms[line.form] > 1 or any(t and says_nothing(t) for t in line.texts[first:])


def _rows(
    lines: list[Line], found: list[int | None], head: int, size: int, gap: int
) -> tuple[list[Line], list[int]] | None:
    """Return the row of each group, and of each line without; None where no field numbers the strips side by side."""
    many = [(line, n) for line, n in zip(lines, found, strict=True) if n is not None]
    first = next(line for line, n in many if n)
    form = first.form[: head + size]
    groups = {
        line.number: [line.texts[at : at + size] for at in range(head, head + n * (size + gap), size + gap)]
        for line, n in many
    }
    labels = [place for place in range(size) if form[head + place] == VALUE and _number(groups, place)]
    if not labels:
        return None
    void = tuple(
        text if place == labels[0] or form[head + place] != VALUE else ""
        for place, text in enumerate(first.texts[head : head + size])
    )
    rows = [
        replace(line, form=form, texts=(*line.texts[:head], *first.texts[len(line.texts) : head], *group))
        for line, _ in many
        for group in groups[line.number] or [void]
    ]
    return rows, [line.number for line, n in many if not n]


def _number(groups: dict[int, list[tuple[str, ...]]], place: int) -> bool:
    """Return whether the fields of a place count up or down by one within each line."""
    fields = [[group[place] for group in of_line] for of_line in groups.values()]
    if not all(re.fullmatch(r"\d{1,3}", f) for line in fields for f in line):
        return False
    steps = {b - a for line in fields for a, b in itertools.pairwise(map(int, line))}
    return steps in ({1}, {-1})

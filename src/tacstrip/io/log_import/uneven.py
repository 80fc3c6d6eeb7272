"""Rows of more or fewer fields than there are names."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from tacstrip.io.log_import.fields import is_value, number_of, says_nothing
from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.separators import fields_of
from tacstrip.io.log_import.table import ContradictionError

_REMARK_NAMES = (
    r"notes?|remarks?|comments?|labels?|events?|bemerkung(?:en)?|notizen?|kommentare?|remarques?|notas?"
)


def under_more_names(
    split: list[tuple[int, list[str]]], comments: list[tuple[int, str]], width: int, separator: str
) -> tuple[list[tuple[int, list[str]]], int, tuple[str, ...]]:
    """Return rows filled up to the number of names, where these are more than any line has fields, and the last names.

    Which field is missing no line tells.
    """
    if separator.isspace() and separator != "\t":
        return split, width, ()
    tops = [n for n, (_, row) in enumerate(split) if len(row) > width and names_columns(row)]
    first = tops[-1] + 1 if tops else 0
    said = [(i, fields_of(line.lstrip("#%/! \t"), separator)) for i, line in comments if i < split[0][0]]
    top, names = split[first - 1] if tops else (said or [(0, [""])])[-1]
    wide = len(names)
    numbers = [row for _, row in split[first:] if sum(is_value(c, ".") or is_value(c, ",") for c in row) > 1]
    if wide <= width or not numbers or any(len(row) >= wide for row in numbers) or not names_columns(names):
        return split, width, ()
    if 2 * sum(m.role != "" for m in meanings(names).values()) < wide:
        return split, width, ()
    filled = [
        (i, row + [""] * (wide - len(row)) if row in numbers or _is_idle(row, width) else row)
        for i, row in split[first:]
    ]
    return [*split[: max(first - 1, 0)], (top, names), *filled], wide, tuple(names[width:])


def _is_idle(row: list[str], width: int) -> bool:
    """Return whether a row says that nothing touches, beside a time."""
    return len(row) == width and all(
        says_nothing(c) or is_value(c, ".") or is_value(c, ",") for c in row if c
    )


def are_remarks(names: Sequence[str]) -> bool:
    """Return whether columns are of remarks only, which a line may lack."""
    return all(re.fullmatch(_REMARK_NAMES, name.strip(), re.IGNORECASE) for name in names)


def filled_fields(row: list[str]) -> int:
    """Return the fields of a row up to its last that is not empty."""
    return max((n for n, cell in enumerate(row, 1) if cell), default=0)


def in_first_order(
    split: list[tuple[int, list[str]]], named: list[tuple[int, list[str]]], width: int, decimal: str
) -> tuple[list[tuple[int, list[str]]], tuple[str, ...]]:
    """Return rows with their fields in the order of the first names, where these come again in another; and remarks.

    Raises
    ------
    ContradictionError
        A line among the rows names columns otherwise than the first names do.

    Examples
    --------
    >>> rows = [(1, ["t", "h", "l"]), (2, ["0", "5", "4"]), (3, ["t", "l", "h"]), (4, ["1", "4", "5"])]
    >>> in_first_order(rows, [], 3, ".")[0]
    [(1, ['t', 'h', 'l']), (2, ['0', '5', '4']), (3, ['t', 'h', 'l']), (4, ['1', '5', '4'])]
    """
    heads = [(i, row) for i, row in sorted([*split, *named]) if len(row) == width and names_columns(row)]
    first = next(
        (i for i, row in split if len(row) == width and sum(is_value(c, decimal) for c in row) > 1), 0
    )
    above = [row for i, row in heads if i < first]
    later = {i: row for i, row in heads if i > first and above}
    others = {i: row for i, row in later.items() if row != above[-1]}
    for i, row in others.items():
        if sorted(row) != sorted(above[-1]) or any(
            bool(a) != bool(b) for a, b in zip(row, above[-1], strict=True)
        ):
            raise ContradictionError(
                f"line {i} names the columns {', '.join(row)}, and the first names are "
                f"{', '.join(above[-1])}: two tables in one log; save them as two files"
            )
    if not others:
        return split, ()
    found = []
    for i, row in split:
        names = later[max(n for n in later if n <= i)] if i >= min(later) else above[-1]
        order = [names.index(name) if name else n for n, name in enumerate(above[-1])]
        found.append((i, [row[n] for n in order] if len(row) == width else row))
    lines = ", ".join(map(str, others))
    return found, (f"line(s) {lines}: the names in another order; what stands below is read by them",)


def names_columns(row: list[str]) -> bool:
    """Return whether a row is one of names: words only, at least two of which tell what a column is."""
    row = row and row[not row[0] : len(row) - (not row[-1])]  # a border parts off an empty field at both ends
    if not all(row) or len({*row}) < len(row) or any(map(_is_no_name, row)):
        return False
    return sum(m.role != "" for m in meanings(row).values()) > 1


def _is_no_name(field: str) -> bool:
    return is_value(field, ".") or is_value(field, ",") or says_nothing(field)


def below_an_index(split: list[tuple[int, list[str]]], width: int) -> list[tuple[int, list[str]]]:
    """Return rows with a name for a column that only counts them, as R writes it, if the names lack one."""
    numbers = [number_of(row[0]) for _, row in split[1:] if len(row) == width]
    counts = (
        None not in numbers and len(numbers) > 1 and set(np.diff(np.array(numbers, dtype=float))) == {1.0}
    )
    if len(split[0][1]) == width - 1 and counts and not any(is_value(f, ".") for f in split[0][1]):
        split[0][1].insert(0, "index")
    return split

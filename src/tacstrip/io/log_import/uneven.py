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
    filled = [(i, row + [""] * (wide - len(row)) if row in numbers else row) for i, row in split[first:]]
    return [*split[: max(first - 1, 0)], (top, names), *filled], wide, tuple(names[width:])


def are_remarks(names: Sequence[str]) -> bool:
    """Return whether columns are of remarks only, which a line may lack."""
    return all(re.fullmatch(_REMARK_NAMES, name.strip(), re.IGNORECASE) for name in names)


def untrimmed(split: list[tuple[int, list[str]]], width: int) -> tuple[list[tuple[int, list[str]]], int, str]:
    """Return rows with the empty fields that were left out at their ends, the width of the names, and a remark.

    That is sure where no row ends with an empty field, and empty ones stand inside.
    """
    wide = max(
        filled_fields(row) for _, row in split
    )  # lines of a preamble may be filled up with empty fields
    top = next(n for n, (_, row) in enumerate(split) if filled_fields(row) == wide)
    names, below = split[top][1], split[top + 1 :]
    if any(len(row) > wide for _, row in below):
        return split, width, ""
    short = [row for _, row in below if len(row) < wide]
    if len(short) < 2 or not all(names) or any(is_value(cell, ".") for cell in names):
        return split, width, ""
    rows = [row for _, row in below]
    noted = [row[-1] for row in rows if len(row) == wide]  # a column of remarks, which few lines have
    if (
        wide == width + 1
        and noted
        and not any(is_value(t, ".") or is_value(t, ",") or says_nothing(t) for t in noted)
    ):
        filled = [(i, [*row, ""] if len(row) == width else row) for i, row in below]
        return split[: top + 1] + filled, wide, f"{names[-1]}: a remark on {len(noted)} line(s)"
    if not all(row[-1] and not says_nothing(row[-1]) for row in rows) or "" not in [
        c for r in rows for c in r
    ]:
        return split, width, ""
    if any(len(row) < 2 or sum(is_value(c, ".") or not c for c in row) < len(row) - 1 for row in short):
        return split, width, ""
    filled = [(i, row + [""] * (wide - len(row))) for i, row in below]
    return split[: top + 1] + filled, wide, f"{len(short)} line(s) end early: what is not there is empty"


def filled_fields(row: list[str]) -> int:
    """Return the fields of a row up to its last that is not empty."""
    return max((n for n, cell in enumerate(row, 1) if cell), default=0)


def under_first_names(
    split: list[tuple[int, list[str]]], named: list[tuple[int, list[str]]], width: int
) -> tuple[list[tuple[int, list[str]]], str]:
    """Return rows in the order of the log's first names, where a line within it names columns anew, and a doubt.

    Raises
    ------
    ContradictionError
        It names others.
    """
    heads = [(i, row) for i, row in sorted([*split, *named]) if len(row) == width and names_columns(row)]
    first = next((i for i, row in split if len(row) == width and sum(is_value(c, ".") for c in row) > 1), 0)
    above = [row for i, row in heads if i < first]
    others = [(i, row) for i, row in heads if i > first and above and row != above[-1]]
    if not others:
        return split, ""
    names, (line, new) = above[-1], others[0]
    for i, row in others:
        if sorted(row) != sorted(names) or len({*names}) < width:
            raise ContradictionError(
                f"line {i} names the columns {', '.join(row)}, and the first names are {', '.join(names)}: two "
                "tables in one log; save them as two files"
            )
    made, order = [], names
    heads_at = dict(heads)
    for i, row in sorted([*split, *((i, row) for i, row in others if (i, row) not in split)]):
        if i > first and i in heads_at:
            order = row
        else:
            made.append((i, [row[order.index(n)] for n in names] if len(row) == width else row))
    said = (
        f"line {line} names the columns in another order ({', '.join(new)}): taken so for the lines below it"
    )
    return made, said


def names_columns(row: list[str]) -> bool:
    """Return whether a row is one of names: words only, at least two of which tell what a column is."""
    if not all(row) or len({*row}) < len(row) or any(is_value(c, ".") or says_nothing(c) for c in row):
        return False
    return sum(m.role != "" for m in meanings(row).values()) > 1


def below_an_index(split: list[tuple[int, list[str]]], width: int) -> list[tuple[int, list[str]]]:
    """Return rows with a name for a column that only counts them, as R writes it, if the names lack one."""
    numbers = [number_of(row[0]) for _, row in split[1:] if len(row) == width]
    counts = (
        None not in numbers and len(numbers) > 1 and set(np.diff(np.array(numbers, dtype=float))) == {1.0}
    )
    if len(split[0][1]) == width - 1 and counts and not any(is_value(f, ".") for f in split[0][1]):
        split[0][1].insert(0, "index")
    return split

"""Find misspelt column names: another case, a missing underscore, an added unit, or one wrong letter."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable


def nearly(
    header: Iterable[str], wanted: Collection[str], known: Collection[str], letters: bool = True
) -> str:
    """Return an error message for a column that is probably a misspelt one of `wanted`; an empty text where none is.

    Parameters
    ----------
    header
        The columns of the file.
    wanted
        Columns that the file lacks.
    known
        Columns that are never taken for misspelt ones.
    letters
        Whether one letter may differ too; not where names differ only by a number.
    """
    others = [name for name in header if name not in known and name not in wanted]
    alike = [_alike, _one_off] if letters else [_alike]
    for same in alike:
        for name in others:
            if meant := next((right for right in wanted if same(name, right)), ""):
                return (
                    f"column {name!r} is not known, and {meant!r} is missing: write {meant!r} if that is what it is, "
                    "else give it another name"
                )
    return ""


def _alike(name: str, right: str) -> bool:
    """Return whether two names have the same letters and digits, apart from a unit in brackets."""
    return bool(_bare(name)) and _bare(name) == _bare(right)


def _bare(name: str) -> str:
    return "".join(c for c in re.sub(r"[(\[].*", "", name).casefold() if c.isalnum())


def _one_off(name: str, right: str) -> bool:
    """Return whether one letter is wrong, missing, added, or exchanged with its neighbour."""
    a, b = sorted((name.casefold(), right.casefold()), key=len)
    start = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), len(a))
    x, y = a[start:], b[start:]
    if len(x) < len(y):
        return x == y[1:]
    return len(x) == len(y) and (x[1:] == y[1:] or (x[:2] == y[1::-1] and x[2:] == y[2:]))

"""Lines that begin as those of the commonest form do, and say in words that nothing touches."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence

from tacstrip.io.log_import.fields import STAMP, says_nothing
from tacstrip.io.log_import.names import meaning

_HEX = r"[\dA-Fa-f]{2,8}"
_UNTOUCHED = re.compile(r"(?:touch\w*|contact|press\w*|active)\W{1,3}(?:false|no|none|off)\b", re.IGNORECASE)
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
# Of what stands for no contact, an "x" may stand between letters, as in "HxLx".
_NOTHING = (
    r"(?<![^\s,;|/:=(\[{<>])(?:(?<!<)-{1,2}(?!>)|-{3,5}|\*{1,5}|_{1,5}|\.{1,5}|[nN]/[aA]|(?![A-Z]x)[A-Za-z]+)"
    r"(?![^\s,;|/:)\]}>])|(?<=[A-Z])x(?=[A-Z\s,;|]|\Z)"
)
_TOKEN = re.compile(
    rf"(?P<clock>(?<![\w.]){STAMP}(?![\w]))|(?P<hex>(?<![\w.])(?:0[xX][\dA-Fa-f]+|(?:(?=[A-Fa-f]*\d){_HEX}|[A-F]{{3,8}}))(?![\w.]))"
    rf"|(?P<number>{_NUMBER})|(?P<nothing>{_NOTHING})"
)
_WORD = re.compile(r"[^\W\d_]{2,}")
_FEW = 3  # lines of one form
_LABELLED = 2  # places that a line of no contact has in common with others, such as a time and a strip

Line = tuple[int, tuple[str, ...], tuple[str, ...]]  # its number, what stands between its values, and these


def _parted(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what stands between the values of a line, with blanks of one length, and the values."""
    between, values, last = [], [], 0
    for token in _TOKEN.finditer(line):
        if (
            token.lastgroup == "nothing"
            and token[0].isalpha()
            and not (says_nothing(token[0]) or token[0] == "x")
        ):
            continue
        between.append(line[last : token.start()])
        values.append(token[0].strip())
        last = token.end()
    return tuple(re.sub(r"\s+", " ", b) for b in (*between, line[last:])), tuple(values)


def with_values_of_nothing(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with values for those that begin as the others do and say instead that nothing touches.

    Examples
    --------
    >>> lines = [(n, f"t={n} strip=1 h=2.{n}V l=1V") for n in range(3)] + [(4, "t=3 strip=1 state=open")]
    >>> with_values_of_nothing(lines)[3]
    (4, 't=3 strip=1 h=nanV l=nanV')
    """
    split = [(n, *_parted(line)) for n, line in lines]
    main = _main([form for _, form, _ in split])
    if main is None:
        return lines
    filled = [_filled(line, main) for line in split]
    return [
        old if new is one else (new[0], _line(new))
        for old, one, new in zip(lines, split, filled, strict=True)
    ]


def _line(line: Line) -> str:
    return "".join(itertools.chain(*itertools.zip_longest(line[1], line[2], fillvalue="")))


def _main(forms: Sequence[tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the form in which the most values stand; None where no lines are of one."""
    worth = {
        f: many * (len(f) - 1) for f, many in Counter(forms).items() if many >= _FEW and len(f) > _LABELLED
    }
    return max(worth, key=lambda form: worth[form], default=None)


def _filled(line: Line, main: tuple[str, ...]) -> Line:
    """Return a line that begins as those of the commonest form and says that nothing touches as one of that form."""
    n, form, values = line
    same = next((k for k, (a, b) in enumerate(zip(form, main, strict=False)) if a != b), 0)
    rest = _line((n, form[same:], values[same:]))
    said = _WORD.findall(rest)
    void = _UNTOUCHED.search(rest) or any(map(says_nothing, said))
    # With as many values, or a word of an end, it is of a reading that others have, too.
    short = len(form) < len(main) and not any(meaning(w).channel for w in re.findall(r"[^\W\d_]+", rest))
    if said and all(map(says_nothing, said)):
        return line  # a row of marks
    if same < _LABELLED or re.search(r"\d", rest) or not (void and short):
        return line
    return n, main, (*values[:same], *["nan"] * (len(main) - 1 - same))

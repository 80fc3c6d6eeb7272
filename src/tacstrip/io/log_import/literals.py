"""What a program printed as it is: lists and records of Python and NumPy, lists of Mathematica and C."""

from __future__ import annotations

import ast
import re
from typing import Any

from tacstrip.io.log_import.fields import is_prose

_WRAPPED = re.compile(
    r"\b(?:np\.|numpy\.)?(?:array|float\d*|u?int\d*|deque|tuple|list)\(((?:[^()]|\([^()]*\))*?)(?:,\s*dtype=[\w.']+)?\)"
)
_ASSIGNED = re.compile(r"\s*(?:>>>\s*)?(?:[A-Za-z_]\w*\s*=\s*)?(?=[\[({])")
_REMARK = re.compile(r"\(\*.*?\*\)", re.DOTALL)  # of Mathematica
_NONE = re.compile(r"(?<![\w'\"])[+-]?(?:nan|NaN|NAN|inf|Infinity|[nN]ull)(?![\w'\"])")
_TIMED = re.compile(r"\A\s*(\d+(?:\.\d+)?)[\s:,;]+([\[(].*[\])])\s*\Z")  # a number before a list
_FEW = 2  # lists
_DEEPEST = 400  # brackets in one line


def literal(text: str) -> Any:
    """Return the value that a text writes in Python's form, perhaps with a name before it; None where it is none.

    Examples
    --------
    >>> literal("row = (0.02, [np.float64(1.5), nan, None])")
    (0.02, [1.5, None, None])
    >>> literal("1, 2") is None
    True
    """
    head = _ASSIGNED.match(text)
    if not head or text.count("[") + text.count("(") > _DEEPEST + len(text) // 4:
        return None
    if ":" not in text and "{" in text:  # as in C
        text = re.sub(r"(?<=\d)[fF]\b", "", text.translate({123: 91, 125: 93}))
        head = _ASSIGNED.match(text) or head
    plain, many = _NONE.sub("None", text[head.end() :].rstrip().rstrip(",;")), 1
    while many:
        plain, many = _WRAPPED.subn(r"\1", plain)
    try:
        return ast.literal_eval(plain)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None


def literals(text: str) -> tuple[list[tuple[int, Any]], list[tuple[int, str]]]:
    r"""Return the containers that a text, or its lines, write in Python's form, with their lines; lines around them.

    Examples
    --------
    >>> literals("(* t, high *)\n{{0, {2.5, Null}},\n {1, {2.6, Null}}}")
    ([(1, [0, [2.5, None]]), (2, [1, [2.6, None]])], [(0, '(* t, high *)')])
    """
    whole = literal(_REMARK.sub("", text).strip())
    if (
        isinstance(whole, list | tuple)
        and len(whole) > 1
        and all(isinstance(r, list | tuple | dict) for r in whole)
    ):
        return list(enumerate(whole, 1)), [(0, remark) for remark in _REMARK.findall(text)]
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    found = [
        (i, value)
        for i, line in lines
        if isinstance(value := literal(_TIMED.sub(r"(\1, \2)", line)), list | tuple | dict) and value
    ]
    first, last = (found[0][0], found[-1][0]) if found else (0, 0)
    there = {i for i, _ in found}
    around = [(i, line) for i, line in lines if i not in there]
    contiguous = not any(first <= i <= last for i, _ in around)
    # A prompt, a banner or what a program prints as it fails holds no list.
    words = len(found) > _FEW and all(not re.search(r"\d", line) or is_prose(line) for _, line in around)
    return (found, around) if words or (contiguous and len(found) > len(around)) else ([], [])

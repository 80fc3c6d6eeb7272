"""What a program printed as it is: Python's and NumPy's lists, MATLAB's and Octave's matrices in pages."""

from __future__ import annotations

import ast
import re
from typing import Any

from tacstrip.io.log_import.fields import STAMP, is_prose, number_of, says_nothing

_WRAPPED = re.compile(
    r"\b(?:np\.|numpy\.)?(?:array|float\d*|u?int\d*|deque|tuple|list)\(((?:[^()]|\([^()]*\))*?)(?:,\s*dtype=[\w.']+)?\)"
)
_ASSIGNED = re.compile(r"\s*(?:>>>\s*)?(?:[A-Za-z_]\w*\s*=\s*)?(?=[\[({])")
_REMARK = re.compile(r"\(\*.*?\*\)", re.DOTALL)  # of Mathematica
_NONE = re.compile(r"(?<![\w'\"])[+-]?(?:nan|NaN|NAN|inf|Infinity|[nN]ull)(?![\w'\"])")
_SCALE = re.compile(r"\s*(\d+(?:\.\d+)?[eE][+-]?\d+)\s*\*\s*")
_PAGE = re.compile(r"\s*Columns? \d+(?: (?:through|thru|and|to) \d+)?:?\s*")
_ROWS = re.compile(r"([^\[]*)\[\s*((?:\[[^\[\],]*\]\s*)+)\]\s*\)?")
_TIMED = re.compile(r"\A\s*(\d+(?:\.\d+)?)[\s:,;]+([\[(].*[\])])\s*\Z")  # a number before a list
_COUNTED = re.compile(  # a logger's time and words, and a scan's number before a list of lists
    rf"\A\s*(?:(?P<stamp>{STAMP})\b[^\[({{]*?\W)?(?:frame|scan|sweep|sample|cycle)\s*#?(?P<n>\d+)\s*[:=]\s*"
    r"(?P<rest>[\[(].*[\[(].*[\])]|\[(?:\s*None\s*,?)+\])\s*\Z",
    re.IGNORECASE,
)
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


def _counted(line: str) -> str:
    """Return a line such as "10:12:33 INFO frame 3: [None, (1.9, 1.8)]" as a record; another one as it is.

    Examples
    --------
    >>> _counted("10:12:33 - INFO - frame 3: [None, (1.9, 1.8)]")
    "{'time stamp': '10:12:33', 'scan': 3, 'values': [None, (1.9, 1.8)]}"
    """
    m = _COUNTED.match(line)
    if m is None:
        return line
    stamp = f"'time stamp': '{m['stamp']}', " if m["stamp"] else ""
    return f"{{{stamp}'scan': {int(m['n'])}, 'values': {m['rest']}}}"


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
        if isinstance(value := literal(_TIMED.sub(r"(\1, \2)", _counted(line))), list | tuple | dict)
        and value
    ]
    first, last = (found[0][0], found[-1][0]) if found else (0, 0)
    there = {i for i, _ in found}
    around = [(i, line) for i, line in lines if i not in there]
    contiguous = not any(first <= i <= last for i, _ in around)
    # A prompt, a banner or what a program prints as it fails holds no list.
    words = len(found) > _FEW and all(not re.search(r"\d", line) or is_prose(line) for _, line in around)
    return (found, around) if words or (contiguous and len(found) > len(around)) else ([], [])


def unwrapped(every: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with each row of a NumPy array in one, however it was wrapped; an array of rows is a block.

    Examples
    --------
    >>> unwrapped([(1, "t=0 [[1. 2."), (2, "  3.]"), (3, " [4. 5. 6.]]")])
    [(1, 't=0'), (1, ''), (1, '[1. 2. 3.]'), (2, '[4. 5. 6.]')]
    """
    if sum(line.count("[") - line.count("]") for _, line in every):
        return every
    made: list[tuple[int, str]] = []
    for i, line in every:
        if (
            made
            and "," not in made[-1][1].rpartition("[")[2]
            and made[-1][1].count("[") > made[-1][1].count("]")
        ):
            made[-1] = (made[-1][0], f"{made[-1][1]} {line.strip()}")
        else:
            made.append((i, line))
    split: list[tuple[int, str]] = []
    for i, line in made:
        if rows := _ROWS.fullmatch(line):
            before = [(i, rows[1].strip())] if rows[1].strip() else []
            split += [
                *before,
                (i, ""),
                *((i + n, row) for n, row in enumerate(re.findall(r"\[[^\[\]]*\]", rows[2]))),
            ]
        else:
            split.append((i, line))
    return split


def one_page(every: list[tuple[int, str]]) -> list[tuple[int, str]]:
    r"""Return lines with the columns of a matrix beside each other that was printed in pages, times the factor above.

    Examples
    --------
    >>> one_page([(1, "1.0e+03 *"), (2, "Columns 1 through 2"), (3, "0 1.5"), (4, "Column 3"), (5, "NaN")])
    [(3, '0\t1500\tnan')]
    """
    if not any(_SCALE.fullmatch(line) or _PAGE.fullmatch(line) for _, line in every):
        return every
    scale, pages, others = 1.0, [[]], []  # type: float, list[list[tuple[int, list[str]]]], list[tuple[int, str]]
    for i, line in every:
        fields = line.split()
        values = [number_of(f) for f in fields]
        if factor := _SCALE.fullmatch(line):
            scale = float(factor[1])
        elif _PAGE.fullmatch(line):
            pages.append([])
        elif fields and all(v is not None or says_nothing(f) for v, f in zip(values, fields, strict=True)):
            pages[-1].append((i, ["nan" if v is None else f"{v * scale:.15g}" for v in values]))
        else:
            others.append((i, line))
    pages = [page for page in pages if page]
    if len({len(page) for page in pages}) != 1:
        return every
    rows = [
        (row[0][0], "\t".join(f for _, fields in row for f in fields)) for row in zip(*pages, strict=True)
    ]
    return [(i, line) for i, line in others if i < rows[0][0] and re.search(r"\d", line)] + rows

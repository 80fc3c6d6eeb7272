"""What a program printed as it is: lists and records of Python and NumPy, lists of Mathematica and C."""

from __future__ import annotations

import ast
import datetime as dt
import math
import re
from typing import Any

from tacstrip.io.log_import.fields import is_prose

_ASSIGNED = re.compile(r"\s*(?:>>>\s*)?(?:[A-Za-z_]\w*\s*=\s*)?(?=[\[({]|[A-Za-z_][\w.]*\()")
_STRUCT = re.compile(r"\b[A-Z]\w*\s*(?=\{\s*\w+\s*:)")  # its name, as Rust prints it
_REMARK = re.compile(r"\(\*.*?\*\)", re.DOTALL)  # of Mathematica
_HASH = re.compile(r""":?([A-Za-z_]\w*|"\w+"|'\w+')\s*=>""")  # a key of Ruby or Perl
_NOTHING = frozenset(("nil", "undef", "nan", "inf", "infinity", "null", "none", "na", "undefined", "missing"))
_TIMED = re.compile(r"\A\s*(\d+(?:\.\d+)?)[\s:,;]+([\[(].*[\])])\s*\Z")  # a number before a list
_FEW = 2  # lists
_OF_DATE = 2  # year, month, and day at least
_DEEPEST = 400  # brackets in one line


def literal(text: str, *, words: bool = False) -> Any:
    """Return the value that a text writes in Python's form or one like it; None where it is none.

    A name may stand before it. An object of named parts is a record, a value in a type's name is that value; with
    `words`, a bare word is a text.

    Examples
    --------
    >>> literal("row = (0.02, [np.float64(1.5), nan, None])")
    (0.02, [1.5, None, None])
    >>> literal("Scan(t=0.5, ends=[Ends(h=2.5, l=1.9), None])")
    {'t': 0.5, 'ends': [{'h': 2.5, 'l': 1.9}, None]}
    >>> literal("Scan { t_us: 12, ends: [Some((2.5, 1.9)), None] }"), literal("{2: [1.5, 1.25], high: 3}")
    ({'t_us': 12, 'ends': [(2.5, 1.9), None]}, {2: [1.5, 1.25], 'high': 3})
    >>> literal("(datetime.datetime(2026, 5, 4, 10, 12, 0, 500000), 1.5)")
    ('2026-05-04 10:12:00.500000', 1.5)
    >>> literal("{:t=>0.5, :high=>[2.5, nil]}")
    {'t': 0.5, 'high': [2.5, None]}
    >>> literal("1, 2") is None
    True
    """
    text = _HASH.sub(r"\1:", _STRUCT.sub("", text))
    head = _ASSIGNED.match(text)
    if not head or text.count("[") + text.count("(") > _DEEPEST + len(text) // 4:
        return None
    if ":" not in text and re.search(r"\{\s*[^\s}]", text):  # as in C
        text = re.sub(r"(?<=\d)[fF]\b", "", text.translate({123: 91, 125: 93}))
        head = _ASSIGNED.match(text) or head
    try:
        return _value(ast.parse(text[head.end() :].rstrip().rstrip(",;"), mode="eval").body, words=words)
    # TypeError and OverflowError: a date of no numbers, a sign before a text, a list as a key.
    except (ValueError, TypeError, OverflowError, SyntaxError, MemoryError, RecursionError):
        return None


def _value(node: ast.expr, *, words: bool) -> Any:
    """Return what an expression of literals, of objects and of values within a type's name says."""

    def of(inner: ast.expr) -> Any:
        return _value(inner, words=words)

    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None as value):
            return None if isinstance(value, float) and not math.isfinite(value) else value
        case ast.List(elts=parts):
            return [of(p) for p in parts]
        case ast.Tuple(elts=parts):
            return tuple(of(p) for p in parts)
        case ast.Dict(keys=keys, values=values):
            return {
                (k.id if isinstance(k, ast.Name) else of(k)): of(v)
                for k, v in zip(keys, values, strict=True)
                if k
            }
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            value = of(inner)
            return -value if value is not None and isinstance(sign, ast.USub) else value
        case ast.Name(id=name) | ast.Attribute(attr=name) if name.casefold() in _NOTHING:
            return None
        case ast.Name(id="true" | "false" as name):
            return name == "true"
        case ast.Name(id=name) if words:
            return name
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=args, keywords=named):
            if name == "datetime" and len(args) > _OF_DATE:
                return str(dt.datetime(*map(of, args)))
            if not args:
                return {k.arg: of(k.value) for k in named if k.arg}
            return of(args[0]) if len(args) == 1 else tuple(of(a) for a in args)
    raise ValueError(ast.dump(node))


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

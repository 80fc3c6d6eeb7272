"""Arrays that a text gives to names, as C, JavaScript, Python, Mathematica and ncdump write them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.names import UNITS, unit_in
from tacstrip.io.log_import.table import Table

_REMARK = re.compile(r"/\*.*?\*/|\(\*.*?\*\)|(?://|#|%)[^\n]*", re.DOTALL)
_SHOWN = re.compile(r"(?m)^\s*>>> ?(\w+)\s*$\n(?=\s*(?:tensor|array|\[))")  # what a prompt prints
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_GIVEN = re.compile(
    r"(?<![\w:.])(?P<name>[A-Za-z_]\w*)(?:\s*\[[^\]=\n]*\]|:[^=\n;]{1,40})*\s*=\s*"
    r"(?P<value>(?:[A-Za-z_.]+\()*\s*(?:[\[{(][^=;]*?[\])}]\s*\)*(?=\s*(?:;|\n\s*(?:[A-Za-z_}>#/]|\Z)|\Z))|[^=;\[{(\"]*,[^=;\[{(\"]*(?=;)))"
)
_ROW = re.compile(r"[\[{(]([^\[\]{}()]*)[\])}]")
_UNIT_SAID = re.compile(r"\b(\w+):units\s*=\s*\"([^\"]+)\"")
_SUFFIX = re.compile(rf"({_NUMBER})[fFsSbLd](?![\w.])")
_MOST_BESIDE = 0.1  # numbers outside of the arrays, over those in them


def of_assigned(text: str, path: str | Path) -> Table | None:
    r"""Return arrays of numbers that have names as a table of a row per scan; None where the text is no such.

    Raises
    ------
    ReadingError
        An array has rows of different lengths, or is of other things than numbers.

    Examples
    --------
    >>> table = of_assigned("float t[3] = {0, 1, 2};\nfloat vh[3][2] = {{1, NAN},\n{2, 3}, {3, 4}};", "x.h")
    >>> table.names, table.rows[0]
    (('t', 'vh[0]', 'vh[1]'), ['0', '1', ''])
    """
    plain = _SHOWN.sub(r"\1 = ", _REMARK.sub("", text))
    found = [(m["name"], m["value"]) for m in _GIVEN.finditer(plain)]
    names = [name for name, _ in found]
    many = sum(len(re.findall(r"(?<![\w.])\d", value)) for _, value in found)
    rest = len(re.findall(r"(?<![\w.])\d", _GIVEN.sub("", plain)))
    if rest > _MOST_BESIDE * many or len({*names}) < len(names) or not names:
        return None
    units = {name: UNITS.get(unit.casefold(), "") for name, unit in _UNIT_SAID.findall(text)}
    arrays = {
        f"{name} [{units[name]}]" if units.get(name) and not unit_in(name) else name: _array(
            name, value, path
        )
        for name, value in found
    }
    if not any(a.ndim == 2 for a in arrays.values()):
        return None
    table = of_arrays(arrays, path, {}, "arrays that are given names")
    said = [line.strip() for m in _REMARK.finditer(text) for line in m[0].splitlines()]
    return replace(table, preamble=(*table.preamble, *said))


def _array(name: str, value: str, path: str | Path) -> npt.NDArray[Any]:
    """Return the numbers of a list, or of rows in brackets or on lines."""
    nested = re.search(r"[\[{(]\s*[\[{(]", re.sub(r"\A(?:\s*[A-Za-z_.]+\()+", "", value))
    bare = not re.search(r"[\[{]", value)
    rows = _ROW.findall(value) if nested else value.splitlines() if bare else [value]
    split = [
        [f.strip() for f in re.sub(r"[\[\]{}();]|[A-Za-z_.]+\(", " ", row).strip(" ,\n").split(",")]
        for row in rows
    ]
    split = [row for row in split if any(row)]
    read = [[_value(f) for f in row] for row in split]
    if not read or len({*map(len, read)}) > 1 or any(v is None for row in read for v in row):
        raise ReadingError(f"{path}: {name} is no array of numbers in rows of one length: is it cut?")
    array = np.array(read, dtype=np.float64)
    return array if len(array) > 1 else array[0]


def _value(text: str) -> float | None:
    text = _SUFFIX.sub(r"\1", text)
    return float("nan") if text == "_" or says_nothing(text.removesuffix("f")) else number_of(text)

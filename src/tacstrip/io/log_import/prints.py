"""What MATLAB, Octave and R save or print of their arrays."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.strays import filled_lines
from tacstrip.io.log_import.table import Table

_FEW = 2  # records
_ASSIGNED = re.compile(r"([A-Za-z_][\w.]*)\s*=\s*(\[[^\]]*\]|[^;\n\[]+)\s*'?\s*;?")
_RANGE = re.compile(r"\(?([^:()]+):([^:()]+)(?::([^:()]+))?\)?(?:\s*\.?([*/])\s*(.+))?")
_PRINTED = re.compile(r"\s*\[(\d+)\]\s+(.*)")  # R's print of a vector
_NAMED = re.compile(r"(?:\$|>\s*(?:print\()?)\s*([A-Za-z][\w.$]*)\)?\s*")
_VECTOR = re.compile(r"`?([\w.]+)`?\s*=\s*c\(([^()]*)\)")
_SAVED = re.compile(r"(?m)^# name: (\w+)\n# type: (?:complex )?matrix\n((?:# .*\n)+)((?:[^#\n]*\n)+)")
_ENTRY = r"(?:[-+]?\d[\d.]*(?:[eE][-+]?\d+)?|(?i:nan)|NA)"
_MATRIX_ROW = rf"[ \t]*{_ENTRY}(?:[ \t]+{_ENTRY})*[ \t]*\n"
_MATRIX = re.compile(
    rf"(?m)^[ \t]*([A-Za-z]\w*) =[ \t]*\n\s*\n((?:{_MATRIX_ROW})+)"
)  # as MATLAB prints a matrix


def of_displayed_scans(text: str) -> str:
    r"""Return what MATLAB displays scan by scan, `ans = ...` and vectors, as lines of fields; another text as it is.

    Examples
    --------
    >>> of_displayed_scans("ans =\n\n  0.0\n\nvh =\n\n  2.5  NaN\n\nans =\n\n  0.1\n\nvh =\n\n  2.6  NaN\n")
    'ans\tvh 0\tvh 1\n0.0\t2.5\tNaN\n0.1\t2.6\tNaN\n'
    """
    found = [(m[1], m[2].split()) for m in _MATRIX.finditer(text + "\n") if "\n" not in m[2].strip()]
    names = list(dict.fromkeys(name for name, _ in found))
    scans = [found[n : n + len(names)] for n in range(0, len(found), len(names) or 1)]
    usual = [(name, len(values)) for name, values in scans[0]] if scans else []
    rest = re.sub(r"(?m)^>>.*$", "", _MATRIX.sub("", text + "\n"))
    if len(scans) < _FEW or any([(n, len(v)) for n, v in scan] != usual for scan in scans) or rest.strip():
        return text
    # What has no name is that which the command does not assign, as t(i) in ">> t(i), v = V(i,:)".
    pieces = re.split(r"[,;]\s|\n", "\n".join(re.findall(r"(?m)^>>(.*)$", text)))
    bare = [m[1] for piece in pieces if (m := re.fullmatch(r"\s*([A-Za-z]\w*)(?:\([^()]*\))?\s*", piece))]
    bare = [meaning(name).role for name in bare if meaning(name).role in ("time", "scan")]
    unnamed = bare[0] if len(bare) == 1 else "ans"
    called = [
        unnamed if name == "ans" else name if many == 1 else f"{name} {n}"
        for name, many in usual
        for n in range(many)
    ]
    rows = [[value for _, values in scan for value in values] for scan in scans]
    above = [line for line in text.splitlines() if line.startswith(">>") and line.strip(" >")]
    return "\n".join([*(f"% {line}" for line in above), *("\t".join(row) for row in [called, *rows])]) + "\n"


def of_octave(text: str, path: str) -> Table | None:
    """Return what Octave saves as text: names, sizes, and the numbers below them."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name, size, body in _SAVED.findall(text):
        values = vector(body.split())
        shape = [int(n) for n in re.findall(r"(?:rows|columns): (\d+)", size)]
        if values is None or len(values) != int(np.prod(shape)):
            raise ReadingError(f"{path}: {name} is said to be of {shape} numbers, and is not: is it cut?")
        arrays[name] = values.reshape(shape).squeeze()
    return of_arrays(arrays, path, {}, "matrices as Octave saves them") if arrays else None


def of_matlab(text: str, path: str) -> Table | None:
    """Return the matrices of a script in MATLAB's form as a table; None where it is none."""
    plain = re.sub(r"(?m)%.*$|^\s*//.*$", "", text)
    plain = re.sub(r"\.\.\.[^\n]*\n", " ", plain)
    if len(_MATRIX.findall(plain)) > 1:
        plain = _MATRIX.sub(r"\1 = [\2];\n", plain)
    if not re.search(r"(?m)^\s*[A-Za-z_][\w.]*\s*=\s*\[", plain):
        return None
    found = [(m[1].rpartition(".")[2], m[2].strip()) for m in _ASSIGNED.finditer(plain)]
    rest = _ASSIGNED.sub("", plain)
    if re.search(r"\d", rest) or len({name for name, _ in found}) < len(found):
        return None
    arrays: dict[str, npt.NDArray[Any]] = {}
    numbers: dict[str, float] = {}
    for name, value in found:
        if value.startswith("["):
            array = _matrix(value[1:-1])
            if array is None:
                return None
            arrays[name] = array
        elif (number := number_of(value)) is not None:
            numbers[name] = number
        elif (steps := _range(value, numbers)) is not None:
            arrays[name] = steps
    if not arrays:
        return None
    table = of_arrays(_in_columns(arrays), path, numbers, "a script's matrices")
    said = [line for line in text.splitlines() if re.match(r"\s*(?:>>|%|//)", line) or "%" in line]
    return replace(table, preamble=(*table.preamble, *said))


def _matrix(text: str) -> npt.NDArray[np.float64] | None:
    """Return a matrix as MATLAB writes it; None where something in it is no number."""
    rows = [re.split(r"[,\s]+", row.strip(" \t,")) for row in re.split(r"[;\n]", text) if row.strip(" \t,")]
    read = [[float("nan") if says_nothing(f) else number_of(f) for f in row] for row in rows]
    if not rows or len({len(row) for row in rows}) > 1 or any(v is None for row in read for v in row):
        return None
    return np.array(read, dtype=np.float64)


def _in_columns(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Return arrays with vectors of one row or column as such."""
    return {name: a.ravel() if a.ndim == 2 and 1 in a.shape else a for name, a in arrays.items()}


def _range(text: str, numbers: Mapping[str, float]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of a range such as "0:0.05:1" or "(0:11)/fs"; None where it is none."""

    def of(part: str | None) -> float | None:
        part = (part or "").strip(" ()'")
        sums = part.partition("-")
        if sums[1] and sums[0].strip() in numbers:  # as in 0:n-1
            less = number_of(sums[2].strip())
            return None if less is None else numbers[sums[0].strip()] - less
        return numbers.get(part, number_of(part))

    found = _RANGE.fullmatch(text.strip(" ;'"))
    if not found:
        return None
    first, second, third = of(found[1]), of(found[2]), of(found[3])
    factor = of(found[5]) if found[5] else 1.0
    if first is None or second is None or not factor or (found[3] and third is None):
        return None
    step, last = (1.0, second) if third is None else (second, third)
    if not step or not 0.0 <= (last - first) / step < 1e7:
        return None
    made = first + step * np.arange(int((last - first) / step + 1e-9) + 1)
    return np.asarray(made / factor if found[4] == "/" else made * factor)


def of_r(text: str, path: str) -> Table | None:
    """Return vectors that R printed or dumped, or a matrix that it printed."""
    if re.match(r"\s*(?:\w+\s*(?:<-|=)\s*)?(?:structure\()?(?:list|data\.frame)\(", text):
        vectors = {
            n: v for n, v in _VECTOR.findall(text) if n not in ("row.names", "class", "names", ".Names")
        }
        arrays = {name: vector(inner.split(",")) for name, inner in vectors.items()}
        kept = {name: a for name, a in arrays.items() if a is not None}
        return of_arrays(kept, path, {}, "vectors of R") if len(kept) > 1 else None
    lines = filled_lines(text)
    printed = [(i, _PRINTED.fullmatch(line), _NAMED.fullmatch(line)) for i, line in lines]
    if next((p[1] for _, p, _ in printed if p), "") != "1" or not all(p or n for _, p, n in printed):
        return None
    series: list[tuple[int, str, list[str]]] = []
    name = ""
    for i, values, named in printed:
        if named:
            name = named[1]
        elif values and values[1] == "1":
            series.append((i, name, values[2].split()))
            name = ""
        elif values and series:
            series[-1][2].extend(values[2].split())
    if all(n for _, n, _ in series) and len({n for _, n, _ in series}) == len(series) > 1:
        read = {n: vector(fields) for _, n, fields in series}
        kept = {n: a for n, a in read.items() if a is not None}
        return of_arrays(kept, path, {}, "vectors of R") if len(kept) == len(read) else None
    if any(n for _, n, _ in series) or len({len(f) for _, _, f in series}) > 1:
        return None
    names = tuple(f"column {n + 1}" for n in range(len(series[0][2])))
    rows = [[f.strip('"') for f in fields] for _, _, fields in series]
    return Table(names, rows, [i for i, _, _ in series], named=False, remarks=("R's print of vectors",))


def vector(fields: Sequence[str]) -> npt.NDArray[np.float64] | None:
    """Return fields as numbers; None where one is none, and does not say that nothing touches."""
    plain = [re.sub(r"(?<=\d)L\Z", "", f.strip().strip('"')) for f in fields]
    spread: list[float | None] = []
    for f in plain:
        if found := re.fullmatch(r"(\d+):(\d+)", f):
            spread += [float(v) for v in range(int(found[1]), int(found[2]) + 1)]
        else:
            spread.append(float("nan") if says_nothing(f) or f == "NA" else number_of(f))
    return None if None in spread else np.array(spread, dtype=np.float64)

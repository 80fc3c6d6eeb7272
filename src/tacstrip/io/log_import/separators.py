"""What separates the fields of lines, and the fields of a line."""

from __future__ import annotations

import csv
import re
from collections import Counter
from pathlib import Path

from tacstrip.io.log_import.fields import clock_seconds, is_value, number_of, says_nothing
from tacstrip.io.log_import.records import STEADY
from tacstrip.io.log_import.table import NoTableError

_WIDE = "  "  # two spaces or more
_SEPARATORS = (";", "\t", "|", ",", _WIDE, " ")
_ARRAY = re.compile(r"(?<![\"\w])\[[\d\s.,;eE+\-naNuloNe]*\](?!\")")
_SIGN_APART = re.compile(r"\A([+-])\s+(?=[\d.,])")  # as loggers write "+  2.862"
_SEVERAL = re.compile(r"[\d-]\s+[-+]?\d")
_SAMPLE = 500  # lines at either end that tell what separates the fields
_HEAD = 40  # lines in which a log may say what separates its fields
_SEPARATED_BY = re.compile(
    r"(?:sep|separator|delimiter)[\s:=\"]+(tab|comma|semicolon|[;,|])\"?", re.IGNORECASE
)
_SAID_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
_MOSTLY = 0.6  # of the lines, where these have several fields
_EMPTY = '""'
_FEW_LINES = 4  # of fewer, the length of the last number tells nothing


def fields_of(line: str, separator: str) -> list[str]:
    """Return the fields of a line; arrays in brackets are one field, or fields of their own between spaces."""
    if separator == _WIDE:
        return re.split(r"\s{2,}|\t", line.strip())
    if separator == " ":
        if '"' in line:
            split = next(csv.reader([line.strip()], delimiter=" ", skipinitialspace=True))
            line = " ".join(re.sub(r"\s+", "_", f) or _EMPTY for f in split)
        first, *others = re.sub(r"\[((?:[-+\s\d.eE]|nan)*)\]", r" \1 ", line).split() or [""]
        first, *others = ["" if f == _EMPTY else f for f in (first, *others)]
        return [first[:-1] if others and re.fullmatch(r"\d+:", first) else first, *others]
    if "[" in line and '"' not in line:
        line = _ARRAY.sub(lambda m: f'"{m.group()}"', line)
    split = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [_SIGN_APART.sub(r"\1", f.strip()) for f in split]


def separator_of(data: list[tuple[int, str]], path: str | Path) -> tuple[str, int]:
    """Return what separates the fields, and how many there are in most lines."""
    ranked = []
    if said := next((m for _, line in data[:_HEAD] if (m := _SEPARATED_BY.fullmatch(line.strip()))), None):
        separator = _SAID_SEPARATORS.get(said[1].casefold(), said[1])
        width = Counter(len(fields_of(line, separator)) for _, line in data[len(data) // 2 :]).most_common(1)[
            0
        ][0]
        if width > 1:
            return separator, width
    data = data if len(data) <= 2 * _SAMPLE else data[:_SAMPLE] + data[-_SAMPLE:]
    for separator in _SEPARATORS:
        try:
            split = [fields_of(line, separator) for _, line in data]
        except csv.Error:
            continue
        width, many = max(Counter(map(len, split)).items(), key=lambda item: (item[0] > 1, item[1]))
        if width > 1:
            several = sum(
                _SEVERAL.search(f) is not None and not is_value(f, ".") and clock_seconds(f) is None
                for row in split for f in row
            )  # fmt: skip
            share = (many - several) / len(data)  # a field of two numbers is none
            ranked.append(
                (share if separator.strip() or separator == "\t" else 0.99 * share, separator, width)
            )
    if not ranked:
        if sum(number_of(line) is not None or says_nothing(line.strip()) for _, line in data) < STEADY * len(
            data
        ):
            raise NoTableError(f"{path}: no table: no line has two fields")
        return ",", 1
    share, separator, width = max(
        ranked, key=lambda r: (r[0] > STEADY, r[0] > 0.98, -_SEPARATORS.index(r[1]), r[0])
    )
    enough = 0.99 * (STEADY if width < _FEW_LINES else _MOSTLY)
    if share < enough and len(data) > _FEW_LINES:
        share, separator, width = _below_a_preamble(ranked, data)
    if share < enough and len(data) > _FEW_LINES:
        raise NoTableError(
            f"{path}: no separator gives lines of as many fields; save it as CSV with one line per reading"
        )
    return separator, width


def _below_a_preamble(
    ranked: list[tuple[float, str, int]], data: list[tuple[int, str]]
) -> tuple[float, str, int]:
    """Return the separator of the log's second half, where what stands above the table is as long as the table."""
    found = []
    for _, separator, _ in ranked:
        widths = [len(fields_of(line, separator)) for _, line in data]
        width = widths[-1]
        run = next((n for n, w in enumerate(reversed(widths)) if w != width), len(widths)) if width > 1 else 0
        found.append((run, -_SEPARATORS.index(separator), separator, width))
    run, _, separator, width = max(found)
    return (
        (1.0 if run >= _FEW_LINES or (run == _FEW_LINES - 1 and width > _FEW_LINES) else 0.0),
        separator,
        width,
    )

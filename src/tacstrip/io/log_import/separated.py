"""Lines of fields between separators: which separator, how many fields, which line names them."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.blocks import in_blocks, labels_of
from tacstrip.io.log_import.fields import is_value, says_nothing
from tacstrip.io.log_import.headed import decimal_mark, headed
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.separators import fields_of, separator_of
from tacstrip.io.log_import.table import ContradictionError, Table
from tacstrip.io.log_import.uneven import (
    are_remarks,
    below_an_index,
    filled_fields,
    in_first_order,
    names_columns,
    under_more_names,
)

_WIDE = "  "  # two spaces or more
_COMMENT = ("#", "%", "//", "!")
_REMARK = re.compile(r"(?<=[\d\w,;])\s+(?:#|//)\s+\S.*")  # behind the fields of a line
_REMARKED = re.compile(
    r"(?<!\s)(?:\s+[(\[][^()\[\]]{9,}[)\]]\s*|\s{2,}\S.*|\s+(?:--|#|//)\s.*)\Z"
)  # behind names in a comment
_ANNOUNCED = re.compile(
    r"\A(?:[^:=]*\s)?(?:order|columns?|fields?|format|header|names?|cols?|spalten)\s*[:=]\s*", re.IGNORECASE
)
_RANGE = re.compile(
    r"\b([A-Za-z_]+) ?(\d+)\s*(?:\.\.+|\u2026|-|to)\s*([A-Za-z_]*) ?(\d+)\b"
)  # such as "A0..A3"
_SAID_OF = re.compile(r"(?:[,;]\s*-?\d+)?\s+(?:=|are|:)\s.*\Z")  # what names are, or a number is
_PARTED = re.compile(
    r"[-+\d.]+(?:\s+[-+\d.]+)+(?:\s+\|(?:\s+[-+\d.]+){2,})+"
)  # runs of numbers between spaces
_MOST_NAMES = 1000
_NUMBERED = re.compile(r"[A-Za-z_]+\d+\S*")  # a column's name, such as S1 or v2_h
_HEX = r"[\dA-Fa-f]{2,8}"
_FEW_BLOCKS = 2


def separated(lines: list[tuple[int, str]], blank: set[int], path: str | Path) -> Table:
    """Return lines of fields with the separator that most of them share."""
    parted = {i for i, line in lines if _PARTED.fullmatch(line.strip())}
    if 2 * len(parted) > len(lines):
        lines = [(i, re.sub(r"\s+\|\s+", " ", line) if i in parted else line) for i, line in lines]
    comments = [(i, line) for i, line in lines if line.lstrip().startswith(_COMMENT)]
    data = [(i, line) for i, line in lines if not line.lstrip().startswith(_COMMENT)]
    if not data:  # all of it is commented out
        data, comments = [(i, line.lstrip("#%/! \t")) for i, line in lines], []
    labels = labels_of(lines)
    data = [(i, line) for i, line in data if i not in labels]
    if not data:
        raise ReadingError(f"{path}: nothing but comments")
    separator, width = separator_of(data, path)
    split, width = _rows(data, separator, width)
    split, width, lacking = under_more_names(split, comments, width, separator)
    split = _in_decimals(below_an_index(split, width), width)
    line, top = split[0]
    if separator.isspace() and len(top) > width > 1 and all(_NUMBERED.fullmatch(name) for name in top[1:]):
        raise ReadingError(
            f"{path}: line {line} names {len(top)} columns, and most lines have {width} fields: what stands for the "
            "others is not to be told from spaces; put commas or tabs between the fields"
        )
    full = [row for _, row in split if len(row) == width]
    _check_commas(top, width, separator, line)
    decimal = _decimal_of_quoted(full) if separator == "," else decimal_mark(full)
    said = {"\t": "tabs", " ": "spaces", _WIDE: "spaces"}.get(separator, repr(separator))
    remarks: tuple[str, ...] = (
        f"fields are separated by {said}" if width > 1 else "",
        "decimal commas" if decimal == "," else "",
    )
    ends = min((len(row) - filled_fields(row) for _, row in split if len(row) == width), default=0)
    if ends and any(
        len(fields_of(line.lstrip("#%/! \t"), separator)) == width - ends > 1 or _listed(line, width - ends)
        for _, line in comments
    ):
        split = [(i, row[:-ends] if len(row) == width else row) for i, row in split]
        width -= ends
    named = [(i, fields_of(_names_said(line, width, separator), separator)) for i, line in comments]
    if separator == _WIDE:  # names may stand nearer to each other than numbers
        named = [(i, row if len(row) == width else " ".join(row).split()) for i, row in named]
    split, anew = in_first_order(split, named, width, decimal)
    remarks += anew
    above = [line for _, line in comments]
    out = [
        i for i, row in named
        if i > split[0][0] and len(row) == width > 1 and all(is_value(c, decimal) or not c for c in row)
    ]  # fmt: skip
    if out:
        remarks = (
            *remarks,
            f"line(s) {', '.join(map(str, out))}: readings that are commented out; passed over",
        )
    table = headed(split, width, decimal, tuple(filter(None, remarks)), named, above)
    return in_blocks(_without_lacking_remarks(table, lacking, decimal), labels, blank)


def _rows(data: list[tuple[int, str]], separator: str, width: int) -> tuple[list[tuple[int, list[str]]], int]:
    """Return lines as fields, without remarks behind them and marks between, and how many fields most have."""
    remarked = [_REMARK.search(line) for _, line in data]
    if 0 < sum(map(bool, remarked)) < 0.5 * len(data):
        data = [
            (i, line[: m.start()] if m and len(fields_of(line[: m.start()], separator)) == width else line)
            for (i, line), m in zip(data, remarked, strict=True)
        ]
    split = [(i, fields_of(line, separator)) for i, line in data]
    split = [(i, row[:-1] if len(row) == width + 1 and not row[-1] else row) for i, row in split]
    if _have_remarks(split, width):
        split = [(i, [*row, ""] if len(row) == width else row) for i, row in split]
        width += 1
    if any(len(row) == width and are_remarks(row[-1:]) for _, row in split):  # which are the rest of a line
        split = [
            (i, [*row[: width - 1], f"{separator} ".join(rest)])
            if len(rest := row[width - 1 :]) > 1 and not any(is_value(c, ".") for c in rest)
            else (i, row)
            for i, row in split
        ]
    marks = [
        n
        for n in range(width)
        if all(re.fullmatch(r"[/|:&]", row[n]) for _, row in split[1:] if len(row) == width)
    ]
    if 0 < len(marks) < width and sum(len(row) == width for _, row in split) > 1:  # between fields, and none
        split = [
            (i, [c for n, c in enumerate(row) if n not in marks] if len(row) == width else row)
            for i, row in split
        ]
        width -= len(marks)
    return split, width


def _without_lacking_remarks(table: Table, lacking: tuple[str, ...], decimal: str) -> Table:
    """Return a table without the names for which no line has a field, if these are of remarks; else it lacks them."""
    last = [r[-1 - len(lacking)] for r in table.rows]  # the last fields that are there
    if (
        lacking
        and are_remarks(lacking)
        and any(c and (is_value(c, decimal) or says_nothing(c)) for c in last)
    ):
        said = f"no line has as many fields as there are names: taken as if {', '.join(lacking)} were missing"
        return replace(table, doubts=(*table.doubts, said))
    return replace(table, lacking=lacking)


def _have_remarks(split: list[tuple[int, list[str]]], width: int) -> bool:
    """Return whether some rows have one field more than the others, of words, below a name such as "Comment"."""
    longer = [row for _, row in split if len(row) == width + 1]
    rows = [row for row in longer if not is_value(row[-1], ".") and not names_columns(row)]
    return bool(rows) and any(names_columns(row) and are_remarks(row[-1:]) for row in longer)


def _names_said(line: str, width: int, separator: str) -> str:
    """Return a comment without what stands around as many names as there are fields: a word before, a remark behind.

    As in "# columns: t strip h l", "# scan strip volts   (touched strips only)", "# t, A0..A3 = strips 1 to 4" and
    "# fw 3 order: H0..H7 | L0..L7, 0 = open".
    """
    bare = line.lstrip("#%/! \t")
    if in_json := _listed(line, width):
        return (separator or " ").join(name.replace(" ", "_") for name in in_json)
    for shorter in (
        bare,
        _REMARKED.sub("", bare),
        _ANNOUNCED.sub("", bare),
        _ANNOUNCED.sub("", _REMARKED.sub("", bare)),
    ):
        found = fields_of(shorter, separator)
        if len(found) == width and not {*found} & {"=", ":", "->"}:
            return shorter
        listed = _SAID_OF.sub("", _ANNOUNCED.sub("", _REMARKED.sub("", shorter)))
        parts = [p.strip() for p in re.split(r"[,;|]", _RANGE.sub(_in_full, listed))]
        if (
            len(parts) == width > _FEW_BLOCKS
            and all(parts)
            and (separator not in ",;" or _RANGE.search(listed))
        ):
            return (separator or " ").join(p.replace(" ", "_") for p in parts)
    return "" if len(fields_of(bare, separator)) == width else bare


def _listed(comment: str, width: int) -> list[str]:
    r"""Return the first list of as many different texts in a comment that is JSON, as programs write headers; else [].

    Examples
    --------
    >>> _listed('# {"dev 1": {"column": ["n", "A1", "A2"], "sensor": ["RAW", "RAW", "RAW"], "fs": 100}}', 3)
    ['n', 'A1', 'A2']
    """
    try:
        values = [json.loads(comment.lstrip("#%/! \t"))]
    except (ValueError, RecursionError):
        return []
    while values:
        value = values.pop(0)
        if isinstance(value, dict):
            values += value.values()
        elif isinstance(value, list):
            if len({v for v in value if isinstance(v, str)}) == len(value) == width > 1:
                return value
            values += value
    return []


def _in_full(m: re.Match[str]) -> str:
    """Return the names of a range such as "A0..A3"."""
    first, last = int(m[2]), int(m[4])
    many = range(first, last + 1) if first < last < first + _MOST_NAMES else ()
    return ", ".join(f"{m[1]}{n}" for n in many) if m[3] in ("", m[1]) and many else m[0]


def _decimal_of_quoted(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal mark of fields between commas: a comma where quoted numbers have one, and none a point."""
    cells = [cell for row in rows for cell in row]
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d+,\d+", cell)]
    if not commas or any(re.fullmatch(r"[+-]?[\d,]*\.\d+", cell) for cell in cells):
        return "."
    in_volts = any(re.search(r"[\[(]V[\])]", cell) for cell in cells)  # of which there are no thousands
    if not in_volts and all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas):
        raise ReadingError(
            f"{commas[0]!r}: a decimal comma, or thousands? Write such numbers with a decimal point, "
            "without marks in between"
        )
    return decimal_mark(rows)


def _check_commas(names: list[str], width: int, separator: str, line: int) -> None:
    """Refuse decimal commas between commas: names, and about as many more fields as are numbers with decimals."""
    roles = [meaning(name).role for name in names]
    if separator != "," or not len(names) + 1 < width <= 2 * len(names) or not all(roles) or len(names) < 2:
        return
    raise ContradictionError(
        f"line {line} has {len(names)} names, and the lines below it {width} fields: decimal commas, and commas "
        "between fields, too? Save it with decimal points, or with semicolons between fields"
    )


def _in_decimals(split: list[tuple[int, list[str]]], width: int) -> list[tuple[int, list[str]]]:
    """Mark as such the numbers of columns that are hexadecimal: of one length, some with letters."""
    full = [row for _, row in split if len(row) == width]
    body = full[len(full) // 10 + 1 :]
    there = {n: [row[n] for row in body if not says_nothing(row[n])] for n in range(width)}
    digits = [n for n, read in there.items() if read and all(re.fullmatch(_HEX, cell) for cell in read)]
    digits = [n for n in digits if len({*map(len, there[n])}) == 1]
    lettered = [row[n] for row in body for n in digits if re.search("[A-Fa-f]", row[n])]
    moving = [n for n in digits if len({row[n] for row in body}) > 1]
    if 2 * sum(any(re.search("[A-Fa-f]", row[n]) for row in body) for n in moving) < len(moving):
        return split  # numbers beside a checksum or a device's name
    if 10 * len(lettered) < len(body) or not any(
        re.search(r"[ABCDFabcdf]", f) and f[0].isdigit() for f in lettered
    ):
        return split
    digits = [n for n in digits if len(there[n][0]) == len(lettered[0])]
    for n in [n for n in digits if not any(re.search("[A-Fa-f]", cell) for cell in there[n])]:
        even = [_rises_evenly([int(cell, base) for cell in there[n]]) for base in (10, 16)]
        if even == [True, True]:
            raise ReadingError(
                f"{there[n][0]!r}: a hexadecimal number, as others on its line, or a decimal one? Write 0x before those"
            )
        digits = [d for d in digits if d != n] if even[0] else digits
    for _, row in split:
        for n in digits if len(row) == width else ():
            row[n] = f"0x{row[n]}" if re.fullmatch(_HEX, row[n]) else row[n]
    return split


def _rises_evenly(numbers: list[int]) -> bool:
    steps = np.diff(numbers)
    return len(steps) > 1 and bool((steps > 0).all()) and len({*steps.tolist()}) == 1

"""A log of any form as a table of named columns: text, spreadsheets, NumPy archives, Parquet."""

from __future__ import annotations

import csv
import importlib
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.errors import OptionError, ReadingError
from tacstrip.files import why_unreadable
from tacstrip.io.log_import.names import UNITS

_SEPARATORS = (";", "\t", "|", ",", " ")
_COMMENT = ("#", "%", "//", "!")
# Such as "14:03:07.512 -> ", which the serial monitor of the Arduino IDE puts before each line, or "[14:03:07] ".
_STAMP = re.compile(
    r"^\s*\[?(?:\d{4}-\d\d-\d\d[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)\]?\s*(?:->|=>|>|\||\t|\s)\s*(?=\S)"
)
_PAIR = re.compile(r"([A-Za-z_][\w.]*(?: ?[\[(][^\])]*[\])])?)\s*[:=]\s*([^\s,;|]*)")
_NUMBER = re.compile(r"^\s*([+-]?[\d.,' ]*\d[.,]?(?:[eE][+-]?\d+)?)\s*([A-Za-zµ%]{0,6})\s*$")
# What stands for an untouched strip in anybody's log.
NOTHING = frozenset(
    {"", "nan", "na", "n/a", "#n/a", "-", "--", "---", "null", "none", "open", "untouched", "-nan", "nc"}
)
_MOST_BYTES = 2**30
_FEW_LINES = 4  # of fewer, the length of the last number tells nothing
_STEADY = 0.8  # of the lines: a form that as many have is that of the log
CLOCK = "time of day [s]"  # the column of the serial monitor's stamps


class SeveralSheets(Exception):  # noqa: N818, a question
    """Names of the sheets of a workbook, of which one must be chosen."""


@dataclass(frozen=True)
class Table:
    """What a log holds, before anything of it is interpreted.

    Attributes
    ----------
    names
        Of the columns; "column 1", ... where the log has no names.
    rows
        Fields as text, as many as there are columns.
    lines
        Where each row stands in the log.
    decimal
        "." or ",".
    named
        Whether the names are the log's own.
    remarks
        What was decided on the way, each with its reason.
    broken
        Lines that are not like the others.
    """

    names: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    decimal: str = "."
    named: bool = True
    remarks: tuple[str, ...] = ()
    broken: tuple[int, ...] = field(default=())

    def column(self, name: str) -> list[str]:
        """Return the fields of a column."""
        place = self.names.index(name)
        return [row[place] for row in self.rows]


def number_of(text: str, decimal: str = ".") -> float | None:
    """Return a field's number, without its unit; None where it is none. "1.234,5" is 1234.5 with a decimal comma.

    Examples
    --------
    >>> number_of("2,50 V", ","), number_of("512"), number_of("n/a")
    (2.5, 512.0, None)
    """
    text = text.replace("\u202f", " ").replace("\xa0", " ")
    found = _NUMBER.match(text) if text.isascii() or "µ" in text else None
    if not found:
        return None
    digits = found.group(1).replace("'", "").replace(" ", "")
    thousands = "." if decimal == "," else ","
    whole, _, rest = digits.partition(decimal)
    if thousands in rest or (
        thousands in whole and not re.fullmatch(rf"[+-]?\d{{1,3}}(\{thousands}\d{{3}})+", whole)
    ):
        return None
    try:
        return float(f"{whole.replace(thousands, '')}.{rest}" if rest else whole.replace(thousands, ""))
    except ValueError:
        return None


def read_table(path: str | Path, sheet: str | None = None) -> Table:
    """Read a log: .csv, .tsv, .txt, .log and other text, .xlsx, .npz, .parquet.

    Parameters
    ----------
    path
        The file.
    sheet
        Of a workbook; None: its only one that holds something.

    Raises
    ------
    ReadingError
        It cannot be read, or has no table.
    OptionError
        A library that it needs is not there.
    """
    if unreadable := why_unreadable(path):
        raise ReadingError(f"{path}: {unreadable}")
    file = Path(path)
    try:
        match file.suffix.lower():
            case ".xlsx" | ".xlsm":
                return _of_cells(_chosen_sheet(file, _sheets(file), sheet), path)
            case ".npz":
                return _of_arrays(_archive(file), path)
            case ".parquet":
                return _of_columns(_parquet(file))
            case ".xls" | ".ods" | ".mat" | ".h5" | ".hdf5" | ".json":
                raise ReadingError(f"{path}: not a form that is read here; export it as CSV")
            case _:
                return of_text(_decoded(file), path)
    except FileNotFoundError:
        raise ReadingError(f"{path}: no such file") from None
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read ({error.strerror or error})") from None


def of_text(text: str, path: str | Path = "the log") -> Table:
    """Return a text as a table; errors as of `read_table`."""
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise ReadingError(f"{path}: the file is empty")
    remarks: list[str] = []
    stamps: dict[int, str] = {}
    found = [(i, _STAMP.match(line)) for i, line in lines]
    if sum(m is not None for _, m in found) > _STEADY * len(lines):
        stamps = {i: _seconds(m) for i, m in found if m}
        lines = [(i, line[m.end() :] if m else line) for (i, line), (_, m) in zip(lines, found, strict=True)]
        remarks.append("each line begins with a time of day, as a serial monitor puts there")
    table = _without_cut_end(_pairs(lines) or _separated(lines, path), text)
    remarks += table.remarks
    names, rows = table.names, table.rows
    if stamps:
        names = (CLOCK, *names)
        lacks = [i for i in table.lines if i not in stamps]
        if lacks:
            raise ReadingError(f"{path}: line {lacks[0]} has no time of day before it, and most have")
        # The table's own decimal mark holds for all of it.
        rows = [
            [stamps[i].replace(".", table.decimal), *row] for i, row in zip(table.lines, rows, strict=True)
        ]
    return Table(names, rows, table.lines, table.decimal, table.named, tuple(remarks), table.broken)


def _without_cut_end(table: Table, text: str) -> Table:
    """Return a table whose last line is a broken one, if the log ends within its last number."""
    if text.endswith(("\n", "\r")) or len(table.rows) < _FEW_LINES:
        return table
    *others, last = [row[-1] for row in table.rows]
    longer = [len(cell) for cell in others if cell]
    if not last or not longer or len(last) >= min(longer):
        return table
    broken = (*table.broken, table.lines[-1])
    return replace(table, rows=table.rows[:-1], lines=table.lines[:-1], broken=broken)


def _seconds(stamp: re.Match[str]) -> str:
    hours, minutes, seconds = stamp.groups()
    return f"{int(hours) * 3600 + int(minutes) * 60 + float(seconds.replace(',', '.')):.6f}"


def _decoded(file: Path) -> str:
    raw = file.read_bytes() if file.stat().st_size <= _MOST_BYTES else b""
    if not raw and file.stat().st_size:
        raise ReadingError(f"{file}: more than a gigabyte of text; cut it into pieces, or use a recording")
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if raw.startswith(mark):
            return raw.decode(name)
    if b"\0" in raw:
        raise ReadingError(f"{file}: not a text file (byte {raw.index(0)} is 0)")
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")  # of a spreadsheet on Windows


def _pairs(lines: list[tuple[int, str]]) -> Table | None:
    """Return lines such as "strip:3 vh=512 vl=300" as a table; None where the log is none of that kind."""
    found = [(i, line, _PAIR.findall(line)) for i, line in lines]
    many = Counter(tuple(name.strip() for name, _ in pairs) for _, _, pairs in found if len(pairs) > 1)
    if not many:
        return None
    names, count = many.most_common(1)[0]
    if count < _STEADY * len(lines) or len(set(names)) < len(names):
        return None
    same = [
        (i, [value for _, value in pairs])
        for i, _, pairs in found
        if tuple(n.strip() for n, _ in pairs) == names
    ]
    kept = {i for i, _ in same}
    decimal = _decimal([row for _, row in same], " ")
    return Table(
        names, [row for _, row in same], [i for i, _ in same], decimal,
        remarks=("each line names its values",), broken=tuple(i for i, _ in lines if i not in kept),
    )  # fmt: skip


def _fields(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [f.strip() for f in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _separated(lines: list[tuple[int, str]], path: str | Path) -> Table:
    """Return lines of fields with the separator that most of them share."""
    comments = [(i, line) for i, line in lines if line.lstrip().startswith(_COMMENT)]
    data = [(i, line) for i, line in lines if not line.lstrip().startswith(_COMMENT)]
    if not data:
        raise ReadingError(f"{path}: nothing but comments")
    ranked = []
    for separator in _SEPARATORS:
        try:
            counts = Counter(len(_fields(line, separator)) for _, line in data)
        except csv.Error:
            continue
        width, many = max(counts.items(), key=lambda item: (item[0] > 1, item[1]))
        if width > 1:
            ranked.append(
                (many / len(data) if separator != " " else 0.99 * many / len(data), separator, width)
            )
    if not ranked:
        return _one_column(data, path)
    share, separator, width = max(
        ranked, key=lambda r: (r[0] > _STEADY, r[0] > 0.999, -_SEPARATORS.index(r[1]), r[0])
    )
    if share < _STEADY * 0.99 and len(data) > 4:
        raise ReadingError(
            f"{path}: no separator gives lines of as many fields; save it as CSV with one line per reading"
        )
    split = [(i, _fields(line, separator)) for i, line in data]
    split = [(i, row[:-1] if len(row) == width + 1 and not row[-1] else row) for i, row in split]
    top = next((row for _, row in split if len(row) == width), [])
    if top and not top[-1] and any(top) and all(len(row) < width or not row[-1] for _, row in split):
        words = [cell for cell in top if cell and number_of(cell) is None and number_of(cell, ",") is None]
        if 2 * len(words) > len(top):  # a header that ends with a separator, as all lines below it do
            split, width = [(i, row[: width - 1]) for i, row in split], width - 1
    decimal = _decimal([row for _, row in split if len(row) == width], separator)
    said = {"\t": "tabs", " ": "spaces"}.get(separator, repr(separator))
    remarks = (f"fields are separated by {said}", *(("decimal commas",) if decimal == "," else ()))
    return _headed(split, width, decimal, remarks, comments, separator)


def _one_column(data: list[tuple[int, str]], path: str | Path) -> Table:
    if sum(number_of(line) is not None for _, line in data) < _STEADY * len(data):
        raise ReadingError(f"{path}: no table: no line has two fields")
    return _headed([(i, [line]) for i, line in data], 1, ".", (), [], ",")


def _headed(
    split: list[tuple[int, list[str]]],
    width: int,
    decimal: str,
    remarks: tuple[str, ...],
    comments: list[tuple[int, str]],
    separator: str,
) -> Table:
    """Find the header above the numbers: a line of names, perhaps with a line of units below it."""
    full = [row for _, row in split if len(row) == width]
    numeric = [
        any(column) and 2 * sum(_is_number(c, decimal) for c in column if c) >= sum(map(bool, column))
        for column in zip(*full[len(full) // 2 :], strict=True)
    ]
    headers = [len(row) != width or _is_header(row, numeric, decimal) for _, row in split]
    first = headers.index(False) if False in headers else len(split)
    above = [(i, row) for i, row in split[:first] if len(row) == width and any(row)]
    rows = [(i, row) for i, row in split[first:] if len(row) == width and any(row)]
    broken = tuple(i for i, row in split[first:] if len(row) != width)
    if not above and comments and rows:  # the header may be a comment
        before = [line for i, line in comments if i < rows[0][0]]
        names = _fields(before[-1].lstrip("#%/! \t"), separator) if before else []
        if len(names) == width and _is_header(names, numeric, decimal):
            above = [(0, names)]
    named = bool(above)
    names = above[-1][1] if above else [f"column {n + 1}" for n in range(width)]
    if len(above) > 1 and all(_is_unit(cell) for cell in above[-1][1]):
        names = [
            f"{n} [{u.strip('[]() ')}]" if u.strip("[]() ") else n
            for n, u in zip(above[-2][1], above[-1][1], strict=True)
        ]
    if skipped := first - (1 if above and above[0][0] else 0):
        remarks = (*remarks, f"{skipped} line(s) above the table passed over") if skipped > 0 else remarks
    names = [name or f"column {n + 1}" for n, name in enumerate(names)]
    if twice := [name for name, many in Counter(names).items() if many > 1]:
        names = [f"{name} ({n + 1})" if name in twice else name for n, name in enumerate(names)]
    return Table(
        tuple(names), [row for _, row in rows], [i for i, _ in rows], decimal, named, remarks, broken
    )


def _is_number(cell: str, decimal: str) -> bool:
    """Return whether a field is a number or a time."""
    return number_of(cell, decimal) is not None or bool(re.match(r"^\d[\d:.\-T ]+Z?$", cell))


def _is_header(row: Sequence[str], numeric: Sequence[bool], decimal: str) -> bool:
    """Return whether a row has words, and no signs of an untouched strip, where columns hold numbers; or is empty."""
    words = [
        bool(cell)
        and not _is_number(cell, decimal)
        and cell.casefold() not in NOTHING
        and cell.casefold() != "ol"
        for cell in row
    ]
    return any(w and n for w, n in zip(words, numeric, strict=True)) or not any(row)


def _is_unit(cell: str) -> bool:
    return cell.strip("[]() ").casefold() in {"", "-", "n", "nr", "-/-", "1", *UNITS}


def _decimal(rows: list[list[str]], separator: str) -> str:
    """Return the decimal mark: a comma where no field has a point, and where it is no thousand's."""
    if separator == ",":
        return "."
    comma, point = (re.compile(rf"[+-]?\d*\{mark}\d+(?:[eE][+-]?\d+)?(?:\s*[A-Za-z%]+)?") for mark in ",.")
    columns = [
        [f for f in column if number_of(f) is not None or comma.fullmatch(f)]
        for column in zip(*rows, strict=True)
    ]
    commas = [f for column in columns for f in column if comma.fullmatch(f)]
    points = [f for column in columns for f in column if point.fullmatch(f)]
    if any(re.fullmatch(r"[+-]?\d{1,3}(\.\d{3})+,\d+", f) for row in rows for f in row):
        return ","
    if commas and points:
        raise ReadingError(
            f"decimal points ({points[0]!r}) and decimal commas ({commas[0]!r}) in one log; save "
            f"it with one of them"
        )
    # Of thousands, a column has smaller numbers without a mark, too, or none that begins with 0.
    thousands = [
        column
        for column in columns
        if any(comma.fullmatch(f) for f in column)
        and all(re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})?", f) for f in column)
        and any("," not in f for f in column)
    ]
    if thousands:
        shown = next(f for f in thousands[0] if "," in f)
        raise ReadingError(
            f"{shown!r}: a decimal comma, or thousands? Write such numbers with a decimal point, "
            f"without marks in between"
        )
    return "," if commas else "."


@contextmanager
def _library_at_work(file: Path) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file of its own form into a `ReadingError`."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise ReadingError(
            f"{file}: no {file.suffix} file, or a damaged one ({type(error).__name__})"
        ) from None


def _sheets(file: Path) -> dict[str, list[list[str]]]:
    """Return the cells of the sheets of a workbook that hold something, by name."""
    openpyxl = _library("openpyxl", file, "spreadsheet")
    with file.open("rb") as opened, _library_at_work(file):
        book = openpyxl.load_workbook(opened, read_only=True, data_only=True)
        found = {
            ws.title: [[_text(cell) for cell in row] for row in ws.iter_rows(values_only=True)]
            for ws in book.worksheets
        }
    return {title: rows for title, rows in found.items() if any(map(any, rows))}


def _chosen_sheet(file: Path, sheets: dict[str, list[list[str]]], name: str | None) -> list[list[str]]:
    chosen = [title for title in sheets if name in (None, title)]
    if not chosen:
        raise ReadingError(f"{file}: no sheet {name!r}; it has: {', '.join(sheets) or 'nothing'}")
    if len(chosen) > 1:
        raise SeveralSheets(", ".join(chosen))
    return sheets[chosen[0]]


def _archive(file: Path) -> dict[str, npt.NDArray[Any]]:
    with file.open("rb") as opened, _library_at_work(file), np.load(opened, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _parquet(file: Path) -> dict[str, list[Any]]:
    parquet = _library("pyarrow.parquet", file, "data")
    with file.open("rb") as opened, _library_at_work(file):
        columns: dict[str, list[Any]] = parquet.read_table(opened).to_pydict()
    return columns


def _of_cells(rows: list[list[str]], path: str | Path) -> Table:
    numbered = [(i, row) for i, row in enumerate(rows, 1) if any(row)]
    if not numbered:
        raise ReadingError(f"{path}: the sheet is empty")
    width = Counter(
        max((n + 1 for n, cell in enumerate(row) if cell), default=0) for _, row in numbered
    ).most_common(1)[0][0]
    width = max([width] + [len(row) for _, row in numbered[:1] if len(row) <= width])
    return _headed(
        [(i, [*row[:width], *[""] * (width - len(row))]) for i, row in numbered], width, ".", (), [], ","
    )


def _of_arrays(arrays: dict[str, npt.NDArray[Any]], path: str | Path) -> Table:
    """Return the arrays of a NumPy archive: one column each, or one per strip where there is a second axis."""
    names: list[str] = []
    columns: list[list[str]] = []
    lengths = Counter(a.shape[0] for a in arrays.values() if a.ndim in (1, 2))
    if not lengths:
        raise ReadingError(f"{path}: no array of scans (scans,) or (scans, strips) in it")
    scans = max(lengths.items(), key=lambda item: (item[1], item[0]))[0]
    passed = [name for name, a in arrays.items() if a.ndim not in (1, 2) or a.shape[0] != scans]
    for name, array in arrays.items():
        if name in passed:
            continue
        for n, values in enumerate(array.T if array.ndim == 2 else [array]):
            names.append(f"{name}_{n}" if array.ndim == 2 else name)
            columns.append([_text(v) for v in values.tolist()])
    rows = [list(row) for row in zip(*columns, strict=True)]
    remarks = (f"arrays of another length passed over: {', '.join(passed)}",) if passed else ()
    return Table(tuple(names), rows, list(range(1, len(rows) + 1)), remarks=remarks)


def _of_columns(columns: dict[str, list[Any]]) -> Table:
    rows = [[_text(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return Table(tuple(columns), rows, list(range(1, len(rows) + 1)))


def _text(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return f"{value:.15g}"
    return str(value).strip()


def _library(name: str, path: str | Path, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise OptionError(
            f"{path}: reading it needs {name}: pip install 'tacstrip[{extra}]', or save it as CSV"
        ) from None

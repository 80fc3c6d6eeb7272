"""Logs in files that are no text: spreadsheets, NumPy archives, Parquet; and a log's file of any kind as a table."""

from __future__ import annotations

import gzip
import importlib
import json
import math
import re
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from tacstrip.errors import OptionError, ReadingError
from tacstrip.files import why_unreadable
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.decoding import decoded
from tacstrip.io.log_import.fields import quantity, says_nothing
from tacstrip.io.log_import.headed import decimal_mark, headed
from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.relations import joined
from tacstrip.io.log_import.shape import in_normal_form
from tacstrip.io.log_import.sheets import numbered_scans, of_scans, of_strips, of_two_channels
from tacstrip.io.log_import.table import Table, text_of
from tacstrip.io.log_import.text import content_of, of_text
from tacstrip.io.log_import.thousands import mark_thousands
from tacstrip.io.log_import.uneven import in_first_order

ALL = "all"  # sheets of one form
_MOST_UNPACKED = 2**28  # bytes
_MOST_ROWS = 2**20  # of a sheet, as the form sets it
_MOST_NUMBERS = 2**25  # of a file: as many take gigabytes
_START = 4096  # bytes that tell a text
_OURS = 65536  # bytes, within which a recording of tacstrip names it
_LONG = 100  # characters of a library's message
_OFFICE, _TABLE, _TEXT = (
    f"{{urn:oasis:names:tc:opendocument:xmlns:{part}:1.0}}" for part in ("office", "table", "text")
)
_MOST_EMPTY = 2**10  # cells beside each other: a sheet's row ends in thousands of these
_NEW_MATLAB = b"MATLAB 7.3"


class SeveralSheets(Exception):  # noqa: N818, a question
    """Names of the sheets of a workbook, of which one must be chosen."""


def read_table(path: str | Path, sheet: str | None = None) -> Table:
    """Read a log: .csv, .tsv, .txt, .log, .json, .jsonl and other text, .xlsx, .ods, .npz, .npy, .mat, .parquet.

    Parameters
    ----------
    path
        The file.
    sheet
        Of a workbook; None: its only one that holds readings, or scans in turn; "all": those of one form.

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
    if file.suffix.lower() == ".gz":
        return _of_gzip(file, sheet)
    try:
        match file.suffix.lower():
            case ".xlsx" | ".xlsm":
                return _of_workbook(file, _sheets(file), sheet)
            case ".npz" | ".npy":
                return _of_archive(_archive(file), path)
            case ".parquet":
                return of_columns(_parquet(file))
            case ".feather" | ".arrow" | ".ipc":
                return of_columns(_feather(file))
            case ".ods" if not _is_text(file):
                return _of_workbook(file, _open_document(file), sheet)
            case ".mat" if not _is_text(file):
                return _of_archive(_matrices(file), path)
            case ".mcap" if not _is_text(file):
                raise ReadingError(f"{path}: {_of_mcap(file)}")
            case ".xls" | ".h5" | ".hdf5" if not _is_text(file):
                raise ReadingError(f"{path}: not a form that is read here; export it as CSV")
            case _:
                return of_text(decoded(file), path)
    except FileNotFoundError:
        raise ReadingError(f"{path}: no such file") from None
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read ({error.strerror or error})") from None


def _of_mcap(file: Path) -> str:
    """Return which command makes readings of an MCAP file: one that tacstrip recorded names it near the start."""
    with file.open("rb") as stream:
        own = b"tacstrip" in stream.read(_OURS)
    if own:
        return f"is a recording; `tacstrip convert {file} -o readings.csv` makes readings of it"
    return (
        "is another program's recording; write its messages as lines of JSON, and import these: "
        f"mcap cat --json {file} > {file.stem}.jsonl (`mcap` is the command line tool of mcap.dev)"
    )


def _is_text(file: Path) -> bool:
    """Return whether a file is plain text whatever its ending says, as Octave saves matrices under .mat."""
    with file.open("rb") as stream:
        start = stream.read(_START)
    return bool(start) and not re.search(rb"[\0-\x08\x0e-\x1f]", start) and not start.startswith(b"MATLAB")


def _of_gzip(file: Path, sheet: str | None) -> Table:
    """Return the table of a file that gzip has packed, of any form that is read here."""
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / file.stem
        try:
            with gzip.open(file) as packed, plain.open("wb") as out:
                size = 0
                while part := packed.read(2**20):
                    _check_size(file, size := size + len(part))
                    out.write(part)
        except (OSError, EOFError, zlib.error) as error:
            raise ReadingError(f"{file}: no .gz file, or a damaged one ({error})") from None
        try:
            return read_table(plain, sheet)
        except ReadingError as error:
            raise ReadingError(str(error).replace(str(plain), str(file))) from None


def of_columns(columns: Mapping[str, Iterable[Any]]) -> Table:
    """Return columns of values as a table in normal form; None and NaN are empty fields, records lines of JSON."""
    if any(_holds_records(value) for values in columns.values() for value in values):
        rows_of = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
        return of_text("\n".join(json.dumps(row, default=text_of) for row in rows_of), "")
    rows = [[_field(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return in_normal_form(Table(tuple(columns), rows, list(range(1, len(rows) + 1))))


def _holds_records(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list | np.ndarray) and any(map(_holds_records, value))
    )


def _field(value: Any) -> str:
    array = isinstance(value, list | tuple | np.ndarray)
    return "[" + ", ".join(_field(v) or "null" for v in value) + "]" if array else text_of(value)


@contextmanager
def _library_at_work(file: Path) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file of its own form, which is open, into a `ReadingError`."""
    try:
        yield
    except ReadingError:
        raise
    except Exception as error:
        why = " ".join(str(error).split())[:_LONG] or type(error).__name__
        raise ReadingError(f"{file}: no {file.suffix} file, or a damaged one ({why})") from None


def _check_unpacked(file: Path, opened: BinaryIO) -> None:
    """Refuse what is no zip file, or would unpack to more than fits."""
    with zipfile.ZipFile(opened) as packed:
        _check_size(file, sum(member.file_size for member in packed.infolist()))
    opened.seek(0)


def _check_size(file: Path, size: int) -> None:
    if size > _MOST_UNPACKED:
        raise ReadingError(f"{file}: more than {_MOST_UNPACKED / 2**20:g} MB unpacked; cut it into pieces")


def _sheets(file: Path) -> dict[str, list[list[Any]]]:
    """Return the cells of the sheets of a workbook that hold something, by name."""
    openpyxl = _library("openpyxl", file, "spreadsheet")
    with file.open("rb") as opened, _library_at_work(file):
        _check_unpacked(file, opened)
        book = openpyxl.load_workbook(opened, read_only=True, data_only=True)
        found = {ws.title: _cells(ws, file) for ws in book.worksheets}
    return {title: rows for title, rows in found.items() if any(text_of(c) for row in rows for c in row)}


def _cells(sheet: Any, file: Path) -> list[list[Any]]:
    """Return the cells of a sheet, each row as far as it is filled: the size that the sheet states may be wrong."""
    sheet.reset_dimensions()
    rows: list[list[Any]] = []
    for row in sheet.iter_rows():
        rows.append([_shown(c.value, c.value is not None and "%" in (c.number_format or "")) for c in row])
        if len(rows) > _MOST_ROWS:
            raise ReadingError(
                f"{file}: sheet {sheet.title!r} has more rows than a sheet can have: it is damaged"
            )
    return rows


def _shown(value: Any, percent: bool) -> Any:
    """Return what a cell holds, as the sheet shows it where that is in percent: 45.2% for 0.452."""
    return f"{100.0 * value:.12g}%" if percent and isinstance(value, int | float) else value


def _open_document(file: Path) -> dict[str, list[list[Any]]]:
    """Return the cells of the sheets of an OpenDocument spreadsheet that hold something, by name."""
    with file.open("rb") as opened, _library_at_work(file):
        _check_unpacked(file, opened)
        with zipfile.ZipFile(opened) as packed:
            root = ET.fromstring(packed.read("content.xml"))
        found: dict[str, list[list[Any]]] = {}
        for sheet in root.iter(f"{_TABLE}table"):
            rows = found[sheet.get(f"{_TABLE}name", "")] = []
            for row in sheet.iter(f"{_TABLE}table-row"):
                cells: list[Any] = []
                for cell in row:
                    many = int(cell.get(f"{_TABLE}number-columns-repeated", 1))
                    value = _cell(cell)
                    _check_size(file, sum(map(len, rows)) + len(cells) + many if value is not None else 0)
                    cells += [value] * (many if value is not None else min(many, _MOST_EMPTY))
                many = int(row.get(f"{_TABLE}number-rows-repeated", 1))
                filled = any(value is not None for value in cells)
                _check_size(file, many * len(cells) if filled else 0)
                rows += [cells] * (many if filled else 1)
    return {title: rows for title, rows in found.items() if any(text_of(c) for row in rows for c in row)}


def _cell(cell: ET.Element) -> Any:
    """Return what a cell of OpenDocument holds, as other workbooks have it; None where that is nothing."""
    shown = "\n".join("".join(p.itertext()) for p in cell.findall(f"{_TEXT}p"))
    if (number := cell.get(f"{_OFFICE}value")) is not None:
        return _shown(float(number), cell.get(f"{_OFFICE}value-type") == "percentage")
    return cell.get(f"{_OFFICE}date-value") or shown or None


def _of_workbook(file: Path, sheets: dict[str, list[list[Any]]], name: str | None) -> Table:
    if name is not None and name not in (*sheets, ALL):
        raise ReadingError(f"{file}: no sheet {name!r}; it has: {', '.join(sheets) or 'nothing'}")
    if not sheets:
        raise ReadingError(f"{file}: the workbook is empty")
    if name in sheets or len(sheets) == 1:
        return _of_cells(sheets[name if name in sheets else next(iter(sheets))], file)
    tables = {}
    for title, rows in sheets.items():
        with suppress(ReadingError):  # as of a sheet of notes
            tables[title] = _of_cells(rows, file)
    read = [title for title, table in tables.items() if table.named and table.rows and _holds_readings(table)]
    read = [title for title in read if _names_strips(tables[title])] or read or [*tables]
    kept = {title: tables[title] for title in read}
    if both := of_two_channels(kept) or of_strips(kept) or joined(tables):
        notes = (text_of(c) for title in sheets if title not in kept for row in sheets[title] for c in row)
        return replace(both, preamble=(*filter(None, notes), *both.preamble))
    one = of_scans(kept) if len(kept) > 1 else None
    if one is not None and (name == ALL or numbered_scans(read)):
        return one
    if name == ALL and len(read) > 1:
        raise ReadingError(
            f"{file}: sheets {', '.join(read)} are not of one form, or their times do not follow; choose one"
        )
    if len(read) != 1:
        raise SeveralSheets(", ".join([*(read or sheets), *([ALL] if one is not None else [])]))
    told = f"sheet {read[0]!r}: the only one with readings"
    return replace(tables[read[0]], remarks=(told, *tables[read[0]].remarks))


def _holds_readings(table: Table) -> bool:
    """Return whether a sheet has a column of readings: a name, and below it numbers or what stands for no contact."""
    named = [n for n, m in meanings(table.names).items() if m.role == "reading"]
    columns = [[f for f in table.column(n) if not says_nothing(f)] for n in named]
    return any(c and all(quantity(f, table.decimal) is not None for f in c) for c in columns)


def _names_strips(table: Table) -> bool:
    return any(m.role == "strip" or m.strip is not None for m in meanings(table.names).values())


def _from_first_column(cells: list[list[Any]]) -> list[list[Any]]:
    """Return rows without the columns left of where all that are wide begin; a title that stands there stays."""
    begins = [
        next(n for n, c in enumerate(row) if text_of(c))
        for row in cells
        if sum(map(bool, map(text_of, row))) > 2
    ]
    first = min(begins, default=0)
    return [
        row[first:] if any(map(text_of, row[first:])) else [c for c in row if text_of(c)] for row in cells
    ]


def _of_cells(cells: list[list[Any]], path: str | Path) -> Table:
    cells = _without_thousands(_from_first_column(cells))
    written = [
        [c.strip() if isinstance(c, str) else "" for c in row] for row in cells if any(map(text_of, row))
    ]
    width = max(map(len, written), default=0)
    comma = decimal_mark([row + [""] * (width - len(row)) for row in written]) == ","
    rows = [
        [c.strip().replace(",", ".") if comma and isinstance(c, str) and _is_comma(c) else text_of(c) for c in row]
        for row in cells
    ]  # fmt: skip
    numbered = [(i, row) for i, row in enumerate(rows, 1) if any(row)]
    if not numbered:
        raise ReadingError(f"{path}: the sheet is empty")
    lengths = [max(n + 1 for n, cell in enumerate(row) if cell) for _, row in numbered]
    width = Counter(lengths).most_common(1)[0][0]
    width = max(
        [width, *(n for n in lengths[:6] if n > 1)]
    )  # names may reach further than the first readings
    told = ("decimal commas in text cells",) if comma else ()
    # Empty rows part what stands above the table from its names.
    split = [
        (i, [*row[:width], *[""] * (width - len(row))])
        for i, row in enumerate(rows, 1) if numbered[0][0] <= i <= numbered[-1][0]
    ]  # fmt: skip
    split, anew = in_first_order(split, [], width, ".")
    text = "\n".join("\t".join([*row, *[""] * (width - len(row))]) for row in rows)
    return replace(
        in_normal_form(headed(split, width, ".", (*told, *anew))),
        of_content=lambda strips, channels: content_of(text, strips, channels),
    )


def _without_thousands(cells: list[list[Any]]) -> list[list[Any]]:
    """Return cells with "2206" for texts such as "2,206", if their marks are of thousands."""
    texts = [c.strip() for row in cells for c in row if isinstance(c, str)]
    numbers = [t for t in texts if re.fullmatch(r"[+-]?\d[\d.,]*", t)]
    rest = "\n".join(t for t in texts if not re.search(r"\d[.,]\d", t))
    if not any("," in n for n in numbers) or not mark_thousands(numbers, rest):
        return cells
    return [
        [c.replace(",", "") if isinstance(c, str) and c.strip() in {*numbers} else c for c in row]
        for row in cells
    ]


def _is_comma(text: str) -> bool:
    return text.count(",") == 1 and text.strip().strip("+-").replace(",", "").isdigit()


def _archive(file: Path) -> dict[str, npt.NDArray[Any]]:
    with file.open("rb") as opened, _library_at_work(file):
        if file.suffix.lower() == ".npy":
            saved = np.load(opened, allow_pickle=False)
            if not saved.dtype.names or saved.ndim != 1:
                raise ReadingError(f"{file}: an array without names; save its columns by name, with np.savez")
            return {name: saved[name] for name in saved.dtype.names}
        _check_unpacked(file, opened)
        archive = np.load(opened, allow_pickle=False)
        found = {name: archive[name] for name in archive.files}
        if strange := [name for name, array in found.items() if not isinstance(array, np.ndarray)]:
            raise ReadingError(f"{file}: {strange[0]} in it is no array: no .npz file, or a damaged one")
        return found


def _matrices(file: Path) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays that MATLAB saves, vectors as such and numbers without axes."""
    from scipy import io  # late: it takes long

    with file.open("rb") as opened:
        if opened.read(len(_NEW_MATLAB)) == _NEW_MATLAB:
            raise ReadingError(
                f"{file}: saved with -v7.3; save it with save('log.mat', '-v7'), or export it as CSV"
            )
        opened.seek(0)
        with _library_at_work(file):
            _check_size(file, 8 * sum(math.prod(shape) for _, shape, _ in io.whosmat(opened)))
            saved = io.loadmat(opened)
    found = {
        n: a for n, a in saved.items() if isinstance(a, np.ndarray) and a.dtype.kind in "biuf" and a.size
    }
    return {n: a.squeeze() if a.ndim == 2 and 1 in a.shape else a for n, a in found.items()}


def _of_archive(arrays: dict[str, npt.NDArray[Any]], path: str | Path) -> Table:
    numbers = {name: a.item() for name, a in arrays.items() if a.size == 1 and a.ndim == 0}
    return of_arrays(arrays, path, numbers)


def _parquet(file: Path) -> dict[str, list[Any]]:
    parquet = _library("pyarrow.parquet", file, "data")
    with file.open("rb") as opened, _library_at_work(file):
        said = parquet.ParquetFile(opened, page_checksum_verification=True)
        if said.metadata.num_rows * said.metadata.num_columns > _MOST_NUMBERS:
            raise ReadingError(f"{file}: more than {_MOST_NUMBERS:,} numbers; cut it into pieces")
        return _of_arrow(said.read())


def _feather(file: Path) -> dict[str, list[Any]]:
    feather = _library("pyarrow.feather", file, "data")
    with file.open("rb") as opened, _library_at_work(file):
        read = feather.read_table(opened, memory_map=False)
        if read.num_rows * read.num_columns > _MOST_NUMBERS:
            raise ReadingError(f"{file}: more than {_MOST_NUMBERS:,} numbers; cut it into pieces")
        return _of_arrow(read)


def _of_arrow(table: Any) -> dict[str, list[Any]]:
    """Return columns of an Arrow table as values of Python, whose times have no nanoseconds."""
    types = importlib.import_module("pyarrow").types
    while any(types.is_struct(t) for t in table.schema.types):
        table = table.flatten()
    columns = {}
    for field, column in zip(table.schema, table.columns, strict=True):
        fine = types.is_temporal(field.type) and getattr(field.type, "unit", "") == "ns"
        values = column.cast(_in_microseconds(field.type), safe=False) if fine else column
        columns[field.name] = values.to_pylist(maps_as_pydicts="strict")
    return columns


def _in_microseconds(kind: Any) -> Any:
    """Return the type of a time stamp, a duration or a time of day that counts microseconds."""
    pyarrow = importlib.import_module("pyarrow")
    if pyarrow.types.is_timestamp(kind):
        return pyarrow.timestamp("us", kind.tz)
    return pyarrow.duration("us") if pyarrow.types.is_duration(kind) else pyarrow.time64("us")


def _library(name: str, path: str | Path, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise OptionError(
            f"{path}: reading it needs {name}: pip install 'tacstrip[{extra}]', or save it as CSV"
        ) from None

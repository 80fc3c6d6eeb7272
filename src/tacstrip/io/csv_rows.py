"""A CSV file as a header and rows with their line numbers; every way in which it can be broken is named."""

from __future__ import annotations

import csv
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO, TypeVar

from tacstrip.errors import ReadingError, is_number, shortened
from tacstrip.files import other_kind, replacing, why_unreadable
from tacstrip.io.column_names import nearly
from tacstrip.io.columns import OTHER_FORM, PLACE

Row = tuple[int, list[str]]  # line number, fields
_Result = TypeVar("_Result")
_LONGEST_LINE = 2**24  # characters: a pipe may go on without end
_UTF16 = (b"\xff\xfe", b"\xfe\xff")  # marks at the start of such a file


@contextmanager
def csv_writer(path: str | Path, header: Sequence[str]) -> Iterator[Any]:
    """Give a writer of rows below a header, as of the module csv; the file is written whole or not at all."""
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(header)
        yield out


def read_csv(
    path: str | Path,
    what: str,
    parse: Callable[[list[str], Iterator[Row]], _Result],
    example: str = "scan,time_s,strip,v_h,v_l",
) -> _Result:
    """Open a file and return what `parse` makes of its header and rows.

    `what` names its content in messages, such as "readings"; `example` is a header that it could have.

    Raises
    ------
    ReadingError
        The file cannot be read, is no CSV with a header, or `parse` says so; the message starts with the file.
    """
    if unreadable := why_unreadable(path):
        raise ReadingError(f"{path}: {unreadable}")
    if (kind := other_kind(path, ".csv")) and Path(path).is_file():
        remedy = (
            f"; `tacstrip convert {shlex.quote(str(path))} -o readings.csv` makes them"
            if kind == "a recording"
            else ""
        )
        raise ReadingError(f"{path}: is {kind}, not {what} (CSV){remedy if what == 'readings' else ''}")
    last, ended = "\n", False  # the last line read, and whether it is the file's last

    def lines(file: TextIO) -> Iterator[str]:
        nonlocal last, ended
        while line := file.readline(_LONGEST_LINE):
            if len(line) == _LONGEST_LINE:
                raise ReadingError(
                    f"a line is longer than {_LONGEST_LINE} characters; {what} are CSV in short lines"
                )
            last = line
            yield line
        ended = True

    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = _rows(lines(file), what)
            header = _header(next(rows, (0, None))[1], what, example)
            return parse(header, _whole(rows, len(header)))
    except FileNotFoundError:
        raise ReadingError(f"{path}: no such file") from None
    except (UnicodeDecodeError, csv.Error):
        with Path(path).open("rb") as raw:
            if raw.read(2) in _UTF16:
                raise ReadingError(
                    f"{path}: the text is in UTF-16; save it as UTF-8, in a spreadsheet as CSV UTF-8"
                ) from None
        raise ReadingError(f"{path}: not a text file in UTF-8; {what} are CSV with a header line") from None
    except ReadingError as error:
        cut = ended and not last.endswith(("\n", "\r"))  # as where writing it was broken off
        hint = "; the last line has no line end: is the file cut off?" if cut else ""
        raise ReadingError(f"{path}: {error}{hint}") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ReadingError(f"{path}: cannot be read ({why})") from None


def find(header: list[str], name: str) -> int:
    """Return the place of a column that must be there."""
    if name not in header:
        hint = f". {OTHER_FORM}" if name == "scan" else ""
        raise ReadingError(
            nearly(header, [name], PLACE)
            or f"column {name!r} is missing; the header has: {shortened(header)}{hint}"
        )
    return header.index(name)


def _rows(file: Iterable[str], what: str) -> Iterator[Row]:
    reader = csv.reader(file, strict=True)
    for row in _closed(reader):
        if any("\0" in field for field in row):
            raise ReadingError(
                f"line {reader.line_num}: not text; {what} are CSV in UTF-8 with a header line"
            )
        if row:
            yield reader.line_num, [field.strip() for field in row]


def _closed(reader: Iterator[list[str]]) -> Iterator[list[str]]:
    """Yield rows; `ReadingError` where the file ends within quotes."""
    try:
        yield from reader
    except csv.Error as error:
        if "end of data" not in str(error):
            raise
        raise ReadingError("a field in quotes has no end") from None


def _header(header: list[str] | None, what: str, example: str) -> list[str]:
    if header is None:
        raise ReadingError(f"the file is empty; {what} need a header line and lines below it")
    if len(header) == 1 and (other := next((c for c in ";\t|" if c in header[0]), None)):
        raise ReadingError(
            f"columns are separated by {other!r}; separate them by commas, with decimal points"
            + (f". {OTHER_FORM}" if what == "readings" else "")
        )
    if any(header) and all(is_number(name) for name in header if name):
        raise ReadingError(
            f"the header line is missing: line 1 has numbers already; put names before it, such as {example}"
        )
    if twice := [name for name in header if name and header.count(name) > 1]:
        raise ReadingError(f"column {twice[0]!r} is there twice; leave one out")
    return header


def _whole(rows: Iterator[Row], fields: int) -> Iterator[Row]:
    for line, row in rows:
        if len(row) != fields:
            why = "is the file cut off?" if len(row) < fields else "are there decimal commas?"
            raise ReadingError(f"line {line} has {len(row)} fields and the header {fields}: {why}")
        yield line, row

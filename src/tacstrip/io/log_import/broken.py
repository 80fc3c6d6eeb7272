"""Lines that are not like the others: those that cannot have lost a scan in the middle are left out with a warning."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.records import is_label, items
from tacstrip.io.log_import.scans import LogScan, scans
from tacstrip.io.log_import.statements import untouched_said
from tacstrip.io.log_import.strays import form_of
from tacstrip.io.log_import.table import CLOCK, GARBLED, Table
from tacstrip.io.log_import.tokens import VALUE, parted
from tacstrip.io.log_import.words import finder

_NUMBERS = {mark: re.compile(rf"(?<![\w.])[-+]?\d+(?:\{mark}\d+)*(?!\w)") for mark in ".,"}
_NAME = re.compile(r"[^\W\d_]\w*")
_STAMP = re.compile(r"\d+:\d+(?::\d+)?(?:[.,]\d+)?|\d{4}-\d\d-\d\d[T ]?")
_FEW_VALUES = 0.5  # of those of other lines: a line with more may be a scan
_GAP, _REGULAR = 1.5, 0.9  # times the usual step, part of the steps that are near it
_FEW, _WORDS = 3, 5  # scans; words of a sentence
_QUOTED = 5  # lines that are named
_MOST_DAMAGED = 0.05  # of the rows: of more that are damaged, the form is not understood
_MOST_BELOW = 10  # lines of statistics


def settle_broken(clues: Clues, mapping: ColumnMapping, rough: list[LogScan]) -> None:
    """Take back the question on broken lines where leaving them out loses no scan but the first or the last one."""
    table = clues.table
    if not any(q.key == "broken_lines" for q in clues.questions) or {*table.broken} & {*table.lines}:
        return
    rows = [n for n in table.lines if n not in table.broken] or table.lines
    first, last = min(rows), max(rows)
    above = [n for n in table.broken if n < first]
    below = [n for n in table.broken if n > last]
    inner = [n for n in table.broken if first < n < last]
    if (
        inner
        and len(above) + len(inner) + len(below) == len(table.broken)
        and _is_whole(table, mapping, max(len(above), len(below)))
    ):
        clues.because(f"line(s) {_shown(inner)}: no readings, for every scan has its strips without them")
        clues.questions = [q for q in clues.questions if q.key != "broken_lines"]
        return
    if (
        len(above) + len(inner) + len(below) == len(table.broken)
        and all(_is_remark(table, n) for n in above[: -1 if _begins_within(table, above[-1:]) else None])
        and _at_the_end(table, below, _has_empty(table, rough))
        and (
            not inner
            or _lose_themselves(table, mapping, inner)
            or (
                all(_is_short(table, n) for n in inner)
                and not (mapping.strip and any(_names_readings(table, n) for n in inner))
                and _loses_nothing(clues, mapping, rough, inner)
            )
        )
    ):
        clues.questions = [q for q in clues.questions if q.key != "broken_lines"]


def _has_empty(table: Table, rough: list[LogScan]) -> bool:
    """Return whether scans without a contact are written out as others are, so that none is only a label."""
    if table.empty:
        return False
    listed = len(table.rows) >= len(rough) * len(rough[0].values)  # each strip, touched or not
    return any(np.isnan(scan.values).all() or (listed and np.isnan(scan.values).any()) for scan in rough)


def _lose_themselves(table: Table, mapping: ColumnMapping, inner: list[int]) -> bool:
    """Return whether lines are few, and those among the rows torn ones or messages: they hold fewer values than rows.

    What they leave out is a scan at most, which is told, and all others are what they were: these have times of their
    own, and of lines for each strip `scans` leaves out the whole scan. A line that may say of a scan that nothing
    touches is none of these.
    """
    quotes = [table.quotes.get(n, "") for n in inner]
    few = len(inner) <= max(_FEW, _MOST_DAMAGED * len(table.rows))
    return (
        few
        and bool(mapping.time or not inner)
        and not any(
            max(_values_of(quote, table.decimal), _parted_values(quote, table.decimal)) >= _usual(table)
            for quote in quotes
        )
        and not any(untouched_said([quote]) or finder("contact").search(quote) for quote in quotes)
    )


def _is_whole(table: Table, mapping: ColumnMapping, most: int) -> bool:
    """Return whether each scan lists every strip in lines of its own, more of them than `most`.

    Then no line between them is a reading that is damaged: that would leave a gap.
    """
    dropped: list[int] = []
    try:
        found = scans(replace(table, broken=()), replace(mapping, missing="error"), dropped)
    except ReadingError:
        return False
    lines = len({*table.lines} - {*table.broken}) // len(found)
    return not dropped and len(found) >= _FEW and lines > max(1, most)


def _shown(lines: list[int]) -> str:
    return ", ".join(map(str, lines[:_QUOTED])) + (", ..." if len(lines) > _QUOTED else "")


def are_torn(table: Table) -> bool:
    """Return whether the lines that are not like the others are few and among the rows, and none names a scan."""
    if len(table.broken) > _MOST_DAMAGED * len(table.rows) or min(table.broken) < min(table.lines):
        return False
    named = [item.name for n in table.broken for item in items(table.quotes.get(n, ""))]
    return len(table.broken) < _FEW and not any(meaning(name).role in ("time", "scan") for name in named)


def hold_readings(table: Table, lines: list[int]) -> list[int]:
    """Return the lines above or below all rows that hold as many numbers as these, as in a list's outer brackets."""
    quotes = {n: table.quotes.get(n, "") for n in lines if not min(table.lines) < n < max(table.lines)}
    return [
        n for n, q in quotes.items() if GARBLED not in q and _values_of(q, table.decimal) >= _usual(table)
    ]


def of_other_kinds(table: Table, lines: list[int]) -> bool:
    """Return whether lines are of forms of their own, each of several, so that none is a row that is damaged.

    Each begins with a word that no row has and that names no reading, and holds another number of values than rows do.
    """
    quotes = [table.quotes.get(n, "") for n in lines]
    forms = Counter(map(form_of, quotes))
    words = {
        w.casefold() for row in (table.names, *table.rows) for f in row for w in re.findall(r"[^\W\d_]+", f)
    }
    first = [m[1].casefold() if (m := re.match(r"\W*([^\W\d_]{2,})", q)) else "" for q in quotes]
    return (
        all(w and w not in words and not meaning(w).role for w in first)
        and min(forms.values(), default=0) >= _FEW
        and not any(_values_of(q, table.decimal) in (_usual(table), _usual(table) - 1) for q in quotes)
    )


def _at_the_end(table: Table, lines: list[int], labels: bool) -> bool:
    """Return whether lines below all rows are one that is cut, or several that begin with no number, as statistics.

    Where `labels`, one that is only a record's label is cut, too.
    """
    quotes = [table.quotes.get(n, "") for n in lines]
    if len(lines) == 1:
        label = (
            not labels
            and bool(re.search(r"\d", quotes[0]))
            and is_label(items(quotes[0]))
            and len(re.findall(r"[^\W\d_]+", quotes[0])) < _WORDS
        )
        begun = (
            bool(re.match(r"[^,;\t|]", quotes[0])) and not label and GARBLED not in quotes[0]
        )  # what is cut has its first field
        return begun and _values_of(quotes[0], table.decimal) <= _usual(table)
    return len(lines) <= _MOST_BELOW and all(q and not re.match(r"[\W_]*\d", q) for q in quotes)


def _is_short(table: Table, line: int) -> bool:
    """Return whether a line holds far fewer values than the table's do."""
    return _parted_values(table.quotes.get(line, ""), table.decimal) < _FEW_VALUES * _usual(table)


def _is_remark(table: Table, line: int) -> bool:
    """Return whether a line above all rows says something in words, and is no row that is damaged."""
    quote = table.quotes.get(line, "")
    words, values = len(re.findall(r"[^\W\d_]{3,}", quote)), _parted_values(quote, table.decimal)
    return words > 0 and (_is_short(table, line) or words > values < _usual(table))


def _begins_within(table: Table, last: list[int]) -> bool:
    """Return whether the last line above all rows is the end of one, within which the log begins: of fewer values.

    Its names are the last ones of rows, but for the first, which may be the end of one.
    """
    quote = "".join(table.quotes.get(n, "") for n in last)
    every = [found[0] for name in table.names if (found := _NAME.findall(name))]
    if not (names := _NAME.findall(quote)):
        return not table.named and 0 < _values_of(quote, table.decimal) < _usual(table)
    at = len(every) - len(names)
    return at > 0 and every[at + 1 :] == names[1:] and every[at].endswith(names[0])


def _parted_values(quote: str, decimal: str) -> int:
    return parted(0, _STAMP.sub(" ", quote), decimal).form.count(VALUE)


def _names_readings(table: Table, line: int) -> bool:
    words = re.findall(r"[^\W\d_][\w]*", _STAMP.sub(" ", table.quotes.get(line, "")))
    return any(meaning(w).role in ("reading", "strip", "scan") for w in words)


def _usual(table: Table) -> int:
    """Return how many values a line of a table holds, but for a time before it."""
    return Counter(table.lines).most_common(1)[0][1] * (len(table.names) - (CLOCK in table.names))


def _values_of(quote: str, decimal: str) -> int:
    """Return how many numbers and words for nothing a line holds, but for a time of day."""
    plain = _STAMP.sub(" ", quote)
    voids = sum(says_nothing(w) for w in re.split(r"[\s;,|]+", plain) if w)
    return len(_NUMBERS[decimal].findall(plain)) + voids


def _loses_nothing(clues: Clues, mapping: ColumnMapping, rough: list[LogScan], inner: list[int]) -> bool:
    """Return whether scans follow each other evenly and are whole where such lines stand, which hold few values."""
    table = clues.table
    if not mapping.time or len(rough) < _FEW:
        return False
    dropped: list[int] = []
    try:
        scans(table, mapping, dropped)
    except ReadingError:
        return False
    times, lines = np.array([s.time_s for s in rough]), np.array([s.line for s in rough])
    steps = np.diff(times)
    usual = float(np.median(steps))
    even = np.abs(steps - usual) < (_GAP - 1.0) * usual
    at = [int(np.searchsorted(lines, n)) - 1 for n in inner]
    return not dropped and float(np.mean(even)) >= _REGULAR and all(even[min(k, len(even) - 1)] for k in at)

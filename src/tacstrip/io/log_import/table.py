"""A log as a table of named columns, before anything of it is interpreted; where its names stand."""

from __future__ import annotations

import bisect
import itertools
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from datetime import timedelta
from functools import cached_property
from typing import Any

import numpy as np

from tacstrip.errors import ReadingError

GARBLED = "\ufffd"  # for what a board wrote as it was reset
CLOCK = "time stamp"  # the column of what a serial monitor or a logger puts before each line
BY_CONTENT = "no other assignment of its values is one that the sensor can have read"
PART = "part"  # the column that tells lines above a change of what readings mean from those below it
SHEET = "name of the sheet"  # a column, where each sheet is a run
ROW = "line of its block"  # where blocks of as many lines follow each other
_MOST_VOLTS = 100.0  # no Vref has more
_INNER = re.compile(r"(?:\[\d+\]|\.\w+)([.\[].*)")  # what is within a part of a record
_SAID_IN = {"hz": "Hz", "s": "s", "ms": "ms", "us": "us", "v": "V", "volt": "V", "volts": "V", "mv": "mV"}
_SAID = (
    (r"(?:\w+[_ ]?)?(?:fs|rate|freq|frequency|hz|sps)", "Hz"), (r"dt|interval|period|t_?s(?:ample)?", "s"),
    (r"(?:adc[_ ]?)?(?:bits|resolution(?:[_ ]bits)?)", "bits"), (r"v_?ref|aref|vcc|vdd", "V"),
)  # fmt: skip
_CELLS = 100_000  # of a table, however sparse
_SPARSEST = 256  # cells of a larger table to one that is filled: more than strips of which one is touched
_DEEPEST = 32  # levels of records within records
TOO_DEEP = f"the log has records of more than {_DEEPEST} levels within each other"


class ContradictionError(ReadingError):
    """What no line that is set aside would mend."""


class NoTableError(ReadingError):
    """Nothing tells where a log's fields begin and end, or what they are."""


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
    preamble
        Lines above the table.
    absent
        Of records that do not all name the same values: the first line that lacks one, 0 where none does.
    quotes
        What stands on broken lines, as far as that is known.
    empty
        Lines of rows that stand for scans in which nothing touches; each row is a scan of its own.
    retries
        The tables that the log would be without its stray lines, the fewest set aside first.
    refused
        Why the log is none with its stray lines.
    of_content
        What it is by what it holds, for a sensor of so many strips and channels; None where that does not tell it.
    doubts
        What of it may be meant otherwise than it is read.
    resolutions
        What lines that are no rows say of the codes' resolution: line, bits, what it says.
    varied
        Whether records name other strips from one to the next, as where they name only touched ones.
    changes
        Lines among the rows that tell of a change of what readings mean, and what they say.
    notes
        Other comments among the rows, and what they say.
    lacking
        The last names, where there are more names than any line has fields: as if these were missing.
    """

    names: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    decimal: str = "."
    named: bool = True
    remarks: tuple[str, ...] = ()
    broken: tuple[int, ...] = field(default=())
    preamble: tuple[str, ...] = ()
    absent: int = 0
    quotes: Mapping[int, str] = field(default_factory=dict)
    empty: frozenset[int] = frozenset()
    retries: Callable[[], Iterator[Table]] = field(default=lambda: iter(()), repr=False, compare=False)
    refused: ReadingError | None = None
    of_content: Callable[[int, int], Table | None] = field(
        default=lambda _strips, _channels: None, repr=False, compare=False
    )
    doubts: tuple[str, ...] = ()
    varied: bool = False
    resolutions: tuple[tuple[int, int, str], ...] = ()
    changes: tuple[tuple[int, str], ...] = ()
    notes: tuple[tuple[int, str], ...] = ()
    lacking: tuple[str, ...] = ()

    def column(self, name: str) -> list[str]:
        """Return the fields of a column."""
        place = self.places[name]
        return [row[place] for row in self.rows]

    def constants(self) -> list[str]:
        """Return what columns that never change say, as lines such as "first_strip: 0"."""
        columns = zip(self.names, zip(*self.rows, strict=True), strict=True)
        return [f"{name}: {fields[0]}" for name, fields in columns if len({*fields}) == 1 and fields[0]]

    @cached_property
    def places(self) -> dict[str, int]:
        """Where each column stands in a row."""
        return {name: place for place, name in enumerate(self.names)}

    @property
    def by_content(self) -> bool:
        """Whether its names are none of the log's, for only what it holds tells what its columns are."""
        return any(doubt.endswith(BY_CONTENT) for doubt in self.doubts)

    def of_rows(self, kept: Iterable[int]) -> Table:
        """Return it with only these of its rows, counted from 0, in this order."""
        chosen = [*kept]
        return replace(self, rows=[self.rows[n] for n in chosen], lines=[self.lines[n] for n in chosen])

    def with_columns(self, columns: Mapping[str, Sequence[str]], *remarks: str) -> Table:
        """Return it with other columns, and more remarks."""
        rows = [list(row) for row in zip(*columns.values(), strict=True)]
        return replace(self, names=tuple(columns), rows=rows, remarks=(*self.remarks, *remarks))

    def in_parts(self, changes: tuple[tuple[int, str], ...]) -> Table:
        """Return it with a column that says between which of such lines, as its `changes` are, a row stands."""
        at = [line for line, _ in changes]
        parts = [f"above line {at[0]}", *(f"below line {line}" for line in at)]
        rows = [
            [*row, parts[bisect.bisect_left(at, i)]] for i, row in zip(self.lines, self.rows, strict=True)
        ]
        if len({row[-1] for row in rows}) < 2:
            return self
        return replace(self, names=(*self.names, PART), rows=rows, changes=changes)

    def part_at_note(self, part: str) -> Table:
        """Return it in parts at the note whose line `part` names, at all where it names none; without one, at a row."""
        if not part or PART in self.names:
            return self
        line = re.fullmatch(r"(?:above|below) line (\d+)", part)
        notes = tuple(n for n in self.notes if not line or n[0] == int(line[1]))
        if notes:
            return self.in_parts(notes)
        first = int(line[1]) if line else 0  # of the rows below a jump
        if not (first in self.lines or part == "skip"):
            return self
        above, below = f"above line {first}", f"below line {first}"
        rows = [[*row, above if i < first else below] for i, row in zip(self.lines, self.rows, strict=True)]
        return replace(self, names=(*self.names, PART), rows=rows)

    def where(self, conditions: Sequence[str]) -> Table:
        """Return only the rows in which columns are as such conditions as "pad=left" say; `ReadingError`: none is."""
        table = self
        for condition in conditions:
            table = table.part_at_note(
                condition.removeprefix(f"{PART}=") if condition.startswith(PART) else ""
            )
            name = next((n for n in table.names if condition.startswith(f"{n}=")), "")
            fields = table.column(name) if name else []
            kept = [n for n, f in enumerate(fields) if f"{name}={f}" == condition]
            if not kept:
                raise ReadingError(f"no line has {condition}")
            table = table.of_rows(kept)
        return table


def of_records(
    records: Sequence[Mapping[str, str]], lines: list[int], decimal: str = ".", *remarks: str
) -> Table:
    """Return records as a table with a column for each name that occurs.

    An empty field in the place of a list or a record stands for all of what is in that elsewhere.
    """
    names = tuple(dict.fromkeys(itertools.chain.from_iterable(records)))
    parents = {parent for name in names for parent in _parents(name)}
    filled = {n for record in records for n, text in record.items() if text}
    void = {n for n in names if n in parents and n not in filled}
    names = tuple(n for n in names if n not in void)
    lists = {n for n in names if n not in filled}
    most = max(_CELLS, _SPARSEST * sum(map(len, records)))
    levels = sorted({len(_parents(n)) for n in lists} - {0})
    while levels and len(names) * len(records) <= most:
        names = _with_parts(names, lists, levels.pop(), most // len(records))  # so what is within comes first
    if len(names) * len(records) > most:
        raise ReadingError(
            f"the {len(records)} records of the log would make a table of {len(names)} columns that is nearly "
            f"empty, with {names[0]!r} and {names[-1]!r}; name what is alike the same in each record"
        )
    void |= lists - {*names}
    absent = next(
        (
            i
            for i, r in zip(lines, records, strict=True)
            if any(n not in r and not void.intersection(_parents(n), r) for n in names)
        ),
        0,
    )
    rows = [[record.get(name, "") for name in names] for record in records]
    return Table(names, rows, lines, decimal, remarks=remarks, absent=absent)


def _with_parts(names: tuple[str, ...], lists: Set[str], level: int, most: int) -> tuple[str, ...]:
    """Return names with the parts of their neighbours in the place of those that are empty throughout, of one level.

    Only the first one beyond `most`, so that what is damaged makes no more of them.
    """
    inner: dict[str, set[str]] = {}  # what is within the parts of a parent
    parent_of = {n: above[level - 1] for n in names if len(above := _parents(n)) >= level}
    for name, parent in parent_of.items():
        if found := _INNER.fullmatch(name[len(parent) :]):
            inner.setdefault(parent, set()).add(found[1])
    parts = {parent: sorted(found) for parent, found in inner.items()}
    here = {n for n in lists & parent_of.keys() if len(_parents(n)) == level}
    spread = ([n + p for p in parts.get(parent_of[n], [""])] if n in here else [n] for n in names)
    return tuple(itertools.islice(itertools.chain.from_iterable(spread), most + 1))


def _parents(name: str) -> list[str]:
    return [name[: mark.start()] for mark in re.finditer(r"[.\[]", name)]


def flattened(name: str, value: Any, _level: int = 0) -> dict[str, str]:
    """Return a value of a record as fields: arrays as name[0], name[1], ..., what is within it as name.key."""
    if _level >= _DEEPEST:
        raise ReadingError(TOO_DEEP)
    if isinstance(value, dict):
        parts = [(f"{name}.{key}" if name else str(key), v) for key, v in value.items()]
    elif isinstance(value, list | tuple):
        parts = [(f"{name}[{n}]", v) for n, v in enumerate(value)]
    else:
        return {name: text_of(value)}
    return {key: text for part, v in parts for key, text in flattened(part, v, _level + 1).items()}


def _counted(labels: Sequence[Any]) -> tuple[int, int] | None:
    """Return the first and the last number of labels that are the same but for one that counts, as S01, S02, ..."""
    found = [re.fullmatch(r"(\D+)(\d+)", t) if isinstance(t, str) else None for t in labels]
    numbers = [int(m[2]) for m in found if m]
    counted = len(numbers) == len(labels) > 1 and numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    return (numbers[0], numbers[-1]) if counted and len({m[1] for m in found if m}) == 1 else None


def said_above(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what stands beside a log's arrays or records as lines such as "rate 20 Hz" that could stand above them.

    Examples
    --------
    >>> said_above({"meta": {"fs": 20, "adc": {"bits": 12}}, "vref_mV": 3300, "unit": "mV"})
    ('fs: 20 Hz', 'bits: 12 bits', 'vref: 3300 mV', 'unit: mV')
    """
    told: list[str] = []
    milli = any(re.fullmatch("units?", k, re.IGNORECASE) and v == "mV" for k, v in values.items())
    for key, value in values.items():
        if isinstance(value, Mapping):
            told += said_above(value)
        elif isinstance(value, list) and (ends := _counted(value)):
            told.append(f"{key}: {ends[0]} to {ends[1]}")
        elif isinstance(value, str | int | float) and not isinstance(value, bool):
            name, _, last = key.rpartition("_")
            unit = _SAID_IN.get(last.casefold() if name else "", "")
            name = name if unit else key
            unit = unit or next((u for words, u in _SAID if re.fullmatch(words, key, re.IGNORECASE)), "")
            if milli and unit == "V" and isinstance(value, int | float) and value > _MOST_VOLTS:
                unit = "mV"  # as the unit beside it says
            told.append(f"{name}: {value} {unit if isinstance(value, int | float) else ''}".rstrip())
    return tuple(told)


def text_of(value: Any) -> str:
    """Return a cell of a spreadsheet, an array or a record as a field."""
    if value is None or value is getattr(sys.modules.get("pandas"), "NA", None) or value != value:
        return ""
    if isinstance(value, timedelta):
        return f"{value.total_seconds():.15g} s"
    if isinstance(value, float | np.floating):
        return f"{value:.15g}"
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    return str(value).strip()

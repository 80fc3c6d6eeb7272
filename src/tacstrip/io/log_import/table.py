"""A log as a table of named columns, before anything of it is interpreted; where its names stand."""

from __future__ import annotations

import bisect
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import is_prose, is_sentence, is_value, number_of, says_nothing, ungrouped
from tacstrip.io.log_import.names import READING_UNITS, UNITS, meaning, meanings, unknown_unit

GARBLED = "\ufffd"  # for what a board wrote as it was reset
CLOCK = "time stamp"  # the column of what a serial monitor or a logger puts before each line
PART = "part"  # the column that tells lines above a change of what readings mean from those below it
ROW = "line of its block"  # where blocks of as many lines follow each other
_MOST_VOLTS = 100.0  # no Vref has more
_TALLEST_HEADER = 5
_STATISTICS = frozenset(
    {"mean", "average", "avg", "mittel", "mittelwert", "moyenne", "media", "promedio", "mw", "min", "minimum", "max"}
    | {"maximum", "std", "stdev", "stddev", "stabw"}
    | {"sd", "sigma", "sum", "summe", "total"}
    | {"somme", "median", "count"}
    | {"anzahl", "rms", "var", "variance", "range", "25%", "50%", "75%"}
    | {"std dev", "std. dev", "st. dev", "standard deviation", "stdev.s"}
    | {"stdev.p", "standardabweichung", "varianz", "\u00f8"}
    | {"durchschnitt", "gesamt", "\u00e9cart-type", "\u00e9cart type", "ecart-type", "m\u00e9diane", "moy"}
    | {"m\u00e9dia", "desvio padr\u00e3o", "desvio", "mediana", "m\u00edn"}
    | {"m\u00e1x", "m\u00ednimo", "m\u00e1ximo", "soma", "vari\u00e2ncia"}
    | {"desviaci\u00f3n", "desviaci\u00f3n est\u00e1ndar", "desv. est", "suma", "varianza"}
    | {"deviazione standard", "dev. st", "somma"}
    | {"minimo", "massimo", "gemiddelde", "gemiddeld", "standaardafwijking", "\u015brednia", "srednia", "odchylenie"}
    | {"mediaan", "skew", "kurtosis", "\u03c3", "\u03bc"}
    | {"\u5e73\u5747", "\u6807\u51c6\u5dee", "\u6a19\u6e96\u504f\u5dee"}
)  # fmt: skip
_UNIT_WORDS = frozenset({"unit", "units", "einheit", "einheiten"})
_INNER = re.compile(r"(?:\[\d+\]|\.\w+)([.\[].*)")  # what is within a part of a record
_SAID_IN = {"hz": "Hz", "s": "s", "ms": "ms", "us": "us", "v": "V", "volt": "V", "volts": "V", "mv": "mV"}
_SAID = (
    (r"(?:\w+[_ ]?)?(?:fs|rate|freq|frequency|hz|sps)", "Hz"), (r"dt|interval|period|t_?s(?:ample)?", "s"),
    (r"(?:adc[_ ]?)?(?:bits|resolution(?:[_ ]bits)?)", "bits"), (r"v_?ref|aref|vcc|vdd", "V"),
)  # fmt: skip
_LONG = 40  # characters of a line that are quoted
_CELLS = 100_000  # of a table, however sparse
_SPARSEST = 256  # cells of a larger table to one that is filled: more than strips of which one is touched
_DEEPEST = 32  # levels of records within records
_FEW = 2  # fields that may look like units by chance


class ContradictionError(ReadingError):
    """What no line that is set aside would mend."""


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

    @cached_property
    def places(self) -> dict[str, int]:
        """Where each column stands in a row."""
        return {name: place for place, name in enumerate(self.names)}

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
        """Return it in parts at the note whose line `part` names, at all where it names none; as it is without one."""
        line = re.fullmatch(r"(?:above|below) line (\d+)", part)
        notes = tuple(n for n in self.notes if not line or n[0] == int(line[1]))
        return self.in_parts(notes) if notes and part and PART not in self.names else self

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
            table = replace(table, rows=[table.rows[n] for n in kept], lines=[table.lines[n] for n in kept])
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
        raise ReadingError(f"the log has records of more than {_DEEPEST} levels within each other")
    if isinstance(value, dict):
        parts = [(f"{name}.{key}" if name else str(key), v) for key, v in value.items()]
    elif isinstance(value, list | tuple):
        parts = [(f"{name}[{n}]", v) for n, v in enumerate(value)]
    else:
        return {name: text_of(value)}
    return {key: text for part, v in parts for key, text in flattened(part, v, _level + 1).items()}


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
    if value is None or value != value:
        return ""
    if isinstance(value, float | np.floating):
        return f"{value:.15g}"
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    return str(value).strip()


def headed(
    split: list[tuple[int, list[str]]],
    width: int,
    decimal: str,
    remarks: tuple[str, ...] = (),
    comments: Sequence[tuple[int, list[str]]] = (),
    preamble: Sequence[str] = (),
) -> Table:
    """Return rows of fields as a table: find the names above the numbers, in one line or in several.

    Parameters
    ----------
    split
        Line number and fields of each row, also of those that have not `width` fields.
    width, decimal
        Number of fields of the table's rows, and their decimal mark.
    remarks, preamble
        Of the table.
    comments
        Line number and fields of comments that could hold the names.
    """
    full = [row for _, row in split if len(row) == width]
    numeric = [
        any(is_value(c, decimal) for c in column)
        and 2 * sum(is_value(c, decimal) for c in column) >= sum(not says_nothing(c) for c in column)
        for column in zip(*full[len(full) // 3 :], strict=True)
    ]
    if not any(numeric):
        units = (re.fullmatch(r"[-+]?\d[\d.,]*\s?([^\W\d]{1,6})", cell) for row in full for cell in row)
        strange = next((m for m in units if m and unknown_unit(f"x [{m[1]}]")), None)
        said = (
            f": {strange[1]!r}, as in {strange[0]!r}, is no unit of readings that is known" if strange else ""
        )
        raise ReadingError(f"the log has no column of numbers{said}")
    # Words that stand for no contact come again in the lines below the names.
    lower = [
        row
        for row in full[len(full) // 2 :]
        if any(n and is_value(cell, decimal) for cell, n in zip(row, numeric, strict=True))
    ]
    usual = {cell for row in lower for cell in row if not is_value(cell, decimal)}
    headers = [
        len(row) != width or not any(row) or _named(row, numeric, decimal, usual) > 0 for _, row in split
    ]
    first = headers.index(False) if False in headers else len(split)
    above = _last_block([row for _, row in split[:first]])
    above = [row for row in above if len(row) == width and any(row) and not _says_one_number(row)]
    above = above[-_TALLEST_HEADER:]
    if first < len(split) and (_counts(split[first][1], full[-1]) or _numbers_columns(split[first][1])):
        above, first = [*above, split[first][1]], first + 1
    # What is below the names, and has numbers, is no heading, however short.
    names_at = max((n for n, (_, row) in enumerate(split[:first]) if row in above), default=first)
    cut = [
        (i, row) for i, row in split[names_at + 1 : first]
        if row not in above and len(row) > 1 and sum(is_value(c, decimal) for c in row) > 0.5 * len(row)
    ]  # fmt: skip
    if names_at == first:  # no names: what holds as many readings as the others is none either
        cut = [
            (i, row) for i, row in split[:first]
            if len(row) > width > _FEW and all(c and (is_value(c, decimal) or says_nothing(c)) for c in row[:width])
        ]  # fmt: skip
    below = cut + [(i, row) for i, row in split[first:] if any(row)]
    if not above and below:
        above = [row for i, row in comments if i < below[0][0] and len(row) == width][-1:]
        above = [
            r for r in above if _named(r, numeric, decimal) and not any(number_of(c) is not None for c in r)
        ]
    _check_names(split, above, width, decimal)
    again = {i for i, row in below if len(row) == width and row in above}
    # What a board says as it starts stands above the table, and again where it was reset.
    banner = [row for _, row in split[:first] if row not in above]
    boots = {i for i, row in split[first:] if len(row) != width and row in banner}
    below = [(i, row) for i, row in below if i not in boots]
    garbled = {i for i, row in below if GARBLED in "".join(row)}
    rows = [(i, row) for i, row in below if len(row) == width and i not in {*again, *garbled}]
    sums = {i: word for i, row in rows if (word := _statistic(row, numeric, decimal))}
    sums = sums if 2 * len(sums) < len(rows) else {}  # else these are labels
    rows = [(i, row) for i, row in rows if i not in sums]
    notes = {i for i, row in rows if _is_note(row, numeric, decimal)}
    rows = [(i, row) for i, row in rows if i not in notes]
    # A line without a digit holds no reading, so none is lost with it.
    told_names = {w.casefold() for row in above for w in re.findall(r"[^\W\d_]+", " ".join(row))}
    told_names |= {w.casefold() for _, row in rows for cell in row for w in re.findall(r"[^\W\d_]{3,}", cell)}
    odd = [(i, " ".join(row)) for i, row in below if len(row) != width or i in garbled]
    broken = tuple(
        i for i, text in odd
        if re.search(r"\d", text)
        and (i in garbled or not (is_prose(text, told_names) or (i > rows[-1][0] and is_sentence(text))))
    )  # fmt: skip
    words = len(odd) - len(broken) + len(notes)
    numbers = [
        f"{i} ({' '.join(row)[:_LONG]!r})" for i, row in split[: max(first - len(above), 0)]
        if len(row) > 1 and all(is_value(c, decimal) for c in row)
    ]  # fmt: skip
    if not rows:
        raise ReadingError("the log has no line of readings" + (", only names" if above else ""))
    names = _names(above, width)
    columns = list(zip(*(row for _, row in rows), strict=True))
    first_at: dict[tuple[str, tuple[str, ...]], int] = {}
    for n, key in enumerate(zip(names, columns, strict=True)):
        first_at.setdefault(key, n)
    again_at = {
        n
        for n, key in enumerate(zip(names, columns, strict=True))
        if first_at[key] < n and not all(not c or says_nothing(c) for c in columns[n])
    }
    if again_at:
        names = [x for n, x in enumerate(names) if n not in again_at]
        rows = [(i, [c for n, c in enumerate(row) if n not in again_at]) for i, row in rows]
    told = [
        f"{first - len(above)} line(s) above the table passed over"
        + (f", with numbers: line(s) {', '.join(numbers)}" if numbers else "")
        if first > len(above) > 0
        else "",
        f"{words} line(s) without a reading passed over" if words else "",
        f"line {min(again)}: the names again; passed over" if again else "",
        f"line(s) {', '.join(map(str, sorted(boots)))}: as above the table; passed over" if boots else "",
        f"line(s) {', '.join(map(str, sums))}: {', '.join(dict.fromkeys(sums.values()))}; passed over"
        if sums
        else "",
    ]
    return Table(
        tuple(_distinct(names)), [row for _, row in rows], [i for i, _ in rows], decimal, bool(above),
        (*remarks, *filter(None, told)), broken, (*preamble, *("\t".join(row) for _, row in split[:first])),
        quotes={i: " ".join(row) for i, row in below if i in broken},
        doubts=(
            *_fewer_names(split[:first], above, width),
            *_other_units(above),
            *(f"line {i} holds bytes of 0, as of a reset: what stood there is lost" for i in sorted(garbled)),
        ),
    )  # fmt: skip


def _last_block(rows: list[list[str]]) -> list[list[str]]:
    """Return the rows below the last empty one, with a row of two fields or more; with those above it if of units."""
    blocks = [[*block] for filled, block in itertools.groupby(rows, lambda row: any(row)) if filled]
    blocks = [block for n, block in enumerate(blocks) if n or any(_filled_fields(row) > 1 for row in block)]
    if len(blocks) < 2 or all(_are_units(row) for row in blocks[-1]):
        return rows
    return blocks[-1]


def _filled_fields(row: list[str]) -> int:
    return sum(map(bool, row))


def _check_names(
    split: list[tuple[int, list[str]]], above: list[list[str]], width: int, decimal: str
) -> None:
    """Refuse names that come again with other units."""
    if not above:
        return
    said = [meaning(c) for c in above[-1]]
    for i, row in split:
        if row in above or len(row) != width or any(is_value(c, decimal) for c in row):
            continue
        now = [meaning(c) for c in row]
        alike = all(replace(a, unit=b.unit, volts=b.volts) == b for a, b in zip(said, now, strict=True))
        other = [n for n, (a, b) in enumerate(zip(said, now, strict=True)) if a.unit != b.unit]
        if alike and other and any(m.role for m in said):
            old, new = above[-1][other[0]], row[other[0]]
            raise ContradictionError(
                f"line {i}: the names come again, and {old!r} is {new!r} from there on; save each part "
                "as a log of its own"
            )


def _fewer_names(head: list[tuple[int, list[str]]], above: list[list[str]], width: int) -> tuple[str, ...]:
    """Return a doubt where a line above the numbers names other columns than there are; none where names are known."""
    for i, row in head if not above else ():
        names = [m for m in meanings(row).values() if m.role in ("time", "reading", "strip")]
        if 1 < len(row) != width and 2 * len(names) > width and len(names) > _FEW:
            return (
                f"line {i} has {len(row)} names, and the lines below it {width} fields: its names are passed "
                "over; if one is missing there, write it in",
            )
    return ()


def _names(above: list[list[str]], width: int) -> list[str]:
    """Return the names of columns from the lines above them: those lines with which the most columns say something."""
    if not above:
        return [f"column {n + 1}" for n in range(width)]
    units = next((row for row in reversed(above) if _are_units(row)), None)
    above = [row for row in above if row is not units] or above
    best, most = above[-1], -1
    for tall in range(1, len(above) + 1):
        names = _joined(above[-tall:])
        said = Counter(meanings(names).values())
        useful = sum(m.role != "" for m in said) + sum(m.role == "reading" for m in said)
        if useful > most:
            best, most = names, useful
    best = _labelled(above, best)
    if units is None:
        return best
    given = [u.strip("[]() ") for u in units]
    known = [UNITS.get(u) or UNITS.get(u.lower(), "") for u in given]
    if units[0].casefold() in _UNIT_WORDS:  # so the words of that column are of the lines above, and no name
        best = ["", *best[1:]]
    elif meaning(units[0]).role and not known[0]:  # a name beside units, as in "time [s], V, V"
        best = [units[0], *best[1:]]
    return [f"{n} [{u}]" if u and n and not meaning(n).unit else n for n, u in zip(best, known, strict=True)]


def _other_units(above: list[list[str]]) -> tuple[str, ...]:
    """Return a doubt where a line of units says another unit of a column than its name does."""
    units = next((row for row in reversed(above) if _are_units(row)), None)
    for row in above if units else ():
        for name, cell in zip(row, units or (), strict=True):
            said, own = (
                UNITS.get(bare := cell.strip("[]() ")) or UNITS.get(bare.lower(), ""),
                meaning(name).unit,
            )
            if row is not units and said and own and said != own:
                return (
                    f"{name!r} stands above the unit {bare!r}: taken in {own}, as the name says; is it so?",
                )
    return ()


def _labelled(above: list[list[str]], names: list[str]) -> list[str]:
    """Return names, or instead those of a line of labels above them that tell the ends of strips, which these do not.

    As an oscilloscope's "Label,S1_H,S1_L" above "TIME,CH1,CH2".
    """
    if any(m.channel in ("h", "l") for m in meanings(names).values()):
        return names
    for row in above[:-1]:
        labels = [names[0] if meaning(names[0]).role == "time" else row[0], *row[1:]]
        labels = [label or name for label, name in zip(labels, names, strict=True)]
        said = list(meanings(labels).values())
        ends = Counter((m.strip, m.channel) for m in said if m.channel in ("h", "l"))
        if (
            len(ends) > 1 and {end for _, end in ends} == {"h", "l"} and set(ends.values()) == {1}
            and None not in {strip for strip, _ in ends}
            and sum(m.role == "reading" and not m.channel for m in said) == 0
        ):  # fmt: skip
            return labels
    return names


def _joined(rows: list[list[str]]) -> list[str]:
    """Return names of several lines: one that stands over several columns holds for all of them."""
    filled = []
    for row in rows[:-1]:
        spread, last = [], ""
        for n, cell in enumerate(row):
            last = cell or (last if n else "")
            spread.append(last)
        filled.append(spread if any(row[1:]) else [""] * len(row))
    columns = zip(*filled, rows[-1], strict=True)
    names = []
    for parts in columns:
        told = list(dict.fromkeys(p for p in parts if p))
        joined = " ".join(told)
        own = len(told) < 2 or (meaning(joined).role and meaning(told[-1]).role != "time")
        names.append(joined if own else told[-1])
    return names


def _distinct(names: Sequence[str]) -> list[str]:
    names = [name or f"column {n + 1}" for n, name in enumerate(names)]
    twice = {name for name, many in Counter(names).items() if many > 1}
    # The place must not be taken for a strip's number, where there is one.
    word = {name: "column " if re.search(r"\d", name) else "" for name in twice}
    return [f"{name} ({word[name]}{n + 1})" if name in twice else name for n, name in enumerate(names)]


def _named(row: Sequence[str], numeric: Sequence[bool], decimal: str, usual: Set[str] = frozenset()) -> int:
    """Return in how many columns of numbers a row has a word, but signs of an untouched strip and what is usual."""
    return sum(
        n and bool(cell) and cell not in usual and not (is_value(cell, decimal) or says_nothing(cell))
        for cell, n in zip(row, numeric, strict=False)
    )


def _statistic(row: Sequence[str], numeric: Sequence[bool], decimal: str) -> str:
    """Return the word that says that a row sums up the others, in a column of numbers or in front."""
    at = next((n for n, cell in enumerate(row) if cell), 0)
    words = [cell.strip(" :.=") if n == at or numeric[n] else "" for n, cell in enumerate(row)]
    found = [w for n, w in enumerate(words) if w.casefold() in _STATISTICS and (numeric[n] or n == 0)]
    return (found or [""])[0]


def _is_note(row: Sequence[str], numeric: Sequence[bool], decimal: str) -> bool:
    """Return whether a row holds a few words only, in columns of numbers, as below the table of a sheet."""
    filled = [n for n, cell in enumerate(row) if cell]
    return 3 * len(filled) <= len(row) and not any(
        not numeric[n] or is_value(row[n], decimal) or says_nothing(row[n])
        or (re.search(r"\d", row[n]) and not is_prose(row[n]))
        for n in filled
    )  # fmt: skip


def _counts(row: list[str], other: list[str]) -> bool:
    """Return whether a row only counts strips, all as often, beside fields that are empty there and not below."""
    counted = [n for n, cell in enumerate(row) if cell]
    many = Counter(number_of(row[n]) for n in counted)
    if len(counted) < 2 or counted[0] == 0 or not any(other[: counted[0]]) or len(set(many.values())) > 1:
        return False
    return any(set(many) == {float(n + base) for n in range(len(many))} for base in (0, 1))


def _says_one_number(row: Sequence[str]) -> bool:
    """Return whether a row says the same number of each column, as "Samples, 14, 14, 14"."""
    numbers = [cell for cell in row[1:] if cell]
    counted = meaning(row[0]).role in ("scan", "") and len(numbers) > _FEW
    return counted and len(set(numbers)) == 1 and numbers[0].isdecimal()


def _numbers_columns(row: Sequence[str]) -> bool:
    """Return whether a row only numbers its columns: 0, 1, 2, ... or 1, 2, 3, ..."""
    row = [cell for cell in row if cell]
    return len(row) > _FEW + 1 and any(row == [str(n + base) for n in range(len(row))] for base in (0, 1))


def _are_units(row: list[str]) -> bool:
    """Return whether a header line names units: each of its fields, or of all but the first the same of a reading."""
    if all((cell.strip("[]() ").lower() in {"", "-", "n", "nr", "-/-", "1", *UNITS}) for cell in row) and any(
        row
    ):
        return True
    rest = {UNITS.get(cell.strip("[]() ").lower(), "?") for cell in row[1:] if cell}
    if row[0].casefold() in _UNIT_WORDS and len(rest) <= _FEW and "?" not in rest:
        return True
    return len(rest) == 1 and rest <= set(READING_UNITS) and bool(row[0]) and sum(map(bool, row)) > _FEW


def decimal_mark(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal mark of fields: a comma where no field has a point, and where it is no thousand's.

    Raises
    ------
    ReadingError
        Both occur, or a comma could be either.
    """
    comma, point = (re.compile(rf"[+-]?\d*\{mark}\d+(?:[eE][+-]?\d+)?(?:\s*[A-Za-z%]+)?") for mark in ",.")
    rows = [[ungrouped(f) for f in row] for row in rows]
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
        and any("," not in f and not f.startswith("-") for f in column)  # -1 is no reading
    ]
    if thousands:
        shown = next(f for f in thousands[0] if "," in f)
        raise ReadingError(
            f"{shown!r}: a decimal comma, or thousands? Write such numbers with a decimal point, "
            f"without marks in between"
        )
    return "," if commas else "."

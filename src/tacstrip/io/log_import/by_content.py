"""A log of any form by what it holds: the one assignment of its values to strips that a sensor can have read.

Lines of one form are rows, what changes in them are columns. Which of these are readings is told by no name: every
assignment is tried, and that is taken with which touched strips are neighbours, both ends of a strip are touched at
once, k_h is above k_l, and neighbours read nearly alike. Where several are possible, none is taken.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.groups import in_groups
from tacstrip.io.log_import.names import (
    READING_UNITS,
    TIME_UNITS,
    UNITS,
    Meaning,
    derived_words,
    is_called_k,
    meaning,
    unit_in,
)
from tacstrip.io.log_import.periods import JOINED, ways_to_join
from tacstrip.io.log_import.plausible import ROUGH, roughness
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import BY_CONTENT, CLOCK, Table
from tacstrip.io.log_import.tokens import TIME, VALUE, WORD, Line, in_pairs, kinds_of_rows, parted

_FAR_OFF = 1.5  # times as rough: an assignment that is no rival
_EXPLAINED = 0.8  # of the values that another assignment makes readings
_FEW_SCANS = 4
_BEGUN = 4  # values and marks that a damaged row has in common with the others, or more
_ABOVE = 4  # lines that may hold the names
_LONG = 72  # characters of a line that are quoted
_MOST_COLUMNS = 600
_RESTARTS, _LONG_RUN = 3, 10  # times that a clock may begin anew; rows for each
_BETWEEN_STRIPS = 2  # columns, at most, of something else


@dataclass(frozen=True)
class Column:
    """What stands in one place of all rows: texts, their kind, numbers (NaN for none), and the words before it."""

    texts: tuple[str, ...]
    kind: str
    numbers: FloatArray
    label: str
    words: tuple[str, ...] = ()

    @property
    def said(self) -> Meaning:
        """What the word before it says."""
        return meaning(self.label if len(self.label) > 1 or self.label in "tT" else "")

    @property
    def is_numeric(self) -> bool:
        """Whether it holds numbers, but for what may stand for no contact."""
        return self.kind == VALUE

    @property
    def is_constant(self) -> bool:
        """Whether it never changes."""
        return len({*self.texts}) == 1

    @property
    def counts(self) -> bool:
        """Whether it rises by always as much."""
        steps = np.diff(self.numbers)
        return bool(
            len(steps) > 2
            and np.isfinite(steps).all()
            and steps[0] > 0.0
            and np.allclose(steps, steps[0], rtol=1e-6)
        )

    @property
    def rises(self) -> bool:
        """Whether it never falls, but for a clock that begins anew, and is a number throughout."""
        steps = np.diff(self.numbers)
        if not len(steps) or not np.isfinite(self.numbers).all() or not steps.any():
            return False
        anew = np.flatnonzero(steps < 0.0)
        few = len(anew) <= _RESTARTS and len(steps) > _LONG_RUN * len(anew)
        return few and bool(
            (self.numbers[anew + 1] <= np.quantile(self.numbers, 0.2)).all() and (steps > 0.0).any()
        )


@dataclass(frozen=True)
class Assignment:
    """Which column is what: readings as (column, strip, channel), None where another column says these."""

    readings: tuple[tuple[int, int | None, str], ...]
    strip: int | None = None
    which: int | None = None
    ends: tuple[str, ...] = ()  # what stands in the column of the end for h and l
    by_place: int = 0  # rows of a scan, whose places are the strips


def of_content(text: str, strips: int, channels: int) -> Table | None:
    r"""Return a log as a table with names that tell what its columns are; None where its content does not tell it.

    Parameters
    ----------
    text
        The log.
    strips, channels
        Of its sensor.

    Examples
    --------
    >>> pair = lambda s, n: f"{2 + s * s / 99 + n / 8:.3f}~{1 + s * s / 99:.3f}" if abs(s / 4 - n) < 2 else "x~x"
    >>> log = "\n".join(f"<{s / 10} s> " + " ".join(pair(s, n) for n in range(4)) for s in range(12))
    >>> of_content(log, 4, 2).names
    ('time [s]', 'h_0', 'l_0', 'h_1', 'l_1', 'h_2', 'l_2', 'h_3', 'l_3')
    """
    there = _without_gaps([(n, line.strip(" \r")) for n, line in numbered(text) if line.strip()])
    found: list[tuple[float, FloatArray, Table]] = []
    marks = [len(re.findall(rf"(?<![\w.,:])\d+{mark}\d+(?![\w.,])", text)) for mark in (r"\.", ",")]
    for decimal in (".", ",") if marks[1] > marks[0] else (".",):
        lines = in_pairs([parted(n, line, decimal) for n, line in there])
        for way in ways_to_join(lines):
            told = [_best(rows, way, dict(there), decimal, strips, channels) for rows in kinds_of_rows(way)]
            found += [one for one in told if one is not None]
        if (parts := in_groups(lines, channels + 1)) is not None:
            rows, empty = parts
            one = _best(rows, lines, dict(there), decimal, strips, channels, empty)
            found += [one] if one is not None else []
    most = max((int(np.isfinite(values).sum()) for _, values, _ in found), default=0)
    found = sorted((f for f in found if np.isfinite(f[1]).sum() > _EXPLAINED * most), key=lambda one: one[0])
    if not found:
        return None
    rough, values, table = found[0]
    rivals = [v for other, v, _ in found[1:] if other < _FAR_OFF * rough]
    return None if any(not np.array_equal(values, v, equal_nan=True) for v in rivals) else table


def _without_gaps(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines without those of separators alone that stand beside a title, as a spreadsheet saves empty rows."""
    gaps = [not re.search(r"[^\s;,|]", line) for _, line in lines]
    mark = next((line.strip()[:1] for (_, line), gap in zip(lines, gaps, strict=True) if gap), "") or "\t"
    filled = [[f for f in line.split(mark) if f.strip()] for _, line in lines]
    title = [len(f) == 1 and bool(re.search(r"[^\W\d_]{2}", f[0])) for f in filled]
    beside = [any(title[max(n - 1, 0) : n + 2]) for n in range(len(lines))]
    return [line for line, gap, so in zip(lines, gaps, beside, strict=True) if not (gap and so)]


def _best(
    rows: list[Line],
    lines: list[Line],
    texts: dict[int, str],
    decimal: str,
    strips: int,
    channels: int,
    empty: list[int] | None = None,
) -> tuple[float, FloatArray, Table] | None:
    """Return the only assignment of these rows that a sensor can have read, and how rough it is, and its readings.

    Where rows are parts of lines, `empty` are lines that have none.
    """
    columns, read, lost = _columns(rows, lines, decimal)
    if not columns or len(columns) > _MOST_COLUMNS:
        return None
    names = _names_above(rows[0], texts, columns)
    tried: list[tuple[float, Assignment, FloatArray]] = []
    for one in _assignments(columns, strips, channels, empty is not None):
        values = _values(columns, one, strips, channels)
        if values is None or len(values) < _FEW_SCANS or not _agrees(one, names):
            continue
        rough = roughness(values)
        if (
            rough is not None
            and rough < ROUGH
            and not any(np.array_equal(values, v, equal_nan=True) for *_, v in tried)
        ):
            tried.append((rough, one, values))
    most = max((int(np.isfinite(v).sum()) for *_, v in tried), default=0)
    tried = [t for t in tried if np.isfinite(t[2]).sum() > _EXPLAINED * most]
    tried.sort(key=lambda t: t[0])
    if not tried or (len(tried) > 1 and tried[1][0] < _FAR_OFF * tried[0][0]):
        return None
    rough, one, values = tried[0]
    if (
        any({meaning(w).channel, end} == {"h", "l"} for n, _, end in one.readings for w in columns[n].words)
        or _of_derived(columns, one, names)
        or _others_like_readings(columns, one, names)
        or _are_numbers_of_columns(columns, one)
    ):
        return None
    table = _table(columns, one, rows, texts, read, lost, decimal, values)
    if len(table.broken) > len(rows):  # these rows are the few of which a part happens to look so
        return None
    if empty is not None:
        if one.strip is None or one.which is not None:
            return None
        table = table.with_columns(
            {n: table.column(n) for n in table.names if n != "scan"} | {"scan": [str(r.number) for r in rows]}
        )
        table = replace(table, empty=frozenset(empty))
    return rough, values, table


def _columns(rows: list[Line], lines: list[Line], decimal: str) -> tuple[list[Column], set[int], set[int]]:
    """Return what changes from row to row, or in the last line of another form above it.

    And the lines of these, and those of them that no row follows.
    """
    columns = _of_places([r.form for r in rows], [r.texts for r in rows], decimal)
    taken = {n for r in rows for n in (r.number, *r.others)}
    read: set[int] = set()
    lost: set[int] = set()  # labels without a row
    first, last = rows[0].number, rows[-1].number
    others = kinds_of_rows([line for line in lines if line.number not in taken])
    above: list[Column] = []
    beside: list[Column] = []
    for group in others:
        if len(group) == len(rows) and (group[0].number > last or group[-1].number < first):
            beside += _of_places([r.form for r in group], [r.texts for r in group], decimal)
            read |= {line.number for line in group}
            continue
        if group[0].number > first or len(group) < 2:
            continue
        at, k = [], 0
        for row in rows:
            while k + 1 < len(group) and group[k + 1].number < row.number:
                k += 1
            at.append(group[k])
        if len({line.number for line in at}) > 1:
            read |= {line.number for line in at} | {group[0].number}
            lost |= {line.number for line in group} - read
            above += [
                c
                for c in _of_places([g.form for g in at], [g.texts for g in at], decimal)
                if not c.is_constant
            ]
    columns = beside + columns if beside and others[0][0].number < first else columns + beside
    return above + columns, read, lost


def _of_places(forms: Sequence[str], texts: Sequence[tuple[str, ...]], decimal: str) -> list[Column]:
    made: list[Column] = []
    label = ""
    words: list[str] = []
    for place, symbol in enumerate(forms[0]):
        fields = tuple(t[place] for t in texts)
        if symbol == WORD:
            label = fields[0] if len({*fields}) == 1 else ""
            if label:
                words += label.split()
                continue
        if symbol not in (VALUE, TIME, WORD):
            continue
        fields = _in_decimals(fields) if symbol == VALUE else fields
        numbers = np.array([np.nan if (v := number_of(f, decimal)) is None else v for f in fields])
        made.append(Column(fields, symbol, numbers, label, tuple(words)))
        label, words = "", []
    return made


def _in_decimals(fields: tuple[str, ...]) -> tuple[str, ...]:
    """Return fields with a mark before hexadecimal numbers, if some have letters and all are as long."""
    there = [f for f in fields if re.fullmatch(r"[\dA-Fa-f]{2,8}", f)]
    hexadecimal = len({*map(len, there)}) == 1 and sum(not f.isdigit() for f in there) > 0.1 * len(there)
    return tuple(f"0x{f}" if hexadecimal and re.fullmatch(r"[\dA-Fa-f]{2,8}", f) else f for f in fields)


def _assignments(
    columns: list[Column], strips: int, channels: int, listed: bool = False
) -> Iterator[Assignment]:
    """Yield the ways to give columns to strips and ends; `listed`: only touched strips, each with its number."""
    numeric = [
        n
        for n, c in enumerate(columns)
        if c.is_numeric and not c.counts and c.said.role not in ("time", "scan", "strip")
    ]
    often = {t for n in numeric if not columns[n].is_constant for t in columns[n].texts}
    if any(t and says_nothing(t) for t in often):  # what is empty throughout is then no untouched strip
        numeric = [n for n in numeric if any(columns[n].texts)]
    # A number that never changes is a label, unless it is what others have where nothing touches.
    plain = [
        n
        for n in numeric
        if not columns[n].is_constant or columns[n].texts[0] in often or says_nothing(columns[n].texts[0])
    ]
    plain = [n for n in plain if not columns[n].rises] if len(plain) > strips else plain  # as a time does
    moving = [n for n in plain if not columns[n].is_constant]  # labels may be numbers that readings are, too
    for some in [s for s in (plain, moving) if len(s) >= strips * channels] or [numeric]:
        for size in range(channels, channels + _BETWEEN_STRIPS + 1):
            for at in range(len(some) - strips * size + 1):
                block = some[at : at + strips * size]
                if size > channels and len(some) - len(block) > 2:
                    continue
                yield from (
                    _by_labels(columns, one, strips) for one in _of_block(block, strips, channels, size)
                )
    whiches = [
        n
        for n, c in enumerate(columns)
        if len({*c.texts}) == 2 and (c.kind == WORD or (np.isfinite(c.numbers).all() and not c.rises))
    ]
    yield from _of_lines(columns, numeric, whiches, strips, channels, listed)
    if channels == 2:
        for which in whiches:
            some = [n for n in plain if n != which]
            words = sorted({*columns[which].texts})
            for at, ends in itertools.product(
                range(len(some) - strips + 1), (tuple(words), tuple(words[::-1]))
            ):
                yield Assignment(
                    tuple((n, k, "") for k, n in enumerate(some[at : at + strips])), None, which, ends
                )


def _of_lines(
    columns: list[Column], numeric: list[int], whiches: list[int], strips: int, channels: int, listed: bool
) -> Iterator[Assignment]:
    """Yield the assignments of columns to the ends of one strip in each row, and of its number and its end."""
    cycles = [n for n, c in enumerate(columns) if c.is_numeric and _are_strips(c, strips, listed)]
    places = () if cycles else (None,)
    values = [
        n
        for n in numeric
        if not columns[n].rises and not (columns[n].is_constant and not says_nothing(columns[n].texts[0]))
    ]
    for strip in (*cycles, *places):
        left = [n for n in values if n != strip]
        by_place = 0 if strip is not None else strips
        if channels == 1:
            yield from (Assignment(((n, None, "out"),), strip, by_place=by_place) for n in left)
            continue
        for a, b in itertools.pairwise(left):
            yield Assignment(((a, None, "h"), (b, None, "l")), strip, by_place=by_place)
            yield Assignment(((b, None, "h"), (a, None, "l")), strip, by_place=by_place)
        if strip is None:
            continue
        for which in whiches:
            words = sorted({*columns[which].texts})
            for ends in (tuple(words), tuple(words[::-1])):
                yield from (Assignment(((n, None, ""),), strip, which, ends) for n in left if n != which)


def _of_block(block: list[int], strips: int, channels: int, size: int) -> Iterator[Assignment]:
    """Return the assignments of columns to the ends of all strips, `size` of each strip, alternating or in blocks."""
    names = ("out",) if channels == 1 else ("h", "l")
    for order in itertools.permutations(range(size), channels):
        yield Assignment(
            tuple(
                (block[k * size + place], k, name)
                for k in range(strips)
                for place, name in zip(order, names, strict=True)
            )
        )
        if size > 1:
            yield Assignment(
                tuple(
                    (block[place * strips + k], k, name)
                    for k in range(strips)
                    for place, name in zip(order, names, strict=True)
                )
            )


def _by_labels(columns: list[Column], one: Assignment, strips: int) -> Assignment:
    """Return an assignment with the strips that numbers before the columns give them, if these number all strips."""
    labels: list[int] = []
    last = -1
    for n, *_ in sorted(one.readings):
        between = [
            columns[c].numbers[0]
            for c in range(last + 1, n)
            if columns[c].is_constant and columns[c].is_numeric
        ]
        between = [v for v in between if v % 1.0 == 0.0]
        labels.append(int(between[-1]) if between else labels[-1] if labels else -1)
        last = n
    told = {n: k for (n, *_), k in zip(sorted(one.readings), labels, strict=True)}
    low = min(labels)
    if {*labels} != {*range(low, low + strips)} or len({(told[n], c) for n, _, c in one.readings}) < len(
        labels
    ):
        return one
    return replace(one, readings=tuple((n, told[n] - low, c) for n, _, c in one.readings))


def _are_strips(column: Column, strips: int, listed: bool) -> bool:
    """Return whether a column counts strips: whole numbers from 0 or 1, or as many in a row, that begin anew.

    Where only touched ones are `listed` they may begin with any.
    """
    if not np.isfinite(column.numbers).all() or (column.numbers % 1.0).any() or column.rises:
        return False
    low, high = int(column.numbers.min()), int(column.numbers.max())
    many = len({*column.numbers.tolist()})
    return (
        low >= 0
        and high - low < strips
        and many > 1
        and (low in (0, 1) or many == strips or (listed and high <= strips))
        and not (low == 1 and high > strips)
    )


def _values(columns: list[Column], one: Assignment, strips: int, channels: int) -> FloatArray | None:
    """Return the readings (scans, strips, channels) of an assignment; None where a strip comes twice in a scan."""
    many = len(columns[0].texts)
    numbers = {n: columns[n].numbers for n, *_ in one.readings}
    if one.strip is None and one.which is None and not one.by_place:
        made = np.full((many, strips, channels), np.nan)
        for n, k, channel in one.readings:
            made[:, k, int(channel == "l")] = numbers[n]
        return made
    if one.by_place and many % strips:
        return None
    counted = one.strip is not None or one.by_place > 0
    steps = np.diff(columns[one.strip].numbers) if one.strip is not None else np.zeros(0)
    down = -1 if 2 * (steps < 0.0).sum() > (steps != 0.0).sum() else 1  # the last strip may stand first
    at = np.arange(many) % strips
    if one.strip is not None:
        at = columns[one.strip].numbers.astype(int)
        at = at - (1 if at.min() == 1 else 0 if at.max() < strips else at.min())
    end = (
        np.zeros(many, dtype=int)
        if one.which is None
        else np.array([one.ends.index(t) for t in columns[one.which].texts])
    )
    scans: list[FloatArray] = []
    seen: set[tuple[int, int]] = set()
    last = -1
    for row in range(many):
        places = [
            (
                k if k is not None else int(at[row]),
                "hl".index(channel) if channel in ("h", "l") else int(end[row]),
            )
            for _, k, channel in one.readings
        ]
        falls = (
            counted and down * (int(at[row]) - last) < 0 <= last and (one.which is None or places[0] in seen)
        )
        if not scans or falls or seen & {*places}:
            scans.append(np.full((strips, channels), np.nan))
            seen = set()
        last = int(at[row])
        for (k, c), (n, *_) in zip(places, one.readings, strict=True):
            scans[-1][k, c] = numbers[n][row]
            seen.add((k, c))
    return np.stack(scans)


def _names_above(first: Line, texts: dict[int, str], columns: list[Column]) -> list[str]:
    """Return the fields of the last line above that has as many as there are columns; [] where none has."""
    for n in sorted((n for n in texts if n < first.number), reverse=True)[:_ABOVE]:
        for mark in ("\t", ";", ",", "|", None):
            fields = [f.strip(" \"'") for f in texts[n].lstrip("#% ").strip(" |").split(mark)]
            if len(fields) == len(columns) and any(re.search(r"[^\W\d_]", f) for f in fields):
                return fields
    return []


def _agrees(one: Assignment, names: list[str]) -> bool:
    """Return whether names contradict no strip and no end that an assignment gives their columns."""
    if not names:
        return True
    found = [meaning(name) for name in names]
    told = {n: m.strip for n, m in enumerate(found) if m.strip is not None}
    if len(told) >= len({n for n, *_ in one.readings}) and any(n not in told for n, *_ in one.readings):
        return False
    numbers = {told[n] - k for n, k, _ in one.readings if k is not None and n in told}
    ends = {
        (channel, found[n].channel) for n, _, channel in one.readings if found[n].channel in ("h", "l", "out")
    }
    return len(numbers) < 2 and all(channel in ("", end) for channel, end in ends)


def _of_derived(columns: list[Column], one: Assignment, names: list[str]) -> bool:
    """Return whether most columns of one end are called by a word of what is made of readings, and not of the other."""
    words: dict[str, Counter[str]] = {}
    many = Counter(end for *_, end in one.readings)
    for n, _, end in one.readings:
        said = derived_words(" ".join((*columns[n].words, *names[n : n + 1])))
        words.setdefault(end, Counter()).update(said)
    made = [{w for w, times in said.items() if 2 * times > many[end]} for end, said in words.items()]
    return len(made) > 1 and made[0] != made[1]


def _others_like_readings(columns: list[Column], one: Assignment, names: list[str]) -> bool:
    """Return whether columns that are passed over hold numbers of a like name or size, as of other strips."""
    used = {n for n, *_ in one.readings}
    there = np.concatenate([c.numbers[np.isfinite(c.numbers)] for c in (columns[n] for n in used)])
    low, high = np.quantile(there, [0.05, 0.95])
    plain = [re.sub(r"\d+|\b[A-Za-z]\b", "0", n) for n in names]  # strips may be called A, B, ...
    alike = {plain[n] for n in used} if plain else {*()}
    for n, column in enumerate(columns):
        if (
            n in used
            or n in (one.strip, one.which)
            or not column.is_numeric
            or column.is_constant
            or column.rises
        ):
            continue
        if plain and plain[n] not in alike and names[n]:
            continue
        numbers = column.numbers[np.isfinite(column.numbers)]
        if len(numbers) and low <= np.median(numbers) <= high and not column.said.role:
            return True
    return False


def _are_numbers_of_columns(columns: list[Column], one: Assignment) -> bool:
    """Return whether the first row only counts the columns, as a line of names may."""
    first = np.array([columns[n].numbers[0] for n in sorted({n for n, *_ in one.readings})])
    return len(first) > 2 and bool((np.diff(first) == 1.0).all())


def _table(
    columns: list[Column],
    one: Assignment,
    rows: list[Line],
    texts: dict[int, str],
    read: set[int],
    lost: set[int],
    decimal: str,
    values: FloatArray,
) -> Table:
    """Return the table of an assignment, with the time, and units that stand by the values or above them."""
    first = rows[0].number
    preamble = tuple(line for n, line in texts.items() if n < first)
    used = {n for n, *_ in one.readings} | {one.strip, one.which}
    words = {w for n, *_ in one.readings for w in columns[n].words}
    unit = _unit_above(preamble, READING_UNITS) or ("fraction" if any(map(is_called_k, words)) else "")
    made: dict[str, Sequence[str]] = {}
    labels = [n for n in range(len(columns)) if n not in used and not columns[n].is_constant]
    clocks = [n for n in labels if columns[n].kind == TIME]
    rising = [n for n in labels if columns[n].is_numeric and columns[n].rises]
    if clocks:
        made[CLOCK] = columns[clocks[0]].texts
    for n in rising:
        said, own = columns[n].said, unit_in(columns[n].label)
        steps = np.unique(np.round(np.diff(columns[n].numbers), 9))
        in_field = next((u for u in TIME_UNITS if re.search(rf"\d\s?{u}\Z", columns[n].texts[0])), "")
        counts = {*steps.tolist()} <= {0.0, 1.0}
        role = (
            said.role
            if said.role == "time" or (said.role == "scan" and not in_field)
            else "scan"
            if counts and not (in_field or own)
            else "time"
        )
        above = _unit_above(preamble[-1:], tuple(TIME_UNITS)) if role == "time" else ""
        name = (
            f"{role} [{own or in_field or above}]" if role == "time" and (own or in_field or above) else role
        )
        made.setdefault(name, columns[n].texts)
    if one.strip is not None:
        made["strip"] = columns[one.strip].texts
    elif one.by_place:
        made["strip"] = [str(row % one.by_place) for row in range(len(rows))]
    if one.which is not None:
        made["end"] = [("h", "l")[one.ends.index(t)] for t in columns[one.which].texts]
    for n, k, channel in one.readings:
        name = (channel or "reading") + ("" if k is None else f"_{k}")
        made[f"{name} [{unit}]" if unit else name] = columns[n].texts
    taken = read | {n for r in rows for n in (r.number, *r.others)}
    broken = tuple(
        n
        for n, line in texts.items()
        if n in lost
        or (
            n not in taken
            and not (n < first and line.startswith("#"))
            and any(_may_be_row(parted(n, line, decimal), *of) for of in _parts_of(rows))
        )
    )
    whole = one.strip is not None and one.which is None and len(rows) == len(values) * values.shape[1]
    if whole and len(broken) < values.shape[1]:  # a line that is lost would leave a gap
        broken = ()
    shown = texts[rows[0].number][:_LONG]
    told = f"line {rows[0].number} ({shown!r}) and those like it are read as {', '.join(made)}; {BY_CONTENT}"
    return Table(
        tuple(made), [list(row) for row in zip(*made.values(), strict=True)], [r.number for r in rows], decimal,
        broken=broken, quotes={n: texts[n] for n in broken}, preamble=preamble,
        doubts=(told,),
    )  # fmt: skip


def _parts_of(rows: Sequence[Line]) -> list[tuple[str, int]]:
    """Return the forms of the lines of a record, and how many values each holds at most."""
    forms = rows[0].form.split(JOINED)
    ends = [sum(map(len, forms[: n + 1])) + n for n in range(len(forms))]
    texts = [[r.texts[end - len(form) : end] for r in rows] for form, end in zip(forms, ends, strict=True)]
    return [
        (form, max(sum(s == VALUE and t != "" for s, t in zip(form, row, strict=True)) for row in of))
        for form, of in zip(forms, texts, strict=True)
    ]


def _may_be_row(line: Line, form: str, usual: int) -> bool:
    """Return whether a line begins as the rows do, or holds as many values: one of them that is damaged."""
    alike = next(
        (n for n, (a, b) in enumerate(zip(line.form, form, strict=False)) if a != b),
        min(len(line.form), len(form)),
    )
    many = sum(symbol == VALUE and text != "" for symbol, text in zip(line.form, line.texts, strict=True))

    begun = alike > min(_BEGUN, len(form) - 1) and VALUE in line.form[:alike]
    words = max(form.count(WORD), many // 2)  # a hexadecimal number may come apart into numbers and letters
    return many > 0 and (begun or (2 * many > usual and line.form.count(WORD) <= words))


def _unit_above(lines: Sequence[str], known: Sequence[str]) -> str:
    """Return the only one of some units that a line above says in brackets, alone in a field, or behind "in"."""
    for line in lines[:-_ABOVE:-1]:
        said = re.findall(
            r"[\[(]([^\W\d]+|%)[\])]|(?:\A|[\t;,|])[\s\"']*([^\W\d]+|%)[\s\"']*(?=[\t;,|]|\Z)|\bin ([^\W\d]+|%)",
            line,
        )
        there = {
            UNITS.get(word, UNITS.get(word.casefold(), "")) for words in said for word in words if word
        } & {*known}
        if len(there) == 1:
            return there.pop()
    return ""

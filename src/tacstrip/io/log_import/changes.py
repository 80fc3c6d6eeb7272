"""Notes among the readings, in whichever language: one that may change how these are read is asked; others are told."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tacstrip.io.log_import import conversion
from tacstrip.io.log_import.fields import STAMP, number_of
from tacstrip.io.log_import.jumps import jump_of_all
from tacstrip.io.log_import.names import IN_VOLTS, UNITS, meanings
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.supply import names_a_supply, stated_vref
from tacstrip.io.log_import.table import PART, Table
from tacstrip.io.log_import.words import all_are, any_of, finder

_MARK = re.compile(r"\s*+(?:[#%!;]|//)++\s*+")  # possessive: a line of a thousand such marks is read once
_LETTERS = re.compile(r"[^\W\d_]{2}")
_WORDS = re.compile(r"[^\W\d_]{2,}")
_CODE = re.compile(r"[{}\"]|\w=\S")  # no words of a person, as in {"unit": "V"}
_FORMAL = re.compile(r"[{}<>\"]")  # of the log's form, such as XML; but for what is drawn before it
_DRAWN = re.compile(r"\A[\s>*~=+.-]+(?=[^\W\d_])")
# A unit's sign that is not behind a number, so that nothing was measured in it.
_UNIT = re.compile(
    r"(?<![\w.,])(?<!\d\s)(?:[mu\u00b5]?V|V_?ref|V_?cc|V_?dd|AREF|ADC|LSB|%|\u2030)(?!\w)", re.IGNORECASE
)
_BARE_UNIT = re.compile(r"(?<![\w.,])(?<!\d\s)(?:[mu\u00b5]V|V_?ref)(?!\w)", re.IGNORECASE)
_VERSION = re.compile(r"(?<![^\W_])(?:v|ver|version|rev|revision|build)[\s.:]{0,2}\d", re.IGNORECASE)
_RESOLUTION = re.compile(r"\d\s?-?_?bits?\b|analogReadResolution", re.IGNORECASE)  # of which others ask
_OF_PORT = re.compile(r"\binput[/ -]output\b", re.IGNORECASE)  # of a port that is gone
_SENSOR = re.compile(
    r"(?:sensor|pad|skin|board|module?|device)[\s:=#]*(?:n[or]\.?\s?)?(?:\d+|[A-Z])[:.]?", re.IGNORECASE
)
# A change of what touches, or of where: "now pressing", "swapped for pen", "moved to the left end".
_GAP = rf"(?:\s+{any_of('filler')})*\s+"
_OF_CONTACT = re.compile(
    rf"{any_of('change')}{_GAP}(?:{any_of('which')}\s+)?{any_of('contact')}"
    rf"|{any_of('contact')}{_GAP}{any_of('change')}(?=\s*(?:[,;.!]|\Z))"
    rf"|{any_of('motion')}(?:{_GAP}|\s+)(?:(?:{any_of('which')}\s+)*(?:{any_of('place')}|strip\s+\d+)"
    rf"|{any_of('which')}(?=\s*(?:[,;.!]|\Z)))",
    re.IGNORECASE,
)
# Of a system's log, with the time: behind it, the message stands.
_PROCESS = re.compile(r"\A.*?\w\[\d+\]:\s*")
_STAMP = rf"\A\s*[\[(\"']?{STAMP}[\])\"']?\s*(?:->|=>|[>|:,;])?\s*"  # what a monitor puts before a line
_FEW_WORDS = 3  # of fewer, no change is told
_OFTEN = 0.1  # of the lines: what stands on more is of the log's form
_BANNER = 4.0  # lines: as many a program may print as it starts
_FEW = 5  # notes that are not understood: of more, they are of the log's form
_LONGEST = 100  # characters of a line that are quoted
_READ = 1000  # characters of a line that are read as words
_JUMP = 1.3  # times: readings that jump less may move so
_OTHERS = 2.0  # times the largest other step
_AS_MUCH = 4.0  # times: so far may readings of two parts be apart in the median, in one unit
_ALIKE = 0.2  # of the step: so much may it differ from reading to reading


def in_parts(table: Table, text: str) -> Table:
    """Return a table with a column of the part of the log that a line is of, where lines between tell of a change.

    Else with its other notes.
    """
    if PART in table.names or not table.lines:
        return table
    whole = [n for n in table.lines if n not in table.broken]
    changes = changes_said(text, whole, _units(table.names))
    if len(changes) == 1 and (converted := _in_one_unit(table, text, *changes[0])) is not None:
        return converted
    return table.in_parts(changes) if changes else replace(table, notes=notes_among(text, table.lines))


def _in_one_unit(table: Table, text: str, line: int, said: str) -> Table | None:
    """Return a table with all readings in one unit of voltage, where a line says another from there on.

    None where the lines above or the names say no other one, or the readings' size does not change with it.
    """
    above = _inner(text, table.lines)[1]
    names = [n for n, m in meanings(table.names).items() if m.role == "reading"]
    before = _units(table.names) or {u for other in above for u in _volts_in(other)}
    after = _volts_in(said)
    sizes: list[list[float]] = [[], []]
    for row, at in zip(table.rows, table.lines, strict=True):
        read = (number_of(row[table.places[n]], table.decimal) for n in names)
        sizes[at > line] += [v for v in read if v]
    if len(before) != 1 or len(after) != 1 or not before <= IN_VOLTS.keys() or not all(sizes):
        return None
    times = IN_VOLTS[min(after)] / IN_VOLTS[min(before)]
    if times == 1.0 or not 1.0 / _AS_MUCH < np.median(sizes[1]) * times / np.median(sizes[0]) < _AS_MUCH:
        return None
    columns = {n: table.column(n) for n in table.names}
    for n in names:
        columns[n] = [
            f if at < line or (v := number_of(f, table.decimal)) is None
            else f"{times * v:.15g}".replace(".", table.decimal)
            for f, at in zip(columns[n], table.lines, strict=True)
        ]  # fmt: skip
    told = f"line {line} says {said[:_LONGEST]!r}: readings below it are taken in {min(after)}, above in {min(before)}"
    return replace(table.with_columns(columns), doubts=(*table.doubts, told))


def _volts_in(line: str) -> set[str]:
    """Return the units of voltage that a line names, behind no number."""
    words = re.findall(r"(?<!\d)(?<!\d )\b[^\W\d_]+", line)
    return {u for w in words if (u := UNITS.get(w.casefold(), "")) in IN_VOLTS}


def _units(names: Sequence[str]) -> frozenset[str]:
    return frozenset(m.unit for m in meanings(names).values() if m.role == "reading" and m.unit)


def changes_said(
    text: str, lines: Sequence[int], units: frozenset[str] = frozenset()
) -> tuple[tuple[int, str], ...]:
    r"""Return the lines among those of a table, with what they say, which tell of a change of what readings mean.

    Also a line of a form of its own that speaks of how readings are written. Not what the lines above the table say as
    well, nor the unit that the names of its columns say.

    Examples
    --------
    >>> changes_said("0,1.5,1\n# changed the sketch: prints mV now\n1,2400,2100", [1, 3])
    ((2, '# changed the sketch: prints mV now'),)
    >>> changes_said("0,1.5,1\nchanged the object: steel now\n1,2.4,2.1", [1, 3])
    ()
    """
    inner, above = _inner(text, lines)
    rows, said, first = {*lines}, {*map(_form, above)}, min(lines, default=0)
    forms = Counter(_form(line.strip()) for n, line in numbered(text) if n >= first)
    found = []
    for n, line in inner:
        alone = n not in rows and forms[_form(line)] == 1  # else it is of the log's form
        another = alone and (speaks_of_writing(line) or _is_other_version(line, said))
        own = units and _units_said(line) == units
        if _plain(line) not in above and (
            tells_of_change(line) or names_a_sensor(line) or ((another or names_a_unit(line)) and not own)
        ):
            found.append((n, line))
    return tuple(found) if len(found) <= max(_BANNER, _OFTEN * len(inner)) else ()


def notes_among(text: str, lines: Sequence[int]) -> tuple[tuple[int, str], ...]:
    r"""Return comments between a table's lines, and lines of words, whose words are on no other, and what they say.

    Examples
    --------
    >>> notes_among("0,1.5,1\n# palec zeslizgnal sie\n1,2.4,2.1", [1, 3])
    ((2, '# palec zeslizgnal sie'),)
    """
    inner, above = _inner(text, lines)
    words = Counter(w for _, line in inner for w in {*_WORDS.findall(line.casefold())})
    rows = {*lines}
    there = [
        (n, line) for n, line in inner
        if is_comment(line) or (n not in rows and _is_of_words(_DRAWN.sub("", line, count=1), words))
    ]  # fmt: skip
    there = [(n, line) for n, line in there if n < max(lines) and not _RESOLUTION.search(line)]
    forms = Counter(_form(line) for _, line in there)
    return tuple((n, line) for n, line in there if forms[_form(line)] == 1 and _plain(line) not in above)


def _form(line: str) -> str:
    return re.sub(r"\d+", "0", line)


def _inner(text: str, lines: Sequence[int]) -> tuple[list[tuple[int, str]], set[str]]:
    """Return the lines from a table's first to its last, and those above as `_plain`."""
    first, last = min(lines, default=0), max(lines, default=0)
    every = numbered(text)
    inner = [(n, line.strip()) for n, line in every if first < n <= last and line.strip()]
    return inner, {_plain(line) for n, line in every if n < first} - {""}


def _plain(line: str) -> str:
    """Return what a line says, however it is marked and its numbers are written."""
    said = _PROCESS.sub("", re.sub(_STAMP, "", line[:_READ], count=1), count=1)
    said = re.sub(r"\d+(?:[.,]\d+)?", lambda m: f"{float(m[0].replace(',', '.')):g}", said)
    return " ".join(said.casefold().lstrip("#%/!; ").split())


def is_comment(line: str) -> bool:
    """Return whether a line begins with the mark of a comment, and a word behind it."""
    mark = _MARK.match(line)
    first = line[mark.end() :].split(maxsplit=1)[:1] if mark else []
    return any(map(_LETTERS.search, first))


def _is_of_words(line: str, words: Counter[str]) -> bool:
    """Return whether a line without a mark of a comment is words, of which the log's other lines hold not one."""
    found = _WORDS.findall(line.casefold())
    return bool(found) and not _FORMAL.search(line) and all(words[w] == 1 for w in found)


def tells_of_change(line: str) -> bool:
    """Return whether a line is words which say that readings mean something else from there on.

    A change of what touches, or of where, is none.

    Examples
    --------
    >>> tells_of_change("# now the left pad"), tells_of_change("# swapped the ends"), tells_of_change("# now in volts")
    (True, True, True)
    >>> tells_of_change("# moved to the left end"), tells_of_change("# finger swapped for pen")
    (False, False)
    >>> tells_of_change("# moved to the left pad"), tells_of_change("# now pressing with gain 2")
    (True, True)
    """
    line = line[:_READ]
    if len(_WORDS.findall(line)) < _FEW_WORDS or (_CODE.search(line) and not _MARK.match(line)):
        return False
    return _changes(line, "measuring") or _changes(_OF_CONTACT.sub(" ", line), "sensor", "measuring")


def _changes(line: str, *concepts: str) -> bool:
    """Return whether a line says that something changes, and beside it a word of such concepts."""
    said = finder("change").search(line)
    return said is not None and any(
        m.start() >= said.end() or m.end() <= said.start() for m in finder(*concepts).finditer(line)
    )


def names_a_sensor(line: str) -> bool:
    """Return whether a comment is a sensor's name and nothing else, which is then of the lines below.

    Examples
    --------
    >>> [names_a_sensor(t) for t in ("# pad 2", "# Sensor: B", "# pad 2 pressed", "# press 2")]
    [True, True, False, False]
    """
    mark = _MARK.match(line)
    return mark is not None and _SENSOR.fullmatch(line[mark.end() :].strip()) is not None


def names_a_unit(line: str) -> bool:
    """Return whether a comment names a unit of readings behind no number; a Vref with its volts is another matter.

    Examples
    --------
    >>> names_a_unit("# odtad jako ulamek Vref"), names_a_unit("# battery 3.3 V"), names_a_unit("# Vref = 5 V")
    (True, False, False)
    """
    named = is_comment(line) and _UNIT.search(line) and not _RESOLUTION.search(line)
    return bool(named) and stated_vref(line) is None


def _units_said(line: str) -> frozenset[str]:
    """Return the units that a comment names; of one that something changes to, none."""
    if finder("change").search(line):
        return frozenset()
    return frozenset(u for w in _UNIT.findall(line) if (u := UNITS.get(w.casefold(), w)))


def speaks_of_writing(line: str) -> bool:
    """Return whether a line speaks of how readings are written, if only by naming the program that writes them.

    Examples
    --------
    >>> [speaks_of_writing(t) for t in ("fw 1.4 - output is ratiometric", "gain: 2", "Input/output error", "fw OK")]
    [True, True, False, True]
    """
    line = _OF_PORT.sub(" ", line[:_READ])
    return stated_vref(line) is None and bool(finder("writing").search(line) or _BARE_UNIT.search(line))


def _is_other_version(line: str, above: set[str]) -> bool:
    """Return whether a line names a version, and one of the forms above does it in the same words."""
    return _VERSION.search(line) is not None and _form(_plain(line)) in above


def is_harmless(line: str, vref: float) -> bool:
    """Return whether a note changes nothing for sure: each word is known, of contacts and tests; or it says Vref again.

    Examples
    --------
    >>> is_harmless("# pressed harder", 5.0), is_harmless("# Vref = 5.00", 5.0), is_harmless("# at the left end", 5.0)
    (True, True, True)
    >>> is_harmless("# from here on half", 5.0), is_harmless("# Vref = 3.3", 5.0), is_harmless("# nuovo cavo", 5.0)
    (False, False, False)
    """
    volts = stated_vref(line)
    if volts is not None:
        return vref > 0.0 and abs(volts - vref) <= 0.02 * vref
    rest = _OF_CONTACT.sub(" ", line[:_READ])
    known = all_are(line[:_READ], "change", "contact", "motion", "place", "which", "filler", "session")
    return known and not finder("change").search(rest)


def ask_which_part(clues: Clues) -> None:
    """Ask which part of a log is meant, where a line in it tells of a change of what readings mean."""
    if PART in clues.table.names and PART not in clues.answers:
        (line, text), fields = clues.table.changes[0], clues.table.column(PART)
        _ask_for_part(clues, line, text, "", *dict.fromkeys(fields))
        clues.stop()


def _ask_for_part(clues: Clues, line: int, text: str, more: str, *parts: str) -> None:
    clues.ask(
        PART,
        f"line {line} says {text[:_LONGEST]!r}{more}: which readings are meant? Those of one part, or of all if they "
        "mean the same throughout (skip)",
        *(parts or (f"above line {line}", f"below line {line}")), "skip",
    )  # fmt: skip


def ask_for_notes(clues: Clues, rough: list[LogScan]) -> None:
    """Ask which part is meant where all readings jump alike as nowhere else, or a note names another supply.

    Of other comments those that are not understood are a doubt, and how many change nothing is told.
    """
    notes = clues.table.notes
    if PART in clues.table.names or {PART, "unit"} & {*clues.answers}:
        return
    vref = clues.sensor.vref_volt if clues.sensor else 0.0
    if (notes and _ask_for_jump(clues, rough, notes)) or _ask_for_silent_jump(clues, rough, vref):
        return
    for line, text in notes:
        volts = stated_vref(text) if vref else None
        if names_a_supply(text, vref) or (volts is not None and not is_harmless(text, vref)):
            _ask_for_part(clues, line, text, ", and Vref may be another one from there on")
            return
    comments = [(line, text) for line, text in notes if is_comment(text)]
    strange = [(line, text) for line, text in comments if not is_harmless(text, vref)]
    if many := len(comments) - len(strange):
        clues.because(f"{many} note(s) among the readings: none changes how they are read")
    if 0 < len(strange) <= _FEW:
        shown = "; ".join(f"line {line} ({text[:_LONGEST]!r})" for line, text in strange)
        clues.doubt(
            f"between the readings, not understood, and taken as notes: {shown}. If one says that unit, "
            "supply or sensor change there, --answer part"
        )


def _ask_for_jump(clues: Clues, rough: list[LogScan], notes: Sequence[tuple[int, str]]) -> bool:
    """Ask for the part where all readings jump alike at a note, and say whether they do."""
    steps = _steps(rough)
    at = [next((k for k, scan in enumerate(rough) if scan.line > n), len(rough)) for n, _ in notes]
    each = len(at) > _FEW or len({*at}) >= len(rough) - 1  # scan has one: then these are steps as others
    noted = set() if each else {*at}
    sizes = {k: abs(step) for k, (step, _) in steps.items()}
    for (line, text), k in zip(notes, at, strict=True):
        step, alike = steps.get(k, (0.0, False))
        others = max((size for n, size in sizes.items() if n != k and n not in noted), default=0.0)
        if alike and abs(step) > max(np.log(_JUMP), _OTHERS * others):
            more = f", and from there on all readings are {np.exp(step):.3g} times those before"
            _ask_for_part(clues, line, text, more)
            return True
    return False


def _ask_for_silent_jump(clues: Clues, rough: list[LogScan], vref: float) -> bool:
    """Ask for the part where all readings jump by one factor, whatever is said there, and say whether they do."""
    if conversion.changes_below(clues.table):  # of which another asks
        return False
    line, times = jump_of_all(rough, vref)
    if line:
        clues.ask(
            PART,
            f"from line {line} on all readings are {times:.3g} times those before, at once, and nothing says why: did "
            "the unit or the supply change? Which are meant? Those of one part (below: from that line on), or of all "
            "if they mean the same throughout (skip)",
            f"above line {line}", f"below line {line}", "skip",
        )  # fmt: skip
    return bool(line)


def _steps(rough: list[LogScan]) -> dict[int, tuple[float, bool]]:
    """Return of each scan but the first by how much its readings are above those before, and whether all alike.

    As the logarithm's median over the strips that are touched in both.
    """
    found = {}
    for k in range(1, len(rough)):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(rough[k].values / rough[k - 1].values).ravel()
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            step = float(np.median(ratio))
            found[k] = (step, len(ratio) > 1 and bool(np.median(np.abs(ratio - step)) < _ALIKE * abs(step)))
    return found

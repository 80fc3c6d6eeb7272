"""Lines of a log that have not the form that nearly all others share: which they are, and the log without them."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import is_prose, says_nothing
from tacstrip.io.log_import.names import meaning, meanings
from tacstrip.io.log_import.table import ContradictionError, NoTableError, Table
from tacstrip.io.log_import.uneven import names_columns

_NUMBER = re.compile(r"(?<![A-Za-z])[+-]?(?:\d+(?:[.:/-]\d+)*|\.\d+)(?:[eE][+-]?\d+)?|\b0x[\dA-Fa-f]+\b")
_COMMA_WITHIN = re.compile(r"(?<=\d),(?=\d)")
_BETWEEN = re.compile(r"[;\t|]|\d\s+[\d.+-]")  # fields, so that commas are within numbers
_WORD = re.compile(
    r"[^\W\d_]+(?:/[^\W\d_]+)*|-{1,3}(?=[\s,;|]|\Z)|\*{2,}|\+{3,}"
)  # or the marks of an over-range
_FIELD = re.compile(r"\s*[,;|\t]\s*|\s+")
_NAMES_ITSELF = re.compile(r"[^\W\d_]{2,}\d*\s*[:=]")  # a line that needs no names above it
_PATH = re.compile(r"[^\W\d]\w*/\w+")
# A level, a time and a tag before each line, as ESP-IDF and Python write.
_TAGGED = re.compile(
    r"\s*(?:[EWIDV] \(\d+\) ([A-Za-z][\w.-]*):"
    r"|(?:[\d:.,T/-]+ ){0,2}(?:- )?\[?(?:TRACE|DEBUG|INFO|WARN|WARNING|ERROR)\]?[ :-]+"
    r"([A-Za-z][\w.-]*):(?: |(?=[a-z]+: )))"
)
# What the ROM of an ESP32 prints before the program starts, and its monitor before that.
_ROM = re.compile(
    r"--- (?:idf_monitor|Quit:|esp-idf-monitor)|ets [A-Z]|rst:0x|ESP-ROM:|Build:|configsip:|clk_drv:|SPIWP:"
    r"|mode:[A-Z]+, clock div|load:0x|entry 0x|ho \d+ tail"
)
_LEVELLED = re.compile(
    r"\s*(?:\[?[\d:.,T/-]+\]?\s+){0,2}(?:[-|]\s)?[\[(]?(TRACE|DEBUG|VERBOSE|INFO|NOTICE|WARN|WARNING|ERROR|FATAL|CRITICAL)"
    r"[\])]?[\s:|-]+(?:[A-Za-z][\w.-]*: )?"
)
_OTHER_TOPICS = 0.5  # times the lines of the commonest path: others are of something else
_OFTEN, _FEW = 3, 0.05  # lines, and part of all lines, that have a form in common: fewer of one are strays
_MOST = 0.25  # of all lines: more strays are no strays
_FEW_WORDS = 2  # of more, not all are of a channel or a unit
_FEW_COLUMNS = 2  # of fewer numbers, a line may be of anything
_SHOWN, _LONG = 5, 40  # strays, and characters of each, that are quoted

Read = Callable[[frozenset[int]], Table]


def form_of(line: str) -> str:
    """Return what a line has in common with others that hold other numbers.

    Examples
    --------
    >>> form_of("S1  2.5 V, nan"), form_of("12:03:01 -> 5,,7")
    ('S0 0 V, 0', '0 -> 0,0,0')
    >>> form_of("1,2,3.5"), form_of("1;2,5")
    ('0,0,0', '0;0')
    """
    line = _COMMA_WITHIN.sub(".", line) if _BETWEEN.search(line) else line
    line = re.sub(r"\d+", "0", _NUMBER.sub("0", " ".join(line.split())))
    line = _WORD.sub(lambda m: "0" if m[0][0] in "*+" or says_nothing(m[0]) else m[0], line)
    return re.sub(r"(?<=[,;|\s])(?=[,;|]|\Z)", "0", line)


def stray_lines(text: str) -> list[frozenset[int]]:
    """Return the sets of lines (from 1) that may be strays, the smallest first.

    Those at the end and above the table, then with those in between. The last line above is kept where it may hold
    the names of columns.
    """
    lines = [
        (n, form_of(line)) for n, line in enumerate(re.split(r"\r\n|\r\r\n|\n|\r", text), 1) if line.strip()
    ]
    many = Counter(form for _, form in lines)
    often = max(_OFTEN, _FEW * max(many.values(), default=0))
    common = [n for n, form in lines if many[form] >= often]
    if not common:
        return []
    rare = [n for n, form in lines if many[form] < often]
    head, tail = [n for n in rare if n < common[0]], [n for n in rare if n > common[-1]]
    inner = [n for n in rare if common[0] < n < common[-1]]
    tried = [tail, head[:-1] + tail]
    wide = len(_FIELD.split(max(many, key=lambda form: many[form])))
    above = form_of(dict(numbered(text))[head[-1]]) if head else ""
    names = len(_FIELD.split(above)) >= wide - 1 and re.search(r"[^\W\d_]", above)
    if not names or any(_NAMES_ITSELF.search(form) for _, form in lines if many[form] >= often):
        tried.append(head + tail)
    tried += [part + inner for part in ([], *tried)]
    usual = max(many, key=lambda form: many[form])
    topics = [
        n for n, form in lines if _PATH.search(form) and often <= many[form] < _OTHER_TOPICS * many[usual]
    ]
    topics = topics if _PATH.search(usual) else []
    tried += [head + inner + tail + topics] if topics else []
    sets = [s for s in dict.fromkeys(map(frozenset, tried)) if s]
    return [s for s in sets if len(s - {*head}) <= _MOST * len(lines)]


def without_messages(text: str) -> tuple[str, str]:
    r"""Return a text without log lines of other tags than the readings', such as "W (12407) wifi: ...", and a remark.

    Examples
    --------
    >>> without_messages("I (1) TACT: 5\nW (2) wifi: up 3\nI (3) TACT: 6\nI (4) TACT: 6")[0].split("\n")[1]
    ''
    """
    text = without(text, frozenset(n for n, line in numbered(text) if _ROM.match(line.lstrip())))
    text, foreign = _without_foreign(text)
    found = {n: m[1] or m[2] for n, line in numbered(text) if (m := _TAGGED.match(line))}
    tags = Counter(found.values()).most_common(1)
    if not tags or tags[0][1] < _OFTEN or 2 * tags[0][1] <= len(found):
        return text, foreign
    out = frozenset(n for n, tag in found.items() if tag != tags[0][0])
    said = f"line(s) {', '.join(map(str, sorted(out)[:_SHOWN]))}: of another tag than {tags[0][0]!r}; passed over"
    return (without(text, out), "; ".join(filter(None, [said, foreign]))) if out else (text, foreign)


def _without_foreign(text: str) -> tuple[str, str]:
    """Return a logger's text without lines of another level, or without any, that share no word with the readings.

    As warnings and what a program prints as it fails. Lines above the readings stay, for they may say what those are.
    """
    lines = [(n, line) for n, line in numbered(text) if line.strip()]
    found = {n: m for n, line in lines if (m := _LEVELLED.match(line))}
    bodies = {n: line[found[n].end() :] if n in found else line for n, line in lines}
    words = {n: {*_WORD.findall(body)} for n, body in bodies.items()}
    forms = Counter((found[n][1], form_of(bodies[n])) for n in found if words[n]).most_common(1)
    if not forms or forms[0][1] < _OFTEN or 2 * forms[0][1] <= len(found):
        return text, ""
    (level, form), _ = forms[0]
    first = next(n for n in found if (found[n][1], form_of(bodies[n])) == (level, form))
    usual = words[first]
    out = frozenset(
        n for n, _ in lines
        if n > first and words[n] and not words[n] & usual and (n not in found or found[n][1] != level)
    )  # fmt: skip
    if not out or 2 * len(out) > len(lines):
        return text, ""
    return without(
        text, out
    ), f"{_quoted(sorted(out), dict(lines))}: messages among the readings, passed over"


def without(text: str, lines: frozenset[int]) -> str:
    """Return a text with some of its lines empty, so that the others keep their numbers."""
    return "\n".join("" if n in lines else line for n, line in numbered(text))


def numbered(text: str) -> list[tuple[int, str]]:
    """Return a text's lines with their numbers, from 1."""
    return list(enumerate(re.split(r"\r\n|\r\r\n|\n|\r", text), 1))


def filled_lines(text: str) -> list[tuple[int, str]]:
    """Return a text's lines that are not blank with their numbers, from 1."""
    return [(n, line.strip()) for n, line in numbered(text) if line.strip()]


def with_retries(text: str, read: Read) -> Table:
    """Return the table of a text, of which `read` leaves lines out; with those that lines set aside would make of it.

    Raises
    ------
    ReadingError
        It is no table, whatever is set aside.
    """

    def retries() -> Iterator[Table]:
        for strays in stray_lines(text):
            try:
                yield _told(read(strays), strays, dict(numbered(text)))
            except ReadingError:
                continue

    try:
        return replace(read(frozenset()), retries=retries)
    except ContradictionError:
        raise
    except ReadingError as error:
        others = retries()
        refused = error
        if strays := max(stray_lines(text), key=len, default=frozenset()):
            shown = _quoted(sorted(strays), dict(numbered(text)))
            refused = type(error)(
                f"{error}\n  not of the others' form, and it is not read without these either: {shown}"
            )
        if (table := next(others, None)) is None:
            if not isinstance(error, NoTableError):
                raise refused from None
            lines = filled_lines(text)
            return Table(
                ("line",), [[line] for _, line in lines], [n for n, _ in lines], named=False, refused=refused
            )
        return replace(table, retries=lambda: others, refused=refused)


def _quoted(lines: list[int], texts: dict[int, str]) -> str:
    shown = ", ".join(f"line {n} ({texts[n].strip()[:_LONG]!r})" for n in lines[:_SHOWN])
    return shown + (f" and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else "")


def _told(table: Table, strays: frozenset[int], texts: dict[int, str]) -> Table:
    """Return a table that says which lines were set aside: broken, if they may hold readings."""
    first, last = min(table.lines, default=0), max(table.lines, default=0)
    words = {w.casefold() for name in table.names for w in re.findall(r"[^\W\d_]+", name)}
    rows = {shape for n in table.lines if n in texts and (shape := _shape(texts[n]))[1]}
    there = sorted(strays)
    broken = [
        n for n in there
        if re.search(r"\d", texts[n]) and not is_prose(texts[n], words)
        and (n > first or _is_row_of_numbers(texts[n], len(table.names)) or _shape(texts[n]) in rows)
    ]  # fmt: skip
    # The log ends within a line, if only before its first number.
    broken += [n for n in there if n == max(texts) and n not in broken and any(
        texts[i].startswith(texts[n]) for i in table.lines if i in texts
    )]  # fmt: skip
    _check_names(table, [n for n in there if n < first], texts)
    _check_names_below(first, [n for n in there if n > first], texts)
    said = _quoted(there, texts)
    table = _without_lacking(table, broken)
    return replace(
        table,
        remarks=(f"{len(there)} line(s) set aside, for they have not the form of the others: {said}", *table.remarks),
        broken=tuple(sorted({*table.broken, *broken})),
        quotes={**table.quotes, **{n: texts[n].strip() for n in broken}},
        preamble=(*(texts[n] for n in there if n <= last), *table.preamble),
    )  # fmt: skip


def _check_names(table: Table, above: list[int], texts: dict[int, str]) -> None:
    """Raise `NoTableError` where a table has no names, and a line set aside above it is of names in another order.

    Also where it has names for few columns, and such a line has a word for each of the others, which may be strips'.
    """
    nameless = sum(bool(re.fullmatch(r"column \d+", name)) for name in table.names)
    for n in above if table.named and nameless > 1 else ():
        fields = [f for f in _fields(texts[n]) if re.search(r"[^\W\d_]{3}", f) and not meaning(f).channel]
        if len(fields) >= nameless and len({*fields}) > _FEW_WORDS:
            raise NoTableError(f"line {n} ({texts[n].strip()[:_LONG]!r}) seems to name the columns")
    for n in () if table.named else above:
        fields = _fields(texts[n])
        roles = [m.role for m in meanings(fields).values()]
        strips = [int(m[1]) for f in fields if (m := re.search(r"(\d+)\D*\Z", f))]
        if len(strips) > 1 and all(a < b for a, b in itertools.pairwise(strips)):
            continue  # as columns without names are taken
        if len({*fields}) == len(fields) >= len(table.names) and 2 * sum(map(bool, roles)) > len(roles) > 1:
            raise NoTableError(
                f"line {n} ({texts[n].strip()[:_LONG]!r}) seems to name the columns: are they so?"
            )


def _check_names_below(first: int, below: list[int], texts: dict[int, str]) -> None:
    """Raise `NoTableError` where a line set aside among the rows has the names above them in another order."""
    heads = [names for n in texts if n < first and names_columns(names := _fields(texts[n]))]
    for n in below:
        names = _fields(texts[n])
        if any(sorted(names) == sorted(head) and names != head for head in heads):
            raise NoTableError(f"line {n} ({texts[n].strip()[:_LONG]!r}) names the columns in another order")


def _fields(line: str) -> list[str]:
    return [f.strip() for f in re.split(r"[\t;,|]|\s{2,}", line.strip()) if f.strip()]


def _shape(line: str) -> tuple[str, int]:
    """Return what separates the fields of a line that begins with a number or a tag, and how often; 0 of another."""
    by = next((mark for mark in "\t;|, " if mark in line.strip()), "")
    return by, line.count(by) if by and re.match(r"\W*\d|[$@!]?\w+[,;\t|]", line) else 0


def _is_row_of_numbers(line: str, columns: int) -> bool:
    """Return whether a line holds nothing but numbers, or as many as a table has columns beside a remark."""
    form = _FIELD.split(form_of(line.replace('"', "").strip()))
    return len(form) > 1 and (
        {*form} == {"0"} or (form[:columns] == ["0"] * columns and columns > _FEW_COLUMNS)
    )


def _without_lacking(table: Table, broken: list[int]) -> Table:
    """Return a table without the records of several lines each that a broken line may be of, if some lack values."""
    gaps = Counter(b - a for a, b in itertools.pairwise(table.lines)).most_common(1)
    if not (broken and table.absent and gaps and gaps[0][0] > 1):
        return table
    ends = [*table.lines[1:], max(table.lines[-1], *broken) + 1]
    out = {
        n for n, (a, b) in enumerate(zip(table.lines, ends, strict=True)) if any(a < i < b for i in broken)
    }
    out |= {n for n, a in enumerate(table.lines) if a - 1 in broken}
    if not out or len(out) == len(table.rows):
        return table
    lines = ", ".join(str(table.lines[n]) for n in sorted(out))
    return replace(
        table.of_rows(n for n in range(len(table.rows)) if n not in out),
        doubts=(
            *table.doubts,
            f"{len(out)} scan(s) left out, from line(s) {lines}: a line left out is of these",
        ),
    )

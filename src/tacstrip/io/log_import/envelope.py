"""What loggers and monitors put around the readings of each line: times, levels, names, prompts, brackets."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import STAMP, number_of
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import STEADY
from tacstrip.io.log_import.strays import numbered, without
from tacstrip.io.log_import.table import CLOCK, Table

_DAY_NAMED = r"(?:(?:[A-Z][a-z]{2},? )?[A-Z][a-z]{2} [ \d]\d )?"  # as "Sun Nov 22 "
_HOST = re.compile(r"[\w.-]+ [\w./-]+(?:\[\d+\])?: ")  # behind the time of a system's journal
# Such as "14:03:07.512 -> ", which the serial monitor of the Arduino IDE puts before each line, "[14:03:07] ", or the
# mark of what SSCOM has received.
_STAMPED = re.compile(
    rf"\s*\[?{_DAY_NAMED}(?P<stamp>{STAMP})(?: \d{{4}}(?=\])|,\d{{3}}(?=\]))?\]?"
    r"(?!\s*[AaPp]\.?[Mm]\b)\s*(?:->|=>|>|\||:|\t|\s|\u6536?\u2190\u25c6)\s*(?=\S)"
)
_LEVELS = (
    r"(?:<(?:dbg|inf|wrn|err)>"
    r"|[\[(]?(?:TRACE|DEBUG|DBG|VERBOSE|INFO|INF|NOTICE|LOG|WARN|WARNING|WRN|ERROR|ERR|FATAL|CRITICAL)[\])]?)"
)
_LEVEL = re.compile(rf"{_LEVELS}[\s:|-]\s*")
_LEVEL_FIRST = re.compile(rf"\A\s*{_LEVELS}\s*[:|-]?\s*(?=[\[(\d])")  # before a time, as ROS writes
_NODE = re.compile(r"\[[A-Za-z][\w./-]*\]:?\s+(?:-\s+)?")
_TAG = re.compile(r"[A-Za-z][\w.-]*:\s+(?=\S)")  # of the part of a program that writes
# Such as "[001200] " or "I (1200) ".
_COUNTED = re.compile(r"\s*(?:[A-Z]\s)?[\[(]\s*(?P<stamp>\d+(?:\.\d+)?)\s*[\])]:?\s*(?=\S)")
_BETWEEN = r"[,;|\s]+"
_PROMPT = re.compile(
    r"\s*(?P<name>[A-Za-z](?:[\w@:~/.-]*[A-Za-z_~/])?)(?:[=*'(!^-]{0,2}[>#]|\$)(?:\s+(?:[A-Za-z\\./(*_].*)?)?"
)  # with a command or nothing behind it
_R_ROW = re.compile(r"\s*\[\d+,\](?=\s)")  # before the rows of a matrix that R prints
_BRACKETED = re.compile(r"\s*[\[({](.*)[\])}]\s*[,;]?\s*")  # a line such as "(20, [1, 2])"
_FRAMED = re.compile(r"\s*/\*\s*\$?(.*?)\s*\*/\s*")  # as the frames of Serial Studio
_PREFIX = re.compile(r"\s*(?:[A-Za-z]+:|-)\s+(?=[-+.\d])")  # such as "RX: " before the fields of each line
_PREFIX_OF_NAMES = re.compile(r"\s*[A-Za-z]+:\s+(?=[^\W\d])")  # such as "HEAD: "
_NAMED = re.compile(r"[^\W\d]\w*\s*[:=]")  # the name of what follows in a line
_CHECKED = re.compile(
    r"\*(?:[\dA-Fa-f]{2}|checksum|crc|cs|xx|hh)\s*\Z", re.IGNORECASE
)  # of a sentence as of NMEA
_CHECK_NAMED = re.compile(r"\*(?:checksum|crc|cs|xx|hh)\b\s*", re.IGNORECASE)  # behind the names
_ESP_IDF = re.compile(
    r"(?m)^[EWIDV] \(\d+\) [\w.-]+: "
)  # of which the manual says that it counts milliseconds
_MOSTLY = 0.6  # of the lines, where these have several fields
_FEW_FIELDS = 4  # of fewer, a word before them may name them

Lines = list[tuple[int, str]]


def without_stamps(lines: Lines) -> tuple[Lines, dict[int, str]]:
    """Return lines without what a monitor or a logger puts before each: the time, by line, and a level."""
    levelled, lines = lines, [(i, _LEVEL_FIRST.sub("", line)) for i, line in lines]
    found = [_STAMPED.match(line) or _COUNTED.match(line) for _, line in lines]
    many, first = sum(m is not None for m in found), next((n for n, m in enumerate(found) if m), 0)
    if many <= STEADY * (len(lines) - first if 2 * first < len(lines) else len(lines)):
        return levelled, {}
    if any(m is None and _as_wide(line, lines[-1][1]) for (_, line), m in zip(lines, found, strict=True)):
        return levelled, {}  # a table, whose names count the time, too
    stamps = {i: m["stamp"].strip() for (i, _), m in zip(lines, found, strict=True) if m}
    counts = [number_of(stamp) for stamp in stamps.values()]
    falls = sum(b < a for a, b in itertools.pairwise(counts) if a is not None and b is not None)
    if falls > (1.0 - STEADY) * len(counts) or (falls and max(c or 0.0 for c in counts) < len(counts)):
        return levelled, {}  # numbers of strips
    rest = [(i, line[m.end() :] if m else line) for (i, line), m in zip(lines, found, strict=True)]
    for prefix in (_HOST, _LEVEL, _NODE, _TAG):
        before = [m.group() if (m := prefix.match(line)) else "" for _, line in rest]
        usual, many = Counter(b.strip() for b in before if b).most_common(1)[0] if any(before) else ("", 0)
        before = [b if prefix is _LEVEL or b.strip() == usual else "" for b in before]
        told = prefix is _TAG and bool(meaning(usual).role)  # as in "strip: 3"
        if max(many, sum(map(bool, before))) > STEADY * len(rest) and not told:
            rest = [(i, line.removeprefix(b)) for (i, line), b in zip(rest, before, strict=True)]
    return [(i, line) for i, line in rest if line.strip()], stamps


def _as_wide(names: str, other: str) -> bool:
    """Return whether a line may name the fields of another: as many, none twice."""
    return any(
        len(names.split(by)) == len({*names.split(by)}) == len(other.split(by)) > 2
        for by in ("\t", "|", None)
    )


def _is_typed(line: str) -> bool:
    """Return whether a line is a prompt, as of a database or a board's shell, perhaps with what was typed behind it.

    Examples
    --------
    >>> [_is_typed(t) for t in ("skin=> select 1;", "ready> go 4", "lab@pi:~$ cat x", "high> 512", "left> 2.5 1.9")]
    [True, True, True, False, False]
    """
    found = _PROMPT.fullmatch(line)
    return bool(found) and not any(
        meaning(w).role for w in re.findall(r"[^\W\d_]+", found["name"] if found else "")
    )


def without_typed(text: str) -> str:
    """Return a text without what was typed at a prompt, which may name columns of its own."""
    return without(text, frozenset(n for n, line in numbered(text) if _is_typed(line)))


def bare(lines: Lines) -> Lines:
    """Return lines without what stands around the fields of nearly all: a word, brackets, a checksum, a number."""
    checked = [bool(_CHECKED.search(line)) for _, line in lines if not line.lstrip().startswith("#")]
    if sum(checked) > STEADY * len(checked):
        parts = [(i, _CHECK_NAMED.split(_CHECKED.sub("", line), maxsplit=1)) for i, line in lines]
        lines = [(i, part if n == 0 else f"# {part}") for i, of in parts for n, part in enumerate(of) if part]
    if sum(_FRAMED.fullmatch(line) is not None for _, line in lines) > STEADY * len(lines):
        lines = [(i, _FRAMED.sub(r"\1", line)) for i, line in lines]
    lines = _without_prefix(lines)
    if sum(bool(_R_ROW.match(line)) for _, line in lines) > _MOSTLY * len(lines):
        lines = [(i, _R_ROW.sub("", line)) for i, line in lines if not line.startswith("> ")]
    if sum(_BRACKETED.fullmatch(line) is not None for _, line in lines) > STEADY * len(lines):
        lines = [(i, _BRACKETED.sub(r"\1", line)) for i, line in lines]
    if sum(line.lstrip().startswith("#") for _, line in lines) > STEADY * len(lines):  # it numbers them
        lines = [(i, line.lstrip("# \t")) for i, line in lines]
    return lines


def _without_prefix(lines: Lines) -> Lines:
    """Return lines without the word that nearly all begin with, where it is no name of what follows."""
    head, many = Counter(m.group() if (m := _PREFIX.match(line)) else "" for _, line in lines).most_common(1)[
        0
    ]
    numbers = sum(bool(re.search(r"\d|nan", line)) for _, line in lines)
    wide = sum(len(re.split(_BETWEEN, line.strip())) > _FEW_FIELDS for _, line in lines) > STEADY * numbers
    # It is a name, and not to be lost, where others follow it in the line, or where it says which channel.
    named = sum(bool(_NAMED.search(line, len(head))) for _, line in lines) > (1.0 - STEADY) * numbers
    named = named or meaning(head.strip(" :")).channel in ("h", "l")
    if not head or many <= STEADY * numbers or named or not (wide or not meaning(head).role):
        return lines
    width = Counter(len(_fields(line, head)) for _, line in lines if line.startswith(head)).most_common(1)[0][
        0
    ]
    rest = [(i, line.removeprefix(head)) for i, line in lines]
    first = next(n for n, (_, line) in enumerate(lines) if line.startswith(head))
    names = _PREFIX_OF_NAMES.match(rest[first - 1][1]) if first else None
    if names and len(_fields(rest[first - 1][1], names.group())) == width:  # a word of their own in its place
        rest[first - 1] = (rest[first - 1][0], rest[first - 1][1].removeprefix(names.group()))
    return rest


def _fields(line: str, head: str) -> list[str]:
    return re.split(_BETWEEN, line.removeprefix(head).strip())


def with_stamps(table: Table, stamps: Mapping[int, str], text: str, path: str | Path) -> Table:
    """Return a table with the times that stand before the lines, by line, as a column of its own.

    Raises
    ------
    ReadingError
        A line has none.
    """
    lacks = [i for i in table.lines if i not in stamps]
    if lacks:
        raise ReadingError(f"{path}: line {lacks[0]} has no time of day before it, and most have")
    name = "time before each line" if number_of(stamps[table.lines[0]]) is not None else CLOCK
    name += " [ms]" if name != CLOCK and len(_ESP_IDF.findall(text)) > STEADY * len(stamps) else ""
    said = f"each line begins with a time, such as {stamps[table.lines[0]]}, as a serial monitor puts there"
    rows = [[stamps[i], *row] for i, row in zip(table.lines, table.rows, strict=True)]
    return replace(table, names=(name, *table.names), rows=rows, remarks=(said, *table.remarks))

"""Lines that count scans in whichever words, as "PRESS 2 (t = 1.5 s)": their times, and those without a reading."""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import clock_seconds, number_of
from tacstrip.io.log_import.names import meaning, meanings
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import CLOCK, Table

_COUNTED = re.compile(
    r"[\W_]*?(?P<word>[^\W\d_]+(?:\s[^\W\d_]+)?|#)[\s#.:=_(\[-]{0,3}(?P<count>\d{1,5})(?![\w.,]*\d)(?P<rest>.*)"
)
_TIME = re.compile(
    r"(?:(?:\bt(?:ime)?\s*[=:]?|\bat|@|\bbei|\bnach|\bafter|\b\u00e0|\ba los)"
    r"\s*(?P<said>\d+(?:[.,]\d+)?)\s?(?P<unit>ms|s|sec|min)\b"
    r"|[-\u2013,(]\s*(?P<last>\d+(?:[.,]\d+)?)\s?(?P<behind>ms|s|sec|min)\W*\Z"
    r"|(?P<clock>(?<![\w:])\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)(?![\w:])))",
    re.IGNORECASE,
)
_FEW = 2  # lines: fewer count nothing
_MOSTLY = 0.5  # of them, below which readings follow
_SHOWN = 3
_LONGEST = 60  # characters of a line that are quoted

_Labels = dict[int, "re.Match[str]"]


def with_announced(table: Table, text: str, read: Callable[[str], Table]) -> Table:
    """Return a table with the times of lines that count scans, and an empty one where no reading follows; or a doubt.

    Parameters
    ----------
    table
        As it was read.
    text
        Of which.
    read
        Reads another text, in which such lines say "scan" in place of the log's own word.
    """
    labels = _labels(table, text)
    lost = _without_rows(table, labels)
    timed = any(m.role == "time" for m in meanings(table.names).values()) or CLOCK in table.names
    timely = not timed and _tell_times(labels)
    if not lost and not timely:
        return table
    lines = dict(numbered(text))
    plain = {
        n: f"scan {m['count']}{_time(m['rest']) if _tell_times(labels) else ''}" for n, m in labels.items()
    }
    try:
        other = read("\n".join(plain.get(n, line) for n, line in lines.items()))
    except ReadingError:
        other = table
    first, every = min(labels), {*table.lines}
    torn = {
        n for n in (every | {*other.broken}) - {*other.lines} if n < first
    }  # the log begins within a scan
    torn = torn if len(torn) * len(labels) < len(every) else set()
    if (
        {*lost} <= {*other.lines}
        and every - torn <= {*other.lines}
        and not {*other.broken} - {*table.broken} - torn
    ):
        word = next(iter(labels.values()))["word"]
        return replace(
            other,
            broken=tuple(n for n in other.broken if n not in torn),
            remarks=(
                *other.remarks,
                f"{word!r} with a number, on line(s) {_shown(sorted(labels))}: a scan each",
            ),
            doubts=(
                *other.doubts,
                *(
                    [f"line(s) {_shown(sorted(torn))}: above the first {word!r} with a number; left out"]
                    if torn
                    else []
                ),
            ),
        )
    if not lost:
        return table
    shown = "; ".join(f"line {n} ({lines[n].strip()[:_LONGEST]!r})" for n in lost[:_SHOWN])
    more = f" and {len(lost) - _SHOWN} more" if len(lost) > _SHOWN else ""
    return replace(
        table,
        doubts=(
            *table.doubts,
            f"no reading follows below {shown}{more}: if it is a scan in which nothing is touched, it is lost",
        ),
    )


def _labels(table: Table, text: str) -> _Labels:
    """Return the lines that count up by one, from 0 or 1, behind a word in common; none where these are not scans."""
    rows = {*table.lines}
    found: dict[str, _Labels] = {}
    for n, line in numbered(text):
        if (
            n not in rows
            and (m := _COUNTED.fullmatch(line))
            and not re.search(r"\d", _TIME.sub("", m["rest"]))
        ):
            found.setdefault(m["word"].casefold(), {})[n] = m
    for word, labels in found.items():
        counts = [int(m["count"]) for m in labels.values()]
        said = meaning(word)
        if (
            len(labels) >= _FEW
            and ((counts[0] in (0, 1) and word != "#") or _tell_times(labels))
            and all(b == a + 1 for a, b in pairwise(counts))
            and said.role in ("", "scan")
            and not said.channel
            and len(_without_rows(table, labels)) <= _MOSTLY * len(labels)
        ):
            return labels
    return {}


def _without_rows(table: Table, labels: _Labels) -> list[int]:
    """Return the labels between which and the next one no row stands."""
    places = sorted(labels)
    ends = [*places[1:], max([*table.lines, *places]) + 1]
    lines = [*sorted(table.lines), math.inf]
    return [a for a, b in zip(places, ends, strict=False) if lines[bisect.bisect_right(lines, a)] >= b]


def _time(rest: str) -> str:
    """Return what a scan's line says of its time, as a name and a value."""
    found = _TIME.search(rest)
    if found is None:
        return ""
    if found["clock"]:
        return f", time = {found['clock']}"
    value, unit = found["said"] or found["last"], found["unit"] or found["behind"]
    return f", t = {value.replace(',', '.')} {unit}"


def _tell_times(labels: _Labels) -> bool:
    """Return whether all say a time, each a later one: durations would not."""
    told = [said.rpartition("= ")[2] for m in labels.values() if (said := _time(m["rest"]))]
    values = [clock_seconds(t) if ":" in t else number_of(t.split()[0]) for t in told]
    known = [v for v in values if v is not None]
    return len(known) == len(labels) > 0 and all(b > a for a, b in pairwise(known))


def _shown(lines: list[int]) -> str:
    return ", ".join(map(str, lines[:_SHOWN])) + (", ..." if len(lines) > _SHOWN else "")

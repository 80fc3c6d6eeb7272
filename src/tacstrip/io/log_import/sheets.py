"""Sheets of one workbook that are of one form, as one table: of the two channels, of strips, or of scans in turn."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import replace

from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import meaning, meanings, pair_of
from tacstrip.io.log_import.table import SHEET, Table

_NUMBERED = re.compile(r"\s*(?P<word>[^\d]*?)[\s_#.:-]*(?P<number>\d+)\W*")
_SCANS = re.compile(
    r"press(?:es|ure|ion|ione|ing)?|push|touch|contact|druck|dr\u00fccken|kontakt|messung|mesure|appui|presi\u00f3n|toque|medida"
    r"|misura|meting|contacto|contatto|reading|measurement"
    r"|run|trial|test|session|take|attempt|repetition|recording|versuch|durchgang|lauf|aufnahme|essai|s\u00e9ance|prueba"
    r"|ensayo|corrida|prova|ensaio|teste", re.IGNORECASE,
)  # fmt: skip


def of_two_channels(tables: Mapping[str, Table]) -> Table | None:
    """Return two sheets of the same columns, named for the two channels, as one table; None where they are none."""
    if len(tables) != 2:
        return None
    (one, first), (other, second) = tables.items()
    said = {meaning(one).channel, meaning(other).channel}
    if first.names != second.names or not (said == {"h", "l"} or pair_of(said)):
        return None
    rows = [[title, *row] for title, table in tables.items() for row in table.rows]
    told = f"sheets {one!r} and {other!r}: the two channels of the same scans"
    return _joined(tables, ("channel", *first.names), rows, told)


def of_scans(tables: Mapping[str, Table]) -> Table | None:
    """Return sheets of the same columns as one table, in their order; None where they are no scans of one log.

    Each is a scan if it has a line per strip, or one line, and neither a time nor a scan's number. With these each
    is a part, or a run, if it has a time only and that begins anew.
    """
    first = next(iter(tables.values()))
    if len(tables) < 2 or any(t.names != first.names or t.decimal != first.decimal for t in tables.values()):
        return None
    roles = {n: m.role for n, m in meanings(first.names).items()}
    counted = [n for n, role in roles.items() if role in ("time", "scan")]
    strips = [n for n, role in roles.items() if role == "strip"]
    told = f"sheets {', '.join(map(repr, tables))}: one after the other"
    if counted:
        values = [[number_of(f, t.decimal) for f in t.column(counted[0])] for t in tables.values()]
        if any(None in v for v in values):
            return None
        steps = [(b[0] or 0.0) - (a[-1] or 0.0) for a, b in itertools.pairwise(values)]
        rises = min(steps) > 0.0
        if not (rises or (max(steps) < 0.0 and [roles[n] for n in counted] == ["time"])):
            return None
        if not rises:
            rows = [[title, *row] for title, t in tables.items() for row in t.rows]
            return _joined(tables, (SHEET, *first.names), rows, f"{told}, a run each")
        return _joined(tables, first.names, [row for t in tables.values() for row in t.rows], told)
    if any(
        len(t.rows) != 1 and not (len(strips) == 1 and _once(t.column(strips[0]))) for t in tables.values()
    ):
        return None
    rows = [[str(n), *row] for n, t in enumerate(tables.values()) for row in t.rows]
    return _joined(tables, ("scan", *first.names), rows, f"{told}, a scan each")


def of_strips(tables: Mapping[str, Table]) -> Table | None:
    """Return sheets of the same columns, each named for a strip, as one table; None where they are none.

    All have the same times, in the same rows.
    """
    first = next(iter(tables.values()))
    numbers = [meaning(title).strip for title in tables]
    said = meanings(first.names)
    counted = [n for n, m in said.items() if m.role in ("time", "scan")]
    if (
        len(tables) < 2 or None in numbers or len({*numbers}) < len(numbers) or not counted
        or any(m.role == "strip" or m.strip is not None for m in said.values())
        or any(t.names != first.names or t.decimal != first.decimal for t in tables.values())
        or any(t.column(n) != first.column(n) for t in tables.values() for n in counted)
    ):  # fmt: skip
        return None
    every = sorted(zip(numbers, tables.values(), strict=True), key=lambda pair: pair[0] or 0)
    rows = [[str(number), *t.rows[n]] for n in range(len(first.rows)) for number, t in every]
    told = f"sheets {', '.join(map(repr, tables))}: a strip each"
    joined = _joined(tables, ("strip", *first.names), rows, told)
    return replace(joined, lines=[line for line in first.lines for _ in every])


def numbered_scans(titles: list[str]) -> bool:
    """Return whether sheets' names count scans or runs, as "Press 1", "Press 2": such a word, and numbers up by one.

    Examples
    --------
    >>> numbered_scans(["Press 1", "Press 2"]), numbered_scans(["Pad 1", "Pad 2"]), numbered_scans(["A", "B"])
    (True, False, False)
    """
    found = [_NUMBERED.fullmatch(t) for t in titles]
    words = {m["word"].strip().casefold() for m in found if m}
    numbers = [int(m["number"]) for m in found if m]
    if (
        len(numbers) < len(titles)
        or len(words) != 1
        or any(b != a + 1 for a, b in itertools.pairwise(numbers))
    ):
        return False
    word = words.pop()
    return bool(_SCANS.fullmatch(word)) or (bool(word) and meaning(word).role == "scan")


def _once(fields: list[str]) -> bool:
    return len({*fields}) == len(fields)


def _joined(tables: Mapping[str, Table], names: tuple[str, ...], rows: list[list[str]], told: str) -> Table:
    every = list(tables.values())
    return replace(
        every[0], names=names, rows=rows, lines=[i for t in every for i in t.lines],
        remarks=(told, *every[0].remarks), broken=tuple(i for t in every for i in t.broken),
        preamble=tuple(line for t in every for line in t.preamble), doubts=tuple(d for t in every for d in t.doubts),
    )  # fmt: skip

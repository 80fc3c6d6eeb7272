"""Lines of which each is of one numbered input, two inputs for each strip, as a column for each input."""

from __future__ import annotations

from dataclasses import replace

from tacstrip.io.log_import.contents import is_numeric
from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.table import CLOCK, Table


def inputs_as_columns(clues: Clues) -> Table:
    """Return the table of a log with a line for each input: one row per scan where these are twice as many as strips.

    Else as it is. Which end an input is of, its readings tell (`ends_of_columns`).
    """
    table = clues.table
    if clues.expected != ("h", "l") or clues.sensor is None or clues.answers.keys() & {*table.names}:
        return table
    many = 2 * clues.sensor.strips
    known = meanings(table.names)
    counting = [
        n
        for n in table.names
        if known[n].role in ("", "strip", "which", "scan", "reading") and _counts(clues.values(n), many)
    ]
    if len(counting) != 1 or len(table.rows) % many:
        return table
    (counter,) = counting
    read = [
        n for n in table.names if n != counter and known[n].role in ("", "reading") and is_numeric(clues, n)
    ]
    read = [n for n in read if len({*table.column(n)}) > 1 and n != CLOCK]
    read = [n for n in read if known[n].role == "reading"] or read
    if len(read) != 1 or known[read[0]].channel in ("h", "l"):
        return table
    numbers = [int(v) for v in clues.values(counter)[:many] if v is not None]
    unit = f" [{known[read[0]].unit}]" if known[read[0]].unit else ""
    others = [n for n in table.names if n not in (counter, read[0])]
    fields = table.column(read[0])
    rows = [
        [*(table.column(n)[at] for n in others), *fields[at : at + many]]
        for at in range(0, len(table.rows), many)
    ]
    clues.because(f"{counter}: {many} inputs, two for each strip")
    names = (*others, *(f"input {n}{unit}" for n in numbers))
    return replace(table, names=names, rows=rows, lines=table.lines[::many])


def _counts(values: list[float | None], many: int) -> bool:
    """Return whether numbers count so many inputs, from any number on, again and again."""
    first = values[0] if values else None
    return first is not None and all(v == first + n % many for n, v in enumerate(values))

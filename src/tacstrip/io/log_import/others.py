"""Lines of a table that are of another device than the strips: they hold its values, and nothing of a strip."""

from __future__ import annotations

from tacstrip.io.log_import.columns import Columns
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.table import CLOCK, PART, ROW

_SHOWN = 5  # lines that are named


def drop_others(clues: Clues, found: Columns) -> None:
    """Leave out lines without a field of readings, where another device's values stand, or no contact is written out.

    A merged table has lines of each device, and what is not its own is empty there. An empty scan is none of these if
    untouched strips are left empty in others, too, and nothing else fills its line only.
    """
    table = clues.table
    own = {*found.readings, *filter(None, (found.strip, found.which))}
    keys = {*filter(None, (found.time, found.scan)), CLOCK, ROW, PART}
    places = [table.places[n] for n in own]
    void = [not any(row[p] for p in places) for row in table.rows]
    if not any(void) or all(void):
        return
    readings = [table.places[n] for n in found.readings]
    filled = [[row[p] for p in readings] for row, empty in zip(table.rows, void, strict=True) if not empty]
    written = all(all(row) for row in filled)  # so no contact is said in each field, or there is none
    said = written and any(
        says_nothing(f) or (number_of(f, table.decimal) or 0.0) < 0.0 for row in filled for f in row
    )
    others = [
        table.places[n] for n in table.names if n not in own | keys
        and not any(row[table.places[n]] for row, empty in zip(table.rows, void, strict=True) if not empty)
        and any(number_of(row[table.places[n]], table.decimal) is not None for row in table.rows)
    ]  # fmt: skip
    alien = [empty and any(row[p] for p in others) for row, empty in zip(table.rows, void, strict=True)]
    out = [
        n
        for n, empty in enumerate(void)
        if alien[n] or (said and empty and table.lines[n] not in table.empty)
    ]
    if not out:
        _doubt_events(clues, void, own | keys)
        return
    lines = ", ".join(str(table.lines[n]) for n in out[:_SHOWN]) + (", ..." if len(out) > _SHOWN else "")
    others_only = all(alien[n] for n in out)
    if others_only and said:
        names = ", ".join(n for n in table.names if table.places[n] in others)
        clues.because(f"line(s) {lines}: only {names}, nothing of a strip; passed over")
    else:
        why = (
            "they hold another device's values"
            if others_only
            else "no contact is written otherwise on the other lines"
        )
        clues.doubt(
            f"{len(out)} line(s) without a field of a strip are no scans, for {why}; left out: line(s) {lines}"
        )
    kept = [n for n in range(len(table.rows)) if n not in {*out}]
    clues.table = table.of_rows(kept)


def _doubt_events(clues: Clues, void: list[bool], known: set[str]) -> None:
    """Doubt an empty scan at the very end whose line has words where no other line has any, as of a logger's events."""
    table = clues.table
    if not void[-1] or any(void[:-1]):
        return
    said = [row for n in table.names if n not in known and (row := table.column(n))[-1] and not any(row[:-1])]
    if said:
        clues.doubt(
            f"line {table.lines[-1]} has nothing of a strip, and {said[0][-1]!r}: taken as a scan in which nothing is "
            "touched; if it is an event, take the line out"
        )

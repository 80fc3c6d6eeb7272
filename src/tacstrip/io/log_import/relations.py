"""Readings whose scans stand in a table of their own, as databases and workbooks have them: put together by the key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tacstrip.io.log_import.names import meaning, meanings
from tacstrip.io.log_import.table import Table

_ENDS = 2  # of a strip


def joined(tables: Mapping[str, Table]) -> Table | None:
    """Return the table of readings with the times of the table that its rows refer to; None where none is so.

    That one has a time and a number of each scan, none twice; the other one has no time, and a column of the same name,
    or named for that table, with no other numbers. A scan without a row is one in which nothing touches.

    Examples
    --------
    >>> scans = Table(("id", "t_ms"), [["7", "0"], ["8", "50"]], [1, 2])
    >>> read = Table(("scan", "strip", "v_h", "v_l"), [["8", "3", "2.5", "1.9"]], [1])
    >>> joined({"scan": scans, "reading": read}).rows
    [['0', '3', '', ''], ['50', '3', '2.5', '1.9']]
    """
    for title, scans in tables.items():
        clocks = [n for n in scans.names if meaning(n).role == "time"]
        for other in tables.values():
            known = meanings(other.names).values()
            if other is scans or len(clocks) != 1 or any(m.role == "time" for m in known):
                continue
            strips = [n for n in other.names if meaning(n).role == "strip"]
            keys = [
                (own, key) for own in scans.names for key in other.names
                if _refers(key, own, title) and len({*scans.column(own)}) == len(scans.rows)
                and {*other.column(key)} <= {*scans.column(own)}
            ]  # fmt: skip
            if len(keys) == 1 and len(strips) == 1:
                return _joined(scans, other, *keys[0], clocks[0], strips[0])
    return None


def _refers(key: str, own: str, title: str) -> bool:
    """Return whether a column is called as the other table's, or as that table and its column "id"."""
    key, own, title = key.casefold(), own.casefold(), title.casefold().removesuffix("s")
    alike = (
        {title, f"{title}_id", f"{title}id", f"{title}s_id"} if own in ("id", "no", "nr") else {own} - {"id"}
    )
    return key in alike or key == own != "id"


def _joined(scans: Table, read: Table, own: str, key: str, clock: str, strip: str) -> Table:
    names = [n for n in read.names if n != key and not (n.casefold() == "id" and n != strip)]
    columns = [read.column(n) for n in names]
    rows, lines, empty = [], [], set()
    of_scan: dict[str, list[int]] = {}
    for n, number in enumerate(read.column(key)):
        of_scan.setdefault(number, []).append(n)
    # Of which strip, and of which of two ends, a row is.
    labels = [
        c if n == strip or len({*c}) == _ENDS else [""] * len(c) for n, c in zip(names, columns, strict=True)
    ]
    last = max(read.lines)
    for line, number, time in zip(scans.lines, scans.column(own), scans.column(clock), strict=True):
        for n in of_scan.get(number, ()):
            rows.append([time, *(column[n] for column in columns)])
            lines.append(read.lines[n])
        if number not in of_scan:
            void = [[time, *row] for row in dict.fromkeys(zip(*labels, strict=True))]
            rows += void
            lines += [last + line] * len(void)
            empty.add(last + line)
    told = f"{key}: the scan's {own}, whose {clock} stands in a table of its own"
    return replace(
        read, names=(clock, *names), rows=rows, lines=lines, remarks=(told, *read.remarks), empty=frozenset(empty),
        preamble=(*scans.preamble, *read.preamble),
    )  # fmt: skip

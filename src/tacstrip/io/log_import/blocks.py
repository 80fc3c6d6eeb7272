"""Blocks of lines below labels or between empty lines: which scan, time or strip they are of."""

from __future__ import annotations

import bisect
import itertools
import re
from collections import Counter
from dataclasses import replace

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import meaning, meanings
from tacstrip.io.log_import.records import Item, is_label, items
from tacstrip.io.log_import.table import ROW, NoTableError, Table

_FEW_BLOCKS = 2
_WORDED = re.compile(
    r"[^\dA-Za-z]*[A-Za-z][^\t;|]*(?<!,)\Z|\s*([=*~<>-])\1+\s*\w[^\t;|]*\1{2,}\s*\Z"
)  # and without fields
_NUMBER_SIGN = re.compile(r"\s(?:n|no|nr|num)?[\u00b0\u00ba.]\s*(?=\d)", re.IGNORECASE)  # as "Messung Nr. 2"
_IN_TIME = re.compile(r"(?<![\w.,])(\d+(?:\.\d+)?)\s?(?:s|sec|ms|us)(?!\w)")
_TIME_SAID = re.compile(r"(?<![\w.,])(\d+),(\d+)(?=\s?(?:s|sec|ms|us|\u00b5s)(?!\w))")  # with a decimal comma
_LONG = 80  # characters: no label has as many


def labels_of(lines: list[tuple[int, str]]) -> dict[int, list[Item]]:
    """Return the lines that only say to which scan or strip those below belong, if there are several alike."""
    worded = [(i, line.strip("#%/! \t")) for i, line in lines if len(line) < _LONG]
    worded = [(i, _TIME_SAID.sub(r"\1.\2", _NUMBER_SIGN.sub(" ", line))) for i, line in worded]
    timed = {i: items(f"t = {time}") for i, time in _timed(worded).items()}
    # With a mark for nothing in several fields it is a row.
    worded = [(i, line) for i, line in worded if _WORDED.match(line) and _void_fields(line) < _FEW_BLOCKS]
    found = {i: parts for i, line in worded if is_label(parts := items(line))} or timed
    kinds = Counter(tuple(item.name for item in parts) for parts in found.values())
    return {i: parts for i, parts in found.items() if kinds[tuple(p.name for p in parts)] >= _FEW_BLOCKS}


def _void_fields(line: str) -> int:
    return sum(bool(f) and says_nothing(f) for f in re.split(r"[\s,;|]+", line.strip()))


def _timed(lines: list[tuple[int, str]]) -> dict[int, str]:
    """Return the times of lines of words of one form with a number and its unit of time, evenly above their blocks."""
    found = {
        i: m
        for i, line in lines
        if len(m := [*_IN_TIME.finditer(line)]) == 1 and not re.search(r"[;\t|]", line)
    }
    texts = dict(lines)
    forms = Counter(re.sub(r"\d+(?:\.\d+)?", "0", texts[i]) for i in found)
    if (
        not forms
        or len(forms) > 1
        or sum(forms.values()) < _FEW_BLOCKS
        or len(re.findall("0", next(iter(forms)))) > 2
    ):
        return {}
    first, *gaps = [b - a for a, b in itertools.pairwise(found)] or [0]
    times = [float(m[0][1]) for m in found.values()]
    # The first block may have names besides.
    even = len({*gaps}) == 1 and 0 <= first - gaps[0] <= 2 < gaps[0]
    even = even and all(a < b for a, b in itertools.pairwise(times))
    return {i: m[0].group() for i, m in found.items()} if even else {}


def in_blocks(table: Table, labels: dict[int, list[Item]], blank: set[int]) -> Table:
    """Return a table with what the lines between its blocks say as columns, and each line's place in its block."""
    if not table.rows:
        return table
    if labels:
        table = _with_empty_blocks(table, labels)
    marks = sorted(labels) if labels else sorted(i for i in blank if table.lines[0] < i < table.lines[-1])
    blocks = [bisect.bisect_right(marks, line) for line in table.lines]
    sizes = Counter(blocks)
    rows, names = table.rows, table.names
    if labels:
        keys = tuple(dict.fromkeys(item.name for found in labels.values() for item in found))
        state, columns = dict.fromkeys(keys, ""), []
        pending = iter(sorted(labels))
        following = next(pending, None)
        for line in table.lines:
            while following is not None and following <= line:
                state |= {item.name: item.values[0].replace(".", table.decimal) for item in labels[following]}
                following = next(pending, None)
            columns.append(list(state.values()))
        if any("" in column for column in columns):
            raise NoTableError(
                f"line {table.lines[0]}: no {' or '.join(keys)} above it, as there is above others"
            )
        rows = [[*column, *row] for column, row in zip(columns, rows, strict=True)]
        names = (*keys, *names)
    if not labels and _scans_of(table, blocks):
        told = f"{len(sizes)} blocks between empty lines: a scan each"
        rows = [[str(block), *row] for block, row in zip(blocks, rows, strict=True)]
        return replace(table, names=("scan", *names), rows=rows, remarks=(*table.remarks, told))
    if len(sizes) >= _FEW_BLOCKS and len(set(sizes.values())) == 1 and sizes[blocks[0]] > 1:
        places = [n % sizes[blocks[0]] for n in range(len(blocks))]
        rows = [[*row, str(place)] for row, place in zip(rows, places, strict=True)]
        names = (*names, ROW)
    if names == table.names:
        return table
    told = f"{len(sizes)} blocks" + (f", each below its {' and '.join(keys)}" if labels else "")
    return replace(table, names=names, rows=rows, remarks=(*table.remarks, told))


def _with_empty_blocks(table: Table, labels: dict[int, list[Item]]) -> Table:
    """Return a table with a row for each scan, or time, below which nothing stands before the next."""
    heading: dict[str, int] = {}  # labels below which no row has come yet, and their lines
    void = []
    for line in sorted([*labels, *table.lines]):
        named = {i.name for i in labels.get(line, []) if meaning(i.name).role in ("scan", "time")}
        if line not in labels or named & {*heading}:
            void += [min(heading.values())] if line in labels else []
            heading = {}
        heading |= dict.fromkeys(named, line)
    strips = [n for n, m in meanings(table.names).items() if m.role == "strip"]
    cut = [min(heading.values())] if heading else []  # the last: what stood below it may be cut
    if void and len(strips) != 1:
        void, cut = [], [*void, *cut]
    if not void:
        return replace(table, broken=(*table.broken, *cut))
    place = table.places[strips[0]]
    nothing = [table.rows[0][n] if n == place else "" for n in range(len(table.names))]
    both = sorted([*zip(table.lines, table.rows, strict=True), *((line, nothing) for line in void)])
    told = f"{len(void)} block(s) without a line: nothing touches in them"
    return replace(
        table, rows=[row for _, row in both], lines=[i for i, _ in both], remarks=(*table.remarks, told),
        broken=(*table.broken, *cut), empty=table.empty | {*void},
    )  # fmt: skip


def _scans_of(table: Table, blocks: list[int]) -> bool:
    """Return whether blocks between empty lines are scans of strips: none comes twice in one, and most come again."""
    said = meanings(table.names)
    strips = [n for n, m in said.items() if m.role == "strip"]
    roles = {m.role for m in said.values()}
    if len(strips) != 1 or roles & {"time", "scan", "which"} or len(set(blocks)) < _FEW_BLOCKS:
        return False
    there: dict[int, list[str]] = {}
    for block, strip in zip(blocks, table.column(strips[0]), strict=True):
        there.setdefault(block, []).append(strip)
    again = [bool({*a} & {*b}) for a, b in itertools.pairwise(there.values())]
    return all(len({*s}) == len(s) for s in there.values()) and 2 * sum(again) > len(again)

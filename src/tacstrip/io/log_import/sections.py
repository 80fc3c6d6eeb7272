"""Tables below each other in one text, such as all of v_h and then all of v_l, as one."""

from __future__ import annotations

import re

from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import meaning, pair_of

Lines = list[tuple[int, str]]
_SEPARATORS = (";", "\t", ",", "|")


def in_one_table(lines: Lines) -> Lines:
    """Return lines of two tables of the same scans as those of one; others as they are.

    Where both have the same names, the title above each says its channel, and becomes a field of its lines. Where they
    have others below the same first one, their columns are put beside each other.

    Examples
    --------
    >>> in_one_table([(1, "high"), (2, "t,1,2"), (3, "0,2,3"), (4, "low"), (5, "t,1,2"), (6, "0,1,2")])
    [(2, 'channel,t,1,2'), (3, 'high,0,2,3'), (6, 'low,0,1,2')]
    >>> in_one_table([(1, "t,h1,h2"), (2, "0,2,3"), (3, "t,l1,l2"), (4, "0,1,2")])
    [(1, 't,h1,h2,l1,l2'), (2, '0,2,3,1,2')]
    """
    mark = max(_SEPARATORS, key=lambda m: sum(line.count(m) for _, line in lines))
    split = [[f.strip() for f in line.split(mark)] for _, line in lines]
    heads = [n for n, row in enumerate(split) if len(row) > 2 and _worded(row[0])]
    if (
        len(heads) != 2
        or split[heads[0]][0] != split[heads[1]][0]
        or len(split[heads[0]]) != len(split[heads[1]])
    ):
        return lines
    first, second = heads
    width = len(split[first])
    parts = [range(first + 1, second), range(second + 1, len(lines))]
    inner = [
        [n for n in part if len(split[n]) == width and number_of(split[n][0].replace(",", ".")) is not None]
        for part in parts
    ]
    if len(inner[0]) != len(inner[1]) or not inner[0]:
        return lines
    titles = [lines[n - 1][1].strip(f"#%{mark} ") if n and n - 1 not in inner[0] else "" for n in heads]
    if any(
        n not in part
        for part, whole in zip(inner, parts, strict=True)
        for n in whole
        if lines[n][1].strip(f"#%{mark} ") != titles[1]
    ):
        return lines
    if split[first] == split[second]:
        said = [meaning(t).channel for t in titles]
        if not ({*said} == {"h", "l"} or pair_of({*said})):
            return lines
        named = [re.sub(rf"[{re.escape(mark)}\s]+", " ", t) for t in titles]
        body = [
            (lines[n][0], f"{t}{mark}{lines[n][1]}")
            for t, part in zip(named, inner, strict=True)
            for n in part
        ]
        return [*lines[: max(first - 1, 0)], (lines[first][0], f"channel{mark}{lines[first][1]}"), *body]
    if [split[n][0] for n in inner[0]] != [split[n][0] for n in inner[1]] or {*split[first][1:]} & {
        *split[second][1:]
    }:
        return lines
    beside = [(first, second), *zip(*inner, strict=True)]
    return [*lines[:first], *((lines[a][0], mark.join(split[a] + split[b][1:])) for a, b in beside)]


def _worded(field: str) -> bool:
    return bool(re.search(r"[^\W\d_]", field)) and number_of(field) is None

"""Tables whose fields stand in columns of a fixed width, some of them blank."""

from __future__ import annotations

import re

from tacstrip.io.log_import.fields import clock_seconds, number_of, says_nothing
from tacstrip.io.log_import.records import STEADY

_SAMPLE = 500  # lines at either end that tell what separates the fields
_FEW_LINES = 4  # of fewer, the length of the last number tells nothing


def without_columns_of_blanks(data: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with tabs between their fields, where these stand in columns of a fixed width and some are blank."""
    sample = [line.expandtabs() for _, line in data[len(data) // 2 :][:_SAMPLE]]
    counts = {len(line.split()) for line in sample}
    if sum(bool(re.search(r"[,;|\t]", line)) for _, line in data) > (1.0 - STEADY) * len(data):
        return data
    if below := _below_their_names(data):
        return below
    if len(counts) < 2 or any(re.search(r"[,;|\t]", line) for _, line in data):
        return data
    width = max(map(len, sample))
    blank = [all(line[n : n + 1] in ("", " ") for line in sample) for n in range(width)]
    ends = [n for n in range(1, width) if blank[n] and not blank[n - 1]]
    pieces = list(zip([0, *ends], [*ends, None], strict=True))
    if len(pieces) < max(counts) or max(counts) < 2:
        return data
    rows = [all(map(_is_bare, line.split())) for _, line in data]
    full = [
        line for (_, line), row in zip(data, rows, strict=True) if row and len(line.split()) >= len(pieces)
    ]
    if any(len(line[n - 1 : n + 1].strip()) == 2 for line in full for n in ends):  # a boundary within a word
        return data
    cut = [
        (
            i,
            [line.expandtabs()[a:b].strip() for a, b in pieces]
            if row or len(line.split()) != len(pieces)
            else line.split(),
        )
        for (i, line), row in zip(data, rows, strict=True)
    ]
    if any(piece and says_nothing(piece) for _, row in cut for piece in row):  # then a blank one is lost
        return data
    if any(re.search(r"\S\s\S", piece) for _, row in cut[len(cut) // 2 :] for piece in row):
        return data
    return [(i, "\t".join(row)) for i, row in cut]


def _below_their_names(data: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with tabs between fields that end, or begin, where their names do; none if blanks alone tell them.

    Names may hold single blanks, and fields may be empty; lines of words around the table stay as they are.
    """
    words = [list(re.finditer(r"\S+", line.expandtabs())) for _, line in data]
    bare = [len(found) > 1 and all(_is_bare(m.group()) for m in found) for found in words]
    first = bare.index(True) if True in bare else 0
    if not first or sum(bare) < _FEW_LINES:
        return []
    body = [n for n, is_row in enumerate(bare) if is_row]
    top = data[first - 1][1].expandtabs()
    many = {len(words[n]) for n in body}
    if many == {len(words[first - 1])}:
        return []
    for names in (list(re.finditer(r"\S+(?: \S+)*", top)), words[first - 1]):
        if len(names) < max(3, *many) or any(number_of(m.group()) is not None for m in names):
            continue
        for side in (re.Match.end, re.Match.start):
            places = [side(m) for m in names]
            if any(not {side(m) for m in words[n]} <= {*places} for n in body):
                continue
            made = list(data)
            alone = [n for n, m in enumerate(words) if n > first and len(m) == 1 and _is_bare(m[0].group())]
            for n in [first - 1, *body, *(n for n in alone if side(words[n][0]) in places)]:
                at = {side(m): m.group() for m in (names if n < first else words[n])}
                made[n] = (data[n][0], "\t".join(at.get(p, "") for p in places))
            return made
    return []


def _is_bare(word: str) -> bool:
    return number_of(word) is not None or says_nothing(word) or clock_seconds(word) is not None

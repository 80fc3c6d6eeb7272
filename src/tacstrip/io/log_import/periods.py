"""Records of several lines: lines whose forms come again in the same order, or stand in equal blocks, are one row."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence

from tacstrip.io.log_import.tokens import TIME, VALUE, WORD, Line, with_marks

JOINED = "\n"  # between the lines of a record
_FEW = 3  # records, or lines of one form
_MOSTLY = 0.6  # of the lines between heads of records that have the commonest forms, and of all lines
_MOST_LINES = 200  # of a record
_OFTEN = 0.5  # times the heads: a line between them of a rarer form is of no record


def ways_to_join(lines: Sequence[Line]) -> Iterator[list[Line]]:
    r"""Return lines as they stand, and with one line in place of the lines of each record.

    Examples
    --------
    >>> from tacstrip.io.log_import.tokens import parted
    >>> log = [f"{'HL'[n % 2]} {n} {n + 1}" for n in range(8)]
    >>> [[r.form for r in way][-1] for way in ways_to_join([parted(n, line) for n, line in enumerate(log)])]
    ['w##', 'w##\nw##']
    """
    yield list(lines)
    lines = with_marks(lines)
    for joined in (_in_cycles(lines), _in_blocks(lines)):
        if joined is not None:
            yield joined


def _join(parts: Sequence[Line]) -> Line:
    """Return one line for several; where a bracket is open, the comma at a line's end separates what follows."""
    form = ""
    texts: tuple[str, ...] = ()
    for part in parts:
        if sum(map(form.count, "([{")) > sum(map(form.count, ")]}")) and texts[-1:] == ("",):
            form, texts = form[:-1], texts[:-1]
        form, texts = f"{form}{JOINED}{part.form}", (*texts, JOINED, *part.texts)
    return Line(parts[0].number, form[1:], texts[1:], tuple(part.number for part in parts[1:]))


def _in_cycles(lines: Sequence[Line]) -> list[Line] | None:
    """Return lines with one in place of those from each head to the next, if they have nearly always the same forms."""
    keys = _keys(lines)
    many = Counter(keys)
    best: tuple[float, list[list[int]]] = (0.0, [])
    heads = dict.fromkeys(k for k in keys if many[k] >= _FEW)
    for head in heads:
        often = {k for k in heads if many[k] >= _OFTEN * many[head]}
        at = [n for n, k in enumerate(keys) if k == head]
        groups = [
            [n for n in range(a, b) if keys[n] in often] for a, b in itertools.pairwise([*at, len(lines)])
        ]
        kinds = Counter(tuple(keys[n] for n in g) for g in groups)
        kind, alike = kinds.most_common(1)[0]
        if not 1 < len(kind) <= _MOST_LINES or alike < max(_FEW, _MOSTLY * len(groups)):
            continue
        covered = alike * len(kind) / sum(k in often for k in keys)
        if covered > best[0] + 1e-9:
            best = covered, [g for g in groups if tuple(keys[n] for n in g) == kind]
    if best[0] < _MOSTLY:
        return None
    first = {g[0]: g for g in best[1]}
    taken = {n for g in best[1] for n in g}
    return [
        _join([lines[i] for i in first[n]]) if n in first else line
        for n, line in enumerate(lines)
        if n in first or n not in taken
    ]


def _keys(lines: Sequence[Line]) -> list[str]:
    """Return what tells lines of a record apart: their form, their words, and a number that comes again in turn."""
    keys = [
        f"{line.form} {' '.join(t for s, t in zip(line.form, line.texts, strict=True) if s == WORD)}"
        for line in lines
    ]
    often = Counter(keys)
    keys = [k if often[k] >= _FEW else line.form for k, line in zip(keys, lines, strict=True)]
    for form, many in Counter(keys).items():
        at = [n for n, k in enumerate(keys) if k == form]
        if many < 2 * _FEW:
            continue
        for place, symbol in enumerate(lines[at[0]].form):
            texts = [lines[n].texts[place] for n in at]
            period = next((p for p in range(1, many // _FEW + 1) if texts[p] == texts[0]), 0)
            if (
                symbol in (VALUE, TIME)
                and period > 1
                and len({*texts[:period]}) == period == len({*texts})
                and texts[0] not in ("", *texts[1:period])
                and all(a == b for a, b in zip(texts, texts[period:], strict=False))
            ):
                for n, text in zip(at, texts, strict=True):
                    keys[n] = f"{keys[n]} {text}"
                break
    return keys


def _in_blocks(lines: Sequence[Line]) -> list[Line] | None:
    """Return lines with one in place of the first, second ... of several blocks that are as long and of one form."""
    usual, many = Counter(line.form for line in lines).most_common(1)[0]
    blocks = [[*run] for is_row, run in itertools.groupby(lines, lambda line: line.form == usual) if is_row]
    long = max(map(len, blocks))
    whole = [b for b in blocks if len(b) == long]
    if len(whole) < 2 or long < _FEW or len(whole) >= long or len(whole) * long < many:
        return None
    taken = {line.number for b in whole[1:] for line in b}
    first = {b.number: _join(together) for together in zip(*whole, strict=True) for b in together[:1]}
    return [first.get(line.number, line) for line in lines if line.number not in taken]

"""What instruments write above their readings of each channel: a row of names, or a table with a line per channel."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import Meaning, is_strip_word, meaning, meanings, pair_of

Rows = list[list[str]]
_SEPARATORS = ("\t", ";", ",")
_FEW = 4  # channels: of fewer, words and numbers may be anything
_FIRST = re.compile(r"\d[\d\s.,:/T+-]*(?:Z|[AP]M)?")
_LONGEST = 60  # characters of a channel's name
# "AI0 = upper end of strip 8", "AI0/AI8: strip 3", '"field1": "strip 4 high"'.
_TOLD = re.compile(
    r"(?<!\w)(?P<label>[^\W\d_]{1,20}[ _]?\d{1,4})(?:\s*[/&]\s*\w{1,20})?[\"']?\s*(?:[:=]|->|\u2192)\s*[\"']?"
    r"(?P<what>[^\"';,\n]{1,80})"
)
_NUMBERED = re.compile(
    r"(?P<word>[^\W\d_]+)[\s#.:]{0,2}(?P<first>\d{1,4})"
    r"(?:\s*(?:-|\u2013|\.{2,3}|(?:down )?to|bis|\u2192)\s*(?P<last>\d{1,4}))?"
)
_ASSIGNED = re.compile(r"\s*(?:[=:]|->|=>|\u2192)\s*")
_UNIT = re.compile(r"[\[(][^\])]*[\])]\s*\Z")
_FLAGGED = re.compile(r"alarm|status|flag|state|zustand", re.IGNORECASE)
_SCALING = ("scale", "gain", "offset", "factor", "faktor", "mx+b")
_NO_SCALING = {"no", "off", "1", "0", "1.0", "0.0", "nein", "non", ""}


def with_channel_names(text: str) -> str:
    r"""Return a text with the names of strips and ends, which stand elsewhere above, right above its readings.

    Examples
    --------
    >>> rows = "Note,S2 top,S2 bottom,S1 top,S1 bottom\nRange,10,10,10,10\nt,CH1,CH2,CH3,CH4\n0,3,2,4,1\n1,3,2,4,1"
    >>> with_channel_names(rows).split("\n")[:4]
    ['', 'Range,10,10,10,10', 't,S2 top,S2 bottom,S1 top,S1 bottom', '0,3,2,4,1']
    """
    lines = text.split("\n")
    mark = max(_SEPARATORS, key=lambda m: sum(line.count(m) for line in lines[-20:]))
    rows = [[f.strip(' "\r') for f in line.split(mark)] for line in lines]
    many = Counter(len(row) for row in rows if _is_data(row))
    width = max(many, key=lambda w: w * many[w], default=0)
    if width <= _FEW:
        return text
    first = next(n for n, row in enumerate(rows) if _is_data(row) and len(row) == width)
    head = next((n for n in range(first - 1, -1, -1) if len(rows[n]) == width and _words(rows[n])), -1)
    if head >= 0 and tell_strips(rows[head][1:]):
        if not any(line.strip() for line in lines[head + 1 : first]):
            return text
        head = -1
    taken = _of_row(rows, first, head, width) or _of_lines(lines, rows, head)
    if not taken:
        return text
    names, out = taken
    lines = ["" if n in out else line for n, line in enumerate(lines)]
    if head >= 0:
        lines[head] = mark.join(names)
    elif lines[first - 1].strip():
        return text
    else:
        lines[first - 1] = mark.join(names)
    return "\n".join(lines)


def _is_data(row: Sequence[str]) -> bool:
    """Return whether a line begins with a number or a time, and holds another number."""
    return bool(_FIRST.fullmatch(row[0])) and any(number_of(f.replace(",", ".")) is not None for f in row[1:])


def _words(row: Sequence[str]) -> bool:
    filled = [f for f in row[1:] if f]
    return len(filled) > 1 and len({*filled}) == len(filled) and all(re.search(r"[^\W\d]", f) for f in filled)


def tell_strips(names: Sequence[str]) -> bool:
    """Return whether names tell a strip and an end each, of two ends, and none twice."""
    filled = [n for n in names if n]
    said: list[Meaning] = list(meanings(filled).values()) if len({*filled}) == len(filled) >= _FEW else []
    keys = {(m.strip, m.channel) for m in said}
    ends = {m.channel for m in said}
    two = ends == {"h", "l"} or pair_of(ends) is not None
    return bool(said) and two and len(keys) == len(filled) and all(s is not None for s, _ in keys)


def _of_row(rows: Rows, first: int, head: int, width: int) -> tuple[list[str], set[int]] | None:
    """Return names of a row above, whose fields stand above those of the readings, and the lines to be left out."""
    for n in range(first):
        row = rows[n]
        if n == head or len(row) != width or not tell_strips(row[1:]) or any(len(f) > _LONGEST for f in row):
            continue
        own = rows[head] if head >= 0 else [""] * width
        named = [own[0] if head >= 0 else "index"]
        units = [unit.group().strip() if (unit := _UNIT.search(name)) else "" for name in own[1:]]
        named += [
            f"{label or name} {unit}".rstrip()
            for label, name, unit in zip(row[1:], own[1:], units, strict=True)
        ]
        again = {
            i for i in range(head if head >= 0 else first)
            if len(rows[i]) == width and (_of_channels(rows[i], own) if head >= 0 else _words(rows[i]))
        }  # fmt: skip
        return named, {n} | again
    return None


def _of_channels(row: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether a row holds the channels that the names above the readings hold, too."""
    return all(f and f in name for f, name in zip(row[1:], names[1:], strict=True))


def _of_lines(lines: list[str], rows: Rows, head: int) -> tuple[list[str], set[int]] | None:
    """Return names of lines with a channel's number, as in the names above the readings, and a strip's name each."""
    if head < 0:
        return None
    numbers = {
        n: found[0].lstrip("0")
        for n, name in enumerate(rows[head])
        if len(found := re.findall(r"\d+", name)) == 1 and not _FLAGGED.search(name)
    }
    if len({*numbers.values()}) < len(numbers) or len(numbers) < _FEW:
        return None
    split = [
        row if len(row) > 2 else _ASSIGNED.split(line.strip("#%/! \t\r"), maxsplit=1)
        for line, row in zip(lines[:head], rows, strict=False)
    ]
    for place, other in itertools.permutations(range(4), 2):
        there = {
            n: (found[0].lstrip("0"), row[other]) for n, row in enumerate(split)
            if len(row) > max(place, other) and len(found := re.findall(r"\d+", row[place])) == 1
            and found[0].lstrip("0") in {*numbers.values()} and meaning(row[other]).strip is not None
        }  # fmt: skip
        labels = dict(there.values())
        if (
            len(labels) < len(there)
            or {*labels} != {*numbers.values()}
            or not tell_strips([*labels.values()])
        ):
            continue
        named = []
        for n, name in enumerate(rows[head]):
            unit = _UNIT.search(name)
            named.append(
                f"{labels[numbers[n]]}{' ' + unit.group() if unit else ''}" if n in numbers else name
            )
        return named, {*there} | _scaled_by_nothing(split, min(there), [split[n] for n in there])
    return None


def _scaled_by_nothing(rows: Rows, first: int, table: Rows) -> set[int]:
    """Return the line of names above a table of channels, if what it says of their scale is that there is none."""
    names = rows[first - 1] if first else []
    at = [n for n, name in enumerate(names) if name.casefold() in _SCALING]
    none = all(row[n].casefold() in _NO_SCALING for row in table for n in at if n < len(row))
    return {first - 1} if at and none else set()


def strips_told_otherwise(lines: Sequence[str]) -> list[str]:
    """Return a doubt where lines such as "channel 1 = strip 6 top" tell strips of other numbers than the channels'.

    Not where they only count from another number on.

    Examples
    --------
    >>> strips_told_otherwise(["K1 = strip 2", "K2 = strip 1", "Lab 3"])[0][:48]
    "the log says 'K1 = strip 2' and 'K2 = strip 1', "
    >>> strips_told_otherwise(["K1: strip 0", "K2: strip 1"])
    []
    """
    found: dict[str, tuple[int, int]] = {}
    for line in lines:
        sides = _ASSIGNED.split(line.strip("#%/! \t\r"), maxsplit=1)
        numbers = re.findall(r"\d+", sides[0])
        strip = meaning(sides[-1]).strip
        if len(sides) == 2 and len(numbers) == 1 and strip is not None and re.search(r"[^\W\d_]", sides[1]):
            found[line.strip()[:_LONGEST]] = (int(numbers[0]), strip)
    shifts = {strip - number for number, strip in found.values()}
    if len(shifts) < 2 or len({*found.values()}) < len(found):
        return []
    first, second = [*found][:2]
    return [
        f"the log says {first!r} and {second!r}, which is not used: strips are as the columns are named; if those "
        "names are of channels, put the strips' into them"
    ]


def order_told_otherwise(text: str, names: Sequence[str]) -> list[str]:
    """Return a doubt where a text gives columns to strips that do not rise with them, and their names tell no strip.

    Examples
    --------
    >>> names = ["t", "AI0 (V)", "AI1 (V)", "AI2 (V)", "AI3 (V)"]
    >>> order_told_otherwise("AI0-AI1 = upper ends of strips 2-1", names)[0][:50]
    "the log says 'AI1 = upper ends of strips 2-1': wit"
    >>> order_told_otherwise("AI0/AI2: strip 1, AI1/AI3: strip 2", names)
    []
    """
    labels = {
        _UNIT.sub("", name).strip().casefold(): n
        for n, name in enumerate(names)
        if len(re.findall(r"\d+", _UNIT.sub("", name))) == 1
    }
    told: dict[int, tuple[int, str]] = {}
    falls = ""
    for found in _TOLD.finditer(text):
        at = labels.get(found["label"].casefold())
        strip = next((m for m in _NUMBERED.finditer(found["what"]) if is_strip_word(m["word"])), None)
        if at is None or strip is None:
            continue
        said = f"{found['label']} = {found['what'].strip()[:_LONGEST]}"
        told[at] = int(strip["first"]), said
        if strip["last"] and int(strip["last"]) < int(strip["first"]):
            falls = falls or said
    strips = [told[at][0] for at in sorted(told)]
    # Of two ends they rise twice.
    rises = all(b >= a or b == strips[0] for a, b in pairwise(strips)) and all(s >= strips[0] for s in strips)
    if not falls and rises:
        return []
    said = falls or next(iter(told.values()))[1]
    return [
        f"the log says {said!r}: without an answer strips are taken in the order of the columns; say which strip and "
        f"end a column is, as in --answer '{names[min(told)]}=8:h', or name the columns so"
    ]

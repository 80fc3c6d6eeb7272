"""Lines that repeat a group for each strip, such as "scan 1 @ 0.25 s: #2 (3.27 V, 3.23 V) #3 (3.48 V, 2.38 V)"."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise

from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import STEADY, Item, items
from tacstrip.io.log_import.statements import order_said

Lines = list[tuple[int, str]]
_VALUE = (
    r"(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?:\s?(?:[mu\u00b5]?V|%|lsb))?(?![\w.])"
    r"|(?:nan|n/?a|null|none|open|idle|ol|x)\b|-{1,3}(?![\d.])|\*{1,3})"
)
_BETWEEN = r"(?:\s*[/,;|]\s*|\s+)"
_LABEL = r"(?<![\w.:])(?:(?P<word>[A-Za-z]{1,8})[\s_]?)?#?(?P<strip>\d{1,3})"
# Values between brackets, or behind a colon or an equals sign.
_GROUP = re.compile(
    rf"{_LABEL}(?:\s*[:=]?\s*[(\[{{<]\s*(?P<inner>{_VALUE}(?:{_BETWEEN}{_VALUE})?)\s*[)\]}}>]"
    rf"|\s*[:=]\s*(?P<bare>{_VALUE}(?:{_BETWEEN}{_VALUE})?)(?=\s*(?:[,;|]|\Z)|\s+[A-Za-z#\d]+\s*[:=(\[]))",
    re.IGNORECASE,
)
# The strip's number within the brackets, too.
_WITHIN = re.compile(
    rf"[(\[{{<]\s*#?(?P<strip>\d{{1,3}}){_BETWEEN.replace('[/,;|]', '[/,;|:]')}"
    rf"(?P<inner>{_VALUE}{_BETWEEN}{_VALUE})\s*[)\]}}>](?P<bare>)(?P<word>)",
    re.IGNORECASE,
)
_SPLIT = re.compile(_VALUE, re.IGNORECASE)
_TIGHT = re.compile(r"[/(\[{<]")  # what parts a group's values where a line holds but one group
_NO_GROUP = r"\s*[,;|]?\s*"


def of_groups(lines: Lines) -> Lines:
    r"""Return lines of groups as rows of a strip each, below names; h and l in the order that a comment states.

    Examples
    --------
    >>> of_groups([(1, "# high, low"), (2, "5 | 0: 2.5 1.9 | 1: 2.6 1.8"), (3, "6 | 0: 2.5 1.9 | 1: 2.6 1.8")])[1:4]
    [(2, 'time\tstrip\th\tl'), (2, '5\t0\t2.5\t1.9'), (2, '5\t1\t2.6\t1.8')]
    >>> of_groups([(1, "boot"), (2, "1: --/--"), (3, "2: 512/300")])
    [(1, 'boot'), (2, 'strip\ta\tb'), (2, '1\t--\t--'), (3, '2\t512\t300')]
    """
    found = {i: parsed for i, line in lines if (parsed := _parsed(line)) is not None}
    numeric = sum(bool(re.search(r"\d", line)) for _, line in lines)
    if len(found) < 2 or len(found) <= STEADY * numeric:
        return lines
    if any(_GROUP.search(line) or _WITHIN.search(line) for i, line in lines if i < min(found)):
        return lines  # a damaged one would be taken for what stands above the readings
    widths = Counter(len(values) for _, groups in found.values() for _, values in groups)
    heads = Counter(tuple(item.name for item in head) for head, _ in found.values())
    several = max(len(groups) for _, groups in found.values()) > 1
    if len(widths) != 1 or len(heads) != 1 or (1 in widths and not several):
        return lines
    if not several and not all(_TIGHT.search(line) for i, line in lines if i in found):
        return lines
    head = _named([line for i, line in lines if i < min(found)], next(iter(heads)))
    counted = several and not {meaning(name).role for name in head} & {"scan", "time"}
    order = order_said([line for i, line in lines if i not in found])
    ends = ["value"] if 1 in widths else list(order or "ab")  # which of the two is not known
    first = next(strip for _, groups in found.values() for strip, _ in groups)
    made: Lines = []
    scan = 0
    for i, line in lines:
        if i == min(found):
            made.append((i, "\t".join([*["scan"] * counted, *head, "strip", *ends])))
        items_of, groups = found.get(i, ([], []))
        if (
            i > min(found) and not groups and head and _is_head(items(line), head)
        ):  # a scan in which nothing is touched
            items_of, groups = items(line), [(first, [""] * len(ends))]
        scan += bool(groups)
        before = [*[str(scan)] * counted, *(item.values[0] for item in items_of)]
        made += [(i, "\t".join([*before, strip, *values])) for strip, values in groups] or [(i, line)]
    return made


def _parsed(line: str) -> tuple[list[Item], list[tuple[str, list[str]]]] | None:
    """Return what stands before the groups of a line, and the strip and the values of each; None where it has none."""
    groups = list(_WITHIN.finditer(line))
    groups = groups if len(groups) > 1 else list(_GROUP.finditer(line))
    if not groups or any(not re.fullmatch(_NO_GROUP, line[a.end() : b.start()]) for a, b in pairwise(groups)):
        return None
    if not re.fullmatch(_NO_GROUP, line[groups[-1].end() :]):
        return None
    words = [m["word"] for m in groups if m["word"]]
    values = [_SPLIT.findall(m["inner"] or m["bare"]) for m in groups]
    if any(meaning(word).role != "strip" for word in words) or (words and min(map(len, values)) < 2):
        return None  # else it names a channel, or what is no strip's; single values behind names are read by these
    strips = [int(m["strip"]) for m in groups]
    if len({*strips}) < len(strips):
        return None
    text = line[: groups[0].start()].rstrip(" |;,:>")
    head = [item for item in items(text) if item.name != ""] or _bare(text)
    if (re.search(r"\d", text) and not head) or not _is_head(head, tuple(item.name for item in head)):
        return None
    return head, [(m["strip"], pair) for m, pair in zip(groups, values, strict=True)]


def _bare(text: str) -> list[Item]:
    """Return numbers that stand alone before the groups: one as a time, several without names."""
    parts = [part.strip() for part in re.split(r"[;,|\t]", text)]
    if not all(re.fullmatch(r"\d[\d.:]*\s?\w{0,2}", part) for part in parts):
        return []
    names = ["time"] if len(parts) == 1 else [f"column {n}" for n in range(1, len(parts) + 1)]
    return [Item(name, (part,), told=False) for name, part in zip(names, parts, strict=True)]


def _named(above: list[str], head: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of what stands before the groups, from a line of names above, if they have none."""
    split = [[part.strip() for part in re.split(r"[;,|\t]", line.lstrip("#%/! "))] for line in above]
    fits = [r for r in split if len(r) == len(head) + 1 and all(re.match(r"[^\W\d]", name) for name in r)]
    return tuple(fits[-1][: len(head)]) if fits and head[:1] == ("column 1",) else head


def _is_head(found: list[Item], names: tuple[str, ...]) -> bool:
    return tuple(item.name for item in found) == names and all(len(item.values) == 1 for item in found)

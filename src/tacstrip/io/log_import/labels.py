"""Lines above a table that say which strip and channel a numbered column is of, as data loggers write them."""

from __future__ import annotations

import re

from tacstrip.io.log_import.names import meaning

_FEW = 2  # labels: of fewer, a line with a number and a name may be anything
_SIZE = re.compile(r"\d+(?:\.\d+)?\s?[^\W\d]+")  # as a range of "10 V"
_BETWEEN = re.compile(r"[,;\t]")
_FIRST = re.compile(r"\A(\s*\d+)(?:\s*[:=]\s*|\s+)(?=[^\W\d])")  # as in "101 Strip 2 high", "101: ..."
_NUMBERED = re.compile(r"\D{0,8}?0*(\d+)(?:\s*([\[(][^\])]*[\])]))?")  # as "101 (VDC)" or "CH101"


def with_labels(text: str) -> str:
    r"""Return a text with its labels in place of the numbers of columns; another text as it is.

    Examples
    --------
    >>> with_labels("Label,101,Strip 2 V_high\nLabel,102,Strip 1 V_high\nt,101 (V),102 (V)\n0,2.5,2.4\n")
    '\n\nt,Strip 2 V_high (V),Strip 1 V_high (V)\n0,2.5,2.4\n'
    """
    lines = text.split("\n")
    labels: dict[str, str] = {}
    of_labels: set[int] = set()
    for n, line in enumerate(lines):
        fields = [f.strip(' "\r') for f in _BETWEEN.split(_FIRST.sub(r"\1,", line))]
        fields = [f for f in fields if not _SIZE.fullmatch(f)]
        numbers = [f.lstrip("0") for f in fields if f.isdecimal()]
        named = [f for f in fields if not f.isdecimal() and meaning(f).strip is not None]
        words = [f for f in fields if f not in named and not f.isdecimal()]
        if len(numbers) == len(named) == 1 and not re.search(r"\d", "".join(words)):
            if labels.get(numbers[0], named[0]) != named[0]:
                return text
            labels[numbers[0]] = named[0]
            of_labels.add(n)
            continue
        if n - 1 in of_labels and fields[0].isdecimal() and re.match(r"[^\W\d]", "".join(fields[1:2])):
            labels[fields[0].lstrip("0")] = fields[1]  # of what is no strip, in the same list
            of_labels.add(n)
            continue
        found = [m for f in fields if (m := _NUMBERED.fullmatch(f)) and m[1] in labels]
        if len(labels) < _FEW or len(found) < _FEW or len({m[1] for m in found}) < len(found):
            continue
        parts = re.split(r"([,;\t])", line)
        parts = [_labelled(part, labels) for part in parts]
        kept = ["" if i in of_labels else other for i, other in enumerate(lines[:n])]
        return "\n".join([*kept, "".join(parts), *lines[n + 1 :]])
    return text


def _labelled(field: str, labels: dict[str, str]) -> str:
    found = _NUMBERED.fullmatch(field.strip(' "\r'))
    if not found or found[1] not in labels:
        return field
    return labels[found[1]] + (f" {found[2]}" if found[2] else "")

"""Tables that lie on their side: a line for each strip and end, a column for each time."""

from __future__ import annotations

import itertools
import re

from tacstrip.io.log_import.channel_names import tell_strips
from tacstrip.io.log_import.names import TIME_UNITS, UNITS, meaning

_SEPARATORS = ("\t", ";", ",")
_TIME = re.compile(r"(?:[^\W\d_]{1,5}\s*[=:]?\s*)?(\d+(?:[.,]\d+)?)\s*([^\W\d_\u03bc]{1,4})?")
_UNIT = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
_FEW = 3  # times


def upright(text: str) -> str:
    r"""Return a text whose table lies on its side with a line for each time; another text as it is.

    Examples
    --------
    >>> print(upright("via [V];0 ms;50 ms;100 ms\n1 haut;2,1;2,2;2,3\n1 bas;1;1;1\n2 haut;3;3;3\n2 bas;2;2;2"), end="")
    time [ms];1 haut [V];1 bas [V];2 haut [V];2 bas [V]
    0;2,1;1;3;2
    50;2,2;1;3;2
    100;2,3;1;3;2
    """
    lines = text.split("\n")
    mark = max(_SEPARATORS, key=text.count)
    rows = [[f.strip(' "\r') for f in line.split(mark)] for line in lines]
    for n, row in enumerate(rows):
        found = [_TIME.fullmatch(f) for f in row[1:]]
        if len(row) <= _FEW or not all(found) or meaning(row[0]).role in ("time", "scan"):
            continue
        units = {UNITS.get((m[2] or "").casefold(), "") for m in found if m}
        times = [m[1] for m in found if m]
        steps = [float(t.replace(",", ".")) for t in times]
        if not all(a < b for a, b in itertools.pairwise(steps)) or len(rows[-1]) not in (1, len(row)):
            continue
        body = [r for r in rows[n + 1 :] if any(r)]
        if (
            len(units) != 1 or not units <= {*TIME_UNITS}
            or any(len(r) != len(row) for r in body) or not tell_strips([r[0] for r in body])
        ):  # fmt: skip
            continue
        unit = _UNIT.search(row[0])
        names = [r[0] if not unit or _UNIT.search(r[0]) else f"{r[0]} [{unit[1]}]" for r in body]
        made = [[f"time [{units.pop()}]", *names]]
        made += [[time, *(r[k + 1] for r in body)] for k, time in enumerate(times)]
        return "\n".join([*lines[:n], *(mark.join(fields) for fields in made), ""])
    return text

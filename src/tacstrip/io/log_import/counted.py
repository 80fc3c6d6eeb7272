"""Numbers that stand with how many there are, as "strip 1/4" or "Streifen 1 von 4": the number alone."""

from __future__ import annotations

import re
from collections import defaultdict

from tacstrip.io.log_import.names import meaning

_OF = re.compile(
    r"(?<![\w.])(?P<word>[^\W\d_]+)(?P<gap>[ \t]*[#:=]?[ \t]*)(?P<n>\d{1,6})"
    r"(?:[ \t]?/[ \t]?|[ \t]+(?:out of|of|von|de|sur|di|van|z|av|af|od)[ \t]+)(?P<many>\d{1,6})(?![\w.,]*\d)",
    re.IGNORECASE,
)
_FEW = 3  # lines: of fewer, a date or a ratio may look so


def without_totals(text: str) -> tuple[str, str]:
    r"""Return a text without the totals behind numbers of strips and scans, and a remark; another text as it is.

    Only where a word has the same total on each line, and numbers up to that: else these may be pairs of readings.

    Examples
    --------
    >>> without_totals("strip 1/2 h 5\nstrip 2/2 h 6\nstrip 1/2 h 7")[0]
    'strip 1 h 5\nstrip 2 h 6\nstrip 1 h 7'
    >>> without_totals("strip 512/300\nstrip 500/301\nstrip 498/302")[1]
    ''
    """
    found: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for m in _OF.finditer(text):
        found[m["word"].casefold()].append((int(m["n"]), int(m["many"])))
    counted = {
        word for word, pairs in found.items()
        if len(pairs) >= _FEW and len({many for _, many in pairs}) == 1
        and len({n for n, _ in pairs}) > 1 and all(n <= many for n, many in pairs)
        and meaning(word).role in ("strip", "scan")
    }  # fmt: skip
    if not counted:
        return text, ""
    plain = _OF.sub(
        lambda m: f"{m['word']}{m['gap']}{m['n']}" if m["word"].casefold() in counted else m[0], text
    )
    said = ", ".join(f"{word}: of {found[word][0][1]}" for word in sorted(counted))
    return plain, f"behind each number of a {said}, which is left out"

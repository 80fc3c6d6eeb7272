"""Marks of thousands in quoted numbers, as spreadsheets write them between commas: "2,023"."""

from __future__ import annotations

import re
from collections.abc import Sequence

_QUOTED = re.compile(r"\"([+-]?[\d.,]+)\"")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?")
_POINT = re.compile(r"(?<![\w.,:\"/-])[+-]?\d+\.\d+(?![\w.:/-])")
_WHOLE_UNIT = re.compile(
    r"(?<![A-Za-z])(?:mV|[u\u00b5]V|millivolts?|counts?|codes?|adc|lsb|raw)(?![A-Za-z])", re.IGNORECASE
)
_OF_VOLTS = re.compile(r"(?<![A-Za-z])(?:V|volts?)(?![A-Za-z])", re.IGNORECASE)


def without_thousands(text: str) -> str:
    r"""Return a text without the marks of thousands in quoted numbers, where these can be nothing else.

    All quoted numbers are grouped by threes, and decimals elsewhere have a point, a number has two marks, or the names
    say millivolts or codes, which have no three decimals.

    Examples
    --------
    >>> without_thousands('t,Hi (mV),Lo (mV)\\n1,"2,023",968\\n')
    't,Hi (mV),Lo (mV)\\n1,2023,968\\n'
    >>> without_thousands('t,Hi (V),Lo (V)\\n1,"2,023","1,968"\\n')  # which may be 2.023 V
    't,Hi (V),Lo (V)\\n1,"2,023","1,968"\\n'
    """
    quoted = [m[1] for m in _QUOTED.finditer(text)]
    rest = _QUOTED.sub("", text)
    if not any("," in q for q in quoted) or not mark_thousands(quoted, rest):
        return text
    return _QUOTED.sub(lambda m: m[1].replace(",", ""), text)


def mark_thousands(numbers: Sequence[str], rest: str) -> bool:
    """Return whether commas in numbers mark thousands, by these and the rest of a log.

    Examples
    --------
    >>> mark_thousands(["2,206", "968"], "High (mV)"), mark_thousands(["2,206"], "High (V)")
    (True, False)
    """
    if not all(_GROUPED.fullmatch(n) or re.fullmatch(r"[+-]?\d+(?:\.\d+)?", n) for n in numbers):
        return False
    if any(n.count(",") > 1 or ("," in n and "." in n) for n in numbers) or _POINT.search(rest):
        return True
    return bool(_WHOLE_UNIT.search(rest)) and not _OF_VOLTS.search(rest)

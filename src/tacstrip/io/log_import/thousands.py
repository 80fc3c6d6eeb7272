"""Marks of thousands in quoted numbers, as spreadsheets write them between commas: "2,023"."""

from __future__ import annotations

import re

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
    if not any("," in q for q in quoted) or not all(
        _GROUPED.fullmatch(q) or re.fullmatch(r"[+-]?\d+(?:\.\d+)?", q) for q in quoted
    ):
        return text
    rest = _QUOTED.sub("", text)
    certain = any(q.count(",") > 1 or ("," in q and "." in q) for q in quoted) or _POINT.search(rest)
    if not certain and not (_WHOLE_UNIT.search(rest) and not _OF_VOLTS.search(rest)):
        return text
    return _QUOTED.sub(lambda m: m[1].replace(",", ""), text)

"""What the lines around a log's readings say of these: their order, the first strip, signs of no contact."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

_HIGH = r"\b(?:(?:v_)?(?:high|hi|upper|top)|v?_?h)\b"
_LOW = r"\b(?:(?:v_)?(?:low|lo|lower|bottom)|v?_?l)\b"
_AND = r"(?:[\s,;/|&+-]|\b(?:then|all|and|und|the|ends?|values?|dann|alle|of|first|zuerst)\b)+"
_PAIR = re.compile(rf"({_HIGH}{_AND}{_LOW})|({_LOW}{_AND}{_HIGH})", re.IGNORECASE)
_OF_COLUMNS = re.compile(
    r"\b(?:strips?|columns?|channels?|order|each|per|then|streifen|spalten?|volts?|m?V|scan|time|t|ms|s|raw|codes?)\b",
    re.I,
)
_FEW = 3  # words of a line that says nothing else
_TO = r"\s*(?:\.\.+|\u2026|[-\u2013]|\b(?:up )?to\b|\bthrough\b|\bbis\b|\b\u00e0\b|\bhasta\b|\bat\u00e9\b)\s*"
_RANGE = re.compile(
    rf"\b(?:[A-Za-z_]*[A-Za-z]\s?)?(\d+){_TO}(?:[A-Za-z_]*[A-Za-z]\s?)?(\d+)\b", re.IGNORECASE
)
_ORDER_SAID = re.compile(
    r"(?=.*\b(?:strips?|columns?|channels?|streifen|spalten)\b)"
    r".*\b(?:first|last|then|order|reversed?|descending|backwards|zuerst|zuletzt|dann|absteigend)\b",
    re.IGNORECASE,
)
_FROM_AN_END = re.compile(
    r"\b(?:first|last|reversed?|descending|backwards|zuerst|zuletzt|absteigend|not|except|without)\b",
    re.IGNORECASE,
)
# As "strips are numbered 1 to 10", "strip numbers from 0", "1-based", "first strip is 1".
_BASE = re.compile(
    r"\bstrips?\b[^\d\n]{0,30}?\b(?:from|numbered|counted|count|are|ab|von)\b[^\d\n]{0,12}?\b([01])\b"
    r"|\b([01])[ -](?:based|indexed)\b|\bfirst[ _-]?strip\b[^\d\n]{0,20}?\b([01])\b"
    r"|\bstrips(?:[ :=]+\d+)?[ (:]{1,3}([01]) ?(?:to|-|\.\.+|bis) ?\d",
    re.IGNORECASE,
)
_NO_CONTACT = (
    r"(?:un-?touched|not touched|no (?:touch|contact)|without contact|not pressed|released|open|nothing touche[sd]"
    r"|unber\u00fchrt|nicht ber\u00fchrt|(?:kein|ohne) kontakt|offen|sans contact|non touch\u00e9e?s?|sin contacto"
    r"|sem contato|senza contatto|aperto|ouverte?)"
)
_SIGN = (
    r"(?P<{}>[-+]?(?:0x[\dA-Fa-f]+|\d+(?:\.\d+)?)(?![\w.]*\d)|\b[A-Z]{{2,8}}\b|['\"][^'\"]{{1,12}}['\"]"
    r"|-{{1,3}}|\*+)"
)
_MEANS = r"\s*(?:=+>?|:|->|\bmeans?\b|\bis\b|\bare\b|\bstands? for\b|\bfor\b|\bwhere\b|\bwhen\b|\bif\b)\s*(?:strips? )?"
_UNTOUCHED = re.compile(
    rf"(?<![\w.])(?<![a-z] )(?<![a-z] #){_SIGN.format('a')}{_MEANS}(?:(?:is|are|the|a|strip|input) )*"
    rf"{_NO_CONTACT}\b"
    rf"|\b{_NO_CONTACT}(?: (?:strips?|inputs?|channels?|pins?))?\s*(?:=+>?|:|->|\bis\b|\bare\b|\bgives?\b|\breads?\b"
    rf"|\bas\b|\bmarked(?: as| with)?\b)\s*{_SIGN.format('b')}",
    re.IGNORECASE,
)
_TOUCHED = re.compile(r"\d\s*(?:=+|:|->|means|is)\s*(?:touched|contact|pressed)\b", re.IGNORECASE)


def order_said(lines: Sequence[str]) -> str:
    """Return "hl" or "lh" where lines name two values in that order, as "high/low"; "" where none does, or both.

    Examples
    --------
    >>> order_said(["ADC 10 bit, order is high/low"]), order_said(["lower, upper"]), order_said(["higher is better"])
    ('hl', 'lh', '')
    >>> order_said(["filter: low, high cut at 5 Hz"])
    ''
    """
    of_columns = [
        line for line in lines if _OF_COLUMNS.search(line) or len(re.findall(r"[^\W\d]+", line)) <= _FEW
    ]
    said = {"hl" if m[1] else "lh" for line in of_columns for m in _PAIR.finditer(line)}
    return said.pop() if len(said) == 1 else ""


def in_blocks_said(lines: Sequence[str]) -> bool:
    """Return whether a line says that all values of one end stand before all of the other.

    Examples
    --------
    >>> in_blocks_said(["time in s, then all low, then all high"]), in_blocks_said(["h, l of each strip"])
    (True, False)
    """
    return any(
        re.search(r"\b(?:all|alle)\b.{1,20}\b(?:then|dann)\b.{0,9}\b(?:all|alle)\b", line) for line in lines
    )


def untouched_said(lines: Sequence[str]) -> tuple[str, ...]:
    """Return numbers and words of which lines say that they stand for no contact.

    Examples
    --------
    >>> untouched_said(["pull-up on every strip: 4095 = not touched"]), untouched_said(["raw ADC, -1 where open"])
    (('4095',), ('-1',))
    >>> untouched_said(["strip 7: open", "touched: 5"])
    ()
    >>> untouched_said(["flag: 1 = touched, 0 = not touched"]), untouched_said(["untouched strips rest near 0 V"])
    ((), ())
    """
    found = [
        m["a"] or m["b"] for line in lines if not _TOUCHED.search(line) for m in _UNTOUCHED.finditer(line)
    ]
    return tuple(dict.fromkeys(sign.strip("'\"") for sign in found))


def base_said(lines: Sequence[str]) -> int | None:
    """Return the number of the first strip by what lines say; None where they say none, or both.

    Examples
    --------
    >>> base_said(["strips are numbered 1 to 10"]), base_said(["0-based"]), base_said(["10 strips"])
    (1, 0, None)
    """
    told = {int(b) for b in itertools.chain(*_BASE.findall("\n".join(lines))) if b}
    return told.pop() if len(told) == 1 else None


def strips_order_said(lines: Sequence[str], strips: int) -> tuple[str, str]:
    """Return "ascending", "descending", "?" where it must be asked, or "" of columns in strips' order, and the line.

    Examples
    --------
    >>> strips_order_said(["order: strip 0 ... strip 9"], 10)[0]
    'ascending'
    >>> strips_order_said(["strip 9 first, strip 0 last"], 10)[0]
    'descending'
    >>> strips_order_said(["ms, then high and low of strips 0 to 7, raw ADC (0..1023), -1 where open"], 8)[0]
    'ascending'
    >>> strips_order_said(["columns: strip 0 is last, strip 9 first"], 10)[0], strips_order_said(["strips 9..0"], 10)[0]
    ('?', 'descending')
    """
    clauses = [
        clause for line in dict.fromkeys(lines) for clause in re.split(r"[;\t]", _UNTOUCHED.sub(" ", line))
    ]
    # Those of the two ends, without a number, say nothing of the strips.
    lines = [_PAIR.sub(" ", c) for c in clauses if re.search(r"\d", c) or not _PAIR.search(c)]
    ends = [(base, strips - 1 + base) for base in (0, 1)]
    ranges = [
        (line, {(int(a), int(b)) for a, b in _RANGE.findall(line)} & {*ends, *(e[::-1] for e in ends)})
        for line in lines
    ]
    said = [line for line in lines if _ORDER_SAID.search(line) and not told_channels(line, strips)]
    told = [(line, found) for line, found in ranges if found and (line in said or not said)]
    if len(said) < 2 and len(told) == 1 and len(told[0][1]) == 1 and not _FROM_AN_END.search(told[0][0]):
        return "ascending" if told[0][1] <= {*ends} else "descending", told[0][0]
    if len(said) == 1 and _from_last(said[0], strips):
        return "descending", said[0]
    return ("?", said[0]) if said else ("", "")


def _from_last(line: str, strips: int) -> bool:
    """Return whether a line says that the last strip's columns stand first, by the numbers of both."""
    told = list(re.finditer(r"\b(?:strips?|s|channels?|ch)\s*#?(\d+)", line.casefold()))
    numbers = [int(m[1]) for m in told]
    if not any(numbers == [strips - 1 + base, base] for base in (0, 1)):
        return False
    first, last = (
        re.search(words, line.casefold()) for words in (r"\b(?:first|zuerst)\b", r"\b(?:last|zuletzt)\b")
    )
    between = told[1].start()  # else the words say the contrary of the numbers' order
    return not (first and first.start() > between) and not (last and last.start() < between)


def told_channels(line: str, strips: int) -> str:
    """Return the order of columns that a line describes, as "h0..h7 then l0..l7"; "" where it does not."""
    told = re.findall(r"(?<![A-Za-z])(?:[vku]_?)?([hl])_?\[?(\d+)", line.casefold())
    ends, numbers = "".join(end for end, _ in told), [int(n) for _, n in told]
    if re.fullmatch(r"h{2,}l{2,}", ends) and max(numbers) - min(numbers) == strips - 1:
        return "blocks"
    if re.fullmatch(r"(?:hl){2,}", ends) and numbers[0] == numbers[1] == numbers[2] - 1:
        return "alternating"
    return ""


def wired_ends(names: Sequence[str], lines: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Return the strip and the end of columns by lines that each tell them of one strip.

    Examples
    --------
    >>> wired_ends(["A0", "A1", "A2"], ["# strip 0: high A2, low A1", "# strip 1: high A0"])
    {'A1': (0, 'l'), 'A2': (0, 'h'), 'A0': (1, 'h')}
    """
    told: dict[str, tuple[int, str]] = {}
    for line in lines:
        strips = re.findall(r"\bstrip\s*#?(\d+)", line, re.IGNORECASE)
        for name in names if len(strips) == 1 else ():
            said = rf"(?:({_HIGH})|{_LOW})\s*(?:end|side)?\s*[:=]?\s*(?:to |on |pin )?{re.escape(name)}(?!\w)"
            if end := re.search(said, line, re.IGNORECASE):
                told[name] = (int(strips[0]), "h" if end[1] else "l")
    return told

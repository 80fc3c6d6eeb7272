"""At which side of the sensor a log says that its first strip lies: readings count strips from the left."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

_RIGHT = (
    r"\b(?:right(?:most|-?hand)?(?!-?aligned)|rechts|rechte[nrs]?|droite|derech[ao]|direit[ao]|destr[ao])\b"
)
_LEFT = (
    r"\b(?:left(?:most|-?hand)?(?! (?:open|un|out|empty|free|alone|as\b))|links|linke[nrs]?|gauche|izquierd[ao]"
    r"|esquerd[ao]|sinistr[ao])\b"
)
_STRIP = (
    r"(?:strips?|channels?|ch|columns?|s|streifen|kan\u00e4?le?|spalten?|bandes?|voies?|tiras?|canale?s?|fitas?"
    r"|strisc(?:ia|e)|no\.?|nr\.?|#)"
)
_ORDER = (
    rf"\b{_STRIP}\b|\b(?:sensor\w*|pins?|count\w*|number\w*|index\w*|order\w*|\w*z\u00e4hl\w*|\w*nummer\w*|reihenfolge"
    r"|num\u00e9rot\w*|compt\w*|numerad\w*|contad\w*|numerat\w*|contat\w*)\b"
)
_TO = r"[\s\-/.]*(?:[-=]>|\u2192|\b(?:to|nach|bis|zu|vers|\u00e0|a)\b|[-/.]+|\s)[\s\-]*(?:(?:the|la|il)\s)?"
_FROM = r"\b(?:from|start\w*|begin\w*|ab|von|depuis|partir|desde|dal?|dalla)\b"
_FROM_RIGHT = re.compile(
    rf"{_RIGHT}{_TO}{_LEFT}|\bR\s*(?:[-=]>|\u2192|\bto\b)\s*L\b|{_FROM}(?:(?!{_LEFT})[^.;:]){{0,25}}?{_RIGHT}"
    r"|\b(?:mirror(?:ed)?|(?:ge)?spiegel(?:t|verkehrt)|espe(?:j|lh)ad[ao]s?|specchiat[aoei])\b",
    re.IGNORECASE,
)
_FIRST, _LAST = (
    r"\b(?:first|erste[rn]?|premi\u00e8re|primer[ao]|prim[ao])",
    r"\b(?:last|letzte[rn]?|derni\u00e8re|ultim[ao])",
)
_SHIFTED = re.compile(
    rf"\b{_STRIP}\s*#?([a-z])\b[^.;]{{0,20}}?\b{_STRIP}\s*#?\1\s*([-+])\s*([1-9]\d*)\b", re.IGNORECASE
)
_IS = r"(?:[:=]|[-=]>|\u2192|\b(?:is|on|to|at)\b)"
# As "channel map: see wiring.xlsx", "pinout in README".
_ELSEWHERE = re.compile(
    r"\b(?:map(?:ping)?|pin ?-?out|wiring|order|assignment|belegung|zuordnung|reihenfolge|verdrahtung)\b[^.\n]{0,20}?"
    r"\b(?:see|in|as in|per|cf|from|siehe|s\.|laut|nach|voir|ver)\b[^\n]{0,20}?"
    r"(?:\w+\.(?:xlsx?|ods|csv|txt|md|pdf|docx?|png|jpe?g|svg|h|ino|toml|ya?ml|json)\b"
    r"|\b(?:read ?me|notebook|photo|sketch|drawing|laborbuch|skizze|foto)\b)",
    re.IGNORECASE,
)
_WIRED = re.compile(
    r"\b(?:wir(?:ing|ed)|(?:de)?mux\w*|multiplexer|map(?:ping)?|pin ?-?out|order|verdrahtung|belegung|zuordnung"
    r"|reihenfolge)\b",
    re.IGNORECASE,
)
_STRIPS = re.compile(r"\b(?:strips?|streifen|bandes?|tiras?|fitas?|strisc(?:ia|e))\b", re.IGNORECASE)
_SIGN = r"\s*(?:[:=]|[-=]>|\u2192)\s*"
_PAIR = re.compile(rf"(?<![\w.])[^\W\d_]*(\d+){_SIGN}[^\W\d_]*\s?#?(\d+)(?![\w.]*\d)")
_LIST = re.compile(r"(?<![\w.,-])\d+(?:(?:\s*[,;-]\s*|\s+)\d+){2,}(?![\w.]*\d)")
_FEW = 2  # columns of which a strip is told
# Of what touches, of one strip beside another, of the two ends of a strip, or of nothing.
_OTHERWISE = re.compile(
    r"\b(?:mov\w*|slid\w*|roll\w*|drag\w*|swip\w*|fingers?|press\w*|object|ball|bewegt|\w*schoben|glis\w*"
    rf"|no[tn]?|nicht|never|[vku]?_?[hl])\s|{_RIGHT}\s+(?:of|von|neben|next)\b|{_LEFT}{_TO}{_RIGHT}",
    re.IGNORECASE,
)


def _ways_to_call(name: str) -> set[str]:
    """Return a column's name without its unit, and the input's in it, as "C0" of "C0_H"."""
    return {re.sub(r"\s*[\[(].*", "", name), *re.findall(r"\A[^\W\d]+ ?\d+", name)}


def assigned_otherwise(columns: Mapping[str, int], lines: Sequence[str]) -> tuple[str, bool, dict[str, int]]:
    """Return the line that gives columns to other strips than their names do, and whether just to those from the right.

    Also the strip of each column, where it names one for all of them. Not where it only counts from another number on.

    Examples
    --------
    >>> pins = {"A0": 0, "A1": 1, "A2": 2}
    >>> assigned_otherwise(pins, ["wiring: A0 = strip 2 ... A2 = strip 0"])
    ('wiring: A0 = strip 2 ... A2 = strip 0', True, {})
    >>> assigned_otherwise(pins, ["A0 = strip 1, A1 = strip 2"])
    ('', False, {})
    >>> assigned_otherwise(pins, ["value in column n is from strip n-1"])
    ('value in column n is from strip n-1', False, {})
    >>> assigned_otherwise(pins, ["strip 1 on A0, strip 0 on A1, strip 2 on A2"])[1:]
    (False, {'A0': 1, 'A1': 0, 'A2': 2})
    >>> assigned_otherwise({"C0H": 0, "C0L": 0, "C1H": 1, "C2H": 2}, ["channel = strip: C0=2, C1=3, C2=1"])[2]
    {'C0H': 1, 'C0L': 1, 'C1H': 2, 'C2H': 0}
    """
    named = [
        int(m[1]) for name in columns if not name.startswith("column ") and (m := re.search(r"(\d+)", name))
    ]
    for line in lines:
        # Strip n + 1 of columns from 0 on, and n - 1 of columns from 1 on, are the same strips counted otherwise.
        if (m := _SHIFTED.search(line)) and (not named or min(named) + int(m[2] + m[3]) not in (0, 1)):
            return line, False, {}
    told: dict[str, tuple[int, str]] = {}
    strips_of: dict[str, set[int]] = {}  # "Run 1", as all columns may be called, names none of them
    for name, strip in columns.items():
        for way in _ways_to_call(name):
            strips_of.setdefault(way, set()).add(strip)
    for name in columns:
        ways = sorted((w for w in _ways_to_call(name) if len(strips_of[w]) == 1), key=len, reverse=True)
        bare = f"(?:{'|'.join(map(re.escape, ways)) or '(?!)'})"
        said = re.compile(
            rf"(?<!\w){bare}\s*{_IS}\s*{_STRIP}\s*#?(\d+)|\b{_STRIP}\s*#?(\d+)\s*{_IS}\s*(?:pin |input )?{bare}(?!\w)",
            re.IGNORECASE,
        )
        told.update((name, (int(m[1] or m[2]), line)) for line in lines if (m := said.search(line)))
    listed = {} if told else _listed(columns, lines)
    told = told or listed
    shifts = {number - columns[name] for name, (number, _) in told.items()}
    if len(told) < _FEW or len(shifts) == 1:
        return "", False, {}
    turned = len({number + columns[name] for name, (number, _) in told.items()}) == 1
    numbers = sorted({number for number, _ in told.values()})
    strips = len({(columns[name], number) for name, (number, _) in told.items()})
    many = len({*columns.values()})
    whole = strips == many and numbers == list(range(numbers[0], numbers[0] + many)) and numbers[0] in (0, 1)
    if listed and not whole:
        return "", False, {}
    wired = {name: number - numbers[0] for name, (number, _) in told.items()} if whole and not turned else {}
    return next(iter(told.values()))[1], turned, wired


def _listed(columns: Mapping[str, int], lines: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Return the number that a list as "C0=6, C1=5" gives to each column of that name, whatever its end."""
    told: dict[str, tuple[int, str]] = {}
    for name in columns:
        if stem := re.match(r"[^\W\d]+\d+", name):
            said = re.compile(rf"(?<!\w){re.escape(stem[0])}{_SIGN}#?(\d+)(?![\w.]*\d)", re.IGNORECASE)
            wired = (line for line in lines if _STRIPS.search(line) or _WIRED.search(line))
            told.update((name, (int(m[1]), line)) for line in wired if (m := said.search(line)))
    return told


def wired_otherwise(lines: Sequence[str], strips: int) -> str:
    """Return the line that gives channels to strips, or the reverse, in another order than their own; else "".

    Examples
    --------
    >>> wired_otherwise(["mux order: 2 0 1"], 3), wired_otherwise(["wired: 0->2, 1->1, 2->0; 5 V"], 3)
    ('mux order: 2 0 1', 'wired: 0->2, 1->1, 2->0; 5 V')
    >>> wired_otherwise(["wiring: CH0=2, CH1=1, CH2=1"], 3)  # a slip: one strip twice
    'wiring: CH0=2, CH1=1, CH2=1'
    >>> wired_otherwise(["mux order: 0 1 2", "order of runs: 3 1", "2 0 1", "wiring: A0=1, A1=2, A2=3"], 3)
    ''
    """
    for line in lines if strips > _FEW else ():
        if not _WIRED.search(line):
            continue
        pairs = [(int(a), int(b)) for a, b in _PAIR.findall(line)]
        if len(pairs) > _FEW and len({b - a for a, b in pairs}) > 1:  # whether or not each strip comes once
            return line.strip()
        for numbers in ([*map(int, re.findall(r"\d+", m))] for m in _LIST.findall(line)):
            of_all = sorted(numbers) == [*range(min(numbers), min(numbers) + strips)]
            if of_all and numbers != sorted(numbers):
                return line.strip()
    return ""


def order_elsewhere(lines: Sequence[str]) -> str:
    """Return the line that says that the order of channels stands in another file; "" where none does.

    Examples
    --------
    >>> order_elsewhere(["CD74HC4067 mux, channel map: see wiring.xlsx"])
    'CD74HC4067 mux, channel map: see wiring.xlsx'
    >>> order_elsewhere(["channel map: C0..C7 = strips 0..7", "see notes.txt", "in order of strips"])
    ''
    """
    return next((line.strip() for line in lines if _ELSEWHERE.search(line)), "")


def from_the_right_said(lines: Sequence[str], strips: int) -> str:
    """Return the words that say that the first of so many strips lies at the right; "" where no line does.

    Examples
    --------
    >>> from_the_right_said(["ADC 12 bit; strip 1 is the rightmost one"], 8)
    'strip 1 is the rightmost one'
    >>> from_the_right_said(["strips are numbered from right to left"], 8), from_the_right_said(["S8 = far left"], 8)
    ('strips are numbered from right to left', 'S8 = far left')
    >>> from_the_right_said(["strip 1 at the left, strip 8 at the right", "finger slid from the right strip"], 8)
    ''
    """
    ends = re.compile(
        "|".join(
            rf"(?:\b{_STRIP}\s*(?:number\s*)?#?0?(?:{numbers})|{word}\s{_STRIP})\b[^.;,\d]{{0,25}}{side}(?! end\b)"
            rf"|{side}\W+(?:[^\W\d]+\W+){{0,4}}?(?:(?:{_STRIP}|=|is|number|nummer)\s*#?0?(?:{numbers})|{word}\s{_STRIP})"
            r"\b(?! of)"
            for numbers, word, side in (("[01]", _FIRST, _RIGHT), (f"{strips - 1}|{strips}", _LAST, _LEFT))
        ),
        re.IGNORECASE,
    )
    for clause in (c.strip(" #%/!*\t") for line in lines for c in re.split(r"[;,\n]|(?<=[a-z])\.\s", line)):
        of_order = re.search(_ORDER, clause, re.IGNORECASE) and _FROM_RIGHT.search(clause)
        if (of_order or ends.search(clause)) and not _OTHERWISE.search(clause):
            return clause
    return ""

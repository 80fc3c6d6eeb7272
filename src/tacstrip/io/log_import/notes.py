"""Notes between the readings in whichever language: one that names a unit, or at which all readings jump, is asked."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import PART

_COMMENT = re.compile(r"\s*(?:#|%|//|!|;)+\s*(?=\S*[^\W\d_]{2})")
# A unit's sign that is not behind a number, so that nothing was measured in it.
_UNIT = re.compile(
    r"(?<![\w.,])(?<!\d\s)(?:[mu\u00b5]?V|V_?ref|V_?cc|V_?dd|AREF|ADC|LSB|%|\u2030)(?!\w)", re.IGNORECASE
)
_RESOLUTION = re.compile(r"\d\s?-?_?bits?\b|analogReadResolution", re.IGNORECASE)  # of which others ask
_FEW = 5  # notes: of more, they are of the log's form
_WORDS = re.compile(r"[^\W\d_]{2,}")
_MARKED = re.compile(r"[{}<>\"]")  # of the log's form, such as XML; but for what is drawn before it
# From what a board is fed; where no level is told, nor that it runs low, it changes there.
_SOURCE = re.compile(
    r"\blipo\b|batter[iy]|bater\u00ed?a|\bbateri|akku|\baccu\b|\bpile\b|\bpila\b|\bpil\b|netzteil|power ?bank|mains"
    r"|secteur|\u96fb\u6c60|\u7535\u6c60|suppl(?:y|ied)\b|powered|versorg|speis|aliment|fuente|zasil|nap\u00e1j|voeding|besleme"
    r"|\u043f\u0438\u0442\u0430\u043d|\u96fb\u6e90|\u7535\u6e90|\u4f9b\u7535|\bv_?ref\b|\bv_?cc\b|\bv_?dd\b",
    re.IGNORECASE,
)
_LEVEL = re.compile(
    r"\blow\b|schwach|leer|faible|baj[ao]|bassa|fraca|weak|empty|charg|warn|ok\b", re.IGNORECASE
)
_VOLTS = re.compile(r"(\d+(?:[.,]\d+)?)\s?(m?)V(?:olts?)?(?!\w)", re.IGNORECASE)
_TOLD = re.compile(
    r"(?:batter\w*|bater\w*|akku|accu|lipo|pile|pila|pil)[\s:=]*\d", re.IGNORECASE
)  # its level
_FED = re.compile(
    r"\b(?:on|from|by|via|off|now|am|vom|aus|mit|jetzt|sur|par|maintenant|con|ahora|com|agora|ora|na|teraz|op|nu)\b",
    re.IGNORECASE,
)
_LIKE_VREF = (0.6, 1.7)  # times Vref: what a sensor may be fed with instead
_AS_VREF = 0.02  # relative
_DRAWN = re.compile(r"\A[\s>*~=+.-]+(?=[^\W\d_])")
_LONGEST = 100  # characters of a line that are quoted
_JUMP = 1.3  # times: readings that jump less may move so
_OTHERS = 2.0  # times the largest other step
_ALIKE = 0.2  # of the step: so much may it differ from reading to reading


def notes_among(text: str, lines: Sequence[int]) -> tuple[tuple[int, str], ...]:
    r"""Return comments between a table's lines, and lines of words, whose words are on no other, and what they say.

    Examples
    --------
    >>> notes_among("0,1.5,1\n# palec zeslizgnal sie\n1,2.4,2.1", [1, 3])
    ((2, '# palec zeslizgnal sie'),)
    """
    first, last = min(lines, default=0), max(lines, default=0)
    inner = [(n, line.strip()) for n, line in numbered(text) if first < n < last and line.strip()]
    words = Counter(w for _, line in numbered(text) for w in {*_WORDS.findall(line.casefold())})
    rows = {*lines}
    there = [
        (n, line) for n, line in inner
        if _COMMENT.match(line) or (n not in rows and _is_of_words(_DRAWN.sub("", line, count=1), words))
    ]  # fmt: skip
    there = [(n, line) for n, line in there if not _RESOLUTION.search(line)]
    forms = Counter(re.sub(r"\d+", "0", line) for _, line in there)
    return tuple((n, line) for n, line in there if forms[re.sub(r"\d+", "0", line)] == 1)


def _is_of_words(line: str, words: Counter[str]) -> bool:
    """Return whether a line without a mark of a comment is words, of which the log's other lines hold not one."""
    found = _WORDS.findall(line.casefold())
    return bool(found) and not _MARKED.search(line) and all(words[w] == 1 for w in found)


def names_a_unit(line: str) -> bool:
    """Return whether a comment names a unit of readings behind no number.

    Examples
    --------
    >>> names_a_unit("# od tego miejsca jako ulamek Vref"), names_a_unit("# battery 3.3 V"), names_a_unit("# pad 2")
    (True, False, False)
    """
    return bool(_COMMENT.match(line) and _UNIT.search(line) and not _RESOLUTION.search(line))


def names_a_supply(line: str, vref: float) -> bool:
    """Return whether a note names a supply other than Vref (0: not known), and not the level of a battery.

    Examples
    --------
    >>> names_a_supply("# runs on lipo now", 5.0), names_a_supply("# sur batterie, 4,1 V", 5.0)
    (True, True)
    >>> names_a_supply("# battery 3.9 V", 5.0), names_a_supply("# battery low", 5.0), names_a_supply("# USB 5.0 V", 5.0)
    (False, False, False)
    """
    if not _SOURCE.search(line) or _LEVEL.search(line) or _TOLD.search(line):
        return False
    volts = [float(d.replace(",", ".")) * (1e-3 if milli else 1.0) for d, milli in _VOLTS.findall(line)]
    if not vref or not volts:
        return bool(volts or _FED.search(line)) or not line.isascii()
    return any(_LIKE_VREF[0] <= v / vref <= _LIKE_VREF[1] and abs(v - vref) > _AS_VREF * vref for v in volts)


def ask_for_notes(clues: Clues, rough: list[LogScan]) -> None:
    """Ask which part is meant where all readings jump alike at a note as nowhere else; other notes are a doubt."""
    if PART in clues.table.names or {PART, "unit"} & {*clues.answers} or not clues.table.notes:
        return
    steps = _steps(rough)
    at = [(n, text, _at(rough, n)) for n, text in clues.table.notes]
    noted = (
        {k for *_, k in at} if len(at) <= _FEW else set()
    )  # where each scan has one, these are steps as others
    sizes = {k: abs(step) for k, (step, _) in steps.items()}
    for line, text, k in at:
        step, alike = steps.get(k, (0.0, False))
        others = max(
            (size for place, size in sizes.items() if place != k and place not in noted), default=0.0
        )
        if alike and abs(step) > max(np.log(_JUMP), _OTHERS * others):
            clues.ask(
                PART,
                f"line {line} says {text[:_LONGEST]!r}, and from there on all readings are {np.exp(step):.3g} times "
                "those before: which are meant? Those of one part, or of all if they mean the same throughout (skip)",
                f"above line {line}", f"below line {line}", "skip",
            )  # fmt: skip
            return
    for line, text, _ in at:
        if names_a_supply(text, clues.sensor.vref_volt if clues.sensor else 0.0):
            clues.ask(
                PART,
                f"line {line} says {text[:_LONGEST]!r}: if Vref is another one from there on, which readings are "
                "meant? Those of one part, or of all if they mean the same throughout (skip)",
                f"above line {line}", f"below line {line}", "skip",
            )  # fmt: skip
            return
    marked = [(line, text) for line, text, _ in at if _COMMENT.match(text)]
    if 0 < len(marked) <= _FEW:
        shown = "; ".join(f"line {line} ({text[:_LONGEST]!r})" for line, text in marked)
        clues.doubt(
            f"between the readings, not understood, and taken as notes: {shown}. If one says that unit, "
            "supply or sensor change there, --answer part"
        )


def _at(rough: list[LogScan], line: int) -> int:
    """Return the place of the first scan below a line."""
    return next((k for k, scan in enumerate(rough) if scan.line > line), len(rough))


def _steps(rough: list[LogScan]) -> dict[int, tuple[float, bool]]:
    """Return of each scan but the first by how much its readings are above those before, and whether all alike.

    As the logarithm's median over the strips that are touched in both.
    """
    found = {}
    for k in range(1, len(rough)):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(rough[k].values / rough[k - 1].values).ravel()
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            step = float(np.median(ratio))
            found[k] = (step, len(ratio) > 1 and bool(np.median(np.abs(ratio - step)) < _ALIKE * abs(step)))
    return found

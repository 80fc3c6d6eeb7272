"""Lines between the readings which say that from there on these mean something else: another unit, scale or sketch."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from tacstrip.io.log_import.notes import names_a_unit, notes_among
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import PART, Table

# That something changes, or holds from there on.
_CHANGED = re.compile(
    r"\b(?:chang(?:ed|ing|es? (?:to|of))|switch(?:ed|ing)?|swapp?(?:ed|ing)?|exchanged?|interchanged?"
    r"|replac(?:ed|ing)|re-?(?:flashed"
    r"|wired|calibrated|scaled|ordered|numbered|plugged|soldered|routed|programmed|configured)"
    r"|rotated|reversed|inverted"
    r"|flipped|updated|upgraded|new|from (?:here|now|this)|as of (?:here|now)|now|instead|other"
    r"|another|different|moved to"
    r"|ab (?:hier|jetzt|nun|zeile)|von hier|jetzt|nun|ge\u00e4ndert|umge(?:stellt|steckt|baut"
    r"|l\u00f6tet)|(?:ver)?ge?tauscht"
    r"|vertauscht|neue[rs]?|andere[rs]?|statt|d\u00e9sormais|maintenant|\u00e0 partir|chang\u00e9e?s?"
    r"|\u00e9chang\u00e9e?s?"
    r"|nouvel(?:le)?|nouveau|autre|ahora|a partir|desde aqu\u00ed|cambi\w+|nuev[oa]|otr[oa]"
    r"|intercambi\w+|agora|mud\w+"
    r"|troc\w+|nov[oa]|outr[oa]|adesso|da qui|d'ora|scambi\w+|invertit\w+|nuov[oa]|altr[oa]|vanaf hier|nu|verwisseld"
    r"|gewijzigd|veranderd|andere|nieuwe|teraz|odt\u0105d|zmien\w+|zamien\w+)\b",
    re.IGNORECASE,
)
# Of what the readings' meaning hangs on.
_SUBJECT = re.compile(
    r"\b(?:units?|einheit(?:en)?|unit\u00e9s?|unidad(?:es)?|unit\u00e0|eenheid|volts?|(?:milli"
    r"|micro)volts?|m?v|counts?|codes?"
    r"|raw|lsb|adc|bits?|ratios?|fractions?|percent|prozent|permille|v_?ref|aref|vcc|supply"
    r"|versorgung|reference|referenz"
    r"|gains?|verst\u00e4rkung|verstaerkung|ganancia|ganho|guadagno|amplif\w+|scal(?:e[sd]?|ing)"
    r"|skalierung|\u00e9chelle|escala"
    r"|scala|factor|faktor|facteur|fator|fattore|dividers?|teiler|diviseur|divis\w+r|partitore"
    r"|resistors?|widerst\u00e4nde?"
    r"|range|bereich|resolution|aufl\u00f6sung|sketch|firmware|script|skript|program(?:m[ea]?)?"
    r"|calibration|kalibrierung"
    r"|mux|multiplexer|connectors?|stecker|conecto\w+|connett\w+|connecteurs?|plugs?|cables?|kabel"
    r"|c\u00e2bles?|cavi|cavo"
    r"|wires?|wiring|leitung(?:en)?|adern?|fils|hilos?|pins?|channels?|kan[\u00e4a]le?|canal\w*"
    r"|columns?|spalten?|colonn\w+"
    r"|column\w+|coluna\w*|order|reihenfolge|ordre|orden|ordem|ordine|ends?|enden|strips?|streifen"
    r"|bandes?|tiras?|fitas?"
    r"|strisc\w+|sensors?|sensor\w*|capteurs?|pads?|boards?|platine|hand|finger|left|right|links"
    r"|rechts|clock|baud|rate"
    r"|millis|micros|seconds|sekunden)\b",
    re.IGNORECASE,
)
_CODE = re.compile(r"[{}\"]|\w=\S")  # no words of a person, as in {"unit": "V"}
_FEW_WORDS = 3
_OFTEN = 0.1  # of the lines: what stands on more is of the log's form
_LONGEST = 100  # characters of a line that are quoted


def changes_said(text: str, lines: Sequence[int]) -> tuple[tuple[int, str], ...]:
    r"""Return the lines among those of a table, with what they say, which tell of a change of what readings mean.

    Examples
    --------
    >>> changes_said("0,1.5,1\n# changed the sketch: prints mV now\n1,2400,2100", [1, 3])
    ((2, '# changed the sketch: prints mV now'),)
    >>> changes_said("0,1.5,1\nchanged the object: steel now\n1,2.4,2.1", [1, 3])
    ()
    """
    if not lines:
        return ()
    first, last = min(lines), max(lines)
    inner = [(n, line.strip()) for n, line in numbered(text) if first < n <= last and line.strip()]
    above = {line.strip() for n, line in numbered(text) if n < first}  # what comes again changes nothing
    found = [
        (n, line) for n, line in inner if line not in above and (tells_of_change(line) or names_a_unit(line))
    ]
    return tuple(found) if len(found) <= max(1.0, _OFTEN * len(inner)) else ()


def tells_of_change(line: str) -> bool:
    """Return whether a line is words which say that readings mean something else from there on."""
    words = re.findall(r"[^\W\d_]{2,}", line)
    if len(words) < _FEW_WORDS or (_CODE.search(line) and not line.lstrip().startswith(("#", "%", "/", ";"))):
        return False
    said = _CHANGED.search(line)
    return said is not None and any(m.span() != said.span() for m in _SUBJECT.finditer(line))


def in_parts(table: Table, text: str) -> Table:
    """Return a table with a column of the part of the log that a line is of, where lines between tell of a change."""
    changes = changes_said(text, table.lines)
    if PART in table.names:
        return table
    return table.in_parts(changes) if changes else replace(table, notes=notes_among(text, table.lines))


def ask_which_part(clues: Clues) -> None:
    """Ask which part of a log is meant, where a line in it tells of a change of what readings mean."""
    if PART not in clues.table.names or PART in clues.answers:
        return
    (line, text), fields = clues.table.changes[0], clues.table.column(PART)
    clues.ask(
        PART,
        f"line {line} says {text[:_LONGEST]!r}: which readings are meant? Those of one part, or of all if they mean "
        "the same throughout (skip)",
        *dict.fromkeys(fields), "skip",
    )  # fmt: skip
    clues.stop()

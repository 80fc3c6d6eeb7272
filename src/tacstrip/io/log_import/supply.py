"""Volts that a log's words name: of Vref, of a supply that was measured, or of another one than the spec's."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tacstrip.io.log_import.conversion import volts_of_codes
from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.words import any_of, finder

_NAME = r"(?:v_?ref|aref|v_?cc|v_?dd)"
_DIGITS = r"(\d+(?:[.,]\d+)?)"
_VREF_IS = re.compile(rf"\b{_NAME}\b[^\d\n]{{0,12}}?{_DIGITS}\s*(m?)V\b", re.IGNORECASE)
_STATED = re.compile(
    rf"[\s#%!;/]*+{_NAME}\s*(?:[=:]|is)?\s*{_DIGITS}\s*(?:(m?)V(?:olts?)?)?[\s.]*", re.IGNORECASE
)
_COLUMN = re.compile(r"v_?ref(?:_?(?:m?v|volts?))?(?:\s*[\[(]m?V[\])])?", re.IGNORECASE)
_VOLTS = re.compile(rf"(?<![\w.,:/\u00b1<>=~-]){_DIGITS}\s?(m?)V(?:olts?)?(?![\w/])", re.IGNORECASE)
_ANY_VOLTS = re.compile(rf"{_DIGITS}\s?(m?)V(?:olts?)?(?!\w)", re.IGNORECASE)
_LEVEL_IS = re.compile(rf"{any_of('battery')}[\s:=]*\d", re.IGNORECASE)  # of a battery
_AS_SPEC = 0.02  # relative: rounded
_LIKE_SPEC = (0.8, 1.25)  # times Vref: a supply that sags, or another one that is used in its place
_INSTEAD = (0.6, 1.7)  # times Vref: what a sensor may be fed with instead
_SUPPLIES = (1.1, 1.8, 2.048, 2.5, 2.56, 3.0, 3.3, 4.096, 5.0)
_MANY = 3  # volts on a line: more are names or readings
_LONGEST = 100  # characters of a line that are quoted


def stated_vref(line: str) -> float | None:
    """Return the Vref that a line states and nothing else, in volts; None where it says something else.

    Examples
    --------
    >>> stated_vref("# Vref = 5.00"), stated_vref("AREF: 3.3V"), stated_vref("# now Vref = 5 V")
    (5.0, 3.3, None)
    """
    found = _STATED.fullmatch(line)
    return _value(found[1], found[2] or "") if found else None


def other_supplies(text: str, above: Sequence[str]) -> tuple[str, ...]:
    r"""Return the lines of a text that name volts of Vref or a supply which none above the readings names, each once.

    Examples
    --------
    >>> other_supplies("scan 0, Vref=3.3V\n1 2.5\nscan 1, Vref=3.0V\n1 2.4", ["scan 0, Vref=3.3V"])
    ('scan 1, Vref=3.0V',)
    """
    named, found = {v for line in above for v in _named_volts(line)}, list[str]()
    for _, line in numbered(text):
        other = {v for v in _named_volts(line) if all(abs(v - known) > _AS_SPEC * known for known in named)}
        named |= other
        found += [line.strip()] if other else []
    return tuple(found)


def _named_volts(line: str) -> set[float]:
    """Return the volts of Vref or of a supply that a line names, none of a battery."""
    if not re.search(r"\d\s?m?V", line) or finder("battery").search(line):
        return set()
    supply = _VOLTS.findall(line) if finder("supply").search(line) else []
    supply = supply if len(supply) <= _MANY else []
    return {_value(d, m) for d, m in (*_VREF_IS.findall(line), *supply)}


def ask_for_vref(clues: Clues) -> None:
    """Ask which Vref holds where a log states another one than the spec."""
    if clues.sensor is None or "vref_volt" in clues.answers:
        return
    table, vref = clues.table, clues.sensor.vref_volt
    told = {_value(d, m): "" for d, m in _VREF_IS.findall("\n".join(table.preamble))}
    for name in table.names:
        if _COLUMN.fullmatch(name.strip()):
            milli = 1e-3 if re.search(r"mv", name, re.IGNORECASE) else 1.0
            for line, text in zip(table.lines, table.column(name), strict=True):
                value = number_of(text, table.decimal)
                told |= {milli * value: f"line {line}: "} if value and milli * value not in told else {}
    for volts, place in told.items():
        if abs(volts - vref) > _AS_SPEC * vref:
            clues.ask(
                "vref_volt",
                f"{place}the log says Vref = {volts:g} V, and the spec vref_volt = {vref:g}: with which was it made?",
                f"{volts:g}", f"{vref:g}",
            )  # fmt: skip


def ask_for_supply(clues: Clues) -> None:
    """Ask for Vref where a log of volts names others about as large, or as of a supply; doubt other usual supplies.

    What a log says in whichever language is no Vref only if words that are known, or the number, tell so.
    """
    if clues.sensor is None or "vref_volt" in clues.answers:
        return
    vref = clues.sensor.vref_volt
    lines = clues.table.preamble
    stated = [_value(d, m) for line in lines for d, m in _VREF_IS.findall(line)]
    settled = any(abs(volts - vref) <= _AS_SPEC * vref for volts in stated)
    told = [(line, [_value(d, m) for d, m in _VOLTS.findall(line)]) for line in lines]
    as_spec = any(abs(v - vref) <= _AS_SPEC * vref for _, found in told for v in found)
    codes = {*volts_of_codes(clues.table).values()}
    for line, found in told:
        text = " ".join(line.split()).lstrip("#%/!; ")[:_LONGEST]
        reckoned = finder("reckoned").search(line)  # with what it names, whatever the board had
        other = finder("battery", "other_volts").search(line) or meaning(text).role or settled
        if len(found) > _MANY or (other and not reckoned):
            continue
        for volts in found:
            if abs(volts - vref) <= _AS_SPEC * vref or volts in codes:
                continue
            usual = any(abs(volts - v) <= 0.5 * _AS_SPEC * v for v in _SUPPLIES)
            named = finder("supply").search(line)
            if (usual and (named or reckoned)) or (
                not other and _LIKE_SPEC[0] <= volts / vref <= _LIKE_SPEC[1]
            ):
                clues.ask(
                    "vref_volt",
                    f"the log says {text!r}, and the spec vref_volt = {vref:g}: with which Vref was it made?",
                    f"{volts:g}", f"{vref:g}",
                )  # fmt: skip
            elif usual and not (as_spec or other):
                clues.doubt(
                    f"the log says {text!r}, and the spec vref_volt = {vref:g}: readings are taken by the spec; else "
                    f"--answer vref_volt={volts:g}"
                )


def names_a_supply(line: str, vref: float) -> bool:
    """Return whether a note names a supply other than Vref (0: not known), and not the level of a battery.

    Examples
    --------
    >>> names_a_supply("# runs on lipo now", 5.0), names_a_supply("# sur batterie, 4,1 V", 5.0)
    (True, True)
    >>> names_a_supply("# battery 3.9 V", 5.0), names_a_supply("# battery low", 5.0), names_a_supply("# USB 5.0 V", 5.0)
    (False, False, False)
    """
    named = finder("battery", "mains", "supply").search(line)
    if not named or finder("battery_level").search(line) or _LEVEL_IS.search(line):
        return False
    volts = [_value(d, m) for d, m in _ANY_VOLTS.findall(line)]
    if not vref or not volts:
        return bool(volts or finder("fed").search(line)) or not line.isascii()
    return any(_INSTEAD[0] <= v / vref <= _INSTEAD[1] and abs(v - vref) > _AS_SPEC * vref for v in volts)


def _value(digits: str, milli: str) -> float:
    return float(digits.replace(",", ".")) * (1e-3 if milli else 1.0)

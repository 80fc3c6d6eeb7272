"""Volts that a log's words name and that are not the spec's Vref: of a supply that was measured, or of another one."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tacstrip.io.log_import.conversion import volts_of_codes
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.questions import Clues

_VOLTS = re.compile(r"(?<![\w.,:/\u00b1<>=~-])(\d+(?:[.,]\d+)?)\s?(m?)V(?:olts?)?(?![\w/])", re.IGNORECASE)
# Where words say otherwise: of another part, of a meter's range, of what readings are compared with or came to.
_OF_OTHERS = re.compile(
    r"batter|bat[ée]ria|bateri|akku|\baku\b|\baccu|\bpile\b|\bpila\b|vbat|lipo|\u96fb\u6c60|\u7535\u6c60"
    r"|range|bereich|gamme|plage|calibre|rango|zakres|portata|rozsah|bereik|\u30ec\u30f3\u30b8|\u91cf\u7a0b|full ?scale"
    r"|fond[eo] |thresh|schwell|seuil|soglia|umbral|limiar|pr\u00f3g|pr\u00e1h|drempel|\bmin|\bmax|peak|noise|rausch"
    r"|offset|alarm|resol|aufl\u00f6s|touch|rest\b|idle|led\b|pull|zener|gate|hyster|error|fehler|dropout",
    re.IGNORECASE,
)
_OF_SUPPLY = re.compile(
    r"suppl|power|v_?ref|aref|v_?cc|v_?dd|refer|versorg|speis|betriebssp|netzteil|aliment|fuente|zasil|nap\u00e1j"
    r"|voeding|besleme|\u043f\u0438\u0442\u0430\u043d|\u96fb\u6e90|\u7535\u6e90|\u4f9b\u7535|\u57fa\u6e96|\u57fa\u51c6",
    re.IGNORECASE,
)
_VREF_IS = re.compile(
    r"\b(?:v_?ref|aref|v_?cc|v_?dd)\b[^\d\n]{0,12}?(\d+(?:[.,]\d+)?)\s*(m?)V\b", re.IGNORECASE
)
_AS_SPEC = 0.02  # relative: rounded
_LIKE_SPEC = (0.8, 1.25)  # times Vref: a supply that sags, or another one that is used in its place
_SUPPLIES = (1.8, 2.5, 3.0, 3.3, 4.096, 5.0)
_MANY = 3  # volts on a line: more are names or readings
_LONGEST = 100  # characters of a line that are quoted


def ask_for_supply(clues: Clues) -> None:
    """Ask for Vref where a log of volts names others about as large, or as of a supply; doubt other usual supplies.

    What a log says in whichever language is no Vref only if words that are known, or the number, tell so.
    """
    if clues.sensor is None or "vref_volt" in clues.answers:
        return
    vref = clues.sensor.vref_volt
    lines = clues.table.preamble
    stated = [_value(d, m) for line in lines for d, m in _VREF_IS.findall(line)]
    if any(abs(volts - vref) <= _AS_SPEC * vref for volts in stated):
        return
    told = [(line, _volts(line)) for line in lines]
    as_spec = any(abs(v - vref) <= _AS_SPEC * vref for _, found in told for v in found)
    codes = {*volts_of_codes(clues.table).values()}
    for line, found in told:
        text = " ".join(line.split()).lstrip("#%/!; ")[:_LONGEST]
        for volts in (
            found if len(found) <= _MANY and not (_OF_OTHERS.search(line) or meaning(text).role) else ()
        ):
            if abs(volts - vref) <= _AS_SPEC * vref or volts in codes:
                continue
            usual = any(abs(volts - v) <= 0.5 * _AS_SPEC * v for v in _SUPPLIES) and not as_spec
            like = _LIKE_SPEC[0] <= volts / vref <= _LIKE_SPEC[1]
            if like or (usual and _OF_SUPPLY.search(line)):
                clues.ask(
                    "vref_volt",
                    f"the log says {text!r}, and the spec vref_volt = {vref:g}: with which Vref was it made?",
                    f"{volts:g}", f"{vref:g}",
                )  # fmt: skip
            elif usual:
                clues.doubt(
                    f"the log says {text!r}, and the spec vref_volt = {vref:g}: readings are taken by the spec; else "
                    f"--answer vref_volt={volts:g}"
                )


def _volts(line: str) -> Sequence[float]:
    return [_value(d, m) for d, m in _VOLTS.findall(line)]


def _value(digits: str, milli: str) -> float:
    return float(digits.replace(",", ".")) * (1e-3 if milli else 1.0)

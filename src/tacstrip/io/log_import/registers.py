"""Values of numbered registers, as a Modbus poll prints them, where the log says which strip's end each one is."""

from __future__ import annotations

import re

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import meaning, pair_of
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.untouched_phrases import says_no_contact

_TO = r"\s*(?:\.\.+|\u2026|-|\u2013|to|bis|through|\u00e0|a)\s*"
_SAID = re.compile(
    rf"(?P<first>\b(?:0x[\dA-Fa-f]+|\d+))(?:{_TO}(?P<last>0x[\dA-Fa-f]+|\d+))?\s*(?:=|:|are|is|hold)\s*"
    rf"(?P<what>[^\d,;=:]*?)(?:(?P<strip>\d+)(?:{_TO}(?P<end>\d+))?)?(?P<rest>[^\d,;=:.]*)(?=[,;.]|\Z)"
)
_VALUE = re.compile(
    r"\s*(?:\[|(?:reg(?:ister)?|hr|ir|holding|input)[\s_#]*)?(?P<at>0x[\dA-Fa-f]+|\d+)\]?\s*[=:]\s*(?P<value>[-+]?\d[\d.]*|\S+)\s*",
    re.IGNORECASE,
)
_FEW = 4  # registers
_STRIP = re.compile(r"strip|streifen|bande|banda|tira|taxel|strook", re.IGNORECASE)


def with_registers(text: str) -> tuple[str, str]:
    r"""Return a text with names of strips' ends in place of registers' numbers, and a remark; another text as it is.

    Examples
    --------
    >>> text = "1..2 = upper ends of strips 1..2, 3..4 = lower ends; 9 = open\n1 = 5\n2 = 9\n3 = 4\n4 = 9\n"
    >>> with_registers(text)[0].split("\n")[1:5]
    ['strip1_upper = 5', 'strip2_upper = nan', 'strip1_lower = 4', 'strip2_lower = nan']
    """
    lines = numbered(text)
    values = {n: m for n, line in lines if (m := _VALUE.fullmatch(line))}
    there = {_number(m["at"]) for m in values.values()}
    if len(there) < _FEW or 2 * len(values) < sum(bool(line.strip()) for _, line in lines):
        return text, ""
    names: dict[int, str] = {}
    void: set[str] = set()
    said: set[str] = set()  # ends
    strips: list[int] = []  # of the last range that names them: what follows it is of the same ones
    for n, line in lines:
        for m in _SAID.finditer(line) if n not in values else ():
            words = f"{m['what']} {m['rest']}".strip()
            if not m["last"] and (says_nothing(words) or says_no_contact(words)):
                void.add(m["first"])
                continue
            ends = {
                w for w in re.findall(r"[^\W\d_]+", words.casefold()) if meaning(w).channel not in ("", "end")
            }
            if m["strip"] and _STRIP.search(m["what"]):
                first, last = int(m["strip"]), int(m["end"] or m["strip"])
                strips = [*range(first, last + 1)] if last >= first else [*range(first, last - 1, -1)]
            at = range(_number(m["first"]), _number(m["last"] or m["first"]) + 1)
            if len(ends) != 1 or len(at) != len(strips):
                continue
            end = ends.pop()
            said.add(meaning(end).channel)
            for register, strip in zip(at, strips, strict=True):
                if names.setdefault(register, f"strip{strip}_{end}") != f"strip{strip}_{end}":
                    return text, ""
    if (
        not (said == {"h", "l"} or pair_of(said))
        or not there <= {*names}
        or len({*names.values()}) < len(names)
    ):
        return text, ""
    made = [
        f"{names[int(m['at'], 0)]} = {'nan' if m['value'] in void else m['value']}"
        if (m := values.get(n))
        else line
        for n, line in lines
    ]
    return "\n".join(made), "registers are taken for the strips' ends that the log says"


def _number(text: str) -> int:
    return int(text, 16) if text[:2] in ("0x", "0X") else int(text)

"""Frames of bytes in hex, of a CAN bus, of a dump or of lines: refused, so that no byte is taken for a reading."""

from __future__ import annotations

import itertools
import re

from tacstrip.io.log_import.table import ContradictionError

_BYTE = r"(?:0[xX])?[\dA-Fa-f]{2}"
_LINE = re.compile(
    rf"(?:.*(?<![\w.:#]))?{_BYTE}(?:(?:\s*,\s*|\s+){_BYTE}){{3,}}[\s,;\])}}]*"
    r"|(?:.*(?<![\w.:]))?(?:[\dA-Fa-f]{2}){6,}\s*"
)
_DUMPED = re.compile(
    r"(?P<at>[\dA-Fa-f]{4,8}):?(?:\s+(?:[\dA-Fa-f]{2}|[\dA-Fa-f]{4})){4,}(?:\s{2,}.*|\s+\|.*\|)?\s*"
)
_CAN = re.compile(
    r".*?\b[\dA-Fa-f]{3,8}(?:\s+\[\d+\]\s*(?:[\dA-Fa-f]{2}\s*)+|#(?:[\dA-Fa-f]{2})+)(?:\s+'.*')?\s*"
)
_OF_TWO = re.compile(
    r"\b(?:2|two|zwei|deux)[ -]?(?:bytes?|octets?|b)\b|\bu?int16|\b[ui]?16[ -]?(?:bits?)?\b"
    r"|\bbytes?\s+\d+\s*(?:-|\.\.+|to|and|,|/|\+|&|bis|und|et)\s*\d",
    re.IGNORECASE,
)
_FEW, _MOST = 3, 0.6  # frames; of the lines


def refuse_frames(text: str) -> None:
    r"""Raise `ContradictionError` where a text is of frames of bytes, of which two or more make a reading.

    Examples
    --------
    >>> refuse_frames("can0 210 [4] 0A 1F 03 22\n" * 4)
    Traceback (most recent call last):
    tacstrip.io.log_import.table.ContradictionError: line 1: bytes in hex ('can0 210 [4] 0A 1F 03 22'), of which ...
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    plain = [(n, line) for n, line in lines if not line.lstrip().startswith(("#", "//", "%"))]
    rest = {n for n, _ in plain[1:]}
    said = any(_OF_TWO.search(line) for n, line in lines if n not in rest)
    for form in (_CAN, _DUMPED, _LINE):
        found = [(n, line) for n, line in plain if form.fullmatch(line)]
        if form is _DUMPED:  # else the first number may be a time
            at = [int(form.fullmatch(line)["at"], 16) for _, line in found]  # type: ignore[index]
            found = found if len({b - a for a, b in itertools.pairwise(at)}) == 1 and at[0] == 0 else []
        digits = "".join(line for _, line in found)
        if len(found) < max(_FEW, _MOST * len(plain)) or not (
            form is not _LINE or (said and re.search("[a-fA-F]", digits))
        ):
            continue
        raise ContradictionError(
            f"line {found[0][0]}: bytes in hex ({found[0][1].strip()[:40]!r}), of which several make a reading: not "
            "a form that is read here; decode them first, and save the numbers"
        )

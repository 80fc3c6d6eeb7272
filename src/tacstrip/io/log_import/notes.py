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
_LONGEST = 100  # characters of a line that are quoted
_JUMP = 1.3  # times: readings that jump less may move so
_OTHERS = 2.0  # times the largest other step
_ALIKE = 0.35  # of the step: so much may it differ from reading to reading


def notes_among(text: str, lines: Sequence[int]) -> tuple[tuple[int, str], ...]:
    r"""Return the comments between a table's lines with words that no other shares but for numbers, and what they say.

    Examples
    --------
    >>> notes_among("0,1.5,1\n# palec zeslizgnal sie\n1,2.4,2.1", [1, 3])
    ((2, '# palec zeslizgnal sie'),)
    """
    first, last = min(lines, default=0), max(lines, default=0)
    there = [(n, line.strip()) for n, line in numbered(text) if first < n < last and _COMMENT.match(line)]
    there = [(n, line) for n, line in there if not _RESOLUTION.search(line)]
    forms = Counter(re.sub(r"\d+", "0", line) for _, line in there)
    found = [(n, line) for n, line in there if forms[re.sub(r"\d+", "0", line)] == 1]
    return tuple(found) if len(found) <= _FEW else ()


def names_a_unit(line: str) -> bool:
    """Return whether a comment names a unit of readings behind no number.

    Examples
    --------
    >>> names_a_unit("# od tego miejsca jako ulamek Vref"), names_a_unit("# battery 3.3 V"), names_a_unit("# pad 2")
    (True, False, False)
    """
    return bool(_COMMENT.match(line) and _UNIT.search(line) and not _RESOLUTION.search(line))


def ask_for_notes(clues: Clues, rough: list[LogScan]) -> None:
    """Ask which part is meant where all readings jump alike at a note as nowhere else; other notes are a doubt."""
    if PART in clues.table.names or {PART, "unit"} & {*clues.answers} or not clues.table.notes:
        return
    steps = _steps(rough)
    at = [(n, text, _at(rough, n)) for n, text in clues.table.notes]
    others = max((abs(s) for k, (s, _) in steps.items() if k not in [k for *_, k in at]), default=0.0)
    for line, text, k in at:
        step, alike = steps.get(k, (0.0, False))
        if alike and abs(step) > max(np.log(_JUMP), _OTHERS * others):
            clues.ask(
                PART,
                f"line {line} says {text[:_LONGEST]!r}, and from there on all readings are {np.exp(step):.3g} times "
                "those before: which are meant? Those of one part, or of all if they mean the same throughout (skip)",
                f"above line {line}", f"below line {line}", "skip",
            )  # fmt: skip
            return
    shown = "; ".join(f"line {line} ({text[:_LONGEST]!r})" for line, text, _ in at)
    clues.doubt(f"between the readings, taken as notes that change nothing of these: {shown}")


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

"""Columns that are the strips in their order, though no name says so: which they are, and where the first strip is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tacstrip.errors import OptionError
from tacstrip.io.log_import.ends import noise, order_of_ends
from tacstrip.io.log_import.mapping import STRIP_ORDERS
from tacstrip.io.log_import.names import (
    Meaning,
)
from tacstrip.io.log_import.neighbours import order_of_neighbours
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.statements import order_said, strips_order_said


def ask_for_block(clues: Clues, why: str, names: list[str], wide: int) -> list[str]:
    """Ask which columns are the strips; return the likeliest, with which other questions can be found."""
    at = [clues.table.places[n] for n in names]
    starts = [
        n for n in range(len(names) - wide + 1) if at[n + wide - 1] - at[n] == wide - 1
    ]  # with none between
    blocks = [f"{names[n]}..{names[n + wide - 1]}" for n in starts or range(len(names) - wide + 1)]
    shown = (blocks[-1], *blocks[:-1][:2])
    if len(blocks) == 1 and len(clues.expected) == 1 and not names[0].startswith("column "):
        shown = tuple(dict.fromkeys((*by_neighbours(clues, names[-wide:]), *blocks)))
    clues.ask(
        "readings",
        f"{why}: which {wide} are the readings of the strips in their order (else name all, with commas)?",
        *shown,
        of_form=all(n.startswith("column ") for n in names),  # only the user knows what other names number
    )
    return names[-wide:]


def by_neighbours(clues: Clues, names: list[str]) -> tuple[str, str]:
    """Return the order in which columns of one reading for each strip probably lie, and its reverse, as answers."""
    values = np.array([[np.nan if v is None else v for v in clues.values(n)] for n in names]).T[:, :, None]
    values[values <= noise(values)] = np.nan
    order = order_of_neighbours(values)
    if sorted((order, order[::-1]))[0] == [*range(len(order))]:
        return f"{names[0]}..{names[-1]}", f"{names[-1]}..{names[0]}"
    return ",".join(names[n] for n in order), ",".join(names[n] for n in order[::-1])


def _parts(answer: str, names: Sequence[str]) -> list[str]:
    """Return what stands between the commas of an answer, but for those within columns' names."""
    parts: list[str] = []
    for piece in answer.split(","):
        whole = f"{parts[-1]},{piece}" if parts else ""
        if parts and parts[-1] not in names and any(n.startswith(whole) for n in names):
            parts[-1] = whole
        else:
            parts.append(piece)
    return [part.strip() if part not in names else part for part in parts]


def answered_block(clues: Clues) -> list[str]:
    """Return the columns of the answer "readings": from one to another, perhaps backwards, or as they are named."""
    answer, names = clues.answers["readings"], clues.table.names
    block: list[str] = []
    for part in _parts(answer, names):
        first, dots, last = part.partition("..")
        if first not in names or (dots and last not in names):
            raise OptionError(
                f"--answer readings={answer}: {part!r} is no column; name the first and the last, as in "
                f"{names[0]}..{names[-1]}, or all in the strips' order, with commas between them"
            )
        from_, to = names.index(first), names.index(last if dots else first)
        block += names[from_ : to + 1] if to >= from_ else names[to : from_ + 1][::-1]
    wide = clues.sensor.strips * len(clues.expected) if clues.sensor else len(block)
    if len(block) != wide:
        raise OptionError(
            f"--answer readings={answer}: these are {len(block)} columns, and the sensor has {wide} readings"
        )
    return block


def readings_of_block(
    clues: Clues, block: list[str], known: dict[str, Meaning], which: str
) -> dict[str, Meaning]:
    """Return columns as the readings of the strips in their order, h and l as the readings allow."""
    channels = 1 if which else max(len(clues.expected), 1)
    clues.counted = True
    strips = len(block) // channels
    answer = clues.choice("strip_order", STRIP_ORDERS)
    told, line = strips_order_said(clues.table.preamble, strips)
    if told == "?" and not answer:
        clues.ask(
            "strip_order",
            f"a line above the columns, which have no names, says {line.strip()[:80]!r}: does the first strip stand "
            "first (ascending), or the last (descending)?",
            *STRIP_ORDERS,
        )
    elif told and not answer:
        answer = told
        end = "first" if told == "ascending" else "last"
        clues.because(f"the {end} strip's columns stand first, as the log says: {line.strip()[:80]!r}")
    order, low_first = "", False
    if channels == 2:
        said = (*clues.table.preamble, *clues.table.constants())
        low_first = order_said(said) == "lh"
        order, low_first = order_of_ends(
            clues, block, f"{block[0]} to {block[-1]} are two for each strip", low_first
        )
    at = [
        (n, 0) if channels == 1 else divmod(n, 2) if order == "alternating" else (n % strips, n // strips)
        for n in range(len(block))
    ]
    at = [(strip, 1 - end) for strip, end in at] if low_first else at
    clues.descending = answer == "descending"
    return {
        name: Meaning(
            "reading", "" if which or not clues.expected else clues.expected[end], strip, known[name].unit
        )
        for name, (strip, end) in zip(block, at, strict=True)
    }

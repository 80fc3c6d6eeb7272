"""Which columns are of the high end of the strips, and which of the low one: by names, and k_h is never below k_l."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.contents import comes_again
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import (
    CHANNELS,
    IN_VOLTS,
    Meaning,
    end_beside,
    meanings,
    numbered_groups,
    pair_of,
)
from tacstrip.io.log_import.questions import Clues, Question, Unanswered
from tacstrip.io.log_import.scans import LogScan
from tacstrip.io.log_import.statements import in_blocks_said, told_channels, wired_ends
from tacstrip.io.log_import.table import ContradictionError

FROM_VREF = "from_vref"
# Answers: columns, nothing, or readings that are measured from Vref down.
EXCHANGED = ("yes", "no", FROM_VREF)
_ABOVE = 0.95  # of the strips: k_h is above k_l there, and so the names are clear
_ENDS = 2  # of a strip
_APART = 0.004  # over the largest reading: by which k_h and k_l differ, in the median
_SAME_SIGN, _LEAST_APART = 0.99, 0.001  # of the strips; over the largest reading, in the median
_OFTEN = 0.2  # of the readings
_PAIRS_TOLD = 20  # pairs of readings that tell in which order columns stand
_ALONE = 0.9  # of the readings of one end: so many have the other beside them
_REST, _GAP = 0.05, 5.0  # of the largest reading: the most of noise; and times that: where readings begin
_BELOW = 0.02  # of the largest reading: v_h below v_l by more is no noise
_STRAYS = 2  # such readings, of which each may be a lost digit
_LOST = 0.02  # of the touched strips: so many may lack one reading by chance
_STRIPS_OFF = 4  # touched strips for each wire that may be off
_ALIKE = 0.02  # relative: two columns that are the same quantity in two units


def in_one_unit(clues: Clues, readings: dict[str, Meaning]) -> dict[str, Meaning]:
    """Return readings without those that say the same again in another unit, such as codes beside volts."""
    groups: dict[str, dict[tuple[int | None, str], str]] = {}
    for name, m in readings.items():
        groups.setdefault(m.unit or ("V" if m.volts else ""), {})[m.strip, m.channel] = name
    if len(groups) != 2 or sum(map(len, groups.values())) < len(readings):
        return readings
    (one, first), (other, second) = groups.items()
    if set(first) != set(second):
        return readings
    for key, name in first.items():
        a, b = (np.array([np.nan if v is None else v for v in clues.values(n)]) for n in (name, second[key]))
        told = np.isfinite(a) & np.isfinite(b) & (np.abs(b) > 0.1 * np.nanmax(np.abs(b), initial=0.0))
        ratio = a[told] / b[told]
        if len(ratio) and np.ptp(ratio) > _ALIKE * abs(float(np.median(ratio))):
            return readings
    volts = first if one in IN_VOLTS else second if other in IN_VOLTS else first
    out = second if volts is first else first
    clues.because(f"{next(iter(out.values()))}: the same readings again in another unit; passed over")
    return {n: m for n, m in readings.items() if n in volts.values()}


def _ask_for_twice(
    clues: Clues, readings: dict[str, Meaning], chosen: dict[str, str], which: str, expected: tuple[str, ...]
) -> None:
    """Ask which of columns that are of one channel of a strip is meant, or of which sensor, and stop."""
    many = Counter((m.strip, chosen[n]) for n, m in readings.items())
    twice = [n for n, m in readings.items() if many[m.strip, chosen[n]] > 1]
    key = (readings[twice[0]].strip, chosen[twice[0]])
    alike = [n for n in twice if (readings[n].strip, chosen[n]) == key]
    names, wide = list(readings), len(readings) // len(alike)
    blocks = [names[n : n + wide] for n in range(0, len(names), wide)]
    keys = [[(readings[n].strip or 0, chosen[n]) for n in block] for block in blocks]
    whole = all(block == sorted({*block}) for block in keys)  # as an answer of columns is read
    if whole and not which and clues.sensor and wide == clues.sensor.strips * len(expected):
        clues.ask(
            "readings", f"columns are of {len(blocks)} sensors, and the spec describes one: of which?",
            *(f"{b[0]}..{b[-1]}" for b in blocks),
        )  # fmt: skip
        clues.stop()
    clues.ask(
        alike[1], f"{alike[0]!r} and {alike[1]!r} look like the same channel of a strip: which is it?",
        "skip", *(expected if len(expected) > 1 else ()),
    )  # fmt: skip
    clues.stop()


def _ask_for_each(clues: Clues, readings: dict[str, Meaning]) -> dict[str, str]:
    """Ask of each column that no name says an end of what it is, and stop."""
    for odd in [n for n, m in readings.items() if m.channel not in ("h", "l")]:
        if len(fields := {*clues.table.column(odd)}) == _ENDS and all(number_of(f) is None for f in fields):
            shown = " and ".join(map(repr, sorted(fields)))
            clues.ask(odd, f"{odd!r} is {shown}: does it say which end a line is of?", "which", "skip")
            continue
        clues.ask(odd, f"is {odd!r} v_h, v_l, or neither?", "h", "l", "skip", *strip_too(clues, odd))
    clues.stop()
    return dict.fromkeys(readings, "h")


def _without_states(clues: Clues, readings: dict[str, Meaning]) -> dict[str, Meaning]:
    """Return readings without columns that never change, such as digital outputs, beside one of each strip."""
    groups = [{*g.values()} & {*readings} for g in numbered_groups(list(readings))]
    whole = [g for g in groups if clues.sensor and len(g) == clues.sensor.strips]
    others = {*readings}.difference(*whole)
    if (
        len(whole) != 1
        or clues.expected != ("out",)
        or any(len({*clues.table.column(n)}) > 1 for n in others)
    ):
        return readings
    return {n: m for n, m in readings.items() if n in whole[0]}


def ends_of_columns(
    clues: Clues, readings: dict[str, Meaning], which: str, left: list[str]
) -> tuple[dict[str, str], bool]:
    """Return column -> what it is, and whether the readings must tell the ends (`ends_of`)."""
    readings = _without_states(clues, readings)
    kinds = {m.channel for m in readings.values()}
    per_strip = Counter(m.strip for m in readings.values())
    expected = clues.expected or (("h", "l") if kinds & {"h", "l"} or len(kinds) == 2 or which else ("out",))
    paired = False
    if which:
        chosen = dict.fromkeys(readings, "h")
    elif expected == ("out",):
        if kinds & {"h", "l"} and max(per_strip.values()) == 1 and len(kinds) == 1:
            name = next(iter(readings))
            clues.ask(
                name,
                f"{name!r} looks like one of two channels, and the sensor has one output: is it that?",
                "out",
            )
        chosen = dict.fromkeys(readings, "out")
    elif len(kinds) == 2 and (lack := end_beside(kinds)):
        chosen = {n: m.channel if m.channel in ("h", "l") else lack for n, m in readings.items()}
    elif kinds <= {"h", "l"}:
        chosen = {n: m.channel for n, m in readings.items()}
        if len(kinds) == 1 and clues.expected == ("h", "l") and left:
            lack = "l" if kinds == {"h"} else "h"
            clues.ask(left[0], f"no name says v_{lack}: is it {left[0]!r}?", lack, "skip")
    elif len(kinds) == 2 and (pair := pair_of(kinds)):
        chosen = {n: "h" if m.channel == pair[0] else "l" for n, m in readings.items()}
        paired = True
    elif len(kinds) == 1 and len(expected) == 2:
        numbers = sorted(s for s in per_strip if s is not None)
        if clues.sensor and len(numbers) == 2 * clues.sensor.strips:
            return _numbered(clues, readings, numbers), False
        name = next(iter(readings))
        clues.ask(
            name,
            f"there is one reading for each strip, and the sensor has two: is {name!r} v_h or v_l?",
            "h",
            "l",
            of_form=True,
        )
        chosen = dict.fromkeys(readings, "h")
    else:
        chosen = _ask_for_each(clues, readings)
    many = Counter((m.strip, chosen[n]) for n, m in readings.items())
    if any(n > 1 for n in many.values()):
        _ask_for_twice(clues, readings, chosen, which, expected)
    for channel in CHANNELS:
        if names := [n for n in readings if chosen[n] == channel and not paired and not which]:
            clues.because(f"{names[0]}{' ... ' + names[-1] if len(names) > 1 else ''}: v_{channel}")
    return {
        n: chosen[n] if m.strip is None else f"{m.strip}:{chosen[n]}" for n, m in readings.items()
    }, paired


def strip_too(clues: Clues, name: str) -> tuple[str, ...]:
    """Return the answer that a column is the strip, if it may be: whole numbers that come again, one for each strip."""
    values = clues.values(name)
    few = len({*values}) == clues.sensor.strips if clues.sensor else comes_again(values)
    whole = all(v is not None and v % 1.0 == 0.0 for v in values)
    taken = any(m.role == "strip" for n, m in meanings(clues.table.names).items() if n not in clues.answers)
    return ("strip",) if whole and few and len(values) > len({*values}) and not taken else ()


def _numbered(clues: Clues, readings: dict[str, Meaning], numbers: list[int]) -> dict[str, str]:
    """Take 2 n numbered inputs as h and l of n strips, in the order that the readings allow."""
    assert clues.sensor is not None
    many = clues.sensor.strips
    wired = wired_ends(list(readings), clues.table.preamble)
    for base in (0, 1):
        if {(strip - base, end) for strip, end in wired.values()} == {
            (n, e) for n in range(many) for e in "hl"
        }:
            clues.because("columns are of the strips and ends that the lines above them say")
            return {name: f"{strip}:{end}" for name, (strip, end) in wired.items()}
    by_number = {m.strip: n for n, m in readings.items()}
    names = [by_number[i] for i in numbers]
    order, low_first = order_of_ends(clues, names, f"{names[0]} to {names[-1]} are two for each strip")
    clues.counted = True
    at = [(n // 2, n % 2) if order == "alternating" else (n % many, n // many) for n in range(2 * many)]
    made = {name: (strip, "hl"[end != low_first]) for name, (strip, end) in zip(names, at, strict=True)}
    if not any(all(made[n] == (s - base, e) for n, (s, e) in wired.items()) for base in (0, 1)):
        raise ContradictionError(
            f"lines above the columns say of which strip and end {', '.join(wired)} are, and not so of each: name the "
            "columns so, as S0_high, S0_low, ..."
        )
    return {name: f"{strip}:{end}" for name, (strip, end) in made.items()}


def order_of_ends(clues: Clues, names: list[str], said: str, low_first: bool = False) -> tuple[str, bool]:
    """Return in which order columns of h and l stand, and whether l is first: as k_h is the larger, if only one is."""
    if answer := clues.choice("order", ("alternating", "blocks")):
        return answer, low_first
    fields = [
        [np.nan if says_nothing(f) else number_of(f, clues.table.decimal) for f in clues.table.column(n)]
        for n in names
    ]
    table = np.array([[np.nan if v is None else v for v in column] for column in fields]).T
    large = float(np.nanmax(table, initial=0.0))
    table[table < -_REST * large] = np.nan
    table[table < 0.0] = 0.0  # an offset, or -1 among codes
    many = Counter(table[np.isfinite(table)].tolist())
    if many and many[top := max(many)] > max(
        _OFTEN * many.total(), 2
    ):  # full scale stands for no contact, too
        table[table == top] = 0.0
    if below := noise(table):
        table[table <= below] = 0.0
    half = len(names) // 2
    if told := next(filter(None, (told_channels(line, half) for line in clues.table.preamble)), ""):
        clues.because(f"columns are {told}, as the log says above them")
        return told, low_first
    if in_blocks_said(clues.table.preamble):
        clues.because("columns are blocks, as the log says above them")
        return "blocks", low_first
    ways = {"alternating": (table[:, 0::2], table[:, 1::2]), "blocks": (table[:, :half], table[:, half:])}
    ways = {way: (b, a) if low_first else (a, b) for way, (a, b) in ways.items()}
    holds = _ways_that_hold(ways)
    if len(holds) == 1:
        clues.because(f"columns are {holds[0]}: only so is k_h above k_l everywhere, as it must be")
        return holds[0], low_first
    wrong = all(_part_below(high, low) > _OFTEN for high, low in ways.values())
    if wrong and len(holds := _ways_that_hold({way: ends[::-1] for way, ends in ways.items()})) == 1:
        first = "high" if low_first else "low"
        clues.because(
            f"columns are {holds[0]}, {first} first: only so is k_h above k_l everywhere, as it must be"
        )
        return holds[0], not low_first
    clues.ask(
        "order",
        f"{said}: h, l, h, l, ... (alternating), or all h and then all l (blocks)?",
        "alternating",
        "blocks",
    )
    return "alternating", low_first


def _ways_that_hold(ways: Mapping[str, tuple[FloatArray, FloatArray]]) -> list[str]:
    """Return in which orders of columns k_h is above k_l: everywhere, or, of one order only, but for few pairs."""
    # Where one channel says that nothing touches, the other does.
    holds = [
        way
        for way, (high, low) in ways.items()
        if above(high, low)
        and (np.isnan(high) == np.isnan(low)).all()
        and ((high == 0.0) == (low == 0.0)).all()
    ]
    if not holds:
        wrong = {way: _part_below(high, low) for way, (high, low) in ways.items()}
        good, bad = sorted(wrong, key=lambda way: wrong[way])
        if wrong[good] == 0.0 and wrong[bad] > _OFTEN:
            holds = [good]
    return holds


def _part_below(high: FloatArray, low: FloatArray) -> float:
    """Return in which part of the readings h is below l, as none can be; 1 where mostly one of both is there alone."""
    there = [np.isfinite(end) & (end != 0.0) for end in (high, low)]
    both = there[0] & there[1]
    if both.sum() < _ALONE * max(there[0].sum(), there[1].sum()) or both.sum() < _PAIRS_TOLD:
        return 1.0
    apart = (high - low)[both]
    return float((apart < -_APART * np.nanmax(high)).mean()) if np.median(apart) > 0.0 else 1.0


def noise(table: FloatArray) -> float:
    """Return the most that the noise of untouched strips reaches, where a gap parts it from the readings; else 0."""
    values = np.unique(table[np.isfinite(table)])
    low = values[values < _REST * values.max(initial=0.0)]
    high = values[len(low) :]
    return float(low[-1]) if len(low) and len(high) and high[0] > _GAP * low[-1] else 0.0


def above(high: FloatArray, low: FloatArray) -> bool:
    """Return whether one of two channels is the larger nearly everywhere, and clearly so in the median.

    By less than that, if it is on many strips and hardly ever the smaller: no noise has always the same sign.
    """
    apart = (high - low)[
        np.isfinite(high - low) & ((high != 0.0) | (low != 0.0))
    ]  # both are 0 where nothing touches
    if len(apart) < 2:
        return False
    scale = float(np.nanmax(np.abs(np.stack([high, low]))))
    middle = np.median(apart)
    if len(apart) >= _PAIRS_TOLD and (apart > 0.0).mean() >= _SAME_SIGN and middle > _LEAST_APART * scale:
        return True
    return bool((apart >= -_APART * scale).mean() >= _ABOVE and middle > _APART * scale)


def ends_exchanged(scans: Sequence[LogScan], mapping: ColumnMapping, answer: str | None) -> list[str]:
    """Return a warning where v_h is below v_l beyond noise, on a stray strip or, if the answer is "no", on more.

    Parameters
    ----------
    scans, mapping
        Of a log.
    answer
        To the question whether ends are exchanged, "" where it was not given; None where none is taken.

    Raises
    ------
    Unanswered
        It is on more: nothing tells which channel is which there.
    """
    if mapping.channels != ("h", "l") or not scans:
        return []
    apart = np.stack([scan.values[:, 0] - scan.values[:, 1] for scan in scans])
    apart = -apart if mapping.from_vref else apart
    top = max(float(np.nanmax(scan.values, initial=0.0)) for scan in scans)
    wrong = np.argwhere(apart < -_BELOW * top)
    if not len(wrong):
        return []
    scan, strip = wrong[0]
    more = f", and {len(wrong) - 1} time(s) more" if len(wrong) > 1 else ""
    text = (
        f"v_h is below v_l on strip {strip + mapping.strip_base} of the scan from line {scans[scan].line}{more}: no "
        "sensor reads so; is a digit lost, are columns exchanged, or readings measured from Vref down?"
    )
    if len(wrong) <= _STRAYS or answer == "no":
        return [text]
    yes, no, down = EXCHANGED
    mends = bool((-apart < -_BELOW * top).sum() <= _STRAYS)
    mended = [yes] * (mends and not mapping.which) + [down] * (mends and answer != down)
    choices = () if answer is None else (*mended, no)  # a mapping takes no answer
    raise Unanswered(
        Question("exchanged", f"{text} Mend the log, or answer no to take it as it stands", choices)
    )


def refuse_split_ends(scans: Sequence[LogScan], left_out: int = 0) -> None:
    """Refuse scans in which strips have one reading of two as no wires that are off, or readings that are lost, do it.

    Columns that are taken for those of other strips or ends give readings where nothing touches the other end.

    Parameters
    ----------
    scans
        Of a log.
    left_out
        How many channels the spec leaves out.

    Raises
    ------
    ReadingError
        Others than few channels lack readings where the strip's other channel has one, and more than seldom.
    """
    there = np.isfinite(np.stack([scan.values for scan in scans]))  # (scans, strips, channels)
    lacks = np.sort((~there & there.any(axis=2, keepdims=True)).sum(axis=0).ravel())
    off = left_out + max(1, int(there.any(axis=(0, 2)).sum()) // _STRIPS_OFF)
    if lacks[:-off].sum() > _LOST * there.any(axis=2).sum():
        raise ReadingError(
            f"on {np.count_nonzero(lacks)} channels readings are missing where the strip's other channel has one: are "
            "the columns of other strips or ends? If these wires are off, write the channels into the spec: "
            'without = ["3:v_h", ...]'
        )

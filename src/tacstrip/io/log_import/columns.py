"""Which column is time, scan, strip or reading: by its name, and by what it holds where names say nothing."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.changes import ask_which_part
from tacstrip.io.log_import.fields import clock_seconds, is_date, number_of, says_nothing
from tacstrip.io.log_import.names import (
    CHANNELS,
    IN_VOLTS,
    LENGTHS_MM,
    TIME_UNITS,
    Meaning,
    meaning,
    meanings,
    numbered_groups,
    pair_of,
)
from tacstrip.io.log_import.questions import ROLES, Clues
from tacstrip.io.log_import.statements import in_blocks_said, order_said, strips_order_said, told_channels
from tacstrip.io.log_import.table import CLOCK, PART, ROW

_ABOVE = 0.95  # of the strips: k_h is above k_l there, and so the names are clear
_ENDS = 2  # of a strip
_APART = 0.004  # over the largest reading: by which k_h and k_l differ, in the median
CLOCK_BITS = (16, 32)
_AS_LONG, _LATE_S = (
    0.25,
    0.1,
)  # so far, and s, two clocks may differ, of which one is read when a line has come
_ON_PITCH = 0.02  # of the pitch
_STEADY, _MOSTLY = 0.5, 0.7  # so far are steps of a clock from the usual one, and so many of them
_OFTEN = 0.2  # of the readings
_PAIRS_TOLD = 20  # pairs of readings that tell in which order columns stand
_STEADY = 0.1  # of its largest value: a supply's voltage moves by no more
_ALONE = 0.9  # of the readings of one end: so many have the other beside them
_REST, _GAP = 0.05, 5.0  # of the largest reading: the most of noise; and times that: where readings begin
_MOST_ASKED = 6  # columns, of each of which is asked what it is
_FEW_WORDS = 2  # among numbers: one may stand for no contact, which is asked
_ALIKE = 0.02  # relative: two columns that are the same quantity in two units
# What a column may be that holds something made of readings, or what is measured beside them.
_DERIVED = frozenset(
    {"mid", "middle", "center", "centre", "mitte", "width", "breite", "span", "mean", "avg", "average", "sum", "total"}
    | {"diff", "difference", "delta", "std", "var", "gain", "offset", "force", "pressure", "temp", "temperature"}
    | {"current", "resistance", "area", "load", "gap", "product", "error"}
)  # fmt: skip
_SENSORS = frozenset(
    {"pad", "hand", "finger", "board", "device", "skin", "patch", "module", "gripper", "arm", "side"}
)
# What names the sender of a line or message, or its kind.
_SOURCES = frozenset(
    {"topic", "source", "src", "sender", "node", "frame", "host", "hostname", "addr", "address", "mac", "ip", "port"}
    | {"origin", "link", "robot", "publisher", "client", "uuid", "serial", "quelle", "knoten", "capteur", "sensor"}
)  # fmt: skip
_SIZES = frozenset({"len", "length", "size", "bytes", "count", "crc", "checksum"})  # of a sender's frames
_MOST_SENSORS, _FEW_COUNTED = 12, 2
_LOGIC = re.compile("[LH]+")  # levels of logic inputs, as loggers write them
_ROLE_NAMES = {"scan": "scan's number", "strip": "strip's number", "which": "channel's name"}


@dataclass(frozen=True)
class Columns:
    """What the columns are.

    Attributes
    ----------
    readings
        Column -> what it is, as of `ColumnMapping.columns`.
    meanings
        Of all columns.
    time, scan, strip, which
        Their names; "" where there is none.
    paired
        Whether no name tells which of two channels is v_h.
    strip_step
        From strip to strip, where the column of the strip says where it lies; else 0.
    numbered
        Whether the log gives strips numbers of their own; else they are counted here, from 0.
    """

    readings: dict[str, str]
    meanings: dict[str, Meaning] = field(repr=False)
    time: str = ""
    scan: str = ""
    strip: str = ""
    which: str = ""
    paired: bool = False
    strip_step: float = 0.0
    numbered: bool = True


def find_columns(clues: Clues) -> Columns:
    """Say what each column is; raises `Unanswered` where no readings can be found without an answer."""
    known = _meanings(clues)
    ask_which_part(clues)
    _ask_for_sensor(clues, known)
    found = _find(clues, known)
    used = {*found.readings, found.time, found.scan, found.strip, found.which, ROW, PART}
    if passed := [n for n in clues.table.names if n not in used]:
        clues.because(f"passed over: {', '.join(passed)}")
        _refuse_lost(clues, known, found, passed)
    return found


def _refuse_lost(clues: Clues, known: dict[str, Meaning], found: Columns, passed: list[str]) -> None:
    """Refuse what would pass over more readings than it takes; warn where the answers say so.

    Columns that are named as one that is taken but for a number are scans or strips, whatever the answers say.
    """
    if "readings" in clues.answers:
        return
    before = meanings(clues.table.names)
    alike = {
        n for g in numbered_groups(clues.table.names) if {*g.values()} & {*found.readings} for n in g.values()
    }
    lost = [n for n in passed if (before[n].role == "reading" or n in alike) and _numeric(clues, n)]
    many = [sum(v is not None for n in names for v in clues.values(n)) for names in (lost, found.readings)]
    if many[0] <= many[1] or len(lost) <= len(found.readings):
        return
    shown = ", ".join(lost[:_MOST_ASKED]) + (", ..." if len(lost) > _MOST_ASKED else "")
    text = f"{shown}: passed over, with {many[0]} numbers, and readings are taken from {many[1]}"
    if all(n in clues.answers for n in lost) and not alike & {*lost}:
        clues.doubt(text)
        return
    raise ReadingError(
        f"{text}: are these scans, or strips? Save the log with a line per scan or per strip, without columns that are "
        "no readings; or name those that are: --answer readings=FIRST..LAST"
    )


def _ask_for_sensor(clues: Clues, known: dict[str, Meaning]) -> None:
    """Ask which sensor's lines are meant, where a column names several: "pad", or one that tells equal lines apart."""
    table = clues.table
    one = {m.channel for m in known.values() if m.role == "reading"}
    single = clues.expected == ("out",) or {"h", "l"} <= one or bool(len(one) == 2 and pair_of(one))
    named = {n for n, m in known.items() if m.role in ("time", "scan", "strip") and n != CLOCK}
    numbered = any(m.role == "strip" or m.strip is not None for m in known.values())
    of = [n for n in table.names if n in named]
    keys = list(zip(*(table.column(n) for n in of), strict=True)) if of else []
    when = list(zip(*(table.column(n) for n in of if known[n].role != "strip"), strict=True))
    read = [table.places[n] for n, m in known.items() if m.role == "reading"]
    holds = [
        any(row[p] for p in read) for row in table.rows
    ]  # else lines of another device, which is no choice
    for name in table.names:
        fields = table.column(name)
        values = sorted({f for f, there in zip(fields, holds, strict=True) if there or not read})
        worded = not any(number_of(v) is not None for v in values)
        if (
            known[name].role in ("time", "strip", "position", "skip") or (known[name].role == "scan" and not worded)
            or name in (*clues.answers, ROW, CLOCK, PART)
            or not 1 < len(values) <= _MOST_SENSORS or not all(values) or {*values} & {*ROLES}
            or (known[name].role == "reading" and known[name].strip is not None)
            or all(clock_seconds(v) is not None or is_date(v) for v in values)
            or _counts_scans(fields, when)
        ):  # fmt: skip
            continue
        each = Counter(zip(keys, fields, strict=True)) if keys else Counter()
        apart = (
            bool(each) and set(each.values()) == {1} and len(each) >= _ALONE * len(values) * len(set(keys))
        )
        words = set(re.findall(r"[a-z]+", name.casefold()))
        called = _SENSORS & words or (_SOURCES & words and meaning(name).role != "strip")
        called = called and not _SIZES & words
        if single and numbered and (called or (worded and (apart or _in_turns(fields)))):
            lines = [table.lines[fields.index(v)] for v in values[:2]]
            clues.ask(
                name,
                f"{name!r} is {values[0]!r} on line {lines[0]} and {values[1]!r} on line {lines[1]}: are these of "
                f"{len(values)} sensors? Then which one's lines are meant",
                *values, *([] if apart else ["skip"]),
            )  # fmt: skip
            clues.stop()


def _counts_scans(fields: list[str], when: list[tuple[str, ...]]) -> bool:
    """Return whether numbers rise from scan to scan, never to come again: no sensors are called so."""
    runs = [number_of(value) for value, _ in itertools.groupby(fields)]
    rising = all(a is not None and b is not None and a < b for a, b in itertools.pairwise(runs))
    scans = {*zip(fields, when, strict=True)} if when else set()
    return len(runs) > _FEW_COUNTED and rising and len(scans) == len({*fields})


def _in_turns(fields: list[str]) -> bool:
    """Return whether a few words come in turn, again and again, as of senders that take turns."""
    turn = len({*fields})
    return len(fields) > 2 * turn and all(a == b for a, b in zip(fields, fields[turn:], strict=False))


def _meanings(clues: Clues) -> dict[str, Meaning]:
    table = clues.table
    named = table.named or any(name in clues.answers for name in (*table.names, "readings"))
    found = meanings(table.names) if named else _unnamed(clues)
    strips = {m.strip for m in found.values() if m.role == "reading"} - {None}
    if clues.sensor and strips == {*range(clues.sensor.strips + 1)}:
        extra = [n for n, m in found.items() if m.strip == 0 and not re.search(r"\d", n)]
        found |= {n: Meaning("") for n in extra}  # as the supply, "voltage" beside "voltage1" and so on
        for name in extra:
            read = [v for v in map(number_of, table.column(name)) if v is not None]
            if read and max(read) - min(read) > _STEADY * max(read):
                clues.doubt(
                    f"{name} is passed over, for columns 1 to {clues.sensor.strips} are one for each of the spec's "
                    "strips; but it moves as a reading does: is it a strip, and strips in the spec one too few?"
                )
    found |= {
        n: Meaning("") for n, m in found.items()
        if m.role == "reading" and (all(map(_LOGIC.fullmatch, table.column(n))) or _is_clock(table.column(n)))
    }  # fmt: skip
    before = dict(found)
    for name in table.names:
        if name in (CLOCK, ROW):
            kept = found[name] if found[name].role == "which" else Meaning("")
            found[name] = Meaning("time", unit="clock") if name == CLOCK else kept
        answer = clues.answers.get(name, "")
        if answer in ("", name) and name not in clues.answers:
            continue
        strip, _, channel = answer.rpartition(":")
        reading = channel in CHANNELS
        unit = found[name].unit
        found[name] = Meaning(
            "reading" if reading else answer, channel if reading else "",
            int(strip) if strip else before[name].strip if reading else None, unit,
        )  # fmt: skip
        counted = next((g for g in numbered_groups(table.names) if name in g.values()), {})
        if (
            before[name].role == "" and not strip and answer in (*CHANNELS, "skip")
        ):  # as does that of unknown ones
            alike = {n: i for i, n in counted.items() if before[n].role == "" and n not in clues.answers}
            found |= {
                n: replace(found[name], strip=i, unit=before[n].unit) if reading else Meaning("skip")
                for n, i in alike.items()
            }  # fmt: skip
            if reading and counted:
                number = next(i for i, n in counted.items() if n == name)
                found[name] = replace(found[name], strip=number)
        if reading and not strip and before[name].strip is not None:  # it holds for all columns of its kind
            found |= {
                n: replace(m, channel=channel) for n, m in before.items()
                if m.role == "reading" and m.channel == before[name].channel and n not in clues.answers
            }  # fmt: skip
    return found


def _find(clues: Clues, known: dict[str, Meaning]) -> Columns:
    given = {name: clues.answers[name] for name in clues.table.names if name in clues.answers}
    which = _which(clues, known)
    known = {n: Meaning("which") if n == which else m for n, m in known.items()}
    time = _time(clues, known)
    scan = _scan(clues, known, time)
    wide = [n for n, m in known.items() if m.role == "reading" and m.strip is not None]
    strip, step = _strip(clues, known, which, wide)
    scan = "" if scan == strip else scan
    readings = {n: m for n, m in known.items() if m.role == "reading" and n != strip}
    if strip:  # a number in a name is then of a channel
        readings = {
            n: replace(m, strip=None, channel=m.channel or ("" if m.strip is None else str(m.strip)))
            for n, m in readings.items()
        }
    elif wide:
        readings = {n: m for n, m in readings.items() if m.strip is not None}
    if "readings" in clues.answers:
        readings = _of_block(clues, _answered_block(clues), known, which)
    if not readings and not strip:
        readings = _by_number(clues, known, {time, scan, which})
    if not readings:
        readings = _by_contents(clues, known, {time, scan, strip, which}, given)
    if not strip and all(m.strip is None for m in readings.values()):
        some = [n for n in clues.table.names if n not in {*readings, time, scan, which} and _labels(clues, n)]
        text = "no column says which strip a line is of"
        if not some:
            raise ReadingError(f"{text}; add one with its number")
        clues.ask(some[0], f"{text}: is it this one? Say it of the right one", "strip")
        strip = some[0]
    readings = _one_unit(clues, _with_other_end(clues, known, readings, {time, scan, which}))
    for role, name in (("time", time), ("scan", scan if strip else ""), ("strip", strip), ("which", which)):
        if name:
            clues.because(f"{name}: the {_ROLE_NAMES.get(role, role)}")
    used = {*readings, time, scan, strip, which}
    left = [
        n
        for n, m in known.items()
        if n not in used and m.role in ("", "reading") and _numeric(clues, n) and n != ROW
    ]
    left = [n for n in left if strip and n not in clues.answers and len(set(clues.table.column(n))) > 1]
    columns, paired = _channels(clues, readings, which, left)
    indexed = all(re.search(r"\[\d+\]", n) for n in readings)  # places in a list or a matrix
    numbered = strip != ROW if strip else not (indexed or clues.counted)
    return Columns(
        columns, known | readings, time, scan if strip else "", strip, which, paired, step, numbered
    )


# Roles


def _which(clues: Clues, known: dict[str, Meaning]) -> str:
    """Return the column that says of which channel a line is."""
    if answered := [n for n, a in clues.answers.items() if a == "which" and n in known]:
        return answered[0]
    if clues.expected == ("out",):
        return ""
    strips = [n for n, m in known.items() if m.role == "strip"]
    for name, m in known.items():
        fields = set(clues.table.column(name))
        if len(fields) != 2 or name in clues.answers or m.role in ("time", "position"):
            continue
        channels = {meaning(f).channel or f.casefold() for f in fields}
        worded = not any(number_of(f) is not None for f in fields)
        if (worded and (channels == {"h", "l"} or pair_of(channels))) or (
            pair_of(channels) and (m.role == "which" or (m.role == "strip" and len(strips) > 1))
        ):
            return name
    return ""


def _time(clues: Clues, known: dict[str, Meaning]) -> str:
    """Return the column of the time: that which never falls and says the most."""
    there = []
    dated = {n for n, m in known.items() if m.role == "" and n != ROW and _is_clock(clues.table.column(n))}
    for n in [name for name, m in known.items() if m.role == "time" or name in dated]:
        fields = clues.table.column(n)
        numbers = [number_of(f, clues.table.decimal) for f in fields]
        times = numbers if None not in numbers else [clock_seconds(f) for f in fields]
        if None in times:
            if n in clues.answers or (clock_seconds(fields[0]) or numbers[0]) is not None:
                there.append((n, True, 0))
            continue
        falls = any(b < a for a, b in itertools.pairwise(times) if a is not None and b is not None)
        there.append((n, not falls, len(set(times))))
    if (
        not there
        and (clues.table.named or "readings" in clues.answers)
        and not any(m.role == "time" for m in known.values())
    ):
        block = _answered_block(clues) if "readings" in clues.answers else []
        nameless = [
            n
            for n in clues.table.names
            if re.fullmatch(r"column \d+", n) and n not in (*clues.answers, *block)
        ]
        wide = clues.sensor.strips * len(clues.expected) if clues.sensor else 0
        ends = {*nameless[:1], *nameless[-1:]} if len(nameless) != wide else set()  # else all are readings
        if any(m.role == "reading" for m in known.values()):
            ends = {*nameless}
        rising = [n for n in nameless if n in ends and _rises(clues.values(n))]
        for n in sorted(rising, key=lambda n: (_are_whole(clues.values(n)), _counts(clues.values(n))))[:1]:
            clues.because(f"{n}: has no name, and rises from line to line, so it is the time")
            there.append((n, True, len(set(clues.table.column(n)))))
    own = [n for n, rises, _ in there if n != CLOCK and rises]
    for name in [n for n in own if _contradicts_the_stamps(clues, n, known[n].unit)]:
        own.remove(name)
        there = [t for t in there if t[0] != name]
        clues.doubt(
            f"{name}: does not run as the times before the lines do, in no unit, so these are the time (if {name} is: "
            f"--answer {name}=time)"
        )
    if own:  # the device's own clock is better than a monitor's
        there = [t for t in there if t[0] != CLOCK]
    there = [t for t in there if t[2] > 1 or len(clues.table.rows) < 2] or there[:1]
    return max(there, key=lambda t: (t[0] in clues.answers, t[1], t[2]))[0] if there else ""


def _are_whole(values: list[float | None]) -> bool:
    return all(v is None or v == round(v) for v in values)


def _contradicts_the_stamps(clues: Clues, name: str, unit: str) -> bool:
    """Return whether a column of no known unit, such as T, spans in none what the times before the lines do."""
    if unit in TIME_UNITS or CLOCK not in clues.table.names or name in clues.answers:
        return False
    ends = [[clock_seconds(clues.table.column(CLOCK)[n]), clues.values(name)[n]] for n in (0, -1)]
    if any(v is None for row in ends for v in row):
        return False
    (stamp, own) = (float(last) - float(first) for first, last in zip(*ends, strict=True))
    stamp %= TIME_UNITS["days"]
    slack = _AS_LONG * stamp + (_LATE_S if "." in clues.table.column(CLOCK)[0] else 1.0)
    return stamp > slack and own >= 0.0 and not any(abs(own * u - stamp) < slack for u in TIME_UNITS.values())


def _is_clock(fields: list[str]) -> bool:
    return all(number_of(f) is None and clock_seconds(f) is not None for f in fields)


def _scan(clues: Clues, known: dict[str, Meaning], time: str) -> str:
    """Return the column of the scan's number: one that is not another on each line."""
    there = {n: len(set(clues.table.column(n))) for n, m in known.items() if m.role == "scan"}
    there = {
        n: c
        for n, c in there.items()
        if n in clues.answers or all(v is None or v % 1.0 == 0.0 for v in clues.values(n))
    }
    many = len(clues.table.rows)
    fit = {n: count for n, count in there.items() if n in clues.answers or 1 < count < many}
    return max(fit, key=lambda n: (n in clues.answers, fit[n])) if fit else ""


def _strip(clues: Clues, known: dict[str, Meaning], which: str, wide: list[str]) -> tuple[str, float]:
    """Return the column of the strip, and from strip to strip where it says where that lies."""
    there = [n for n, m in known.items() if m.role == "strip" and n != which]
    there = [n for n in there if len(set(clues.table.column(n))) > 1 or n in clues.answers] or there[:1]
    if wide and there and not any(n in clues.answers for n in there):
        one = clues.sensor is not None and clues.sensor.strips == 1
        there = [n for n in there if len(set(clues.table.column(n))) > 1 and not one and len(wide) <= 2]
    if len(there) > 1:
        clues.ask(there[1], f"both {there[0]!r} and {there[1]!r} look like the strip: which is not?", "skip")
    if there:
        return there[0], 0.0
    if wide:
        return "", 0.0
    for name, m in known.items():
        if m.role == "position" and (step := _pitches(clues, name, m.unit)):
            return name, step
    strips = clues.sensor.strips if clues.sensor else 0
    for name in [n for n, m in known.items() if m.role == "" and n != ROW]:
        kinds = meanings(sorted(set(clues.table.column(name))))
        told = {m.strip for m in kinds.values()}
        named = all(m.role == "reading" and m.strip is not None and not m.channel for m in kinds.values())
        if named and len(told) == len(kinds) == strips and not any(number_of(f) is not None for f in kinds):
            clues.because(f"{name}: {strips} names that count, as many as strips, such as {min(kinds)!r}")
            return name, 0.0
    for name in clues.table.names:
        fields = clues.table.column(name)
        if name == ROW and (not strips or len(set(fields)) == strips):
            clues.because("each block has a line for each strip, in their order")
            return name, 0.0
        unknown = known[name].role in ("", "scan", "which") and name not in (ROW, which)
        if unknown and strips > 1 and _cycles(clues.values(name)) and len(set(fields)) == strips:
            clues.because(f"{name}: {strips} whole numbers that come again and again, as many as strips")
            return name, 0.0
    return "", 0.0


def _pitches(clues: Clues, name: str, unit: str) -> float:
    """Return from strip to strip where a column's positions are those of the sensor's strips; else 0."""
    values = clues.values(name)
    if clues.sensor is None or any(v is None for v in values):
        return 0.0
    places = np.unique([v for v in values if v is not None])
    for scale in [LENGTHS_MM[unit]] if unit else LENGTHS_MM.values():
        step = clues.sensor.pitch_mm / scale
        numbers = places / step
        if np.abs(numbers % 1.0 - 0.5).max() < _ON_PITCH:  # the middle of each strip
            numbers = numbers - 0.5
        whole = (
            np.abs(numbers - np.round(numbers)) < _ON_PITCH
        ).all() and numbers.max() - numbers.min() >= 1.0
        if whole and numbers.min() > -0.5 and numbers.max() <= clues.sensor.strips - 0.5:
            clues.because(
                f"{name}: multiples of the pitch, {clues.sensor.pitch_mm:g} mm, so they are the strips"
            )
            return step
    return 0.0


def _by_contents(
    clues: Clues, known: dict[str, Meaning], taken: set[str], given: dict[str, str]
) -> dict[str, Meaning]:
    """Return as readings the columns of numbers that are left, if there are as many as channels; else ask."""
    left = [
        n
        for n, m in known.items()
        if n not in taken
        and n not in given
        and m.role in ("", "which", "position")
        and n != ROW
        and _numeric(clues, n)
    ]
    which = any(known[n].role == "which" for n in taken if n in known)
    many = (1,) if which or clues.expected == ("out",) else (2,) if clues.expected else (1, 2)
    wide = clues.sensor.strips * many[0] if clues.sensor else 0
    some = [n for n, m in known.items() if n not in {*taken, *given, ROW} and m.role not in ("time", "strip")]
    if sum(known[n].role != "scan" for n in some) == wide:
        some = [n for n in some if known[n].role != "scan"]
    some = [n for n in some if _numeric(clues, n) or all(map(says_nothing, clues.table.column(n)))]
    if len(some) >= wide > 1:
        if len(some) == wide and all(re.fullmatch(r"column \d+", n) for n in some):
            clues.because(f"{wide} columns without names are the strips in their order")
            return _of_block(clues, some, known, "")
        block = _ask_for_block(clues, "no name says of which strip a column is", some, wide)
        return _of_block(clues, block, known, "")
    if len(left) in many and taken - {""}:
        if odd := [n for n in left if _DERIVED & set(re.findall(r"[a-z]+", n.lower()))]:
            clues.ask(
                odd[0], f"{odd[0]!r} is called neither a reading nor an end of a strip: which is it? (A middle, a "
                "width or a difference of two ends is no reading)", *(clues.expected or ("h", "l", "out")), "skip",
            )  # fmt: skip
            clues.stop()
        clues.because(f"{' and '.join(left)}: the only numbers that are left, so they are the readings")
        channels = ("1", "2") if len(left) == 2 else ("",)
        return {n: Meaning("reading", c, unit=known[n].unit) for n, c in zip(left, channels, strict=True)}
    shown = ", ".join(clues.table.names[:8]) + (", ..." if len(clues.table.names) > 8 else "")
    text = f"no column's name says that it holds readings (they are: {shown}); say it, of each that does"
    free = [n for n in clues.table.names if n not in {*taken, *given, ROW, CLOCK}]
    for name in (left or free or list(clues.table.names))[-_MOST_ASKED:]:
        clues.ask(name, text, *(clues.expected or ("h", "l", "out")), "skip", *_strip_too(clues, name))
        text = "or of this one"
    clues.stop()
    raise AssertionError


def _ask_for_block(clues: Clues, why: str, names: list[str], wide: int) -> list[str]:
    """Ask which columns are the strips; return the likeliest, with which other questions can be found."""
    at = [clues.table.places[n] for n in names]
    starts = [
        n for n in range(len(names) - wide + 1) if at[n + wide - 1] - at[n] == wide - 1
    ]  # with none between
    blocks = [f"{names[n]}..{names[n + wide - 1]}" for n in starts or range(len(names) - wide + 1)]
    shown = (blocks[-1], *blocks[:-1][:2])
    clues.ask(
        "readings",
        f"{why}: which {wide} are the readings of the strips in their order (else name all, with commas)?",
        *shown,
    )
    return names[-wide:]


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


def _answered_block(clues: Clues) -> list[str]:
    """Return the columns of the answer "readings": from one to another, or in the order in which they are named."""
    answer, names = clues.answers["readings"], clues.table.names
    block: list[str] = []
    for part in _parts(answer, names):
        first, dots, last = part.partition("..")
        if first not in names or (dots and last not in names):
            raise OptionError(
                f"--answer readings={answer}: {part!r} is no column; name the first and the last, as in "
                f"{names[0]}..{names[-1]}, or all in the strips' order, with commas between them"
            )
        block += names[names.index(first) : names.index(last if dots else first) + 1]
    wide = clues.sensor.strips * len(clues.expected) if clues.sensor else len(block)
    if len(block) != wide:
        raise OptionError(
            f"--answer readings={answer}: these are {len(block)} columns, and the sensor has {wide} readings"
        )
    return block


def _of_block(clues: Clues, block: list[str], known: dict[str, Meaning], which: str) -> dict[str, Meaning]:
    """Return columns as the readings of the strips in their order, h and l as the readings allow."""
    channels = 1 if which else max(len(clues.expected), 1)
    clues.counted = True
    strips = len(block) // channels
    answer = clues.choice("strip_order", ("ascending", "descending"))
    told, line = strips_order_said(clues.table.preamble, strips)
    if told == "?" and not answer:
        clues.ask(
            "strip_order",
            f"a line above the columns, which have no names, says {line.strip()[:80]!r}: does the first strip stand "
            "first (ascending), or the last (descending)?",
            "ascending",
            "descending",
        )
    elif told and not answer:
        answer = told
        end = "first" if told == "ascending" else "last"
        clues.because(f"the {end} strip's columns stand first, as the log says: {line.strip()[:80]!r}")
    low_first = channels == 2 and order_said(clues.table.preamble) == "lh"
    order = (
        _order(clues, block, f"{block[0]} to {block[-1]} are two for each strip", low_first)
        if channels == 2
        else ""
    )
    at = [
        (n, 0) if channels == 1 else divmod(n, 2) if order == "alternating" else (n % strips, n // strips)
        for n in range(len(block))
    ]
    at = [(strip, 1 - end) for strip, end in at] if low_first else at
    if answer == "descending":
        at = [(strips - 1 - strip, end) for strip, end in at]
    return {
        name: Meaning(
            "reading", "" if which or not clues.expected else clues.expected[end], strip, known[name].unit
        )
        for name, (strip, end) in zip(block, at, strict=True)
    }


def _by_number(clues: Clues, known: dict[str, Meaning], taken: set[str]) -> dict[str, Meaning]:
    """Return as readings the columns whose names are the same but for a number, if these are as many as strips."""
    groups = [
        group
        for group in numbered_groups(
            [n for n, m in known.items() if n not in taken and m.role in ("", "which")]
        )
        if all(_numeric(clues, n) or all(map(says_nothing, clues.table.column(n))) for n in group.values())
        and any(len(set(clues.table.column(n))) > 1 for n in group.values())
        and (not clues.sensor or len(group) == clues.sensor.strips)
    ]
    if (
        len(groups) not in ((1, 2) if not clues.expected else (len(clues.expected),))
        or len({*map(len, groups)}) != 1
    ):
        return {}
    clues.because(f"{' and '.join(g[min(g)] for g in groups)}, ...: the only names that count as strips do")
    channels = ("1", "2") if len(groups) == 2 else ("",)
    return {
        name: Meaning("reading", channel, number, unit=known[name].unit)
        for channel, group in zip(channels, groups, strict=True)
        for number, name in group.items()
    }


def _with_other_end(
    clues: Clues, known: dict[str, Meaning], readings: dict[str, Meaning], taken: set[str]
) -> dict[str, Meaning]:
    """Return readings of one end with the only other columns that count as these do: R1 beside L1; others are asked."""
    ends = {m.channel for m in readings.values()}
    strips = {m.strip for m in readings.values()}
    if clues.expected != ("h", "l") or len(ends) != 1 or not ends <= {"h", "l"} or None in strips:
        return readings
    left = [n for n, m in known.items() if n not in {*readings, *taken, *clues.answers} and m.role == ""]
    groups = [
        g for g in numbered_groups(left) if {*g} == strips and all(_numeric(clues, n) for n in g.values())
    ]
    groups = [g for g in groups if any(len(set(clues.table.column(n))) > 1 for n in g.values())]
    lack = "l" if ends == {"h"} else "h"
    for group in groups:
        first, one = group[min(group)], next(iter(readings))
        if (
            len(groups) == 1
            and ends == {"l"}
            and re.match(r"[Rr]\W*\d", first)
            and re.match(r"[Ll]\W*\d", one)
        ):
            clues.because(f"{one} and {first}, ...: left and right are the two ends")
            sides = {n: replace(m, channel="left") for n, m in readings.items()}
            return sides | {
                n: Meaning("reading", "right", i, known[n].unit or readings[one].unit)
                for i, n in group.items()
            }
        clues.ask(
            first, f"{first!r}, ... are as many as the strips, as are {one!r}, ... (v_{min(ends)}): are they v_{lack}?",
            lack, "skip",
        )  # fmt: skip
    if groups:
        clues.stop()
    return readings


def _labels(clues: Clues, name: str) -> bool:
    """Return whether a column may say which strip a line is of: a few labels or whole numbers that come again."""
    fields = clues.table.column(name)
    numbers = [v for v in clues.values(name) if v is not None]
    return 1 < len(set(fields)) <= len(fields) // 2 and all(v == int(v) for v in numbers)


def _numeric(clues: Clues, name: str) -> bool:
    fields = [f for f in clues.table.column(name) if not says_nothing(f)]
    words = {f for f in fields if number_of(f, clues.table.decimal) is None}
    numbers = sum(f not in words for f in fields)
    return (
        4 * numbers > len(fields) and len(words) < _FEW_WORDS and not any(re.search(r"\d", f) for f in words)
    )


# Channels


def _one_unit(clues: Clues, readings: dict[str, Meaning]) -> dict[str, Meaning]:
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
        ratio = (a / b)[
            np.isfinite(a) & np.isfinite(b) & (np.abs(b) > 0.1 * np.nanmax(np.abs(b), initial=0.0))
        ]
        if len(ratio) and np.ptp(ratio) > _ALIKE * abs(float(np.median(ratio))):
            return readings
    volts = first if one in IN_VOLTS else second if other in IN_VOLTS else first
    out = second if volts is first else first
    clues.because(f"{next(iter(out.values()))}: the same readings again in another unit; passed over")
    return {n: m for n, m in readings.items() if n in volts.values()}


def _channels(
    clues: Clues, readings: dict[str, Meaning], which: str, left: list[str]
) -> tuple[dict[str, str], bool]:
    """Return column -> what it is, and whether the readings must tell the ends (`ends_of`)."""
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
        )
        chosen = dict.fromkeys(readings, "h")
    else:
        for odd in [n for n, m in readings.items() if m.channel not in ("h", "l")]:
            if len(fields := {*clues.table.column(odd)}) == _ENDS and all(
                number_of(f) is None for f in fields
            ):
                shown = " and ".join(map(repr, sorted(fields)))
                clues.ask(odd, f"{odd!r} is {shown}: does it say which end a line is of?", "which", "skip")
                continue
            clues.ask(odd, f"is {odd!r} v_h, v_l, or neither?", "h", "l", "skip", *_strip_too(clues, odd))
        chosen = dict.fromkeys(readings, "h")
        clues.stop()
    many = Counter((m.strip, chosen[n]) for n, m in readings.items())
    if twice := [n for n, m in readings.items() if many[m.strip, chosen[n]] > 1]:
        key = (readings[twice[0]].strip, chosen[twice[0]])
        alike = [n for n in twice if (readings[n].strip, chosen[n]) == key]
        clues.ask(
            alike[1], f"{alike[0]!r} and {alike[1]!r} look like the same channel of a strip: which is it?",
            "skip", *(expected if len(expected) > 1 else ()),
        )  # fmt: skip
        clues.stop()
    for channel in CHANNELS:
        if names := [n for n in readings if chosen[n] == channel and not paired and not which]:
            clues.because(f"{names[0]}{' ... ' + names[-1] if len(names) > 1 else ''}: v_{channel}")
    return {
        n: chosen[n] if m.strip is None else f"{m.strip}:{chosen[n]}" for n, m in readings.items()
    }, paired


def _strip_too(clues: Clues, name: str) -> tuple[str, ...]:
    """Return the answer that a column is the strip, if it may be: whole numbers that come again, one for each strip."""
    values = clues.values(name)
    few = len({*values}) == clues.sensor.strips if clues.sensor else _cycles(values)
    whole = all(v is not None and v % 1.0 == 0.0 for v in values)
    taken = any(m.role == "strip" for n, m in meanings(clues.table.names).items() if n not in clues.answers)
    return ("strip",) if whole and few and len(values) > len({*values}) and not taken else ()


def _numbered(clues: Clues, readings: dict[str, Meaning], numbers: list[int]) -> dict[str, str]:
    """Take 2 n numbered inputs as h and l of n strips, in the order that the readings allow."""
    assert clues.sensor is not None
    by_number = {m.strip: n for n, m in readings.items()}
    names = [by_number[i] for i in numbers]
    order = _order(clues, names, f"{names[0]} to {names[-1]} are two for each strip")
    many = clues.sensor.strips
    clues.counted = True
    at = [(n // 2, n % 2) if order == "alternating" else (n % many, n // many) for n in range(2 * many)]
    return {name: f"{strip}:{'hl'[end]}" for name, (strip, end) in zip(names, at, strict=True)}


def _order(clues: Clues, names: list[str], said: str, low_first: bool = False) -> str:
    """Return in which order columns of h and l stand: that in which k_h is the larger, if only one is."""
    if answer := clues.choice("order", ("alternating", "blocks")):
        return answer
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
    if below := _noise(table):
        table[table <= below] = 0.0
    half = len(names) // 2
    if told := next(filter(None, (told_channels(line, half) for line in clues.table.preamble)), ""):
        clues.because(f"columns are {told}, as the log says above them")
        return told
    if in_blocks_said(clues.table.preamble):
        clues.because("columns are blocks, as the log says above them")
        return "blocks"
    ways = {"alternating": (table[:, 0::2], table[:, 1::2]), "blocks": (table[:, :half], table[:, half:])}
    ways = {way: (b, a) if low_first else (a, b) for way, (a, b) in ways.items()}
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
    if len(holds) == 1:
        clues.because(f"columns are {holds[0]}: only so is k_h above k_l everywhere, as it must be")
        return holds[0]
    clues.ask(
        "order",
        f"{said}: h, l, h, l, ... (alternating), or all h and then all l (blocks)?",
        "alternating",
        "blocks",
    )
    return "alternating"


def _part_below(high: FloatArray, low: FloatArray) -> float:
    """Return in which part of the readings h is below l, as none can be; 1 where mostly one of both is there alone."""
    there = [np.isfinite(end) & (end != 0.0) for end in (high, low)]
    both = there[0] & there[1]
    if both.sum() < _ALONE * max(there[0].sum(), there[1].sum()) or both.sum() < _PAIRS_TOLD:
        return 1.0
    apart = (high - low)[both]
    return float((apart < -_APART * np.nanmax(high)).mean()) if np.median(apart) > 0.0 else 1.0


def _noise(table: FloatArray) -> float:
    """Return the most that the noise of untouched strips reaches, where a gap parts it from the readings; else 0."""
    values = np.unique(table[np.isfinite(table)])
    low = values[values < _REST * values.max(initial=0.0)]
    high = values[len(low) :]
    return float(low[-1]) if len(low) and len(high) and high[0] > _GAP * low[-1] else 0.0


# Tables without names


def _unnamed(clues: Clues) -> dict[str, Meaning]:
    """Say what the columns of a table without names are, from their number and how they rise."""
    sensor, names = clues.sensor, [n for n in clues.table.names if n not in (CLOCK, ROW, PART)]
    found = {n: Meaning("") for n in clues.table.names}
    labels = [n for n in names if not n.startswith("column ")]  # of lines between blocks
    found |= {n: meaning(n) for n in labels}
    texts = {n: set(clues.table.column(n)) for n in names}
    which = [n for n in names if {meaning(f).channel for f in texts[n]} == {"h", "l"} and len(texts[n]) == 2]
    if sensor and not which and len(names) - len(labels) == sensor.strips and len(clues.expected) == 2:
        which = [n for n in (ROW,) if n in clues.table.names and {*clues.table.column(n)} == {"0", "1"}]
    constant = [
        n for n in names if len(texts[n]) == 1 and not (_numeric(clues, n) or says_nothing(*texts[n]))
    ]
    names = [n for n in names if n not in (*labels, *which, *constant)]
    found |= {n: Meaning("which") for n in which}
    values = {n: clues.values(n) for n in names}
    channels = 1 if which else max(len(clues.expected), 1)
    wide = channels * sensor.strips if sensor else 0
    clocks = [n for n in names if all(clock_seconds(t) is not None for t in texts[n])]
    rising = [n for n in names if _rises(values[n]) or n in clocks]
    spare = len(names) - wide - len(set(rising) & set(names[:2]))
    if sensor and spare > 0 and not any(clues.table.column(names[-1])):  # each line ends with a separator
        names = names[:-1]
    extra, rest = names[: len(names) - wide], names[len(names) - wide :]
    clear = (
        len(extra) < 2 or extra[0] in clocks or _counts(values[extra[0]])
    )  # else one may be a strip, and the last not
    clear = clear and (not extra or extra[-1] in clocks or _steady(values[extra[-1]]))
    if sensor and len(extra) <= 2 and clear and set(rising) >= set(extra) and len(rest) == wide:
        found |= {n: Meaning("scan") for n in extra[:-1]} | {n: Meaning("time") for n in extra[-1:]}
        if extra:
            clues.because(f"{extra[-1]}: rises from line to line, so it is the time")
        found |= _of_block(clues, rest, found, "".join(which[:1]))
        clues.because(f"{wide} columns without names are the {sensor.strips} strips in their order")
        return found
    cycles = [n for n in names if _cycles(values[n]) or _are_strips(texts[n])]
    rest = [n for n in names if n not in cycles and n not in rising]
    told = ROW in clues.table.names or "strip" in {m.role for m in found.values()}
    placed = len(cycles) == 1 or (not cycles and told)
    if placed and len(rest) in (1, 2) and (not sensor or len(rest) == channels):
        found |= dict(
            zip(rest, (Meaning("reading", c) for c in ("ab" if len(rest) == 2 else ("",))), strict=False)
        )
        found |= {n: Meaning("time" if n == rising[-1] or n in clocks else "scan") for n in rising}
        for name in cycles:
            found[name] = Meaning("strip")
            clues.because(f"{name}: whole numbers that come again and again, so they are the strips")
        return found
    if len(names) > wide > 1 and not labels:
        block = _ask_for_block(
            clues, f"the {len(names)} columns have no names", names[names[0] in rising :], wide
        )
        found |= {n: Meaning("time") for n in rising[:1] if n not in block}
        return found | _of_block(clues, block, found, "".join(which[:1]))
    first = (names or list(clues.table.names))[0]
    nameless = sum(n.startswith("column ") for n in clues.table.names)
    clues.ask(
        first,
        f"the {nameless} columns have no names: say what each is (which: the channel's name)"
        + ("" if sensor else "; or name the SENSOR, whose strips may tell"),
        "time", "scan", "strip", "which", *(clues.expected or ("h", "l"))[:2],
    )  # fmt: skip
    clues.stop()
    raise AssertionError


def _are_strips(texts: set[str]) -> bool:
    """Return whether words count strips, as "/skin/0", "/skin/1", ..."""
    kinds = meanings(sorted(texts))
    named = all(m.role == "reading" and m.strip is not None and not m.channel for m in kinds.values())
    worded = not any(number_of(t) is not None for t in texts)
    return worded and named and len({m.strip for m in kinds.values()}) == len(texts) > 2


def _counts(values: list[float | None]) -> bool:
    """Whether numbers go up by one, or stay."""
    return set(np.diff([np.nan if v is None else v for v in values]).tolist()) <= {0.0, 1.0}


def _steady(values: list[float | None]) -> bool:
    """Whether numbers go up as a clock's do: by steps that are mostly alike."""
    steps = np.diff([np.nan if v is None else v for v in values])
    steps = steps[steps > 0.0]
    usual = np.median(steps) if len(steps) else 0.0
    return len(steps) > 0 and bool((np.abs(steps - usual) <= _STEADY * usual).mean() >= _MOSTLY)


def _rises(values: list[float | None]) -> bool:
    numbers = [v for v in values if v is not None]
    steps = np.diff(numbers)
    if len(numbers) < len(values) or len(numbers) < 2:
        return False
    falls = steps[steps < 0.0]
    if (
        len(falls) == 1 and len(steps) > 2 and all(v % 1.0 == 0.0 for v in numbers)
    ):  # a clock whose bits are full
        over = [falls[0] + 2.0**bits for bits in CLOCK_BITS if max(numbers) < 2.0**bits]
        return any(0.0 < o <= 2.0 * steps.max() for o in over)
    return bool((steps >= 0.0).all()) and numbers[-1] > numbers[0]


def _cycles(values: list[float | None]) -> bool:
    """Return whether these are whole numbers from 0 or 1 on, all as often, in runs that begin anew."""
    if any(v is None or v != int(v) for v in values) or len(values) < 4:
        return False
    numbers = [int(v) for v in values if v is not None]
    many = Counter(numbers)
    distinct = sorted(many)
    return (
        len(distinct) > 1
        and distinct == list(range(distinct[0], distinct[0] + len(distinct)))
        and distinct[0] in (0, 1)
        and len(set(many.values())) == 1
        and (numbers[: len(distinct)] == distinct or numbers[: len(distinct)] == distinct[::-1])
    )


def above(high: FloatArray, low: FloatArray) -> bool:
    """Return whether one of two channels is the larger nearly everywhere, and clearly so in the median."""
    apart = (high - low)[
        np.isfinite(high - low) & ((high != 0.0) | (low != 0.0))
    ]  # both are 0 where nothing touches
    if len(apart) < 2:
        return False
    scale = float(np.nanmax(np.abs(np.stack([high, low]))))
    return bool((apart >= -_APART * scale).mean() >= _ABOVE and np.median(apart) > _APART * scale)

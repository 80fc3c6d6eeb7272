"""What the numbers of a log are in: the unit of readings and of the time, what stands for no contact."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from dataclasses import replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import import conversion
from tacstrip.io.log_import.columns import CLOCK_BITS, Columns
from tacstrip.io.log_import.fields import clock_seconds, is_date, is_of_two, number_of, says_nothing
from tacstrip.io.log_import.mapping import RESTARTS, ColumnMapping
from tacstrip.io.log_import.names import (
    CLOCKS,
    IN_VOLTS,
    LENGTHS_MM,
    OF_VREF,
    READING_UNITS,
    TIME_UNITS,
    UNITS,
    is_called_k,
    unknown_unit,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan, raw_times
from tacstrip.io.log_import.statements import untouched_said
from tacstrip.io.log_import.table import CLOCK, ROW

_RATES_HZ = (0.12, 5000.0)  # scans per second that a log may have
_POSSIBLE_S = (1.5e-4, 3600.0)  # from scan to scan
_SENTINELS = (999.0, 9999.0, 99999.0, 32767.0, 65535.0, 99.9, 99.99, 999.9, 999.99)
_NEAR_0 = 0.01  # of the largest reading; and of the most that there can be
_REST = 0.05  # of the largest reading: the most that the noise of open inputs reaches
_GAP = 5.0  # times: how far above that the other readings begin
_LEAP = 2.0  # times the largest step of a strip that stays touched: a contact begins or ends
_AT_ONCE = "strips go there and back in one step, and no other reading moves as far"
_FAINT = 0.005  # of what there can be: a log that stays below was hardly made so
# Of Vref: so far above is no offset, and so far may another Vref let readings go; and fewer that do are slips.
_OFF_VREF, _MOST_OVER, _FEW_OVER = 0.01, 2.0, 2
_VREFS = (1.1, 1.8, 2.048, 2.5, 3.0, 3.3, 4.096, 5.0, 10.0, 12.0, 24.0, 48.0)
_FEW_TOUCHED = 0.005  # of the readings: fewer are no contact among noise
_MANY = 0.05  # of the readings: more that are exactly 0 are no chance
# Of what there can be: a unit in which a log uses less is out where it uses as much in another.
_LITTLE, _MUCH = 0.21, 0.5
_EVEN = 0.2  # of the largest step: so much may others of a clock be less
_BITS = (8, 10, 12, 14, 16, 24)
_FEW_CODES = 6  # distinct readings that lie on a converter's steps: no chance
_FAR = 1e5  # usual steps: no pause is as long
_FAR_LAST = 300.0  # times the largest other step
_JUMP = 5.0  # usual steps: so much a clock may rise where it begins anew
_EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # since 1970, up to 2.2 times that
_FULL = 0.9  # of the largest reading: what becomes larger than the range goes there from above
_SAME_RATE = 0.02  # relative: steps that are those of a rate
_SAME_TIME = 0.5  # of the scans: if more have the time of the one before, the clock is too coarse
_RATE = re.compile(
    r"\b(?:\w*(?:rate|frequenz|frequency|fs|freq|takt|sampled|sampling|recorded|logged)\w*)\b[^\d\n]{0,20}?([\d.,]+)\s*(k?)(?:hz|sps|s/s|1/s)",
    re.IGNORECASE,
)
_ALARM = re.compile(
    r"err|fault|fail|sat|clip|ovf|overf|bad|invalid|miss|\?", re.IGNORECASE
)  # not of no contact
_OVER_RANGE = re.compile(
    r"\++|\+?(?:over(?:range|load)?|o\.?l\.?|ovl?d|burnout|inf)", re.IGNORECASE
)  # of loggers
_CODES_SAID = re.compile(r"\b(?:adc|raw|codes?|counts?|lsbs?|digits?)\b", re.IGNORECASE)
_PERCENT = (20.0, 100.0)  # between which the largest reading of a sensor in percent lies as a rule
_ANALOG_READ = re.compile(r"\banalogRead\b")  # of Arduino: it returns the converter's codes
_BITS_TOLD = re.compile(r"\b(\d{1,2})[\s_-]?bits?\b", re.IGNORECASE)
_UNIT_TOLD = re.compile(
    r"\b(?:units?|readings?|values?|voltages?|signals?|channels?|data|in|all|normali[sz]ed|ratiometric)\b[^\n,;]{0,16}?"
    r"(?<![\w])(mV|[uµ]V|V|volts?|millivolts?|microvolts?|counts?|codes?|percent|%|‰"
    r"|to Vref|of Vref|over Vref|/ ?Vref)(?!\w)|\b(counts|codes|LSBs?)\b",
    re.IGNORECASE,
)
# What is said in prose: "ratios to Vref", "RATIO_OF_VREF", "permille of the supply", "these are *millivolts*".
_UNIT_IN_PROSE = (
    (
        re.compile(
            r"(?:ratios?|fractions?|ratiometric)[\s_]+(?:to|of|over)[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref)",
            re.I,
        ),
        "fraction",
    ),
    (
        re.compile(r"\bper ?mille?\b[\s_]+of[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref|full)", re.I),
        "permille",
    ),
    (
        re.compile(r"(?:\bpercent|%)[\s_]+of[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref|full)", re.I),
        "percent",
    ),
    (re.compile(r"(?<![\w\d])(?<!\d )millivolts\b", re.I), "mV"),
)
_OF_OTHERS = re.compile(r"batter|supply|vbat|temp|v_?ref|aref|vcc|vdd|\btime\b|\bbaud\b", re.IGNORECASE)
_OVER_VREF = re.compile(r"=\s*\w+\s*\.?/\s*V_?ref\b", re.IGNORECASE)  # as in "Vh = raw/Vref"
_HOURS_SAID = re.compile(
    r"\bh{1,2}[ :.]?m{1,2}\b(?![ :.]?s)|\btimes? of day\b|\buhrzeit\b|\bhours? ?(?:and|:) ?min", re.IGNORECASE
)
_MINUTES_SAID = re.compile(
    r"(?<![hH][:.])\bm{1,2}[ :.]s{1,2}\b|\bmin\w* ?(?:and|:) ?s(?:ec\w*)?\b|\bstop ?watch\b", re.IGNORECASE
)
_OF_DAY_SAID = re.compile(r"\b(?:hora|heure|ora|uhr|godzina|klokken)\b", re.IGNORECASE)
_LAST_HOUR = 23
# As National Instruments' programs write it, in seconds.
_INCREMENT = re.compile(
    r"(?:^X_Dimension[\t;,]Time\b[\s\S]*?^Delta_X|^wf_increment)[\t;,]\s*([\d.,]+(?:E[+-]?\d+)?)",
    re.IGNORECASE | re.MULTILINE,
)
_PERIOD = re.compile(
    r"\b(?:\w*(?:interval|period|intervall|periode|delta[ _]?[tx]|dt|time ?step|schrittweite)\w*)\b[^\d\n]{0,20}?"
    r"([\d.,]+(?:e[+-]?\d+)?)[\s,;]*(s|ms|us|µs|sec|seconds|msec)\b",
    re.IGNORECASE,
)


# Time


def with_time(clues: Clues, mapping: ColumnMapping, found: Columns) -> ColumnMapping:
    """Return the mapping with the unit of its time and what its clock does, as far as the column says it."""
    if not found.time:
        return mapping
    clues.choice("restart", RESTARTS)
    unit = clues.choice("time_unit", (*TIME_UNITS, *CLOCKS)) or _unit_of_name(clues, found)
    mapping = replace(mapping, time_unit=unit or "s")
    times = raw_times(clues.table, mapping)
    if not unit and (since := [u for u, s in _EPOCHS.items() if s <= abs(times[0]) <= 2.2 * s]):
        clues.because(f"{found.time}: {since[0]} since 1970")
        unit = since[0]
    steps = np.diff(times)
    mapping = replace(mapping, time_unit=unit)
    return (
        mapping
        if unit in CLOCKS
        else replace(mapping, time_bits=_clock_bits(clues, found.time, times, steps))
    )


def _unit_of_name(clues: Clues, found: Columns) -> str:
    first = clues.table.column(found.time)[0]
    if number_of(first, clues.table.decimal) is None and clock_seconds(first) is not None:
        clues.because(f"{found.time}: times of day or dates, such as {first}")
        return _of_two_parts(clues, found.time)
    unit = found.meanings[found.time].unit
    return unit if unit in TIME_UNITS else ""


def _of_two_parts(clues: Clues, name: str) -> str:
    """Return whether times such as 14:05 are hours and minutes or minutes and seconds; "clock" for all others."""
    fields = clues.table.column(name)
    if not all(map(is_of_two, fields)):
        return "clock"
    above = "\n".join((name, *clues.table.preamble))
    ways = {"hh:mm": bool(_HOURS_SAID.search(above)), "mm:ss": bool(_MINUTES_SAID.search(above))}
    first = [int(f.partition(":")[0]) for f in fields]
    of_day = _OF_DAY_SAID.search(name) and any(fields[0].strip("0:"))
    dated = any(all(map(is_date, clues.table.column(n))) for n in clues.table.names)
    midnight = any((a, b) == (23, 0) for a, b in itertools.pairwise(first))
    ways["hh:mm"] |= bool(of_day or dated or midnight)
    ways["mm:ss"] |= max(first) > _LAST_HOUR
    times = [clock_seconds(f) or 0.0 for f in fields]
    steps = [b - a for a, b in itertools.pairwise(times) if b > a]
    for period in {1.0 / rate for rate in _rates_above(clues)} | conversion.repeated_s(clues.table):
        for way, unit in (("hh:mm", 60.0), ("mm:ss", 1.0)) if steps else ():
            ways[way] |= _is_rate(unit * float(np.median(steps)), 1.0 / period)
    said = [way for way, so in ways.items() if so]
    if len(said) == 1:
        clues.because(f"{name}: {fields[-1]} is {said[0]}, as the log says")
        return said[0]
    clues.ask(
        "time_unit", f"{name}: is {fields[-1]} hours and minutes (hh:mm), or minutes and seconds (mm:ss)?",
        "hh:mm", "mm:ss",
    )  # fmt: skip
    return "mm:ss"


def _clock_bits(clues: Clues, name: str, times: FloatArray, steps: FloatArray) -> int:
    """Return how many bits a clock has that falls only where these are full; 0 where it never falls, or otherwise."""
    falls, rises = steps[steps < 0.0], steps[steps > 0.0]
    if not len(falls) or not len(rises) or (times != np.round(times)).any():
        return 0
    for bits in CLOCK_BITS:
        over = falls + 2.0**bits
        if times.max() < 2.0**bits and (over > 0.0).all() and (over <= _JUMP * rises.max()).all():
            clues.because(f"{name}: a clock of {bits} bits, for it begins anew where these are full")
            return bits
    return 0


def settled_time(clues: Clues, mapping: ColumnMapping, rough: list[LogScan]) -> ColumnMapping:
    """Return the mapping with the unit of its time, by the steps from scan to scan, or with its rate."""
    rate = clues.number("rate_hz")
    if mapping.time and len(rough) > 1:
        steps = np.diff([s.time_s for s in rough])
        if (steps == 0.0).mean() > _SAME_TIME:
            if (steps != 0.0).any() or rate is None:
                clues.because(
                    f"{mapping.time}: most scans have the time of the one before, so it says nothing"
                )
            mapping = replace(mapping, time="", time_unit="s", time_bits=0)
    if not mapping.time:
        rate = rate or _rate_above(clues)
        if rate is None and len(rough) > 1:
            if even := _even_column(clues, mapping, len(rough)):
                clues.ask(
                    even, f"no name says the time, and {even!r} rises evenly: is it? Or give rate_hz", "time"
                )
            else:
                text = f"the log has {len(rough)} scans and no time: how many scans per second?"
                clues.ask("rate_hz", text, "50")
        return replace(mapping, rate_hz=rate or 0.0)
    steps = np.diff(np.array([s.time_s for s in rough]))
    if len(steps) > 2 and (
        steps[0] > _FAR * np.median(steps[1:]) > 0.0
        or (len(steps) > _FEW_CODES and steps[0] > _FAR_LAST * max(steps[1:]) > 0.0)
    ):
        raise ReadingError(
            f"line {rough[1].line}: the time jumps as at no other line from {rough[0].time_s:g} s; if the line before "
            "is cut, take it out"
        )
    if len(steps) > _FEW_CODES and steps[-1] > _FAR_LAST * max(steps[:-1]) > 0.0:
        raise ReadingError(
            f"line {rough[-1].line}, the last: the time jumps there as nowhere else, to {rough[-1].time_s:g} s: is a "
            "point lost, or is it cut? Mend it, or take it out"
        )
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if mapping.time_unit or len(rough) < 2:
        if "time_unit" not in clues.answers and step and not _POSSIBLE_S[0] <= step <= _POSSIBLE_S[1]:
            raw = step / TIME_UNITS.get(mapping.time_unit, 1.0)
            rates = _rates_above(clues)
            so = [
                u for u in ("ms", "us", "s") if len(rates) == 1 and _is_rate(raw * TIME_UNITS[u], min(rates))
            ]
            clues.ask(
                "time_unit",
                f"{mapping.time} would rise by {step:g} s from scan to scan: in which unit is it?"
                + (f" (A line above says {min(rates):g} Hz, as they would be in {so[0]})" if so else ""),
                "ms",
                "us",
                "s",
            )
        return replace(mapping, time_unit=mapping.time_unit or "s")
    fits = [
        u
        for u in ("s", "ms", "us", "days")
        if step and _RATES_HZ[0] <= 1.0 / (step * TIME_UNITS[u]) <= _RATES_HZ[1]
    ]
    strange = unknown_unit(mapping.time)
    if rate and step:  # which tells the unit, or that the column is no time
        told = [u for u in ("s", "ms", "us") if _is_rate(step * TIME_UNITS[u], rate)]
        if not told:
            clues.doubt(
                f"{mapping.time!r} rises by {step:g} from scan to scan, which is {rate:g} scans per second in no unit: "
                "it is passed over"
            )
            return replace(mapping, time="", time_unit="s", time_bits=0, rate_hz=rate)
        clues.because(f"{mapping.time} is in {told[0]}, at {rate:g} scans per second")
        return replace(mapping, time_unit=told[0])
    if fits and not strange and len(told := [u for u in fits if _is_told(clues, mapping.time, u, step)]) == 1:
        clues.because(f"{mapping.time} is in {told[0]}, as a line above says")
        return replace(mapping, time_unit=told[0])
    if len(fits) == 1 and not strange:
        if fits != ["days"] and step == round(step):  # which may count the ticks of any clock
            clues.doubt(
                f"{mapping.time} rises by {step:g} from scan to scan, and nothing says its unit: taken as {fits[0]}, "
                f"so {1.0 / (step * TIME_UNITS[fits[0]]):g} scans per second; else --answer rate_hz=... or time_unit=us"
            )
        clues.because(f"{mapping.time} is in {fits[0]}: it rises by {step:g} from scan to scan")
        return replace(mapping, time_unit=fits[0])
    counts = step == 1.0 and set(steps.tolist()) == {1.0}
    clues.ask(
        "time_unit",
        f"{mapping.time} rises by {step:g} from scan to scan: in which unit?"
        + (f" ({strange!r} is none that is known: if it is none of these, write seconds)" if strange else "")
        + (" (If it only counts the scans, --answer rate_hz=50 with their rate instead)" if counts else ""),
        *(fits or ("s", "ms", "us")),
    )
    return replace(mapping, time_unit="s")


def _is_told(clues: Clues, name: str, unit: str, step: float) -> bool:
    """Return whether lines above say that a time is in a unit ("t in ms"), or a rate that it has only in that."""
    text = "\n".join(clues.table.preamble)
    said = {
        UNITS.get(u.lower(), u) for u in re.findall(rf"\b{re.escape(name)} in (?:the )?([a-zµ]+)\b", text)
    }
    rates = _rates_above(clues)
    return said == {unit} or (not said and len(rates) == 1 and _is_rate(step * TIME_UNITS[unit], min(rates)))


def _is_rate(step_s: float, rate_hz: float) -> bool:
    return abs(step_s * rate_hz - 1.0) < _SAME_RATE


def _even_column(clues: Clues, mapping: ColumnMapping, scans: int) -> str:
    """Return a column of no known meaning that rises from scan to scan by always as much; "" where there is none."""
    used = {*mapping.columns, mapping.scan, mapping.strip, mapping.which, CLOCK, ROW}
    for name in clues.table.names:
        values = np.array([np.nan if v is None else v for v in clues.values(name)])
        steps = np.diff(values)
        steps = steps[steps != 0.0]
        if (
            name in used
            or name in clues.answers
            or len(steps) != scans - 1
            or not (steps > 0.0).all()
            or len(steps) < 2
        ):
            continue
        if np.ptp(steps) <= _EVEN * steps.max() and (steps != 1.0).any():  # else it counts the scans
            return name
    return ""


def _rate_above(clues: Clues) -> float | None:
    """Return the rate that the lines above the table say, if only one."""
    rates = _rates_above(clues)
    if len(rates) != 1:
        return None
    clues.because(f"{min(rates):g} scans per second, by a line above the table")
    return rates.pop()


def _rates_above(clues: Clues) -> set[float]:
    text = "\n".join(clues.table.preamble)
    if steps := {number_of(d, "," if "," in d else ".") for d in _INCREMENT.findall(text)} - {None, 0.0}:
        return {1.0 / step for step in steps if step}
    rates = {
        value * (1000.0 if kilo else 1.0)
        for digits, kilo in _RATE.findall(text)
        if (value := number_of(digits.rstrip(".,"), "," if "," in digits else "."))
    }
    rates |= {
        1.0 / (value * TIME_UNITS[{"sec": "s", "seconds": "s", "msec": "ms", "µs": "us"}.get(unit, unit)])
        for digits, unit in ((d, u.casefold()) for d, u in _PERIOD.findall(text))
        if (value := number_of(digits.rstrip(".,"), "," if "," in digits else "."))
    }
    return rates


# No contact


def words_for_nothing(clues: Clues, found: Columns) -> tuple[str, ...]:
    """Return words that are no readings, which the user says stand for no contact; ask where nothing is said."""
    if (answer := clues.answers.get("untouched")) is not None:
        return (
            () if answer in ("none", "empty") else tuple(filter(None, (a.strip() for a in answer.split(","))))
        )
    table = clues.table
    for name in found.readings:
        for line, text in zip(table.lines, table.column(name), strict=True):
            if _is_word(text, table.decimal):
                if len(parts := text.split()) > 1 and all(
                    number_of(p, table.decimal) is not None for p in parts
                ):
                    raise ReadingError(
                        f"line {line}: {name} is {text!r}, which are {len(parts)} numbers, not one"
                    )
                if re.search(r"\d[.,]\d", text) or clock_seconds(text) is not None:
                    raise ReadingError(
                        f"line {line}: {name} is {text!r}, which is no number; mend it, or say --answer "
                        f"'{name}=skip' if the column holds no readings"
                    )
                said = {t for n in found.readings for t in table.column(n) if _is_word(t, table.decimal)}
                if said <= {*untouched_said(clues.table.preamble)}:
                    return tuple(sorted(said))
                if any(c.isdigit() or _ALARM.search(t) for t in said for c in t):
                    clues.ask(
                        "untouched",
                        f"line {line}: {text!r} is no number; does it stand for no contact?",
                        text,
                    )
                return tuple(sorted(said))
    return ()


def settle_words(clues: Clues, mapping: ColumnMapping, rough: list[LogScan]) -> None:
    """Ask for words that are no readings, unless both channels of a strip always have them at once, and often."""
    if not mapping.untouched or "untouched" in {*clues.answers, *(q.key for q in clues.questions)}:
        return
    values = np.stack([s.values for s in rough])  # (scans, strips, channels)
    word = ", ".join(mapping.untouched)
    if {*mapping.untouched} <= {*untouched_said(clues.table.preamble)}:
        clues.because(f"{word}: no contact, as the log says")
        return
    idle = np.isnan(values)
    if values.shape[2] == 2 and (idle[:, :, 0] == idle[:, :, 1]).all() and idle.mean() > _MANY:
        clues.because(f"{word}: no contact, for both channels of a strip have it at once, and none alone")
        return
    words = [w for w in mapping.untouched if _OVER_RANGE.fullmatch(w)]
    if values.shape[2] == 1 and len(words) == len(mapping.untouched) == 1 and _is_open(values[:, :, 0]):
        clues.because(
            f"{word}: no contact, as of open inputs: strips with readings lie side by side, and go there from readings "
            "far below the largest"
        )
        return
    clues.ask(
        "untouched", f"{word!r} is no number; does it stand for no contact?", ",".join(mapping.untouched)
    )


def _is_open(values: FloatArray) -> bool:
    """Return whether inputs over the range are open ones; else readings that are too large would be near there."""
    idle = np.asarray(np.isnan(values))
    side_by_side = all(row[np.argmax(row) :][: row.sum()].all() for row in np.asarray(~idle))
    beside = [values[1:][idle[:-1] & ~idle[1:]], values[:-1][idle[1:] & ~idle[:-1]]]
    edge = np.concatenate(beside)  # the first and the last readings of contacts
    return (
        side_by_side and idle.mean() > _MANY and len(edge) > 0
        and bool(np.median(edge) < _FULL * np.nanmax(values))
    )  # fmt: skip


def _is_word(text: str, decimal: str) -> bool:
    return number_of(text, decimal) is None and not says_nothing(text)


def numbers_for_nothing(clues: Clues, rough: list[LogScan]) -> tuple[str, ...]:
    """Return numbers that stand for no contact: below 0, far above all others, or 0 in both channels at once."""
    if "untouched" in clues.answers or not rough:
        return ()
    values = np.stack([s.values for s in rough])  # (scans, strips, channels)
    numbers = Counter(values[np.isfinite(values)].tolist())
    found: list[str] = []
    said = [s for s in untouched_said(clues.table.preamble) if number_of(s) in numbers]
    if said:
        clues.because(f"{', '.join(said)}: no contact, as the log says")
        return tuple(f"{number_of(s):g}" for s in said)
    negative = [v for v in numbers if v < 0.0]
    nines = len(negative) == 1 and re.fullmatch(r"-9+\.9+", f"{negative[0]:g}")
    if len(negative) == 1 and negative[0] <= -1.0 and (negative[0] % 1.0 == 0.0 or nines):
        found.append(f"{negative[0]:g}")
        clues.because(f"{negative[0]:g} stands for no contact: it is the only negative number")
    rest = sorted(v for v in numbers if f"{v:g}" not in found)
    if len(rest) > 1 and rest[-1] in _SENTINELS and rest[-2] < 0.5 * rest[-1]:
        found.append(f"{rest.pop():g}")
        clues.because(f"{found[-1]} stands for no contact: all other readings are far below it")
    rests = clues.sensor is not None and clues.sensor.rest_volt is not None
    if rest and clues.answers.get("missing") == "untouched":  # the others may have noise, all the same
        idle = np.asarray(np.isnan(values).all(axis=2))  # (scans, strips)
        values = np.where(idle[:, :, None], rest[0], values)[:, ~idle.all(axis=0)]
    if rest and not (rests or found or np.isnan(values).any()):
        found += _at_an_end(clues, values, rest)
    return tuple(found)


def _at_an_end(clues: Clues, values: FloatArray, rest: list[float]) -> list[str]:
    """Return 0, the most that there can be, or what is near 0, where that is no reading; ask where it may be one."""
    most = {2.0**bits - 1.0 for bits in _BITS} | ({clues.sensor.vref_volt} if clues.sensor else set())
    others = [v for v in rest if v != 0.0]
    ends = [0.0] * bool(others and min(others) > _NEAR_0 * max(others))
    ends += [rest[-1]] * bool(rest[-1] in most and len(rest) > 1 and rest[-2] < (1.0 - _NEAR_0) * rest[-1])
    for end in ends:
        there = values == end
        if there.mean() <= _MANY or there.sum() < 2:
            continue
        told = f"{100 * there.mean():.0f} % of the readings are exactly {end:g}, and no other is near"
        if values.shape[2] == 2 and (there[:, :, 0] == there[:, :, 1]).all():
            told = f"{end:g} stands for no contact: both channels of a strip have it at once, and none alone"
        elif _comes_at_once(values, there):
            told = f"{end:g} stands for no contact: {_AT_ONCE}"
        else:
            told += ": does it stand for no contact, or is it a reading (none)?"
            clues.ask("untouched", told, f"{end:g}", "none")
            return []
        clues.because(told)
        return [f"{end:g}"]
    low = [v for v in rest if v < _REST * rest[-1]]
    high = rest[len(low) :]
    there = values <= max(low, default=-1.0)
    if ends or not (low and high) or high[0] <= _GAP * max(low[-1], -low[0]):
        return []
    if not _MANY < there.mean() < 1.0 - _FEW_TOUCHED:  # else the others have lost a point
        return []
    below = f"<{0.5 * (low[-1] + high[0]):.3g}"
    told = f"{100 * there.mean():.0f} % of the readings are {low[-1]:g} or less, and all others {high[0]:g} or more"
    both = values.shape[2] == 2 and (there[:, :, 0] == there[:, :, 1]).all() and low[-1] < _NEAR_0 * rest[-1]
    if both or _comes_at_once(values, there):
        why = "both channels of a strip are so low at once, and none alone" if both else _AT_ONCE
        clues.because(f"{told}: the noise of strips that nothing touches, for {why}")
        return [below]
    clues.ask(
        "untouched", f"{told}: is that the noise of strips that nothing touches, or are they readings (none)?",
        below, "none",
    )  # fmt: skip
    return []


def _comes_at_once(values: FloatArray, there: BoolArray) -> bool:
    """Return whether strips go to such values and back in one step, of which no other reading makes the like.

    A contact that moves to the end of a strip takes its reading there by and by.
    """
    idle = np.asarray(there.all(axis=2))  # (scans, strips)
    if (there.any(axis=2) != idle).any():
        return False
    side_by_side = all(row[np.argmax(row) :][: row.sum()].all() for row in np.asarray(~idle))
    steps = np.abs(np.diff(values, axis=0)).max(axis=2)
    jumps = steps[idle[1:] != idle[:-1]]
    moves = steps[~(idle[1:] | idle[:-1])]
    far = max(_LEAP * float(moves.max(initial=0.0)), _REST * float(values.max()))
    return side_by_side and len(jumps) > 0 and bool(jumps.min() > far)


# Units


def with_unit(clues: Clues, mapping: ColumnMapping, found: Columns, rough: list[LogScan]) -> ColumnMapping:
    """Return the mapping with the unit of its readings, and what that needs."""
    sensor = clues.sensor
    values = np.concatenate([s.values.ravel() for s in rough])
    values = values[np.isfinite(values)]
    answer = clues.choice("unit", (*READING_UNITS, *LENGTHS_MM))
    vref = clues.number("vref_volt") or (sensor.vref_volt if sensor else 0.0)
    bits = _stated_bits(clues)
    scale = mapping.scale
    if not len(values):
        return replace(mapping, unit=answer or "V")
    if values.max() < 0.0 < mapping.zero:
        raise OptionError(
            f"codes reach {values.max() + mapping.zero:g}, below {mapping.zero:g}, which would be 0 V: they are not "
            "offset by half; say --answer coding=signed or coding=unsigned"
        )
    told = [found.meanings[n] for n in mapping.columns]
    named = {m.unit for m in told} - {""}
    volts = any(m.volts for m in told)
    hundred = 1.0 / OF_VREF["percent"]
    if (
        named == {"fraction"}
        and 1.0 + _OFF_VREF < values.max() <= hundred
        and (values != np.round(values)).any()
    ):
        named = set()  # a ratio in percent, say
    if named == {"fraction"} and values.max() > 1.0 and all(map(is_called_k, mapping.columns)):
        named = {"code"} if bits and (values == np.round(values)).all() else set()
        if named and values.max() <= 1.0 / OF_VREF["permille"] and not answer:
            clues.doubt(
                f"{next(iter(mapping.columns))}, ...: whole numbers up to {values.max():g} are taken as codes of "
                f"{bits} bits; if they are thousandths of Vref, --answer unit=permille"
            )
    filled = [f for n in mapping.columns for f in clues.table.column(n) if not says_nothing(f)]
    if not named and all(f[:2].casefold() == "0x" for f in filled):
        named = {"code"}
    if not named and "coding" in clues.answers:
        named = {"code"}
    unit = answer or (named.pop() if len(named) == 1 else _by_size(clues, values, vref / scale, bits, volts))
    open_unit = next((q for q in clues.questions if q.key == "unit"), None)
    step = (
        0.0
        if bits or scale != 1.0 or conversion.bits_told(clues.table, vref)
        else conversion.step_told(clues)
    )
    if unit == "code" and not open_unit and 0.0 < step * values.max() <= (1.0 + _OFF_VREF) * (vref or np.inf):
        clues.because(f"codes of {step:g} V each, as the log says")
        mapping, scale, unit = replace(mapping, scale=step), step, "V"
    elif unit == "code" or (open_unit and sensor and "code" in open_unit.choices and not step):
        bits = _bits(clues, values, bits)
    if unit == "code":
        conversion.ask_for_half(clues, values, bits)
    of_lines = unit == "code" and clues.answers.get("adc_bits") == "lines"
    how = conversion.coding(clues, bits) if unit == "code" else "unsigned"
    if not how:
        conversion.ask_for_coding(clues)
    bits -= how in ("signed", "offset") and bits > 0
    if unit == "code" and how and "adc_bits" not in {q.key for q in clues.questions}:
        conversion.ask_for_step(clues, bits, vref)
    if of_lines:
        clues.because(f"codes are brought to {bits} bits from the resolution that the line above them says")
    if scale != 1.0:
        clues.because(f"readings are multiplied by {scale:g}")
    if sensor is None and (unit in ("fraction", "percent") or how != "unsigned" or of_lines) and not vref:
        clues.ask(
            "vref_volt",
            "the readings are parts of Vref: how many volts is that? Or name the SENSOR",
            "5",
            "3.3",
        )
    top = (_most(vref, scale) | {"code": 2.0**bits - 1.0}).get(unit, 0.0)
    if unit in IN_VOLTS and sensor and not open_unit and "vref_volt" not in clues.answers:
        over = values > (1.0 + _OFF_VREF) * top
        if over.sum() > _FEW_OVER and over.mean() > _MANY and values.max() <= _MOST_OVER * top and not answer:
            fits = [f"{v:g}" for v in _VREFS if v >= 0.99 * values.max() * IN_VOLTS[unit]][:2]
            clues.ask(
                "vref_volt",
                f"readings reach {values.max():g} {unit}, above vref_volt = {vref:g} of the spec: with which Vref was "
                "the log made (then put it into the spec, too)? If they are no volts, say --answer unit=code (mV, ...)",
                *fits,
            )  # fmt: skip
            return replace(mapping, unit=unit, vref_volt=float(fits[0]))
        if clues.stated is not None and "vref_volt" not in clues.stated:
            clues.ask(
                "vref_volt",
                f"readings are in {unit}, and the spec does not state vref_volt (unset, it is {vref:g} V): how "
                "many volts is Vref? Or write it into the spec",
                f"{vref:g}", "3.3",
            )  # fmt: skip
    if unit and top and values.max() > 1.01 * top:
        raise ReadingError(
            f"a reading of {values.max():g} is above {top:g}, the most that there can be in {unit}; check the unit "
            f"(--answer unit=...) and {'adc_bits' if unit == 'code' else 'vref_volt'} in the spec"
        )
    if unit and top and values.max() < _NEAR_0 * top and not answer:
        most = _most(vref)
        others = [u for u in ("V", "mV", "fraction", "percent") if u != unit and most[u] >= values.max()]
        others = [u for u in others if values.max() > _LITTLE * most[u]] or others[:2]
        own = not (
            unit in IN_VOLTS and "V" in others and _LITTLE * vref < values.max()
        )  # which would be refused
        clues.ask(
            "unit",
            f"the log says {unit}, of which there can be {top:g}, and no reading is above {values.max():g}: is the "
            "mark in them one of thousands (then save them without), or are they in another unit?",
            *others, *([unit] if own else []),
        )  # fmt: skip
    if answer and top and values.max() < _FAINT * top:
        if answer in IN_VOLTS and answer != "V" and _LITTLE * vref < values.max() <= vref:
            raise OptionError(
                f"--answer unit={answer}: no reading is above {values.max():g} of {top:g} {answer} then; they fit V: "
                "--answer unit=V (if they are of an untouched sensor, write unit into a --mapping)"
            )
        clues.doubt(f"in {answer}, no reading is above {values.max():g} of {top:g}: is that the unit?")
    whole = answer == "mV" and bool((values == np.round(values)).all())
    if whole and sensor and sensor.adc_bits and _off_steps(values, vref, sensor.adc_bits):
        clues.doubt(
            f"in mV, readings do not lie on the steps of the spec's {sensor.adc_bits} bits: are they codes?"
        )
    plain = how == "unsigned" and not of_lines and scale == 1.0
    own = sensor is None or bits == sensor.adc_bits
    other = 0 if unit != "code" or (plain and own) else bits
    if sensor and (vref == sensor.vref_volt or unit not in IN_VOLTS):
        vref = 0.0
    if sensor and vref:
        clues.doubt(
            f"volts of Vref = {vref:g} are written as such of vref_volt = {sensor.vref_volt:g} of the spec, with the "
            f"same ratios; better put vref_volt = {vref:g} into the spec and import again"
        )
    return replace(mapping, unit=unit or "V", vref_volt=vref, adc_bits=other, adc_bits_of_lines=of_lines)


def _stated_bits(clues: Clues) -> int:
    """Return the bits of codes by the answer or the spec; 0 where neither says them."""
    if clues.answers.get("adc_bits") == "lines":
        return max(conversion.bits_by_line(clues.table), default=0)
    return int(clues.number("adc_bits") or (clues.sensor.adc_bits or 0 if clues.sensor else 0))


def with_zero(clues: Clues, mapping: ColumnMapping) -> ColumnMapping:
    """Return the mapping with the code of 0 V, where the log or the answer says that codes are offset by half."""
    bits = _stated_bits(clues)
    zero, _ = conversion.told_codes(clues.table)
    told = clues.answers.get("coding", "" if zero is None or zero != 2.0 ** (bits - 1) else "offset")
    return replace(mapping, zero=2.0 ** (bits - 1)) if told == "offset" and bits else mapping


def _bits(clues: Clues, values: FloatArray, bits: int) -> int:
    """Return the bits of codes, 0 where nobody says them; ask where these are none, or are above the spec's."""
    broken = values[values != np.round(values)]
    if len(broken):
        clues.ask(
            "unit", f"the readings are called codes, and {broken[0]:g} is none: which unit?", "V", "fraction"
        )
        return 0
    told = {int(b) for b in _BITS_TOLD.findall("\n".join((*clues.table.preamble, *clues.table.names)))} & {
        *_BITS
    }
    told |= conversion.bits_told(clues.table, clues.sensor.vref_volt if clues.sensor else 0.0)
    if "adc_bits" not in clues.answers and conversion.changes_below(clues.table):
        said = clues.table.resolutions
        line, _, other = next(r for r in said if r[1] != said[0][1])
        clues.ask(
            "adc_bits",
            f"line {said[0][0]} says {said[0][2]!r}, and line {line} {other!r}: are codes of that resolution from "
            "there on (lines), or all of one?",
            "lines", *dict.fromkeys(str(b) for _, b, _ in said),
        )  # fmt: skip
        return bits
    if not bits and len(told) == 1 and values.max() <= 2.0 ** min(told) - 1.0:
        bits = told.pop()
        clues.because(f"codes of {bits} bits, as the log says")
        return bits
    if bits and told and bits not in told and "adc_bits" not in clues.answers:
        clues.ask(
            "adc_bits", f"the log says {min(told)} bit, and the spec adc_bits = {bits}: which is it?",
            *(str(b) for b in (*sorted(told), bits)),
        )  # fmt: skip
    over = bits and values.max() > 2.0**bits - 1.0
    if (over or not bits) and clues.sensor is not None:
        fits = [str(b) for b in _BITS if values.max() <= 2.0**b - 1.0][:3]
        why = f"and adc_bits = {bits}" if bits else "and the spec has no adc_bits"
        if_so = "if unit=code: " if "unit" in {q.key for q in clues.questions} else ""
        text = f"{if_so}codes reach {values.max():g}, {why}: how many bits has the converter?"
        clues.ask("adc_bits", text, *fits)
        return 0
    return bits


def _by_size(clues: Clues, values: FloatArray, vref: float, bits: int, volts: bool) -> str:
    """Return the unit that the readings' size and steps leave, and a question where there are several."""
    whole, top = bool((values == np.round(values)).all()), float(values.max())
    most = _most(vref or 24.0)
    rare = {u: most.pop(u) for u in ("permille", "uV", "cV", "dV")}
    if whole and top > 1.0:
        few = len(set(values.tolist())) < 4
        fitting = [b for b in _BITS if vref and top <= 2.0**b - 1.0]
        width = bits or (fitting or _BITS[-1:])[0]
        most = {"code": 2.0**width - 1.0, "mV": most["mV"]} | ({"V": most["V"]} if few else {})
    fits = {u: top / m for u, m in most.items() if top <= m}
    if bits and whole and top > most.get("code", top):
        fits["code"] = 1.0  # of another converter than the spec's, which would be asked
    if top > most["mV"]:
        fits["uV"] = top / rare["uV"]
    fits = {u: used for u, used in fits.items() if 0.0 < used <= 1.0}
    if top > 1.0 and not whole:
        if "V" not in fits and top <= _MOST_OVER * vref:
            return "V"  # of another Vref, which is asked
        fits = {"V": fits["V"]} if "V" in fits else fits
    best = max(fits.values(), default=0.0)
    if (
        whole
        and bits
        and {*fits} == {"code", "mV"}
        and fits["mV"] < _LITTLE
        and _off_steps(values, vref, bits)
    ):
        best = max(best, _MUCH)  # so few of the millivolts, and not on the converter's steps of them
    likely = [u for u, used in fits.items() if used >= _LITTLE or best < _MUCH]
    if not likely and {*fits} == {"code", "mV"}:
        likely = ["code"]  # not those millivolts, however few codes they are
    if volts and not whole and "V" in fits:
        likely = list(fits)
    if volts and whole and len(fits) > 1:
        likely = list(fits)
    above = "\n".join((*clues.table.preamble, *clues.table.names))
    told_bits = bool(_BITS_TOLD.search(above) or conversion.bits_told(clues.table, vref))
    if likely == ["code"] and "mV" in fits and not (clues.sensor and clues.sensor.adc_bits) and not told_bits:
        if "adc_bits" not in clues.answers:  # nothing says that there are codes
            likely.insert(0, "mV")
        else:
            clues.doubt(
                f"readings reach {top:g}: taken as codes, of which adc_bits speaks; else --answer unit=mV"
            )
    if (
        whole and bits and likely == ["code"] and _PERCENT[0] < top <= _PERCENT[1]
        and not (told_bits or volts or {"adc_bits", "coding"} & {*clues.answers} or _raw_said(clues))
        and not (_ANALOG_READ.search(above) or _CODES_SAID.search(above))
    ):  # fmt: skip
        likely.append("percent")  # codes of touched strips seldom stay below that
    if likely == ["fraction"] and vref:
        likely.append("V")  # a light touch reads as little
    if likely == ["mV"] and vref and fits["mV"] < _LITTLE and top <= rare["permille"]:
        likely.append("permille")
    if len(likely) > 1 and vref and bits and (steps := _on_steps(values, vref, bits)) in likely:
        clues.because(f"readings are in {steps}: all lie on the steps of {bits} bits, which is no chance")
        return steps
    if len(likely) > 1:
        clauses = re.split(r"[,;\n]", "\n".join(clues.table.preamble))
        clauses = [clause for clause in clauses if not _OF_OTHERS.search(clause)]
        said = {w.casefold() for w in _UNIT_TOLD.findall("\n".join(clauses)) for w in w if w}
        named = {"fraction" if w.endswith("vref") else UNITS.get(w, "") for w in said}
        named |= {unit for words, unit in _UNIT_IN_PROSE if any(map(words.search, clues.table.preamble))}
        named |= {"fraction"} if any(map(_OVER_VREF.search, clues.table.preamble)) else set()
        if len(named) == 1 and named <= set(likely):
            clues.because(f"readings are in {min(named)}, as the log says above them")
            return named.pop()
        if "code" in likely and not (said or volts) and _ANALOG_READ.search("\n".join(clues.table.preamble)):
            clues.because("readings are codes, for analogRead returns these")
            return "code"
        told = {int(b) for b in _BITS_TOLD.findall("\n".join(clues.table.preamble))}
        if "code" in likely and not said and bits in told and not volts:
            clues.because(f"codes of {bits} bits, as the log says above them")
            return "code"
        if (
            bits
            and "code" in likely
            and not (said or volts)
            and top <= most["code"]
            and (raw := _raw_said(clues))
        ):
            clues.because(f"codes of {bits} bits: they fit these, and {raw!r} says raw")
            return "code"
    if len(likely) == 1:
        of = f", and Vref is {vref * (clues.number('scale') or 1.0):g} V" if vref else ""
        clues.because(f"readings are in {likely[0]}: they reach {top:g}{of}")
        return likely[0]
    clues.ask(
        "unit", f"readings reach {top:g}{' in whole numbers' if whole else ''}: in which unit?",
        *(u for u in READING_UNITS if u in (likely or READING_UNITS)),
    )  # fmt: skip
    return likely[0] if likely else "V"


def _raw_said(clues: Clues) -> str:
    """Return a column's name, or what stands on each line as its topic does, that says "raw"; "" where none does."""
    fixed = [fields[0] for n in clues.table.names if len({*(fields := clues.table.column(n))}) == 1]
    return next(
        (t for t in (*clues.table.names, *fixed) if re.search(r"(?<![a-z])raw(?![a-z])", t, re.I)), ""
    )


def _most(vref: float, scale: float = 1.0) -> dict[str, float]:
    """Return the most that there can be in each unit but codes, of readings that are to be multiplied by `scale`."""
    most = {u: vref / volts for u, volts in IN_VOLTS.items()} | {u: 1.0 / part for u, part in OF_VREF.items()}
    return {u: value / scale for u, value in most.items()}


def _off_steps(values: FloatArray, vref: float, bits: int) -> bool:
    """Return whether several whole numbers lie between the steps in millivolts of a converter, rounded."""
    step = 1000.0 * vref / 2.0**bits
    distinct = np.unique(values)
    off = np.abs(distinct - step * np.round(distinct / step))
    return step > 2.0 and int((off > 1.0).sum()) >= _FEW_CODES


def _on_steps(values: FloatArray, vref: float, bits: int) -> str:
    """Return "V" or "mV" where all readings are rounded images of a converter's codes, which others would not be."""
    texts = {f"{v:.9g}" for v in values.tolist()}
    places = max(len(t.partition(".")[2]) for t in texts)
    quantum = 10.0**-places
    for unit, full in (("V", vref), ("mV", 1000.0 * vref)):
        for codes in (2.0**bits - 1.0, 2.0**bits):
            step = full / codes
            chance = min(1.0, 1.01 * quantum / step) ** len(texts)  # that numbers at random lie so near
            off = np.abs(values - step * np.round(values / step))
            if len(texts) >= _FEW_CODES and chance < 1e-4 and (off <= 0.501 * quantum).all():
                return unit
    return ""

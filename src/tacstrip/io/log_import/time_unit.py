"""The unit of the time, and what its clock does."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.input_checks import unlikely_times
from tacstrip.io.log_import.columns import Columns
from tacstrip.io.log_import.contents import CLOCK_BITS
from tacstrip.io.log_import.fields import clock_seconds, is_of_two, number_of
from tacstrip.io.log_import.mapping import RESTARTS, ColumnMapping
from tacstrip.io.log_import.names import (
    CLOCKS,
    TIME_UNITS,
    UNITS,
    seconds_of,
    unknown_unit,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan, raw_times
from tacstrip.io.log_import.table import CLOCK, ROW

NO_TIME = "none"  # answered for a rate: times are left empty
_RATES_HZ = (0.12, 1000.0)  # scans per second that a log may have
_POSSIBLE_S = (1.5e-4, 3600.0)  # from scan to scan
_DRIFT = 0.05  # of the time: clocks that differ by less may drift
_OTHER_UNITS = ("86.4ms",)  # a millionth of a day, as of Siemens' logs
_EVEN = 0.2  # of the largest step: so much may others of a clock be less
_FEW_CODES = 6  # distinct readings that lie on a converter's steps: no chance
_FAR = 1e5  # usual steps: no pause is as long
_FAR_LAST = 300.0  # times the largest other step
_JUMP = 5.0  # usual steps: so much a clock may rise where it begins anew
_EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # since 1970, up to 2.2 times that
_SAME_TIME = 0.5  # of the scans: if more have the time of the one before, the clock is too coarse
_TIME_SAID = re.compile(
    r"\b(?:t|times?|zeit|temps|tiempo|tempo|tijd) (?:is |are )?in ([^\W\d_]+)\b", re.IGNORECASE
)
_TICKS = re.compile(r"(?<![^\W_])ticks?(?![^\W_])", re.IGNORECASE)  # of a timer, as a column's name
_USUAL_TICKS = ("ms", "10ms", "us")
_TICK = re.compile(r"\bticks?\s*(?:=|:|is|are|of|every)\s*(\d+(?:\.\d+)?)\s*(ms|us|s)\b", re.IGNORECASE)
_OF_ARDUINO = re.compile(r"\b(millis|micros)\b")  # functions
_LAST_HOUR = 23
_SAME_RATE = 0.02  # relative: steps that are those of a rate
_MOST_SAMPLES = 1000.0  # of a converter for a scan: its strips, times what it averages
_RATE = re.compile(
    r"\b(?:\w*(?:rate|frequenz|frequency|fs|freq|takt|sampled|sampling|recorded|logged)\w*)\b[^\d\n]{0,20}?([\d.,]+)\s*(k?)(?:hz|sps|s/s|1/s)",
    re.IGNORECASE,
)
# As "fs_hz: 50", "sampling rate [Hz], 100".
_RATE_NAMED = re.compile(
    r"(?<![^\W_])(?:f_?s|\w*rate|\w*(?:sampl|scan|acqui|abtast)\w*(?:[ _]\w+)?)"
    r"[ _]*[\[(]?(k?)hz[\])]?\s*[:=,;\t]\s*\"?([\d.,]+)",
    re.IGNORECASE,
)
# As JSON says it, without a unit.
_RATE_BARE = re.compile(
    r"[\"'](f_?s|(?:sampl\w*|scan|acquisition)[ _]?(?:rate|frequency))[\"']\s*:\s*(\d+(?:\.\d+)?)(?=\s*[,}\]])",
    re.IGNORECASE,
)
_RATE_BEHIND = re.compile(
    r"(?<![\w.,])(\d[\d.,]*)\s*(k?)(?:hz|sps)\s+(?:sampl|scan|rate|abtast|log|record)", re.IGNORECASE
)
# As "Acquisition with 8/8 channels at 10 Hz"; what a filter, the mains or a shaker does at a frequency is no rate.
_AT_RATE = re.compile(
    r"^(?!.*(?:filter|pass|cut-?off|mains|notch|pwm|excit|shak|vibrat|osc|press|tap|indent|mov|cycl|strok|load|rotat|slid))(?=.*(?:acqui|sampl|scan|channel|record|logg?ed"
    r"|measure|captur)).*\bat\s+(\d[\d.,]*)\s*(k?)(?:hz|sps)\b",
    re.IGNORECASE | re.MULTILINE,
)
# As "20 scans/s", "10 frames per second", "every 50 ms"; and "10 Hz" where no word says what else may be so often.
_SCANS_PER = re.compile(
    r"(?<![\w.,])(\d[\d.,]*)\s*(k?)(?:scans?|samples?|frames?|readings?|sweeps?|lines?|rows?|mess\w*|bilder)\s*(?:/|per|pro|par|por|al?)\s*s(?:ec\w*|ek\w*)?\b"
    r"|(?<![\w.,])(\d[\d.,]*)\s*(k?)fps\b",
    re.IGNORECASE,
)
_EVERY = re.compile(
    r"\b(?:every|each|alle|toutes les|tous les|cada|ogni|om de|elke|co)\s+(\d[\d.,]*)\s*(ms|s|sec|seconds|msec)\b"
    r"|(?<![\w.,])(\d[\d.,]*)\s*(ms|s|sec|seconds|msec)\s+(?:apart|per (?:scan|row|line|sample|frame)|between)\b",
    re.IGNORECASE,
)
_HERTZ = re.compile(
    r"^(?!.*(?:filter|pass|cut-?off|mains|hum|notch|pwm|excit|shak|vibrat|osc|press|tap|indent|mov|cycl|strok|load|rotat"
    r"|slid|noise|bandwidth|carrier|clock|sine|tone)).*?(?<![\w.,])(\d[\d.,]*)\s*(k?)hz\b",
    re.IGNORECASE | re.MULTILINE,
)
# As National Instruments' programs write it, in seconds.
_INCREMENT = re.compile(
    r"(?:^(?:# )?X_Dimension[\t;,]Time\b[\s\S]*?^(?:# )?Delta_X|^wf_increment)[\t;,]\s*([\d.,]+(?:E[+-]?\d+)?)",
    re.IGNORECASE | re.MULTILINE,
)
_PERIOD = re.compile(
    r"\b(?:\w*(?:interval|period|intervall|periode|delta[ _]?[tx]|dt|time ?step|schrittweite"
    r"|\u5468\u671f|\u9593\u9694|\u95f4\u9694|\uc8fc\uae30|\uac04\uaca9)\w*)\b[^\d\n]{0,20}?"
    r"([\d.,]+(?:e[+-]?\d+)?)[\s,;]*(s|ms|us|µs|sec|seconds|msec)\b",
    re.IGNORECASE,
)


def with_time(clues: Clues, mapping: ColumnMapping, found: Columns) -> ColumnMapping:
    """Return the mapping with the unit of its time and what its clock does, as far as the column says it."""
    if not found.time:
        return mapping
    clues.choice("restart", RESTARTS)
    unit = _answered_unit(clues) or _unit_of_name(clues, found)
    mapping = replace(mapping, time_unit=unit or "s")
    times = raw_times(clues.table, mapping)
    too_late = "time_unit" not in clues.answers and unit in TIME_UNITS and times[0] * TIME_UNITS[unit] > 2.2e9
    if (not unit or too_late) and (since := [u for u, s in _EPOCHS.items() if s <= abs(times[0]) <= 2.2 * s]):
        clues.because(f"{found.time}: {since[0]} since 1970")
        unit = since[0]
    if "time_unit" not in clues.answers and unit in TIME_UNITS:
        unit = _as_stamps_run(clues, found.time, times, unit)
    steps = np.diff(times)
    mapping = replace(mapping, time_unit=unit)
    return (
        mapping
        if unit in CLOCKS
        else replace(mapping, time_bits=_clock_bits(clues, found.time, times, steps))
    )


def _as_stamps_run(clues: Clues, name: str, times: FloatArray, unit: str) -> str:
    """Return the only unit in which a time spans what a column of dates and times of day does; else the unit named."""
    span = float(times[-1] - times[0])
    for stamps in (n for n in clues.table.names if n not in (name, CLOCK)):
        ends = [clues.table.column(stamps)[n] for n in (0, -1)]
        if any(number_of(t, clues.table.decimal) is not None or clock_seconds(t) is None for t in ends):
            continue
        other = (clock_seconds(ends[1]) or 0.0) - (clock_seconds(ends[0]) or 0.0)
        slack = _DRIFT * other + (0.0 if re.search(r"[.,]\d", ends[0]) else 1.0)
        fits = [u for u in (*TIME_UNITS, *_OTHER_UNITS) if abs(span * seconds_of(u) - other) <= slack]
        if span > 0.0 and other > 2.0 * slack and len(fits) == 1 and fits != [unit]:
            clues.doubt(
                f"{name}: taken in steps of {fits[0]}, for only so it runs as {stamps} does; else --answer "
                f"time_unit={unit}"
            )
            return fits[0]
    return unit


def _answered_unit(clues: Clues) -> str:
    answer = clues.answers.get("time_unit", "")
    if not seconds_of(answer) > 0.0:
        clues.choice("time_unit", (*TIME_UNITS, *CLOCKS, "2.5ms"))  # a tick of any length
    return answer


def _units_that_fit(step: float) -> list[str]:
    """Return the units in which a log with such a step from scan to scan has a rate that it may have."""
    units = ("s", "ms", "us", "days")
    return [u for u in units if step and _RATES_HZ[0] <= 1.0 / (step * TIME_UNITS[u]) <= _RATES_HZ[1]]


def _unit_of_name(clues: Clues, found: Columns) -> str:
    first = clues.table.column(found.time)[0]
    if number_of(first, clues.table.decimal) is None and clock_seconds(first) is not None:
        clues.because(f"{found.time}: times of day or dates, such as {first}")
        return _of_two_parts(clues, found.time)
    unit = found.meanings[found.time].unit
    above = "\n".join(clues.table.preamble)
    said = {UNITS.get(u.casefold(), "") for u in _TIME_SAID.findall(above)}
    said = said or {{"millis": "ms", "micros": "us"}[word] for word in _OF_ARDUINO.findall(above)}
    if unit not in TIME_UNITS and len(said) == 1 and said <= {*TIME_UNITS}:
        clues.because(f"{found.time} is in {min(said)}, as a line above says")
        return said.pop()
    if unit not in TIME_UNITS and (tick := _TICK.search(above)) and _TICKS.search(found.time):
        clues.because(f"{found.time}: {tick[0]!r}, as a line above says")
        return f"{tick[1]}{tick[2]}"
    return unit if unit in TIME_UNITS else ""


def _of_two_parts(clues: Clues, name: str) -> str:
    """Return whether times such as 14:05 are hours and minutes or minutes and seconds; "clock" for all others."""
    fields = clues.table.column(name)
    if not all(map(is_of_two, fields)):
        return "clock"
    if max(int(f.partition(":")[0]) for f in fields) > _LAST_HOUR:
        return "mm:ss"
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
    untimed = clues.answers.get("rate_hz") == NO_TIME
    rate = None if untimed else clues.number("rate_hz")
    steps = np.diff(np.array([s.time_s for s in rough]))
    coarse = bool(mapping.time and len(steps) and (steps == 0.0).mean() > _SAME_TIME)
    if coarse:
        if (steps != 0.0).any() or rate is None:
            clues.because(f"{mapping.time}: most scans have the time of the one before, so it says nothing")
        mapping = replace(mapping, time="", time_unit="s", time_bits=0)
    if not mapping.time:
        return _with_rate(clues, mapping, len(rough), rate or _rate_above(clues), coarse)
    _refuse_jumps(rough, steps)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if mapping.time_unit and step and "time_unit" not in clues.answers:
        mapping = _by_rate(clues, mapping, step, rate)
    if mapping.time_unit or len(rough) < 2:
        if "time_unit" not in clues.answers and step and not _POSSIBLE_S[0] <= step <= _POSSIBLE_S[1]:
            _ask_for_strange(clues, mapping, step)
        elif "time_unit" not in clues.answers and mapping.time_unit == "s" and not rate:
            clues.doubt(unlikely_times(mapping.time, np.array([s.time_s for s in rough])))
        return replace(mapping, time_unit=mapping.time_unit or "s")
    if rate and step:  # which tells the unit, or that the column is no time
        return _of_rate(clues, mapping, step, rate)
    return _of_steps(clues, mapping, step, counts=step == 1.0 and set(steps.tolist()) == {1.0})


def _with_rate(
    clues: Clues, mapping: ColumnMapping, scans: int, rate: float | None, coarse: bool
) -> ColumnMapping:
    """Return the mapping of a log without a time, by its rate, or a column that rises evenly; else that is asked."""
    if clues.answers.get("rate_hz") == NO_TIME:
        clues.doubt(
            "the log has no time: time_s is left empty, and what needs it (velocities, drift, recordings) is not "
            "told; if you know the scans per second, --answer rate_hz=50"
        )
    elif rate is None and scans > 1:
        even = _even_column(clues, mapping, scans)
        if even and (unit := _answered_unit(clues) or even * (even in TIME_UNITS)):
            clues.because(f"{even}: rises evenly, and no other column is the time")
            return replace(mapping, time=even, time_unit=unit)
        if even:
            values = [v for v in clues.values(even) if v is not None]
            step = float(np.median(np.diff(sorted({*values}))))
            clues.ask(
                "time_unit",
                f"no name says the time, and {even!r} rises evenly, by {step:g}: if it is, in which unit (0.4ms: "
                "by the ticks of a timer)? Or give rate_hz",
                *(_units_that_fit(step) or ("s", "ms", "us")), of_form=True,
            )  # fmt: skip
        else:
            text = f"the log has {scans} scans and no time: how many scans per second?"
            default = "" if coarse or _has_stamps(clues) else NO_TIME
            clues.ask("rate_hz", text, "50", NO_TIME, default=default)
    return replace(mapping, rate_hz=rate or 0.0)


def _refuse_jumps(rough: list[LogScan], steps: FloatArray) -> None:
    """Refuse a time that jumps at the first or the last scan as nowhere else."""
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


def _ask_for_strange(clues: Clues, mapping: ColumnMapping, step: float) -> None:
    """Ask for the unit of a time in whose own unit scans would come as they hardly can."""
    raw = step / TIME_UNITS.get(mapping.time_unit, 1.0)
    rates = _rates_above(clues)
    so = [u for u in ("ms", "us", "s") if len(rates) == 1 and _is_rate(raw * TIME_UNITS[u], min(rates))]
    clues.ask(
        "time_unit",
        f"{mapping.time} would rise by {step:g} s from scan to scan: in which unit is it?"
        + (f" (A line above says {min(rates):g} Hz, as they would be in {so[0]})" if so else ""),
        "ms", "us", "s",
    )  # fmt: skip


def _of_rate(clues: Clues, mapping: ColumnMapping, step: float, rate: float) -> ColumnMapping:
    """Return the mapping with the unit in which a time has a rate; without that column where it has it in none."""
    told = [u for u in ("s", "ms", "us") if _is_rate(step * TIME_UNITS[u], rate)]
    if not told:
        clues.doubt(
            f"{mapping.time!r} rises by {step:g} from scan to scan, which is {rate:g} scans per second in no unit: "
            "it is passed over"
        )
        return replace(mapping, time="", time_unit="s", time_bits=0, rate_hz=rate)
    clues.because(f"{mapping.time} is in {told[0]}, at {rate:g} scans per second")
    return replace(mapping, time_unit=told[0])


def _of_steps(clues: Clues, mapping: ColumnMapping, step: float, counts: bool) -> ColumnMapping:
    """Return the mapping with the only unit in which scans come as they may; asked where there are several."""
    fits, strange = _units_that_fit(step), unknown_unit(mapping.time)
    told = [u for u in fits if _is_unit_told(clues, mapping.time, u, step)]
    if not strange and len(told) == 1:
        clues.because(f"{mapping.time} is in {told[0]}, as a line above says")
        return replace(mapping, time_unit=told[0])
    if _TICKS.search(mapping.time):  # of an operating system, as a rule
        fits = [
            u for u in _USUAL_TICKS if step and _RATES_HZ[0] <= 1.0 / (step * seconds_of(u)) <= _RATES_HZ[1]
        ]
    elif len(fits) == 1 and not strange:
        if fits != ["days"] and step == round(step):  # which may count the ticks of any clock
            clues.doubt(
                f"{mapping.time} rises by {step:g} from scan to scan, and nothing says its unit: taken as {fits[0]}, "
                f"so {1.0 / (step * TIME_UNITS[fits[0]]):g} scans per second; else --answer rate_hz=... or time_unit=us"
            )
        clues.because(f"{mapping.time} is in {fits[0]}: it rises by {step:g} from scan to scan")
        return replace(mapping, time_unit=fits[0])
    clues.ask(
        "time_unit",
        f"{mapping.time} rises by {step:g} from scan to scan: in which unit?"
        + (f" ({strange!r} is none that is known: if it is none of these, write seconds)" if strange else "")
        + (
            " (any other tick can be written so: 0.1ms, or 1/1024s of a clock of 1024 Hz)"
            if _TICKS.search(mapping.time)
            else ""
        )
        + (" (If it only counts the scans, --answer rate_hz=50 with their rate instead)" if counts else ""),
        *(fits or ("s", "ms", "us")),
    )
    return replace(mapping, time_unit="s")


def _has_stamps(clues: Clues) -> bool:
    """Return whether a column holds times of day or dates on most lines, of which others may be damaged."""
    columns = map(clues.table.column, clues.table.names)
    return any(
        2 * sum(number_of(f) is None and clock_seconds(f) is not None for f in fields) > len(fields)
        for fields in columns
    )


def _by_rate(clues: Clues, mapping: ColumnMapping, step: float, rate: float | None) -> ColumnMapping:
    """Return the mapping with the unit of its time that an answered rate tells; ask where a line says another rate."""
    rates = {rate} if rate else _rates_above(clues)
    if len(rates) != 1 or _is_rate(step, min(rates)):
        return mapping
    (hz,) = rates
    raw = step / TIME_UNITS.get(mapping.time_unit, 1.0)
    fits = [
        u for u in ("s", "ms", "us") if mapping.time_unit in TIME_UNITS and _is_rate(raw * TIME_UNITS[u], hz)
    ]
    told = f"{mapping.time} is in {mapping.time_unit}, so that it rises by {step:g} s from scan to scan"
    if fits and not rate:
        clues.ask(
            "time_unit",
            f"{told}, and the log says {hz:g} Hz, as it would be in {fits[0]}: in which unit is it?",
            fits[0], mapping.time_unit,
        )  # fmt: skip
    elif fits:
        clues.doubt(f"{told}; at {hz:g} scans per second it is in {fits[0]}, and is taken so")
        return replace(mapping, time_unit=fits[0])
    elif rate or (mapping.time_unit in TIME_UNITS and not 1.0 - _SAME_RATE < step * hz < _MOST_SAMPLES):
        clues.doubt(f"{told}, and {hz:g} Hz are said: the time is taken as it stands")
    return mapping


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


def _is_unit_told(clues: Clues, name: str, unit: str, step: float) -> bool:
    """Return whether lines above say that a time is in a unit ("t in ms"), or a rate that it has only in that."""
    text = "\n".join(clues.table.preamble)
    said = {
        UNITS.get(u.lower(), u) for u in re.findall(rf"\b{re.escape(name)} in (?:the )?([a-zµ]+)\b", text)
    }
    rates = _rates_above(clues)
    return said == {unit} or (not said and len(rates) == 1 and _is_rate(step * TIME_UNITS[unit], min(rates)))


def _is_rate(step_s: float, rate_hz: float) -> bool:
    """Return whether a step from scan to scan is that of a rate."""
    return abs(step_s * rate_hz - 1.0) < _SAME_RATE


def _rate_above(clues: Clues) -> float | None:
    """Return the rate that the lines above the table say, if only one."""
    rates = _rates_above(clues) or _rates_in_words("\n".join(clues.table.preamble))
    if len(rates) != 1:
        return None
    clues.because(f"{min(rates):g} scans per second, by a line above the table")
    return rates.pop()


def _rates_in_words(text: str) -> set[float]:
    """Return the rates [Hz] that a log without a time says in passing.

    Examples
    --------
    >>> _rates_in_words("pad 7, 20 scans/s"), _rates_in_words("a scan every 50 ms"), _rates_in_words("run 3, 10 Hz")
    ({20.0}, {20.0}, {10.0})
    >>> _rates_in_words("pressed at 2 Hz")
    set()
    """

    def number(digits: str) -> float:
        return number_of(digits.rstrip(".,"), "," if "," in digits else ".") or 0.0

    said = {number(a or b) * (1000.0 if k or c else 1.0) for a, k, b, c in _SCANS_PER.findall(text)}
    said |= {
        1.0 / (number(a or b) * TIME_UNITS["ms" if (u or v).casefold().startswith("ms") else "s"])
        for a, u, b, v in _EVERY.findall(text)
        if number(a or b)
    }
    said = said or {number(a) * (1000.0 if k else 1.0) for a, k in _HERTZ.findall(text)}
    return said - {0.0}


def _rates_above(clues: Clues) -> set[float]:
    """Return the rates [Hz] that the lines above the table say, as such or as periods."""
    text = "\n".join(clues.table.preamble)
    if steps := {number_of(d, "," if "," in d else ".") for d in _INCREMENT.findall(text)} - {None, 0.0}:
        return {1.0 / step for step in steps if step}
    rates = {
        value * (1000.0 if kilo else 1.0)
        for digits, kilo in (
            *_RATE.findall(text),
            *_RATE_BEHIND.findall(text),
            *_AT_RATE.findall(text),
            *(named[::-1] for named in _RATE_NAMED.findall(text)),
            *((bare, "") for _, bare in _RATE_BARE.findall(text)),
        )
        if (value := number_of(digits.rstrip(".,"), "," if "," in digits else "."))
    }
    rates |= {
        1.0 / (value * TIME_UNITS[{"sec": "s", "seconds": "s", "msec": "ms", "µs": "us"}.get(unit, unit)])
        for digits, unit in ((d, u.casefold()) for d, u in _PERIOD.findall(text))
        if (value := number_of(digits.rstrip(".,"), "," if "," in digits else "."))
    }
    return rates

"""Guess what the columns of a log are: each guess has a reason, and what cannot be known is a question."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, ReadingError, one_of
from tacstrip.io.log_import.mapping import CHANNELS, ColumnMapping
from tacstrip.io.log_import.names import READING_UNITS, TIME_UNITS, Meaning, meaning, pair_of
from tacstrip.io.log_import.scans import LogScan, clock_seconds, scans, strip_numbers
from tacstrip.io.log_import.table import CLOCK, NOTHING, Table, number_of
from tacstrip.sensor.spec import Sensor

_ROLES = ("time", "scan", "strip", "which", "skip", *CHANNELS)
_KEYS = (
    "time_unit",
    "rate_hz",
    "strip_base",
    "strips",
    "unit",
    "untouched",
    "missing",
    "broken_lines",
    "vref_volt",
    "exchanged",
    "order",
)
_RATES_HZ = (0.12, 20_000.0)  # scans per second that a log may have
_ABOVE = 0.95  # of the strips: k_h is above k_l there, and so the names are clear
_APART = 0.004  # over the largest reading: by which k_h and k_l differ, in the median
_SENTINELS = (999.0, 9999.0, 99999.0, 32767.0, 65535.0, 99.9, 99.99, 999.9, 999.99)
_NEAR_0 = 0.01  # of the largest reading; and of the most that there can be


@dataclass(frozen=True)
class Question:
    """What the log does not tell: the key of the answer, and what is asked."""

    key: str
    text: str


class Unanswered(Exception):  # noqa: N818, it is no error of the user's
    """Questions that must be answered before the log can be read."""

    def __init__(self, *questions: Question) -> None:
        super().__init__("; ".join(q.text for q in questions))
        self.questions = questions


@dataclass(frozen=True)
class Proposal:
    """A mapping, the scans that it gives, and why."""

    mapping: ColumnMapping
    scans: list[LogScan]
    reasons: tuple[str, ...]


def propose(table: Table, sensor: Sensor | None = None, answers: Mapping[str, str] | None = None) -> Proposal:
    """Propose how to read a log.

    Parameters
    ----------
    table
        What it holds.
    sensor
        That it is of, which tells the number of strips, Vref and the converter.
    answers
        To questions: by their key, or by a column's name ("h", "l", "out", "3:h", "time", "scan", "strip", "which",
        "skip").

    Raises
    ------
    Unanswered
        Something cannot be known from the log.
    ReadingError
        Something in it cannot be a reading.
    OptionError
        An answer to nothing, or one that is not possible.
    """
    guess = _Guess(table, sensor, dict(answers or {}))
    return guess.proposal()


class _Guess:
    def __init__(self, table: Table, sensor: Sensor | None, answers: dict[str, str]) -> None:
        self.table, self.sensor, self.answers = table, sensor, answers
        self.reasons: list[str] = list(table.remarks)
        self.questions: list[Question] = []
        self.paired = False  # channels of which no name tells the end
        for key, answer in answers.items():
            if key not in _KEYS and key not in table.names:
                raise OptionError(
                    f"--answer {key}={answer}: no question has that key, and no column that name; "
                    + one_of("key", key, (*_KEYS, *table.names))
                )
            if key in table.names and answer not in _ROLES and not re.fullmatch(r"-?\d+:(h|l|out)", answer):
                raise OptionError(
                    f"--answer {key}={answer}: " + one_of("role of a column", answer, (*_ROLES, "3:h"))
                )
        self.expected = () if sensor is None else ("out",) if sensor.signatures == ("k",) else ("h", "l")

    def proposal(self) -> Proposal:
        self.meanings = self._meanings()
        columns, strip, which = self._columns()
        time = self._role("time")
        scan = self._role("scan")
        base, count = self._strips(columns, strip)
        mapping = ColumnMapping(
            columns=columns, unit="V",
            strips=count, strip_base=base, scan=scan if strip else "", strip=strip, which=which, time=time,
            broken_lines=self._broken(), untouched=self._untouched(columns), missing="untouched",
        )  # fmt: skip
        self._stop()
        self._check_answer("missing", ("untouched", "error"))
        mapping = replace(mapping, time_unit=self._clock(time) if time else "s")
        seconds = replace(mapping, time_unit=mapping.time_unit or "s")
        rough = scans(self.table, seconds)
        mapping = replace(mapping, missing=self._missing(seconds))
        mapping = self._time(mapping, rough)
        mapping = replace(mapping, columns=self._ends(mapping, rough))
        mapping = self._unit(mapping, rough)
        self._stop()
        return Proposal(mapping, scans(self.table, mapping), tuple(self.reasons))

    def _stop(self) -> None:
        if self.questions:
            raise Unanswered(*self.questions)

    def _ask(self, key: str, text: str) -> None:
        self.questions.append(Question(key, text))

    def _check_answer(self, key: str, known: tuple[str, ...]) -> str:
        answer = self.answers.get(key, "")
        if answer and answer not in known:
            raise OptionError(f"--answer {key}={answer}: " + one_of(key, answer, known))
        return answer

    def _number(self, key: str) -> float | None:
        if key not in self.answers:
            return None
        value = number_of(self.answers[key])
        if value is None or value < 0.0:
            raise OptionError(f"--answer {key}={self.answers[key]}: not a number of 0 or more")
        return value

    # Columns

    def _meanings(self) -> dict[str, Meaning]:
        if not self.table.named and not any(name in self.answers for name in self.table.names):
            return self._unnamed()
        found = {}
        for name in self.table.names:
            known = Meaning("time", unit="s") if name == CLOCK else meaning(name)
            fields = set(self.table.column(name))
            if len(fields) == 2 and {meaning(f).channel for f in fields} == {"h", "l"}:
                known = Meaning("which")
            if answer := self.answers.get(name, ""):
                strip, _, channel = answer.rpartition(":")
                role = "reading" if channel in CHANNELS else answer
                known = Meaning(
                    role, channel if role == "reading" else "", int(strip) if strip else None, known.unit
                )
            found[name] = known
        if (
            any(m.role == "time" and n != CLOCK for n, m in found.items())
            and CLOCK in found
            and CLOCK not in self.answers
        ):
            found[CLOCK] = Meaning("skip")  # the device's own clock is better
        return found

    def _unnamed(self) -> dict[str, Meaning]:
        """Guess the columns of a log without names, from their number and how they rise."""
        names, sensor = list(self.table.names), self.sensor
        found: dict[str, Meaning] = {}
        if CLOCK in names:
            found[CLOCK] = Meaning("time", unit="s")
            names.remove(CLOCK)
        values = {n: [number_of(t, self.table.decimal) for t in self.table.column(n)] for n in names}
        channels = max(len(self.expected), 1)
        wide = channels * sensor.strips if sensor else 0
        rising = [n for n in names if _rises(values[n])]
        spare = len(names) - wide - len(set(rising) & set(names[:2]))
        if sensor and spare > 0 and not any(self.table.column(names[-1])):  # each line ends with a separator
            names = names[:-1]
        if (
            sensor
            and wide <= len(names) <= wide + 2
            and (len(names) == wide or set(rising) >= set(names[: len(names) - wide]))
        ):
            extra, rest = names[: len(names) - wide], names[len(names) - wide :]
            if len(extra) == 2:
                found[extra[0]] = Meaning("scan")
            if extra:
                found[extra[-1]] = Meaning("time")
                self.reasons.append(f"{extra[-1]}: rises from line to line, so it is the time")
            order = self._check_answer("order", ("alternating", "blocks"))
            order = order or (self._order(rest, values) if channels == 2 else "")
            if channels == 2 and not order:
                self._ask(
                    "order",
                    "the columns have no names: are they h, l, h, l, ... (alternating), or all "
                    "h and then all l (blocks)?",
                )
            for n, name in enumerate(rest):
                at = (
                    (n // channels, n % channels)
                    if order == "alternating" or channels == 1
                    else (n % sensor.strips, n // sensor.strips)
                )
                found[name] = Meaning("reading", self.expected[at[1]], at[0])
            self.reasons.append(f"{wide} columns without names are the {sensor.strips} strips in their order")
            return found
        cycles = [n for n in names if _cycles(values[n])]
        rest = [n for n in names if n not in cycles and n not in rising]
        if len(cycles) == 1 and (not sensor or len(rest) == channels) and len(rest) in (1, 2):
            found |= {
                cycles[0]: Meaning("strip"),
                **dict(zip(rest, (Meaning("reading", c) for c in "ab"), strict=False)),
            }
            if len(rest) == 1:
                found[rest[0]] = Meaning("reading")
            found |= {n: Meaning("time" if n == rising[-1] else "scan") for n in rising}
            self.reasons.append(
                f"{cycles[0]}: whole numbers that come again and again, so they are the strips"
            )
            return found
        self._ask(
            names[0],
            f"the {len(names)} columns have no names: say what each is, such as --answer "
            f"'{names[0]}=time' --answer '{names[-1]}=h'"
            + ("" if sensor else "; or name the SENSOR, whose strips may tell"),
        )
        self._stop()
        raise AssertionError

    def _order(self, names: list[str], values: dict[str, list[float | None]]) -> str:
        """Return in which order columns of h and l stand: that in which k_h is the larger, if only one is."""
        table = np.array([[np.nan if v is None else v for v in values[n]] for n in names]).T
        half = len(names) // 2
        ways = {"alternating": (table[:, 0::2], table[:, 1::2]), "blocks": (table[:, :half], table[:, half:])}
        holds = [way for way, (high, low) in ways.items() if _above(high, low)]
        if len(holds) == 1:
            self.reasons.append(f"columns are {holds[0]}: only so is k_h above k_l everywhere, as it must be")
        return holds[0] if len(holds) == 1 else ""

    def _role(self, role: str) -> str:
        there = [name for name, m in self.meanings.items() if m.role == role]
        if (
            role == "time" and len(there) > 1
        ):  # a date beside a time of day says nothing more; of two clocks the finer
            steady = [n for n in there if len(set(self.table.column(n))) > 1] or there[:1]
            there = sorted(steady, key=lambda n: -len(set(self.table.column(n))))[:1]
        if role == "scan" and len(there) > 1:
            there = sorted(there, key=lambda n: -len(set(self.table.column(n))))[-1:]
        if len(there) > 1:
            self._ask(
                there[1],
                f"both {there[0]!r} and {there[1]!r} look like the {role}: which is not? "
                f"--answer '{there[1]}=skip'",
            )
        if there:
            what = {"scan": "scan's number", "strip": "strip's number", "which": "channel's name"}.get(
                role, role
            )
            self.reasons.append(f"{there[0]}: the {what}")
        return there[0] if there else ""

    def _columns(self) -> tuple[dict[str, str], str, str]:
        readings = {n: m for n, m in self.meanings.items() if m.role == "reading"}
        passed = [n for n, m in self.meanings.items() if m.role in ("", "position", "skip") and n != CLOCK]
        strip = self._role("strip")
        if not readings:
            shown = ", ".join(self.table.names[:8]) + (", ..." if len(self.table.names) > 8 else "")
            self._ask(
                self.table.names[-1],
                f"no column's name says that it holds readings (they are: {shown}); say it, such "
                f"as --answer '{self.table.names[-1]}=h'",
            )
            self._stop()
        if strip:  # a number in a name is then of a channel
            readings = {
                n: replace(m, strip=None, channel=m.channel or ("" if m.strip is None else str(m.strip)))
                for n, m in readings.items()
            }
        elif any(m.strip is None for m in readings.values()) and any(
            m.strip is not None for m in readings.values()
        ):
            odd = [n for n, m in readings.items() if m.strip is None]
            passed += odd
            readings = {n: m for n, m in readings.items() if m.strip is not None}
        which = self._role("which") if strip and len(readings) == 1 else ""
        if not strip and len(readings) and all(m.strip is None for m in readings.values()):
            if (self.sensor is not None and self.sensor.strips == 1) or len(self.table.rows) == (
                self.sensor.strips if self.sensor else -1
            ):
                self._ask(
                    self.table.names[0],
                    "no column says the strip; is each line one strip? Add a column with its number",
                )
            else:
                self._ask(
                    self.table.names[0],
                    "no column says which strip a line is of: name it, such as --answer '"
                    + self.table.names[0]
                    + "=strip'",
                )
            self._stop()
        if passed:
            self.reasons.append(f"passed over: {', '.join(passed)}")
        columns = self._channels(readings, which)
        return columns, strip, which

    def _channels(self, readings: dict[str, Meaning], which: str) -> dict[str, str]:
        """Return column -> what it is; where names tell no end, the readings will (`_ends`)."""
        kinds = {m.channel for m in readings.values()}
        expected = self.expected or (
            ("h", "l") if kinds & {"h", "l"} or len(kinds) == 2 or which else ("out",)
        )
        per_strip = Counter(m.strip for m in readings.values())
        if which:
            return dict.fromkeys(readings, "h")
        if expected == ("out",):
            if kinds & {"h", "l"} and max(per_strip.values()) == 1 and len(kinds) == 1:
                name = next(iter(readings))
                self._ask(
                    name,
                    f"{name!r} looks like one of two channels, and the sensor has one output "
                    f"only: --answer '{name}=out' if it is that",
                )
            chosen = dict.fromkeys(readings, "out")
        elif kinds <= {"h", "l"}:
            chosen = {n: m.channel for n, m in readings.items()}
        elif len(kinds) == 2 and (pair_of(kinds) or all(k.isdigit() for k in kinds)):
            first, _ = sorted(kinds) if not pair_of(kinds) else pair_of(kinds) or ("", "")
            chosen = {n: "h" if m.channel == first else "l" for n, m in readings.items()}
            self.paired = True
        elif len(kinds) == 1 and len(self.expected) == 2:
            name = next(iter(readings))
            numbers = sorted(s for s in per_strip if s is not None)
            if self.sensor and len(numbers) == 2 * self.sensor.strips:
                return self._numbered(readings, numbers)
            self._ask(
                name,
                f"there is one reading for each strip, and the sensor has two: is {name!r} v_h "
                f"or v_l? --answer '{name}=...' (h or l)",
            )
            chosen = dict.fromkeys(readings, "h")
        else:
            odd = next(n for n, m in readings.items() if m.channel not in ("h", "l"))
            self._ask(odd, f"is {odd!r} v_h, v_l, or neither? --answer '{odd}=...' (h, l, out or skip)")
            chosen = dict.fromkeys(readings, "h")
        if len(readings) > len({(m.strip, chosen[n]) for n, m in readings.items()}):
            twice = [
                n
                for n, m in readings.items()
                if sum((m.strip, chosen[n]) == (o.strip, chosen[p]) for p, o in readings.items()) > 1
            ]
            self._ask(
                twice[1],
                f"{twice[0]!r} and {twice[1]!r} look like the same channel of a strip: which is "
                f"it? --answer '{twice[1]}=skip'",
            )
        said = {c: [n for n in readings if chosen[n] == c] for c in CHANNELS}
        for channel, names in said.items():
            if names:
                self.reasons.append(f"{names[0]}{' ... ' + names[-1] if len(names) > 1 else ''}: v_{channel}")
        return {n: chosen[n] if m.strip is None else f"{m.strip}:{chosen[n]}" for n, m in readings.items()}

    def _numbered(self, readings: dict[str, Meaning], numbers: list[int]) -> dict[str, str]:
        """Take 2 n numbered inputs as h and l of n strips, in the order that the readings allow."""
        assert self.sensor is not None
        by_number = {m.strip: n for n, m in readings.items()}
        names = [by_number[i] for i in numbers]
        values = {n: [number_of(t, self.table.decimal) for t in self.table.column(n)] for n in names}
        order = self._check_answer("order", ("alternating", "blocks")) or self._order(names, values)
        if not order:
            self._ask(
                "order",
                f"{names[0]} to {names[-1]} are two for each strip: h, l, h, l, ... "
                f"(alternating), or all h and then all l (blocks)?",
            )
        many = self.sensor.strips
        at = [(n // 2, n % 2) if order == "alternating" else (n % many, n // many) for n in range(2 * many)]
        return {name: f"{strip}:{'hl'[end]}" for name, (strip, end) in zip(names, at, strict=True)}

    def _ends(self, mapping: ColumnMapping, rough: list[LogScan]) -> dict[str, str]:
        """Return the columns with the ends that the readings confirm: k_h is never below k_l."""
        columns = mapping.columns
        if mapping.channels != ("h", "l"):
            return columns
        both = np.stack([s.values for s in rough])
        high, low = both[:, :, 0], both[:, :, 1]
        swapped = {n: what[:-1] + {"h": "l", "l": "h"}[what[-1]] for n, what in columns.items()}
        if self.paired:
            if _above(high, low) or _above(low, high):
                chosen = columns if _above(high, low) else swapped
                name = next(n for n, what in chosen.items() if what.endswith("h"))
                self.reasons.append(f"{name}: v_h, for it is the larger on every strip, as k_h must be")
                return chosen
            name = next(iter(columns))
            self._ask(
                name,
                f"which of the two channels is v_h? Neither is the larger everywhere. --answer "
                f"'{name}=h' and so on",
            )
            return columns
        answer = self._check_answer("exchanged", ("yes", "no"))
        if answer == "yes" or (not answer and not mapping.which and _above(low, high)):
            if not answer:
                self._ask(
                    "exchanged",
                    "v_h is below v_l on nearly every strip, which no sensor reads: are the "
                    "columns exchanged (yes, no)?",
                )
            return swapped
        return columns

    # Strips, scans, lines

    def _strips(self, columns: dict[str, str], strip: str) -> tuple[int, int]:
        if strip:
            found = set(strip_numbers(self.table, strip))
        else:
            found = {int(what.partition(":")[0]) for what in columns.values()}
        low, high = min(found), max(found)
        base = self._number("strip_base")
        many = self._number("strips")
        count = self.sensor.strips if self.sensor else int(many) if many else 0
        if base is None:
            fits = [b for b in (0, 1) if low >= b and (not count or high <= b + count - 1)]
            if count and not fits:
                raise ReadingError(
                    f"strips are numbered {low} to {high}, and the sensor has {count}; check strips in the spec"
                )
            if low in (0, 1) and low in fits and (not count or len(found) == count or len(fits) == 1):
                base = low
            elif len(fits) == 1:
                base = fits[0]
            else:
                self._ask("strip_base", f"strips are numbered {low} to {high}: is the first one 0 or 1?")
                base = 0
        self.reasons.append(f"strips are numbered from {int(base)}")
        return int(base), count or high - int(base) + 1

    def _broken(self) -> str:
        broken = self.table.broken
        if not broken or self._check_answer("broken_lines", ("skip", "error")):
            return self.answers.get("broken_lines", "error")
        if set(broken) <= {self.table.lines[0] - 1, min(broken)} and broken[0] < self.table.lines[0]:
            self.reasons.append(f"line {broken[0]} passed over: the log begins in the middle of it")
            return "skip"
        shown = ", ".join(map(str, broken[:5])) + (", ..." if len(broken) > 5 else "")
        self._ask("broken_lines", f"line(s) {shown} are not like the others: leave them out (skip)?")
        return "skip"

    def _missing(self, mapping: ColumnMapping) -> str:
        if answer := self.answers.get("missing"):
            return answer
        try:
            scans(self.table, replace(mapping, missing="error"))
        except ReadingError as error:
            if "no line for strip" not in str(error):
                raise
            self._ask(
                "missing", f"{str(error).partition(';')[0]}: are strips without a line untouched (untouched)?"
            )
            return "untouched"
        return "error"

    # Numbers

    def _untouched(self, columns: dict[str, str]) -> tuple[str, ...]:
        if (answer := self.answers.get("untouched")) is not None:
            return (
                ()
                if answer in ("none", "empty")
                else tuple(filter(None, (a.strip() for a in answer.split(","))))
            )
        fields = Counter(text for name in columns for text in self.table.column(name))
        words = [
            t for t in fields if number_of(t, self.table.decimal) is None and t.casefold() not in NOTHING
        ]
        if words:
            line = next(
                i for i, row in zip(self.table.lines, self.table.rows, strict=True) if words[0] in row
            )
            self._ask(
                "untouched",
                f"line {line}: {words[0]!r} is no number; does it stand for no contact? --answer "
                f"'untouched={words[0]}'",
            )
            return (words[0],)
        numbers = Counter(
            {float(number_of(t, self.table.decimal) or 0.0): 0 for t in fields if t.casefold() not in NOTHING}
        )
        for text, many in fields.items():
            if text.casefold() not in NOTHING:
                numbers[float(number_of(text, self.table.decimal) or 0.0)] += many
        found: list[float] = []
        negative = [v for v in numbers if v < 0.0]
        if len(negative) == 1 and (negative[0] <= -1.0):
            found += negative
            self.reasons.append(f"{negative[0]:g} stands for no contact: it is the only negative number")
        rest = sorted(v for v in numbers if v not in found)
        if len(rest) > 1 and rest[-1] in _SENTINELS and rest[-2] < 0.5 * rest[-1]:
            found.append(rest[-1])
            self.reasons.append(f"{rest[-1]:g} stands for no contact: all other readings are far below it")
            rest.pop()
        if self.sensor is None or self.sensor.rest_volt is None:
            zeros, above = numbers.get(0.0, 0), [v for v in rest if v > 0.0]
            if zeros > 1 and above and not any(t.casefold() in NOTHING for t in fields) and not found:
                share = zeros / sum(numbers.values())
                if share > 0.05 and min(above) > _NEAR_0 * max(above):
                    self._ask(
                        "untouched",
                        f"{100 * share:.0f} % of the readings are exactly 0, and no other is "
                        f"below {min(above):g}: does 0 stand for no contact "
                        "(untouched=0), or is it a reading (untouched=none)?",
                    )
        return tuple(f"{v:g}" for v in found)

    def _clock(self, time: str) -> str:
        """Return the unit of the time where the column says it, "" where its numbers must tell."""
        if answer := self._check_answer("time_unit", (*TIME_UNITS, "clock")):
            return answer
        first = self.table.column(time)[0]
        if number_of(first, self.table.decimal) is None and clock_seconds(first) is not None:
            self.reasons.append(f"{time}: times of day or dates, such as {first}")
            return "clock"
        return self.meanings[time].unit

    def _time(self, mapping: ColumnMapping, rough: list[LogScan]) -> ColumnMapping:
        rate = self._number("rate_hz")
        if not mapping.time:
            if rate is None and len(rough) > 1:
                self._ask(
                    "rate_hz",
                    f"the log has {len(rough)} scans and no time: how many scans per second (rate_hz=100)?",
                )
            return replace(mapping, rate_hz=rate or 0.0)
        if mapping.time_unit:
            return mapping
        steps = np.diff([s.time_s for s in rough])
        step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        fits = [
            u
            for u in ("s", "ms", "us")
            if step and _RATES_HZ[0] <= 1.0 / (step * TIME_UNITS[u]) <= _RATES_HZ[1]
        ]
        if len(fits) == 1:
            self.reasons.append(f"{mapping.time} is in {fits[0]}: it rises by {step:g} from scan to scan")
            return replace(mapping, time_unit=fits[0])
        if len(rough) > 1:
            self._ask(
                "time_unit",
                f"{mapping.time} rises by {step:g} from scan to scan: in which unit "
                f"({', '.join(fits) or 's, ms, us'})?",
            )
        return replace(mapping, time_unit="s")

    def _unit(self, mapping: ColumnMapping, rough: list[LogScan]) -> ColumnMapping:
        values = np.concatenate([s.values.ravel() for s in rough])
        values = values[np.isfinite(values)]
        answer = self._check_answer("unit", READING_UNITS)
        vref = self._number("vref_volt") or (self.sensor.vref_volt if self.sensor else 0.0)
        if not len(values):
            return replace(mapping, unit=answer or "V")
        named = {self.meanings[n].unit for n in mapping.columns} - {""}
        unit = answer or (named.pop() if len(named) == 1 else self._by_size(values, vref))
        if unit in ("fraction", "percent") and not vref:
            self._ask(
                "vref_volt",
                "the readings are over Vref: which is it in volts (vref_volt=5)? Or name the SENSOR",
            )
        top = {"V": vref, "mV": 1000.0 * vref, "fraction": 1.0, "percent": 100.0}.get(unit, 0.0)
        if unit == "code":
            bits = self.sensor.adc_bits if self.sensor else None
            top = 2.0**bits - 1.0 if bits else 0.0
            if (values != np.round(values)).any():
                self._ask(
                    "unit",
                    f"the readings are called codes, and "
                    f"{values[values != np.round(values)][0]:g} is none: which unit ({', '.join(READING_UNITS)})?",
                )
        if unit and top and values.max() > 1.01 * top:
            raise ReadingError(
                f"a reading of {values.max():g} is above {top:g}, the most that there can be in "
                f"{unit}; check the unit (--answer unit=...) and "
                f"{'adc_bits' if unit == 'code' else 'vref_volt'} in the spec"
            )
        if unit and top and values.max() < _NEAR_0 * top and not answer:
            self._ask(
                "unit",
                f"no reading is above {values.max():g}, and there can be {top:g} {unit}: is the mark in them one of "
                f"thousands (then save them without), or are they in another unit? --answer unit={unit} takes them as "
                "they are",
            )
        if (
            unit == "V"
            and top > 2.0
            and values.max() <= 1.0
            and answer != "V"
            and not self._volts_named(mapping)
        ):
            self._ask(
                "unit",
                f"no reading is above {values.max():.3g}, and Vref is {top:g} V: volts (V) or "
                f"over Vref (fraction)?",
            )
        return replace(mapping, unit=unit or "V", vref_volt=0.0 if self.sensor else vref)

    def _volts_named(self, mapping: ColumnMapping) -> bool:
        return any(self.meanings[n].unit == "V" for n in mapping.columns)

    def _by_size(self, values: FloatArray, vref: float) -> str:
        """Return the unit that the readings' size leaves, "" and a question where there are several."""
        whole, top = bool((values == np.round(values)).all()), float(values.max())
        bits = self.sensor.adc_bits if self.sensor else None
        fits = []
        if whole and top > 1.0:
            fits += ["code"] * (top <= 2.0**bits - 1.0 if bits else not self.sensor) + ["mV"] * (
                not vref or vref < top <= 1000.0 * vref
            )
            fits += ["V"] * (0 < len(set(values)) < 4 and bool(vref) and top <= vref)
        else:
            fits += (
                ["fraction"] * (top <= 1.0)
                + ["V"] * (top <= (vref or 24.0))
                + ["percent"] * (1.0 < top <= 100.0 and (vref or 24.0) < top)
            )
            fits += ["mV"] * ((vref or 24.0) < top <= 1000.0 * (vref or 24.0))
        if fits == ["fraction", "V"] and vref and (vref <= 1.2 or top > 1.0):
            fits = ["V"]
        if len(fits) == 1:
            self.reasons.append(
                f"readings are in {fits[0]}: they reach {top:g}"
                + (f", and Vref is {vref:g} V" if vref else "")
            )
            return fits[0]
        self._ask(
            "unit",
            f"readings reach {top:g}{' in whole numbers' if whole else ''}: in which unit "
            f"({', '.join(fits or READING_UNITS)})?",
        )
        return fits[0] if fits else "V"


def _rises(values: list[float | None]) -> bool:
    numbers = [v for v in values if v is not None]
    steps = np.diff(numbers)
    return len(numbers) == len(values) > 1 and bool((steps >= 0.0).all()) and numbers[-1] > numbers[0]


def _cycles(values: list[float | None]) -> bool:
    """Return whether these are whole numbers from 0 or 1 on, all as often, in runs that begin anew."""
    if any(v is None or v != int(v) for v in values) or len(values) < 4:
        return False
    numbers = [int(v) for v in values if v is not None]
    distinct = sorted(set(numbers))
    return (
        len(distinct) > 1
        and distinct == list(range(distinct[0], distinct[0] + len(distinct)))
        and distinct[0] in (0, 1)
        and (numbers[: len(distinct)] == distinct or numbers[: len(distinct)] == distinct[::-1])
    )


def _above(high: FloatArray, low: FloatArray) -> bool:
    """Return whether one of two channels is the larger nearly everywhere, and clearly so in the median."""
    apart = (high - low)[np.isfinite(high - low)]
    if len(apart) < 2:
        return False
    scale = float(np.nanmax(np.abs(np.stack([high, low]))))
    return bool((apart >= -_APART * scale).mean() >= _ABOVE and np.median(apart) > _APART * scale)

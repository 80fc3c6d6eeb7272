"""Propose how to read a log: each guess has a reason, and what cannot be known is a question."""

from __future__ import annotations

import bisect
import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import import conversion, no_contact, time_unit, units
from tacstrip.io.log_import.broken import are_torn, hold_readings, of_other_kinds, settle_broken
from tacstrip.io.log_import.changes import ask_for_notes
from tacstrip.io.log_import.columns import Columns, find_columns
from tacstrip.io.log_import.contents import names_strips
from tacstrip.io.log_import.doubts import backwards, raise_doubts
from tacstrip.io.log_import.ends import EXCHANGED, FROM_VREF, above, ends_exchanged, noise
from tacstrip.io.log_import.fields import STAMP, is_garbled, number_of, says_nothing
from tacstrip.io.log_import.mapping import STRIP_ORDERS, ColumnMapping
from tacstrip.io.log_import.middles import doubt_middles
from tacstrip.io.log_import.named_strips import in_ends_of_strips
from tacstrip.io.log_import.names import CLOCKS, IN_VOLTS, is_strip_word, meaning, meanings
from tacstrip.io.log_import.neighbours import order_of_neighbours
from tacstrip.io.log_import.others import drop_others
from tacstrip.io.log_import.questions import (
    KEYS,
    ROLES,
    Clues,
    Question,
    Unanswered,
    UnknownAnswerError,
)
from tacstrip.io.log_import.scans import (
    LogScan,
    inputs_read,
    is_newest_first,
    is_unsorted,
    raw_times,
    scans,
    strip_numbers,
)
from tacstrip.io.log_import.sides import (
    assigned_otherwise,
    from_the_right_said,
    order_elsewhere,
    wired_otherwise,
)
from tacstrip.io.log_import.statements import base_said
from tacstrip.io.log_import.supply import ask_for_supply
from tacstrip.io.log_import.table import PART, SHEET, ContradictionError, NoTableError, Table
from tacstrip.io.log_import.turns import with_turn
from tacstrip.io.log_import.write import at_rest
from tacstrip.sensor.spec import Sensor

Read = TypeVar("Read")
_TOUCH = re.compile(r"touch|contact|press|active|open|ber(?:\u00fc|ue)hrt", re.IGNORECASE)
_AS_WIRED = (
    "the log says {!r}: do its columns stand in the strips' order (ascending), or does the last strip stand first "
    "(descending)? If neither, list the strips in the columns' order, as 2,0,1"
)
_TAKEN_AS_TOLD = "columns are taken as of the strips that the log says they are of: {!r}"
_ROUNDS = 4  # of questions that others open
_SHOWN, _LONG = 3, 72  # broken lines, and characters of each, that are quoted
_FEW_BROKEN, _MOST_BROKEN = 2, 1.0 / 3.0  # lines, and part of the lines: of more, the log is of another form
_FEW_ROWS, _MOST_REPEATED = 4, 0.25  # rows; part of them: of more that come twice, nothing is known
_MOST_COMPLETE = 0.5  # of the scans: if more have all strips, lines are lost where others have not
# Of the strips: where always the same ones are listed, and more, others may not be logged.
_MOST_STEADY = 0.75


@dataclass(frozen=True)
class Proposal:
    """A mapping, the scans that it gives, and why."""

    mapping: ColumnMapping
    scans: list[LogScan]
    reasons: tuple[str, ...]
    doubts: tuple[str, ...] = ()


def propose(
    table: Table,
    sensor: Sensor | None = None,
    answers: Mapping[str, str] | None = None,
    stated: frozenset[str] | None = None,
) -> Proposal:
    """Propose how to read a log.

    Parameters
    ----------
    table
        What it holds.
    sensor
        That it is of, which tells the number of strips, Vref and the converter.
    answers
        To questions: by their key, or by a column's name ("h", "l", "out", "3:h", "time", "scan", "strip", "which",
        "position", "skip").
    stated
        Keys that the spec's file states, so that their values are no defaults; None: not known.

    Raises
    ------
    Unanswered
        Something cannot be known from the log; all that is known to be open is asked at once.
    ReadingError
        Something in it cannot be a reading.
    OptionError
        An answer to nothing, or one that is not possible.
    """
    strips, channels = (sensor.strips, 1 + (sensor.signatures != ("k",))) if sensor else (0, 0)

    def told(given: dict[str, str]) -> Proposal:
        return settled(table, lambda found: _proposed(found, sensor, given, stated), strips, channels)

    given = dict(answers or {})
    try:
        return told(given)
    except UnknownAnswerError as error:
        raise OptionError(f"{error}; {_asks(told, given, error.key)}") from None
    except Unanswered as asked:  # what has a default is not asked beside the rest
        known = {q.key: q.default for q in asked.questions if q.default}
        if not known:
            raise
        return told(given | known)


def _asks(told: Callable[[dict[str, str]], Proposal], given: dict[str, str], unknown: str) -> str:
    """Return what a log asks that was given an answer to nothing."""
    try:
        told({key: answer for key, answer in given.items() if key != unknown})
    except Unanswered as asked:
        return f"the log asks for: {', '.join(q.key for q in asked.questions)}"
    except UnknownAnswerError as other:
        return f"nor has {other.key!r}"
    except (ReadingError, OptionError) as error:
        return f"without it: {error}"
    return "the log asks nothing: leave it out"


def settled(table: Table, read: Callable[[Table], Read], strips: int = 0, channels: int = 0) -> Read:
    """Return what `read` makes of a log, without its stray lines where it is not understood with them.

    Where names leave something open, what it holds may tell it. Errors are those of the log as it stands, unless
    without strays, or by its content, less is open.
    """
    fewest: float = np.inf
    kept: Exception | None = None
    for one in itertools.chain([table], table.retries()):
        try:
            return read(one)
        except ContradictionError:
            raise
        except (ReadingError, OptionError, Unanswered) as error:
            open_ = _open(error)
            if kept is None or open_ < fewest:
                fewest, kept = open_, error
            # A line of a form of its own may name a value that all others lack, or hide the names.
            lacks = isinstance(error, Unanswered) and "missing" in {q.key for q in error.questions}
            if open_ == 0.0 or one.lacking or (one is table and table.named and open_ < np.inf and not lacks):
                break
    assert kept is not None
    if (
        strips
        and _is_of_form(table.refused or kept)
        and (told := table.of_content(strips, channels)) is not None
    ):
        try:
            return read(told)
        except Unanswered as error:
            asked = kept.questions if isinstance(kept, Unanswered) and not table.refused else None
            keys = {q.key for q in error.questions}
            if asked is None or (len(keys) < len(asked) and {q.key for q in asked if not q.of_form} <= keys):
                raise
        except (ReadingError, OptionError):
            pass
    if fewest == np.inf and table.refused:
        raise table.refused
    raise kept


def _is_of_form(error: Exception) -> bool:
    """Return whether nothing but what the columns are is open, which their content may tell."""
    if not isinstance(error, Unanswered):
        return isinstance(error, NoTableError)
    form = [q.of_form for q in error.questions]
    return any(form) and all(so or q.key in KEYS for so, q in zip(form, error.questions, strict=True))


def _open(error: Exception) -> float:
    """Return how much of a log is open; inf where it is not understood: nothing tells what its columns are."""
    if not isinstance(error, Unanswered) or any(
        q.key not in (*KEYS, PART) or q.key == "readings" for q in error.questions
    ):
        return np.inf
    return sum(q.key != "broken_lines" for q in error.questions)


def _proposed(
    table: Table, sensor: Sensor | None, answers: dict[str, str], stated: frozenset[str] | None
) -> Proposal:
    clues = Clues(table, sensor, answers, stated=stated)
    try:
        mapping, _ = assembled(clues)
        clues.stop()
    except Unanswered as asked:
        error = Unanswered(*asked.questions, *_later(asked.questions, table, sensor, answers, stated))
        if not (strange := next((n for n in table.names if is_garbled(n)), "")):
            raise error from None
        first, *others = error.questions
        text = f"{strange!r} looks garbled: if the log is no UTF-8, save it as that first; else: {first.text}"
        raise Unanswered(replace(first, text=text), *others) from None
    dropped: list[int] = []
    found = scans(clues.table, mapping, dropped)
    exchanged = ends_exchanged(found, mapping, clues.answers.get("exchanged", ""))
    doubts = [*left_out(table, dropped), *backwards(clues.table, mapping), *exchanged]
    return Proposal(mapping, at_rest(found, mapping, sensor), tuple(clues.reasons), (*clues.doubts, *doubts))


def _later(
    questions: tuple[Question, ...], table: Table, sensor: Sensor | None, answers: dict[str, str],
    stated: frozenset[str] | None,
) -> list[Question]:  # fmt: skip
    """Return what will be asked whatever is answered, so that one round is enough."""
    first = _asked_next(questions, 0, table, sensor, answers, stated)
    last = {q.key for q in _asked_next(questions, -1, table, sensor, answers, stated)} if first else set()
    return [q for q in first if q.key in last]


def _asked_next(
    questions: tuple[Question, ...], pick: int, table: Table, sensor: Sensor | None, answers: dict[str, str],
    stated: frozenset[str] | None,
) -> list[Question]:  # fmt: skip
    later: list[Question] = []
    asked, known = questions, {*answers}
    for _ in range(_ROUNDS):
        if any(not q.choices or q.key in known for q in asked):
            break
        known |= {q.key for q in asked}
        answers = answers | _picked(asked, pick)
        try:
            clues = Clues(table, sensor, answers, stated=stated)
            assembled(clues)
            clues.stop()
            break
        except Unanswered as error:
            asked = tuple(q for q in error.questions if q.key not in known)
            later += [replace(q, text=f"then: {q.text}") for q in asked]
            if not asked:
                break
        except (ReadingError, OptionError):
            break
    return later


def _picked(questions: tuple[Question, ...], pick: int) -> dict[str, str]:
    """Return answers by the first choices or the last; of columns one for each channel, as none is of two."""
    columns = [q for q in questions if q.key not in KEYS]
    taken = {}
    for n, q in enumerate(columns):
        choices = q.choices if pick == 0 else (*q.choices[1::-1], *q.choices[2:])
        taken[q.key] = choices[min(n, len(choices) - 1)]
    return {q.key: q.choices[pick] for q in questions} | taken


def left_out(table: Table, dropped: list[int]) -> list[str]:
    """Return what to warn of where broken lines, and scans that they may have been of, are left out."""
    said = []
    if table.broken:
        shown = "; ".join(f"line {n}{_quote(table, n)}" for n in table.broken[:_SHOWN])
        more = f"; line(s) {', '.join(map(str, rest))}" if (rest := table.broken[_SHOWN:]) else ""
        said.append(f"left out: {shown}{more}; what they say is lost")
    if dropped:
        said.append(
            f"{len(dropped)} scan(s) left out, from line(s) {', '.join(map(str, dropped))}: of strips that they lack "
            "it is not known whether anything touches them, for a line that is lost or left out may be of these"
        )
    return said


def _quote(table: Table, line: int) -> str:
    text = table.quotes.get(line, "")
    return f" ({text[:_LONG]!r}{' ...' if len(text) > _LONG else ''})" if text else ""


def assembled(clues: Clues) -> tuple[ColumnMapping, list[LogScan]]:
    """Return a mapping as far as it can be known, and the scans that it gives; what is open is asked in `clues`."""
    try:
        return _assembled(clues)
    except (ReadingError, OptionError):
        if any(q.key == "readings" or q.choices in (("strip",), ("skip",)) for q in clues.questions):
            clues.stop()  # what is taken for likely until that is answered need not fit
        raise


def _assembled(clues: Clues) -> tuple[ColumnMapping, list[LogScan]]:
    if not clues.table.rows:
        raise ReadingError("the log has no readings")
    if (lacking := clues.table.lacking) and lacking[-1] not in clues.answers:
        names = clues.table.names
        clues.ask(
            lacking[-1],
            f"there are {len(names)} names, and no line has more than {len(names) - len(lacking)} fields: is what is "
            f"missing {' and '.join(map(repr, lacking))}, the last? Else write in what is, or take its name out",
            "skip",
        )  # fmt: skip
    if clues.expected != ("out",):
        strips = clues.sensor.strips if clues.sensor else 0
        clues.table, told, doubts = in_ends_of_strips(clues.table, strips, clues.answers)
        clues.reasons += [told] if told else []
        for doubt in doubts:
            clues.doubt(doubt)
    try:
        found = find_columns(clues)
    except Unanswered:
        if not any(q.key in clues.table.names and not {*q.choices} <= {*ROLES} for q in clues.questions):
            _ask_for_base(clues)  # which is of all lines, not those of one sensor of several
        raise Unanswered(*clues.questions) from None
    _order_names(clues, found)
    _drop_repeated(clues, found)
    drop_others(clues, found)
    found = _as_wired(clues, found)
    mapping, rough = _rough(clues, found)
    mapping = time_unit.settled_time(clues, mapping, rough)
    mapping = replace(
        mapping, scale=conversion.factor(clues) * conversion.of_lengths(clues, [*mapping.columns])
    )
    mapping = replace(mapping, untouched=(*mapping.untouched, *no_contact.numbers_for_nothing(clues, rough)))
    loose = replace(mapping, time_unit=mapping.time_unit or "s", restart="continue", missing="untouched")
    rough = scans(clues.table, loose)
    settle_broken(clues, loose, rough)
    mapping, rough = with_turn(clues, mapping, rough)
    ask_for_notes(clues, rough)
    _refuse_no_exchange(clues, mapping)
    mapping = _with_ends(clues, mapping, found, rough)
    raise_doubts(clues, mapping)
    mapping = units.with_unit(clues, mapping, found, rough)
    if mapping.unit in IN_VOLTS:
        ask_for_supply(clues)
    return mapping, rough


def _order_names(clues: Clues, found: Columns) -> None:
    """Ask in which order strips lie that have names instead of numbers, such as the colours of wires."""
    if not found.strip or found.which or not names_strips(clues, found.strip):
        return
    fields = clues.table.column(found.strip)
    names = [*dict.fromkeys(fields)]
    if answer := clues.answers.get("strip_order", ""):
        listed = [n.strip().casefold() for n in answer.split(",")]
        if sorted(listed) != sorted(n.casefold() for n in names):
            raise OptionError(f"--answer strip_order={answer}: list each of {', '.join(names)} once")
        clues.strip_names = answer
        return
    values: list[FloatArray] = []
    for n, field in enumerate(fields):
        if (
            not values
            or np.isfinite(values[-1][names.index(field)]).any()
            or (found.scan and clues.table.column(found.scan)[n] != clues.table.column(found.scan)[n - 1])
        ):
            values.append(np.full((len(names), len(found.readings)), np.nan))
        read = [number_of(clues.table.column(c)[n], clues.table.decimal) for c in found.readings]
        values[-1][names.index(field)] = [np.nan if v is None else v for v in read]
    order = [names[n] for n in order_of_neighbours(np.stack(values))]
    clues.ask(
        "strip_order",
        f"strips are called {', '.join(names)}: in which order do they lie, from the first strip on? "
        "(Any order can be written so.) By which are touched together, and read alike, so or in reverse",
        ",".join(order), ",".join(order[::-1]),
    )  # fmt: skip
    clues.strip_names = ",".join(order)


def _drop_repeated(clues: Clues, found: Columns) -> None:
    """Leave out a line that is one above it again, where the times or scans and strips of all others differ."""
    table = clues.table
    if not (found.time or found.scan) or len(table.rows) < _FEW_ROWS:
        return
    keys = [n for n in (found.time, found.scan, found.strip, found.which) if n]
    first: dict[tuple[str, ...], int] = {}
    of = [first.setdefault(tuple(row), n) for n, row in enumerate(table.rows)]
    again = [n for n, before in enumerate(of) if table.lines[n] != table.lines[before]]
    kept = [n for n in range(len(table.rows)) if n not in {*again}]
    said = Counter(zip(*([table.column(k)[n] for n in kept] for k in keys), strict=True))
    if not again or len(again) > max(1.0, _MOST_REPEATED * len(table.rows)) or max(said.values()) > 1:
        return
    shown = "; ".join(f"line {table.lines[n]} is line {table.lines[of[n]]} again" for n in again[:_SHOWN])
    more = f", and {len(again) - _SHOWN} more" if len(again) > _SHOWN else ""
    clues.doubt(f"{shown}{more}: left out")
    clues.table = table.of_rows(kept)


def _as_wired(clues: Clues, found: Columns) -> Columns:
    """Return columns as of the strips that a line above gives to each of them, whatever number its name has."""
    columns = {n: int(what.partition(":")[0]) for n, what in found.readings.items() if ":" in what}
    line, _, wired = assigned_otherwise(columns, clues.table.preamble)
    if "strip_order" in clues.answers:
        return found
    if not wired or len(wired) < len(found.readings):
        strips = clues.sensor.strips if clues.sensor else len({*columns.values()})
        words = re.findall(r"[^\W\d_]+", " ".join((*columns, found.strip)))
        if not line and not any(map(is_strip_word, words)) and (
            told := wired_otherwise(clues.table.preamble, strips)
        ):  # fmt: skip
            clues.ask("strip_order", _AS_WIRED.format(told[:_LONG]), *STRIP_ORDERS)
        return found
    clues.doubt(_TAKEN_AS_TOLD.format(line.strip()[:_LONG]))
    first = min(columns.values())
    return replace(
        found,
        readings={n: f"{first + wired[n]}:{what.rpartition(':')[2]}" for n, what in found.readings.items()},
    )


def _rough(clues: Clues, found: Columns) -> tuple[ColumnMapping, list[LogScan]]:
    """Return a mapping without units, and the scans that it gives; what lines and strips leave open is asked."""
    which_h = _which_h(clues, found)
    base, count = _strips(clues, found)
    mapping = ColumnMapping(
        columns=found.readings, unit="V", strips=count, strip_base=base, scan=found.scan, strip=found.strip,
        which=found.which, which_h=which_h, time=found.time, strip_step=found.strip_step,
        broken_lines=_broken(clues), untouched=no_contact.words_for_nothing(clues, found), missing="untouched",
        only=clues.only, strip_order=_strip_order(clues, found, count),
    )  # fmt: skip
    mapping = units.with_zero(clues, mapping)
    clues.choice("missing", ("untouched", "skip", "error"))
    mapping = time_unit.with_time(clues, mapping, found)
    loose = replace(mapping, time_unit=mapping.time_unit or "s", restart="continue")
    if is_newest_first(clues.table, loose):
        told = f"{mapping.time} falls: the newest stands first, and scans are put in the order of time"
        (clues.because if mapping.time_unit in CLOCKS else clues.doubt)(told)
    if is_unsorted(clues.table, loose):
        clues.doubt(f"{mapping.time}: lines are not in the order of time, and are put in it")
    plain = replace(loose, restart="error")
    try:
        rough = scans(clues.table, plain)
    except ReadingError as error:
        if "restart=" not in str(error):
            raise
        rough = scans(clues.table, loose)
        marked = [] if "restart" in clues.answers else _marked_restarts(clues.table, loose)
        if marked:
            clues.doubt(
                f"the time begins anew below line(s) {', '.join(map(str, marked))}, where another sheet begins, or "
                "lines between part two runs: taken a step later; else --answer restart=first or restart=last"
            )
        elif "restart" not in clues.answers:
            clues.ask(
                "restart",
                f"{str(error).partition(';')[0]}, as after a reset: does it go on one step later (continue), or shall "
                "only the part before (first) or after it (last) be taken? (If lines are unsorted, sort them)",
                "continue", "first", "last",
            )  # fmt: skip
        mapping = replace(mapping, restart=clues.answers.get("restart", "continue"))
    no_contact.settle_words(clues, mapping, rough)
    mapping = replace(mapping, missing=_missing(clues, loose, rough))
    return mapping, rough


def _marked_restarts(table: Table, mapping: ColumnMapping) -> list[int]:
    """Return the lines above which the time falls, if each time another sheet or lines between part the rows."""
    falls = np.flatnonzero(np.diff(raw_times(table, mapping)) < 0.0)
    gaps = np.diff(table.lines)
    between = [gaps[n] - sum(table.lines[n] < b < table.lines[n + 1] for b in table.broken) for n in falls]
    parted = bool(between) and min(between) > np.median(gaps)
    if SHEET in table.names:
        sheets = table.column(SHEET)
        parted |= all(sheets[n] != sheets[n + 1] for n in falls)
    return [table.lines[n] for n in falls] if parted else []


def _which_h(clues: Clues, found: Columns) -> str:
    """Return what stands in the column of the channel's name for h, where no word says so."""
    if not found.which:
        return ""
    fields = sorted(set(clues.table.column(found.which)))
    if answer := clues.choice("which_h", tuple(fields)):
        return answer
    if {meaning(f).channel for f in fields} <= {"h", "l"}:
        return ""
    if len(fields) != 2:
        raise ReadingError(
            f"{found.which}: {', '.join(map(repr, fields[:4]))}: of two channels there are two names"
        )
    return fields[0]  # the readings will say whether it is (`_with_ends`)


def _refuse_no_exchange(clues: Clues, mapping: ColumnMapping) -> None:
    """Refuse the answer that columns are exchanged where there are none of both ends."""
    if clues.answers.get("exchanged") == "yes" and (mapping.channels != ("h", "l") or mapping.which):
        why = f"{mapping.which!r} tells the ends; say which_h" if mapping.which else "the log has one channel"
        raise OptionError(f"--answer exchanged=yes: {why}; there are no columns to exchange: leave it out")


def _with_ends(clues: Clues, mapping: ColumnMapping, found: Columns, rough: list[LogScan]) -> ColumnMapping:
    """Return the mapping with the ends that the readings confirm: k_h is never below k_l."""
    answer = clues.choice("exchanged", EXCHANGED)
    mapping = replace(mapping, from_vref=answer == FROM_VREF)
    if mapping.channels != ("h", "l"):
        return mapping
    both = np.stack([s.values for s in rough])
    high, low = (both[:, :, 1], both[:, :, 0]) if mapping.from_vref else (both[:, :, 0], both[:, :, 1])
    if mapping.which_h and "which_h" not in clues.answers:
        first, other = sorted(set(clues.table.column(mapping.which)))
        chosen = first if above(high, low) else other if above(low, high) else ""
        if chosen:
            clues.because(
                f"{mapping.which}: {chosen} is v_h, for it is the larger on every strip, as k_h must be"
            )
        else:
            clues.ask("which_h", f"{mapping.which}: which of {first!r} and {other!r} is v_h?", first, other)
        return replace(mapping, which_h=chosen or first)
    columns = mapping.columns
    swapped = {n: what[:-1] + {"h": "l", "l": "h"}[what[-1]] for n, what in columns.items()}
    if clues.table.by_content or clues.counted:  # no name tells the ends
        doubt_middles(clues, columns, high, low)
    if found.paired:
        idle = noise(both.reshape(len(both), -1))  # where nothing touches, either may be the larger
        high, low = (np.where(end <= idle, 0.0, end) for end in (high, low))
        if not (above(high, low) or above(low, high)):
            name = next(iter(columns))
            clues.ask(name, "which of the two channels is v_h? Neither is the larger everywhere", "h", "l")
        chosen_columns = swapped if above(low, high) else columns
        name = next(n for n, what in chosen_columns.items() if what.endswith("h"))
        clues.because(f"{name}: v_h, for it is the larger on every strip, as k_h must be")
        doubt_middles(clues, chosen_columns, *((low, high) if above(low, high) else (high, low)))
        return replace(mapping, columns=chosen_columns)
    if not mapping.which and not answer and above(low, high):
        clues.ask(
            "exchanged",
            "v_h is below v_l on nearly every strip, which no sensor reads: are the columns exchanged, or all readings "
            "measured from Vref down? As exchanged ones the latter would be a mirror image",
            *EXCHANGED,
        )  # fmt: skip
    return replace(mapping, columns=swapped) if answer == "yes" and not mapping.which else mapping


def _strips(clues: Clues, found: Columns) -> tuple[int, int]:
    """Return the number of the first strip, and how many there are."""
    many = clues.number("strips")
    count = clues.sensor.strips if clues.sensor else int(many) if many else 0
    if clues.strip_names or found.strip_step:
        return 0, count
    if found.strip:
        shown = ColumnMapping(columns=found.readings, unit="V", strips=1, strip=found.strip)
        many_lines = Counter(strip_numbers(clues.table, shown))
        there, all_listed = set(many_lines), len(set(many_lines.values())) == 1
        if count and len(there) > count:
            return _of_more_inputs(clues, found, there, count), count
    else:
        there, all_listed = {int(what.partition(":")[0]) for what in found.readings.values()}, True
    low, high = min(there), max(there)
    base = said = clues.number("strip_base")  # by the answer, the log, or the spec
    if base is None:
        base, said = _base(clues, found, there, count, all_listed)
    elif count and not base <= low <= high <= base + count - 1:
        raise OptionError(
            f"--answer strip_base={base:g}: strips are numbered {low} to {high}, and the sensor has {count}"
        )
    if found.numbered:
        clues.because(f"strips are numbered from {int(base)}")
        if said is None and clues.sensor and "strip_base" in (clues.stated or ()):
            said = clues.sensor.strip_base
        if said not in (None, base) and base < 2:
            clues.doubt(
                f"the log counts its strips from {int(base)}, the readings from {said}, for strip_base = {said} in the "
                f"spec: strip {int(base)} of the log is strip {said} of the readings; there is nothing to do"
            )
    return int(base), count or high - int(base) + 1


def _too_many(clues: Clues, found: Columns, low: int, high: int, count: int) -> NoTableError:
    return NoTableError(
        f"strips are numbered {low} to {high}, and the sensor has {count}{_where(clues, found, high)}; check strips in "
        "the spec, or say which column is the strip's number: --answer NAME=strip, and NAME=skip of others (they are: "
        f"{', '.join(clues.table.names[:8])})"
    )


def _of_more_inputs(clues: Clues, found: Columns, there: set[int], count: int) -> int:
    """Return the number of the first strip where lines are of more inputs than strips, some of which are never read."""
    read = {int(v) for v in inputs_read(clues.table, found.strip, [*found.readings]) if v is not None}
    low, high = min(there), max(there)
    fits = [b for b in range(low, high - count + 2) if not read or b <= min(read) <= max(read) < b + count]
    if not fits:
        raise _too_many(clues, found, low, high, count)
    base = clues.number("strip_base")
    if base is not None and base not in fits:
        raise OptionError(
            f"--answer strip_base={base:g}: only from {fits[0]} to {fits[-1]} are all readings of strips"
        )
    if base is None and len(fits) > 1:
        clues.ask(
            "strip_base",
            f"{found.strip} has {len(there)} numbers, {low} to {high}, and the sensor has {count} strips: which is the "
            "first strip? (Others are taken as not connected; none has a reading)", *map(str, fits),
        )  # fmt: skip
    if low < fits[0]:
        clues.because(f"{found.strip}: inputs without a reading are taken as not connected")
    return int(fits[0] if base is None else base)


def _base(
    clues: Clues, found: Columns, there: set[int], count: int, all_listed: bool
) -> tuple[int, int | None]:
    """Return the number of the first strip by those that are there, and by what the log says (None: nothing)."""
    low, high = min(there), max(there)
    fits = [b for b in (0, 1) if low >= b and (not count or high <= b + count - 1)]
    if count and len(there) == count == high - low + 1:  # such as pins A2 to A7
        fits = [low]
    if count and not fits:
        raise _too_many(clues, found, low, high, count)
    if low in fits and (len(there) == count if count and len(fits) > 1 else all_listed or low == 0):
        return low, None
    if len(fits) == 1:
        return fits[0], None
    if (told := base_said((*clues.table.preamble, *clues.table.constants()))) is not None:
        clues.because(f"strips are numbered from {told}, as the log says above them")
        return told, told
    stated = bool(clues.sensor and "strip_base" in (clues.stated or ()))
    if clues.sensor and stated and 0 < clues.sensor.strip_base <= low:
        base = clues.sensor.strip_base  # which nobody writes unless it is so; 0 is the default
        clues.because(
            f"strips are numbered {low} to {high}: taken as strip_base = {base}, as the spec says; else --answer "
            f"strip_base={1 - base}"
        )
        return base, None
    clues.ask(
        "strip_base",
        f"strips are numbered {low} to {high}: is the first one 0 or 1?"
        + (
            " (strip_base = 0 of the spec, which may be no more than the default, tells nothing of the log)"
            if stated
            else ""
        ),
        "0",
        "1",
    )
    return 0, None


def _strip_order(clues: Clues, found: Columns, strips: int) -> str:
    """Return whether the log's strips run from the left, "ascending", or from the right; or how they are called."""
    if clues.strip_names:
        return clues.strip_names
    if "," in (listed := clues.answers.get("strip_order", "")):
        clues.because(f"the log's strips are {listed} of the readings, in their order")
        return listed
    if answer := clues.choice("strip_order", STRIP_ORDERS):
        if answer == "descending":
            clues.because("the log's first strip is the last of the readings")
        return answer
    said = (*clues.table.preamble, found.strip.replace("_", " "))
    columns = {n: int(what.partition(":")[0]) for n, what in found.readings.items() if ":" in what}
    line, turned, _ = assigned_otherwise(columns, clues.table.preamble)
    if line and not turned:
        raise ReadingError(
            f"the log says {line.strip()[:_LONG]!r}, and columns are named otherwise: give them the strips' numbers"
        )
    words = re.findall(r"[^\W\d_]+", " ".join(columns))
    if line and not any(map(is_strip_word, words)):  # of inputs, whose strips nothing else tells
        clues.doubt(_TAKEN_AS_TOLD.format(line.strip()[:_LONG]))
        return "descending"
    if not clues.descending and (told := line or from_the_right_said(said, strips)):
        clues.ask(
            "strip_order",
            f"the log says {told[:_LONG]!r}, and in readings the first strip is the leftmost: turn the strips' order "
            "round (descending), or is the log's first strip the readings' first (ascending)?",
            *STRIP_ORDERS[::-1],
        )
    elif columns and (told := order_elsewhere(clues.table.preamble)):
        clues.ask("strip_order", _AS_WIRED.format(told[:_LONG]), *STRIP_ORDERS)
    return STRIP_ORDERS[clues.descending]


def _ask_for_base(clues: Clues) -> None:
    """Ask from where on strips are numbered, beside what else is asked, where a column is sure to be the strip."""
    strips = [n for n, m in meanings(clues.table.names).items() if m.role == "strip"]
    if len(strips) == 1:
        with contextlib.suppress(ReadingError, OptionError):
            _strips(clues, Columns({strips[0]: ""}, {}, strip=strips[0]))


def _where(clues: Clues, found: Columns, strip: int) -> str:
    """Return where a strip stands: a column's name, and the first line."""
    if not found.strip:
        return (
            f" (column {next(n for n, w in found.readings.items() if int(w.partition(':')[0]) == strip)!r})"
        )
    shown = ColumnMapping(columns=found.readings, unit="V", strips=1, strip=found.strip)
    line = clues.table.lines[strip_numbers(clues.table, shown).index(strip)]
    return f" (column {found.strip!r}, line {line})"


def _broken(clues: Clues) -> str:
    changes = {line for line, _ in clues.table.changes}  # of which another asks
    broken = [line for line in clues.table.broken if line not in changes]
    if not broken:
        return clues.answers.get("broken_lines", "skip" if changes else "error")
    shown = (
        ", ".join(map(str, broken[:5]))
        + (", ..." if len(broken) > 5 else "")
        + _quote(clues.table, broken[0])
    )
    if "broken_lines" not in clues.answers and of_other_kinds(clues.table, broken):
        clues.doubt(f"line(s) {shown} and those like it are of another kind than the readings: passed over")
        return "skip"
    if len(broken) > _FEW_BROKEN and len(broken) >= _MOST_BROKEN * (len(broken) + len(clues.table.rows)):
        raise NoTableError(
            f"line(s) {shown} are not like the others, and they are {len(broken)} beside {len(clues.table.rows)} that "
            "are: the log is not of a form that is read here; save it with a line per strip or per scan"
        )
    if clues.choice("broken_lines", ("skip", "error")):
        return clues.answers["broken_lines"]
    if all(n > max(clues.table.lines) and _is_footer(clues.table.quotes.get(n, "")) for n in broken):
        return "skip"  # with a warning
    if whole := hold_readings(clues.table, broken):
        text = f"line(s) {shown} are not like the others, and {whole[0]} holds as many numbers: mend it, or take it out"
        clues.ask("broken_lines", text)
        return "skip"
    clues.ask("broken_lines", f"line(s) {shown} are not like the others: leave them out?", "skip")
    return "skip"


def _is_footer(text: str) -> bool:
    """Return whether a line below the readings is words and perhaps a time, and nothing of a strip or a reading."""
    rest = re.sub(STAMP, "", text)
    words = [w for w in re.findall(r"[^\W\d_]+", rest) if len(w) > 1]
    known = {meaning(w).role for w in words}
    return len(words) > 1 and not re.search(r"\d", rest) and not known & {"strip", "reading", "which"}


def _missing(clues: Clues, mapping: ColumnMapping, rough: list[LogScan]) -> str:
    """Return what strips without a line mean: no contact where only touched ones are listed; else that is asked."""
    if answer := clues.answers.get("missing"):
        return answer
    try:
        scans(clues.table, replace(mapping, missing="error"))
    except ReadingError as error:
        if not any(said in str(error) for said in ("no line for", "lacks a value", "no column is of")):
            raise
        # Scans beside torn lines are left out, or torn lines are scans.
        table = clues.table
        a_line_each = table.varied or len({*table.lines}) == len(rough) < len(table.lines)
        whole = not table.broken or a_line_each or (mapping.strip and are_torn(table))
        if whole and _only_touched(clues.table, mapping, rough):
            clues.because(
                "only touched strips have lines: they lie side by side, and none is without a reading"
            )
            return "untouched"
        if flag := _flag_of_touch(clues.table, mapping):
            clues.because(f"values that are not there are of untouched strips, as {flag} says")
            return "untouched"
        if "no line for" in str(error) and _are_lost(clues.table, mapping):
            clues.because("untouched strips have lines, too: scans that lack some are left out")
            return "skip"
        what = "values" if "lacks a value" in str(error) else "strips"
        other = (
            " Else name the spec that it was made with, or give those that were not connected as without in the spec"
            if "no column is of" in str(error)
            else ""
        )
        clues.ask(
            "missing",
            f"{str(error).partition(';')[0]}: are {what} that are not there untouched?{other}",
            "untouched",
        )
        return "untouched"
    return "error"


def _are_lost(table: Table, mapping: ColumnMapping) -> bool:
    """Return whether lines that are not there are lost: untouched strips have theirs, and most scans all of them."""
    if not mapping.strip:
        return False
    idle = sum(all(map(says_nothing, f)) for f in zip(*map(table.column, mapping.columns), strict=True))
    dropped: list[int] = []
    with contextlib.suppress(ReadingError):
        found = scans(table, replace(mapping, missing="skip"), dropped)
        return idle > len(dropped) * mapping.strips and len(found) > len(dropped)
    return False


def _flag_of_touch(table: Table, mapping: ColumnMapping) -> str:
    """Return a column such as "touched" that has one value where readings are, and another where none is; else ""."""
    if not mapping.strip:
        return ""
    there = [any(fields) for fields in zip(*map(table.column, mapping.columns), strict=True)]
    for name in table.names:
        if _TOUCH.search(name) and name not in mapping.columns:
            pairs = {*zip(there, table.column(name), strict=True)}
            if len(pairs) == 2 == len({flag for _, flag in pairs}) and len({t for t, _ in pairs}) == 2:
                return name
    return ""


def _fail_in_pairs(table: Table, mapping: ColumnMapping) -> bool:
    """Return whether named values are not there only for both ends of a strip at once, and nowhere said to be none."""
    pairs: dict[str, list[Sequence[str]]] = {}
    for name, what in mapping.columns.items():
        pairs.setdefault(what.rpartition(":")[0], []).append(table.column(name))
    there = [[tuple(map(bool, ends)) for ends in zip(*columns, strict=True)] for columns in pairs.values()]
    return all(len({*ends}) == 1 for strip in there for ends in strip) and not any(
        f and says_nothing(f) for columns in pairs.values() for column in columns for f in column
    )


def _lines_of_kept(table: Table, mapping: ColumnMapping) -> list[int]:
    """Return the lines of all rows but those of scans that are left out."""
    dropped: list[int] = []
    begins = [scan.line for scan in scans(table, mapping, dropped)]
    begins = sorted([*begins, *dropped])
    return [i for i in table.lines if begins[max(bisect.bisect(begins, i) - 1, 0)] not in {*dropped}]


def _only_touched(table: Table, mapping: ColumnMapping, rough: list[LogScan]) -> bool:
    """Return whether scans list only touched strips: side by side, with readings, not always the same, seldom all."""
    there = np.asarray(np.isfinite(np.stack([s.values for s in rough])).any(axis=2))  # (scans, strips)
    side_by_side = all(row[np.argmax(row) :][: row.sum()].all() for row in there)
    if not mapping.strip and len(mapping.channels) > 1 and _fail_in_pairs(table, mapping):
        none = int((~there.any(axis=1)).sum())  # scans without a value, which no line that is cut has
        return bool(
            side_by_side
            and len(np.unique(there, axis=0)) > 1
            and (there.all(axis=1).mean() < _MOST_COMPLETE or none > max(_FEW_BROKEN, 0.05 * len(there)))
        )
    if table.varied and not mapping.strip:
        touched = sum(map(bool, itertools.chain(*map(table.column, mapping.columns)))) == sum(
            int(np.isfinite(s.values).sum()) for s in rough
        )
    else:
        kept = _lines_of_kept(table, mapping) if table.broken else table.lines
        listed = sum(i not in table.empty for i in kept) if mapping.strip and not table.absent else 0
        touched = int(there.sum()) * (2 if mapping.which else 1) == listed
    # Of the same strips always, and most of all, the others may not be logged.
    vary = len(np.unique(there, axis=0)) > 1 or there.mean() <= _MOST_STEADY
    return touched and side_by_side and vary and bool(there.all(axis=1).mean() < _MOST_COMPLETE)

"""Which column is time, scan, strip or reading: by its name, and by what it holds where names say nothing."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.changes import ask_which_part
from tacstrip.io.log_import.column_blocks import answered_block, readings_of_block
from tacstrip.io.log_import.contents import are_times, counts_strips, is_numeric, may_label_strips
from tacstrip.io.log_import.conversion import length_in
from tacstrip.io.log_import.ends import ends_of_columns, in_one_unit
from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import (
    CHANNELS,
    Meaning,
    meanings,
    numbered_groups,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.roles import (
    channel_column,
    scan_column,
    strip_column,
    time_column,
    with_time_by_unit,
)
from tacstrip.io.log_import.senders import ask_for_sensor
from tacstrip.io.log_import.table import CLOCK, PART, ROW, NoTableError
from tacstrip.io.log_import.unnamed import (
    readings_by_contents,
    readings_by_number,
    readings_by_words,
    roles_without_names,
    with_other_end,
)

_SUPPLY = 0.1  # of its largest value: a supply's voltage moves by no more
_MOST_ASKED = 6  # columns, of each of which is asked what it is
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
    ask_for_sensor(clues, known)
    found = _find(clues, known)
    used = {*found.readings, found.time, found.scan, found.strip, found.which, ROW, PART}
    if passed := [n for n in clues.table.names if n not in used]:
        clues.because(f"passed over: {', '.join(passed)}")
        _refuse_lost(clues, known, found, passed)
        _ask_for_other_end(clues, found, passed)
    return found


def _ask_for_other_end(clues: Clues, found: Columns, passed: list[str]) -> None:
    """Ask whether columns that are empty where those of the one end are, and are as many, are of the other end."""
    one = {what.rpartition(":")[2] for what in found.readings.values()}
    if clues.expected != ("h", "l") or found.which or len(one) != 1 or "readings" in clues.answers:
        return
    taken = [[v is None for v in clues.values(name)] for name in found.readings]
    for group in numbered_groups(clues.table.names):
        names = [*group.values()]
        if {*names} <= {*passed} - {*clues.answers} and [
            [v is None for v in clues.values(n)] for n in names
        ] == taken:
            other = "l" if one == {"h"} else "h"
            clues.ask(
                names[0],
                f"{names[0]} ... {names[-1]}: as many numbers as {next(iter(found.readings))} ..., and no column is "
                f"named v_{other}: is it these?",
                other,
                "skip",
                of_form=True,
            )


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
    lost = [n for n in passed if (before[n].role == "reading" or n in alike) and is_numeric(clues, n)]
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


def _meanings(clues: Clues) -> dict[str, Meaning]:
    table = clues.table
    named = table.named or any(name in clues.answers for name in (*table.names, "readings"))
    found = meanings(table.names) if named else roles_without_names(clues)
    strips = {m.strip for m in found.values() if m.role == "reading"} - {None}
    if clues.sensor and strips == {*range(clues.sensor.strips + 1)}:
        extra = [n for n, m in found.items() if m.strip == 0 and not re.search(r"\d", n)]
        found |= {n: Meaning("") for n in extra}  # as the supply, "voltage" beside "voltage1" and so on
        for name in extra:
            read = [v for v in map(number_of, table.column(name)) if v is not None]
            if read and max(read) - min(read) > _SUPPLY * max(read):
                clues.doubt(
                    f"{name} is passed over, for columns 1 to {clues.sensor.strips} are one for each of the spec's "
                    "strips; but it moves as a reading does: is it a strip, and strips in the spec one too few?"
                )
    found |= {
        n: Meaning("") for n, m in found.items()
        if m.role == "reading" and (all(map(_LOGIC.fullmatch, table.column(n))) or are_times(table.column(n)))
    }  # fmt: skip
    readings = [n for n, m in found.items() if m.role == "reading"]
    if any(not length_in(n) for n in readings):  # then places along the strip are computed from the others
        found |= {n: Meaning("") for n in readings if length_in(n)}
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


def _likely_strip(
    clues: Clues, known: dict[str, Meaning], readings: dict[str, Meaning], time: str, scan: str, which: str
) -> str:
    """Return the column that may say which strip a line is of, where no name says it; ask, unless it counts them."""
    some = [
        n for n in clues.table.names if n not in {*readings, time, scan, which} and may_label_strips(clues, n)
    ]
    within = {n.rpartition(".")[0] for n in readings}  # of records: what stands beside readings goes first
    some = [n for n in some if known[n].role != "time"] or some
    some.sort(key=lambda n: n.rpartition(".")[0] not in within)
    text = "no column says which strip a line is of"
    if not some:
        raise NoTableError(f"{text}; add one with its number")
    strip = some[0]
    # Lines of one scan may each have a time of their own.
    if len(some) == 1 and any(
        counts_strips(clues, strip, [n for n in same if n]) for same in ((time, scan), (scan,))
    ):
        clues.because(f"{strip}: counts up by one within each scan, from another number in some")
    else:
        clues.ask(strip, f"{text}: is it this one? Say it of the right one", "strip", of_form=True)
    return strip


def _find(clues: Clues, known: dict[str, Meaning]) -> Columns:
    given = {name: clues.answers[name] for name in clues.table.names if name in clues.answers}
    which = channel_column(clues, known)
    known = {n: Meaning("which") if n == which else m for n, m in known.items()}
    known = with_time_by_unit(clues, known)
    time = time_column(clues, known)
    scan = scan_column(clues, known, time)
    wide = [n for n, m in known.items() if m.role == "reading" and m.strip is not None]
    strip, step = strip_column(clues, known, which, wide)
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
        readings = readings_of_block(clues, answered_block(clues), known, which)
    elif not strip and not wide:
        readings = readings_by_words(clues, known, {time, scan, which, *given}) or readings
    if not readings and not strip:
        readings = readings_by_number(clues, known, {time, scan, which})
    if not readings:
        readings = readings_by_contents(clues, known, {time, scan, strip, which}, given)
    if not strip and all(m.strip is None for m in readings.values()):
        strip = _likely_strip(clues, known, readings, time, scan, which)
    readings = in_one_unit(clues, with_other_end(clues, known, readings, {time, scan, which}))
    for role, name in (("time", time), ("scan", scan if strip else ""), ("strip", strip), ("which", which)):
        if name:
            clues.because(f"{name}: the {_ROLE_NAMES.get(role, role)}")
    used = {*readings, time, scan, strip, which}
    left = [
        n
        for n, m in known.items()
        if n not in used and m.role in ("", "reading") and is_numeric(clues, n) and n != ROW
    ]
    left = [n for n in left if strip and n not in clues.answers and len(set(clues.table.column(n))) > 1]
    columns, paired = ends_of_columns(clues, readings, which, left)
    indexed = all(re.search(r"\[\d+\]", n) for n in readings)  # places in a list or a matrix
    numbered = strip != ROW if strip else not (indexed or clues.counted)
    return Columns(
        columns, known | readings, time, scan if strip else "", strip, which, paired, step, numbered
    )

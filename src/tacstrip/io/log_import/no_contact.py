"""Words and numbers that stand for no contact."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.columns import Columns
from tacstrip.io.log_import.fields import clock_seconds, number_of, says_nothing
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.plausible import roughness
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import BOUND, LogScan
from tacstrip.io.log_import.statements import untouched_said
from tacstrip.io.log_import.table import NoTableError, Table
from tacstrip.io.log_import.units import BITS
from tacstrip.io.log_import.words import finder

_SENTINELS = (999.0, 9999.0, 99999.0, 32767.0, 65535.0, 99.9, 99.99, 999.9, 999.99)
_NEAR_0 = 0.01  # of the largest reading; and of the most that there can be
_NOISE = 0.005  # of the largest reading: so far noise takes one at 0 below it
_REST = 0.05  # of the largest reading: the most that the noise of open inputs reaches
_GAP = 5.0  # times: how far above that the other readings begin
_FEW_TOUCHED = 0.005  # of the readings: fewer are no contact among noise
_FLOATING = 0.2  # of the readings: so many near 0 are hardly contacts, all of them
_MANY = 0.05  # of the readings: more that are exactly 0 are no chance
_FULL = 0.9  # of the largest reading: what becomes larger than the range goes there from above
_OVER_RANGE = re.compile(
    r"\++|\*+|\+?(?:over(?:range|load)?|o\.?l\.?|ovl?d|burnout|inf)|[+-]?\u221e", re.IGNORECASE
)  # of loggers


def words_for_nothing(clues: Clues, found: Columns) -> tuple[str, ...]:
    """Return words that are no readings, which the user says stand for no contact; ask where nothing is said."""
    if (answer := clues.answers.get("untouched")) is not None:
        return () if answer in ("none", "empty") else _that_apply(answer, clues.table, found)
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
                    words = sum(_is_word(t, table.decimal) for t in table.column(name))
                    raise (NoTableError if 2 * words > len(table.rows) else ReadingError)(
                        f"line {line}: {name} is {text!r}, which is no number; mend it, or say --answer "
                        f"'{name}=skip' if the column holds no readings"
                    )
                said = {t for n in found.readings for t in table.column(n) if _is_word(t, table.decimal)}
                if said <= {*untouched_said(clues.table.preamble)}:
                    return tuple(sorted(said))
                if any(_says_a_fault(t) or any(c.isdigit() for c in t) for t in said):
                    clues.ask(
                        "untouched",
                        f"line {line}: {text!r} is no number; does it stand for no contact? (If it is a fault, take "
                        "its lines out)",
                        text,
                    )
                return tuple(sorted(said))
    return ()


def _that_apply(answer: str, table: Table, found: Columns) -> tuple[str, ...]:
    """Return what an answer says stands for no contact; `OptionError` for what no reading's column holds."""
    words = tuple(filter(None, (a.strip() for a in answer.split(","))))
    there = {text for name in found.readings for text in table.column(name)}
    for word in words:
        number = number_of(word)
        if (
            number == 0.0 or word in there or BOUND.fullmatch(word)
        ):  # codes may have their 0 at half of full scale
            continue
        if number is not None and number in {number_of(t, table.decimal) for t in there}:
            continue
        raise OptionError(
            f"--answer untouched={answer}: {word!r} stands in no column of readings; say what does, <N or >N for all "
            "readings below or above N, or none"
        )
    return words


def _says_a_fault(word: str) -> bool:
    return finder("fault").search(word.replace("_", " ")) is not None


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
    doubtful = any("?" in w for w in mapping.untouched) and roughness(values) is None
    if (
        values.shape[2] == 2
        and (idle[:, :, 0] == idle[:, :, 1]).all()
        and idle.mean() > _MANY
        and not doubtful
    ):
        clues.because(f"{word}: no contact, for both channels of a strip have it at once, and none alone")
        return
    over = any(map(_OVER_RANGE.fullmatch, mapping.untouched))
    if values.shape[2] == 1 and _are_apart(idle[:, :, 0]) and not (doubtful or over):
        clues.doubt(
            f"{word!r} is taken for no contact: strips without it lie side by side, and whole scans have it; else take "
            "these lines out"
        )
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


def _are_apart(idle: BoolArray) -> bool:
    """Return whether strips that are not idle, (scans, strips), lie side by side in each scan, and some have none."""
    side_by_side = all(row[np.argmax(row) :][: row.sum()].all() for row in ~idle)
    several = ((~idle).sum(axis=1) > 1).any()
    return bool(side_by_side and several and _MANY < idle.mean() < 1.0 and idle.all(axis=1).mean() > _MANY)


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
    whole = len(negative) == 1 and negative[0] <= -1.0 and (negative[0] % 1.0 == 0.0 or nines)
    if whole and not _is_noise(values, negative[0]):
        found.append(f"{negative[0]:g}")
        clues.because(f"{negative[0]:g} stands for no contact: it is the only negative number")
    rest = sorted(v for v in numbers if f"{v:g}" not in found)
    if len(rest) > 1 and (
        (rest[-1] in _SENTINELS and rest[-2] < 0.5 * rest[-1])
        or (
            rest[-2] < _NEAR_0 * rest[-1]
            and numbers[rest[-1]] > _MANY * values.size
            and _is_alone(values, rest[-1])
        )
    ):
        found.append(f"{rest.pop():g}")
        clues.because(f"{found[-1]} stands for no contact: all other readings are far below it")
    rests = clues.sensor is not None and clues.sensor.rest_volt is not None
    if rest and clues.answers.get("missing") == "untouched":  # the others may have noise, all the same
        idle = np.asarray(np.isnan(values).all(axis=2))  # (scans, strips)
        values = np.where(idle[:, :, None], rest[0], values)[:, ~idle.all(axis=0)]
    if rest and not (rests or found or np.isnan(values).any()):
        found += _at_an_end(clues, values, rest)
    return tuple(found)


def _is_noise(values: FloatArray, negative: float) -> bool:
    """Return whether a number just below 0 is a reading near 0: one end of a strip has it alone, or others are near."""
    top = float(np.nanmax(values))
    there = values == negative
    alone = there.any(axis=2) != there.all(axis=2)
    others = (values > 0.0) & (values < _NEAR_0 * top)
    return -negative < _NOISE * top and bool((alone if values.shape[2] > 1 else others).any())


def _is_alone(values: FloatArray, end: float) -> bool:
    """Return whether both channels of a strip have a number at once, and strips without it lie side by side."""
    idle = np.asarray((values == end).all(axis=2))
    side_by_side = all(row[np.argmax(row) :][: row.sum()].all() for row in np.asarray(~idle))
    return side_by_side and bool(((values == end).any(axis=2) == idle).all())


def _at_an_end(clues: Clues, values: FloatArray, rest: list[float]) -> list[str]:
    """Return 0, the most that there can be, or what is near 0, where that is no reading; ask where it may be one."""
    most = {2.0**bits - 1.0 for bits in BITS} | ({clues.sensor.vref_volt} if clues.sensor else set())
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
        elif values.shape[2] == 1 and _is_alone(values, end) and there.all(axis=(1, 2)).any():
            told += ", and strips without it lie side by side: it stands for no contact"
        else:
            told += ": does it stand for no contact, or is it a reading (none)?"
            clues.ask("untouched", told, f"{end:g}", "none")
            return []
        clues.because(told)
        return [f"{end:g}"]
    if noise := _noise_at_full_scale(clues, values, rest, most):
        return noise
    low = [v for v in rest if v < _REST * rest[-1]]
    high = rest[len(low) :]
    there = values <= max(low, default=-1.0)
    if ends or not (low and high):
        return []
    if high[0] <= _GAP * max(low[-1], -low[0]):
        if (values < _REST * rest[-1]).mean() > _FLOATING:
            clues.ask(
                "untouched",
                f"every strip has a reading, and {100 * there.mean():.0f} % are {low[-1]:g} or less, which "
                "no gap parts from the others: do strips that nothing touches read so, or are all touched (none)? "
                "The spec's rest_volt and touch_volt say it, too",
                f"<{high[0]:g}", "none",
            )  # fmt: skip
        return []
    if not _MANY < there.mean() < 1.0 - _FEW_TOUCHED:  # else the others have lost a point
        return []
    below = f"<{0.5 * (low[-1] + high[0]):.3g}"
    told = f"{100 * there.mean():.0f} % of the readings are {low[-1]:g} or less, and all others {high[0]:g} or more"
    both = values.shape[2] == 2 and (there[:, :, 0] == there[:, :, 1]).all() and low[-1] < _NEAR_0 * rest[-1]
    if both:
        clues.because(
            f"{told}: the noise of strips that nothing touches, for both channels of a strip are so low at once, and "
            "none alone"
        )
        return [below]
    clues.ask(
        "untouched", f"{told}: is that the noise of strips that nothing touches, or are they readings (none)?",
        below, "none",
    )  # fmt: skip
    return []


def _noise_at_full_scale(clues: Clues, values: FloatArray, rest: list[float], most: set[float]) -> list[str]:
    """Return what is above the readings where both channels of strips stand at full scale; ask if one does alone.

    Inputs that are pulled up rest there. A contact that drives k_l to 1 has no length.
    """
    if clues.sensor:
        most = most | {1000.0 * clues.sensor.vref_volt, 1.0, 100.0}
    if values.shape[2] != 2 or not any(abs(rest[-1] - m) <= _NEAR_0 * m for m in most):
        return []
    top = [v for v in rest if v > (1.0 - _NEAR_0) * rest[-1]]
    below = rest[len(rest) - len(top) - 1] if len(top) < len(rest) else rest[0]
    if rest[-1] - below <= max(_GAP * (rest[-1] - top[0]), _NEAR_0 * rest[-1]):
        return []
    there = values >= top[0]
    idle = there.all(axis=2)
    if not _MANY < idle.mean() < 1.0 - _FEW_TOUCHED:
        return []
    limit = f">{0.5 * (below + top[0]):.6g}"
    told = f"both channels of {100 * idle.mean():.0f} % of the strips are {top[0]:g} or more at once"
    if (there.any(axis=2) == idle).all():
        clues.because(f"{told}, and none alone: the noise of strips that nothing touches")
        return [limit]
    clues.ask(
        "untouched", f"{told}: is that where nothing touches, or are they readings (none)?", limit, "none"
    )
    return []

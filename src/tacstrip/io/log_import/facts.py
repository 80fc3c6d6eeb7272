"""What a log says of the sensor that it is of, to begin a spec with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tacstrip.io.log_import.guess import assembled, settled
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.table import Table

# What only the readings need, not the spec.
_OF_READINGS = frozenset(
    {"time_unit", "rate_hz", "unit", "missing", "broken_lines", "vref_volt", "adc_bits", "exchanged", "order"}
    | {"restart", "untouched", "which_h"}
)  # fmt: skip


@dataclass(frozen=True)
class SensorFacts:
    """What a log says of its sensor.

    Attributes
    ----------
    strips
        How many there are; None where the log lists only those that are touched.
    highest
        The highest number of a strip in the log.
    strip_base
        Number of the first strip.
    channels
        ("h", "l") or ("out",).
    unit
        Of the readings: as of `ColumnMapping.unit`, "" where the log does not tell.
    largest
        Reading, in that unit; 0 where there is none.
    whole
        Whether all readings are whole numbers, as codes are.
    reasons
        Why.
    """

    strips: int | None
    highest: int
    strip_base: int
    channels: tuple[str, ...]
    unit: str
    largest: float
    whole: bool
    reasons: tuple[str, ...]


def sensor_facts(table: Table, answers: Mapping[str, str] | None = None) -> SensorFacts:
    """Say what a log tells of its sensor.

    Raises
    ------
    Unanswered
        Which columns are readings of which strips cannot be known.
    ReadingError, OptionError
        As of `propose`.
    """
    return settled(table, lambda found: _facts(found, dict(answers or {})))


def _facts(table: Table, answers: dict[str, str]) -> SensorFacts:
    clues = Clues(table, None, answers)
    mapping, rough = assembled(clues)
    open_keys = {q.key for q in clues.questions}
    clues.questions = [q for q in clues.questions if q.key not in _OF_READINGS]
    clues.stop()
    values = np.stack([s.values for s in rough])  # (scans, strips, channels)
    whole = mapping.missing == "error" or "strips" in clues.answers
    return SensorFacts(
        mapping.strips if whole else None, mapping.strip_base + mapping.strips - 1, mapping.strip_base,
        mapping.channels, "" if "unit" in open_keys else mapping.unit,
        float(np.nanmax(values, initial=0.0)), bool((values[np.isfinite(values)] % 1.0 == 0.0).all()),
        tuple(clues.reasons),
    )  # fmt: skip

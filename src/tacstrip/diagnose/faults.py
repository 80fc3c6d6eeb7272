"""What can be wrong, what was found, and the whole report."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.data import data_path
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import channel_name

Severity = Literal["broken", "degraded", "note"]


@dataclass(frozen=True)
class Fault:
    """A kind of fault: its name, how bad it is, and what to check."""

    title: str
    severity: Severity
    check: str


FAULTS = {
    name: Fault(**row)
    for name, row in tomllib.loads(data_path("faults.toml").read_text(encoding="utf-8")).items()
}


@dataclass(frozen=True)
class Finding:
    """One fault and its evidence.

    Attributes
    ----------
    fault
        A key of `FAULTS`.
    strips
        The strips concerned, counted from 0; none: the whole sensor.
    evidence
        Why, in words and numbers.
    numbers
        The numbers alone, by name; voltages over Vref, lengths in mm.
    signature
        The channel, where it is one of two.

    Examples
    --------
    >>> from tacstrip.diagnose import Finding
    >>> finding = Finding("hum", (4,), "50 Hz of +-0.5 % of Vref", {"hertz": 50.0})
    >>> finding.kind.title, finding.kind.severity
    ('mains hum', 'degraded')
    """

    fault: str
    strips: tuple[int, ...]
    evidence: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    signature: str | None = None

    @property
    def kind(self) -> Fault:
        """The fault's row in the table."""
        return FAULTS[self.fault]

    @property
    def place(self) -> tuple[str, tuple[int, ...], str | None]:
        """What was found where, whatever the evidence."""
        return self.fault, self.strips, self.signature


@dataclass(frozen=True)
class Question:
    """What the readings leave open about a strip.

    Attributes
    ----------
    strips
        The strips concerned, counted from 0; none: the whole sensor.
    causes
        The one or two keys of `FAULTS` that would explain the readings, the likelier one first.
    evidence
        What was read.
    signature
        The channel, where it is one of two.

    Examples
    --------
    >>> from tacstrip.diagnose import Question
    >>> question = Question((3,), ("open-strip", "dead"), "lies 40 % of Vref off its neighbours' line in 1 place(s)")
    >>> question.ask(strip_base=1)
    'open strip or dead channel? Press strip 4 at three places, with the strips beside it, and run doctor again'
    """

    strips: tuple[int, ...]
    causes: tuple[str, ...]
    evidence: str
    signature: str | None = None

    def ask(self, strip_base: int = 0) -> str:
        """Return the question, and what to record for an answer; strips as the readings file counts them."""
        titles = " or ".join(FAULTS[cause].title for cause in self.causes)
        if not self.strips:
            ends = "Push a contact over each end of the strips, until it is off"
            wires = "Press at three heights in turn while you move the wires that the strips share"
            asks = {"wrong-vref": ends, "loose-ground": wires, "loose-supply": wires}
            what = asks.get(self.causes[0], "Record all strips once more, for longer")
            return f"{titles}? {what}, and run doctor again"
        names = " and ".join(str(i + strip_base) for i in self.strips)
        return (
            f"{titles}? Press strip {names} at three places, with the strips beside it, and run doctor again"
        )


@dataclass(frozen=True, eq=False)
class Quality:
    """The noise of a recording.

    Attributes
    ----------
    sigma
        Standard deviation of a reading over Vref, the median of the channels'; NaN where it could not be noise.
    strips
        That of each strip's noisier channel (strips,), NaN where there was too little.
    half_width_percent
        P.U.: half-width of a uniform error of this sigma, in % of Vref (5.1.3).
    profile
        "I", "II" or "above II", the error profiles of table 5.1; "" where nothing was noise.
    vertex_rms_mm
        Least RMS vertex error to expect of one scan of a typical contact [mm].
    steady
        Whether noise could be separated from the contact's motion; else all of these are upper bounds.
    """

    sigma: float
    strips: FloatArray
    half_width_percent: float
    profile: str
    vertex_rms_mm: float
    steady: bool


@dataclass(frozen=True, eq=False)
class Report:
    """What the doctor found.

    Attributes
    ----------
    findings
        Faults, broken ones first, of these the surest.
    notes
        Not faults, but worth knowing.
    questions
        What this recording cannot tell, strip by strip; no verdicts.
    unchecked
        What could not be checked in this recording, and what it would need; also what of it is missing.
    touched_scans
        In how many scans each strip was touched (strips,).

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import Log, diagnose
    >>> sensor = ts.Sensor(construction="crs-m", strips=4, pitch_mm=10.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(0, 30), (40, 30), (40, 60), (0, 60)])
    >>> report = diagnose(Log.of_scans(sensor, [ts.simulate(sensor, contact, rng=0)] * 3))
    >>> report.healthy, report.unchecked[0]  # a contact that does not move shows little
    (True, 'shorts, strips exchanged, stuck channels, saturation: the contact stood at 1 place(s); move and turn it')
    """

    findings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    questions: tuple[Question, ...]
    unchecked: tuple[str, ...]
    quality: Quality
    touched_scans: IntArray
    seconds: float
    scans: int
    strip_base: int

    @property
    def healthy(self) -> bool:
        """Whether no fault was found."""
        return not self.findings

    def of_strip(self, strip: int) -> tuple[Finding, ...]:
        """Return the faults of one strip, counted from 0; those of the whole sensor are not among them."""
        return tuple(f for f in self.findings if strip in f.strips)

    def condition(self, strip: int) -> str:
        """Return "broken", "degraded", "asked" of a strip in question, "ok", or "unchecked": nothing touched it."""
        worst = {f.kind.severity for f in self.of_strip(strip)}
        for severity in ("broken", "degraded"):
            if severity in worst:
                return severity
        if any(strip in q.strips for q in self.questions):
            return "asked"
        return "ok" if self.touched_scans[strip] else "unchecked"

    def where(self, finding: Finding | Question) -> str:
        """Name a finding's strips as the readings file counts them."""
        if not finding.strips:
            return "all strips"
        numbers = [str(i + self.strip_base) for i in finding.strips]
        names = "strip " + numbers[0] if len(numbers) == 1 else "strips " + ", ".join(numbers)
        return names if finding.signature is None else f"{names}, {SIGNATURES[finding.signature].volt_column}"

    def without(self, finding: Finding) -> str:
        """Return the name of the channel or strip that a finding spoils, to leave it out; "" where it is neither."""
        if len(finding.strips) != 1:
            return ""
        if finding.fault == "tied-wires":  # nobody knows which of its two readings is right
            return str(finding.strips[0] + self.strip_base)
        if finding.signature is None:
            return ""
        return channel_name(finding.strips[0], finding.signature, self.strip_base)

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON values; strips are counted as in the readings file, null is not noise."""
        return {
            "format": 1,
            "healthy": self.healthy,
            "scans": self.scans,
            "seconds": self.seconds,
            "findings": [self._entry(f) for f in self.findings],
            "notes": [self._entry(f) for f in self.notes],
            "questions": [
                {
                    "strips": [i + self.strip_base for i in q.strips],
                    "causes": list(q.causes),
                    "signature": q.signature,
                    "evidence": q.evidence,
                    "ask": q.ask(self.strip_base),
                }
                for q in self.questions
            ],
            "unchecked": list(self.unchecked),
            "noise": {
                "sigma": _number(self.quality.sigma),
                "half_width_percent": _number(self.quality.half_width_percent),
                "profile": self.quality.profile or None,
                "vertex_rms_mm": _number(self.quality.vertex_rms_mm),
                "upper_bound": not self.quality.steady,
            },
            "strips": [
                {
                    "strip": i + self.strip_base,
                    "condition": self.condition(i),
                    "touched_scans": int(self.touched_scans[i]),
                    "sigma": _number(self.quality.strips[i]),
                    "faults": [f.fault for f in self.of_strip(i)],
                }
                for i in range(len(self.touched_scans))
            ],
        }

    def _entry(self, finding: Finding) -> dict[str, Any]:
        return {
            "fault": finding.fault,
            "severity": finding.kind.severity,
            "strips": [i + self.strip_base for i in finding.strips],
            "signature": finding.signature,
            "evidence": finding.evidence,
            "numbers": {name: _number(v) for name, v in finding.numbers.items()},
            "check": finding.kind.check,
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

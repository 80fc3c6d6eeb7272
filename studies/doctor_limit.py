"""Whether the readings hold a fault at all: a likelihood ratio test that knows it, of units of the hold-out.

A unit is drawn again and read without noise, with its fault and without. What differs, in standard errors, is what a
test sees that knows what the fault does and where contacts end, and has to tell it from noise, the strip's rubber, its
zero's wander, its offset and its gain: no finder sees more. Beside it, what is left of that where outline and path of
the contact are to be found as well (`diagnose.rigid_contact`, fitted to the unit without its fault).
`python -m studies.doctor_limit 770-31 770-33 ...` prints it of recordings of the hold-out, by seed and number.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import tacstrip as ts
from studies.holdout import doctor_set, logs, units
from studies.holdout.logs import Bench, Touching
from studies.holdout.units import Array
from tacstrip.arrays import FloatArray
from tacstrip.diagnose import Log, read_log
from tacstrip.diagnose.bend_model import BendModel, Explanation
from tacstrip.diagnose.doctor import working_sigma
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, places, working_copy
from tacstrip.diagnose.noise import measure
from tacstrip.diagnose.rigid_contact import RigidContact

_APART = 2  # strips
_PARTS = 256  # as the doctor's
_UNEVEN, _PIECES = 0.023, 12  # the hold-out's rubber: deviation of a piece's resistance, and pieces
_OFFSET, _GAIN = 0.3, 0.003  # prior standard deviations of a channel's own, over Vref
_CHANCE = 3.7  # standard errors that noise exceeds on one of 20 strips in 1 of 200 recordings
_BESIDE = 0.03  # of L: a strip of which less is touched may be touched or not


@dataclass(frozen=True)
class Evidence:
    """What the readings of a unit hold of its fault.

    scans: in which strips at fault read as untouched, or the other way round, amid a contact. ends: standard errors of
    what readings differ by where contacts' ends are known. outline: the same where only the contact is rigid; NaN
    where no outline can be fitted.
    """

    kind: str
    scans: int
    ends: float
    outline: float

    @property
    def nothing(self) -> bool:
        """Whether noise alone does as much in 1 of 200 recordings, whatever the test."""
        return not self.scans and self.ends < _CHANCE

    @classmethod
    def of(cls, seed: int, number: int) -> Evidence:
        """Draw a faulty unit of the hold-out again, and return it."""
        random = np.random.default_rng([14, 1, seed, number])
        kind, lines = list(doctor_set.KINDS)[number // 2 % len(doctor_set.KINDS)], logs.lines
        caught: list[Any] = []

        def catch(*arguments: Any) -> Any:
            caught.extend(arguments[3:])
            return lines(*arguments)

        with mock.patch.object(logs, "lines", catch):
            one, touch, _, strips = doctor_set.faulty(random, kind)
        quiet = replace(one, material=units.Material(white=0.0, stray=0.0))
        with_it, without = (lines(quiet, touch, np.random.default_rng(0), *w) for w in (caught, (None, None)))
        both = (with_it >= 0) & (without >= 0)
        added = np.where(both, with_it - without, 0) / (2**one.converter.bits - 1)
        amid = np.nan_to_num(touch.high - touch.low) > _BESIDE * one.unit.length
        changed = ((with_it >= 0) != (without >= 0)).any(axis=0) & amid
        at = list(strips or range(one.unit.strips))
        ends = [
            _ends_known(one, touch, c[:, i], w[:, i]) for c, w in zip(added, without, strict=True) for i in at
        ]
        outline = _outline_found(one, touch, added, at)
        return cls(kind, int(changed[:, at].sum()), float(np.sqrt(np.sum(ends))), outline)


def _ends_known(one: Bench, touch: Touching, course: Array, codes: Array) -> float:
    """Return the squared standard errors of what a fault adds to a channel (scans,) that reads `codes` without it."""
    there, top = np.flatnonzero(codes >= 0), 2**one.converter.bits - 1
    knots, fine = np.linspace(0.0, 1.0, _PIECES + 1), np.linspace(0.0, 1.0, 401)
    density = np.stack([np.interp(fine, knots, piece) for piece in np.eye(_PIECES + 1)])
    below = np.cumsum(density, axis=1) / len(fine)
    below -= below[:, -1:] * fine
    height, apart = codes[there] / top, touch.time_s[there, None] - touch.time_s[there]
    rubber = np.stack([np.interp(height, fine, piece) for piece in below])
    errors = _UNEVEN**2 * rubber.T @ rubber + _GAIN**2 * np.outer(height - 0.5, height - 0.5) + _OFFSET**2
    wander = np.mean([np.exp(-np.abs(apart) / tau) for tau in units.WANDER_S], axis=0)
    errors += one.material.wander**2 * wander
    errors += (one.material.white**2 + 1.0 / (12.0 * top**2)) * np.eye(len(there))
    return float(course[there] @ np.linalg.solve(errors, course[there])) if len(there) else 0.0


def _outline_found(one: Bench, touch: Touching, added: Array, strips: list[int]) -> float:
    """Return the standard errors of what a fault adds (names, scans, strips) beyond outline, path and constants."""
    with tempfile.TemporaryDirectory() as folder:
        spec, file = Path(folder) / "sensor.toml", Path(folder) / "readings.csv"
        spec.write_text(one.spec())
        logs.write(file, one, logs.lines(one, touch, np.random.default_rng(0)), touch.time_s)
        log = read_log(file, ts.Sensor.load(spec))
    work = _in_parts(log)
    if (half := RigidContact.fit(work)) is None or (model := half.joined()).sigma > 1.5 * work.sigma:
        return float("nan")
    course = np.stack([[np.interp(work.time_s, touch.time_s, v) for v in channel.T] for channel in added])
    found = model.explain(course[:, model.strip, model.place].T[:, :, None])
    at = np.zeros(work.strips)
    at[[int(np.flatnonzero(work.order == i)[0]) for i in strips]] = 1.0
    power = float(at @ found.whole @ at) - float(np.sum((found.reduced @ at) ** 2))
    return math.sqrt(max(power, 0.0)) / model.sigma


def _in_parts(log: Log) -> WorkingCopy:
    """Return a log's places as the doctor takes them to look for drift."""
    return places(working_copy(log, working_sigma(measure(log))), max(len(log.time_s) // _PARTS, 1))


def shows(log: Log, sound: Log, strips: tuple[int, ...]) -> bool:
    """Whether a fault of one strip, or of two neighbours, shows more where it is than anywhere further away.

    What it adds, the readings of a log less those without it (scans, strips), is regressed on what shape and constant
    errors leave of the bends, and of one strip on what a rigid outline leaves, of these strips and, with the same
    course, of all others: a likelihood ratio test that knows the fault.
    """
    work = _in_parts(log)
    score, power = np.zeros((2, work.strips - len(strips) + 1))
    for name, values in work.k.items():
        model = BendModel.fit(work, values)
        if model is None:
            return False
        added = np.nan_to_num(log.k[name] - sound.k[name])
        course = [np.interp(work.time_s, log.time_s, added[:, i])[:, None] for i in strips]
        alternatives = [{at + i: c for i, c in enumerate(course)} for at in range(len(score))]
        own, common, _ = model.alternatives(alternatives)
        power += own[:, 0] / model.sigma**2
        score += common[:, 0] / model.sigma**2
    every = [np.abs(score) / np.sqrt(np.maximum(power, 1e-9))]
    if len(strips) == 1 and (half := RigidContact.fit(work)):
        outline = half.joined()
        course = np.mean([np.nan_to_num(log.k[name] - sound.k[name])[:, strips[0]] for name in log.k], axis=0)
        at_places = np.interp(work.time_s, log.time_s, course)[outline.place, None, None]
        every.append(_z(outline.explain(at_places), outline.sigma))
    far = np.abs(np.arange(len(score)) - strips[0]) > _APART
    return any(z[strips[0]] > z[far].max(initial=0.0) for z in every)


def _z(found: Explanation, sigma: float) -> FloatArray:
    """Return how many standard errors of a course each strip shows (strips,)."""
    return np.asarray(
        np.abs(found.score) / np.sqrt(np.maximum(found.power_of_groups(1).ravel(), 1e-9)) / sigma
    )


def main(recordings: list[str]) -> None:
    """Print a table of recordings, each as seed-number."""
    lines = [
        "| recording | fault | scans that differ | known ends, z | outline to be found, z | verdict |",
        "|" + " --- |" * 6,
    ]
    for name in recordings:
        seed, number = map(int, name.split("-"))
        row, verdict = Evidence.of(seed, number), doctor_set.score(seed, number)["verdict"]
        limit = " (the readings hold nothing)" * row.nothing
        lines.append(
            f"| {name} | {row.kind} | {row.scans} | {row.ends:.1f}{limit} | {row.outline:.1f} | {verdict} |"
        )
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])

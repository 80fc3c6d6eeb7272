"""Whether the readings hold a drift or wander at all: a likelihood ratio test that knows its course.

The hold-out units' drift and wander are drawn again, and what the fault adds over time, which no finder can know, is
regressed on what shape and constant errors leave of each strip's bends (`diagnose.bend_model`): z standard errors on
the strip that has it, and on those further than two strips away, which have none. What lies below the largest of the
latter cannot be named by bends without as many false alarms. Beside it, how many standard errors a test would see that
knows where the contact ends, too, and has to tell a drift from noise, the strip's rubber, its offset and its gain only.
`python -m studies.doctor_limit [last seed]`, tuning seeds from 0.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import tacstrip as ts
from studies.holdout import doctor_set, logs
from tacstrip.arrays import FloatArray
from tacstrip.diagnose import Log, read_log
from tacstrip.diagnose.bend_model import BendModel, Explanation
from tacstrip.diagnose.doctor import working_sigma
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.noise import measure
from tacstrip.diagnose.rigid_contact import RigidContact

KINDS = ("drift of 1-3 %", "slow wander")
_WAYS = ("bends", "outline")
_APART = 2  # strips
_PARTS = 256  # as the doctor's


_UNEVEN, _PIECES = 0.023, 12  # the hold-out's rubber: deviation of a piece's resistance, and pieces
_OFFSET, _GAIN = 0.3, 0.003  # prior standard deviations of a channel's own, over Vref
_CHANCE = 3.7  # |z| that noise exceeds on one of 20 strips in 1 of 200 recordings


@dataclass(frozen=True)
class Known:
    """What a test shows that knows the course of a fault: the doctor's verdict, and |z|.

    bends, outline: (|z| on the strip at fault, the largest on sound ones); ends: where contacts end is known, too.
    """

    verdict: str
    bends: tuple[float, float]
    outline: tuple[float, float]
    ends: float


def course_known(seed: int, number: int) -> Known:
    """Return what is shown of a drift or wander of the hold-out."""
    random = np.random.default_rng([14, 1, seed, number])
    kind = list(doctor_set.KINDS)[number // 2 % len(doctor_set.KINDS)]
    caught: dict[str, Any] = {}
    lines = logs.lines

    def catch(*arguments: Any) -> Any:
        caught["wrong"] = arguments[3]
        return lines(*arguments)

    with mock.patch.object(logs, "lines", catch):
        one, touch, codes, (strip,) = doctor_set.faulty(random, kind)
    with tempfile.TemporaryDirectory() as folder:
        spec, file = Path(folder) / "sensor.toml", Path(folder) / "readings.csv"
        spec.write_text(one.spec())
        logs.write(file, one, codes, touch.time_s)
        log = read_log(file, ts.Sensor.load(spec))
    still = np.full((1, len(touch.time_s), one.unit.strips), 0.5)
    added = caught["wrong"](still, np.broadcast_to(touch.time_s[:, None], still.shape[1:])) - still
    work = places(working_copy(log, working_sigma(measure(log))), max(len(log.time_s) // _PARTS, 1))
    course = np.interp(work.time_s, touch.time_s, added[0, :, strip])
    course -= course.mean()
    fits = [BendModel.fit(work, v) for v in work.k.values()]
    bends = [_z(m.explain(m.rows.effect(course[:, None])), m.sigma) for m in fits if m]
    half = RigidContact.fit(work)
    outline = half and half.joined()
    against = [_z(outline.explain(course[outline.place, None, None]), outline.sigma)] if outline else []
    far = np.abs(np.arange(work.strips) - strip) > _APART
    nothing = [np.zeros(work.strips)]
    shown = [np.max(z or nothing, axis=0) for z in (bends, against)]
    both = [(float(z[strip]), float(z[far].max(initial=0.0))) for z in shown]
    ends = ends_known(log, strip, added[0, :, strip], one.material.white)
    return Known(doctor_set.score(seed, number)["verdict"], both[0], both[1], ends)


def shows(log: Log, sound: Log, strips: tuple[int, ...]) -> bool:
    """Whether a fault of one strip, or of two neighbours, shows more where it is than anywhere further away.

    What it adds, the readings of a log less those without it (scans, strips), is regressed on what shape and constant
    errors leave of the bends, and of one strip on what a rigid outline leaves, of these strips and, with the same
    course, of all others: a likelihood ratio test that knows the fault.
    """
    work = places(working_copy(log, working_sigma(measure(log))), max(len(log.time_s) // _PARTS, 1))
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


def ends_known(log: Log, strip: int, course: FloatArray, white: float) -> float:
    """Return the standard errors of a course (scans,) that a test sees which knows what a sound strip would read."""
    knots, fine = np.linspace(0.0, 1.0, _PIECES + 1), np.linspace(0.0, 1.0, 401)
    density = np.stack([np.interp(fine, knots, one) for one in np.eye(_PIECES + 1)])
    below = np.cumsum(density, axis=1) / len(fine)
    below -= below[:, -1:] * fine
    power = 0.0
    for values in log.k.values():
        there = np.flatnonzero(log.touched[:, strip] & np.isfinite(values[:, strip]))
        height = np.clip(values[there, strip], 0.0, 1.0)
        rubber = np.stack([np.interp(height, fine, one) for one in below])
        errors = _UNEVEN**2 * rubber.T @ rubber + _GAIN**2 * np.outer(height - 0.5, height - 0.5)
        errors += _OFFSET**2 + white**2 * np.eye(len(there))
        power += float(course[there] @ np.linalg.solve(errors, course[there]))
    return float(np.sqrt(power))


def _z(found: Explanation, sigma: float) -> FloatArray:
    """Return how many standard errors of a course each strip shows (strips,)."""
    return np.asarray(
        np.abs(found.score) / np.sqrt(np.maximum(found.power_of_groups(1).ravel(), 1e-9)) / sigma
    )


def main(last: int) -> None:
    """Print a table of tuning seeds 0 to `last`."""
    every = len(doctor_set.KINDS)
    rows: dict[str, list[Known]] = {}
    for kind in KINDS:
        first = 2 * list(doctor_set.KINDS).index(kind) + 1
        rows[kind] = [course_known(s, first + 2 * every * turn) for s in range(last + 1) for turn in (0, 1)]
    limits = [max(getattr(row, of)[1] for some in rows.values() for row in some) for of in _WAYS]
    lines = [
        f"largest |z| of a strip without a fault, {of}: {z:.1f}" for of, z in zip(_WAYS, limits, strict=True)
    ]
    head = (
        "| fault | units | named or asked | below bends' limit | below outline's | below chance, known ends |"
    )
    lines += ["", head, "|" + " --- |" * 6]
    for kind, some in rows.items():
        below = [sum(getattr(r, of)[0] <= z for r in some) for of, z in zip(_WAYS, limits, strict=True)]
        told = sum(row.verdict != "missed" for row in some)
        chance = sum(row.ends <= _CHANCE for row in some)
        lines.append(f"| {kind} | {len(some)} | {told} | {below[0]} | {below[1]} | {chance} |")
    lines += ["", "missed, |z| of bends, outline, known ends:"]
    lines += [
        f"- {kind}: {r.bends[0]:.1f}, {r.outline[0]:.1f}, {r.ends:.1f}"
        for kind, some in rows.items() for r in some if r.verdict == "missed"
    ]  # fmt: skip
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)

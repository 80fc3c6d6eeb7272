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
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import tacstrip as ts
from studies.holdout import doctor_set, logs
from tacstrip.arrays import FloatArray
from tacstrip.diagnose import Log, read_log
from tacstrip.diagnose.bend_model import BendModel
from tacstrip.diagnose.doctor import working_sigma
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.noise import measure

KINDS = ("drift of 1-3 %", "slow wander")
_APART = 2  # strips
_PARTS = 256  # as the doctor's


_UNEVEN, _PIECES = 0.023, 12  # the hold-out's rubber: deviation of a piece's resistance, and pieces
_OFFSET, _GAIN = 0.3, 0.003  # prior standard deviations of a channel's own, over Vref
_CHANCE = 3.7  # |z| that noise exceeds on one of 20 strips in 1 of 200 recordings


def course_known(seed: int, number: int) -> tuple[str, float, float, float]:
    """Return the doctor's verdict, |z| on the strip at fault, the largest on sound ones, |z| with known ends."""
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
    z = np.max(
        [_z(BendModel.fit(work, v), course - course.mean(), work.strips) for v in work.k.values()], axis=0
    )
    far = np.abs(np.arange(work.strips) - strip) > _APART
    ends = ends_known(log, strip, added[0, :, strip], one.material.white)
    return doctor_set.score(seed, number)["verdict"], float(z[strip]), float(z[far].max(initial=0.0)), ends


def shows_in_bends(log: Log, sound: Log, strips: tuple[int, ...]) -> bool:
    """Whether a fault of one strip, or of two neighbours, shows more where it is than anywhere further away.

    What it adds, the readings of a log less those without it (scans, strips), is regressed on what shape and constant
    errors leave of the bends, of these strips and, with the same course, of all others: a likelihood ratio test that
    knows the fault.
    """
    work = places(working_copy(log, working_sigma(measure(log))), max(len(log.time_s) // _PARTS, 1))
    score, power = np.zeros((2, work.strips - len(strips) + 1))
    for name, values in work.k.items():
        model = BendModel.fit(work, values)
        if model is None:
            return False
        added = np.nan_to_num(log.k[name] - sound.k[name])
        course = [np.interp(work.time_s, log.time_s, added[:, i])[:, None] for i in strips]
        every = [{at + i: c for i, c in enumerate(course)} for at in range(len(score))]
        own, common, _ = model.alternatives(every)
        power += own[:, 0] / model.sigma**2
        score += common[:, 0] / model.sigma**2
    z = np.abs(score) / np.sqrt(np.maximum(power, 1e-9))
    far = np.abs(np.arange(len(z)) - strips[0]) > _APART
    return bool(z[strips[0]] > z[far].max(initial=0.0))


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


def _z(model: BendModel | None, course: FloatArray, strips: int) -> FloatArray:
    """Return how many standard errors of a course (places,) each strip shows (strips,)."""
    if model is None:
        return np.zeros(strips)
    found = model.explain(model.rows.effect(course[:, None]))
    return np.asarray(
        np.abs(found.score) / np.sqrt(np.maximum(found.power_of_groups(1).ravel(), 1e-9)) / model.sigma
    )


def main(last: int) -> None:
    """Print a table of tuning seeds 0 to `last`."""
    every = len(doctor_set.KINDS)
    rows = []
    for kind in KINDS:
        at = list(doctor_set.KINDS).index(kind)
        rows += [
            (kind, *course_known(s, 2 * (at + every * turn) + 1)) for s in range(last + 1) for turn in (0, 1)
        ]
    limit = max(row[3] for row in rows)
    lines = [
        f"largest |z| of a strip without a fault, in {len(rows)} recordings: {limit:.1f}",
        "",
        "| fault | units | named or asked | missed | of these below the limit | below chance with known ends |",
        "|" + " --- |" * 6,
    ]
    for kind in KINDS:
        some = [row for row in rows if row[0] == kind]
        missed = [row for row in some if row[1] == "missed"]
        below = sum(row[2] <= limit for row in missed)
        chance = sum(row[4] <= _CHANCE for row in missed)
        lines.append(
            f"| {kind} | {len(some)} | {len(some) - len(missed)} | {len(missed)} | {below} | {chance} |"
        )
    lines += ["", "missed: |z| " + ", ".join(f"{row[2]:.1f}" for row in rows if row[1] == "missed")]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)

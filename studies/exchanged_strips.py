"""Two strips in each other's places: `python -m studies.exchanged_strips [--seed S] [--logs N]`.

Short logs of one polygon that is held, slides or turns: 20 to 60 scans on 10 or 20 strips, noise of .2 to 1 %. Of each
the doctor reads three: with two neighbours exchanged, with two strips that are further apart, and as it is. What it
says of an exchanged pair is counted: found, asked about, named as not checked, or nothing. Of the sound log, findings
and questions are alarms, and the share of neighbours whose order is not checked is the price.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.faults import Report
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

MOTIONS = ("held", "slides", "turns")
_ORDER = "swapped-strips"
SAID = ("found", "asked", "not checked", "other strips", "silent")


def sound_log(seed: int) -> tuple[Log, str]:
    """Draw a unit, what touches it, and what it reads; return its motion, too."""
    rng = np.random.default_rng([seed, 90210])
    strips, pitch = int(rng.choice([10, 20])), float(rng.uniform(3.0, 8.0))
    rest = rng.random() < 0.3
    sensor = Sensor(
        construction=str(rng.choice(["crs-crs", "crs-m"])), strips=strips, pitch_mm=pitch,
        length_mm=float(rng.uniform(0.7, 2.0)) * strips * pitch, vref_volt=5.0,
        rest_volt=0.25 if rest else None, touch_volt=0.2 if rest else None,
    )  # fmt: skip
    corners = int(rng.integers(3, 7))
    angles = (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) * 2.0 * np.pi / corners
    size = rng.uniform(0.3, 0.8) * sensor.width_mm, rng.uniform(0.3, 0.7) * sensor.length_mm
    outline = 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1) * size
    motion, scans = str(rng.choice(MOTIONS)), int(rng.integers(20, 61))
    share = np.linspace(0.0, 1.0, scans)
    here = rng.uniform(0.35, 0.65, 2)
    there = rng.uniform(0.25, 0.75, 2) if motion == "slides" else here
    turned = rng.uniform(-np.pi, np.pi) + share * (rng.choice([-1, 1]) * rng.uniform(0.3, 2.0)) * (
        motion == "turns"
    )
    at_mm = (here + share[:, None] * (there - here)) * (sensor.width_mm, sensor.length_mm)
    contacts = [
        Contact.polygon(outline).turned(float(angle)).placed(float(x), float(y))
        for angle, (x, y) in zip(turned, at_mm, strict=True)
    ]
    noise = Noise(positional=float(rng.uniform(0.002, 0.01)))
    read = [simulate(sensor, c, noise, rng=rng) for c in contacts]
    k = {name: np.stack([scan[name] for scan in read]) for name in read[0].signatures}
    if sensor.rest_volt is not None:
        k = {name: np.where(np.isfinite(v), v, sensor.rest_volt / sensor.vref_volt) for name, v in k.items()}
    return Log.of(sensor, share * scans / 50.0, k), motion


def exchanged(log: Log, one: int, other: int) -> Log:
    """Return what the log would be with two strips in each other's places."""
    order = np.arange(log.sensor.strips)
    order[[one, other]] = other, one
    return Log.of(log.sensor, log.time_s, {name: v[:, order] for name, v in log.raw.items()})


def said(report: Report, pair: tuple[int, int]) -> str:
    """Return which of `SAID` the doctor says of an exchanged pair."""
    if any(f.fault == _ORDER and f.strips == pair for f in report.findings):
        return "found"
    if any(_ORDER in q.causes and set(q.strips) & set(pair) for q in report.questions):
        return "asked"
    untold = unchecked_strips(report)
    if set(pair) & untold:
        return "not checked"
    # Nobody is sent to the exchanged pair, but hears that something is wrong.
    near = {i + side for i in pair for side in (-1, 0, 1)}
    named = [*(f.strips for f in report.findings), *(q.strips for q in report.questions)]
    if any(near & set(strips) for strips in named):
        return "other strips"
    return "silent"


def unchecked_strips(report: Report) -> set[int]:
    """Return the strips whose order is said not to be checked, or of which nothing is."""
    found: set[int] = set()
    for reason in report.unchecked:
        if "never touched" in reason or "exchanged" in reason or "no usable" in reason:
            every = "contact stood" in reason or "four strips wide" in reason
            found |= set(range(len(report.touched_scans))) if every else numbers(reason)
    return found


def numbers(text: str) -> set[int]:
    """Return the strips of a reason: "strips 0-3, 7"."""
    match = re.search(r"strips? ((?:\d+(?:-\d+)?(?:, | and )?)+)", text)
    parts = re.findall(r"(\d+)(?:-(\d+))?", match[1]) if match else []
    return {i for first, last in parts for i in range(int(first), int(last or first) + 1)}


def pairs(log: Log, seed: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Draw two neighbours, and two strips further apart, of which one at least is touched."""
    rng = np.random.default_rng([seed, 7])
    touched = np.flatnonzero(log.touched.any(axis=0))
    one = int(rng.choice(touched[touched < log.sensor.strips - 1]))
    a, b = int(rng.choice(touched)), int(rng.integers(0, log.sensor.strips))
    while abs(a - b) < 2:
        a, b = int(rng.choice(touched)), int(rng.integers(0, log.sensor.strips))
    return (one, one + 1), (min(a, b), max(a, b))


def counted(
    seeds: Sequence[int], verbose: bool = False
) -> tuple[dict[tuple[str, str], Counter[str]], Counter[str]]:
    """Count what is said, by how far apart the two are and by motion, and the alarms of sound logs."""
    table: dict[tuple[str, str], Counter[str]] = {}
    sound: Counter[str] = Counter()
    for seed in seeds:
        log, motion = sound_log(seed)
        for kind, pair in zip(("neighbours", "far"), pairs(log, seed), strict=True):
            verdict = said(diagnose(exchanged(log, *pair)), pair)
            table.setdefault((kind, motion), Counter())[verdict] += 1
            if verbose:
                print(seed, kind, motion, pair, verdict)  # noqa: T201
        report = diagnose(log)
        sound["logs"] += 1
        sound["findings"] += bool(report.findings)
        sound["order found"] += any(f.fault == _ORDER for f in report.findings)
        sound["order asked"] += any(_ORDER in q.causes for q in report.questions)
        sound["asked"] += bool(report.questions)
        touched = np.asarray(log.touched.any(axis=0))
        untold = unchecked_strips(report)
        both = [(i, j) for i, j in pairwise(range(log.sensor.strips)) if touched[i] and touched[j]]
        sound["neighbours touched"] += len(both)
        sound["of these not checked"] += sum(bool({i, j} & untold) for i, j in both)
        if verbose and (report.findings or report.questions):
            what = [(f.strips, f.fault) for f in report.findings]
            asked = [(q.strips, q.causes) for q in report.questions]
            print(seed, "sound", motion, what, asked)  # noqa: T201
    return table, sound


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(prog="python -m studies.exchanged_strips", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--logs", type=int, default=20)
    parser.add_argument("--verbose", action="store_true")
    asked = parser.parse_args(arguments)
    table, sound = counted(range(asked.seed, asked.seed + asked.logs), asked.verbose)
    print("\n| exchanged | motion | " + " | ".join(SAID) + " |")  # noqa: T201
    for (kind, motion), count in sorted(table.items()):
        print(f"| {kind} | {motion} | " + " | ".join(str(count[v]) for v in SAID) + " |")  # noqa: T201
    print(dict(sound))  # noqa: T201


if __name__ == "__main__":
    main()

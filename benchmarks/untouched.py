"""How often untouched strips with readings are told, and how often contacts over all strips are taken for them.

Random sensors of 5 to 100 strips and random contacts, noise none to P.U. profile II; k_h and k_l together and alone.
Run: python benchmarks/untouched.py [recordings]
"""

from __future__ import annotations

import re
import sys
from collections import Counter

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import add_reading_errors
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.simulation import readings

KINDS = [kind for kind in CONSTRUCTIONS.values() if kind.closed_form]
NOISE = (0.0, 0.001, 0.005, 0.01)
HEALTHY = ("convex", "concave", "box", "along", "across")  # the last two dragged, ten scans


def sensor(random: np.random.Generator, number: int) -> ts.Sensor:
    """Draw a sensor."""
    kind, strips = KINDS[number % len(KINDS)], int(random.choice([5, 6, 8, 10, 16, 24, 50, 100]))
    pitch = float(random.uniform(1.0, 7.0))
    return ts.Sensor(
        construction=kind.name, strips=strips, pitch_mm=pitch, length_mm=random.uniform(1.0, 6.0) * strips * pitch,
        radius_mm=strips * pitch / 5.0 if kind.cylindrical else None,
    )  # fmt: skip


def outline(random: np.random.Generator, convex: bool = True) -> FloatArray:
    """Draw a polygon that fills the unit square."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 9)))
        if np.diff(angle, append=angle[0] + 2.0 * np.pi).max() < 0.95 * np.pi:
            reach = np.ones(len(angle)) if convex else random.uniform(0.4, 1.0, len(angle))
            corners = np.stack([np.cos(angle), np.sin(angle)], axis=1) * reach[:, None]
            return np.asarray((corners - corners.min(axis=0)) / np.ptp(corners, axis=0))


def over_all(random: np.random.Generator, of: ts.Sensor, kind: str) -> list[ts.Contact]:
    """Draw a contact over all strips, at one place or dragged."""
    high, over = random.uniform(0.05, 0.9) * of.length_mm, random.uniform(0.0, 0.6) * of.width_mm
    corners = outline(random, kind != "concave")
    if kind == "box":
        corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    contact = ts.Contact.polygon(corners * [of.width_mm + over + 2e-6, high])
    y = random.uniform(-0.3, 1.0) * (of.length_mm - 0.3 * high)
    contact = contact.moved(-over * random.uniform() - 1e-6, y)
    way = {"along": (0.0, 0.3 * of.length_mm), "across": (0.2 * of.width_mm, 0.0)}.get(kind)
    return (
        [contact.moved(*(np.array(way) * part)) for part in np.linspace(0.0, 1.0, 10)] if way else [contact]
    )


def read(
    random: np.random.Generator, of: ts.Sensor, contacts: list[ts.Contact], level: float
) -> list[dict[str, FloatArray]]:
    """Return readings (scans, strips), `level` where nothing touches: all signatures, then each alone."""
    noise = ts.Noise(positional=float(random.choice(NOISE)))
    k = {
        name: np.clip(add_reading_errors(np.where(np.isnan(v), level, v), noise, random), 0.0, 1.0)
        for name, v in readings(of, *ts.footprint(of, contacts)).items()
    }
    return [k, *({name: v} for name, v in k.items() if len(k) > 1)]


def main(recordings: int) -> None:
    """Print both counts."""
    random = np.random.default_rng(1)
    named, of_all = Counter[str](), Counter[str]()
    for number in range(recordings):
        unit, kind = sensor(random, number), HEALTHY[number // 3 % len(HEALTHY)]
        try:
            parts = read(random, unit, over_all(random, unit, kind), np.nan)
        except ts.ContactError:  # off the sensor, or from end to end over metal
            continue
        for k in parts:
            if np.isfinite(next(iter(k.values()))).all(axis=1).any():
                of_all[kind] += 1
                named[kind] += bool(rest_hint(unit, k))
    print("healthy recordings, contacts over all strips: named")
    for kind in HEALTHY:
        print(f"  {kind:<10}{named[kind]:>5} of {of_all[kind]}")
    named, of_all = Counter(), Counter()
    for number in range(recordings):
        unit, level = sensor(random, number), float(random.choice([0.0, 0.5, 1.0, random.uniform()]))
        size = [
            random.uniform(3.0 / unit.strips, 0.8) * unit.width_mm,
            random.uniform(0.1, 0.6) * unit.length_mm,
        ]
        place = random.uniform(0.2, 0.8) * unit.width_mm, random.uniform(0.3, 0.7) * unit.length_mm
        contact = ts.Contact.polygon(outline(random) * size).placed(*place)
        touched = np.isfinite(ts.footprint(unit, contact).l)
        if touched.all() or not touched.any() or unit.strips < 8:
            continue
        for k in read(random, unit, [contact], level):
            what = "k_h and k_l" if len(k) > 1 else "one signature"
            told = re.search(r"set rest_volt = ([\d.e+-]+)", rest_hint(unit, k))
            of_all[what] += 1
            named[what] += told is not None and abs(float(told[1]) / unit.vref_volt - level) < 0.02
    print("untouched strips with readings, one scan: told, the level within 2 % of Vref")
    for what, count in of_all.items():
        print(f"  {what:<15}{named[what]:>5} of {count}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 6000)

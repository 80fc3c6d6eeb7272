"""One faulty channel of ten strips: how many shapes come back right, with the channel named and without.

`python -m studies.faulty_channel` prints the table of docs/science/estimation.md.
"""

from __future__ import annotations

import sys

import numpy as np
import shapely

import tacstrip as ts
from tacstrip.arrays import FloatArray

SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
FAULTS = ("healthy", "named", "dead", "stuck", "saturated", "clipped")
_CLIP = 0.45  # of Vref, where a clipped channel stops
_RIGHT = 0.8  # IoU with the truth


def shapes(count: int, seed: int = 7) -> list[FloatArray]:
    """Draw convex shapes (N, 2) [mm] over five strips or more."""
    random = np.random.default_rng(seed)
    found: list[FloatArray] = []
    while len(found) < count:
        points = random.uniform(0.0, 1.0, (random.integers(6, 10), 2)) * random.uniform(
            (60.0, 40.0), (95.0, 80.0)
        )
        hull = shapely.MultiPoint(points).convex_hull
        corners = shapely.get_coordinates(hull)[:-1] - hull.bounds[:2]
        if hull.area >= 800.0 and np.ptp(corners[:, 0]) >= 50.0:
            found.append(corners + random.uniform((0.0, 3.0), (100.0, 97.0) - np.ptp(corners, axis=0)))
    return found


def right(truths: list[FloatArray], fault: str, noise: ts.Noise, known: bool) -> tuple[int, int]:
    """Return how many shapes are "ok" and right, and how many "ok" and wrong."""
    random, good, wrong = np.random.default_rng(3), 0, 0
    for truth in truths:
        scan = ts.simulate(SENSOR, ts.Contact.polygon(truth), noise, rng=random)
        strip, name, level = random.integers(10), ("kh", "kl")[random.integers(2)], random.uniform(0.1, 0.9)
        k = {n: scan[n].copy() for n in ("kh", "kl")}
        if fault != "healthy" and scan.touched[strip]:
            k[name][strip] = {
                "named": np.nan, "dead": 0.0, "stuck": level, "saturated": 1.0, "clipped": min(k[name][strip], _CLIP)
            }[fault]  # fmt: skip
        found = ts.fit_polygon(ts.Scan(kh=k["kh"], kl=k["kl"]), SENSOR, noise if known else None)
        if found.status == "ok" and len(found.objects) == 1:
            sure = ts.mismatch(truth, found.objects[0].vertices).iou >= _RIGHT
            good, wrong = good + sure, wrong + (not sure)
    return good, wrong


if __name__ == "__main__":
    truths = shapes(120)
    for amplitude in (0.005, 0.01):
        for known in (True, False):
            counts = [right(truths, fault, ts.Noise(positional=amplitude), known) for fault in FAULTS]
            told = " | ".join(f"{good} ({wrong} wrong)" for good, wrong in counts)
            sys.stdout.write(f"| {100.0 * amplitude:g} % | {'yes' if known else 'no'} | {told} |\n")

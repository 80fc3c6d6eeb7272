"""Batches of scans against vectorised NumPy and the copy of the result; footprints against Shapely; one scan.

Processor time of a thread counts where one thread works, so that other work on the machine disturbs little; the ratio
of two threads needs two cores that do nothing else. Run: python benchmarks/batches.py [--scans 20000] [--rounds 7]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

import tacstrip as ts
from tacstrip.core.batch import batch_sensor, plain_batch
from tacstrip.core.binding import BatchErrors

NOISE = ts.Noise(positional=0.004)


def least(work: Callable[[], Any], rounds: int, clock: Callable[[], float] = time.thread_time) -> float:
    """Return the least time of some rounds [s]."""
    found = []
    for _ in range(rounds):
        begun = clock()
        work()
        found.append(clock() - begun)
    return min(found)


def simulated(strips: int, scans: int, rounds: int, **kind: Any) -> str:
    """Return the table's row of a batch."""
    sensor = ts.Sensor(
        construction="crs-crs", strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0, adc_bits=12
    )
    shapes, noise = ts.Shapes(n=scans, **kind), NOISE
    by, laws = batch_sensor(sensor, single=True), shapes.laws(sensor)

    def made(workers: int = 1) -> ts.Scans:
        return ts.simulate_many(sensor, shapes, noise, rng=1, dtype="float32", workers=workers)

    result = made()
    assert result.labels is not None
    arrays = [result["kh"], result["kl"], result.l, result.u, *vars(result.labels).values()]
    some = max(scans // 20, 1)
    ours = least(made, rounds) / scans
    copy = least(lambda: [np.array(a) for a in arrays], rounds) / scans
    plain = least(lambda: plain_batch(by, BatchErrors((1, 2), (0.004, 0.0)), np.arange(some), laws), 3) / some
    one, two = (least(lambda w=w: made(w), rounds, time.perf_counter) for w in (1, 2))  # type: ignore[misc]
    name = ", ".join(f"{k}={v}" for k, v in kind.items()) or "polygons of 3 to 8 corners"
    return (
        f"| {strips} | {name} | {1e9 * ours:.0f} | {1e-6 / ours:.2f} | {ours / copy:.1f} | {plain / ours:.0f} | "
        f"{one / two:.2f} |"
    )


def footprints(rounds: int) -> str:
    """Return how footprints of given polygons compare with Shapely's intersections with centre lines."""
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0)
    drawn = ts.simulate_many(sensor, ts.Shapes(n=200), rng=1)
    contacts = [drawn.contact(i) for i in range(200)]
    lines = shapely.linestrings([[(x, -1.0), (x, 1001.0)] for x in sensor.x_mm])

    def by_shapely() -> None:
        for contact in contacts:
            shapely.prepare(contact.shapes[0])
            shapely.bounds(shapely.intersection(lines, contact.shapes[0]))

    ours, theirs = least(lambda: ts.footprint(sensor, contacts), rounds), least(by_shapely, 3)
    each = f"{1e6 * ours / 200:.1f} us each, Shapely {theirs / ours:.0f} times"
    return f"footprints of 200 polygons on 100 strips: {each}"


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--scans", type=int, default=20_000)
    options.add_argument("--rounds", type=int, default=7)
    given = options.parse_args()
    print("| strips | shapes | ns a scan | million scans/s | copies | NumPy takes, times | two threads |")
    print("| --- " * 7 + "|")
    for strips, kind in ((10, {}), (100, {}), (100, {"kinds": "ellipse"}), (100, {"objects": 3}), (1000, {})):
        print(
            simulated(strips, given.scans * min(100, 10_000 // strips) // 100, given.rounds, **kind),
            flush=True,
        )
    print(footprints(given.rounds))
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12)
    contact = ts.Contact.polygon([(100, 400), (350, 200), (800, 250), (850, 600), (500, 800)])
    for name, noise in (("without errors", ts.Noise()), ("with errors", NOISE)):
        one = least(lambda noise=noise: ts.simulate(sensor, contact, noise, rng=1), 2000)  # type: ignore[misc]
        print(f"simulate, one scan {name}: {1e6 * one:.0f} us")


if __name__ == "__main__":
    main()

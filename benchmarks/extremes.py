"""Inputs that nobody means: how long the slowest of them take.

A raw profile of 2000 points against a hexagon (wanted: 20 s), and fits of readings that are no contact (wanted: 20 s).

Run: python benchmarks/extremes.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray

FITS = 100


def seconds(job: Callable[[], object]) -> float:
    """Return how long a job takes [s]."""
    start = time.perf_counter()
    job()
    return time.perf_counter() - start


def circle(points: int) -> FloatArray:
    """Return a regular polygon of radius 10 mm."""
    angle = 2.0 * np.pi * np.arange(points) / points
    return 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def main() -> None:
    """Print the worst of each."""
    print(f"mismatch of 6 and 2000 points: {seconds(lambda: ts.mismatch(circle(6), circle(2000))):.2f} s")
    random = np.random.default_rng(1)
    times = []
    for i in range(FITS + 1):
        strips = 100 if i == 0 else int(random.integers(2, 500))
        sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=1.0, length_mm=100.0)
        gap = random.uniform(size=strips) < random.choice([0.0, 0.05, 0.5])
        kh, kl = np.where(gap, np.nan, random.uniform(0.0, 1.0, (2, strips)))
        scan = ts.Scan(kh=kh, kl=kl)
        times.append((seconds(lambda: ts.fit_polygon(scan, sensor, assessment="none")), strips))  # noqa: B023
    worst, strips = max(times[1:])
    print(f"fits of {FITS} random scans: {worst:.2f} s at worst, of {strips} strips")


if __name__ == "__main__":
    main()

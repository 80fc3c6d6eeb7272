"""`fit_polygons` on one thread and on two, in turn; the least of many rounds counts.

Two threads want two cores that do nothing else. Run: python benchmarks/threads.py [--seconds 10]
"""

from __future__ import annotations

import argparse
import time

import tacstrip as ts
from tacstrip.reconstruction.polygon.estimate import fit_polygons

CONTACT = ts.Contact.polygon([(100, 400), (350, 200), (800, 250), (850, 600), (500, 800)])
SCANS = 16


def main() -> None:
    """Print milliseconds per scan, and their ratio."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--seconds", type=float, default=10.0, help="per line")
    seconds = options.parse_args().seconds
    print("| strips | noise | ms, one thread | two | times as fast |")
    print("| --- " * 5 + "|")
    for strips in (100, 1000):
        sensor = ts.Sensor(
            construction="crs-crs", strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0, adc_bits=12
        )
        for distribution in ("normal", "uniform"):
            noise = ts.Noise(positional=0.004, distribution=distribution)
            scans = [ts.simulate(sensor, CONTACT, noise, rng=seed) for seed in range(SCANS)]
            least, end = [float("inf")] * 2, time.perf_counter() + seconds
            while time.perf_counter() < end:
                for i in range(2):
                    begun = time.perf_counter()
                    fit_polygons(scans, sensor, noise, workers=i + 1)
                    least[i] = min(least[i], time.perf_counter() - begun)
            one, two = (1e3 * value / SCANS for value in least)
            print(f"| {strips} | {distribution} | {one:.2f} | {two:.2f} | {one / two:.2f} |")


if __name__ == "__main__":
    main()

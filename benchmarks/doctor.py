"""Time the doctor takes for 10 s of 100 strips at 1 kHz: a sound unit, and one with a cut sensing strip.

Run: python benchmarks/doctor.py; it prints the median of three in seconds of CPU, reading a file not counted.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

import tacstrip as ts
from tacstrip.diagnose import Log, diagnose

SENSOR = ts.Sensor(
    construction="crs-crs", strips=100, pitch_mm=2.0, length_mm=200.0, rest_volt=0.0, touch_volt=0.02
)
RATE_HZ, SECONDS, CUT = 1000.0, 10.0, 40


def log(cut: bool) -> Log:
    """Return what a hexagon reads that slides over the strips to and fro, with white noise."""
    random, time_s = np.random.default_rng(11), np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    outline = np.array(
        [(-28.0, -20.0), (-5.0, -34.0), (24.0, -22.0), (30.0, 12.0), (4.0, 33.0), (-26.0, 18.0)]
    )
    moved = np.stack([100.0 + 62.0 * np.sin(0.9 * time_s), 100.0 + 55.0 * np.sin(1.7 * time_s)], axis=1)
    shapes = [ts.Contact.polygon(outline + place) for place in moved[::10]]
    scans = [ts.simulate(SENSOR, shape) for shape in shapes]
    full = {name: np.repeat(np.stack([scan[name] for scan in scans]), 10, axis=0) for name in ("kh", "kl")}
    for values in full.values():
        values += random.normal(0.0, 0.002, values.shape)
    if cut:
        full["kl"][:, CUT] = np.where(np.isnan(full["kl"][:, CUT]), np.nan, 0.0)
    return Log.of(SENSOR, time_s, full)


def main() -> None:
    """Print the table."""
    for name, recorded in (("sound", log(False)), (f"v_l of strip {CUT} cut", log(True))):
        took = []
        for _ in range(3):
            begun = time.process_time()
            report = diagnose(recorded)
            took.append(time.process_time() - begun)
        found = ", ".join(f"{f.fault} {f.strips}" for f in report.findings) or "no fault"
        print(f"{name}: {statistics.median(took):.2f} s of CPU; {found}")


if __name__ == "__main__":
    main()

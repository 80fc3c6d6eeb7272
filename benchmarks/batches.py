"""Simulating and profile-reconstructing 100-strip scans in batches, on one core, against a plain loop.

The loop is what (3.3), (3.4) and (4.36) look like typed as printed: scan by scan, strip by strip.
Run: python benchmarks/batches.py
"""

from __future__ import annotations

import numpy as np
from _timing import median_seconds

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.simulation import readings

SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
NOISE = ts.Noise(quantisation=0.001, positional=0.005)
SCANS = 1000
HEXAGON = ts.Contact.polygon([(0, 15), (15, 0), (50, 6), (62, 28), (40, 47), (8, 40)])


def batch(l: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Simulate and reconstruct all scans at once."""
    scan = readings(SENSOR, l, u, NOISE, 0)
    return closed_ends(SENSOR, scan["kh"], scan["kl"])


def plain_loop(l: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Do the same strip by strip."""
    random, length = np.random.default_rng(0), SENSOR.length_mm
    low, high = np.full(l.shape, np.nan), np.full(l.shape, np.nan)
    for scan in range(len(l)):
        for strip in range(l.shape[1]):
            if np.isnan(l[scan, strip]):
                continue
            a, w = l[scan, strip], u[scan, strip] - l[scan, strip]
            ideal = (a + w / 2) / (length - w / 2), a / (length - w / 2)
            noisy = (k + random.uniform(-0.001, 0.001) + random.uniform(-0.005, 0.005) for k in ideal)
            kh, kl = (round(min(max(k, 0.0), 1.0) * 4095) / 4095 for k in noisy)
            solved = np.linalg.solve(np.array([[1, (1 + kh) / 2], [1, kl / 2]]), np.array([kh, kl]) * length)
            low[scan, strip], high[scan, strip] = solved[0], solved[0] + solved[1]
    return low, high


def main() -> None:
    """Print scans per second of each method, and the ratio."""
    contacts = HEXAGON.dragged([(35.0, 30.0), (65.0, 70.0)], SCANS, 0.01)
    l, u = ts.footprint(SENSOR, contacts)
    fast = median_seconds(lambda: batch(l, u))
    whole = median_seconds(lambda: batch(*ts.footprint(SENSOR, contacts)))
    few = 20
    slow = median_seconds(lambda: plain_loop(l[:few], u[:few]), 3) * SCANS / few
    print(
        f"{SENSOR.strips} strips, {np.isfinite(l).sum() / SCANS:.0f} of them touched, batches of {SCANS} scans"
    )
    print(f"simulate + profile from l, u         {SCANS / fast:12,.0f} scans/s   (wanted: 50,000)")
    print(f"footprint + simulate + profile       {SCANS / whole:12,.0f} scans/s")
    print(f"plain loop, strip by strip           {SCANS / slow:12,.0f} scans/s   ratio {slow / fast:,.0f}")


if __name__ == "__main__":
    main()

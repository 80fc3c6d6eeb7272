"""What a calibration leaves on units that the network model makes: the table of docs/guide/calibration.md, and speeds.

Runs: 81 places and fewer, w = 0, 5, 10 units at the 1, 2, 3, ... unit marks, 3 repeats, +-0.2 % of Vref. Errors: the
largest on other contacts, without noise, up to the place where an offset takes readings to Vref.
Run: python benchmarks/calibration.py
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from _timing import median_seconds

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.calibrate import DriftEstimator
from tacstrip.calibrate.model import apply
from tacstrip.calibrate.model_selection import select_model
from tacstrip.calibrate.offsets import mean_offsets
from tacstrip.calibrate.residuals import residuals
from tacstrip.data.published import offsets_volt
from tacstrip.network import Imperfections
from tacstrip.sensor import Channel, apply_calibration

Places = list[tuple[float, float]]
UNIT, NOISE, LAMBDA, MISMATCH = 10.0, 0.002, 2.0, 1.05
RNG = np.random.default_rng(3)
BEND = 1.0 + 0.1 * np.sin(np.linspace(0.0, 3.0, 16))  # rubber that varies by 10 % along y
PATCHY = np.array([BEND * (1.0 + 0.05 * RNG.normal(size=16)) for _ in range(10)])


def offsets(construction: str, fade: float = 0.0) -> ts.Calibration:
    """Return the thesis' printed offsets (tables 6.1, 6.5) as what a unit does."""
    names = {"CRS-CRS": ("kh", "kl"), "CRS-M": ("k",)}[construction]
    return ts.Calibration(
        channels=tuple(
            Channel(signature=n, offset=tuple(offsets_volt(construction, n) / 6.05), fade=fade) for n in names
        )
    )


CASES: dict[str, tuple[str, Imperfections, ts.Calibration]] = {
    "mismatch 5 %": ("crs-crs", Imperfections(sensing=MISMATCH), offsets("CRS-CRS")),
    "own mismatch within 5 %": (
        "crs-crs", Imperfections(sensing=1.0 + RNG.uniform(-0.05, 0.05, 10)), offsets("CRS-CRS")
    ),
    "mismatch, offsets fade": ("crs-crs", Imperfections(sensing=MISMATCH), offsets("CRS-CRS", 0.12)),
    "mismatch, rubber varies": (
        "crs-crs", Imperfections(energised=PATCHY, sensing=MISMATCH * PATCHY), offsets("CRS-CRS")
    ),
    "CRS-M": ("crs-m", Imperfections(), offsets("CRS-M")),
    "CRS-M, offsets fade": ("crs-m", Imperfections(), offsets("CRS-M", 0.15)),
    "CRS-M, fade, rubber varies": ("crs-m", Imperfections(energised=np.tile(BEND, (9, 1))), offsets("CRS-M", 0.15)),
}  # fmt: skip


def runs(
    sensor: ts.Sensor,
    imperfections: Imperfections,
    unit: ts.Calibration,
    places: Places,
    repeats: int,
    noise: float,
) -> ts.Runs:
    """Return what a unit reads of contacts across all strips."""
    true, x, rng = replace(sensor, contact_lambda_mm=LAMBDA), sensor.width_mm, np.random.default_rng(0)
    raw: dict[str, list[FloatArray]] = {n: [] for n in sensor.signatures}
    for l, w in places:
        bar = (
            ts.Contact.polygon([(0, l), (x, l), (x, l + w), (0, l + w)])
            if w
            else ts.Contact.line([(0, l), (x, l)])
        )
        scan = ts.simulate(true, bar, model="network", imperfections=imperfections)
        for name, rows in raw.items():
            rows += [unit.distort(name, scan[name])] * repeats
    read = {n: np.array(v) + rng.uniform(-noise, noise, (len(v), sensor.strips)) for n, v in raw.items()}
    each = np.repeat(np.array(places), repeats, axis=0)[:, :, None] * np.ones(sensor.strips)
    line = np.arange(each[:, 0].size).reshape(each[:, 0].shape) + 2
    return ts.Runs(each[:, 0], each[:, 1], {n: np.clip(v, 0.0, 1.0) for n, v in read.items()}, line, {})


def largest(sensor: ts.Sensor, check: ts.Runs) -> float:
    """Return the largest error of corrected readings [% of Vref]."""
    return max(float(100.0 * np.abs(v).max()) for v in residuals(sensor, check).values())


def main() -> None:
    """Print the table and the speeds."""
    print(f"{'unit':<28}{'raw':>6}{'mean':>7}{'model':>7}  chosen (largest error, % of Vref)")
    for name, (construction, imperfections, unit) in CASES.items():
        sensor = replace(ts.Sensor.load(f"prototype-{construction}"), strip_width_mm=None)
        length = sensor.length_mm
        marks = [(float(l), w) for w in (0.0, 5 * UNIT, 10 * UNIT) for l in np.arange(UNIT, length - w, UNIT)]
        fresh = [(float(l), s * length) for s in (0.0, 0.08, 0.23, 0.4)
                 for l in np.arange(5.0, (0.93 - s) * length, 0.052 * length)]  # fmt: skip
        measured = runs(sensor, imperfections, unit, marks, 3, NOISE)
        check = runs(sensor, imperfections, unit, fresh, 1, 0.0)
        begin = time.perf_counter()
        found, _ = select_model(sensor, measured)
        seconds = time.perf_counter() - begin
        thesis = replace(sensor, calibration=mean_offsets(sensor, measured))
        errors = [largest(s, check) for s in (sensor, thesis, apply(found.constants, sensor))]
        numbers = f"{errors[0]:6.2f}{errors[1]:7.2f}{errors[2]:7.3f}"
        print(f"{name:<28}{numbers}  {found.constants.model.name} ({seconds:.1f} s)")
    many = ts.Sensor(
        construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=325.0, rest_volt=0.1, touch_volt=0.01
    )
    at = tuple(float(v) for v in np.linspace(0.0, 1.0, 9))
    ends = tuple(
        Channel(signature=n, offset=(0.02,) * 100, gain=(0.98,) * 100, rest=(0.02,) * 100)
        for n in ("kh", "kl")
    )
    raw = {"kh": np.linspace(0.3, 0.8, 100), "kl": np.linspace(0.1, 0.2, 100)}
    plain = replace(many, calibration=ts.Calibration(channels=ends))
    warped = replace(
        many, calibration=ts.Calibration(channels=ends, ratio=(1.1,) * 100, warp_at=at, warp=(at,) * 100)
    )
    drift = DriftEstimator(plain)
    print("100 strips, double measurement, one core, microseconds a scan:")
    print(f"  offset, gain, touch      {1e6 * median_seconds(lambda: apply_calibration(plain, raw)):.0f}")
    print(f"  with ratios and warp     {1e6 * median_seconds(lambda: apply_calibration(warped, raw)):.0f}")
    print(
        f"  drift estimate           {1e6 * median_seconds(lambda: drift.update(raw, drift.scans * 1e-3)):.0f}"
    )


if __name__ == "__main__":
    main()

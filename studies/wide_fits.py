"""Fits on wide strips: how often the number of corners is right, and 95 % regions of the corners hold.

`python -m studies.wide_fits [SEED]` prints the table of docs/science/estimation.md.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.geometry.outline import Outline

_LENGTH, _CASES = 100.0, 14
_CHI_SQUARE = 5.991  # of two degrees of freedom, 95 %
# Construction, ratio, strips, width over L, noise, whether the count is given.
CELLS = (
    *(("crs-crs", 1.0, 40, 0.02, noise, False) for noise in (0.001, 0.003, 0.01)),
    *(("crs-crs", 1.0, 20, 0.05, noise, True) for noise in (0.003, 0.01)),
    ("crs-crs", 0.2, 40, 0.02, 0.003, False),
    ("crs-m", 0.0, 40, 0.02, 0.003, True),
)


def corners(sensor: ts.Sensor, random: np.random.Generator) -> FloatArray:
    """Draw a convex polygon (4 to 6, 2) [mm] whose corners are 1.2 pitches or more apart in x."""
    size = np.array([sensor.width_mm, sensor.length_mm])
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(4, 7)))
        middle, radius = size * random.uniform(0.4, 0.6, 2), size * random.uniform(0.25, 0.4)
        points = middle + np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        gaps = np.diff(angle, append=angle[0] + 2.0 * np.pi)
        inside = points.min() >= 4.0 and (points <= 0.96 * size).all()
        apart = np.diff(np.sort(points[:, 0])).min() >= 1.2 * sensor.pitch_mm
        if inside and apart and gaps.max() <= 2.6 and gaps.min() >= 0.5:
            return np.asarray(points)


def measure(
    construction: str, ratio: float, strips: int, width: float, noise: float, given: bool, seed: int
) -> tuple[float, float, float]:
    """Return the share of right counts; of these that of corners within their region, and the median RMS [mm]."""
    keys: dict[str, Any] = {"resistivity_ratio": ratio} if ratio else {}
    b = width * _LENGTH
    sensor = ts.Sensor(
        construction=construction, strips=strips, pitch_mm=b, length_mm=_LENGTH, strip_width_mm=b, **keys
    )
    within, rms = [], []
    for case in range(_CASES):
        truth = Outline.of(corners(sensor, np.random.default_rng([seed, case]))).vertices
        ideal = ts.simulate(sensor, ts.Contact.polygon(truth))
        random = np.random.default_rng([seed, case, 0, 1])
        noisy: dict[str, Any] = {
            name: ideal[name] + random.uniform(-noise, noise, strips) for name in sensor.signatures
        }
        found = ts.fit_polygon(
            ts.Scan(**noisy), sensor, ts.Noise(positional=noise), bounded=False, assessment="none",
            vertices=len(truth) if given else None,
        ).objects[0]  # fmt: skip
        if found.covariance is None or found.vertices.shape != truth.shape:
            continue
        off = found.vertices - truth
        rms.append(float(np.sqrt((off**2).sum(axis=1).mean())))
        for i, e in enumerate(off):
            own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
            within.append(e @ np.linalg.pinv(own) @ e < _CHI_SQUARE)
    return len(rms) / _CASES, float(np.mean(within)), float(np.median(rms))


def main() -> None:
    """Print a line per cell."""
    seed = int(sys.argv[1]) if sys.argv[1:] else 70
    for cell in CELLS:
        right, holds, rms = measure(*cell, seed)
        sys.stdout.write(f"{cell}: right {right:.2f}, regions hold {holds:.2f}, RMS {rms:.3f} mm\n")


if __name__ == "__main__":
    main()

"""The protocol of the transitions benchmark: random convex polygons and what a sensor reads of them.

Polygons have 3 to 6 corners on an ellipse. Their corners lie at least 10 % of the contact's width apart in x, and at
each of them the slope of a signature jumps by at least 0.15 of full scale per width. A contact spans n strips; where
in their pitch its ends lie is random too. Errors are independent and uniform within +-a, and a 12-bit converter reads
the sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance

LENGTH_MM = 1000.0
BITS = 12
SIGNATURES: dict[str, tuple[str, ...]] = {"kh": ("kh",), "kl": ("kl",), "k": ("k",), "both": ("kh", "kl")}
_LEAST_GAP = 0.1  # of the width
_LEAST_JUMP = 0.15  # of full scale per width
_CORNERS = (3, 6)
_HALF_HEIGHT = (0.05, 0.25)  # of the strip length
_STEP = 1e-6  # of the width: a slope is a difference over it


@dataclass(frozen=True)
class Cell:
    """One row of the table."""

    kind: str
    noise: float
    strips: int

    @property
    def sensor(self) -> ts.Sensor:
        """A sensor with two strips to spare."""
        construction = "crs-m" if self.kind == "k" else "crs-crs"
        pitch = LENGTH_MM / self.strips
        return ts.Sensor(
            construction=construction,
            strips=self.strips + 2,
            pitch_mm=pitch,
            length_mm=LENGTH_MM,
            adc_bits=BITS,
        )


@dataclass(frozen=True)
class Trial:
    """One contact, its readings and what can be known of it."""

    truth: FloatArray  # corners (N, 2) [mm], counter-clockwise from the left-most
    x: FloatArray  # centre lines of the strips in contact (n,) [mm]
    scan: ts.Scan
    bound: FloatArray  # covariance (2 N, 2 N) [mm^2]

    @property
    def interior(self) -> FloatArray:
        """Where the interior corners are in x [mm], ascending."""
        return np.sort(self.truth[:, 0])[1:-1]


def trial(cell: Cell, random: np.random.Generator) -> Trial:
    """Draw a contact and read it."""
    sensor, names = cell.sensor, SIGNATURES[cell.kind]
    pitch, shape = sensor.pitch_mm, _polygon(cell, random)
    left, right = random.uniform(-0.5, 0.5, 2) * pitch + (pitch, LENGTH_MM + pitch)
    truth = np.stack([left + shape[:, 0] * (right - left), shape[:, 1] * LENGTH_MM], axis=1)
    scan = ts.simulate(sensor, ts.Contact.polygon(truth), ts.Noise(quantisation=cell.noise), rng=random)
    outline = Outline.of(truth)
    bound = vertex_covariance(
        outline, sensor, reading_sigma(ts.Noise(quantisation=cell.noise), sensor), names
    )
    kh, kl, k = (scan[name] if name in names else None for name in ("kh", "kl", "k"))
    return Trial(outline.vertices, sensor.x_mm[scan.touched], ts.Scan(kh=kh, kl=kl, k=k), bound)


def _polygon(cell: Cell, random: np.random.Generator) -> FloatArray:
    """Draw corners (N, 2), x from 0 to 1 over the contact, y over the strip."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(_CORNERS[0], _CORNERS[1] + 1)))
        if np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max() > 0.95 * np.pi:
            continue  # the ellipse's centre lies outside: a sliver
        half = random.uniform(*_HALF_HEIGHT)
        centre, turn, flat = (
            random.uniform(half + 0.02, 0.98 - half),
            random.uniform(0.0, np.pi),
            random.uniform(0.4, 1.0),
        )
        on_ellipse = np.stack([np.cos(angle), flat * np.sin(angle)], axis=1)
        cos, sin = np.cos(turn), np.sin(turn)
        x, y = (on_ellipse @ np.array([[cos, sin], [-sin, cos]])).T
        x = (x - x.min()) / np.ptp(x)
        shape = np.stack([x, centre + half * y], axis=1)
        if np.diff(np.sort(x)).min() >= _LEAST_GAP and _jumps(cell, shape).min() >= _LEAST_JUMP:
            return shape


def _jumps(cell: Cell, shape: FloatArray) -> FloatArray:
    """Return each interior corner's jump of slope, in the signature where it is largest."""
    outline = Outline.of(shape)
    x = np.sort(shape[:, 0])[1:-1]
    unit = ts.Sensor(construction=cell.sensor.construction, strips=1, pitch_mm=1.0, length_mm=1.0)
    at = [ts.signatures(unit, *outline.ends(x + i * _STEP)) for i in (-1, 0, 1)]
    bends = [at[0][n] - 2.0 * at[1][n] + at[2][n] for n in SIGNATURES[cell.kind]]
    return np.asarray(np.abs(bends).max(axis=0) / _STEP)

"""What a strip reads, written out from chapter 3 and the transfer length, and a unit that draws where it is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import tacstrip as ts
from studies.holdout.shapes import Array


@dataclass(frozen=True)
class Unit:
    """A sensor: strips of a length and pitch [mm], decay length of the contact [mm], sensing over energised ohms."""

    names: tuple[str, ...]  # of what it reads: "kh", "kl" of CRS-CRS, or "k" of CRS-M
    strips: int
    pitch: float
    length: float
    contact_lambda: float = 0.0
    ratio: float = 1.0
    bits: int | None = None
    width: float | None = None  # of a strip [mm]; None: it reads on its centre line

    @property
    def x(self) -> Array:
        """Centre lines (strips,) [mm]."""
        return np.asarray((np.arange(self.strips) + 0.5) * self.pitch)

    @property
    def sensor(self) -> ts.Sensor:
        """The same for the package."""
        metal = self.names == ("k",)
        return ts.Sensor(
            construction="crs-m" if metal else "crs-crs",
            strips=self.strips,
            pitch_mm=self.pitch,
            length_mm=self.length,
            contact_lambda_mm=self.contact_lambda,
            strip_width_mm=self.width,
            adc_bits=self.bits,
            resistivity_ratio=1.0 if metal else self.ratio,
        )

    def touched(self, outlines: Sequence[Array]) -> tuple[Array, Array]:
        """Return the lowest and highest touched y (strips,) of shapes [mm], NaN where nothing touches."""
        low, high = np.full(self.strips, np.inf), np.full(self.strips, -np.inf)
        for outline in outlines:
            (x0, y0), (x1, y1) = outline.T[:, :, None], np.roll(outline, -1, axis=0).T[:, :, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                y = y0 + (y1 - y0) * (self.x - x0) / (x1 - x0)  # (edges, strips)
            crossed = (np.minimum(x0, x1) <= self.x) & (self.x <= np.maximum(x0, x1)) & np.isfinite(y)
            low = np.minimum(low, np.where(crossed, y, np.inf).min(axis=0))
            high = np.maximum(high, np.where(crossed, y, -np.inf).max(axis=0))
        low, high = np.maximum(low, 0.0), np.minimum(high, self.length)
        return np.where(low <= high, low, np.nan), np.where(low <= high, high, np.nan)

    def read(self, low: Array, high: Array) -> Array:
        """Return readings (names, strips) over Vref of contacts from `low` to `high` [mm], without error."""
        width = high - low
        lost = np.zeros_like(width)
        if self.contact_lambda:
            lost = self.contact_lambda * np.tanh(0.5 * width / self.contact_lambda)
        low, width = low + lost, width - 2.0 * lost
        # The energised strip in series: below the contact, under it (beside the second layer), above it.
        under = 0.0 if self.names == ("k",) else width * self.ratio / (1.0 + self.ratio)
        whole = self.length - width + under
        return np.stack([(low + under if name == "kh" else low) / whole for name in self.names])

    def scan(self, read: Array) -> ts.Scan:
        """Return readings (names, strips) as a scan, digitised."""
        return ts.Scan(**dict(zip(self.names, self.digitised(read), strict=True)))

    def digitised(self, read: Array) -> Array:
        """Return readings of any shape as the converter gives them: clipped to 0..1 and rounded to its steps."""
        read = np.clip(read, 0.0, 1.0)
        return read if self.bits is None else np.round(read * (2**self.bits - 1)) / (2**self.bits - 1)

    def sigma(self, half_width: float) -> float:
        """Return the standard deviation of errors of this half-width and of the converter's step [Vref]."""
        step = 0.0 if self.bits is None else 1.0 / (2**self.bits - 1)
        return float(np.sqrt(half_width**2 / 3.0 + step**2 / 12.0))


def white(shape: tuple[int, ...], half_width: float, distribution: str, random: np.random.Generator) -> Array:
    """Return independent errors, normal ones of the variance of uniform ones."""
    if distribution == "normal":
        return random.normal(0.0, half_width / np.sqrt(3.0), shape)
    return random.uniform(-half_width, half_width, shape)

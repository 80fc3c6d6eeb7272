"""Errors of readings made by other means than the package's: wander from its spectrum, soft edges by smoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray


@dataclass(frozen=True)
class Rubber:
    """What a sensor's errors are: fractions of Vref, mm and seconds.

    `flicker` is the Allan floor of noise with a spectrum 1 / f from `slowest_s` to two scans, `lorentz` and `lorentz_s`
    standard deviation and time constant of one with a corner; `shared` the share of either that all channels have.
    """

    white: float = 0.0066
    flicker: float = 0.0
    lorentz: float = 0.0
    lorentz_s: float = 10.0
    shared: float = 0.15
    edge_mm: float = 0.0
    edge_mm_apart: float = 5.0
    strays: float = 0.0
    slowest_s: float = 1200.0

    def series(self, random: np.random.Generator, scans: int, channels: int, period_s: float) -> FloatArray:
        """Return errors (scans, channels) at even times, cut from the middle of a longer stretch."""
        if not (self.flicker or self.lorentz):
            return self._faults(random, random.normal(0.0, self.white, (scans, channels)))
        count = 2 ** int(np.ceil(np.log2(max(2.0 * self.slowest_s / period_s, 2.0 * scans))))
        hertz = np.fft.rfftfreq(count, period_s)
        with np.errstate(divide="ignore", invalid="ignore"):
            density = np.where(
                hertz >= 1.0 / self.slowest_s, self.flicker**2 / (2.0 * np.log(2.0)) / hertz, 0.0
            )
        corner = 2.0 * np.pi * hertz * self.lorentz_s
        density = density + 4.0 * self.lorentz**2 * self.lorentz_s / (1.0 + corner**2)
        amplitude = np.sqrt(density * count / (2.0 * period_s))
        parts = random.normal(size=(2, len(hertz), channels + 1)) / np.sqrt(2.0)
        slow = np.fft.irfft(amplitude[:, None] * (parts[0] + 1j * parts[1]), n=count, axis=0)
        start = int(random.integers(0, count - scans + 1))
        slow = slow[start : start + scans]
        wander = np.sqrt(1.0 - self.shared) * slow[:, 1:] + np.sqrt(self.shared) * slow[:, :1]
        return self._faults(random, wander + random.normal(0.0, self.white, (scans, channels)))

    def _faults(self, random: np.random.Generator, errors: FloatArray) -> FloatArray:
        hit = random.uniform(size=errors.shape) < self.strays
        size = random.uniform(0.1, 0.3, errors.shape) * random.choice([-1.0, 1.0], errors.shape)
        return np.asarray(errors + hit * size)

    def edges(self, random: np.random.Generator, sensor: ts.Sensor) -> FloatArray:
        """Return errors of l and u (2, strips) [mm]: white noise, smoothed on a fine grid."""
        fine = 0.05 * sensor.pitch_mm
        kernel = np.exp(-np.arange(0.0, 12.0 * self.edge_mm_apart, fine) / self.edge_mm_apart)
        at = np.round(sensor.x_mm / fine).astype(int)
        rough = random.normal(size=(2, at[-1] + len(kernel) + 1))
        smooth = np.stack([np.convolve(r, kernel, "valid") for r in rough]) / np.sqrt((kernel**2).sum())
        return np.asarray(self.edge_mm * smooth[:, at])

    def scans(
        self, random: np.random.Generator, sensor: ts.Sensor, contact: ts.Contact, count: int, period_s: float
    ) -> list[ts.Scan]:
        """Return scans of a contact that rests."""
        l, u = ts.footprint(sensor, contact)
        shift = self.edges(random, sensor)
        ideal = ts.signatures(
            sensor, np.clip(l + shift[0], 0.0, sensor.length_mm), np.clip(u + shift[1], 0.0, sensor.length_mm)
        )
        errors = self.series(random, count, sensor.strips * len(ideal), period_s).reshape(
            count, len(ideal), -1
        )
        return [
            ts.Scan(
                **{n: np.clip(k + errors[i, s], 0.0, 1.0) for s, (n, k) in enumerate(ideal.items())},
                time_s=i * period_s,
            )
            for i in range(count)
        ]

"""Units to tune and judge calibration on: ladders of resistors, apart from the package's forms and network.

Each strip has its own profile of resistivity, clamps, channels and converter; a contact is cut into cells, graded
towards its ends, and solved as a band matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

import tacstrip as ts
from tacstrip.arrays import FloatArray

_CELLS = 48


@dataclass(frozen=True, eq=False)
class Unit:
    """One unit: resistivities along y (strips, pieces), clamps over a strip's resistance, contact and channels."""

    sensor: ts.Sensor
    energised: FloatArray  # (strips, pieces)
    sensing: FloatArray  # (strips, pieces)
    clamp: FloatArray  # (strips, 2), at y = 0 and at y = L, over the strip's resistance
    lambda_mm: float
    offset: dict[str, FloatArray]
    gain: dict[str, FloatArray]
    bits: int

    def ideal(self, strip: int, l: float, w: float) -> tuple[float, float]:
        """Return the voltages over Vref at the sensing layer's lower and upper end."""
        length = self.sensor.length_mm
        below, above = (self._resistance(strip, *ends) for ends in ((0.0, l), (l + w, length)))
        whole = self._resistance(strip, 0.0, length)
        below += self.clamp[strip, 0] * whole
        above += self.clamp[strip, 1] * whole
        if w < 1e-6:
            return (below / (below + above),) * 2
        node = l + w * (1.0 - np.cos(np.linspace(0.0, np.pi, _CELLS + 1))) / 2.0
        step = np.diff(node)
        middle = 0.5 * (node[1:] + node[:-1])
        energised = self._at(self.energised, strip, middle) * step
        metal = self.sensor.construction == "crs-m"
        sensing = (1e-5 if metal else self._at(self.sensing, strip, middle)) * step
        # lambda = 1 / sqrt((rho_0 + rho_1) g), with the nominal resistivities
        nominal = 1.0 + (0.0 if metal else float(self.sensing.mean()))
        bridge = np.zeros(_CELLS + 1)
        bridge[:-1] += 0.5 * step
        bridge[1:] += 0.5 * step
        bridge /= nominal * self.lambda_mm**2
        band = np.zeros((3, 2 * (_CELLS + 1)))  # lower form, energised and sensing nodes in turn
        for chain, ohms in ((0, energised), (1, sensing)):
            g = 1.0 / ohms
            band[0, chain:-2:2] += g
            band[0, chain + 2 :: 2] += g
            band[2, chain:-2:2] -= g
        band[0, 0::2] += bridge
        band[0, 1::2] += bridge
        band[1, 0::2] -= bridge
        band[0, 0] += 1.0 / max(below, 1e-9)
        band[0, -2] += 1.0 / max(above, 1e-9)
        drive = np.zeros(band.shape[1])
        drive[-2] = 1.0 / max(above, 1e-9)
        volt = solveh_banded(band, drive, lower=True)
        return float(volt[1]), float(volt[-1])

    def read(self, l: FloatArray, w: FloatArray) -> dict[str, FloatArray]:
        """Return what the unit reads, without noise or converter, of contacts (contacts, strips)."""
        both = np.array(
            [[self.ideal(s, l[c, s], w[c, s]) for s in range(l.shape[1])] for c in range(l.shape[0])]
        )
        pick = {"kl": 0, "kh": 1, "k": 0}
        return {n: self.gain[n] * both[..., pick[n]] + self.offset[n] for n in self.sensor.signatures}

    def convert(
        self, raw: dict[str, FloatArray], noise: float, rng: np.random.Generator, uniform: bool = True
    ) -> dict[str, FloatArray]:
        """Return readings with noise (+- noise, or that standard deviation) and the converter's steps."""
        top = 2.0**self.bits - 1.0
        found = {}
        for name, values in raw.items():
            error = (
                rng.uniform(-noise, noise, values.shape) if uniform else rng.normal(0.0, noise, values.shape)
            )
            found[name] = np.round(np.clip(values + error, 0.0, 1.0) * top) / top
        return found

    def _at(self, profile: FloatArray, strip: int, y: FloatArray) -> FloatArray:
        at = (np.arange(profile.shape[1]) + 0.5) / profile.shape[1] * self.sensor.length_mm
        return np.asarray(np.interp(y, at, profile[strip]))

    def _resistance(self, strip: int, start: float, end: float) -> float:
        if end <= start:
            return 0.0
        edge = np.linspace(start, end, 257)
        return float(
            self._at(self.energised, strip, 0.5 * (edge[1:] + edge[:-1])).sum() * (end - start) / 256
        )


def draw(
    rng: np.random.Generator,
    construction: str = "",
    *,
    uneven: float = 0.0,
    clamp: float = 0.0,
    own_ratio: float = 0.0,
    offset: float = 0.01,
    gain: float = 0.005,
    strips: int = 0,
) -> Unit:
    """Return a random unit; `uneven` its variation of resistivity along y, the rest standard deviations."""
    construction = construction or str(rng.choice(["crs-crs", "crs-m"]))
    strips = strips or int(rng.integers(4, 13))
    length = float(rng.choice([150.0, 240.0, 325.0, 400.0]))
    sensor = ts.Sensor(
        construction=construction, strips=strips, pitch_mm=length / 40.0, length_mm=length, vref_volt=5.0
    )
    y = np.linspace(0.0, 1.0, 64)

    def profile(scale: FloatArray) -> FloatArray:
        common = sum(rng.normal() / k * np.sin(np.pi * k * y + rng.uniform(0, 6.28)) for k in (1, 2, 3))
        rows = []
        for s in range(strips):
            own = sum(rng.normal() / k * np.sin(np.pi * k * y + rng.uniform(0, 6.28)) for k in (1, 2, 3, 4))
            rows.append(scale[s] * np.exp(uneven * (0.7 * common + 0.5 * own)))
        return np.array(rows)

    ratio = np.exp(rng.uniform(-0.2, 0.2)) * np.exp(own_ratio * rng.normal(size=strips))
    names = sensor.signatures
    return Unit(
        sensor,
        profile(np.ones(strips)),
        profile(ratio),
        np.abs(rng.normal(0.0, clamp, (strips, 2))) if clamp else np.zeros((strips, 2)),
        float(rng.uniform(0.3, 5.0) * length / 325.0),
        {n: rng.normal(offset * rng.normal(), offset, strips) for n in names},
        {n: 1.0 + rng.normal(0.0, gain, strips) for n in names},
        int(rng.choice([10, 12, 16])),
    )


def press(
    unit: Unit,
    places: FloatArray,
    rng: np.random.Generator,
    noise: float,
    *,
    repeats: int = 1,
    uniform: bool = True,
    place_mm: float = 0.0,
) -> ts.Runs:
    """Return runs of contacts (contacts, 2) across all strips, `repeats` times, placed to +- place_mm."""
    strips, length = unit.sensor.strips, unit.sensor.length_mm
    each = np.repeat(np.asarray(places, dtype=float), repeats, axis=0)
    l, w = (np.repeat(each[:, i : i + 1], strips, axis=1) for i in (0, 1))
    true_l, true_w = l, w
    if place_mm:
        move = rng.uniform(-place_mm, place_mm, (len(each), 2))
        true_l = np.clip(l + move[:, :1], 0.0, length)
        true_w = np.where(w > 0.0, np.clip(w + move[:, 1:], 0.0, length - true_l), 0.0)
    raw = unit.convert(unit.read(true_l, true_w), noise, rng, uniform)
    line = np.arange(l.size).reshape(l.shape) + 2
    return ts.Runs(l, w, raw, line, {})


def other_readings(unit: Unit, rng: np.random.Generator, count: int = 60) -> ts.Runs:
    """Return noise-free readings of random contacts, up to half of the strips long."""
    length, strips = unit.sensor.length_mm, unit.sensor.strips
    w = np.where(rng.random((count, strips)) < 0.3, 0.0, rng.uniform(0.0, 0.5, (count, strips))) * length
    l = rng.uniform(0.02, 1.0, (count, strips)) * (0.95 * length - w)
    raw = unit.read(l, w)
    inside = np.all([(v > 0.0) & (v < 1.0) for v in raw.values()], axis=0)
    line = np.arange(l.size).reshape(l.shape) + 2
    return ts.Runs(
        np.where(inside, l, np.nan),
        np.where(inside, w, np.nan),
        {n: np.clip(v, 0.0, 1.0) for n, v in raw.items()},
        line,
        {},
    )

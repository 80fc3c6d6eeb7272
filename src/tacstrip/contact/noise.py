"""Errors drawn: those of section 5.1, each reading's own, and those that last from scan to scan."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.converter import Converter
from tacstrip.sensor.noise import Noise as Noise
from tacstrip.sensor.spec import Sensor

Rng: TypeAlias = int | np.random.Generator


def add_reading_errors(k: FloatArray, noise: Noise, rng: np.random.Generator) -> FloatArray:
    """Return readings with their errors added (5.1)-(5.3), any shape; not clipped. NaN stays NaN."""
    for half_width in (noise.quantisation, noise.positional):
        if half_width:
            k = k + _draw(half_width, noise.distribution, k.shape, rng)
    return k


def add_transition_errors(x_mm: FloatArray, noise: Noise, rng: np.random.Generator) -> FloatArray:
    """Return transitions [mm] with their error added (5.1.2)."""
    if not noise.transition_mm:
        return x_mm
    return np.asarray(x_mm + _draw(noise.transition_mm, noise.distribution, x_mm.shape, rng))


def digitise(k: FloatArray, bits: int | None, converter: Converter | None = None) -> FloatArray:
    """Return readings as an A/D converter of so many bits gives them: clipped to 0..1, then rounded.

    Codes run from 0 to 2^bits - 1, which reads Vref. Without a converter, readings are only clipped. One with wide
    codes rounds to its own, and is corrected as it is where codes are read.
    """
    k = np.asarray(np.maximum(k, 0.0))
    np.minimum(k, 1.0, out=k)
    if bits is not None and converter is not None:
        return np.clip(converter.correct(digitise(converter.distort(k, bits), bits), bits), 0.0, 1.0)
    if bits is not None:
        top = 2.0**bits - 1.0
        k *= top
        np.rint(k, out=k)
        k /= top
    return k


def generator(rng: Rng) -> np.random.Generator:
    """Return the generator for a seed, 0 or above; a generator is returned as it is."""
    return rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)


class NoiseProcess:
    """The errors of one sensor while a contact rests or moves on it; lasting errors are kept from scan to scan.

    Parameters
    ----------
    noise, sensor
        The kinds of errors, and the sensor that has them.
    rng
        A seed, or a NumPy generator. The errors of section 5.1 are drawn from it as they always were.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=10.0, length_mm=100.0)
    >>> process = NoiseProcess(ts.Noise(offset=0.01), sensor, 1)
    >>> once, again = (process.add({"k": np.full(3, 0.4)}, time_s)["k"] - 0.4 for time_s in (0.0, 5.0))
    >>> bool(np.ptp(once) < 1e-15), bool(np.allclose(once, again))
    (True, True)
    """

    def __init__(self, noise: Noise, sensor: Sensor, rng: Rng = 0) -> None:
        self.noise, self.sensor, self._rng = noise, sensor, rng
        self._time_s = math.nan
        self._wander: dict[str, FloatArray] = {}  # of each channel (processes, *channel)
        if noise.independent:
            return
        if noise.soft:
            check_closed_form(sensor.kind, "an error of where the contact ends (edge_mm, blur_mm)")
        draw, n = self._random.standard_normal, sensor.strips
        self._offset, self._gain = noise.offset * draw(), 1.0 + noise.gain * draw(n)
        self._turn = self._random.uniform(0.0, 2.0 * math.pi)
        self._edges = noise.edge_mm * _correlated(draw((2, n)), sensor.pitch_mm, noise.edge_correlation_mm)
        self._edges += noise.blur_mm * draw() * np.array([[-1.0], [1.0]])
        self._common = draw(len(noise.processes))
        self._of_signature: dict[str, FloatArray] = {}  # of each signature (processes,)

    @property
    def _random(self) -> np.random.Generator:
        if not isinstance(self._rng, np.random.Generator):
            # When first used: making one takes as long as a scan's closed forms.
            self._rng = generator(self._rng)
        return self._rng

    def add(
        self,
        ideal: Mapping[str, FloatArray],
        time_s: npt.ArrayLike = 0.0,
        ends_mm: tuple[FloatArray, FloatArray] | None = None,
    ) -> dict[str, FloatArray]:
        """Return readings with all errors, not clipped.

        Parameters
        ----------
        ideal
            Readings over Vref, name to array: of one scan at a time [s], or (scans, strips) at as many.
        time_s
            When, ascending [s].
        ends_mm
            l and u of the contact [mm], of the readings' shape: where soft edges move them.
        """
        noise = self.noise
        if noise.independent and not (noise.quantisation or noise.positional):
            return dict(ideal)
        random, turn = self._random, 2.0 * math.pi * self.noise.hum_hz
        found = {name: add_reading_errors(k, noise, random) for name, k in ideal.items()}
        if noise.independent:
            return found
        if noise.soft and ends_mm is not None:
            l, u = ends_mm
            moved = np.maximum(l + self._edges[0], 0.0), np.minimum(u + self._edges[1], self.sensor.length_mm)
            soft = signatures(self.sensor, np.minimum(*moved), np.maximum(*moved))
            for name, k in signatures(self.sensor, l, u).items():
                found[name] = found[name] + np.nan_to_num(soft[name] - k)
        times = np.atleast_1d(np.asarray(time_s, dtype=float))
        rows = {name: k if np.ndim(time_s) else k[None] for name, k in found.items()}
        errors = {name: np.empty_like(k) for name, k in rows.items()}
        for i, now in enumerate(times):
            self._go_on(now, {name: k.shape[1:] for name, k in rows.items()})
            alike = self._offset + noise.hum * math.sqrt(2.0) * math.sin(turn * now + self._turn)
            alike += noise.white * math.sqrt(noise.white_shared) * random.standard_normal()
            alike += float(self._sigmas @ self._common) * math.sqrt(noise.wander_shared)
            for name, k in errors.items():
                own = noise.white * math.sqrt(1.0 - noise.white_shared) * random.standard_normal(k.shape[1:])
                slow = np.tensordot(self._sigmas, self._wander[name], 1)
                k[i] = alike + own + slow * math.sqrt(1.0 - noise.wander_shared - noise.wander_by_signature)
                if noise.wander_by_signature:
                    k[i] += self._sigmas @ self._of_signature[name] * math.sqrt(noise.wander_by_signature)
                if noise.strays:
                    strays = random.uniform(size=k.shape[1:]) < noise.strays
                    k[i] += strays * noise.stray_size * random.standard_normal(k.shape[1:])
        for name, k in rows.items():
            of_strips = k.shape[-1] == len(self._gain)  # else of a sheet's electrodes
            gain = self._gain if of_strips else self._gain[:, None]
            found[name] = np.reshape(k * gain + errors[name], found[name].shape)
        return found

    @property
    def _sigmas(self) -> FloatArray:
        return np.array([sigma for sigma, _ in self.noise.processes])

    def _go_on(self, now_s: float, shapes: Mapping[str, tuple[int, ...]]) -> None:
        """Advance the wander to a time [s]."""
        since = abs(now_s - self._time_s)
        kept = np.array([0.0 if math.isnan(since) else math.exp(-since / t) for _, t in self.noise.processes])
        new, draw = np.sqrt(1.0 - kept**2), self._random.standard_normal
        self._common = kept * self._common + new * draw(len(kept))
        for name, shape in shapes.items():
            by = (slice(None), *[None] * len(shape))
            drawn = new[by] * draw((len(kept), *shape))
            self._wander[name] = kept[by] * self._wander.get(name, 0.0) + drawn
            if self.noise.wander_by_signature:
                self._of_signature[name] = kept * self._of_signature.get(name, 0.0) + new * draw(len(kept))
        self._time_s = now_s


def _correlated(white: FloatArray, pitch_mm: float, correlation_mm: float) -> FloatArray:
    """Return errors (..., strips) of variance 1, from independent ones, whose correlation falls as exp(-distance)."""
    kept = math.exp(-pitch_mm / correlation_mm) if correlation_mm else 0.0
    found, new = white.copy(), math.sqrt(1.0 - kept**2)
    for i in range(1, white.shape[-1]) if kept else ():
        found[..., i] = kept * found[..., i - 1] + new * white[..., i]
    return found


def _draw(
    half_width: float, distribution: str, shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    if distribution == "normal":
        return rng.normal(0.0, half_width / math.sqrt(3.0), shape)
    return np.asarray(2.0 * half_width * rng.random(shape) - half_width)  # as rng.uniform, in half the time

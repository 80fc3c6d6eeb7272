"""How noisy the readings are: from third differences in time, which smooth motion does not survive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.diagnose.expected import expected
from tacstrip.diagnose.finding import Finding, Quality
from tacstrip.diagnose.log import Log
from tacstrip.errors import TacstripError
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance, vertex_rms
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

PROFILE_I, PROFILE_II = 0.005, 0.01  # half-widths over Vref, table 5.1
_ABOVE_II = 1.5  # times profile II's sigma: more is no sensor that the thesis could use
_NOISIER = 4.0  # times the other strips
_SPILL = 0.7  # of a neighbour's noise: less may be the neighbour's
_WHITE = 0.6  # of what first differences say: motion leaves less of itself in third ones, noise the same
_SLOW = 2.0  # times sigma: faster motion is in third differences too
_FEWEST = 24  # third differences


@dataclass(frozen=True, eq=False)
class Measured:
    """Standard deviations of readings over Vref, NaN where not known.

    Attributes
    ----------
    sigma
        Of all channels together.
    strips
        Of each strip (strips,), the larger of its channels.
    steady
        Whether the scans followed each other closely enough for the noise to stand out from the motion.
    least
        Of each strip, the least that differences of any order say (strips,): noise is the same in all, motion is not.
    """

    sigma: float
    strips: FloatArray
    steady: bool
    least: FloatArray


def measure(log: Log) -> Measured:
    """Measure the noise of touched strips, and of untouched ones that have readings."""
    strips, least = (np.full(log.sensor.strips, np.nan) for _ in range(2))
    pooled, smoother = [], []
    for raw in log.raw.values():
        values = _off_rails(raw)
        alone = _third(values) / math.sqrt(20.0)
        line = expected(values, np.isfinite(values))[0]
        beside = _third(values - line) / math.sqrt(20.0 * 1.5)
        here = np.array([_least(a, b) for a, b in zip(alone.T, beside.T, strict=True)])
        strips = np.fmax(strips, here)
        least = np.fmax(least, np.minimum(here, _any_order(values, values - line)))
        pooled.append(here)
        smoother.append(
            np.array([_deviation(d) for d in (np.diff(values - line, axis=0) / math.sqrt(3.0)).T])
        )
    known = np.concatenate(pooled)
    known = known[np.isfinite(known)]
    if not len(known):
        return Measured(_across(log), strips, False, least)
    sigma = float(np.median(known))
    rough = (
        float(np.nanmedian(np.concatenate(smoother)))
        if np.isfinite(np.concatenate(smoother)).any()
        else np.inf
    )
    return Measured(sigma, strips, sigma > _WHITE * rough and _speed(log) < _SLOW * sigma, least)


def excess_noise(log: Log, measured: Measured) -> list[Finding]:
    """Find strips much noisier than the others, or a sensor noisier than profile II of the thesis."""
    profile_i, profile_ii = (w / math.sqrt(3.0) for w in (PROFILE_I, PROFILE_II))
    found = []
    limit = max(_NOISIER * measured.sigma, profile_i)
    padded = np.pad(measured.strips, 1, constant_values=np.nan)
    loudest = np.fmax(padded[:-2], padded[2:])
    for strip in np.flatnonzero((measured.least > limit) & ~(measured.strips < _SPILL * loudest)):
        sigma = float(measured.strips[strip])
        found.append(
            Finding(
                "noise", (int(strip),),
                f"+-{100 * sigma * math.sqrt(3.0):.2g} % of Vref, where the sensor as a whole has "
                f"+-{100 * measured.sigma * math.sqrt(3.0):.2g} %",
                {"sigma": sigma, "others": measured.sigma},
            )
        )  # fmt: skip
    if measured.steady and measured.sigma > _ABOVE_II * profile_ii:
        found.append(
            Finding(
                "noise", (),
                f"+-{100 * measured.sigma * math.sqrt(3.0):.2g} % of Vref, above profile II: few shapes come back",
                {"sigma": measured.sigma},
            )
        )  # fmt: skip
    return found


def quality(sensor: Sensor, measured: Measured) -> Quality:
    """Put noise in the thesis' terms, and in the vertex error that no estimator can beat."""
    sigma = measured.sigma
    if not math.isfinite(sigma):
        return Quality(sigma, measured.strips, math.nan, "", math.nan, steady=False)
    half = sigma * math.sqrt(3.0)
    profile = "I" if half <= PROFILE_I else "II" if half <= PROFILE_II else "above II"
    return Quality(
        sigma, measured.strips, 100.0 * half, profile, _vertex_error(sensor, sigma), measured.steady
    )


def typical_contact(sensor: Sensor) -> Outline:
    """Return a tilted four-sided contact in the middle, half the sensor wide and a third of it long."""
    width, length = sensor.width_mm, sensor.length_mm
    corners = [(0.25, 0.45), (0.6, 0.33), (0.75, 0.52), (0.4, 0.66)]
    return Outline.of([(x * width, y * length) for x, y in corners])


def _vertex_error(sensor: Sensor, sigma: float) -> float:
    least = reading_sigma(Noise(), sensor)  # the converter's own steps
    try:
        rms = vertex_rms(vertex_covariance(typical_contact(sensor), sensor, max(sigma, least, 1e-6)))
    except TacstripError:
        return math.nan
    return rms if math.isfinite(rms) else math.nan


def _speed(log: Log) -> float:
    """Return by how much readings change from scan to scan, in the middle, over Vref."""
    steps = np.concatenate([np.abs(np.diff(v, axis=0)).ravel() for v in log.k.values()])
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0


def _off_rails(values: FloatArray) -> FloatArray:
    """Return readings without those that are cut off, at the highest and the lowest value: they have no noise."""
    ends = (np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None))
    many = [np.count_nonzero(values == e) > 0.02 * values.size for e in ends]
    cut = np.any(
        [values == e for e, m in zip(ends, many, strict=True) if m] or [np.zeros(values.shape, bool)], axis=0
    )
    return np.where(cut, np.nan, values)


def _any_order(alone: FloatArray, beside: FloatArray) -> FloatArray:
    """Return each strip's least deviation (strips,) by first, second and fourth differences, NaN where not known."""
    found = [
        [_deviation(d) for d in (np.diff(values, n=order, axis=0) / math.sqrt(power * share)).T]
        for values, share in ((alone, 1.0), (beside, 1.5))
        for order, power in ((1, 2.0), (2, 6.0), (4, 70.0))
    ]
    return np.asarray(np.fmin.reduce(found, axis=0))


def _third(values: FloatArray) -> FloatArray:
    return np.asarray(np.diff(values, n=3, axis=0))


def _least(a: FloatArray, b: FloatArray) -> float:
    return float(np.fmin(_deviation(a), _deviation(b)))


def _deviation(differences: FloatArray) -> float:
    known = differences[np.isfinite(differences)]
    return float(robust_sigma(known)) if len(known) >= _FEWEST else math.nan


def _across(log: Log) -> float:
    """Return sigma from second differences across strips, for a few scans: an upper bound, kinks included."""
    found = [v[np.isfinite(v)] for v in (np.diff(k, n=2, axis=1) / math.sqrt(6.0) for k in log.k.values())]
    together = np.concatenate(found)
    return float(robust_sigma(together)) if len(together) >= 5 else math.nan

"""Noise of readings, from third differences in time, which remove smooth motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.noise import Noise
from tacstrip.diagnose.faults import Finding, Quality
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.neighbour_prediction import predict_from_neighbours
from tacstrip.errors import TacstripError
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance, vertex_rms
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

PROFILE_I, PROFILE_II = 0.005, 0.01  # half-widths over Vref, table 5.1
_ABOVE_II = 2.0  # times profile II's sigma: carbon rubber has 1.3 times it, and more while it is tapped
_EXCESS = _ABOVE_II * PROFILE_II / math.sqrt(3.0)
# Correlation of neighbours' differences: a contact that is elsewhere in every scan moves them all.
_TOGETHER = 0.6
_NOISIER = 3.2  # times the median strip
# The same, and the least standard deviation over Vref, of strips whose differences of every order tell one noise.
_NOISIER_WHITE, _LEAST_WHITE = 2.5, 0.5 * PROFILE_I / math.sqrt(3.0)
_AGREE = 0.75  # of the largest estimate from orders 2 to 4: motion shows less in each, noise alike
_ALONE, _LOUD = 2.0, 2  # times the next strip: motion makes several look noisy; strips that may be noisy
_QUIETER = 3  # strips besides these, where motion may be in all
_SPILL = 0.7  # of a neighbour's noise: a strip with less may only show its neighbour's
_WHITE = 0.6  # of the estimate from first differences: for noise it is the same, for motion larger
_SLOW = 2.0  # times sigma: faster motion shows in third differences too
_FEWEST = 24  # third differences
_POWERS, _ORDER = {1: 2.0, 2: 6.0, 3: 20.0, 4: 70.0}, 3  # variance of differences by order; the usual one


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """Standard deviations of readings over Vref, NaN where not known.

    Attributes
    ----------
    sigma
        The median of the channels.
    strips
        Of each strip (strips,), the larger of its channels.
    steady
        Whether the scan rate was high enough to separate noise from motion.
    least
        Of each strip, the least estimate from differences of any order (strips,): noise is the same in all.
    white
        Of which strips differences of every order tell the same (strips,): no motion is in them.
    """

    sigma: float
    strips: FloatArray
    steady: bool
    least: FloatArray
    white: BoolArray


def measure(log: Log, of_each: bool = True) -> NoiseEstimate:
    """Measure the noise of touched strips, and of untouched ones that have readings.

    `of_each`: whether `least` and `white` are asked for, which take differences of every order.
    """
    orders = _POWERS if of_each else (1, _ORDER)
    strips, least = (np.full(log.sensor.strips, np.nan) for _ in range(2))
    white = np.ones(log.sensor.strips, dtype=bool)
    pooled: list[FloatArray] = []
    first_order: list[FloatArray] = []
    # How often each strip was put down on or left before: no difference spans that.
    since = np.cumsum(np.diff(log.touched, prepend=log.touched[:1], axis=0), axis=0)
    for raw in log.raw.values():
        values = _off_rails(raw)
        relative = values - predict_from_neighbours(values, np.isfinite(values))[0]
        # Relative to its neighbours a reading has 1.5 times the variance.
        found = {
            order: [
                _deviations(one, since, order, _POWERS[order] * share)
                for one, share in ((values, 1.0), (relative, 1.5))
            ]
            for order in orders
        }
        each = {order: np.fmin(*two) for order, two in found.items()}
        white &= _one_noise(each, np.isfinite(values))
        strips = np.fmax(strips, each[_ORDER])
        least = np.fmax(least, np.minimum(each[_ORDER], np.fmin.reduce(list(each.values()))))
        pooled.append(each[_ORDER])
        first_order.append(found[1][1])
    known = np.concatenate(pooled)
    known = known[np.isfinite(known)]
    if not len(known):
        return NoiseEstimate(_sigma_across_strips(log), strips, False, least, white)
    sigma = float(np.median(known))
    rough = float(np.nanmedian(first_order)) if np.isfinite(first_order).any() else math.inf
    steady = sigma > _WHITE * rough and _speed(log) < _SLOW * sigma
    if sigma > _EXCESS:
        steady = steady and _apart(log, since)
    return NoiseEstimate(sigma, strips, steady, least, white)


def excess_noise(noise: NoiseEstimate) -> Iterator[Finding]:
    """Find strips much noisier than the others, or a sensor noisier than profile II of the thesis."""
    others = np.sort(noise.least[np.isfinite(noise.least)])[:-_LOUD]
    next_loud = _ALONE * float(others.max(initial=0.0))
    white = noise.white.copy()
    white[[0, -1]] &= noise.steady  # a contact whose rim hurries over the last strip moves it alone
    times = np.where(white, _NOISIER_WHITE, _NOISIER)
    floor = np.where(white, _LEAST_WHITE, PROFILE_I / math.sqrt(3.0))
    limit = np.maximum(np.maximum(times * noise.sigma, next_loud), floor)
    if not noise.steady and len(others) < _QUIETER:
        limit[:] = np.inf
    padded = np.pad(noise.strips, 1, constant_values=np.nan)
    loudest = np.fmax(padded[:-2], padded[2:])
    least = np.pad(noise.least, 1, constant_values=np.nan)
    # Motion is on neighbours, too, whose own noise tells nothing of this strip's; where theirs is not known, it may be.
    moving = ~(np.fmax(least[:-2], least[2:]) <= limit) & (not noise.steady)
    to_half = 100.0 * math.sqrt(3.0)  # half-width of a uniform error [% of Vref]
    whole = f"{to_half * noise.sigma:.2g} %"
    for strip in np.flatnonzero(
        (noise.least > limit) & ~moving & ~(noise.strips < _SPILL * loudest)
    ).tolist():
        sigma = float(noise.strips[strip])
        evidence = f"+-{to_half * sigma:.2g} % of Vref, where the sensor as a whole has +-{whole}"
        yield Finding("noise", (strip,), evidence, {"sigma": sigma, "others": noise.sigma})
    if noise.steady and noise.sigma > _EXCESS:
        evidence = f"+-{whole} of Vref, above profile II: few shapes are recovered"
        yield Finding("noise", (), evidence, {"sigma": noise.sigma})


def quality(sensor: Sensor, noise: NoiseEstimate) -> Quality:
    """Return the noise in the thesis' terms, and the Cramer-Rao bound of a typical contact's vertices."""
    sigma = noise.sigma
    if not math.isfinite(sigma):
        return Quality(sigma, noise.strips, math.nan, "", math.nan, steady=False)
    half = sigma * math.sqrt(3.0)
    profile = "I" if half <= PROFILE_I else "II" if half <= PROFILE_II else "above II"
    return Quality(sigma, noise.strips, 100.0 * half, profile, _vertex_error(sensor, sigma), noise.steady)


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
    """Return the median change of readings from scan to scan, over Vref."""
    steps = np.concatenate([np.abs(np.diff(v, axis=0)).ravel() for v in log.k.values()])
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0


def _apart(log: Log, since: IntArray) -> bool:
    """Whether neighbours' changes from scan to scan differ, as noise does."""
    found = []
    for values in log.k.values():
        steps = np.diff(values, axis=0)
        steps[since[1:] != since[:-1]] = np.nan
        for one, two in pairwise(steps.T):
            both = np.isfinite(one) & np.isfinite(two)
            if both.sum() >= _FEWEST and min(np.ptp(one[both]), np.ptp(two[both])) > 0.0:
                found.append(float(np.corrcoef(one[both], two[both])[0, 1]))
    return not found or float(np.median(found)) < _TOGETHER


def _off_rails(values: FloatArray) -> FloatArray:
    """Return readings without those clipped at the highest and the lowest value, which have no noise."""
    ends = (np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None))
    many = [np.count_nonzero(values == e) > 0.02 * values.size for e in ends]
    cut = np.any(
        [values == e for e, m in zip(ends, many, strict=True) if m] or [np.zeros(values.shape, bool)], axis=0
    )
    return np.where(cut, np.nan, values)


def _one_noise(each: Mapping[int, FloatArray], read: BoolArray) -> BoolArray:
    """Return of which strips (strips,) differences of orders 2 to 4 tell nearly the same noise; all of them have to.

    `each`: the deviations by order; `read`: where there are readings (scans, strips). A strip without readings is no
    exception: it says nothing.
    """
    high = [deviation for order, deviation in each.items() if order > 1]
    with np.errstate(invalid="ignore"):
        return np.asarray(~read.any(axis=0) | (np.min(high, axis=0) >= _AGREE * np.max(high, axis=0)))


def _deviations(values: FloatArray, since: IntArray, order: int, power: float) -> FloatArray:
    """Return each strip's deviation (strips,) by differences of an order, NaN where there are few.

    `power`: the variance of a difference over that of a reading.
    """
    steps = np.diff(values, n=order, axis=0)
    steps[since[order:] != since[:-order]] = np.nan
    if not len(steps):
        return np.full(steps.shape[1], np.nan)
    enough = np.isfinite(steps).sum(axis=0) >= _FEWEST
    return np.where(enough, robust_sigma(steps, axis=0) / math.sqrt(power), np.nan)


def _sigma_across_strips(log: Log) -> float:
    """Return sigma from second differences across strips, for a few scans: an upper bound, kinks included."""
    found = [v[np.isfinite(v)] for v in (np.diff(k, n=2, axis=1) / math.sqrt(6.0) for k in log.k.values())]
    known = np.concatenate(found)
    return float(robust_sigma(known)) if len(known) >= 5 else math.nan

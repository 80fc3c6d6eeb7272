"""Noise that nobody gave, where what passes for it in one polygon may be jumps of l and u.

Straight lines along l and u, which may jump from one to the next, explain two objects, or a concave one, by less noise
than a polygon of few corners. Both are compared as wholes, by the probability of all readings: every number that lines
take costs, and the noise has bounds, the converter's step below.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.convex_chain import best_lines
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.polygon.convexity import nearest_convex
from tacstrip.reconstruction.polygon.faulty_channel import contradictory
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit
from tacstrip.sensor.spec import Sensor

_LEAST = 5e-4  # of Vref: no sensor that works has less
_LESS = 0.7  # of the polygon's noise: what is nearer to it changes nothing
_STEP = 1.4  # from one noise that is tried to the next
_WITHIN = 0.1  # of Vref: the range of what a line's number may be
_OUTLIER = 0.01  # how often a reading is one
_ONE = 4.0  # times as frequent as others: one convex object


def noise_beside_jumps(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> float | None:
    """Return the noise [Vref] that straight lines along l and u leave, None where one convex outline does as well.

    Parameters
    ----------
    run
        A fit to both signatures, which estimated its noise.
    sensor, readings
        What measured them; signature to (n,) over Vref.
    """
    if run.model is None or run.singled_out is not None or not _LEAST < run.sigma * _LESS < MOST_SIGMA * _LESS:
        return None
    least = max(_LEAST, sensor.adc_step / math.sqrt(12.0))
    faulty = contradictory(run, sensor, readings)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(closed_ends(sensor, readings["kh"], readings["kl"]))
    used = np.isfinite(ends).all(axis=0) & ~faulty.any(axis=0)
    x, ends = run.problem.x[used], ends[:, used]
    if not x.size:
        return None
    spread = np.stack(end_deviations(sensor, *ends, 1.0))
    left_out = np.count_nonzero(run.excluded & used)
    numbers = run.problem.readings - run.freedom
    best = math.log(_ONE) - 0.5 * run.freedom - run.freedom * math.log(run.sigma) - numbers * math.log(_WITHIN)
    best += left_out * math.log(_OUTLIER)
    found, sigma = None, _LESS * run.sigma
    while sigma >= least:
        per_line = 4.0 * math.log(_WITHIN / sigma)  # of its two numbers
        cost = sum(best_lines(x, y, (of * sigma) ** -2.0, per_line)[1] for y, of in zip(ends, spread, strict=True))
        probability = -0.5 * cost - ends.size * math.log(sigma)
        if probability > best:
            best, found = probability, sigma
        sigma /= _STEP
    if found is None:
        return None
    nearest = nearest_convex(run, sensor, readings, faulty, found)
    return None if nearest is None or nearest[1].explains else found

"""Noise that nobody gave, where what passes for it in a polygon of few corners may be jumps of l and u.

Straight lines along l and u, which may jump from one to the next, explain two objects, or a concave one, by less noise.
Lines and polygon are compared as wholes, by the probability of all readings: each number that a model takes costs, and
noise has bounds, of which the lower one is the converter's step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import best_lines
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.pieces.run import LEAST_SIGMA
from tacstrip.reconstruction.polygon.convexity import nearest_convex
from tacstrip.reconstruction.polygon.faulty_channel import MOST_STRIPS, contradictory
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit
from tacstrip.sensor.spec import Sensor

_LESS = 0.7  # of the polygon's noise: what is nearer to it changes nothing
_STEP = 0.7  # from one noise at which lines are looked for to the next
_RANGE = 0.1  # of Vref, of a number of a model
_STRAY = 0.01  # of readings: so many have an error that no noise explains
ONE = 4.0  # one convex object is so many times as frequent as others


def noise_beside_jumps(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> float | None:
    """Return the noise [Vref] that lines leave over of few strips; None where one convex outline is as likely.

    Parameters
    ----------
    run
        A polygon, or an ellipse, fitted to both signatures, which estimated its noise.
    sensor, readings
        What measured them; signature to (n,) over Vref.
    """
    least, most = max(LEAST_SIGMA, sensor.adc_step / math.sqrt(12.0)), min(_LESS * run.sigma, MOST_SIGMA)
    told = run.singled_out is not None or run.problem.x.size > MOST_STRIPS
    if run.model is None or told or least > most:
        return None
    faulty = contradictory(run, sensor, readings)
    found, probability = _of_lines(run, sensor, readings, faulty, (least, most))
    strays = int(np.count_nonzero(run.excluded & ~faulty))
    _, of_one = log_probability(run.squares, max(run.freedom, 1), run.problem.readings - run.freedom, least)
    if found > most or probability < of_one + strays * math.log(_STRAY) + math.log(ONE):
        return None
    nearest = nearest_convex(run, sensor, readings, faulty, found)
    if nearest is None or nearest[1].explains:
        return None
    ends, read = nearest[1], int(np.count_nonzero(nearest[0].weight))
    _, of_one = log_probability(ends.chi_square * found**2, ends.freedom, read - ends.freedom, least)
    return None if probability < of_one + math.log(ONE) else found


def _of_lines(
    run: RunFit,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
    faulty: BoolArray,
    bounds: tuple[float, float],
) -> tuple[float, float]:
    """Return the likeliest noise [Vref] beside lines along l and u, and its log probability.

    `bounds`: the least and the greatest noise at which lines are looked for. Infinite where they leave none.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(closed_ends(sensor, readings["kh"], readings["kl"]))
    used = np.isfinite(ends).all(axis=0) & ~faulty.any(axis=0)
    x, ends = run.problem.x[used], ends[:, used]
    best, (least, at) = (math.inf, -math.inf), bounds
    if not x.size:
        return best
    spread = np.stack(end_deviations(sensor, ends[0], ends[1], 1.0))
    while at >= least:
        per_line = 4.0 * math.log(_RANGE / at)  # of its two numbers
        lines = [best_lines(x, y, (of * at) ** -2.0, per_line) for y, of in zip(ends, spread, strict=True)]
        numbers = 2 * sum(len(begins) - 1 for begins, _ in lines)
        if numbers >= ends.size:  # so many lines explain readings of any noise
            break
        squares = (sum(cost for _, cost in lines) - 0.5 * per_line * numbers) * at**2
        tried = log_probability(squares, ends.size - numbers, numbers, least)
        best, at = max(best, tried, key=lambda each: each[1]), _STEP * at
    return best


def log_probability(squares: float, freedom: int, numbers: int, least: float) -> tuple[float, float]:
    """Return the likeliest noise [Vref], `least` or more, where a model of so many numbers leaves so much.

    And the log probability of the readings, but for what all models share.
    """
    sigma = max(math.sqrt(max(squares, 0.0) / freedom), least)
    return sigma, -0.5 * squares / sigma**2 - freedom * math.log(sigma) - numbers * math.log(_RANGE)

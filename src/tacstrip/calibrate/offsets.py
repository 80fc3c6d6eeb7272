"""The thesis' calibration: mean differences between measured and expected readings, (6.1)-(6.5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.residuals import expected
from tacstrip.io.runs import Runs
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.spec import Sensor


def mean_offsets(sensor: Sensor, runs: Runs) -> Calibration:
    """Return the offsets of (6.1), (6.2), (6.5): the mean over the lengths w of each length's mean difference.

    Lengths count alike, however many contacts each has; every contact of a length counts alike.
    """
    ideal = expected(sensor, runs)
    return Calibration(
        channels=tuple(
            Channel(signature=name, offset=tuple(_mean_of_means(raw - ideal[name], runs.w_mm)))
            for name, raw in runs.raw.items()
        ),
        model="mean offsets",
        sensor=sensor.fingerprint,
    )


def mean_offset_sigma(sensor: Sensor, runs: Runs, signature: str) -> FloatArray:
    """Return the standard deviation of each strip's offset (strips,) over Vref: the spread of its rows' differences."""
    plain = replace(sensor, calibration=None)
    gap = runs.raw[signature] - expected(plain, runs)[signature]
    known = np.isfinite(gap)
    count, gap = known.sum(axis=0), np.where(known, gap, 0.0)
    mean = gap.sum(axis=0) / np.maximum(count, 1)
    spread = np.sqrt(np.sum(known * (gap - mean) ** 2, axis=0) / np.maximum(count, 1))
    return np.where(count > 1, spread / np.sqrt(np.maximum(count - 1, 1)), np.inf)


def _mean_of_means(difference: FloatArray, w_mm: FloatArray) -> list[float]:
    means = []
    for strip in range(difference.shape[1]):
        there = np.isfinite(difference[:, strip])
        if not there.any():  # left out
            means.append(0.0)
            continue
        gap, w = difference[there, strip], w_mm[there, strip]
        means.append(float(np.mean([gap[w == each].mean() for each in np.unique(w)])))
    return means

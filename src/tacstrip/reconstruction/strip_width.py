"""Strips as wide as they are: what their width adds to the readings of an outline, and takes from what ends tell.

The polygon fit sees a strip as its centre line. A strip of some width reads the mean height of its edges, and beyond it
where they are slanted (`sensor.slant`); the last strips that read anything are covered in part. So the readings are
fitted, what the width adds to the outline found is taken from them, and what is left is fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.slant import slant_shift
from tacstrip.sensor.spec import Sensor

PARTIAL_STRIPS = 1  # strips at either end of a contact that may be covered in part
_PARTS = 16  # of a strip's width
_ANGLES = 512  # of the table of shifts


def end_margin_mm(sensor: Sensor) -> float:
    """Return how much further out the ends are than the strips left, read at their centre lines, would say [mm]."""
    return PARTIAL_STRIPS * sensor.pitch_mm - 0.5 * sensor.strip_width


def equivalent_ends(sensor: Sensor, outline: Outline, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the l and u (n,) [mm] that ideal contact would have where wide strips at x (n,) [mm] read the same."""
    lower, upper = (
        _edge(sensor, chain, x, sign) for chain, sign in ((outline.lower, -1.0), (outline.upper, 1.0))
    )
    lower = np.clip(lower, 0.0, sensor.length_mm)
    return lower, np.clip(upper, lower, sensor.length_mm)


def remove_width_effect(
    sensor: Sensor, outline: Outline, x: FloatArray, readings: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return readings (n,) over Vref without what the width adds to those of an outline."""
    l, u = (np.interp(x, *chain.T) for chain in (outline.lower, outline.upper))
    thin, wide = signatures(sensor, l, u), signatures(sensor, *equivalent_ends(sensor, outline, x))
    return {name: k - (wide[name] - thin[name]) for name, k in readings.items()}


def _edge(sensor: Sensor, chain: FloatArray, x: FloatArray, sign: float) -> FloatArray:
    width = sensor.strip_width
    borders = x[:, None] + width * (np.arange(_PARTS + 1) / _PARTS - 0.5)
    height = np.interp(borders, *chain.T)
    slope = np.diff(height, axis=1) * (_PARTS / width)
    angle, table = _table(sensor.contact_lambda_mm / width)
    shift = np.interp(np.arctan(np.abs(slope)), angle, table).mean(axis=1)
    mean = 0.5 * (height[:, 1:] + height[:, :-1]).mean(axis=1)
    return np.asarray(mean + sign * width * shift)


@lru_cache(maxsize=8)
def _table(decay: float) -> tuple[FloatArray, FloatArray]:
    """Return angles and the shifts at them, over the width."""
    angle = np.linspace(0.0, np.arctan(50.0), _ANGLES)
    return angle, slant_shift(np.tan(angle), decay)

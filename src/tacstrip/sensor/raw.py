"""From what a unit's converter gives to readings, and back: the one place where a calibration is applied.

Files, wires and recordings hold raw readings; a `Scan` holds corrected ones. A sensor without a calibration has both
the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.spec import Sensor


def touched(sensor: Sensor, raw: Mapping[str, FloatArray]) -> BoolArray:
    """Return which strips are touched: further than `touch_volt` from rest in any reading.

    Rest is each strip's own learned level, else `rest_volt`. A sensor without `rest_volt` takes every strip that has
    readings for touched. Arguments as for `apply_calibration`.
    """
    raw = leave_out(sensor, raw)
    found = np.any([np.isfinite(v) for v in raw.values()], axis=0)
    if sensor.rest_volt is None or sensor.touch_volt is None:
        return np.asarray(found)
    away = [np.abs(v - _rest(sensor, name)) * sensor.vref_volt for name, v in raw.items()]
    return np.asarray(found & np.any([a > sensor.touch_volt for a in away], axis=0))


@takes(sensor=Sensor)
def apply_calibration(sensor: Sensor, raw: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return a unit's readings for a `Scan`: NaN where nothing touches, corrected by its calibration elsewhere.

    Parameters
    ----------
    sensor
        Its `calibration`, `rest_volt` and `touch_volt` count.
    raw
        Raw readings over Vref by signature, (strips,) or (scans, strips); wide codes of the converter are corrected
        first. With k_h and k_l together a strip's own rubber is exact; with one of them it is taken as for typical
        contacts (`Calibration.correct`). What the spec leaves out (`without`) is NaN.
    """
    there = touched(sensor, raw)
    values = {name: np.where(there, v, np.nan) for name, v in leave_out(sensor, raw).items()}
    values, calibration = with_equal_codes(sensor, values), sensor.calibration
    if calibration is None:
        return values
    return _by_pairs(values, sensor, calibration.correct_pair, calibration.correct)


@takes(sensor=Sensor)
def invert_calibration(sensor: Sensor, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the raw readings that `apply_calibration` turns into these; NaN, nothing touches, stays NaN."""
    calibration, raw = sensor.calibration, dict(readings)
    if calibration is not None:
        raw = _by_pairs(raw, sensor, calibration.distort_pair, calibration.distort)
    if sensor.converter is not None and sensor.adc_bits is not None:
        raw = {name: sensor.converter.distort(v, sensor.adc_bits) for name, v in raw.items()}
    return raw


def with_equal_codes(sensor: Sensor, raw: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return raw readings as a converter would give them whose codes are all equally wide."""
    if sensor.converter is None or sensor.adc_bits is None:
        return dict(raw)
    return {name: sensor.converter.correct(v, sensor.adc_bits) for name, v in raw.items()}


def _by_pairs(
    readings: Mapping[str, FloatArray],
    sensor: Sensor,
    of_pair: Callable[[FloatArray, FloatArray, float], tuple[FloatArray, FloatArray]],
    of_one: Callable[[str, FloatArray], FloatArray],
) -> dict[str, FloatArray]:
    """Return readings mapped in pairs where there are both, alone where a strip has one of them."""
    if not {"kh", "kl"} <= set(readings):
        return {name: of_one(name, v) for name, v in readings.items()}
    pair = of_pair(readings["kh"], readings["kl"], sensor.sensing_ratio)
    half = np.isnan(readings["kh"]) != np.isnan(readings["kl"])
    return {
        name: np.where(half, of_one(name, readings[name]), mapped) if half.any() else mapped
        for name, mapped in zip(("kh", "kl"), pair, strict=True)
    }


def _rest(sensor: Sensor, signature: str) -> FloatArray:
    """Return the raw level of untouched strips, (strips,) or a number, over Vref; drift moves it too."""
    level = (sensor.rest_volt or 0.0) / sensor.vref_volt
    for channel in sensor.calibration.channels if sensor.calibration else ():
        if channel.signature == signature:
            return np.asarray(np.array(channel.rest or level) + channel.arrays["drift"])
    return np.array(level)

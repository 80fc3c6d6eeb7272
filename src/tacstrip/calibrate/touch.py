"""Touch detection learned from untouched strips: the level at which each rests, and how far noise takes it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.robust import half_sigma
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.left_out import left_out
from tacstrip.sensor.raw import invert_calibration, touched
from tacstrip.sensor.spec import Sensor

_LEAST = 10  # readings: fewer do not determine the noise
_SIGMAS = 6.0  # an untouched strip crosses this once in 5e8 readings of normal noise
_MARGIN = 1.5  # over the furthest that any reading was from rest
_RESTLESS = 0.02  # of Vref: a strip that moves by more from reading to reading is not at rest
_CLIPPED = 0.3  # of the wider half's spread: the narrower half is cut off by a rail
_WANDER = 0.05  # of Vref: nor is one that wanders so far


@takes(sensor=Sensor)
def learn_touch(sensor: Sensor, raw: Mapping[str, FloatArray], *, source: str = "") -> Sensor:
    """Return the sensor with `rest_volt`, `touch_volt` and each strip's own level and noise from untouched readings.

    Parameters
    ----------
    sensor
        Of which the readings are.
    raw
        Raw readings over Vref by signature (scans, strips), NaN where there is none; nothing touched.
    source
        When and from which file, kept with the levels.

    Raises
    ------
    ReadingError
        Fewer than 10 readings of a strip, or a strip that is not at rest; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0)
    >>> noise = np.random.default_rng(0).normal(0.0, 0.001, (50, 2))
    >>> learned = ts.learn_touch(sensor, {"k": 0.02 + noise})
    >>> round(learned.rest_volt, 2), round(learned.touch_volt, 3)
    (0.1, 0.03)
    """
    levels = {name: _untouched_level(sensor, name, values) for name, values in _filled(sensor, raw).items()}
    calibration = sensor.calibration or Calibration(sensor=sensor.fingerprint)
    new = (
        replace(calibration.channel(name), rest=tuple(rest), noise=tuple(noise), drift=())
        for name, (rest, noise, _) in levels.items()
    )
    rest = float(np.median([rest for rest, _, _ in levels.values()]))
    touch = max(
        max(_SIGMAS * float(noise.max()), _MARGIN * far, 2.0 * sensor.adc_step)
        for _, noise, far in levels.values()
    )
    return replace(
        sensor,
        rest_volt=float(np.clip(rest, 0.0, 1.0)) * sensor.vref_volt,
        touch_volt=max(touch, 1e-6) * sensor.vref_volt,
        calibration=calibration.with_channels(new, touch=source),
    )


def _filled(sensor: Sensor, raw: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return readings with the others' median in channels that the spec leaves out, of which no level counts."""
    out = left_out(sensor)
    return {
        name: np.where(out[name], np.nanmedian(v[:, ~out[name]], axis=1)[:, None], v)
        if name in out and not out[name].all() and len(v)
        else v
        for name, v in raw.items()
    }


def _untouched_level(sensor: Sensor, name: str, values: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return level and noise of untouched strips (strips,) over Vref, and the furthest that a reading was from it.

    Readings beyond ten robust standard deviations are rejected: somebody touched the strip. The wider half counts: a
    strip that rests at 0 is clipped there.
    """
    count = np.isfinite(values).sum(axis=0) if len(values) else np.zeros(sensor.strips, dtype=int)
    if (few := np.flatnonzero(count < _LEAST)).size:
        raise ReadingError(
            f"strip {few[0] + sensor.strip_base} has {count[few[0]]} untouched readings of {name}; at least {_LEAST} "
            "determine its noise. Record a second of readings with nothing on the sensor"
        )
    level = np.nanmedian(values, axis=0)
    low, spread = np.sort([half_sigma(values - level, sign) for sign in (1.0, -1.0)], axis=0)
    step = half_sigma(np.diff(values, axis=0), 1.0) / np.sqrt(2.0)
    loud = np.flatnonzero((step > _RESTLESS) | (spread > _WANDER))
    if loud.size:
        worst = 100.0 * float(max(step[loud[0]], spread[loud[0]]))
        raise ReadingError(
            f"strip {loud[0] + sensor.strip_base} is not at rest: its {name} varies by {worst:.2g} % "
            "of Vref. Take everything off the sensor; an input that floats needs a resistor to ground"
        )
    near = np.where(np.abs(values - level) <= np.maximum(10.0 * spread, 1e-3), values, np.nan)
    noise = np.nanstd(near, axis=0, ddof=1)
    clipped = low < _CLIPPED * spread
    noise = np.where(clipped, np.maximum(spread, noise), noise)
    # Strays of one or two samples say nothing of where the strip rests: the median of five leaves them out.
    windows = np.lib.stride_tricks.sliding_window_view(near, 5, axis=0)
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # five lost readings
        lasting = np.nanmedian(windows, axis=-1)
    furthest = float(np.nanmax(np.abs(lasting - level)))
    return np.where(clipped, level, np.nanmean(near, axis=0)), noise, furthest


def undetectable_mm(sensor: Sensor) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest y of a point contact that reads as untouched (strips,) [mm]; NaN: none does."""
    y = np.linspace(0.0, 1.0, 1001)[:, None] * np.ones(sensor.strips)  # (places, strips), over L
    blind = ~touched(sensor, invert_calibration(sensor, dict.fromkeys(sensor.signatures, y)))
    place = np.where(blind, y * sensor.length_mm, np.nan)
    some = blind.any(axis=0)
    place = np.where(some, place, 0.0)
    low, high = (np.where(some, f(place, axis=0), np.nan) for f in (np.nanmin, np.nanmax))
    return low, high

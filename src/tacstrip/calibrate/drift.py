"""Drift since the calibration, from untouched strips or a contact of known place.

Drift is modelled as a shift of the raw reading that is the same touched and untouched, as of an amplifier's zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.errors import OptionError, ReadingError
from tacstrip.robust import robust_sigma
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.raw import invert_calibration, touched
from tacstrip.sensor.spec import Sensor

_FURTHEST = 0.05  # of Vref: a strip that moved more is touched, or broken
# Standard deviations of the noise that a reading counts, and the least [Vref].
_MOST_STEP, _LEAST_NOISE = 3.0, 1e-3
_RESTLESS = 5.0  # times the learned noise: a strip that varies more is touched


@takes(sensor=Sensor)
def rezero(
    sensor: Sensor,
    raw: Mapping[str, FloatArray],
    *,
    source: str = "",
    reference: tuple[float, float] | None = None,
) -> tuple[Sensor, BoolArray]:
    """Return the sensor with the drift that these readings show, and on which strips it was measured (strips,).

    Parameters
    ----------
    sensor
        A calibrated sensor, with learned untouched levels where there is no reference.
    raw
        Raw readings over Vref by signature (scans, strips), NaN where there is none.
    source
        When and from which file, kept with the drift.
    reference
        Lower end and length [mm] of a contact across the strips; None: nothing touches.

    Raises
    ------
    OptionError
        The sensor has no calibration, no learned level, or the reference is not on it.
    ReadingError
        The drift cannot be measured on any strip; the message says why.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.calibrate import DriftEstimator, rezero
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0)
    >>> noise = np.random.default_rng(0).normal(0.0, 0.001, (50, 2))
    >>> learned = ts.learn_touch(sensor, {"k": 0.02 + noise})
    >>> today, measured = rezero(learned, {"k": np.full((20, 2), 0.025)})
    >>> np.round(today.calibration.channel("k").drift, 3), measured
    (array([0.005, 0.005]), array([ True,  True]))
    """
    levels = _readings_without_drift(sensor, tuple(raw), reference)
    shift, usable = {}, np.ones(sensor.strips, dtype=bool)
    for name, values in raw.items():
        there = np.isfinite(values).any(axis=0)
        known = np.where(there, values, 0.0)
        median = np.nanmedian(known, axis=0)
        sigma = robust_sigma(known - median, axis=0)
        shift[name] = median - levels[name]
        noise = np.array(_channel(sensor, name).noise or np.inf)
        usable &= there & (np.abs(shift[name]) <= _FURTHEST) & (sigma <= _RESTLESS * np.maximum(noise, 1e-4))
    if not usable.any():
        what = "touched as the reference says" if reference else "untouched"
        raise ReadingError(
            f"no strip is {what}: each has no readings, varies, or is more than {100.0 * _FURTHEST:.0f} % of Vref "
            "from where it was. Clear the sensor and record again, or calibrate anew"
        )
    drift = {n: np.where(usable, s, _drift(sensor, n)) for n, s in shift.items()}
    return with_drift(sensor, drift, source), usable


def with_drift(sensor: Sensor, drift: Mapping[str, FloatArray], source: str) -> Sensor:
    """Return the sensor with the given drift by signature (strips,) over Vref, and where it comes from."""
    old = sensor.calibration or Calibration(sensor=sensor.fingerprint)
    new = (replace(old.channel(name), drift=tuple(values)) for name, values in drift.items())
    return replace(sensor, calibration=old.with_channels(new, zeroed=source))


def _readings_without_drift(
    sensor: Sensor, names: tuple[str, ...], reference: tuple[float, float] | None
) -> dict[str, FloatArray]:
    """Return what raw readings (strips,) would be without drift."""
    if sensor.calibration is None:
        raise OptionError("the sensor has no calibration to re-zero; make one with `tacstrip calibrate`")
    if reference is None:
        if any(not _channel(sensor, name).rest for name in names):
            raise OptionError(
                "the calibration does not know the untouched strips' level: learn it with --touch, or press a "
                "contact of known place and give it as --reference L W"
            )
        return {name: np.array(_channel(sensor, name).rest) for name in names}
    l, w = reference
    if not (min(l, w) >= 0.0 and l + w <= sensor.length_mm):
        raise OptionError(f"--reference {l:g} {w:g} is not on strips of {sensor.length_mm:g} mm")
    each = np.full(sensor.strips, l)
    still = with_drift(sensor, {name: np.zeros(sensor.strips) for name in names}, "")
    ideal = signatures(sensor, each, each + w)
    return invert_calibration(still, {name: ideal[name] for name in names})


def _channel(sensor: Sensor, name: str) -> Channel:
    assert sensor.calibration is not None
    return sensor.calibration.channel(name)


def _drift(sensor: Sensor, name: str) -> FloatArray:
    return np.array(_channel(sensor, name).drift or np.zeros(sensor.strips))


class DriftEstimator:
    """Tracks the drift scan by scan on the strips that nothing touches, by an exponential average.

    At first it is the plain mean of what was read, so that a drift since the calibration is known within a second. No
    reading moves it by more than three standard deviations of the noise do: neither strays nor touches too light to be
    seen. A strip that is held stays as it was, however long.

    Parameters
    ----------
    sensor
        A calibrated sensor with learned levels, as for `rezero`; its drift is where the estimate starts.
    time_constant_s
        Of the average [s]: longer is less noisy and slower.
    settle_s
        A strip counts only when it has been untouched this long [s], so that pressing and letting go have no effect.

    Raises
    ------
    OptionError
        The sensor has no calibration or no learned level, or a time that cannot be.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.calibrate import DriftEstimator, rezero
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0)
    >>> noise = np.random.default_rng(0).normal(0.0, 0.001, (50, 2))
    >>> estimator = DriftEstimator(ts.learn_touch(sensor, {"k": 0.02 + noise}), time_constant_s=1.0)
    >>> for i in range(1000):
    ...     estimator.update({"k": np.array([0.023, 0.019])}, time_s=0.01 * i)
    >>> estimator.drift["k"].round(3)
    array([ 0.003, -0.001])
    """

    def __init__(self, sensor: Sensor, *, time_constant_s: float = 30.0, settle_s: float = 1.0) -> None:
        if not time_constant_s > 0.0 or not settle_s >= 0.0:
            raise OptionError("time_constant_s must be above 0 and settle_s 0 or more")
        _readings_without_drift(sensor, sensor.signatures, None)
        self.sensor, self.time_constant_s, self.settle_s = sensor, time_constant_s, settle_s
        self.scans = 0
        self._drift = {name: _drift(sensor, name) for name in sensor.signatures}
        self._touched_s = np.full(sensor.strips, np.nan)  # when each strip was last touched
        self._counted_s = np.zeros(sensor.strips)  # how long each strip was seen at rest
        self._time_s = np.nan  # of the last scan

    def update(self, raw: Mapping[str, FloatArray], time_s: float) -> None:
        """Take a scan: raw readings over Vref by signature (strips,), at a time that does not run backwards [s]."""
        without = {n: v - (self._drift[n] - _drift(self.sensor, n)) for n, v in raw.items()}
        unknown = np.isnan(self._touched_s)  # before the first scan
        now_touched = touched(self.sensor, without) | unknown
        self._touched_s[now_touched] = time_s
        elapsed_s = max(0.0, time_s - self._time_s) if self.scans else 0.0
        settled = ~now_touched & (time_s - self._touched_s >= self.settle_s)
        self._counted_s += np.where(settled, elapsed_s, 0.0)
        least = 1.0 - np.exp(-elapsed_s / self.time_constant_s)
        share = elapsed_s / np.maximum(self._counted_s, max(elapsed_s, 1e-9))
        weight = np.maximum(least, np.where(self._counted_s < self.time_constant_s, share, 0.0))
        for name, values in raw.items():
            channel = _channel(self.sensor, name)
            change = values - np.array(channel.rest) - self._drift[name]
            most = _MOST_STEP * np.maximum(np.array(channel.noise or 0.0), _LEAST_NOISE)
            moved = settled & np.isfinite(values)
            self._drift[name] += np.where(moved, weight * np.clip(change, -most, most), 0.0)
        self._time_s = time_s
        self.scans += 1

    @property
    def drift(self) -> dict[str, FloatArray]:
        """The drift by signature (strips,) over Vref."""
        return {name: values.copy() for name, values in self._drift.items()}

    def zeroed(self, source: str) -> Sensor:
        """Return the sensor with the drift as it is now; `source` says when and from what."""
        return with_drift(self.sensor, self._drift, f"{source}, {self.scans} scans")

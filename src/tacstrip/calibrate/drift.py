"""Drift: what raw readings have moved by since the calibration, from untouched strips or a contact of known place.

Drift is taken for a shift of the raw reading that is the same touched and untouched, as of an amplifier's zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

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

_FURTHEST = 0.05  # of Vref: who moved more is touched, or broken
_RESTLESS = 5.0  # times the learned noise: a strip that varies more is touched


@takes(sensor=Sensor)
def rezero(
    sensor: Sensor,
    raw: Mapping[str, FloatArray],
    source: str = "",
    reference: tuple[float, float] | None = None,
) -> tuple[Sensor, BoolArray]:
    """Return the sensor with its drift as these readings have it, and which strips told (strips,).

    Parameters
    ----------
    sensor
        A calibrated one; with its untouched levels learned where there is no reference.
    raw
        Raw readings over Vref by signature (scans, strips), NaN where there is none.
    source
        When and from which file, to be kept.
    reference
        Lower end and length [mm] of a contact across the strips; None: nothing touches.

    Raises
    ------
    OptionError
        The sensor has no calibration, no learned level, or the reference is not on it.
    ReadingError
        No strip tells; the message says why.
    """
    levels = _levels(sensor, tuple(raw), reference)
    shift, good = {}, np.ones(sensor.strips, dtype=bool)
    for name, values in raw.items():
        there = np.isfinite(values).any(axis=0)
        some = np.where(there, values, 0.0)
        middle = np.nanmedian(some, axis=0)
        spread = robust_sigma(some - middle, axis=0)
        shift[name] = middle - levels[name]
        noise = np.array(_channel(sensor, name).noise or np.inf)
        good &= there & (np.abs(shift[name]) <= _FURTHEST) & (spread <= _RESTLESS * np.maximum(noise, 1e-4))
    if not good.any():
        what = "touched as the reference says" if reference else "untouched"
        raise ReadingError(
            f"no strip is {what}: each has no readings, varies, or is more than {100.0 * _FURTHEST:.0f} % of Vref "
            "from where it was. Clear the sensor and record again, or calibrate anew"
        )
    return with_drift(
        sensor, {n: np.where(good, s, _drift(sensor, n)) for n, s in shift.items()}, source
    ), good


def with_drift(sensor: Sensor, drift: Mapping[str, FloatArray], source: str) -> Sensor:
    """Return the sensor with the given drift by signature (strips,) over Vref, and where it comes from."""
    old = sensor.calibration or Calibration(sensor=sensor.fingerprint)
    kept = [c for c in old.channels if c.signature not in drift]
    new = [replace(old.channel(name), drift=tuple(values)) for name, values in drift.items()]
    return replace(sensor, calibration=replace(old, channels=(*kept, *new), zeroed=source))


def _levels(
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


@dataclass
class DriftEstimator:
    """Follows the drift scan by scan from the strips that nothing touches; O(strips) a scan.

    Attributes
    ----------
    sensor
        A calibrated sensor with learned levels, as for `rezero`; its drift is where the estimate starts.
    time_constant_s
        Of the average: longer is quieter and later.
    settle_s
        A strip counts only when it has been untouched this long, so that pressing and letting go leave no trace.
    """

    sensor: Sensor
    time_constant_s: float = 30.0
    settle_s: float = 1.0
    scans: int = 0
    _level: dict[str, FloatArray] = field(default_factory=dict)
    _since_s: FloatArray | None = None  # when each strip was last touched (strips,)
    _time_s: float | None = None

    def __post_init__(self) -> None:
        if not self.time_constant_s > 0.0 or not self.settle_s >= 0.0:
            raise OptionError("time_constant_s must be above 0 and settle_s 0 or more")
        _levels(self.sensor, self.sensor.signatures, None)
        self._level = {name: _drift(self.sensor, name) for name in self.sensor.signatures}

    def update(self, raw: Mapping[str, FloatArray], time_s: float) -> None:
        """Take a scan: raw readings over Vref by signature (strips,), at a time that does not run backwards [s]."""
        moved = {n: v - (self._level[n] - _drift(self.sensor, n)) for n, v in raw.items()}
        touch = touched(self.sensor, moved)
        if self._since_s is None or self._time_s is None:
            self._since_s, self._time_s = np.full(len(touch), time_s), time_s
        self._since_s[touch] = time_s
        part = 1.0 - np.exp(-max(0.0, time_s - self._time_s) / self.time_constant_s)
        quiet = ~touch & (time_s - self._since_s >= self.settle_s)
        for name, values in raw.items():
            rest = np.array(_channel(self.sensor, name).rest)
            use = quiet & np.isfinite(values)
            self._level[name] = np.where(
                use, self._level[name] + part * (values - rest - self._level[name]), self._level[name]
            )
        self._time_s = time_s
        self.scans += 1

    @property
    def drift(self) -> dict[str, FloatArray]:
        """The drift by signature (strips,) over Vref."""
        return dict(self._level)

    def zeroed(self, source: str) -> Sensor:
        """Return the sensor with the drift as it is now; `source` says when and from what."""
        return with_drift(self.sensor, self._level, f"{source}, {self.scans} scans")

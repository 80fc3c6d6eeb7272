"""Raw scans to readings as they come: calibrated, and their drift taken out where the calibration knows how."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from tacstrip.calibrate.drift import DriftEstimator
from tacstrip.errors import OptionError
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import ELECTRODES, decode, top_code
from tacstrip.stream.source import RawScan

_LOOK_S, _APPLY_S = 0.05, 1.0  # between two scans that drift is taken from, and between two corrections


class Readings:
    """What raw scans mean.

    Attributes
    ----------
    sensor
        With the drift as it is now.
    follows_drift
        Whether drift is followed: the calibration must know the level of untouched strips.
    """

    def __init__(self, sensor: Sensor, drift: bool = True) -> None:
        self.sensor = sensor
        self._drift: DriftEstimator | None = None
        if drift and sensor.rest_volt is not None:
            with suppress(OptionError):  # no calibration, or no learned level: nothing to follow drift by
                self._drift = DriftEstimator(sensor)
        self._looked_s = self._applied_s = -math.inf

    @property
    def follows_drift(self) -> bool:
        """Whether drift is followed."""
        return self._drift is not None

    def scan(self, raw: RawScan) -> Scan:
        """Return the readings of the next scan; errors as of `decode`."""
        if self._drift is not None:
            self._follow(raw, self._drift)
        return decode(raw, self.sensor)

    def _follow(self, raw: RawScan, drift: DriftEstimator) -> None:
        if abs(raw.time_s - self._looked_s) < _LOOK_S or ELECTRODES in raw.codes:
            return
        self._looked_s = raw.time_s
        top = top_code(self.sensor)
        drift.update({name: np.asarray(codes / top) for name, codes in raw.codes.items()}, raw.time_s)
        if abs(raw.time_s - self._applied_s) >= _APPLY_S:
            self._applied_s = raw.time_s
            self.sensor = drift.zeroed("live")

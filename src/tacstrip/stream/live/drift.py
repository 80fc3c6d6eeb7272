"""Decode live scans and remove the drift of their calibration while they come in."""

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

_SAMPLE_S, _APPLY_S = (
    0.05,
    1.0,
)  # between two scans that the drift is estimated from, and between two corrections


class DriftCorrectingDecoder:
    """Turns raw scans into readings.

    Parameters
    ----------
    sensor
        The sensor of the scans.
    drift
        Whether to remove drift, where the calibration knows the level of untouched strips.

    Attributes
    ----------
    sensor
        The sensor, its calibration corrected by the present drift.
    """

    def __init__(self, sensor: Sensor, drift: bool = True) -> None:
        self.sensor = sensor
        self._drift: DriftEstimator | None = None
        if drift and sensor.rest_volt is not None:
            with suppress(OptionError):  # no calibration, or no level of untouched strips in it
                self._drift = DriftEstimator(sensor)
        self._sampled_s = self._applied_s = -math.inf

    @property
    def corrects_drift(self) -> bool:
        """Whether drift is removed."""
        return self._drift is not None

    def decode(self, raw: RawScan) -> Scan:
        """Return the readings of the next scan; errors as of `stream.codes.decode`."""
        if self._drift is not None and ELECTRODES not in raw.codes:
            self._estimate(raw, self._drift)
        return decode(raw, self.sensor)

    def _estimate(self, raw: RawScan, drift: DriftEstimator) -> None:
        if abs(raw.time_s - self._sampled_s) < _SAMPLE_S:
            return
        self._sampled_s = raw.time_s
        top = top_code(self.sensor)
        drift.update({name: np.asarray(codes / top) for name, codes in raw.codes.items()}, raw.time_s)
        if abs(raw.time_s - self._applied_s) >= _APPLY_S:
            self._applied_s = raw.time_s
            self.sensor = drift.zeroed("live")

"""Decode live scans and remove the drift of their calibration, and creep, while they come in."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tacstrip.calibrate.drift import DriftEstimator
from tacstrip.errors import OptionError
from tacstrip.scan import Scan
from tacstrip.sensor.layers import unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import ELECTRODES, decode, top_code
from tacstrip.stream.live.creep import CreepFilter
from tacstrip.stream.source import RawScan

_SAMPLE_S = 0.05  # between two scans that the drift is estimated from
_APPLY_S = 1.0  # between two corrections


class DriftCorrectingDecoder:
    """Turns raw scans into readings.

    Parameters
    ----------
    sensor
        The sensor of the scans.
    drift
        Whether to remove drift, where the calibration knows the level of untouched strips.
    creep
        Whether to take the creep of a held contact out.

    Attributes
    ----------
    sensor
        The sensor, its calibration corrected by the present drift.
    drift
        The estimator of the drift; None where none is removed.
    creep
        The filter of held contacts; None where readings are passed on as they are.
    left_out
        Channels that are not used beside those that the spec leaves out, named as there.
    """

    def __init__(self, sensor: Sensor, drift: bool = True, creep: bool = False) -> None:
        self.sensor = self._zeroed = sensor
        self.left_out: tuple[str, ...] = ()
        self._left_out: tuple[str, ...] = ()  # as of the last scan
        self.creep = CreepFilter() if creep and unit_of(sensor).kind.closed_form else None
        self.drift: DriftEstimator | None = None
        if drift and isinstance(sensor, Sensor) and sensor.rest_volt is not None:
            with suppress(OptionError):  # no calibration, or no level of untouched strips in it
                self.drift = DriftEstimator(sensor)
        self._sampled_s = self._applied_s = -math.inf

    def decode(self, raw: RawScan) -> Scan:
        """Return the readings of the next scan; errors as of `stream.codes.decode`."""
        if self.left_out != self._left_out:
            self._left_out = self.left_out
            self.sensor = replace(self._zeroed, without=(*self._zeroed.without, *self.left_out))
        due = abs(raw.time_s - self._sampled_s) >= _SAMPLE_S and ELECTRODES not in raw.codes
        if self.drift is not None and due:
            self._sampled_s, top = raw.time_s, top_code(self.sensor)
            readings = {name: np.asarray(codes / top) for name, codes in raw.codes.items()}
            self.drift.update(readings, raw.time_s)
            if abs(raw.time_s - self._applied_s) >= _APPLY_S:
                self._applied_s = raw.time_s
                self._zeroed = self.drift.zeroed("live")
                self.sensor = replace(self._zeroed, without=(*self._zeroed.without, *self.left_out))
        scan = decode(raw, self.sensor)
        return scan if self.creep is None else self.creep.update(scan)

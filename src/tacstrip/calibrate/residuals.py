"""What readings of known contacts are off by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.io.runs import Runs
from tacstrip.sensor.raw import apply_calibration
from tacstrip.sensor.spec import Sensor


def expected(sensor: Sensor, runs: Runs) -> dict[str, FloatArray]:
    """Return what the spec's sensor reads of the contacts, by signature (contacts, strips) over Vref."""
    ideal = signatures(sensor, runs.l_mm, runs.l_mm + runs.w_mm)
    return {name: ideal[name] for name in runs.signatures}


def residuals(sensor: Sensor, runs: Runs) -> dict[str, FloatArray]:
    """Return corrected less expected readings, by signature (contacts, strips) over Vref."""
    plain = replace(sensor, rest_volt=None, touch_volt=None)  # a contact counts even where it reads as rest
    ideal, read = expected(sensor, runs), apply_calibration(plain, runs.raw)
    return {name: read[name] - ideal[name] for name in runs.signatures}


def rms_percent(off: dict[str, FloatArray]) -> float:
    """Return the root mean square over all readings [% of Vref]."""
    return float(100.0 * np.sqrt(np.nanmean(np.square(np.stack(list(off.values()))))))

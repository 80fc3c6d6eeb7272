"""How fast a unit can be scanned."""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import NetworkError
from tacstrip.network.imperfections import Readout
from tacstrip.sensor.closed_form import sensing_share
from tacstrip.sensor.spec import Sensor


def source_ohm(sensor: Sensor, readout: Readout, l_mm: FloatArray, u_mm: FloatArray) -> FloatArray:
    """Return the resistance that the converter sees at a strip's worse reading [ohm], shape of l and u.

    The energised strip's two ends in parallel, as seen from the contact's end that is read, then the sensing strip
    from there to its own end, then the switches. Ideal contact.
    """
    per_mm = readout.strip_ohm / sensor.length_mm
    switch, supply = (0.0, 0.0) if sensor.kind.common_supply else (readout.mux_ohm, readout.supply_ohm)
    l, u, length = np.asarray(l_mm) * per_mm, np.asarray(u_mm) * per_mm, sensor.length_mm * per_mm  # [ohm]
    below, above = l + switch, length - u + switch + supply
    contact = sensing_share(sensor.sensing_ratio) * (u - l)
    whole = below + contact + above
    whole = np.where(whole > 0.0, whole, 1.0)
    upper = (below + contact) * above / whole + (length - u) * sensor.sensing_ratio
    lower = below * (contact + above) / whole + l * sensor.sensing_ratio
    return np.asarray(np.maximum(upper, lower) + (readout.mux_ohm if sensor.kind.common_supply else 0.0))


def settling_s(ohm: float, farad: float, bits: int) -> float:
    """Return how long a reading takes to settle to half a step of a converter [s]: RC ln 2^(bits + 1)."""
    return ohm * farad * math.log(2.0) * (bits + 1)


def fastest_scan_hz(sensor: Sensor, readout: Readout, farad: float, conversion_s: float = 0.0) -> float:
    """Return how many full scans a second settle to half a step, wherever a point contact lies [Hz].

    Parameters
    ----------
    sensor, readout
        The unit and its electronics; the sensor needs `adc_bits`.
    farad
        Capacitance at the converter's input, with the wires [F].
    conversion_s
        Time of one conversion, after settling [s].

    Raises
    ------
    NetworkError
        The spec has no `adc_bits`, or the capacitance or the time is not 0 or more.
    """
    if sensor.adc_bits is None:
        raise NetworkError("the spec has no adc_bits: how far a reading must settle is not known")
    if not (0.0 <= farad < math.inf and 0.0 <= conversion_s < math.inf and farad + conversion_s > 0.0):
        raise NetworkError(
            f"farad = {farad}, conversion_s = {conversion_s}: must be 0 or more, and not both 0"
        )
    y = np.linspace(0.0, sensor.length_mm, 1001)
    worst = float(source_ohm(sensor, readout, y, y).max())
    samples = sensor.strips * len(sensor.signatures)
    return 1.0 / (samples * (settling_s(worst, farad, sensor.adc_bits) + conversion_s))

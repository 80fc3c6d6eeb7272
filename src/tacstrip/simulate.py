"""Sensor + contact + noise -> scan."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, Rng, digitise, generator, on_readings
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.network.build import Build, Readout
from tacstrip.network.ladder import fast_readings
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_MODELS = ("closed", "network")
_IDEAL = Noise()


def simulate(
    sensor: Sensor,
    contact: Contact,
    noise: Noise = _IDEAL,
    rng: Rng = 0,
    model: Literal["closed", "network"] = "closed",
    time_s: float = 0.0,
    build: Build | None = None,
    readout: Readout | None = None,
) -> Scan:
    """Return the scan that the sensor makes of a contact.

    Parameters
    ----------
    sensor, contact
        What touches what.
    noise
        Errors on the readings; ideal by default. Its transition error does not show in a scan.
    rng
        A seed, or a NumPy generator to go on with.
    model
        "closed": the closed forms of chapter 3. "network": the sensor as a network of resistors, each
        separate piece of the contact on its own.
    time_s
        The scan's time [s].
    build, readout
        With the network: the unit's imperfections, its wiring and electronics; ideal by default.

    Raises
    ------
    ContactError
        The contact lies outside the sensor, or ties a strip's both ends to a metal sheet.
    OptionError
        There is no such model, or the closed forms were asked for a build or a readout.
    NetworkError
        The network cannot be: a fault off the sensor, a sensing strip cut off, a resistance of 0 or less.
    """
    if model not in _MODELS:
        raise OptionError(one_of("model", model, _MODELS))
    if model == "network":
        ideal = fast_readings(sensor, contact, build, readout)
        return Scan(**_measured(sensor, ideal, noise, rng), time_s=time_s)
    if build is not None or readout is not None:
        raise OptionError('build and readout need model="network": the closed forms know ideal units only')
    touch = footprint(sensor, contact)
    scan = readings(sensor, touch.l, touch.u, noise, rng)
    for values in scan.values():
        shorted = np.flatnonzero(np.isnan(values) & ~np.isnan(touch.l))
        if len(shorted):
            raise ContactError(
                f"the contact covers strip {shorted[0] + sensor.strip_base} from end to end: on metal that "
                "shorts Vref to ground, and nothing can be read"
            )
    return Scan(**scan, time_s=time_s)


def readings(
    sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray, noise: Noise = _IDEAL, rng: Rng = 0
) -> dict[str, FloatArray]:
    """Return the readings of contacts from l to u, name to array over Vref.

    l and u [mm] have the shape (strips,) for one scan or (scans, strips) for many, NaN where nothing
    touches; so have the results.
    """
    return _measured(sensor, signatures(sensor, l_mm, u_mm), noise, rng)


def _measured(sensor: Sensor, ideal: dict[str, FloatArray], noise: Noise, rng: Rng) -> dict[str, FloatArray]:
    random = generator(rng)
    return {name: digitise(on_readings(k, noise, random), sensor.adc_bits) for name, k in ideal.items()}

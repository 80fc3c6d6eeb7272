"""What a contact that moves during a scan looks like: a sheared one."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.sensor.spec import Sensor


def skewed(
    sensor: Sensor, contact: Contact, velocity_mm_s: tuple[float, float], scan_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return l and u (strips,) [mm] of a contact that moves while the strips are read one after another.

    Strip i is read i / n of the scan's time after the first. NaN where a strip is not touched at its time.

    Parameters
    ----------
    sensor, contact
        What touches what, where it is when the scan starts.
    velocity_mm_s
        Speed across and along the strips [mm/s].
    scan_s
        Time of a scan [s].

    Raises
    ------
    ContactError
        The contact leaves the sensor before the scan ends.
    """
    when = scan_s * np.arange(sensor.strips) / sensor.strips
    places = [contact.moved(velocity_mm_s[0] * t, velocity_mm_s[1] * t) for t in when]
    touch = footprint(sensor, places)
    every = np.arange(sensor.strips)
    return touch.l[every, every], touch.u[every, every]

"""From l and u to the signatures: k_h, k_l, k, and the centres of section 4.1."""

from __future__ import annotations

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import k_h, k_l, k_metal
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.resistance import electrical_ends
from tacstrip.sensor.spec import Sensor


@takes(sensor=Sensor)
def signatures(sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray) -> dict[str, FloatArray]:
    """Return every signature of the construction, name to array of the shape of l and u.

    NaN where a strip is not touched, and for a metal sheet that a contact of the strip's full length ties
    to both ends (0 / 0).

    Parameters
    ----------
    sensor
        Its construction says which signatures there are.
    l_mm, u_mm
        Lower and upper ends of the contact [mm], any shapes that broadcast; NaN where nothing touches.

    Raises
    ------
    OptionError
        The construction has no closed form (CRS-CRP).

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=10.0, length_mm=100.0)
    >>> {name: k.round(6).tolist() for name, k in signatures(sensor, np.array([20.0]), np.array([50.0])).items()}
    {'k': [0.285714]}
    """
    check_closed_form(sensor.kind, "a signature from l and u alone")
    l, u, lam = electrical_ends(sensor, l_mm, u_mm)
    w, length = np.asarray(u - l), sensor.length_mm
    if sensor.sensing_ratio == 0.0:
        return {"k": k_metal(l, w, length, lam)}
    return {name: k(l, w, length, sensor.sensing_ratio, lam) for name, k in (("kh", k_h), ("kl", k_l))}


def geometric_centre(l_mm: FloatArray, u_mm: FloatArray) -> FloatArray:
    """Return l + w / 2 [mm]; over the strips in contact it is the geometric signature (4.1)."""
    return np.asarray(0.5 * (np.asarray(l_mm, dtype=float) + u_mm))


@takes(sensor=Sensor)
def pseudo_centres(sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray) -> dict[str, FloatArray]:
    """Return the pseudo-centres k_h L, k_l L or k L [mm] of each signature: (4.1), (4.2), (4.3)."""
    return {name: k * sensor.length_mm for name, k in signatures(sensor, l_mm, u_mm).items()}

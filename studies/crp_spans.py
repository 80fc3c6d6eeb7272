"""What a CRS-CRP sensor reads of given ends l and u, and the least error of these: of spans that need no shape."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.fisher import checked_sigma
from tacstrip.fisher import covariance as covariance_bound
from tacstrip.network.crp.cramer_rao import Electrodes, embed_touched, jacobian
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.mesh import SheetMesh, Wiring, checked_span
from tacstrip.sensor.spec import Sensor


def factored_span(
    sensor: Sensor, l: FloatArray, u: FloatArray, rows: int | None = None, wiring: Wiring | None = None
) -> FactoredScan:
    """Prepare the scan of a contact from l to u (strips,) [mm]; see `own_electrodes`."""
    mesh = SheetMesh.of(sensor, rows, wiring)
    strip, low, high = checked_span(mesh, l, u)
    return FactoredScan(mesh, strip, mesh.hat_lengths(low, high))


def own_electrodes(
    sensor: Sensor, l: FloatArray, u: FloatArray, rows: int | None = None, wiring: Wiring | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return k_h and k_l (strips,) [Vref]: the electrodes in line with each energised strip, at y = L and y = 0.

    Parameters
    ----------
    sensor
        Its strips, pitch, strip width, length, `resistivity_ratio` (sheet over strips) and `contact_lambda_mm`.
    l, u
        Ends of the contact on each strip (strips,) [mm]; NaN where untouched, and so are the readings there.
        A contact shorter than 1e-6 L is taken as one of 1e-6 L.
    rows
        Cells of the mesh over the length; by default 4 per lambda, 100 to 400.
    wiring
        What the other strips and the sheet's edges are joined to; nothing by default.

    Raises
    ------
    SpecError
        The sensor cannot be: ratio or lambda is not above 0.
    ContactError
        Nothing is touched, or l and u are not on the sensor.
    """
    readings = all_electrodes(sensor, l, u, rows, wiring)
    each = np.arange(sensor.strips)
    return readings[each, sensor.strips + each], readings[each, each]


def all_electrodes(
    sensor: Sensor, l: FloatArray, u: FloatArray, rows: int | None = None, wiring: Wiring | None = None
) -> FloatArray:
    """Return what all electrodes read while each strip is energised (strips, 2 strips) [Vref].

    Columns: the electrodes at y = 0 in the order of the strips, then those at y = L. Arguments and errors as
    for `own_electrodes`.
    """
    return factored_span(sensor, l, u, rows, wiring).all_readings()


def covariance(
    sensor: Sensor,
    l: FloatArray,
    u: FloatArray,
    sigma: float = 1e-3,
    electrodes: Electrodes = "own",
    rows: int | None = None,
    wiring: Wiring | None = None,
) -> FloatArray:
    """Return the Cramer-Rao bound of l of all strips, then u (2 strips, 2 strips) [mm^2]; NaN where untouched.

    Its diagonal's square root is the least standard error that any unbiased method can have when every reading
    has independent normal noise of `sigma` [Vref]; inf where the readings do not identify an end.
    Other arguments and errors as for `own_electrodes`.
    """
    strip, by_ends = jacobian(sensor, l, u, electrodes, rows, wiring)
    scaled = by_ends.reshape(-1, 2 * len(strip)) / checked_sigma(sigma)
    return embed_touched(covariance_bound(scaled), strip, sensor.strips)

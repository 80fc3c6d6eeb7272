"""What the electrodes of a CRS-CRP sensor read of a shape, and the networks behind."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.mesh import (
    SHORTEST,
    ContactNetwork,
    SheetMesh,
    Wiring,
    checked_span,
    contact_network,
)
from tacstrip.network.nodal import Measurement
from tacstrip.sensor.spec import Sensor


def contact_electrodes(sensor: Sensor, contact: Contact, wiring: Wiring | None = None) -> FloatArray:
    """Return what all electrodes read while each strip is energised (strips, 2 strips) [Vref].

    Columns: the electrodes at y = 0 in the order of the strips, then those at y = L. Each of the shape's separate
    pieces on a strip counts.

    Parameters
    ----------
    sensor
        Its strips, pitch, strip width, length, `resistivity_ratio` (sheet over strips) and `contact_lambda_mm`.
    contact
        What touches.
    wiring
        What the other strips and the sheet's edges are joined to; nothing by default.

    Raises
    ------
    SpecError
        The sensor cannot be: ratio or lambda is not above 0.
    ContactError
        Nothing is touched.
    """
    mesh = SheetMesh.of(sensor, wiring=wiring)
    return FactoredScan(mesh, *_pieces(mesh, sensor, contact)).all_readings()


def _pieces(mesh: SheetMesh, sensor: Sensor, contact: Contact) -> tuple[IntArray, FloatArray]:
    """Return the strips that a shape touches (T,) and what of it lies under each node's hat (T, nodes) [mm]."""
    strip, low, high = footprint(sensor, contact).intervals[0]
    shortest = SHORTEST * sensor.length_mm
    low = np.minimum(low, sensor.length_mm - shortest)
    each = mesh.hat_lengths(low, np.maximum(high, low + shortest))
    touched, where = np.unique(strip, return_inverse=True)
    lengths = np.zeros((len(touched), mesh.rows + 1))
    np.add.at(lengths, where, each)
    if not len(touched):
        l = np.full(sensor.strips, np.nan)
        checked_span(mesh, l, l)
    return touched, lengths


def contact_measurements(sensor: Sensor, contact: Contact, rows: int | None = None) -> dict[int, Measurement]:
    """Return the measurement on each touched strip, by its number, for a shape with all its pieces."""
    mesh = SheetMesh.of(sensor, rows)
    return measurements(contact_network(mesh, *_pieces(mesh, sensor, contact)), mesh.wiring)


def measurements(resistors: ContactNetwork, wiring: Wiring) -> dict[int, Measurement]:
    """Return the measurement on each energised strip as it stands, for the plain solver and for netlists.

    Readings are named kh and kl, the strip's own electrodes.
    """
    kl, kh = np.split(resistors.electrode, 2)
    ends = np.stack([resistors.bottom, resistors.top])
    others = dict.fromkeys(ends.ravel().tolist(), 0.0) if wiring.others == "grounded" else {}
    found = {}
    for strip, (bottom, top) in zip(resistors.strip.tolist(), ends.T.tolist(), strict=True):
        read = {"kh": int(kh[strip]), "kl": int(kl[strip])}
        found[strip] = Measurement(resistors.network, others | {bottom: 0.0, top: 1.0}, read)
    return found

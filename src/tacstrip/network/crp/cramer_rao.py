"""How the readings of a CRS-CRP sensor change with l and u: what its Cramer-Rao bound is made of."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import NetworkError, one_of
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.mesh import SheetMesh, Wiring, checked_span
from tacstrip.sensor.spec import Sensor

Electrodes: TypeAlias = Literal["own", "all"]
_ELECTRODES = ("own", "all")


def jacobian(
    sensor: Sensor,
    l: FloatArray,
    u: FloatArray,
    electrodes: Electrodes = "own",
    rows: int | None = None,
    wiring: Wiring | None = None,
) -> tuple[IntArray, FloatArray]:
    """Return the touched strips (T,), and d readings / d (l, u) of them (T, E, 2 T) [1/mm].

    Own electrodes are k_h, then k_l; all of them are in the order of `contact_electrodes`, as are the other arguments
    and errors. l and u (strips,) [mm] are NaN where nothing touches; `rows` are cells of the mesh over the length.
    """
    if electrodes not in _ELECTRODES:
        raise NetworkError(one_of("electrodes", electrodes, _ELECTRODES))
    mesh = SheetMesh.of(sensor, rows, wiring)
    strip, low, high = checked_span(mesh, l, u)
    scan = FactoredScan(mesh, strip, mesh.hat_lengths(low, high))
    ends = np.concatenate([low, high])
    return strip, np.asarray(scan.jacobian(ends, used_columns(sensor, strip, electrodes)))


def used_columns(sensor: Sensor, strip: IntArray, electrodes: Electrodes) -> IntArray:
    """Return which columns of the readings are used of each touched strip (T, E)."""
    if electrodes == "own":
        return np.stack([sensor.strips + strip, strip], axis=1)
    return np.tile(np.arange(2 * sensor.strips), (len(strip), 1))


def embed_touched(matrix: FloatArray, strip: IntArray, strips: int) -> FloatArray:
    """Put a matrix of the touched strips (2 T, 2 T) among NaN for all strips (2 strips, 2 strips)."""
    where = np.concatenate([strip, strips + strip])
    full = np.full((2 * strips, 2 * strips), np.nan)
    full[np.ix_(where, where)] = matrix
    return full

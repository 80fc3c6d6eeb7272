"""The Cramer-Rao bound of l and u from the readings of a CRS-CRP sensor."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import NetworkError, one_of
from tacstrip.fisher import checked_sigma
from tacstrip.fisher import covariance as covariance_bound
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.mesh import SheetMesh, Wiring, checked_span
from tacstrip.sensor.spec import Sensor

Electrodes: TypeAlias = Literal["own", "all"]
_ELECTRODES = ("own", "all")


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


def jacobian(
    sensor: Sensor,
    l: FloatArray,
    u: FloatArray,
    electrodes: Electrodes = "own",
    rows: int | None = None,
    wiring: Wiring | None = None,
) -> tuple[IntArray, FloatArray]:
    """Return the touched strips (T,), and d readings / d (l, u) of them (T, E, 2 T) [1/mm].

    Own electrodes are k_h, then k_l; all of them are in the order of `all_electrodes`. Arguments and errors as
    for `covariance`.
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

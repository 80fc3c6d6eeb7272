"""How well the readings of a CRS-CRP sensor can tell l and u at best: the Cramer-Rao bound."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import NetworkError, ReadingError, one_of
from tacstrip.network.crp_mesh import Mesh, Wiring, checked_span
from tacstrip.network.crp_scan import Scan
from tacstrip.sensor.spec import Sensor

Electrodes: TypeAlias = Literal["own", "all"]
_ELECTRODES = ("own", "all")
_TINY = 1e-14  # of the largest eigenvalue: information below is none


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
    has independent normal noise of `sigma` [Vref]. Other arguments and errors as for `own_electrodes`.
    """
    if electrodes not in _ELECTRODES:
        raise NetworkError(one_of("electrodes", electrodes, _ELECTRODES))
    mesh = Mesh.of(sensor, rows)
    strip, low, high = checked_span(mesh, l, u)
    scan = Scan(mesh, strip, mesh.hat_lengths(low, high), wiring or Wiring())
    columns = used_columns(sensor, strip, electrodes)
    slope = scan.jacobian(np.concatenate([low, high]), columns).reshape(columns.size, -1) / checked_sigma(
        sigma
    )
    return spread(inverse(slope.T @ slope), strip, sensor.strips)


def used_columns(sensor: Sensor, strip: IntArray, electrodes: Electrodes) -> IntArray:
    """Return which columns of the readings are used of each touched strip (T, E)."""
    if electrodes == "own":
        return np.stack([sensor.strips + strip, strip], axis=1)
    return np.tile(np.arange(2 * sensor.strips), (len(strip), 1))


def checked_sigma(sigma: float) -> float:
    """Return sigma, or raise `ReadingError` where it is not a finite number above 0."""
    if not 0.0 < sigma < np.inf:
        raise ReadingError(
            f"sigma = {sigma}: the noise of a reading over Vref must be a finite number above 0"
        )
    return sigma


def inverse(information: FloatArray) -> FloatArray:
    """Invert; what the readings do not tell at all becomes very large rather than infinite."""
    value, vector = np.linalg.eigh(information)
    floor = max(_TINY * value[-1], np.finfo(float).tiny)
    return np.asarray((vector / np.maximum(value, floor)) @ vector.T)


def spread(matrix: FloatArray, strip: IntArray, strips: int) -> FloatArray:
    """Put a matrix of the touched strips (2 T, 2 T) among NaN for all strips (2 strips, 2 strips)."""
    where = np.concatenate([strip, strips + strip])
    full = np.full((2 * strips, 2 * strips), np.nan)
    full[np.ix_(where, where)] = matrix
    return full

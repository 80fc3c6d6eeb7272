"""The Cramer-Rao bound, once for all models: from the slopes of readings to a covariance.

With J the slopes of all readings by the parameters, each over its reading's standard deviation, the information
of independent normal noise is J'J, and the bound its inverse. A direction that no reading tells has no bound: it
comes out as inf, never as the 0 that a pseudo-inverse would put there.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError

_ROUNDING = 1e-13  # of the largest singular value, columns scaled to length 1: below, nothing is told
_LEAN = 1e-6  # a parameter that leans by less on what is not told does not need it


def checked_sigma(sigma: float) -> float:
    """Return sigma, or raise `ReadingError` where it is not a finite number above 0."""
    if not 0.0 < sigma < np.inf:
        raise ReadingError(
            f"sigma = {sigma}: the noise of a reading over Vref must be a finite number above 0"
        )
    return sigma


def covariance(slopes: FloatArray) -> FloatArray:
    """Return the least covariance (P, P) that any unbiased method can have.

    Parameters
    ----------
    slopes
        Of the readings by the parameters, each row over its reading's standard deviation (readings, P). A prior
        is a reading of a parameter itself.

    Returns
    -------
    FloatArray
        A parameter that is not told has variance inf and covariances NaN; the others have their bound all the same.
    """
    count = slopes.shape[1]
    norm = np.linalg.norm(slopes, axis=0)
    scale = 1.0 / np.where(norm > 0.0, norm, 1.0)  # parameters of any unit or strength compare
    rows = np.concatenate([slopes * scale, np.zeros((max(0, count - len(slopes)), count))])
    value, vector = np.linalg.svd(rows, full_matrices=False)[1:]
    told = value > _ROUNDING * max(value.max(initial=0.0), np.finfo(float).tiny)
    root = (vector[told].T / value[told]) * scale[:, None]
    found = root @ root.T
    blind = np.linalg.norm(vector[~told], axis=0) > _LEAN
    found[blind, :] = found[:, blind] = np.nan
    found[blind, blind] = np.inf
    return np.asarray(found)

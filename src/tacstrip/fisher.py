"""The Cramer-Rao bound, for all models: from the Jacobian of the readings to a covariance.

With J the Jacobian of all readings by the parameters, each row over its reading's standard deviation, the information
of independent normal noise is J'J, and the bound its inverse. A direction that no reading identifies has no bound: it
comes out as inf, never as the 0 that a pseudo-inverse would put there.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError

# Of the largest singular value, columns scaled to length 1: below, a direction is not identified.
_ROUNDING = 1e-13
_UNIDENTIFIED = 1e-6  # a parameter with a larger component along such directions is not identified


def checked_sigma(sigma: float) -> float:
    """Return sigma, or raise `ReadingError` where it is not a finite number above 0."""
    if not 0.0 < sigma < np.inf:
        raise ReadingError(
            f"sigma = {sigma}: the noise of a reading over Vref must be a finite number above 0"
        )
    return sigma


def covariance(jacobian: FloatArray) -> FloatArray:
    """Return the least covariance (P, P) that any unbiased method can have.

    Parameters
    ----------
    jacobian
        Of the readings by the parameters, each row over its reading's standard deviation (readings, P). A prior
        is a reading of a parameter itself.

    Returns
    -------
    FloatArray
        A parameter that is not identified has variance inf and covariances NaN; the others have their bound.

    Examples
    --------
    Two readings of a parameter with sigma = 0.2 bound its variance by 0.02:

    >>> import numpy as np
    >>> covariance(np.array([[1.0], [1.0]]) / 0.2).round(6).tolist()
    [[0.02]]
    """
    count = jacobian.shape[1]
    norm = np.linalg.norm(jacobian, axis=0)
    scale = 1.0 / np.where(norm > 0.0, norm, 1.0)  # parameters of any unit or strength compare
    rows = np.concatenate([jacobian * scale, np.zeros((max(0, count - len(jacobian)), count))])
    value, vector = np.linalg.svd(np.linalg.qr(rows, mode="r"))[1:]  # many rows: in a quarter of the time
    identified = value > _ROUNDING * max(value.max(initial=0.0), np.finfo(float).tiny)
    root = (vector[identified].T / value[identified]) * scale[:, None]
    found = root @ root.T
    unbounded = np.linalg.norm(vector[~identified], axis=0) > _UNIDENTIFIED
    found[unbounded, :] = found[:, unbounded] = np.nan
    found[unbounded, unbounded] = np.inf
    return np.asarray(found)


def positive_part(matrix: FloatArray) -> FloatArray:
    """Return the nearest covariance to a difference of two (P, P): its negative eigenvalues are 0.

    Rows of parameters that are not identified, with inf on the diagonal, stay as they are.
    """
    known = np.isfinite(matrix.diagonal())
    block = np.ix_(known, known)
    value, vector = np.linalg.eigh(np.nan_to_num(matrix[block], posinf=0.0, neginf=0.0))
    found = matrix.copy()
    found[block] = (vector * np.maximum(value, 0.0)) @ vector.T
    return found

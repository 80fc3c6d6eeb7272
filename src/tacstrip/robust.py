"""Statistics that outliers do not move."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray

_NORMAL_MAD = 1.4826  # standard deviation of normal errors over their median absolute deviation


def robust_sigma(residuals: FloatArray, axis: int | None = None) -> FloatArray:
    """Return the standard deviation of normal errors from their median absolute value.

    Parameters
    ----------
    residuals
        Errors about 0, any shape, at least one along `axis`; NaN is ignored.
    axis
        The axis to reduce; all by default.

    Returns
    -------
    FloatArray
        In the unit of the residuals. Up to half of them may be outliers.

    Examples
    --------
    >>> import numpy as np
    >>> round(float(robust_sigma(np.array([-0.1, 0.1, -0.1, 0.1, 50.0]))), 4)
    0.1483
    """
    if axis is None:
        return np.asarray(_NORMAL_MAD * np.nanmedian(np.abs(residuals)))
    ordered = np.sort(np.abs(residuals), axis=axis)  # some times faster than nanmedian; NaN are last
    last = np.maximum((~np.isnan(ordered)).sum(axis=axis, keepdims=True) - 1, 0)
    middle = (np.take_along_axis(ordered, m, axis) for m in (last // 2, (last + 1) // 2))
    return np.asarray(_NORMAL_MAD * np.mean(list(middle), axis=0).squeeze(axis))


def half_sigma(residuals: FloatArray, sign: float) -> FloatArray:
    """Return `robust_sigma` of each column's errors of one sign (columns,), 0 where there are none.

    Of errors that a rail clips on one side, the other side's is theirs.

    Examples
    --------
    >>> import numpy as np
    >>> half_sigma(np.array([[0.0], [0.0], [0.1], [0.2], [0.3]]), 1.0).round(4).tolist()
    [0.2965]
    """
    half = np.where(sign * residuals > 0.0, residuals, np.nan)
    some = np.isfinite(half).any(axis=0)
    return np.where(some, robust_sigma(np.where(some, half, 0.0), axis=0), 0.0)


def shortest_half(values: FloatArray) -> float:
    """Return how long the shortest interval is that holds more than half of the values (n,), n > 0.

    Examples
    --------
    >>> import numpy as np
    >>> round(shortest_half(np.array([0.1, 0.1, 0.2, 0.9, 0.5])), 4)
    0.1
    """
    ordered, many = np.sort(values), len(values) // 2
    return float((ordered[many:] - ordered[: len(values) - many]).min())

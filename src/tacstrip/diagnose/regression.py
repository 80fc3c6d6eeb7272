"""Least squares on a few terms, and whether a contact moved to and fro."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray

_DEPENDENT = 1e-9  # of a term's length: a shorter orthogonal part means that it depends on the others
_BACK = 3  # times: twice may be one movement to and fro
_RANGE = 0.3  # over Vref: a contact that sways shows little else than its shape


def orthonormal(*terms: FloatArray) -> list[FloatArray]:
    """Return an orthonormal basis of what the terms, each (rows,), span.

    Gram-Schmidt by hand: BLAS would start threads for these few columns, which wait for each other on a busy machine.
    """
    basis: list[FloatArray] = []
    for term in terms:
        rest = orthogonal_part(orthogonal_part(term, basis), basis)  # twice, for rounding
        length = np.sqrt((rest**2).sum())
        if length > _DEPENDENT * np.sqrt((term**2).sum()):
            basis.append(rest / length)
    return basis


def orthogonal_part(values: FloatArray, basis: list[FloatArray]) -> FloatArray:
    """Return values (rows,) less their parts along an orthonormal basis."""
    for axis in basis:
        values = values - (values * axis).sum() * axis
    return values


def median_crossings(values: FloatArray, least: float) -> int:
    """Count how often values cross their median, going beyond it by `least` on both sides."""
    deviation = values - np.median(values)
    return int(np.count_nonzero(np.diff(np.sign(deviation[np.abs(deviation) > least]))))


def moved_to_and_fro(level: FloatArray, sigma: float, least: float = _RANGE) -> bool:
    """Whether a contact moved along the strips, over heights (places,) in order of time, three times, `least` far."""
    low, high = np.percentile(level, [5.0, 95.0])
    return bool(high - low >= least and median_crossings(level, max(0.01, 3.0 * sigma)) >= _BACK)

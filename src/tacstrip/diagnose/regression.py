"""What every test uses alike: least squares, and whether a contact came back."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray

_DEPENDENT = 1e-9  # of a term's length: what is left of one that others say already
_BACK = 3  # times: twice may be one movement to and fro
_RANGE = 0.3  # over Vref: a contact that sways shows little else than its shape


def without(values: FloatArray, *terms: FloatArray) -> FloatArray:
    """Return values (rows,) without their mean and what terms, each (rows,), explain by least squares.

    By hand: BLAS would start threads for these few columns, which wait for each other on a busy machine.
    """
    own: list[FloatArray] = []  # orthogonal, of length 1
    for term in (np.ones(len(values)), *terms):
        rest = _beside(_beside(term, own), own)  # twice, for rounding
        length = np.sqrt(np.sum(rest**2))
        if length > _DEPENDENT * np.sqrt(np.sum(term**2)):
            own.append(rest / length)
    return _beside(values, own)


def _beside(values: FloatArray, own: list[FloatArray]) -> FloatArray:
    for axis in own:
        values = values - np.sum(values * axis) * axis
    return values


def returns(values: FloatArray, least: float) -> int:
    """Count how often values cross their middle, going beyond it by `least` on both sides."""
    aside = values - np.median(values)
    return int(np.count_nonzero(np.diff(np.sign(aside[np.abs(aside) > least]))))


def came_back(level: FloatArray, sigma: float, least: float = _RANGE) -> bool:
    """Whether a contact went along the strips, over heights (places,) in order of time, three times, `least` far."""
    low, high = np.percentile(level, [5.0, 95.0])
    return bool(high - low >= least and returns(level, max(0.01, 3.0 * sigma)) >= _BACK)

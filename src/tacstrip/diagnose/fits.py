"""Least squares that every test uses alike."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray


def without(values: FloatArray, *terms: FloatArray) -> FloatArray:
    """Return values (rows,) without their mean and what terms, each (rows,), explain by least squares."""
    design = np.column_stack([np.ones(len(values)), *terms])
    return np.asarray(values - design @ np.linalg.lstsq(design, values, rcond=None)[0])

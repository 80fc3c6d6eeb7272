"""Medians and 5 % to 95 % ranges of our results, and whether a printed value lies inside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tacstrip.arrays import FloatArray

POINTS = ("median", "p05", "p95")
_HALF_DIGIT = 0.0005  # the thesis prints three decimals


def ranges(values: FloatArray, measures: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """Return the points of each measure, a column of `values` (shapes, measures); None where there are no shapes."""
    if not len(values):
        return {measure: dict.fromkeys(POINTS) for measure in measures}
    percentiles = np.percentile(values, [50.0, 5.0, 95.0], axis=0).T.tolist()
    named = [dict(zip(POINTS, points, strict=True)) for points in percentiles]
    return dict(zip(measures, named, strict=True))


def is_inside(printed: float, low: float | None, high: float | None) -> bool | None:
    """Tell whether a printed value lies in a range, give or take half its last digit; None if one is missing."""
    if np.isnan(printed) or low is None or high is None:
        return None
    return bool(low - _HALF_DIGIT <= printed <= high + _HALF_DIGIT)

"""Pairs of neighbouring strips compared with the strips around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class NeighbourPair:
    """Neighbours i and i + 1, and the straight line through the strips around them, over Vref (places,).

    Attributes
    ----------
    difference
        Reading of i + 1 less that of i.
    slope
        Rise of the line from strip to strip.
    offset
        Mean of both readings less the line.
    level
        The line, half way between the two.
    rows
        The places' rows.
    """

    difference: FloatArray
    slope: FloatArray
    offset: FloatArray
    level: FloatArray
    rows: IntArray

    @property
    def excess(self) -> FloatArray:
        """By how much the difference exceeds the line's slope."""
        return self.difference - self.slope


def neighbour_pair(values: FloatArray, strip: int) -> NeighbourPair | None:
    """Compare a strip and the next one, at the places where all four strips have readings.

    Parameters
    ----------
    values
        Readings of one signature over Vref (places, strips).
    strip
        The first of the two. The line goes through the strips on both sides, at an edge through the next two; None is
        returned where there are none.
    """
    n = values.shape[1]
    inner = strip - 1, strip + 2
    a, b = inner if 0 < strip < n - 2 else (strip + 2, strip + 3) if strip == 0 else (strip - 2, strip - 1)
    if a < 0 or b >= n:
        return None
    slope = (values[:, b] - values[:, a]) / (b - a)
    level = values[:, a] + slope * (strip + 0.5 - a)
    first, second = values[:, strip], values[:, strip + 1]
    offset = (first + second) / 2.0 - level
    known = np.flatnonzero(np.isfinite(offset))
    if not len(known):
        return None
    return NeighbourPair((second - first)[known], slope[known], offset[known], level[known], known)

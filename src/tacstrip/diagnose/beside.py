"""Two neighbouring strips beside the strips around them: how far apart they are, and how far off together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Beside:
    """Two neighbours, i and i + 1, and the line through the strips around them, over Vref (places,).

    Attributes
    ----------
    apart
        How much i + 1 reads above i.
    slope
        How much the line rises from strip to strip.
    together
        How much both read above the line, in the mean.
    level
        The line, half way between the two.
    rows
        The places' rows.
    """

    apart: FloatArray
    slope: FloatArray
    together: FloatArray
    level: FloatArray
    rows: IntArray

    @property
    def bent(self) -> FloatArray:
        """How much further than the line's slope the two lie apart."""
        return self.apart - self.slope


def neighbours(values: FloatArray, strip: int) -> Beside | None:
    """Compare a strip and the next one, at the places where all four strips have readings.

    Parameters
    ----------
    values
        Readings of one signature over Vref (places, strips).
    strip
        The first of the two. The line goes through the strips on either side of the two, or at an edge of the
        sensor through the next two; None where there are none.
    """
    n = values.shape[1]
    if 0 < strip < n - 2:
        a, b = strip - 1, strip + 2
    elif n >= 4:
        a, b = (2, 3) if strip == 0 else (n - 4, n - 3)
    else:
        return None
    slope = (values[:, b] - values[:, a]) / (b - a)
    level = values[:, a] + slope * (strip + 0.5 - a)
    first, second = values[:, strip], values[:, strip + 1]
    together = (first + second) / 2.0 - level
    known = np.flatnonzero(np.isfinite(together))
    if not len(known):
        return None
    return Beside((second - first)[known], slope[known], together[known], level[known], known)

"""Two neighbouring strips beside the strips around them: how far apart they are, how far off, and by what bridge.

Over metal, strips are energised in turn, and a bridge between two gives the current a second way to the sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.diagnose.expected import View

_FEW = 16  # places
_BINS = 8  # of height
_OTHERS = 3  # pairs that say what is usual
_STRAIGHT = 0.6  # of the places: the others have a corner of the contact under one of the two
_GRID = np.linspace(0.0, 1.0, 11)


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


@dataclass(frozen=True, eq=False)
class Bridge:
    """A bridge that explains what two neighbours read together beside the others.

    strength: of what a bridge would do. off: the root mean square of the misfit over Vref. left: of its square. most,
    least: what the bridge adds over Vref, at some height.
    """

    strength: float
    off: float
    left: float
    size: float
    most: float
    least: float
    low: float
    high: float
    places: int


def second_way(level: FloatArray, low: float, high: float) -> FloatArray:
    """Return what a bridge adds to readings over Vref, of contacts that read `level`.

    Between contact and bridge the strip's neighbour lies beside it, and halves the resistance there. A contact has
    some length: its readings go from `low` to `high` while it lies on the bridge, which then does nothing.
    """
    below = np.minimum(level, low)
    above = np.maximum(level, high)
    return np.asarray(
        below / (1.0 - (low - below) / 2.0)
        - below
        + (high + (above - high) / 2.0) / (1.0 - (above - high) / 2.0)
        - above
    )


def bridges(view: View) -> Iterator[tuple[int, Beside, Bridge]]:
    """Give every two neighbours with the bridge that fits them best."""
    (values,) = view.k.values()
    pairs = {i: b for i in range(view.strips - 1) if (b := neighbours(values, i)) and len(b.level) >= _FEW}
    usual = _usual(_means(list(pairs.values())))
    for strip, pair in pairs.items():
        aside = np.abs(pair.bent - np.median(pair.bent))
        keep = aside <= np.quantile(aside, _STRAIGHT)
        level = np.clip(pair.level[keep], 0.0, 1.0)
        best = _best(level, pair.together[keep] - np.interp(level, *usual))
        if best is not None:
            yield strip, pair, best


def _best(level: FloatArray, off: FloatArray) -> Bridge | None:
    fade = (1.0 - level**6) * (1.0 - (1.0 - level) ** 6)  # as offsets of a unit without calibration do
    fade /= max(float(np.linalg.norm(fade)), 1e-9)
    rest = off - (off @ fade) * fade
    whole = float(rest @ rest)
    found = None
    for i, low in enumerate(_GRID):
        for high in _GRID[i:]:
            way = second_way(level, float(low), float(high))
            own = way - (way @ fade) * fade
            power = float(own @ own)
            if power < 1e-9 * len(level):
                continue
            strength = float(own @ rest) / power
            left = 1.0 - strength * float(own @ rest) / max(whole, 1e-12)
            if strength > 0.0 and (found is None or left < found.left):
                added = strength * way
                found = Bridge(
                    strength, float(np.sqrt(whole / len(level))), left, float(np.std(added)), float(added.max()),
                    float(added.min()), float(low), float(high), len(level),
                )  # fmt: skip
    return found


def _means(pairs: list[Beside]) -> FloatArray:
    """Return what pairs lie off the line, in the middle (pairs, heights), NaN where there are few places."""
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    means = np.full((len(pairs), _BINS), np.nan)
    for row, pair in enumerate(pairs):
        height = np.searchsorted(edges[1:-1], pair.level)
        for b in range(_BINS):
            here = pair.together[height == b]
            if len(here) >= 4:
                means[row, b] = np.median(here)
    return means


def _usual(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return heights and what pairs usually lie off the line there: a contact's curve is the same for all."""
    middle = (np.arange(_BINS) + 0.5) / _BINS
    known = np.isfinite(means).sum(axis=0) >= _OTHERS
    if not known.any():
        return np.array([0.5]), np.array([0.0])
    return middle[known], np.array([np.median(c[np.isfinite(c)]) for c in means.T[known]])

"""Pairs of neighbouring strips compared with the strips around them, and the bridge that explains a deviation.

Over metal, strips are energised in turn, and a bridge between two gives the current a second way to the sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.diagnose.neighbour_prediction import WorkingCopy

_FEW = 16  # places
_BINS = 8  # of height
_OTHERS = 3  # pairs that determine the typical offset
_STRAIGHT = 0.6  # of the places; at the others a corner of the contact lies under one of the two
_GRID = np.linspace(0.0, 1.0, 11)


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
    offset = (first + second) / 2.0 - level
    known = np.flatnonzero(np.isfinite(offset))
    if not len(known):
        return None
    return NeighbourPair((second - first)[known], slope[known], offset[known], level[known], known)


@dataclass(frozen=True, eq=False)
class Bridge:
    """The bridge that best explains the offset of two neighbours.

    Attributes
    ----------
    strength
        Its effect over that of an ideal bridge.
    rms
        Root mean square of the offset over Vref.
    unexplained
        Share of the offset's variance that the bridge does not explain.
    size, most, least
        Standard deviation, maximum and minimum of its effect over Vref.
    low, high
        Where it lies over L: readings while the contact lies on it.
    places
        How many there were.
    """

    strength: float
    rms: float
    unexplained: float
    size: float
    most: float
    least: float
    low: float
    high: float
    places: int


def bridge_effect(level: FloatArray, low: float, high: float) -> FloatArray:
    """Return what a bridge adds to readings over Vref, of contacts that read `level`.

    Between contact and bridge the neighbour is parallel to the strip, which halves the resistance there. A contact
    has some length: its readings go from `low` to `high` while it lies on the bridge, which then has no effect.
    """
    below = np.minimum(level, low)
    above = np.maximum(level, high)
    return np.asarray(
        below / (1.0 - (low - below) / 2.0)
        - below
        + (high + (above - high) / 2.0) / (1.0 - (above - high) / 2.0)
        - above
    )


def bridges(work: WorkingCopy) -> Iterator[tuple[int, NeighbourPair, Bridge]]:
    """Yield all pairs of neighbours with the bridge that fits them best."""
    (values,) = work.k.values()
    every = {i: neighbour_pair(values, i) for i in range(work.strips - 1)}
    pairs = {i: b for i, b in every.items() if b and len(b.level) >= _FEW}
    typical = _typical_offset(_binned_medians(list(pairs.values())))
    for strip, pair in pairs.items():
        aside = np.abs(pair.excess - np.median(pair.excess))
        keep = aside <= np.quantile(aside, _STRAIGHT)
        level = np.clip(pair.level[keep], 0.0, 1.0)
        best = _best(level, pair.offset[keep] - np.interp(level, *typical))
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
            way = bridge_effect(level, float(low), float(high))
            own = way - (way @ fade) * fade
            power = float(own @ own)
            if power < 1e-9 * len(level):
                continue
            strength = float(own @ rest) / power
            unexplained = 1.0 - strength * float(own @ rest) / max(whole, 1e-12)
            if strength > 0.0 and (found is None or unexplained < found.unexplained):
                added = strength * way
                found = Bridge(
                    strength, float(np.sqrt(whole / len(level))), unexplained, float(np.std(added)), float(added.max()),
                    float(added.min()), float(low), float(high), len(level),
                )  # fmt: skip
    return found


def _binned_medians(pairs: list[NeighbourPair]) -> FloatArray:
    """Return the median offset of each pair by height (pairs, heights), NaN where there are few places."""
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    means = np.full((len(pairs), _BINS), np.nan)
    for row, pair in enumerate(pairs):
        height = np.searchsorted(edges[1:-1], pair.level)
        for b in range(_BINS):
            here = pair.offset[height == b]
            if len(here) >= 4:
                means[row, b] = np.median(here)
    return means


def _typical_offset(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return heights and the median offset of all pairs there: that of the contact's curvature, the same for all."""
    middle = (np.arange(_BINS) + 0.5) / _BINS
    known = np.isfinite(means).sum(axis=0) >= _OTHERS
    if not known.any():
        return np.array([0.5]), np.array([0.0])
    return middle[known], np.array([np.median(c[np.isfinite(c)]) for c in means.T[known]])

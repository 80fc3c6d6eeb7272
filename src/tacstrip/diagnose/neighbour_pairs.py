"""Pairs of neighbouring strips compared with the strips around them, and the bridge that explains a deviation.

Over metal, strips are energised in turn, and a bridge between two gives the current a second way to the sheet.
"""

from __future__ import annotations

import math
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
_PLACES = [(float(low), float(high)) for i, low in enumerate(_GRID) for high in _GRID[i:]]


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


def neighbour_pair(values: FloatArray, strip: int, beyond: int | None = None) -> NeighbourPair | None:
    """Compare a strip and the next one, at the places where all four strips have readings.

    Parameters
    ----------
    values
        Readings of one signature over Vref (places, strips).
    strip
        The first of the two.
    beyond
        Where the line comes from: 0, one strip on either side; 1, the next two; -1, the two before. None: from both
        sides, but at an edge of the sensor. None is returned where there are none.
    """
    n = values.shape[1]
    if beyond is None:
        beyond = 0 if 0 < strip < n - 2 else 1 if strip == 0 else -1
    a, b = {0: (strip - 1, strip + 2), 1: (strip + 2, strip + 3), -1: (strip - 2, strip - 1)}[beyond]
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


def bridge_effect(level: FloatArray, low: float | FloatArray, high: float | FloatArray) -> FloatArray:
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


def bridges(work: WorkingCopy) -> Iterator[tuple[int, NeighbourPair, Bridge, float]]:
    """Yield all pairs of neighbours with the bridge that fits them best, and the size that fits other pairs.

    The line of a pair at the sensor's edge is extrapolated, and so are those of the pairs that it is held against.
    """
    (values,) = work.k.values()
    last = work.strips - 2
    for beyond, asked in ((0, range(1, last)), (1, range(1)), (-1, range(last, last + 1))):
        every = {i: neighbour_pair(values, i, beyond) for i in range(last + 1)}
        pairs = {i: b for i, b in every.items() if b and len(b.level) >= _FEW}
        typical = _typical_offset(_binned_medians(list(pairs.values())))
        fits = {i: _fitted(pair, typical) for i, pair in pairs.items()}
        for strip in asked:
            if (fit := fits.get(strip)) is not None:
                # Lines through a bridged strip are off too.
                hit = {strip + d for d in range(*{0: (-2, 3), 1: (-3, 2), -1: (-1, 4)}[beyond])}
                others = sorted(f.size for i, f in fits.items() if f is not None and i not in hit)
                yield (
                    strip,
                    pairs[strip],
                    fit,
                    others[-2 if len(others) > 4 else -1] if len(others) > 1 else math.inf,
                )


def _fitted(pair: NeighbourPair, typical: tuple[FloatArray, FloatArray]) -> Bridge | None:
    aside = np.abs(pair.excess - np.median(pair.excess))
    keep = aside <= np.quantile(aside, _STRAIGHT)
    level = np.clip(pair.level[keep], 0.0, 1.0)
    return _best(level, pair.offset[keep] - np.interp(level, *typical))


def _best(level: FloatArray, off: FloatArray) -> Bridge | None:
    """Return the bridge that leaves the least, None where none adds anything.

    What readings at nearly one height differ by no bridge explains; it does not count as unexplained.
    """
    fade = (1.0 - level**6) * (1.0 - (1.0 - level) ** 6)  # as offsets of a unit without calibration do
    fade /= max(float(np.linalg.norm(fade)), 1e-9)
    rest = off - (off @ fade) * fade
    whole = float(rest @ rest)
    scatter = (
        0.5 * float(np.mean(np.diff(rest[np.argsort(level)]) ** 2)) * len(level) if len(level) > 1 else 0.0
    )
    ways = _effects(level)
    own = ways - np.outer(ways @ fade, fade)
    power = np.einsum("ij,ij->i", own, own)
    with np.errstate(invalid="ignore", divide="ignore"):
        strength = np.where(power < 1e-9 * len(level), 0.0, (own @ rest) / power)
    explained = np.where(strength > 0.0, strength**2 * power, 0.0)
    best = int(np.argmax(explained))
    if explained[best] <= 0.0:
        return None
    added = strength[best] * ways[best]
    left = max(whole - explained[best] - scatter, 0.0) / max(whole - scatter, explained[best], 1e-12)
    low, high = _PLACES[best]
    return Bridge(
        float(strength[best]), float(np.sqrt(whole / len(level))), float(left), float(np.std(added)),
        float(added.max()), float(added.min()), low, high, len(level),
    )  # fmt: skip


def _effects(level: FloatArray) -> FloatArray:
    """Return what a bridge at each of `_PLACES` adds (bridges, places)."""
    low, high = np.array(_PLACES).T[:, :, None]
    return bridge_effect(level, low, high)


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

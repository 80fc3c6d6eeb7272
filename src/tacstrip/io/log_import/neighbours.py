"""In which order strips lie that have no numbers: contacts are on neighbours, whose readings are alike."""

from __future__ import annotations

import itertools

import numpy as np

from tacstrip.arrays import FloatArray, IntArray


def order_of_neighbours(values: FloatArray) -> list[int]:
    """Return strips in the order, or its reverse, in which they probably lie.

    The path through all strips on which neighbours are touched together most often, and read most alike: improved by
    turning and moving its parts, from each strip on, as for the shortest path through points. Of equals, as they stand.

    Parameters
    ----------
    values
        Readings (scans, strips, channels), NaN where nothing touches.

    Examples
    --------
    >>> scan, strip = np.ogrid[:20, :5]
    >>> y = np.where(abs(scan / 5 - strip) < 2, 0.2 + 0.02 * scan + 0.01 * strip, np.nan)[:, [3, 0, 4, 1, 2], None]
    >>> [[3, 0, 4, 1, 2][n] for n in order_of_neighbours(y)] in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0])
    True
    """
    strips = values.shape[1]
    there = values[np.isfinite(values)]
    spread = float(np.ptp(there)) if len({*there.tolist()}) > 1 else 1.0
    alike = np.zeros((strips, strips))
    for a, b in itertools.combinations(range(strips), 2):
        apart = np.abs(values[:, a] - values[:, b]).mean(axis=1) / spread
        alike[a, b] = alike[b, a] = float(np.nansum(1.0 - apart))
    paths = [np.arange(strips), *(_improved(_greedy(alike, first), alike) for first in range(strips))]
    best = max(_length(path, alike) for path in paths)
    return next(path.tolist() for path in paths if _length(path, alike) > best - 1e-9)


def _length(path: IntArray, alike: FloatArray) -> float:
    return float(alike[path[:-1], path[1:]].sum())


def _greedy(alike: FloatArray, first: int) -> IntArray:
    path, left = [first], {*range(len(alike))} - {first}
    while left:
        path.append(max(left, key=lambda n: (alike[path[-1], n], -n)))
        left.remove(path[-1])
    return np.array(path)


def _improved(path: IntArray, alike: FloatArray) -> IntArray:
    best, better = _length(path, alike), True
    while better:
        better = False
        for i, j in itertools.combinations(range(len(path) + 1), 2):
            part, rest = path[i:j], np.concatenate([path[:i], path[j:]])
            turned = np.concatenate([path[:i], part[::-1], path[j:]])
            ways = [turned, np.concatenate([part, rest]), np.concatenate([rest, part])]
            found = max(ways, key=lambda way: _length(way, alike))
            if (length := _length(found, alike)) > best + 1e-9:
                path, best, better = found, length, True
    return path

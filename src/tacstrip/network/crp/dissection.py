"""The order in which the nodes of a sheet with strips on it are eliminated: nested dissection.

A line of nodes parts a rectangle of strips and rows in two that know of each other by it alone, so it comes after both
(A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973)).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tacstrip.arrays import IntArray

_FEWEST = 20  # nodes of one strip that are parted no further
_FLAT = 0.6  # a rectangle is parted between strips up to so many rows a line of nodes across


def elimination_order(lines: IntArray, each: int, last: IntArray) -> IntArray:
    """Return all nodes in the order of their elimination (N,).

    Parameters
    ----------
    lines
        Nodes along the strips, across (lines, rows); -1 where there is none.
    each
        Lines from the left side of a strip's pitch, which the strip before has too, to its right one.
    last
        Nodes that come last; only these may stand more than once.
    """
    order = lines.ravel()[_dissected(*lines.shape, each)]
    inner = np.append(np.ones(int(order.max(initial=0)) + 1, dtype=bool), False)  # -1: there is none
    inner[last] = False
    return np.concatenate([order[inner[order]], np.unique(last)])


@lru_cache(maxsize=8)
def _dissected(lines: int, rows: int, each: int) -> IntArray:
    """Return the places of a whole mesh (lines, rows), flat, in their order."""
    place, strips, parts = np.arange(lines * rows).reshape(lines, rows), lines // each, []

    def part(first: int, end: int, low: int, high: int) -> None:
        """Add the nodes of a rectangle of strips and rows, but for lines that it shares with strips beside it."""
        own = place[first * each + (first > 0) : end * each + (end == strips), low:high]
        across, along = own.shape
        if along < 2 or (end - first == 1 and own.size <= _FEWEST):
            parts.append(own[:, ::-1].ravel())
        elif end - first > 1 and along <= _FLAT * across:
            middle = (first + end) // 2
            part(first, middle, low, high)
            part(middle, end, low, high)
            parts.append(place[middle * each, low:high])
        else:
            middle = (low + high) // 2
            part(first, end, low, middle)
            part(first, end, middle + 1, high)
            parts.append(own[:, middle - low])

    part(0, strips, 0, rows)
    return np.concatenate(parts)

"""The linear system of Vertex Reconstruction: blocks of vertices and the edges opposite to them (4.2.4)."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.sensor.closed_form import end_weights
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor


def linear_system(
    x: FloatArray,
    k: FloatArray,
    upper: BoolArray,
    y_ends: tuple[float, float],
    sensor: Sensor,
    signature: str,
) -> tuple[FloatArray, FloatArray]:
    """Set up A y = b for the interior vertices' y: steps 3 and 4 of section 4.2.4.

    A row says c_own y_i + c_opposite y_edge = k_i L. The thesis' row is this one over c_opposite, which
    would divide by zero at k_l = 0.

    Parameters
    ----------
    x
        The vertices' x (N,) [mm].
    k
        Readings at the vertices (N,).
    upper
        Whether each vertex is on the upper chain (N,); the ends' entries do not count.
    y_ends
        y of the left-most and the right-most vertex [mm].
    sensor, signature
        Which closed form.

    Returns
    -------
    tuple
        A (N - 2, N - 2) and b (N - 2,) [mm].
    """
    n = len(x)
    c_l, c_u = end_weights(k, SIGNATURES[signature].at_upper_end, sensor.sensing_ratio)
    own, opposite = np.where(upper, c_u, c_l), np.where(upper, c_l, c_u)
    matrix = np.diag(own[1:-1])
    right = k[1:-1] * sensor.length_mm
    for start, end in blocks(upper):
        inside = np.arange(start + 1, end)
        to_end = (x[inside] - x[start]) / (x[end] - x[start])
        # The four block types of table 4.1: an end of the block is known where it is an end of the polygon.
        for vertex, weight in ((start, 1.0 - to_end), (end, to_end)):
            if vertex in (0, n - 1):
                right[inside - 1] -= opposite[inside] * weight * y_ends[0 if vertex == 0 else 1]
            else:
                matrix[inside - 1, vertex - 1] += opposite[inside] * weight
    return matrix, right


def blocks(upper: BoolArray) -> list[tuple[int, int]]:
    """Return the blocks of 4.2.4 as (start, end) vertex indices; neighbouring blocks share one section.

    Between a block's start and end all vertices are on one chain, and start and end are neighbours on the
    other chain, so that the edge opposite the block's vertices runs from start to end.
    """
    n = len(upper)
    turns = [i for i in range(2, n - 1) if upper[i] != upper[i - 1]]
    starts = [0, *(i - 1 for i in turns)]
    ends = [*turns, n - 1]
    return list(zip(starts, ends, strict=True))

"""Points of a feasible set as outlines, and how these scatter about their mean."""

from __future__ import annotations

from functools import cache

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at as address
from tacstrip.core.binding import exported
from tacstrip.geometry.moments import LEVEL, MomentDeviations, axis_deviation, sample_deviations
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds

_ALIKE = 0.1  # of the points: if fewer are worth as much as all, they do not tell of vertices


def draw_outlines(
    points: FloatArray, lines: EdgeLines, band: ReadingBounds
) -> tuple[FloatArray, FloatArray] | None:
    """Return chains (K, M, 2) and (K, N, 2) [mm], as often as their vertices' places have room in the set.

    None where that is too unlike the heights' room for points (K, P) drawn by heights to tell: with an edge that
    crosses hardly a strip, nearly all of them make it vertical.
    """
    core, count = exported("outlines"), len(points)
    if core is None:
        return plain_draw_outlines(points, lines, band)
    vertical_x, windows, points = _vertical_x(band, count), band.windows, np.ascontiguousarray(points)
    lower, upper = (np.empty((count, n + 1, 2)) for n in (lines.lower, len(lines.reach) - lines.lower))
    workspace = np.empty(lower.size + upper.size + count)
    given = map(address, (windows, points, vertical_x, lower, upper, workspace))
    at_windows, at_points, at_vertical, *out = given
    length = band.sensor.length_mm
    found = core(lines.compiled, at_windows, length, at_points, at_vertical, count, *out)
    return (lower, upper) if found else None


def plain_draw_outlines(
    points: FloatArray, lines: EdgeLines, band: ReadingBounds
) -> tuple[FloatArray, FloatArray] | None:
    """Do as `draw_outlines`, in NumPy."""
    count, windows = len(points), band.windows
    lower, upper = lines.chains(points, _vertical_x(band, count))
    weight, ends = lines.density(points, lower, upper), lower[:, [0, -1], 0]
    weight[np.any((ends < windows[:, 0]) | (ends > windows[:, 1]), axis=1)] = 0.0  # a bound too far to be met
    if not 0.0 < weight.max(initial=0.0) < np.inf:
        return None
    weight /= weight.max()
    total = np.cumsum(weight)
    if total[-1] ** 2 < _ALIKE * count * (weight**2).sum():
        return None
    kept = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    on_strip = ([-np.inf, 0.0], [np.inf, band.sensor.length_mm])
    return np.clip(lower[kept], *on_strip), np.clip(upper[kept], *on_strip)


def _vertical_x(band: ReadingBounds, count: int) -> FloatArray:
    """Return x (K, 2) [mm] of vertical ends: nothing tells where in its window one lies, nor one end of the other."""
    windows = band.windows
    return np.asarray(windows[:, 0] + (shuffled_ends(count) + 0.5) / count * (windows[:, 1] - windows[:, 0]))


@cache
def shuffled_ends(count: int) -> FloatArray:
    """Return both columns 0 to count - 1 in some order (count, 2), always the same."""
    random = np.random.default_rng(0)
    return np.stack([random.permutation(count), random.permutation(count)], axis=1).astype(float)


def scatter(
    mean: Outline, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray, MomentDeviations]:
    """Return how chains (K, M, 2), (K, N, 2) scatter about their mean; its covariance is of its `vertices.ravel()`.

    Covariance (2 V, 2 V) [mm^2], the squared Mahalanobis distance within which 95 % of them have each vertex (V,), and
    the deviations of area, centroid and orientation. Where the mean has one vertex of two, their middle counts.
    """
    core = exported("scatter")
    if core is None:
        return plain_scatter(mean, lower, upper)
    vertices, indices = mean.vertices, [np.ascontiguousarray(at, dtype=np.int64) for at in mean.indices]
    count, n = len(lower), len(vertices)
    covariance, radii, deviations = np.empty((2 * n, 2 * n)), np.empty(n), np.empty(4)
    workspace = np.empty((2 * n + 6) * (count + 3) + 2 * n)
    out = map(address, (covariance, radii, deviations, workspace))
    given = (*map(address, (lower, upper, *indices)), *map(len, indices), address(vertices))
    core(*given, n, count, *out)
    area, x, y, turn = deviations.tolist()
    return covariance, radii, (area, np.array([x, y]), axis_deviation(turn))


def plain_scatter(
    mean: Outline, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray, MomentDeviations]:
    """Do as `scatter`, in NumPy."""
    vertices = np.zeros((len(lower), *mean.vertices.shape))
    times = np.zeros(len(mean.vertices))
    for index, chain in zip(mean.indices, (lower, upper), strict=True):
        vertices[:, index] += chain
        times[index] += 1.0
    vertices /= times[:, None]
    off = vertices - mean.vertices
    covariance = np.cov(off.reshape(len(off), -1), rowvar=False)
    blocks = np.einsum("kvi,kvj->vij", off, off) / (len(off) - 1)
    distance = np.einsum("kvi,vij,kvj->kv", off, np.linalg.pinv(blocks, hermitian=True), off)
    return covariance, np.quantile(distance, LEVEL, axis=0), sample_deviations(mean.vertices, vertices)

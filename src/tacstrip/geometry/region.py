"""Where a vertex lies with 95 % probability, and shapes with these regions for notebooks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.moments import LEVEL
from tacstrip.notebook import BLUE, VERMILION, SvgPath

_COARSE, _MOST_VERTICES = 20, 20  # corners of a region that is sent, and of an outline that has some


def ellipse(vertex: FloatArray, covariance: FloatArray, level: float = LEVEL) -> FloatArray:
    """Return the outline (48, 2) [mm] of the region that holds a vertex with probability `level`.

    Parameters
    ----------
    vertex
        Its estimate (2,) [mm].
    covariance
        Of its x and y (2, 2) [mm^2]; the error is taken for normal, so the region is where the Mahalanobis
        distance squared is at most -2 ln(1 - level), the quantile of chi-square with two degrees of freedom.
        Without a finite one there is no region: (0, 2).
    """
    if not np.isfinite(covariance).all():
        return np.empty((0, 2))
    spread, axes = np.linalg.eigh(covariance)
    reach = np.sqrt(np.maximum(spread, 0.0) * -2.0 * math.log(1.0 - level))
    turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    return np.asarray(vertex + np.stack([np.cos(turn), np.sin(turn)], axis=1) * reach @ axes.T)


def regions(vertices: FloatArray, covariance: FloatArray | None) -> list[FloatArray]:
    """Return the region of every vertex (N, 2) that has one, from their covariance (2N, 2N) [mm^2]."""
    if covariance is None:
        return []
    parts = [covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(vertices))]
    own = (ellipse(v, part) for v, part in zip(vertices, parts, strict=True))
    return [region for region in own if len(region)]


def coarse_regions(vertices: FloatArray, covariance: FloatArray | None) -> list[FloatArray]:
    """Return the regions of an outline as polygons of few corners, to be sent; none of an outline of many vertices."""
    own = regions(vertices, covariance) if len(vertices) <= _MOST_VERTICES else []
    return [region[:: max(1, len(region) // _COARSE)] for region in own]


def outline_paths(shapes: Sequence[tuple[FloatArray, FloatArray | None]]) -> list[SvgPath]:
    """Return polygons (N, 2) [mm] with their covariance (2N, 2N) or None as areas, and their 95 % regions as rings."""
    shapes = [(v, c) for v, c in shapes if len(v)]
    around = [region for v, c in shapes for region in regions(v, c)]
    areas = [SvgPath(v, stroke=VERMILION, fill=VERMILION) for v, _ in shapes]
    return areas + [SvgPath(region, stroke=BLUE, width=1.0) for region in around]

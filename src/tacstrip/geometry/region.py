"""Where a vertex lies with 95 % probability, and shapes with these regions as SVG for notebooks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.moments import LEVEL

_NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
_SIZE = 320.0  # of the picture's longer side [px]


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


def svg(shapes: Sequence[tuple[FloatArray, FloatArray | None]]) -> str:
    """Return polygons (N, 2) [mm] with their covariance (2N, 2N) or None as one SVG, y upwards, with 95 % regions."""
    shapes = [(v, c) for v, c in shapes if len(v)]
    if not shapes:
        return f'<svg {_NAMESPACE} width="90" height="24"><text x="4" y="16">no shape</text></svg>'
    around = [regions(v, c) for v, c in shapes]
    every = np.concatenate([*(v for v, _ in shapes), *(r for each in around for r in each)])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.06 * max(float((high - low).max()), 1e-9)
    low, high = low - margin, high + margin
    width, height = (float(part) for part in high - low)
    scale = _SIZE / max(width, height)

    def path(points: FloatArray) -> str:
        return "M" + " ".join(f"{x - low[0]:.6g},{high[1] - y:.6g}" for x, y in points) + "Z"

    shape = f'fill="#c1440e" fill-opacity=".15" stroke="#c1440e" stroke-width="{1.5 / scale:.6g}"'
    region = f'fill="none" stroke="#1f5fa8" stroke-width="{1.0 / scale:.6g}"'
    lines = [f'<path d="{path(v)}" {shape}/>' for v, _ in shapes]
    lines += [f'<path d="{path(r)}" {region}/>' for each in around for r in each]
    return (
        f'<svg {_NAMESPACE} width="{width * scale:.0f}" height="{height * scale:.0f}" '
        f'viewBox="0 0 {width:.6g} {height:.6g}">{"".join(lines)}</svg>'
    )

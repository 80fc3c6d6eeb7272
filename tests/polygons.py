"""Random polygons with their ground truth, for tests of the reconstructions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tacstrip.core.binding import exported

Polygon = NDArray[np.float64]
# What one signature's outline is at best, and why: without the core nothing is drawn that tells how sure it is.
DRAWN = exported("sample_outlines") is not None
SURE, WHY = (
    ("ok", "") if DRAWN else ("likely", "how sure this is was not assessed: the compiled core is missing")
)
CONVEX = WHY or "taken for convex: one signature does not tell a notch or a gap"
many_fits = pytest.mark.skipif(
    not DRAWN, reason="so many fits take NumPy minutes; tests/core holds it to the same results"
)


def convex_polygon(seed: int, corners: int, size: float = 1000.0, least_gap: float = 3.01) -> Polygon:
    """Return a strictly convex polygon (corners, 2) inside (0, size) squared, counter-clockwise.

    Its corners lie on an ellipse, in x at least `least_gap` apart, so that every section holds 3 strips of
    pitch 1.
    """
    random = np.random.default_rng(seed)
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, corners))
        axes = random.uniform(0.1, 0.4, 2) * size
        low, high = axes + 0.02 * size, 0.98 * size - axes
        polygon: Polygon = axes * np.stack([np.cos(angle), np.sin(angle)], axis=1) + random.uniform(low, high)
        widest = np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()
        if widest < 0.95 * np.pi and np.diff(np.sort(polygon[:, 0])).min() >= least_gap:
            return polygon


def from_left(polygon: Polygon) -> Polygon:
    """Start a polygon at its left-most corner, as reconstructions do."""
    return np.roll(polygon, -int(polygon[:, 0].argmin()), axis=0)

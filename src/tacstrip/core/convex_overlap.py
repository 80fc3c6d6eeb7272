"""The area that a convex polygon shares with a ring."""

from __future__ import annotations

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at, exported


def convex_overlap(convex: FloatArray, ring: FloatArray) -> float:
    """Return the area [mm^2] that a polygon (N, 2), convex or nearly so, shares with a ring (M, 2)."""
    core = exported("convex_overlap")
    if core is not None:
        convex, ring = np.ascontiguousarray(convex), np.ascontiguousarray(ring)
        room = np.empty(4 * (len(convex) + 3))
        area = core(at(convex), len(convex), at(ring), len(ring), at(room))
        if area >= 0.0:
            return float(area)
    return _plain_overlap(convex, ring)


def _plain_overlap(convex: FloatArray, ring: FloatArray) -> float:
    """Do as `convex_overlap`, of a polygon that turns inwards, too."""
    if min(len(convex), len(ring)) < 3:
        return 0.0
    shapes = shapely.polygons([shapely.linearrings(convex), shapely.linearrings(ring)])
    if not shapely.is_valid(shapes).all():
        shapes = shapely.buffer(shapes, 0.0)
    return float(shapely.area(shapely.intersection(*shapes)))

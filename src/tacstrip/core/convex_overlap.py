"""The area that a convex polygon shares with a ring."""

from __future__ import annotations

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at, exported


def convex_overlap(convex: FloatArray, ring: FloatArray) -> tuple[float, float, float]:
    """Return the areas [mm^2] of a polygon (N, 2), convex as a rule, of a ring (M, 2), and of what both share."""
    core = exported("convex_overlap")
    if core is not None:
        convex, ring = np.ascontiguousarray(convex), np.ascontiguousarray(ring)
        areas, room = np.empty(3), np.empty(4 * (len(convex) + 3))
        if core(at(convex), len(convex), at(ring), len(ring), at(areas), at(room)):
            own, other, shared = areas.tolist()
            return own, other, shared
    return _plain_overlap(convex, ring)


def _plain_overlap(convex: FloatArray, ring: FloatArray) -> tuple[float, float, float]:
    """Do as `convex_overlap`, also of polygons that turn inwards or cross themselves."""
    shapes = [shapely.Polygon(o if len(o) > 2 else None).buffer(0.0) for o in (convex, ring)]
    return shapes[0].area, shapes[1].area, shapes[0].intersection(shapes[1]).area

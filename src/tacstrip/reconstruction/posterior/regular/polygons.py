"""Rectangles with corners from sharp to round, and trapezoids: convex polygons swept by discs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruction.posterior.regular.kinds import (
    FIRST,
    FLATTEST,
    RATIO,
    RECTANGLE,
    SECOND,
    TRAPEZOID,
    TURN,
    TURNED,
    Floats,
)

_NONE = 1e-30  # length that an edge without any counts as


@dataclass(frozen=True, eq=False)
class Polygons:
    """Convex polygons, counter-clockwise, swept by discs: corners x, y (K, 4) and radii (K,), in own units."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> Polygons:
        """Return the outlines that numbers (K, 8) make, of kinds (K,)."""
        high = np.exp(math.log(FLATTEST) - z[:, RATIO] * math.log(FLATTEST**2))
        turned = (kind == TURNED) | (kind == RECTANGLE)
        quarter = np.where(kind == TRAPEZOID, 0.5 * np.pi * np.floor(4.0 * z[:, TURN]), 0.0)
        turn = np.where(turned, 2.0 * np.pi * z[:, TURN], quarter)
        rectangle = kind < TRAPEZOID
        # Corners are sharp in a quarter of the rectangles, and ends half discs in a few.
        radius = np.where(rectangle, np.clip(1.5 * z[:, FIRST] - 0.4, 0.0, 1.0) * np.minimum(1.0, high), 0.0)
        a, b, top = 1.0 - radius, high - radius, 0.2 + 1.6 * z[:, FIRST]
        begin = np.where(rectangle, -a, -1.6 + (3.2 - top) * z[:, SECOND])
        end = np.where(rectangle, a, begin + top)
        x, y = np.stack([-a, a, end, begin], axis=1), np.stack([-b, -b, b, b], axis=1)
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        return cls(c * x - s * y, s * x + c * y, radius)

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Least and greatest x, least and greatest y (K,)."""
        x, y, r = self.x, self.y, self.radius
        return x.min(axis=1) - r, x.max(axis=1) + r, y.min(axis=1) - r, y.max(axis=1) + r

    @property
    def marks(self) -> FloatArray:
        """Where edges begin and end (K, 8)."""
        dx, dy = (np.roll(v, -1, axis=1) - v for v in (self.x, self.y))
        off = self.radius[:, None] * dy / (np.hypot(dx, dy) + _NONE)
        return np.concatenate([self.x + off, self.x + off + dx], axis=1)

    def ends(self, at: Floats) -> tuple[Floats, Floats]:
        """Return the lowest and highest y (K, G) at x (K, G); inf and -inf outside."""
        x, y, r = (v.astype(at.dtype) for v in (self.x, self.y, self.radius[:, None]))
        low, high = np.full_like(at, np.inf), np.full_like(at, -np.inf)
        for i in range(4):
            x0, y0 = x[:, i, None], y[:, i, None]
            dx, dy = x[:, (i + 1) % 4, None] - x0, y[:, (i + 1) % 4, None] - y0
            length = np.hypot(dx, dy) + _NONE
            from_x = x0 + r * dy / length
            upright = np.abs(dx) < 1e-6 * length
            line = y0 - r * dx / length + dy / np.where(upright, 1.0, dx) * (at - from_x)
            first, last = from_x + np.minimum(dx, 0.0), from_x + np.maximum(dx, 0.0)
            on = (at > first - 1e-6) & (at < last + 1e-6) & ~upright
            np.minimum(low, np.where(on & (dx > 0.0), line, np.inf), out=low)
            np.maximum(high, np.where(on & (dx < 0.0), line, -np.inf), out=high)
            if r.any():
                square = r**2 - (at - x0) ** 2
                half = np.where(square >= 0.0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
                np.minimum(low, y0 - half, out=low)
                np.maximum(high, y0 + half, out=high)
        return low, high

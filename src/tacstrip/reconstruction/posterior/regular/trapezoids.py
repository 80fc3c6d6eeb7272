"""Trapezoids, upright or turned: parallelograms and triangles nearly, too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruction.posterior.regular.kinds import (
    FIRST,
    SECOND,
    TRAPEZOID,
    TURN,
    as_columns,
    axes_ratio,
)

_UPRIGHT = 1e-6  # of an edge's length: it goes along y


@dataclass(frozen=True, eq=False)
class Trapezoids:
    """Corners x, y (K, 4), counter-clockwise."""

    x: FloatArray
    y: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> Trapezoids:
        """Return the outlines that numbers (K, 8) make, of kinds (K,)."""
        high, top = axes_ratio(z)[:, None], 0.2 + 1.6 * z[:, FIRST]
        quarters = np.where(kind == TRAPEZOID, np.floor(4.0 * z[:, TURN]), 4.0 * z[:, TURN])
        begin = -1.6 + (3.2 - top) * z[:, SECOND]
        one = np.ones(len(z))
        x, y = np.stack([-one, one, begin + top, begin], axis=1), high * (-1.0, -1.0, 1.0, 1.0)
        c, s = np.cos(0.5 * np.pi * quarters)[:, None], np.sin(0.5 * np.pi * quarters)[:, None]
        return cls(c * x - s * y, s * x + c * y)

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Least and greatest x, least and greatest y (K,)."""
        return self.x.min(axis=1), self.x.max(axis=1), self.y.min(axis=1), self.y.max(axis=1)

    @property
    def marks(self) -> FloatArray:
        """Where edges begin and end (K, 4)."""
        return self.x

    def ends(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest y (K, G) at x (K, G) within the extent: of the lines of lower, upper edges."""
        dx, dy = (np.roll(v, -1, axis=1) - v for v in (self.x, self.y))
        upright = np.abs(dx) < _UPRIGHT * np.hypot(dx, dy)
        slopes = dy / np.where(upright, np.inf, dx)
        below, above = (
            np.where(~upright & (side * dx > 0.0), self.y, -side * np.inf) for side in (1.0, -1.0)
        )
        low, high = np.full_like(at, -np.inf), np.full_like(at, np.inf)
        for i in range(4):
            x, slope, lower, upper = as_columns(*(v[:, i] for v in (self.x, slopes, below, above)))
            rise = slope * (at - x)
            np.maximum(low, lower + rise, out=low)
            np.minimum(high, upper + rise, out=high)
        return low, high

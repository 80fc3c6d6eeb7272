"""Rectangles, upright or turned, with corners from sharp to round: what a disc sweeps over a core."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruction.posterior.regular.kinds import (
    FIRST,
    RECTANGLE,
    TURN,
    as_columns,
    axes_ratio,
)

_UPRIGHT = 1e-6  # cosine of an edge that adds nothing to its ends


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Cores about 0 of half axes a, b (K,), the first one along (c, s), both 0 or more, and the discs' radii (K,)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    s: FloatArray
    radius: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> Rectangles:
        """Return the outlines that numbers (K, 8) make, of kinds (K,)."""
        high = axes_ratio(z)
        quarters = np.where(kind == RECTANGLE, 4.0 * z[:, TURN], 0.0)
        turn, lies = 0.5 * np.pi * (quarters % 1.0), quarters % 2.0 < 1.0
        # Corners are sharp in a quarter of the rectangles, and ends half discs in a few.
        radius = np.clip(1.5 * z[:, FIRST] - 0.4, 0.0, 1.0) * np.minimum(1.0, high)
        a, b = np.where(lies, 1.0, high) - radius, np.where(lies, high, 1.0) - radius
        return cls(a, b, np.cos(turn), np.sin(turn), radius)

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Least and greatest x, least and greatest y (K,)."""
        x = self.a * self.c + self.b * self.s + self.radius
        y = self.a * self.s + self.b * self.c + self.radius
        return -x, x, -y, y

    @property
    def marks(self) -> FloatArray:
        """Where edges begin and end (K, 8)."""
        ac, bs, across, along = self.a * self.c, self.b * self.s, self.radius * self.s, self.radius * self.c
        half = np.stack([bs - ac + across, bs + ac + across, -bs - ac - along, bs - ac - along], axis=1)
        return np.concatenate([half, -half], axis=1)

    def ends(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest y (K, G) at x (K, G); inf and -inf outside."""
        both = self._lower(np.concatenate([at, -at], axis=1))
        return both[:, : at.shape[1]], -both[:, at.shape[1] :]

    def _lower(self, at: FloatArray) -> FloatArray:
        """Return the lowest y (K, G) at x (K, G); inf outside.

        It lies on the disc about that point of a lower edge whose normal meets x, or about the nearer of its ends.
        """
        c, s, r = self.c, self.s, self.radius
        x, y = self.b * s - self.a * c, -self.b * c - self.a * s  # the lowest corner of the core
        low = np.full_like(at, np.inf)
        for along, rise, begin, end, off in (
            (c, s, x, x + 2.0 * self.a * c, r * s),
            (s, -c, x - 2.0 * self.b * s, x, -r * c),
        ):
            tilt = np.where(along > _UPRIGHT, rise / np.maximum(along, _UPRIGHT), 0.0)
            slope, level, first, last, shift, square = as_columns(tilt, y - tilt * x, begin, end, off, r**2)
            middle = np.minimum(np.maximum(at - shift, first), last)
            half = square - (at - middle) ** 2
            disc = slope * middle + level - np.sqrt(np.maximum(half, 0.0))
            np.minimum(low, np.where(half >= 0.0, disc, np.inf), out=low)
        return low

"""Discs, ellipses and segments of discs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruction.posterior.regular.kinds import (
    ELLIPSE,
    FIRST,
    FLATTEST,
    RATIO,
    SEGMENT,
    TURN,
    as_columns,
)


@dataclass(frozen=True, eq=False)
class Ovals:
    """Ellipses about 0, half axes 1 and `flat`, the first one along (c, s), and cut across it at `cut` (K,)."""

    flat: FloatArray
    c: FloatArray
    s: FloatArray
    cut: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> Ovals:
        """Return the outlines that numbers (K, 8) make, of kinds (K,)."""
        turn = np.pi * z[:, TURN] * np.where(kind == SEGMENT, 2.0, 1.0)
        cut = np.where(kind == SEGMENT, -0.6 + 1.5 * z[:, FIRST], 2.0)
        flat = np.where(kind == ELLIPSE, FLATTEST ** z[:, RATIO], 1.0)
        return cls(flat, np.cos(turn), np.sin(turn), cut)

    def _extent(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far they reach back and forth in the direction of these parts along and across the first axis."""
        reach, at = np.hypot(along, self.flat * across), np.minimum(self.cut, 1.0)
        chord, half = at * along, np.abs(self.flat * np.sqrt(1.0 - at**2) * across)
        first = along / reach  # of the farthest point, along the first axis
        return (
            np.where(-first <= self.cut, -reach, chord - half),
            np.where(first <= self.cut, reach, chord + half),
        )

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Least and greatest x, least and greatest y (K,)."""
        return *self._extent(self.c, -self.s), *self._extent(self.s, self.c)

    @property
    def marks(self) -> FloatArray:
        """Where the cut begins and ends (K, 2), within the extent."""
        at = np.minimum(self.cut, 1.0)
        half = self.flat * np.sqrt(1.0 - at**2) * self.s
        return np.stack([at * self.c - half, at * self.c + half], axis=1)

    def ends(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest y (K, G) at x (K, G) within the extent."""
        flat, c, s, cut = as_columns(self.flat, self.c, self.s, self.cut)
        square = c**2 + (flat * s) ** 2
        half = np.sqrt(np.maximum(square - at**2, 0.0)) * (flat / square)
        middle = at * (c * s * (1.0 - flat**2) / square)
        low, high = middle - half, middle + half
        with np.errstate(divide="ignore", invalid="ignore"):
            line = (cut - at * c) / s
        return np.where(s < -1e-6, np.fmax(low, line), low), np.where(s > 1e-6, np.fmin(high, line), high)

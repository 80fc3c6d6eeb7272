"""Where regular outlines lie on the sensor: inside it, or over one of its borders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.posterior.regular.kinds import (
    BORDER,
    LEFT,
    PART,
    RIGHT,
    UPRIGHT,
    Floats,
    Outlines,
)
from tacstrip.reconstruction.posterior.regular.ovals import Ovals
from tacstrip.reconstruction.posterior.regular.polygons import Polygons


@dataclass(frozen=True, eq=False)
class Placed:
    """Outlines (K,) on the sensor, over the strip's length above their lowest point.

    `border` 0 to 3: over the first strip, the last one, the ground end, the other one, by `part` of their extent.
    """

    lower: Floats
    upper: Floats
    there: BoolArray
    left: FloatArray
    right: FloatArray
    height: FloatArray
    border: IntArray
    part: FloatArray


@dataclass(frozen=True, eq=False)
class Placement:
    """Between which x the left end lies, and the right one; which borders can be crossed; width over length."""

    window: tuple[float, float, float, float]
    borders: IntArray
    aspect: float

    @classmethod
    def of(cls, problem: FitProblem, window: tuple[float, float, float, float]) -> Placement:
        """Return what a window leaves; that is between which x the left end lies, and the right one."""
        beyond = 0.5 * problem.pitch - 1e-9  # an end that cannot lie so far out is at the sensor's side
        borders = np.flatnonzero([-window[0] < beyond, window[3] - 1.0 < beyond, True, True])
        return cls(window, borders, problem.width_mm / problem.length_mm)

    def placed(self, some: Outlines, at: Floats) -> Placed:
        """Return outlines at x (G,) or (K, G)."""
        z, (begin, begun, end, ended) = some.z, self.window
        left, right = begin + (begun - begin) * z[:, LEFT], end + (ended - end) * z[:, RIGHT]
        part = 0.1 + 0.4 * z[:, PART]
        border = np.where(some.over, self.borders[(z[:, BORDER] * len(self.borders)).astype(int)], -1)
        whole = (right - left) / (1.0 - part)
        left, right = np.where(border == 0, right - whole, left), np.where(border == 1, left + whole, right)
        lower, upper = (np.empty((len(z), at.shape[-1]), dtype=at.dtype) for _ in range(2))
        height = np.empty(len(z))
        for make, which in ((Ovals, some.kind < UPRIGHT), (Polygons, some.kind >= UPRIGHT)):
            i = np.flatnonzero(which)
            shape = make.of(some.kind[i], z[i])
            first, last, low, high = shape.box
            scale = (last - first) / (right[i] - left[i])
            own = first[:, None] + (np.broadcast_to(at, lower.shape)[i] - left[i, None]) * scale[:, None]
            tall = self.aspect / scale
            ends = shape.ends(own.astype(at.dtype))
            lower[i], upper[i] = ((v - low[:, None]) * tall[:, None] for v in ends)
            height[i] = (high - low) * tall
        there = (at >= left[:, None]) & (at <= right[:, None]) & (upper >= lower)
        return Placed(lower, upper, there, left, right, height, border, part)

    def ends(self, some: Outlines, lowest: FloatArray, at: FloatArray) -> FloatArray:
        """Return l and u (K, 2, G) at x (G,) or (K, G) within the strip; both 0 outside the outline."""
        on = self.placed(some, at)
        ends = np.clip(np.stack([on.lower, on.upper], axis=1) + lowest[:, None, None], 0.0, 1.0)
        return np.where(on.there[:, None], ends, 0.0)

    def shape(self, one: Outlines) -> Ovals | Polygons:
        """Return outlines of one kind in their own units."""
        return (Ovals if one.kind[0] < UPRIGHT else Polygons).of(one.kind, one.z)

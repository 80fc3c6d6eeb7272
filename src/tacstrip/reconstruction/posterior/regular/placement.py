"""Where regular outlines lie on the sensor: inside it, or over one of its borders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import RegularPlace
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.posterior.regular.kinds import (
    BORDER,
    DISC,
    LEFT,
    PART,
    RIGHT,
    TRAPEZOID,
    UPRIGHT,
    Outlines,
    as_columns,
)
from tacstrip.reconstruction.posterior.regular.ovals import Ovals
from tacstrip.reconstruction.posterior.regular.rectangles import Rectangles
from tacstrip.reconstruction.posterior.regular.trapezoids import Trapezoids

_FAMILIES = (Ovals, Rectangles, Trapezoids)
_FIRST = (DISC, UPRIGHT, TRAPEZOID)  # kinds of each


@dataclass(frozen=True, eq=False)
class Placed:
    """Outlines (K,) on the sensor, over the strip's length above their lowest point.

    `border` 0 to 3: over the first strip, the last one, the ground end, the other one, by `part` of their extent.
    """

    lower: FloatArray
    upper: FloatArray
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

    @property
    def compiled(self) -> RegularPlace:
        """The same for the compiled core."""
        place = RegularPlace(self.window, self.aspect, len(self.borders))
        place.border[: len(self.borders)] = self.borders.tolist()
        return place

    def placed(self, some: Outlines, at: FloatArray) -> Placed:
        """Return outlines at x (G,) or (K, G)."""
        z, (begin, begun, end, ended) = some.z, self.window
        left, right = begin + (begun - begin) * z[:, LEFT], end + (ended - end) * z[:, RIGHT]
        part = 0.1 + 0.4 * z[:, PART]
        border = np.where(some.over, self.borders[(z[:, BORDER] * len(self.borders)).astype(int)], -1)
        whole = (right - left) / (1.0 - part)
        left, right = np.where(border == 0, right - whole, left), np.where(border == 1, left + whole, right)
        lower, upper = (np.empty((len(z), at.shape[-1])) for _ in range(2))
        height, at = np.empty(len(z)), np.broadcast_to(at, lower.shape)
        family = np.searchsorted(_FIRST, some.kind, side="right") - 1
        for i in (np.flatnonzero(family == f) for f in range(len(_FAMILIES))):
            if not len(i):
                continue
            shape = _shape(some.at(i))
            first, last, low, high = shape.box
            scale = (last - first) / (right[i] - left[i])
            tall = self.aspect / scale
            height[i] = tall * (high - low)
            along, offset, rise, base = as_columns(scale, first - scale * left[i], tall, tall * low)
            for found, y in zip((lower, upper), shape.ends(along * at[i] + offset), strict=True):
                found[i] = rise * y - base
        from_x, to_x = as_columns(left, right)
        there = (at >= from_x) & (at <= to_x) & (upper >= lower)
        return Placed(lower, upper, there, left, right, height, border, part)

    def ends(self, some: Outlines, lowest: FloatArray, at: FloatArray) -> FloatArray:
        """Return l and u (K, 2, G) at x (G,) or (K, G) within the strip; both 0 outside the outline."""
        on = self.placed(some, at)
        ends = np.clip(np.stack([on.lower, on.upper], axis=1) + lowest[:, None, None], 0.0, 1.0)
        return np.where(on.there[:, None], ends, 0.0)

    def marks(self, one: Outlines) -> FloatArray:
        """Return the x (M,) where edges of a single outline begin and end."""
        shape, on = _shape(one), self.placed(one, np.zeros(0))
        first, last = shape.box[:2]
        return np.asarray(on.left + (on.right - on.left) * (shape.marks[0] - first) / (last - first))


def _shape(some: Outlines) -> Ovals | Rectangles | Trapezoids:
    """Return outlines of one family in their own units."""
    family = int(np.searchsorted(_FIRST, some.kind[0], side="right")) - 1
    return _FAMILIES[family].of(some.kind, some.z)

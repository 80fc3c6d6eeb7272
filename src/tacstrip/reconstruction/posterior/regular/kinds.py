"""Kinds of regular outlines, and the numbers that make one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray

KINDS = (
    "disc",
    "ellipse",
    "segment of a disc",
    "upright rectangle",
    "rectangle",
    "upright trapezoid",
    "trapezoid",
)
DISC, ELLIPSE, SEGMENT, UPRIGHT, RECTANGLE, TRAPEZOID, TURNED = range(7)
# Numbers uniform in 0 to 1: the ends, ratio of the axes, turn, two of the kind, and which part is over which border.
NUMBERS = 8
LEFT, RIGHT, RATIO, TURN, FIRST, SECOND, PART, BORDER = range(NUMBERS)
FLATTEST = 0.35  # ratio of the axes


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines by kind (K,), whether over a border (K,), and their numbers (K, 8)."""

    kind: IntArray
    over: BoolArray
    z: FloatArray

    def at(self, which: IntArray) -> Outlines:
        """Return some of them."""
        return Outlines(self.kind[which], self.over[which], self.z[which])


def axes_ratio(z: FloatArray) -> FloatArray:
    """Return the ratio of the axes (K,) by numbers (K, 8), that of height to width."""
    return np.exp(math.log(FLATTEST) * (1.0 - 2.0 * z[:, RATIO]))


def as_columns(*numbers: FloatArray) -> tuple[FloatArray, ...]:
    """Return numbers of outlines (K,) as columns (K, 1)."""
    return tuple(v[:, None] for v in numbers)

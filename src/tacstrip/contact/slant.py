"""What a slanted edge of the contact reads on a strip of some width: further out than its mean position."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.contact.resistive_ends import ResistiveEnds

PARTS = 16  # of a strip's width
_ANGLES = 512  # of the table of shifts
STEEPEST = 16.0  # slope that is solved for, with contact resistance
_STEEPER = 50.0  # in the table
_NODES = 16  # slopes that are solved for
_AWAY, _AWAY_LAMBDA = 3.0, 20.0  # widths and lambdas between an edge and what else there is


def slant_shift(slope: npt.ArrayLike, decay: float = 0.0) -> FloatArray:
    """Return how far a contact reads beyond its edge's mean position, over the strip width: (...).

    Parameters
    ----------
    slope
        dy/dx of a straight edge that crosses the whole width (...).
    decay
        lambda over the strip width b. What a straight edge loses by it, lambda, is not in the shift.

    Notes
    -----
    Under ideal contact it is exact, by mapping the strip with its slanted end onto one with a straight end (Schwarz
    and Christoffel): with a = 1/2 - arctan(slope) / pi, -(gamma + ln 4 + (psi(a) + psi(1 - a)) / 2) / pi. It is .271
    slope^2 where that is small, ln 2 / pi at 45 degrees, and ln 4 / pi = .441 below the edge's furthest point,
    slope / 2, where that is large. With contact resistance it is less, and solved for (`resistive_ends`) at some
    slopes up to 16, between which it is interpolated: within 5e-4 b. Beyond, how far from the furthest point it
    reads goes on with a power of the slope.
    """
    steep = np.abs(np.asarray(slope, dtype=float))
    if decay <= 0.0:
        a = 0.5 - np.arctan(steep) / np.pi
        return np.asarray(-(np.euler_gamma + np.log(4.0) + 0.5 * (_digamma(a) + _digamma(1.0 - a))) / np.pi)
    return np.asarray(0.5 * steep + _below_furthest(steep, decay))


def _below_furthest(steep: FloatArray, decay: float) -> FloatArray:
    """Return how far beyond the edge's furthest point it reads (...), which is negative."""
    within = np.minimum(steep, STEEPEST)
    at = 2.0 * np.arcsinh(within) / np.arcsinh(STEEPEST) - 1.0
    coefficients, power = _solved(decay)
    found = within * np.polynomial.chebyshev.chebval(at, coefficients)
    return np.asarray(found * np.maximum(steep / STEEPEST, 1.0) ** power)


@lru_cache(maxsize=8)
def _solved(decay: float) -> tuple[FloatArray, float]:
    """Return Chebyshev coefficients of that over the slope, in arsinh(slope), and its power at the steepest."""
    node = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    slope = np.sinh(0.5 * (node + 1.0) * np.arcsinh(STEEPEST))
    away = _AWAY + _AWAY_LAMBDA * decay
    edges = [[[(0.0, away), (1.0, away)], [(1.0, 2.0 * away + s), (0.0, 2.0 * away)]] for s in slope]
    ends = ResistiveEnds.on(np.array(edges), 3.0 * away + STEEPEST, decay).ends
    below = ends[1] - 2.0 * away - slope
    coefficients = np.polynomial.chebyshev.chebfit(node, below / slope, _NODES - 1)
    (steep, steeper), (low, high) = np.log(slope[1::-1]), np.log(-below[1::-1])
    return np.asarray(coefficients), float((high - low) / (steeper - steep))


def _digamma(x: FloatArray) -> FloatArray:
    """Return the digamma function of x > 0 by its recurrence and series: SciPy's takes half a second to import."""
    with np.errstate(divide="ignore"):
        below = sum(1.0 / (x + i) for i in range(8))
    far = x + 8.0
    z, series = 1.0 / far**2, np.zeros_like(far)
    for term in (691.0 / 32760.0, -1.0 / 132.0, 1.0 / 240.0, -1.0 / 252.0, 1.0 / 120.0, -1.0 / 12.0):
        series = (series + term) * z
    return np.asarray(np.log(far) - 0.5 / far + series - below)


def edge_read(height: FloatArray, width_mm: float, sign: float, contact_lambda_mm: float) -> FloatArray:
    """Return where ideal contact on a thin strip would end that reads like an edge across the width (...) [mm].

    Parameters
    ----------
    height
        The edge at the borders of equal parts of the width (..., parts + 1) [mm]; NaN where nothing touches.
    width_mm, contact_lambda_mm
        Of the strip.
    sign
        1.0 for an upper edge, -1.0 for a lower one: which way the contact reads beyond its edge.
    """
    parts = height.shape[-1] - 1
    angle, table = _table(contact_lambda_mm / width_mm)
    slope = np.abs(np.diff(height, axis=-1)) * (parts / width_mm)
    shift = 0.5 * slope + np.interp(np.arctan(slope), angle, table)
    middle = 0.5 * (height[..., 1:] + height[..., :-1]) + sign * width_mm * shift
    there = np.isfinite(middle)
    count = there.sum(axis=-1)
    mean = np.where(there, middle, 0.0).sum(axis=-1) / np.maximum(count, 1)
    # Nothing reads further out than the furthest point: an upright side within the strip has no slope to count.
    furthest = np.where(np.isfinite(height), sign * height, -np.inf).max(axis=-1)
    return np.asarray(np.where(count > 0, sign * np.minimum(sign * mean, furthest), np.nan))


@lru_cache(maxsize=8)
def _table(decay: float) -> tuple[FloatArray, FloatArray]:
    """Return angles, and how far from the edge's furthest point, over the width, such edges read: that is smooth."""
    angle = np.linspace(0.0, np.arctan(_STEEPER), _ANGLES)
    slope = np.tan(angle)
    return angle, slant_shift(slope, decay) - 0.5 * slope

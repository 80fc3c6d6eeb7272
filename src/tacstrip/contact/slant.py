"""What a slanted edge of the contact reads on a strip of some width: further out than its mean position."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray

PARTS = 16  # of a strip's width
_ANGLES = 512  # of the table of shifts
_FLAT = 1e-4  # slope below which an edge is straight
_SPREAD = (12.07, 0.883, 15.39, -1.938)  # fitted to networks, slopes up to 6, lambda / b from .05 to 2


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
    slope / 2, where that is large. With contact resistance the contact conducts the more the wider it covers the strip:
    where potentials are alike across the width an Airy equation, from lambda = b / 2 on within .03 b for slopes up to
    2. Between the two a share of their difference at lambda = 0, fitted to `network.wide`: within .021 b for slopes up
    to 6, .005 b root mean square.
    """
    steep = np.abs(np.asarray(slope, dtype=float))
    a = 0.5 - np.arctan(steep) / np.pi
    ideal = -(np.euler_gamma + np.log(4.0) + 0.5 * (_digamma(a) + _digamma(1.0 - a))) / np.pi
    if decay <= 0.0:
        return np.asarray(ideal)
    steep = np.maximum(steep, _FLAT)
    p, q, r, power = _SPREAD
    share = 1.0 / (1.0 + (p + q / steep) * decay + r * steep**power * decay**2)
    return np.asarray(decay - _alike_across(steep, decay) - (0.5 * steep - ideal) * share)


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
    angle = np.linspace(0.0, np.arctan(50.0), _ANGLES)
    slope = np.tan(angle)
    return angle, slant_shift(slope, decay) - 0.5 * slope


def _alike_across(steep: FloatArray, decay: float) -> FloatArray:
    """Return where an edge reads, from its middle into the contact and over b, potentials alike across the width.

    d'' = c d / lambda^2, with c growing from 0 to 1 over the edge's height h = slope b, and d linear beside the
    contact: an Airy equation over the edge, an exponential beyond. Scaled functions, for h / lambda may be large.
    """
    from scipy.special import airy, airye

    unit = np.cbrt(steep * decay**2)
    t = steep / unit
    ai, ai_slope, bi, bi_slope = airye(t)
    part = -(ai_slope / unit + ai / decay) / (bi_slope / unit + bi / decay) * np.exp(-4.0 / 3.0 * t**1.5)
    ai, ai_slope, bi, bi_slope = airy(0.0)
    return np.asarray(-0.5 * steep - unit * (ai + part * bi) / (ai_slope + part * bi_slope))

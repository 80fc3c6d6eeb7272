"""The signature between two neighbouring vertices: (p x + q) / (r x + s), fitted to the section's strips.

Between vertices l and u are straight, so a signature is a ratio of two straight lines. Three readings
determine it; more average the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.robust import robust_sigma

_ON_STRIP = 1e-9  # pitches: a vertex this near a strip lies on it, and the strip belongs to both sections


@dataclass(frozen=True)
class Section:
    """k(t) = (q + p t) / (1 + r t), t = (x - middle) / half; covariance over the noise's variance."""

    middle: float
    half: float
    coefficients: FloatArray  # q, p, r
    covariance: FloatArray  # (3, 3), rows and columns of what was not fitted are 0
    squared_residuals: float
    strips: int

    @property
    def freedom(self) -> int:
        """Strips beyond the fitted numbers."""
        return max(self.strips - 3, 0)

    def reading(self, x: float) -> tuple[float, float]:
        """Return k at x, and its variance over the noise's."""
        t = (x - self.middle) / self.half
        q, p, r = self.coefficients
        d = 1.0 + r * t
        k = (q + p * t) / d
        gradient = np.array([1.0, t, -k * t]) / d
        return float(k), float(gradient @ self.covariance @ gradient)

    def slope(self, x: float) -> tuple[float, float]:
        """Return dk/dx at x, and its variance over the noise's."""
        t = (x - self.middle) / self.half
        q, p, r = self.coefficients
        d = 1.0 + r * t
        gradient = np.array([-r / d**2, 1.0 / d**2, -(q * d + 2.0 * (p - q * r) * t) / d**3])
        gradient /= self.half
        return float((p - q * r) / d**2 / self.half), float(gradient @ self.covariance @ gradient)


def fit_sections(x: FloatArray, k: FloatArray, transitions: FloatArray, ratio: float) -> list[Section | None]:
    """Fit each section between neighbouring transitions.

    Parameters
    ----------
    x, k
        Centre lines [mm] and readings of the strips in contact (n,).
    transitions
        x of all vertices [mm], ascending (N,).
    ratio
        Resistivity of the sensing layer over the strip's; it bounds r.

    Returns
    -------
    list
        N - 1 sections. One with two strips is straight, with one strip flat, with none it is None.
    """
    pitch = x[1] - x[0] if len(x) > 1 else 1.0
    slack = _ON_STRIP * pitch
    # D = L - (1 - a) w lies between a L and L, a = ratio / (1 + ratio): so does the fitted denominator.
    steepest = 1.0 / (1.0 + 2.0 * ratio)
    inside = [(x >= a - slack) & (x <= b + slack) for a, b in pairwise(transitions)]
    return [_fit(x[m], k[m], steepest) if m.any() else None for m in inside]


def noise_level(sections: list[Section | None]) -> float:
    """Return the noise's standard deviation, from what all sections left over; NaN where nothing was."""
    freedom = sum(s.freedom for s in sections if s)
    squares = sum(s.squared_residuals for s in sections if s)
    return math.sqrt(squares / freedom) if freedom else math.nan


def reading_noise(k: FloatArray) -> float:
    """Return the noise's standard deviation from the second differences of neighbouring readings, robustly."""
    if len(k) < 3:
        return 0.0
    second = np.diff(k, 2)
    return float(robust_sigma(second - np.median(second)) / np.sqrt(6.0))


def _fit(x: FloatArray, k: FloatArray, steepest: float) -> Section:
    n = len(x)
    middle, half = 0.5 * (x[0] + x[-1]), 0.5 * (x[-1] - x[0])
    if n < 3:
        half = half or 1.0
        design = np.stack([np.ones(n), (x - middle) / half], axis=1)[:, :n]
        found = np.linalg.solve(design, k)
        covariance = np.zeros((3, 3))
        covariance[:n, :n] = np.linalg.inv(design.T @ design)
        return Section(middle, half, np.pad(found, (0, 3 - n)), covariance, 0.0, n)
    t = (x - middle) / half
    mean = k.mean()
    # Multiplied out, k - mean = q' + p' t - r (k - mean) t: linear, and well scaled where k hardly varies.
    q, p, r = np.linalg.lstsq(np.stack([np.ones(n), t, -(k - mean) * t], axis=1), k - mean, rcond=1e-13)[0]
    q, p, r = _refine(t, k, np.array([q + mean, p + r * mean, r]), steepest)
    model = (q + p * t) / (1.0 + r * t)
    jacobian = np.stack([np.ones(n), t, -model * t], axis=1) / (1.0 + r * t)[:, None]
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-13, hermitian=True)
    return Section(middle, half, np.array([q, p, r]), covariance, float(((k - model) ** 2).sum()), n)


def _refine(t: FloatArray, k: FloatArray, start: FloatArray, steepest: float) -> FloatArray:
    """Two Gauss-Newton steps on the readings themselves; r is held where it leaves its bounds."""
    c = start
    for _ in range(2):
        c[2] = np.clip(c[2], -0.999 * steepest, 0.999 * steepest)
        d = 1.0 + c[2] * t
        model = (c[0] + c[1] * t) / d
        free = 3 if abs(c[2]) < 0.99 * steepest else 2
        jacobian = np.stack([np.ones_like(t), t, -model * t], axis=1) / d[:, None]
        c[:free] += np.linalg.lstsq(jacobian[:, :free], k - model, rcond=1e-13)[0]
    c[2] = np.clip(c[2], -0.999 * steepest, 0.999 * steepest)
    return c

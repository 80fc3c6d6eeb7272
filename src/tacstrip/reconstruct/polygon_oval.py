"""An oval as a rival of the polygon: five numbers explain a round contact, which no count of vertices fits best.

l and u are c + s t -+ b sqrt(1 - t^2), t from -1 to 1 over the contact: an ellipse in any position. From one
signature the polygon with the fewest vertices that explains an ellipse has a fifth of its area.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.fisher import covariance
from tacstrip.reconstruct.kernels import Data, Model, strip_terms
from tacstrip.reconstruct.polygon_cholesky import cholesky, solve_cholesky
from tacstrip.reconstruct.polygon_compiled import DATA, F1, F2, MODEL, compiled
from tacstrip.reconstruct.polygon_fit import Fit
from tacstrip.reconstruct.polygon_signal import Signal

_STEPS, _ENOUGH, _HOPE = 25, 1e-2, 4.0
PARAMETERS = 3  # that the readings determine; the ends' x have a prior
_POINTS = 20  # interior points of either chain that draw it
_CHORD = math.pi / (_POINTS + 1)  # angle between two of them
_SAME_AREA = _CHORD / math.sin(_CHORD)  # they lie so much further out in y that chords hold the oval's area
_EDGE = 0.03  # sqrt(1 - t^2) of the place nearest to an end where an oval's slope is taken
_LEAST = 1e-9  # added to the normal matrix


@dataclass(frozen=True, eq=False)
class Oval:
    """An ellipse in units of a signal.

    Attributes
    ----------
    parameters
        Left end, right end, height c of the middle, rise s from there to the right end, half-height b (5,).
    cost
        Squared residuals over sigma^2, and what the prior of the ends' x adds.
    information
        J'J by the parameters (5, 5), the prior included.
    """

    parameters: FloatArray
    cost: float
    information: FloatArray

    def residuals(self, signal: Signal) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        left, right, c, s, b = self.parameters
        t = np.clip((2.0 * signal.x - left - right) / (right - left), -1.0, 1.0)
        middle, half = c + s * t, b * np.sqrt(1.0 - t * t)
        k = signal.slopes(np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0))[2]
        return np.asarray((signal.k - k) * np.sqrt(signal.weight))

    def outline(self, signal: Signal) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return lower and upper chain (22, 2) [mm], and the covariance (84, 84) [mm^2] of the 42 vertices."""
        left, right, c, s, b = self.parameters
        t = -np.cos(np.linspace(0.0, np.pi, _POINTS + 2))
        r = _SAME_AREA * np.sqrt(np.maximum(1.0 - t * t, 0.0))
        r[[0, -1]] = 0.0
        x = 0.5 * (left + right) + 0.5 * (right - left) * t
        scale, origin = np.array((signal.width_mm, signal.length_mm)), (signal.origin_mm, 0.0)
        lower, upper = (
            np.stack([x, np.clip(c + s * t + side * b * r, 0.0, 1.0)], axis=1) * scale + origin
            for side in (-1, 1)
        )
        ring_t, ring_r = np.concatenate([t, t[-2:0:-1]]), np.concatenate([-r, r[-2:0:-1]])
        slopes = np.zeros((len(ring_t), 2, 5))
        slopes[:, 0, 0], slopes[:, 0, 1] = 0.5 * (1.0 - ring_t), 0.5 * (1.0 + ring_t)
        slopes[:, 1, 2], slopes[:, 1, 3], slopes[:, 1, 4] = 1.0, ring_t, ring_r
        by = (slopes * scale[:, None]).reshape(-1, 5)
        value, vector = np.linalg.eigh(self.information)
        told = covariance(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T)
        return lower, upper, by @ told @ by.T


def fit_oval(start: Fit, signal: Signal, wanted: float = np.inf) -> Oval:
    """Fit an oval by least squares, from where a polygon was found; in vain if it cannot cost less than `wanted`."""
    l, u = start.ends(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    middle = 0.5 * (l + u)
    rise, half = 0.5 * (middle[4] - middle[0]), min(max(0.5 * float((u - l).max()), 0.15), 0.4)
    height = float(np.clip(middle.mean(), 0.05, 0.95))
    p = np.array([0.0, 1.0, height, rise, half])
    matrix = np.empty((5, 5))
    cost = _descend_oval(p, signal.data, signal.model, wanted, matrix)
    return Oval(p, cost, matrix)


@compiled(f"float64({F1},{DATA},{MODEL},{F2},{F1})")
def _normal_equations(
    p: FloatArray, data: Data, signal: Model, matrix: FloatArray, gradient: FloatArray
) -> float:
    x, k, weight, pitch = data
    shares, narrow, lam = signal
    by_l, by_u = np.empty(5), np.empty(5)
    for i in range(5):
        gradient[i] = 0.0
        for j in range(5):
            matrix[i, j] = 0.0
    a, middle = 0.5 * (p[1] - p[0]), 0.5 * (p[1] + p[0])
    cost = 0.0
    for i in range(len(x)):
        t = min(max((x[i] - middle) / a, -1.0), 1.0)
        r = math.sqrt(max(1.0 - t * t, 0.0))
        bend = p[4] * t / max(r, _EDGE)
        for side in range(2):
            by = by_u if side else by_l
            sign = 1.0 if side else -1.0
            by_t = p[3] - sign * bend
            by[0], by[1] = -by_t * (1.0 - t) * 0.5 / a, -by_t * (1.0 + t) * 0.5 / a
            by[2], by[3], by[4] = 1.0, t, sign * r
        l = min(max(p[2] + p[3] * t - p[4] * r, 0.0), 1.0)
        u = min(max(p[2] + p[3] * t + p[4] * r, l), 1.0)
        for s in range(len(shares)):
            ll, lu, uu, rl, ru, squares = strip_terms(l, u, k[s, i], weight[s, i], shares[s], narrow, lam)
            cost += squares
            for m in range(5):
                gradient[m] += rl * by_l[m] + ru * by_u[m]
                for n in range(m + 1):
                    matrix[m, n] += by_l[m] * (ll * by_l[n] + lu * by_u[n]) + by_u[m] * (
                        lu * by_l[n] + uu * by_u[n]
                    )
    prior = 12.0 / (pitch * pitch)
    for i in range(2):
        matrix[i, i] += prior
        gradient[i] -= prior * (p[i] - i)
        cost += prior * (p[i] - i) ** 2
    for m in range(5):
        for n in range(m):
            matrix[n, m] = matrix[m, n]
    return cost


@compiled(f"float64({F1},{DATA},{MODEL},float64,{F2})")
def _descend_oval(p: FloatArray, data: Data, signal: Model, wanted: float, matrix: FloatArray) -> float:
    """Improve p in place; write J'J at the end to matrix and return the cost."""
    half_pitch = 0.5 * data[3]
    gradient, other_gradient = np.empty(5), np.empty(5)
    other, small, trial, step = np.empty((5, 5)), np.empty((5, 5)), np.empty(5), np.empty(5)
    cost = _normal_equations(p, data, signal, matrix, gradient)
    damping = 1e-3
    for _ in range(_STEPS):
        for i in range(5):
            step[i] = gradient[i]
            for j in range(5):
                small[i, j] = matrix[i, j]
            small[i, i] += damping * matrix[i, i] + _LEAST
        if not cholesky(small, 5):
            break
        solve_cholesky(small, 5, step)
        for i in range(5):
            trial[i] = p[i] + step[i]
        trial[0] = min(max(trial[0], -half_pitch), half_pitch)
        trial[1] = min(max(trial[1], 1.0 - half_pitch), 1.0 + half_pitch)
        trial[2] = min(max(trial[2], 0.0), 1.0)
        room = min(trial[2], 1.0 - trial[2])
        trial[3] = min(max(trial[3], -room), room)
        trial[4] = min(max(trial[4], 0.0), 0.5)
        new = _normal_equations(trial, data, signal, other, other_gradient)
        gain = cost - new
        if gain >= 0.0:
            for i in range(5):
                p[i], gradient[i] = trial[i], other_gradient[i]
                for j in range(5):
                    matrix[i, j] = other[i, j]
            cost = new
            damping = max(0.1 * damping, 1e-9)
            if gain < _ENOUGH or cost - _HOPE * gain > wanted:
                break
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    return cost

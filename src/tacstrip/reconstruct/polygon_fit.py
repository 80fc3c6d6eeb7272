"""A polygon fitted to a signal: its parameters, its chains in millimetres, what it leaves over, how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import ENDS, normal_equations
from tacstrip.reconstruct.outline import Outline
from tacstrip.reconstruct.polygon_signal import Signal


@dataclass(frozen=True, eq=False)
class Fit:
    """An outline in units of a `Signal`, in the layout of `kernels`.

    Attributes
    ----------
    theta
        x, l, u of the left end and of the right end, then x and y of each interior vertex (6 + 2 m,).
    chain
        0: the vertex is on the lower chain, 1: on the upper one (m,).
    blunt
        Whether the left and the right end are vertical edges (2,), 0 or 1.
    cost
        Squared residuals over sigma^2, and what the prior of the ends' x adds.
    """

    theta: FloatArray
    chain: IntArray
    blunt: IntArray
    cost: float

    @property
    def count(self) -> int:
        """Interior vertices, m."""
        return len(self.chain)

    @property
    def corners(self) -> int:
        """Vertices in all."""
        return self.count + 2 + int(self.blunt.sum())

    @property
    def parameters(self) -> int:
        """Numbers that the readings determine; a pointed end's x is not one, its prior comes along."""
        return 2 * self.count + 2 + int(self.blunt.sum())

    @property
    def transitions(self) -> FloatArray:
        """Where all vertices are in x, ends included, ascending (m + 2,), in units of the signal."""
        return np.concatenate([self.theta[:1], self.theta[ENDS::2], self.theta[3:4]])

    @property
    def chains(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper chain (M, 2), (N, 2) in units of the signal, held to l <= u."""
        vertices = self.theta[ENDS:].reshape(-1, 2)
        both = tuple(
            np.concatenate(
                [
                    [[self.theta[0], self.theta[1 + side]]],
                    vertices[self.chain == side],
                    [[self.theta[3], self.theta[4 + side]]],
                ]
            )
            for side in (0, 1)
        )
        for i in (0, -1):  # a vertical edge points up
            both[1][i, 1] = max(both[1][i, 1], both[0][i, 1])
        return both[0], both[1]

    def ends(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return l and u at x, in units of the signal."""
        lower, upper = self.chains
        return np.interp(x, *lower.T), np.interp(x, *upper.T)

    def readings(self, signal: Signal) -> FloatArray:
        """Return the readings that it makes (S, n)."""
        return signal.slopes(*self.ends(signal.x))[2]

    def residuals(self, signal: Signal) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        return np.asarray((signal.k - self.readings(signal)) * np.sqrt(signal.weight))

    def polygon(self, signal: Signal) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain [mm]."""
        scale, origin = (signal.width_mm, signal.length_mm), (signal.origin_mm, 0.0)
        lower, upper = self.chains
        return lower * scale + origin, upper * scale + origin

    @classmethod
    def of(cls, outline: Outline, signal: Signal) -> Fit:
        """Return an outline [mm] in units of a signal, not fitted: a start, or the truth to compare with."""
        scale, origin = np.array((signal.width_mm, signal.length_mm)), (signal.origin_mm, 0.0)
        lower, upper = ((c - origin) / scale for c in (outline.lower, outline.upper))
        inner = np.concatenate([lower[1:-1], upper[1:-1]])
        chain = np.repeat((0, 1), (len(lower) - 2, len(upper) - 2))
        order = np.argsort(inner[:, 0], kind="stable")
        ends = (*lower[0], upper[0, 1], *lower[-1], upper[-1, 1])
        blunt = np.array((ends[1] != ends[2], ends[4] != ends[5]), dtype=np.int64)
        return cls(np.concatenate([ends, inner[order].ravel()]), chain[order], blunt, np.inf)


def fit_of(theta: FloatArray, chain: IntArray, m: int, blunt: IntArray, cost: float) -> Fit:
    """Copy a fit of m vertices out of the search's arrays."""
    return Fit(theta[: ENDS + 2 * m].copy(), chain[:m].copy(), blunt.copy(), cost)


def information_root(fit: Fit, signal: Signal) -> FloatArray:
    """Return R (2 V, 2 V) with R'R = J'J, J the slopes of all readings over sigma by `vertices.ravel()` [mm]."""
    size = ENDS + 2 * fit.count
    matrix, gradient = np.empty((size, size)), np.empty(size)
    normal_equations(fit.theta, fit.chain, fit.count, fit.blunt, signal.data, signal.model, matrix, gradient)
    return _root(matrix, fit, signal)


def _root(matrix: FloatArray, fit: Fit, signal: Signal) -> FloatArray:
    interior = [ENDS + 2 * np.flatnonzero(fit.chain == side) for side in (0, 1)]
    x_of_upper_end = -1  # it has the lower one's x
    places = [(0, 1), *((i, i + 1) for i in interior[0]), (3, 4)]
    places += [(x_of_upper_end, 5)] * int(fit.blunt[1])
    places += [(i, i + 1) for i in interior[1][::-1]]
    places += [(x_of_upper_end, 2)] * int(fit.blunt[0])
    flat = np.array(places).ravel()
    scale = np.tile([signal.width_mm, signal.length_mm], len(places))
    told = np.outer(flat >= 0, flat >= 0)
    value, vector = np.linalg.eigh(np.where(told, matrix[np.ix_(flat, flat)], 0.0))
    return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T / scale)


def untangled(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both chains (M, 2), (N, 2) with no part of the lower one above the upper one: noise can cross them."""
    lower, upper = lower.copy(), upper.copy()
    lower[1:-1, 1] = np.minimum(lower[1:-1, 1], np.interp(lower[1:-1, 0], *upper.T))
    upper[1:-1, 1] = np.maximum(upper[1:-1, 1], np.interp(upper[1:-1, 0], *lower.T))
    return lower, upper


def thickness(lower: FloatArray, upper: FloatArray) -> float:
    """Return the greatest distance in y between both chains."""
    x = np.union1d(lower[:, 0], upper[:, 0])
    return float((np.interp(x, *upper.T) - np.interp(x, *lower.T)).max())

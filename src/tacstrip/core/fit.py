"""A polygon in units of a signal: what a search finds, and what tracking goes on with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported
from tacstrip.core.problem import Signal

ENDS = 6  # entries of theta before the first vertex
MOST = 16  # interior vertices
SIZE = ENDS + 2 * MOST

# `Polygon` of core.h.
POLYGON = np.dtype(
    [
        ("m", np.int64),
        ("vertical", np.int64, 2),
        ("upper", np.int64, MOST),
        ("theta", np.float64, SIZE),
        ("cost", np.float64),
        ("score", np.float64),
    ]
)


class Chains(Protocol):
    """An outline's lower and upper chain (M, 2), (N, 2) [mm]."""

    @property
    def lower(self) -> FloatArray: ...  # noqa: D102

    @property
    def upper(self) -> FloatArray: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Fit:
    """An outline in units of a `Signal`: x from 0 to 1 over the run, y from 0 to 1 over the strip.

    Attributes
    ----------
    theta
        x, l, u of the left end and of the right end, then x and y of each interior vertex, ascending in x
        (6 + 2 m,). A pointed end has one height: its u follows its l.
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
        return self.count + 2 + int(self.blunt[0] + self.blunt[1])

    @property
    def parameters(self) -> int:
        """Numbers that the readings determine; a pointed end's x is not one, its prior comes along."""
        return 2 * self.count + 2 + int(self.blunt[0] + self.blunt[1])

    @property
    def transitions(self) -> FloatArray:
        """Where all vertices are in x, ends included, ascending (m + 2,), in units of the signal."""
        return np.concatenate([self.theta[:1], self.theta[ENDS::2], self.theta[3:4]])

    @property
    def chains(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper chain (M, 2), (N, 2) in units of the signal, held to l <= u."""
        vertices = self.theta[ENDS:].reshape(-1, 2)
        both = []
        for side in (0, 1):
            inner = vertices[self.chain == side]
            chain = np.empty((len(inner) + 2, 2))
            chain[0], chain[1:-1], chain[-1] = self.theta[[0, 1 + side]], inner, self.theta[[3, 4 + side]]
            both.append(chain)
        for i in (0, -1):  # a vertical edge points up
            both[1][i, 1] = max(both[1][i, 1], both[0][i, 1])
        return both[0], both[1]

    def ends(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return l and u at x, in units of the signal."""
        lower, upper = self.chains
        return np.interp(x, *lower.T), np.interp(x, *upper.T)

    def readings(self, signal: Signal) -> FloatArray:
        """Return the readings that it makes (S, n)."""
        return signal.readings_of(*self.ends(signal.x))

    def residuals(self, signal: Signal) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        core = exported("residuals")
        if core is None or self.count > MOST:
            return np.asarray((signal.k - self.readings(signal)) * signal.root_weight)
        record, found = self.record, np.empty(signal.k.shape)
        core(signal.problem, at(record), at(found))
        return found

    def polygon(self, signal: Signal) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain [mm]."""
        scale, origin = (signal.width_mm, signal.length_mm), (signal.origin_mm, 0.0)
        lower, upper = self.chains
        return lower * scale + origin, upper * scale + origin

    @classmethod
    def of(cls, outline: Chains, signal: Signal) -> Fit:
        """Return an outline [mm] in units of a signal, not fitted: a start, or the truth to compare with."""
        scale, origin = np.array((signal.width_mm, signal.length_mm)), (signal.origin_mm, 0.0)
        lower, upper = ((c - origin) / scale for c in (outline.lower, outline.upper))
        inner = np.concatenate([lower[1:-1], upper[1:-1]])
        chain = np.repeat((0, 1), (len(lower) - 2, len(upper) - 2))
        order = np.argsort(inner[:, 0], kind="stable")
        ends = (*lower[0], upper[0, 1], *lower[-1], upper[-1, 1])
        blunt = np.array((ends[1] != ends[2], ends[4] != ends[5]), dtype=np.int64)
        return cls(np.concatenate([ends, inner[order].ravel()]), chain[order], blunt, np.inf)

    @classmethod
    def of_record(cls, record: npt.NDArray[np.void]) -> Fit:
        """Return a copy of what the compiled core left in a `POLYGON` (1,)."""
        m = int(record["m"][0])
        theta, upper = record["theta"][0, : ENDS + 2 * m], record["upper"][0, :m]
        return cls(theta.copy(), upper.copy(), record["vertical"][0].copy(), float(record["cost"][0]))

    @property
    def record(self) -> npt.NDArray[Any]:
        """A copy for the compiled core: a `POLYGON` (1,); there may be MOST vertices."""
        record, m = np.zeros(1, POLYGON), self.count
        record["m"], record["vertical"] = m, self.blunt
        record["theta"][0, : ENDS + 2 * m], record["upper"][0, :m] = self.theta, self.chain
        record["cost"] = self.cost
        return record

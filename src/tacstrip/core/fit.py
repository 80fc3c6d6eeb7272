"""A polygon in units of a problem: what a search finds, and what tracking goes on with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported
from tacstrip.core.problem import FitProblem

END_ENTRIES = 6  # entries of theta before the first vertex
MAX_VERTICES = 16  # interior vertices
SIZE = END_ENTRIES + 2 * MAX_VERTICES

# `Polygon` of core.h.
POLYGON = np.dtype(
    [
        ("m", np.int64),
        ("vertical", np.int64, 2),
        ("upper", np.int64, MAX_VERTICES),
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
class PolygonFit:
    """An outline in units of a `FitProblem`: x from 0 to 1 over the run, y from 0 to 1 over the strip.

    Attributes
    ----------
    theta
        x, l, u of the left end and of the right end, then x and y of each interior vertex, ascending in x
        (6 + 2 m,). A pointed end has one height: its u follows its l.
    chain
        0: the vertex is on the lower chain, 1: on the upper one (m,).
    vertical_ends
        Whether the left and the right end are vertical edges (2,), 0 or 1.
    cost
        Squared residuals over sigma^2, and what the prior of the ends' x adds.
    """

    theta: FloatArray
    chain: IntArray
    vertical_ends: IntArray
    cost: float

    @property
    def n_interior(self) -> int:
        """Interior vertices, m."""
        return len(self.chain)

    @property
    def n_vertices(self) -> int:
        """Vertices in all."""
        return self.n_interior + 2 + int(self.vertical_ends[0] + self.vertical_ends[1])

    @property
    def parameters(self) -> int:
        """Numbers that the readings determine; a pointed end's x is not one, its prior comes along."""
        return 2 * self.n_interior + 2 + int(self.vertical_ends[0] + self.vertical_ends[1])

    @property
    def transitions(self) -> FloatArray:
        """Where all vertices are in x, ends included, ascending (m + 2,), in units of the problem."""
        return np.concatenate([self.theta[:1], self.theta[END_ENTRIES::2], self.theta[3:4]])

    @property
    def chains(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper chain (M, 2), (N, 2) in units of the problem, held to l <= u."""
        vertices = self.theta[END_ENTRIES:].reshape(-1, 2)
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
        """Return l and u at x, in units of the problem."""
        lower, upper = self.chains
        return np.interp(x, *lower.T), np.interp(x, *upper.T)

    def readings(self, problem: FitProblem) -> FloatArray:
        """Return the readings that it makes (S, n)."""
        return problem.readings_of(*self.ends(problem.x))

    def residuals(self, problem: FitProblem) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        core = exported("residuals")
        if core is None or self.n_interior > MAX_VERTICES:
            return np.asarray((problem.k - self.readings(problem)) * problem.root_weight)
        record, found = self.record, np.empty(problem.k.shape)
        core(problem.compiled, at(record), at(found))
        return found

    def polygon(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain [mm]."""
        scale, origin = (problem.width_mm, problem.length_mm), (problem.origin_mm, 0.0)
        lower, upper = self.chains
        return lower * scale + origin, upper * scale + origin

    @classmethod
    def of(cls, outline: Chains, problem: FitProblem) -> PolygonFit:
        """Return an outline [mm] in units of a problem, not fitted: a start, or the truth to compare with."""
        scale, origin = np.array((problem.width_mm, problem.length_mm)), (problem.origin_mm, 0.0)
        lower, upper = ((c - origin) / scale for c in (outline.lower, outline.upper))
        inner = np.concatenate([lower[1:-1], upper[1:-1]])
        chain = np.repeat((0, 1), (len(lower) - 2, len(upper) - 2))
        order = np.argsort(inner[:, 0], kind="stable")
        ends = (*lower[0], upper[0, 1], *lower[-1], upper[-1, 1])
        vertical_ends = np.array((ends[1] != ends[2], ends[4] != ends[5]), dtype=np.int64)
        return cls(np.concatenate([ends, inner[order].ravel()]), chain[order], vertical_ends, np.inf)

    @classmethod
    def of_record(cls, record: npt.NDArray[np.void]) -> PolygonFit:
        """Return a copy of what the compiled core left in a `POLYGON` (1,)."""
        m = int(record["m"][0])
        theta, upper = record["theta"][0, : END_ENTRIES + 2 * m], record["upper"][0, :m]
        return cls(theta.copy(), upper.copy(), record["vertical"][0].copy(), float(record["cost"][0]))

    @property
    def record(self) -> npt.NDArray[Any]:
        """A copy for the compiled core: a `POLYGON` (1,); there may be MAX_VERTICES vertices."""
        record, m = np.zeros(1, POLYGON), self.n_interior
        record["m"], record["vertical"] = m, self.vertical_ends
        record["theta"][0, : END_ENTRIES + 2 * m], record["upper"][0, :m] = self.theta, self.chain
        record["cost"] = self.cost
        return record

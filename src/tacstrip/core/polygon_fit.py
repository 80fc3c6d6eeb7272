"""A polygon fitted to a run of strips: what a search finds, and what tracking goes on with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import END_ENTRIES, MAX_VERTICES, POLYGON, at, exported
from tacstrip.core.cost import normal_equations
from tacstrip.core.descent import descend
from tacstrip.core.problem import FitProblem
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.geometry.outline import Outline, uncrossed
from tacstrip.sensor.spec import Sensor

_FINE, _SETTLED = 40, 1e-4  # steps of a last descent, and the gain in chi square that ends it
_CLOSED = 1e-12  # of the strip length
_APART = 1e-6  # of the run: vertices of a chain
_TOLD = 6.0  # deviations of a strip's readings between two edges: less, and either explains them


@dataclass(frozen=True, eq=False)
class PolygonFit:
    """A polygon as outline model, in units of a `FitProblem`: x from 0 to 1 over the run, y from 0 to 1 over the strip.

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

    @classmethod
    def fitted(cls, start: PolygonFit, problem: FitProblem) -> PolygonFit:
        """Return the least-squares polygon near an outline: `refine`."""
        return refine(start, problem)

    @property
    def n_interior(self) -> int:
        """Interior vertices, m."""
        return len(self.chain)

    @property
    def n_vertices(self) -> int:
        """Vertices in all."""
        return self.n_interior + 2 + int(self.vertical_ends[0] + self.vertical_ends[1])

    @property
    def n_parameters(self) -> int:
        """Numbers that the readings determine; a pointed end's x is not one, its prior comes along."""
        return 2 * self.n_interior + 2 + int(self.vertical_ends[0] + self.vertical_ends[1])

    @property
    def kind(self) -> str:
        """What it is called."""
        return "polygon"

    @property
    def complexity(self) -> int:
        """Interior vertices, m."""
        return self.n_interior

    @property
    def transitions(self) -> FloatArray:
        """Where all vertices are in x, ends included, ascending (m + 2,), in units of the problem."""
        return np.concatenate([self.theta[:1], self.theta[END_ENTRIES::2], self.theta[3:4]])

    @cached_property
    def chains(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper chain (M, 2), (N, 2) in units of the problem, held to l <= u."""
        return self._compiled_chains() or self.plain_chains()

    def plain_chains(self) -> tuple[FloatArray, FloatArray]:
        """Return `chains`, in NumPy."""
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

    def chains_mm(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain (M, 2), (N, 2) [mm]; where noise crossed them they touch instead."""
        made = self._compiled_chains(problem.origin_mm, problem.width_mm, problem.length_mm, True)
        return made or self.plain_chains_mm(problem)

    def plain_chains_mm(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return `chains_mm`, in NumPy."""
        scale, origin = (problem.width_mm, problem.length_mm), (problem.origin_mm, 0.0)
        lower, upper = self.plain_chains()
        return uncrossed(lower * scale + origin, upper * scale + origin)

    def _compiled_chains(
        self, origin: float = 0.0, width: float = 1.0, length: float = 1.0, apart: bool = False
    ) -> tuple[FloatArray, FloatArray] | None:
        core, record = exported("chains"), self.__dict__.get("record")
        if core is None or record is None:  # without one NumPy is as fast
            return None
        points = np.empty((self.n_interior + 4, 2))
        split, first = self.n_interior - int(np.count_nonzero(self.chain)) + 2, at(points)
        core(at(record), origin, width, length, apart, first, first + split * points.strides[0])
        return points[:split], points[split:]

    def information(self, problem: FitProblem) -> FloatArray:
        """Return J'J (6 + 2 m, 6 + 2 m), J the Jacobian of all readings over sigma by theta."""
        core = exported("normal_equations")
        if core is None:
            batch = self.theta[None], self.chain[None], self.vertical_ends
            return np.asarray(normal_equations(*batch, problem, prior=False)[1][0])
        size = len(self.theta)
        matrix, gradient, record = np.empty((size, size)), np.empty(size), self.record
        core(problem.compiled, at(record), 0, at(matrix), at(gradient))
        return matrix

    def information_root(self, problem: FitProblem) -> FloatArray:
        """Return R (2 V, 2 V) with R'R = J'J, J the Jacobian of all readings over sigma by `vertices.ravel()` [mm]."""
        entries = self._vertex_entries()
        repeated = np.zeros(len(entries), dtype=bool)
        for end, place in ((1, 2 * (self.chain == 0).sum() + 4), (0, len(entries) - 2)):
            if self.vertical_ends[end]:
                repeated[place] = True  # the upper vertex of a vertical edge has the lower one's x
        scale = np.tile([problem.width_mm, problem.length_mm], len(entries) // 2)
        own = np.outer(~repeated, ~repeated)
        matrix = self.information(problem)[np.ix_(entries, entries)]
        value, vector = np.linalg.eigh(np.where(own, matrix, 0.0))
        return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T / scale)

    def _vertex_entries(self) -> IntArray:
        """Return the entries of theta that are the outline's `vertices.ravel()` (2 V,)."""
        lower, upper = (END_ENTRIES + 2 * np.flatnonzero(self.chain == side) for side in (0, 1))
        left, right = (int(end) for end in self.vertical_ends)
        x = np.array([0, *lower, 3, *[3] * right, *upper[::-1], *[0] * left])
        y = x + 1
        if right:
            y[len(lower) + 2] = 5
        if left:
            y[-1] = 2
        return np.stack([x, y], axis=1).ravel()

    def covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance of the vertices (2 V, 2 V) [mm^2], see `covariance_with_x_priors`.

        An edge that crosses two strips, of which the next edge explains one as well, may cross the other one alone: its
        vertices are anywhere within a pitch then, though a line through both strips seems to tell their place.
        """
        told = self._compiled_covariance(problem, sensor, loose=True)
        return self.plain_covariance(problem, sensor) if told is None else told

    def plain_covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return `covariance`, edges made loose in NumPy."""
        fit = self._with_loose_edges(problem)
        covariance = fit.linear_covariance(problem, sensor)
        if fit is not self:
            scale = np.tile([problem.width_mm, problem.length_mm], self.n_vertices)
            off = (self.theta[self._vertex_entries()] - fit.theta[fit._vertex_entries()]) * scale
            covariance += np.kron(np.eye(self.n_vertices), np.ones((2, 2))) * np.outer(off, off)
        return covariance

    def linear_covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance of the vertices (2 V, 2 V) [mm^2] by slopes at this outline alone."""
        told = self._compiled_covariance(problem, sensor, loose=False)
        if told is not None:
            return told
        outline = Outline(*self.chains_mm(problem))
        return covariance_with_x_priors(outline, sensor, self.information_root(problem))

    def _compiled_covariance(self, problem: FitProblem, sensor: Sensor, loose: bool) -> FloatArray | None:
        """Return what the core says; None where there is none, or a direction is hardly told."""
        core = exported("vertex_covariance")
        if core is None:
            return None
        record, x_mm, size = self.record, sensor.x_mm, 2 * self.n_vertices
        covariance = np.empty((size, size))
        in_mm = (problem.origin_mm, problem.width_mm, problem.length_mm)
        told = core(problem.compiled, at(record), loose, *in_mm, at(x_mm), len(x_mm), at(covariance))
        return covariance if told else None

    def _with_loose_edges(self, problem: FitProblem) -> PolygonFit:
        """Return it, vertices of edges that may cross one strip or none moved to the middle of where they may be."""
        theta = self.theta.copy()
        for side, points in enumerate(self.chains):
            places = np.searchsorted(problem.x, points[:, 0]).tolist()
            for i in range(len(points) - 1):
                if not 2 <= (crossed := places[i + 1] - places[i]) <= 3:
                    continue
                moved = points.copy()
                first, last = places[i], places[i + 1] - 1
                for vertex, edge, strip, after in (
                    (i, points[max(i - 1, 0) : i + 1], first, first + 1),
                    (i + 1, points[i + 1 : i + 3], last, last - 1),
                ):
                    if len(edge) == 2 and (place := self._beside(problem, side, edge, strip, after)):
                        moved[vertex], crossed = place, crossed - 1
                if crossed <= 1 and (np.diff(moved[:, 0]) > _APART).all():
                    points = moved
            entries = END_ENTRIES + 2 * np.flatnonzero(self.chain == side)
            theta[entries], theta[entries + 1] = points[1:-1].T
        if np.array_equal(theta, self.theta):
            return self
        order = np.argsort(theta[END_ENTRIES::2], kind="stable")
        vertices = theta[END_ENTRIES:].reshape(-1, 2)[order]
        theta = np.concatenate([theta[:END_ENTRIES], vertices.ravel()])
        return PolygonFit(theta, self.chain[order], self.vertical_ends, self.cost)

    def _beside(
        self, problem: FitProblem, side: int, edge: FloatArray, strip: int, after: int
    ) -> tuple[float, float] | None:
        """Return the place halfway from a strip to its neighbour `after` on an edge (2, 2), lengthened.

        None where the edge does not explain the strip as the chain does.
        """
        (ax, ay), (bx, by) = edge.tolist()
        x = problem.x
        to = float(0.5 * (x[strip] + x[after]))
        if not ax < bx:
            return None
        slope = (by - ay) / (bx - ax)
        ends = [e[strip : strip + 1] for e in self.ends(x)]
        there = problem.readings_of(*ends)
        ends[side] = np.array([ay + slope * (x[strip] - ax)])
        off = (problem.readings_of(*ends) - there)[:, 0] * problem.root_weight[:, strip]
        return (to, ay + slope * (to - ax)) if np.linalg.norm(off) < _TOLD else None

    @classmethod
    def of(cls, outline: Outline, problem: FitProblem) -> PolygonFit:
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
        record = record.copy()
        row = record[0]
        m = int(row["m"])
        theta, upper = row["theta"][: END_ENTRIES + 2 * m], row["upper"][:m]
        found = cls(theta.copy(), upper.copy(), row["vertical"].copy(), float(row["cost"]))
        found.__dict__["record"] = record  # the cached property's place
        return found

    @cached_property
    def record(self) -> npt.NDArray[Any]:
        """For the compiled core, not to be written to: a `POLYGON` (1,); there may be MAX_VERTICES vertices."""
        record, m = np.zeros(1, POLYGON), self.n_interior
        record["m"], record["vertical"] = m, self.vertical_ends
        record["theta"][0, : END_ENTRIES + 2 * m], record["upper"][0, :m] = self.theta, self.chain
        record["cost"] = self.cost
        return record


class FoundPolygons(Sequence[PolygonFit]):
    """Polygons that the compiled core left in records (N,), made when first asked for."""

    def __init__(self, records: npt.NDArray[np.void]) -> None:
        self._records = records
        self._made: dict[int, PolygonFit] = {}

    @property
    def scores(self) -> tuple[float, ...]:
        """The criterion that they are compared by."""
        return tuple(self._records["score"].tolist())

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, place: int) -> PolygonFit: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[PolygonFit, ...]: ...
    def __getitem__(self, place: int | slice) -> PolygonFit | tuple[PolygonFit, ...]:
        if isinstance(place, slice):
            return tuple(self[i] for i in range(*place.indices(len(self))))
        at = range(len(self))[place]
        if at not in self._made:
            self._made[at] = PolygonFit.of_record(self._records[at : at + 1])
        return self._made[at]


def refine(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    """Return the least-squares fit near a given one, on all strips: also the warm start of tracking."""
    core = exported("refine")
    if core is None:
        return plain_refine(fit, problem)
    record = fit.record.copy()
    core(problem.compiled, at(record))
    return PolygonFit.of_record(record)


def plain_refine(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    """Do as `refine`, in NumPy."""
    theta = fit.theta.copy()
    for end in (0, 1):
        if not fit.vertical_ends[end]:
            theta[3 * end + 1 : 3 * end + 3] = theta[3 * end + 1 : 3 * end + 3].mean()
    found = descend(theta[None], fit.chain[None], fit.vertical_ends, problem, _FINE, _SETTLED, np.inf)
    theta, chain, cost = found[0][0], found[1][0], float(found[2][0])
    height = np.array([theta[2] - theta[1], theta[5] - theta[4]])
    closed = (fit.vertical_ends == 1) & (height <= _CLOSED)
    if closed.any():  # a vertical edge without height is a point, whose x is free
        return plain_refine(PolygonFit(theta, chain, np.where(closed, 0, fit.vertical_ends), cost), problem)
    return PolygonFit(theta, chain, fit.vertical_ends, cost)

"""Is a contact that both signatures tell one object? Convex l and u nearest to the readings, and where an end jumps.

Two objects on the same strips read as their hull: where the second one begins, and where the first of both ends, l or u
jumps between two strips, and elsewhere both are convex. An inward corner of a concave object is continuous; behind an
overhang an end jumps too, but once, unless there is one at either side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.convex_chain import convex_regression
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.polygon.run import CHECKS, RunFit
from tacstrip.sensor.spec import Sensor

_POINTS = 60  # at most, that the regression sees: a mean of a convex function's neighbours is convex too
_ROUNDS = 3  # of l with u as it is, and u with l
# Pitches from an inward corner to the jump that it belongs to; nearer to an end no jump is resolved.
_NEAR = 1.6
_GAP = 0.02  # of L: objects nearer to each other are one
_LEAST, _CLEAR = 0.005, 4.0  # of L, and of sigma: a jump that a polygon's ends show
_STAYS, _RAIL = 4.0, 3.0  # deviations: an end is where it was; a reading is none of ground or Vref
_OUTER = 3  # strips at either end
_ALARM = 3.09  # deviations of chi square: p = .001


@dataclass(frozen=True, eq=False)
class ConvexFit:
    """The convex l and the concave u that explain both signatures best.

    Attributes
    ----------
    x, ends
        Places (n,), and l and u there (2, n), in units of the problem.
    chi_square, freedom
        Squared residuals over sigma^2, and their degrees of freedom.
    """

    x: FloatArray
    ends: FloatArray
    chi_square: float
    freedom: int

    @property
    def explains(self) -> bool:
        """Whether noise explains what it leaves over of the readings."""
        small = 2.0 / (9.0 * self.freedom)
        score = ((self.chi_square / self.freedom) ** (1.0 / 3.0) - (1.0 - small)) / math.sqrt(small)
        return bool(score <= _ALARM)


@dataclass(frozen=True)
class Jump:
    """An end of the contact that jumps between two strips, or may.

    Attributes
    ----------
    chain
        0: l, 1: u.
    strips
        The strip to its right, counted in the run; of an inward corner that may hide one, the strips to the right of
        where it may be.
    rise
        By how much more the end rises than beside the jump, over L; 0: an inward corner, or too near to the run's end.
    begins
        Whether an object, or an overhang, begins there; False: one ends; None: either.
    """

    chain: int
    strips: tuple[int, ...]
    rise: float
    begins: bool | None


def fit_convex(problem: FitProblem, l: FloatArray, u: FloatArray, jumps: Sequence[Jump] = ()) -> ConvexFit:
    """Fit a convex l and a concave u, whatever their kinks, by least squares.

    Parameters
    ----------
    problem
        Readings and weights of two signatures.
    l, u
        A fit (n,), in units of the problem, near which readings are taken for linear.
    jumps
        Where l and u are convex and concave on either side only.
    """
    by_l, by_u, k = problem.jacobian(l, u)
    jacobian = np.stack([by_l, by_u], axis=-1)  # (S, n, 2)
    weighted = problem.weight[..., None] * jacobian
    matrix = np.einsum("sni,snj->nij", weighted, jacobian)
    slope = np.einsum("sni,sn->ni", weighted, problem.k - k)
    regular = np.linspace(0, len(l), min(len(l), _POINTS) + 1).round().astype(int)[1:-1]
    breaks = [sorted({i for j in jumps if j.chain == c for i in j.strips}) for c in (0, 1)]
    cuts = np.union1d(regular, breaks[0] + breaks[1]).astype(int)
    groups = np.split(np.arange(len(l)), cuts)
    pieces = [np.flatnonzero(np.isin(cuts, breaks[c])) + 1 for c in (0, 1)]
    x = np.array([problem.x[g].mean() for g in groups])
    m = np.stack([matrix[g].sum(axis=0) for g in groups])
    near = np.stack([l, u], axis=1)
    total = np.stack([(slope[g] + np.einsum("nij,nj->ni", matrix[g], near[g])).sum(axis=0) for g in groups])
    z = np.einsum("nij,nj->ni", np.linalg.pinv(m, rcond=1e-10, hermitian=True), total)
    found, kinks = z.copy(), [0, 0]
    for _ in range(_ROUNDS):
        for c, sign in ((0, 1.0), (1, -1.0)):
            own = np.maximum(m[:, c, c], np.finfo(float).tiny)
            target = z[:, c] - m[:, c, 1 - c] / own * (found[:, 1 - c] - z[:, 1 - c])
            kinks[c] = 2 * len(pieces[c])
            for p in np.split(np.arange(len(x)), pieces[c]):
                found[p, c], more = convex_regression(x[p], target[p], own[p], sign)
                kinks[c] += more
    off = found - z
    chi = float(np.einsum("ni,nij,nj->", off, m, off))
    return ConvexFit(x, found.T, chi, max(2 * len(x) - sum(kinks) - 4, 1))


def turns_inwards(fit: PolygonFit) -> bool:
    """Whether a corner of a polygon turns inwards."""
    for sign, chain in zip((1.0, -1.0), fit.chains, strict=True):
        slopes = [sign * _slope(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(chain.tolist())]
        if any(after < before for before, after in pairwise(slopes)):
            return True
    return False


def _slope(run: float, rise: float) -> float:
    return rise / run if run else math.copysign(math.inf, rise) if rise else math.nan


def one_end_off(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> bool:
    """Whether readings were left out of a strip where one end of the contact, and no more, would lie elsewhere.

    A faulty channel moves both ends, or to where none can be; a second object, or an overhang, moves one. Amid strips
    that agree none touches a single strip; where few readings are left to check, nothing tells.
    """
    if not run.excluded.any():
        return False
    problem, selection = run.problem, run.selection
    assert selection is not None
    kh, kl = readings["kh"], readings["kl"]
    l, u = selection.chosen.ends(problem.x)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.stack(closed_ends(sensor, kh, kl)) / sensor.length_mm - [l, u]
        by_l, by_u, _ = problem.jacobian(l, u)
        # A column of the inverse Jacobian's rows: how far both readings' errors move l, and u.
        spread = np.stack([np.hypot(*by_u), np.hypot(*by_l)]) / np.abs(by_l[0] * by_u[1] - by_l[1] * by_u[0])
        deviations = np.abs(off) / (run.sigma * spread)
        rail = _RAIL * run.sigma
        inside = (kl > rail) & (kh < 1.0 - rail) & (kh > kl)
    left_out = run.excluded.any(axis=0) & inside
    one = (deviations.min(axis=0) <= _STAYS) & (deviations.max(axis=0) >= 2.0 * _STAYS)
    one &= np.abs(off).max(axis=0) >= _GAP
    one[_OUTER:-_OUTER] = False
    return bool((left_out & (one | (run.freedom < CHECKS))).any())

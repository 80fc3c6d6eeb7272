"""Is a contact that both signatures tell one object? Convex l and u nearest to the readings, and where an end jumps.

Two objects on the same strips read as their hull: where the second one begins, and where the first of both ends, l or u
jumps between two strips, and elsewhere both are convex. An inward corner of a concave object is continuous; behind an
overhang an end jumps too, but once, unless there is one at either side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.sensor.spec import Sensor

_POINTS = 60  # at most, that the regression sees: a mean of a convex function's neighbours is convex too
_ROUNDS = 3  # of l with u as it is, and u with l
_SPARE = 1e-9  # of the largest gradient: none is left
_NEAR = (
    1.6  # pitches from an inward corner to the jump that it belongs to; nearer to an end no jump is resolved
)
_GAP = 0.02  # of L: objects nearer to each other are one
_LEAST, _CLEAR = 0.005, 4.0  # of L, and of sigma: a jump that a polygon's ends show
_STAYS, _RAIL = 4.0, 3.0  # deviations: an end is where it was; a reading is none of ground or Vref
_CHECKS = 6  # readings beyond the numbers fitted
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


def convex_regression(
    x: FloatArray, y: FloatArray, weight: FloatArray, sign: float = 1.0
) -> tuple[FloatArray, int]:
    """Return the convex function (sign 1; -1: concave) nearest to y (n,) at x (n,), and its number of kinks.

    By least squares with weights (n,), as a line and hinges of positive weight (Lawson and Hanson's active set).
    """
    if len(x) < 3:
        return y.copy(), 0
    root = np.sqrt(weight)
    centre = x.mean()
    line = np.stack([np.ones_like(x), x - centre], axis=1)
    hinge = sign * np.maximum(x[:, None] - x[None, 1:-1], 0.0)
    every = np.concatenate([line, hinge], axis=1) * root[:, None]
    target, active = y * root, [0, 1]
    value = np.zeros(every.shape[1])
    value[active] = np.linalg.lstsq(every[:, active], target, rcond=None)[0]
    for _ in range(3 * len(x)):
        gradient = every.T @ (target - every @ value)
        gradient[active] = -np.inf
        best = int(np.argmax(gradient[2:])) + 2 if len(gradient) > 2 else 0
        if best == 0 or gradient[best] <= _SPARE * max(np.abs(target).sum(), 1e-300):
            break
        active.append(best)
        while True:
            trial = np.linalg.lstsq(every[:, active], target, rcond=None)[0]
            low = [i for i, a in enumerate(active) if a > 1 and trial[i] <= 0.0]
            if not low:
                break
            now = value[active]
            step = min(now[i] / max(now[i] - trial[i], 1e-300) for i in low)
            value[active] = now + step * (trial - now)
            gone = {active[i] for i in low if value[active[i]] <= 1e-15 + 1e-12 * abs(now[i])} or {
                active[low[0]]
            }
            value[list(gone)] = 0.0
            active = [a for a in active if a not in gone]
        value[:] = 0.0
        value[active] = trial
    return line @ value[:2] + hinge @ value[2:], len(active) - 2


def find_jumps(fit: PolygonFit, problem: FitProblem) -> list[Jump]:
    """Return the jumps of a polygon's ends at its inward corners, from left to right.

    A corner that turns so little from strip to strip that no gap hides in it is none.
    """
    n, found = len(problem.x), set()
    least = max(_LEAST, _CLEAR * problem.sigma)
    for c, chain in enumerate(fit.chains):
        run, rise = np.diff(chain, axis=0).T
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.diff(rise / run)
        step = np.append(0.0, np.diff(np.interp(problem.x, *chain.T)))  # to each strip
        more = np.zeros(n)
        sides = np.stack([step[1:-2], step[3:]])
        more[2:-1] = step[2:-1] - np.clip(step[2:-1], sides.min(axis=0), sides.max(axis=0))
        for corner in chain[1:-1, 0][(turn < 0.0) if c == 0 else (turn > 0.0)]:
            place = float(corner - problem.x[0]) / problem.pitch
            near = [i for i in range(1, n) if abs(i - 0.5 - place) <= _NEAR]
            right = math.floor(place) + 1
            also = right - 1 if place % 1.0 < 0.5 else right + 1
            at = max(near, key=lambda i: abs(more[i]), default=0)
            if abs(more[at]) >= least:  # noise, and a steep begin, hide the very place
                strips = sorted({i for i in (at, right, also) if 0 < i < n})
                found.add(Jump(c, tuple(strips), float(more[at]), (c == 0) == bool(more[at] < 0.0)))
            elif 1 in near or n - 1 in near:
                found.add(Jump(c, (near[0], near[-1]), 0.0, 1 in near))
            elif abs(step[right + 1] - step[right - 1]) >= 2.0 * _GAP:
                found.add(Jump(c, (min(right, also), max(right, also)), 0.0, None))
    return sorted(found, key=lambda jump: (jump.strips, jump.chain))


def may_be_several(fit: PolygonFit, problem: FitProblem, jumps: Sequence[Jump]) -> bool:
    """Whether one object begins at a jump, or with the run, before one ends at a jump, or with the run.

    Where both begin, or both end, between the same two strips, the contact is not pointed there.
    """
    l, u = fit.ends(problem.x)
    w = u - l
    abrupt = [bool(max(2.0 * v[0] - v[1], 2.0 * v[1] - v[2] - v[0]) > _GAP) for v in (w, w[::-1])]
    for i, jump in enumerate(jumps):
        if jump.begins is True and (abrupt[1] or any(not other.begins for other in jumps[i + 1 :])):
            return True
        if jump.begins is False and (abrupt[0] or any(other.begins is not False for other in jumps[:i])):
            return True
    return False


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
    return bool((left_out & (one | (run.freedom < _CHECKS))).any())


def hidden_share(jumps: Sequence[Jump], problem: FitProblem, area: float) -> float:
    """Return how much of an outline of an area (over L and the run) may not be touched behind a jump's overhang.

    The least that an opening as high as the jump leaves: a triangle to the run's other end.
    """
    x = problem.x
    return max(
        (
            0.5 * abs(j.rise) * (1.0 - x[j.strips[0]] if j.begins else x[j.strips[0] - 1]) / area
            for j in jumps
        ),
        default=0.0,
    )

"""Is a contact that both signatures tell one convex object? Convex l and u nearest to the readings, and their steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.outline import Outline

_POINTS = 60  # at most, that the regression sees: a mean of a convex function's neighbours is convex too
_ROUNDS = 3  # of l with u as it is, and u with l
_SPARE = 1e-9  # of the largest gradient: none is left
_STEP, _STEEP = 1.35, 3.0  # pitches that a step runs at most, and how much steeper it is than the outline


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


def fit_convex(problem: FitProblem, l: FloatArray, u: FloatArray) -> ConvexFit:
    """Fit a convex l and a concave u, whatever their kinks, by least squares.

    Parameters
    ----------
    problem
        Readings and weights of two signatures.
    l, u
        A fit (n,), in units of the problem, near which readings are taken for linear.
    """
    by_l, by_u, k = problem.jacobian(l, u)
    jacobian = np.stack([by_l, by_u], axis=-1)  # (S, n, 2)
    weighted = problem.weight[..., None] * jacobian
    matrix = np.einsum("sni,snj->nij", weighted, jacobian)
    slope = np.einsum("sni,sn->ni", weighted, problem.k - k)
    groups = np.array_split(np.arange(len(l)), min(len(l), _POINTS))
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
            found[:, c], kinks[c] = convex_regression(x, target, own, sign)
    off = found - z
    chi = float(np.einsum("ni,nij,nj->", off, m, off))
    return ConvexFit(x, found.T, chi, max(2 * len(x) - sum(kinks) - 4, 1))


def convex_regression(
    x: FloatArray, y: FloatArray, weight: FloatArray, sign: float = 1.0
) -> tuple[FloatArray, int]:
    """Return the convex function (sign 1; -1: concave) nearest to y (n,) at x (n,), and its number of kinks.

    By least squares with weights (n,), as a line and hinges of positive weight (Lawson and Hanson's active set).
    """
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


def largest_step(outline: Outline, pitch_mm: float) -> float:
    """Return the height [mm] of the largest jump of l or u: of an edge between strips next to an inward corner.

    Where a second object begins or ends on the strips of a first one, l or u jumps. 0 without any.
    """
    found = 0.0
    reach = float(outline.lower[-1, 0] - outline.lower[0, 0])
    height = float(np.ptp(np.concatenate([outline.lower, outline.upper])[:, 1]))
    for chain, side in ((outline.lower, 1.0), (outline.upper, -1.0)):
        run, rise = np.diff(chain, axis=0).T
        inward = side * np.diff(rise / run) < 0.0
        beside = np.append(False, inward) | np.append(inward, False)
        steep = np.abs(rise) * reach > _STEEP * height * run
        found = max(found, float(np.abs(rise)[beside & steep & (run <= _STEP * pitch_mm)].max(initial=0.0)))
    return found

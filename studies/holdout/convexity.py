"""How far readings are from every convex outline: whether they can tell that there is more than one object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.special import chdtrc  # scipy.stats takes half a second to import

from studies.holdout.readings import Unit
from studies.holdout.shapes import Array

_ROUNDS, _ENOUGH, _STEP = 60, 1e-3, 1e-6  # of Levenberg-Marquardt; of chi square; of numerical slopes, over L
_BORDER = 1e-4  # over L: how softly l and u are kept on the sensor
_LAST_DAMPING = 1e12


class BestConvex(NamedTuple):
    """The least chi square of readings over convex outlines, its p, and where that outline lies [mm] (touched,)."""

    chi_square: float
    p: float
    low: Array
    high: Array


def best_convex(unit: Unit, read: Array, sigma: float, low: Array, high: Array) -> BestConvex:
    """Return the least chi square of readings (names, strips) over all convex outlines on the sensor.

    A convex l is a line plus hinges, c >= 0 each; the height w = u - l is a line with ends above 0 plus tents, c + d
    each, so that u has kinks of -d <= 0 and l <= u. Each step of Levenberg-Marquardt, begun from the convex outline
    nearest to `low` and `high` [mm], so is a least squares problem with non-negative unknowns. Two lines always belong
    to them and cost four degrees of freedom, three where one signature sees them. With one signature the minimum may be
    a local one: p is then smaller than it should be.
    """
    on = np.isfinite(low)
    t = (unit.x[on] - unit.x[on][0]) / np.ptp(unit.x[on])
    line, knots = np.column_stack([1.0 - t, t]), t[1:-1]
    hinges = np.maximum(t[:, None] - knots, 0.0)
    tents = np.minimum(t[:, None], knots) * (1.0 - np.maximum(t[:, None], knots))
    # Unknowns: l at both ends, the same with the other sign, w at both ends, c, d.
    of_l = np.hstack([line, -line, 0.0 * line, hinges, 0.0 * tents])
    of_u = of_l + np.hstack([0.0 * line, 0.0 * line, line, tents, tents])
    ends, length, h = np.vstack([of_l, of_u]), unit.length, _STEP * unit.length
    target = np.vstack([read[:, on] / sigma, np.zeros((2, len(t)))])

    def nearest(matrix: Array, wanted: Array) -> Array:
        return np.asarray(ends @ nnls(matrix, wanted, maxiter=100 * matrix.shape[1])[0]) * length

    def predicted(l: Array, u: Array) -> Array:
        beyond = np.maximum([-l, u - length], 0.0) / (_BORDER * length)
        return np.vstack([unit.read(l, u) / sigma, beyond])

    def misfit(l: Array, u: Array) -> float:
        if (u - l).max() >= 0.9999 * length:
            return np.inf
        return float(((target - predicted(l, u)) ** 2).sum())

    at = nearest(ends, np.concatenate([low[on], high[on]]) / length)
    least, damping = misfit(*np.split(at, 2)), 1.0
    for _ in range(_ROUNDS):
        l, u = np.split(at, 2)
        here = predicted(l, u)
        by_l, by_u = (predicted(l + h, u) - here) / h, (predicted(l, u + h) - here) / h
        rows = (by_l[:, :, None] * of_l + by_u[:, :, None] * of_u).reshape(target.size, -1) * length
        wanted = (target - here + by_l * l + by_u * u).ravel()
        weight = np.sqrt(damping)
        tried = nearest(np.vstack([rows, weight * ends]), np.concatenate([wanted, weight * at / length]))
        gain = least - (new := misfit(*np.split(tried, 2)))
        damping *= 0.1 if gain > 0.0 else 10.0
        if gain > 0.0:
            least, at = new, tried
        if 0.0 < gain < _ENOUGH or damping > _LAST_DAMPING:
            break
    freedom = max(read[:, on].size - (4 if len(unit.names) > 1 else 3), 1)
    return BestConvex(least, float(chdtrc(freedom, least)), *np.split(at, 2))

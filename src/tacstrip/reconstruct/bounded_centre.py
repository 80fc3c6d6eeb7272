"""A point inside a polytope A h <= b, or a proof that there is none; and its analytic centre.

Of the thousands of rows a few dozen decide: both work on those, and check against all.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.polytope import lowest

_ROUNDS = 12  # of adding the rows that are broken most
_FIRST, _MORE = 6, 2  # rows to begin with and to add, per dimension
_FLAT = 1e-8  # of the scale: a polytope as thin has no inside
_NEAREST = 24  # rows per dimension that the centre keeps away from
_SELECTIONS, _STEPS = 3, 10
_DONE = 1e-3  # squared Newton decrement that counts as centred


def interior(a: FloatArray, b: FloatArray, start: FloatArray, scale: float) -> tuple[FloatArray, float, bool]:
    """Look for a point strictly inside: the minimax fit over as many rows as it takes to know.

    Parameters
    ----------
    a, b
        The polytope (M, P) and (M,).
    start
        A point (P,).
    scale
        What counts as far outside, in units of b; deeper inside than that is not looked for.

    Returns
    -------
    tuple
        A point (P,); how far it is outside at most, in units of b, below 0 inside; and whether the polytope is
        known to be empty, or thinner than rounding.
    """
    size = len(start)
    at = start
    broken = a @ at - b
    worst = float(broken.max())
    if worst < 0.0 or not np.isfinite(worst):
        return at, worst, not worst < 0.0
    used = largest(broken, _FIRST * size)
    form = np.append(np.zeros(size), 1.0)
    for _ in range(_ROUNDS):
        # Least t with A h - t <= b over the rows in use, and t >= -scale.
        rows = np.vstack([np.hstack([a[used], -np.ones((len(used), 1))]), -form])
        slack = np.append(b[used] - a[used] @ at, scale)
        point, active = np.append(np.zeros(size), worst), np.full(size + 1, -1)
        least = lowest(form, rows, slack, point, active)
        if not least > -np.inf:  # rounding led it astray
            return at, worst, False
        if least > -_FLAT * scale:
            return at + point[:-1], max(worst, 0.0), True
        at = at + point[:-1]
        broken = a @ at - b
        worst = float(broken.max())
        if worst < 0.0:
            return at, worst, False
        used = np.union1d(used, largest(broken, _MORE * size))
    return at, worst, False


def centre(a: FloatArray, b: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the analytic centre (P,) from a point strictly inside, and the barrier's curvature there (P, P).

    It maximises the product of the slacks b - A h of the rows that are nearest.
    """
    at, slack = start, b - a @ start
    near = largest(-slack, _NEAREST * len(start))
    for _ in range(_SELECTIONS):
        for _ in range(_STEPS):
            scaled = a[near] / slack[near, None]
            gradient, curvature = scaled.sum(axis=0), scaled.T @ scaled
            step = _solve(curvature, -gradient)
            along = a @ step
            size = min(1.0, 0.7 / max(float((along / slack).max()), 1e-300))
            left = slack - size * along
            if left.min() <= 0.0:  # as far as rounding lets one go
                break
            at, slack = at + size * step, left
            if -gradient @ step < _DONE:
                break
        # Near is what is few steps of the barrier's own size away, in whichever direction.
        scaled = a[near] / slack[near, None]
        reach = np.sqrt(np.maximum((_solve(scaled.T @ scaled, a.T) * a.T).sum(axis=0), 0.0))
        near = largest(reach / slack, _NEAREST * len(start))
    scaled = a[near] / slack[near, None]
    return at, scaled.T @ scaled


def largest(values: FloatArray, count: int) -> IntArray:
    """Return the places of the largest values, ascending: of equal ones the first, whatever the processor."""
    if count >= len(values):
        return np.arange(len(values))
    least = np.partition(values, len(values) - count)[len(values) - count]
    above, equal = np.flatnonzero(values > least), np.flatnonzero(values == least)
    return np.sort(np.concatenate([above, equal[: count - len(above)]]))


def _solve(curvature: FloatArray, right: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.diag(curvature))
    scaled = curvature * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += 1e-13
    return np.asarray((np.linalg.solve(scaled, (scale * right.T).T).T * scale).T)

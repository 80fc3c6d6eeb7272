"""A point inside a polytope A h <= b, or a proof that there is none; and its analytic centre."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray

_FASTER = 10.0  # how the barrier's weight falls from round to round
_ROUNDS, _STEPS = 12, 20
_NEAR = 0.1  # squared Newton decrement that counts as centred on the way
_FLAT = 1e-8  # of the scale: a polytope as thin has no inside
_DONE = 1e-3  # and as the centre


def interior(a: FloatArray, b: FloatArray, start: FloatArray, scale: float) -> tuple[FloatArray, float, bool]:
    """Look for a point strictly inside: the minimax fit, stopped when it is known to be inside or not.

    Parameters
    ----------
    a, b
        The polytope (M, P) and (M,).
    start
        A point (P,).
    scale
        What counts as far outside, in units of b.

    Returns
    -------
    tuple
        A point (P,); how far it is outside at most, in units of b, below 0 inside; and whether the polytope is
        known to be empty.
    """
    at = start
    t = worst = float((a @ at - b).max())
    if t < 0.0:
        return at, t, False
    t += 0.05 * t + 1e-3 * scale
    count = len(b)
    weight = count / (0.5 * t + 0.1 * scale)
    rows = np.hstack([a, -np.ones((count, 1))])
    for _ in range(_ROUNDS):
        # Newton on weight t - sum log(t + b - A h): self-concordant, so damped steps always get there.
        for _ in range(_STEPS):
            slack = b + t - a @ at
            if not slack.min() > 0.0:  # t is lost in rounding, or all is NaN
                return at, worst, True
            scaled = rows / slack[:, None]
            gradient = scaled.sum(axis=0)
            gradient[-1] += weight
            curvature = scaled.T @ scaled
            step = _solve(curvature, -gradient)
            decrement = float(-gradient @ step)
            size = _reach(scaled @ step)
            at, t = at + size * step[:-1], t + size * float(step[-1])
            worst = float((a @ at - b).max())
            if worst < 0.0:
                return at, worst, False
            if decrement < _NEAR:
                break
        if t - count / weight > 0.0 and decrement < _NEAR:
            return at, worst, True
        if t < _FLAT * scale:
            break
        weight *= _FASTER
    return at, worst, True


def centre(a: FloatArray, b: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the analytic centre (P,) from a point strictly inside, and the barrier's curvature there (P, P).

    It maximises the product of all slacks b - A h.
    """
    at, slack = start, b - a @ start
    for _ in range(_STEPS):
        scaled = a / slack[:, None]
        gradient, curvature = scaled.sum(axis=0), scaled.T @ scaled
        step = _solve(curvature, -gradient)
        moved = at + _reach(scaled @ step) * step
        left = b - a @ moved
        if left.min() <= 0.0:  # as far as rounding lets one go
            break
        at, slack = moved, left
        if -gradient @ step < _DONE:
            break
    scaled = a / slack[:, None]
    return at, scaled.T @ scaled


def _solve(curvature: FloatArray, right: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.diag(curvature))
    scaled = curvature * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += 1e-13
    return np.asarray(scale * np.linalg.solve(scaled, scale * right))


def _reach(used: FloatArray) -> float:
    """Return how much of a step to take: all, or most of the way to the first slack that it uses up."""
    return min(1.0, 0.7 / max(float(used.max()), 1e-300))

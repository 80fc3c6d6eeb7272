"""The normal equations of the polygon fit in NumPy, of many polygons at once.

A batch is theta (B, P), P = 6 + 2 m, in the layout of `PolygonFit`, and chain (B, m); all have the same kinds of ends.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.problem import FitProblem

_CROSSED = 100.0  # weight of l > u against a reading
_CROSSED_FROM = 1e-9  # of L: where both chains meet on a strip, a rounding error must not cross them


def normal_equations(
    theta: FloatArray, chain: IntArray, vertical_ends: IntArray, problem: FitProblem, prior: bool = True
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the cost (B,), J'WJ (B, P, P) and J'Wr (B, P); with the prior of pointed ends' x, or without."""
    (l, by_l), (u, by_u) = heights(theta, chain, vertical_ends, problem.x)
    ll, lu, uu, lr, ur, rr = terms(l, u, problem)
    left, right = np.swapaxes(by_l, 1, 2), np.swapaxes(by_u, 1, 2)
    matrix = left @ (ll[..., None] * by_l + lu[..., None] * by_u)
    matrix += right @ (lu[..., None] * by_l + uu[..., None] * by_u)
    gradient = (left @ lr[..., None] + right @ ur[..., None])[..., 0]
    cost = rr.sum(axis=1)
    for end in np.flatnonzero(np.asarray(vertical_ends) == 0) if prior else ():
        weight, off = 12.0 / problem.pitch**2, theta[:, 3 * end] - end
        matrix[:, 3 * end, 3 * end] += weight
        gradient[:, 3 * end] -= weight * off
        cost = cost + weight * off * off
    return cost, matrix, gradient


def heights(
    theta: FloatArray, chain: IntArray, vertical_ends: IntArray, x: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Return l and u at x (B, n), each with its slopes by theta (B, n, P)."""
    found, b, i = [], np.arange(len(theta))[:, None], np.arange(len(x))
    m = chain.shape[1]
    passed = theta[:, None, END_ENTRIES::2] <= x[:, None]  # (B, n, m)
    for upper in (0, 1):
        mine = (chain == upper)[:, None]
        before = np.where(passed & mine, np.arange(m), -1).max(axis=2, initial=-1)
        after = np.where(~passed & mine, np.arange(m), m).min(axis=2, initial=m)
        y_left, y_right = (3 * end + (1 + upper if vertical_ends[end] else 1) for end in (0, 1))
        ax = np.where(before >= 0, END_ENTRIES + 2 * before, 0)
        ay = np.where(before >= 0, END_ENTRIES + 1 + 2 * before, y_left)
        bx = np.where(after < m, END_ENTRIES + 2 * after, 3)
        by = np.where(after < m, END_ENTRIES + 1 + 2 * after, y_right)
        run = np.maximum(theta[b, bx] - theta[b, ax], 1e-12)
        slope, share = (theta[b, by] - theta[b, ay]) / run, (x - theta[b, ax]) / run
        slopes = np.zeros((*before.shape, theta.shape[1]))
        slopes[b, i, ay], slopes[b, i, by] = 1.0 - share, share
        slopes[b, i, ax], slopes[b, i, bx] = -slope * (1.0 - share), -slope * share
        found.append((theta[b, ay] + slope * (x - theta[b, ax]), slopes))
    return found


def terms(l: FloatArray, u: FloatArray, problem: FitProblem) -> tuple[FloatArray, ...]:
    """Return sums over the signatures of weight times g_l^2, g_l g_u, g_u^2, g_l r, g_u r and r^2, each as l and u.

    g_l and g_u are the slopes of a reading by l and by u, r is what is measured less what l and u make. l > u costs
    extra.
    """
    by_l, by_u, k = problem.jacobian(l, u)
    r, weight = problem.k - k, problem.weight
    crossed = np.where(u - l < -_CROSSED_FROM, _CROSSED * weight.sum(axis=0), 0.0)
    push = crossed * (u - l)
    wl, wu = weight * by_l, weight * by_u
    return (
        (wl * by_l).sum(axis=-2) + crossed,
        (wl * by_u).sum(axis=-2) - crossed,
        (wu * by_u).sum(axis=-2) + crossed,
        (wl * r).sum(axis=-2) + push,
        (wu * r).sum(axis=-2) - push,
        (weight * r * r).sum(axis=-2) + push * (u - l),
    )


def free_entries(size: int, vertical_ends: IntArray) -> BoolArray:
    """Return which entries of theta (P,) a descent moves."""
    free = np.ones(size, dtype=bool)
    for end in (0, 1):
        free[3 * end], free[3 * end + 2] = not vertical_ends[end], bool(vertical_ends[end])
    return free

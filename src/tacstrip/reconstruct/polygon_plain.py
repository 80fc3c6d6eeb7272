"""The compiled kernels of the polygon fit once more in NumPy: the readable truth, which they must agree with.

Layouts as in `kernels`.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import CROSSED, CROSSED_FROM, ENDS, LEAST_D, Data, Model
from tacstrip.sensor.circuit import erosion


def chains_of(theta: FloatArray, chain: IntArray, blunt: IntArray) -> list[tuple[IntArray, IntArray]]:
    """Return the entries of theta that hold x and y of the lower chain's knots, and of the upper one's."""
    found = []
    for upper in (0, 1):
        inner = ENDS + 2 * np.flatnonzero(chain == upper)
        left, right = (1 + upper if blunt[0] else 1), (4 + upper if blunt[1] else 4)
        found.append((np.array([0, *inner, 3]), np.array([left, *(inner + 1), right])))
    return found


def heights(
    theta: FloatArray, chain: IntArray, blunt: IntArray, x: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Return l and u at x (n,), each with its slopes by theta (n, size)."""
    both = []
    for at_x, at_y in chains_of(theta, chain, blunt):
        knots, y = theta[at_x], theta[at_y]
        left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
        run = np.maximum(knots[left + 1] - knots[left], 1e-12)
        slope, share = (y[left + 1] - y[left]) / run, (x - knots[left]) / run
        by, row = np.zeros((len(x), len(theta))), np.arange(len(x))
        for k, weight in ((left, 1.0 - share), (left + 1, share)):
            by[row, at_y[k]] += weight
            by[row, at_x[k]] -= weight * slope
        both.append((y[left] + slope * (x - knots[left]), by))
    return both


def rows(
    theta: FloatArray, chain: IntArray, blunt: IntArray, data: Data, signal: Model
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Return weighted slopes (R, size) and residuals (R,) of all readings, and their slopes by l and by u (R,).

    R = (S + 1) n: at last come rows that are not 0 where l > u, a penalty.
    """
    x, k, weight, _ = data
    shares, narrow, lam = signal
    (l, l_by), (u, u_by) = heights(theta, chain, blunt, x)
    w = u - l
    t = erosion(w, lam)
    dt = 0.5 * (1.0 - (t / lam) ** 2) if lam > 0.0 else np.zeros_like(w)
    over = 1.0 / np.maximum(1.0 - narrow * (w - 2.0 * t), LEAST_D)
    by_l, by_u, off = [], [], []
    for share, row, weigh in zip(shares, k, weight, strict=True):
        model = ((1.0 - share) * (l + t) + share * (u - t)) * over
        gl, gu = (1.0 - share - narrow * model) * over, (share + narrow * model) * over
        root = np.sqrt(weigh)
        by_l.append(root * (gl * (1.0 - dt) + gu * dt))
        by_u.append(root * (gu * (1.0 - dt) + gl * dt))
        off.append(root * (row - model))
    crossed = np.where(w < -CROSSED_FROM, np.sqrt(CROSSED * weight.sum(axis=0)), 0.0)
    by_l.append(-crossed)
    by_u.append(crossed)
    off.append(-crossed * w)
    by = [np.concatenate(g) for g in (by_l, by_u)]
    tiles = len(shares) + 1
    slopes = by[0][:, None] * np.tile(l_by, (tiles, 1)) + by[1][:, None] * np.tile(u_by, (tiles, 1))
    return slopes, np.concatenate(off), by


def normal_equations(
    theta: FloatArray, chain: IntArray, blunt: IntArray, data: Data, signal: Model
) -> tuple[float, FloatArray, FloatArray]:
    """Return the cost, J'WJ and J'Wr, with the prior of pointed ends' x."""
    slopes, off, _ = rows(theta, chain, blunt, data, signal)
    matrix, gradient, cost = slopes.T @ slopes, slopes.T @ off, float(off @ off)
    for side in (0, 1):
        if not blunt[side]:
            weight, away = 12.0 / data[3] ** 2, theta[3 * side] - side
            matrix[3 * side, 3 * side] += weight
            gradient[3 * side] -= weight * away
            cost += weight * away**2
    return cost, matrix, gradient


def free_entries(m: int, blunt: IntArray) -> IntArray:
    """Return the entries of theta that a descent moves."""
    ends = [
        3 * side + i
        for side in (0, 1)
        for i in range(3)
        if (i == 0 and not blunt[side]) or i == 1 or (i == 2 and blunt[side])
    ]
    return np.array(ends + list(range(ENDS, ENDS + 2 * m)))


def ordered(theta: FloatArray, chain: IntArray) -> tuple[FloatArray, IntArray]:
    """Return a fit with its vertices in ascending x."""
    order = np.argsort(theta[ENDS::2], kind="stable")
    return np.concatenate([theta[:ENDS], theta[ENDS:].reshape(-1, 2)[order].ravel()]), chain[order]


def moved(
    theta: FloatArray, chain: IntArray, blunt: IntArray, free: IntArray, step: FloatArray, pitch: float
) -> FloatArray:
    """Return theta + step, held to the sensor, to the ends' pitch and to the order on each chain."""
    trial = theta.copy()
    trial[free] += step
    half = 0.5 * pitch
    trial[0], trial[3] = np.clip(trial[0], -half, half), np.clip(trial[3], 1.0 - half, 1.0 + half)
    x = theta[ENDS::2]
    if len(x):
        trial[0] = min(trial[0], max(theta[0], 0.5 * (theta[0] + x[0]) - 0.5 * half))
        trial[3] = max(trial[3], min(theta[3], 0.5 * (theta[3] + x[-1]) + 0.5 * half))
    heights_at = [1, 2, 4, 5, *range(ENDS + 1, len(theta), 2)]
    trial[heights_at] = np.clip(trial[heights_at], 0.0, 1.0)
    for side in (0, 1):
        if not blunt[side]:
            trial[3 * side + 2] = trial[3 * side + 1]
    for upper in (0, 1):
        mine = np.flatnonzero(chain == upper)
        room = np.maximum(0.5 * np.diff(np.concatenate([theta[:1], x[mine], theta[3:4]])) - 0.5 * half, 0.0)
        at = ENDS + 2 * mine
        trial[at] = np.clip(trial[at], x[mine] - room[:-1], x[mine] + room[1:])
    return trial


def descend(
    theta: FloatArray, chain: IntArray, m: int, blunt: IntArray, data: Data, signal: Model,
    most: int, least: float, wanted: float,
) -> float:  # fmt: skip
    """Improve a fit in place by Levenberg-Marquardt; return its cost. As `polygon_descent.descend`."""
    pitch, size = data[3], ENDS + 2 * m
    here, kinds = ordered(theta[:size], chain[:m])
    cost, matrix, gradient = normal_equations(here, kinds, blunt, data, signal)
    low, high = np.zeros(size), np.ones(size)
    low[[0, 3]], high[[0, 3]] = np.array([0.0, 1.0]) - 0.5 * pitch, np.array([0.0, 1.0]) + 0.5 * pitch
    low[ENDS::2], high[ENDS::2] = -np.inf, np.inf
    damping = 1e-3
    for _ in range(most):
        free = free_entries(m, blunt)
        held = ((here <= low) & (gradient <= 0.0)) | ((here >= high) & (gradient >= 0.0))
        free = free[~held[free]]
        small = matrix[np.ix_(free, free)]
        small = small + np.diag(damping * small.diagonal() + 1e-9)
        trial = moved(here, kinds, blunt, free, np.asarray(np.linalg.solve(small, gradient[free])), pitch)
        trial, trial_kinds = ordered(trial, kinds)
        new = normal_equations(trial, trial_kinds, blunt, data, signal)
        gain = cost - new[0]
        if gain >= 0.0:
            here, kinds = trial, trial_kinds
            cost, matrix, gradient = new
            damping = max(0.1 * damping, 1e-9)
            if gain < least or cost - 2.0 * gain > wanted:
                break
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    theta[:size], chain[:m] = here, kinds
    return cost


def gain_of_vertex(
    theta: FloatArray, chain: IntArray, blunt: IntArray, data: Data, signal: Model, place: float, upper: int
) -> tuple[float, float, float]:
    """Return what a vertex at x = place on a chain would gain by the score test, its height, and what is new of it.

    That is the share of v'v that the slopes there are already cannot make. The chain is lifted by a hat; v is the
    readings' answer, J and r the slopes and residuals without it.
    """
    slopes, off, by = rows(theta, chain, blunt, data, signal)
    at_x, _ = chains_of(theta, chain, blunt)[upper]
    knots = theta[at_x]
    i = int(np.searchsorted(knots, place))
    hat = np.interp(data[0], [knots[i - 1], place, knots[i]], [0.0, 1.0, 0.0])
    v = by[upper] * np.tile(hat, len(off) // len(hat))
    free = free_entries(len(chain), blunt)
    jac = slopes[:, free]
    normal = normal_equations(theta, chain, blunt, data, signal)[1][np.ix_(free, free)]
    normal += np.diag(1e-6 * normal.diagonal() + 1e-9)
    own = v @ v - (v @ jac) @ np.linalg.solve(normal, jac.T @ v)
    return float((v @ off) ** 2 / own), float(v @ off / own), float(own / (v @ v))

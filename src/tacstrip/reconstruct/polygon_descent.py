"""Levenberg-Marquardt for the polygon fit, compiled: from a start to the nearest least-squares polygon.

Layouts as in `kernels`.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import (
    ENDS,
    Data,
    Model,
    normal_equations,
    with_prior,
)
from tacstrip.reconstruct.polygon_cholesky import cholesky, solve_cholesky
from tacstrip.reconstruct.polygon_compiled import DATA, F1, I1, MODEL, compiled

_DAMPING, _STUCK = 1e-3, 1e8  # of J'J's diagonal: at first, and where a descent gives up
_LEAST = 1e-9  # damping that always stays
_HOPE = 2.0  # a descent will not gain more than twice what its last step did


@compiled(f"int64(int64,{I1},{I1})")
def free_entries(m: int, blunt: IntArray, free: IntArray) -> int:
    """Write the entries of theta that a descent moves to free; return how many they are."""
    n = 0
    for side in range(2):
        first = 3 * side
        if not blunt[side]:
            free[n] = first
            n += 1
        free[n] = first + 1
        n += 1
        if blunt[side]:
            free[n] = first + 2
            n += 1
    for i in range(ENDS, ENDS + 2 * m):
        free[n] = i
        n += 1
    return n


@compiled()
def sort_vertices(theta: FloatArray, chain: IntArray, m: int) -> None:
    """Bring the vertices into ascending x; opposite chains may pass each other."""
    for j in range(1, m):
        i = j
        while i > 0 and theta[ENDS + 2 * i] < theta[ENDS + 2 * i - 2]:
            a, b = ENDS + 2 * i - 2, ENDS + 2 * i
            theta[a], theta[b] = theta[b], theta[a]
            theta[a + 1], theta[b + 1] = theta[b + 1], theta[a + 1]
            chain[i - 1], chain[i] = chain[i], chain[i - 1]
            i -= 1


@compiled(f"void({F1},{I1},int64,{I1},{I1},int64,{F1},float64,{F1})")
def move(
    theta: FloatArray,
    chain: IntArray,
    m: int,
    blunt: IntArray,
    free: IntArray,
    n: int,
    step: FloatArray,
    pitch: float,
    trial: FloatArray,
) -> None:
    """Write theta + step to trial, held to the sensor, to the ends' pitch and to the order on each chain."""
    size = ENDS + 2 * m
    for i in range(size):
        trial[i] = theta[i]
    for i in range(n):
        trial[free[i]] += step[i]
    trial[0] = min(max(trial[0], -0.5 * pitch), 0.5 * pitch)
    trial[3] = min(max(trial[3], 1.0 - 0.5 * pitch), 1.0 + 0.5 * pitch)
    if m > 0:  # halfway to the first or last vertex at most, as below
        trial[0] = min(trial[0], max(theta[0], 0.5 * (theta[0] + theta[ENDS]) - 0.25 * pitch))
        trial[3] = max(trial[3], min(theta[3], 0.5 * (theta[3] + theta[ENDS + 2 * m - 2]) + 0.25 * pitch))
    for first in (1, 4):
        for i in range(first, first + 2):
            trial[i] = min(max(trial[i], 0.0), 1.0)
        side = first // 3
        if not blunt[side]:
            trial[first + 1] = trial[first]
    for j in range(m):
        before, after = theta[0], theta[3]
        for i in range(m):
            if chain[i] == chain[j]:
                if i < j:
                    before = theta[ENDS + 2 * i]
                elif i > j:
                    after = theta[ENDS + 2 * i]
                    break
        i = ENDS + 2 * j
        here = theta[i]
        # Halfway to the neighbour at most, so that two that approach each other never pass.
        low = here - max(0.5 * (here - before) - 0.25 * pitch, 0.0)
        high = here + max(0.5 * (after - here) - 0.25 * pitch, 0.0)
        trial[i] = min(max(trial[i], low), high)
        trial[i + 1] = min(max(trial[i + 1], 0.0), 1.0)


@compiled(f"float64({F1},{I1},int64,{I1},{DATA},{MODEL},int64,float64,float64)")
def descend(
    theta: FloatArray,
    chain: IntArray,
    m: int,
    blunt: IntArray,
    data: Data,
    signal: Model,
    most: int,
    least: float,
    wanted: float,
) -> float:
    """Improve a fit in place by Levenberg-Marquardt; return its cost.

    data = x (n,), k (S, n), weight (S, n), pitch; signal = shares (S,), narrow, lam. It ends after `most` steps
    or when one gains less than `least`, or when it is not on its way to cost less than `wanted`.
    """
    pitch = data[3]
    size = ENDS + 2 * m
    matrix, other = np.empty((size, size)), np.empty((size, size))
    gradient, other_gradient, step = np.empty(size), np.empty(size), np.empty(size)
    trial, trial_chain = np.empty(size), np.empty(m, np.int64)
    small, free = np.empty((size, size)), np.empty(size, np.int64)
    sort_vertices(theta, chain, m)
    cost = normal_equations(theta, chain, m, blunt, data, signal, matrix, gradient)
    cost += with_prior(theta, blunt, pitch, matrix, gradient)
    damping = _DAMPING
    for _ in range(most):
        n = free_entries(m, blunt, free)
        kept = 0
        for i in range(n):  # an entry at its bound that the gradient pushes on stays
            f = free[i]
            if f == 0 or f == 3:
                low, high = f // 3 - 0.5 * pitch, f // 3 + 0.5 * pitch
            elif f < ENDS or f % 2 == 1:
                low, high = 0.0, 1.0
            else:
                low, high = -np.inf, np.inf
            if (theta[f] > low or gradient[f] > 0.0) and (theta[f] < high or gradient[f] < 0.0):
                free[kept] = f
                kept += 1
        for i in range(kept):
            for j in range(kept):
                small[i, j] = matrix[free[i], free[j]]
            small[i, i] += damping * small[i, i] + _LEAST
            step[i] = gradient[free[i]]
        gain = -1.0
        if cholesky(small, kept):
            solve_cholesky(small, kept, step)
            move(theta, chain, m, blunt, free, kept, step, pitch, trial)
            for j in range(m):
                trial_chain[j] = chain[j]
            sort_vertices(trial, trial_chain, m)
            new = normal_equations(trial, trial_chain, m, blunt, data, signal, other, other_gradient)
            new += with_prior(trial, blunt, pitch, other, other_gradient)
            gain = cost - new
        if gain >= 0.0:
            for i in range(size):
                theta[i] = trial[i]
            for j in range(m):
                chain[j] = trial_chain[j]
            cost = new
            matrix, other = other, matrix
            gradient, other_gradient = other_gradient, gradient
            damping = max(0.1 * damping, _LEAST)
            if gain < least or cost - _HOPE * gain > wanted:
                break
        else:
            damping *= 8.0
            if damping > _STUCK:
                break
    return cost

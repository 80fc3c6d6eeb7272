"""Levenberg-Marquardt for the polygon fit: from starts to the nearest least-squares polygons."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.cost import free_entries, normal_equations
from tacstrip.core.problem import FitProblem

_DAMPING, _STUCK = 1e-3, 1e8  # of J'J's diagonal: at first, and where a descent gives up
_ALWAYS = 1e-9  # damping that stays
_HOPE = 2.0  # a descent will not gain more than twice what its last step did


def descend(
    theta: FloatArray,
    chain: IntArray,
    vertical_ends: IntArray,
    problem: FitProblem,
    steps: int,
    least: float,
    wanted: float,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Improve a batch by Levenberg-Marquardt.

    Parameters
    ----------
    theta, chain, vertical_ends
        The starts, as `equations` has a batch.
    problem
        Readings and weights.
    steps, least, wanted
        A descent ends after so many steps, when one gains less than `least`, or when it is not on its way to cost less
        than `wanted`.

    Returns
    -------
    tuple
        theta (B, P), chain (B, m) and the costs (B,).
    """
    theta, chain = ordered(theta, chain)
    cost, matrix, gradient = normal_equations(theta, chain, vertical_ends, problem)
    size, half = theta.shape[1], 0.5 * problem.pitch
    low, high = np.zeros(size), np.ones(size)
    low[[0, 3]], high[[0, 3]] = (-half, 1.0 - half), (half, 1.0 + half)
    low[END_ENTRIES::2], high[END_ENTRIES::2] = -np.inf, np.inf
    free, diagonal = free_entries(size, vertical_ends), np.arange(size)
    damping, going = np.full(len(theta), _DAMPING), np.arange(len(theta))
    found = theta.copy(), chain.copy(), cost.copy()
    for _ in range(steps):
        # An entry at its bound that the gradient pushes on stays.
        moves = free & ((theta > low) | (gradient > 0.0)) & ((theta < high) | (gradient < 0.0))
        normal = np.where(moves[:, :, None] & moves[:, None, :], matrix, 0.0)
        own = normal[:, diagonal, diagonal] * (1.0 + damping[:, None]) + _ALWAYS
        normal[:, diagonal, diagonal] = np.where(moves, own, 1.0)
        step = np.linalg.solve(normal, np.where(moves, gradient, 0.0)[..., None])[..., 0]
        trial, trial_chain = ordered(moved(theta, chain, vertical_ends, step, problem.pitch), chain)
        new_cost, new_matrix, new_gradient = normal_equations(trial, trial_chain, vertical_ends, problem)
        gain = cost - new_cost
        better = gain >= 0.0
        theta, chain = np.where(better[:, None], trial, theta), np.where(better[:, None], trial_chain, chain)
        matrix = np.where(better[:, None, None], new_matrix, matrix)
        gradient, cost = np.where(better[:, None], new_gradient, gradient), np.where(better, new_cost, cost)
        damping = np.where(better, np.maximum(0.1 * damping, _ALWAYS), 8.0 * damping)
        found[0][going], found[1][going], found[2][going] = theta, chain, cost
        go = ~(better & ((gain < least) | (cost - _HOPE * gain > wanted))) & (damping <= _STUCK)
        if not go.any():
            break
        going, theta, chain, damping = going[go], theta[go], chain[go], damping[go]
        cost, matrix, gradient = cost[go], matrix[go], gradient[go]
    return found


def ordered(theta: FloatArray, chain: IntArray) -> tuple[FloatArray, IntArray]:
    """Return a batch with its vertices in ascending x; opposite chains may pass each other."""
    order = np.argsort(theta[:, END_ENTRIES::2], axis=1, kind="stable")
    theta = theta.copy()
    for entry in (END_ENTRIES, END_ENTRIES + 1):
        theta[:, entry::2] = np.take_along_axis(theta[:, entry::2], order, 1)
    return theta, np.take_along_axis(chain, order, 1)


def moved(
    theta: FloatArray, chain: IntArray, vertical_ends: IntArray, step: FloatArray, pitch: float
) -> FloatArray:
    """Return theta + step (B, P), held to the sensor, to the ends' pitch and to the order on each chain."""
    trial, half, x = theta + step, 0.5 * pitch, theta[:, END_ENTRIES::2]
    first, last, m = theta[:, :1], theta[:, 3:4], chain.shape[1]
    for at_end, other in ((0, x[:, :1]), (3, x[:, -1:])):
        end = at_end // 3
        trial[:, at_end] = np.clip(trial[:, at_end], end - half, end + half)
        if m:
            own, middle = theta[:, at_end], 0.5 * (theta[:, at_end] + other[:, 0])
            if end:
                trial[:, 3] = np.maximum(trial[:, 3], np.minimum(own, middle + 0.5 * half))
            else:
                trial[:, 0] = np.minimum(trial[:, 0], np.maximum(own, middle - 0.5 * half))
        both = slice(at_end + 1, at_end + 3)
        trial[:, both] = np.clip(trial[:, both], 0.0, 1.0)
        if not vertical_ends[end]:
            trial[:, at_end + 2] = trial[:, at_end + 1]
    # Halfway to the neighbour at most, so that two that approach each other never pass.
    same, earlier = chain[:, :, None] == chain[:, None, :], np.tri(m, k=-1, dtype=bool)
    place = np.arange(m)
    before = np.where(same & earlier, place, -1).max(axis=2, initial=-1)
    after = np.where(same & earlier.T, place, m).min(axis=2, initial=m)
    knots = np.concatenate([first, x, last], axis=1)
    room_before = np.maximum(0.5 * (x - np.take_along_axis(knots, before + 1, 1)) - 0.5 * half, 0.0)
    room_after = np.maximum(0.5 * (np.take_along_axis(knots, after + 1, 1) - x) - 0.5 * half, 0.0)
    trial[:, END_ENTRIES::2] = np.clip(trial[:, END_ENTRIES::2], x - room_before, x + room_after)
    trial[:, END_ENTRIES + 1 :: 2] = np.clip(trial[:, END_ENTRIES + 1 :: 2], 0.0, 1.0)
    return trial

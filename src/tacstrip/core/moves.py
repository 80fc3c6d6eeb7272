"""The moves of the polygon search, in NumPy: a first vertex, one vertex more, one vertex less.

A move makes starts of one kind, descends from all of them at once and keeps what is best.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.descent import descend
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.core.score_test import places

FIRST, GROW, SHRINK = 0, 1, 2  # moves
ROUGH = 12  # steps of a descent
ENOUGH = 0.1  # of chi square: a descent step that gains less is the last
_FIRST_PLACES = 5  # positions of a first vertex, on each chain
_ROUNDING = 1e-3  # of chi square


def improve(move: int, fit: PolygonFit, cost: float, convex: bool, problem: FitProblem) -> PolygonFit | None:
    """Try one kind of move on a fit; return the best of what it makes, None where nothing costs less than `cost`."""
    if move == FIRST:
        theta, chain = first_places(fit.theta, problem)
    elif move == GROW:
        theta, chain = places(fit.theta, fit.chain, fit.vertical_ends, convex, problem)
    else:
        theta, chain = without_each(fit.theta, fit.chain)
    if not len(theta):
        return None
    best, wanted = None, cost
    theta, chain, costs = descend(theta, chain, fit.vertical_ends, problem, ROUGH, ENOUGH, wanted)
    for start, kinds, found in zip(theta, chain, costs, strict=True):
        if convex and found < wanted and turned(start, kinds, fit.vertical_ends):
            again = descend(start[None], kinds[None], fit.vertical_ends, problem, ROUGH, ENOUGH, wanted)
            start, kinds, found = (values[0] for values in again)
            if turned(start, kinds, fit.vertical_ends):
                continue
        if found < cost - _ROUNDING:
            best, cost = PolygonFit(start, kinds, fit.vertical_ends, float(found)), float(found)
    return best


def first_places(theta: FloatArray, problem: FitProblem) -> tuple[FloatArray, IntArray]:
    """Return starts with one vertex, each of which alone makes the reading where it is."""
    k, n, starts = problem.k[0], len(problem.x), []
    for place in range(_FIRST_PLACES):
        i = min(n * (2 * place + 1) // (2 * _FIRST_PLACES), n - 1)
        reading = (k[max(i - 1, 0)] + k[i] + k[min(i + 1, n - 1)]) / 3.0
        c_u = problem.shares[0] + problem.narrow * reading
        for upper, own in ((0, 1.0 - c_u), (1, c_u)):
            opposite = theta[2 - upper] + (theta[5 - upper] - theta[2 - upper]) * problem.x[i]
            height = (reading - (1.0 - own) * opposite) / max(own, 1e-3)
            starts.append([*theta, problem.x[i], min(max(height, 0.0), 1.0)])
    return np.array(starts), np.tile([[0], [1]], (_FIRST_PLACES, 1))


def without_each(theta: FloatArray, chain: IntArray) -> tuple[FloatArray, IntArray]:
    """Return starts that lack one vertex each."""
    places = range(len(chain))
    starts = [np.delete(theta, [END_ENTRIES + 2 * out, END_ENTRIES + 2 * out + 1]) for out in places]
    return np.array(starts), np.array([np.delete(chain, out) for out in places])


def turned(theta: FloatArray, chain: IntArray, vertical_ends: IntArray) -> int:
    """Move each corner that turns inwards to the other chain, where it makes a kink of the same sign outwards."""
    count = 0
    for j, upper in enumerate(chain):
        y = END_ENTRIES + 2 * j + 1
        lift = theta[y] - _chord(theta, chain, vertical_ends, j, int(upper))
        if (lift < 0.0) == (upper == 1) and lift != 0.0:
            theta[y] = min(max(_chord(theta, chain, vertical_ends, j, 1 - int(upper)) + lift, 0.0), 1.0)
            chain[j] = 1 - upper
            count += 1
    return count


def _chord(theta: FloatArray, chain: IntArray, vertical_ends: IntArray, j: int, upper: int) -> float:
    """Return how high a chain would be at vertex j if that were not on it."""
    on = np.flatnonzero(chain == upper)
    before, after = on[on < j], on[on > j]
    left, right = (3 * end + (1 + upper if vertical_ends[end] else 1) for end in (0, 1))
    ax, ay = (END_ENTRIES + 2 * before[-1], END_ENTRIES + 2 * before[-1] + 1) if len(before) else (0, left)
    bx, by = (END_ENTRIES + 2 * after[0], END_ENTRIES + 2 * after[0] + 1) if len(after) else (3, right)
    slope = (theta[by] - theta[ay]) / max(theta[bx] - theta[ax], 1e-12)
    return float(theta[ay] + slope * (theta[END_ENTRIES + 2 * j] - theta[ax]))

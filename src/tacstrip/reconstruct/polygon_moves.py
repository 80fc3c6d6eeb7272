"""The moves of the polygon search, compiled: a first vertex, one vertex more, one vertex less.

A move makes starts of one kind, descends from each and keeps what is best. Layouts as in `kernels`.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import ENDS, Data, Model, edge, knot
from tacstrip.reconstruct.polygon_compiled import DATA, F1, F2, I1, I2, MODEL, compiled
from tacstrip.reconstruct.polygon_descent import descend
from tacstrip.reconstruct.polygon_score import places

MOST = 16  # interior vertices
FIRST, GROW, SHRINK = 0, 1, 2  # moves
ROUGH = 12  # steps of a descent
ENOUGH = 0.1  # of chi square: a descent step that gains less is the last
_STARTS = 5  # positions of a first vertex, on each chain
_ROUNDING = 1e-3  # of chi square


@compiled()
def first_places(theta: FloatArray, data: Data, signal: Model, starts: FloatArray, kinds: IntArray) -> int:
    """Write starts with one vertex, each of which alone makes the reading where it is; return how many."""
    x, k, _, _ = data
    shares, narrow, _ = signal
    n, count = len(x), 0
    for place in range(_STARTS):
        i = min(n * (2 * place + 1) // (2 * _STARTS), n - 1)
        reading = (k[0, max(i - 1, 0)] + k[0, i] + k[0, min(i + 1, n - 1)]) / 3.0
        c_u = shares[0] + narrow * reading
        for upper in range(2):
            for q in range(ENDS):
                starts[count, q] = theta[q]
            opposite = theta[2 - upper] + (theta[5 - upper] - theta[2 - upper]) * x[i]
            own = c_u if upper else 1.0 - c_u
            height = (reading - (1.0 - own) * opposite) / max(own, 1e-3)
            starts[count, ENDS], starts[count, ENDS + 1] = x[i], min(max(height, 0.0), 1.0)
            kinds[count, 0] = upper
            count += 1
    return count


@compiled()
def without_each(theta: FloatArray, chain: IntArray, m: int, starts: FloatArray, kinds: IntArray) -> int:
    """Write starts that lack one vertex each; return how many."""
    for out in range(m):
        at = ENDS + 2 * out
        for q in range(ENDS + 2 * m - 2):
            starts[out, q] = theta[q if q < at else q + 2]
        for j in range(m - 1):
            kinds[out, j] = chain[j if j < out else j + 1]
    return m


@compiled()
def chord(theta: FloatArray, chain: IntArray, m: int, blunt: IntArray, j: int, upper: int) -> float:
    """Return how high a chain would be at vertex j if that were not on it."""
    before, after = -1, -1
    for i in range(m):
        if chain[i] == upper and i != j:
            if i < j:
                before = i
            else:
                after = i
                break
    line = np.empty(4)
    edge(theta, knot(blunt, before, upper, False), knot(blunt, after, upper, True), line)
    return float(line[1] + line[2] * (theta[ENDS + 2 * j] - line[0]))


@compiled()
def turned(theta: FloatArray, chain: IntArray, m: int, blunt: IntArray) -> int:
    """Move each corner that turns inwards to the other chain, where it makes a kink of the same sign outwards."""
    count = 0
    for j in range(m):
        y = ENDS + 2 * j + 1
        lift = theta[y] - chord(theta, chain, m, blunt, j, chain[j])
        if (lift < 0.0) == (chain[j] == 1) and lift != 0.0:
            theta[y] = min(max(chord(theta, chain, m, blunt, j, 1 - chain[j]) + lift, 0.0), 1.0)
            chain[j] = 1 - chain[j]
            count += 1
    return count


@compiled(f"boolean(int64,{F2},{I2},{F1},int64,{I1},boolean,{DATA},{MODEL})")
def improve(
    move_kind: int,
    fits: FloatArray,
    kinds: IntArray,
    costs: FloatArray,
    m: int,
    blunt: IntArray,
    convex: bool,
    data: Data,
    signal: Model,
) -> bool:
    """Try one kind of move on the fit of m vertices; return whether a fit of one more, or less, got better.

    fits (MOST + 1, ENDS + 2 MOST), kinds (MOST + 1, MOST), costs (MOST + 1,): the best fit of each count so far.
    """
    to = m - 1 if move_kind == SHRINK else m + 1
    starts, chains = np.empty((2 * MOST, ENDS + 2 * MOST)), np.empty((2 * MOST, MOST), np.int64)
    if move_kind == FIRST:
        count = first_places(fits[0], data, signal, starts, chains)
    elif move_kind == GROW:
        count = places(fits[m], kinds[m], m, blunt, convex, data, signal, starts, chains)
    else:
        count = without_each(fits[m], kinds[m], m, starts, chains)
    better = False
    for t in range(count):
        cost = descend(starts[t], chains[t], to, blunt, data, signal, ROUGH, ENOUGH, costs[to])
        if convex and cost < costs[to] and turned(starts[t], chains[t], to, blunt):
            cost = descend(starts[t], chains[t], to, blunt, data, signal, ROUGH, ENOUGH, costs[to])
            if turned(starts[t], chains[t], to, blunt):
                continue
        if cost < costs[to] - _ROUNDING:
            better = True
            costs[to] = cost
            for q in range(ENDS + 2 * to):
                fits[to, q] = starts[t, q]
            for j in range(to):
                kinds[to, j] = chains[t, j]
    return better

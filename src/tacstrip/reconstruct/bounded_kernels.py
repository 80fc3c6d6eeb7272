"""Compiled: a walk through a set of bounds, and the least value of a linear form in a polytope.

The readable versions are `bounded_sample.plain_walk` and SciPy's `linprog`; tests hold them together.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_ROUNDING = 1e-9
_SLANTED = 1e-7  # a row less against the direction than this depends on the met ones; to pass it by is safe


@njit(cache=True, nogil=True, error_model="numpy")
def walk(a, slack, edge, pair_a, pair_slack, pair_edge, draws, out):  # type: ignore[no-untyped-def]
    """Walk as `bounded_sample.plain_walk` does; same arguments, slacks are changed in place."""
    rows, pairs, size = a.shape[1], pair_a.shape[1], len(a)
    cut, pair_cut = np.zeros(rows), np.zeros(pairs)
    z = np.zeros(size)
    for sweep in range(len(out)):
        w = 0
        for i in range(rows):
            cut[i] = draws[sweep, w] * min(edge[i], slack[i])
            w += 1
        for i in range(pairs):
            pair_cut[i] = draws[sweep, w] * min(pair_edge[i], max(pair_slack[i, 0], pair_slack[i, 1]))
            w += 1
        for j in range(size):
            up, down = steepest(a[j], slack, cut)
            high, low = 1.0 / up, 1.0 / down
            for i in range(pairs):
                s1, s2 = pair_slack[i, 0] - pair_cut[i], pair_slack[i, 1] - pair_cut[i]
                r1, r2 = pair_a[j, i, 0], pair_a[j, i, 1]
                high = min(high, held(s1, s2, r1, r2))
                low = max(low, -held(s1, s2, -r1, -r2))
            step = low + (high - low) * draws[sweep, w]
            w += 1
            z[j] += step
            for i in range(rows):
                slack[i] -= step * a[j, i]
            for i in range(pairs):
                pair_slack[i, 0] -= step * pair_a[j, i, 0]
                pair_slack[i, 1] -= step * pair_a[j, i, 1]
        for j in range(size):
            out[sweep, j] = z[j]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz", "reassoc"})
def steepest(row, slack, cut):  # type: ignore[no-untyped-def]
    """Return the largest and the smallest of row / (slack - cut), at least 0 and at most 0 but for a trace."""
    up, down = 1e-300, -1e-300
    for i in range(len(row)):
        q = row[i] / (slack[i] - cut[i])
        up, down = max(up, q), min(down, q)
    return up, down


@njit(cache=True, nogil=True, error_model="numpy")
def held(s1, s2, r1, r2):  # type: ignore[no-untyped-def]
    """Return how far one can go while slack s1 - d r1 or s2 - d r2 is not below 0, from d = 0 on."""
    if s1 < s2:
        s1, s2, r1, r2 = s2, s1, r2, r1
    reach = max(s1, 0.0) / r1 if r1 > 0.0 else np.inf
    if s2 >= 0.0:
        return max(reach, s2 / r2 if r2 > 0.0 else np.inf)
    if r2 < 0.0 and s2 / r2 <= reach:
        return np.inf
    return reach


@njit(cache=True, nogil=True, error_model="numpy")
def lowest(form, a, slack, at, active):  # type: ignore[no-untyped-def]
    """Return the least of form z where a z <= slack, in rows of a (M, P); -inf where none was found.

    By an active set: downhill along the rows that are met, which are given up where their multiplier is negative.
    at (P,) is a point inside and active (P,) its met rows, -1 for none; both are moved to the lowest point.
    """
    rows, size = a.shape
    basis, root = np.empty((size, size)), np.zeros((size, size))
    direction, multiplier = np.empty(size), np.empty(size)
    is_met = np.zeros(rows, np.bool_)
    met = 0
    while met < size and active[met] >= 0:
        is_met[active[met]] = True
        met += 1
    scale = 0.0
    for p in range(size):
        scale = max(scale, abs(form[p]))
    for _ in range(40 * size):
        # Orthonormal basis of the met rows (twice for accuracy), then what is left of the form.
        for q in range(met):
            for p in range(size):
                basis[q, p] = a[active[q], p]
            for r in range(q):
                root[r, q] = 0.0
            for _ in range(2):
                for r in range(q):
                    dot = 0.0
                    for p in range(size):
                        dot += basis[r, p] * basis[q, p]
                    root[r, q] += dot
                    for p in range(size):
                        basis[q, p] -= dot * basis[r, p]
            norm = 0.0
            for p in range(size):
                norm += basis[q, p] ** 2
            root[q, q] = np.sqrt(norm)
            for p in range(size):
                basis[q, p] /= root[q, q]
        for p in range(size):
            direction[p] = -form[p]
        for q in range(met):
            dot = 0.0
            for p in range(size):
                dot += basis[q, p] * direction[p]
            multiplier[q] = dot
            for p in range(size):
                direction[p] -= dot * basis[q, p]
        length = 0.0
        for p in range(size):
            length = max(length, abs(direction[p]))
        if met == size or length <= _ROUNDING * scale:
            for q in range(met - 1, -1, -1):
                for r in range(q + 1, met):
                    multiplier[q] -= root[q, r] * multiplier[r]
                multiplier[q] /= root[q, q]
            worst = -1
            for q in range(met):
                if multiplier[q] < -_ROUNDING * scale and (worst < 0 or multiplier[q] < multiplier[worst]):
                    worst = q
            if worst < 0:
                value = 0.0  # of the dual: a bound whatever the rounding of `at`
                for q in range(met):
                    value -= max(multiplier[q], 0.0) * slack[active[q]]
                return value
            is_met[active[worst]] = False
            for q in range(worst, met - 1):
                active[q] = active[q + 1]
            met -= 1
            active[met] = -1
            continue
        step, row = np.inf, -1
        for i in range(rows):
            if is_met[i]:
                continue
            along, room = 0.0, slack[i]
            for p in range(size):
                along += a[i, p] * direction[p]
                room -= a[i, p] * at[p]
            if along > _SLANTED * length and max(room, 0.0) < step * along:
                step, row = max(room, 0.0) / along, i
        if row < 0:
            return -np.inf
        for p in range(size):
            at[p] += step * direction[p]
        active[met] = row
        is_met[row] = True
        met += 1
    return -np.inf

"""Where one vertex more gains most: the score test of the polygon search, compiled.

A new vertex lifts its chain by a hat: its feet are the neighbours on that chain, its top is the vertex. With v the
readings' answer to the hat's height, r the residuals and J the slopes of what is fitted already, the fit gains
(v'r)^2 / (v'v - v'J (J'J)^-1 J'v). Running sums over strips give that for every place. Layouts as in `kernels`.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.kernels import (
    ENDS,
    Data,
    Model,
    edge,
    first_from,
    knot,
    normal_equations,
    strip_terms,
    with_prior,
)
from tacstrip.reconstruct.polygon_cholesky import cholesky
from tacstrip.reconstruct.polygon_compiled import F2, compiled
from tacstrip.reconstruct.polygon_descent import free_entries, move

TRIED = 3  # best places of one more vertex that are tried
_PLACES = 48  # positions that are tested
_NEAR = 3  # of them, within which two are one place
_FIRM, _LEAST = 1e-6, 1e-9  # added to the diagonal of J'J, over it and plainly
OWN = 1e-5  # of v'v: less of it is left where the hat is nothing new


@compiled()
def running_sums(
    theta: FloatArray,
    chain: IntArray,
    m: int,
    blunt: IntArray,
    data: Data,
    signal: Model,
    columns: FloatArray,
    sums: FloatArray,
) -> None:
    """Write, for each chain c, what strips up to each one add up to.

    columns (2, 2, n + 1, size + 1): chain, power of x, strips so far; x^power times g_c J by each entry of theta, and
    g_c r in the last place. sums (2, n + 1, 3): g_c^2, x g_c^2 and x^2 g_c^2.
    """
    x, k, weight, _ = data
    shares, narrow, lam = signal
    size = ENDS + 2 * m
    lines = np.empty((2, 4))
    at, left = np.empty((2, 2, 2), np.int64), [-1, -1]
    terms = np.empty(5)
    section, fresh = 0, True
    for c in range(2):
        for q in range(size + 1):
            columns[c, 0, 0, q] = columns[c, 1, 0, q] = 0.0
        for q in range(3):
            sums[c, 0, q] = 0.0
    for i in range(len(x)):
        while section < m and theta[ENDS + 2 * section] <= x[i]:
            left[chain[section]] = section
            section += 1
            fresh = True
        if fresh:
            for upper in range(2):
                j = section
                while j < m and chain[j] != upper:
                    j += 1
                a = knot(blunt, left[upper], upper, False)
                b = knot(blunt, j if j < m else -1, upper, True)
                edge(theta, a, b, lines[upper])
                at[upper, 0, 0], at[upper, 0, 1] = a
                at[upper, 1, 0], at[upper, 1, 1] = b
            fresh = False
        for q in range(5):
            terms[q] = 0.0  # g_l^2, g_l g_u, g_u^2, g_l r, g_u r
        l = lines[0, 1] + lines[0, 2] * (x[i] - lines[0, 0])
        u = lines[1, 1] + lines[1, 2] * (x[i] - lines[1, 0])
        for s in range(len(shares)):
            of = strip_terms(l, u, k[s, i], weight[s, i], shares[s], narrow, lam)
            for q in range(5):
                terms[q] += of[q]
        for c in range(2):
            for power in range(2):
                for q in range(size + 1):
                    columns[c, power, i + 1, q] = columns[c, power, i, q]
            for upper in range(2):
                g = terms[c + upper]  # g_c g_upper
                right = (x[i] - lines[upper, 0]) * lines[upper, 3]
                for side in range(2):
                    v = g * (right if side else 1.0 - right)
                    y_at, x_at, slope = at[upper, side, 1], at[upper, side, 0], lines[upper, 2]
                    columns[c, 0, i + 1, y_at] += v
                    columns[c, 1, i + 1, y_at] += v * x[i]
                    columns[c, 0, i + 1, x_at] -= v * slope
                    columns[c, 1, i + 1, x_at] -= v * slope * x[i]
            gr, gg = terms[3 + c], terms[2 * c]
            columns[c, 0, i + 1, size] += gr
            columns[c, 1, i + 1, size] += gr * x[i]
            for q in range(3):
                sums[c, i + 1, q] = sums[c, i, q] + gg
                gg *= x[i]


@compiled(f"float64({F2},{F2},int64,int64,int64,int64,float64,float64,float64)")
def hat(
    plain: FloatArray, by_x: FloatArray, e: int, ia: int, ip: int, ib: int, a: float, p: float, b: float
) -> float:
    """Return the sum of f times a hat with feet a, b and top p; column e has the running sums of f and of x f."""
    rise = (by_x[ip, e] - by_x[ia, e] - a * (plain[ip, e] - plain[ia, e])) / (p - a)
    return float(rise + (b * (plain[ib, e] - plain[ip, e]) - (by_x[ib, e] - by_x[ip, e])) / (b - p))


@compiled()
def squares(s: FloatArray, start: int, end: int, foot: float) -> float:
    """Return the sum of (x - foot)^2 g^2 over strips, from the running sums of g^2, x g^2 and x^2 g^2."""
    second = s[end, 2] - s[start, 2] - 2.0 * foot * (s[end, 1] - s[start, 1])
    return float(second + foot * foot * (s[end, 0] - s[start, 0]))


@compiled()
def places(
    theta: FloatArray,
    chain: IntArray,
    m: int,
    blunt: IntArray,
    convex: bool,
    data: Data,
    signal: Model,
    starts: FloatArray,
    kinds: IntArray,
) -> int:
    """Write fits with one vertex more, where the score test gains most; return how many.

    starts (TRIED, size + 2), kinds (TRIED, m + 1): theta and chains, not sorted.
    """
    x, _, _, pitch = data
    n, size = len(x), ENDS + 2 * m
    matrix, gradient = np.empty((size, size)), np.empty(size)
    normal_equations(theta, chain, m, blunt, data, signal, matrix, gradient)
    with_prior(theta, blunt, pitch, matrix, gradient)
    free = np.empty(size, np.int64)
    f = free_entries(m, blunt, free)
    factor = np.empty((f, f))
    for i in range(f):
        for j in range(f):
            factor[i, j] = matrix[free[i], free[j]]
        factor[i, i] += _FIRM * factor[i, i] + _LEAST
    if not cholesky(factor, f):
        return 0
    columns, sums = np.empty((2, 2, n + 1, size + 1)), np.empty((2, n + 1, 3))
    running_sums(theta, chain, m, blunt, data, signal, columns, sums)
    stride = max(n // _PLACES, 1)
    top, height, where = np.zeros(TRIED), np.zeros(TRIED), np.zeros(TRIED, np.int64)
    side = np.zeros(TRIED, np.int64)
    shifts, c = np.zeros((TRIED, f)), np.empty(f)
    for upper in range(2):
        ja, jb = -1, 0
        while jb < m and chain[jb] != upper:
            jb += 1
        for i in range(stride, n - 1, stride):
            while jb < m and theta[ENDS + 2 * jb] <= x[i]:
                ja = jb
                jb += 1
                while jb < m and chain[jb] != upper:
                    jb += 1
            a = theta[ENDS + 2 * ja] if ja >= 0 else theta[0]
            b = theta[ENDS + 2 * jb] if jb < m else theta[3]
            p = x[i]
            if p - a < pitch or b - p < pitch:
                continue
            ia, ib = first_from(x, a), first_from(x, b)
            plain, by_x, s = columns[upper, 0], columns[upper, 1], sums[upper]
            vr = hat(plain, by_x, size, ia, i + 1, ib, a, p, b)
            if convex and (vr > 0.0) != (upper == 1):
                continue
            vv = squares(s, ia, i + 1, a) / (p - a) ** 2 + squares(s, i + 1, ib, b) / (b - p) ** 2
            own = vv
            for q in range(f):
                e = free[q]
                v = hat(plain, by_x, e, ia, i + 1, ib, a, p, b)
                for r in range(q):
                    v -= factor[q, r] * c[r]
                c[q] = v / factor[q, q]
                own -= c[q] * c[q]
            if own <= OWN * vv:
                continue
            score = vr * vr / own
            # Near an earlier place on the same chain the better of both counts, else the worst gives way.
            slot = 0
            for t in range(TRIED):
                if top[t] > 0.0 and side[t] == upper and i - where[t] <= _NEAR * stride:
                    slot = t
                    break
                if top[t] < top[slot]:
                    slot = t
            if score > top[slot]:
                top[slot], height[slot], where[slot], side[slot] = score, vr / own, i, upper
                for q in range(f):
                    shifts[slot, q] = c[q]
    worst = 0
    for t in range(TRIED):
        if top[t] < top[worst]:
            worst = t
    count = 0
    for t in range(TRIED):
        # Two signatures tell the chain, and l and u are nearly linear in the readings: one place less is enough.
        if top[t] <= 0.0 or (t == worst and not convex):
            continue
        p, upper, new = x[where[t]], side[t], starts[count]
        for q in range(f - 1, -1, -1):  # what the others do meanwhile: -(J'J)^-1 J'v times the height
            v = shifts[t, q]
            for r in range(q + 1, f):
                v -= factor[r, q] * c[r]
            c[q] = v / factor[q, q]
        for q in range(f):
            shifts[t, q] = -height[t] * c[q]
        move(theta, chain, m, blunt, free, f, shifts[t], pitch, new)
        before, after = (new[0], new[1 + upper]), (new[3], new[4 + upper])
        for j in range(m):
            if chain[j] == upper:
                if new[ENDS + 2 * j] <= p:
                    before = (new[ENDS + 2 * j], new[ENDS + 2 * j + 1])
                else:
                    after = (new[ENDS + 2 * j], new[ENDS + 2 * j + 1])
                    break
        line = before[1] + (after[1] - before[1]) * (p - before[0]) / (after[0] - before[0])
        new[size], new[size + 1] = p, min(max(line + height[t], 0.0), 1.0)
        for j in range(m):
            kinds[count, j] = chain[j]
        kinds[count, m] = upper
        count += 1
    return count

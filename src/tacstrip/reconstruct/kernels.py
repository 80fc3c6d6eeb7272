"""The normal equations of the polygon fit, compiled; `polygon_plain.py` is the same in NumPy.

A fit is a vector theta and a chain per vertex. theta holds the ends, then x and y of each interior vertex,
ascending in x:

    theta = x_left, l_left, u_left, x_right, l_right, u_right, x_0, y_0, x_1, y_1, ...
    chain[j] = 0: vertex j is on the lower chain, 1: on the upper one

x counts from 0 to 1 over the run (n pitches), y from 0 to 1 over the strip. A pointed end has one height: its
u follows its l. `Data` and `Model` are what a `Signal` gives.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.reconstruct.polygon_compiled import DATA, F1, F2, I1, MODEL, compiled

ENDS = 6  # entries of theta before the first vertex
LEAST_D = 1e-3  # of L: a metal sheet under a whole strip would divide by zero
CROSSED = 100.0  # weight of l > u against a reading
# Of L, from where on l > u counts. In a pointed end that lies on a strip l = u; a rounding error must not decide there
# whether the weight above joins J'WJ.
CROSSED_FROM = 1e-9
# The pairs of columns in the order of section_sums.
_PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))

Data: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, float]  # x (n,), k (S, n), weight (S, n), pitch
Model: TypeAlias = tuple[FloatArray, float, float]  # shares (S,), narrow, lam


@compiled()
def strip_terms(
    l: float, u: float, k: float, weight: float, share: float, narrow: float, lam: float
) -> tuple[float, float, float, float, float, float]:
    """Return g_l^2, g_l g_u, g_u^2, g_l r, g_u r and r^2 of one reading, times its weight; l > u costs extra."""
    w = u - l
    t = 0.0
    dt = 0.0
    if lam > 0.0:
        tanh = math.tanh(w / (2.0 * lam))
        t = lam * tanh
        dt = 0.5 * (1.0 - tanh * tanh)
    over = 1.0 / max(1.0 - narrow * (w - 2.0 * t), LEAST_D)
    model = ((1.0 - share) * (l + t) + share * (u - t)) * over
    by_l = (1.0 - share - narrow * model) * over
    by_u = (share + narrow * model) * over
    gl = by_l * (1.0 - dt) + by_u * dt
    gu = by_u * (1.0 - dt) + by_l * dt
    r = k - model
    c = CROSSED * weight if w < -CROSSED_FROM else 0.0
    rl, ru = weight * gl * r + c * w, weight * gu * r - c * w
    return (
        weight * gl * gl + c,
        weight * gl * gu - c,
        weight * gu * gu + c,
        rl,
        ru,
        weight * r * r + c * w * w,
    )


@compiled()
def section_sums(
    x: FloatArray,
    k: FloatArray,
    weight: FloatArray,
    share: float,
    narrow: float,
    lam: float,
    low: FloatArray,
    high: FloatArray,
    out: FloatArray,
) -> None:
    """Add the products of one section's residuals and derivatives to out (15,).

    low, high: x, y and slope, and 1 / extent in x, of the edges below and above. The four columns are the
    derivatives by the heights at the edges' ends: lower left, lower right, upper left, upper right.
    """
    n00 = n01 = n11 = n02 = n03 = n12 = n13 = n22 = n23 = n33 = 0.0
    g0 = g1 = g2 = g3 = cost = 0.0
    xa, ya, ma, ra = low[0], low[1], low[2], low[3]
    xc, yc, mc, rc = high[0], high[1], high[2], high[3]
    for i in range(len(x)):
        l = ya + ma * (x[i] - xa)
        u = yc + mc * (x[i] - xc)
        a, b, d, rl, ru, c = strip_terms(l, u, k[i], weight[i], share, narrow, lam)
        s1 = (x[i] - xa) * ra
        s0 = 1.0 - s1
        t1 = (x[i] - xc) * rc
        t0 = 1.0 - t1
        n00 += a * s0 * s0
        n01 += a * s0 * s1
        n11 += a * s1 * s1
        n02 += b * s0 * t0
        n03 += b * s0 * t1
        n12 += b * s1 * t0
        n13 += b * s1 * t1
        n22 += d * t0 * t0
        n23 += d * t0 * t1
        n33 += d * t1 * t1
        g0 += rl * s0
        g1 += rl * s1
        g2 += ru * t0
        g3 += ru * t1
        cost += c
    out[0] += n00
    out[1] += n01
    out[2] += n11
    out[3] += n02
    out[4] += n03
    out[5] += n12
    out[6] += n13
    out[7] += n22
    out[8] += n23
    out[9] += n33
    out[10] += g0
    out[11] += g1
    out[12] += g2
    out[13] += g3
    out[14] += cost


@compiled(f"UniTuple(int64,2)({I1},int64,int64,boolean)")
def knot(blunt: IntArray, j: int, upper: int, right: bool) -> tuple[int, int]:
    """Return the entries of theta that hold x and y of vertex j, or of an end (j < 0) on one chain."""
    if j >= 0:
        return ENDS + 2 * j, ENDS + 2 * j + 1
    first = 3 if right else 0
    return first, first + (2 if upper and blunt[1 if right else 0] else 1)


@compiled()
def first_from(x: FloatArray, at: float) -> int:
    """Return the first strip whose x is not below `at`."""
    low, high = 0, len(x)
    while low < high:
        middle = (low + high) // 2
        if x[middle] < at:
            low = middle + 1
        else:
            high = middle
    return low


@compiled()
def edge(theta: FloatArray, a: tuple[int, int], b: tuple[int, int], line: FloatArray) -> None:
    """Write the line between two knots, given by their entries, to line (4,): x, y, slope, 1 / extent."""
    run = 1.0 / max(theta[b[0]] - theta[a[0]], 1e-12)
    line[0], line[1], line[3] = theta[a[0]], theta[a[1]], run
    line[2] = (theta[b[1]] - theta[a[1]]) * run


@compiled(f"float64({F1},{I1},int64,{I1},{DATA},{MODEL},{F2},{F1})")
def normal_equations(
    theta: FloatArray,
    chain: IntArray,
    m: int,
    blunt: IntArray,
    data: Data,
    signal: Model,
    matrix: FloatArray,
    gradient: FloatArray,
) -> float:
    """Write J'WJ and J'Wr of all entries of theta; return the weighted sum of squares."""
    x, k, weight, _ = data
    shares, narrow, lam = signal
    size = ENDS + 2 * m
    for i in range(size):
        gradient[i] = 0.0
        for j in range(size):
            matrix[i, j] = 0.0
    low, high, out = np.empty(4), np.empty(4), np.empty(15)
    at, factor, sums = np.empty((4, 2), np.int64), np.empty(4), np.empty((4, 4))
    left = [-1, -1]
    cost = 0.0
    start, strips = 0, len(x)
    for section in range(m + 1):
        if section > 0:
            left[chain[section - 1]] = section - 1
        for upper in range(2):
            right = section
            while right < m and chain[right] != upper:
                right += 1
            a = knot(blunt, left[upper], upper, False)
            b = knot(blunt, right if right < m else -1, upper, True)
            line = high if upper else low
            edge(theta, a, b, line)
            at[2 * upper, 0], at[2 * upper, 1] = a
            at[2 * upper + 1, 0], at[2 * upper + 1, 1] = b
            factor[2 * upper] = factor[2 * upper + 1] = -line[2]
        end = strips
        if section < m:
            end = max(first_from(x, theta[ENDS + 2 * section]), start)
        if end == start:
            continue
        for i in range(15):
            out[i] = 0.0
        for s in range(len(shares)):
            section_sums(
                x[start:end], k[s, start:end], weight[s, start:end], shares[s], narrow, lam, low, high, out
            )
        start = end
        cost += out[14]
        for i, (p, q) in enumerate(_PAIRS):
            sums[p, q] = sums[q, p] = out[i]
        for p in range(4):
            px, py, fp = at[p, 0], at[p, 1], factor[p]
            gradient[py] += out[10 + p]
            gradient[px] += fp * out[10 + p]
            for q in range(4):
                qx, qy, fq, s_pq = at[q, 0], at[q, 1], factor[q], sums[p, q]
                matrix[py, qy] += s_pq
                matrix[py, qx] += s_pq * fq
                matrix[px, qy] += s_pq * fp
                matrix[px, qx] += s_pq * fp * fq
    return cost


@compiled()
def with_prior(
    theta: FloatArray, blunt: IntArray, pitch: float, matrix: FloatArray, gradient: FloatArray
) -> float:
    """Add what the touched strips say of a pointed end: it lies within one pitch, variance pitch^2 / 12."""
    cost = 0.0
    for side in range(2):
        if not blunt[side]:
            i = 3 * side
            off, weight = theta[i] - side, 12.0 / (pitch * pitch)
            matrix[i, i] += weight
            gradient[i] -= weight * off
            cost += weight * off * off
    return cost

"""Where one vertex more gains most: the score test of the polygon search, in NumPy.

A new vertex lifts its chain by a hat: its feet are the neighbours on that chain, its top is the vertex. With v the
readings' answer to the hat's height, r the residuals and J the slopes of what is fitted already, the fit gains
(v'r)^2 / (v'v - v'J (J'J)^-1 J'v).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.cost import free_entries, heights, normal_equations, terms
from tacstrip.core.descent import moved
from tacstrip.core.problem import FitProblem

TRIED = 3  # best places of one more vertex that are tried
_PLACES = 48  # positions that are tested
_NEAR = 3  # of them, within which two are one place
_FIRM, _LITTLE = 1e-6, 1e-9  # added to the diagonal of J'J, over it and plainly
NEW = 1e-5  # of v'v: less of it is left where the hat is nothing new


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place of one vertex more: what it gains, its strip, chain and height, and how the rest answers (P,)."""

    gain: float
    strip: int
    upper: int
    height: float
    shift: FloatArray


def places(
    theta: FloatArray, chain: IntArray, vertical_ends: IntArray, convex: bool, problem: FitProblem
) -> tuple[FloatArray, IntArray]:
    """Return starts with one vertex more than a fit (P,), (m,), where the score test gains most; not sorted."""
    stride = max(len(problem.x) // _PLACES, 1)
    best: list[Candidate] = []
    strips = np.arange(stride, len(problem.x) - 1, stride)
    for new in candidates(theta, chain, vertical_ends, problem, strips):
        if convex and (new.height > 0.0) != (new.upper == 1):
            continue
        # Near an earlier place on the same chain the better of both counts, else the worst gives way.
        last = new.strip - _NEAR * stride
        near = [i for i, b in enumerate(best) if b.upper == new.upper and b.strip >= last]
        if not near and len(best) < TRIED:
            best.append(new)
            continue
        i = near[0] if near else min(range(TRIED), key=lambda i: best[i].gain)
        if new.gain > best[i].gain:
            best[i] = new
    if not convex and len(best) == TRIED:
        # Two signatures tell the chain, and l and u are nearly linear in the readings: one place less is enough.
        best.remove(min(best, key=lambda b: b.gain))
    starts = np.empty((len(best), len(theta) + 2))
    chains = np.empty((len(best), len(chain) + 1), dtype=np.int64)
    for start, kinds, new in zip(starts, chains, best, strict=True):
        start[:-2] = moved(theta[None], chain[None], vertical_ends, new.shift[None], problem.pitch)[0]
        inner, x = start[END_ENTRIES:-2].reshape(-1, 2)[chain == new.upper], problem.x[new.strip]
        knots = np.array([start[[0, 1 + new.upper]], *inner, start[[3, 4 + new.upper]]])
        start[-2:] = x, np.clip(np.interp(x, *knots.T) + new.height, 0.0, 1.0)
        kinds[:-1], kinds[-1] = chain, new.upper
    return starts, chains


def candidates(
    theta: FloatArray, chain: IntArray, vertical_ends: IntArray, problem: FitProblem, strips: IntArray
) -> list[Candidate]:
    """Return what a vertex at the x of each strip would gain on either chain, where it would be anything new."""
    x, found = problem.x, []
    free = np.flatnonzero(free_entries(len(theta), vertical_ends))
    normal = normal_equations(theta[None], chain[None], vertical_ends, problem)[1][0][np.ix_(free, free)]
    normal += np.diag(_FIRM * normal.diagonal() + _LITTLE)
    (l, by_l), (u, by_u) = heights(theta[None], chain[None], vertical_ends, x)
    ll, lu, uu, lr, ur, _ = (term[0] for term in terms(l, u, problem))
    with_jacobian = [a[:, None] * by_l[0] + b[:, None] * by_u[0] for a, b in ((ll, lu), (lu, uu))]
    for upper, own, with_r in ((0, ll, lr), (1, uu, ur)):
        knots = np.array([theta[0], *theta[END_ENTRIES::2][chain == upper], theta[3]])
        after = np.searchsorted(knots, x[strips], side="right").clip(1, len(knots) - 1)
        left, right, top = knots[after - 1], knots[after], x[strips]
        room = (top - left >= problem.pitch) & (right - top >= problem.pitch)
        at, left, right, top = strips[room], left[room, None], right[room, None], top[room, None]
        hat = np.maximum(np.minimum((x - left) / (top - left), (right - x) / (right - top)), 0.0)
        vr, vv, vj = hat @ with_r, hat**2 @ own, hat @ with_jacobian[upper][:, free]
        answer = np.linalg.solve(normal, vj.T).T  # of the rest, to a height of 1
        left_over = vv - (vj * answer).sum(axis=1)
        for i in np.flatnonzero(left_over > NEW * vv):
            height, shift = vr[i] / left_over[i], np.zeros(len(theta))
            shift[free] = -height * answer[i]
            found.append(Candidate(float(vr[i] * height), int(at[i]), upper, float(height), shift))
    return found

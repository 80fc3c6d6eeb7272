"""Points of a set of bounds, as often as the readings make them likely.

With errors equally likely up to their bound, every outline in the set explains the readings equally well. Their mean
is then the best estimate in squares, and their scatter its uncertainty. What draws them is a Gibbs walk: along one
coordinate after the other to a random place between the bounds. Where an error becomes less likely towards its bound,
each sweep draws how far the bound is drawn in, as likely as the error allows (slice sampling).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import at as address
from tacstrip.core.binding import exported
from tacstrip.core.polytope import MOST_DIMENSIONS, largest

# Coefficients, right sides, and over how much slack a reading becomes less likely.
Bounds: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
SWEEPS = 600
_SETTLING = 60  # sweeps that forget where the walk began
_NEAREST, _NEAREST_PAIRS = 112, 48  # bounds and pairs that the walk can meet; all others are too far


def hit_and_run(
    rows: Bounds, pairs: Bounds, middle: FloatArray, curvature: FloatArray, sweeps: int = SWEEPS
) -> FloatArray:
    """Return points (sweeps, P) of a set, the same ones for the same set.

    Parameters
    ----------
    rows
        A and b with A h <= b, (M, P) and (M,); and over how much slack a reading becomes less likely (M,).
    pairs
        The same of pairs (E, 2, P), (E, 2) and (E,), of which one at least holds.
    middle
        A point (P,) inside the set.
    curvature
        Of the barrier there (P, P): it makes the set round.
    sweeps
        Points wanted; neighbouring ones are alike.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the curvature is not positive definite: the set is too thin to compute with.
    """
    core = exported("hit_and_run")
    count, size = rows[0].shape
    if core is None or size > MOST_DIMENSIONS:
        return plain_hit_and_run(rows, pairs, middle, curvature, sweeps)
    either = len(pairs[1])
    given = [np.ascontiguousarray(part.T) for part in (*rows, *pairs, middle, curvature)]
    out, workspace = np.empty((sweeps, size)), np.empty(208 * size + max(count, 2 * either) * (size + 4))
    if not core(*map(address, (*given, out)), sweeps, count, either, size, address(workspace)):
        raise np.linalg.LinAlgError("the curvature is not positive definite")
    return out


def plain_hit_and_run(
    rows: Bounds, pairs: Bounds, middle: FloatArray, curvature: FloatArray, sweeps: int = SWEEPS
) -> FloatArray:
    """Do as `hit_and_run`, in NumPy: sums in the same order, for a walk makes much of a rounding error."""
    size = len(middle)
    upper = _factor(curvature)  # z = U (h - middle)
    a, pair_a = _solve(upper, rows[0].T), _solve(upper, pairs[0].T)  # (P, M), (P, 2, E)
    slack, pair_slack = rows[1] - _sum(rows[0].T, middle), pairs[1].T - _sum(pairs[0].T, middle)
    # In the order of the strips, so that draws meet the same bounds whatever the order of a sort.
    near = largest(-slack / _length(a), _NEAREST)
    near_pairs = largest(-(pair_slack / _length(pair_a)).max(axis=0), _NEAREST_PAIRS)
    a, slack, edge = a[:, near], slack[near], rows[2][near]
    pair_a, pair_slack, pair_edge = pair_a[..., near_pairs], pair_slack[:, near_pairs], pairs[2][near_pairs]
    z, out = np.zeros(size), np.empty((_SETTLING + sweeps, size))
    for sweep in range(_SETTLING + sweeps):
        draw = uniform(sweep, size)
        cut = draw[: len(near)] * np.minimum(edge, slack)
        pair_cut = draw[_NEAREST : _NEAREST + len(near_pairs)] * np.minimum(pair_edge, pair_slack.max(axis=0))
        slack, pair_slack = slack - cut, pair_slack - pair_cut
        for j, share in enumerate(draw[_NEAREST + _NEAREST_PAIRS :][:size]):
            ways = a[j] / slack
            high, low = 1.0 / max(ways.max(), 1e-300), 1.0 / min(ways.min(), -1e-300)
            high = _held(pair_slack, pair_a[j]).min(initial=high)
            low = (-_held(pair_slack, -pair_a[j])).max(initial=low)
            step = low + (high - low) * share
            z[j] += step
            slack = slack - step * a[j]
            pair_slack = pair_slack - step * pair_a[j]
        slack, pair_slack = slack + cut, pair_slack + pair_cut
        out[sweep] = z
    points = out[_SETTLING:].T.copy()
    for i in range(size)[::-1]:
        for j in range(i + 1, size):
            points[i] -= upper[i, j] * points[j]
        points[i] /= upper[i, i]
    return np.ascontiguousarray((points + middle[:, None]).T)


def _factor(a: FloatArray) -> FloatArray:
    """Return U with U' U = a."""
    u = a.copy()
    for k in range(len(u)):
        if not u[k, k] > 0.0:
            raise np.linalg.LinAlgError("the curvature is not positive definite")
        u[k, k:] /= np.sqrt(u[k, k])
        for i in range(k + 1, len(u)):
            u[i, i:] -= u[k, i] * u[k, i:]
    return u


def _solve(u: FloatArray, a: FloatArray) -> FloatArray:
    """Return z (P, ...) with U' z = a."""
    z = a.copy()
    for p in range(len(u)):
        for q in range(p):
            z[p] -= u[q, p] * z[q]
        z[p] *= 1.0 / u[p, p]
    return z


def _sum(a: FloatArray, by: FloatArray) -> FloatArray:
    """Return the sum over the first axis of a (P, ...) times by (P,)."""
    total = np.zeros(a.shape[1:])
    for row, factor in zip(a, by, strict=True):
        total = total + factor * row
    return total


def _length(a: FloatArray) -> FloatArray:
    total = np.zeros(a.shape[1:])
    for row in a:
        total = total + row * row
    return np.sqrt(total)


def uniform(sweep: int, size: int = MOST_DIMENSIONS) -> FloatArray:
    """Return the numbers from 0 to 1 that a sweep draws: of bounds, pairs, then coordinates (splitmix64)."""
    count = _NEAREST + _NEAREST_PAIRS + max(size, MOST_DIMENSIONS)
    bits = np.arange(sweep * count + 1, (sweep + 1) * count + 1, dtype=np.uint64)
    bits = bits * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray(((bits ^ (bits >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53)


def _held(slack: FloatArray, row: FloatArray) -> FloatArray:
    """Return how far one can go from d = 0 on while one of two slacks - d row (2, E) is not below 0 (E,)."""
    swap = slack[0] < slack[1]
    (s, t), (r, q) = np.where(swap, slack[::-1], slack), np.where(swap, row[::-1], row)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(r > 0.0, np.maximum(s, 0.0) / r, np.inf)
        longer = np.maximum(reach, np.where(q > 0.0, t / q, np.inf))
        return np.where(t >= 0.0, longer, np.where((q < 0.0) & (t / q <= reach), np.inf, reach))

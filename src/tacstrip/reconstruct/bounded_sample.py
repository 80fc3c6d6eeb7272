"""Points of a set of bounds, as often as the readings make them likely.

With errors equally likely up to their bound, every outline in the set explains the readings equally well. Their mean
is then the best estimate in squares, and their scatter its uncertainty. What draws them is a Gibbs walk: along one
coordinate after the other to a random place between the bounds. Where an error becomes less likely towards its bound,
each sweep draws how far the bound is drawn in, as likely as the error allows (slice sampling).
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.bounded_centre import largest
from tacstrip.reconstruct.bounded_set import FeasibleSet

SWEEPS = 600
_SETTLING = 60  # sweeps that forget where the walk began
_NEAREST, _NEAREST_PAIRS = 112, 48  # bounds and pairs that the walk can meet; all others are too far
_SEED = 20


def sample(
    bounds: FeasibleSet, middle: FloatArray, curvature: FloatArray, sweeps: int = SWEEPS
) -> FloatArray:
    """Return points (sweeps, P) [mm] of the set, the same ones for the same set.

    Parameters
    ----------
    bounds
        The set.
    middle
        A point (P,) inside the set.
    curvature
        Of the barrier there (P, P): it makes the set round.
    sweeps
        Points wanted; neighbouring ones are alike.
    """
    from tacstrip.reconstruct.bounded_kernels import walk

    to_round = np.linalg.inv(
        np.linalg.cholesky(curvature)
    )  # z = L' (h - middle), so h = middle + to_round' z
    a = to_round @ bounds.a.T  # (P, M)
    slack = bounds.b - bounds.a @ middle
    pair_a = np.moveaxis(bounds.either_a @ to_round.T, -1, 0)  # (P, E, 2)
    pair_slack = bounds.either_b - bounds.either_a @ middle
    # In the order of the strips, so that draws meet the same bounds whatever the order of a sort.
    near = largest(-slack / np.linalg.norm(a, axis=0), _NEAREST)
    pairs = largest(-(pair_slack / np.linalg.norm(pair_a, axis=0)).max(axis=1), _NEAREST_PAIRS)
    a, slack, size = np.ascontiguousarray(a[:, near]), slack[near], len(middle)
    pair_a, pair_slack = np.ascontiguousarray(pair_a[:, pairs]), pair_slack[pairs]
    random = np.random.default_rng(_SEED)
    draws = random.random((_SETTLING + sweeps, len(near) + len(pairs) + size))
    out = np.empty((_SETTLING + sweeps, size))
    walk(a, slack, bounds.edge[near], pair_a, pair_slack, bounds.either_edge[pairs], draws, out)
    return np.asarray(middle + out[_SETTLING:] @ to_round)


def plain_walk(
    a: FloatArray,
    slack: FloatArray,
    edge: FloatArray,
    pair_a: FloatArray,
    pair_slack: FloatArray,
    pair_edge: FloatArray,
    draws: FloatArray,
    out: FloatArray,
) -> None:
    """Walk from z = 0, where rows have `slack`; the plain version of `bounded_kernels.walk`.

    Parameters
    ----------
    a, slack, edge
        By coordinate and row (P, M), and (M,): slack - z a stays above 0; edge is over how much of it a reading
        becomes less likely.
    pair_a, pair_slack, pair_edge
        The same of pairs (P, E, 2), (E, 2), (E,), of which one at least holds.
    draws
        Uniform random numbers (sweeps, M + E + P).
    out
        Filled with the points (sweeps, P).
    """
    size, rows = a.shape
    z = np.zeros(size)
    for sweep, draw in enumerate(draws):
        for_rows, for_pairs, for_steps = np.split(draw, [rows, len(draw) - size])
        cut = for_rows * np.minimum(edge, slack)
        pair_cut = for_pairs * np.minimum(pair_edge, pair_slack.max(axis=1))
        for j, share in enumerate(for_steps):
            with np.errstate(divide="ignore"):
                ways = a[j] / (slack - cut)
                high, low = 1.0 / max(ways.max(), 1e-300), 1.0 / min(ways.min(), -1e-300)
            for s, r in zip(pair_slack - pair_cut[:, None], pair_a[j], strict=True):
                high, low = min(high, _held(s, r)), max(low, -_held(s, -r))
            step = low + (high - low) * share
            z[j] += step
            slack -= step * a[j]
            pair_slack -= step * pair_a[j]
        out[sweep] = z


def _held(slack: FloatArray, row: FloatArray) -> float:
    """Return how far one can go from d = 0 on while one of two slacks - d row is not below 0."""
    first = int(slack.argmax())
    reach = max(slack[first], 0.0) / row[first] if row[first] > 0.0 else np.inf
    s, r = slack[1 - first], row[1 - first]
    if s >= 0.0:
        return float(max(reach, s / r if r > 0.0 else np.inf))
    return float(np.inf if r < 0.0 and s / r <= reach else reach)

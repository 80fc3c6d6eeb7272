"""Points of a set of bounds, as often as the readings make them likely.

With errors equally likely up to their bound, every outline in the set explains the readings equally well. Their mean
is then the best estimate in squares, and their scatter its uncertainty. What draws them is a Gibbs walk: along one
coordinate after the other to a random place between the bounds. Where an error becomes less likely towards its bound,
each sweep draws how far the bound is drawn in, as likely as the error allows (slice sampling).
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.polytope import walk
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

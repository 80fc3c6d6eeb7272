"""Outlines as often as readings and prior make them likely: the posterior of one run of strips.

One signature leaves many outlines that explain it: weak corners, upright ends, contacts over a border. What samples
have in common is known, what differs among them is not. Only the compiled core samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import HOTTEST, MOST_CORNERS, OUTLINE, OUTLINE_PRIOR, at, exported
from tacstrip.core.problem import FitProblem

# Of objects: how often so many vertices are met, before any reading.
VERTEX_COUNTS: Mapping[int, float] = {
    3: 0.16, 4: 0.24, 5: 0.18, 6: 0.14, 7: 0.10, 8: 0.07, 9: 0.04, 10: 0.03, 11: 0.02, 12: 0.02,
}  # fmt: skip
_RARE = -60.0  # log of how often other counts are met
HEAT = (1.0, 3.0, 9.0, 30.0)


def vertex_log_prior(counts: Mapping[int, float]) -> FloatArray:
    """Return the log density (3, MOST_CORNERS + 1) of an outline of N vertices, of which 0, 1 or 2 ends are upright.

    How often N is met, over the volume of such outlines where heights lie uniformly between the lowest and the
    highest, and x between the ends. Of n uniform points the share (C(2 n - 2, n - 1) / n!)^2 is in convex position
    (Valtr 1995); with upright ends, and n half a point less for each, that holds within 4 % (up to five in between).
    """
    found = np.full((3, MOST_CORNERS + 1), _RARE)
    for upright in range(3):
        there = {n: share for n, share in counts.items() if n >= max(3, 2 + upright)}
        for n, share in there.items():
            points = n - 0.5 * upright
            convex = math.lgamma(2.0 * points - 1.0) - 2.0 * math.lgamma(points) - math.lgamma(points + 1.0)
            orders = math.lgamma(n - 1 - upright) + upright * math.log(2.0) - math.log(n * (n - 1))
            found[upright, n] = math.log(share / sum(there.values())) + orders - 2.0 * convex
    return found


@dataclass(frozen=True, eq=False)
class OutlinePrior:
    """What is known of an outline without readings, in units of a `FitProblem`.

    Attributes
    ----------
    window
        The left end's x lies between the first two, the right end's between the last two (4,).
    ends
        Log probability of pointed ends, an upright left one, an upright right one, and both.
    reflex
        Log density of a corner that turns inwards; -inf: there is none.
    sigma
        Bounds of sigma over that of the problem's weights; equal: it is known.
    area, area_sigma
        Mean and standard deviation, in units of x and y; sigma 0: not known.
    vertices
        Log density of so many vertices, with 0, 1 or 2 upright ends (3, MOST_CORNERS + 1).
    finest
        -log of the sampler's finest step over its coarsest.
    """

    window: tuple[float, float, float, float]
    ends: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    reflex: float = -math.inf
    sigma: tuple[float, float] = (1.0, 1.0)
    area: float = 0.0
    area_sigma: float = 0.0
    vertices: FloatArray = field(default_factory=lambda: vertex_log_prior(VERTEX_COUNTS))
    finest: float = 7.0


@dataclass(frozen=True, eq=False)
class Samples:
    """Outlines drawn.

    Attributes
    ----------
    outlines
        `OUTLINE` (K,), in units of the problem.
    squares, log_prior, sigma
        Of each (K,): squared residuals over sigma^2 of the weights, log prior density, sigma over that of the weights.
    """

    outlines: npt.NDArray[np.void]
    squares: FloatArray
    log_prior: FloatArray
    sigma: FloatArray


def chains(outline: npt.NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper chain (M, 2), (N, 2) of an `OUTLINE`."""
    x, y, count = outline["x"], outline["y"], outline["count"]
    lower, upper = (np.stack([x[c, : count[c]], y[c, : count[c]]], axis=1) for c in (0, 1))
    return lower, upper


def vertex_counts(outlines: npt.NDArray[np.void]) -> npt.NDArray[np.int64]:
    """Return how many vertices each `OUTLINE` (K,) has."""
    count, y = outlines["count"], outlines["y"]
    each = np.arange(len(outlines))
    last = [y[each, c, count[:, c] - 1] for c in (0, 1)]
    upright = (y[:, 0, 0] < y[:, 1, 0]).astype(np.int64) + (last[0] < last[1])
    return np.asarray(count.sum(axis=1) - 2 + upright, dtype=np.int64)


def outline_record(lower: FloatArray, upper: FloatArray) -> npt.NDArray[np.void]:
    """Return two chains (M, 2), (N, 2) in units of a problem as an `OUTLINE` (1,)."""
    made = np.zeros(1, OUTLINE)
    for c, chain in enumerate((lower, upper)):
        made["count"][0, c] = len(chain)
        made["x"][0, c, : len(chain)], made["y"][0, c, : len(chain)] = chain.T
    return made


def sample_outlines(
    problem: FitProblem,
    prior: OutlinePrior,
    starts: Sequence[npt.NDArray[np.void]],
    steps: int,
    kept: int,
    seed: int = 0,
    heat: Sequence[float] = HEAT,
) -> Samples | None:
    """Draw outlines by tempered reversible-jump Markov chains; the same seed gives the same ones.

    Parameters
    ----------
    problem
        Readings and weights of at most 200 strips: `FitProblem.thinned`.
    prior
        What is known without them.
    starts
        `OUTLINE` (1,) of which the chains begin, in turn; the first is the coldest's.
    steps
        Of each chain. All take steps times temperatures evaluations, some .5 us each for 100 strips.
    kept
        Samples wanted, of the last three quarters.
    seed
        0 or more.
    heat
        Temperatures, 1 first.

    Returns
    -------
    Samples or None
        None without a compiled core, and where a start is not allowed by the prior.
    """
    core = exported("sample_outlines")
    if core is None:
        return None
    if not 0 < len(heat) <= HOTTEST:
        raise ValueError(f"{len(heat)} temperatures: 1 to {HOTTEST}")
    told = np.zeros(1, OUTLINE_PRIOR)
    for name in OUTLINE_PRIOR.names or ():
        told[name][0] = getattr(prior, name)
    begin = np.concatenate([starts[t % len(starts)] for t in range(len(heat))])
    hot = np.array(heat, dtype=np.float64)
    found, values = np.zeros(kept, OUTLINE), np.empty((kept, 3))
    given = problem.compiled, at(told), at(begin), at(hot), len(hot)
    count = core(*given, steps, kept, seed, at(found), at(values))
    return Samples(found[:count], *values[:count].T) if count else None


def outline_ends(outlines: npt.NDArray[np.void], x: FloatArray) -> FloatArray:
    """Return l and u (K, 2, G) of outlines at x (G,), ascending, held to 0 and 1; both 0 outside."""
    core = exported("outline_ends")
    found = np.zeros((len(outlines), 2, len(x)))
    if core is not None:
        outlines, x = np.ascontiguousarray(outlines), np.ascontiguousarray(x)
        core(at(outlines), len(outlines), at(x), len(x), at(found))
        return found
    for ends, outline in zip(found, outlines, strict=True):
        for row, chain in zip(ends, chains(outline), strict=True):
            inside = (x >= chain[0, 0]) & (x <= chain[-1, 0])
            row[:] = np.where(inside, np.clip(np.interp(x, *chain.T), 0.0, 1.0), 0.0)
    return found

"""Regular outlines that explain the readings of one signature, as particles of each kind.

What numbers make an outline, and the same as `regular_values` in NumPy, is in reconstruction/posterior/regular/. Only
the compiled core samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import (
    REGULAR_KINDS,
    REGULAR_NUMBERS,
    REGULAR_STRIPS,
    REGULAR_VALUES,
    RegularPlace,
    at,
    exported,
)
from tacstrip.core.problem import FitProblem

_WORKSPACE = 48  # doubles a particle


@dataclass(frozen=True, eq=False)
class Particles:
    """Particles of each kind, inside the sensor (even rows) and over a border (odd ones).

    Attributes
    ----------
    numbers
        What makes each (14, P, 8), from 0 to 1.
    log_prior, misfit, lowest
        Of each (14, P): log prior, half chi square, lowest point over the strip.
    evidence, done
        Log evidence (14,), and whether it is that: not where a kind was given up, by what it had reached then (14,).
    """

    numbers: FloatArray
    log_prior: FloatArray
    misfit: FloatArray
    lowest: FloatArray
    evidence: FloatArray
    done: BoolArray


def regular_values(
    problem: FitProblem,
    place: RegularPlace,
    kind: IntArray,
    over: BoolArray,
    numbers: FloatArray,
) -> FloatArray | None:
    """Return log prior, half chi square and lowest point over the strip (K, 3); None without a compiled core."""
    core = exported("regular_values")
    if core is None:
        return None
    of, cut, z = (np.ascontiguousarray(v, dtype=t) for v, t in ((kind, "i8"), (over, "i8"), (numbers, "f8")))
    found = np.empty((len(of), REGULAR_VALUES))
    core(_short(problem).compiled, place, at(of), at(cut), at(z), len(of), at(found))
    return found


def sample_regular(
    problem: FitProblem, place: RegularPlace, particles: int, best: float, seed: int = 0
) -> Particles | None:
    """Draw outlines of each kind as often as readings make them likely; the same seed gives the same ones.

    Parameters
    ----------
    problem, place
        One signature's readings of `REGULAR_STRIPS` strips or fewer, and where outlines may lie.
    particles
        Of each kind, 2 or more.
    best
        Log evidence of others: kinds that cannot come near it are given up on the way.
    seed
        0 or more.

    Returns
    -------
    Particles or None
        None without a compiled core.
    """
    core = exported("sample_regular")
    if core is None:
        return None
    kinds = 2 * REGULAR_KINDS
    z, values = np.empty((kinds, particles, REGULAR_NUMBERS)), np.empty((kinds, particles, REGULAR_VALUES))
    evidence, done, room = np.empty(kinds), np.empty(kinds, dtype=np.int64), np.empty(_WORKSPACE * particles)
    given = _short(problem).compiled, place, particles, best, seed
    core(*given, at(z), at(values), at(evidence), at(done), at(room))
    log_prior, misfit, lowest = np.moveaxis(values, -1, 0)
    return Particles(z, log_prior, misfit, lowest, evidence, done == 1)


def _short(problem: FitProblem) -> FitProblem:
    if len(problem.x) > REGULAR_STRIPS or len(problem.k) != 1:
        raise ValueError(
            f"{len(problem.x)} strips, {len(problem.k)} signatures: {REGULAR_STRIPS} and 1 at most"
        )
    return problem

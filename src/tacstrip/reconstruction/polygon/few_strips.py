"""How likely an outline that explains the readings of few strips is of something else: a concave object, or two.

On few strips the ends of a cross, of a bean, or of two objects are often convex, or follow few corners, and then no
test of the readings tells. What remains is how often that happens. The prior is that of four convex objects, one
concave one and one pair, as elsewhere one object is taken to be four times as common as two; among drawn
contacts weighed so, a logistic regression of outlines that were wrong gives the odds
(`docs/decisions/2026-11-29-odds-of-few-strips.md`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.polygon.chi_square import ALARM, squares_score
from tacstrip.reconstruction.polygon.convexity import OneConvex, inward_corners
from tacstrip.reconstruction.polygon.lone_fault import at_a_rail
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.reconstruction.posterior.assessment import HELD_STRIPS

# Log odds by `unlike_terms`, which `studies/few_strips.py` fits, but for that of one concave object.
_ODDS = (-4.03, -0.88, 3.6, -0.4, 1.2, 1.3, 7.2)
_QUIET = 0.004  # of Vref: less noise that nobody gave tells nothing
_HIGHEST = 2.0  # height over breadth, beyond which it tells no more: bars lie along the strips, too
# Of a reading left out as a faulty channel's: log odds that it is none, where one scan in ten has such a channel, of
# three strips, by the logarithm of strips but two, and where the reading has not been singled out.
_NO_FAULT, _NO_FAULT_BY_STRIPS, _NOT_NAMED = 3.2, -4.0, 2.2


def unlike_probability(terms: FloatArray) -> float:
    """Return the probability that few strips read what their outline is unlike, by its `unlike_terms`."""
    return float(1.0 / (1.0 + np.exp(-(terms @ _ODDS))))


def unlike_terms(
    run: RunFit,
    model: OutlineModel,
    outline: Outline,
    distribution: str | None,
    convex: OneConvex | None,
    one_object: bool,
) -> FloatArray:
    """Return what tells whether the readings of few strips are of what their outline is unlike (7,).

    1; the logarithm of strips but two: the fewer there are, the more often ends are convex by chance. Whether the
    outline is concave, as one of many that read alike; and if so whether it is known to be one object. Whether it
    misses readings of very few strips, though convex ends explain them. The logarithm of noise that nobody gave, which
    may be jumps. That of the height over the breadth, for of two objects that share strips one lies above the other;
    times the numbers fitted for each reading, for few of them read as an outline of few corners does.

    Parameters
    ----------
    run, model, outline
        The fit of both signatures, and the outline that is given.
    distribution
        Of the noise; None where its level was not given.
    convex
        One convex object that explains all readings, if there is one.
    one_object
        Whether it is known that there are no two.
    """
    strips = run.problem.x.size
    concave = convex is None and isinstance(model, PolygonFit) and any(inward_corners(model))
    missed = convex is not None and strips < HELD_STRIPS
    missed = missed and squares_score(run.residual_sums[0], run.freedom) > ALARM
    noise = max(math.log(run.sigma / _QUIET), 0.0) if distribution is None else 0.0
    width, height = np.ptp(outline.vertices, axis=0)
    fitted = 1.0 - max(run.freedom, 0) / run.problem.readings
    high = 0.0 if one_object else fitted * math.log(np.clip(height / width, 1.0, _HIGHEST))
    return np.array(
        [1.0, math.log(max(strips - 2, 1)), concave, concave and one_object, missed, noise, high], dtype=float
    )


def no_fault_probability(
    run: RunFit, left_out: BoolArray, faulty: BoolArray, readings: Mapping[str, FloatArray]
) -> float:
    """Return the probability that readings left out (2, n) of few strips are of a concave object or a second one.

    The fewer strips there are, the more often all but one agree on a convex outline by chance. A reading at ground or
    Vref shows its fault in itself. `faulty`: those that no contact makes which the others agree on.
    """
    off = left_out & ~at_a_rail(run, readings)
    if not off.any():
        return 0.0
    odds = _NO_FAULT + _NO_FAULT_BY_STRIPS * math.log(max(run.problem.x.size - 2, 1))
    odds += _NOT_NAMED * bool((off & ~faulty).any())
    return 1.0 / (1.0 + math.exp(-odds))

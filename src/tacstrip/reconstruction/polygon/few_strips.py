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

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.polygon.chi_square import ALARM, squares_score
from tacstrip.reconstruction.polygon.convexity import OneConvex, inward_corners
from tacstrip.reconstruction.polygon.lone_fault import at_a_rail
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.reconstruction.posterior.assessment import HELD_STRIPS, few_strips

# Log odds: of three strips; by the logarithm of strips but two; of a concave outline, and if that is known to be one
# object; of an outline that misses readings of very few strips, though convex ends explain them; by the logarithm of
# noise that nobody gave, over so much of Vref; by that of the contact's height over its breadth, of the numbers fitted
# for each reading.
_THREE, _BY_STRIPS, _CONCAVE, _CONCAVE_OF_ONE, _MISSED = -4.03, -0.88, 3.5, 3.1, 1.2
_BY_NOISE, _QUIET, _BY_PROPORTION = 1.3, 0.004, 7.2
_HIGHEST = 2.0  # height over breadth, beyond which it tells no more: bars lie along the strips, too
# Of a reading left out as a faulty channel's: log odds that it is none, where one scan in ten has such a channel, of
# three strips, by the logarithm of strips but two, and where the reading has not been singled out.
_NO_FAULT, _NO_FAULT_BY_STRIPS, _NOT_NAMED = 3.2, -4.0, 2.2


def unlike_probability(
    run: RunFit,
    model: OutlineModel,
    outline: Outline,
    distribution: str | None,
    convex: OneConvex | None,
    one_object: bool,
) -> float:
    """Return the probability that the readings of few strips are of what the outline is unlike; 0 of more strips.

    The fewer strips there are, the more often ends are convex by chance. Of two objects that share strips one lies
    above the other, so that both together are rather high; but few of them read as an outline of few corners does. A
    concave outline is one of many that read alike; and noise that nobody gave may be jumps.

    Parameters
    ----------
    run, model, outline
        The fit of both signatures, and the outline that is given.
    distribution
        Of the noise; None where its level was not given.
    convex
        One convex object that explains all readings, where the outline alone does not tell.
    one_object
        Whether it is known that there are no two.
    """
    if len(run.problem.k) == 1 or run.selection is None or not few_strips(run):
        return 0.0
    odds = _THREE + _BY_STRIPS * math.log(max(run.problem.x.size - 2, 1))
    if convex is None:
        concave = isinstance(model, PolygonFit) and any(inward_corners(model))
        odds += concave * (_CONCAVE_OF_ONE if one_object else _CONCAVE)
    elif run.problem.x.size < HELD_STRIPS:
        odds += _MISSED * (squares_score(run.residual_sums[0], run.freedom) > ALARM)
    if distribution is None:
        odds += _BY_NOISE * max(math.log(run.sigma / _QUIET), 0.0)
    if not one_object:
        width, height = outline.vertices.max(axis=0) - outline.vertices.min(axis=0)
        fitted = 1.0 - max(run.freedom, 0) / run.problem.readings
        odds += _BY_PROPORTION * fitted * math.log(min(max(float(height / width), 1.0), _HIGHEST))
    return 1.0 / (1.0 + math.exp(-odds))


def no_fault_probability(
    run: RunFit, left_out: BoolArray, faulty: BoolArray, readings: Mapping[str, FloatArray]
) -> float:
    """Return the probability that readings left out (2, n) are of a concave object or a second one; 0 of more strips.

    The fewer strips there are, the more often all but one agree on a convex outline by chance. A reading at ground or
    Vref shows its fault in itself. `faulty`: those that no contact makes which the others agree on.
    """
    off = left_out & ~at_a_rail(run, readings)
    if len(run.problem.k) == 1 or not few_strips(run) or not off.any():
        return 0.0
    odds = _NO_FAULT + _NO_FAULT_BY_STRIPS * math.log(max(run.problem.x.size - 2, 1))
    odds += _NOT_NAMED * bool((off & ~faulty).any())
    return 1.0 / (1.0 + math.exp(-odds))

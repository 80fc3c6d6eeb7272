"""With one signature: a reading that contradicts all others, as a faulty channel's does, and hardly a contact's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.reconstruction.polygon.run import RunFit

_BEYOND, _RAIL = 4.0, 3.0  # deviations: a reading is none of this contact; is one of ground or Vref


def beyond_outline(run: RunFit, readings: Mapping[str, FloatArray]) -> BoolArray:
    """Return where the one reading left out (1, n) reaches beyond the outline on its strip, amid strips that agree.

    A reading lies between l and u, and a notch, which takes some of the contact away, leaves it there: one beyond them
    asks for a contact that sticks out on this strip alone. At either end that is an edge, or a second object.

    Parameters
    ----------
    run, readings
        The fit, of what; signature to (n,).
    """
    found = np.zeros_like(run.excluded)
    if len(found) > 1 or run.model is None or np.count_nonzero(run.excluded) != 1:
        return found
    problem, in_mm = run.problem, run.model_mm
    (k,) = readings.values()
    x = problem.x * problem.width_mm + problem.origin_mm
    l, u = (np.interp(x, *chain.T) / problem.length_mm for chain in (in_mm.lower, in_mm.upper))
    margin, used = _BEYOND * run.sigma, problem.weight[0] > 0.0
    with np.errstate(invalid="ignore"):
        beyond = (k < l - margin) | (k > u + margin)
    if not run.checked:  # a corner may be what the few readings left do not tell, but not as far as that
        beyond &= at_a_rail(run, readings)[0]
    found[0, 1:-1] = (run.excluded[0] & beyond)[1:-1] & used[:-2] & used[2:]
    return found


def at_a_rail(run: RunFit, readings: Mapping[str, FloatArray]) -> BoolArray:
    """Return which readings (S, n) lie on ground or Vref."""
    k, rail = np.stack([*readings.values()]), _RAIL * run.sigma
    with np.errstate(invalid="ignore"):
        return np.asarray((k <= rail) | (k >= 1.0 - rail))

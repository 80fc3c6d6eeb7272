"""What vertex counts are compared by: how far a fit is from the readings, and what its vertices cost."""

from __future__ import annotations

import math

from tacstrip.core.fit import Fit
from tacstrip.core.problem import FLOOR, Signal


def penalty(readings: int) -> float:
    """Return what a vertex must gain in chi square to be believed: BIC's 2 ln n for its two numbers, and 4.

    The 4 is for its place: the best of many places gains more than one that is given.
    """
    return 2.0 * math.log(max(readings, 2)) + 4.0


def charge(signal: Signal, vertices: int, known: bool = True) -> float:
    """Return what so many vertices must gain in the criterion together.

    Where sigma is not known few readings are soon fitted too well, and the more vertices the sooner: the correction of
    small samples (AICc's) makes them dearer.
    """
    n = signal.readings
    price = penalty(n) * vertices
    return price if known else price * n / max(n - 2 * vertices - 3, 1)


def criterion(fit: Fit, signal: Signal, known: bool = True) -> float:
    """Return what counts are compared by: misfit, and a penalty per vertex, one more for a vertical edge."""
    return misfit(fit.cost, signal, known) + charge(signal, fit.count + int(fit.blunt.sum()), known)


def misfit(cost: float, signal: Signal, known: bool) -> float:
    """Return chi square, or n log of it where sigma is not known, as if no reading were more exact than `FLOOR`."""
    n = max(signal.readings, 1)
    return cost if known else n * math.log(max(cost / n, (FLOOR / signal.sigma) ** 2))

"""What vertex counts are compared by: how far a fit is from the readings, and what its vertices cost."""

from __future__ import annotations

import math

from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FLOOR, FitProblem


def per_vertex_penalty(readings: int) -> float:
    """Return what a vertex must gain in chi square to be believed: BIC's 2 ln n for its two numbers, and 4.

    The 4 is for its place: the best of many places gains more than one that is given.
    """
    return 2.0 * math.log(max(readings, 2)) + 4.0


def complexity_penalty(problem: FitProblem, vertices: int, sigma_known: bool = True) -> float:
    """Return what so many vertices must gain in the criterion together.

    Where sigma is not known few readings are soon fitted too well, and the more vertices the sooner: the correction of
    small samples (AICc's) makes them dearer.
    """
    n = problem.readings
    price = per_vertex_penalty(n) * vertices
    return price if sigma_known else price * n / max(n - 2 * vertices - 3, 1)


def criterion(fit: PolygonFit, problem: FitProblem, sigma_known: bool = True) -> float:
    """Return what counts are compared by: deviance, and a penalty per vertex, one more for a vertical edge."""
    counted = fit.n_interior + int(fit.vertical_ends.sum())
    return deviance(fit.cost, problem, sigma_known) + complexity_penalty(problem, counted, sigma_known)


def deviance(cost: float, problem: FitProblem, sigma_known: bool) -> float:
    """Return chi square, or n log of it where sigma is not known, with readings no more exact than `FLOOR`."""
    n = max(problem.readings, 1)
    return cost if sigma_known else n * math.log(max(cost / n, (FLOOR / problem.sigma) ** 2))

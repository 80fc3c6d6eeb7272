"""How far squared residuals exceed what noise leaves."""

from __future__ import annotations

import math

ALARM = 3.5  # standard deviations of a score: noise alone hardly reaches it
_SPREAD = {"uniform": 0.8, "normal": 2.0}  # variance of a squared error over sigma^4


def squares_score(squares: float, freedom: int, distribution: str = "normal") -> float:
    """Return how many standard deviations squared residuals over sigma^2 exceed their degrees of freedom.

    Wilson and Hilferty's cube root makes chi square nearly normal; a uniform error's square spreads less.
    """
    if freedom < 1:
        return 0.0
    root = (squares / freedom) ** (1.0 / 3.0)
    small = _SPREAD[distribution] / (9.0 * freedom)
    return float((root - (1.0 - small)) / math.sqrt(small))

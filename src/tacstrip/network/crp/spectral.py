"""The sheet across one pitch: spectral elements on Gauss-Lobatto nodes.

Across the strips potentials are smooth within a strip and within a gap, and bend sharply, over lambda, where a contact
ends at a strip's side. One element per strip follows that with four columns or fewer: its functions are, besides 1, x
and x^2, the two exponentials that a contact makes along its sides. Gauss-Lobatto quadrature, made for these, keeps what
a column stands for apart from its neighbours, so only the stiffness joins columns: C. Canuto, M. Y. Hussaini, A.
Quarteroni and T. A. Zang, Spectral Methods (2006), 2.3 and 3.8. Some of its conductances are negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from tacstrip.arrays import FloatArray, IntArray

# Degree 2 up to the first of these widths over the decay, 4 up to the second, then 6, then 8; under a contact always 4
# beyond the first, with exponentials: ends of contacts are then off by some .002 lambda (`studies/crp_sheet.py`).
_WIDEST = 1.5, 7.0, 15.0
_WIDEST_LINEAR = 0.5  # a gap up to this width over lambda is one straight piece


@dataclass(frozen=True, eq=False)
class PitchElements:
    """Columns of one pitch, the first and the last shared with its neighbours.

    Attributes
    ----------
    widths
        Width of sheet that each column stands for (C + 1,) [mm].
    under
        Share of the strip's contact that lies on each (C + 1,), 1 in all.
    first, second, stiffness
        Pairs of columns that are joined, and by what (J,) [1/mm].
    middle
        The column on the strip's centre line.
    """

    widths: FloatArray
    under: FloatArray
    first: IntArray
    second: IntArray
    stiffness: FloatArray
    middle: int

    @classmethod
    def of(cls, pitch: float, strip_width: float, decay: float, coarse: bool = False) -> PitchElements:
        """Cut a pitch into half a gap, a strip and half a gap; [mm].

        `decay` is how fast the sheet's potential nears a strip's across a contact's side, `coarse` takes the lowest
        degrees whatever it is.
        """
        gap = 0.5 * (pitch - strip_width)
        smooth = coarse or strip_width <= _WIDEST[0] * decay
        strip = gauss_lobatto(2) if smooth else exponential_lobatto(strip_width / decay)
        parts = [(strip_width, strip)]
        if gap > 1e-6 * pitch:
            degree = 1 if coarse or gap <= _WIDEST_LINEAR * decay else gap_degree(gap / decay)
            beside = gap, gauss_lobatto(degree)
            parts = [beside, *parts, beside]
        count = sum(len(weights) - 1 for _, (weights, _) in parts)
        widths, under, joined = np.zeros(count + 1), np.zeros(count + 1), np.zeros((count + 1, count + 1))
        at = 0
        for part, (width, (weights, stiffness)) in enumerate(parts):
            inside = slice(at, at + len(weights))
            widths[inside] += width * weights
            joined[inside, inside] -= stiffness / width
            if part == len(parts) // 2:
                under[inside] = weights
            at += len(weights) - 1
        first, second = np.nonzero(np.triu(joined, 1))
        return cls(widths, under, first, second, joined[first, second], count // 2)


def gap_degree(width_over_decay: float) -> int:
    """Return the degree, even, that follows the potential across a gap so wide."""
    return 2 + 2 * int(np.searchsorted(_WIDEST, width_over_decay))


@cache
def gauss_lobatto(degree: int) -> tuple[FloatArray, FloatArray]:
    """Return the weights (N,), 1 in all, and the stiffness (N, N) of an element of width 1, N = degree + 1."""
    top = legendre.Legendre.basis(degree)
    node = np.concatenate([[-1.0], np.sort(top.deriv().roots().real), [1.0]])
    value = top(node)
    weights = 2.0 / (degree * (degree + 1) * value**2)
    apart = node[:, None] - node + np.eye(degree + 1)
    derivative = value[:, None] / value / apart
    derivative[np.diag_indices(degree + 1)] = 0.0
    derivative[[0, -1], [0, -1]] = np.array([-0.25, 0.25]) * degree * (degree + 1)
    return 0.5 * weights, 2.0 * derivative.T @ (weights[:, None] * derivative)


@cache
def exponential_lobatto(width_over_decay: float) -> tuple[FloatArray, FloatArray]:
    """Return weights (5,) and stiffness (5, 5), as `gauss_lobatto(4)`, of an element that holds exponentials.

    Its functions on [-1, 1] are 1, x, x^2 and e^(-t (1 - x)), e^(-t (1 + x)), t half of `width_over_decay`, which
    x^3 and x^4 are in the limit of a wide decay. The quadrature is exact for 1, x^2, cosh(t x) and cosh(2 t x).
    """
    t = 0.5 * width_over_decay
    even = np.array([2.0, 2.0 / 3.0, -np.expm1(-2.0 * t) / t, -np.expm1(-4.0 * t) / (2.0 * t)])

    def quadrature(inner: float) -> tuple[FloatArray, float]:
        """Return weights of the nodes 1, `inner` and 0, exact for the first three, and what they miss of the last."""
        x = np.array([1.0, inner, 0.0])
        rest = [(np.exp(-k * (1.0 - x)) + np.exp(-k * (1.0 + x))) / 2.0 for k in (t, 2.0 * t)]
        at = np.stack([np.ones(3), x**2, *rest]) * [2.0, 2.0, 1.0]
        weight = np.linalg.solve(at[:3], even[:3])
        return weight, float(at[3] @ weight - even[3])

    # What is missed falls from the polynomials' node to the side, once through 0.
    low, high = np.sqrt(3.0 / 7.0), 1.0 - 1e-9
    for _ in range(50):
        inner = 0.5 * (low + high)
        low, high = (inner, high) if quadrature(inner)[1] > 0.0 else (low, inner)
    weight, node = quadrature(low)[0], np.array([-1.0, -low, 0.0, low, 1.0])
    above, below = np.exp(-t * (1.0 - node)), np.exp(-t * (1.0 + node))
    to_nodal = np.linalg.inv(np.stack([node**0, node, node**2, above, below], axis=1))
    # Integrals of the functions' slopes: 0, 1, 2 x, t above, -t below.
    tail = np.exp(-2.0 * t)
    by_x = 2.0 * ((1.0 + tail) - (1.0 - tail) / t)  # of 2 x t above, and of 2 x (-t below)
    slopes = np.zeros((5, 5))
    slopes[1, 1], slopes[2, 2] = 2.0, 8.0 / 3.0
    slopes[1, 3:] = slopes[3:, 1] = 1.0 - tail, tail - 1.0
    slopes[2, 3:] = slopes[3:, 2] = by_x
    slopes[3, 3] = slopes[4, 4] = 0.5 * t * (1.0 - tail**2)
    slopes[3, 4] = slopes[4, 3] = -2.0 * t**2 * tail
    return 0.5 * weight[[0, 1, 2, 1, 0]], 2.0 * to_nodal.T @ slopes @ to_nodal

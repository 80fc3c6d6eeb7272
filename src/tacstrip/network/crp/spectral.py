"""The sheet across one pitch: spectral elements on Gauss-Lobatto nodes.

Across the strips potentials are smooth within a strip and within a gap, and bend sharply, over lambda, where a contact
ends at a strip's side. One element of a high degree per strip follows that with a few columns: its error falls
exponentially with the degree, that of equal columns with the square of their width. Gauss-Lobatto quadrature keeps what
a column stands for apart from its neighbours, so only the stiffness joins columns: C. Canuto, M. Y. Hussaini,
A. Quarteroni and T. A. Zang, Spectral Methods (2006), 2.3 and 3.8. Some of its conductances are negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from tacstrip.arrays import FloatArray, IntArray

# Degree 2 up to the first of these widths over lambda, 4 up to the second, then 6, then 8: ends of contacts are then
# off by some .003 lambda in the median (`studies/crp_sheet.py`).
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

        `decay` is lambda, `coarse` takes the lowest degrees whatever it is.
        """
        gap = 0.5 * (pitch - strip_width)
        degree = 2 if coarse else strip_degree(strip_width / decay)
        parts = [(strip_width, degree)]
        if gap > 1e-6 * pitch:
            beside = 1 if coarse or gap <= _WIDEST_LINEAR * decay else strip_degree(gap / decay)
            parts = [(gap, beside), *parts, (gap, beside)]
        count = sum(degree for _, degree in parts)
        widths, under, joined = np.zeros(count + 1), np.zeros(count + 1), np.zeros((count + 1, count + 1))
        at = 0
        for part, (width, order) in enumerate(parts):
            weights, stiffness = gauss_lobatto(order)
            inside = slice(at, at + order + 1)
            widths[inside] += width * weights
            joined[inside, inside] -= stiffness / width
            if part == len(parts) // 2:
                under[inside] = weights
            at += order
        first, second = np.nonzero(np.triu(joined, 1))
        return cls(widths, under, first, second, joined[first, second], count // 2)


def strip_degree(width_over_decay: float) -> int:
    """Return the degree, even, that follows a contact's decay within a strip so wide."""
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

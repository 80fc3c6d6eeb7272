"""A polygon as the sensor sees it: a lower and an upper chain of vertices, l(x) and u(x), and their slopes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.errors import ContactError

_ON_END = 1e-9  # of the width: a strip this near an end vertex touches it


@dataclass(frozen=True, eq=False)
class Outline:
    """An x-monotone polygon, convex or not.

    Attributes
    ----------
    lower, upper
        Chains of vertices (M, 2) and (N, 2) [mm], x strictly ascending. At either end they share a vertex, or
        have one x: a vertical edge.

    Raises
    ------
    ContactError
        The chains make no such polygon; the message names the place.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> outline = ts.Outline.of([(0, 5), (5, 0), (10, 5), (5, 10)])
    >>> l, u = outline.ends(np.array([2.5, 5.0]))
    >>> l.tolist(), u.tolist()
    ([2.5, 0.0], [7.5, 10.0])
    """

    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            chain = np.array(getattr(self, name), dtype=float)
            chain.flags.writeable = False
            object.__setattr__(self, name, chain)
            if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) < 2 or not np.isfinite(chain).all():
                raise ContactError(f"the {name} chain needs two or more finite vertices (x, y)")
            for before, at in pairwise(chain[:, 0].tolist()):
                if at <= before:
                    raise ContactError(f"the {name} chain does not ascend at x = {at:.6g} mm: not x-monotone")
        if self.lower[0, 0] != self.upper[0, 0] or self.lower[-1, 0] != self.upper[-1, 0]:
            raise ContactError("the chains must begin on one x and end on one x")
        x = np.concatenate([self.lower[:, 0], self.upper[:, 0]])
        width = np.interp(x, *self.upper.T) - np.interp(x, *self.lower.T)
        if width.min() < 0.0:
            at = x[width.argmin()]
            raise ContactError(f"the lower chain passes above the upper one at x = {at:.6g} mm")

    @classmethod
    def of(cls, vertices: npt.ArrayLike) -> Outline:
        """Make the outline of an x-monotone polygon (N, 2) [mm], listed either way round.

        Raises
        ------
        ContactError
            It is not x-monotone, or crosses itself.
        """
        v = np.asarray(vertices, dtype=float)
        if v.ndim != 2 or v.shape[1] != 2 or len(v) < 3 or not np.isfinite(v).all():
            raise ContactError("an outline needs three or more finite vertices (x, y)")
        x, y = v.T
        if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0.0:
            v = v[::-1]
        first = np.lexsort((v[:, 1], v[:, 0]))[0]  # left-most, the lower one of two
        v = np.roll(v, -int(first), axis=0)
        right = np.flatnonzero(v[:, 0] == v[:, 0].max())
        if right[-1] - right[0] != len(right) - 1 or len(right) > 2:
            raise ContactError(f"more than one edge ends at x = {v[right[0], 0]:.6g} mm: not x-monotone")
        back = np.concatenate([v[right[-1] :], v[:1]])[::-1]
        if len(back) > 1 and back[0, 0] == back[1, 0]:
            back = back[1:]  # a vertical edge closes the polygon on the left
        return cls(v[: right[0] + 1], back)

    @classmethod
    def held(cls, lower: FloatArray, upper: FloatArray) -> Outline:
        """Make the outline of chains that are known to ascend and not to cross; nothing is checked."""
        outline = cls.__new__(cls)
        lower.flags.writeable = upper.flags.writeable = False
        outline.__dict__.update(lower=lower, upper=upper)
        return outline

    def moved(self, dx_mm: float, dy_mm: float) -> Outline:
        """Return the outline moved across and along the strips."""
        by = np.array([dx_mm, dy_mm])
        return Outline(self.lower + by, self.upper + by)

    @cached_property
    def vertices(self) -> FloatArray:
        """Vertices (V, 2) [mm], counter-clockwise from the left-most, the lower one of two; not to be written to."""
        left, right = self._joined
        last = len(self.upper) - 1 - right
        vertices = np.concatenate([self.lower, self.upper[last : 0 if left else None : -1]])
        vertices.flags.writeable = False
        return vertices

    @property
    def _joined(self) -> tuple[bool, bool]:
        """Whether the chains share their first vertex, and their last one."""
        ends = self.lower[:: len(self.lower) - 1, 1] == self.upper[:: len(self.upper) - 1, 1]
        return bool(ends[0]), bool(ends[1])

    @cached_property
    def indices(self) -> tuple[IntArray, IntArray]:
        """Rows of `vertices` that are the lower chain (M,) and the upper chain (N,)."""
        m, n = len(self.lower), len(self.upper)
        left, right = self._joined
        upper = m + n - 1 - right - np.arange(n)
        if left:
            upper[0] = 0
        return np.arange(m), upper

    def touches(self, x: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether each x [mm] lies within the outline, ends included but for rounding."""
        first, last = self.lower[0, 0], self.lower[-1, 0]
        slack = _ON_END * (last - first)
        return np.asarray((x >= first - slack) & (x <= last + slack))

    def ends(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return l and u [mm] at x [mm], of its shape; NaN outside."""
        x = np.asarray(x, dtype=float)
        inside = self.touches(x)
        l, u = (np.where(inside, np.interp(x, *chain.T), np.nan) for chain in (self.lower, self.upper))
        return l, u

    def jacobian(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the slopes of l and of u at x (S,) by `vertices.ravel()`, each (S, 2 V); NaN outside.

        At a vertex they are those of the section to its right.
        """
        x = np.asarray(x, dtype=float)
        chains = zip((self.lower, self.upper), self.indices, strict=True)
        by_l, by_u = (_slopes(chain, index, x, 2 * len(self.vertices)) for chain, index in chains)
        outside = ~self.touches(x)
        by_l[outside] = by_u[outside] = np.nan
        return by_l, by_u


def _slopes(chain: FloatArray, index: IntArray, x: FloatArray, places: int) -> FloatArray:
    """Return the slopes of a chain's height at x by all vertices (S, places)."""
    left = np.clip(np.searchsorted(chain[:, 0], x, side="right") - 1, 0, len(chain) - 2)
    (xa, ya), (xb, yb) = chain[left].T, chain[left + 1].T
    share = np.clip((x - xa) / (xb - xa), 0.0, 1.0)
    steepness = (yb - ya) / (xb - xa)
    slope = np.zeros((len(x), places))
    row = np.arange(len(x))
    for vertex, weight in ((index[left], 1.0 - share), (index[left + 1], share)):
        slope[row, 2 * vertex] = -steepness * weight
        slope[row, 2 * vertex + 1] = weight
    return slope


def uncrossed(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both chains (M, 2), (N, 2) with no part of the lower one above the upper one."""
    lower, upper = lower.copy(), upper.copy()
    lower[1:-1, 1] = np.minimum(lower[1:-1, 1], np.interp(lower[1:-1, 0], *upper.T))
    upper[1:-1, 1] = np.maximum(upper[1:-1, 1], np.interp(upper[1:-1, 0], *lower.T))
    return lower, upper


def max_height(lower: FloatArray, upper: FloatArray) -> float:
    """Return the greatest distance in y between two chains (M, 2), (N, 2)."""
    x = np.concatenate([lower[:, 0], upper[:, 0]])
    return float((np.interp(x, *upper.T) - np.interp(x, *lower.T)).max())


def close_chains(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Join a lower and an upper chain, both (M, 2) left to right, to a counter-clockwise polygon.

    Points that both chains share, at the ends, appear once.
    """
    ring = np.concatenate([lower, upper[::-1]])
    return np.asarray(ring[distinct(ring)])


def distinct(ring: FloatArray) -> BoolArray:
    """Return which points of a ring (M, 2) differ from their next one (M,)."""
    return np.asarray((ring != np.concatenate([ring[1:], ring[:1]])).any(axis=1))

"""Where ideal contact on a thin strip would end that reads like edges across a wide strip, and the slopes of that.

Without contact resistance the difference of both layers' potentials is 0 under the contact and obeys Laplace's
equation beside it; it is even along either bar, and no current leaves the sides. So it is y plus what charges on the
contact's edge add, by the Green's function of the strip: mirrored in its sides, -(ln|2 sinh(pi (z - z') / 2)| +
ln|2 sinh(pi (z + z'*) / 2)|) / 2 pi with z = y + ix over the width, and once more in the bars. On each straight piece
of the edge the charge is a series of Chebyshev polynomials over sqrt(1 - t^2), whose logarithmic integrals are known
(J. C. Mason and D. C. Handscomb, Chebyshev Polynomials (2003), 9.5.2), so corners and tips need no finer mesh.

Slopes by the ends of the edges are those of the equations solved, by their transposes: all for one solution more.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tacstrip.arrays import FloatArray

BAR = 0.02  # widths: nearer to a bar the charges and their images are too near for the quadrature
_FAR = 3.0  # widths: an image beyond a bar adds exp(-2 pi) to the power of this
_FEWEST, _BY_LENGTH, _MOST = 8, 6.0, 64  # terms of a piece: so many, and more for each width that it is long
_UNKNOWNS = 800
_FINER = 4  # quadrature nodes a term
_KEPT = 2**18  # numbers of a thread's scratch memory, for 104 unknowns
_DIGITS = 7  # of widths: fewer than rounding leaves alike on all machines, whatever their threads (1e-13)


@dataclass(frozen=True, eq=False)
class _Series:
    """Of a piece with n terms: where its equations stand, t (n,), and its charges, s (4 n,), from -1 to 1."""

    t: FloatArray
    s: FloatArray
    gap: FloatArray  # ln|t - s| (n, 4 n); no node of t is one of s, for there are four of the latter to each
    weight: FloatArray  # of T_k over sqrt(1 - t^2) at s (4 n, n)
    own: FloatArray  # what the logarithm makes of each term at t (n, n)

    @staticmethod
    @lru_cache(maxsize=64)
    def of(terms: int) -> _Series:
        t, s = (np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in (terms, _FINER * terms))
        order = np.arange(terms)
        log_of_term = -np.pi * np.where(order == 0, np.log(2.0), 1.0 / np.maximum(order, 1))
        return _Series(
            t,
            s,
            np.log(np.abs(t[:, None] - s)),
            np.cos(order * np.arccos(s)[:, None]) * (np.pi / len(s)),
            np.cos(order * np.arccos(t)[:, None]) * log_of_term / (2.0 * np.pi),
        )


@dataclass(frozen=True, eq=False)
class Charges:
    """The charges on straight edges across a strip of width 1.

    Examples
    --------
    Edges at 45 degrees read ln 2 / pi of the width beyond their middles, and a contact that moves takes them with it:

    >>> import numpy as np
    >>> from tacstrip.contact.boundary_integrals import Charges
    >>> charges = Charges.on(np.array([[(0, 4), (1, 5)], [(0, 7), (1, 8)]]), 10.0)
    >>> charges.ends.round(3).tolist(), charges.slopes()[..., 1].sum(axis=(1, 2)).round(3).tolist()
    ([4.279, 7.721], [1.0, 1.0])
    """

    series: list[_Series]
    rows: list[slice]  # of each piece's terms
    at: FloatArray  # where the equations stand (n, 2), and the charges (4 n, 2)
    by: FloatArray
    bars: list[float]  # sums of y and its image's, of those that count
    system: FloatArray
    moments: FloatArray
    found: FloatArray  # terms of all pieces, and a constant (n + 1,)

    @classmethod
    def on(cls, edges: FloatArray, length: float) -> Charges | None:
        """Return those on edges (P, 2, 2) of a strip of a length; None without any, with hundreds, or near a bar."""
        if not 0 < len(edges) <= _UNKNOWNS // _FEWEST:
            return None
        if edges[..., 1].min() < BAR or edges[..., 1].max() > length - BAR:
            return None
        middle, reach = edges.mean(axis=1), 0.5 * (edges[:, 1] - edges[:, 0])
        most = max(_FEWEST, min(_MOST, _UNKNOWNS // len(edges)))
        terms = np.clip(_FEWEST + _BY_LENGTH * 2.0 * np.hypot(*reach.T), _FEWEST, most).astype(int)
        series = [_Series.of(n) for n in terms.tolist()]
        at, by = (
            np.concatenate([m + r * each[:, None] for m, r, each in zip(middle, reach, nodes, strict=True)])
            for nodes in ([one.t for one in series], [one.s for one in series])
        )
        ends = np.cumsum(terms).tolist()
        rows = [slice(end - len(one.t), end) for end, one in zip(ends, series, strict=True)]
        y, by_y = at[:, 1:], by[:, 1]
        near = by_y.min() < _FAR, by_y.max() > length - _FAR
        bars = [bar for bar, counts in zip((0.0, 2.0 * length), near, strict=True) if counts]
        images = _Images(at, by)
        kernel, other = images.planes[:2]
        images.log(by_y, kernel)
        for bar in bars:
            kernel -= images.log(bar - by_y, other)
        kernel *= -1.0 / (2.0 * np.pi)
        np.abs(np.subtract(y, by_y, out=other), out=other)
        other *= 0.5
        kernel -= other
        # What goes into the contact comes out of it: the charges sum to 0. A constant is left open instead.
        count = len(y)
        system, moments = np.zeros((count + 1, count + 1)), np.empty(count)
        system[:count, count] = 1.0
        for row, one in zip(rows, series, strict=True):
            node = _nodes(row)
            kernel[row, node] += one.gap / (2.0 * np.pi)
            system[:count, row], moments[row] = kernel[:, node] @ one.weight, by_y[node] @ one.weight
            system[row, row] -= one.own
            system[count, row.start] = np.pi
        return cls(series, rows, at, by, bars, system, moments, np.linalg.solve(system, np.append(-y, 0.0)))

    @property
    def ends(self) -> FloatArray:
        """Ends l and u (2,) of the ideal contact on a thin strip that reads the same, within 1e-3."""
        moment, constant = 0.5 * float(self.found[:-1] @ self.moments), float(self.found[-1])
        l, u = (round(end, _DIGITS) for end in (moment - constant, -moment - constant))
        return np.array([l, max(l, u)])

    def slopes(self) -> FloatArray:
        """Return the slopes of l and u by the ends of the edges (2, P, 2, 2)."""
        terms = self.found[:-1]
        # Of half the moment, and of the constant.
        asked = np.stack([np.append(0.5 * self.moments, 0.0), np.append(np.zeros(len(terms)), 1.0)], axis=1)
        weight = -np.linalg.solve(self.system.T, asked)[:-1].T
        charge = np.concatenate(
            [one.weight @ terms[row] for row, one in zip(self.rows, self.series, strict=True)]
        )
        by_y, images = self.by[:, 1], _Images(self.at, self.by)
        of_at, of_by = images.pulls(by_y, charge, weight)
        for bar in self.bars:
            at, by = images.pulls(bar - by_y, charge, weight, vanishing=True)
            of_at -= at
            of_by -= by * (1.0, -1.0)
        of_at *= -1.0 / (2.0 * np.pi)
        of_by *= -1.0 / (2.0 * np.pi)
        of_at[..., 1] += weight
        of_by[0, :, 1] += 0.5 * charge
        found = np.empty((2, len(self.rows), 2, 2))
        for piece, (row, one) in enumerate(zip(self.rows, self.series, strict=True)):
            own, node = of_at[:, row], of_by[:, _nodes(row)]
            for end, side in enumerate((-1.0, 1.0)):
                found[:, piece, end] = 0.5 * ((1.0 + side * one.t) @ own + (1.0 + side * one.s) @ node)
        moment, constant = found
        return np.stack([moment - constant, -moment - constant])


def _nodes(row: slice) -> slice:
    return slice(_FINER * row.start, _FINER * row.stop)


class _Images:
    """Points (n, 2), and charges (m, 2) with their images in the sides, of a strip of width 1."""

    def __init__(self, at: FloatArray, by: FloatArray) -> None:
        self.y = at[:, 1:]
        self.at, self.by = np.pi * at[:, 0], np.pi * by[:, 0]
        self.planes = _planes(len(at), len(by))

    def _squares(self, charge_y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return exp(-pi |dy|), |2 sinh(pi dz / 2)|^2 times that, of the charge and of its image, and scratch."""
        decay, one, other, along = self.planes[2:]
        np.subtract(self.y, charge_y, out=decay)
        np.abs(decay, out=decay)
        decay *= -np.pi
        np.exp(decay, out=decay)
        half, by_half = 0.5 * self.at[:, None], 0.5 * self.by
        np.multiply(np.sin(half), np.cos(by_half), out=one)
        np.multiply(np.cos(half), np.sin(by_half), out=along)
        np.add(one, along, out=other)
        one -= along
        np.subtract(1.0, decay, out=along)
        along *= along
        for square in (one, other):
            square *= 2.0
            square *= square
            square *= decay
            square += along
        return decay, one, other, along

    def log(self, charge_y: FloatArray, out: FloatArray) -> FloatArray:
        """Return ln|2 sinh(pi dz / 2)| - pi |dy| / 2, both added, which vanishes far away."""
        _, one, other, _ = self._squares(charge_y)
        np.multiply(one, other, out=out)
        np.log(out, out=out)
        out *= 0.5
        return out

    def pulls(
        self, charge_y: FloatArray, charge: FloatArray, weight: FloatArray, *, vanishing: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return the slopes of `weight` (k, n) @ f @ charge (m,) by the points (k, n, 2) and the charges (k, m, 2).

        f is `log`, or ln|2 sinh(pi dz / 2)| of both, + pi |dy|: of the equations' -|dy| / 2 nothing is left then.
        """
        decay, one, other, along = self._squares(charge_y)
        np.reciprocal(one, out=one)
        np.reciprocal(other, out=other)
        np.add(one, other, out=along)
        one *= decay
        other *= decay
        decay *= decay
        np.subtract(1.0, decay, out=decay)
        along *= decay
        along *= 0.5
        if vanishing:
            along -= 1.0
        np.subtract(self.y, charge_y, out=decay)
        along *= np.sign(decay, out=decay)
        sine, cosine, by_sine, by_cosine = np.sin(self.at), np.cos(self.at), np.sin(self.by), np.cos(self.by)
        both = np.stack([by_cosine * charge, by_sine * charge], axis=1)
        (a, b), (c, d) = (one @ both).T, (other @ both).T
        of_at = np.stack([weight * (sine * (a + c) - cosine * (b - d)), weight * (along @ charge)], axis=-1)
        first, second = weight * sine, weight * cosine
        x = by_cosine * (first @ other - first @ one) + by_sine * (second @ other + second @ one)
        of_by = np.stack([x * charge, -(weight @ along) * charge], axis=-1)
        return np.pi * of_at, np.pi * of_by


_memory = threading.local()


def _planes(rows: int, columns: int) -> FloatArray:
    """Return arrays (6, rows, columns), of this thread until the next call: new memory costs more than the sums."""
    size = 6 * rows * columns
    if size > _KEPT:
        return np.empty((6, rows, columns))
    if not hasattr(_memory, "kept"):
        _memory.kept = np.empty(_KEPT)
    kept: FloatArray = _memory.kept[:size]
    return kept.reshape(6, rows, columns)

"""Contact resistance on wide strips: where a contact on a thin strip would end that reads the same, and its slopes.

The difference d of both layers' potentials obeys div grad d = d / lambda^2 under the contact and 0 beside it; it is
even along either bar, and no current leaves the sides. A field of 1 enters at one bar and leaves at the other, so d is
L - u' at the upper bar and -l' at the lower one, for the ideal contact on a thin strip that reads the same;
`width_from_ideal` leads on to one of the same lambda.

Across the strip d is a sum of cosines. Where the strip is free or covered over its whole width each has its own
exponentials along the strip. In between, where an edge crosses it, they couple by integrals of their products under
the contact, and along the strip they are polynomials on finite elements. The ends are what a quadratic form takes as
its least, so their error is of twice the order of the potentials'. Where the edge moves outwards by n, l' or u' moves
by the integral along the edge of d, n and the potential of a unit current into that bar, over lambda^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solveh_banded

from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import width_from_ideal

_FEWEST, _MOST, _PER_LAMBDA = 8, 64, 1.0  # cosines
_DEGREE = 3  # of the polynomials
_LONGEST = 0.5  # element, of the width or of lambda
_SAME = 1e-9  # of the width: closer places along the strip are one
_HELD = 1e30  # what holds a cosine at 0 at a bar
_SHORTEST = 1e-9  # of the width: ideal contact


@lru_cache(maxsize=8)
def _element(points: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return Gauss points from 0 to 1 (q,), weights (q,), polynomials there (q, nodes), and the products' integrals.

    Of the polynomials, and of their slopes: (nodes, nodes) each.
    """
    at, weight = np.polynomial.legendre.leggauss(points)
    t, weight = 0.5 * (at + 1.0), 0.5 * weight
    nodes = 0.5 * (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE))
    by_power = np.linalg.inv(np.vander(nodes, increasing=True))
    powers = np.arange(_DEGREE + 1)
    value = np.vander(t, _DEGREE + 1, increasing=True) @ by_power
    slope = (powers * t[:, None] ** np.maximum(powers - 1, 0)) @ by_power
    return t, weight, value, (value * weight[:, None]).T @ value, (slope * weight[:, None]).T @ slope


@dataclass(frozen=True, eq=False)
class LeakingStrips:
    ends: FloatArray  # (2, n)
    edges: FloatArray
    _decay: float
    _elements: tuple
    _rows: tuple
    _potential: FloatArray  # (nodes, N, 2): d, lower

    @classmethod
    def on(cls, edges: FloatArray, length: float, decay: float, N=None, h=None, q=None) -> LeakingStrips:
        """edges (n, P, 2, 2) in widths; padded by edges without a length."""
        n = len(edges)
        N = N or int(np.clip(np.ceil(_PER_LAMBDA / decay), _FEWEST, _MOST))
        h = (h or _LONGEST) * min(1.0, decay) if False else (h or _LONGEST)
        q = q or N + 4
        p = _DEGREE
        strip, y = _places(edges, length)
        inner = strip[1:] == strip[:-1]
        of, low, high = strip[:-1][inner], y[:-1][inner], y[1:][inner]
        middle = 0.5 * (low + high)
        covered = _lengths(edges[of], middle[:, None], 0)[:, 0, 0]
        port = (covered < 1e-12) | (covered > 1.0 - 1e-12)
        parts = np.where(port, 1, np.ceil((high - low) / h - 1e-9).astype(int).clip(1))
        adds = np.where(port, 1, parts * p)
        # nodes: first of an interval
        first = np.cumsum(adds) - adds + of
        bar_low = first[np.searchsorted(of, np.arange(n))]
        last = np.searchsorted(of, np.arange(n), side="right") - 1
        bar_high = first[last] + adds[last]
        count = int(bar_high[-1]) + 1
        # elements
        which = np.repeat(np.flatnonzero(~port), parts[~port])
        number = np.arange(len(which)) - np.repeat(np.cumsum(parts[~port]) - parts[~port], parts[~port])
        tall = ((high - low) / parts)[which]
        begin = low[which] + number * tall
        node = first[which] + number * p
        t, weight, value, mass, stiff = _element(q)
        own = edges[of[which]]
        at = begin[:, None] + tall[:, None] * t
        S = _lengths(own, at, 2 * N - 2)  # (E, q, 2N-1)
        pairs = (value[:, :, None] * value[:, None, :] * weight[:, None, None]).reshape(q, -1)
        G = (pairs.T @ S).reshape(-1, p + 1, p + 1, 2 * N - 1) * (tall / (2.0 * decay**2))[:, None, None, None]
        k = np.arange(N)
        minus, plus = np.abs(k[:, None] - k), k[:, None] + k
        A = (G[..., minus] + G[..., plus]).transpose(0, 1, 3, 2, 4)  # (E, i, n, j, m)
        w = np.where(k == 0, 1.0, 0.5)
        A = np.ascontiguousarray(A)
        diag = np.einsum("einjn->eijn", A)
        diag += w * (stiff[..., None] / tall[:, None, None, None] + mass[..., None] * (np.pi * k) ** 2 * tall[:, None, None, None])
        size = (p + 1) * N
        kd = size - 1
        a, b = np.tril_indices(size)
        band = np.bincount(
            (((node * N)[:, None] + b) * (kd + 1) + a - b).ravel(),
            A.reshape(-1, size, size)[:, a, b].ravel(),
            minlength=count * N * (kd + 1),
        ).reshape(count * N, kd + 1)
        # ports
        H = (high - low)[port]
        rate = np.sqrt((np.pi * k) ** 2 + (covered[port] > 0.5)[:, None] / decay**2)
        safe = np.where(rate > 0.0, rate, 1.0)
        e = np.exp(-safe * H[:, None])
        e2 = -np.expm1(-2.0 * safe * H[:, None])
        own_ = w * np.where(rate > 0.0, safe * (1.0 + e * e) / e2, 1.0 / H[:, None])
        off_ = -w * np.where(rate > 0.0, 2.0 * safe * e / e2, 1.0 / H[:, None])
        f = (first[port] * N)[:, None] + k
        np.add.at(band[:, 0], f, own_)
        np.add.at(band[:, 0], f + N, own_)
        band[f, N] += off_
        for bar in (bar_low, bar_high):
            band[(bar * N)[:, None] + k[1:], 0] += _HELD
        right = np.zeros((count * N, 2))
        right[bar_low * N] = -1.0, 1.0
        right[bar_high * N, 0] = 1.0
        found = solveh_banded(band.T, right, lower=True, check_finite=False, overwrite_ab=True, overwrite_b=True)
        found = found.reshape(count, N, 2)
        l = -found[bar_low, 0, 0]
        u = length - found[bar_high, 0, 0]
        wide = width_from_ideal(np.maximum(u - l, _SHORTEST), decay)
        ends = 0.5 * (l + u + np.array([[-1.0], [1.0]]) * wide)
        return cls(ends, edges, decay, (of[which], node, begin, tall, q), (strip, y), found)


def _places(edges, length):
    n = len(edges)
    y = np.concatenate([edges[..., 1].reshape(n, -1).clip(0.0, length), np.zeros((n, 1)), np.full((n, 1), length)], axis=1)
    y.sort(axis=1)
    keep = np.concatenate([np.ones((n, 1), bool), np.diff(y, axis=1) > _SAME], axis=1)
    # the upper bar stays
    y[:, 1:][(length - y[:, 1:] < _SAME) & keep[:, 1:]] = length
    strip = np.repeat(np.arange(n), y.shape[1]).reshape(y.shape)
    return strip[keep], y[keep]


def _lengths(edges, y, most):
    """integral of cos(k pi x), k = 0 .. most, over what lies under the contact at y (E, q): (E, q, most + 1)"""
    (x0, y0), (x1, y1) = edges[:, :, 0].transpose(2, 0, 1), edges[:, :, 1].transpose(2, 0, 1)  # (E, P)
    rise = y1 - y0
    level = np.abs(rise) < _SAME
    t = (y[..., None] - y0[:, None]) / np.where(level, 1.0, rise)[:, None]
    t = np.where(level[:, None], y[..., None] > y0[:, None], np.clip(t, 0.0, 1.0))
    cut = x0[:, None] + t * (x1 - x0)[:, None]  # (E, q, P)
    down = (rise < 0.0) & ~level
    sign = np.where(down, -1.0, 1.0)
    const = np.where(down, x1, -x0)
    out = np.empty((*y.shape, most + 1))
    out[..., 0] = (sign[:, None] * cut).sum(axis=-1) + const.sum(axis=-1)[:, None]
    if most:
        k = np.pi * np.arange(1, most + 1)
        fixed = (sign[..., None] * -np.sin(np.where(down, x1, x0)[..., None] * k)).sum(axis=1)
        out[..., 1:] = (np.einsum("eqpk,ep->eqk", np.sin(cut[..., None] * k), sign) + fixed[:, None]) / k
    return out

"""Contact resistance on wide strips: where a contact on a thin strip would end that reads the same, and the slopes.

The difference d of both layers' potentials obeys div grad d = d / lambda^2 under the contact and 0 beside it; it is
even along either bar, and no current leaves the sides. A field of 1 enters at one bar and leaves at the other, so d is
L - u' at the upper bar and -l' at the lower one, for the ideal contact on a thin strip that reads the same;
`width_from_ideal` leads on to one of the same lambda.

Across the strip d is a sum of cosines. Where the strip is free, or covered over its whole width, each of them has its
own exponentials along the strip. In between, where an edge crosses it, integrals of their products under the contact
couple them, and along the strip they are polynomials on finite elements. The ends are the least values of quadratic
forms, so their errors are as the squares of the potentials'. Where the edge moves outwards by n, l' or u' moves by the
integral along the edge of n, d and the potential of a unit current into that bar, over lambda^2.

Lengths are in widths of the strip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from scipy.linalg import solveh_banded
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.boundary_integrals import Charges
from tacstrip.sensor.closed_form import width_from_ideal

_COSINES, _FEWEST, _MOST = 6.0, 6, 64  # times 1 / sqrt(lambda)
_DEGREE = 4  # of the polynomials
_ELEMENT, _LONGEST = 0.9, 1.0  # times sqrt(lambda): how long elements are
_POINTS = 4  # of the quadrature, more than cosines
_TOGETHER = 1500  # strips times squares of the number of cosines
_SAME = 1e-9  # closer places along the strip are one
LEAST = 0.02  # lambda that is solved for; with less, ends lie between these and those of ideal contact
_LEAST_LEAK = 1e-6  # of a contact in all: with less, too, it reads where it is
_FREE = 1e-12  # less of the width is not covered
_HELD = 1e30  # what holds a cosine at 0 at a bar
_SHORTEST = 1e-9  # ideal contact


def edges_on(contacts: Sequence[BaseGeometry]) -> FloatArray:
    """Return the edges of areas (n, P, 2, 2) as `ResistiveEnds.on` takes them; those of no length fill up."""
    found = []
    for contact in contacts:
        rings = []
        for part in shapely.get_parts(contact):
            if part.area > 0.0:
                for number, ring in enumerate((part.exterior, *part.interiors)):
                    at = shapely.get_coordinates(ring)[:: 1 if ring.is_ccw == (number == 0) else -1]
                    rings.append(np.stack([at[:-1], at[1:]], axis=1))
        found.append(np.concatenate(rings))
    most = max(map(len, found))
    return np.stack([np.concatenate([e, np.tile(e[-1:, 1:], (most - len(e), 2, 1))]) for e in found])


@dataclass(frozen=True, eq=False)
class ResistiveEnds:
    """Contacts on strips of width 1.

    Attributes
    ----------
    ends
        l and u (2, n) of contacts on thin strips of the same lambda that read the same; l may be below 0, and u above
        the length, of a contact near a bar.

    Examples
    --------
    A slanted edge reads beyond its middle, the less the longer lambda, and a contact that moves takes its ends along:

    >>> import numpy as np
    >>> from tacstrip.contact.resistive_ends import ResistiveEnds
    >>> edges = np.array([[[(0, 4), (1, 4)], [(1, 8), (0, 7)]]])
    >>> [ResistiveEnds.on(edges, 12.0, lam).ends.ravel().round(3).tolist() for lam in (0.1, 0.5)]
    [[4.0, 7.688], [4.0, 7.609]]
    >>> ResistiveEnds.on(edges, 12.0, 0.5).slopes()[..., 1].sum(axis=(2, 3)).ravel().round(3).tolist()
    [1.0, 1.0]
    """

    ends: FloatArray
    _parts: list[_Solved]
    _ideal: list[tuple[int, BoolArray, Charges]]  # strips, which of their edges, and the charges on these
    _share: float  # of ideal contact, on these strips

    @classmethod
    def on(cls, edges: FloatArray, length: float, decay: float) -> ResistiveEnds:
        """Return those of contacts with edges (n, P, 2, 2) from point to point, x from 0 to 1.

        Contacts lie to the left of their edges. What lies along a strip's sides or over the bars may be left out.
        `decay` is lambda, above 0.
        """
        share, decay = max(0.0, 1.0 - decay / LEAST), max(decay, LEAST)
        cosines = int(np.clip(np.ceil(_COSINES / np.sqrt(decay)), _FEWEST, _MOST))
        together = max(1, _TOGETHER // cosines**2)
        parts = [
            _Solved.of(edges[i : i + together], length, decay, cosines)
            for i in range(0, len(edges), together)
        ]
        ends = np.concatenate([p.ends for p in parts], axis=1)
        ideal = []
        if share:
            run, rise = np.moveaxis(np.abs(edges[:, :, 1] - edges[:, :, 0]), -1, 0)
            beside = (run == 0.0) & np.isin(edges[:, :, 0, 0], (0.0, 1.0))
            for strip, own in enumerate((np.maximum(run, rise) > _SAME) & ~beside):
                charges = Charges.on(edges[strip, own], length)
                if charges is not None:
                    ideal.append((strip, own, charges))
                    ends[:, strip] += share * (charges.ends - ends[:, strip])
        return cls(ends, parts, ideal, share)

    def slopes(self) -> FloatArray:
        """Return the slopes of l and u by the ends of the edges (2, n, P, 2, 2)."""
        found = np.concatenate([part.slopes() for part in self._parts], axis=1)
        for strip, own, charges in self._ideal:
            found[:, strip] *= 1.0 - self._share
            found[:, strip, own] += self._share * charges.slopes()
        return found


@dataclass(frozen=True, eq=False)
class _Intervals:
    """Strips cut where an edge begins or ends: `strip` (I,) from `low` to `high` (I,), ascending.

    Attributes
    ----------
    alike
        Whether the strip is free or covered over its whole width (I,), and `covered` (I,) which.
    parts
        Elements of each, 1 where alike (I,).
    node
        Number of the node at the lower end (I,).
    leak
        Conductance of the contact per area (I,), 1 / lambda^2; more where a speck would be lost in rounding.
    bars
        Nodes of the lower and the upper bars (2, n).
    """

    strip: IntArray
    low: FloatArray
    high: FloatArray
    alike: BoolArray
    covered: BoolArray
    parts: IntArray
    node: IntArray
    leak: FloatArray
    bars: IntArray

    @classmethod
    def between(cls, edges: FloatArray, length: float, decay: float) -> _Intervals:
        n = len(edges)
        y = np.pad(
            edges[..., 1].reshape(n, -1).clip(0.0, length), ((0, 0), (1, 1)), constant_values=(0.0, length)
        )
        y.sort(axis=1)
        y[y > length - _SAME] = length
        new = np.diff(y, axis=1, prepend=-1.0) > _SAME
        strip, y = np.nonzero(new)[0], y[new]
        inner = strip[1:] == strip[:-1]
        of, low, high = strip[:-1][inner], y[:-1][inner], y[1:][inner]
        covered = _under(edges[of], 0.5 * (low + high)[:, None], 1)[:, 0, 0]
        alike = (covered < _FREE) | (covered > 1.0 - _FREE)
        area = np.bincount(of, np.where(alike, covered > 0.5, covered) * (high - low), minlength=n)
        leak = np.maximum(1.0 / decay**2, _LEAST_LEAK / np.maximum(area, _SAME**2))[of]
        longest = min(_LONGEST, _ELEMENT * np.sqrt(decay))
        parts = np.where(alike, 1, np.ceil((high - low) / longest)).astype(int)
        nodes = np.where(alike, 1, _DEGREE * parts)
        node = np.cumsum(nodes) - nodes + of
        first, last = (np.searchsorted(of, np.arange(n), side=side) for side in ("left", "right"))
        bars = np.stack([node[first], node[last - 1] + nodes[last - 1]])
        return cls(of, low, high, alike, covered > 0.5, parts, node, leak, bars)

    def at(self, strip: IntArray, y: FloatArray) -> IntArray:
        """Return the nodes nearest to places y (M,) of strips (M,) where an edge begins or ends."""
        step = 2.0 * self.high.max()
        low = np.searchsorted(self.strip * step + self.low, strip * step + y + 2.0 * _SAME) - 1
        upper = y > self.high[low] - 2.0 * _SAME  # at the upper bar
        return np.asarray(np.where(upper, self.bars[1, strip], self.node[low]))


@dataclass(frozen=True, eq=False)
class _Solved:
    """Strips solved at once: d and the lower bar's potential (nodes, cosines, 2)."""

    ends: FloatArray
    edges: FloatArray
    decay: float
    intervals: _Intervals
    elements: _Elements
    potential: FloatArray

    @classmethod
    def of(cls, edges: FloatArray, length: float, decay: float, cosines: int) -> _Solved:
        cut = _Intervals.between(edges, length, decay)
        elements = _Elements.of(cut, edges, cosines)
        size, count = (_DEGREE + 1) * cosines, int(cut.bars.max() + 1) * cosines
        matrices = elements.matrices(cosines)
        row, column = np.tril_indices(size)
        place = ((elements.node * cosines)[:, None] + column) * size + row - column
        sums = np.bincount(place.ravel(), matrices[:, row, column].ravel(), minlength=count * size)
        band = sums.astype(float).reshape(count, size)  # by columns: the diagonal, and what is below it
        _add_alike(band, cut, cosines)
        lower, upper = cut.bars * cosines
        for bar in (lower, upper):
            band[bar[:, None] + np.arange(1, cosines), 0] += _HELD
        fed = np.zeros((count, 2))
        fed[lower], fed[upper, 0] = (-1.0, 1.0), 1.0
        found = solveh_banded(
            band.T, fed, lower=True, overwrite_ab=True, overwrite_b=True, check_finite=False
        )
        l, u = -found[lower, 0], length - found[upper, 0]
        wide = width_from_ideal(np.maximum(u - l, _SHORTEST), decay)
        ends = 0.5 * (l + u + np.array([[-1.0], [1.0]]) * wide)
        return cls(ends, edges, decay, cut, elements, found.reshape(-1, cosines, 2))

    def slopes(self) -> FloatArray:
        """Return the slopes of the ends by those of the edges (2, n, P, 2, 2)."""
        e, level = self.elements, _level(self.edges)
        own, run = self.edges[e.strip], np.diff(self.edges, axis=2)[:, :, 0]  # (E, P, 2, 2), (n, P, 2)
        t = _share(own, e.at)
        here = (t > 0.0) & (t < 1.0) & ~level[e.strip][:, None]  # (E, q, P)
        element, point, edge = np.nonzero(here)
        weight = (e.tall[:, None] * e.rule.weight)[element, point] / np.abs(run[e.strip[element], edge, 1])
        nodes = self.potential[e.node[:, None] + np.arange(_DEGREE + 1)]
        values = np.einsum("qi,eikv->eqkv", e.rule.value, nodes)[element, point]
        found = np.zeros((2, *self.edges.shape))
        self._add(found, e.strip[element], edge, t[here], weight, values)
        strip, edge = np.nonzero(level & (np.abs(run[..., 0]) > _SAME))
        if len(strip):
            t, weight = np.tile(e.rule.t, len(strip)), np.tile(e.rule.weight, len(strip))
            node = self.intervals.at(
                strip, self.edges[strip, edge, 0, 1].clip(0.0, self.intervals.high.max())
            )
            strip, edge, node = (np.repeat(a, len(e.rule.t)) for a in (strip, edge, node))
            self._add(found, strip, edge, t, weight, self.potential[node])
        first = np.searchsorted(self.intervals.strip, np.arange(len(self.edges)))
        l, u = found * self.intervals.leak[first, None, None, None]
        short = np.diff(self.ends, axis=0)[0] / (2.0 * self.decay)
        grows = (u - l) / np.tanh(short)[:, None, None, None] ** 2  # as w - 2 T does
        return np.asarray(0.5 * (l + u + np.array([-1.0, 1.0])[:, None, None, None, None] * grows))

    def _add(
        self,
        found: FloatArray,
        strip: IntArray,
        edge: IntArray,
        t: FloatArray,
        weight: FloatArray,
        values: FloatArray,
    ) -> None:
        """Add what places (M,) on edges add to the slopes, with the cosines' `values` there (M, cosines, 2)."""
        begin, end = self.edges[strip, edge].transpose(1, 0, 2)
        x = begin[:, 0] + t * (end - begin)[:, 0]
        wave = np.cos(np.pi * x[:, None] * np.arange(values.shape[1]))
        d, lower = np.einsum("mkv,mk->vm", values, wave)
        outwards = (end - begin)[:, ::-1] * (1.0, -1.0)
        for of_end, potential in zip(found, (lower, lower + d), strict=True):
            pull = (weight * d * potential)[:, None] * outwards
            np.add.at(of_end[:, :, 0], (strip, edge), (1.0 - t)[:, None] * pull)
            np.add.at(of_end[:, :, 1], (strip, edge), t[:, None] * pull)


@dataclass(frozen=True, eq=False)
class _Rule:
    """Of an element from 0 to 1: Gauss points t and weights (q,), the polynomials' values there (q, nodes).

    And integrals of products (nodes, nodes) of the polynomials, `mass`, and of their slopes, `stiff`.
    """

    t: FloatArray
    weight: FloatArray
    value: FloatArray
    mass: FloatArray
    stiff: FloatArray

    @staticmethod
    @lru_cache(maxsize=8)
    def of(points: int) -> _Rule:
        at, weight = np.polynomial.legendre.leggauss(points)
        t, weight = 0.5 * (at + 1.0), 0.5 * weight
        power = np.arange(_DEGREE + 1)
        nodes = 0.5 - 0.5 * np.cos(np.pi * power / _DEGREE)
        by_power = np.linalg.inv(nodes[:, None] ** power)
        value = t[:, None] ** power @ by_power
        slope = (power * t[:, None] ** np.maximum(power - 1, 0)) @ by_power
        mass, stiff = ((each * weight[:, None]).T @ each for each in (value, slope))
        return _Rule(t, weight, value, mass, stiff)


@dataclass(frozen=True, eq=False)
class _Elements:
    """Elements of strips (E,), `tall` (E,) each, with their first nodes and leaks (E,), where an edge crosses.

    `at` (E, q) are places along the strip, `under` (E, q, 2 cosines - 1) the integrals of cosines over what is under
    the contact there.
    """

    strip: IntArray
    tall: FloatArray
    node: IntArray
    leak: FloatArray
    rule: _Rule
    at: FloatArray
    under: FloatArray

    @classmethod
    def of(cls, cut: _Intervals, edges: FloatArray, cosines: int) -> _Elements:
        rule = _Rule.of(cosines + _POINTS)
        parts = np.where(cut.alike, 0, cut.parts)
        which = np.repeat(np.arange(len(parts)), parts)
        number = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)
        tall = (cut.high - cut.low)[which] / parts[which]
        at = (cut.low[which] + number * tall)[:, None] + tall[:, None] * rule.t
        strip = cut.strip[which]
        under = _under(edges[strip], at, 2 * cosines - 1)
        return cls(strip, tall, cut.node[which] + _DEGREE * number, cut.leak[which], rule, at, under)

    def matrices(self, cosines: int) -> FloatArray:
        """Return the elements' matrices (E, nodes * cosines, nodes * cosines)."""
        value, nodes = self.rule.value, _DEGREE + 1
        pairs = value[:, :, None] * value[:, None] * self.rule.weight[:, None, None]
        by_order = pairs.reshape(len(pairs), -1).T @ self.under  # (E, nodes^2, 2 cosines - 1)
        by_order *= (0.5 * self.tall * self.leak)[:, None, None]
        k = np.arange(cosines)
        found = by_order[..., np.abs(k[:, None] - k)] + by_order[..., k[:, None] + k]
        found = found.reshape(-1, nodes, nodes, cosines, cosines)
        along = self.rule.stiff / self.tall[:, None, None]
        sideways = self.rule.mass * self.tall[:, None, None]
        found[..., k, k] += _weight(k) * (along[..., None] + sideways[..., None] * (np.pi * k) ** 2)
        return np.asarray(found.transpose(0, 1, 3, 2, 4).reshape(-1, nodes * cosines, nodes * cosines))


def _add_alike(band: FloatArray, cut: _Intervals, cosines: int) -> None:
    """Add intervals over which the strip is alike across: each cosine has exponentials of its own."""
    k = np.arange(cosines)
    rate = np.sqrt((np.pi * k) ** 2 + (cut.covered * cut.leak)[cut.alike, None])
    long = (cut.high - cut.low)[cut.alike, None]
    straight, rate = rate == 0.0, np.maximum(rate, _SAME)
    left, lost = np.exp(-rate * long), -np.expm1(-2.0 * rate * long)
    own = _weight(k) * np.where(straight, 1.0 / long, rate * (1.0 + left**2) / lost)
    other = _weight(k) * np.where(straight, 1.0 / long, 2.0 * rate * left / lost)
    place = cut.node[cut.alike, None] * cosines + k
    np.add.at(band[:, 0], place, own)
    np.add.at(band[:, 0], place + cosines, own)
    band[place, cosines] -= other


def _weight(k: IntArray) -> FloatArray:
    """Return the integral of a cosine's square across the strip."""
    return np.where(k == 0, 1.0, 0.5)


def _level(edges: FloatArray) -> BoolArray:
    """Whether edges (..., 2, 2) are straight across, all of them at one place along the strip."""
    return np.asarray(np.abs(edges[..., 1, 1] - edges[..., 0, 1]) <= _SAME)


def _share(edges: FloatArray, y: FloatArray) -> FloatArray:
    """Return how far along edges (E, P, 2, 2) they cross places y (E, q): (E, q, P), 0 or 1 where beside them."""
    begin, rise = edges[..., 0, 1], edges[..., 1, 1] - edges[..., 0, 1]
    ahead, level = y[..., None] - begin[:, None], _level(edges)
    share = np.clip(ahead / np.where(level, 1.0, rise)[:, None], 0.0, 1.0)
    return np.asarray(np.where(level[:, None], ahead > 0.0, share))


def _under(edges: FloatArray, y: FloatArray, orders: int) -> FloatArray:
    """Return integrals of cos(k pi x), k below `orders`, over what is under the contact at y (E, q): (E, q, orders).

    An edge to the right adds what lies above it, one to the left takes it away again.
    """
    x, falls = edges[..., 0], edges[..., 1, 1] < edges[..., 0, 1]
    falls &= ~_level(edges)
    share, sign = _share(edges, y), np.where(falls, -1.0, 1.0)
    cut = x[..., 0][:, None] + share * (x[..., 1] - x[..., 0])[:, None]
    start = np.where(falls, x[..., 1], x[..., 0])  # of what is above, from or to where the edge is cut
    found = np.empty((*y.shape, orders))
    found[..., 0] = ((cut - start[:, None]) * sign[:, None]).sum(axis=-1)
    k = np.pi * np.arange(1, orders)
    wave = np.sin(cut[..., None] * k) - np.sin(start[..., None] * k)[:, None]
    found[..., 1:] = np.einsum("eqpk,ep->eqk", wave, sign) / k
    return found

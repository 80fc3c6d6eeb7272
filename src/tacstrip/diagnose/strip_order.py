"""Which strips may be in each other's places, by how rough the readings are across the strips in either order.

A contact's signatures are smooth across the strips but for its corners. With two strips in each other's places these
and those beside them lie off each other's lines, and contacts have gaps. An order that takes that away, wherever the
contact is, and leaves less than offsets of all these strips would, is a question; of one that takes nothing away and
adds nothing the recording tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.exchanged import told_by_slope, touched_elsewhere
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.neighbour_prediction import WorkingCopy

_GAP = 0.15  # over Vref: how rough a gap counts, and the most that anything does
_COMPARED, _PART = 120, 256  # rows; pairs at a time
# Places: in a band every two are compared, of those further apart any two of the roughest.
_BAND, _ROUGHEST = 8, 32
# Footprints in which an order is better, by so much over Vref and signature, and what it leaves at the most; of all.
_FOOTPRINTS, _BETTER, _LEAVES = 3, 0.02, 0.6
_WORSE = 0.3  # footprints in which it is worse, over those in which it is better
_SILENT = ("open-strip", "dead", "intermittent")
_KNOWN = 0.7  # of the triples: an order that leaves fewer to compare is none


@dataclass(frozen=True, eq=False)
class Orders:
    """What exchanging two places would change, for every two that were compared (pairs,).

    Attributes
    ----------
    pairs
        The places (pairs, 2).
    better, worse
        Whether the order with the two exchanged is clearly the smoother one, and whether the order at hand is.
    gain
        By how much the former is, a row, over Vref.
    """

    pairs: IntArray
    better: BoolArray
    worse: BoolArray
    gain: FloatArray


def compared_orders(rows: WorkingCopy) -> Orders:
    """Compare the order of the strips with those that exchange two places.

    These are any two of a band, and of the roughest places any two: strips in each other's places are both rough. So
    the work is proportional to the number of strips.
    """
    some = np.linspace(0, len(rows.there) - 1, min(len(rows.there), _COMPARED)).astype(int)
    there = rows.there[some]
    at = _Roughness(np.stack([v[some] for v in rows.k.values()]), there)
    pairs = _pairs(at.around(), np.asarray(there.any(axis=0)))
    parts = [_compared(at, part, len(rows.k)) for part in np.split(pairs, range(_PART, len(pairs), _PART))]
    return Orders(pairs, *map(np.concatenate, zip(*parts, strict=True)))


def _pairs(rough: FloatArray, touched: BoolArray) -> IntArray:
    """Return the places to compare (pairs, 2), from how rough it is around each and which are touched (places,).

    Two that are not touched tell nothing.
    """
    n, roughest = len(rough), np.sort(np.argsort(-rough, kind="stable")[:_ROUGHEST]).tolist()
    pairs = {(i, j) for i in range(n) for j in range(i + 1, min(i + _BAND + 1, n))}
    pairs.update(combinations(roughest, 2))
    return np.array(sorted((i, j) for i, j in pairs if touched[i] or touched[j]), dtype=int).reshape(-1, 2)


def _compared(at: _Roughness, pairs: IntArray, signatures: int) -> tuple[BoolArray, BoolArray, FloatArray]:
    """Return `better`, `worse` and `gain` of `Orders` for some pairs (pairs, 2)."""
    now, then = at.now(pairs), at.exchanged(pairs)
    least = _BETTER * signatures

    def smoother(one: _Sums, other: _Sums) -> BoolArray:
        """Whether the order of `one` is clearly smoother than that of `other` (pairs,)."""
        clearly = (other.each - one.each > least) & (one.each < _LEAVES * other.each)
        against, times = (one.each - other.each > least).sum(axis=1), clearly.sum(axis=1)
        enough = (times >= _FOOTPRINTS) & (against <= _WORSE * times) & (one.known >= _KNOWN * other.known)
        less = (one.rough < _LEAVES * other.rough) & (other.rough - one.rough > least * at.rows)
        return np.asarray(enough & less & (one.rough < other.varies))

    return smoother(then, now), smoother(now, then), (now.rough - then.rough) / at.rows


@dataclass(frozen=True, eq=False)
class _Sums:
    """How rough it is: in each footprint's mean row (n, footprints), and over all rows (n,), as `_Roughness` says."""

    each: FloatArray
    rough: FloatArray
    known: FloatArray
    varies: FloatArray


class _Roughness:
    """How far each strip lies off the line of those beside it, over Vref, over all signatures.

    With it, in how many signatures that is known, and what is left with an offset of its own for each.
    """

    def __init__(self, values: FloatArray, there: BoolArray) -> None:
        self.rows, n = there.shape
        _, footprint, self._rows_of_each = np.unique(there, axis=0, return_inverse=True, return_counts=True)
        self._first = np.cumsum([0, *self._rows_of_each[:-1]])
        by_footprint = np.argsort(footprint.ravel(), kind="stable")
        values, there = values[:, by_footprint].swapaxes(1, 2), there[by_footprint].T
        # The last place stands for all beyond the sensor.
        self._values = np.pad(values, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
        self._there = np.pad(there, ((0, 1), (0, 0)))
        self._several = there.sum(axis=0) > 1  # alone is a strip only where others are touched, too
        self._own = self._sums(*self._triples(np.arange(n)[:, None] + (-1, 0, 1)))

    def around(self) -> FloatArray:
        """Return how rough each place and those beside it are, over all rows (places,)."""
        padded = np.pad(self._own.rough, 1)
        return np.asarray(padded[:-2] + padded[1:-1] + padded[2:])

    def now(self, pairs: IntArray) -> _Sums:
        """Return that of two places and those beside them, for some pairs (pairs, 2)."""
        around, counted = self._around(pairs)
        own, at = self._own, np.where(counted, around, len(self._own.rough)).T
        each = np.pad(own.each, ((0, 1), (0, 0)))
        others = (np.pad(one, (0, 1))[at].sum(axis=0) for one in (own.rough, own.known, own.varies))
        return _Sums(np.sum([each[i] for i in at], axis=0), *others)

    def exchanged(self, pairs: IntArray) -> _Sums:
        """Return the same with the two in each other's places."""
        around, counted = self._around(pairs)
        total = np.zeros((3, len(pairs), self.rows))
        for place, count in zip(around.T, counted.T, strict=True):
            strips = place[:, None] + (-1, 0, 1)
            strips = np.where(
                strips == pairs[:, :1], pairs[:, 1:], np.where(strips == pairs[:, 1:], pairs[:, :1], strips)
            )
            for one, more in zip(total, self._triples(strips), strict=True):
                one += more * count[:, None]
        return self._sums(*total)

    def _around(self, pairs: IntArray) -> tuple[IntArray, BoolArray]:
        """Return the places that an exchange changes, the two and those beside them, and which to count (pairs, 6)."""
        around = np.concatenate([pairs[:, :1] + (-1, 0, 1), pairs[:, 1:] + (-1, 0, 1)], axis=1)
        counted = (around >= 0) & (around < len(self._there) - 1)
        counted[:, 3:] &= around[:, 3:] > around[:, 2:3]  # once
        return around, counted

    def _sums(self, rough: FloatArray, known: FloatArray | IntArray, varies: FloatArray) -> _Sums:
        """Add up over rows what is (n, rows)."""
        each = np.add.reduceat(rough, self._first, axis=1) / self._rows_of_each
        return _Sums(each, rough.sum(axis=1), known.sum(axis=1), varies.sum(axis=1))

    def _triples(self, strips: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return that of the middle one of three strips (n, 3), each (n, rows)."""
        beyond = len(self._there) - 1
        left, strip, right = np.where((strips >= 0) & (strips < beyond), strips, beyond).T
        there, beside = self._there[strip], (self._there[left], self._there[right])
        odd = (beside[0] & beside[1] & ~there) | (there & ~beside[0] & ~beside[1] & self._several)
        off = self._values[:, left] - 2.0 * self._values[:, strip] + self._values[:, right]
        known = np.isfinite(off)
        usual = np.where(known, off, 0.0).sum(axis=2, keepdims=True)
        usual /= np.maximum(known.sum(axis=2, keepdims=True), 1)

        def added(values: FloatArray) -> FloatArray:
            gaps = np.where(known, np.minimum(np.abs(values), _GAP), 0.0)
            return np.asarray(np.where(odd, _GAP, gaps).sum(axis=0))

        return added(off), (known | odd).sum(axis=0), added(off - usual)


def order_question(rows: WorkingCopy, orders: Orders) -> Question | None:
    """Ask about the two strips whose exchange makes the readings smoothest, where one does."""
    if not orders.better.any():
        return None
    best = int(np.argmax(np.where(orders.better, orders.gain, -np.inf)))
    evidence = (
        f"with the two exchanged, they and the next strips lie {100.0 * orders.gain[best] / len(rows.k):.2g} % of Vref "
        "less off their neighbours' lines, added up, wherever the contact is"
    )
    return Question(
        tuple(sorted(int(rows.order[p]) for p in orders.pairs[best])), ("swapped-strips",), evidence
    )


def joined(
    question: Question, rows: WorkingCopy, findings: Sequence[Finding], asked: Sequence[Question]
) -> tuple[list[Finding], list[Question]]:
    """Return findings and questions with that of two strips' order; what it explains as well becomes its other cause.

    A strip that reads nothing, and another that reads something where no contact is, may be in each other's places. Any
    other finding of one of the two explains more than an order does.
    """
    two = set(question.strips)
    astray = touched_elsewhere(rows)[[int(np.flatnonzero(rows.order == i)[0]) for i in question.strips]].any()
    silent = [f for f in findings if astray and f.fault in _SILENT and set(f.strips) <= two]
    if any(two & set(f.strips) for f in findings if f not in silent):
        return list(findings), list(asked)
    same = [q for q in asked if two & set(q.strips)]
    if any("swapped-strips" in q.causes for q in same):
        return list(findings), list(asked)
    others = [*(f.fault for f in silent), *(cause for q in same for cause in q.causes)]
    beside = {i + side for i in two for side in (-1, 0, 1)}  # they lie off a line through one of the two
    asked = [q for q in asked if not q.strips or not set(q.strips) <= beside]
    return [f for f in findings if f not in silent], [
        *asked,
        replace(question, causes=(*question.causes, *others[:1])),
    ]


def order_unknown(rows: WorkingCopy, orders: Orders) -> set[int]:
    """Return the file's strips that would go unnoticed in another one's place, as far as orders were compared."""
    touched, slopes = np.asarray(rows.there.any(axis=0)), told_by_slope(rows)
    unknown = [
        pair
        for pair, worse in zip(orders.pairs.tolist(), orders.worse, strict=True)
        if not worse and not (pair[1] - pair[0] == 1 and pair[0] in slopes)
    ]
    return {int(rows.order[place]) for pair in unknown for place in pair if all(touched[p] for p in pair)}

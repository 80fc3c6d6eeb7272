"""Which strips may be in each other's places, by how rough the readings are across the strips in either order.

A contact's signatures are smooth across the strips but for its corners. With two strips in each other's places these
and those beside them lie off each other's lines, and contacts have gaps. An order that takes that away, wherever the
contact is, and leaves less than offsets of all these strips would, is a question; of one that takes nothing away and
adds nothing the recording tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.exchanged import told_by_slope, touched_elsewhere
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.neighbour_prediction import WorkingCopy

_GAP = 0.15  # over Vref: how rough a gap counts, and the most that anything does
_NEAR = 2  # places: strips nearer to each other are beside the same ones
_COMPARED = 120  # rows
# Footprints in which an order is better, by so much over Vref and signature, and what it leaves at the most; of all.
_FOOTPRINTS, _BETTER, _LEAVES = 3, 0.02, 0.6
_WORSE = 0.3  # footprints in which it is worse, over those in which it is better
_SILENT = ("open-strip", "dead", "intermittent")
_KNOWN = 0.7  # of the triples: an order that leaves fewer to compare is none


@dataclass(frozen=True, eq=False)
class Orders:
    """What exchanging two places would change, for every two (pairs,).

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
    """Compare the order of the strips with every one that exchanges two places."""
    some = np.linspace(0, len(rows.there) - 1, min(len(rows.there), _COMPARED)).astype(int)
    there = rows.there[some]
    values = np.stack([v[some] for v in rows.k.values()])  # (signatures, rows, places)
    n, signatures = rows.strips, len(values)
    at = _Roughness(values, there)
    _, footprint = np.unique(there, axis=0, return_inverse=True)
    where = np.eye(footprint.max() + 1)[footprint.ravel()]  # (rows, footprints)
    where /= where.sum(axis=0)
    moved = [at.with_strip(place) for place in range(n)]  # each (3, rows, places)
    own = np.stack([at.triples(place - 1, place, place + 1) for place in range(n)])  # (places, 3, rows)
    touched = there.any(axis=0)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if touched[i] or touched[j]]
    now, then = np.empty((2, len(pairs), 3, len(there)))
    for pair, (i, j) in enumerate(pairs):
        around = sorted({p for q in (i, j) for p in (q - 1, q, q + 1) if 0 <= p < n})
        now[pair] = own[around].sum(axis=0)
        if j - i > _NEAR:
            then[pair] = moved[i][:, :, j] + moved[j][:, :, i]
        else:
            order = np.arange(-1, n + 1)
            order[[i + 1, j + 1]] = j, i
            then[pair] = sum(at.triples(*order[p : p + 3].tolist()) for p in around)
    each_now, each_then = now[:, 0] @ where, then[:, 0] @ where  # (pairs, footprints)
    least = _BETTER * signatures
    known = now[:, 1].sum(axis=1), then[:, 1].sum(axis=1)

    def smoother(one: FloatArray, other: FloatArray, kept: BoolArray) -> BoolArray:
        """Whether `one` is clearly smoother than `other`, both by footprint (pairs, footprints)."""
        clearly = (other - one > least) & (one < _LEAVES * other)
        against = (one - other > least).sum(axis=1)
        enough = (clearly.sum(axis=1) >= _FOOTPRINTS) & (against <= _WORSE * clearly.sum(axis=1))
        return np.asarray(enough & kept)

    gain = (now[:, 0] - then[:, 0]).mean(axis=1)
    total_now, total_then = now[:, 0].sum(axis=1), then[:, 0].sum(axis=1)
    offsets_now, offsets_then = now[:, 2].sum(axis=1), then[:, 2].sum(axis=1)
    better = smoother(each_then, each_now, known[1] >= _KNOWN * known[0])
    better &= (total_then < _LEAVES * total_now) & (gain > least) & (total_then < offsets_now)
    worse = smoother(each_now, each_then, known[0] >= _KNOWN * known[1])
    worse &= (total_now < _LEAVES * total_then) & (-gain > least) & (total_now < offsets_then)
    return Orders(np.array(pairs).reshape(-1, 2), better, worse, gain)


class _Roughness:
    """How far each strip lies off the line of those beside it, over Vref, over all signatures.

    With it, in how many signatures that is known, and what is left with an offset of its own for each.
    """

    def __init__(self, values: FloatArray, there: BoolArray) -> None:
        self._values, self._there = values, there
        self._several = there.sum(axis=1) > 1  # alone is a strip only where others are touched, too

    def triples(self, left: int, strip: int, right: int) -> FloatArray:
        """Return that of a strip between two (3, rows)."""
        n = self._values.shape[2]
        nowhere = np.full(self._values.shape[:2], np.nan)
        values = [self._values[:, :, i] if 0 <= i < n else nowhere for i in (left, strip, right)]
        there = [
            self._there[:, i] if 0 <= i < n else np.zeros(len(self._there), bool)
            for i in (left, strip, right)
        ]
        return self._of(values, there)

    def with_strip(self, place: int) -> FloatArray:
        """Return that of a place and those beside it, with each strip there in turn (3, rows, strips)."""
        n = self._values.shape[2]
        nowhere, off = np.full((*self._values.shape[:2], 1), np.nan), np.zeros((len(self._there), 1), bool)

        def strip(at: int) -> tuple[FloatArray, BoolArray]:
            within = 0 <= at < n
            return (
                (self._values[:, :, at : at + 1], self._there[:, at : at + 1]) if within else (nowhere, off)
            )

        every, total = (self._values, self._there), np.zeros((3, len(self._there), n))
        for one in range(place - 1, place + 2):
            if 0 <= one < n:
                three = [every if at == place else strip(at) for at in (one - 1, one, one + 1)]
                total += self._of([v for v, _ in three], [t for _, t in three])
        return total

    def _of(self, values: list[FloatArray], there: list[BoolArray]) -> FloatArray:
        several = self._several if there[1].ndim == 1 else self._several[:, None]
        gap = there[0] & there[2] & ~there[1]
        odd = gap | (there[1] & ~there[0] & ~there[2] & several)
        off = values[0] - 2.0 * values[1] + values[2]  # (signatures, rows) or (signatures, rows, strips)
        known = np.isfinite(off)
        usual = np.nan_to_num(off).sum(axis=1, keepdims=True) / np.maximum(
            known.sum(axis=1, keepdims=True), 1
        )
        rough, varies = (np.where(odd, _GAP, np.minimum(np.abs(v), _GAP)) for v in (off, off - usual))
        known |= odd
        return np.stack(
            [np.nan_to_num(rough).sum(axis=0), known.sum(axis=0), np.nan_to_num(varies).sum(axis=0)]
        )


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
    """Return the file's strips that would go unnoticed in another one's place."""
    touched, slopes = np.asarray(rows.there.any(axis=0)), told_by_slope(rows)
    unknown = [
        pair
        for pair, worse in zip(orders.pairs.tolist(), orders.worse, strict=True)
        if not worse and not (pair[1] - pair[0] == 1 and pair[0] in slopes)
    ]
    return {int(rows.order[place]) for pair in unknown for place in pair if all(touched[p] for p in pair)}

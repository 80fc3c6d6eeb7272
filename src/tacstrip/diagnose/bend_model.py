"""How a signature bends across three strips: the contact's shape, the same for all, and each strip's own error.

The bend of strip i is k_i - (k_(i-1) + k_(i+1)) / 2. Under a contact it depends on how the signature runs around, in
the same way on every strip, and on constant errors of the three strips. What one strip does with time, or with the
place of a fault, is regressed on what these leave; it shows on the strip and, reversed and half as large, on both
neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, strips_on_both_sides
from tacstrip.robust import robust_sigma

_SIDES = ((-1, -0.5), (0, 1.0), (1, -0.5))  # strips of a bend, and their weights
_POWERS = 3  # of the level, in a strip's own error: offset, gain, a bow
_FEWEST, _FEWEST_SQUARES = 40, 300  # rows, for terms of the shape and for their products
_MOST_ROWS = 12_000
_ROBUST = 2.5  # deviations, from which a row loses weight (Cauchy)
_ROUNDS = 5  # of weighting
_RIDGE = 1e-2  # of a term's sum of squares: terms that the recording does not determine stay 0
_FAR = 3.0  # deviations at which terms of the shape are clipped
_WAVES, _ROWS_A_WAVE, _WAVE_LENGTH = 100, 4, 2.0  # at most, rows for each at least, and deviations


@dataclass(frozen=True, eq=False)
class BendModel:
    """The fit of one signature's bends.

    Attributes
    ----------
    rows
        Where the bends are.
    residual, weight
        What shape and constant errors leave over Vref, and its weight (rows,).
    sigma
        Its robust standard deviation.
    """

    rows: BendRows
    residual: FloatArray
    weight: FloatArray
    sigma: float
    _terms: _Terms
    _factor: FloatArray  # Cholesky's, of the normal equations, lower

    @classmethod
    def fit(cls, work: WorkingCopy, values: FloatArray, contact: bool = False) -> BendModel | None:
        """Fit readings over Vref (places, strips); None where there are too few bends, or too like ones.

        With `contact`, the shape depends on where in the contact a strip lies, too. Source: iteratively reweighted
        least squares; random Fourier features of the contact (A. Rahimi, B. Recht: Random Features for Large-Scale
        Kernel Machines, NIPS 2007).
        """
        known = work.there & np.isfinite(values)
        rows = work.once((known.tobytes(), contact), lambda: BendRows.of(work, known, contact))
        if len(rows.place) < _FEWEST:
            return None
        left, middle, right = (values[rows.place, rows.strip + side] for side, _ in _SIDES)
        mean = (left + right) / 2.0
        bend = middle - mean
        # Its own level holds the strip's error, to which the neighbours' would answer.
        powers = [(level - 0.5)[:, None] ** np.arange(_POWERS) for level in (left, mean, right)]
        terms = _Terms(rows, np.hstack([share * p for (_, share), p in zip(_SIDES, powers, strict=True)]))
        weight, residual, sigma = np.ones(len(bend)), bend, np.inf
        for _ in range(_ROUNDS):
            # Before the fit: what is regressed on its residuals later needs the very weights that they come from.
            weight = 1.0 / (1.0 + (residual / (_ROBUST * sigma)) ** 2)
            try:
                factor = cho_factor(terms.normal(weight), lower=True, overwrite_a=True, check_finite=False)
            except LinAlgError:  # bends alike to rounding, but for a reading that is far off
                return None
            right_side = np.zeros((terms.many, 1))
            terms.add_common((weight * bend)[:, None], right_side)
            residual = bend - terms.of(cho_solve(factor, right_side, check_finite=False))[:, 0]
            sigma = max(float(robust_sigma(residual)), 1e-6)
        return cls(rows, residual, weight, sigma, terms, factor[0])

    def explain(self, columns: FloatArray) -> Explanation:
        """Return what columns of each strip explain beyond shape and constant errors: `BendRows.effect`."""
        weighted = columns * self.weight[:, None]
        alone = _Terms(replace(self.rows, parts=[]), columns)
        score = np.zeros((alone.many, 1))
        alone.add_common((self.weight * self.residual)[:, None], score)
        return Explanation(alone.common(weighted), score[:, 0], self._reduced(self._terms.common(weighted)))

    def alternatives(
        self, changes: Sequence[Mapping[int, FloatArray]]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what alternatives explain alone: power, score, power without other terms, each (changes, A).

        Parameters
        ----------
        changes
            Of each: by the place across of the strips that change, their readings' change over Vref (places, A) in
            each of A alternatives; NaN: none.
        """
        many = next(iter(changes[0].values())).shape[1]
        cross = np.zeros((self._terms.many, len(changes), many))
        score, whole = np.zeros((2, len(changes), many))
        for n, change in enumerate(changes):
            strips = range(max(min(change) - 1, 1), min(max(change) + 2, self.rows.strips - 1))
            rows = self.rows.of_strips(strips)
            strip, place = self.rows.strip[rows], self.rows.place[rows]
            column = np.zeros((len(strip), many))
            for side, share in _SIDES:
                for i, one in change.items():
                    at = strip + side == i
                    column[at] += share * np.nan_to_num(one[place[at]])
            weighted = column * self.weight[rows, None]
            self._terms.add_common(weighted, cross[:, n], strips)
            score[n], whole[n] = self.residual[rows] @ weighted, np.sum(column * weighted, axis=0)
        reduced = self._reduced(cross.reshape(len(cross), -1))
        return whole - np.sum(reduced**2, axis=0).reshape(whole.shape), score, whole

    def beyond(self, found: Explanation, columns: FloatArray, by: int, shown: int) -> FloatArray:
        """Return what shape and constant errors leave of a strip's columns in the bends of another (its rows, C)."""
        many = columns.shape[1] // len(_SIDES)
        at, own = (slice(i * many, (i + 1) * many) for i in (by, by - shown + 1))
        confounded = solve_triangular(
            self._factor, found.reduced[:, at], lower=True, trans="T", check_finite=False
        )
        strips = range(shown, shown + 1)
        return np.asarray(columns[self.rows.of_strips(strips), own] - self._terms.of(confounded, strips))

    def _reduced(self, cross: FloatArray) -> FloatArray:
        """Return what columns (terms, C) have in common with terms, made independent of each other."""
        return np.asarray(solve_triangular(self._factor, cross, lower=True, check_finite=False))


@dataclass(frozen=True, eq=False)
class Explanation:
    """Normal equations of columns (C) beyond shape and constant errors.

    `whole` (C, C), `score` (C,): power of the columns alone and what they have in common with the residuals; `reduced`
    (terms, C): what they have in common with independent combinations of the terms.
    """

    whole: FloatArray
    score: FloatArray
    reduced: FloatArray

    def power(self, columns: slice) -> FloatArray:
        """Return the power that all columns have in common with some, beyond shape and constant errors (C, some)."""
        return np.asarray(self.whole[:, columns] - self.reduced.T @ self.reduced[:, columns])

    def power_of_groups(self, many: int) -> FloatArray:
        """Return the power of each group of so many columns by themselves (groups, many, many)."""
        groups = len(self.score) // many
        alone = np.einsum("iaib->iab", self.whole.reshape(groups, many, groups, many))
        reduced = self.reduced.reshape(-1, groups, many)
        return np.asarray(alone - reduced.transpose(1, 2, 0) @ reduced.transpose(1, 0, 2))


@dataclass(frozen=True, eq=False)
class BendRows:
    """Where three neighbours have readings, strip by strip, and the contact's shape there.

    Attributes
    ----------
    place, strip
        Each bend's row in the working copy and its strip's place across (rows,).
    edges
        Each strip's first row (strips + 1,).
    parts
        Terms of the shape by the strips that are touched beyond the three: rows (n,), each strip's first of these
        (strips + 1,), terms (n, terms).
    """

    place: IntArray
    strip: IntArray
    edges: IntArray
    parts: list[tuple[IntArray, IntArray, FloatArray]]

    @classmethod
    def of(cls, work: WorkingCopy, known: BoolArray, contact: bool) -> BendRows:
        """Return the rows for readings that are known (places, strips)."""
        strip, place = np.nonzero((known[:, :-2] & known[:, 1:-1] & known[:, 2:]).T)
        keep = place % max(-(-len(place) // _MOST_ROWS), 1) == 0
        place, strip = place[keep], strip[keep] + 1
        each = np.arange(work.strips + 1)
        parts = [
            (here, np.searchsorted(strip[here], each), terms)
            for here, terms in _shape_terms(work, known, place, strip, contact)
        ]
        return cls(place, strip, np.searchsorted(strip, each), parts)

    @property
    def strips(self) -> int:
        """Number of strips."""
        return len(self.edges) - 1

    def of_strips(self, strips: range) -> slice:
        """Return the rows of some strips."""
        return slice(int(self.edges[strips.start]), int(self.edges[strips.stop]))

    def effect(self, change: FloatArray) -> FloatArray:
        """Return what changes of readings (places, terms) do to bends: of the three strips each (rows, 3 * terms)."""
        each = change[self.place]
        return np.hstack([share * each for _, share in _SIDES])


@dataclass(frozen=True, eq=False)
class _Terms:
    """Terms of bends: of each strip, in its own bend and the next ones' (rows, 3 * terms), and those of the shape."""

    rows: BendRows
    own: FloatArray

    @property
    def many(self) -> int:
        """Number of terms: of all strips, then of the shape's parts."""
        each: int = self.own.shape[1] // len(_SIDES)
        return each * self.rows.strips + sum(len(terms.T) for *_, terms in self.rows.parts)

    def _each(self, strips: range | None) -> Iterator[tuple[slice, slice | IntArray, FloatArray]]:
        """Yield blocks of the terms of some strips' bends, or all: which terms, which of these strips' rows, values."""
        strips = strips or range(1, self.rows.strips - 1)
        each = self.own.shape[1] // len(_SIDES)
        first = self.rows.edges[strips.start]
        for strip in strips:
            rows = self.rows.of_strips(range(strip, strip + 1))
            at = slice(rows.start - first, rows.stop - first)
            yield slice(each * (strip - 1), each * (strip + 2)), at, self.own[rows]
        many = each * self.rows.strips
        for here, edges, terms in self.rows.parts:
            some = slice(edges[strips.start], edges[strips.stop])
            yield slice(many, many + len(terms.T)), here[some] - first, terms[some]
            many += len(terms.T)

    def add_common(self, columns: FloatArray, out: FloatArray, strips: range | None = None) -> None:
        """Add to `out` (terms, C) what terms have in common with columns of some strips' rows (rows, C)."""
        for terms, rows, values in self._each(strips):
            out[terms] += values.T @ columns[rows]

    def of(self, coefficients: FloatArray, strips: range | None = None) -> FloatArray:
        """Return the sum of terms times coefficients (terms, C) in some strips' rows (rows, C)."""
        rows = self.rows.of_strips(strips or range(self.rows.strips))
        out = np.zeros((rows.stop - rows.start, coefficients.shape[1]))
        for terms, here, values in self._each(strips):
            out[here] += values @ coefficients[terms]
        return out

    def common(self, columns: FloatArray) -> FloatArray:
        """Return what terms have in common with columns of each strip (rows, 3 * C): (terms, strips * C)."""
        many = columns.shape[1] // len(_SIDES)
        out = np.zeros((self.many, many * self.rows.strips), order="F")
        for strip in range(1, self.rows.strips - 1):
            one = range(strip, strip + 1)
            at = slice(many * (strip - 1), many * (strip + 2))
            self.add_common(columns[self.rows.of_strips(one)], out[:, at], one)
        return out

    def normal(self, weight: FloatArray) -> FloatArray:
        """Return the normal equations with these weights (rows,), below their diagonal (terms, terms)."""
        out = np.zeros((self.many, self.many), order="F")
        own = self.common(self.own * weight[:, None])
        many = len(own.T)
        out[:, :many] = own
        for here, _, terms in self.rows.parts:
            one = terms * np.sqrt(weight[here, None])
            at = slice(many, many + len(terms.T))
            out[at, at] = one.T @ one
            many = at.stop
        out.flat[:: self.many + 1] += _RIDGE
        return out


def _shape_terms(
    work: WorkingCopy, known: BoolArray, place: IntArray, strip: IntArray, contact: bool
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield terms of all signatures around bends: slope, bends of the next strips, products; their rows, and values.

    In parts, by the strips that are touched. With `contact` also levels, and waves of all of these and of the strip's
    place in the contact.
    """
    signatures = list(work.k.values())
    whole = _in_contact(work) if contact else []
    beyond = [np.pad(known, ((0, 0), (1, 1)))[place, strip + 1 + side] for side in (-2, 2)]
    for left in (False, True):
        for right in (False, True):
            here = np.flatnonzero((beyond[0] == left) & (beyond[1] == right))
            if len(here) < _FEWEST:
                continue
            terms, levels = [], []
            for one in signatures:
                at = one[place[here], strip[here] - 1], one[place[here], strip[here] + 1]
                terms.append(at[1] - at[0])
                mean = (at[0] + at[1]) / 2.0
                terms += [one[place[here], strip[here] + side] - mean for side in [-2] * left + [2] * right]
                levels.append(mean)
            scaled = _scaled(terms + levels if contact else terms)
            all_of_it = [np.ones((len(here), 1)), scaled]
            if len(here) > _FEWEST_SQUARES:
                a, b = np.triu_indices(scaled.shape[1])
                all_of_it.append(scaled[:, a] * scaled[:, b])
                if contact:
                    around = _scaled([one[place[here], strip[here]] for one in whole])
                    count = min(_WAVES, len(here) // _ROWS_A_WAVE)
                    all_of_it.append(_waves(np.hstack([scaled, around]), count))
            yield here, np.concatenate(all_of_it, axis=1)


def _scaled(terms: list[FloatArray]) -> FloatArray:
    """Return terms (rows,) of mean 0 and deviation 1, side by side (rows, terms)."""
    values = np.nan_to_num(np.stack(terms, axis=1))
    return np.asarray(np.clip((values - values.mean(axis=0)) / (values.std(axis=0) + 1e-6), -_FAR, _FAR))


def _waves(values: FloatArray, count: int) -> FloatArray:
    """Return random Fourier features (rows, count) of scaled values (rows, terms), smooth functions of all of them."""
    random = np.random.default_rng(0)
    slopes = random.normal(size=(values.shape[1], count)) / (_WAVE_LENGTH * np.sqrt(values.shape[1]))
    return np.asarray(np.sqrt(2.0) * np.cos(values @ slopes + random.uniform(0.0, 2.0 * np.pi, count)))


def _in_contact(work: WorkingCopy) -> list[FloatArray]:
    """Return how strips lie in their contacts (places, strips): strips to either rim, and from the contact's middle.

    Between these, each signature's slope and mean over the contact, which turn and move with it.
    """
    there, across = work.there, np.arange(work.strips)
    left, right = (np.where(there, v, 0.0) for v in strips_on_both_sides(there))
    out = [left, right]
    for one in work.k.values():
        weight = (there & np.isfinite(one)).astype(float)
        level = np.where(weight > 0.0, one, 0.0)
        count = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
        off = weight * (across - (weight @ across)[:, None] / count)
        spread = np.maximum((off**2).sum(axis=1, keepdims=True), 1.0)
        around = (off * level).sum(axis=1, keepdims=True) / spread, level.sum(axis=1, keepdims=True) / count
        out += [np.broadcast_to(v, there.shape) for v in around]
    if work.pair is None:
        return [*out, (left - right) / 2.0]
    wide = np.where(there, np.maximum(np.nan_to_num(work.pair[0] - work.pair[1]), 0.0), 0.0)
    middle = (wide @ across) / np.maximum(wide.sum(axis=1), 1e-6)
    return [*out, across - middle[:, None]]

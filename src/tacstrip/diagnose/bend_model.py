"""How a signature bends across three strips: the contact's shape, the same for all, and each strip's own error.

The bend of strip i is k_i - (k_(i-1) + k_(i+1)) / 2. Under a contact it depends on how the signature runs around, in
the same way on every strip, and on constant errors of the three strips. What one strip does with time, or with the
place of a fault, is regressed on what these leave; it shows on the strip and, reversed and half as large, on both
neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, strips_on_both_sides
from tacstrip.robust import robust_sigma

_SIDES = ((0, 1.0), (-1, -0.5), (1, -0.5))  # strips of a bend, and their weights
_POWERS = 3  # of the level, in a strip's own error: offset, gain, a bow
_FEWEST, _FEWEST_SQUARES = 40, 300  # rows, for terms of the shape and for their products
_MOST_ROWS = 12_000
_ROBUST = 2.5  # deviations, from which a row loses weight (Cauchy)
_ROUNDS = 5  # of weighting
_RIDGE = 1e-2  # of a term's sum of squares: terms that the recording does not determine stay 0
_FAR = 3.0  # deviations at which terms of the shape are clipped
_Part = tuple[IntArray, slice, FloatArray]  # rows and columns of terms, and the terms there
_WAVES, _ROWS_A_WAVE, _WAVE_LENGTH = 100, 4, 2.0  # at most, rows for each at least, and deviations


@dataclass(frozen=True, eq=False)
class BendModel:
    """The fit of one signature's bends.

    Attributes
    ----------
    place, strip
        Each bend's row in the working copy and its strip's place across (rows,).
    residual, weight
        What shape and constant errors leave over Vref, and its weight (rows,).
    sigma
        Its robust standard deviation.
    """

    place: IntArray
    strip: IntArray
    residual: FloatArray
    weight: FloatArray
    sigma: float
    _own: sparse.csr_matrix
    _shape: FloatArray
    _parts: list[_Part]
    _factor: tuple[FloatArray, bool]  # Cholesky's, of the normal equations

    @classmethod
    def of(cls, work: WorkingCopy, name: str) -> BendModel | None:
        """Return the fit of a signature by name, kept with the working copy until that changes."""
        if name not in work.bends:
            work.bends[name] = cls.fit(work, work.k[name])
        found = work.bends[name]
        assert found is None or isinstance(found, BendModel)
        return found

    @classmethod
    def fit(cls, work: WorkingCopy, values: FloatArray, contact: bool = False) -> BendModel | None:
        """Fit readings over Vref (places, strips); None where there are too few bends.

        With `contact`, the shape depends on where in the contact a strip lies, too. Source: iteratively reweighted
        least squares, normal equations split into sparse and dense terms; random Fourier features of the contact
        (A. Rahimi, B. Recht: Random Features for Large-Scale Kernel Machines, NIPS 2007).
        """
        known = work.there & np.isfinite(values)
        place, strip = np.nonzero(known[:, :-2] & known[:, 1:-1] & known[:, 2:])
        if len(place) > _MOST_ROWS:
            every = -(-len(place) // _MOST_ROWS)
            keep = place % every == 0
            place, strip = place[keep], strip[keep]
        strip = strip + 1
        if len(place) < _FEWEST:
            return None
        level = np.stack([values[place, strip + side] for side, _ in _SIDES])
        bend = level[0] - (level[1] + level[2]) / 2.0
        # Its own level holds the strip's error, to which the neighbours' would answer.
        level = np.stack([(level[1] + level[2]) / 2.0, level[1], level[2]]) - 0.5
        own = _spread(
            strip, values.shape[1], [np.stack([x**p for p in range(_POWERS)], axis=1) for x in level]
        )
        shape, parts = _shape_terms(work, values, known, place, strip, contact)
        weight, residual, sigma = np.ones(len(bend)), bend, np.inf
        for _ in range(_ROUNDS):
            # Before the fit: what is regressed on its residuals later needs the very weights that they come from.
            weight = 1.0 / (1.0 + (residual / (_ROBUST * sigma)) ** 2)
            weighted = _times(own, weight)
            corner = _with_shape(weighted, parts)
            terms = np.zeros((shape.shape[1], shape.shape[1]))
            for here, columns, part in parts:
                one = part * np.sqrt(weight[here, None])
                terms[columns, columns] = one.T @ one
            normal = np.block([[(weighted.T @ own).toarray(), corner], [corner.T, terms]])
            normal += _RIDGE * np.eye(len(normal))
            right = np.concatenate([weighted.T @ bend, shape.T @ (weight * bend)])
            factor = cho_factor(normal, overwrite_a=True, check_finite=False)
            found = cho_solve(factor, right, check_finite=False)
            residual = bend - own @ found[: own.shape[1]] - shape @ found[own.shape[1] :]
            sigma = max(float(robust_sigma(residual)), 1e-6)
        return cls(place, strip, residual, weight, sigma, own, shape, parts, factor)

    @cached_property
    def _rows(self) -> list[IntArray]:
        """The rows of each strip."""
        ordered = np.argsort(self.strip, kind="stable")
        strips = self._own.shape[1] // _POWERS
        return np.split(ordered, np.searchsorted(self.strip[ordered], np.arange(1, strips)))

    def effect(self, change: FloatArray, strips: int) -> sparse.csr_matrix:
        """Return what changes of each strip's readings do to bends (rows, strips * terms).

        Parameters
        ----------
        change
            Of a strip by the places' rows, several terms (places, terms).
        """
        each = change[self.place]
        return _spread(self.strip, strips, [each] * len(_SIDES))

    def explain(self, columns: sparse.csr_matrix) -> Explanation:
        """Return what columns (rows, C) explain beyond shape and constant errors."""
        weighted = _times(columns, self.weight)
        cross = np.vstack([(self._own.T @ weighted).toarray(), _with_shape(weighted, self._parts).T])
        whole = (columns.T @ weighted).toarray()
        return Explanation(
            whole, weighted.T @ self.residual, cross, cho_solve(self._factor, cross, check_finite=False)
        )

    def alternatives(self, changes: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what each of several alternatives explains alone: power (A,), score (A,), power without other terms.

        Parameters
        ----------
        changes
            By the place across of the strips that change, their readings' change over Vref (places, A); NaN: none.
        """
        bends = {i + side for i in changes for side, _ in _SIDES}
        rows = np.sort(np.concatenate([self._rows[i] for i in bends if 0 <= i < len(self._rows)]))
        place, strip = self.place[rows], self.strip[rows]
        column = np.zeros((len(rows), next(iter(changes.values())).shape[1]))
        for side, share in _SIDES:
            for i, change in changes.items():
                at = np.flatnonzero(strip + side == i)
                column[at] += share * np.nan_to_num(change[place[at]])
        weighted = column * self.weight[rows][:, None]
        cross = np.vstack([self._own[rows].T @ weighted, self._shape[rows].T @ weighted])
        whole = np.sum(column * weighted, axis=0)
        power = whole - np.sum(cross * cho_solve(self._factor, cross, check_finite=False), axis=0)
        return power, weighted.T @ self.residual[rows], whole

    def beyond(self, rows: IntArray, columns: FloatArray, confounded: FloatArray) -> FloatArray:
        """Return columns (rows, C) of some rows less what shape and constant errors explain of them."""
        many = self._own.shape[1]
        return np.asarray(
            columns - self._own[rows] @ confounded[:many] - self._shape[rows] @ confounded[many:]
        )


@dataclass(frozen=True, eq=False)
class Explanation:
    """Normal equations of columns (C) beyond shape and constant errors.

    `whole` (C, C), `score` (C,): power of the columns alone and what they have in common with the residuals; `cross`
    (terms, C): with shape and constant errors; `confounded` (terms, C): coefficients of these that do the same.
    """

    whole: FloatArray
    score: FloatArray
    cross: FloatArray
    confounded: FloatArray

    def power(self, columns: slice) -> FloatArray:
        """Return the power that all columns have in common with some, beyond shape and constant errors (C, some)."""
        return np.asarray(self.whole[:, columns] - self.confounded.T @ self.cross[:, columns])

    def power_of_groups(self, many: int) -> FloatArray:
        """Return the power of each group of so many columns by themselves (groups, many, many)."""
        groups = len(self.score) // many
        alone = np.einsum("iaib->iab", self.whole.reshape(groups, many, groups, many))
        confounded, cross = (v.reshape(-1, groups, many) for v in (self.confounded, self.cross))
        return np.asarray(alone - confounded.transpose(1, 2, 0) @ cross.transpose(1, 0, 2))


def _times(columns: sparse.csr_matrix, weight: FloatArray) -> sparse.csr_matrix:
    """Return columns (rows, C) times each row's weight (rows,)."""
    each = np.repeat(weight, np.diff(columns.indptr))
    return sparse.csr_matrix((columns.data * each, columns.indices, columns.indptr), columns.shape)


def _with_shape(columns: sparse.csr_matrix, parts: list[_Part]) -> FloatArray:
    """Return what columns (rows, C) have in common with the shape's terms (C, terms)."""
    none = np.zeros((columns.shape[1], 0))
    return np.concatenate([none, *(columns[here].T @ part for here, _, part in parts)], axis=1)


def _spread(strip: IntArray, strips: int, terms: list[FloatArray]) -> sparse.csr_matrix:
    """Return a matrix (rows, strips * terms) of terms (rows, terms) of each of the three strips of a bend."""
    rows, many = terms[0].shape
    columns = [((strip + side)[:, None] * many + np.arange(many)).ravel() for side, _ in _SIDES]
    data = [weight * term.ravel() for (_, weight), term in zip(_SIDES, terms, strict=True)]
    row = np.repeat(np.arange(rows), many)
    at = np.tile(row, len(_SIDES)), np.concatenate(columns)
    return sparse.csr_matrix((np.concatenate(data), at), (rows, strips * many))


def _shape_terms(
    work: WorkingCopy, values: FloatArray, known: BoolArray, place: IntArray, strip: IntArray, contact: bool
) -> tuple[FloatArray, list[_Part]]:
    """Return terms of all signatures around each bend (rows, terms): slope, bends of the next strips, products.

    With `contact` also levels, and waves of all of these and of the strip's place in the contact. Also each part of
    them, by the strips that are touched: all else is 0.
    """
    signatures = list(work.k.values())
    whole = _in_contact(work) if contact else []
    beyond = [np.pad(known, ((0, 0), (1, 1)))[place, strip + 1 + side] for side in (-2, 2)]
    parts = []
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
            parts.append((here, np.concatenate(all_of_it, axis=1)))
    out = np.zeros((len(place), sum(part.shape[1] for _, part in parts)))
    where, first = [], 0
    for here, part in parts:
        columns = slice(first, first + part.shape[1])
        out[here, columns] = part
        where.append((here, columns, part))
        first = columns.stop
    return out, where


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

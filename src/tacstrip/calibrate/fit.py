"""Fit a model's parameters to runs: robust least squares, with the uncertainty of each parameter.

A strip's own parameters affect its own readings only, so each step eliminates them strip by strip (one QR each) and
solves for the shared parameters from what remains. Parts in which strips are alike have a prior whose spread the fit
finds (empirical Bayes), and so have errors of the places.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.special import stdtrit

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.calibrate.model import (
    PARTS,
    Constants,
    Model,
    initial_constants,
    pooled_precision,
    predict,
    within_bounds,
)
from tacstrip.calibrate.place_errors import PlaceErrors, place_numbers
from tacstrip.fisher import covariance
from tacstrip.io.runs import Runs
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_STEP = 1e-6  # of the difference quotients: parameters are of order 1, readings smooth
_MOST_ITERATIONS = 40
_HUBER_ITERATIONS = 3  # with Huber's weights, before Tukey's
_CONVERGED = 1e-6  # change of the readings over Vref
_SETTLED = 0.05  # relative change of the spreads and of the noise
_LEAST_SIGMA = 1e-5  # of Vref
_LEAST_SPREAD = 1e-3  # of the largest
_HUBER = 1.345  # standard deviations at which a row begins to lose weight; 95 % efficient for normal noise
_TUKEY = 4.685  # standard deviations at which a row no longer counts
_EFFICIENCY = 0.95  # of Tukey's function for normal noise
_LEAST_REDUNDANCY = 0.02
_MORE, _LEAST_SHARE = 1.01, 0.01  # times the noise, for a difference quotient; of a variance
_FADES = (0.05, 0.15, 0.35)  # where fits with a fading offset start
_TWO_SIGMA = 0.97725  # of a distribution: below two standard deviations of a normal one


@dataclass(frozen=True, eq=False)
class ModelFit:
    """Fitted parameters and how well the runs determine them.

    Attributes
    ----------
    constants
        Their values.
    shared_sigma, own_sigma
        Standard deviations (shared,) and (strips, own); inf where the runs do not determine them. Twice of it is what
        holds 95.4 %, few readings allowed for.
    sigma
        Standard deviation of a reading about the fit, by signature, over Vref.
    weight
        Weight of each row (contacts, strips), 0 to 1; 0 for outliers.
    evidence
        Log probability of the readings, all values of the parameters weighed, but for a constant of the runs: the
        larger, the better the model.
    residual
        Measured less predicted readings over Vref (signatures, contacts, strips).
    covariance
        Each strip's own parameters', then the shared ones' (strips, own and shared, own and shared).
    places
        Errors of the places; None where they are exact.
    pooled
        Spread of the parts in which strips are alike, by part.
    excess
        By how much variances exceed those of independent readings: repeats share what the model leaves.
    errors
        Errors of places that strips share, over their standard deviations (errors,).
    """

    constants: Constants
    shared_sigma: FloatArray
    own_sigma: FloatArray
    sigma: dict[str, float]
    weight: FloatArray
    evidence: float
    residual: FloatArray
    covariance: FloatArray
    places: PlaceErrors | None = None
    pooled: dict[str, float] = field(default_factory=dict)
    excess: float = 1.0
    errors: FloatArray = field(default_factory=lambda: np.zeros(0))


def fit_model(
    model: Model, sensor: Sensor, runs: Runs, old: Constants | None = None, places: PlaceErrors | None = None
) -> ModelFit:
    """Return the best parameters of a model, starting from `old` where they are given."""
    first = initial_constants(model, sensor, runs.signatures, old)
    if model.has("fade") and (old is None or not old.model.has("fade")):
        is_fade = np.array(model.shared) == "fade"
        starts = [replace(first, shared=np.where(is_fade, fade, first.shared)) for fade in _FADES]
        fits = (_gauss_newton(sensor, runs, c, _HUBER_ITERATIONS, places) for c in starts)
        return max(fits, key=lambda f: f.evidence)
    return _gauss_newton(sensor, runs, first, 0 if old else _HUBER_ITERATIONS, places)


def average(fits: Sequence[ModelFit]) -> ModelFit:
    """Return fits of one model, which differ in what they take the errors of places for, weighted by their evidence.

    Constants are means; variances count how far the fits differ (Hoeting et al. 1999, Bayesian model averaging). The
    noise, the rows that count and the residuals are those of the likeliest fit.
    """
    fits = [f for f in fits if np.isfinite(f.covariance).all()] or list(fits[:1])
    best = max(fits, key=lambda f: f.evidence)
    share = np.exp([f.evidence - best.evidence for f in fits])
    share = share / share.sum()

    def mean(values: Iterable[FloatArray]) -> FloatArray:
        return np.asarray(sum(p * v for p, v in zip(share, values, strict=True)))

    together = [_together(f.constants) for f in fits]  # (strips, own and shared)
    centre = mean(together)
    off = [t - centre for t in together]
    covariance = mean(f.covariance + d[:, :, None] * d[:, None, :] for f, d in zip(fits, off, strict=True))
    own = best.constants.own.shape[1]
    shared = mean(
        f.shared_sigma**2 + (d[0, own:] ** 2 if len(d) else 0.0) for f, d in zip(fits, off, strict=True)
    )
    return replace(
        best,
        constants=replace(best.constants, own=centre[:, :own], shared=mean(f.constants.shared for f in fits)),
        shared_sigma=np.sqrt(shared),
        own_sigma=np.sqrt(_diagonal(covariance)[:, :own]),
        covariance=covariance,
    )


def _together(constants: Constants) -> FloatArray:
    """Return each strip's own parameters, then the shared ones (strips, own and shared)."""
    shared = np.broadcast_to(constants.shared, (len(constants.own), len(constants.shared)))
    return np.concatenate([constants.own, shared], axis=1)


def usable_rows(runs: Runs) -> BoolArray:
    """Return which contacts there are (contacts, strips) that read neither 0 nor Vref, where the converter clips."""
    clipped = np.any([(v <= 0.0) | (v >= 1.0) for v in runs.raw.values()], axis=0)
    return np.asarray(np.isfinite(runs.l_mm) & ~clipped)


def _gauss_newton(
    sensor: Sensor, runs: Runs, constants: Constants, huber: int, places: PlaceErrors | None
) -> ModelFit:
    """Improve the constants until readings settle; the first `huber` iterations reject no row."""
    if huber:
        constants = within_bounds(offsets_at_median(sensor, runs, constants))
    usable = usable_rows(runs)
    pooled = {
        part: 0.3 * PARTS[part].prior for part in PARTS if PARTS[part].pooled and constants.model.has(part)
    }
    weight = usable.astype(float)
    residual = _residuals(sensor, runs, constants)  # (signatures, contacts, strips)
    shift = np.zeros_like(residual)  # of readings by what the places are off
    sigma = _robust_sigma(residual, weight)
    redundancy = np.ones_like(residual)
    for iteration in range(_MOST_ITERATIONS):
        here = Linear(sensor, runs, constants, sigma, pooled, places)
        scaled = np.abs(here.whiten(residual - shift) / redundancy).max(axis=0)
        weight = np.where(usable, _robust_weight(scaled, iteration < huber), 0.0)
        system = here.eliminate(weight)
        shared, own, errors = system.solve(here.whiten(residual))
        moved_by = here.columns @ errors
        constants, residual, moved = _line_search(
            sensor, runs, constants, residual, moved_by, (shared, own), here, weight
        )
        shift, redundancy = moved_by, system.redundancy(here)
        old_sigma, old_pooled = sigma, pooled
        sigma = _sigma(here, residual - shift, redundancy, weight, sigma, iteration < huber)
        pooled = {part: system.spread(part, constants, old) for part, old in pooled.items()}
        settled = _settled(sigma, old_sigma) and _settled(
            np.array(list(pooled.values())), np.array(list(old_pooled.values()))
        )
        if moved < _CONVERGED and settled and iteration >= huber:
            break
    here = Linear(sensor, runs, constants, sigma, pooled, places)
    system = here.eliminate(weight)
    beyond = _beyond_independent(here.whiten(residual - shift), system, weight > 0.0, place_numbers(runs))
    shared_sigma, own_sigma, together = _deviations(sensor, runs, here, sigma, weight, places, beyond)
    by_name = dict(zip(runs.signatures, sigma.tolist(), strict=True))
    evidence = _evidence(here, system, residual - shift, usable, errors)
    return ModelFit(
        constants,
        shared_sigma,
        own_sigma,
        by_name,
        weight,
        evidence,
        residual - shift,
        together,
        places,
        pooled,
        beyond[0],
        errors,
    )


def _deviations(
    sensor: Sensor,
    runs: Runs,
    here: Linear,
    sigma: FloatArray,
    weight: FloatArray,
    places: PlaceErrors | None,
    beyond: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the deviations of shared and of own parameters, and the covariance of own and shared, strip by strip.

    The readings' noise is estimated, of `beyond` times the variance, with so many degrees of freedom; stated deviations
    of places are known. So only the share of a variance that follows the noise is enlarged, and the fewer degrees of
    freedom there are for the larger share, the wider the range (Student's distribution, Satterthwaite's degrees).
    """
    counts = (weight > 0.0).astype(float)  # what weights between cost is Tukey's efficiency
    excess, free = beyond
    variance, together = here.eliminate(counts).variances()
    share, share_together = np.ones_like(variance), np.ones(together.shape[:2])
    if places is not None and places.stated:
        pooled = {part: _MORE * spread for part, spread in here.pooled.items()}
        noisier = Linear(sensor, runs, here.constants, _MORE * sigma, pooled, places)
        more, more_together = noisier.eliminate(counts).variances()
        share = _share(variance, more)
        share_together = _share(_diagonal(together), _diagonal(more_together))

    def factor(share: FloatArray) -> FloatArray:
        student = stdtrit(free / np.maximum(share, _LEAST_SHARE) ** 2, _TWO_SIGMA) / 2.0
        return np.asarray(student * np.sqrt((1.0 + share * (excess - 1.0)) / _EFFICIENCY))

    root = factor(share_together)
    together = together * root[:, :, None] * root[:, None, :]
    own_sigma = np.sqrt(_diagonal(together)[:, : here.constants.own.shape[1]])
    return factor(share) * np.sqrt(variance), own_sigma, together


def _share(variance: FloatArray, more: FloatArray) -> FloatArray:
    """Return which share of a variance follows the noise's, from that with `_MORE` times the noise."""
    with np.errstate(all="ignore"):  # not determined: inf
        share = (more / variance - 1.0) / (_MORE**2 - 1.0)
    return np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0)


def _diagonal(matrices: FloatArray) -> FloatArray:
    return np.diagonal(matrices, axis1=1, axis2=2)


def _beyond_independent(
    white: FloatArray, system: _Eliminated, counts: BoolArray, places: IntArray
) -> tuple[float, float]:
    """Return by how much variances exceed those of independent readings, and how many degrees of freedom say so.

    Repeats of a place on a strip share what the model leaves there and what the converter rounds: what counts is how
    far their means are off.
    """
    square, free, most = 0.0, 0.0, 1.0
    of_fit = system.leverages(white.shape)  # (strips, signatures, contacts, parameters)
    for strip, rows in enumerate(of_fit):
        group = (np.unique(places[:, strip])[:, None] == places[:, strip]) & counts[:, strip]
        group = group[group.any(axis=1)]
        mean = group / np.sqrt(group.sum(axis=1, keepdims=True))  # (places, contacts)
        most = max(most, float(group.sum(axis=1).max(initial=1)))
        square += float(((white[:, :, strip] @ mean.T) ** 2).sum())
        free += len(white) * len(mean) - float(((mean @ rows) ** 2).sum())
    free = max(free, 1.0)
    return max(square / free, 1.0 / most), free


def _settled(new: FloatArray, old: FloatArray) -> bool:
    return bool((np.abs(new - old) <= _SETTLED * old).all())


def _residuals(sensor: Sensor, runs: Runs, constants: Constants) -> FloatArray:
    """Return measured less predicted readings (signatures, contacts, strips), 0 where there is no contact."""
    predicted = predict(constants, sensor, runs.l_mm, runs.w_mm)
    residual = np.stack([runs.raw[s] - predicted[s] for s in runs.signatures])
    return np.where(np.isfinite(runs.l_mm), residual, 0.0)


def offsets_at_median(sensor: Sensor, runs: Runs, constants: Constants) -> Constants:
    """Start offsets, or curves, at the median residual, which no single row can pull away."""
    predicted = predict(constants, sensor, runs.l_mm, runs.w_mm)
    own = constants.own.copy()
    for i, name in enumerate(constants.model.own(runs.signatures)):
        part, *rest = name.split()
        if part in ("offset", "curve"):
            off = runs.raw[rest[0]] - predicted[rest[0]]
            known = np.isfinite(off).any(axis=0)
            own[known, i] += np.nanmedian(off[:, known], axis=0)
    return replace(constants, own=own)


def _robust_sigma(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the robust standard deviation of each signature's residuals (signatures,)."""
    return np.array([max(_LEAST_SIGMA, float(robust_sigma(r[weight > 0.0]))) for r in residual])


def _robust_weight(scaled: FloatArray, huber: bool) -> FloatArray:
    """Return the weight of rows that are off by so many standard deviations: Huber's or Tukey's."""
    if huber:
        return np.minimum(1.0, _HUBER / np.maximum(scaled, 1e-12))
    return np.asarray(np.maximum(0.0, 1.0 - (scaled / _TUKEY) ** 2) ** 2)


def _sigma(
    here: Linear,
    residual: FloatArray,
    redundancy: FloatArray,
    weight: FloatArray,
    old: FloatArray,
    first: bool,
) -> FloatArray:
    """Return each signature's noise: by the median first, then by the mean square of the rows that count.

    Uniform noise, a converter's, has 1.28 times its standard deviation by the median.
    """
    white = here.whiten(residual)
    if first or not (weight > 0.0).any():
        scale = [float(robust_sigma((e / r)[weight > 0.0])) for e, r in zip(white, redundancy, strict=True)]
        return np.maximum(_LEAST_SIGMA, old * scale)
    counts = weight > 0.0
    square = [
        float((e[counts] ** 2).sum() / max((r[counts] ** 2).sum(), 1e-9))
        for e, r in zip(white, redundancy, strict=True)
    ]
    return np.maximum(_LEAST_SIGMA, old * np.sqrt(square))


def jacobian(sensor: Sensor, constants: Constants, l_mm: FloatArray, w_mm: FloatArray) -> FloatArray:
    """Return the derivatives of raw readings by the parameters (signatures, contacts, strips, shared and own).

    Forward differences: an own parameter is moved on all strips at once; lambda upwards, because a length below 0 is
    meaningless.
    """

    def predicted(c: Constants) -> FloatArray:
        return np.nan_to_num(np.stack(list(predict(c, sensor, l_mm, w_mm).values())))

    shared, own = constants.shared, constants.own
    moves = [replace(constants, shared=shared + step) for step in _STEP * np.eye(len(shared))]
    moves += [replace(constants, own=own + step) for step in _STEP * np.eye(own.shape[1])]
    here = predicted(constants)
    return np.stack([(predicted(c) - here) / _STEP for c in moves], axis=-1)


def jacobian_of_places(sensor: Sensor, constants: Constants, l: FloatArray, w: FloatArray) -> FloatArray:
    """Return the derivatives of raw readings by l and w [1/mm] (signatures, contacts, strips, 2)."""
    step = _STEP * sensor.length_mm
    here, up, longer = (
        np.stack(list(predict(constants, sensor, *place).values()))
        for place in ((l, w), (l + step, w), (l, w + step))
    )
    return np.nan_to_num(np.stack([up - here, longer - here], axis=-1) / step)


class Linear:
    """The model linearised at its constants, rows over their noise.

    Attributes
    ----------
    columns
        Derivatives of readings by errors of places that strips share (signatures, contacts, strips, errors).
    white
        Whitens the signatures of a contact (contacts, strips, signatures, signatures).
    """

    def __init__(
        self,
        sensor: Sensor,
        runs: Runs,
        constants: Constants,
        sigma: FloatArray,
        pooled: dict[str, float],
        places: PlaceErrors | None,
    ) -> None:
        self.constants, self.pooled = constants, pooled
        shape = runs.l_mm.shape
        noise = np.broadcast_to(np.diag(sigma**2), (*shape, len(sigma), len(sigma)))
        self.columns = np.zeros((len(sigma), *shape, 0))
        self.by_place = by_place = jacobian_of_places(sensor, constants, runs.l_mm, runs.w_mm)
        if places is not None:
            self.columns = places.columns(by_place)
            own = np.moveaxis(places.own(by_place), 0, 2)  # (contacts, strips, signatures, 2)
            noise = noise + own @ np.swapaxes(own, 2, 3)
        self.white = np.linalg.inv(np.linalg.cholesky(noise))
        self.by = jacobian(sensor, constants, runs.l_mm, runs.w_mm)

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Return rows (signatures, contacts, strips, ...) with noise of 1."""
        return np.asarray(np.einsum("cnst,tcn...->scn...", self.white, rows))

    def eliminate(self, weight: FloatArray) -> _Eliminated:
        """Return the rows with each strip's own parameters eliminated; weight (contacts, strips)."""
        return _Eliminated(self, weight)

    def prior_rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the rows of pooled parts by own (rows, own) and shared parameters, and their values (strips, rows)."""
        c = self.constants
        names, shared = c.model.own(c.signatures), c.model.shared
        own_rows, shared_rows = [np.zeros((0, len(names)))], [np.zeros((0, len(shared)))]
        for part, spread in self.pooled.items():
            root = pooled_precision(c.model, part) / spread
            at = [i for i, name in enumerate(names) if name.split()[0] == part]
            rows = np.zeros((len(root), len(names)))
            rows[:, at] = root
            about = np.zeros((len(root), len(shared)))
            if part == "ratios":
                about[:, shared.index("ratio")] = -root[0]
            own_rows.append(rows)
            shared_rows.append(about)
        o, s = np.concatenate(own_rows), np.concatenate(shared_rows)
        return o, s, c.own @ o.T + s @ c.shared


class _Eliminated:
    """Weighted rows, strip by strip, after one QR of the own parameters' columns."""

    def __init__(self, here: Linear, weight: FloatArray) -> None:
        self.here = here
        shared, errors = len(here.constants.shared), here.columns.shape[-1]
        self.shared, self.errors = shared, errors
        root = np.sqrt(weight)[..., None]
        own_prior, shared_prior, self.prior = here.prior_rows()
        strips = len(here.constants.own)

        def rows(columns: FloatArray, prior: FloatArray) -> FloatArray:
            white = np.moveaxis(here.whiten(columns) * root, 2, 0)  # (strips, signatures, contacts, columns)
            white = white.reshape(strips, white.shape[1] * white.shape[2], white.shape[3])
            return np.concatenate([white, np.broadcast_to(prior, (strips, *prior.shape))], axis=1)

        own = rows(here.by[..., shared:], own_prior)
        common = rows(
            np.concatenate([here.by[..., :shared], here.columns], axis=-1),
            np.concatenate([shared_prior, np.zeros((len(shared_prior), errors))], axis=1),
        )
        # Strips without rows keep their constants: their own are known, and cost no evidence.
        still = np.eye(own.shape[2]) * ~np.asarray((weight > 0.0).any(axis=0))[:, None, None]
        still = still if still.any() else still[:, :0]
        own = np.concatenate([own, still], axis=1)
        lack = max(0, own.shape[2] - own.shape[1])
        self.root, self.lack = root[..., 0], lack + still.shape[1]
        own, common = _with_zeros(own, lack), _with_zeros(common, self.lack)
        self.q, self.r = np.linalg.qr(own)
        self.t = np.swapaxes(self.q, 1, 2) @ common  # (strips, own, common)
        self.z = common - self.q @ self.t
        # Errors of places have a prior of 1 each: Cholesky's factor of their information is safe, and small matrices
        # are quick, where a QR of all rows by hundreds of errors is slow, and slower on BLAS' threads.
        of_shared, of_errors = np.split(np.concatenate(self.z), [shared], axis=1)
        self.root_of_errors = np.linalg.cholesky(of_errors.T @ of_errors + np.eye(errors))
        self.by_shared = self._errors_from(of_errors.T @ of_shared)
        self.rest = np.concatenate([of_shared - of_errors @ self.by_shared, -self.by_shared])
        self.of_errors = of_errors

    def _errors_from(self, score: FloatArray) -> FloatArray:
        """Return the errors of places (errors, ...) from their score: the inverse of their information times it."""
        return np.asarray(cho_solve((self.root_of_errors, True), score)) if self.errors else score

    def solve(self, white: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the steps of shared and own parameters, and the errors of places, from whitened residuals."""
        b = np.moveaxis(white * self.root, 2, 0).reshape(len(self.q), -1)
        b = _with_zeros(np.concatenate([b, -self.prior], axis=1), self.lack)[..., None]
        along = np.swapaxes(self.q, 1, 2) @ b
        right = (b - self.q @ along).ravel()
        shared = np.linalg.lstsq(self.rest, _with_zeros(right[None], self.errors)[0], rcond=1e-10)[0]
        errors = self._errors_from(self.of_errors.T @ right) - self.by_shared @ shared
        common = np.concatenate([shared, errors])
        own = np.linalg.pinv(self.r, rcond=1e-10) @ (along - self.t @ common[:, None])
        return shared, own[..., 0], errors

    def redundancy(self, here: Linear) -> FloatArray:
        """Return what share of a reading's error its residual shows (signatures, contacts, strips): sqrt(1 - leverage).

        Where few rows determine many parameters, the fit follows each row, and a bare residual would hide its error.
        """
        leverage = np.moveaxis((self.leverages(here.by.shape[:3]) ** 2).sum(axis=-1), 0, 2)
        return np.asarray(np.sqrt(np.maximum(1.0 - leverage, _LEAST_REDUNDANCY)))

    def leverages(self, shape: tuple[int, ...]) -> FloatArray:
        """Return orthonormal columns that span the fit (strips, signatures, contacts, parameters).

        From the shape (signatures, contacts, strips): a row's squares add to its leverage.
        """
        columns = [self.q]
        if self.errors:
            of_errors = solve_triangular(self.root_of_errors, self.of_errors.T, lower=True).T
            columns.append(of_errors.reshape(*self.z.shape[:2], -1))
        if self.shared:
            known = np.linalg.pinv(np.linalg.qr(self.rest, mode="r"), rcond=1e-10)
            columns.append((self.rest[: len(self.of_errors)] @ known).reshape(*self.z.shape[:2], -1))
        fit = np.concatenate(columns, axis=2)
        signatures, contacts, strips = shape
        return fit[:, : signatures * contacts].reshape(strips, signatures, contacts, fit.shape[2])

    def spread(self, part: str, constants: Constants, old: float) -> float:
        """Return the spread of a pooled part over the strips: squares over how many of them the readings determine."""
        names = constants.model.own(constants.signatures)
        at = [i for i, name in enumerate(names) if name.split()[0] == part]
        root = pooled_precision(constants.model, part)
        centre = constants.value("ratio") if part == "ratios" else 0.0
        values = (constants.own[:, at] - centre) @ root.T
        inverse = np.linalg.pinv(self.r, rcond=1e-10)[:, at]
        unknown = float(((root @ inverse) ** 2).sum()) / old**2
        determined = max(values.size - unknown, 0.05)
        most = PARTS[part].prior
        return float(np.clip(np.sqrt((values**2).sum() / determined), _LEAST_SPREAD * most, most))

    def log_determinant(self) -> float:
        """Return that of the parameters' information."""
        factors = [
            np.diagonal(self.r, axis1=1, axis2=2).ravel(),
            np.diagonal(self.root_of_errors),
            np.diagonal(np.linalg.qr(self.rest, mode="r")),
        ]
        return float(2.0 * np.log(np.maximum(np.abs(np.concatenate(factors)), 1e-12)).sum())

    def variances(self) -> tuple[FloatArray, FloatArray]:
        """Return the shared parameters' variances, and the covariance of each strip's own and the shared ones.

        Both by the Cramer-Rao bound; the latter (strips, own and shared, own and shared).
        """
        own = self.r.shape[1]
        together = np.linalg.qr(np.pad(self.rest, ((0, self.shared), (0, 0))), mode="r")
        shared = np.diag(covariance(self.rest)) if self.shared else np.zeros(0)
        found = np.zeros((len(self.r), own + self.shared, own + self.shared))
        below = np.concatenate([np.zeros((len(together), own)), together], axis=1)
        for strip, (r, t) in enumerate(zip(self.r, self.t, strict=True)):
            of_shared, of_errors = t[:, : self.shared], t[:, self.shared :]
            # What places are off by is noise of the strip's rows.
            noise = np.linalg.cholesky(np.eye(own) + of_errors @ self._errors_from(of_errors.T))
            above = np.concatenate([r, of_shared - of_errors @ self.by_shared], axis=1)
            rows = np.concatenate([np.linalg.solve(noise, above), below])
            found[strip] = covariance(rows)
        return shared, found


def _with_zeros(rows: FloatArray, count: int) -> FloatArray:
    """Return rows (strips, rows, ...) and so many more of zeros; `np.pad` does the same in ten times the time."""
    return np.concatenate([rows, np.zeros((len(rows), count, *rows.shape[2:]))], axis=1) if count else rows


def _cost(here: Linear, residual: FloatArray, constants: Constants, weight: FloatArray) -> float:
    squares = (weight * (here.whiten(residual) ** 2).sum(axis=0)).sum()
    own, shared, _ = here.prior_rows()
    return float(squares + ((constants.own @ own.T + shared @ constants.shared) ** 2).sum())


def _evidence(
    here: Linear, system: _Eliminated, residual: FloatArray, usable: BoolArray, errors: FloatArray
) -> float:
    """Return the log probability of the readings by Laplace's method; rows that do not count as at Tukey's limit."""
    c = here.constants
    square = np.minimum((here.whiten(residual) ** 2).sum(axis=0), _TUKEY**2)[usable].sum()
    square += (system.prior**2).sum() + (errors**2).sum()
    noise = np.log(np.diagonal(here.white, axis1=2, axis2=3)[usable]).sum()
    known = -sum(np.log(PARTS[name].prior) for name in c.model.shared)
    for name in c.model.own(c.signatures):
        part = name.split()[0]
        known -= 0.0 if part in here.pooled else usable.any(axis=0).sum() * np.log(PARTS[part].prior)
    for part, spread in here.pooled.items():
        known += len(c.own) * np.log(np.abs(np.linalg.det(pooled_precision(c.model, part) / spread)))
    return float(noise + known - 0.5 * (square + system.log_determinant()))


def _line_search(
    sensor: Sensor,
    runs: Runs,
    constants: Constants,
    residual: FloatArray,
    shift: FloatArray,
    step: tuple[FloatArray, FloatArray],
    here: Linear,
    weight: FloatArray,
) -> tuple[Constants, FloatArray, float]:
    """Take the step, or the part of it that does not raise the cost.

    Returns the constants, their residuals, and how far readings moved; the given ones where no part will do.
    """
    before = _cost(here, residual - shift, constants, weight)
    for part in (1.0, 0.5, 0.25, 0.1, 0.01):
        shared, own = constants.shared + part * step[0], constants.own + part * step[1]
        new = within_bounds(replace(constants, shared=shared, own=own))
        after = _residuals(sensor, runs, new)
        if np.isfinite(after).all() and _cost(here, after - shift, new, weight) <= before + 1e-12 * (
            1.0 + before
        ):
            return new, after, float(np.abs(after - residual).max(initial=0.0))
    return constants, residual, 0.0

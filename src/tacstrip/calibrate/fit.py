"""Fit a model's parameters to runs: robust least squares, with the uncertainty of each parameter.

Each step solves the linearised model (`linearised.py`). Parts in which strips are alike have a prior whose spread the
fit finds (empirical Bayes), and so have errors of the places.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import stdtrit

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.calibrate.linearised import Eliminated, Linear
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
from tacstrip.io.runs import Runs
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_MOST_ITERATIONS = 40
_HUBER_ITERATIONS = 3  # with Huber's weights, before Tukey's
_CONVERGED = 1e-6  # change of the readings over Vref
_SETTLED = 0.05  # relative change of the spreads and of the noise
_LEAST_SIGMA = 1e-5  # of Vref
_HUBER = 1.345  # standard deviations at which a row begins to lose weight; 95 % efficient for normal noise
_TUKEY = 4.685  # standard deviations at which a row no longer counts
_EFFICIENCY = 0.95  # of Tukey's function for normal noise
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
    # What a smaller model took for outliers may be what the larger one describes.
    same = old is not None and old.model == model
    return _gauss_newton(sensor, runs, first, 0 if same else _HUBER_ITERATIONS, places)


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
    white: FloatArray, system: Eliminated, counts: BoolArray, places: IntArray
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


def _cost(here: Linear, residual: FloatArray, constants: Constants, weight: FloatArray) -> float:
    squares = (weight * (here.whiten(residual) ** 2).sum(axis=0)).sum()
    own, shared, _ = here.prior_rows()
    return float(squares + ((constants.own @ own.T + shared @ constants.shared) ** 2).sum())


def _evidence(
    here: Linear, system: Eliminated, residual: FloatArray, usable: BoolArray, errors: FloatArray
) -> float:
    """Return the log probability of the readings by Laplace's method; rows that do not count as at Tukey's limit."""
    c = here.constants
    square = np.minimum((here.whiten(residual) ** 2).sum(axis=0), _TUKEY**2)[usable].sum()
    square += (system.prior**2).sum() + (errors**2).sum()
    noise = np.log(np.diagonal(here.white, axis1=2, axis2=3)[usable]).sum()
    known = -sum(np.log(PARTS[name].prior) for name in c.model.shared)
    for name in c.names:
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

"""Fit a model's parameters to runs: robust least squares, with the uncertainty of each parameter.

A strip's own parameters affect its own readings only, so each step eliminates them strip by strip (one QR each) and
solves for the shared parameters from what remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.model import Constants, Model, initial_constants, predict, within_bounds
from tacstrip.fisher import covariance
from tacstrip.io.runs import Runs
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_STEP = 1e-6  # of the difference quotients: parameters are of order 1, readings smooth
_MOST_ITERATIONS = 25
_HUBER_ITERATIONS = 3  # with Huber's weights, before Tukey's
_CONVERGED = 1e-7  # change of the readings over Vref
_LEAST_SIGMA = 1e-5  # of Vref
_HUBER = 1.345  # standard deviations at which a row begins to lose weight; 95 % efficient for normal noise
_TUKEY = 4.685  # standard deviations at which a row no longer counts; 95 % efficient for normal noise
_LEAST_REDUNDANCY = 0.02
_FADES = (0.05, 0.15, 0.35)  # where fits with a fading offset start


@dataclass(frozen=True, eq=False)
class ModelFit:
    """Fitted parameters and how well the runs determine them.

    Attributes
    ----------
    constants
        Their values.
    shared_sigma, own_sigma
        Standard deviations (shared,) and (strips, own); inf where the runs do not determine them.
    sigma
        Standard deviation of a reading about the fit, by signature, over Vref.
    weight
        Weight of each row (contacts, strips), 0 to 1; 0 for outliers.
    cost
        What the fit minimises.
    residual
        Measured less predicted readings over Vref (signatures, contacts, strips).
    """

    constants: Constants
    shared_sigma: FloatArray
    own_sigma: FloatArray
    sigma: dict[str, float]
    weight: FloatArray
    cost: float
    residual: FloatArray


def fit_model(model: Model, sensor: Sensor, runs: Runs, old: Constants | None = None) -> ModelFit:
    """Return the best parameters of a model, starting from `old` where they are given."""
    first = initial_constants(model, sensor, runs.signatures, old)
    if model.has("fade") and (old is None or not old.model.has("fade")):
        is_fade = np.array(model.shared) == "fade"
        starts = [replace(first, shared=np.where(is_fade, fade, first.shared)) for fade in _FADES]
        return min((_gauss_newton(sensor, runs, c, _HUBER_ITERATIONS) for c in starts), key=lambda f: f.cost)
    warm = old is not None and old.model == model
    return _gauss_newton(sensor, runs, first, 0 if warm else _HUBER_ITERATIONS)


def usable_rows(runs: Runs) -> BoolArray:
    """Return which contacts there are (contacts, strips) that read neither 0 nor Vref, where the converter clips."""
    clipped = np.any([(v <= 0.0) | (v >= 1.0) for v in runs.raw.values()], axis=0)
    return np.asarray(np.isfinite(runs.l_mm) & ~clipped)


def _gauss_newton(sensor: Sensor, runs: Runs, constants: Constants, huber: int) -> ModelFit:
    """Improve the constants until readings settle; the first `huber` iterations reject no row."""
    if huber:
        constants = within_bounds(_offsets_at_median(sensor, runs, constants))
    usable = usable_rows(runs)
    shared = len(constants.shared)
    weight = usable.astype(float)
    residual = _residuals(sensor, runs, constants)  # (signatures, contacts, strips)
    redundancy = np.ones_like(residual)
    for iteration in range(_MOST_ITERATIONS):
        sigma = _sigma(residual / redundancy, weight)[:, None, None]
        scaled = np.abs(residual / redundancy / sigma).max(axis=0)
        weight = np.where(usable, _robust_weight(scaled, iteration < huber), 0.0)
        by = jacobian(sensor, constants, runs.l_mm, runs.w_mm) / sigma[..., None]
        redundancy = _redundancy(by[..., shared:], weight)
        step = _step(by, residual / sigma, weight, shared)
        constants, residual, moved = _line_search(sensor, runs, constants, residual, step, sigma, weight)
        if moved < _CONVERGED and iteration >= huber:
            break
    sigma = _sigma(residual / redundancy, weight)[:, None, None]
    by = jacobian(sensor, constants, runs.l_mm, runs.w_mm) / sigma[..., None]
    shared_sigma, own_sigma = _uncertainty(by, weight, shared)
    by_name = dict(zip(runs.signatures, sigma.ravel().tolist(), strict=True))
    cost = _cost(residual, sigma, weight)
    return ModelFit(constants, shared_sigma, own_sigma, by_name, weight, cost, residual)


def _residuals(sensor: Sensor, runs: Runs, constants: Constants) -> FloatArray:
    """Return measured less predicted readings (signatures, contacts, strips), 0 where there is no contact."""
    predicted = predict(constants, sensor, runs.l_mm, runs.w_mm)
    residual = np.stack([runs.raw[s] - predicted[s] for s in runs.signatures])
    return np.where(np.isfinite(runs.l_mm), residual, 0.0)


def _offsets_at_median(sensor: Sensor, runs: Runs, constants: Constants) -> Constants:
    """Start offsets, or curves, at the median residual, which no single row can pull away."""
    predicted = predict(constants, sensor, runs.l_mm, runs.w_mm)
    own = constants.own.copy()
    for i, name in enumerate(constants.model.own(runs.signatures)):
        part, *rest = name.split()
        if part in ("offset", "curve"):
            own[:, i] += np.nanmedian(runs.raw[rest[0]] - predicted[rest[0]], axis=0)
    return replace(constants, own=own)


def _sigma(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the robust standard deviation of each signature's residuals (signatures,)."""
    return np.array([max(_LEAST_SIGMA, float(robust_sigma(r[weight > 0.0]))) for r in residual])


def _redundancy(by: FloatArray, weight: FloatArray) -> FloatArray:
    """Return how much of a reading's error shows in its residual (signatures, contacts, strips): sqrt(1 - leverage).

    Where few rows determine many parameters, the fit follows each row, and a bare residual would hide its error.
    """
    rows = np.moveaxis(by * np.sqrt(weight)[..., None], 2, 0)  # (strips, signatures, contacts, own)
    flat = rows.reshape(len(rows), rows.shape[1] * rows.shape[2], rows.shape[3])
    leverage = (np.linalg.qr(flat)[0] ** 2).sum(axis=-1).reshape(rows.shape[:-1])
    return np.asarray(np.sqrt(np.maximum(1.0 - np.moveaxis(leverage, 0, 2), _LEAST_REDUNDANCY)))


def _robust_weight(scaled: FloatArray, huber: bool) -> FloatArray:
    """Return the weight of rows that are off by so many standard deviations: Huber's or Tukey's."""
    if huber:
        return np.minimum(1.0, _HUBER / np.maximum(scaled, 1e-12))
    return np.asarray(np.maximum(0.0, 1.0 - (scaled / _TUKEY) ** 2) ** 2)


def _cost(residual: FloatArray, sigma: FloatArray, weight: FloatArray) -> float:
    squares = (weight * ((residual / sigma) ** 2).sum(axis=0)).sum()
    return float(squares + 2.0 * np.log(sigma).sum() * (weight > 0.0).sum())


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


def _triangular_factors(
    by: FloatArray, weight: FloatArray, shared: int, residual: FloatArray | None = None
) -> FloatArray:
    """Return the triangular factor of each strip's weighted rows: own columns, shared columns, then the residual."""
    columns = [by[..., shared:], by[..., :shared]] + ([] if residual is None else [residual[..., None]])
    rows = np.concatenate(columns, axis=-1) * np.sqrt(weight)[..., None]
    rows = np.moveaxis(rows, 2, 0)  # (strips, signatures, contacts, columns)
    rows = rows.reshape(len(rows), -1, rows.shape[-1])
    lack = max(0, rows.shape[2] - rows.shape[1])
    return np.asarray(np.linalg.qr(np.pad(rows, ((0, 0), (0, lack), (0, 0))), mode="r"))


def _step(
    by: FloatArray, residual: FloatArray, weight: FloatArray, shared: int
) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss-Newton step of the shared and of the own parameters."""
    own = by.shape[-1] - shared
    r = _triangular_factors(by, weight, shared, residual)
    rest = np.concatenate(list(r[:, own:, own:]))
    shared_step = np.linalg.lstsq(rest[:, :shared], rest[:, shared], rcond=1e-10)[0]
    right = r[:, :own, -1] - r[:, :own, own:-1] @ shared_step
    own_step = np.linalg.pinv(r[:, :own, :own], rcond=1e-10) @ right[..., None]
    return shared_step, own_step[..., 0]


def _line_search(
    sensor: Sensor,
    runs: Runs,
    constants: Constants,
    residual: FloatArray,
    step: tuple[FloatArray, FloatArray],
    sigma: FloatArray,
    weight: FloatArray,
) -> tuple[Constants, FloatArray, float]:
    """Take the step, or the part of it that does not raise the cost.

    Returns the constants, their residuals, and how far readings moved; the given ones where no part will do.
    """
    before = _cost(residual, sigma, weight)
    for part in (1.0, 0.5, 0.25, 0.1, 0.01):
        shared, own = constants.shared + part * step[0], constants.own + part * step[1]
        new = within_bounds(replace(constants, shared=shared, own=own))
        after = _residuals(sensor, runs, new)
        if np.isfinite(after).all() and _cost(after, sigma, weight) <= before + 1e-12:
            return new, after, float(np.abs(after - residual).max(initial=0.0))
    return constants, residual, 0.0


def _uncertainty(by: FloatArray, weight: FloatArray, shared: int) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of the shared and of the own parameters: the Cramer-Rao bound."""
    own = by.shape[-1] - shared
    r = _triangular_factors(by, weight, shared)
    rest = np.concatenate(list(r[:, own:, own:]))
    together = np.linalg.qr(np.pad(rest, ((0, max(0, shared - len(rest))), (0, 0))), mode="r")
    shared_sigma = np.sqrt(np.diag(covariance(rest))) if shared else np.zeros(0)
    own_sigma = np.zeros((len(r), own))
    for strip, factor in enumerate(r):
        below = np.concatenate([np.zeros((len(together), own)), together], axis=1)
        own_sigma[strip] = np.sqrt(np.diag(covariance(np.concatenate([factor[:own], below]))))[:own]
    return shared_sigma, own_sigma

"""Fit a model's parameters to runs: least squares that bad rows cannot bend, with the uncertainty of each parameter.

A strip's own parameters move its own readings only, so each step eliminates them strip by strip (a QR each) and
solves what all strips share from what is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.model import Constants, Model, held, predict, start
from tacstrip.fisher import covariance
from tacstrip.io.runs import Runs
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_STEP = 1e-6  # of derivatives: parameters are of order 1, readings smooth
_ROUNDS = 25
_CAREFUL = 3  # rounds with Huber's weights before Tukey's
_SETTLED = 1e-7  # change of the readings over Vref
_FLOOR = 1e-5  # of Vref: noise is never taken for less
_TUKEY = 4.685  # standard deviations at which a row no longer counts; 95 % efficient for normal noise
_LEAST_SLACK = 0.02
_FADES = (0.05, 0.15, 0.35)


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted parameters and how well the runs tell them.

    Attributes
    ----------
    constants
        Their values.
    shared_sigma, own_sigma
        Standard deviations (shared,) and (strips, own); inf where the runs do not tell.
    sigma
        Standard deviation of a reading about the fit, by signature, over Vref.
    weight
        What each row counts (contacts, strips), 0 to 1.
    cost
        What the fit minimises.
    """

    constants: Constants
    shared_sigma: FloatArray
    own_sigma: FloatArray
    sigma: dict[str, float]
    weight: FloatArray
    cost: float

    @property
    def bad(self) -> BoolArray:
        """Rows that do not count (contacts, strips)."""
        return np.asarray(self.weight == 0.0)


def fit(model: Model, sensor: Sensor, runs: Runs, old: Constants | None = None) -> Fit:
    """Return the best parameters of a model; `old` has those to start from."""
    first = start(model, sensor, runs.signatures, old)
    if model.has("fade") and (old is None or not old.model.has("fade")):
        index = model.shared.index("fade")
        return min(
            (_descend(sensor, runs, _with(first, index, f), _CAREFUL) for f in _FADES), key=lambda f: f.cost
        )
    return _descend(sensor, runs, first, 0 if old is not None and old.model == model else _CAREFUL)


def at_rail(runs: Runs) -> BoolArray:
    """Return which contacts read 0 or Vref (contacts, strips): the converter may have cut them off there."""
    return np.asarray(np.any([(v <= 0.0) | (v >= 1.0) for v in runs.raw.values()], axis=0))


def _with(constants: Constants, index: int, value: float) -> Constants:
    shared = constants.shared.copy()
    shared[index] = value
    return replace(constants, shared=shared)


def _descend(sensor: Sensor, runs: Runs, constants: Constants, careful: int) -> Fit:
    """Improve the constants until readings settle; the first `careful` rounds let no row go."""
    if careful:
        constants = held(_centred(sensor, runs, constants))
    there = np.isfinite(runs.l_mm) & ~at_rail(runs)
    weight = there.astype(float)
    gap = _gap(sensor, runs, constants)
    slack = np.ones_like(gap)
    for turn in range(_ROUNDS):
        sigma = _sigma(gap / slack, weight)
        rough = np.abs(gap / slack / sigma[:, None, None]).max(axis=0)
        weight = np.where(there, _weight(rough, turn < careful), 0.0)
        by = slopes(sensor, constants, runs.l_mm, runs.w_mm) / sigma[:, None, None, None]
        slack = _slack(by[..., len(constants.shared) :], weight)
        step = _solve(by, gap / sigma[:, None, None], weight, len(constants.shared))
        constants, gap, moved = _go(sensor, runs, constants, gap, step, sigma, weight)
        if moved < _SETTLED and turn >= careful:
            break
    sigma = _sigma(gap / slack, weight)
    by = slopes(sensor, constants, runs.l_mm, runs.w_mm) / sigma[:, None, None, None]
    shared_sigma, own_sigma = _uncertainty(by, weight, len(constants.shared))
    named = dict(zip(runs.signatures, (float(s) for s in sigma), strict=True))
    return Fit(constants, shared_sigma, own_sigma, named, weight, _cost(gap, sigma, weight))


def _gap(sensor: Sensor, runs: Runs, constants: Constants) -> FloatArray:
    """Return measured less predicted readings (signatures, contacts, strips), 0 where there is no contact."""
    told = predict(constants, sensor, runs.l_mm, runs.w_mm)
    gap = np.stack([runs.raw[s] - told[s] for s in runs.signatures])
    return np.where(np.isfinite(runs.l_mm), gap, 0.0)


def _centred(sensor: Sensor, runs: Runs, constants: Constants) -> Constants:
    """Start offsets, or curves, at the median of what is left, which no single row can pull away."""
    told = predict(constants, sensor, runs.l_mm, runs.w_mm)
    own = constants.own.copy()
    for i, name in enumerate(constants.model.own(runs.signatures)):
        part, _, signature = name.partition(" ")
        if part in ("offset", "curve"):
            signature = signature.split()[0]
            own[:, i] += np.nanmedian(runs.raw[signature] - told[signature], axis=0)
    return replace(constants, own=own)


def _sigma(gap: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the spread of each signature's readings about the fit (signatures,), by the median."""
    there = weight > 0.0
    return np.array([max(_FLOOR, float(robust_sigma(g[there]))) for g in gap])


def _slack(by: FloatArray, weight: FloatArray) -> FloatArray:
    """Return how much of a reading's error shows in its gap (signatures, contacts, strips): sqrt(1 - leverage).

    Where few rows carry many parameters, the fit follows each row, and a bare gap would hide its error.
    """
    rows = np.moveaxis(by * np.sqrt(weight)[..., None], 2, 0)  # (strips, signatures, contacts, own)
    flat = rows.reshape(len(rows), rows.shape[1] * rows.shape[2], rows.shape[3])
    leverage = (np.linalg.qr(flat)[0] ** 2).sum(axis=-1).reshape(rows.shape[:-1])
    return np.asarray(np.sqrt(np.maximum(1.0 - np.moveaxis(leverage, 0, 2), _LEAST_SLACK)))


def _weight(rough: FloatArray, careful: bool) -> FloatArray:
    """Return what rows count that are off by so many standard deviations: Huber's at first, then Tukey's."""
    if careful:
        return np.minimum(1.0, 1.345 / np.maximum(rough, 1e-12))
    return np.asarray(np.maximum(0.0, 1.0 - (rough / _TUKEY) ** 2) ** 2)


def _cost(gap: FloatArray, sigma: FloatArray, weight: FloatArray) -> float:
    return float(
        (weight * ((gap / sigma[:, None, None]) ** 2).sum(axis=0)).sum()
        + 2.0 * np.log(sigma).sum() * (weight > 0.0).sum()
    )


def slopes(sensor: Sensor, constants: Constants, l_mm: FloatArray, w_mm: FloatArray) -> FloatArray:
    """Return the slopes of raw readings by the parameters (signatures, contacts, strips, shared and own).

    An own parameter is moved on all strips at once; lambda upwards, because a length below 0 means nothing.
    """

    def told(c: Constants) -> FloatArray:
        return np.nan_to_num(np.stack(list(predict(c, sensor, l_mm, w_mm).values())))

    shared, own = constants.shared, constants.own
    moves = [replace(constants, shared=shared + step) for step in _STEP * np.eye(len(shared))]
    moves += [replace(constants, own=own + step) for step in _STEP * np.eye(own.shape[1])]
    here = told(constants)
    return np.stack([(told(c) - here) / _STEP for c in moves], axis=-1)


def _triangles(by: FloatArray, weight: FloatArray, shared: int, gap: FloatArray | None = None) -> FloatArray:
    """Return the triangular factor of each strip's weighted rows: own columns, shared columns, then the gap."""
    columns = [by[..., shared:], by[..., :shared]] + ([] if gap is None else [gap[..., None]])
    rows = np.concatenate(columns, axis=-1) * np.sqrt(weight)[..., None]
    rows = np.moveaxis(rows, 2, 0)  # (strips, signatures, contacts, columns)
    rows = rows.reshape(len(rows), -1, rows.shape[-1])
    lack = max(0, rows.shape[2] - rows.shape[1])
    return np.asarray(np.linalg.qr(np.pad(rows, ((0, 0), (0, lack), (0, 0))), mode="r"))


def _solve(by: FloatArray, gap: FloatArray, weight: FloatArray, shared: int) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss-Newton step of the shared and of the own parameters."""
    own = by.shape[-1] - shared
    r = _triangles(by, weight, shared, gap)
    rest = np.concatenate(list(r[:, own:, own:]))
    common = np.linalg.lstsq(rest[:, :shared], rest[:, shared], rcond=1e-10)[0]
    right = r[:, :own, -1] - r[:, :own, own:-1] @ common
    each = np.linalg.pinv(r[:, :own, :own], rcond=1e-10) @ right[..., None]
    return common, each[..., 0]


def _go(
    sensor: Sensor,
    runs: Runs,
    constants: Constants,
    here: FloatArray,
    step: tuple[FloatArray, FloatArray],
    sigma: FloatArray,
    weight: FloatArray,
) -> tuple[Constants, FloatArray, float]:
    """Take the step, or the part of it that makes nothing worse; return the new gap and how far readings moved."""
    before = _cost(here, sigma, weight)
    for part in (1.0, 0.5, 0.25, 0.1, 0.01):
        shared, own = constants.shared + part * step[0], constants.own + part * step[1]
        there = held(replace(constants, shared=shared, own=own))
        gap = _gap(sensor, runs, there)
        if np.isfinite(gap).all() and _cost(gap, sigma, weight) <= before + 1e-12:
            return there, gap, float(np.abs(gap - here).max(initial=0.0))
    return constants, here, 0.0


def _uncertainty(by: FloatArray, weight: FloatArray, shared: int) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of the shared and of the own parameters: the Cramer-Rao bound."""
    own = by.shape[-1] - shared
    r = _triangles(by, weight, shared)
    rest = np.concatenate(list(r[:, own:, own:]))
    together = np.linalg.qr(np.pad(rest, ((0, max(0, shared - len(rest))), (0, 0))), mode="r")
    common = np.sqrt(np.diag(covariance(rest))) if shared else np.zeros(0)
    each = np.zeros((len(r), own))
    for strip, factor in enumerate(r):
        below = np.concatenate([np.zeros((len(together), own)), together], axis=1)
        each[strip] = np.sqrt(np.diag(covariance(np.concatenate([factor[:own], below]))))[:own]
    return common, each

"""A unit's model linearised at its constants: derivatives of readings, and each strip's own parameters eliminated.

A strip's own parameters affect its own readings only, so they are eliminated strip by strip (one QR each), and the
shared parameters are solved for from what remains.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.model import (
    CHANNEL,
    PARTS,
    Constants,
    pooled_precision,
    predict,
    strip_readings,
    through_channels,
)
from tacstrip.calibrate.place_errors import PlaceErrors
from tacstrip.fisher import covariance
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_STEP = 1e-6  # of the difference quotients: parameters are of order 1, readings smooth
_LEAST_SPREAD = 1e-3  # of the largest
_LEAST_REDUNDANCY = 0.02


def jacobian(sensor: Sensor, constants: Constants, l_mm: FloatArray, w_mm: FloatArray) -> FloatArray:
    """Return the derivatives of raw readings by the parameters (signatures, contacts, strips, shared and own).

    Forward differences: an own parameter is moved on all strips at once; lambda upwards, because a length below 0 is
    meaningless.
    """
    shared, own = constants.shared, constants.own
    moves = [replace(constants, shared=shared + step) for step in _STEP * np.eye(len(shared))]
    moves += [replace(constants, own=own + step) for step in _STEP * np.eye(own.shape[1])]
    names = (*constants.model.shared, *constants.names)
    readings = strip_readings(constants, sensor, l_mm, w_mm)
    raw = [through_channels(constants, readings)]
    for name, c in zip(names, moves, strict=True):
        same = name.split()[0] in CHANNEL
        raw.append(through_channels(c, readings if same else strip_readings(c, sensor, l_mm, w_mm)))
    here, *moved = np.nan_to_num(np.array([list(one.values()) for one in raw]))
    return np.stack([(one - here) / _STEP for one in moved], axis=-1)


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
        if places is not None:
            by_place = jacobian_of_places(sensor, constants, runs.l_mm, runs.w_mm)
            self.columns = places.columns(by_place)
            own = np.moveaxis(places.own(by_place), 0, 2)  # (contacts, strips, signatures, 2)
            noise = noise + own @ np.swapaxes(own, 2, 3)
        self.white = np.linalg.inv(np.linalg.cholesky(noise))
        self.by = jacobian(sensor, constants, runs.l_mm, runs.w_mm)

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Return rows (signatures, contacts, strips, ...) with noise of 1."""
        return np.asarray(np.einsum("cnst,tcn...->scn...", self.white, rows))

    def eliminate(self, weight: FloatArray) -> Eliminated:
        """Return the rows with each strip's own parameters eliminated; weight (contacts, strips)."""
        return Eliminated(self, weight)

    def prior_rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the rows of pooled parts by own (rows, own) and shared parameters, and their values (strips, rows)."""
        c = self.constants
        names, shared = c.names, c.model.shared
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


class Eliminated:
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
        names = constants.names
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

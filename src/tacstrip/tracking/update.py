"""Update one object's outline from scan to scan: least squares, started from the previous outline."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.descent import refine
from tacstrip.core.ellipse import PARAMETERS, fit_ellipse
from tacstrip.core.fit import ENDS, Fit
from tacstrip.core.problem import FLOOR, Signal
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline, close_chains
from tacstrip.reconstruction.polygon.fit import fitted_covariance, untangled
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.robust import robust_sigma
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_MAX_EXCESS_SIGMA = 5.0  # standard deviations by which the squared residuals may exceed those of the search
_OUTLIER_SIGMA = 6.0  # times the residuals' spread: a larger residual is an outlier
_SIGMA_UPDATE = 0.02  # weight of a new scan in the running estimate of the noise
_ELLIPSE_VERTICES = 40  # only the outline of an ellipse has so many
_MIN_WIDTH = 1e-6  # of the strip length: a narrower outline is a line
_MIN_SEPARATION = 1e-6  # of the width: between vertices that the ends have pushed together


class TrackLost(Exception):  # noqa: N818 - never reaches a user: the object is searched for instead
    """The outline cannot be placed on the strips that are touched now."""


@dataclass(frozen=True, eq=False)
class TrackState:
    """The state of a tracked object.

    Attributes
    ----------
    shape
        The latest reconstruction.
    fit
        The same in the parameters of the fit, its theta in [mm].
    sigma
        Standard deviation of a reading, estimated from the residuals [Vref].
    outliers
        Readings that are excluded from the fit (S, strips).
    """

    shape: RecoveredObject
    fit: Fit
    sigma: float
    outliers: BoolArray

    @property
    def is_ellipse(self) -> bool:
        """Whether it is an ellipse."""
        return len(self.shape.vertices) >= _ELLIPSE_VERTICES


def initialise(shape: RecoveredObject, scan: Scan, sensor: Sensor) -> TrackState | None:
    """Return the state of an object that a search found in this scan; None where its shape cannot be tracked."""
    outliers = np.zeros((len(scan.signatures), sensor.strips), dtype=bool)
    signal = _fit_problem(scan, sensor, shape.strips, 1.0, outliers)
    try:
        fit = Fit.of(Outline.of(shape.vertices), signal)
    except ContactError:
        return None
    residuals, used = fit.residuals(signal), signal.weight > 0.0
    spread = float(robust_sigma(residuals[used]))
    outlying = np.abs(residuals) > max(_OUTLIER_SIGMA * spread, FLOOR)
    outliers[:, shape.strips] = outlying
    last = TrackState(shape, _in_mm(fit, signal), 1.0, outliers)
    freedom = max(int(np.count_nonzero(used & ~outlying)) - _n_determined(last), 1)
    level = math.sqrt(float((residuals[~outlying] ** 2).sum()) / freedom)
    return replace(last, sigma=max(level, _sigma_floor(sensor)))


def update(
    last: TrackState, scan: Scan, sensor: Sensor, strips: slice, detail: bool
) -> tuple[TrackState, bool]:
    """Return the object's state in the next scan, and whether its shape explains the readings.

    Parameters
    ----------
    last
        State in the previous scan.
    scan, sensor, strips
        The next scan, its sensor, and the strips that the object touches now.
    detail
        Compute the covariance of a polygon too; an ellipse always has one.

    Raises
    ------
    TrackLost
        The outline cannot be placed on these strips.
    """
    signal = _fit_problem(scan, sensor, strips, last.sigma, last.outliers)
    start = _normalised(last.fit, signal)
    if last.is_ellipse:
        ellipse = fit_ellipse(start, signal)
        lower, upper, covariance = ellipse.outline(signal)
        cost, fit = ellipse.cost, _in_mm(Fit.of(Outline(lower, upper), signal), signal)
    else:
        found = refine(start, signal)
        lower, upper = untangled(*found.polygon(signal))
        cost, fit = found.cost, _in_mm(found, signal)
        if any((chain[1:, 0] <= chain[:-1, 0]).any() for chain in (lower, upper)):
            raise TrackLost
        covariance = None
        if detail:
            covariance = fitted_covariance(found, Outline(lower, upper), signal, sensor)
    x = sensor.x_mm[strips]
    profile = (x, np.interp(x, *lower.T), np.interp(x, *upper.T))
    if (profile[2] - profile[1]).max() <= _MIN_WIDTH * sensor.length_mm:
        raise TrackLost
    vertices = close_chains(lower, upper)
    shape = replace(last.shape, strips=strips, vertices=vertices, profile=profile, covariance=covariance)
    freedom = max(signal.readings - _n_determined(last), 1)
    variance = cost / freedom
    # The cube root of chi square is nearly normal (Wilson and Hilferty); sigma was estimated from as many readings.
    small = 2.0 / (9.0 * freedom)
    explained = (variance ** (1.0 / 3.0) - (1.0 - small)) / math.sqrt(2.0 * small) <= _MAX_EXCESS_SIGMA
    level = (
        last.sigma * math.sqrt(1.0 - _SIGMA_UPDATE + _SIGMA_UPDATE * variance) if explained else last.sigma
    )
    return TrackState(shape, fit, max(level, _sigma_floor(sensor)), last.outliers), explained


def _fit_problem(scan: Scan, sensor: Sensor, strips: slice, sigma: float, outliers: BoolArray) -> Signal:
    readings = {name: scan[name][strips] for name in scan.signatures}
    return Signal.of(sensor, sensor.x_mm[strips], readings, sigma, outliers[:, strips])


def _in_mm(fit: Fit, signal: Signal) -> Fit:
    theta = fit.theta * signal.length_mm
    for at in _X_PLACES:
        theta[at] = fit.theta[at] * signal.width_mm + signal.origin_mm
    return replace(fit, theta=theta)


def _normalised(fit: Fit, signal: Signal) -> Fit:
    """Return a fit in [mm] in the units of `signal`, its end vertices moved to the strips that are touched now."""
    theta = fit.theta / signal.length_mm
    for at in _X_PLACES:
        theta[at] = (fit.theta[at] - signal.origin_mm) / signal.width_mm
    reach = 0.5 * signal.pitch
    theta[0] = min(max(theta[0], -reach), reach)
    theta[3] = min(max(theta[3], 1.0 - reach), 1.0 + reach)
    inner: FloatArray = theta[ENDS::2]
    if len(inner) and not theta[0] < inner.min() <= inner.max() < theta[3]:
        many = len(inner)
        low, high = (
            theta[0] + np.arange(1, many + 1) * _MIN_SEPARATION,
            theta[3] - np.arange(many, 0, -1) * _MIN_SEPARATION,
        )
        inner[:] = np.clip(inner, low, high)
    return replace(fit, theta=theta)


_X_PLACES = (slice(0, 4, 3), slice(ENDS, None, 2))  # where theta holds x


def _n_determined(last: TrackState) -> int:
    """Return the number of parameters of the shape that the readings determine."""
    return PARAMETERS if last.is_ellipse else 2 * len(last.shape.vertices) - 2


def _sigma_floor(sensor: Sensor) -> float:
    """Return the least standard deviation of a reading: the converter's quantisation [Vref]."""
    return max(sensor.adc_step / math.sqrt(12.0), FLOOR)

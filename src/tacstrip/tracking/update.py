"""Update one object's outline from scan to scan: least squares, started from the previous outline."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FLOOR, FitProblem
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline, close_chains
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.strip_width import fitted_strips, remove_width_effect
from tacstrip.robust import robust_sigma
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_MAX_EXCESS_SIGMA = 5.0  # standard deviations by which the squared residuals may exceed those of the search
_OUTLIER_SIGMA = 6.0  # times the residuals' spread: a larger residual is an outlier
_SIGMA_UPDATE = 0.02  # weight of a new scan in the running estimate of the noise
_CURVE_PARAMETERS = 3  # of an ellipse that the readings determine
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
    fit: PolygonFit
    sigma: float
    outliers: BoolArray

    @property
    def model(self) -> type[OutlineModel]:
        """What is fitted to the next scan."""
        return self.shape.model or PolygonFit


def initialise(shape: RecoveredObject, scan: Scan, sensor: Sensor) -> TrackState | None:
    """Return the state of an object that a search found in this scan; None where its shape cannot be tracked."""
    outliers = np.zeros((len(scan.signatures), sensor.strips), dtype=bool)
    problem = _fit_problem(scan, sensor, shape.strips, 1.0, outliers, shape)
    fitted, _ = fitted_strips(sensor, shape.strips)
    try:
        fit = PolygonFit.of(Outline.of(shape.vertices), problem)
    except ContactError:
        return None
    residuals, used = fit.residuals(problem), problem.weight > 0.0
    spread = float(robust_sigma(residuals[used]))
    outlying = np.abs(residuals) > max(_OUTLIER_SIGMA * spread, FLOOR)
    outliers[:, fitted] = outlying
    last = TrackState(shape, _in_mm(fit, problem), 1.0, outliers)
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
        The outline cannot be placed on these strips, or fewer or more signatures are read there.
    """
    if len(scan.signatures) != len(last.outliers):
        raise TrackLost
    problem = _fit_problem(scan, sensor, strips, last.sigma, last.outliers, last.shape)
    start = _normalised(last.fit, problem)
    found = last.model.fitted(start, problem)
    lower, upper = found.chains_mm(problem)
    if any((chain[1:, 0] <= chain[:-1, 0]).any() for chain in (lower, upper)):
        raise TrackLost
    drawn = found if isinstance(found, PolygonFit) else PolygonFit.of(Outline(lower, upper), problem)
    cost, fit = found.cost, _in_mm(drawn, problem)
    covariance = found.covariance(problem, sensor) if detail or drawn is not found else None
    x = sensor.x_mm[strips]
    profile = (x, np.interp(x, *lower.T), np.interp(x, *upper.T))
    if (profile[2] - profile[1]).max() <= _MIN_WIDTH * sensor.length_mm:
        raise TrackLost
    vertices = close_chains(lower, upper)
    shape = replace(last.shape, strips=strips, vertices=vertices, profile=profile, covariance=covariance,
                    guarantee=None)  # fmt: skip
    moved = shape.centroid - last.shape.centroid
    others = tuple(
        replace(a, vertices=a.vertices + moved, others=tuple(o + moved for o in a.others))
        for a in last.shape.alternatives
    )
    shape = replace(shape, alternatives=others)
    freedom = max(problem.readings - _n_determined(last), 1)
    variance = cost / freedom
    # Wilson and Hilferty's cube root makes chi square nearly normal; sigma comes from as many readings.
    small = 2.0 / (9.0 * freedom)
    explained = (variance ** (1.0 / 3.0) - (1.0 - small)) / math.sqrt(2.0 * small) <= _MAX_EXCESS_SIGMA
    growth = math.sqrt(1.0 - _SIGMA_UPDATE + _SIGMA_UPDATE * variance) if explained else 1.0
    level = growth * last.sigma
    return TrackState(shape, fit, max(level, _sigma_floor(sensor)), last.outliers), explained


def _fit_problem(
    scan: Scan, sensor: Sensor, strips: slice, sigma: float, outliers: BoolArray, shape: RecoveredObject
) -> FitProblem:
    """Return what is fitted; of wide strips, without what their width adds to the readings of the last shape."""
    fitted, margin_mm = fitted_strips(sensor, strips)
    x, readings = sensor.x_mm[fitted], {name: scan[name][fitted] for name in scan.signatures}
    if sensor.strip_width_mm is not None:
        with contextlib.suppress(ContactError):
            readings = remove_width_effect(sensor, Outline.of(shape.vertices), x, readings)
    return FitProblem.of(sensor, x, readings, sigma, outliers[:, fitted], margin_mm)


def _in_mm(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    theta = fit.theta * problem.length_mm
    for at in _X_PLACES:
        theta[at] = fit.theta[at] * problem.width_mm + problem.origin_mm
    return replace(fit, theta=theta)


def _normalised(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    """Return a fit in [mm] in the units of `problem`, its end vertices moved to the strips that are touched now."""
    theta = fit.theta / problem.length_mm
    for at in _X_PLACES:
        theta[at] = (fit.theta[at] - problem.origin_mm) / problem.width_mm
    reach = 0.5 * problem.pitch
    theta[0] = min(max(theta[0], -reach), reach)
    theta[3] = min(max(theta[3], 1.0 - reach), 1.0 + reach)
    inner: FloatArray = theta[END_ENTRIES::2]
    if len(inner) and not theta[0] < inner.min() <= inner.max() < theta[3]:
        gaps = np.arange(1, len(inner) + 1) * _MIN_SEPARATION
        inner[:] = np.clip(inner, theta[0] + gaps, theta[3] - gaps[::-1])
    return replace(fit, theta=theta)


_X_PLACES = (slice(0, 4, 3), slice(END_ENTRIES, None, 2))  # the places of x in theta


def _n_determined(last: TrackState) -> int:
    """Return the number of parameters of the shape that the readings determine."""
    return 2 * len(last.shape.vertices) - 2 if last.shape.model is None else _CURVE_PARAMETERS


def _sigma_floor(sensor: Sensor) -> float:
    """Return the least standard deviation of a reading: the converter's quantisation [Vref]."""
    return max(sensor.adc_step / math.sqrt(12.0), FLOOR)

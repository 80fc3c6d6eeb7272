"""One object's outline from one scan to the next: least squares from where it was."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import END_ENTRIES
from tacstrip.core.fit import PolygonFit
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.problem import FLOOR, FitProblem
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline, close_chains
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.robust import robust_sigma
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_ALARM = 5.0  # standard deviations by which the squared residuals may exceed those of the search
_WILD = 6.0  # times the residuals' spread: a reading that the search left out
_SLOW = 0.02  # of the new level of residuals that is taken over with each scan
_CURVE_PARAMETERS = 3  # of an ellipse that the readings determine
_THIN = 1e-6  # of the strip length: thinner is a line
_APART = 1e-6  # of the width: between two vertices that the ends drove together


class Lost(Exception):  # noqa: N818 - no error that anybody sees: the object is searched
    """The outline does not fit on the strips that are touched now."""


@dataclass(frozen=True, eq=False)
class Followed:
    """What following an object needs.

    Attributes
    ----------
    shape
        The last one.
    fit
        The same, its theta in [mm].
    sigma
        Standard deviation of a reading, by what the outline left over [Vref].
    excluded
        Readings that are not used (S, strips).
    """

    shape: RecoveredObject
    fit: PolygonFit
    sigma: float
    excluded: BoolArray

    @property
    def model(self) -> type[OutlineModel]:
        """What is fitted to the next scan."""
        return self.shape.model or PolygonFit


def started(shape: RecoveredObject, scan: Scan, sensor: Sensor) -> Followed | None:
    """Return how to follow a shape that was searched in this scan; None where it has none that can be followed."""
    excluded = np.zeros((len(scan.signatures), sensor.strips), dtype=bool)
    problem = _problem(scan, sensor, shape.strips, 1.0, excluded)
    try:
        fit = PolygonFit.of(Outline.of(shape.vertices), problem)
    except ContactError:
        return None
    residuals, used = fit.residuals(problem), problem.weight > 0.0
    spread = float(robust_sigma(residuals[used]))
    wild = np.abs(residuals) > max(_WILD * spread, FLOOR)
    excluded[:, shape.strips] = wild
    last = Followed(shape, _in_mm(fit, problem), 1.0, excluded)
    freedom = max(int(np.count_nonzero(used & ~wild)) - _numbers(last), 1)
    level = math.sqrt(float((residuals[~wild] ** 2).sum()) / freedom)
    return replace(last, sigma=max(level, _least(sensor)))


def follow(last: Followed, scan: Scan, sensor: Sensor, strips: slice, detail: bool) -> tuple[Followed, bool]:
    """Return the object in the next scan, and whether its shape explains the readings.

    Parameters
    ----------
    last
        From `started`, or from here.
    scan, sensor, strips
        What was measured, with what, and the strips that the object touches now.
    detail
        Work out the covariance of a polygon too; an ellipse has one anyway.

    Raises
    ------
    Lost
        The outline cannot be put on these strips.
    """
    problem = _problem(scan, sensor, strips, last.sigma, last.excluded)
    start = _on_strips(last.fit, problem)
    found = last.model.fitted(start, problem)
    lower, upper = found.chains_mm(problem)
    if any((chain[1:, 0] <= chain[:-1, 0]).any() for chain in (lower, upper)):
        raise Lost
    drawn = found if isinstance(found, PolygonFit) else PolygonFit.of(Outline(lower, upper), problem)
    cost, fit = found.cost, _in_mm(drawn, problem)
    covariance = found.covariance(problem, sensor) if detail or drawn is not found else None
    x = sensor.x_mm[strips]
    profile = (x, np.interp(x, *lower.T), np.interp(x, *upper.T))
    if (profile[2] - profile[1]).max() <= _THIN * sensor.length_mm:
        raise Lost
    vertices = close_chains(lower, upper)
    shape = replace(last.shape, strips=strips, vertices=vertices, profile=profile, covariance=covariance)
    freedom = max(problem.readings - _numbers(last), 1)
    variance = cost / freedom
    # Wilson and Hilferty's cube root makes chi square nearly normal; sigma comes from as many readings.
    small = 2.0 / (9.0 * freedom)
    explained = (variance ** (1.0 / 3.0) - (1.0 - small)) / math.sqrt(2.0 * small) <= _ALARM
    level = last.sigma * math.sqrt(1.0 - _SLOW + _SLOW * variance) if explained else last.sigma
    return Followed(shape, fit, max(level, _least(sensor)), last.excluded), explained


def _problem(scan: Scan, sensor: Sensor, strips: slice, sigma: float, excluded: BoolArray) -> FitProblem:
    readings = {name: scan[name][strips] for name in scan.signatures}
    return FitProblem.of(sensor, sensor.x_mm[strips], readings, sigma, excluded[:, strips])


def _in_mm(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    theta = fit.theta * problem.length_mm
    for at in _X:
        theta[at] = fit.theta[at] * problem.width_mm + problem.origin_mm
    return replace(fit, theta=theta)


def _on_strips(fit: PolygonFit, problem: FitProblem) -> PolygonFit:
    """Return a fit in [mm] in units of the problem, its ends brought to the strips that are touched now."""
    theta = fit.theta / problem.length_mm
    for at in _X:
        theta[at] = (fit.theta[at] - problem.origin_mm) / problem.width_mm
    reach = 0.5 * problem.pitch
    theta[0] = min(max(theta[0], -reach), reach)
    theta[3] = min(max(theta[3], 1.0 - reach), 1.0 + reach)
    inner: FloatArray = theta[END_ENTRIES::2]
    if len(inner) and not theta[0] < inner.min() <= inner.max() < theta[3]:
        many = len(inner)
        low, high = theta[0] + np.arange(1, many + 1) * _APART, theta[3] - np.arange(many, 0, -1) * _APART
        inner[:] = np.clip(inner, low, high)
    return replace(fit, theta=theta)


_X = (slice(0, 4, 3), slice(END_ENTRIES, None, 2))  # the places of x in theta


def _numbers(last: Followed) -> int:
    """Return how many numbers of the shape the readings determine."""
    return 2 * len(last.shape.vertices) - 2 if last.shape.model is None else _CURVE_PARAMETERS


def _least(sensor: Sensor) -> float:
    """Return the noise that a reading has at least: of the converter's steps [Vref]."""
    return max(sensor.adc_step / math.sqrt(12.0), FLOOR)

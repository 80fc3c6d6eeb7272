"""How well a contact's area can be told: of a polygon by its corners, of a round outline by its size and stretch."""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.design.limits import Limit
from tacstrip.geometry.moments import area, deviations, moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_jacobian
from tacstrip.sensor.spec import Sensor

_ROUND = math.radians(
    45.5
)  # an outline that turns by no more at any corner is round: an octagon, and finer ones
_IDENTIFIED = 1e-9  # of the largest singular value: below, readings say nothing of a direction


def is_round(outline: Outline) -> bool:
    """Whether an outline stands for a curve: it turns by 45 degrees at most at each of its corners.

    Examples
    --------
    >>> import tacstrip as ts
    >>> is_round(circle(15.0)), is_round(ts.Outline.of([(0, 0), (40, 5), (30, 30)]))
    (True, False)
    """
    edges = np.roll(outline.vertices, -1, axis=0) - outline.vertices
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.remainder(np.roll(angles, -1) - angles + math.pi, 2.0 * math.pi) - math.pi
    return bool(np.abs(turns).max() <= _ROUND)


def circle(radius_mm: float, corners: int = 32) -> Outline:
    """Return a circle about 0 as a polygon of the same area."""
    angles = 2.0 * math.pi * (np.arange(corners) / corners)
    of_corners = radius_mm * math.sqrt(2.0 * math.pi / corners / math.sin(2.0 * math.pi / corners))
    return Outline.of(of_corners * np.column_stack([np.cos(angles), np.sin(angles)]))


def area_limit(sensor: Sensor, outline: Outline, noise: Noise, limit: Limit) -> float:
    """Return the least standard error of the area, relative to it, from the signatures of a limit."""
    if not is_round(outline):
        return deviations(outline.vertices, limit.covariance)[0] / area(outline.vertices)
    slopes = vertex_jacobian(outline, sensor, limit.signatures) / reading_sigma(noise, sensor)
    return area_bound(outline, sensor, slopes)


def area_bound(outline: Outline, sensor: Sensor, slopes: FloatArray) -> float:
    """Return the least standard error of the area, relative to it.

    Parameters
    ----------
    outline, sensor
        What touches what.
    slopes
        Of the readings over their sigma, by `vertices.ravel()`, as of `covariance_with_x_priors`.

    Returns
    -------
    float
        Of a polygon whose number of corners is known; of a round outline (`is_round`) as if all were known but place,
        size, stretch and shear: an ellipse is then one of any axes. inf where the readings do not determine it.
    """
    whole = area(outline.vertices)
    if not is_round(outline):
        return deviations(outline.vertices, covariance_with_x_priors(outline, sensor, slopes))[0] / whole
    x, y = (outline.vertices - moments(outline.vertices)[1]).T
    by = np.zeros(
        (outline.vertices.size, 6)
    )  # of the corners, by place, then by xx, xy, yx, yy of a linear map
    by[::2, [0, 2, 3]] = np.column_stack([np.ones_like(x), x, y])
    by[1::2, [1, 4, 5]] = np.column_stack([np.ones_like(x), x, y])
    ends = by[[2 * int(x.argmin()), 2 * int(x.argmax())]] * math.sqrt(12.0) / sensor.pitch_mm
    size = np.array([1.0, 1.0, *[math.sqrt(whole)] * 4])  # in mm all of them
    value, vector = np.linalg.svd(np.concatenate([slopes @ by, ends]) / size)[1:]
    told = value > _IDENTIFIED * value.max()
    relative = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]) / size  # of the area by these
    along = vector[: len(value)] @ relative
    rest = relative - vector[: len(value)][told].T @ along[told]
    if np.linalg.norm(rest) > 1e-6 * np.linalg.norm(relative):
        return math.inf
    return float(np.linalg.norm(along[told] / value[told]))

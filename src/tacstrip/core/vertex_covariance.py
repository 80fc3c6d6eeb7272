"""The covariance of an outline's vertices from a weighted Jacobian, and from what is known of their x."""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.fisher import covariance
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.spec import Sensor


def covariance_with_x_priors(outline: Outline, sensor: Sensor, jacobian: FloatArray) -> FloatArray:
    """Return the covariance of the vertices (2 V, 2 V) [mm^2].

    The ends' x is known to within a pitch, and so is that of two vertices with at most one strip between them, where
    readings say nothing of the edge. The two vertices of a vertical edge have one x.

    Parameters
    ----------
    outline, sensor
        What touches what.
    jacobian
        Of the readings over their sigma, by `vertices.ravel()` (readings, 2 V) [1/mm]; or any matrix J of 2 V columns
        with the same J'J.
    """
    lower, upper = outline.indices
    column = np.arange(jacobian.shape[1])
    ends = ((lower[0], upper[0]), (lower[-1], upper[-1]))
    for a, b in ends:
        column[2 * b] = column[2 * a]  # the same vertex, or one x for a vertical edge
    free, place = np.unique(column, return_inverse=True)
    known = {int(place[2 * i]) for i in (*(a for a, _ in ends), *_on_short_edges(outline, sensor))}
    joined = np.zeros((len(jacobian) + len(known), len(free)))
    np.add.at(joined[: len(jacobian)].T, place, jacobian.T)
    for row, i in enumerate(sorted(known), len(jacobian)):
        joined[row, i] = math.sqrt(12.0) / sensor.pitch_mm
    return np.asarray(covariance(joined)[np.ix_(place, place)])


def _on_short_edges(outline: Outline, sensor: Sensor) -> list[int]:
    """Return the vertices of edges that cross one strip or none."""
    found: list[int] = []
    for chain, index in zip((outline.lower, outline.upper), outline.indices, strict=True):
        crossed = np.diff(np.searchsorted(sensor.x_mm, chain[:, 0]))
        for i in np.flatnonzero(crossed <= 1):
            found += [int(index[i]), int(index[i + 1])]
    return found

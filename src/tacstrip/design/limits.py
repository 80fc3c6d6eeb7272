"""Limits of a sensor: the Cramer-Rao bound of a contact's vertices at one place, and over the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, OptionError
from tacstrip.geometry.moments import moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance, vertex_rms
from tacstrip.sensor.spec import Sensor

_TOLERANCE = 1e-9  # of the sensor's size


@dataclass(frozen=True, eq=False)
class Limit:
    """The bound from some of the signatures.

    Attributes
    ----------
    signatures
        Those that are read.
    covariance
        Of the vertices (2 V, 2 V) [mm^2], in the order of `vertices.ravel()`; inf and NaN where the readings do
        not determine them (`vertex_covariance`).
    """

    signatures: tuple[str, ...]
    covariance: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard errors of every vertex's x and y (V, 2) [mm]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)).reshape(-1, 2))

    @property
    def rms(self) -> float:
        """Root mean square of a vertex's distance from the truth [mm]."""
        return vertex_rms(self.covariance)


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """RMS vertex error with the contact's centroid at a grid of places.

    Attributes
    ----------
    x_mm, y_mm
        Places of the centroid (columns,) and (rows,) [mm], from one edge of the sensor to the other.
    rms_mm
        (rows, columns) [mm]; inf where the readings do not determine the vertices.
    centroid
        Where the contact itself lies (2,) [mm].
    """

    x_mm: FloatArray
    y_mm: FloatArray
    rms_mm: FloatArray
    centroid: FloatArray


def outline_of(sensor: Sensor, contact: Contact) -> Outline:
    """Return a contact's outline where it lies on the sensor.

    Raises
    ------
    ContactError
        It is not one x-monotone polygon, or not wholly on the sensor.
    """
    outline = Outline.of(contact.vertices)
    low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
    size = np.array([sensor.width_mm, sensor.length_mm])
    if np.any(low < -_TOLERANCE * size) or np.any(high > (1.0 + _TOLERANCE) * size):
        raise ContactError(
            f"the contact spans x = {low[0]:.6g} to {high[0]:.6g}, y = {low[1]:.6g} to {high[1]:.6g} mm: not wholly "
            f"on the sensor of {size[0]:.6g} x {size[1]:.6g} mm. Move it (--at)"
        )
    return outline


def checked_noise(sensor: Sensor, noise: Noise) -> float | Noise:
    """Return the standard deviation of a reading [Vref], or of readings whose errors are not independent the noise.

    Raises
    ------
    OptionError
        Nothing limits them.
    """
    sigma = reading_sigma(noise, sensor)
    if not noise.independent and (sigma or noise.edge_mm or noise.gain):
        return noise
    if sigma == 0.0:
        raise OptionError(
            "without noise and A/D steps there is no limit: set quantisation, positional or bits"
        )
    return sigma


def limits(sensor: Sensor, outline: Outline, noise: Noise) -> list[Limit]:
    """Return the bound from each signature alone, then from all of them where there are several."""
    sigma = checked_noise(sensor, noise)
    subsets: list[tuple[str, ...]] = [(name,) for name in sensor.signatures]
    if len(subsets) > 1:
        subsets.append(sensor.signatures)
    return [Limit(names, vertex_covariance(outline, sensor, sigma, names)) for names in subsets]


def places(sensor: Sensor, outline: Outline, columns: int, rows: int) -> tuple[FloatArray, FloatArray]:
    """Return how far to move an outline (columns,) and (rows,) [mm] to have it at a grid of places on the sensor."""
    low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
    across = np.linspace(-low[0], sensor.width_mm - high[0], columns)
    return across, np.linspace(-low[1], sensor.length_mm - high[1], rows)


def limit_map(sensor: Sensor, outline: Outline, noise: Noise, columns: int = 24, rows: int = 24) -> ErrorMap:
    """Return the RMS vertex error, from all signatures, with the contact moved over the surface."""
    sigma = checked_noise(sensor, noise)
    across, along = places(sensor, outline, columns, rows)
    moved = [[outline.moved(dx, dy) for dx in across] for dy in along]
    rms = [[vertex_rms(vertex_covariance(o, sensor, sigma)) for o in row] for row in moved]
    centroid = moments(outline.vertices)[1]
    return ErrorMap(centroid[0] + across, centroid[1] + along, np.array(rms), centroid)

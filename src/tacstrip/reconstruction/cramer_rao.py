"""How well any unbiased method can tell a polygon's vertices from one scan: the Cramer-Rao bound."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.fisher import checked_sigma
from tacstrip.geometry.outline import Outline
from tacstrip.network.crp.cramer_rao import jacobian
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    reading_covariance,
    reading_variance,
    signature_jacobians,
)
from tacstrip.reconstruction.strip_width import OnWideStrips, counts_wide, touched
from tacstrip.sensor.left_out import left_out
from tacstrip.sensor.spec import Sensor


@takes(noise=Noise, sensor=Sensor)
def reading_sigma(noise: Noise, sensor: Sensor) -> float:
    """Return the standard deviation of a reading [Vref]: of the noise's errors, and of the A/D converter's steps.

    An error uniform within +-a has a / sqrt(3); a step s of the converter has s / sqrt(12). Gain, and where a soft
    contact ends, depend on the contact and are not counted.
    """
    return math.sqrt(reading_variance(noise, sensor, Averaging()))


def vertex_jacobian(
    outline: Outline,
    sensor: Sensor,
    signatures: Iterable[str] | None = None,
    x_mm: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the slopes of readings by `vertices.ravel()` (readings, 2 V) [1/mm]; arguments as `vertex_covariance`.

    A row per strip of the first signature, then of the next, but for channels that the spec leaves out. Without a
    closed form (CRS-CRP) they come from the network of all touched strips: a strip's readings depend on its
    neighbours' ends too.
    """
    names = tuple(map(sensor.check_signature, sensor.signatures if signatures is None else signatures))
    x = sensor.x_mm if x_mm is None else np.asarray(x_mm, dtype=float)
    x = x[touched(sensor, outline, x)]
    if not sensor.kind.closed_form:
        return _network_slopes(outline, sensor, names, x)
    if counts_wide(sensor):
        wide = OnWideStrips(sensor, outline, x)
        (l, u), (by_l, by_u) = wide.ends, wide.slopes()
    else:
        (l, u), (by_l, by_u) = outline.ends(x), outline.jacobian(x)
    of_ends = signature_jacobians(sensor, l, u)
    pairs = [(*of_ends[n], _read(sensor, n, x)) for n in names]
    return np.concatenate([(a[:, None] * by_l + b[:, None] * by_u)[there] for a, b, there in pairs])


def _ends(sensor: Sensor, outline: Outline, x_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return l and u (n,) [mm] of strips that are touched, or of wide ones what a line would have to read the same."""
    if not counts_wide(sensor):
        return outline.ends(x_mm)
    l, u = OnWideStrips(sensor, outline, x_mm).ends
    return l, u


def _read(sensor: Sensor, signature: str, x_mm: FloatArray) -> BoolArray:
    """Return of which strips (n,) a signature is not left out."""
    out = left_out(sensor).get(signature, np.zeros(sensor.strips, dtype=bool))
    return np.asarray(~np.isclose(x_mm[:, None], sensor.x_mm[out]).any(axis=1))


def _network_slopes(outline: Outline, sensor: Sensor, names: tuple[str, ...], x: FloatArray) -> FloatArray:
    strip, by_ends = jacobian(sensor, *outline.ends(sensor.x_mm))  # (T, signatures, 2 T)
    by_vertices = by_ends @ np.concatenate(outline.jacobian(sensor.x_mm[strip]))
    read = np.isclose(sensor.x_mm[strip][:, None], x).any(axis=1)
    return np.concatenate([by_vertices[read, sensor.signatures.index(n)] for n in names])


@takes(outline=Outline, sensor=Sensor)
def vertex_covariance(
    outline: Outline,
    sensor: Sensor,
    sigma: float | Noise,
    signatures: Iterable[str] | None = None,
    x_mm: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the bound of the vertices' covariance (2 V, 2 V) [mm^2], in the order of `vertices.ravel()`.

    The number of vertices counts as known. The x of the end vertices has a prior: which strips are touched
    tells it to within one pitch, which counts as a normal error of variance pitch^2 / 12. So has that of both vertices
    of an edge that crosses one strip or none, whose place readings alone do not tell. The two vertices of a vertical
    edge have one x.

    Parameters
    ----------
    outline, sensor
        What touches what.
    sigma
        Standard deviation of a reading [Vref], all independent; or their noise, with what strips share.
    signatures
        Those that are read; all that the sensor has by default.
    x_mm
        Centre lines of the strips that are read [mm]; all of the sensor's by default. Strips that the outline
        does not touch are left out.

    Returns
    -------
    FloatArray
        What the readings do not tell has variance inf and covariance NaN (`fisher.covariance`).

    Raises
    ------
    ReadingError
        sigma is not a finite number above 0.
    SignatureError
        The sensor does not have such a signature.
    ContactError
        CRS-CRP: the outline touches no strip, or leaves the sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> outline = ts.Outline.of([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> bound = ts.vertex_covariance(outline, sensor, sigma=0.002)
    >>> bound.shape, round(ts.vertex_rms(bound), 3)
    ((8, 8), 0.088)
    """
    slopes = vertex_jacobian(outline, sensor, signatures, x_mm)
    if not isinstance(sigma, Noise):
        return covariance_with_x_priors(outline, sensor, slopes / checked_sigma(sigma))
    checked_sigma(reading_sigma(sigma, sensor) + sigma.edge_mm + sigma.gain)
    names = tuple(sensor.signatures if signatures is None else signatures)
    x = sensor.x_mm if x_mm is None else np.asarray(x_mm, dtype=float)
    x = x[touched(sensor, outline, x)]
    errors = reading_covariance(sigma, sensor, x, _ends(sensor, outline, x), names, Averaging())
    read = np.concatenate([_read(sensor, name, x) for name in names])
    errors = errors[np.ix_(read, read)]
    white = np.asarray(np.linalg.solve(np.linalg.cholesky(errors), slopes))
    return covariance_with_x_priors(outline, sensor, white)


def vertex_rms(covariance: FloatArray) -> float:
    """Return the root mean square over vertices of their distance from the truth [mm]; inf where one is unidentifiable.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> ts.vertex_rms(np.diag([0.09, 0.16, 0.09, 0.16]))
    0.5
    """
    return float(np.sqrt(np.trace(covariance) / (len(covariance) / 2.0)))

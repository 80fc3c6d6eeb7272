"""l and u of every strip from k_h and k_l, with the error that the readings' noise makes.

Where a strip's readings follow from its own contact, (4.36) gives both ends strip by strip. CRS-CRP has no closed form:
all strips are solved together on the network.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.network.crp.inversion import invert, invert_all
from tacstrip.network.crp.mesh import Wiring
from tacstrip.reconstruction.noise_covariance import signature_jacobians
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import lower_and_width
from tacstrip.sensor.spec import Sensor

_MOST_VERTICES = 4000
_SIGMA = 1e-3  # of Vref: weighs nothing where the noise is not given, all readings being alike


@dataclass(frozen=True, eq=False)
class Ends:
    """Both ends of the contact on every strip.

    Attributes
    ----------
    l, u
        (strips,) [mm], 0 <= l <= u <= L; NaN where nothing touches.
    covariance
        From the network's inversion: of l of all strips, then u (2 strips, 2 strips) [mm^2], NaN where nothing touches.
        None where no noise was given.
    strip_status, advice
        From the network's inversion, a word per strip; empty where closed forms do.
    """

    l: FloatArray
    u: FloatArray
    covariance: FloatArray | None = None
    strip_status: tuple[str, ...] = ()
    advice: str = ""
    # From closed forms: variance of l, of u, covariance of both (3, strips) [mm^2].
    own: FloatArray | None = None

    def covariance_of(self, which: IntArray) -> FloatArray | None:
        """Return the covariance of vertices (2N, 2N) [mm^2] whose y are some of the ends, and whose x are known.

        None where no noise was given, or of more than 4000 vertices, for it would take half a gigabyte and more.

        Parameters
        ----------
        which
            The ends (N,): i is l of strip i, n + i is u, of n strips.
        """
        if (self.covariance is None and self.own is None) or len(which) > _MOST_VERTICES:
            return None
        full = np.zeros((2 * len(which), 2 * len(which)))
        if self.covariance is not None:
            full[1::2, 1::2] = self.covariance[np.ix_(which, which)]
        if self.own is not None:
            n, y = len(self.l), 2 * np.arange(len(which)) + 1
            full[y, y] = self.own[:2].ravel()[which]
            place = np.full(2 * n, -1)
            place[which] = y
            lower, upper = place[:n], place[n:]
            both = (lower >= 0) & (upper >= 0)
            full[lower[both], upper[both]] = full[upper[both], lower[both]] = self.own[2][both]
        return full


def ends(
    scan: Scan, sensor: Sensor, sigma: float | None = None, convex: bool = False, wiring: Wiring | None = None
) -> Ends:
    """Return l and u of a scan that has k_h and k_l.

    Parameters
    ----------
    scan, sensor
        What was measured, by what. All electrodes of a CRS-CRP sheet are used if the scan has them.
    sigma
        Standard deviation of a reading [Vref]; None if not known.
    convex, wiring
        CRS-CRP: whether every run of strips is taken for one convex contact; how the sensor is wired.
    """
    if sensor.kind.closed_form:
        l, u = closed_ends(sensor, scan["kh"], scan["kl"])
        return Ends(l, u, own=None if sigma is None else sigma**2 * np.stack(_variances(sensor, l, u)))
    if not scan.touched.any():
        return Ends(scan["kl"], scan["kl"])
    weight = sigma or _SIGMA
    if scan.electrodes is None:
        found = invert(sensor, scan["kh"], scan["kl"], weight, convex, wiring=wiring)
    else:
        found = invert_all(sensor, scan.electrodes, weight, convex, wiring=wiring)
    covariance = None if sigma is None else found.covariance * (sigma / weight) ** 2
    return Ends(found.l, found.u, covariance, found.status, found.advice)


def _variances(sensor: Sensor, l: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return variance of l, of u, and covariance of both (n,) [mm^2], for readings of variance 1."""
    slopes = signature_jacobians(sensor, l, u)
    (a, b), (c, d) = slopes["kh"], slopes["kl"]
    det = a * d - b * c
    return (b**2 + d**2) / det**2, (a**2 + c**2) / det**2, -(a * b + c * d) / det**2


def end_deviations(
    sensor: Sensor, l: FloatArray, u: FloatArray, sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of l and of u (n,) [mm], of a strip's two readings of deviation sigma [Vref]."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        of_l, of_u, _ = _variances(sensor, l, u)
        # What the readings leave open, NaN among it, is as uncertain as the strip is long.
        return np.fmin(sigma * np.sqrt(of_l), sensor.length_mm), np.fmin(
            sigma * np.sqrt(of_u), sensor.length_mm
        )


def closed_ends(sensor: Sensor, kh: FloatArray, kl: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return l and u [mm] of readings of any shape by (4.36), held to 0 <= l <= u <= L; NaN stays NaN."""
    l, w = lower_and_width(kh, kl, sensor.length_mm, sensor.sensing_ratio, sensor.contact_lambda_mm)
    middle = l + 0.5 * w
    half = 0.5 * np.maximum(w, 0.0)
    return np.clip(middle - half, 0.0, sensor.length_mm), np.clip(middle + half, 0.0, sensor.length_mm)

"""The covariance of the readings of one contact: what every reading draws anew, what lasts, and what strips share.

Outlines are fitted by plain least squares, with one sigma for all readings; what the errors share goes into the
covariance of the result. With A the covariance that the fit would have if its errors were independent, J the readings'
Jacobian and C their covariance, the vertices' is A + A J'(C - sigma^2) J A / sigma^4: the "sandwich" of econometrics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.core.problem import FLOOR
from tacstrip.fisher import positive_part
from tacstrip.geometry.outline import Outline
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import reading_jacobian
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.noise import Noise
from tacstrip.sensor.resistance import electrical_ends, electrical_slopes
from tacstrip.sensor.spec import Sensor

_ENOUGH = 4.0  # times as much variance that stays as averaging leaves of the rest: then it is enough
_DITHER = 0.5  # of the converter's step: noise of so much sigma makes the mean of scans finer than a step
_DETERMINED = 0.7  # of 1, the share of a parameter's certainty that readings give: the rest is a prior's
# Times their variance that correlated errors may count for when corners are told from noise.
_MOST_ALIKE = 4.0


@dataclass(frozen=True)
class Averaging:
    """Of how many scans a scan is the mean, and over what time [s]; of unknown time where that is 0."""

    count: int = 1
    span_s: float = 0.0

    @classmethod
    def of(cls, scan: Scan | None) -> Averaging:
        """Return that of a scan, or of a single one."""
        return cls() if scan is None else cls(scan.averaged, scan.span_s)

    def lasting(self, time_constant_s: float) -> float:
        """Return the share of a wander's variance that is left in the mean."""
        if self.count == 1 or self.span_s == 0.0:
            return 1.0
        kept = math.exp(-self.span_s / (self.count - 1) / time_constant_s)
        lag = np.arange(1, self.count)
        return float((self.count + 2.0 * ((self.count - lag) * kept**lag).sum()) / self.count**2)

    def humming(self, hertz: float) -> float:
        """Return the share of a hum's variance that is left, at the worst phase: at least that of one scan of all."""
        if self.count == 1 or self.span_s == 0.0:
            return 1.0
        turns = np.exp(2j * math.pi * hertz * self.span_s / (self.count - 1) * np.arange(self.count))
        return max(float(np.abs(turns.mean()) ** 2), 1.0 / self.count)


def own_variance(noise: Noise, sensor: Sensor, averaging: Averaging) -> float:
    """Return the variance [Vref^2] of a reading that no other one shares, edges and gain not counted."""
    fresh = (noise.quantisation**2 + noise.positional**2) / 3.0
    fresh += noise.white**2 * (1.0 - noise.white_shared)
    if averaging.count > 1:  # of a single scan they are told by their neighbours
        fresh += noise.strays * noise.stray_size**2
    steps = sensor.adc_variance
    dithered = fresh + noise.white**2 * noise.white_shared >= (_DITHER * sensor.adc_step) ** 2
    lasting = _wander(noise, averaging) * (1.0 - noise.wander_shared - noise.wander_by_signature)
    return (fresh + steps * dithered) / averaging.count + steps * (not dithered) + lasting


def common_variance(noise: Noise, averaging: Averaging) -> float:
    """Return the variance [Vref^2] of the error that all readings share."""
    lasting = _wander(noise, averaging) * noise.wander_shared
    white = noise.white**2 * noise.white_shared / averaging.count
    return white + lasting + noise.offset**2 + noise.hum**2 * averaging.humming(noise.hum_hz)


def signature_variance(noise: Noise, averaging: Averaging) -> float:
    """Return the variance [Vref^2] of the error that all strips share in one signature, and not in the other."""
    return _wander(noise, averaging) * noise.wander_by_signature


def reading_variance(noise: Noise, sensor: Sensor, averaging: Averaging) -> float:
    """Return the variance [Vref^2] of a reading, edges and gain not counted."""
    shared = common_variance(noise, averaging) + signature_variance(noise, averaging)
    return own_variance(noise, sensor, averaging) + shared


def _wander(noise: Noise, averaging: Averaging) -> float:
    return sum(s**2 * averaging.lasting(t) for s, t in noise.processes)


def correlated(noise: Noise, averaging: Averaging) -> bool:
    """Whether the errors of readings are not independent."""
    shared = common_variance(noise, averaging) + signature_variance(noise, averaging)
    return noise.soft or noise.gain > 0.0 or shared > 0.0


def fit_sigma(noise: Noise, sensor: Sensor, averaging: Averaging) -> float:
    """Return the sigma [Vref] by which a fit tells corners from noise, before it knows where the contact lies.

    What all readings share moves the outline and makes no corners. Errors that neighbours share count for more.
    """
    kept = math.exp(-sensor.pitch_mm / noise.edge_correlation_mm) if noise.edge_correlation_mm else 0.0
    alike = min((1.0 + kept) / (1.0 - kept), _MOST_ALIKE) if kept < 1.0 else _MOST_ALIKE
    soft = alike * (noise.edge_mm / sensor.length_mm) ** 2  # dk/dl and dk/du add up to some 1/L
    return math.sqrt(own_variance(noise, sensor, averaging) + soft + (0.5 * noise.gain) ** 2)


def averaging_advice(noise: Noise | None, sensor: Sensor, averaging: Averaging) -> str:
    """Say how many scans are worth averaging, where a mean of so many is not good enough."""
    if noise is None:
        return "average more scans, as many as `tacstrip noise` says that help"
    lasting = (
        sum(s**2 for s, _ in noise.processes) + noise.offset**2 + (noise.edge_mm / sensor.length_mm) ** 2
    )
    lasting += (0.5 * noise.gain) ** 2 + (noise.blur_mm / sensor.length_mm) ** 2
    if lasting == 0.0:
        return "average more scans"
    fresh = (noise.quantisation**2 + noise.positional**2) / 3.0 + noise.white**2
    stays = f"an error of {100.0 * math.sqrt(lasting):.2g} % of Vref stays"
    enough = math.ceil(_ENOUGH * fresh / lasting)
    if enough <= averaging.count:
        return f"averaging more scans does not help, for {stays}"
    return f"average {enough} scans (more hardly help: {stays})"


def signature_advice(sensor: Sensor) -> str:
    """Say what to do where one signature leaves a shape open: some constructions have no other."""
    both = len(sensor.signatures) > 1
    return "use both signatures" if both else "use finer strips or two signatures (crs-crs)"


def signature_jacobians(
    sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray, read: dict[str, FloatArray] | None = None
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return dk/dl and dk/du [1/mm] of every signature, name to two arrays of the shape of l and u.

    `read`: the signatures of these ends, where the caller has them.
    """
    low, high, lam = electrical_ends(sensor, l_mm, u_mm)
    found = {
        name: reading_jacobian(
            k,
            np.asarray(high - low),
            sensor.length_mm,
            SIGNATURES[name].at_upper_end,
            sensor.sensing_ratio,
            lam,
        )
        for name, k in (signatures(sensor, l_mm, u_mm) if read is None else read).items()
    }
    if sensor.surface is None:
        return found
    (low_by_l, low_by_u), (high_by_l, high_by_u) = electrical_slopes(sensor, l_mm, u_mm)
    return {
        name: (a * low_by_l + b * high_by_l, a * low_by_u + b * high_by_u) for name, (a, b) in found.items()
    }


def reading_covariance(
    noise: Noise,
    sensor: Sensor,
    x_mm: FloatArray,
    ends_mm: tuple[FloatArray, FloatArray],
    names: Sequence[str],
    averaging: Averaging,
) -> FloatArray:
    """Return the covariance (S n, S n) [Vref^2] of the readings of strips at x_mm (n,), one signature after the other.

    Parameters
    ----------
    noise, sensor
        What errors, on what.
    x_mm, ends_mm
        Centre lines (n,) and l and u of the contact (n,) [mm].
    names
        The signatures (S,).
    averaging
        Of how many scans the readings are the mean.
    """
    count = len(names) * len(x_mm)
    found = np.full((count, count), common_variance(noise, averaging))
    of_signature = np.eye(len(names)) * signature_variance(noise, averaging)
    found += np.kron(of_signature, np.ones((len(x_mm), len(x_mm))))
    # Shared alone it is singular.
    found[np.diag_indices(count)] += own_variance(noise, sensor, averaging) + FLOOR**2
    if not (noise.soft or noise.gain):
        return found
    if noise.soft:
        of_ends = signature_jacobians(sensor, *ends_mm)
        by_l, by_u = (np.stack([of_ends[name][end] for name in names]) for end in (0, 1))
        apart = np.abs(x_mm[:, None] - x_mm)
        alike = np.exp(-apart / noise.edge_correlation_mm) if noise.edge_correlation_mm else np.eye(len(x_mm))
        for slope in (by_l, by_u):
            found += noise.edge_mm**2 * np.einsum("ai,ij,bj->aibj", slope, alike, slope).reshape(count, count)
        grown = (by_u - by_l).ravel()
        found += noise.blur_mm**2 * np.outer(grown, grown)
    if noise.gain:
        readings = signatures(sensor, *ends_mm)
        k = np.stack([readings[name] for name in names])
        gains = np.einsum("ai,ij,bj->aibj", k, np.eye(len(x_mm)), k)
        found += noise.gain**2 * gains.reshape(count, count)
    return found


@dataclass(frozen=True, eq=False)
class CorrelatedErrors:
    """The errors of a run's readings where they are not independent.

    Attributes
    ----------
    matrix
        Their covariance [Vref^2], of the readings that were used (R, R).
    sigma
        The one that the fit took for all of them [Vref].
    jacobian
        Of these readings by the outline's `vertices.ravel()` (R, 2 V) [1/mm].
    residuals
        Measured minus fitted [Vref] (R,).
    used
        Which readings these are (S, n).
    """

    matrix: FloatArray
    sigma: float
    jacobian: FloatArray
    residuals: FloatArray
    used: BoolArray

    @classmethod
    def of(
        cls,
        noise: Noise,
        sensor: Sensor,
        outline: Outline,
        x_mm: FloatArray,
        scan: Scan,
        residuals: FloatArray,
        used: BoolArray,
        sigma: float,
    ) -> CorrelatedErrors:
        """Return those of a run that an outline was fitted to.

        `residuals` and `used` are (S, n), strips at x_mm (n,).
        """
        averaging = Averaging.of(scan)
        held = np.clip(x_mm, outline.lower[0, 0], outline.lower[-1, 0])  # the fit reads its ends beyond them
        ends = outline.ends(held)
        matrix = reading_covariance(noise, sensor, x_mm, ends, scan.signatures, averaging)
        of_ends = signature_jacobians(sensor, *ends)
        of_l, of_u = outline.jacobian(held)
        slopes = [of_ends[name] for name in scan.signatures]
        jacobian = np.concatenate([a[:, None] * of_l + b[:, None] * of_u for a, b in slopes])
        at = used.ravel()
        return cls(matrix[np.ix_(at, at)], sigma, jacobian[at], residuals.ravel()[at], used)

    def propagated(self, covariance: FloatArray) -> FloatArray:
        """Return the vertices' covariance with these errors, from that with independent ones of `sigma` (2 V, 2 V)."""
        gain = np.nan_to_num(covariance, nan=0.0, posinf=0.0) @ self.jacobian.T / self.sigma**2
        known = positive_part(
            covariance - self.sigma**2 * gain @ gain.T
        )  # without readings; rounded, or cut by NaN
        return np.asarray(known + gain @ self.matrix @ gain.T)

    def whitened(self, covariance: FloatArray) -> tuple[FloatArray, int]:
        """Return what the best outline of this kind leaves over, independent and over sigma (S, n), and its freedom.

        The outline of plain least squares is not the best one where errors correlate; a step along the parameters, of
        which `covariance` says what they are, leads to that.
        """
        value, vector = np.linalg.eigh(np.nan_to_num(covariance, nan=0.0, posinf=0.0))
        moved = self.jacobian @ (vector * np.sqrt(np.maximum(value, 0.0)))
        size, turned = np.linalg.svd(moved / self.sigma, full_matrices=False)[1:]
        determined = moved @ turned[size > _DETERMINED].T
        white = np.linalg.solve(
            np.linalg.cholesky(self.matrix), np.column_stack([self.residuals, determined])
        )
        along = np.linalg.qr(white[:, 1:])[0]
        found = np.zeros(self.used.shape)
        found[self.used] = white[:, 0] - along @ (along.T @ white[:, 0])
        return found, len(white) - along.shape[1]

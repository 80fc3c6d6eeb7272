"""From y on a strip to what the closed forms know of it, and back: the resistance from its grounded end.

The closed forms of `closed_form` hold on a strip of any width b(y) where y is replaced by L s, s = R(y) / R(L) the
accumulated resistance. Contact resistance eats from either end of the contact a resistance T. With lambda the same
everywhere (both layers as wide) it follows from

    (b d')' = b d / lambda^2 on the contact, d' = -1/b at both ends, T_l = d(l), T_u = -d(u)

With D = d sqrt(b) it is D'' = D (1 / lambda^2 + (sqrt b)'' / sqrt b), which is solved here with the bracket as it is
within T of either end. On even strips that is exact: T = lambda tanh(w / 2 lambda) / b.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import width_from_ideal
from tacstrip.sensor.spec import Sensor
from tacstrip.sensor.surface import Surface

_STEPS = 40  # of Newton's method; mostly five
_SLOPE = 1e-6  # of the strip's length: step of differences


def electrical_ends(
    sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray, x_mm: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Return l and u [mm] of the even strip that reads the same by closed forms, and its lambda [mm].

    l and u are of any shape; their last axis is that of x [mm] in strip coordinates, the sensor's centre lines by
    default, which counts where strips lie along parallels, each as long as its own.
    """
    l, u = np.asarray(l_mm, dtype=float), np.asarray(u_mm, dtype=float)
    surface, lam = sensor.surface, sensor.contact_lambda_mm
    if surface is None:
        return l, u, lam
    if surface.along == "parallels":
        stretch = sensor.length_mm / _lengths(sensor, surface, x_mm)
        lost = lam * np.tanh((u - l) / (2.0 * lam)) if lam else 0.0
        return np.asarray((l + lost) * stretch), np.asarray((u - lost) * stretch), 0.0
    low, high = surface.accumulated_resistance(l), surface.accumulated_resistance(u)
    if lam:
        lost_low, lost_high = _lost(surface, l, u, lam)
        low, high = low + lost_low, high - lost_high
    return low * sensor.length_mm, high * sensor.length_mm, 0.0


def _lengths(sensor: Sensor, surface: Surface, x_mm: FloatArray | None) -> FloatArray:
    """Return how long strips along parallels at x are [mm]."""
    return np.asarray(surface.meridian(sensor.x_mm if x_mm is None else x_mm)[0] * surface.around)


def ends_from_electrical(
    sensor: Sensor, low_mm: FloatArray, high_mm: FloatArray, x_mm: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return l and u [mm] on the strips, the inverse of `electrical_ends`; what lies beyond is held at the ends."""
    surface, lam, length = sensor.surface, sensor.contact_lambda_mm, sensor.length_mm
    assert surface is not None
    low, high = np.clip(low_mm, 0.0, length) / length, np.clip(high_mm, 0.0, length) / length
    parallels = surface.along == "parallels"
    longest = _lengths(sensor, surface, x_mm) if parallels else np.asarray(length)
    l, u = (
        (low * longest, high * longest)
        if parallels
        else (surface.accumulated_inverse(low), surface.accumulated_inverse(high))
    )
    if lam == 0.0:
        return np.asarray(l), np.asarray(u)
    # Start from the even strip's answer; then Newton in both ends, on differences.
    middle, half = 0.5 * (l + u), 0.5 * width_from_ideal(np.maximum(u - l, 0.0), lam)
    l, u = np.maximum(middle - half, 0.0), np.minimum(middle + half, longest)
    step = _SLOPE * length
    for _ in range(_STEPS):
        here = electrical_ends(sensor, l, u, x_mm)
        off_l, off_u = low * length - here[0], high * length - here[1]
        by_l, by_u = (electrical_ends(sensor, l + i * step, u + (1 - i) * step, x_mm) for i in (1, 0))
        a, c = ((end - at) / step for end, at in zip(by_l[:2], here[:2], strict=True))
        b, d = ((end - at) / step for end, at in zip(by_u[:2], here[:2], strict=True))
        det = a * d - b * c
        det = np.where(np.abs(det) < 1e-12, 1e-12, det)
        move_l, move_u = (d * off_l - b * off_u) / det, (a * off_u - c * off_l) / det
        limit = 0.25 * np.maximum(u - l, 4.0 * step)
        l = np.clip(l + np.clip(move_l, -limit, limit), 0.0, longest)
        u = np.clip(np.maximum(u + np.clip(move_u, -limit, limit), l), 0.0, longest)
        if not np.nanmax(np.abs([off_l, off_u]), initial=0.0) > 1e-10 * length:
            break
    return l, u


def electrical_slopes(
    sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray, x_mm: FloatArray | None = None
) -> FloatArray:
    """Return the slopes of `electrical_ends` (2, 2, ...), [end, by l or u]; by differences."""
    step = _SLOPE * sensor.length_mm
    found = []
    for dl, du in ((step, 0.0), (0.0, step)):
        up, down = (electrical_ends(sensor, l_mm + s * dl, u_mm + s * du, x_mm) for s in (1.0, -1.0))
        found.append([(a - b) / (2.0 * step) for a, b in zip(up[:2], down[:2], strict=True)])
    return np.swapaxes(np.array(found), 0, 1)


def _lost(surface: Surface, l: FloatArray, u: FloatArray, lam: float) -> tuple[FloatArray, FloatArray]:
    """Return T at both ends of contacts along meridians, in s."""
    if surface.even:
        lost = np.asarray(lam * np.tanh((u - l) / (2.0 * lam)) / surface.meridian_mm)
        return lost, lost
    reach = lam * np.tanh((u - l) / (2.0 * lam))  # about as far the bracket counts: to the middle at most
    r, _, dr, _ = surface.meridian(np.stack([l, u]))
    inner, _, by, _ = surface.meridian(np.stack([l + reach, u - reach]))
    bend = -1.0 / float(surface.radius_mm or 1.0) ** 2 if surface.kind == "sphere" else 0.0  # r'' / r
    q = np.sqrt(np.maximum(1.0 / lam**2 + 0.5 * bend - 0.25 * (by / inner) ** 2, 1e-6 / lam**2))
    beta_l, beta_u = 0.5 * dr / r
    # D = A c(y) + B s(y), c = cosh(q (y - m)) / cosh(q w / 2) and s = sinh(..) / cosh(..): 1 and -+th at the ends.
    th = np.tanh(0.25 * (q[0] + q[1]) * (u - l))
    left, right = -1.0 / np.sqrt(r)
    a11, a12 = -q[0] * th - beta_l, q[0] + beta_l * th
    a21, a22 = q[1] * th - beta_u, q[1] - beta_u * th
    det = a11 * a22 - a12 * a21
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (left * a22 - right * a12) / det, (a11 * right - a21 * left) / det
    root = np.sqrt(r)
    low, high = (a - b * th) / root[0], -(a + b * th) / root[1]
    low, high = (np.where(u > l, side, np.where(np.isnan(l), np.nan, 0.0)) for side in (low, high))
    return low / surface.resistance, high / surface.resistance

"""Closed forms of chapter 3, forward and back, as plain functions of arrays.

One formula carries all constructions. With rho_0 the resistivity of the energised strip, rho_1 that of
the sensing layer and r = rho_1 / rho_0, the contact is rho_0 r / (1 + r) ohms per length. Let
a = r / (1 + r) and D = L - (1 - a) w; then, over Vref,

    upper end of the sensing strip   (l + a w) / D    (3.5)
    lower end                        l / D            (3.6)

a = 1/2 gives equal strips (3.3), (3.4); a = 0, a metal sheet, makes both of them (3.8).

A contact of finite conductance g per length has the decay length lambda = 1 / sqrt((rho_0 + rho_1) g).
It reads as an ideal contact on [l + T, u - T] with T = lambda tanh(w / (2 lambda)) (docs/decisions/, one closed form).

l, w, L and lambda share one unit; arguments broadcast; NaN (no contact) passes through.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray

_ROUNDING = 16.0 * np.finfo(float).eps  # of Vref
_NEWTON_STEPS = 60  # quadratic: five or six do, more only where w is far below lambda or k near 0


def sensing_share(ratio: float) -> float:
    """Return a = r / (1 + r), the share of a contact's resistance that the energised strip keeps."""
    return ratio / (1.0 + ratio)


def transfer_length(w: FloatArray, contact_lambda: float) -> FloatArray:
    """Return the transfer length T = lambda tanh(w / 2 lambda), lost to contact resistance at each end [unit of w]."""
    if contact_lambda == 0.0:
        return np.zeros_like(w)
    return np.asarray(contact_lambda * np.tanh(w / (2.0 * contact_lambda)))


def fraction(
    l: FloatArray,
    w: FloatArray,
    length: float,
    share: float | FloatArray,
    narrow: float,
    contact_lambda: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return numerator and D of a reading, (3.3) to (3.8) in one; share is a at the upper end, else 0, narrow 1 - a."""
    t = transfer_length(w, contact_lambda)
    ideal = w - 2.0 * t
    return l + t + share * ideal, length - narrow * ideal


def k_h(
    l: FloatArray, w: FloatArray, length: float, ratio: float = 1.0, contact_lambda: float = 0.0
) -> FloatArray:
    """Return k_h, the sensing strip's upper voltage over Vref: (3.3), (3.5).

    Parameters
    ----------
    l, w
        Lower end and length of the contact [mm], any shapes that broadcast.
    length
        Strip length L [mm].
    ratio
        Resistivity of the sensing strip over that of the energised strip.
    contact_lambda
        Decay length of the contact resistance [mm].

    Returns
    -------
    FloatArray
        Over Vref, of the broadcast shape; NaN where l or w is NaN.

    Examples
    --------
    A contact from 20 to 50 mm on a strip of 100 mm:

    >>> import numpy as np
    >>> round(float(k_h(np.array(20.0), np.array(30.0), 100.0)), 6)
    0.411765
    """
    a = sensing_share(ratio)
    return _over_vref(*fraction(l, w, length, a, 1.0 - a, contact_lambda), length)


def k_l(
    l: FloatArray, w: FloatArray, length: float, ratio: float = 1.0, contact_lambda: float = 0.0
) -> FloatArray:
    """Return k_l, the sensing strip's lower voltage over Vref: (3.4), (3.6).

    Arguments and result as for `k_h`.

    Examples
    --------
    >>> import numpy as np
    >>> round(float(k_l(np.array(20.0), np.array(30.0), 100.0)), 6)
    0.235294
    """
    return _over_vref(*fraction(l, w, length, 0.0, 1.0 - sensing_share(ratio), contact_lambda), length)


def k_metal(l: FloatArray, w: FloatArray, length: float, contact_lambda: float = 0.0) -> FloatArray:
    """Return k, the metal sheet's voltage over Vref: (3.8).

    Arguments and result as for `k_h`; NaN, 0 / 0, for a contact of the whole strip length.

    Examples
    --------
    >>> import numpy as np
    >>> round(float(k_metal(np.array(20.0), np.array(30.0), 100.0)), 6)
    0.285714
    """
    with np.errstate(invalid="ignore"):
        return k_l(l, w, length, 0.0, contact_lambda)


def _over_vref(numerator: FloatArray, d: FloatArray, length: float) -> FloatArray:
    """Return numerator / d, with 0 or 1 where only rounding put it beyond; further out, l or w are impossible."""
    with np.errstate(divide="ignore"):  # metal under the whole strip: d = 0, and no k
        k = np.asarray(numerator / d)
        if bool(((k >= 0.0) & (k <= 1.0)).all()):
            return k
        rounding = _ROUNDING * np.maximum(length / np.abs(d), 1.0)  # d is a difference of lengths
    near = (k >= -rounding) & (k <= 1.0 + rounding) & np.isfinite(rounding)
    return np.where(near, np.clip(k, 0.0, 1.0), k)


def end_weights(k: FloatArray, at_upper_end: bool | BoolArray, ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return (c_l, c_u) with c_l l + c_u u = k L and c_l + c_u = 1, for an ideal contact.

    (3.5), (3.6) and (3.8) are each linear in l and u once the reading is known; steps 3 (a), (b), (c) of
    section 4.2.4 are these weights for equal strips, divided by one of them.

    Parameters
    ----------
    k
        A reading over Vref, any shape.
    at_upper_end
        Whether it is the sensing strip's upper end (k_h) or its lower end (k_l, k); broadcasts with k.
    ratio
        Resistivity of the sensing layer over that of the energised strip; 0 for metal.
    """
    a = sensing_share(ratio)
    c_u = (1.0 - a) * k + np.where(at_upper_end, a, 0.0)
    return 1.0 - c_u, c_u


def reading_jacobian(
    k: FloatArray,
    w: FloatArray,
    length: float | FloatArray,
    at_upper_end: bool | BoolArray,
    ratio: float = 1.0,
    contact_lambda: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return dk/dl and dk/du [1/mm] of a reading.

    Parameters
    ----------
    k
        The reading over Vref, from `k_h`, `k_l` or `k_metal`, any shape.
    w
        Length of the contact [mm], of the same shape.
    length, ratio, contact_lambda
        As for `k_h`.
    at_upper_end
        Whether k is the sensing strip's upper end (k_h) or its lower end (k_l, k).
    """
    t = transfer_length(w, contact_lambda)
    d = length - (w - 2.0 * t) / (1.0 + ratio)
    c_l, c_u = end_weights(k, at_upper_end, ratio)
    # c_l l + c_u u = k L is linear in the ideal contact's ends; contact resistance mixes both by dT/dw.
    mix = 0.5 * (1.0 - (t / contact_lambda) ** 2) if contact_lambda else np.zeros_like(t)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (c_l + mix * (c_u - c_l)) / d, (c_u + mix * (c_l - c_u)) / d


def lower_and_width(
    kh: FloatArray, kl: FloatArray, length: float, ratio: float = 1.0, contact_lambda: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Solve k_h and k_l for l and w: (4.36), for unequal strips and contact resistance too.

    Noise can make w negative: nothing is clipped here.

    Examples
    --------
    >>> import numpy as np
    >>> l, w = lower_and_width(np.array(7.0 / 17.0), np.array(4.0 / 17.0), 100.0)
    >>> round(float(l), 6), round(float(w), 6)
    (20.0, 30.0)
    """
    d = length / (1.0 + (kh - kl) / ratio)
    ideal = (1.0 + ratio) / ratio * (kh - kl) * d
    w = width_from_ideal(ideal, contact_lambda)
    return np.asarray(kl * d - (w - ideal) / 2.0), w


def lower_from_width(k: FloatArray, w: FloatArray, length: float, contact_lambda: float = 0.0) -> FloatArray:
    """Solve (3.8) for l where w is known."""
    t = transfer_length(np.asarray(w, dtype=float), contact_lambda)
    return np.asarray(k * (length - w + 2.0 * t) - t)


def width_from_lower(k: FloatArray, l: FloatArray, length: float, contact_lambda: float = 0.0) -> FloatArray:
    """Solve (3.8) for w where l is known; k = 0 says nothing of w (the contact is at the ground): NaN."""
    k, l = np.broadcast_arrays(np.asarray(k, dtype=float), np.asarray(l, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.where(k > 0.0, length - l / k, np.nan)
    if contact_lambda == 0.0:
        return w
    # k (L - w + 2 T) = l + T, that is g(w) = k w + (1 - 2 k) T(w) + l - k L = 0. g grows with w and bends
    # one way on each side of 0, so Newton from 0 finds the root; from (3.8)'s w it diverges where k is small.
    w = np.where(np.isnan(w), w, 0.0)
    for _ in range(_NEWTON_STEPS):
        t = transfer_length(w, contact_lambda)
        slope = 0.5 * (1.0 - (t / contact_lambda) ** 2)  # dT/dw
        step = (k * w + (1.0 - 2.0 * k) * t + l - k * length) / (k + (1.0 - 2.0 * k) * slope)
        w = w - step
        if not np.nanmax(np.abs(step), initial=0.0) > 1e-15 * length:
            break
    return w


def width_from_ideal(ideal: FloatArray, contact_lambda: float) -> FloatArray:
    """Solve w - 2 lambda tanh(w / 2 lambda) = ideal for w; odd in w, so noise below zero stays below."""
    ideal = np.asarray(ideal, dtype=float)
    if contact_lambda == 0.0:
        return ideal
    # With z = w / 2 lambda: z - tanh z = c. Convex for z > 0, and (3 c)^(1/3) lies below the root, as does c.
    c = np.abs(ideal) / (2.0 * contact_lambda)
    z = np.maximum(np.cbrt(3.0 * c), c)
    for _ in range(_NEWTON_STEPS):
        tanh = np.tanh(z)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(z > 0.0, (z - tanh - c) / tanh**2, 0.0)
        z = z - step
        if not np.nanmax(np.abs(step), initial=0.0) > 1e-15 * np.nanmax(z, initial=1.0):
            break
    return np.asarray(np.copysign(2.0 * contact_lambda * z, ideal))

"""Can this polygon be what touched the sensor? A reconstruction asks before it hands one out."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.reconstruction.noise_covariance import signature_advice
from tacstrip.reconstruction.result import Profile, Status
from tacstrip.reconstruction.sections import reading_noise
from tacstrip.sensor.spec import Sensor

_ROUNDING = 1e-6  # of the strip length: off the sensor by less is rounding, not noise


def judge(sensor: Sensor, polygon: FloatArray, weak_x: FloatArray) -> tuple[Status, str]:
    """Return a status and advice for an x-monotone polygon, counter-clockwise from its left-most corner.

    Parameters
    ----------
    sensor
        The sensor, whose length bounds y.
    polygon
        Corners (N, 2) [mm].
    weak_x
        x of the vertices whose kinks hide in the noise [mm].

    Returns
    -------
    tuple
        "too noisy": no such polygon can touch the sensor. "doubtful": it can, but is likely wrong. "ok".
    """
    remedy = f"average more scans, recalibrate, or {signature_advice(sensor)}"
    off = np.maximum(-polygon[:, 1], polygon[:, 1] - sensor.length_mm)
    if off.max() > _ROUNDING * sensor.length_mm:
        where = _at(polygon[off.argmax()])
        return "too noisy", f"a vertex falls off the sensor, at {where}; {remedy}"
    if _chains_cross(polygon):
        return "too noisy", f"the vertices found make no polygon: upper and lower sides cross; {remedy}"
    if len(weak_x):
        kink = f"the kink at x = {weak_x[0]:.6g} mm hides in the noise"
        return "doubtful", f"{kink}: its vertex may be on the other side; {remedy}"
    edge = np.roll(polygon, -1, axis=0) - polygon
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    if turn.min() < 0.0:
        where = _at(np.roll(polygon, -1, axis=0)[turn.argmin()])
        corner = f"the corner at {where} is not convex, which Vertex Reconstruction assumes"
        return "doubtful", f"{corner}; {remedy}"
    return "ok", ""


def judge_fit(
    sensor: Sensor, signature: str, profile: Profile, k: FloatArray, x: FloatArray
) -> tuple[Status, str]:
    """Ask whether a polygon makes the signature that was measured: with a corner too few it does not.

    Parameters
    ----------
    sensor, signature
        What was measured.
    profile
        The polygon on the touched strips: x, l and u (strips,) [mm].
    k
        The readings (strips,).
    x
        The vertices' x [mm].

    Returns
    -------
    tuple
        "doubtful" where an end vertex lies beside the contact, or where the readings are further from the polygon's
        than their noise explains; "ok".
    """
    strips, l, u = profile
    outside = np.maximum(strips[0] - x, x - strips[-1])
    if outside.max() > (1.0 + _ROUNDING) * sensor.pitch_mm:
        far = f"the vertex at x = {x[outside.argmax()]:.6g} mm lies beside the touched strips"
        return "doubtful", f"{far} ({strips[0]:.6g} to {strips[-1]:.6g} mm); give transitions within them"
    off = k - signatures(sensor, l, u)[signature]
    misfit = float(np.sqrt(np.mean(off**2)))
    # The noise is estimated from as many strips, to some 3 / sqrt(n), and a little high on curved signatures.
    if misfit > (1.15 + 3.0 / np.sqrt(len(k))) * reading_noise(k) + _ROUNDING:
        said = f"the polygon's readings are {100.0 * misfit:.2g} % of Vref from the measured ones"
        cause = "a corner may be missing, or the object is not convex"
        return "doubtful", f"{said}: {cause}; give the transitions by hand, or {signature_advice(sensor)}"
    return "ok", ""


def _at(corner: FloatArray) -> str:
    return f"x = {corner[0]:.6g}, y = {corner[1]:.6g} mm"


def _chains_cross(polygon: FloatArray) -> bool:
    """Whether the upper chain falls to the lower one, or below it, between the end corners."""
    right = int(polygon[:, 0].argmax())
    low, high = polygon[: right + 1], np.concatenate([polygon[right:], polygon[:1]])[::-1]
    x = np.delete(polygon[:, 0], [0, right])
    return bool(np.any(np.interp(x, *high.T) <= np.interp(x, *low.T)))

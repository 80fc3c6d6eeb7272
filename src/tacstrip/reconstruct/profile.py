"""Profile Reconstruction (thesis, 4.3): l and u of every strip from both signatures, concave shapes too."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.errors import SignatureError
from tacstrip.reconstruct.result import Reconstruction, RecoveredObject, Status, close_chains
from tacstrip.scan import Scan
from tacstrip.sensor.circuit import lower_and_width
from tacstrip.sensor.spec import Sensor

_ROUNDING = 1e-9  # of the strip length
_NOISE = 0.02  # of Vref: twice P.U. profile II, which a contact without width may show


def profile_reconstruction(scan: Scan, sensor: Sensor) -> Reconstruction:
    """Recover the profile of each run of touched strips: (4.36), strip by strip.

    Its polygon joins (x, l) left to right and (x, u) back. Noise that makes u fall below l, or either
    leave the sensor, is held at the bound.

    Raises
    ------
    SignatureError
        The sensor or the scan has only one signature; `vertex_reconstruction` is for that.
    ReadingError
        The scan is not of this sensor.
    """
    scan.check(sensor)
    have = scan.signatures
    if not {"kh", "kl"} <= set(have):
        raise SignatureError(
            f"Profile Reconstruction needs kh and kl; this {sensor.construction} scan has only "
            f"{', '.join(have)}. Use Vertex Reconstruction"
        )
    l, u = profile(sensor, scan["kh"], scan["kl"])
    return Reconstruction(
        "profile", tuple(_object(sensor, run, scan, l, u) for run in scan.runs()), scan.time_s
    )


def profile(sensor: Sensor, kh: FloatArray, kl: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return l and u [mm] of readings of any shape, held to 0 <= l <= u <= L; NaN stays NaN."""
    l, w = lower_and_width(kh, kl, sensor.length_mm, sensor.sensing_ratio, sensor.contact_lambda_mm)
    middle = l + 0.5 * w
    half = 0.5 * np.maximum(w, 0.0)
    return np.clip(middle - half, 0.0, sensor.length_mm), np.clip(middle + half, 0.0, sensor.length_mm)


def profile_at(recovered: RecoveredObject, original_vertices: npt.ArrayLike) -> FloatArray:
    """Return the recovered profile at the original's vertex columns, as a polygon (N, 2) [mm].

    Each vertex of the original is read on its own chain at the nearest strip; the left-most and the
    right-most vertex, where l = u, in the middle of both. The measures of tables 5.8-5.11 must mean this
    polygon: the jags of a noisy raw profile swamp any turning function.

    Raises
    ------
    SignatureError
        The object has no profile.
    """
    if recovered.profile is None:
        raise SignatureError("the object has no profile")
    v = np.asarray(original_vertices, dtype=float)
    x, l, u = recovered.profile
    nearest = np.abs(x[:, None] - v[:, 0]).argmin(axis=0)
    left, right = v[:, 0].argmin(), v[:, 0].argmax()
    area2 = (v[:, 0] * np.roll(v[:, 1], -1) - np.roll(v[:, 0], -1) * v[:, 1]).sum()
    order = np.arange(len(v)) if area2 > 0.0 else np.arange(len(v))[::-1]
    steps = np.roll(order, -int(np.flatnonzero(order == left)[0]))  # counter-clockwise from the left end
    turn = int(np.flatnonzero(steps == right)[0])
    y = np.empty(len(v))
    y[steps[:turn]], y[steps[turn:]] = l[nearest[steps[:turn]]], u[nearest[steps[turn:]]]
    y[[left, right]] = 0.5 * (l + u)[nearest[[left, right]]]
    return np.stack([x[nearest], y], axis=1)


def _object(sensor: Sensor, run: slice, scan: Scan, l: FloatArray, u: FloatArray) -> RecoveredObject:
    x, low, high = sensor.x_mm[run], l[run], u[run]
    status, advice = _plausible(x, scan["kh"][run], scan["kl"][run])
    if len(x) < 2:
        where = f"x = {x[0]:.6g} mm, from y = {low[0]:.6g} to {high[0]:.6g} mm"
        advice = advice or f"one strip is touched, at {where}: an interval, not a shape"
        return RecoveredObject(run, profile=(x, low, high), status="too few strips", advice=advice)
    if (high - low).max() <= _ROUNDING * sensor.length_mm:
        advice = advice or "the contact has no width on any strip: a line, given as its profile"
        return RecoveredObject(run, profile=(x, low, high), status="too few strips", advice=advice)
    vertices = close_chains(np.stack([x, low], axis=1), np.stack([x, high], axis=1))
    return RecoveredObject(run, vertices, (x, low, high), None, status, advice)


def _plausible(x: FloatArray, kh: FloatArray, kl: FloatArray) -> tuple[Status, str]:
    """Doubt readings that no contact makes: the current flows down, so k_h is never below k_l."""
    wrong = np.flatnonzero(kl - kh > _NOISE)
    if not len(wrong):
        return "ok", ""
    where = ", ".join(f"{at:.6g}" for at in x[wrong[:5]]) + (", ..." if len(wrong) > 5 else "")
    found = f"k_h is below k_l on {len(wrong)} of {len(x)} strips (x = {where} mm), which no contact makes"
    return "doubtful", f"{found}: are v_h and v_l exchanged there, or is a channel stuck?"

"""Profile Reconstruction (thesis, 4.3): l and u of every strip from both signatures, concave shapes too."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, SignatureError
from tacstrip.geometry.outline import distinct
from tacstrip.network.crp.mesh import Wiring
from tacstrip.reconstruction.contact_ends import Ends, ends
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.on_surface import on_surface
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject, Status
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_ROUNDING = 1e-9  # of the strip length
_NOISE = 0.02  # of Vref: twice P.U. profile II, which a contact without width may show


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def profile_reconstruction(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None = None,
    *,
    convex: bool = False,
    wiring: Wiring | None = None,
) -> Reconstruction:
    """Recover the profile of each run of touched strips: (4.36), strip by strip.

    Its polygon joins (x, l) left to right and (x, u) back. Noise that makes u fall below l, or either
    leave the sensor, is held at the bound. A strip with one reading of two has no l and u of its own: the profile
    passes over it, from neighbour to neighbour. CRS-CRP has no closed form: all strips are solved together on the
    network (`network.crp`), from all of the sheet's electrodes where the scan has them.

    Parameters
    ----------
    scan, sensor
        What was measured, by what.
    noise
        The readings' errors if they are known; the objects then have a covariance, up to 4000 vertices.
    convex
        CRS-CRP: take every run of strips for one convex contact; less noise where that is true.
    wiring
        CRS-CRP: what strips and edges are joined to; nothing by default.

    Raises
    ------
    SignatureError
        The sensor or the scan has only one signature; `vertex_reconstruction` is for that.
    OptionError
        `convex` or `wiring` for another construction than CRS-CRP.
    ReadingError
        The scan is not of this sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> x, l, u = ts.profile_reconstruction(ts.simulate(sensor, contact), sensor).objects[0].profile
    >>> x[35], round(l[35], 6), round(u[35], 6)
    (np.float64(55.5), np.float64(20.6), np.float64(67.5))
    """
    scan = scan.checked(sensor)
    have = scan.signatures
    if not {"kh", "kl"} <= set(have):
        raise SignatureError(
            f"Profile Reconstruction needs kh and kl; this {sensor.construction} scan has only "
            f"{', '.join(have)}. Use Vertex Reconstruction"
        )
    if sensor.kind.closed_form and (convex or wiring is not None):
        raise OptionError(
            f"convex and wiring are for crs-crp sensors, not for a {sensor.construction} sensor"
        )
    noise = sensor.noise if noise is None else noise
    if sensor.surface is not None:
        return on_surface(scan, sensor, lambda scan, even: profile_reconstruction(scan, even, noise))
    sigma = None if noise is None else reading_sigma(noise, sensor)
    found = ends(scan, sensor, sigma, convex, wiring)
    objects = tuple(_object(sensor, run, scan, found) for run in scan.runs())
    return doubt_implausible(Reconstruction("profile", objects, scan.time_s), scan, sensor)


@takes(recovered=RecoveredObject)
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


def _object(sensor: Sensor, run: slice, scan: Scan, found: Ends) -> RecoveredObject:
    there = np.isfinite(found.l[run])
    x, low, high = sensor.x_mm[run][there], found.l[run][there], found.u[run][there]
    profile = (x, low, high)
    own = found.strip_status[run]
    if not len(x):
        alone = "no strip has both readings, which l and u need: use the polygon fit"
        return RecoveredObject(run, status="too few strips", advice=alone)
    read = (scan[name][run][there] for name in ("kh", "kl"))
    status, advice = _told(x, own, found.advice) if own else _plausible(x, *read)
    if len(x) < 2 or (high - low).max() <= _ROUNDING * sensor.length_mm:
        where = f"x = {x[0]:.6g} mm, from y = {low[0]:.6g} to {high[0]:.6g} mm"
        one = f"one strip is touched, at {where}: an interval, not a shape"
        line = "the contact has no width on any strip: a line, given as its profile"
        advice = advice or (one if len(x) < 2 else line)
        return RecoveredObject(run, profile=profile, status="too few strips", advice=advice, strip_status=own)
    ring = np.concatenate([np.stack([x, low], axis=1), np.stack([x, high], axis=1)[::-1]])
    keep = distinct(ring)
    strips = np.arange(run.start, run.stop)[there]
    which = np.concatenate([strips, sensor.strips + strips[::-1]])[keep]
    return RecoveredObject(run, ring[keep], profile, found.covariance_of(which), status, advice, own)


def _told(x: FloatArray, own: tuple[str, ...], advice: str) -> tuple[Status, str]:
    """Sum up what the network's inversion says of each strip."""
    if "not converged" in own:
        return "doubtful", advice
    short = [float(at) for at, status in zip(x, own, strict=True) if status == "short contact"]
    if len(short) == len(own):
        why = "every strip is touched over less than 5 % of its length: l and u are poorly known"
        return "short contact", why
    if not short:
        return "ok", advice
    where = ", ".join(f"{at:.6g}" for at in short[:5]) + (", ..." if len(short) > 5 else "")
    told = f"short contact (w < 5 % of L) on {len(short)} of {len(own)} strips, x = {where} mm"
    return "ok", f"{told}: l and u are poorly known there"


def _plausible(x: FloatArray, kh: FloatArray, kl: FloatArray) -> tuple[Status, str]:
    """Doubt readings that no contact makes: the current flows down, so k_h is never below k_l."""
    wrong = np.flatnonzero(kl - kh > _NOISE)
    if not len(wrong):
        return "ok", ""
    where = ", ".join(f"{at:.6g}" for at in x[wrong[:5]]) + (", ..." if len(wrong) > 5 else "")
    found = f"k_h is below k_l on {len(wrong)} of {len(x)} strips (x = {where} mm), which no contact makes"
    return "doubtful", f"{found}: are v_h and v_l exchanged there, or is a channel stuck?"

"""The best estimate that the readings allow: a polygon fitted to all strips by least squares.

The vertices' number is chosen by a criterion, their places by the fit, and the covariance says how sure they are.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.reconstruct.bound import reading_sigma, with_ends
from tacstrip.reconstruct.ends import closed_ends
from tacstrip.reconstruct.outline import Outline
from tacstrip.reconstruct.polygon_fit import information_root, thickness, untangled
from tacstrip.reconstruct.polygon_moves import MOST
from tacstrip.reconstruct.polygon_run import RunFit, fit_run, one_shape
from tacstrip.reconstruct.polygon_signal import FLOOR
from tacstrip.reconstruct.polygon_verdict import judge
from tacstrip.reconstruct.result import Profile, Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES, check_closed_form
from tacstrip.sensor.spec import Sensor

_BRIDGED = 3  # strips that may be missing inside a contact
_THIN = 1e-6  # of the strip length: thinner is a line
_FEW = 50  # scans that are done before other processes have begun
_NAMED = 5  # strips that advice names


def fit_polygon(scan: Scan, sensor: Sensor, noise: Noise | None = None, most: int = MOST) -> Reconstruction:
    """Recover a polygon from each contact by least squares over all strips and all signatures of the scan.

    Parameters
    ----------
    scan, sensor
        What was measured, with what. From one signature the polygon is convex; from k_h and k_l it is
        x-monotone, and its ends may be vertical edges.
    noise
        Of the readings; the A/D converter's steps come on top. None: estimated from what the fit leaves over.
    most
        Vertices at most, those at the ends not counted.

    Returns
    -------
    Reconstruction
        Objects with vertices, covariance, profile, status and advice. Outliers are left out and named; up to
        three strips that read nothing inside a contact are bridged.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, or the construction has no closed form.
    """
    scan.check(sensor)
    check_closed_form(sensor.kind, "fit_polygon")
    return Reconstruction(
        "polygon",
        tuple(_object(scan, sensor, c, noise) for c in _contacts(scan, sensor, noise, most)),
        scan.time_s,
    )


def fit_polygons(
    scans: Sequence[Scan], sensor: Sensor, noise: Noise | None = None, workers: int | None = None
) -> list[Reconstruction]:
    """Fit many scans on all cores, or on `workers` of them; arguments and errors as for `fit_polygon`.

    By processes where this one can be forked; else by threads, which share the time outside the compiled kernels.
    """
    count = workers or os.cpu_count() or 1
    fit = partial(fit_polygon, sensor=sensor, noise=noise)
    if count == 1 or len(scans) < _FEW:
        return [fit(scan) for scan in scans]
    fork = "fork" in multiprocessing.get_all_start_methods() and threading.active_count() == 1
    if not fork:
        with ThreadPoolExecutor(count) as threads:
            return list(threads.map(fit, scans))
    with ProcessPoolExecutor(count, multiprocessing.get_context("fork")) as processes:
        return list(processes.map(fit, scans, chunksize=max(len(scans) // (8 * count), 1)))


def fitted_transitions(
    scan: Scan, sensor: Sensor, signature: str, noise: Noise | None = None
) -> list[FloatArray]:
    """Return the x [mm] of all vertices, ends included and ascending, of the polygon fitted to each run of strips.

    Only one signature is used, as Vertex Reconstruction does. A run with too few strips gives its two ends.
    """
    scan.check(sensor)
    check_closed_form(sensor.kind, "fit_polygon")
    name, sigma = sensor.check_signature(signature), _sigma(noise, sensor)
    found = []
    for run in scan.runs():
        of_run = fit_run(sensor, sensor.x_mm[run], {name: scan[name][run]}, sigma)
        x = np.array([0.0, 1.0]) if of_run.fits is None else of_run.fits.chosen.transitions
        found.append(x * of_run.signal.width_mm + of_run.signal.origin_mm)
    return found


@dataclass(frozen=True, eq=False)
class _Contact:
    """Strips that belong to one contact, those missing inside it, and its fit."""

    strips: slice
    missing: tuple[int, ...]
    run: RunFit


def _contacts(scan: Scan, sensor: Sensor, noise: Noise | None, most: int) -> list[_Contact]:
    sigma = _sigma(noise, sensor)

    def fit(strips: slice) -> RunFit:
        readings = {name: scan[name][strips] for name in scan.signatures}
        return fit_run(sensor, sensor.x_mm[strips], readings, sigma, most)

    found: list[_Contact] = []
    for strips in scan.runs():
        contact = _Contact(strips, (), fit(strips))
        if found and strips.start - found[-1].strips.stop <= _BRIDGED:
            before = found[-1]
            both = slice(before.strips.start, strips.stop)
            joint = fit(both)
            if one_shape(before.run, contact.run, joint):
                gap = range(before.strips.stop, strips.start)
                contact = _Contact(both, (*before.missing, *gap), joint)
                found.pop()
        found.append(contact)
    return found


def _sigma(noise: Noise | None, sensor: Sensor) -> float | None:
    return None if noise is None else max(reading_sigma(noise, sensor), FLOOR)


def _object(scan: Scan, sensor: Sensor, contact: _Contact, noise: Noise | None) -> RecoveredObject:
    strips, run = contact.strips, contact.run
    notes = _notes(scan, sensor, contact)
    if run.fits is None:
        few = f"{strips.stop - strips.start} strips are touched, too few for a polygon: use finer strips"
        advice = "; ".join([few, *notes])
        return RecoveredObject(
            strips, profile=_raw_profile(scan, sensor, strips), status="too few strips", advice=advice
        )
    x = sensor.x_mm[strips]
    if run.oval is not None and run.round:
        lower, upper, covariance = run.oval.outline(run.signal)
        outline = Outline(lower, upper)
    else:
        lower, upper = untangled(*run.fits.chosen.polygon(run.signal))
        if thickness(lower, upper) <= _THIN * sensor.length_mm:
            line = "no kink and no width stand out of the noise: a line, given as its profile"
            profile = (x, np.interp(x, *lower.T), np.interp(x, *upper.T))
            return RecoveredObject(
                strips, profile=profile, status="too few transitions", advice="; ".join([line, *notes])
            )
        outline = Outline(lower, upper)
        covariance = with_ends(outline, sensor, information_root(run.fits.chosen, run.signal))
    status, advice = judge(run, noise.distribution if noise else None, outline.vertices, covariance)
    profile = (x, np.interp(x, *lower.T), np.interp(x, *upper.T))
    advice = "; ".join(n for n in (advice, *notes) if n)
    return RecoveredObject(strips, outline.vertices, profile, covariance, status, advice)


def _raw_profile(scan: Scan, sensor: Sensor, strips: slice) -> Profile | None:
    """Return the contact strip by strip, which needs both signatures."""
    if not {"kh", "kl"} <= set(scan.signatures):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):  # k_l far above k_h: no contact makes it
        l, u = closed_ends(sensor, scan["kh"][strips], scan["kl"][strips])
    return (sensor.x_mm[strips], l, u) if np.isfinite(l + u).all() else None


def _notes(scan: Scan, sensor: Sensor, contact: _Contact) -> list[str]:
    """Name the strips that were bridged, and the readings that were left out."""
    notes, base = [], sensor.strip_base
    if contact.missing:
        names = _list([str(i + base) for i in contact.missing])
        notes.append(f"strip {names} reads nothing inside the contact and was bridged: is it broken?")
    left_out = np.argwhere(contact.run.left_out)
    if len(left_out):
        names = _list(
            [
                f"{i + contact.strips.start + base} ({SIGNATURES[scan.signatures[s]].symbol} = "
                f"{scan[scan.signatures[s]][i + contact.strips.start]:.3g})"
                for s, i in left_out
            ]
        )
        notes.append(f"strip {names} does not fit its neighbours and was left out: is a channel stuck?")
    return notes


def _list(names: list[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")

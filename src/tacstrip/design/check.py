"""What fits of simulated scans really reach on a design, beside the bound: the bound alone is missed by some part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.design.area import is_round
from tacstrip.design.limits import checked_noise
from tacstrip.geometry.moments import area
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_rms
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate


@dataclass(frozen=True, eq=False)
class Check:
    """Fits of one object at random places.

    Attributes
    ----------
    bound_mm
        RMS corner error of each placement at the Cramer-Rao bound (N,) [mm].
    rms_mm
        That of its fit (N,) [mm]; inf without an outline, or with another number of corners. Of a round outline NaN.
    area_percent
        The area's error (N,), without sign; inf without an outline.
    ok
        Which fits are "ok" (N,).
    """

    bound_mm: FloatArray
    rms_mm: FloatArray
    area_percent: FloatArray
    ok: BoolArray


def check(
    sensor: Sensor,
    outline: Outline,
    noise: Noise,
    placements: int,
    seed: int = 0,
    progress: Callable[[], object] = lambda: None,
) -> Check:
    """Simulate an object at random places wholly on a sensor, turned as it is, and fit it, the number of corners told.

    Parameters
    ----------
    sensor, outline, noise
        As of `limits`; of a round outline (`design.area.is_round`) no number of corners is told.
    placements
        How many.
    seed
        Of places and errors.
    progress
        Called after each fit.

    Raises
    ------
    OptionError
        Nothing limits the readings, or the construction has no closed form.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> outline = ts.Outline.of([(22, 18), (70, 34), (62, 72), (30, 66)])
    >>> found = check(sensor, outline, ts.Noise(positional=0.002), 5)
    >>> bool(np.median(found.rms_mm) < 1.0), found.ok.shape
    (True, (5,))
    """
    check_closed_form(sensor.kind, "check")
    sigma, corners = checked_noise(sensor, noise), None if is_round(outline) else len(outline.vertices)
    low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
    random = np.random.default_rng(seed)
    moves = random.uniform(-low, np.array([sensor.width_mm, sensor.length_mm]) - high, (placements, 2))
    rows = []
    for number, (dx, dy) in enumerate(moves.tolist()):
        true = outline.moved(dx, dy)
        bound = math.nan if corners is None else vertex_rms(vertex_covariance(true, sensor, sigma))
        contact = Contact.polygon(true.vertices)
        scan = simulate(sensor, contact, noise, rng=np.random.default_rng([seed, number]))
        found = [o for o in fit_polygon(scan, sensor, noise, vertices=corners).objects if o.found]
        rms, off, good = math.nan if corners is None else math.inf, math.inf, False
        if len(found) == 1:
            whole = area(true.vertices)
            off, good = 100.0 * abs(found[0].area / whole - 1.0), found[0].status == "ok"
            if corners is not None:
                rms = _corner_rms(true.vertices, found[0].vertices)
        rows.append((bound, rms, off, good))
        progress()
    bounds, errors, areas, ok = np.array(rows, dtype=float).reshape(-1, 4).T
    return Check(bounds, errors, areas, ok > 0.0)


def _corner_rms(true: FloatArray, found: FloatArray) -> float:
    """Return the RMS distance of corners, paired in their order round the outline; inf where they are not as many."""
    if len(true) != len(found):
        return math.inf
    off = [np.square(np.roll(found, shift, axis=0) - true).sum(axis=1).mean() for shift in range(len(true))]
    return math.sqrt(min(off))

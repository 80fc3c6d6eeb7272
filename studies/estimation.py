"""The polygon fit on voltages that its own closed forms did not make: real strips, read by networks.

A fit tested on readings from the formulas it inverts flatters itself (an "inverse crime"). Here the readings come from
networks of resistors with contact resistance, uneven strips and strips of finite width; the fit knows of contact
resistance and of the width at most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise, add_reading_errors, digitise
from tacstrip.contact.shape import Contact
from tacstrip.geometry.outline import Outline
from tacstrip.network.imperfections import Imperfections
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.network.strips.resolved import wide_readings
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

SENSOR = Sensor(
    construction="crs-crs",
    strips=100,
    pitch_mm=3.25,
    length_mm=325.0,
    strip_width_mm=3.0,
    contact_lambda_mm=2.0,
    adc_bits=12,
)
UNEVEN, PIECES = 0.05, 13  # resistivity of each piece of each strip: uniform within +-5 % of nominal
NOISES = (0.001, 0.002, 0.005, 0.01)
REGION = 5.991  # chi square of two numbers at 95 %
_ACROSS = 4  # cells over a strip's width, two per lambda: 4e-5 of Vref from 32 of them
_CORNERS, _LEAST_GAP = (3, 6), 0.12  # of the contact's width
_ON = 1e-6  # mm: a vertex on the edge of its region

# Which units there are, and what the fit knows of lambda and of the strips' width.
UNITS: dict[str, tuple[str, float, bool]] = {
    "lambda": ("lambda", 2.0, False),
    "lambda, given 0": ("lambda", 0.0, False),
    "uneven": ("uneven", 2.0, False),
    "width": ("width", 2.0, False),
    "width, given": ("width", 2.0, True),
    "all": ("all", 2.0, False),
    "all, given": ("all", 2.0, True),
    "all, given 0": ("all", 0.0, False),
}


@dataclass(frozen=True, eq=False)
class RealContact:
    """A polygon, and what the units read of it without noise.

    Attributes
    ----------
    truth
        Its vertices (N, 2) [mm], counter-clockwise from the left-most.
    readings
        Unit to signature to (strips,) [Vref]: "lambda" has contact resistance and no more; "uneven" and "width" have
        uneven strips, or strips of finite width, too; "all" has both, their effects added.
    """

    truth: FloatArray
    readings: dict[str, dict[str, FloatArray]]


@dataclass(frozen=True)
class Outcome:
    """How the fit did on one unit.

    Attributes
    ----------
    right
        Share of scans with one object of the right number of vertices.
    rms_mm, of_bound
        Root mean square error of the vertices [mm] where that was so, and over the Cramer-Rao bound's.
    inside, ends
        Share of the true vertices in their 95 % regions: of all, and of the left and the right end.
    doubtful
        Share of scans whose status is not "likely".
    empty
        Share of scans of which no polygon stays within the noise's bound; NaN where none was looked for.
    silent
        Share of scans with status "likely", but the wrong vertices, or a true one outside of its guaranteed region
        (without a bound: outside of its 95 % region five times over).
    """

    right: float
    rms_mm: float
    of_bound: float
    inside: float
    ends: float
    doubtful: float
    empty: float
    silent: float


def real_contacts(contacts: int, seed: int = 0, wide: bool = True) -> list[RealContact]:
    """Draw polygons and have networks read them; without strips of finite width that takes 0.1 s each, not 2 s."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(contacts):
        truth = _polygon(random)
        contact = Contact.polygon(truth)
        shape = (2, SENSOR.strips, PIECES)
        energised, sensing = 1.0 + UNEVEN * random.uniform(-1.0, 1.0, shape)
        plain = fast_readings(SENSOR, contact)
        readings = {
            "lambda": plain,
            "uneven": fast_readings(SENSOR, contact, Imperfections(energised, sensing)),
        }
        if wide:
            readings["width"] = wide_readings(SENSOR, contact, across=_ACROSS)
            # A strip's edge may be touched where its centre line is not: no more is known of it.
            readings["all"] = {
                name: k + np.nan_to_num(readings["uneven"][name] - plain[name])
                for name, k in readings["width"].items()
            }
        found.append(RealContact(truth, readings))
    return found


def outcome(
    contacts: Sequence[RealContact],
    unit: str,
    noise: Noise,
    known: bool = True,
    bounded: bool = False,
    names: Sequence[str] = ("kh", "kl"),
    draws: int = 3,
) -> Outcome:
    """Add noise to what a unit of `UNITS` read, fit, and compare with the truth.

    Parameters
    ----------
    contacts, unit
        What was read by what.
    noise, known
        Of the readings, and whether the fit knows it.
    bounded
        Whether the fit uses that uniform noise has a bound.
    names
        Signatures that it gets.
    draws
        Of the noise per contact.
    """
    readings_of, known_lambda, wide = UNITS[unit]
    width = SENSOR.strip_width if wide else None
    sensor = replace(SENSOR, contact_lambda_mm=known_lambda, strip_width_mm=width)
    sigma = reading_sigma(noise, SENSOR)
    random = np.random.default_rng(0)
    right, squares, bounds, inside, ends, doubtful, empty, silent = ([] for _ in range(8))
    for contact in contacts:
        bound = np.trace(vertex_covariance(Outline.of(contact.truth), SENSOR, sigma, names))
        for _ in range(draws):
            scan = _scan(contact.readings[readings_of], noise, random, names)
            found = fit_polygon(scan, sensor, noise if known else None, bounded=bounded, assessment="none")
            first = found.objects[0]
            right.append(len(found.objects) == 1 and first.vertices.shape == contact.truth.shape)
            doubtful.append(found.status != "likely")
            empty.append(first.guarantee is None)
            distances = _distances(first, contact.truth) if right[-1] else np.array([np.inf])
            if right[-1]:
                squares.append(((first.vertices - contact.truth) ** 2).sum())
                bounds.append(bound)
                inside += list(distances <= REGION)
                ends += [inside[-len(distances)], inside[int(contact.truth[:, 0].argmax()) - len(distances)]]
            off = _off(first, contact.truth) if bounded and right[-1] else distances.max() > 25.0 * REGION
            silent.append(found.status == "likely" and off)
    vertices = len(inside) or np.nan
    return Outcome(
        float(np.mean(right)),
        float(np.sqrt(np.sum(squares) / vertices)),
        float(np.sqrt(np.sum(squares) / np.sum(bounds))) if bounds else np.nan,
        float(np.sum(inside) / vertices),
        float(np.mean(ends)) if ends else np.nan,
        float(np.mean(doubtful)),
        float(np.mean(empty)) if bounded else np.nan,
        float(np.mean(silent)),
    )


def _scan(
    readings: Mapping[str, FloatArray], noise: Noise, random: np.random.Generator, names: Sequence[str]
) -> Scan:
    kh, kl = (
        digitise(add_reading_errors(readings[name], noise, random), SENSOR.adc_bits)
        if name in names
        else None
        for name in ("kh", "kl")
    )
    return Scan(kh=kh, kl=kl)


def _distances(found: RecoveredObject, truth: FloatArray) -> FloatArray:
    """Return how far each vertex is from the truth, squared and over its covariance (N,)."""
    assert found.covariance is not None
    error = found.vertices - truth
    blocks = [found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(error))]
    return np.array([e @ np.linalg.pinv(b, hermitian=True) @ e for e, b in zip(error, blocks, strict=True)])


def _off(found: RecoveredObject, truth: FloatArray) -> bool:
    """Whether a vertex lies outside of its guaranteed region; not where nothing is guaranteed."""
    regions = found.guaranteed or []
    return any(
        shapely.Polygon(region).distance(shapely.Point(vertex)) > _ON
        for region, vertex in zip(regions, truth, strict=False)
    )


def _polygon(random: np.random.Generator) -> FloatArray:
    """Draw a polygon with clear corners, on an ellipse over 40 to 75 strips."""
    while True:
        corners = int(random.integers(_CORNERS[0], _CORNERS[1] + 1))
        angle = 2.0 * np.pi * (np.arange(corners) + random.uniform(-0.2, 0.2, corners)) / corners
        angle += random.uniform(0.0, 2.0 * np.pi)
        half = random.uniform((20.0, 0.1), (37.0, 0.3)) * (SENSOR.pitch_mm, SENSOR.length_mm)
        middle = random.uniform(half, (SENSOR.width_mm, SENSOR.length_mm) - half)
        shape = middle + 0.98 * half * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if np.diff(np.sort(shape[:, 0])).min() >= _LEAST_GAP * np.ptp(shape[:, 0]):
            return Outline.of(shape).vertices

"""What every build of the core must compute to the same bits. Add a case: a function without arguments, under `@case`,
that calls the core as the package does and returns arrays or numbers, always of the same input.

TACSTRIP_CORE names the build; tests/core/test_build_bits.py runs them in a process for each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from hashlib import sha256

import numpy as np
from numpy.typing import ArrayLike

import tacstrip as ts
from polygons import convex_polygon
from tacstrip.core.ellipse import fit_ellipse
from tacstrip.core.library import library
from tacstrip.core.polytope import lowest, walk
from tacstrip.core.problem import FitProblem
from tacstrip.core.search import fit_counts

Case = Callable[[], Iterable[ArrayLike]]
CASES: dict[str, Case] = {}


def case(function: Case) -> Case:
    """Add a case."""
    CASES[function.__name__] = function
    return function


@case
def version() -> Iterable[ArrayLike]:
    core = library()
    assert core is not None
    return [core.tacstrip_core_version()]


@case
def polygon_fits() -> Iterable[ArrayLike]:
    """ModelSelection as users make them, of few and many strips, one signature and both, with their covariances."""
    for seed, strips in enumerate((8, 10, 16, 40, 100, 300)):
        for construction in ("crs-crs", "crs-m"):
            sensor = ts.Sensor(
                construction=construction, strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0
            )
            contact = ts.Contact.polygon(convex_polygon(seed, 4 + seed % 3))
            noise = ts.Noise(positional=0.002)
            for found in ts.fit_polygon(ts.simulate(sensor, contact, noise, rng=seed), sensor, noise).objects:
                yield found.vertices
                if found.covariance is not None:
                    yield found.covariance


@case
def round_contacts() -> Iterable[ArrayLike]:
    """Ellipses, with contact resistance too, and what is left over of readings with faults."""
    for seed, lam in enumerate((0.0, 0.0, 2.0)):
        sensor = ts.Sensor(
            construction="crs-crs", strips=90, pitch_mm=1.0, length_mm=60.0, contact_lambda_mm=lam
        )
        x, random = sensor.x_mm, np.random.default_rng(seed)
        t = (x - x.mean()) / (0.5 * len(x))
        half = 0.2 * np.sqrt(1.0 - t * t)
        empty = FitProblem.of(sensor, x, {"kh": 0.0 * x, "kl": 0.0 * x}, 0.002)
        k = empty.readings_of(0.5 - half, 0.5 + half) + random.normal(0.0, 0.002, (2, len(x)))
        k[0, 30] += 0.1
        problem = FitProblem.of(sensor, x, {"kh": k[0], "kl": k[1]}, 0.002)
        fits = fit_counts(problem, every=True)
        ellipse = fit_ellipse(fits.chosen, problem)
        yield from (fit.theta for fit in fits.fits)
        yield from (fits.scores, ellipse.parameters, ellipse.information, fits.chosen.residuals(problem))


@case
def walks_and_linear_programs() -> Iterable[ArrayLike]:
    random = np.random.default_rng(0)
    a, slack = random.normal(size=(7, 101)), random.uniform(0.5, 1.0, 101)
    pair_a, pair_slack, out = (
        random.normal(size=(7, 9, 2)),
        random.uniform(0.1, 1.0, (9, 2)),
        np.empty((50, 7)),
    )
    at, active = np.zeros(7), np.full(7, -1)
    yield [lowest(form, np.ascontiguousarray(a.T), slack, at, active) for form in random.normal(size=(5, 7))]
    yield at
    walk(a, slack, 0.1 * slack, pair_a, pair_slack, np.zeros(9), random.random((50, 117)), out)
    yield out


def checksums() -> dict[str, str]:
    """Return a checksum of the bytes of each case's results."""
    return {
        name: sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in function())).hexdigest()
        for name, function in CASES.items()
    }

"""What every build of the core must compute to the same bits. Add a case: a function without arguments, under `@case`,
that calls the core as the package does and returns arrays or numbers, always of the same input.

TACSTRIP_CORE names the build; tests/test_build_bits.py runs them in a process for each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from hashlib import sha256

import numpy as np
from numpy.typing import ArrayLike

import tacstrip as ts
from polygons import convex_polygon
from tacstrip.core.library import library

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
    """Fits as users make them, of few and many strips, one signature and both, with their covariances."""
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


def checksums() -> dict[str, str]:
    """Return a checksum of the bytes of each case's results."""
    return {
        name: sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in function())).hexdigest()
        for name, function in CASES.items()
    }

"""The oracle of one signature: its outlines are the hold-out's, and its posterior finds what was drawn."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity

from studies import one_signature_limit as limit
from studies.holdout.readings import Unit
from studies.one_signature_limit import Array

UNIT = Unit(("kh",), 20, 2.0, 60.0)


RING = np.array([(-1.1, -0.4), (0.2, -1.0), (1.3, -0.1), (0.9, 0.8), (-0.6, 0.9)])
FAMILIES = {
    **{name: limit.Family(name, limit.INSIDE, 0, 1.0) for name in limit.KINDS if not name.startswith("over")},
    "triangle": limit.Family("triangle", limit.INSIDE, 3, 1.0),
    "hull": limit.Family("hull", limit.INSIDE, 5, 1.0),
    "one upright side": limit.Family("one upright side", limit.INSIDE, 5, 1.0),
}


def _drawn(family: limit.Family, latent: Array, z: Array) -> Array:
    """Return the outline that some numbers make, as shapely draws it."""
    if family.shape in ("ellipse", "circle"):
        height = np.exp(-1.0 + 1.7 * z[0]) if family.shape == "ellipse" else 1.0
        round_one = affinity.scale(shapely.Point(0, 0).buffer(1.0, quad_segs=200), 1.0, height)
        shape = affinity.rotate(round_one, 0.06 + (0.5 * np.pi - 0.12) * z[1], (0, 0), use_radians=True)
    else:
        points, radius, _ = limit._corners(family, latent)
        shape = shapely.Polygon(points[0]).buffer(radius[0], quad_segs=200)
    if family.shape == "one upright side":
        low, _, high, _ = shape.bounds
        shape = shapely.clip_by_rect(shape, low + (0.15 + 0.35 * z[2]) * (high - low), -9.0, 9.0, 9.0)
        shape = affinity.scale(shape, -1.0 if z[5] < 0.5 else 1.0, 1.0)
    return np.array(shape.exterior.coords)[:-1]


@pytest.mark.parametrize("name", FAMILIES)
def test_an_outline_is_laid_on_the_strips_as_the_hold_out_reads_it(name: str) -> None:
    family, at = FAMILIES[name], np.arange(4.5, 16.0, dtype=np.float64)
    seen = limit.Seen(UNIT, 4, 15, np.zeros(12), 0.001)
    for z in np.random.default_rng(3).random((4, 10)):
        latent = np.concatenate([RING[: family.corners].ravel(), z])[None]
        l, u, _ = limit.laid(seen, family, latent, at)
        outline = _drawn(family, latent, z)
        begin, end = 4.5 - z[6], 15.5 + z[7]
        outline = (outline - outline.min(axis=0)) * (end - begin) / np.ptp(outline[:, 0]) * UNIT.pitch
        part = np.ptp(outline[:, 1]) / UNIT.length
        outline += [begin * UNIT.pitch, (0.02 + 0.96 * z[9]) * (1.0 - part) * UNIT.length]
        low, high = UNIT.touched([outline])
        if part < 1.0:
            np.testing.assert_allclose(l[0] * UNIT.length, low[4:16], atol=2e-3)
            np.testing.assert_allclose(u[0] * UNIT.length, high[4:16], atol=2e-3)


@pytest.mark.parametrize(("place", "lower"), [(limit.INSIDE, 0.0), (limit.BELOW, 20.0)])
def test_the_posterior_of_a_triangle_explains_the_readings(
    monkeypatch: pytest.MonkeyPatch, place: int, lower: float
) -> None:
    """Inside, and over the lower border, where it begins and ends is not where its corners are."""
    monkeypatch.setattr(limit, "_PRIOR", 1500)
    monkeypatch.setattr(limit, "_PARTICLES", 120)
    monkeypatch.setattr(limit, "_SWEEPS", (1, 3))
    triangle = np.array([(9.0, 20.0 - lower), (34.5, 12.0 - lower), (28.0, 45.0 - lower)])
    random, (low, high) = np.random.default_rng(1), UNIT.touched([triangle])
    at = np.flatnonzero(np.isfinite(low))
    read = UNIT.read(low, high)[0, at] + random.normal(0.0, 0.003, len(at))
    seen = limit.Seen(UNIT, int(at[0]), int(at[-1]), read, 0.003)
    some, evidence = limit.posterior(seen, limit.Family("triangle", place, 3, 0.1), random, -np.inf)
    assert np.median(some.misfit) < 0.5 * len(at) + 2.0 * np.sqrt(0.5 * len(at))
    assert np.isfinite(some.log_prior).all()
    assert -60.0 < evidence < 0.0
    oval, worse = limit.posterior(seen, limit.Family("ellipse", place, 0, 0.1), random, evidence - 3.0)
    assert not len(oval.misfit)
    assert worse == -np.inf


def test_silent_shares_follow_from_what_is_said() -> None:
    sure, right = np.array([0.9, 0.8, 0.7, 0.6]), np.array([1.0, 1.0, 0.0, 1.0])
    assert limit.silent(sure, right, right, 0.0) == pytest.approx(0.25)
    assert limit.silent(sure, right, right, 0.33) == pytest.approx(1.0 / 3.0)

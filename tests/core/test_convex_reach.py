"""How far a convex body may reach: the compiled core against NumPy, and both against what is known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.core import convex_reach as module
from tacstrip.core.binding import exported
from tacstrip.core.convex_reach import convex_reach

_EDGES = (0.0, 100.0, 0.0, 100.0)
Readings = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _readings() -> list[Readings]:
    """Return rings of 3 to 20 corners between what 0 to 100 strips read, and others' bodies."""
    random, found = np.random.default_rng(5), []
    for strips in (0, 3, 12, 40, 100):
        for corners in (3, 6, 20):
            angles = np.sort(random.uniform(0.0, 2.0 * np.pi, corners))
            ring = 50.0 + random.uniform(4.0, 15.0) * np.column_stack([np.cos(angles), np.sin(angles)])
            x = np.linspace(2.0, 98.0, strips)
            below, above = random.uniform(5.0, 34.0, strips), random.uniform(66.0, 95.0, strips)
            bodies = random.uniform(5.0, 95.0, (strips // 3, 2))
            bodies = bodies[np.hypot(*(bodies - 50.0).T) > 17.0]
            found.append((ring, np.column_stack([x, below]), np.column_stack([x, above]), bodies))
    return found


@pytest.mark.parametrize("readings", _readings(), ids=lambda r: f"{len(r[1])}-{len(r[0])}")
def test_reach_is_that_of_numpy(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = shapely.Polygon(convex_reach(*readings, _EDGES, 1e-3))
    monkeypatch.setattr(module, "exported", lambda name: None)
    plain = shapely.Polygon(convex_reach(*readings, _EDGES, 1e-3))
    # At a corner rounding says which line stops a ray, and so where thin cones between readings are looked for.
    # By places, for the sanitizers do not bear exceptions of GEOS.
    places = shapely.points(np.random.default_rng(1).uniform(0.0, 100.0, (2000, 2)))
    assert (shapely.contains(compiled, places) != shapely.contains(plain, places)).mean() < 5e-3


def test_what_is_not_reached_contradicts_a_reading_and_hardly_a_place_that_is() -> None:
    """Between the rays a thin cone may be missed."""
    missed, places = 0, np.random.default_rng(0).uniform(0.5, 99.5, (60, 2))
    for ring, below, above, bodies in _readings():
        reached = shapely.Polygon(convex_reach(ring, below, above, bodies, _EDGES, 1e-3))
        shut = [shapely.LineString([p, (p[0], -1e3)]) for p in below]
        shut += [shapely.LineString([p, (p[0], 1e3)]) for p in above] + [shapely.Point(p) for p in bodies]
        for place in shapely.points(places):
            contradicts = shapely.intersects(shut, shapely.MultiPoint(ring).union(place).convex_hull).any()
            if reached.distance(place) > 0.01:
                assert contradicts
            missed += contradicts and reached.contains(place)
    assert missed < 0.02 * len(places) * len(_readings())


@pytest.mark.parametrize("within", [0.01, 1.0, 8.0])
def test_corners_left_out_change_the_reach_by_no_more(within: float, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = exported("convex_reach") is not None
    rings = [[convex_reach(*r, _EDGES, w) for w in (0.0, within)] for r in _readings()]
    monkeypatch.setattr(module, "exported", lambda name: None)
    fewer = 0
    for whole, found in rings:
        if compiled:  # which leaves out nothing at 0, where the plain version leaves out corners of no angle
            np.testing.assert_allclose(found, module._simplified(whole, within), rtol=0.0, atol=1e-12)
        assert shapely.distance(shapely.LinearRing(found), shapely.points(whole)).max() <= 2.0 * within
        fewer += len(found) < len(whole)
    assert fewer > len(rings) // 2

"""The oracle of one signature: its outlines are the hold-out's, and its posterior finds what was drawn."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from studies import one_signature_limit as limit
from studies.holdout.readings import Unit

UNIT = Unit(("kh",), 24, 2.0, 60.0)


@pytest.mark.parametrize("name", limit.SHAPES)
def test_an_outline_is_laid_on_the_strips_as_the_hold_out_reads_it(name: str) -> None:
    random = np.random.default_rng(3)
    seen = limit.Seen(UNIT, 4, 15, np.zeros(12), 0.001)
    shape, z, at = limit.SHAPES.index(name), random.random((4, 32)), np.arange(4.5, 16.0, dtype=np.float64)
    l, u, _ = limit.laid(seen, shape, np.zeros(4, dtype=np.int64), z, at)
    for k, points in enumerate(limit._points(shape, z)[0]):
        outline = np.array(shapely.MultiPoint(points).convex_hull.exterior.coords)[:-1]
        if name == "one upright side":
            low, high = outline[:, 0].min(), outline[:, 0].max()
            kept = shapely.clip_by_rect(
                shapely.Polygon(outline), low + (0.15 + 0.35 * z[k, 3]) * (high - low), -9.0, 9.0, 9.0
            )
            outline = np.array(kept.exterior.coords)[:-1] * [-1.0 if z[k, 28] < 0.5 else 1.0, 1.0]
        begin, end = 4.5 - z[k, 29], 15.5 + z[k, 30]
        outline = (outline - outline.min(axis=0)) * (end - begin) / np.ptp(outline[:, 0]) * UNIT.pitch
        part = np.ptp(outline[:, 1]) / UNIT.length
        outline += [begin * UNIT.pitch, (0.02 + 0.96 * z[k, 31]) * (1.0 - part) * UNIT.length]
        low, high = UNIT.touched([outline])
        if part < 1.0:
            np.testing.assert_allclose(l[k] * UNIT.length, low[4:16], atol=1e-3)
            np.testing.assert_allclose(u[k] * UNIT.length, high[4:16], atol=1e-3)


def test_the_posterior_of_a_triangle_holds_it_and_explains_the_readings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limit, "_PRIOR", 2000)
    monkeypatch.setattr(limit, "_PARTICLES", 150)
    monkeypatch.setattr(limit, "_SWEEPS", 2)
    triangle, random = np.array([(9.0, 20.0), (35.0, 12.0), (28.0, 45.0)]), np.random.default_rng(1)
    low, high = UNIT.touched([triangle])
    at = np.flatnonzero(np.isfinite(low))
    read = UNIT.read(low, high)[0, at] + random.normal(0.0, 0.003, len(at))
    seen = limit.Seen(UNIT, int(at[0]), int(at[-1]), read, 0.003)
    some = limit.posterior(seen, random)
    assert np.median(some.misfit) < 0.5 * len(at) + 2.0 * np.sqrt(0.5 * len(at))
    assert np.isfinite(some.log_prior).all()
    kinds = {limit.SHAPES[k] for k in some.shape}
    assert kinds & {"triangle", "hull"}


def test_silent_shares_follow_from_what_is_said() -> None:
    sure, right = np.array([0.9, 0.8, 0.7, 0.6]), np.array([1.0, 1.0, 0.0, 1.0])
    assert limit.silent(sure, right, right, 0.0) == pytest.approx(0.25)
    assert limit.silent(sure, right, right, 0.33) == pytest.approx(1.0 / 3.0)

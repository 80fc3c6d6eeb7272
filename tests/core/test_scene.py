import numpy as np
import pytest

from layered_scenes import TRIANGLES, two_triangles
from tacstrip.core import scene as module
from tacstrip.core.scene import Scene, plain_equations


@pytest.mark.parametrize(("construction", "lam"), [("crs-crs", 0.0), ("crs-crs", 2.0), ("crs-m", 0.0)])
@pytest.mark.parametrize(("soft_mm", "reach"), [(0.0, 0.0), (1.0, 4.0)])
def test_c_and_numpy_descend_alike(
    monkeypatch: pytest.MonkeyPatch, construction: str, lam: float, soft_mm: float, reach: float
) -> None:
    problem, scene = two_triangles(construction, lam)
    here, there = (problem.refine(scene, steps, soft_mm, reach) for steps in (0, 12))
    monkeypatch.setattr(module, "exported", lambda name: None)
    for compiled, steps in ((here, 0), (there, 12)):
        plain = problem.refine(scene, steps, soft_mm, reach)
        assert plain.cost == pytest.approx(compiled.cost, rel=1e-9)
        np.testing.assert_allclose(plain.scene.corners, compiled.scene.corners, atol=1e-6)
        scale = np.abs(plain.information).max()
        np.testing.assert_allclose(plain.information, compiled.information, atol=1e-6 * scale)


def test_gradient_is_half_the_slope_of_the_cost() -> None:
    problem, scene = two_triangles()
    found = plain_equations(problem.layers, scene, 0.0, 0.0)
    step = 1e-6 * np.eye(scene.corners.size)
    costs = [[problem.fitted(scene.moved(sign * by)).cost for by in step] for sign in (1.0, -1.0)]
    slopes = (np.array(costs[0]) - costs[1]) / 2e-6
    np.testing.assert_allclose(slopes, -2.0 * found.gradient, rtol=1e-4, atol=1e-3 * np.abs(slopes).max())


def test_ends_short_of_touched_strips_and_over_silent_ones_are_charged() -> None:
    problem, _ = two_triangles()
    true = Scene.of([np.array(p) for p in TRIANGLES])
    best = problem.fitted(true).cost
    for grown in (0.7, 1.3):
        other = Scene.of([p.mean(axis=0) + grown * (p - p.mean(axis=0)) for p in true.polygons])
        assert problem.fitted(other).cost > 20.0 * best


def test_some_of_the_strips_lead_a_search_each_once() -> None:
    """Of 24 strips a layer three problems of eight; none of strips that are few already."""
    problem, _ = two_triangles()
    parts = problem.coarser(8)
    assert len(parts) == 3
    for layer, whole in enumerate(problem.layers):
        kept = np.stack([p.layers[layer].problem.weight > 0.0 for p in parts])
        np.testing.assert_array_equal(kept.sum(axis=0), whole.problem.weight > 0.0)
        assert (np.diff(np.flatnonzero(kept[0].any(axis=0))) % 3 == 0).all()
    assert problem.coarser(13) == []

"""Convex chains of one end: the compiled core against NumPy, and both against what is known."""

from __future__ import annotations

import numpy as np
import pytest

from tacstrip.arrays import FloatArray
from tacstrip.core import convex_chain
from tacstrip.core.convex_chain import (
    best_lines,
    convex_cuts,
    convex_regression,
    hull_ends,
    polyline,
    sure_strips,
)

End = tuple[FloatArray, FloatArray, FloatArray]


def _ends() -> list[End]:
    """Return ends of one to a hundred strips: convex chains that take turns, noise, and weights that differ."""
    random, found = np.random.default_rng(4), []
    for n in (1, 2, 3, 5, 12, 40, 100):
        for jumps in (0, 1, 3):
            x = np.linspace(20.0, 18.5 + 1.5 * n, n)
            y = 0.02 * (x - random.uniform(20.0, 60.0)) ** 2
            for _ in range(min(jumps, n // 5)):
                at = random.integers(n)
                y[at:] += random.normal(0.0, 8.0) + random.normal(0.0, 0.5) * np.arange(n - at)
            sigma = random.uniform(0.05, 0.3, n)
            found.append((x, y + random.normal(0.0, sigma), 1.0 / sigma**2))
    return found


def _everything(end: End) -> list[FloatArray]:
    x, y, weight = end
    found = [*convex_regression(x, y, weight), *convex_regression(x, y, weight, -1.0)]
    cuts, gains = convex_cuts(x, y, weight)
    found += [*best_lines(x, y, weight, 20.0, 6.0), cuts, gains, *polyline(x, y, weight, 1.5)]
    found += [sure_strips(x, y, weight, cuts), hull_ends(np.column_stack([x, y])[::-1], x + 2.0)]
    return [np.asarray(f, dtype=np.float64) for f in found]


@pytest.mark.parametrize("end", _ends(), ids=lambda e: len(e[0]))
def test_chains_are_those_of_numpy(end: End, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = _everything(end)
    monkeypatch.setattr(convex_chain, "exported", lambda name: None)
    for found, wanted in zip(compiled, _everything(end), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-7)


def test_a_regression_is_convex_and_no_convex_function_is_nearer() -> None:
    """Against many convex functions about it: sums of a line and hinges."""
    random = np.random.default_rng(0)
    for x, y, weight in _ends()[12:]:
        found, kinks = convex_regression(x, y, weight)
        bends = np.diff(np.diff(found) / np.diff(x))
        assert bends.min() > -1e-9
        assert kinks == (bends > 1e-9).sum()
        cost = (weight * (y - found) ** 2).sum()
        for _ in range(50):
            hinges = np.maximum(x[:, None] - random.choice(x, 3), 0.0) @ random.exponential(0.02, 3)
            other = found + 0.1 * (random.normal() + random.normal() * 0.02 * (x - x.mean()) + hinges)
            assert (weight * (y - other) ** 2).sum() >= cost - 1e-9 * cost


def test_strips_about_a_cut_are_sure_as_far_as_the_step_tells() -> None:
    """The last strip before a fall may be the next chain's, as a steep edge; by a fall that noise drowns, many may."""
    x = np.arange(30.0)
    weight = np.full(30, 0.1**-2)
    far = sure_strips(x, np.where(x < 15.0, 0.0, -20.0), weight, [0, 15, 30])
    assert np.flatnonzero(~far).tolist() == [14]
    near = sure_strips(x, np.where(x < 15.0, 0.0, -0.2), weight, [0, 15, 30])
    assert near.sum() < 20
    assert sure_strips(x, x, weight, [0, 30]).all()


def test_hull_ends_are_those_of_the_convex_hull_also_where_points_share_an_x() -> None:
    points = np.array([(4.0, 1.0), (0.0, 3.0), (4.0, 5.0), (2.0, 2.5), (0.0, 2.0), (4.0, 2.0)])
    ends = hull_ends(points, np.array([-1.0, 0.0, 2.0, 4.0, 4.5]))
    np.testing.assert_allclose(ends, [[np.nan, 2.0, 1.5, 1.0, np.nan], [np.nan, 3.0, 4.0, 5.0, np.nan]])

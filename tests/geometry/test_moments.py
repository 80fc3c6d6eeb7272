"""Slopes of area, centroid and orientation against differences; deviations against samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polygons import convex_polygon
from strategies import FIXED
from tacstrip.geometry import moments as m

RECTANGLE = np.array([(10.0, 20.0), (50.0, 20.0), (50.0, 30.0), (10.0, 30.0)])


def test_a_rectangle_by_hand() -> None:
    area, centroid, second = m.moments(RECTANGLE)
    assert area == pytest.approx(400.0)
    np.testing.assert_allclose(centroid, (30.0, 25.0))
    np.testing.assert_allclose(second, (40.0**3 * 10 / 12, 10.0**3 * 40 / 12, 0.0), atol=1e-9)
    assert m.orientation(RECTANGLE) == pytest.approx(0.0)
    assert m.orientation(RECTANGLE[:, ::-1][::-1]) == pytest.approx(math.pi / 2)


@FIXED
@given(st.integers(0, 10_000), st.integers(3, 9))
def test_slopes_agree_with_differences(seed: int, corners: int) -> None:
    v = convex_polygon(seed, corners)
    slopes = m.moment_jacobian(v)
    for at in range(v.size):
        step = np.zeros(v.size)
        step[at] = 1e-4
        after, before = v + step.reshape(-1, 2), v - step.reshape(-1, 2)
        ends = [
            np.array([area, *centroid, xx - yy, 2.0 * xy])
            for area, centroid, (xx, yy, xy) in map(m.moments, (after, before))
        ]
        moved = ends[0] - ends[1]
        np.testing.assert_allclose(slopes[:, at], moved / 2e-4, rtol=1e-4, atol=1e-6)


def test_deviations_are_those_of_samples() -> None:
    random = np.random.default_rng(0)
    root = 0.05 * random.standard_normal((8, 8))
    samples = RECTANGLE + (root @ random.standard_normal((8, 4000))).T.reshape(-1, 4, 2)
    drawn = np.array([(m.moments(v)[0], *m.moments(v)[1], m.orientation(v)) for v in samples])
    area, centroid, angle = m.deviations(RECTANGLE, root @ root.T)
    np.testing.assert_allclose((area, *centroid, angle), drawn.std(axis=0), rtol=0.05)


def test_orientation_of_a_near_square_may_be_that_of_the_other_axis() -> None:
    """Both ends of 21 x 20 mm lie anywhere within 3 mm: in one case of six it is higher than wide."""
    wide = np.array([(0.0, 0.0), (21.0, 0.0), (21.0, 20.0), (0.0, 20.0)])
    covariance = 0.01 * np.eye(8)
    for end in ([0, 6], [2, 4]):
        covariance[np.ix_(end, end)] = 9.0 / 12.0
    assert 1.96 * m.deviations(wide, covariance, (0, 2))[2] > 0.45 * math.pi
    longer = wide * [2.0, 1.0]
    assert 1.96 * m.deviations(longer, covariance, (0, 2))[2] < 0.05 * math.pi


def test_an_axis_that_may_be_either_of_two_holds_both() -> None:
    height = np.outer(*2 * ([0.0, -1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0],))
    turn = m.deviations(RECTANGLE, 15.0**2 * height)[2]  # 10 high and 40 wide, or 70 high
    assert turn == m.UNKNOWN_ANGLE
    assert 1.96 * turn > math.pi / 2
    taller = np.stack([RECTANGLE + h * np.array([(0, -1), (0, -1), (0, 1), (0, 1)]) for h in range(40)])
    assert m.sample_deviations(RECTANGLE, taller)[2] == m.UNKNOWN_ANGLE


def test_a_small_difference_of_the_axes_is_as_likely_as_a_large_one() -> None:
    """Of what is turned anyhow and as long over wide as any, what reads like 21 x 20 mm: how it may be turned."""
    covariance, random = 0.2 * np.eye(8), np.random.default_rng(2)
    seen = np.array([(0.0, 0.0), (21.0, 0.0), (21.0, 20.0), (0.0, 20.0)])
    xx, yy, _ = m.moments(seen)[2]
    slopes = m.moment_jacobian(seen)[3:]
    size, angle = random.uniform(0.0, 6.0 * (xx - yy), 400_000), random.uniform(-0.5, 0.5, 400_000) * np.pi
    off = np.stack([size * np.cos(2.0 * angle) - (xx - yy), size * np.sin(2.0 * angle)])
    weight = np.exp(-0.5 * (off * np.linalg.solve(slopes @ covariance @ slopes.T, off)).sum(axis=0))
    turned = np.quantile(np.abs(angle), 0.95, weights=weight, method="inverted_cdf")
    assert turned < 0.4 * np.pi
    assert 1.96 * m.deviations(seen, covariance)[2] == pytest.approx(turned, rel=0.03)


def test_what_the_vertices_leave_open_stays_open() -> None:
    open_x = np.diag([np.inf] + [1.0] * 7)
    open_x[0, 1:] = open_x[1:, 0] = np.nan
    area, centroid, angle = m.deviations(RECTANGLE, open_x)
    assert area == math.inf
    assert np.isinf(centroid).all()
    assert angle == m.UNKNOWN_ANGLE
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    assert m.deviations(square, np.eye(8))[2] == m.UNKNOWN_ANGLE


def test_a_polygon_without_area() -> None:
    flat = np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
    area, centroid, _ = m.moments(flat)
    assert area == 0.0
    np.testing.assert_allclose(centroid, (1.0, 1.0))
    assert np.isnan(m.moment_jacobian(flat)[1:3]).all()
    assert m.deviations(flat, np.eye(6))[2] == m.UNKNOWN_ANGLE
    assert math.isnan(m.orientation(np.empty((0, 2))))
    assert np.isnan(m.moments(np.empty((0, 2)))[1]).all()


def test_a_uniform_error_counts_by_what_holds_95_percent_of_it() -> None:
    """Both ends of a rectangle lie anywhere within 1 mm: 10 mm high, so the area is off by 10 (a - b)."""
    x_left, x_right, var = [0, 6], [2, 4], 1.0 / 12.0
    covariance = np.zeros((8, 8))
    covariance[np.ix_(x_left, x_left)] = covariance[np.ix_(x_right, x_right)] = var
    one_end = np.zeros((8, 8))
    one_end[np.ix_(x_left, x_left)] = var
    # One: uniform in +-5, 95 % within 4.75. Two: a triangle in +-10, 95 % within 10 (1 - sqrt(0.05)).
    assert m.deviations(RECTANGLE, one_end, (0,))[0] == pytest.approx(4.75 / 1.96, rel=0.02)
    both = m.deviations(RECTANGLE, covariance, (0, 2))[0]
    assert both == pytest.approx(10.0 * (1.0 - math.sqrt(0.05)) / 1.96, rel=0.02)
    assert m.deviations(RECTANGLE, covariance)[0] == pytest.approx(10.0 / math.sqrt(6.0))


def test_deviations_of_a_sample_hold_95_percent_of_it() -> None:
    random = np.random.default_rng(1)
    drawn = RECTANGLE + 0.05 * random.standard_normal((600, 4, 2))
    every = np.array([(m.moments(v)[0], *m.moments(v)[1], m.orientation(v)) for v in drawn])
    at = np.array([m.moments(RECTANGLE)[0], *m.moments(RECTANGLE)[1], m.orientation(RECTANGLE)])
    area, centroid, turn = m.sample_deviations(RECTANGLE, drawn)
    inside = np.abs(every - at) <= 1.96 * np.array([area, *centroid, turn])
    np.testing.assert_allclose(inside.mean(axis=0), 0.95, atol=0.004)

"""Outlines drawn, as l and u on columns."""

import numpy as np
import pytest

from tacstrip.core.posterior import Samples, outline_record
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.posterior.draws import Draws, column_ends
from tacstrip.reconstruction.posterior.vertex_scatter import vertex_scatter
from tacstrip.sensor.spec import Sensor


@pytest.mark.parametrize("corners", [2, 3, 7])
def test_ends_of_many_outlines_are_those_of_each(corners: int) -> None:
    sensor = Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=80.0)
    problem = FitProblem.of(sensor, sensor.x_mm, {"kh": np.full(20, 0.5)}, 0.01)
    random, x = np.random.default_rng(corners), np.linspace(-0.02, 1.02, 90)
    along = np.sort(random.uniform(-1.0, 101.0, (40, corners)), axis=1)
    lower, upper = (np.stack([along, random.uniform(-10.0, 90.0, along.shape)], axis=-1) for _ in range(2))
    at = x * problem.width_mm + problem.origin_mm
    for i, ends in enumerate(column_ends(problem, x, lower, upper)):
        outside = (at < along[i, 0]) | (at > along[i, -1])
        for chain, y in ((lower[i], ends[0]), (upper[i], ends[1])):
            one = np.clip(np.interp(at, *chain.T) / 80.0, 0.0, 1.0)
            np.testing.assert_allclose(y, np.where(outside, 0.0, one), atol=1e-12)


def test_vertices_scatter_as_draws_of_the_same_corners_do() -> None:
    sensor = Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=80.0)
    problem = FitProblem.of(sensor, sensor.x_mm, {"kh": np.full(20, 0.5)}, 0.01)
    scale, origin = np.array([problem.width_mm, problem.length_mm]), np.array([problem.origin_mm, 0.0])
    outline = Outline.of([(10.0, 40.0), (40.0, 10.0), (90.0, 40.0), (50.0, 70.0)])
    random, moved = np.random.default_rng(0), list[Outline]()
    for i in range(180):  # the lower corner lies here or there, along the edge
        shift = random.normal(0.0, 0.1, (4, 2))
        shift[1] += np.array([6.0, 3.6]) * (i % 2)
        moved.append(Outline.of(outline.vertices + shift))
    others = [
        Outline.of([(10.0, 40.0), (40.0, 10.0), (70.0, 20.0), (90.0, 40.0), (50.0, 70.0)]),  # a corner more
        Outline.of([(10.0, 40.0), (90.0, 40.0), (50.0, 70.0), (30.0, 60.0)]),  # on the other side
        Outline.of([(10.0, 30.0), (90.0, 40.0), (50.0, 70.0), (10.0, 50.0)]),  # upright
        Outline.of([(10.0, 40.0), (40.0, -9.0), (90.0, 40.0), (50.0, 70.0)]),  # beyond the strips
    ]
    made = [outline_record((o.lower - origin) / scale, (o.upper - origin) / scale) for o in moved + others]
    count = len(made)
    samples = Samples(np.concatenate(made), np.ones(count), np.zeros(count), np.ones(count))
    drawn = Draws(problem, np.zeros(1), np.zeros((count, 2, 1)), np.full(count, 1.0 / count), samples)
    slopes = 0.01 * np.eye(8)
    off = np.array([o.vertices - outline.vertices for o in moved]).reshape(180, 8)
    (*_, most), axes = np.linalg.eigh(
        off.T @ off / 180.0
    )  # in one direction more than slopes say, in the others as much
    expected = slopes + 0.9 * (most - 0.01) * np.outer(axes[:, -1], axes[:, -1])
    np.testing.assert_allclose(vertex_scatter(outline, slopes, drawn), expected, rtol=1e-9, atol=1e-9)
    nothing = Draws(problem, drawn.x, drawn.ends, np.zeros(count), samples)
    np.testing.assert_allclose(vertex_scatter(outline, slopes, nothing), slopes)
    open_end = slopes.copy()
    open_end[0, 0] = np.inf
    assert vertex_scatter(outline, open_end, drawn) is open_end

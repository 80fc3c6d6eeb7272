"""Outlines drawn, as l and u on columns."""

import numpy as np
import pytest

from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.posterior.draws import column_ends
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

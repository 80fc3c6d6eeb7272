"""Contact resistance on wide strips: where a thin strip's contact would end that reads the same, and the slopes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tacstrip.network.strips.resistive_ends import ResistiveEnds

import tacstrip as ts
from tacstrip.network.strips.resolved import Cells, wide_readings

SHAPE = np.array([(14.37, 28.37), (60.37, 44.37), (66.37, 75.37), (20.37, 59.37)])


def on_strip(vertices: np.ndarray, strip: int) -> ResistiveEnds:
    found = ResistiveEnds.of(vertices, 5.0 * strip + 2.5, 5.0, 100.0, 2.5)
    assert found is not None
    return found


@pytest.mark.parametrize(("strip", "way"), [(2, 1), (4, -1), (12, 1)])
def test_readings_and_slopes_are_those_of_networks(strip: int, way: int) -> None:
    """Of a strip covered in part, of one with a corner, and of one that two corners lie near, to 1e-4 of Vref."""
    sensor = ts.Sensor(
        construction="crs-crs", strips=16, pitch_mm=5.0, length_mm=100.0, contact_lambda_mm=2.5, strip_width_mm=5.0
    )  # fmt: skip
    shape = SHAPE[::way]
    found = on_strip(shape, strip)
    l, u = np.full((2, 16), np.nan)
    l[strip], u[strip] = found.ends
    made, read = ts.signatures(sensor, l, u), wide_readings(sensor, ts.Contact.polygon(shape), strips=[strip])
    for name in sensor.signatures:
        assert made[name][strip] == pytest.approx(read[name][strip], abs=1e-4)
    # As all vertices move, so do the ends; and as the upper edge alone does, by differences.
    up = found.slopes @ np.tile([0.0, 1.0], 4)
    np.testing.assert_allclose(up, 1.0, atol=0.02)
    moves = np.where(np.repeat(shape[:, 1] > 50.0, 2), np.tile([0.3, 1.0], 4), 0.0)
    step = 0.05 * moves.reshape(-1, 2)
    difference = (on_strip(shape + step, strip).ends - on_strip(shape - step, strip).ends) / 0.1
    np.testing.assert_allclose(found.slopes @ moves, difference, atol=0.03)


def test_off_the_strip_there_is_none() -> None:
    assert ResistiveEnds.of(SHAPE, 2.5, 5.0, 100.0, 2.5) is None


def test_cells_hold_the_areas_that_intersections_have() -> None:
    grid = Cells(np.linspace(0.0, 5.0, 8), np.array([0.0, 1.0, 4.0, 4.5, 7.0, 10.0]))
    area = shapely.Polygon(
        [(0.0, 1.0), (5.0, 0.5), (4.0, 9.0), (2.0, 6.0)], [[(2.0, 2.0), (3.0, 2.0), (3.0, 4.2)]]
    )
    both = shapely.union(area, shapely.box(0.0, 9.0, 1.0, 9.5))
    side, level = (np.concatenate([a[:1], 0.5 * (a[1:] + a[:-1]), a[-1:]]) for a in (grid.x, grid.y))
    boxes = shapely.box(side[:-1], level[:-1, None], side[1:], level[1:, None])
    np.testing.assert_allclose(grid.shares(both), shapely.area(shapely.intersection(both, boxes)), atol=1e-13)


def test_slopes_lead_on_as_far_as_they_tell() -> None:
    found = on_strip(SHAPE, 2)
    near, far = SHAPE + 0.049 * np.array([[1.0, -1.0]]), SHAPE + 0.2
    ends = found.moved(near)
    assert ends is not None
    np.testing.assert_allclose(ends, on_strip(near, 2).ends, atol=2e-3)  # 2e-5 of L
    assert found.moved(far) is None
    assert found.moved(SHAPE[:3]) is None

"""What may not be touched behind a jump of l or u: an opening no higher than its mouth, of one jump of several."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.reconstruction.pieces.overhang import Overhang, widest_overhang
from tacstrip.reconstruction.pieces.run import split_run
from tacstrip.reconstruction.polygon.status import lowered

SENSOR = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
X = SENSOR.x_mm[5:35]


def _widest(l: np.ndarray, u: np.ndarray) -> Overhang | None:
    return widest_overhang(split_run(SENSOR, X, l, u, 1e-4))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("upside_down", [False, True])
def test_an_arm_that_ends_may_hide_all_between_it_and_the_other_one(
    mirrored: bool, upside_down: bool
) -> None:
    l, u = np.where(np.arange(30) < 12, 20.0, 50.0), np.full(30, 80.0)
    if upside_down:
        l, u = 100.0 - u, 100.0 - l
    if mirrored:
        l, u = l[::-1], u[::-1]
    found = _widest(l, u)
    assert found is not None
    assert found.rise == pytest.approx(30.0)
    assert found.jumps == 1
    assert found.share == pytest.approx(12 * 30.0 / (12 * 60.0 + 18 * 30.0), rel=1e-3)


def test_an_opening_closes_where_the_other_arm_s_edge_meets_this_one() -> None:
    """The edge falls by 3 mm a strip towards the arm that ends, 30 mm beyond the jump it meets it."""
    l = np.where(np.arange(30) < 20, 20.0, 50.0 + 3.0 * (np.arange(30) - 20))
    found = _widest(l, np.full(30, 90.0))
    assert found is not None
    heights = 50.0 + 3.0 * (np.arange(10, 20) - 20) - 20.0
    assert found.share == pytest.approx(heights.sum() / (90.0 - l).sum(), rel=1e-2)


def test_strips_left_out_beside_a_jump_hide_as_those_beside_them_do() -> None:
    l, u = np.where(np.arange(30) < 12, 20.0, 50.0), np.full(30, 80.0)
    l[11:13] = np.nan
    found = _widest(l, u)
    assert found is not None
    assert found.rise == pytest.approx(30.0)
    assert found.share == pytest.approx(0.286, abs=0.03)


def test_no_jump_hides_nothing_and_more_jumps_share_what_one_may_hide() -> None:
    assert _widest(np.full(30, 20.0), 60.0 - np.abs(np.arange(30) - 15.0)) is None
    one, two = Overhang(10.0, 0.6, 1), Overhang(10.0, 0.6, 2)
    assert 0.0 < two.probability == pytest.approx(0.5 * one.probability)
    assert Overhang(10.0, 0.9, 1).probability > one.probability
    assert Overhang(10.0, 1.0, 1).probability < 1.0  # another shape may fill it all the same


def test_a_confidence_that_falls_below_what_ok_asks_for_doubts_however_little_lowers_it() -> None:
    doubt, note, left = lowered("told", 0.04, 0.78, 0.77)
    assert (doubt, note) == ("told", "")
    assert left == pytest.approx(0.7488)
    assert lowered("told", 0.04, 0.9, 0.77)[:2] == ("", "")
    assert lowered("told", 0.06, 0.9, 0.77)[:2] == ("", "told")
    # What was not sure enough without it is not doubted for this.
    assert lowered("told", 0.5, 0.7, 0.77) == ("", "told", 0.35)

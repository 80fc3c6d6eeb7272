"""Two objects that may be taken for one concave one."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.convex_chain import convex_regression
from tacstrip.reconstruction.pieces import pair
from tacstrip.reconstruction.pieces.beside import pair_beside
from tacstrip.reconstruction.pieces.run import split_run


def test_no_chain_is_fitted_to_no_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """One object may be on all strips; the other's end there has none."""
    sizes: list[int] = []

    def counted(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, int]:
        sizes.append(len(x))
        return convex_regression(x, y, weight)

    monkeypatch.setattr(pair, "convex_regression", counted)
    x = np.arange(12.0)
    low = np.where(x < 6, 20.0, 30.0)
    ends = pair.Ends(x, np.stack([low, np.full(12, 60.0)]), np.full((2, 12), 0.1), 1.0)
    assert pair.likeliest_pair(ends, ([6], [6]), ([6], []), pair.Seen(0.1, 0.3, 3.0)) is not None
    assert min(sizes) > 0


def test_two_objects_beside_each_other_are_asked_for_where_both_ends_turn_inwards() -> None:
    x = np.arange(14.0)
    away = np.abs(x - 6.5)
    ends = pair.Ends(x, np.stack([50.0 - 3.0 * away, 54.0 + 3.0 * away]), np.full((2, 14), 0.1), 1.0)
    found, left_out = pair_beside(ends, ([7], [7])), pair_beside(ends, ([7], []), [6])
    assert found is not None
    assert left_out is not None
    assert found.shared == 0
    assert found.meeting_mm == (6.0, 7.0)
    assert max(found.lower[:, 0].max(), found.upper[:, 0].max()) == 13.0
    assert found.probability > left_out.probability + 0.2  # of these one corner is not seen
    assert pair_beside(ends, ([7], [])) is None


@pytest.mark.parametrize(
    "less", [pair.Seen(0.02, 0.3, 2.0), pair.Seen(0.1, 0.6, 2.0), pair.Seen(0.1, 0.3, 1.0)]
)
def test_a_narrow_gap_a_high_jump_and_a_breadth_as_the_height_speak_for_one_object(less: pair.Seen) -> None:
    assert less.log_odds < pair.Seen(0.1, 0.3, 2.0).log_odds


def test_pieces_are_seen_as_wholes() -> None:
    x, jump = np.arange(24.0) + 0.5, np.arange(24) >= 12
    sensor = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=1.0, length_mm=100.0)
    pieces = split_run(sensor, x, np.where(jump, 20.0, 35.0), np.full(24, 60.0), 1e-4)
    seen = pieces.seen
    assert (seen.rise, seen.proportion) == pytest.approx((15.0 / 40.0, 40.0 / 24.0))
    assert seen.gap == pytest.approx(pieces.distance_mm / 100.0)


@pytest.mark.parametrize(
    ("low", "high", "least", "most"),
    [
        ([69.0, 17.2, 20.0, 28.0], [73.7, 80.0, 82.0, 83.0], 0.5, 1.0),
        ([69.0, 17.2, 17.4, 17.6], [73.7, 73.9, 74.1, 74.3], 0.0, 0.25),  # parallel sides
        ([69.0, 17.2, 30.0, 45.0], [73.7, 80.0, 62.0, 46.0], 0.0, 0.25),  # pointed at the other side
        (
            [45.0, 17.2, 20.0, 28.0],
            [50.7, 52.0, 54.0, 55.0],
            0.0,
            0.25,
        ),  # the jump is short beside the breadth
    ],
)
def test_an_edge_that_crosses_one_strip_or_a_second_object(
    low: list[float], high: list[float], least: float, most: float
) -> None:
    ends = pair.Ends(np.arange(4.0) * 8.0, np.array([low, high]), np.full((2, 4), 0.1), 8.0)
    found = pair.likeliest_pair(ends, ([1], []), None)
    assert least < (0.01 if found is None else found.probability) < most

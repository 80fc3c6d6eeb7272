"""What a convex polygon shares with a ring: the compiled core against Shapely, and both against what is known."""

from __future__ import annotations

import numpy as np
import pytest

from tacstrip.core import convex_overlap as module
from tacstrip.core.convex_overlap import convex_overlap

_SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])


def test_overlaps_are_those_of_shapely(monkeypatch: pytest.MonkeyPatch) -> None:
    random, cases = np.random.default_rng(3), []
    for corners in (3, 4, 7):
        for points in (3, 5, 60):
            angles, around = (np.sort(random.uniform(0.0, 2.0 * np.pi, n)) for n in (corners, points))
            convex = 10.0 * np.column_stack([np.cos(angles), np.sin(angles)])
            radius = random.uniform(1.0, 18.0, (points, 1))
            ring = radius * np.column_stack([np.cos(around), np.sin(around)]) + random.uniform(-9.0, 9.0, 2)
            cases += [(convex, ring), (convex, ring[::-1]), (convex, ring + 60.0)]
    compiled = [convex_overlap(*case) for case in cases]
    monkeypatch.setattr(module, "exported", lambda name: None)
    np.testing.assert_allclose(compiled, [convex_overlap(*case) for case in cases], rtol=1e-9, atol=1e-9)
    assert np.ptp([shared for _, _, shared in compiled]) > 10.0


def test_a_notch_a_turned_ring_and_a_line_share_what_they_cover() -> None:
    notched = np.array([(2.0, -2.0), (8.0, -2.0), (8.0, 6.0), (2.0, 6.0), (5.0, 2.0)])
    by_hand = 1.0 / 3.0  # two corners of the square, from x = 3.5 on
    assert convex_overlap(_SQUARE, notched) == pytest.approx((16.0, 48.0 - 12.0, by_hand))
    assert convex_overlap(notched, _SQUARE) == pytest.approx(
        (48.0 - 12.0, 16.0, by_hand)
    )  # not convex: as exact
    assert convex_overlap(_SQUARE, _SQUARE[::-1]) == pytest.approx((16.0, 16.0, 16.0))
    assert convex_overlap(_SQUARE, _SQUARE[:2]) == (16.0, 0.0, 0.0)
    assert convex_overlap(_SQUARE[:2], _SQUARE) == (0.0, 16.0, 0.0)

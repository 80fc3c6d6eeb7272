"""The study of what convex polygons one signature leaves."""

from __future__ import annotations

import numpy as np
import pytest

from studies import polygon_limit
from studies.polygon_limit import Judged
from tacstrip.core.binding import exported


def test_the_report_compares_what_was_said_with_what_was() -> None:
    sure = [Judged("hull", 0.95, 0.99, 0.9, 0.98, 0.92, (1.0, 1.1))] * 8
    wrong = [
        Judged("hull", 0.5, 0.85, 0.1, 0.8, 0.05, (1.2, 1.1)),
        Judged("hull", 0.6, 0.85, 0.1, np.nan, np.nan, (0.9, 1.1)),
    ]
    text = polygon_limit.report([*sure, *wrong])
    assert "said 0.99, was 1.00 of 8" in text
    assert "said 0.85, was 0.00 of 2" in text
    assert "begun at the true outline (9)" in text
    assert (
        "wrong (2): the true outline leaves 1.05 a reading, those drawn 1.10; 1 true ones leave no less"
        in text
    )


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
def test_chains_begun_at_the_true_outline_find_the_same_as_the_others() -> None:
    found = polygon_limit.judge(polygon_limit.drawn(np.random.default_rng(1), "triangle"))
    assert found is not None
    assert found.chi_square[0] == pytest.approx(1.0, abs=0.3)
    assert found.near_from_truth == pytest.approx(found.near, abs=0.05)

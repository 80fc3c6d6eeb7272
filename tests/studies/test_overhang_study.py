"""Overhangs that are drawn hide what the fit of their probability learns."""

from __future__ import annotations

import numpy as np
import pytest

from studies import overhang as study


def test_the_factor_and_the_power_are_found() -> None:
    random = np.random.default_rng(3)
    share, jumps = random.uniform(0.0, 1.0, 20000), random.integers(1, 3, 20000).astype(float)
    hides = random.random(20000) < study.probability(np.array([0.8, 2.0]), share, jumps)
    drawn = study.Overhangs(share, jumps, hides, np.full(20000, "L"))
    assert study.fitted(drawn, np.ones(20000, dtype=bool)) == pytest.approx([0.8, 2.0], rel=0.1)


def test_a_table_is_made_of_shapes_that_jump() -> None:
    lines = study.table(45, 2)
    assert "of 45 outlines jump" in lines[0]
    assert any(line.startswith("channel") for line in lines)

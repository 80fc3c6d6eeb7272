"""A network learns what tells two kinds apart, and the share that is doubted is counted by weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies import concave_or_two as study


def test_a_network_learns_what_no_line_tells() -> None:
    random = np.random.default_rng(1)
    x = random.normal(size=(800, 2))
    two = x[:, 0] * x[:, 1] > 0.0
    odds = study.log_odds(study.network(x, two, np.ones(len(x)), random), x)
    assert ((odds > 0.0) == two).mean() > 0.95


def test_doubted_is_the_share_above_the_pairs_that_are_missed() -> None:
    odds, two = np.array([0.0, 1.0, 2.0, 3.0, 0.5, 1.5]), np.array([True] * 4 + [False] * 2)
    assert study.doubted(odds, two, np.ones(6), 0.2) == pytest.approx(1.0)
    assert study.doubted(odds, two, np.ones(6), 0.3) == pytest.approx(0.5)
    assert study.doubted(odds, two, np.array([1.0, 1, 1, 1, 3, 1]), 0.3) == pytest.approx(0.25)


@pytest.mark.parametrize("family", ["pair", "L"])
def test_what_is_seen_does_not_depend_on_the_side_from_which(family: str) -> None:
    for seed in range(9):
        case = study.drawn(np.random.default_rng(seed), family)
        case = replace(case, unit=replace(case.unit, bits=None, ratio=1.0), told=True)
        case = replace(case, read=case.unit.read(case.low, case.high))
        turned = replace(case, low=case.low[::-1], high=case.high[::-1], read=case.read[:, ::-1])
        seen = study.features(case)
        if seen is not None:
            assert study.features(turned) == pytest.approx(seen, abs=1e-6)
            return
    raise AssertionError("none tells")

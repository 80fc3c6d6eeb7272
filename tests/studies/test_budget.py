"""The budget of positional uncertainty, against what is known without a network."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from studies.budget import IMPERFECTIONS, PROFILE_I, cost, tolerance

CRS, METAL = (ts.Sensor.load(f"prototype-{name}") for name in ("crs-crs", "crs-m"))
BY_NAME = {i.name.split(" ")[0]: i for i in IMPERFECTIONS}


@pytest.mark.parametrize("name", BY_NAME)
def test_cost_grows_with_size_and_vanishes_at_none(name: str) -> None:
    costs = [cost(CRS, BY_NAME[name], size) for size in (0.01, 1.0, 4.0)]
    if name == "on-resistance":  # no current flows through CRS-CRS' switches
        assert max(costs) < 1e-9
        assert tolerance(CRS, BY_NAME[name]) is None
    else:
        assert costs[0] < 2e-4
        assert costs[0] < costs[1] < costs[2]


def test_a_tolerance_costs_what_profile_i_allows() -> None:
    for sensor, name in ((CRS, "contact"), (METAL, "on-resistance")):
        size = tolerance(sensor, BY_NAME[name])
        assert size is not None
        assert cost(sensor, BY_NAME[name], size) == pytest.approx(PROFILE_I, rel=0.03)


def test_small_switch_resistance_costs_as_by_hand() -> None:
    """k = (l + m) / (L - w + 2 m) over metal, m the switch in mm of strip: dk/dm = (1 - 2 k) / (L - w)."""
    size = 0.1
    m = size / 100.0 * METAL.length_mm
    found = cost(METAL, BY_NAME["on-resistance"], size)
    assert found <= m / (0.6 * METAL.length_mm)  # w is below 0.4 L, |1 - 2 k| below 1
    assert found >= 0.3 * m / METAL.length_mm
    assert np.isfinite(found)

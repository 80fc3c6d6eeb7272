"""The study of rounded contacts whose wrong outlines readings do not tell from the true ones."""

from dataclasses import replace

import numpy as np
import pytest

from studies import rounded_twins
from studies.holdout.cases import Case
from studies.holdout.readings import Unit
from tacstrip.core.binding import exported

_ANGLE = np.linspace(0.0, 2.0 * np.pi, 97)[:-1]
_DISC = np.column_stack([50.0 + 38.0 * np.cos(_ANGLE), 45.0 + 38.0 * np.sin(_ANGLE)])


def _case() -> Case:
    unit = Unit(("k",), 25, 4.0, 100.0)
    low, high = unit.touched([_DISC])
    read = unit.read(low, high) + np.random.default_rng(1).normal(0.0, 0.001, (1, unit.strips))
    return Case("disc", unit, [_DISC], low, high, read, 0.001 * np.sqrt(3.0), "normal", told=True)


@pytest.mark.skipif(exported("sample_regular") is None, reason="only the compiled core samples")
def test_what_an_outline_leaves_is_compared_with_what_the_true_one_does() -> None:
    case = _case()
    found = rounded_twins.trusted(case)
    assert found is not None
    assert found.iou > 0.9
    assert found.explained
    assert abs(found.surplus) < 20.0
    other = rounded_twins.trusted(replace(case, outlines=[_DISC + np.array([0.0, 5.0])]))
    assert other is not None
    assert other.surplus < -100.0

"""Two convex objects that read as a concave one does are found, and only where there are some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from studies import several_limit as limit
from studies.holdout import cases

_ELL = np.array([(0, 0), (1, 0), (1, 0.4), (0.5, 0.4), (0.5, 1), (0, 1)])
_PLUS = np.array(
    [(1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)]
)


@pytest.mark.parametrize(("outline", "two"), [(_ELL, True), (_PLUS / 3.0, False)])
def test_an_upright_ell_reads_as_two_objects_and_a_plus_does_not(outline: np.ndarray, two: bool) -> None:
    random = np.random.default_rng(3)
    drawn = cases.single(random, "notched", 20, ("kh", "kl"), 0.005)
    unit = replace(drawn.unit, length=20.0 * drawn.unit.pitch, bits=None)
    placed = outline * 0.8 * unit.length + 0.07 * unit.length
    low, high = unit.touched([placed])
    read = unit.read(low, high) + random.normal(0.0, 0.003, (2, unit.strips))
    case = replace(drawn, unit=unit, outlines=[placed], low=low, high=high, read=read)
    found = limit.explaining(case)
    assert (found is not None) == two
    if found is not None:
        lower, upper = map(shapely.Polygon, found)
        assert lower.is_valid
        assert upper.is_valid
        assert lower.intersection(upper).area < 0.01 * min(lower.area, upper.area) + 1e-9


def test_a_shape_filled_along_the_strips_reads_alike_and_hides_a_gap_across_them() -> None:
    c = np.array([(0, 0), (10, 0), (10, 2), (3, 2), (3, 8), (10, 8), (10, 10), (0, 10)], dtype=float)
    assert shapely.Polygon(limit.filled(c)).area == pytest.approx(100.0, rel=0.01)
    assert shapely.Polygon(limit.filled(_ELL)).area == pytest.approx(0.7, rel=0.01)  # nothing to fill

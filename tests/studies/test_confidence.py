"""The study of confidence: what it draws, and the odds that it fits."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from studies.confidence import FAMILIES, fitted_odds, of_family
from studies.holdout import cases
from studies.holdout.score import overlap
from tacstrip.core.binding import exported
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline


@pytest.mark.parametrize("family", FAMILIES)
def test_families_are_of_one_signature_on_strips_enough(family: str) -> None:
    for drawn in of_family(family, 3, 4):
        assert len(drawn.scan.signatures) == 1
        assert drawn.touched >= 12
        assert drawn.noise.positional <= 0.01
        assert drawn.truth.is_valid
        hull = drawn.truth.convex_hull.area
        assert (drawn.truth.area < 0.98 * hull) == ("concave" in family)


def test_odds_are_found_again_whatever_a_terms_unit() -> None:
    random = np.random.default_rng(1)
    true = np.array([-0.5, 1.5, -40.0])
    of = np.column_stack([np.ones(4000), random.normal(size=4000), random.uniform(0.0, 0.05, 4000)])
    right = random.random(4000) < 1.0 / (1.0 + np.exp(-of @ true))
    np.testing.assert_allclose(fitted_odds(of, right), true, rtol=0.15)


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
def test_a_regular_outline_is_judged_by_what_it_leaves_itself() -> None:
    """A segment of a disc, whose best polygon leaves residuals that hang together; noise unknown."""
    case = cases.rounded(cases.rng("rounded", 861, 768))
    found = ts.fit_polygon(case.unit.scan(case.read), case.unit.sensor).objects[0]
    assert found.model is FamilyOutline
    assert found.status == "ok"
    assert "hangs together" not in found.advice
    assert overlap(case.unit, found.vertices, case.outlines[0]) > 0.95

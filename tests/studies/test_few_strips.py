"""The study of few strips: contacts are what they are called, and the odds that it fits are those of its weights."""

from __future__ import annotations

import numpy as np
import shapely

from studies.few_strips import GROUPS, PRIOR, contact, fitted


def test_contacts_are_convex_concave_or_two() -> None:
    for group in GROUPS:
        for seed in range(4):
            drawn = contact(group, np.random.default_rng(seed))
            on = np.isfinite(drawn.touched[0])
            assert 3 <= on.sum() <= 11
            parts = shapely.get_parts(drawn.objects)
            assert len(parts) == 1 + (group in ("above", "beside"))
            filled = shapely.area(parts) / shapely.area(shapely.convex_hull(parts))
            assert (filled.min() < 0.98) == (group == "concave")


def test_odds_are_those_of_the_prior() -> None:
    """One contact in three of the concave ones is wrong: of one in five by weight, so that one in fifteen is."""
    rows = [
        {"group": group, "right": group == "convex" or number % 3 > 0, "before": 1.0, "terms": np.ones(1)}
        for group in ("convex", "concave")
        for number in range(300)
    ]
    weight = PRIOR["concave"] / (PRIOR["convex"] + PRIOR["concave"])
    (odds,) = fitted(rows)
    np.testing.assert_allclose(1.0 / (1.0 + np.exp(-odds)), weight / 3.0, atol=2e-3)

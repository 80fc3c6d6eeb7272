"""The study of convex outlines that read like what is not convex."""

import numpy as np
import pytest

from studies import convex_twins
from studies.holdout.cases import Case
from studies.holdout.readings import Unit


def _case(name: str, outline: np.ndarray) -> Case:
    unit = Unit((name,), 20, 5.0, 100.0)
    low, high = unit.touched([outline])
    read = unit.read(low, high) + np.random.default_rng(1).normal(0.0, 0.001, (1, unit.strips))
    return Case("concave", unit, [outline], low, high, read, 0.001 * np.sqrt(3.0), "normal", told=True)


def test_a_convex_outline_that_reads_like_a_concave_one_is_found() -> None:
    # k of a convex outline is that of l - c l and u + c (L - u), too: of this quadrilateral one with an inward corner.
    x = np.array([6.0, 50.0, 94.0])
    low, high = np.array([40.0, 34.0, 40.0]), np.array([60.0, 66.0, 60.0])
    c = np.array([0.5, 0.0, 0.5])
    low, high = low - c * low, high + c * (100.0 - high)
    outline = np.column_stack([np.r_[x, x[::-1]], np.r_[low, high[::-1]]])
    found = convex_twins.twin(_case("k", outline))
    assert found.surplus <= 0.0
    assert found.deviations < 1.0
    assert found.iou < 0.8


def test_no_convex_outline_reads_like_a_step() -> None:
    outline = np.array(
        [(6, 40), (94, 40), (94, 45), (61, 45), (61, 90), (39, 90), (39, 45), (6, 45)], dtype=float
    )
    found = convex_twins.twin(_case("kl", outline))
    assert found.surplus > 100.0
    assert found.deviations > 10.0


@pytest.mark.slow
def test_most_wrong_ok_of_one_signature_have_a_convex_twin() -> None:
    """Half of the concave shapes have a twin that nothing tells from them; of pairs likewise."""
    every = convex_twins.table(120, seed=1, effort="fast")[-1].split()
    cases, near, alike, _, wrong, wrong_near = (int(n) for n in every[1:])
    assert near > 0.4 * cases
    assert alike > 0.35 * cases
    assert wrong_near >= 0.5 * wrong

"""Slopes of boundary integrals against differences of their solutions, near a bar and away from it."""

from __future__ import annotations

import numpy as np
import pytest

from tacstrip.arrays import FloatArray
from tacstrip.contact.boundary_integrals import Charges


def charges_on(corners: FloatArray) -> Charges:
    """Solve for all edges but the one along the side."""
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)[[0, 1, 3, 4]]
    charges = Charges.on(edges, 60.0)
    assert charges is not None
    return charges


@pytest.mark.parametrize("above", [0.3, 30.0])
def test_slopes_are_those_of_the_ends(above: float) -> None:
    """A corner on the lower edge and an upright side within the strip; ends are rounded to 1e-7 of the width."""
    corners = np.array([(0.2, 1.2), (0.6, 0.0), (1.0, 0.4), (1.0, 3.3), (0.2, 3.0)])
    corners[:, 1] += above
    by_edges, step = charges_on(corners).slopes(), 1e-3
    slopes = np.zeros((2, 5, 2))
    for edge, first in enumerate((0, 1, 3, 4)):
        slopes[:, first] += by_edges[:, edge, 0]
        slopes[:, (first + 1) % 5] += by_edges[:, edge, 1]
    on_a_side = corners == (1.0, np.nan)
    for place in np.flatnonzero(~on_a_side):
        by = np.zeros(corners.shape)
        by.flat[place] = step
        expected = (charges_on(corners + by).ends - charges_on(corners - by).ends) / (2.0 * step)
        np.testing.assert_allclose(slopes.reshape(2, -1)[:, place], expected, atol=5e-4)

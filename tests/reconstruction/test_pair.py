"""Two objects that may be taken for one concave one."""

from __future__ import annotations

import numpy as np
import pytest

from tacstrip.arrays import FloatArray
from tacstrip.core.convex_chain import convex_regression
from tacstrip.reconstruction.pieces import pair


def test_no_chain_is_fitted_to_no_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """One object may be on all strips; the other's end there has none."""
    sizes: list[int] = []

    def counted(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, int]:
        sizes.append(len(x))
        return convex_regression(x, y, weight)

    monkeypatch.setattr(pair, "convex_regression", counted)
    x = np.arange(12.0)
    low = np.where(x < 6, 20.0, 30.0)
    ends = pair.Ends(x, np.stack([low, np.full(12, 60.0)]), np.full((2, 12), 0.1), 1.0)
    assert pair.likeliest_pair(ends, ([6], [6]), ([6], []), apart=True) is not None
    assert min(sizes) > 0

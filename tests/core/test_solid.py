"""How deep points lie in solids, compiled and in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.binding import SOLID_FRAME, exported
from tacstrip.core.solid import (
    KINDS,
    patch_sums,
    plain_gap,
    plain_patch_sums,
    plain_touch,
    solid_gap,
    solid_touch,
    solid_yields,
)

SOLIDS = (
    ts.Solid.plane(), ts.Solid.sphere(4.0), ts.Solid.cylinder(3.0), ts.Solid.edge(1.2), ts.Solid.box((9.0, 6.0, 4.0)),
    ts.Solid.cone(1.4),
)  # fmt: skip


@pytest.mark.skipif(exported("solid_touch") is None, reason="no compiled core")
@pytest.mark.parametrize("solid", SOLIDS, ids=KINDS)
def test_compiled_and_numpy_agree(solid: ts.Solid) -> None:
    random = np.random.default_rng(3)
    frames = np.stack([
        solid.at(random.uniform(-1.0, 1.0, 3), random.normal(size=3), random.uniform(0.0, 6.0)).frame for _ in range(3)
    ])  # fmt: skip
    assert frames.shape == (3, SOLID_FRAME)
    points = random.uniform(-6.0, 6.0, (3, 3, 400))
    normals = random.normal(size=points.shape)
    normals[:, :, :50] = np.array([0.0, 0.0, 1.0])[:, None, None]
    normals[:, :, 50:150] = frames[:, :9].reshape(3, 3, 3).transpose(1, 2, 0)[random.integers(3)][:, :, None]
    normals /= np.linalg.norm(normals, axis=0)
    touch, yields = solid_yields(solid.kind, frames, points, normals, 3.0)
    shared = solid_touch(solid.kind, frames, points[:, 1:2], None, 3.0)
    for i, frame in enumerate(frames):
        for found, right in zip(
            (touch[i], yields[i]),
            plain_touch(solid.kind, frame, points[:, i], normals[:, i], 3.0),
            strict=True,
        ):
            np.testing.assert_allclose(found, right, atol=1e-9)
        np.testing.assert_allclose(
            shared[i], plain_touch(solid.kind, frame, points[:, 1], None, 3.0)[0], atol=1e-12
        )
        gap = solid_gap(solid.kind, frame, points[:, i], normals[:, i], 0.1)
        np.testing.assert_allclose(
            gap, plain_gap(solid.kind, frame, points[:, i], normals[:, i], 0.1), atol=1e-9
        )
        assert np.isfinite(gap).any()
    assert (touch > 0.0).any()
    p, n = (v[:, 0].reshape(3, 20, 20) for v in (points, normals))
    across, up = random.uniform(0.1, 0.2, 20), random.uniform(0.1, 0.2, 19)
    depth, deep = (np.minimum(v[0], 3.0).reshape(20, 20) for v in (touch, yields))
    np.testing.assert_allclose(
        patch_sums(depth, deep, np.moveaxis(p, 0, -1), np.moveaxis(n, 0, -1), across, up),
        plain_patch_sums(depth, deep, p, n, across, up), rtol=1e-9, atol=1e-9,
    )  # fmt: skip

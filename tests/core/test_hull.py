"""Several outlines on the same strips: no cost at the truth, slopes against differences, descents to the truth."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from rigid_scenes import CORNERS, at, sliding, ten_strips
from tacstrip.arrays import FloatArray
from tacstrip.core.hull import HullScans, available, fit_hull_poses, hull_equations
from tacstrip.core.rigid import RigidScans, equations, loss

pytestmark = pytest.mark.skipif(not available(), reason="compiled only")
SHAPES = [0.5 * CORNERS, 0.6 * np.array([(-25.0, -20.0), (25.0, -20.0), (0.0, 28.0)])]


def scene(construction: str, lam: float) -> tuple[HullScans, FloatArray]:
    """Return exact readings of two shapes on shared strips, and their poses (T, 2, 3)."""
    sensor = ten_strips(construction, lam, strips=20)
    poses = np.stack(
        [sliding(6) + np.array([-5.0, -18.0, 0.0]), sliding(6, -8.0, 3.0, -0.6) + np.array([5.0, 20.0, 1.0])],
        axis=1,
    )
    read = []
    for pose in poses:
        parts = [ts.Contact.polygon(at(s, p)).shapes[0] for s, p in zip(SHAPES, pose, strict=True)]
        read.append(ts.simulate(sensor, ts.Contact(tuple(parts))))
    k = np.stack([np.stack([scan[name] for name in scan.signatures]) for scan in read])
    return HullScans(RigidScans(sensor, read[0].signatures, k, 0.003), np.ones(k.shape[::2])), poses


@pytest.mark.parametrize(("construction", "lam"), [("crs-crs", 0.0), ("crs-crs", 2.0), ("crs-m", 0.0)])
def test_equations_are_those_of_the_readings(construction: str, lam: float) -> None:
    scans, true = scene(construction, lam)
    there, how, step = np.ones(true.shape[:2], dtype=bool), loss(scans.scans), 1e-6
    assert hull_equations(scans, SHAPES, true, there, how).costs.max() < 1e-12
    poses = true + np.random.default_rng(0).normal(0.0, (0.3, 0.3, 0.01), true.shape)
    found = hull_equations(scans, SHAPES, poses, there, how)
    for i in range(6):
        move = step * np.eye(6)[i].reshape(2, 3)
        up, down = (hull_equations(scans, SHAPES, poses + s * move, there, how).costs for s in (1.0, -1.0))
        slope = -(up - down) / (4.0 * step)
        np.testing.assert_allclose(found.pose_slope[:, i], slope, atol=1e-6 * np.abs(found.pose_slope).max())
    for i in range(16):
        move = step * np.eye(16)[i].reshape(8, 2)
        up, down = (
            hull_equations(
                scans, [SHAPES[0] + s * move[:5], SHAPES[1] + s * move[5:]], poses, there, how
            ).costs.sum()
            for s in (1.0, -1.0)
        )
        assert found.shape_slope[i] == pytest.approx(
            -(up - down) / (4.0 * step), abs=1e-5 * np.abs(found.shape_slope).max()
        )
    ended, costs = fit_hull_poses(
        scans, SHAPES, poses[:, None], poses[:, None], np.zeros(1), loss(scans.scans, 0.15, 6.0), 20
    )
    ended, costs = fit_hull_poses(scans, SHAPES, ended, ended, np.zeros(1), how, 20)
    assert (costs.ravel() < 1.0).sum() >= 4
    assert np.median(np.abs(ended[:, 0] - true)) < 1e-3


def test_one_outline_alone_is_a_rigid_one() -> None:
    """Where the other is absent, costs and slopes are those of one object's own equations."""
    scans, true = scene("crs-crs", 2.0)
    there = np.zeros(true.shape[:2], dtype=bool)
    there[:, 0] = True
    sensor = scans.scans.sensor
    read = [ts.simulate(sensor, ts.Contact.polygon(at(SHAPES[0], p))) for p in true[:, 0]]
    k = np.stack([np.stack([scan[name] for name in scan.signatures]) for scan in read])
    alone = RigidScans(sensor, read[0].signatures, k, 0.003)
    poses = true + np.array([0.01, 0.02, 0.001])
    found = hull_equations(HullScans(alone, scans.known), SHAPES, poses, there, loss(alone))
    plain = equations(alone, SHAPES[0], poses[:, 0], loss(alone))
    np.testing.assert_allclose(found.costs, plain.costs, rtol=1e-9)
    np.testing.assert_allclose(found.pose_slope[:, :3], plain.pose_slope, rtol=1e-9)
    assert not found.pose_slope[:, 3:].any()

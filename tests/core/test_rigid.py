"""One outline in many scans: the compiled core against NumPy, slopes against differences, descents to the minimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigid_scenes import CORNERS, distance, rigid_scene, sliding
from tacstrip.core import rigid, rigid_path
from tacstrip.core.rigid import (
    Prior,
    RigidScans,
    descend,
    equations,
    fit_poses,
    linearised,
    loss,
    plain_equations,
    plain_linearised,
    reduced,
    walk,
)
from tacstrip.tracking.rigid.covariance import rigid_motions
from tacstrip.tracking.rigid.smooth_path import Path, circle, fit_corners, fit_path, spline_basis

SCENES = [("crs-crs", 0.0), ("crs-crs", 2.0), ("crs-m", 0.0)]
LOSSES = [(0.0, 0.0, 0.05), (0.5, 3.0, 0.25)]


@pytest.fixture
def in_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rigid, "exported", lambda name: None)


@pytest.mark.parametrize(("construction", "lam"), SCENES)
@pytest.mark.parametrize("how", LOSSES)
def test_equations_are_those_of_numpy(construction: str, lam: float, how: tuple[float, float, float]) -> None:
    scans, corners, poses = rigid_scene(construction, lam)
    found = equations(scans, corners, poses, loss(scans, *how))
    plain = plain_equations(scans, corners, poses, loss(scans, *how))
    for name, value in vars(plain).items():
        np.testing.assert_allclose(
            getattr(found, name), value, rtol=1e-9, atol=1e-9 * np.abs(value).max(), err_msg=name
        )


def test_an_end_lies_anywhere_short_of_the_next_strip_that_is_read() -> None:
    """Strips beside the contact are left out: nobody knows whether the outline reaches over them."""
    scans, corners, poses = rigid_scene("crs-crs", 0.0)
    assert scans.reached == slice(2, 8)
    unknown = replace(scans, sensor=replace(scans.sensor, without=("0", "1", "8")))
    assert unknown.gaps_mm[0, 1:3].tolist() == [np.inf, np.inf]
    assert unknown.gaps_mm[:, 7].tolist() == [10.0, 20.0]
    how, wide = loss(scans), 1.5 * corners
    found, plain = equations(unknown, wide, poses, how), plain_equations(unknown, wide, poses, how)
    np.testing.assert_allclose(found.costs, plain.costs, rtol=1e-9)
    cheaper = (
        equations(scans, wide, poses, how).costs - found.costs
    )  # by what the ends cost, for the readings are alike
    touched = np.asarray(np.isfinite(scans.k).any(axis=1))
    beside = touched[:, 2] | touched[:, 7]
    assert (cheaper[beside] > 1.0).any()
    np.testing.assert_allclose(cheaper[~beside], 0.0, atol=1e-6)


@pytest.mark.parametrize(("construction", "lam"), SCENES)
def test_readings_and_their_slopes_are_those_of_numpy(construction: str, lam: float) -> None:
    scans, corners, poses = rigid_scene(construction, lam)
    found, plain = linearised(scans, corners, poses), plain_linearised(scans, corners, poses)[0]
    np.testing.assert_allclose(found.model, plain.model, atol=1e-12)
    np.testing.assert_allclose(found.rows, plain.rows, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("construction", "lam"), SCENES)
def test_slopes_are_differences_of_costs(construction: str, lam: float) -> None:
    scans, corners, poses = rigid_scene(construction, lam)
    how, step = loss(scans), 1e-5
    found = equations(scans, corners, poses, how)

    def cost(c: np.ndarray, p: np.ndarray) -> np.ndarray:
        return equations(scans, c, p, how).costs

    for i in range(3):
        off = step * np.eye(3)[i]
        slope = -(cost(corners, poses + off) - cost(corners, poses - off)) / (4.0 * step)
        np.testing.assert_allclose(found.pose_slope[:, i], slope, atol=1e-5 * np.abs(found.pose_slope).max())
    for i in range(corners.size):
        off = step * np.eye(corners.size)[i].reshape(-1, 2)
        slope = -(cost(corners + off, poses) - cost(corners - off, poses)).sum() / (4.0 * step)
        np.testing.assert_allclose(found.shape_slope[i], slope, atol=1e-5 * np.abs(found.shape_slope).max())


@pytest.mark.parametrize(("construction", "lam"), SCENES)
def test_descents_end_where_those_of_numpy_do(
    construction: str, lam: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans, corners, poses = rigid_scene(construction, lam)
    joint, single = (
        descend(scans, corners, poses, loss(scans)),
        fit_poses(scans, corners, poses[:, None], loss(scans)),
    )
    monkeypatch.setattr(rigid, "exported", lambda name: None)
    plain = descend(scans, corners, poses, loss(scans))
    for found, wanted in zip(joint, plain, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())
    for found, wanted in zip(single, fit_poses(scans, corners, poses[:, None], loss(scans)), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())


def test_what_is_known_beside_stands_for_the_scans_that_told_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the scans as a prior, the others with free poses: where all end; in NumPy as in the core."""
    scans, corners, poses = rigid_scene("crs-crs", 0.0, 24)
    corners, poses, _ = descend(scans, corners, poses, loss(scans))
    start = corners + 0.02
    old, new = scans.of(slice(0, 12)), scans.of(slice(12, 24))
    information, slope, _ = reduced(equations(old, corners, poses[:12], loss(scans)), pinned=0.0)
    motions = np.linalg.qr(rigid_motions(corners))[0]
    prior = Prior(information + 100.0 * motions @ motions.T, slope, corners)
    found = descend(new, start, poses[12:], loss(scans), prior=prior)
    monkeypatch.setattr(rigid, "exported", lambda name: None)
    plain = descend(new, start, poses[12:], loss(scans), prior=prior)
    for one, wanted in zip(found, plain, strict=True):
        np.testing.assert_allclose(one, wanted, atol=1e-6 * np.abs(wanted).max())
    np.testing.assert_allclose(found[0], corners, atol=2e-3)
    alone, _, _ = descend(new, start, poses[12:], loss(scans))
    assert distance(alone, corners) > 0.02


@pytest.mark.parametrize(("construction", "lam"), SCENES)
def test_a_walk_goes_where_that_of_numpy_does(
    construction: str, lam: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of corners and of poses some trials are taken and some not, and costs are those of the last taken."""
    scans, corners, poses = rigid_scene(construction, lam)
    corners, poses, costs = descend(scans, corners, poses, loss(scans))
    random, many = np.random.default_rng(1), len(poses)
    _, _, inverse = reduced(found := equations(scans, corners, poses, loss(scans)))
    moves, above = random.normal(0.0, 0.03, (40, *corners.shape)), -2.0 * np.log(random.random(40))
    pose_moves = random.normal(0.0, [0.1, 0.1, 0.01], (40, 2, many, 3))
    tries = moves, above, pose_moves, -2.0 * np.log(random.random((40, 2, many)))

    def walk_of() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return walk(scans, corners, poses, costs, inverse @ found.mixed, tries)

    walked, last, their = walk_of()
    monkeypatch.setattr(rigid, "exported", lambda name: None)
    for one, wanted in zip((walked, last, their), walk_of(), strict=True):
        np.testing.assert_allclose(one, wanted, atol=1e-6)
    taken = (np.diff(walked, axis=0) != 0.0).any(axis=(1, 2))
    assert 3 < taken.sum() < 36
    np.testing.assert_allclose(plain_equations(scans, walked[-1], last, loss(scans)).costs, their)


def test_a_descent_finds_the_outline(in_numpy: None) -> None:
    scans, corners, poses = rigid_scene("crs-crs", 0.0)
    found, _, costs = descend(scans, corners, poses, loss(scans))
    assert distance(found, CORNERS) < 0.3 < distance(corners, CORNERS)
    assert costs.sum() < 1.3 * scans.readings.sum()


def test_eliminating_the_poses_leaves_the_corners_part_of_the_whole_inverse() -> None:
    scans, corners, poses = rigid_scene("crs-crs", 0.0, 6)
    found = equations(scans, corners, poses, loss(scans))
    many, size = 3 * len(poses), corners.size
    whole = np.zeros((many + size, many + size))
    for i, (pose, mixed) in enumerate(zip(found.pose, found.mixed, strict=True)):
        at = slice(3 * i, 3 * i + 3)
        whole[at, at] = pose + (rigid.PINNED * np.eye(3) if i == len(poses) // 2 else 0.0)
        whole[at, many:], whole[many:, at] = mixed, mixed.T
    whole[many:, many:] = found.shape
    wanted = np.linalg.inv(whole)[many:, many:]
    np.testing.assert_allclose(
        np.linalg.inv(reduced(found)[0]), wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max()
    )


def test_scans_without_readings_cost_nothing() -> None:
    scans, corners, _ = rigid_scene("crs-crs", 0.0, 3)
    empty = RigidScans(scans.sensor, scans.names, np.full_like(scans.k, np.nan), scans.sigma)
    for found in (equations, plain_equations):
        assert not found(empty, corners, sliding(3), loss(empty)).costs.any()


@pytest.mark.parametrize(("construction", "lam"), SCENES)
@pytest.mark.parametrize("knots", [5, 20])
def test_descents_of_a_path_end_where_those_of_numpy_do(
    construction: str, lam: float, knots: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Radii with a prior on a spline, and with as many knots as scans; corners without a prior on the spline."""
    scans, corners, poses = rigid_scene(construction, lam)
    basis = spline_basis(np.linspace(0.0, 1.0, len(poses)), knots)
    path = replace(circle(scans, basis).turning(1.0), basis=basis)

    def both() -> list[np.ndarray]:
        found = fit_path(scans, path, 6, tolerance=0.07, cauchy=3.0, rough=0.07, end=0.25)
        at_knots = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0], dtype=np.float64)
        fit = fit_corners(scans, corners, at_knots, basis, loss(scans, 0.5, 3.0), 6)
        return [found.radii, found.knots, np.array(found.cost), *fit]

    compiled = both()
    for module in (rigid, rigid_path):
        monkeypatch.setattr(module, "exported", lambda name: None)
    for found, wanted in zip(compiled, both(), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())
    assert compiled[2] < 0.5 * _circle_cost(scans, path)


def _circle_cost(scans: RigidScans, path: Path) -> float:
    """Return what a circle on the way of the contact's middle costs."""
    how = loss(scans, 0.07 * float(path.radii.mean()), 3.0, 0.25)
    return float(equations(scans, path.corners, path.poses, how).costs.sum())

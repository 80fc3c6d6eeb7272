"""An outline that one stretch of scans told along a smooth path, in another stretch along a path of its own.

One signature of few strips leaves the outline of a stretch open; two stretches tell more, if each has a path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans, loss
from tacstrip.core.rigid_path import OnPath, OutlineNumbers, descend_path
from tacstrip.geometry.pose import placed
from tacstrip.tracking.rigid.corners import Fit, fitted, poses_all_round, pruned
from tacstrip.tracking.rigid.smooth_path import (
    Path,
    centres,
    fit_path,
    one_after_another,
    radii_of,
    spline_basis,
)

_LOOKS, _ANGLES = 7, 36  # scans whose poses are tried all round, and at how many angles
_TURNS = np.radians(np.arange(-160, 161, 20))  # from the first to the last scan
_OFF, _MOST = 0.15, 30.0  # radians that a scan may be off an even turn, and what a scan costs at most
_TRIED, _KEPT = 8, 3  # even turns that become paths, and of these the ones that are fitted
# Tolerance over the radius, that of ends over the pitch, and steps.
_ROUGH, _FINER = ((0.07, 0.25, 8), (0.023, 0.1, 6)), ((0.023, 0.25, 10), (0.012, 0.1, 6))
_BENT = 0.09  # of a rough outline, see `fit_path`
_KNOTS = (4, 8)


def joined(known: RigidScans, fits: Sequence[Fit], more: RigidScans) -> Iterator[Fit]:
    """Yield fits of known scans and further ones, from fits of the known ones on splines; those most at hand first.

    Then what such outlines become while they are rough: of few scans they may lack corners.
    """
    together = replace(known, k=np.concatenate([known.k, more.k]))
    soft, (smooth, freer) = 0.05 * known.sensor.pitch_mm, (_spline(len(more.k), knots) for knots in _KNOTS)
    starts = [
        Fit(fit.corners, np.concatenate([fit.poses, path]), fit.costs, one_after_another([fit.basis, smooth]))
        for fit in fits
        if fit.basis is not None
        for path in _paths(more, fit.corners, smooth)
    ]
    rough = [fitted(together, f.corners, f.poses, 10, soft, 5.0, f.basis) for f in starts]
    ends = [fitted(together, f.corners, f.poses, basis=f.basis) for f in rough]
    yield min(ends, key=lambda f: f.cost)
    path = min((_rough(together, start) for start in starts), key=lambda p: p.cost)
    yield _polygon(together, path)
    own = path.basis[: len(known.k), : -smooth.shape[1]]
    yield _polygon(together, _bent(together, path.refined(one_after_another([own, freer])), _FINER))


def _spline(scans: int, knots: int) -> FloatArray:
    return spline_basis(np.linspace(0.0, 1.0, scans), min(knots, scans), straight=True)


def _polygon(scans: RigidScans, path: Path) -> Fit:
    """Return the best polygon that a rough outline becomes."""
    return min(pruned(scans, path.corners, path.poses, path.basis), key=lambda f: f.criterion(scans))


def _bent(scans: RigidScans, path: Path, stages: tuple[tuple[float, float, int], ...]) -> Path:
    for tolerance, end, steps in stages:
        path = fit_path(scans, path, steps, tolerance=tolerance, cauchy=3.0, rough=_BENT, end=end)
    return path


def _rough(scans: RigidScans, fit: Fit) -> Path:
    """Return what becomes of an outline on a path as a rough one."""
    assert fit.basis is not None
    poses, middle = fit.poses.copy(), fit.corners.mean(axis=0)
    poses[:, :2] = [placed(middle[None], pose)[0] for pose in fit.poses]
    knots = np.asarray(np.linalg.lstsq(fit.basis, poses, rcond=None)[0], dtype=np.float64)
    return _bent(scans, Path(radii_of(fit.corners), knots, fit.basis, np.inf), _ROUGH)


def _paths(scans: RigidScans, corners: FloatArray, basis: FloatArray) -> list[FloatArray]:
    """Return poses (T, 3) of a known outline on a spline, the best first."""
    own = corners.mean(axis=0)
    radius = float(np.hypot(*(corners - own).T).mean())
    every = np.linspace(-0.5, 0.5, len(scans.k))
    some = np.unique(np.linspace(0, len(scans.k) - 1, _LOOKS).astype(int))
    near, costs = poses_all_round(scans.of(some), corners, 0.05 * radius, _ANGLES, _ANGLES)
    first = np.arange(_ANGLES) * (2.0 * np.pi / _ANGLES)
    even = first[:, None, None] + _TURNS[:, None] * every[some]  # (angles, turns, scans)
    off = np.angle(np.exp(1j * (even[..., None] - near[..., 2]))) / _OFF
    cost = (np.minimum(costs, _MOST) + off**2).min(axis=-1).sum(axis=-1)
    size = OutlineNumbers(np.zeros(corners.size, dtype=np.int64), corners.ravel(), np.zeros((1, 1)))
    middle, found = centres(scans)[0], list[tuple[float, FloatArray]]()
    for place in np.argsort(cost, axis=None, kind="stable")[:_TRIED]:
        at, turn = np.unravel_index(place, cost.shape)
        angle = first[at] + _TURNS[turn] * every
        cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
        start = np.column_stack([middle - cos * own - sin * [-own[1], own[0]], angle])
        path = OnPath(np.ones(1), np.linalg.lstsq(basis, start, rcond=None)[0])
        for tolerance, end, steps in _ROUGH:
            how = loss(scans, tolerance * radius, 3.0, end)
            path = descend_path(scans, size, path, basis, how, steps, 1e-3)
        found.append((path.cost, basis @ path.knots))
    return [poses for _, poses in sorted(found, key=lambda pair: pair[0])[:_KEPT]]

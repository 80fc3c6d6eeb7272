"""Shape and poses from the readings alone."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.interpolate import CubicSpline

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans, fit_poses, loss
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.tracking.rigid.corners import (
    Fit,
    bad_scans,
    fitted,
    poses_all_round,
    pruned,
    recounted,
    rescued,
    settled,
)
from tacstrip.tracking.rigid.smooth_path import Path, circle, fit_path, spline_basis

_TURNS, _FINE_TURNS = (np.radians(np.arange(-160, 161, step)) for step in (20, 10))
_DENSE, _MANY_STRIPS, _SPARSE = 48, 20, 16  # scans that a search uses; of finer sensors fewer do
_KNOTS, _MORE_KNOTS = 4, 8
_KEPT = 3  # paths that are made polygons of
_SATISFIED = 1.15  # of the freedom: a chi square that ends the search
_ALARM, _HARDLY_MORE = 3.5, 1.05  # deviations of chi square, and times the freedom
_WITHIN, _WORTH_SETTLING = (
    10.0,
    1.6,
)  # of the criterion, and of the freedom: fits that may explain the readings as well
_COARSE, _FINER, _FINEST = 0.07, 0.023, 0.012  # tolerances of edges, over the outline's radius
_ROUGH, _SMOOTHER = 0.07, 0.09  # the radii's second differences, likewise
_REFERENCES = 3  # of a search without a path: scans that it begins with ...
_EASED = (0.04, 0.025, 0.016)  # ... and the tolerance of each round from one of them
_RANDOM_SCANS = 40


def content(scans: RigidScans, fit: Fit, distribution: str) -> bool:
    """Whether the fit leaves no more of the readings than noise does, or hardly more where they are very many."""
    freedom = fit.freedom(scans)
    return (
        fit.cost <= _HARDLY_MORE * freedom
        or chi_square_score(np.sqrt(fit.costs), freedom, distribution) <= _ALARM
    )


@dataclass(frozen=True, eq=False)
class Found:
    """What a search ended with.

    Attributes
    ----------
    fit
        Of all scans.
    chosen
        Scans that the rivals are fits of (K,).
    rivals
        Fits that explain these about as well, but for the best one, and how much worse their criterion is.
    """

    fit: Fit
    chosen: IntArray
    rivals: tuple[tuple[Fit, float], ...] = ()

    @property
    def others(self) -> list[tuple[FloatArray, float]]:
        """The rivals' corners in the fit's frame, each with its weight against all others, the fit's included."""
        odds = [math.exp(-0.5 * max(worse, 0.0)) for _, worse in self.rivals]
        total, middle, found = 1.0 + sum(odds), len(self.chosen) // 2, []
        for (fit, _), one in zip(self.rivals, odds, strict=True):
            outline = placed(fit.corners, fit.poses[middle])
            found.append((in_frame(outline, self.fit.poses[self.chosen[middle]]), one / total))
        return found

    @property
    def spread_mm(self) -> float:
        """How far the rivals' outlines are from the fit's, at most: Hausdorff's distance."""
        own = shapely.Polygon(self.fit.corners).buffer(0)
        return max(
            (float(shapely.Polygon(o).buffer(0).hausdorff_distance(own)) for o, _ in self.others), default=0.0
        )


def search(scans: RigidScans, distribution: str, thorough: bool = True) -> Found:
    """Return the fit of all scans that explains them best, and what else does.

    Along a smooth path first; where that explains the readings badly, and if thorough, with more turns, then without a
    path.
    """
    found = _along_a_path(scans, _TURNS, _KEPT, distribution)
    if not thorough:
        return found
    if not content(scans, found.fit, distribution):
        found = min(
            found,
            _along_a_path(scans, _FINE_TURNS, 2 * _KEPT, distribution),
            key=lambda f: f.fit.criterion(scans),
        )
    if not content(scans, found.fit, distribution):
        found = min(
            found, Found(_without_path(scans), np.arange(len(scans.k))), key=lambda f: f.fit.criterion(scans)
        )
    return found


def _along_a_path(scans: RigidScans, turns: Iterable[float], kept: int, distribution: str) -> Found:
    total = len(scans.k)
    many = _SPARSE if scans.k.shape[2] > _MANY_STRIPS else _DENSE
    chosen = np.unique(np.linspace(0, total - 1, min(total, many)).astype(int))
    few, place = scans.of(chosen), chosen / max(total - 1, 1)
    soft, fine = 0.25, 0.1
    coarse = spline_basis(place, min(_KNOTS, len(chosen)))
    paths = []
    for turn in turns:
        path = circle(few, coarse, turn)
        path = fit_path(few, path, 8, tolerance=_COARSE, cauchy=3.0, rough=_ROUGH, end=soft)
        paths.append(fit_path(few, path, 6, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=soft))
    paths.sort(key=lambda p: p.cost)
    finer = spline_basis(place, min(_MORE_KNOTS, len(chosen)))
    refined = []
    for path in paths[: 2 * kept]:
        path = fit_path(few, path.refined(finer), 10, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=soft)
        refined.append(fit_path(few, path, 6, tolerance=_FINEST, cauchy=3.0, rough=_SMOOTHER, end=fine))
    paths = refined
    paths.sort(key=lambda p: p.cost)
    fits: list[Fit] = []
    for path in paths[:kept]:
        fits += pruned(few, path.corners, path.poses)
    fits.sort(key=lambda f: f.criterion(few))
    fit = _on_all(scans, chosen, fits[0])
    own = Fit(fit.corners, fit.poses[chosen], fit.costs[chosen])
    return Found(fit, chosen, _rivals(few, own, fits, distribution))


def _rivals(
    scans: RigidScans, best: Fit, fits: list[Fit], distribution: str
) -> tuple[tuple[Fit, float], ...]:
    """Return the fits that explain the readings about as well as the best one, and how much worse each is."""
    found = []
    for fit in fits:
        if fit.cost > _WORTH_SETTLING * fit.freedom(scans):
            continue
        fit = settled(scans, fit)
        worse = fit.criterion(scans) - best.criterion(scans)
        if content(scans, fit, distribution) and worse <= _WITHIN:
            found.append((fit, worse))
    return tuple(found)


def _on_all(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans as one of all, settled and recounted."""
    poses = fit.poses
    if len(chosen) < len(scans.k):
        poses = CubicSpline(chosen, poses)(np.arange(len(scans.k)))
        rough = fitted(scans, fit.corners, poses, 6, 0.05 * scans.sensor.pitch_mm, 5.0)
        fit = fitted(scans, rough.corners, rough.poses)
    else:
        fit = fitted(scans, fit.corners, poses)
    return recounted(scans, settled(scans, rescued(scans, fit)))


def _without_path(scans: RigidScans) -> Fit:
    """Return a fit that takes poses for independent: a scan's own outline, poses of all others on it, and again."""
    total = len(scans.k)
    chosen = np.unique(np.linspace(0, total - 1, min(total, _RANDOM_SCANS)).astype(int))
    few = scans.of(chosen)
    order = np.argsort(-few.readings, kind="stable")
    references = order[:: max(1, len(order) // (2 * _REFERENCES))][:_REFERENCES]
    free, best = np.eye(len(chosen)), None
    for reference in references:
        alone = few.of([reference])
        path = circle(alone, np.ones((1, 1)), 0.0)
        path = fit_path(alone, path, 20, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=0.25)
        for tolerance in _EASED:
            near = poses_all_round(few, path.corners, tolerance * float(path.radii.mean()), 24, 3)[0]
            path = Path(path.radii, _wrapped(near[:, 0]), free, np.inf)
            path = fit_path(few, path, 10, tolerance=tolerance, cauchy=3.0, rough=_ROUGH, end=0.1)
        fit = min(pruned(few, path.corners, path.poses), key=lambda f: f.criterion(few))
        fit = settled(few, rescued(few, fit))
        if best is None or fit.criterion(few) < best.criterion(few):
            best = fit
        if fit.cost < _SATISFIED * fit.freedom(few):
            break
    assert best is not None
    if len(chosen) < total:
        poses = poses_all_round(scans, best.corners, 0.05 * scans.sensor.pitch_mm)[0][:, 0]
        best = settled(scans, fitted(scans, best.corners, poses))
    return recounted(scans, best)


def _wrapped(poses: FloatArray) -> FloatArray:
    return np.column_stack([poses[:, :2], (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi])


def with_all_poses(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans with the poses of all: from those next to it, and all round where that fails."""
    if len(chosen) == len(scans.k):
        return fit
    start = np.stack(
        [np.interp(np.arange(len(scans.k)), chosen, p) for p in np.unwrap(fit.poses, axis=0).T], axis=1
    )
    poses, costs = fit_poses(
        scans, fit.corners, start[:, None], loss(scans, 0.05 * scans.sensor.pitch_mm, 5.0), 8
    )
    poses, costs = fit_poses(scans, fit.corners, poses, loss(scans), 12)
    found = Fit(fit.corners, poses[:, 0], costs[:, 0])
    bad = bad_scans(scans, found)
    if len(bad):
        others, cost = poses_all_round(scans.of(bad), fit.corners, 0.05 * scans.sensor.pitch_mm)
        better = cost[:, 0] < found.costs[bad]
        found.poses[bad[better]], found.costs[bad[better]] = others[better, 0], cost[better, 0]
    return found


def recognised(known: RigidScans, fit: Fit, scans: RigidScans, distribution: str) -> Fit | None:
    """Return the fit of known scans and further ones, where the known outline explains these too; else None."""
    middle, last = len(scans.k) // 2, len(scans.k)
    soft, exact = loss(scans, 0.05 * scans.sensor.pitch_mm, 6.0), loss(scans)
    best, least = None, np.inf
    for start in poses_all_round(scans.of([middle]), fit.corners, 0.05 * scans.sensor.pitch_mm, kept=8)[0][0]:
        poses, costs = np.empty((last, 3)), np.empty(last)
        for way in (range(middle, last), range(middle, -1, -1)):
            pose = start
            for i in way:
                one = scans.of([i])
                found = fit_poses(one, fit.corners, pose[None, None], soft, 5)[0]
                found, cost = fit_poses(one, fit.corners, found, exact, 8)
                pose = poses[i] = found[0, 0]
                costs[i] = cost[0, 0]
        if costs.sum() < least:
            best, least = poses, float(costs.sum())
    assert best is not None
    together = replace(known, k=np.concatenate([known.k, scans.k]))
    joint = fitted(together, fit.corners, np.concatenate([fit.poses, best]), 10, cauchy=5.0)
    joint = settled(together, rescued(together, fitted(together, joint.corners, joint.poses)))
    part = Fit(joint.corners, joint.poses[-last:], joint.costs[-last:])
    return joint if content(scans, part, distribution) and content(together, joint, distribution) else None


def placed(corners: FloatArray, pose: FloatArray) -> FloatArray:
    """Return corners (N, 2) of a frame at a pose (3,) on the sensor."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def in_frame(corners: FloatArray, pose: FloatArray) -> FloatArray:
    """Return corners (N, 2) on the sensor as the frame at a pose (3,) has them."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((corners - pose[:2]) @ np.array([[cos, -sin], [sin, cos]]))

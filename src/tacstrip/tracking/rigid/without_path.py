"""A rigid outline in scans whose poses follow no path: each may lie anyhow."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import (
    MOST_BAD,
    Fit,
    bad_scans,
    fitted,
    poses_all_round,
    pruned,
    rescued,
    settled,
    unstuck,
)
from tacstrip.tracking.rigid.found import WORTH_SETTLING, content
from tacstrip.tracking.rigid.hopping import hopped
from tacstrip.tracking.rigid.smooth_path import Path, circle, fit_path
from tacstrip.tracking.rigid.starts import DENSE, FINER, MANY_STRIPS, ROUGH, chosen_scans, with_some_strips

_SATISFIED = 1.15  # of the freedom: a chi square that ends the search
_REFERENCES = 3  # of a search without a path: scans that it begins with ...
_EASED = (0.04, 0.025, 0.016)  # ... and the tolerance of each round from one of them
_RANDOM_SCANS = 40
# Scans that hops explain, first of few and then of more, and how many hops each.
_HOPPED = ((24, 12), (DENSE, 4))


def best_without_path(scans: RigidScans) -> Fit:
    """Return a fit that takes poses for independent: a scan's own outline, poses of all others on it, and again."""
    total, chosen = len(scans.k), chosen_scans(scans, _RANDOM_SCANS)
    few = scans.of(chosen)
    thinned = with_some_strips(few)
    order = np.argsort(-few.readings, kind="stable")
    references = order[:: max(1, len(order) // (2 * _REFERENCES))][:_REFERENCES]
    free, best = np.eye(len(chosen)), None
    for reference in references:
        path = circle(few.of([reference]), np.ones((1, 1)))
        path = fit_path(thinned.of([reference]), path, 20, tolerance=FINER, cauchy=3.0, rough=ROUGH, end=0.25)
        for tolerance in _EASED:
            near = poses_all_round(thinned, path.corners, tolerance * float(path.radii.mean()), 24, 3)[0]
            path = Path(path.radii, _wrapped(near[:, 0]), free, np.inf)
            path = fit_path(thinned, path, 10, tolerance=tolerance, cauchy=3.0, rough=ROUGH, end=0.1)
        fit = min(pruned(few, path.corners, path.poses), key=lambda f: f.criterion(few))
        hopeless = len(bad_scans(few, fit)) > MOST_BAD * len(chosen)
        if not hopeless:
            fit = settled(few, rescued(few, fit))
        if best is None or fit.criterion(few) < best.criterion(few):
            best = fit
        # one scan of many strips shows an outline that explains others, if it is rigid
        if fit.cost < _SATISFIED * fit.freedom(few) or (hopeless and scans.k.shape[2] > MANY_STRIPS):
            break
    assert best is not None
    if len(chosen) < total:
        poses = poses_all_round(scans, best.corners, 0.05 * scans.sensor.pitch_mm)[0][:, 0]
        best = settled(scans, fitted(scans, best.corners, poses))
    return best if best.cost > WORTH_SETTLING * best.freedom(scans) else unstuck(scans, best)


def hopped_fit(scans: RigidScans, distribution: str, known: FloatArray | None = None) -> Fit:
    """Return a fit that takes poses for independent, of one signature of few strips.

    Some of the scans tell an outline in half the time that all of them take; then hops go on from it with more.
    `known`: corners (N, 2) [mm] of what was found before some readings were left out, to go on from at once.
    """
    corners = known
    for count, hops in _HOPPED if known is None else _HOPPED[1:]:
        chosen = np.unique(np.linspace(0, len(scans.k) - 1, min(len(scans.k), count)).astype(int))
        few = scans.of(chosen)

        def explains(fit: Fit, few: RigidScans = few) -> bool:
            return content(few, fit, distribution)

        fit = hopped(few, explains, corners, hops)
        corners = fit.corners
    if len(chosen) < len(scans.k):
        poses = poses_all_round(scans, fit.corners, 0.05 * scans.sensor.pitch_mm)[0][:, 0]
        fit = settled(scans, fitted(scans, fit.corners, poses))
    return fit if fit.cost > WORTH_SETTLING * fit.freedom(scans) else unstuck(scans, fit)


def _wrapped(poses: FloatArray) -> FloatArray:
    return np.column_stack([poses[:, :2], (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi])

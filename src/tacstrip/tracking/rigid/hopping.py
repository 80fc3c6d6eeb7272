"""An outline of which each scan tells hardly more than a pose, and whose poses follow no path: basin hopping.

One signature of a few strips has four or five readings a scan, and three of them are the pose's: fifty scans hold the
outline, but the cost has a minimum for every set of wrong turns. A rough outline finds poses of all scans all round
while the tolerance of its edges falls, polygons made of it find them again, and the best is bent and tried again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import Fit, fitted, poses_all_round, pruned, settled
from tacstrip.tracking.rigid.smooth_path import LEAST, RADII, Path, centres, fit_path, radii_of

_STARTS, _HOPS = 5, 24  # outlines that are bent circles, and tries from the best so far
_IDLE = 2  # tries that found no better one, before one that explains the scans is believed
_BENT, _BENT_AGAIN = 0.18, 0.12  # of the radius, by two waves round the outline; three and four are smaller
_WAVES = (1.0, 0.7, 0.4)
_TOLERANCES = (0.1, 0.07, 0.05, 0.035, 0.025, 0.016)  # of edges, over the radius
_AGAIN = (0.05, 0.03, 0.016)
_TURNS, _TURNED = 24, 3  # poses all round, and how many are refined
_PRUNED = 2  # polygons of a rough outline that poses are found of again
_SHARP, _ROUNDS = 0.02, 6  # tolerance of a polygon's poses all round, and how often they are looked for
_ROUGH, _END = 0.07, 0.1  # see `fit_path`
_ANGLES = 2.0 * np.pi * np.arange(RADII) / RADII


def hopped(scans: RigidScans, explains: Callable[[Fit], bool]) -> Fit:
    """Return the best fit of scans whose poses are independent; the same for the same scans.

    Parameters
    ----------
    scans
        Of one object.
    explains
        Whether a fit leaves no more than noise.
    """
    random, free = np.random.default_rng(0), np.eye(len(scans.k))
    round_ = np.full(RADII, float(np.sqrt(np.median(centres(scans)[1]) / np.pi)))

    def tried(radii: FloatArray, tolerances: tuple[float, ...]) -> Fit:
        path = Path(radii, np.empty((len(free), 3)), free, np.inf)
        for tolerance in tolerances:
            near = poses_all_round(
                scans, path.corners, tolerance * float(path.radii.mean()), _TURNS, _TURNED
            )[0]
            path = replace(path, knots=near[:, 0])
            path = fit_path(scans, path, 10, tolerance=tolerance, cauchy=3.0, rough=_ROUGH, end=_END)
        polygons = sorted(pruned(scans, path.corners, path.poses), key=lambda f: f.criterion(scans))
        again = [_posed_again(scans, f, _SHARP * float(path.radii.mean())) for f in polygons[:_PRUNED]]
        return min(again, key=lambda f: f.criterion(scans))

    best = min(
        (tried(_bent(round_, _BENT, random), _TOLERANCES) for _ in range(_STARTS)),
        key=lambda f: f.criterion(scans),
    )
    idle = 0
    for _ in range(_HOPS):
        if idle >= _IDLE and explains(best):
            break
        new = tried(_bent(radii_of(best.corners), _BENT_AGAIN, random), _AGAIN)
        better = new.criterion(scans) < best.criterion(scans) - 0.5
        best, idle = (new, 0) if better else (best, idle + 1)
    return best


def _posed_again(scans: RigidScans, fit: Fit, tolerance_mm: float) -> Fit:
    """Return the fit with all poses searched for all round, as long as that makes it better."""
    for _ in range(_ROUNDS):
        near = poses_all_round(scans, fit.corners, tolerance_mm, _TURNS, _TURNED)[0]
        new = settled(scans, fitted(scans, fit.corners, near[:, 0], 15), 2)
        if new.cost > fit.cost - 0.5:
            break
        fit = new
    return fit


def _bent(radii: FloatArray, by: float, random: np.random.Generator) -> FloatArray:
    """Return radii with waves round the outline, two, three and four of them, that are normally distributed."""
    phase = _ANGLES + random.uniform(0.0, 2.0 * np.pi, (len(_WAVES), 1))
    size = by * np.array(_WAVES) * random.normal(size=len(_WAVES))
    waves = np.cos(np.arange(2, 2 + len(_WAVES))[:, None] * phase)
    return np.asarray(radii * np.maximum(1.0 + size @ waves, LEAST))

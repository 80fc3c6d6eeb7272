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
from tacstrip.core.rigid import RigidScans, fit_poses, loss
from tacstrip.tracking.rigid.corners import Fit, best_of, fitted, pruned, settled, starts_all_round
from tacstrip.tracking.rigid.smooth_path import LEAST, RADII, Path, centres, fit_path, radii_of

_STARTS, _HOPS = 5, 24  # outlines that are bent circles, and tries from the best so far
_IDLE = 2  # tries that found no better one, before one that explains the scans is believed
_BENT, _BENT_AGAIN = 0.18, 0.12  # of the radius, by two waves round the outline; three and four are smaller
_WAVES = (1.0, 0.7, 0.4)
_TOLERANCES = (0.1, 0.07, 0.05, 0.035, 0.025, 0.016)  # of edges, over the radius
_AGAIN = (0.05, 0.03, 0.016)
_TURNS, _RESTS = 24, 4  # angles at which a pose is looked for, and places where it may rest that are kept
_COARSE, _STEPS, _LOOKED = 2, 5, 10  # steps from all angles, all steps, and how many go on after the first
_PRUNED = 2  # polygons of a rough outline that poses are found of again
_SHARP, _ROUNDS = 0.02, 8  # tolerance of a polygon's poses all round, and how often they are looked for
_HOPE = 2.0  # times the last gain: how far above the least cost that goes on
_ROUGH, _END = 0.07, 0.1  # see `fit_path`
_ANGLES = 2.0 * np.pi * np.arange(RADII) / RADII


def hopped(
    scans: RigidScans, explains: Callable[[Fit], bool], known: FloatArray | None = None, hops: int = _HOPS
) -> Fit:
    """Return the best fit of scans whose poses are independent; the same for the same scans.

    Parameters
    ----------
    scans
        Of one object.
    explains
        Whether a fit leaves no more than noise.
    known
        Corners (N, 2) [mm] of an outline that explains some of the scans, in place of circles to begin with.
    hops
        Tries from the best so far, at most.
    """
    random, free = np.random.default_rng(0), np.eye(len(scans.k))
    round_ = np.full(RADII, float(np.sqrt(np.median(centres(scans)[1]) / np.pi)))

    def tried(radii: FloatArray, tolerances: tuple[float, ...], least: float) -> Fit:
        path = Path(radii, np.empty((len(free), 3)), free, np.inf)
        for tolerance in tolerances:
            rests = _rests(scans, path.corners, tolerance * float(path.radii.mean()))
            path = replace(path, knots=rests[:, 0])
            path = fit_path(scans, path, 10, tolerance=tolerance, cauchy=3.0, rough=_ROUGH, end=_END)
        polygons = sorted(pruned(scans, path.corners, path.poses), key=lambda f: f.criterion(scans))
        again = []
        for polygon in polygons[:_PRUNED]:
            again.append(_posed_again(scans, polygon, _SHARP * float(path.radii.mean()), least))
            least = min(least, again[-1].criterion(scans))
        return min(again, key=lambda f: f.criterion(scans))

    best, least, idle, starts = None, np.inf, 0, _STARTS
    if known is not None:
        rests = starts_all_round(scans, known, _TURNS)[:, 0]
        radius = float(radii_of(known).mean())
        best = _posed_again(scans, Fit(known, rests, np.full(len(rests), np.inf)), _SHARP * radius, np.inf)
        least, idle, starts = best.criterion(scans), _IDLE, 0
    for start in range(starts + hops):
        if best is None or start < starts:
            new = tried(_bent(round_, _BENT, random), _TOLERANCES, least)
        elif idle >= _IDLE and explains(best):
            break
        else:
            new = tried(_bent(radii_of(best.corners), _BENT_AGAIN, random), _AGAIN, least)
        better = new.criterion(scans) < least - 0.5
        idle = 0 if better or start < starts else idle + 1
        if better:
            best, least = new, new.criterion(scans)
    assert best is not None
    return best


def _posed_again(scans: RigidScans, fit: Fit, tolerance_mm: float, least: float) -> Fit:
    """Return the fit with poses searched for again, as long as that makes it better and may get below the least cost.

    All round, then from where each may rest, as long as these are better, then all round once more.
    """
    rests = None
    for _ in range(_ROUNDS):
        known = rests is not None
        rests = _rests(scans, fit.corners, tolerance_mm, rests)
        rests = best_of(*fit_poses(scans, fit.corners, rests, loss(scans), 12), _RESTS)[0]
        new = settled(scans, fitted(scans, fit.corners, rests[:, 0], 15), 2)
        gain = fit.cost - new.cost
        if gain > 0.5:
            fit = new
        elif not known:
            break
        else:
            rests = None
        if fit.criterion(scans) - least > _HOPE * max(gain, 1.0):
            break
    return fit


def _rests(
    scans: RigidScans, corners: FloatArray, tolerance_mm: float, known: FloatArray | None = None
) -> FloatArray:
    """Return where poses of an outline may rest (T, K, 3), the best first: about known ones, or all round."""
    poses = known
    if poses is None:
        poses = starts_all_round(scans, corners, _TURNS)
        soft = loss(scans, 2.0 * tolerance_mm, 3.0, 0.15)
        for steps, kept in ((_COARSE, _LOOKED), (_STEPS - _COARSE, _RESTS)):
            poses = best_of(*fit_poses(scans, corners, poses, soft, steps), kept)[0]
    return best_of(*fit_poses(scans, corners, poses, loss(scans, tolerance_mm, 5.0), 8), _RESTS)[0]


def _bent(radii: FloatArray, by: float, random: np.random.Generator) -> FloatArray:
    """Return radii with waves round the outline, two, three and four of them, that are normally distributed."""
    phase = _ANGLES + random.uniform(0.0, 2.0 * np.pi, (len(_WAVES), 1))
    size = by * np.array(_WAVES) * random.normal(size=len(_WAVES))
    waves = np.cos(np.arange(2, 2 + len(_WAVES))[:, None] * phase)
    return np.asarray(radii * np.maximum(1.0 + size @ waves, LEAST))

"""Whether a known outline explains further scans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tacstrip.core.rigid import RigidScans, fit_poses, loss
from tacstrip.tracking.rigid.corners import (
    Fit,
    explored,
    fitted,
    poses_all_round,
    recounted,
    rescued,
    settled,
    unstuck,
)
from tacstrip.tracking.rigid.found import WORTH_SETTLING, Found, content
from tacstrip.tracking.rigid.joined_paths import joined

_JOINED = 3  # rivals of one stretch that another is tried with


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
    return _explaining_both(together, [joint], scans, distribution)


def recognised_on_path(known: RigidScans, found: Found, scans: RigidScans, distribution: str) -> Fit | None:
    """Return the fit of known scans and further ones, of poses on a spline each; None where none explains both.

    Known scans leave much open: which of the outlines that explain them is right, the further ones may decide.
    """
    together = replace(known, k=np.concatenate([known.k, scans.k]))
    every = len(found.chosen) == len(known.k)
    fits = [found.fit, *(fit for fit, _ in found.rivals[:_JOINED] if every)]
    return _explaining_both(together, joined(known, fits, scans), scans, distribution)


def _explaining_both(
    together: RigidScans, fits: Iterable[Fit], last: RigidScans, distribution: str
) -> Fit | None:
    """Return the first of fits that explains the last scans by themselves and all, or one from the best; else None."""

    def both_explained(fit: Fit) -> bool:
        count = len(last.k)
        basis = None if fit.basis is None else fit.basis[-count:]
        if basis is not None:
            basis = basis[:, (basis != 0.0).any(axis=0)]
        part = Fit(fit.corners, fit.poses[-count:], fit.costs[-count:], basis)
        return content(last, part, distribution) and content(together, fit, distribution)

    tried = list[Fit]()
    for fit in fits:
        if both_explained(fit):
            return fit
        tried.append(fit)
    fit = min(tried, key=lambda f: f.criterion(together))
    # Too few scans may have told a corner too few, or an outline that is off along what they left open.
    for further in (unstuck, lambda every, fit: explored(every, fit)[0]):
        if fit.cost > WORTH_SETTLING * fit.freedom(together):
            break
        fit = recounted(together, further(together, fit))[0]
        if both_explained(fit):
            return fit
    return None

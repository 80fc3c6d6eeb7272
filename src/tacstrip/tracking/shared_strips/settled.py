"""The joint fit of some scans, brought to rest: descents of single scans and of all together, in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.hull import HullScans, fit_hull_poses
from tacstrip.core.rigid import loss
from tacstrip.tracking.shared_strips.joint_fit import Scene, expected, fitted
from tacstrip.tracking.shared_strips.rows import Rows

SOFT, CAUCHY = 0.005, 6.0  # tolerance of edges over the size, and scale of the loss, of the first descent
_BAD, _SPREAD = 6.0, 5.0  # chi square of a scan beyond its readings, and times its deviation
_REPAIRS = 3  # rounds
_JERKS = 2.0  # motion that costs so many times what is expected is less smooth than thought
_MISSED = 4.0  # of chi square that an object must gain to be there
_JIGGLES = np.array(
    [
        (0.0, 0.0, 0.0),
        (1.0, 0, 1.0),
        (-1.0, 0, -1.0),
        (0, 1.0, -1.0),
        (0, -1.0, 1.0),
        (0, 0, 3.0),
        (0, 0, -3.0),
    ]
)
# Of jiggles, of the size, and [rad].
_NARROW, _WIDE = np.array([0.005, 0.005, 0.01]), np.array([0.02, 0.02, 0.03])
# Tolerance over the size, scale of the loss, ends.
_STAGES = ((0.01, 3.0, 0.15), (0.005, 5.0, 0.05), (0.0, 0.0, 0.05))
_LOOSE = np.array([0.01, 0.01, 0.03])  # deviations from what is between the scans that are explained
_ROUGH = 12.0  # of what the motion costs at a scan


def joint(rows: Rows, chosen: IntArray) -> Scene:
    """Return the joint fit of some rows from their poses."""
    some = rows.of(chosen)
    present = np.isfinite(some.poses[..., 0])
    poses = np.nan_to_num(some.poses)
    scene = Scene(rows.outlines, poses, present, rows.motion, np.zeros(len(poses)))
    soft = SOFT * float(rows.sizes.max())
    scene = fitted(some.hull, scene, some.follows, 8, soft, CAUCHY, shapes=False)
    scene = fitted(some.hull, scene, some.follows, 8, soft, shapes=False)
    scene = settled(some, scene, 2, soft, shapes=False)
    scene = fitted(some.hull, scene, some.follows, 8, soft, CAUCHY)
    scene = fitted(some.hull, scene, some.follows, 8, cauchy=CAUCHY)
    scene = fitted(some.hull, scene, some.follows)
    for _ in range(2):  # motion that is less smooth than thought
        bends = 3.0 * float((scene.bends & some.follows[1:-1, None] & some.follows[2:, None]).sum())
        if scene.prior <= _JERKS * max(bends, 1.0):
            break
        scene = replace(scene, motion=scene.motion * np.sqrt(scene.prior / bends))
        scene = fitted(some.hull, scene, some.follows)
    return scene


def not_explained(hull: HullScans, scene: Scene) -> IntArray:
    """Return the rows whose readings a scene does not explain."""
    n = hull.scans.readings
    return np.flatnonzero(scene.costs > n + _SPREAD * np.sqrt(n) + _BAD)


def settled(
    rows: Rows, scene: Scene, rounds: int = _REPAIRS, tolerance_mm: float = 0.0, shapes: bool = True
) -> Scene:
    """Return the scene after descents of single scans from about where they are, and of all together, in turn.

    Kinks of one scan, where a corner passes a strip, do not stop the others then. Scans that are not explained begin
    again between their neighbours too. `tolerance_mm` is of the edges.
    """
    soft = tolerance_mm / float(rows.sizes.max())
    for _ in range(rounds):
        poses, suspect = scene.poses.copy(), _suspect(rows, scene)
        for there in np.unique(scene.present, axis=0):
            same = np.flatnonzero((scene.present == there).all(axis=1))
            for wide, some in ((False, np.setdiff1d(same, suspect)), (True, np.intersect1d(same, suspect))):
                if len(some):
                    _by_themselves(rows, scene, np.flatnonzero(there), some, wide, suspect, poses, soft)
        trial = fitted(rows.hull, replace(scene, poses=poses), rows.follows, 15, tolerance_mm, shapes=shapes)
        gain = scene.cost - trial.cost
        if gain > 0.0:
            scene = trial
        if gain < 0.5 + 1e-3 * scene.cost:
            break
    return scene


def _suspect(rows: Rows, scene: Scene) -> IntArray:
    """Return the rows whose readings a scene does not explain, or which make its motion rough."""
    where, weight = expected(scene, rows.follows)
    rough = (weight * (where - scene.poses) ** 2).sum(axis=(1, 2)) > _ROUGH
    return np.union1d(not_explained(rows.hull, scene), np.flatnonzero(rough))


def _by_themselves(
    rows: Rows,
    scene: Scene,
    on: IntArray,
    some: IntArray,
    wide: bool,
    bad: IntArray,
    poses: FloatArray,
    soft: float,
) -> None:
    """Put into poses (T, K, 3) what is best for each of some rows by itself."""
    scale = np.stack([rows.sizes[on], rows.sizes[on], np.ones(len(on))], axis=1)
    where, weight = (a[some][:, on][:, None] for a in expected(scene, rows.follows))
    step, base = _NARROW * scale, scene.poses[some][:, on]
    starts = [base + jiggle * step for jiggle in _JIGGLES[: None if wide else 5]]
    hull, outlines = rows.hull.of(some), [scene.outlines[k] for k in on]
    if wide:
        starts += [
            base + jiggle * step * (np.arange(len(on)) == k)[:, None]
            for jiggle in _JIGGLES[1:]
            for k in range(len(on))
        ]
        good = np.setdiff1d(np.arange(len(scene.poses)), bad)
        between = np.stack([_between(scene, row, good)[on] for row in some])
        starts += [from_ + jiggle * _WIDE * scale for from_ in (base, between) for jiggle in _JIGGLES]
        starts += [between + jiggle * step for jiggle in _JIGGLES]
        where = between[:, None]
        weight = np.minimum(weight, 1.0 / (_LOOSE * scale) ** 2) + 1e-3 / (_LOOSE * scale) ** 2
    found = np.stack(starts, axis=1)
    for tolerance, cauchy, end in _STAGES if wide else _STAGES[-1:]:
        how = loss(hull.scans, max(tolerance, soft) * float(rows.sizes.max()), cauchy, end)
        found, costs = fit_hull_poses(hull, outlines, found, where, weight, how, 10)
    poses[some[:, None], on] = found[np.arange(len(some)), costs.argmin(axis=1)]


def _between(scene: Scene, row: int, good: IntArray) -> FloatArray:
    """Return poses (K, 3) of a row between those of good rows."""
    found = scene.poses[row].copy()
    for k in np.flatnonzero(scene.present[row]):
        own = good[scene.present[good, k]]
        if len(own):
            found[k] = [np.interp(row, own, scene.poses[own, k, c]) for c in range(3)]
    return np.asarray(found)


def without_unseen(rows: Rows, scene: Scene, shared: BoolArray) -> Scene:
    """Return the scene without objects in scans at the ends of their stay in which nothing shows them."""
    present = scene.present.copy()
    for k in range(present.shape[1]):
        for sign in (1, -1):
            on = np.flatnonzero(present[:, k])[::sign]
            for row in on:
                before = row - sign
                inside = shared[row] and present[row].sum() > 1
                neighbour = (
                    0 <= before < len(present) and rows.follows[max(row, before)] and present[before, k]
                )
                if not inside or neighbour or not (0 <= before < len(present)):
                    break
                without = present[row].copy()
                without[k] = False
                on_too = np.flatnonzero(without)
                _, costs = fit_hull_poses(
                    rows.hull.of([row]), [scene.outlines[i] for i in on_too], scene.poses[row, on_too][None, None],
                    scene.poses[row, on_too], np.zeros(1), loss(rows.hull.scans), 10,
                )  # fmt: skip
                if costs[0, 0] > scene.costs[row] + _MISSED:
                    break
                present[row, k] = False
    if (present == scene.present).all():
        return scene
    return fitted(rows.hull, replace(scene, present=present), rows.follows)

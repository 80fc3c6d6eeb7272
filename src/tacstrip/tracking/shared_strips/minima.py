"""Other minima of a joint fit: smoother motion, rivals of an outline, descents from beside it, another way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.geometry.pose import in_frame, placed
from tacstrip.tracking.rigid.corners import FEWEST, FIRST, PLACES, along_the_open, edges_bent, faintest
from tacstrip.tracking.rigid.starts import FEW_A_SCAN
from tacstrip.tracking.shared_strips.beam import SAME
from tacstrip.tracking.shared_strips.joint_fit import Scene, evidence, fitted, outline_covariances
from tacstrip.tracking.shared_strips.rows import Rows
from tacstrip.tracking.shared_strips.settled import CAUCHY, SOFT, settled, without_unseen

ALIKE = 10.0  # of chi square: another way explains as well
_RIVALS, _BETTER = 3, 6.0  # outlines that are tried against the one found, and how much better one must be
_SLOPE = 10  # scans alone that tell how a rival's way parts from the one found
_EXPLORED, _SETTLED = 3, 6  # rounds of looking beside outlines, and descents of each that are settled
_DEEPER = 3.0  # that a round must gain for another: less is the same minimum, rested in better
_SAME = 0.003  # of the size: outlines that differ by less are one
_AS_DEAR = 0.2  # of chi square: descents that end so near each other, with the same outlines, end in one
_ASTRAY = (
    *((0.0, 0.0, sign * turn) for turn in (0.15, 0.35, 0.7) for sign in (1.0, -1.0)),
    *((sign * 0.06, 0.0, 0.0) for sign in (1.0, -1.0)),
    *((0.0, sign * 0.06, 0.0) for sign in (1.0, -1.0)),
)  # of the size, and [rad]: how far an object may have gone astray while others hid most of it
_HALVED = 4  # times that the deviations of the motion are
_WIDER = 0.005  # of the size: tolerance of edges of minima that are compared
_NEVER = 100.0  # of chi square beyond the best: a descent that rests there, with the outlines as they are, is given up


def criterion_of(some: Rows, scene: Scene) -> float:
    """Return what scenes with the same objects in each scan are compared by."""
    size = float(some.sizes.max())
    return evidence(some.hull, scene, some.follows, some.anchors, size, _WIDER * size)


def smoother(some: Rows, scene: Scene) -> Scene:
    """Return the scene with the motion as smooth as makes the readings likeliest."""
    least = criterion_of(some, scene)
    for _ in range(_HALVED):
        trial = fitted(some.hull, replace(scene, motion=0.5 * scene.motion), some.follows, 15)
        trial = settled(some, trial, 1)
        criterion = criterion_of(some, trial)
        if not criterion < least:
            break
        scene, least = trial, criterion
    return scene


def as_smooth(
    some: Rows, chosen: IntArray, scene: Scene, alike: list[tuple[IntArray, Scene]], both: BoolArray
) -> tuple[list[Scene], list[tuple[IntArray, Scene]]]:
    """Return other ways of the same objects in each scan, with motion as smooth as the scene's, and the rest.

    They were found where the motion was free to take up noise: that tells little of which is likelier.
    """
    rivals, rest = list[Scene](), list[tuple[IntArray, Scene]]()
    for at, other in alike:
        trimmed = without_unseen(some, other, both) if np.array_equal(at, chosen) else None
        if trimmed is not None and np.array_equal(trimmed.present, scene.present):
            trial = fitted(some.hull, replace(trimmed, motion=scene.motion), some.follows)
            rivals.append(settled(some, trial, 1))
        else:
            rest.append((at, other))
    return rivals, rest


def smoother_too(some: Rows, scene: Scene, others: list[Scene]) -> tuple[Scene, list[Scene]]:
    """Return the scene as `smoother`, and others that explain all about as well with motion as smooth."""
    least, smooth = criterion_of(some, scene) + 2.0 * ALIKE, smoother(some, scene)
    others = [other for other in others if criterion_of(some, other) < least]
    if smooth is scene:
        return scene, others
    return smooth, [
        fitted(some.hull, replace(other, motion=smooth.motion), some.follows, 15) for other in others
    ]


def as_likely(some: Rows, scene: Scene, others: Sequence[Scene]) -> list[Scene]:
    """Return the other scenes that explain all as well."""
    least = criterion_of(some, scene) + ALIKE
    return [s for s in others if criterion_of(some, s) < least]


def against_rivals(some: Rows, scene: Scene, k: int) -> list[Scene]:
    """Return the scene and those with a rival of an outline, the one first that explains all scans best."""
    tried, soft = [scene], SOFT * float(some.sizes.max())
    for corners, poses in some.rivals[k][:_RIVALS]:
        trial = _straight_on(some, scene, k, corners, poses)
        trial = fitted(some.hull, trial, some.follows, 8, soft, CAUCHY, shapes=False)
        trial = settled(some, trial, 1, soft, shapes=False)
        trial = fitted(some.hull, trial, some.follows, 8, soft)
        tried.append(settled(some, fitted(some.hull, trial, some.follows), 1))
    criteria = np.array([criterion_of(some, s) for s in tried])
    criteria[1:] += _BETTER  # what was found first stays unless another is clearly better
    best = int(criteria.argmin())
    return [tried[best], *tried[:best], *tried[best + 1 :]]


def _straight_on(some: Rows, scene: Scene, k: int, corners: FloatArray, poses: FloatArray) -> Scene:
    """Return the scene with a rival of an outline, whose way parts from the one found by a straight line.

    Where it is alone it lies as it was found there; a rival may turn otherwise, and the more the farther on.
    """
    row_of = {n: i for i, n in enumerate(some.scans[k])}
    alone, here = np.flatnonzero(some.alone[:, k]), np.flatnonzero(scene.present[:, k])
    its = poses[[row_of[int(n)] for n in some.numbers[alone]]]
    own, middle = scene.outlines[k].mean(axis=0), corners.mean(axis=0)
    apart = _moved_by(its, middle) - _moved_by(scene.poses[alone, k], own)
    apart[:, 2] = np.unwrap(apart[:, 2])
    every, at = scene.poses.copy(), some.numbers
    off = np.stack([np.interp(at[here], at[alone], apart[:, c]) for c in range(3)], axis=1)
    for side, end in ((here < alone[0], slice(None, _SLOPE)), (here > alone[-1], slice(-_SLOPE, None))):
        if side.any() and len(alone) > 2:
            line = np.polyfit(at[alone[end]], apart[end], 1)
            off[side] = line[0] * at[here[side], None] + line[1]
    every[here, k] = _moved_by(_moved_by(scene.poses[here, k], own) + off, -middle)
    every[alone, k] = its
    every[here, k, 2] = np.unwrap(every[here, k, 2])
    return replace(scene, outlines=(*scene.outlines[:k], corners, *scene.outlines[k + 1 :]), poses=every)


def _moved_by(poses: FloatArray, point: FloatArray) -> FloatArray:
    """Return poses (T, 3) of the frame whose origin is at a point (2,) of the one that they are of."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = point
    return np.asarray(poses + np.stack([cos * x - sin * y, sin * x + cos * y, 0.0 * cos], axis=1))


def explored(some: Rows, scene: Scene, part: BoolArray) -> list[Scene]:
    """Return where descents from beside the outlines end that few strips read, the best first.

    The scans of each alone leave such an outline open along valleys, and the corners' number: all scans have other
    minima than these have. The outlines are moved along what all scans tell least, and lose or gain a corner.
    """
    few = [int(k) for k in np.flatnonzero(part & some.alone.any(axis=0)) if _few_read(some, int(k))]
    ends, soft, same = [scene], SOFT * float(some.sizes.max()), _SAME * float(some.sizes.min())
    price = 2.0 * float(np.log(some.hull.scans.readings.sum())) + PLACES
    for _ in range(_EXPLORED if few else 0):
        tries, least = list[Scene](), criterion_of(some, scene)
        spread = outline_covariances(some.hull, scene, some.follows, some.anchors)
        for k in few:
            own = scene.outlines[k]
            starts = along_the_open(own, spread[k])
            starts += [np.delete(own, i, axis=0) for i in faintest(own)] if len(own) > FEWEST else []
            starts += edges_bent(own) if len(own) + 1 < FIRST else []
            for start in starts:
                trial = replace(scene, outlines=(*scene.outlines[:k], start, *scene.outlines[k + 1 :]))
                tries.append(fitted(some.hull, trial, some.follows, 8, soft, CAUCHY))
        tries = [fitted(some.hull, s, some.follows, 6) for s in _unlike(tries, same)]
        tries.sort(key=lambda s: s.cost + price * sum(len(o) for o in s.outlines))
        near = _unlike(tries, same)[:_SETTLED]
        ends += [settled(some, s, 1) for s in near if s.cost < scene.cost + _NEVER]
        ends.sort(key=lambda s: criterion_of(some, s))
        scene = ends[0]
        if not criterion_of(some, scene) < least - _DEEPER:
            break
    return ends


def _unlike(scenes: list[Scene], within_mm: float) -> list[Scene]:
    """Return scenes without those that end where one before does: as dear, and with the same outlines."""
    kept = list[Scene]()
    for one in scenes:
        if not any(
            abs(one.cost - s.cost) < _AS_DEAR and _same_outlines(one.outlines, s.outlines, within_mm)
            for s in kept
        ):
            kept.append(one)
    return kept


def _few_read(some: Rows, k: int) -> bool:
    """Whether scans in which an object is alone touch few strips."""
    return some.hull.scans.of(np.flatnonzero(some.alone[:, k])).strips_touched < FEW_A_SCAN


def of_rivals(some: Rows, scene: Scene, others: list[Scene]) -> list[list[tuple[FloatArray, float]]]:
    """Return each object's outlines, in its frame, in other scenes that explain all as well, and how much worse."""
    best, anchors = criterion_of(some, scene), some.anchors

    def seen(s: Scene) -> list[FloatArray]:
        return [
            placed(o, s.poses[row, k]) for k, (o, row) in enumerate(zip(s.outlines, anchors, strict=True))
        ]

    kept, worse = [seen(scene)], list[float]()
    for other in others:
        mine, by = seen(other), criterion_of(some, other) - best
        if by < ALIKE and not any(_same_outlines(mine, k, _SAME * float(some.sizes.min())) for k in kept):
            kept.append(mine)
            worse.append(by)
    return [
        [(in_frame(one[k], scene.poses[row, k]), by) for one, by in zip(kept[1:], worse, strict=True)]
        for k, row in enumerate(anchors)
    ]


def _same_outlines(a: Sequence[FloatArray], b: Sequence[FloatArray], within_mm: float) -> bool:
    return all(len(p) == len(q) and float(np.abs(p - q).max()) < within_mm for p, q in zip(a, b, strict=True))


def astray(some: Rows, scene: Scene, part: BoolArray) -> list[Scene]:
    """Return the scene, or a better one in which an object gradually goes another way, and what explains as well.

    What others leave to see of an object, such as one edge or one corner, may fit two ways that part slowly from where
    it was alone. Each is a minimum of its own, so that the covariance at one does not tell of the other.
    """
    found = [(criterion_of(some, scene), scene)]
    for k in np.flatnonzero(part):
        mine = np.flatnonzero(scene.present[:, k] & ~some.alone[:, k])
        scale = np.array([some.sizes[k], some.sizes[k], 1.0])
        for run in np.split(mine, np.flatnonzero(~some.follows[mine[1:]] | (np.diff(mine) > 1)) + 1):
            if len(run) < 2:
                continue
            shape = _free_end(some, run, int(k))
            for step in _ASTRAY:
                best = found[0][1]
                poses = best.poses.copy()
                poses[run, k] += shape[:, None] * np.array(step) * scale
                trial = _other_way(some, replace(best, poses=poses), best)
                if trial is not None:
                    found = sorted([*found, (criterion_of(some, trial), trial)], key=lambda s: s[0])
    return [s for _, s in found]


def _free_end(some: Rows, run: IntArray, k: int) -> FloatArray:
    """Return how much of a deviation each row of a run gets (R,): ever less towards scans in which it is alone."""
    first, last = int(run[0]), int(run[-1])
    held = first > 0 and some.follows[first] and some.alone[first - 1, k]
    held_after = last + 1 < len(some.follows) and some.follows[last + 1] and some.alone[last + 1, k]
    t = np.linspace(0.0, 1.0, len(run) + 2)[1:-1]
    if held and held_after:
        return np.asarray(np.sin(np.pi * t))
    return t if held else 1.0 - t if held_after else np.ones(len(run))


def _other_way(some: Rows, trial: Scene, best: Scene) -> Scene | None:
    """Return where a descent from other poses ends; None where that is the best scene again, or explains too little."""
    trial = fitted(some.hull, trial, some.follows, 10, SOFT * float(some.sizes.max()), CAUCHY, shapes=False)
    if _same_poses(some, trial, best):
        return None
    trial = settled(some, trial, 1, shapes=False)
    if trial.cost > best.cost + _NEVER or _same_poses(some, trial, best):
        return None
    trial = fitted(some.hull, trial, some.follows, 15)
    return None if trial.cost > best.cost + ALIKE or _same_poses(some, trial, best) else trial


def _same_poses(some: Rows, a: Scene, b: Scene) -> bool:
    """Whether two scenes of the same presence have the same poses."""
    off = np.abs(a.poses - b.poses)[a.present]
    return bool((off <= (SAME * np.array([some.sizes.min(), some.sizes.min(), 1.0]))).all())

"""What a joint fit tells of each object, with what is doubtful."""

from __future__ import annotations

from math import erf, exp, sqrt

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.tracking.shared_strips.joint_fit import Scene, pose_covariances
from tacstrip.tracking.shared_strips.known import Shared
from tacstrip.tracking.shared_strips.rows import Rows
from tacstrip.tracking.shared_strips.settled import not_explained

_ALARM, _HARDLY_MORE = 3.5, 1.05  # deviations of chi square, and times the freedom
_APART = 0.03  # of the size: another way lies elsewhere
_HELD, _HELD_ANGLE = 0.017, 0.035  # deviations of a pose that is held: of the size, and [rad]
_WRONG = 0.02  # of the poses: where more are probably off by two such deviations and more, it is said
_HIDDEN = (
    "in {n} of the scans {first} to {last} others hide so much of it that the readings do not hold its pose: there it "
    "goes on as it went, see the covariance"
)
_ELSEWHERE = (
    "in scans {first} to {last} all objects may lie elsewhere: another way of theirs explains "
    "the readings as well"
)
_LEFT_OVER = "in {n} of the scans {first} to {last} the objects that are known do not explain the readings"


def told(
    rows: Rows,
    chosen: IntArray,
    scene: Scene,
    part: BoolArray,
    alike: list[tuple[IntArray, Scene]],
    rivals: list[list[tuple[FloatArray, float]]],
    distribution: str,
) -> list[Shared | None]:
    """Return what is known of each object."""
    some = rows.of(chosen)
    bad, readings = not_explained(some.hull, scene), some.hull.scans.readings
    shared = ~some.alone.any(axis=1) | (scene.present.sum(axis=1) > some.alone.sum(axis=1))
    bends = 3 * int((scene.bends & some.follows[1:-1, None] & some.follows[2:, None]).sum())
    unknowns = 3 * int(scene.present.sum()) + 2 * sum(
        len(o) for o, p in zip(scene.outlines, part, strict=True) if p
    )
    freedom = max(int(readings.sum()) + bends - unknowns, 1)
    residuals = np.sqrt([*scene.costs, scene.prior])
    content = (
        scene.cost <= _HARDLY_MORE * freedom or chi_square_score(residuals, freedom, distribution) <= _ALARM
    )
    spread = pose_covariances(some.hull, scene, some.follows, some.anchors, np.flatnonzero(shared))
    found: list[Shared | None] = []
    for k in range(len(part)):
        if not part[k]:
            found.append(None)
            continue
        mine = np.flatnonzero(shared & scene.present[:, k] & ~some.alone[:, k])
        numbers = some.numbers[mine]
        advice = []
        if len(mine):
            size = float(rows.sizes[k])
            sd = np.sqrt(np.diagonal(spread[mine, k], axis1=1, axis2=2))
            off = np.hypot(sd[:, 0], sd[:, 1]) / (_HELD * size), sd[:, 2] / _HELD_ANGLE
            loose = np.maximum(*off) > 1.0
            right = [(1.0 - exp(-4.0 / m**2)) * erf(sqrt(2.0) / a) for m, a in zip(*off, strict=True)]
            if loose.any() and 1.0 - np.mean(right) > _WRONG:
                advice.append(
                    _HIDDEN.format(n=int(loose.sum()), first=numbers[loose].min(), last=numbers[loose].max())
                )
            left = np.intersect1d(bad, mine)
            if len(left) or not content:
                own = some.numbers[left] if len(left) else numbers
                advice.append(_LEFT_OVER.format(n=len(own), first=own.min(), last=own.max()))
            advice += _elsewhere(some, scene, k, alike, rows, size, sd, mine)
        again = {int(some.numbers[i]): scene.poses[i, k] for i in np.flatnonzero(some.alone[:, k])}
        found.append(
            Shared(
                scene.outlines[k], again, numbers.tolist(), scene.poses[mine, k], spread[mine, k],
                _sharing(some, scene, mine, k), tuple(rivals[k]), "; ".join(advice),
            )
        )  # fmt: skip
    return found


def _sharing(some: Rows, scene: Scene, mine: IntArray, k: int) -> tuple[int, ...]:
    """Return the numbers of those of some rows in which an object shares strips with another."""
    half, found = 0.5 * some.hull.scans.sensor.pitch_mm, []
    for row in mine:
        x = {
            int(j): placed(scene.outlines[j], scene.poses[row, j])[:, 0]
            for j in np.flatnonzero(scene.present[row])
        }
        low, high = x[k].min() - half, x[k].max() + half
        if any(j != k and other.min() < high and other.max() > low for j, other in x.items()):
            found.append(int(some.numbers[row]))
    return tuple(found)


def _elsewhere(
    some: Rows,
    scene: Scene,
    k: int,
    alike: list[tuple[IntArray, Scene]],
    rows: Rows,
    size: float,
    sd: FloatArray,
    mine: IntArray,
) -> list[str]:
    """Return advice where another way of the objects explains the readings as well."""
    at = {int(some.numbers[i]): j for j, i in enumerate(mine)}
    apart: list[int] = []
    for its_rows, other in alike:
        for row, pose, there in zip(its_rows, other.poses, other.present, strict=True):
            number = int(rows.numbers[row])
            if number not in at:
                continue
            j = at[number]
            limit = max(_APART * size, 4.0 * float(np.hypot(*sd[j, :2]) + sd[j, 2] * size))
            own, its = placed(scene.outlines[k], scene.poses[mine[j], k]), placed(other.outlines[k], pose[k])
            if not there[k] or np.hypot(*(own[:, None] - its).T).min(axis=0).max() > limit:
                apart.append(number)
    return [_ELSEWHERE.format(first=min(apart), last=max(apart))] if apart else []

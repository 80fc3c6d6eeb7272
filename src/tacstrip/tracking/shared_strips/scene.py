"""Objects that share strips: who is there, and where, from scans in which each was alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from math import erf, exp, sqrt

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.hull import MOST_OBJECTS, HullScans, fit_hull_poses
from tacstrip.core.rigid import RigidScans, loss
from tacstrip.geometry.pose import in_frame, placed
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.rigid.corners import FEWEST, FIRST, PLACES, along_the_open, edges_bent, faintest
from tacstrip.tracking.rigid.search import FEW_A_SCAN
from tacstrip.tracking.shared_strips.beam import SAME, Way, ways
from tacstrip.tracking.shared_strips.joint_fit import (
    Scene,
    evidence,
    expected,
    fitted,
    outline_covariances,
    pose_covariances,
)

_BEFORE = 4  # scans before a window that its beam begins with
_CANDIDATES = 3  # of each direction that are fitted
_AROUND, _MOST_ALONE = (
    20,
    60,
)  # scans alone on both sides of a window, and of an object, that are fitted along
_EVENT, _FAR = (
    25.0,
    100.0,
)  # of chi square: that something came or went, and most for a jump into what follows
_SOFT, _CAUCHY = 0.005, 6.0  # tolerance of edges over the size, and scale of the loss, of the first descent
_BAD, _SPREAD = 6.0, 5.0  # chi square of a scan beyond its readings, and times its deviation
_REPAIRS = 3  # rounds
_WORST = 0.05  # of the scans that may stay unexplained
_FIRST, _HOPELESS = (
    2,
    0.5,
)  # candidates, best of each direction; where they leave so many of the scans none will do
_ALARM, _HARDLY_MORE = 3.5, 1.05  # deviations of chi square, and times the freedom
_STEADY, _TURNS = 0.003, 0.008  # least deviation of second differences: of the size, and [rad]
_JERKS = 2.0  # motion that costs so many times what is expected is less smooth than thought
_MISSED = 4.0  # of chi square that an object must gain to be there
_ALIKE, _APART = 10.0, 0.03  # of chi square, and of the size: another way that explains as well
_GUESSES = 2  # rivals that are followed by where the outlines found explain too little
_RIVALS, _BETTER = 3, 6.0  # outlines that are tried against the one found, and how much better one must be
_SLOPE = 10  # scans alone that tell how a rival's way parts from the one found
_EXPLORED, _SETTLED = 3, 6  # rounds of looking beside outlines, and descents of each that are settled
_DEEPER = 3.0  # that a round must gain for another: less is the same minimum, rested in better
_SAME = 0.003  # of the size: outlines that differ by less are one
_AS_DEAR = 0.2  # of chi square: descents that end so near each other, with the same outlines, end in one
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
_NARROW, _WIDE = (
    np.array([0.005, 0.005, 0.01]),
    np.array([0.02, 0.02, 0.03]),
)  # of jiggles, of the size, and [rad]
_STAGES = (
    (0.01, 3.0, 0.15),
    (0.005, 5.0, 0.05),
    (0.0, 0.0, 0.05),
)  # tolerance over the size, scale of the loss, ends
_LOOSE = np.array([0.01, 0.01, 0.03])  # deviations from what is between the scans that are explained
_ROUGH = 12.0  # of what the motion costs at a scan
_ASTRAY = (
    *((0.0, 0.0, sign * turn) for turn in (0.15, 0.35, 0.7) for sign in (1.0, -1.0)),
    *((sign * 0.06, 0.0, 0.0) for sign in (1.0, -1.0)),
    *((0.0, sign * 0.06, 0.0) for sign in (1.0, -1.0)),
)  # of the size, and [rad]: how far an object may have gone astray while others hid most of it
_HALVED = 4  # times that the deviations of the motion are
_WIDER = 0.005  # of the size: tolerance of edges of minima that are compared
_NEVER = 100.0  # of chi square beyond the best: a descent that rests there, with the outlines as they are, is given up


@dataclass(frozen=True, eq=False)
class Alone:
    """What is known of an object from scans in which it is alone.

    Attributes
    ----------
    corners
        Its outline (N, 2) [mm], in a frame of its own.
    scans
        Numbers of these scans, ascending.
    poses
        In these (M, 3).
    readings
        Its own (M, S, n), NaN elsewhere.
    rivals
        Other outlines that explain these about as well, each in a frame of its own, and their poses (M, 3): those most
        unlike first.
    """

    corners: FloatArray
    scans: list[int]
    poses: FloatArray
    readings: FloatArray
    rivals: tuple[tuple[FloatArray, FloatArray], ...] = ()


@dataclass(frozen=True, eq=False)
class Shared:
    """What scans together with others add.

    Attributes
    ----------
    corners
        As `Alone.corners`, better known.
    again
        Numbers of scans alone whose poses were fitted along, and these (M, 3).
    scans, poses, covariances
        Numbers of scans that show it with others about, its poses there (J, 3) and their covariances (J, 3, 3).
    joint
        Those in which it shares strips with one of them.
    rivals
        Those of `Alone.rivals` that explain all scans as well, fitted to them, and how much worse their criterion is.
    advice
        What is doubtful there; empty when all is well.
    """

    corners: FloatArray
    again: dict[int, FloatArray]
    scans: list[int] = field(default_factory=list)
    poses: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    covariances: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    joint: tuple[int, ...] = ()
    rivals: tuple[tuple[FloatArray, float], ...] = ()
    advice: str = ""


@dataclass(eq=False)
class _Rows:
    """All scans that are fitted, one a row, and what is known of them."""

    numbers: IntArray
    hull: HullScans
    poses: FloatArray  # (R, K, 3), NaN where an object is absent or its pose is not known yet
    outlines: tuple[FloatArray, ...]
    motion: FloatArray
    alone: BoolArray  # (R, K): known before
    rivals: tuple[tuple[tuple[FloatArray, FloatArray], ...], ...]  # of each outline, as `Alone.rivals`
    scans: tuple[list[int], ...]  # as `Alone.scans`

    @property
    def follows(self) -> BoolArray:
        """Whether each row is the scan after the row before."""
        return np.concatenate([[False], np.diff(self.numbers) == 1])

    @property
    def sizes(self) -> FloatArray:
        return np.array([float(np.ptp(o, axis=0).max()) for o in self.outlines])


def follow(
    known: Sequence[Alone],
    readings: Mapping[int, FloatArray],
    touched: BoolArray,
    sensor: Sensor,
    names: tuple[str, ...],
    sigma: float,
    distribution: str,
) -> list[Shared | None] | None:
    """Return for each known object what scans add in which objects share strips.

    Parameters
    ----------
    known
        Objects, at most 8.
    readings
        Of the scans in question (S, n), NaN where nothing touches or what touches is not in question.
    touched
        Strips of all scans (T, n).
    sensor, names, sigma, distribution
        Of the readings.

    Returns
    -------
    list of Shared or None
        None for an object that is in none of these scans; no list where the known objects do not explain them.
    """
    for guess in _guesses(known[:MOST_OBJECTS]):
        rows = _rows(guess, readings, touched, sensor, names, sigma)
        found = _followed(rows, guess, readings, distribution)
        if found is not None:
            return found
    return None


def _guesses(known: Sequence[Alone]) -> Iterator[Sequence[Alone]]:
    """Yield known objects, then with one of them by the outline of a rival: with a wrong one the scans do not fit."""
    yield known
    others = [(i, k, rival) for k, one in enumerate(known) for i, rival in enumerate(one.rivals)]
    for _, k, rival in sorted(others, key=lambda other: other[:2])[:_GUESSES]:
        own = known[k]
        rest = ((own.corners, own.poses), *(o for o in own.rivals if o is not rival))
        yield [*known[:k], replace(own, corners=rival[0], poses=rival[1], rivals=rest), *known[k + 1 :]]


def _followed(
    rows: _Rows, known: Sequence[Alone], readings: Mapping[int, FloatArray], distribution: str
) -> list[Shared | None] | None:
    """Return for each known object what its rows add; None where the objects do not explain them."""
    open_rows = _unexplained(rows, known, readings)
    windows = [
        w for w in np.split(open_rows, np.flatnonzero(np.diff(rows.numbers[open_rows]) > 1) + 1) if len(w)
    ]
    if not windows:
        return None
    alike = list[tuple[IntArray, Scene]]()
    for window in windows:
        found = _of_window(rows, window, _MOST_ALONE if len(windows) == 1 else _AROUND)
        if found is None:
            return None
        scene, chosen, others = found
        rows.poses[chosen] = np.where(scene.present[..., None], scene.poses, np.nan)
        rows.outlines = scene.outlines
        alike += others
    there: BoolArray = np.isfinite(rows.poses[..., 0])
    part = np.asarray(there[np.concatenate(windows)].any(axis=0))
    if len(windows) > 1:
        chosen = _chosen(rows, np.concatenate(windows), part, _MOST_ALONE)
        scene = _settled(_some(rows, chosen), _scene(rows, chosen))
    some, both = _some(rows, chosen), np.asarray(~rows.alone[chosen].any(axis=1))
    scene = _smoother(some, _trimmed(some, scene, both))
    rivals, alike = _as_smooth(some, chosen, scene, alike, both)
    scene, *rivals = sorted([scene, *rivals], key=lambda s: _criterion(some, s))
    for k in np.flatnonzero(part):
        scene, *more = _against_rivals(some, scene, int(k))
        rivals += more
    scene, *more = _explored(some, scene, part)
    scene, rivals = _smoother_too(some, scene, [*rivals, *more])
    scene, *more = _astray(some, scene, part)
    rivals += more
    outlines = _of_rivals(some, scene, rivals)
    alike += [(chosen, s) for s in _as_likely(some, scene, rivals)]
    return _shared(rows, chosen, scene, part, alike, outlines, distribution)


def _smoother(some: _Rows, scene: Scene) -> Scene:
    """Return the scene with the motion as smooth as makes the readings likeliest."""
    least = _criterion(some, scene)
    for _ in range(_HALVED):
        trial = fitted(some.hull, replace(scene, motion=0.5 * scene.motion), some.follows, 15)
        trial = _settled(some, trial, 1)
        criterion = _criterion(some, trial)
        if not criterion < least:
            break
        scene, least = trial, criterion
    return scene


def _as_smooth(
    some: _Rows, chosen: IntArray, scene: Scene, alike: list[tuple[IntArray, Scene]], both: BoolArray
) -> tuple[list[Scene], list[tuple[IntArray, Scene]]]:
    """Return other ways of the same objects in each scan, with motion as smooth as the scene's, and the rest.

    They were found where the motion was free to take up noise: that tells little of which is likelier.
    """
    rivals, rest = list[Scene](), list[tuple[IntArray, Scene]]()
    for at, other in alike:
        trimmed = _trimmed(some, other, both) if np.array_equal(at, chosen) else None
        if trimmed is not None and np.array_equal(trimmed.present, scene.present):
            trial = fitted(some.hull, replace(trimmed, motion=scene.motion), some.follows)
            rivals.append(_settled(some, trial, 1))
        else:
            rest.append((at, other))
    return rivals, rest


def _smoother_too(some: _Rows, scene: Scene, others: list[Scene]) -> tuple[Scene, list[Scene]]:
    """Return the scene as `_smoother`, and others that explain all about as well with motion as smooth."""
    least, smooth = _criterion(some, scene) + 2.0 * _ALIKE, _smoother(some, scene)
    others = [other for other in others if _criterion(some, other) < least]
    if smooth is scene:
        return scene, others
    return smooth, [
        fitted(some.hull, replace(other, motion=smooth.motion), some.follows, 15) for other in others
    ]


def _as_likely(some: _Rows, scene: Scene, others: Sequence[Scene]) -> list[Scene]:
    """Return the other scenes that explain all as well."""
    least = _criterion(some, scene) + _ALIKE
    return [s for s in others if _criterion(some, s) < least]


def _criterion(some: _Rows, scene: Scene) -> float:
    """Return what scenes with the same objects in each scan are compared by."""
    size = float(some.sizes.max())
    return evidence(some.hull, scene, some.follows, _anchors(some), size, _WIDER * size)


def _against_rivals(some: _Rows, scene: Scene, k: int) -> list[Scene]:
    """Return the scene and those with a rival of an outline, the one first that explains all scans best."""
    tried, soft = [scene], _SOFT * float(some.sizes.max())
    for corners, poses in some.rivals[k][:_RIVALS]:
        trial = _straight_on(some, scene, k, corners, poses)
        trial = fitted(some.hull, trial, some.follows, 8, soft, _CAUCHY, shapes=False)
        trial = _settled(some, trial, 1, soft, shapes=False)
        trial = fitted(some.hull, trial, some.follows, 8, soft)
        tried.append(_settled(some, fitted(some.hull, trial, some.follows), 1))
    criteria = np.array([_criterion(some, s) for s in tried])
    criteria[1:] += _BETTER  # what was found first stays unless another is clearly better
    best = int(criteria.argmin())
    return [tried[best], *tried[:best], *tried[best + 1 :]]


def _straight_on(some: _Rows, scene: Scene, k: int, corners: FloatArray, poses: FloatArray) -> Scene:
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


def _explored(some: _Rows, scene: Scene, part: BoolArray) -> list[Scene]:
    """Return where descents from beside the outlines end that few strips read, the best first.

    The scans of each alone leave such an outline open along valleys, and the corners' number: all scans have other
    minima than these have. The outlines are moved along what all scans tell least, and lose or gain a corner.
    """
    few = [int(k) for k in np.flatnonzero(part & some.alone.any(axis=0)) if _few_read(some, int(k))]
    ends, soft, same = [scene], _SOFT * float(some.sizes.max()), _SAME * float(some.sizes.min())
    price = 2.0 * float(np.log(some.hull.scans.readings.sum())) + PLACES
    for _ in range(_EXPLORED if few else 0):
        tries, least = list[Scene](), _criterion(some, scene)
        spread = outline_covariances(some.hull, scene, some.follows, _anchors(some))
        for k in few:
            own = scene.outlines[k]
            starts = along_the_open(own, spread[k])
            starts += [np.delete(own, i, axis=0) for i in faintest(own)] if len(own) > FEWEST else []
            starts += edges_bent(own) if len(own) + 1 < FIRST else []
            for start in starts:
                trial = replace(scene, outlines=(*scene.outlines[:k], start, *scene.outlines[k + 1 :]))
                tries.append(fitted(some.hull, trial, some.follows, 8, soft, _CAUCHY))
        tries = [fitted(some.hull, s, some.follows, 6) for s in _unlike(tries, same)]
        tries.sort(key=lambda s: s.cost + price * sum(len(o) for o in s.outlines))
        near = _unlike(tries, same)[:_SETTLED]
        ends += [_settled(some, s, 1) for s in near if s.cost < scene.cost + _NEVER]
        ends.sort(key=lambda s: _criterion(some, s))
        scene = ends[0]
        if not _criterion(some, scene) < least - _DEEPER:
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


def _few_read(some: _Rows, k: int) -> bool:
    """Whether scans in which an object is alone touch few strips."""
    return some.hull.scans.of(np.flatnonzero(some.alone[:, k])).strips_touched < FEW_A_SCAN


def _of_rivals(some: _Rows, scene: Scene, others: list[Scene]) -> list[list[tuple[FloatArray, float]]]:
    """Return each object's outlines, in its frame, in other scenes that explain all as well, and how much worse."""
    best, anchors = _criterion(some, scene), _anchors(some)

    def seen(s: Scene) -> list[FloatArray]:
        return [
            placed(o, s.poses[row, k]) for k, (o, row) in enumerate(zip(s.outlines, anchors, strict=True))
        ]

    kept, worse = [seen(scene)], list[float]()
    for other in others:
        mine, by = seen(other), _criterion(some, other) - best
        if by < _ALIKE and not any(_same_outlines(mine, k, _SAME * float(some.sizes.min())) for k in kept):
            kept.append(mine)
            worse.append(by)
    return [
        [(in_frame(one[k], scene.poses[row, k]), by) for one, by in zip(kept[1:], worse, strict=True)]
        for k, row in enumerate(anchors)
    ]


def _same_outlines(a: Sequence[FloatArray], b: Sequence[FloatArray], within_mm: float) -> bool:
    return all(len(p) == len(q) and float(np.abs(p - q).max()) < within_mm for p, q in zip(a, b, strict=True))


def _anchors(some: _Rows) -> list[int]:
    """Return for each object a row in which it is alone."""
    return [int(np.flatnonzero(alone)[0]) if alone.any() else 0 for alone in some.alone.T]


def _astray(some: _Rows, scene: Scene, part: BoolArray) -> list[Scene]:
    """Return the scene, or a better one in which an object gradually goes another way, and what explains as well.

    What others leave to see of an object, such as one edge or one corner, may fit two ways that part slowly from where
    it was alone. Each is a minimum of its own, so that the covariance at one does not tell of the other.
    """
    found = [(_criterion(some, scene), scene)]
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
                    found = sorted([*found, (_criterion(some, trial), trial)], key=lambda s: s[0])
    return [s for _, s in found]


def _free_end(some: _Rows, run: IntArray, k: int) -> FloatArray:
    """Return how much of a deviation each row of a run gets (R,): ever less towards scans in which it is alone."""
    first, last = int(run[0]), int(run[-1])
    held = first > 0 and some.follows[first] and some.alone[first - 1, k]
    held_after = last + 1 < len(some.follows) and some.follows[last + 1] and some.alone[last + 1, k]
    t = np.linspace(0.0, 1.0, len(run) + 2)[1:-1]
    if held and held_after:
        return np.asarray(np.sin(np.pi * t))
    return t if held else 1.0 - t if held_after else np.ones(len(run))


def _other_way(some: _Rows, trial: Scene, best: Scene) -> Scene | None:
    """Return where a descent from other poses ends; None where that is the best scene again, or explains too little."""
    trial = fitted(some.hull, trial, some.follows, 10, _SOFT * float(some.sizes.max()), _CAUCHY, shapes=False)
    if _same_poses(some, trial, best):
        return None
    trial = _settled(some, trial, 1, shapes=False)
    if trial.cost > best.cost + _NEVER or _same_poses(some, trial, best):
        return None
    trial = fitted(some.hull, trial, some.follows, 15)
    return None if trial.cost > best.cost + _ALIKE or _same_poses(some, trial, best) else trial


def _same_poses(some: _Rows, a: Scene, b: Scene) -> bool:
    """Whether two scenes of the same presence have the same poses."""
    off = np.abs(a.poses - b.poses)[a.present]
    return bool((off <= (SAME * np.array([some.sizes.min(), some.sizes.min(), 1.0]))).all())


def _rows(
    known: Sequence[Alone],
    readings: Mapping[int, FloatArray],
    touched: BoolArray,
    sensor: Sensor,
    names: tuple[str, ...],
    sigma: float,
) -> _Rows:
    numbers = np.array(sorted({*readings, *(s for one in known for s in one.scans)}))
    row_of = {int(n): i for i, n in enumerate(numbers)}
    k = np.full((len(numbers), len(names), sensor.strips), np.nan)
    poses = np.full((len(numbers), len(known), 3), np.nan)
    for number, own in readings.items():
        k[row_of[number]] = own
    for i, one in enumerate(known):
        for number, pose, own in zip(one.scans, one.poses, one.readings, strict=True):
            row = k[row_of[number]]
            row[np.isfinite(own)] = own[np.isfinite(own)]
            poses[row_of[number], i] = pose
    mine = np.isfinite(k).any(axis=1)
    ever = np.flatnonzero(touched.any(axis=0))
    dead = np.zeros(sensor.strips, dtype=bool)
    dead[ever[0] : ever[-1] + 1] = ~touched[:, ever[0] : ever[-1] + 1].any(axis=0)
    quiet = np.where(~mine & (touched[numbers] | dead), 0.0, 1.0)
    motion = np.stack([_jerk(one) for one in known])
    return _Rows(
        numbers, HullScans(RigidScans(sensor, names, k, sigma), quiet), poses, tuple(one.corners for one in known),
        motion, np.isfinite(poses[..., 0]), tuple(one.rivals for one in known), tuple(one.scans for one in known),
    )  # fmt: skip


def _jerk(one: Alone) -> FloatArray:
    """Return how large second differences of its poses are (3,)."""
    size = float(np.ptp(one.corners, axis=0).max())
    return np.array([_STEADY * size, _STEADY * size, _TURNS])


def _unexplained(rows: _Rows, known: Sequence[Alone], readings: Mapping[int, FloatArray]) -> IntArray:
    """Return the rows in which something is touched that no object alone accounts for."""
    left = np.asarray(np.isfinite(rows.hull.scans.k).any(axis=1))
    row_of = {int(n): i for i, n in enumerate(rows.numbers)}
    for one in known:
        for number, own in zip(one.scans, one.readings, strict=True):
            left[row_of[number]] &= ~np.isfinite(own).any(axis=0)
    return np.flatnonzero(left.any(axis=1))


def _of_window(
    rows: _Rows, window: IntArray, most: int
) -> tuple[Scene, IntArray, list[tuple[IntArray, Scene]]] | None:
    """Return the best scene about a window, its rows, and others that explain the window as well, with theirs."""
    fits: list[tuple[Scene, float, IntArray]] = []
    for tried, (poses, events) in enumerate(_candidates(rows, window)):
        if any(_same_way(poses, scene, np.searchsorted(own, window), rows.sizes) for scene, _, own in fits):
            continue
        if tried >= _FIRST and all(
            len(_bad(_some(rows, own).hull, scene)) > _HOPELESS * len(window) for scene, _, own in fits
        ):
            return None
        trial = _with_poses(rows, window, poses)
        part = np.asarray(np.isfinite(poses[..., 0]).any(axis=0))
        chosen = _chosen(trial, window, part, most)
        scene = _scene(trial, chosen)
        fits.append((scene, scene.cost + events, chosen))
    if not fits:
        return None
    fits.sort(key=lambda fit: fit[1])
    (best, cost, chosen), some = fits[0], _some(rows, fits[0][2])
    others = [(own, scene) for scene, worse, own in fits[1:] if worse - cost < _ALIKE]
    allowed = _WORST * len(window) + 1
    best = _settled(some, best)
    for k in range(len(rows.rivals)):  # what scans alone leave open, all scans may decide
        if len(_bad(some.hull, best)) > allowed and best.present[:, k].any():
            best = _against_rivals(some, best, k)[0]
    return (best, chosen, others) if len(_bad(some.hull, best)) <= allowed else None


def _same_way(poses: FloatArray, scene: Scene, at: IntArray, sizes: FloatArray) -> bool:
    """Whether poses (W, K, 3) are where a scene that was fitted has them in its rows `at` (W,)."""
    there = np.isfinite(poses[..., 0])
    if (there != scene.present[at]).any():
        return False
    off = poses - scene.poses[at]
    off[..., 2] = (off[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return bool((np.abs(off) <= SAME * np.stack([sizes, sizes, np.ones(len(sizes))], axis=1))[there].all())


def _with_poses(rows: _Rows, window: IntArray, poses: FloatArray) -> _Rows:
    """Return rows with poses (W, K, 3) in a window, angles without jumps."""
    every = rows.poses.copy()
    every[window] = poses
    for k in range(every.shape[1]):
        on = np.flatnonzero(np.isfinite(every[:, k, 2]))
        every[on, k, 2] = np.unwrap(every[on, k, 2])
    return replace(rows, poses=every)


def _candidates(rows: _Rows, window: IntArray) -> list[tuple[FloatArray, float]]:
    """Return poses (W, K, 3) in a window that may be, and what they cost because something comes or goes.

    The best of each direction come first.
    """
    first, last = int(window[0]), int(window[-1])
    follows = rows.follows
    found: list[list[tuple[FloatArray, float]]] = []
    for sign, edge in ((-1, first), (1, last)):
        start: list[FloatArray] = []
        row = edge + sign
        while 0 <= row < len(follows) and len(start) < _BEFORE and follows[row + (sign < 0)]:
            start.insert(0, rows.poses[row])
            row += sign
        empty = not start
        if empty:
            start = [np.full(rows.poses.shape[1:], np.nan)]
        order = window if sign < 0 else window[::-1]
        if empty and sign > 0:
            continue  # nothing is known behind it, and from in front it was tried
        ended = ways(rows.hull, rows.outlines, start, order)
        scored = sorted(
            ((w.cost + _jump(rows, w, last + 1 if sign < 0 else first - 1, follows), w) for w in ended),
            key=lambda p: p[0],
        )
        own = [np.stack(way.poses[len(start) :])[::-sign] for _, way in scored[:_CANDIDATES]]
        found.append([(poses, _EVENT * _events(rows, window, poses)) for poses in own])
    return [one for alike in zip_longest(*found) for one in alike if one is not None]


def _jump(rows: _Rows, way: Way, after: int, follows: BoolArray) -> float:
    """Return what it costs that a hypothesis goes on as the row after it is known."""
    if not 0 <= after < len(rows.numbers):
        return 0.0
    pose, cost = rows.poses[after], 0.0
    scale = 0.05 * np.stack([rows.sizes, rows.sizes, np.ones(len(rows.sizes))], axis=1)
    for k in range(len(pose)):
        now, then = np.isfinite(pose[k, 0]), k in way.present
        if now != then:
            cost += _EVENT
        elif now:
            off = way.expected[k] - pose[k]
            off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi
            cost += min(float(((off / scale[k]) ** 2).sum()), _FAR)
    return cost


def _events(rows: _Rows, window: IntArray, poses: FloatArray) -> int:
    """Return how often something comes or goes."""
    every = rows.poses.copy()
    every[window] = poses
    a, b = max(int(window[0]) - 1, 0), min(int(window[-1]) + 2, len(every))
    there = np.isfinite(every[a:b, :, 0])
    return int((there[1:] != there[:-1]).sum())


def _chosen(rows: _Rows, window: IntArray, part: BoolArray, most: int) -> IntArray:
    """Return the rows of a fit: a window, what is next to it, and of each object that takes part enough alone."""
    take = np.zeros(len(rows.numbers), dtype=bool)
    take[window] = True
    for k in np.flatnonzero(part):
        mine = np.flatnonzero(rows.alone[:, k])
        near = np.abs(mine[:, None] - window[None]).min(axis=1)
        take[mine[np.argsort(near, kind="stable")[:most]]] = True
        take[mine[np.unique(np.linspace(0, len(mine) - 1, min(most, len(mine))).astype(int))]] = True
    return np.flatnonzero(take)


def _some(rows: _Rows, chosen: IntArray) -> _Rows:
    return replace(
        rows,
        numbers=rows.numbers[chosen],
        hull=rows.hull.of(chosen),
        poses=rows.poses[chosen],
        alone=rows.alone[chosen],
    )


def _scene(rows: _Rows, chosen: IntArray) -> Scene:
    """Return the joint fit of some rows from their poses."""
    some = _some(rows, chosen)
    present = np.isfinite(some.poses[..., 0])
    poses = np.nan_to_num(some.poses)
    scene = Scene(rows.outlines, poses, present, rows.motion, np.zeros(len(poses)))
    soft = _SOFT * float(rows.sizes.max())
    scene = fitted(some.hull, scene, some.follows, 8, soft, _CAUCHY, shapes=False)
    scene = fitted(some.hull, scene, some.follows, 8, soft, shapes=False)
    scene = _settled(some, scene, 2, soft, shapes=False)
    scene = fitted(some.hull, scene, some.follows, 8, soft, _CAUCHY)
    scene = fitted(some.hull, scene, some.follows, 8, cauchy=_CAUCHY)
    scene = fitted(some.hull, scene, some.follows)
    for _ in range(2):  # motion that is less smooth than thought
        bends = 3.0 * float((scene.bends & some.follows[1:-1, None] & some.follows[2:, None]).sum())
        if scene.prior <= _JERKS * max(bends, 1.0):
            break
        scene = replace(scene, motion=scene.motion * np.sqrt(scene.prior / bends))
        scene = fitted(some.hull, scene, some.follows)
    return scene


def _bad(hull: HullScans, scene: Scene) -> IntArray:
    """Return the rows whose readings a scene does not explain."""
    n = hull.scans.readings
    return np.flatnonzero(scene.costs > n + _SPREAD * np.sqrt(n) + _BAD)


def _settled(
    rows: _Rows, scene: Scene, rounds: int = _REPAIRS, tolerance_mm: float = 0.0, shapes: bool = True
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


def _suspect(rows: _Rows, scene: Scene) -> IntArray:
    """Return the rows whose readings a scene does not explain, or which make its motion rough."""
    where, weight = expected(scene, rows.follows)
    rough = (weight * (where - scene.poses) ** 2).sum(axis=(1, 2)) > _ROUGH
    return np.union1d(_bad(rows.hull, scene), np.flatnonzero(rough))


def _by_themselves(
    rows: _Rows,
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


def _trimmed(rows: _Rows, scene: Scene, shared: BoolArray) -> Scene:
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


def _shared(
    rows: _Rows,
    chosen: IntArray,
    scene: Scene,
    part: BoolArray,
    alike: list[tuple[IntArray, Scene]],
    rivals: list[list[tuple[FloatArray, float]]],
    distribution: str,
) -> list[Shared | None]:
    """Return what is known of each object."""
    some = _some(rows, chosen)
    bad, readings = _bad(some.hull, scene), some.hull.scans.readings
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
    spread = pose_covariances(some.hull, scene, some.follows, _anchors(some), np.flatnonzero(shared))
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


def _sharing(some: _Rows, scene: Scene, mine: IntArray, k: int) -> tuple[int, ...]:
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
    some: _Rows,
    scene: Scene,
    k: int,
    alike: list[tuple[IntArray, Scene]],
    rows: _Rows,
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

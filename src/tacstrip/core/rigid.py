"""One rigid outline in many scans: least squares for its corners and for its pose in each scan, together or by itself.

A strip reads the hull of the outline on its centre line, so that it may be concave. Two scans share nothing but the
corners: eliminating the poses (Schur's complement) leaves equations of the corners alone, and the time of a step grows
with the number of scans only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import RIGID_CORNERS, CornerPrior, Loss, Scans, Sendable, at, exported
from tacstrip.core.problem import LEAST_D
from tacstrip.sensor.closed_form import sensing_share
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

MOST_CORNERS = 19  # of an outline whose corners are fitted
STEEPEST = 16.0  # slope squared from which an edge's tolerance grows no more
DAMPING, EASED, LEAST, HOPELESS = 1e-3, 6.0, 1e-9, 1e8  # of the steps; what is added to the diagonal
PINNED = 1e12  # weight of the pose that the frame is fixed to
TOUCHES = 1e-12  # an edge no longer than this in x is vertical
_BLOCK = 512  # scans that are linearised at a time
_SETTLED = 1e-3  # gain in chi square, or in a pose's own cost its share, that ends a descent


@dataclass(frozen=True, eq=False)
class RigidScans(Sendable):
    """Readings of one object, scan by scan, of S signatures.

    Attributes
    ----------
    sensor
        That the scans are of.
    names
        Signatures (S,).
    k
        Readings over Vref (T, S, n); NaN where there is none.
    sigma
        Standard deviation of a reading.
    """

    sensor: Sensor
    names: tuple[str, ...]
    k: FloatArray
    sigma: float

    @cached_property
    def x_mm(self) -> FloatArray:
        """Centre lines (n,) [mm]."""
        return np.ascontiguousarray(self.sensor.x_mm)

    @cached_property
    def gaps_mm(self) -> FloatArray:
        """From each strip to the next one that is read, to the left and to the right (2, n); infinite: there is none.

        Of a strip that is left out wholly nobody knows whether it is touched.
        """
        strips = np.arange(len(self.x_mm))
        read = np.flatnonzero(~left_out_wholly(self.sensor))
        left = np.concatenate([[-np.inf], read])[np.searchsorted(read, strips, side="left")]
        right = np.concatenate([read, [np.inf]])[np.searchsorted(read, strips, side="right")]
        return np.ascontiguousarray(self.sensor.pitch_mm * np.stack([strips - left, right - strips]))

    @cached_property
    def readings(self) -> IntArray:
        """Readings of each scan (T,)."""
        return np.asarray(np.isfinite(self.k).sum(axis=(1, 2)), dtype=np.int64)

    @cached_property
    def channels(self) -> IntArray:
        """Places of the channels that any scan has a reading of, signature by signature."""
        return np.flatnonzero(np.isfinite(self.k).any(axis=0))

    @cached_property
    def reached(self) -> slice:
        """The strips from the first to the last one that any scan touches."""
        strips = self.channels % self.k.shape[2]
        return slice(int(strips.min()), int(strips.max()) + 1) if len(strips) else slice(0, 0)

    @cached_property
    def read(self) -> tuple[int, ...]:
        """Places of the signatures that have readings; those of strips whose other channel is left out have one."""
        return tuple(np.flatnonzero(np.isfinite(self.k).any(axis=(0, 2))).tolist())

    @cached_property
    def strips_touched(self) -> float:
        """How many strips a scan touches, in the median."""
        return float(np.median(np.isfinite(self.k).any(axis=1).sum(axis=1)))

    @cached_property
    def shares(self) -> FloatArray:
        """c_u of a contact without width per signature (S,)."""
        a = sensing_share(self.sensor.sensing_ratio)
        return np.array([a if SIGNATURES[name].at_upper_end else 0.0 for name in self.names])

    @property
    def narrow(self) -> float:
        """1 - a of the closed form."""
        return 1.0 - sensing_share(self.sensor.sensing_ratio)

    def of(self, scans: Sequence[int] | IntArray | slice) -> RigidScans:
        """Return some of the scans."""
        return replace(self, k=self.k[scans])

    def with_sigma(self, sigma: float) -> RigidScans:
        """Return the same readings, taken for as uncertain as that."""
        return replace(self, sigma=sigma)

    @cached_property
    def compiled(self) -> Scans:
        """What the compiled core takes; the arrays are these scans' own."""
        k, gaps_mm, sensor = np.ascontiguousarray(self.k), self.gaps_mm, self.sensor
        shares = (float(self.shares[0]), float(self.shares[-1]))
        made = Scans(
            len(k), k.shape[2], k.shape[1], at(self.x_mm), at(k), at(gaps_mm), self.sigma, sensor.pitch_mm,
            sensor.length_mm, shares, self.narrow, sensor.contact_lambda_mm / sensor.length_mm,
        )  # fmt: skip
        made.arrays = (self.x_mm, k, gaps_mm)
        return made


@dataclass(frozen=True)
class Equations:
    """Normal equations of the corners of K outlines, C numbers in all, and of their poses in T scans.

    Attributes
    ----------
    pose, mixed, shape
        Blocks of J'WJ: (T, 3 K, 3 K), (T, 3 K, C) and (C, C).
    pose_slope, shape_slope
        J'Wr, (T, 3 K) and (C,).
    costs
        What each scan costs (T,).
    """

    pose: FloatArray
    mixed: FloatArray
    shape: FloatArray
    pose_slope: FloatArray
    shape_slope: FloatArray
    costs: FloatArray


@dataclass(frozen=True, eq=False)
class Prior(Sendable):
    """What is known of corners beside the scans: a normal distribution.

    Attributes
    ----------
    information
        Half the curvature of its cost (2 N, 2 N); it also holds the corners' frame.
    slope
        Half the descent of its cost at `about` (2 N,).
    about
        Corners (N, 2) [mm].
    """

    information: FloatArray
    slope: FloatArray
    about: FloatArray

    @cached_property
    def compiled(self) -> CornerPrior:
        """What the compiled core takes; the arrays are this prior's own."""
        arrays = tuple(np.ascontiguousarray(a) for a in (self.information, self.slope, self.about))
        made = CornerPrior(*map(at, arrays))
        made.arrays = arrays
        return made

    def at(self, corners: FloatArray) -> tuple[FloatArray, float]:
        """Return half the descent of the cost at corners, and the cost."""
        off = (corners - self.about).ravel()
        pull = self.slope - self.information @ off
        return np.asarray(pull), float(-off @ (pull + self.slope))


def loss(scans: RigidScans, tolerance_mm: float = 0.0, cauchy: float = 0.0, end: float = 0.05) -> Loss:
    """Return how far readings may lie from what an outline makes.

    Parameters
    ----------
    scans
        What is fitted.
    tolerance_mm
        Of edges, across them: adds to sigma while an outline is only roughly known.
    cauchy
        Scale of Cauchy's loss in sigmas; 0: least squares.
    end
        Deviation of an end corner from the gap between strips that it lies in, in pitches.
    """
    return Loss(tolerance_mm, cauchy, end * scans.sensor.pitch_mm)


def equations(scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss) -> Equations:
    """Return the normal equations of corners (N, 2) [mm], in a frame of their own, and poses (T, 3)."""
    core = exported("rigid_equations")
    if core is None or len(corners) > RIGID_CORNERS:
        return plain_equations(scans, corners, poses, how)
    many, size = len(poses), 2 * len(corners)
    shapes = ((many, 3, 3), (many, 3, size), (size, size), (many, 3), (size,), (many,))
    found = Equations(*(np.empty(shape) for shape in shapes))
    corners, poses = np.ascontiguousarray(corners), np.ascontiguousarray(poses)
    core(scans.compiled, how, at(corners), len(corners), at(poses), *map(at, vars(found).values()))
    return found


def fit_poses(
    scans: RigidScans, corners: FloatArray, starts: FloatArray, how: Loss, steps: int = 12
) -> tuple[FloatArray, FloatArray]:
    """Return where descents from poses (T, K, 3) end, each by itself, and their costs (T, K)."""
    core, poses = exported("rigid_poses"), np.array(starts)
    costs = np.empty(poses.shape[:2])
    if core is not None and len(corners) <= RIGID_CORNERS:
        corners = np.ascontiguousarray(corners)
        core(scans.compiled, how, at(corners), len(corners), at(poses), poses.shape[1], steps, at(costs))
        return poses, costs
    for k in range(poses.shape[1]):
        poses[:, k], costs[:, k] = _plain_fit_poses(scans, corners, poses[:, k], how, steps)
    return poses, costs


def walk(
    scans: RigidScans,
    corners: FloatArray,
    poses: FloatArray,
    costs: FloatArray,
    follow: FloatArray,
    tries: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the corners after each step of Metropolis' walk (M, N, 2), the last one's poses (T, 3) and costs (T,).

    Of corners and poses alike: the outlines that it meets are as likely as they are with all their poses together.

    Parameters
    ----------
    scans
        That the walk is to explain, by least squares.
    corners, poses, costs
        Where it begins: (N, 2) [mm], (T, 3) and chi square of each scan (T,).
    follow
        How the poses are moved as the corners are tried elsewhere: by -follow (T, 3, 2 N) times that.
    tries
        By how much the corners are moved (M, N, 2) [mm], and by how much that may cost more (M,); then each pose, some
        times by itself (M, K, T, 3), likewise (M, K, T).
    """
    core = exported("rigid_walk")
    if core is None or len(corners) > RIGID_CORNERS:
        return _plain_walk(scans, corners, poses, costs, follow, tries)
    corners, poses, costs = np.array(corners), np.array(poses), np.array(costs)
    moves, above, pose_steps, pose_above = map(np.ascontiguousarray, tries)
    follow, walked = np.ascontiguousarray(follow), np.empty(moves.shape)
    workspace = np.empty(corners.size + 4 * len(poses))
    core(
        scans.compiled, loss(scans), at(corners), len(corners), at(poses), at(costs), at(follow), at(moves), at(above),
        len(moves), at(pose_steps), at(pose_above), pose_steps.shape[1], at(walked), at(workspace),
    )  # fmt: skip
    return walked, poses, costs


def descend(
    scans: RigidScans,
    corners: FloatArray,
    poses: FloatArray,
    how: Loss,
    steps: int = 40,
    prior: Prior | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners (N, 2) and poses (T, 3) after a descent of both together, and the scans' costs (T,).

    Without a prior, which holds the corners' frame, the pose of the scan in the middle stays where it is.
    """
    core = exported("rigid_descend")
    if core is None or len(corners) > MOST_CORNERS:
        return _plain_descend(scans, corners, poses, how, steps, prior)
    corners, poses, costs, count = np.array(corners), np.array(poses), np.empty(len(poses)), len(corners)
    workspace = np.empty(len(poses) * (31 + 12 * count) + 8 * count**2 + 8 * count)
    known = None if prior is None else prior.compiled
    core(scans.compiled, how, known, at(corners), count, at(poses), steps, _SETTLED, at(costs), at(workspace))
    return corners, poses, costs


def reduced(
    found: Equations, damping: float = 0.0, pinned: float = PINNED
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the corners' equations without the poses, matrix and slope, and the inverse of the poses' (T, 3, 3)."""
    own = np.arange(3)
    blocks = found.pose.copy()
    blocks[:, own, own] += damping * blocks[:, own, own] + LEAST
    middle = len(blocks) // 2
    blocks[middle : middle + 1, own, own] += pinned
    try:
        inverse = np.linalg.inv(blocks)
    except np.linalg.LinAlgError:  # scans that do not tell all of their pose
        inverse = np.linalg.pinv(blocks, hermitian=True)
    weighted = inverse @ found.mixed
    size = np.arange(len(found.shape))
    by_pose = weighted.reshape(-1, len(size)).T
    matrix = found.shape - by_pose @ found.mixed.reshape(-1, len(size))
    matrix[size, size] += damping * found.shape[size, size] + LEAST
    slope = found.shape_slope - by_pose @ found.pose_slope.ravel()
    return np.asarray(matrix), np.asarray(slope), np.asarray(inverse)


@dataclass(frozen=True)
class Linearised:
    """What strips read of posed corners, and how it changes with pose and corners; arrays (T, S, n, ...).

    0 of strips beside those that any scan touches.
    """

    model: FloatArray
    rows: FloatArray  # dk by the pose (3) and the corners (2 N)


@dataclass(frozen=True)
class Placed:
    """What else follows of posed corners."""

    edges: FloatArray  # dk by a shift of the lower and of the upper edge across itself, squared (T, S, n)
    x: FloatArray  # of the corners (T, N) [mm]
    y: FloatArray


def linearised(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> Linearised:
    """Return what strips read of corners (N, 2) at poses (T, 3)."""
    core, reached = exported("rigid_linearised"), scans.reached
    if core is None or len(corners) > RIGID_CORNERS:
        return plain_linearised(scans, corners, poses)[0]
    found = Linearised(np.zeros(scans.k.shape), np.zeros((*scans.k.shape, 3 + corners.size)))
    corners, poses = np.ascontiguousarray(corners), np.ascontiguousarray(poses)
    where = (at(corners), len(corners), at(poses), reached.start, reached.stop)
    core(scans.compiled, *where, at(found.model), at(found.rows))
    return found


def plain_linearised(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> tuple[Linearised, Placed]:
    """Do as `linearised`, all scans and strips at once."""
    sensor, length = scans.sensor, scans.sensor.length_mm
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x = cos * corners[:, 0] - sin * corners[:, 1] + poses[:, :1]  # (T, N)
    y = sin * corners[:, 0] + cos * corners[:, 1] + poses[:, 1:2]
    low, high = _crossings(x, y, scans.x_mm[scans.reached])
    by = [_slopes(x, y, cos, sin, poses, crossing) for crossing in (low, high)]  # (T, n, 3 + 2 N)
    l, u = (np.clip(c[1] / length, 0.0, 1.0) for c in (low, high))
    held = [(c[1] > 0.0) & (c[1] < length) for c in (low, high)]
    w, lam = u - l, sensor.contact_lambda_mm / length
    h = np.tanh(w / (2.0 * lam)) if lam > 0.0 else np.zeros_like(w)
    t, mix = lam * h, 0.5 * (1.0 - h * h) if lam > 0.0 else np.zeros_like(w)
    over = 1.0 / np.maximum(1.0 - scans.narrow * (w - 2.0 * t), LEAST_D)
    rough = [1.0 + np.minimum(c[3] ** 2, STEEPEST) for c in (low, high)]
    models, rows, edges = [], [], []
    for share in scans.shares[: len(scans.names)]:
        model = ((1.0 - share) * (l + t) + share * (u - t)) * over
        lower, upper = (1.0 - share - scans.narrow * model) * over, (share + scans.narrow * model) * over
        by_l, by_u = (
            (lower * (1.0 - mix) + upper * mix) / length,
            (upper * (1.0 - mix) + lower * mix) / length,
        )
        models.append(model)
        rows.append((by_l * held[0])[..., None] * by[0] + (by_u * held[1])[..., None] * by[1])
        edges.append(by_l**2 * rough[0] + by_u**2 * rough[1])
    every = []
    for part in (models, rows, edges):
        every.append(np.zeros((*scans.k.shape, *part[0].shape[2:])))
        every[-1][:, :, scans.reached] = np.stack(part, axis=1)
    return Linearised(every[0], every[1]), Placed(every[2], x, y)


def linearised_blocks(
    scans: RigidScans, corners: FloatArray, poses: FloatArray
) -> Iterator[tuple[IntArray, RigidScans, Linearised]]:
    """Yield which scans, these, and what their strips read, some hundred at a time: of many strips that is large."""
    for some in np.array_split(np.arange(len(poses)), max(-(-len(poses) // _BLOCK), 1)):
        part = scans.of(some)
        yield some, part, linearised(part, corners, poses[some])


def plain_equations(scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss) -> Equations:
    """Do as `equations`, all scans and strips at once."""
    size, there = 2 * len(corners), np.isfinite(scans.k)
    touched = np.asarray(there.any(axis=1))  # (T, n)
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    at_poses, placed = plain_linearised(scans, corners, poses)
    pose, mixed = np.zeros((len(poses), 3, 3)), np.zeros((len(poses), 3, size))
    shape, slope, costs = np.zeros((size, size)), np.zeros((len(poses), 3 + size)), np.zeros(len(poses))

    def add(rows: FloatArray, residual: FloatArray, variance: FloatArray, used: FloatArray) -> None:
        """Take rows (T, M, 3 + 2 N) of residuals (T, M)."""
        nonlocal pose, mixed, shape, slope, costs
        cost, weight = _loss(np.where(used, residual, 0.0), variance, how)
        weight = np.where(used, weight, 0.0)
        costs += (cost * used).sum(axis=1)
        both = np.einsum("tmi,tm,tmj->tij", rows, weight, rows, optimize=True)
        pose, mixed, shape = (
            pose + both[:, :3, :3],
            mixed + both[:, :3, 3:],
            shape + both[:, 3:, 3:].sum(axis=0),
        )
        slope = slope + np.einsum("tmi,tm->ti", rows, weight * np.where(used, residual, 0.0))

    for row in range(len(scans.names)):
        variance = scans.sigma**2 + how.tolerance**2 * placed.edges[:, row]
        add(at_poses.rows[:, row], scans.k[:, row] - at_poses.model[:, row], variance, there[:, row])
    for right in (False, True):
        rows, residual, used = _gap(scans, placed.x, placed.y, cos, sin, poses, touched, right)
        add(rows, residual, np.full(residual.shape, how.end**2), used)
    return Equations(pose, mixed, shape, slope[:, :3].copy(), slope[:, 3:].sum(axis=0), costs)


def _crossings(x: FloatArray, y: FloatArray, at_x: FloatArray) -> list[tuple[FloatArray, ...]]:
    """Return where strips cross posed corners (T, N) lowest and highest: edge, y, share and slope, each (T, n)."""
    after = np.arange(1, x.shape[1] + 1) % x.shape[1]
    x0, y0, x1, y1 = (v[..., None] for v in (x, y, x[:, after], y[:, after]))
    crossed = ((x0 <= at_x) & (at_x < x1)) | ((x1 <= at_x) & (at_x < x0))
    run = x1 - x0
    share = (at_x - x0) / np.where(run == 0.0, 1.0, run)
    height = y0 + share * (y1 - y0)
    steep = (y1 - y0) / np.where(np.abs(run) < TOUCHES, np.where(run < 0.0, -TOUCHES, TOUCHES), run)
    ends = np.stack([x.argmin(axis=1), x.argmax(axis=1)])
    rows = np.arange(len(x))
    far = np.abs(at_x - x[rows, ends][..., None])  # (2, T, n)
    corner = np.where(far[1] < far[0], ends[1][:, None], ends[0][:, None])
    beside = np.asarray(~crossed.any(axis=1))
    found: list[tuple[FloatArray, ...]] = []
    for sign in (1.0, -1.0):
        edge = np.where(crossed, sign * height, np.inf).argmin(axis=1)
        lowest, part, slope = (
            np.take_along_axis(v, edge[:, None], axis=1)[:, 0]
            for v in (height, share, np.broadcast_to(steep, share.shape))
        )
        lowest = np.where(beside, np.take_along_axis(y, corner, axis=1), lowest)
        part, slope = np.where(beside, 0.0, part), np.where(beside, 0.0, slope)
        found.append((np.where(beside, corner, edge), lowest, part, slope))
    return found


def _slopes(
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    poses: FloatArray,
    crossing: tuple[FloatArray, ...],
) -> FloatArray:
    """Return dy of crossings (T, n) by poses and corners (T, n, 3 + 2 N)."""
    edge, _, share, m = crossing
    to = np.where((share == 0.0) & (m == 0.0), edge, (edge + 1) % x.shape[1])
    found = np.zeros((*edge.shape, 3 + 2 * x.shape[1]))
    scan, strip = np.indices(edge.shape)
    ex, ey = sin - m * cos, m * sin + cos
    found[..., 0], found[..., 1] = -m, 1.0
    for corner, part in ((edge, 1.0 - share), (to, share)):
        turned = x[scan, corner] - poses[:, :1] + m * (y[scan, corner] - poses[:, 1:2])
        found[..., 2] += part * turned
        found[scan, strip, 3 + 2 * corner] += part * ex
        found[scan, strip, 4 + 2 * corner] += part * ey
    return found


def _gap(
    scans: RigidScans,
    x: FloatArray,
    y: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    poses: FloatArray,
    touched: BoolArray,
    right: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rows (T, 1, 3 + 2 N), residuals (T, 1) and whether they count, of an end corner outside its gap."""
    rows, n = np.arange(len(x)), touched.shape[1]
    corner = x.argmax(axis=1) if right else x.argmin(axis=1)
    strip = n - 1 - touched[:, ::-1].argmax(axis=1) if right else touched.argmax(axis=1)
    inner = scans.x_mm[strip]
    outer = inner + scans.gaps_mm[1, strip] if right else inner - scans.gaps_mm[0, strip]
    least, most = (inner, outer) if right else (outer, inner)
    own, height = x[rows, corner], y[rows, corner]
    beyond = own > most if right else own < least
    unread = beyond & ((height < 0.0) | (height > scans.sensor.length_mm))
    used = touched.any(axis=1) & ((own < least) | (own > most)) & ~unread
    residual = np.where(own < least, least, most) - own
    slope = np.zeros((len(x), 1, 3 + 2 * x.shape[1]))
    slope[:, 0, 0], slope[:, 0, 2] = 1.0, poses[:, 1] - height
    slope[rows, 0, 3 + 2 * corner], slope[rows, 0, 4 + 2 * corner] = cos[:, 0], -sin[:, 0]
    return slope, residual[:, None], used[:, None]


def _loss(residual: FloatArray, variance: FloatArray, how: Loss) -> tuple[FloatArray, FloatArray]:
    """Return what residuals cost, and their weights."""
    square = residual**2 / variance
    if how.cauchy <= 0.0:
        return square, 1.0 / variance
    scale = how.cauchy**2
    return scale * np.log(1.0 + square / scale), 1.0 / (variance * (1.0 + square / scale))


def _plain_fit_poses(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Do as `fit_poses` for one start of each scan."""
    poses, damping, own = poses.copy(), np.full(len(poses), 10.0 * DAMPING), np.arange(3)
    found = plain_equations(scans, corners, poses, how)
    blocks, slopes, costs = found.pose, found.pose_slope, found.costs
    going = np.ones(len(poses), dtype=bool)
    for _ in range(steps):
        matrix = blocks.copy()
        matrix[:, own, own] += damping[:, None] * blocks[:, own, own] + LEAST
        trial = poses + np.linalg.solve(matrix, slopes[..., None])[..., 0]
        new = plain_equations(scans, corners, trial, how)
        better = going & (new.costs < costs)
        done = better & (costs - new.costs < _SETTLED * costs)
        poses[better], blocks[better], slopes[better] = (
            trial[better],
            new.pose[better],
            new.pose_slope[better],
        )
        costs = np.where(better, new.costs, costs)
        damping = np.where(better, np.maximum(damping / EASED, LEAST), damping * EASED)
        going &= ~done & (damping < HOPELESS)
        if not going.any():
            break
    return poses, costs


def _plain_walk(
    scans: RigidScans,
    corners: FloatArray,
    poses: FloatArray,
    costs: FloatArray,
    follow: FloatArray,
    tries: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Do as `walk`."""
    moves, above, pose_steps, pose_above = tries
    walked, how = np.empty(moves.shape), loss(scans)
    for i, move in enumerate(moves):
        trial = poses - follow @ move.ravel()
        new = plain_equations(scans, corners + move, trial, how).costs
        if new.sum() < costs.sum() + above[i]:
            corners, poses, costs = corners + move, trial, new
        for step, most in zip(pose_steps[i], pose_above[i], strict=True):
            new = plain_equations(scans, corners, poses + step, how).costs
            taken = new < costs + most
            poses, costs = np.where(taken[:, None], poses + step, poses), np.where(taken, new, costs)
        walked[i] = corners
    return walked, poses, costs


def _plain_descend(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, how: Loss, steps: int, prior: Prior | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Do as `descend`."""

    def costed(c: FloatArray, p: FloatArray) -> tuple[Equations, float]:
        found = plain_equations(scans, c, p, how)
        if prior is None:
            return found, float(found.costs.sum())
        pull, cost = prior.at(c)
        shape, slope = found.shape + prior.information, found.shape_slope + pull
        return replace(found, shape=shape, shape_slope=slope), float(found.costs.sum()) + cost

    (found, cost), damping = costed(corners, poses), DAMPING
    pinned = PINNED if prior is None else 0.0
    for _ in range(steps):
        new, new_cost = None, np.inf
        matrix, slope, inverse = reduced(found, damping, pinned)
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            pass
        else:
            step = np.linalg.solve(matrix, slope)
            turn = np.einsum("tpq,tq->tp", inverse, found.pose_slope - found.mixed @ step)
            trial = corners + step.reshape(-1, 2), poses + turn
            new, new_cost = costed(*trial)
        if new is not None and new_cost < cost:
            done = cost - new_cost < _SETTLED * max(1.0, 1e-4 * cost)
            (corners, poses), found, cost = trial, new, new_cost
            damping = max(damping / EASED, LEAST)
            if done:
                break
        else:
            damping *= EASED
            if damping >= HOPELESS:
                break
    return corners, poses, found.costs

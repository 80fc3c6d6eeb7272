"""Outlines and poses of several objects in many scans at once: joint least squares with a mild prior on the motion.

The prior is on second differences of the poses, as smooth as the readings ask for, so that a direction which no strip
reads goes on as it went. All scans share the outlines; the poses of neighbouring scans hang together by the prior,
so that their equations are banded, and eliminating them costs in proportion to the number of scans.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import Loss
from tacstrip.core.hull import HullScans, hull_equations
from tacstrip.core.rigid import DAMPING, EASED, HOPELESS, LEAST, PINNED, Equations, loss
from tacstrip.tracking.rigid.covariance import UPRIGHT, rigid_motions

_DONE = 0.02  # gain in chi square that ends a descent
_AT_ONCE = 64  # scans whose covariances are found together
_SIGNS = np.array([1.0, -2.0, 1.0])  # of a second difference


@dataclass(frozen=True, eq=False)
class Scene:
    """K objects in T scans.

    Attributes
    ----------
    outlines
        Corners (N_k, 2) [mm] in a frame of their own.
    poses
        x, y [mm] and angle (T, K, 3), angles without jumps; finite where an object is absent too.
    present
        Whether each is there (T, K).
    motion
        Standard deviations of the poses' second differences (K, 3) [mm, mm, rad].
    costs
        Squared residuals over sigma^2 of every scan (T,).
    prior
        What the motion costs.
    """

    outlines: tuple[FloatArray, ...]
    poses: FloatArray
    present: BoolArray
    motion: FloatArray
    costs: FloatArray
    prior: float = 0.0

    @property
    def cost(self) -> float:
        """Of readings and motion."""
        return float(self.costs.sum()) + self.prior

    @property
    def bends(self) -> BoolArray:
        """Whether the prior holds an object's three poses from each scan on (T - 2, K)."""
        return np.asarray(self.present[:-2] & self.present[1:-1] & self.present[2:])


def fitted(
    scans: HullScans,
    scene: Scene,
    rows: BoolArray,
    steps: int = 25,
    tolerance_mm: float = 0.0,
    cauchy: float = 0.0,
    shapes: bool = True,
) -> Scene:
    """Return the scene where a descent of all poses, and of the outlines, ends.

    `rows` (T,) says which rows follow the one before in time; the prior does not bridge others.
    """
    how, damping = loss(scans.scans, tolerance_mm, cauchy), DAMPING
    found, bends = _equations(scans, scene, how), scene.bends & rows[1:-1, None] & rows[2:, None]
    prior = _bent(scene, bends)
    scene = replace(scene, costs=found.costs, prior=prior[0])
    for _ in range(steps):
        step, new = _step(found, scene, bends, prior[1], damping, shapes), None
        if step is not None:
            trial = replace(scene, poses=scene.poses + step[0], outlines=_moved(scene.outlines, step[1]))
            new, new_prior = _equations(scans, trial, how), _bent(trial, bends)
            trial = replace(trial, costs=new.costs, prior=new_prior[0])
        if new is not None and trial.cost < scene.cost:
            done = scene.cost - trial.cost < _DONE * max(1.0, 1e-4 * scene.cost)
            scene, found, prior, damping = trial, new, new_prior, max(damping / EASED, LEAST)
            if done:
                break
        else:
            damping *= EASED
            if damping > HOPELESS:
                break
    return scene


def pose_covariances(
    scans: HullScans, scene: Scene, rows: BoolArray, anchors: Sequence[int], shown: IntArray
) -> FloatArray:
    """Return the covariances of the poses (T, K, 3, 3) of some scans (numbers), NaN elsewhere and where absent.

    Parameters
    ----------
    scans, scene, rows
        As for `fitted`.
    anchors
        For each object a scan in which it is alone: its pose there fixes the frame of the corners, which then is moved
        to where errors of the corners neither move nor turn them as a whole.
    shown
        Numbers of the scans wanted.
    """
    from scipy.linalg import cho_solve_banded  # late, as the splines of rigid objects

    factor, by_corner, value, vector = _solved(scans, scene, rows, anchors)
    pinned = vector / value @ vector.T
    many, count, width = len(scene.poses), len(scene.outlines), 3 * len(scene.outlines)
    as_motion = np.zeros((count, 3, pinned.shape[0]))
    first = 0
    for k, outline in enumerate(scene.outlines):
        as_motion[k, :, first : first + outline.size] = np.linalg.pinv(rigid_motions(outline))
        first += outline.size
    cov = np.full((many, count, 3, 3), np.nan)
    for start in range(0, len(shown), _AT_ONCE):
        some = shown[start : start + _AT_ONCE]
        columns = (some[:, None] * width + np.arange(width)).ravel()
        unit = np.zeros((many * width, len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        inverse = cho_solve_banded((factor, True), unit, check_finite=False)
        for j, scan in enumerate(some.tolist()):
            own = inverse[scan * width : (scan + 1) * width, j * width : (j + 1) * width]
            for k in np.flatnonzero(scene.present[scan]).tolist():
                at = slice(3 * k, 3 * k + 3)
                cos, sin = np.cos(scene.poses[scan, k, 2]), np.sin(scene.poses[scan, k, 2])
                turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
                by = turned @ as_motion[k] - by_corner[scan * width + 3 * k : scan * width + 3 * k + 3]
                cov[scan, k] = own[at, at] + by @ pinned @ by.T
    return cov


def outline_covariances(
    scans: HullScans, scene: Scene, rows: BoolArray, anchors: Sequence[int]
) -> list[FloatArray]:
    """Return the covariance of each outline's corners (2 N, 2 N) [mm^2], of the shape alone, by all scans.

    Arguments as of `pose_covariances`.
    """
    _, _, value, vector = _solved(scans, scene, rows, anchors)
    pinned, found, first = vector / value @ vector.T, list[FloatArray](), 0
    for outline in scene.outlines:
        rigid, own = rigid_motions(outline), slice(first, first + outline.size)
        inner = np.eye(outline.size) - rigid @ np.linalg.pinv(rigid)
        found.append(inner @ pinned[own, own] @ inner.T)
        first += outline.size
    return found


def evidence(
    scans: HullScans,
    scene: Scene,
    rows: BoolArray,
    anchors: Sequence[int],
    anywhere_mm: float,
    tolerance_mm: float = 0.0,
) -> float:
    """Return minus twice the logarithm of how likely the readings are with any poses and corners near these.

    Laplace's approximation, but for a constant, of scenes with the same objects in each scan. The least cost tells
    little of scenes with so many poses: a narrow minimum between kinks takes up noise. A corner lies anywhere within
    `anywhere_mm`. Other arguments as of `pose_covariances`; `tolerance_mm` of edges widens minima.
    """
    factor, _, value, _ = _solved(scans, scene, rows, anchors, tolerance_mm)
    bends = scene.bends & rows[1:-1, None] & rows[2:, None]
    motion = (bends.sum(axis=0)[:, None] * np.log(scene.motion)).sum()
    corners = len(value) * np.log(anywhere_mm**2 / (2.0 * np.pi))
    return float(scene.cost + 2.0 * motion + 2.0 * np.log(factor[0]).sum() + np.log(value).sum() + corners)


def _solved(
    scans: HullScans, scene: Scene, rows: BoolArray, anchors: Sequence[int], tolerance_mm: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the factor of the poses' equations, how poses follow corners, and eigenpairs of the corners' matrix."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    found, width = _information(scans, scene, tolerance_mm), 3 * len(scene.outlines)
    band = _banded(found, scene, scene.bends & rows[1:-1, None] & rows[2:, None])
    for k, anchor in enumerate(anchors):
        band[0, anchor * width + 3 * k : anchor * width + 3 * k + 3] += PINNED
    anywhere = max(float(np.ptp(o)) for o in scene.outlines) ** 2  # what the readings do not hold at all
    band[0].reshape(-1, 3)[:] += 1.0 / anywhere, 1.0 / anywhere, 1.0
    factor = cholesky_banded(band, lower=True, check_finite=False)
    mixed = found.mixed.reshape(len(scene.poses) * width, -1)
    by_corner = cho_solve_banded((factor, True), mixed, check_finite=False)
    matrix = found.shape - mixed.T @ by_corner
    value, vector = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return factor, by_corner, np.maximum(value, 1.0 / anywhere), vector


def _information(scans: HullScans, scene: Scene, tolerance_mm: float) -> Equations:
    """Return the equations, scans weighed less in which an upright edge passes a strip: it never holds for long."""
    how = loss(scans.scans, tolerance_mm)
    found = _equations(scans, scene, how)
    steepest = (UPRIGHT / (scans.scans.sensor.length_mm * scans.scans.sigma)) ** 2
    slopes = np.diagonal(found.pose, axis1=1, axis2=2)[:, ::3].max(axis=1)
    if not (slopes > steepest).any():
        return found
    weight, shape = np.minimum(1.0, steepest / np.maximum(slopes, steepest)), np.zeros_like(found.shape)
    for i, by in enumerate(weight):
        one = replace(scene, poses=scene.poses[[i]], present=scene.present[[i]])
        shape += by * _equations(scans.of([i]), one, how).shape
    by = weight[:, None, None]
    return replace(found, pose=by * found.pose, mixed=by * found.mixed, shape=shape)


def expected(scene: Scene, rows: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return where the motion of all others wants each pose (T, K, 3), and its weight, 0 where it says nothing."""
    bends = scene.bends & rows[1:-1, None] & rows[2:, None]
    _, slope = _bent(scene, bends)
    weight = np.zeros(scene.poses.shape)
    for i, sign in enumerate(_SIGNS):
        weight[i : len(weight) - 2 + i] += sign**2 * bends[..., None] / scene.motion**2
    return scene.poses + slope / np.maximum(weight, 1e-300), weight


def _equations(scans: HullScans, scene: Scene, how: Loss) -> Equations:
    return hull_equations(scans, scene.outlines, scene.poses, scene.present, how)


def _bent(scene: Scene, bends: BoolArray) -> tuple[float, FloatArray]:
    """Return what the motion costs, and minus half its slope (T, K, 3)."""
    second = (scene.poses[:-2] - 2.0 * scene.poses[1:-1] + scene.poses[2:]) * bends[..., None] / scene.motion
    slope = np.zeros(scene.poses.shape)
    for i, sign in enumerate(_SIGNS):
        slope[i : len(slope) - 2 + i] -= sign * second / scene.motion
    return float((second**2).sum()), slope


def _banded(found: Equations, scene: Scene, bends: BoolArray) -> FloatArray:
    """Return the equations of all poses (2 W + 1, T W), W = 3 K, each diagonal a row."""
    many, width = len(scene.poses), 3 * len(scene.outlines)
    band = np.zeros((2 * width + 1, many, width))
    for p in range(width):
        for q in range(p + 1):
            band[p - q, :, q] = found.pose[:, p, q]
    weight = (bends[:, :, None] / scene.motion**2).reshape(many - 2, width)
    for i in range(3):
        for j in range(i + 1):
            band[(i - j) * width, j : many - 2 + j] += _SIGNS[i] * _SIGNS[j] * weight
    band[0] += np.repeat(~scene.present, 3, axis=1)
    return band.reshape(2 * width + 1, many * width)


def _step(
    found: Equations, scene: Scene, bends: BoolArray, slope: FloatArray, damping: float, shapes: bool
) -> tuple[FloatArray, FloatArray] | None:
    """Return steps of the poses (T, K, 3) and of the corners (C,); None where the equations are not definite."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    band = _banded(found, scene, bends)
    band[0] += damping * band[0] + LEAST
    by = found.pose_slope.ravel() + slope.ravel()
    mixed = found.mixed.reshape(len(by), -1)
    try:
        factor = cholesky_banded(band, lower=True, check_finite=False)
        if not shapes:
            own = cho_solve_banded((factor, True), by, check_finite=False)
            return own.reshape(scene.poses.shape), np.zeros(mixed.shape[1])
        both = cho_solve_banded((factor, True), np.column_stack([mixed, by]), check_finite=False)
        matrix = found.shape - mixed.T @ both[:, :-1]
        size = np.arange(len(matrix))
        matrix[size, size] += damping * found.shape[size, size] + LEAST
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return None
    corners = np.linalg.solve(matrix, found.shape_slope - mixed.T @ both[:, -1])
    return (both[:, -1] - both[:, :-1] @ corners).reshape(scene.poses.shape), corners


def _moved(outlines: Sequence[FloatArray], step: FloatArray) -> tuple[FloatArray, ...]:
    at = np.cumsum([0] + [o.size for o in outlines])
    return tuple(o + step[a : a + o.size].reshape(-1, 2) for o, a in zip(outlines, at, strict=False))

"""Where descents from many poses end: starts on a grid, and Levenberg-Marquardt of all of them at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.pressed.poses import TOUCH_MM, TURNS, Poses

_BEST = 40  # starts from which a rough descent begins
_FOLLOWED = (10, 5)  # of the ends so far, those from which the next ones begin
_TOUCHES_MM = (0.1, TOUCH_MM)  # what touch is known to in the descents that follow
_FAR_MM = 0.3  # the same, of the first descents of a mesh, whose depth is not told
_ITERATIONS, _ROUGH, _SETTLED, _MOST_DAMPING = 30, 0.01, 1e-3, 1e7
_LONGEST = 0.8  # mm, rad, or a factor's logarithm: a step
STEP = 1e-3  # the same, of differences
_ALIKE, _FAR = 0.02, 25.0  # the same: ends that are one; cost above twice the least of those that are left
_RADII, _APART = 13, 0.25  # of a ridge along the radius' logarithm; how far apart they are
_COUNTS = {"cylinder": 9, "edge": 9, "box": 8, "mesh": 12}  # of turns to begin with
_Residuals: TypeAlias = Callable[[FloatArray], FloatArray]
Ridge: TypeAlias = tuple[FloatArray, FloatArray]  # poses (M, P) with radii in their order, their costs (M,)


def refined(poses: Poses, values: FloatArray, held: str = "") -> tuple[FloatArray, FloatArray]:
    """Return where descents from near parameters (M, P), of which one may be held, end, and their costs (M,)."""
    at = poses.column(held)
    values, _ = descend(partial(poses.residuals, smooth=True), values, _SETTLED, at)
    return descend(poses.residuals, values, _SETTLED, at)


def ridge(poses: Poses, end: FloatArray) -> Ridge:
    """Return the best poses with radii beside an end's (M, P), in their order, and their costs (M,); else none.

    A patch tells its size well and the radius hardly: poses lie along a bent ridge, whose slopes at one place do not
    reach along it.
    """
    if (at := poses.column("log_radius")) is None:
        return np.empty((0, len(end))), np.empty(0)
    values = np.repeat(end[None], _RADII, axis=0)
    values[:, at] += _APART * (np.arange(_RADII) - _RADII // 2)
    return refined(poses, values, "log_radius")


def radii_within(logs: FloatArray, costs: FloatArray, deviations: float) -> tuple[float, float]:
    """Return the least and the greatest logarithm (M,), in order, of costs that are so little above the least."""
    root = np.sqrt(costs - costs.min())  # of a parabola a line on either side
    inside = np.flatnonzero(root <= deviations)
    first, last = inside[0], inside[-1]
    low, high = float(logs[first]), float(logs[last])
    if first > 0:
        low = float(np.interp(deviations, root[[first, first - 1]], logs[[first, first - 1]]))
    if last < len(logs) - 1:
        high = float(np.interp(deviations, root[[last, last + 1]], logs[[last, last + 1]]))
    return low, high


def descents(poses: Poses) -> tuple[FloatArray, FloatArray]:
    """Return where descents end (M, P), best first, and their costs (M,): the sum of squared residuals."""
    by_touch = partial(poses.residuals, touch_mm=_FAR_MM, smooth=True)
    rough = poses.depth_residuals if poses.solid.mesh is None else by_touch
    values, costs = descend(rough, _starts(poses, rough), _ROUGH)
    for touch_mm, count in zip(_TOUCHES_MM, _FOLLOWED, strict=True):
        start = _apart(poses, values, costs, count)
        values, costs = descend(partial(poses.residuals, touch_mm=touch_mm, smooth=True), start, _SETTLED)
    values, costs = descend(poses.residuals, values, _SETTLED)
    order = np.argsort(costs)
    return values[order], costs[order]


def _apart(poses: Poses, values: FloatArray, costs: FloatArray, count: int) -> FloatArray:
    """Return the best ends that are unlike, half of so many, and of those that cost little more the furthest apart."""
    near = costs <= _FAR + 2.0 * costs.min()
    values = values[near][np.argsort(costs[near])]
    places = values
    if (at := poses.column("turn_rad")) is not None:  # which is alike after a turn
        per = TURNS[poses.solid.kind] / (2.0 * math.pi)
        round_ = per * np.stack([np.cos(values[:, at] / per), np.sin(values[:, at] / per)], axis=1)
        places = np.concatenate([np.delete(values, at, axis=1), round_], axis=1)
    kept, off = [0], np.abs(places - places[0]).max(axis=1)
    while len(kept) < count and off.max() > _ALIKE:
        kept.append(int((off > _ALIKE if len(kept) < count // 2 else off).argmax()))
        off = np.minimum(off, np.abs(places - places[kept[-1]]).max(axis=1))
    return values[kept]


def jacobian(residuals: _Residuals, values: FloatArray, left: FloatArray) -> FloatArray:
    """Return the slopes (M, R, P) of residuals (M, R) at parameters (M, P), by differences to one side."""
    count = values.shape[1]
    moved = (values[:, None] + STEP * np.eye(count)).reshape(-1, count)
    found = residuals(moved).reshape(len(values), count, -1)
    return np.swapaxes((found - left[:, None]) / STEP, 1, 2)


def descend(
    residuals: _Residuals, values: FloatArray, settled: float, held: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return where descents from parameters (M, P), of which one may be held, end, and their costs (M,)."""
    values, count = values.copy(), values.shape[1]
    left = residuals(values)
    costs, damping = np.square(left).sum(axis=1), np.full(len(values), 1e-2)
    slopes, gained = np.empty((*left.shape, count)), np.full(len(values), math.inf)
    going, fresh = np.ones(len(values), dtype=bool), np.ones(len(values), dtype=bool)
    for _ in range(_ITERATIONS):
        if not going.any():
            break
        if (new := going & fresh).any():
            slopes[new] = jacobian(residuals, values[new], left[new])
            if held is not None:
                slopes[new, :, held] = 0.0
        (at,) = np.nonzero(going)
        normal = np.einsum("mrp,mrq->mpq", slopes[at], slopes[at])
        diagonal = np.einsum("mpp->mp", normal)
        damped = normal + (damping[at, None] * diagonal + 1e-9)[..., None] * np.eye(count)
        step = np.linalg.solve(damped, np.einsum("mrp,mr->mp", slopes[at], left[at])[..., None])[..., 0]
        trial = values[at] - np.clip(step, -_LONGEST, _LONGEST)
        its = residuals(trial)
        cost = np.square(its).sum(axis=1)
        better = cost < costs[at]
        won = at[better]
        gained[won] = costs[won] - cost[better]
        values[won], left[won], costs[won] = trial[better], its[better], cost[better]
        damping[at] *= np.where(better, 0.2, 6.0)
        fresh[:] = False
        fresh[won] = True
        going[won] = gained[won] >= settled * np.maximum(1.0, costs[won])
        going &= damping < _MOST_DAMPING
    return values, costs


def _starts(poses: Poses, residuals: _Residuals) -> FloatArray:
    """Return the best of many poses to begin with, of which no two differ in their depth and radius alone."""
    pitch, thick, kind = poses.sensor.pitch_mm, poses.skin.thickness_mm, poses.solid.kind
    count, aside = _COUNTS.get(kind, 1), 0.5 * pitch * np.array([0.0, -1.0, 1.0])
    grids: dict[str, Any] = {
        "across_mm": aside, "along_mm": aside, "turn_rad": np.arange(count) * TURNS.get(kind, 0.0) / count,
        "depth_mm": np.array([0.1, 0.3, 0.6]) * thick, "log_radius": np.array([-0.7, 0.0, 0.7]),
    }  # fmt: skip
    if (poses.column("log_radius")) is not None:
        grids["log_radius"] = grids["log_radius"] + math.log(poses.solid.size[0])
    order = [name for name in grids if name in poses.names]
    grid = np.stack(np.meshgrid(*(grids[name] for name in order), indexing="ij"), axis=-1)
    starts = grid.reshape(-1, len(order))[:, [order.index(name) for name in poses.names]]
    costs = np.square(residuals(starts)).sum(axis=1)
    sizes = math.prod(len(grids[name]) for name in ("depth_mm", "log_radius") if name in poses.names)
    each = costs.reshape(-1, sizes)
    best = np.argsort(each.min(axis=1))[:_BEST]
    return np.asarray(starts[best * sizes + each[best].argmin(axis=1)])

"""The scans that are fitted together, and what is known of the objects in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.hull import HullScans
from tacstrip.core.rigid import RigidScans
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.shared_strips.known import Alone

_STEADY, _TURNS = 0.003, 0.008  # least deviation of second differences: of the size, and [rad]


@dataclass(eq=False)
class Rows:
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
        """Longer sides of the outlines (K,) [mm]."""
        return np.array([float(np.ptp(o, axis=0).max()) for o in self.outlines])

    @property
    def anchors(self) -> list[int]:
        """For each object a row in which it is alone."""
        return [int(np.flatnonzero(alone)[0]) if alone.any() else 0 for alone in self.alone.T]

    def of(self, chosen: IntArray) -> Rows:
        """Return some of the rows."""
        return replace(
            self,
            numbers=self.numbers[chosen],
            hull=self.hull.of(chosen),
            poses=self.poses[chosen],
            alone=self.alone[chosen],
        )


def rows_of(
    known: Sequence[Alone],
    readings: Mapping[int, FloatArray],
    touched: BoolArray,
    sensor: Sensor,
    names: tuple[str, ...],
    sigma: float,
) -> Rows:
    """Return all scans that show known objects, or whose readings (S, n) are in question."""
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
    dead |= left_out_wholly(sensor)
    quiet = np.where(~mine & (touched[numbers] | dead), 0.0, 1.0)
    motion = np.stack([_jerk(one) for one in known])
    return Rows(
        numbers, HullScans(RigidScans(sensor, names, k, sigma), quiet), poses, tuple(one.corners for one in known),
        motion, np.isfinite(poses[..., 0]), tuple(one.rivals for one in known), tuple(one.scans for one in known),
    )  # fmt: skip


def _jerk(one: Alone) -> FloatArray:
    """Return how large second differences of its poses are (3,)."""
    size = float(np.ptp(one.corners, axis=0).max())
    return np.array([_STEADY * size, _STEADY * size, _TURNS])


def fitted_about(rows: Rows, window: IntArray, part: BoolArray, most: int) -> IntArray:
    """Return the rows of a fit: a window, what is next to it, and of each object that takes part enough alone."""
    take = np.zeros(len(rows.numbers), dtype=bool)
    take[window] = True
    for k in np.flatnonzero(part):
        mine = np.flatnonzero(rows.alone[:, k])
        near = np.abs(mine[:, None] - window[None]).min(axis=1)
        take[mine[np.argsort(near, kind="stable")[:most]]] = True
        take[mine[np.unique(np.linspace(0, len(mine) - 1, min(most, len(mine))).astype(int))]] = True
    return np.flatnonzero(take)


def with_poses(rows: Rows, window: IntArray, poses: FloatArray) -> Rows:
    """Return rows with poses (W, K, 3) in a window, angles without jumps."""
    every = rows.poses.copy()
    every[window] = poses
    for k in range(every.shape[1]):
        on = np.flatnonzero(np.isfinite(every[:, k, 2]))
        every[on, k, 2] = np.unwrap(every[on, k, 2])
    return replace(rows, poses=every)


def unexplained(rows: Rows, known: Sequence[Alone], readings: Mapping[int, FloatArray]) -> IntArray:
    """Return the rows in which something is touched that no object alone accounts for."""
    left = np.asarray(np.isfinite(rows.hull.scans.k).any(axis=1))
    row_of = {int(n): i for i, n in enumerate(rows.numbers)}
    for one in known:
        for number, own in zip(one.scans, one.readings, strict=True):
            left[row_of[number]] &= ~np.isfinite(own).any(axis=0)
    return np.flatnonzero(left.any(axis=1))

"""How exactly scans tell a rigid outline, at the truth: by their readings alone, and by which strips they touch, too.

The bound of Cramer and Rao takes the readings. A strip that is touched, and its neighbour that is not, tell besides
that the outline ends between them: no information in Fisher's sense, but of fifty scans often more than all readings.
With both, the corners' distribution is a normal one within linear bounds; draws from it are made by Pakman and
Paninski's exact Hamiltonian walk (J. Comput. Graph. Stat. 23, 2014). Over many scenes no estimator has a smaller mean
squared error than its variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from studies.holdout.readings import Unit
from studies.holdout.shapes import Array

_STEP = 1e-4  # of differences [mm, rad]
_BOUNCES = 2000  # of one draw, at most
_NEAR = 0.3  # of the outline's width: corners farther inside are no candidates for its end
_NEVER = 1e-9  # information that counts as none


@dataclass(frozen=True, eq=False)
class Told:
    """What scans tell, linear about the truth.

    Attributes
    ----------
    unit, outline, poses
        What touches what: corners (N, 2) [mm] and poses (T, 3).
    shown
        Readings that there are (T, M).
    sigma, offset
        Of errors of readings, and of channels' offsets, over Vref; no offsets: 0.
    basis
        Numbers of the way that poses are linear in (T, K); the identity where they are free.
    """

    unit: Unit
    outline: Array
    poses: Array
    shown: Array
    sigma: float
    offset: float
    basis: Array

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Return those of readings by corners, then offsets (T M, P), and by numbers of the way (T M, 3 K)."""

        def slope(by_corners: Array, by_pose: Array) -> Array:
            up, down = (
                self._readings(self.outline + s * by_corners, self.poses + s * by_pose)
                for s in (_STEP, -_STEP)
            )
            return np.where(self.shown, np.nan_to_num((up - down) / (2.0 * _STEP)), 0.0)

        none = np.zeros_like(self.outline)
        corners = [slope(axis.reshape(-1, 2), np.zeros(3)) for axis in np.eye(self.outline.size)]
        if self.offset:
            corners += [self.shown * axis for axis in np.eye(self.shown.shape[1])]
        poses = np.stack([slope(none, axis) for axis in np.eye(3)], axis=2)  # (T, M, 3)
        ways = np.einsum("tmp,tk->tmpk", poses, self.basis)
        return np.stack(corners, axis=2).reshape(self.shown.size, -1), ways.reshape(self.shown.size, -1)

    def _readings(self, corners: Array, poses: Array) -> Array:
        return np.stack([self.unit.read(*self.unit.touched([at(corners, p)])).ravel() for p in poses])

    def cramer_rao(self) -> Array:
        """Return the bound of the corners' covariance (2 N, 2 N) [mm^2], of their shape alone."""
        corners, ways = self.slopes
        own, mixed, size = ways.T @ ways + 1e-12 * np.eye(ways.shape[1]), ways.T @ corners, self.outline.size
        whole = corners.T @ corners - mixed.T @ np.linalg.solve(own, mixed)
        if self.offset:
            offsets = whole[size:, size:] + (self.sigma / self.offset) ** 2 * np.eye(len(whole) - size)
            whole = whole[:size, :size] - whole[:size, size:] @ np.linalg.solve(offsets, whole[size:, :size])
        value, vector = np.linalg.eigh(whole)
        value, vector = value[3:], vector[:, 3:]  # moved and turned as a whole it is the same shape
        return np.asarray(self.sigma**2 * (vector / np.maximum(value, _NEVER)) @ vector.T)

    def draws(self, random: np.random.Generator, count: int) -> Array:
        """Return how far off the corners' shape may be (count, N, 2) [mm], by readings and touched strips together."""
        corners, ways = self.slopes
        rows, size = np.hstack([corners, ways]) / self.sigma, self.outline.size
        known = rows.T @ rows
        # What nothing tells is off by the outline's size, or a half turn, at most.
        size_mm = float(np.ptp(self.outline, axis=0).max())
        own = np.full(len(known), size_mm**-2)
        own[size : corners.shape[1]] = self.offset**-2 if self.offset else 0.0
        own[corners.shape[1] :] = np.repeat([size_mm**-2, size_mm**-2, math.pi**-2], self.basis.shape[1])
        value, vector = np.linalg.eigh(known + np.diag(own))
        whitened = vector / np.sqrt(value)
        off, room = self._ends(corners.shape[1])
        found = _truncated(off @ whitened, room, random, count) @ whitened.T
        x, y = (self.outline - self.outline.mean(axis=0)).T
        motions = np.zeros((size, 3))
        motions[::2, 0], motions[1::2, 1], motions[::2, 2], motions[1::2, 2] = 1.0, 1.0, -y, x
        shape = np.eye(size) - motions @ np.linalg.pinv(motions)
        return np.asarray(found[:, :size] @ shape).reshape(count, -1, 2)

    def _ends(self, corners: int) -> tuple[Array, Array]:
        """Return linear bounds, rows (C, P) and room (C,): rows of unknowns times these are at most the room."""
        rows, room, unknowns = list[Array](), list[float](), corners + 3 * self.basis.shape[1]
        there = np.asarray(self.shown.reshape(len(self.poses), len(self.unit.names), -1).any(axis=1))
        for scan, (pose, touched) in enumerate(zip(self.poses, there, strict=True)):
            if not touched.any():
                continue
            placed = at(self.outline, pose)
            cos, sin = math.cos(pose[2]), math.sin(pose[2])
            first, last = np.flatnonzero(touched)[[0, -1]]
            for sign, inner, outer in ((-1.0, first, first - 1), (1.0, last, last + 1)):
                reach = sign * placed[:, 0]
                for corner in range(len(placed)):
                    row = np.zeros(unknowns)
                    row[2 * corner : 2 * corner + 2] = cos, -sin
                    turned = -(placed[corner, 1] - pose[1])  # x by the angle
                    row[corners:] = np.concatenate(
                        [self.basis[scan], np.zeros(self.basis.shape[1]), turned * self.basis[scan]]
                    )
                    free = sign * (0.5 + outer) * self.unit.pitch - float(reach[corner])
                    if 0 <= outer < self.unit.strips and free < _NEAR * np.ptp(reach):
                        rows.append(sign * row)
                        room.append(free)
                    if corner == reach.argmax():
                        rows.append(-sign * row)
                        room.append(float(reach[corner]) - sign * (0.5 + inner) * self.unit.pitch)
        return np.array(rows), np.maximum(room, 1e-6)


def _truncated(rows: Array, room: Array, random: np.random.Generator, count: int) -> Array:
    """Return draws (count, P) of independent standard normal numbers z with rows z <= room, begun at z = 0."""
    square, found, here = (rows**2).sum(axis=1), np.empty((count, rows.shape[1])), np.zeros(rows.shape[1])
    for draw in range(-count // 4, count):
        speed, left = random.normal(size=len(here)), 0.5 * math.pi
        for _ in range(_BOUNCES):
            a, b = rows @ speed, rows @ here  # a wall is met where a sin t + b cos t = room
            reach = np.hypot(a, b)
            turn = np.arccos(np.clip(room / np.maximum(reach, 1e-300), -1.0, 1.0))
            meets = (np.arctan2(a, b) - turn) % (2.0 * math.pi)
            meets = np.where(reach > room, meets, np.inf)
            wall = int(meets.argmin())
            t = min(float(meets[wall]), left)
            here, speed = math.sin(t) * speed + math.cos(t) * here, math.cos(t) * speed - math.sin(t) * here
            left -= t
            if left <= 0.0:
                break
            speed = speed - 2.0 * float(rows[wall] @ speed) / square[wall] * rows[wall]
        if draw >= 0:
            found[draw] = here
    return found


def at(outline: Array, pose: Array) -> Array:
    """Return an outline (N, 2) [mm] where a pose (3,) puts it."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(outline @ np.array([[c, s], [-s, c]]) + pose[:2])

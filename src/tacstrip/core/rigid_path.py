"""A rigid outline, a linear function of few numbers, on a path that is a spline of few knots: descents of both."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import RIGID_CORNERS, SIZE, Loss, OutlineBy, Sendable, at, exported
from tacstrip.core.rigid import Equations, RigidScans, equations

ALWAYS = 1e-6  # added to the equations' diagonal
FIRST_DAMPING, TIMES, LEAST_DAMPING, TRIES = 1e-2, 8.0, 1e-7, 6


@dataclass(frozen=True, eq=False)
class OutlineNumbers(Sendable):
    """Numbers (P,) that an outline of N corners is a linear function of: each entry of a corner is one, times a weight.

    Attributes
    ----------
    which, weight
        Of each entry (2 N,): x and y of the first corner, then of the next.
    prior
        Numbers v cost v' prior v (P, P).
    """

    which: IntArray
    weight: FloatArray
    prior: FloatArray

    @cached_property
    def compiled(self) -> OutlineBy:
        """What the compiled core takes; the arrays are its own."""
        which = np.ascontiguousarray(self.which, dtype=np.int64)
        weight, prior = (np.ascontiguousarray(a, dtype=float) for a in (self.weight, self.prior))
        made = OutlineBy(len(which) // 2, len(prior), at(which), at(weight), at(prior))
        made.arrays = (which, weight, prior)
        return made

    def corners(self, outline: FloatArray) -> FloatArray:
        """Return the corners (N, 2) [mm] of numbers (P,)."""
        return np.asarray((self.weight * outline[self.which]).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class OnPath:
    """An outline on a path.

    Attributes
    ----------
    outline
        Its numbers (P,).
    knots
        Poses (K, 3) at the path's knots.
    cost
        Of readings and prior.
    costs
        Of the scans (T,).
    """

    outline: FloatArray
    knots: FloatArray
    cost: float = np.inf
    costs: FloatArray = field(default_factory=lambda: np.empty(0))


def descend_path(
    scans: RigidScans,
    by: OutlineNumbers,
    start: OnPath,
    basis: FloatArray,
    how: Loss,
    steps: int,
    enough: float,
    least: float = -1.0,
) -> OnPath:
    """Return where a descent of outline and knots ends: after a step that gains less than its share of the cost.

    Parameters
    ----------
    scans, by, start, how, steps, enough
        What is fitted, from where and for how long.
    basis
        Of the spline, scans by knots (T, K). With as many knots as scans, each scan has one of its own.
    least
        No number of the outline gets below this share of their mean; negative: it may.
    """
    core, (many, knots), few = exported("rigid_path"), basis.shape, len(by.prior)
    size = len(by.which)
    free = many == knots
    if core is None or size > 2 * RIGID_CORNERS or (free and few > SIZE):
        return _plain_descend_path(scans, by, start, basis, how, steps, enough, least)
    outline, at_knots, costs = np.array(start.outline), np.array(start.knots), np.empty(many)
    both = 3 * knots + few
    place = many * (28 + 6 * size + 3 * few) + 2 * size**2 + 3 * size + few**2 + few + 2 * both
    workspace = np.empty(place + (0 if free else 2 * both**2 + both))
    basis = np.ascontiguousarray(basis)
    cost = core(
        scans.compiled, how, by.compiled, at(outline), None if free else at(basis), knots, at(at_knots), steps, enough,
        least, at(costs), at(workspace),
    )  # fmt: skip
    return OnPath(outline, at_knots, cost, costs)


def _plain_descend_path(
    scans: RigidScans,
    by: OutlineNumbers,
    now: OnPath,
    basis: FloatArray,
    how: Loss,
    steps: int,
    enough: float,
    least: float,
) -> OnPath:
    """Do as `descend_path`."""
    many, knots = basis.shape
    pairs = (basis[:, :, None] * basis[:, None, :]).reshape(many, -1)
    (found, now), damping = _at(scans, by, now, basis, how), FIRST_DAMPING
    for _ in range(steps):
        matrix, slope = (
            (np.empty((0, 0)), np.empty(0)) if many == knots else _joint(found, by, now, basis, pairs)
        )
        for _ in range(TRIES):
            if many == knots:
                step = _free_step(found, by, now, damping)
            else:
                damped = matrix + np.diag(damping * matrix.diagonal() + ALWAYS)
                step = np.asarray(np.linalg.solve(damped, slope), dtype=np.float64)
            trial = OnPath(now.outline + step[3 * knots :], now.knots + step[: 3 * knots].reshape(-1, 3))
            if least < 0.0 or trial.outline.min() > least * trial.outline.mean():
                new, trial = _at(scans, by, trial, basis, how)
                if trial.cost < now.cost:
                    break
            damping *= TIMES
        else:
            break
        gain, damping = now.cost - trial.cost, max(damping / TIMES, LEAST_DAMPING)
        found, now = new, trial
        if gain < enough * now.cost:
            break
    return now


def _at(
    scans: RigidScans, by: OutlineNumbers, now: OnPath, basis: FloatArray, how: Loss
) -> tuple[Equations, OnPath]:
    """Return the equations of the outline's numbers instead of its corners, and this with its cost."""
    found = equations(scans, by.corners(now.outline), basis @ now.knots, how)
    cost = float(found.costs.sum() + now.outline @ by.prior @ now.outline)
    linear = np.zeros((len(by.which), len(by.prior)))
    linear[np.arange(len(by.which)), by.which] = by.weight
    reduced = replace(
        found,
        mixed=found.mixed @ linear,
        shape=linear.T @ found.shape @ linear + by.prior,
        shape_slope=linear.T @ found.shape_slope - by.prior @ now.outline,
    )
    return reduced, replace(now, cost=cost, costs=found.costs)


def _free_step(found: Equations, by: OutlineNumbers, now: OnPath, damping: float) -> FloatArray:
    """Return a step of knots, one per scan and free of each other (Schur's complement), then of the outline."""
    own, three = found.pose.copy(), np.arange(3)
    own[:, three, three] += damping * own[:, three, three] + ALWAYS
    outline = found.shape + np.diag(damping * found.shape.diagonal() + ALWAYS)
    inverse = np.linalg.inv(own)
    weighted = inverse @ found.mixed
    slope = found.shape_slope - np.einsum("tip,ti->p", weighted, found.pose_slope)
    step = np.linalg.solve(outline - np.einsum("tip,tiq->pq", found.mixed, weighted, optimize=True), slope)
    poses = np.einsum("tij,tj->ti", inverse, found.pose_slope - found.mixed @ step)
    return np.concatenate([poses.ravel(), step])


def _joint(
    found: Equations, by: OutlineNumbers, now: OnPath, basis: FloatArray, pairs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the equations of a path's knots, then its outline."""
    many, knots = basis.shape
    own = (pairs.T @ found.pose.reshape(many, 9)).reshape(knots, knots, 3, 3).transpose(0, 2, 1, 3)
    mixed = (basis.T @ found.mixed.reshape(many, -1)).reshape(3 * knots, -1)
    matrix = np.block([[own.reshape(3 * knots, 3 * knots), mixed], [mixed.T, found.shape]])
    return matrix, np.concatenate([(basis.T @ found.pose_slope).ravel(), found.shape_slope])

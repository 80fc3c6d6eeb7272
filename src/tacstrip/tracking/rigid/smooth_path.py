"""A rough shape that moves smoothly, from the readings alone: what a search for corners and poses begins with.

The outline is star-shaped, 24 radii with a prior against roughness; its poses are a spline over the scans. Descents
begin at a circle on the way of the contact's centre, with every total turn, and a tolerance of edges that gets finer,
so that a start which is wrong by half the object still ends at the right shape.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import Loss
from tacstrip.core.rigid import Equations, RigidScans, equations, loss
from tacstrip.reconstruction.contact_ends import closed_ends

RADII = 24
_ANGLES = 2.0 * np.pi * np.arange(RADII) / RADII
_SPOKES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
_BY_RADIUS = np.zeros((2 * RADII, RADII))
_BY_RADIUS[2 * np.arange(RADII), np.arange(RADII)] = _SPOKES[:, 0]
_BY_RADIUS[2 * np.arange(RADII) + 1, np.arange(RADII)] = _SPOKES[:, 1]
_BEND = np.roll(np.eye(RADII), 1, 1) + np.roll(np.eye(RADII), -1, 1) - 2.0 * np.eye(RADII)
_CENTRED = 0.014  # of the radius: how near to the frame's origin the outline's middle is held
_LOOSE = 4.0  # radii: a prior for each radius by itself, so that all are determined
_LEAST = 1e-6  # added to the equations' diagonal
_ROUND = 0.785  # width of a disc's mean section over its diameter


@dataclass(frozen=True, eq=False)
class Path:
    """A rough outline and where it lies.

    Attributes
    ----------
    radii
        Of the outline at `RADII` angles [mm].
    knots
        Poses (K, 3) at the spline's knots.
    basis
        Of the spline, scans by knots (T, K).
    cost
        What readings and priors cost.
    """

    radii: FloatArray
    knots: FloatArray
    basis: FloatArray
    cost: float

    @property
    def corners(self) -> FloatArray:
        """The outline (RADII, 2) [mm]."""
        return np.asarray(self.radii[:, None] * _SPOKES)

    @property
    def poses(self) -> FloatArray:
        """Poses (T, 3)."""
        return self.basis @ self.knots

    def refined(self, basis: FloatArray) -> Path:
        """Return the same path on more knots."""
        knots = np.linalg.lstsq(basis, self.basis, rcond=None)[0] @ self.knots
        return replace(self, basis=basis, knots=knots, cost=np.inf)


def spline_basis(at: FloatArray, knots: int) -> FloatArray:
    """Return what each of some knots, evenly from 0 to 1, adds at places (T,): (T, knots)."""
    places = np.linspace(0.0, 1.0, knots)
    if knots < 4:
        return np.asarray(np.vander(at, knots) @ np.linalg.inv(np.vander(places, knots)))
    ends = "not-a-knot" if knots == 4 else "natural"
    return np.asarray(CubicSpline(places, np.eye(knots), bc_type=ends)(at))


def centres(scans: RigidScans) -> tuple[FloatArray, FloatArray]:
    """Return roughly where the contact's middle is in each scan (T, 2) [mm], and its area (T,) [mm^2]."""
    pitch, length = scans.sensor.pitch_mm, scans.sensor.length_mm
    touched = np.isfinite(scans.k).any(axis=1)
    if len(scans.names) == 2:
        with np.errstate(invalid="ignore", divide="ignore"):
            l, u = closed_ends(scans.sensor, scans.k[:, 0], scans.k[:, 1])
        width = np.where(touched, np.maximum(np.nan_to_num(u - l), 1e-3 * length), 0.0)
        middle = np.nan_to_num(0.5 * (l + u))
    else:
        across = touched.sum(axis=1, keepdims=True) * pitch
        width = np.where(touched, _ROUND * across, 0.0)
        middle = np.nan_to_num(scans.k[:, 0]) * (length - 0.5 * width)
        if scans.shares[0] == 0.0:
            middle = middle + 0.5 * width
    weight = np.maximum(width.sum(axis=1), 1e-12)
    found = (
        np.stack([(width * scans.x_mm).sum(axis=1), (width * middle).sum(axis=1)], axis=1) / weight[:, None]
    )
    return found, weight * pitch


def circle(scans: RigidScans, basis: FloatArray, turn: float, size: float = 1.0) -> Path:
    """Return a circle on the way of the contact's centre, which turns by so much [rad]."""
    middle, area = centres(scans)
    radius = size * float(np.sqrt(np.median(area) / np.pi))
    knots = np.empty((basis.shape[1], 3))
    knots[:, :2] = np.linalg.lstsq(basis, middle, rcond=None)[0]
    knots[:, 2] = turn * (np.linspace(0.0, 1.0, len(knots)) - 0.5)
    return Path(np.full(RADII, radius), knots, basis, np.inf)


def fit_path(
    scans: RigidScans, start: Path, steps: int, *, tolerance: float, cauchy: float, rough: float, end: float
) -> Path:
    """Return where a descent from a path ends.

    Parameters
    ----------
    scans, start
        What is fitted, from where.
    steps
        At most.
    tolerance, rough
        Of edges, across them, and standard deviation of the radii's second differences, over the mean radius.
    cauchy, end
        See `tacstrip.core.rigid.loss`.
    """
    radius = float(start.radii.mean())
    how = loss(scans, tolerance * radius, cauchy, end)
    middle = _SPOKES.T / RADII
    prior = _BEND.T @ _BEND / rough**2 + middle.T @ middle / _CENTRED**2 + np.eye(RADII) / _LOOSE**2
    begin = _State(start.radii, start.knots, _BY_RADIUS, start.basis, prior / radius**2)
    found = begin.descended(scans, how, steps, 1e-3, least=0.02)
    return replace(start, radii=found.outline, knots=found.knots, cost=found.cost)


def fit_corners(
    scans: RigidScans, corners: FloatArray, knots: FloatArray, basis: FloatArray, how: Loss, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners (N, 2) and knots (K, 3) after a descent of both, and the scans' costs (T,)."""
    begin = _State(corners.ravel(), knots, np.eye(corners.size), basis, np.zeros((corners.size,) * 2))
    found = begin.descended(scans, how, steps, 1e-5)
    return found.outline.reshape(-1, 2), found.knots, found.costs


@dataclass(frozen=True, eq=False)
class _State:
    """An outline by numbers of which its corners are a linear function, and a path by its knots."""

    outline: FloatArray  # (P,)
    knots: FloatArray
    by: FloatArray  # (2 N, P)
    basis: FloatArray
    prior: FloatArray  # (P, P)
    cost: float = np.inf
    costs: FloatArray = field(default_factory=lambda: np.empty(0))

    def at(self, scans: RigidScans, how: Loss) -> tuple[Equations, _State]:
        """Return the equations here, and this with its cost."""
        found = equations(scans, (self.by @ self.outline).reshape(-1, 2), self.basis @ self.knots, how)
        cost = float(found.costs.sum() + self.outline @ self.prior @ self.outline)
        return found, replace(self, cost=cost, costs=found.costs)

    def descended(
        self, scans: RigidScans, how: Loss, steps: int, enough: float, least: float = -np.inf
    ) -> _State:
        """Return where a descent ends; no number of the outline gets below `least` times their mean."""
        many, knots = self.basis.shape
        pairs = (self.basis[:, :, None] * self.basis[:, None, :]).reshape(many, -1)
        (found, now), damping = self.at(scans, how), 1e-2
        for _ in range(steps):
            matrix, slope = (np.empty((0, 0)), np.empty(0)) if many == knots else _joint(found, now, pairs)
            size = matrix.diagonal().copy()
            for _ in range(6):
                if many == knots:
                    step = _free_step(found, now, damping)
                else:
                    damped = matrix + np.diag(damping * size + _LEAST)
                    step = np.asarray(np.linalg.solve(damped, slope), dtype=np.float64)
                trial = replace(
                    now,
                    outline=now.outline + step[3 * knots :],
                    knots=now.knots + step[: 3 * knots].reshape(-1, 3),
                )
                if least == -np.inf or trial.outline.min() > least * now.outline.mean():
                    new, trial = trial.at(scans, how)
                    if trial.cost < now.cost:
                        break
                damping *= 8.0
            else:
                break
            gain, damping = now.cost - trial.cost, max(damping / 8.0, 1e-7)
            found, now = new, trial
            if gain < enough * now.cost:
                break
        return now


def _free_step(found: Equations, now: _State, damping: float) -> FloatArray:
    """Return a step of knots, one per scan and free of each other (Schur's complement), then of the outline."""
    own, three = found.pose.copy(), np.arange(3)
    own[:, three, three] += damping * own[:, three, three] + _LEAST
    mixed, outline = found.mixed @ now.by, now.by.T @ found.shape @ now.by + now.prior
    outline += np.diag(damping * outline.diagonal() + _LEAST)
    inverse = np.linalg.inv(own)
    weighted = inverse @ mixed
    slope = now.by.T @ found.shape_slope - now.prior @ now.outline
    slope = slope - np.einsum("tip,ti->p", weighted, found.pose_slope)
    step = np.linalg.solve(outline - np.einsum("tip,tiq->pq", mixed, weighted, optimize=True), slope)
    poses = np.einsum("tij,tj->ti", inverse, found.pose_slope - mixed @ step)
    return np.concatenate([poses.ravel(), step])


def _joint(found: Equations, now: _State, pairs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the equations of a path's knots, then its outline."""
    many, knots = now.basis.shape
    own = (pairs.T @ found.pose.reshape(many, 9)).reshape(knots, knots, 3, 3).transpose(0, 2, 1, 3)
    mixed = (now.basis.T @ found.mixed.reshape(many, -1)).reshape(3 * knots, -1) @ now.by
    outline = now.by.T @ found.shape @ now.by + now.prior
    matrix = np.block([[own.reshape(3 * knots, 3 * knots), mixed], [mixed.T, outline]])
    slope = now.by.T @ found.shape_slope - now.prior @ now.outline
    return matrix, np.concatenate([(now.basis.T @ found.pose_slope).ravel(), slope])

"""A rough shape that moves smoothly, from the readings alone: what a search for corners and poses begins with.

The outline is star-shaped, 24 radii with a prior against roughness; its poses are a spline over the scans. Descents
begin at a circle on the way of the contact's centre, with every total turn, and a tolerance of edges that gets finer,
so that a start which is wrong by half the object still ends at the right shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import Loss
from tacstrip.core.rigid import RigidScans, loss
from tacstrip.core.rigid_path import OnPath, OutlineNumbers, descend_path
from tacstrip.reconstruction.contact_ends import closed_ends

RADII = 24
_ANGLES = 2.0 * np.pi * np.arange(RADII) / RADII
_SPOKES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
_BEND = np.roll(np.eye(RADII), 1, 1) + np.roll(np.eye(RADII), -1, 1) - 2.0 * np.eye(RADII)
_CENTRED = 0.014  # of the radius: how near to the frame's origin the outline's middle is held
_LOOSE = 4.0  # radii: a prior for each radius by itself, so that all are determined
LEAST = 0.2  # of the mean radius that a rough outline keeps everywhere
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

    def turning(self, turn: float) -> Path:
        """Return the same path with an angle that goes on evenly, by so much in all [rad]."""
        knots = self.knots.copy()
        knots[:, 2] = turn * (np.linspace(0.0, 1.0, len(knots)) - 0.5)
        return replace(self, knots=knots)

    def refined(self, basis: FloatArray) -> Path:
        """Return the same path on more knots."""
        knots = np.linalg.lstsq(basis, self.basis, rcond=None)[0] @ self.knots
        return replace(self, basis=basis, knots=knots, cost=np.inf)


def spline_basis(at: FloatArray, knots: int, *, straight: bool = False) -> FloatArray:
    """Return what each of some knots, evenly from 0 to 1, adds at places (T,): (T, knots).

    A cubic motion lies in it, whatever the knots; not so with ends that are straight, which hold a rough start there.
    """
    places = np.linspace(0.0, 1.0, knots)
    if knots < 4:
        return np.asarray(np.vander(at, knots) @ np.linalg.inv(np.vander(places, knots)))
    from scipy.interpolate import CubicSpline  # late: `live` would start a third of a second later

    ends = "natural" if straight and knots > 4 else "not-a-knot"
    return np.asarray(CubicSpline(places, np.eye(knots), bc_type=ends)(at))


def one_after_another(splines: list[FloatArray]) -> FloatArray:
    """Return the spline (T, K) of stretches of scans that have one each, without a step from one to the next."""
    found, at = np.zeros(np.sum([s.shape for s in splines], axis=0)), np.zeros(2, dtype=int)
    for spline in splines:
        end = at + spline.shape
        found[at[0] : end[0], at[1] : end[1]] = spline
        at = end
    return found


def centres(scans: RigidScans) -> tuple[FloatArray, FloatArray]:
    """Return roughly where the contact's middle is in each scan (T, 2) [mm], and its area (T,) [mm^2]."""
    pitch, length = scans.sensor.pitch_mm, scans.sensor.length_mm
    touched = np.isfinite(scans.k).any(axis=1)
    if len(scans.read) == 2:
        with np.errstate(invalid="ignore", divide="ignore"):
            l, u = closed_ends(scans.sensor, scans.k[:, 0], scans.k[:, 1])
        width = np.where(touched, np.maximum(np.nan_to_num(u - l), 1e-3 * length), 0.0)
        middle = np.nan_to_num(0.5 * (l + u))
    else:
        across = touched.sum(axis=1, keepdims=True) * pitch
        width = np.where(touched, _ROUND * across, 0.0)
        row = next(iter(scans.read), 0)
        middle = np.nan_to_num(scans.k[:, row]) * (length - 0.5 * width)
        if scans.shares[row] == 0.0:
            middle = middle + 0.5 * width
    weight = np.maximum(width.sum(axis=1), 1e-12)
    found = (
        np.stack([(width * scans.x_mm).sum(axis=1), (width * middle).sum(axis=1)], axis=1) / weight[:, None]
    )
    return found, weight * pitch


def circle(scans: RigidScans, basis: FloatArray) -> Path:
    """Return a circle on the way of the contact's centre, which does not turn."""
    middle, area = centres(scans)
    radius = float(np.sqrt(np.median(area) / np.pi))
    knots = np.zeros((basis.shape[1], 3))
    knots[:, :2] = np.linalg.lstsq(basis, middle, rcond=None)[0]
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
    by = OutlineNumbers(np.repeat(np.arange(RADII), 2), _SPOKES.ravel(), prior / radius**2)
    begin = OnPath(start.radii, start.knots)
    found = descend_path(scans, by, begin, start.basis, how, steps, 1e-3, least=0.02)
    return replace(start, radii=found.outline, knots=found.knots, cost=found.cost)


def radii_of(corners: FloatArray) -> FloatArray:
    """Return how far from the mean of corners (N, 2) their outline is, at the angles of a rough one (RADII,)."""
    own = corners - corners.mean(axis=0)
    edge = np.roll(own, -1, axis=0) - own
    spoke = _SPOKES[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / (spoke[..., 0] * edge[:, 1] - spoke[..., 1] * edge[:, 0])
        far = (own[:, 0] * edge[:, 1] - own[:, 1] * edge[:, 0]) * over
        share = (own[:, 0] * spoke[..., 1] - own[:, 1] * spoke[..., 0]) * over
        found = np.where((share >= 0.0) & (share <= 1.0), far, 0.0).max(axis=1)
    return np.asarray(np.maximum(found, LEAST * found.mean()))


def fit_corners(
    scans: RigidScans, corners: FloatArray, knots: FloatArray, basis: FloatArray, how: Loss, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners (N, 2) and knots (K, 3) after a descent of both, and the scans' costs (T,)."""
    size = corners.size
    by = OutlineNumbers(np.arange(size), np.ones(size), np.zeros((size, size)))
    found = descend_path(scans, by, OnPath(corners.ravel(), knots), basis, how, steps, 1e-5)
    return by.corners(found.outline), found.knots, found.costs

"""Offsets of channels that last: they move with no object, so that many scans tell them from its shape."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import Equations, RigidScans, linearised_blocks
from tacstrip.tracking.rigid.corners import FEWEST, Fit, faintest, fitted, not_sure, without
from tacstrip.tracking.rigid.covariance import UPRIGHT, information, of_numbers, without_poses

_FEWEST = 12  # scans that tell an offset from a shape
_FIRST, _LEAST, _MOST = 0.002, 0.0003, 0.01  # deviation of offsets [Vref]: the first guess, and its limits
_ROUNDS = 4  # of offsets and fit in turn
EVIDENCE = 3.0  # twice the logarithm of how much likelier the readings are with offsets than without
_RULED_OUT = -6.0  # likewise: odds of 1:20 against offsets
# Fits that offsets are fitted along with; how far above the best criterion these may be, before and after; and what
# differs by less is one outline.
_TRIED, _NEAR, _ALIKE = 4, 8.0, 0.1
_NOT_RIGID = 2.0  # chi square over the freedom, as predicted with offsets: no rigid outline leaves so much
_DAMPING = 1e-4

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Offsets:
    """What channels read beside the truth.

    Attributes
    ----------
    values
        Of signatures and strips (S, n) [Vref]; 0 where nothing is known.
    deviation
        Standard deviation of offsets among the channels [Vref].
    price
        How much narrower the readings make them than this, as twice a logarithm: Occam's factor.
    told
        How many channels' offsets the readings tell, each counted by how far: what the deviation is known from.
    """

    values: FloatArray
    deviation: float
    price: float = 0.0
    told: float = np.inf

    @property
    def upper(self) -> float:
        """The deviation, and two of what it is uncertain by itself [Vref]: what regions must allow for."""
        return self.deviation * (1.0 + float(np.sqrt(2.0 / max(self.told, 1.0))))

    @property
    def cost(self) -> float:
        """What the values cost beside the readings' chi square."""
        return float((self.values**2).sum()) / self.deviation**2 + self.price


def taken_off(scans: RigidScans, offsets: Offsets | None) -> RigidScans:
    """Return scans without what their channels are off."""
    return scans if offsets is None else replace(scans, k=scans.k - offsets.values)


def channel_offsets(
    scans: RigidScans, fit: Fit, known: Offsets | None = None, rounds: int = _ROUNDS
) -> tuple[Offsets, Fit] | None:
    """Return the offsets that explain, with a fit's outline and about its poses, what it leaves of the readings.

    And the fit of the readings without them. Where none are known: None, if the readings do not ask for any. Their
    deviation is found along with them.
    """
    if known is None and len(scans.k) < _FEWEST:
        return None
    before = fit.cost
    values = np.zeros(scans.k.shape[1:]) if known is None else known.values
    deviation, touched = known.deviation if known else _FIRST, scans.channels
    for _ in range(rounds):
        known_of, asked = _alone(scans, fit, values, deviation)
        covariance = np.linalg.inv(known_of)
        step, spread = covariance @ asked, covariance.diagonal()
        price = float(np.linalg.slogdet(deviation**2 * known_of)[1])
        if known is None and not values.any() and float(asked @ step) < price:
            return None
        values = values.copy()
        values.ravel()[touched] += step
        fit = fitted(replace(scans, k=scans.k - values), fit.corners, fit.poses, 10, basis=fit.basis)
        own, prior = values.ravel()[touched], deviation
        deviation = float(np.sqrt((own**2 + spread).mean()))
        deviation = min(max(deviation, _LEAST), _MOST)
    found_now = Offsets(values, prior, price, float((1.0 - spread / prior**2).sum()))
    asked_for = known or before - fit.cost - found_now.cost > EVIDENCE
    return (found_now, fit) if asked_for else None


def offsets_of_all(scans: RigidScans, fits: list[Fit], least: float) -> list[tuple[Offsets, Fit]]:
    """Return offsets and fits, of any number of corners, that explain the readings best together, the best first.

    Corners take offsets up: a fit that explains the readings with too many asks for none, those of fewer do. None where
    all are far above the `least` criterion without offsets, or leave far more of the readings than noise does.
    """
    if len(scans.k) < _FEWEST:
        return []
    none = Offsets(np.zeros(scans.k.shape[1:]), _FIRST)
    predicted = [
        (_with_offsets(scans, fit), fit) for _, fit in _unlike([(f.criterion(scans), f) for f in fits])
    ]
    tries = list[tuple[float, tuple[Offsets, Fit]]]()
    for criterion, fit in _unlike(predicted)[:_TRIED]:
        cost = criterion - fit.criterion(scans) + fit.cost
        if criterion < least + _NEAR and cost < _NOT_RIGID * fit.freedom(scans):
            trial = channel_offsets(scans, fit, none)
            assert trial is not None
            offsets, fewer = without_needless_corners(scans, *trial)
            tries.append((fewer.criterion(scans) + offsets.cost, (offsets, fewer)))
    tries = _unlike(tries)
    if tries and tries[0][0] > least:  # one that comes close may, once it is settled, be better
        tries = tries[:1]
    return [t for criterion, t in tries if criterion < min(tries[0][0], least) + _NEAR]


def _unlike(fits: list[tuple[float, _T]]) -> list[tuple[float, _T]]:
    """Return what several turns ended in once, by its criterion, the best first."""
    kept = list[tuple[float, _T]]()
    for criterion, fit in sorted(fits, key=lambda f: f[0]):
        if not kept or criterion > kept[-1][0] + _ALIKE:
            kept.append((criterion, fit))
    return kept


def _with_offsets(scans: RigidScans, fit: Fit) -> float:
    """Return what the criterion of a fit becomes once offsets are fitted along, as far as that is linear."""
    known_of, asked = _alone(scans, fit, np.zeros(scans.k.shape[1:]), _FIRST)
    price = float(np.linalg.slogdet(_FIRST**2 * known_of)[1])
    return fit.criterion(scans) - float(asked @ np.linalg.solve(known_of, asked)) + price


def _alone(
    scans: RigidScans, fit: Fit, values: FloatArray, deviation: float, by: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the equations of offsets of channels that are read, corners and poses following: matrix and slope.

    `by` (2 N, P): corners follow as few numbers.
    """
    size, rest = fit.corners.size, replace(scans, k=scans.k - values)
    found = with_offsets(rest, fit, information(rest, fit.corners, fit.poses), deviation)
    if by is not None:
        found, size = of_numbers(found, by), by.shape[1]
    slope = found.shape_slope.copy()
    slope[size:] -= values.ravel()[scans.channels] / deviation**2
    matrix, slope, _, _ = without_poses(replace(found, shape_slope=slope), fit.basis, _DAMPING)
    own = np.linalg.pinv(matrix[:size, :size], hermitian=True)  # a corner that no reading sees has none
    outline = own @ np.column_stack([matrix[:size, size:], slope[:size]])
    known_of = matrix[size:, size:] - matrix[size:, :size] @ outline[:, :-1]
    return known_of, slope[size:] - matrix[size:, :size] @ outline[:, -1]


def not_ruled_out(scans: RigidScans, fit: Fit, by: FloatArray | None = None) -> float:
    """Return the deviation of offsets that the readings neither ask for nor rule out [Vref]; 0: they rule them out.

    Regions must allow for offsets of such a size. Of too few scans they are not asked for, and count as ruled out.
    `by` (2 N, P): the corners follow as few numbers.
    """
    if len(scans.k) < _FEWEST:
        return 0.0
    known_of, asked = _alone(scans, fit, np.zeros(scans.k.shape[1:]), _FIRST, by)
    price = float(np.linalg.slogdet(_FIRST**2 * known_of)[1])
    return _FIRST if float(asked @ np.linalg.solve(known_of, asked)) - price > _RULED_OUT else 0.0


def without_needless_corners(scans: RigidScans, offsets: Offsets, fit: Fit) -> tuple[Offsets, Fit]:
    """Return offsets and fit after corners are taken away that the criterion does not miss once offsets follow.

    Corners and offsets explain the same readings in part: a corner too many, once found, keeps the offsets wrong.
    """
    least = fit.criterion(scans) + offsets.cost
    while len(fit.corners) > FEWEST:
        rest, tries = taken_off(scans, offsets), []
        known = with_offsets(rest, fit, information(rest, fit.corners, fit.poses), offsets.deviation)
        unsure = not_sure(rest, fit, known)
        for corner in (c for c in faintest(fit.corners) if c in unsure):
            trial = channel_offsets(scans, without(rest, fit, corner, 8), offsets, 2)
            assert trial is not None
            tries.append((trial[1].criterion(scans) + trial[0].cost, *trial))
        best = min(tries, key=lambda t: t[0], default=None)
        if best is None or best[0] >= least:
            break
        least, offsets, fit = best
    return offsets, fit


def with_offsets(scans: RigidScans, fit: Fit, found: Equations, deviation: float) -> Equations:
    """Return the equations of corners and poses with one offset per channel that is read after the corners."""
    own, size, many = scans.channels, 3 + fit.corners.size, len(fit.poses)
    by_pose = np.empty((many, 3, len(own)))
    cross, known, slope = np.zeros((size - 3, len(own))), np.zeros(len(own)), np.zeros(len(own))
    for some, part, here in linearised_blocks(scans, fit.corners, fit.poses):
        rows = here.rows.reshape(len(some), -1, size)[:, own]
        left = (part.k - here.model).reshape(len(some), -1)[:, own] / scans.sigma**2
        there = np.isfinite(left) & (np.abs(rows[..., 0]) <= UPRIGHT / scans.sensor.length_mm)
        rows *= there[..., None] / scans.sigma**2
        by_pose[some] = rows[..., :3].transpose(0, 2, 1)
        cross += rows[..., 3:].sum(axis=0).T
        known += there.sum(axis=0)
        slope += np.where(there, left, 0.0).sum(axis=0)
    return replace(
        found,
        mixed=np.concatenate([found.mixed, by_pose], axis=2),
        shape=np.block([[found.shape, cross], [cross.T, np.diag(known / scans.sigma**2 + deviation**-2)]]),
        shape_slope=np.concatenate([found.shape_slope, slope]),
    )

"""What a search ends with: a fit, its rivals, and whether it explains the scans."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans, equations, fit_poses, loss
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.tracking.rigid.corners import FIRST, Fit, bad_scans, poses_all_round
from tacstrip.tracking.rigid.offsets import Offsets
from tacstrip.tracking.rigid.starts import Starts, spline_over

_ALARM, _HARDLY_MORE = 3.5, 1.05  # deviations of chi square, and times the freedom
_UNLIKELY = 0.05  # odds of another count of corners, against the best fit, that are taken for none
_ALIKE = 0.95  # of what two outlines cover both do: no rivals, of which one would be right where the other is wrong
# Shares of what a fit leaves that a strain over time explains: of rigid objects that were not found yet .17 at most, as
# measured; and three quarters of a step, by the slope through it.
_STRAINS, _EVENLY = 0.5, 0.8
WORTH_SETTLING = 1.6  # times the freedom: fits that may, once they are settled


def content(scans: RigidScans, fit: Fit, distribution: str) -> bool:
    """Whether the fit leaves no more of the readings than noise does, or hardly more where they are very many."""
    return within_noise(fit.costs, fit.freedom(scans), distribution)


def within_noise(costs: FloatArray, freedom: int, distribution: str) -> bool:
    """Whether what scans cost (T,) is what noise of so many degrees of freedom costs."""
    return (
        float(costs.sum()) <= _HARDLY_MORE * freedom
        or chi_square_score(np.sqrt(costs), freedom, distribution) <= _ALARM
    )


@dataclass(frozen=True, eq=False)
class Found:
    """What a search ended with.

    Attributes
    ----------
    fit
        Of all scans.
    chosen
        Scans that the rivals are fits of (K,).
    rivals
        Fits that explain these about as well, but for the best one, and how much worse their criterion is.
    offsets
        Of the channels, where the readings ask for them: the fits are of readings without these.
    starts
        What the search began with, for one that is more thorough.
    strained
        Share of what the fit leaves of the scans, beyond noise, that a strain over time explains; 0: was not asked.
    """

    fit: Fit
    chosen: IntArray
    rivals: tuple[tuple[Fit, float], ...] = ()
    offsets: Offsets | None = None
    starts: Starts | None = field(default=None, repr=False)
    strained: float = 0.0

    @property
    def strains(self) -> bool:
        """Whether what the fit leaves is that of an object that deforms, and not of a rigid one that was not found."""
        return self.strained > _STRAINS

    @property
    def strains_evenly(self) -> bool:
        """Whether it is not that of a second object either, which comes or goes at once."""
        return self.strained > _EVENLY

    def criterion(self, scans: RigidScans) -> float:
        """Return what searches are compared by: the fit's, and what the offsets cost."""
        return self.fit.criterion(scans) + (0.0 if self.offsets is None else self.offsets.cost)

    @cached_property
    def outlines(self) -> list[FloatArray]:
        """The rivals' corners in the fit's frame."""
        poses = self.fit.poses[self.chosen]
        return [carried(fit, poses) for fit, _ in self.rivals]

    def weights(self, rivals: Sequence[int]) -> FloatArray:
        """Return how likely each of some rivals is the right outline, and not the fit or another one of these."""
        odds = np.array([math.exp(-0.5 * max(self.rivals[i][1], 0.0)) for i in rivals])
        return np.asarray(odds / (1.0 + odds.sum()))

    @cached_property
    def _beside(self) -> list[tuple[float, float]]:
        """How far each rival's outline is from the fit's [mm], Hausdorff's distance, and the share it overlaps by."""
        own, found = shapely.Polygon(self.fit.corners).buffer(0), list[tuple[float, float]]()
        for outline in self.outlines:
            other = shapely.Polygon(outline).buffer(0)
            share = other.intersection(own).area / max(other.union(own).area, 1e-9)
            found.append((float(other.hausdorff_distance(own)), float(share)))
        return found

    def apart(self, alike_mm: float) -> list[int]:
        """Return the rivals whose outlines are neither nearer to the fit's than given nor overlap it by `_ALIKE`."""
        return [i for i, (far, share) in enumerate(self._beside) if far > alike_mm and share < _ALIKE]

    def likely(self, rivals: Sequence[int]) -> float:
        """Return how likely the right outline is one of some rivals, and not the fit's.

        Other rivals do not make these less likely: a valley of the cost has many best fits.
        """
        return float(self.weights(rivals).sum())

    def spread_mm(self, rivals: list[int]) -> float:
        """Return how far the outlines of some rivals are from the fit's, at most: Hausdorff's distance."""
        return max((self._beside[i][0] for i in rivals), default=0.0)

    def without(self, rivals: list[int]) -> Found:
        """Return it without some of its rivals."""
        return replace(self, rivals=tuple(r for i, r in enumerate(self.rivals) if i not in rivals))

    def unlike(self, scans: RigidScans, least_mm: float) -> list[Fit]:
        """Return the rivals with poses of all scans, each the one that is most unlike the fit and those before it."""
        others = [
            (fit, shapely.Polygon(o).buffer(0))
            for (fit, _), o in zip(self.rivals, self.outlines, strict=True)
        ]
        kept, shapes = list[Fit](), [shapely.Polygon(self.fit.corners).buffer(0)]
        apart = [float(shape.hausdorff_distance(shapes[0])) for _, shape in others]
        while apart and max(apart) > least_mm:
            fit, shape = others[int(np.argmax(apart))]
            kept.append(with_all_poses(scans, self.chosen, fit))
            apart = [
                min(a, float(s.hausdorff_distance(shape))) for a, (_, s) in zip(apart, others, strict=True)
            ]
        return kept

    def of_other_count(self, least_mm: float) -> int:
        """Return how many corners the likeliest rival has that has more or fewer and is off by so much; 0: none is.

        What is less likely than `_UNLIKELY` does not count, nor do `FIRST` corners and more: they stand for a curve.
        """
        own = shapely.Polygon(self.fit.corners).buffer(0)
        for (fit, worse), outline in zip(self.rivals, self.outlines, strict=True):
            far = float(shapely.Polygon(outline).buffer(0).hausdorff_distance(own))
            if (
                len(fit.corners) != len(self.fit.corners)
                and math.exp(-0.5 * worse) > _UNLIKELY
                and max(len(fit.corners), len(self.fit.corners)) < FIRST
                and far > least_mm
            ):
                return len(fit.corners)
        return 0


def carried(rival: Fit, poses: FloatArray) -> FloatArray:
    """Return a rival's corners as the frame has them whose poses in the same scans are these, in the median."""
    turns = np.angle(np.exp(1j * (rival.poses[:, 2] - poses[:, 2])))
    turn = turns[0] + np.median(np.angle(np.exp(1j * (turns - turns[0]))))
    middle = rival.corners.mean(axis=0)
    own, there = np.exp(1j * rival.poses[:, 2]), rival.poses[:, :2] - poses[:, :2]
    apart = (own * complex(*middle) + there @ (1.0, 1j)) * np.exp(-1j * poses[:, 2])
    seen = np.median(apart.real), np.median(apart.imag)
    return placed(rival.corners - middle, np.array([*seen, turn]))


def with_all_poses(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans with the poses of all: from those next to it, and all round where that fails."""
    if len(chosen) == len(scans.k):
        return fit
    if fit.basis is not None:
        basis = spline_over(scans, np.arange(len(scans.k)), fit.basis.shape[1])
        poses = basis @ np.linalg.lstsq(basis[chosen], fit.poses, rcond=None)[0]
        return Fit(fit.corners, poses, equations(scans, fit.corners, poses, loss(scans)).costs, basis)
    start = np.stack(
        [np.interp(np.arange(len(scans.k)), chosen, p) for p in np.unwrap(fit.poses, axis=0).T], axis=1
    )
    poses, costs = fit_poses(
        scans, fit.corners, start[:, None], loss(scans, 0.05 * scans.sensor.pitch_mm, 5.0), 8
    )
    poses, costs = fit_poses(scans, fit.corners, poses, loss(scans), 12)
    found = Fit(fit.corners, poses[:, 0], costs[:, 0])
    bad = bad_scans(scans, found)
    if len(bad):
        others, cost = poses_all_round(scans.of(bad), fit.corners, 0.05 * scans.sensor.pitch_mm)
        better = cost[:, 0] < found.costs[bad]
        found.poses[bad[better]], found.costs[bad[better]] = others[better, 0], cost[better, 0]
    return found

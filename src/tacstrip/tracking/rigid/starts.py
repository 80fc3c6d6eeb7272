"""What a search begins with: rough outlines on smooth paths, and the polygons that they become."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import Fit, bad_scans, pruned
from tacstrip.tracking.rigid.smooth_path import Path, centres, circle, fit_path, spline_basis

TURNS = tuple(range(-160, 161, 20))  # degrees
DENSE, MANY_STRIPS, _SPARSE = 48, 20, 16  # scans that a search uses; of finer sensors fewer do
_KNOTS, _MORE_KNOTS = 4, 8
_ENOUGH = 8  # strips of a scan that a rough outline is fitted to, at least, where more are touched
KEPT = 3  # paths that are made polygons of
# Strips: scans that touch fewer explain one another at many wrong turns, so that all are tried.
FEW_A_SCAN = 6
LOST = 0.5  # of the scans: a polygon that leaves more will not explain them once it is settled
_FEW_LOST = 0.3  # likewise of a stretch that touches few strips
_SOFT, _HARD = 0.25, 0.1  # pitches that an end of an outline is off
_COARSE, FINER, _FINEST = 0.07, 0.023, 0.012  # tolerances of edges, over the outline's radius
ROUGH, _SMOOTHER = 0.07, 0.09  # the radii's second differences, likewise
_ERRATIC = 0.2  # of the radius: a middle that is so far off any smooth path, in the median, moves along none


@dataclass(eq=False)
class Starts:
    """Rough outlines on smooth paths, by total turn [deg], and the polygons that they become: each made once.

    Attributes
    ----------
    scans
        All of them.
    rough, refined
        Outlines on few knots, and the best of them on more.
    polygons
        With free poses, of ever fewer corners.
    """

    scans: RigidScans
    rough: dict[int, Path] = field(default_factory=dict)
    refined: dict[int, Path] = field(default_factory=dict)
    polygons: dict[int, list[Fit]] = field(default_factory=dict)

    @cached_property
    def chosen(self) -> IntArray:
        """Scans that a search uses."""
        return chosen_scans(self.scans)

    @cached_property
    def few(self) -> RigidScans:
        """These."""
        return self.scans.of(self.chosen)

    @cached_property
    def thinned(self) -> RigidScans:
        """These with some of their strips, of which rough outlines are made."""
        return with_some_strips(self.few)

    @cached_property
    def circle(self) -> Path:
        """What rough outlines are made of."""
        return circle(self.few, self.splines[0])

    @cached_property
    def splines(self) -> list[FloatArray]:
        """Of few and of more knots, over these."""
        return [spline_over(self.scans, self.chosen, knots) for knots in (_KNOTS, _MORE_KNOTS)]

    @property
    def erratic(self) -> bool:
        """Whether the contact's middle moves along no smooth path."""
        middle, area = centres(self.few)
        basis = self.splines[1]
        off = middle - basis @ np.linalg.lstsq(basis, middle, rcond=None)[0]
        return bool(np.median(np.hypot(*off.T)) > _ERRATIC * math.sqrt(float(np.median(area)) / math.pi))

    def best(self, turns: Sequence[int], kept: int) -> list[int]:
        """Return the turns that the best outlines come from."""
        for turn in turns:
            if turn not in self.rough:
                path = self.circle.turning(math.radians(turn))
                path = fit_path(self.thinned, path, 8, tolerance=_COARSE, cauchy=3.0, rough=ROUGH, end=_SOFT)
                path = fit_path(self.thinned, path, 6, tolerance=FINER, cauchy=3.0, rough=ROUGH, end=_SOFT)
                self.rough[turn] = path
        near = sorted(turns, key=lambda t: self.rough[t].cost)[: 2 * kept]
        for turn in near:
            if turn not in self.refined:
                path = self.rough[turn].refined(self.splines[1])
                path = fit_path(self.thinned, path, 10, tolerance=FINER, cauchy=3.0, rough=ROUGH, end=_SOFT)
                path = fit_path(
                    self.thinned, path, 6, tolerance=_FINEST, cauchy=3.0, rough=_SMOOTHER, end=_HARD
                )
                self.refined[turn] = path
        return sorted(near, key=lambda t: self.refined[t].cost)[:kept]

    def paths(self, turns: Sequence[int]) -> list[Path]:
        """Return the outlines of some turns."""
        return [self.refined[turn] for turn in turns]

    def pruned(self, turns: Sequence[int]) -> list[Fit]:
        """Return the polygons, with free poses, that the outlines of some turns become."""
        for turn, path in zip(turns, self.paths(turns), strict=True):
            if turn not in self.polygons:
                self.polygons[turn] = pruned(self.few, path.corners, path.poses)
        return [fit for turn in turns for fit in self.polygons[turn]]

    @cached_property
    def hopeless(self) -> bool:
        """Whether the best outlines leave most scans unexplained, as those of a rigid object hardly ever do."""
        return self.unexplained(self.best(TURNS, KEPT)) > LOST

    @property
    def plain(self) -> bool:
        """Whether outlines on smooth paths tell if a rigid one explains the scans."""
        return not self.erratic and not needs_smooth_motion(self.scans)

    @property
    def promising(self) -> bool:
        """Whether a rigid outline may explain a stretch of scans, by the best on smooth paths."""
        few = self.scans.strips_touched < FEW_A_SCAN
        return not self.plain or self.unexplained(self.best(TURNS, KEPT)) <= (_FEW_LOST if few else LOST)

    def unexplained(self, turns: Sequence[int]) -> float:
        """Return the share of the scans that the polygons of some turns leave unexplained, at least."""
        return min(len(bad_scans(self.few, f)) for f in self.pruned(turns)) / len(self.chosen)


def needs_smooth_motion(scans: RigidScans) -> bool:
    """Whether a scan tells hardly more than a pose: one signature."""
    return len(scans.read) == 1


def chosen_scans(scans: RigidScans, dense: int = DENSE) -> IntArray:
    """Return the scans that a search uses: so many, and fewer of finer sensors."""
    many = _SPARSE if scans.k.shape[2] > MANY_STRIPS else dense
    return np.unique(np.linspace(0, len(scans.k) - 1, min(len(scans.k), many)).astype(int))


def with_some_strips(scans: RigidScans) -> RigidScans:
    """Return scans with every so many of their touched strips only, the first and the last among them."""
    apart = int(scans.strips_touched) // _ENOUGH
    if apart < 2:
        return scans
    touched = np.asarray(np.isfinite(scans.k).any(axis=1))
    number = np.cumsum(touched, axis=1)
    kept = touched & ((number % apart == 1) | (number == number[:, -1:]))
    return replace(scans, k=np.where(kept[:, None], scans.k, np.nan))


def spline_over(scans: RigidScans, chosen: IntArray, knots: int) -> FloatArray:
    """Return a spline of so many knots over all scans, of those that were chosen."""
    return spline_basis(chosen / max(len(scans.k) - 1, 1), min(knots, len(chosen)), straight=True)

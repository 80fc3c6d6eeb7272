"""Objects while they are found: the scans that show each, its readings there, and what is known of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.hull import available
from tacstrip.core.rigid import RigidScans
from tacstrip.reconstruction.seam import opened
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.rigid.corners import Fit, posed
from tacstrip.tracking.rigid.curved import RigidCurve
from tacstrip.tracking.rigid.found import Found, content, with_all_poses
from tacstrip.tracking.rigid.posterior import Likely
from tacstrip.tracking.rigid.search import LEAST_STRIPS
from tacstrip.tracking.shared_strips.known import Alone, Shared
from tacstrip.tracking.strays import set_aside, strays_over_time

GUESS = 0.003  # of sigma that is not known [Vref]
TOLD = 0.1  # of the pitch: shapes that differ by more are not the same
_UNEXPLAINED = (
    "in the scans in which it shares strips the known objects do not explain the readings: another is there that is "
    "never alone, or one outline is that of two"
)


@dataclass(frozen=True)
class Skin:
    """The strips that contacts lie on: a closed tube's are laid out for as many turns as contacts go on.

    `silent`: strips of the sensor of which nothing is known (n,).
    """

    sensor: Sensor
    span: slice
    silent: BoolArray

    @cached_property
    def laid_out(self) -> Sensor:
        """A sensor of these strips, without those of which nothing is known."""
        sensor, strips = self.sensor, np.arange(self.span.start, self.span.stop)
        if sensor.closed:
            sensor = opened(sensor, len(strips))
        silent = np.flatnonzero(self.silent[strips % self.sensor.strips]) + sensor.strip_base
        return replace(sensor, without=tuple(map(str, silent)))


@dataclass(frozen=True, eq=False)
class Object:
    """The scans that show one object by itself, its readings there, and what was found; and with others.

    `alike`: one of those that share strips with it has its shape. `curve`: it is one, and no polygon.
    `likely`: outlines that are, where the fit that explains it best is none of them; `found` has their mean then.
    `begun`: what searches that were not thorough found: of all readings, then without those that stray.
    """

    shown: list[int]
    joint: list[int]
    runs: list[slice]
    scans: RigidScans
    found: Found
    shared: tuple[Shared, ...] = ()
    alike: bool = False
    curve: RigidCurve | None = None
    likely: Likely | None = None
    begun: tuple[Found, ...] = field(default=(), repr=False)

    def explained(self, distribution: str) -> bool:
        """Whether a rigid outline explains its scans."""
        return self.curve is not None or content(self.scans, self.found.fit, distribution)

    def within_noise(self, distribution: str) -> bool:
        """Whether what it leaves of its scans is noise: a curve may leave more and be believed."""
        if self.curve is not None:
            return self.curve.explains(self.scans, distribution)
        return content(self.scans, self.found.fit, distribution)

    @property
    def judged_fit(self) -> Fit:
        """That of the curve, or of the polygon."""
        return self.found.fit if self.curve is None else self.curve.fit

    @property
    def left_over(self) -> float:
        """Deviation of what it leaves of its readings [Vref]."""
        freedom = (self.curve or self.found.fit).freedom(self.scans)
        return self.scans.sigma * math.sqrt(self.judged_fit.cost / freedom)

    def noise_found(self, given: float | None) -> float:
        """Return what it leaves of its readings over sigma, where that was not given but roughly found; else 1."""
        return 1.0 if given == self.scans.sigma else self.left_over / self.scans.sigma

    @property
    def places(self) -> set[tuple[int, int]]:
        """Scans that show it by itself, and its first strip there."""
        return {(scan, run.start) for scan, run in zip(self.shown, self.runs, strict=True)}

    @property
    def followable(self) -> bool:
        """Whether it can be followed where it shares strips: there channels have no offsets and poses no spline."""
        return (
            self.found.offsets is None
            and self.curve is None
            and self.found.fit.basis is None
            and self.scans.strips_touched >= LEAST_STRIPS
        )

    @property
    def alone(self) -> Alone:
        """What is known of it for scans in which it shares strips."""
        order = np.argsort(self.shown)
        fit = self.found.fit
        return Alone(
            fit.corners,
            [self.shown[i] for i in order],
            fit.poses[order],
            self.scans.k[order],
            tuple(
                (f.corners, f.poses[order])
                for f in self.found.unlike(self.scans, TOLD * self.scans.sensor.pitch_mm)
            ),
        )

    @property
    def unexplained(self) -> Object:
        """It with the advice that what it shares strips with is not known."""
        return replace(self, shared=(*self.shared, Shared(self.found.fit.corners, {}, advice=_UNEXPLAINED)))

    def without(self, places: set[tuple[int, int]]) -> Object | None:
        """Return what is known of it without some scans and places; None where nothing is left."""
        at = zip(self.shown, self.runs, strict=True)
        kept = [i for i, (scan, run) in enumerate(at) if (scan, run.start) not in places]
        if not kept:
            return None
        fit = self.found.fit
        fit = Fit(fit.corners, fit.poses[kept], fit.costs[kept])
        shown, runs = [self.shown[i] for i in kept], [self.runs[i] for i in kept]
        return Object(shown, [], runs, self.scans.of(kept), Found(fit, np.arange(len(kept))))

    def with_likely(self, likely: Likely) -> Object:
        """Return it with the mean of outlines that are likely: as rivals only those of another count remain."""
        found, count = self.found, len(likely.fit.corners)
        fit = with_all_poses(self.scans, found.chosen, likely.fit)
        rivals = tuple((rival, worse) for rival, worse in found.rivals if len(rival.corners) != count)
        return replace(self, found=replace(found, fit=fit, rivals=rivals), likely=likely)

    def with_shared(self, more: Shared) -> Object:
        """Return it with scans in which it shares strips, and the outline that they sharpened."""
        last = self.found.fit.poses
        start = np.stack([more.again.get(s, p) for s, p in zip(self.shown, last, strict=True)])
        fit = posed(self.scans, Fit(more.corners, start, np.full(len(start), np.inf)))
        rivals = tuple(
            (replace(fit, corners=o, poses=fit.poses[self.found.chosen]), w) for o, w in more.rivals
        )
        return replace(self, found=replace(self.found, fit=fit, rivals=rivals), shared=(*self.shared, more))


@dataclass(frozen=True, eq=False)
class Readings:
    """All readings (T, S, n), and what is known of them; sigma None: not known."""

    k: FloatArray
    skin: Skin
    names: tuple[str, ...]
    sigma: float | None
    distribution: str

    @cached_property
    def without_strays(self) -> FloatArray:
        """The readings without those that stray from one scan to the next."""
        return set_aside(
            self.k, strays_over_time(self.k, self.sigma or max(GUESS, self.skin.sensor.adc_step))
        )

    @property
    def followable(self) -> bool:
        """Whether objects can be followed where they share strips: with both signatures, and compiled."""
        return available() and len(self.names) > 1

    @property
    def touched(self) -> BoolArray:
        """Strips of the skin that are touched (T, n)."""
        span = self.skin.span
        own = np.arange(span.start, span.stop) % self.k.shape[2]
        return np.asarray(np.isfinite(self.k).any(axis=1))[:, own]

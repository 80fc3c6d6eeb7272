"""A track: one rigid outline, and where it lies in every scan."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.pose import placed
from tacstrip.notebook import BLUE, VERMILION, Drawn, SvgPath
from tacstrip.reconstruction.result import Alternative, RecoveredObject, Status
from tacstrip.tracking.single_scans import SingleScans

_DRAWN = 6  # outlines of a track in a notebook
STANDS = "the clock stands still: no velocity"


@dataclass(frozen=True, eq=False)
class Track(Drawn):
    """One object over time.

    Attributes
    ----------
    id
        Its number, counted from 1 in the order of appearance.
    outline
        Corners (N, 2) [mm], counter-clockwise, in the object's frame: about their mean, not turned in the first
        scan that shows it.
    covariance
        Of `outline.ravel()` (2 N, 2 N) [mm^2], of the shape alone: moved and turned as a whole it is the same shape.
    poses
        x, y [mm] and angle [rad] in every scan (T, 3), NaN where it is absent: a point p of the outline lies at
        R(angle) p + (x, y) on the sensor.
    pose_covariances
        Of the poses (T, 3, 3) [mm, mm, rad].
    times_s
        Of the scans (T,) [s].
    velocities
        Of the poses (T, 3) [mm/s, mm/s, rad/s]; NaN where it is absent or the clock stands still.
    status
        "ok", "likely" or "doubtful" (read the advice), or that of the single scan which showed most of it; on strips
        of some width (`strip_width_mm`) "likely" at best.
    advice
        In words; empty when all is well.
    alternatives
        Other outlines that explain the scans as well, in this object's frame.
    joint
        Scans in which it shared strips with another object. It has a pose there where the objects that are known from
        other scans explain the readings.
    motion
        What the shape takes for granted of the motion: "free" where each scan has a pose of its own, or which smooth
        path; one signature takes the smoothest that explains the readings.
    offsets
        By signature, what each channel reads beside the truth (strips,) [Vref], where the readings of the whole
        recording ask for it; else empty. 0 where the object never was.
    kind
        What the outline is: "polygon", else its corners draw it: "rounded" (a convex polygon whose corners are arcs of
        one radius), "ellipse" or "disc", whose angle stays 0.
    unseen_corner_mm
        By how much the outline may change, at two standard deviations, where one corner more is that the scans do not
        show: out of the edge from each corner to the next, or cut off at its ends (N,); "likely" at best where that is
        more than a corner may be uncertain. Empty for curves and for the outline of a single scan.
    by_scan
        Where no rigid outline explains the scans, or they are too few for one: how `single` is found; else None.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)])
    >>> scans = [ts.simulate(sensor, shape.turned(0.05 * i).placed(50, 50), time_s=0.01 * i) for i in range(12)]
    >>> (one,) = ts.track(scans, sensor)
    >>> round(one.area_mm2), int(one.present.sum()), one.placed(0).shape
    (1850, 12, (4, 2))
    """

    id: int
    outline: FloatArray
    covariance: FloatArray | None
    poses: FloatArray
    pose_covariances: FloatArray
    times_s: FloatArray
    velocities: FloatArray
    status: Status
    advice: str = ""
    alternatives: tuple[Alternative, ...] = ()
    joint: tuple[int, ...] = field(default=())
    motion: str = "free"
    offsets: dict[str, FloatArray] = field(default_factory=dict)
    by_scan: SingleScans | None = field(default=None, repr=False)
    kind: str = "polygon"
    unseen_corner_mm: FloatArray = field(default_factory=lambda: np.empty(0))

    def __repr__(self) -> str:
        what = f"{len(self.outline)} corners" if self.kind == "polygon" else self.kind
        what = f"{self.status}, {what}, {self.area_mm2:.4g} mm2"
        return f"<Track {self.id}: {what}, in {int(self.present.sum())} of {len(self.poses)} scans>"

    def _paths(self) -> list[SvgPath]:
        seen = np.flatnonzero(self.present)
        shown = seen[np.unique(np.linspace(0, len(seen) - 1, _DRAWN).astype(int))] if len(seen) else seen
        outlines = [SvgPath(self.placed(int(i)), stroke=VERMILION, fill=VERMILION, width=1.0) for i in shown]
        return [*outlines, SvgPath(self.centroids, stroke=BLUE, closed=False)]

    @property
    def present(self) -> FloatArray:
        """Whether each scan shows it (T,)."""
        return np.asarray(np.isfinite(self.poses[:, 0]))

    @property
    def centroids(self) -> FloatArray:
        """Centroid of the rigid outline on the sensor in every scan (T, 2) [mm]; NaN where it is absent."""
        if not len(self.outline):
            return np.full((len(self.poses), 2), np.nan)
        own, (cos, sin) = moments(self.outline)[1], (np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2]))
        turned = np.stack([cos * own[0] - sin * own[1], sin * own[0] + cos * own[1]], axis=1)
        return np.asarray(self.poses[:, :2] + turned)

    @property
    def area_mm2(self) -> float:
        """Of the outline [mm^2]."""
        return moments(self.outline)[0]

    @property
    def area_deviation_mm2(self) -> float:
        """Standard deviation of the area [mm^2]; NaN where none is known."""
        if self.covariance is None:
            return math.nan
        return deviations(self.outline, self.covariance)[0]

    @property
    def single(self) -> tuple[RecoveredObject | None, ...]:
        """What each scan shows by itself (T,), None where it is absent, if no rigid outline explains them; else empty.

        Found when first asked for, in some 5 ms a scan.
        """
        return () if self.by_scan is None else self.by_scan.all()

    def placed(self, scan: int) -> FloatArray:
        """Return the corners (N, 2) [mm] on the sensor in one scan; NaN where it is absent.

        They are the rigid outline's or, where none explains the scans, those of this scan by itself.
        """
        alone = None if self.by_scan is None else self.by_scan[scan]
        return placed(self.outline, self.poses[scan]) if alone is None or not alone.found else alone.vertices

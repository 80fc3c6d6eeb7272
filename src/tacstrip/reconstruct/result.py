"""What a reconstruction returns: objects, a status each, and advice in words."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray

Status: TypeAlias = Literal[
    "ok",
    "doubtful",  # a shape is given, but read the advice
    "no contact",
    "too few strips",
    "too few transitions",
    "shared x",
    "singular",
    "too noisy",
]
Profile: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class RecoveredObject:
    """One object on the sensor.

    Attributes
    ----------
    strips
        The touched strips it was recovered from, a slice of the scan.
    vertices
        Corners (N, 2) [mm], counter-clockwise from the left-most; (0, 2) where the status forbids a shape.
    profile
        x, l and u (strips in contact,) [mm], or None.
    covariance
        Covariance (2N, 2N) [mm^2] in the order of `vertices.ravel()`, or None where the method has none.
    status
        "ok"; "doubtful": a shape is given but may be wrong; else what stood in the way.
    advice
        In words, what to do about it; empty when all is well.
    """

    strips: slice
    vertices: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    profile: Profile | None = None
    covariance: FloatArray | None = None
    status: Status = "ok"
    advice: str = ""

    @property
    def found(self) -> bool:
        """Whether there is a shape."""
        return len(self.vertices) > 0

    @property
    def area(self) -> float:
        """Area [mm^2]; 0 without a shape."""
        return _moments(self.vertices)[0]

    @property
    def centroid(self) -> FloatArray:
        """Area centroid (2,) [mm]; NaN without a shape."""
        return _moments(self.vertices)[1]

    @property
    def orientation(self) -> float:
        """Angle of the longer principal axis from x, in (-pi/2, pi/2] [rad]; NaN without a shape."""
        if not self.found:
            return float("nan")
        xx, yy, xy = _moments(self.vertices)[2]
        return float(0.5 * np.arctan2(2.0 * xy, xx - yy))


@dataclass(frozen=True)
class Reconstruction:
    """All objects of one scan.

    Attributes
    ----------
    method
        "vertex", "profile", ...
    objects
        One per run of touched strips, left to right.
    time_s
        The scan's time [s].
    """

    method: str
    objects: tuple[RecoveredObject, ...]
    time_s: float = 0.0

    @property
    def status(self) -> Status:
        """The worst status of its objects; "no contact" without any."""
        if not self.objects:
            return "no contact"
        failed = [o for o in self.objects if not o.found]
        return next((o.status for o in (*failed, *self.objects) if o.status != "ok"), "ok")

    @property
    def advice(self) -> str:
        """The advice of all objects, a line each."""
        if not self.objects:
            return "no strip reads a contact; press harder, or check rest_volt and touch_volt in the spec"
        return "\n".join(o.advice for o in self.objects if o.advice)


def close_chains(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Join a lower and an upper chain, both (M, 2) left to right, to a counter-clockwise polygon.

    Points that both chains share, at the ends, appear once.
    """
    ring = np.concatenate([lower, upper[::-1]])
    keep = np.any(ring != np.roll(ring, -1, axis=0), axis=1)
    return np.asarray(ring[keep])


def _moments(v: FloatArray) -> tuple[float, FloatArray, tuple[float, float, float]]:
    """Return area, centroid and central second moments (xx, yy, xy) of a polygon."""
    if not len(v):
        return 0.0, np.full(2, np.nan), (0.0, 0.0, 0.0)
    origin = v.mean(axis=0)
    (x0, y0), (x1, y1) = (v - origin).T, np.roll(v - origin, -1, axis=0).T
    cross = x0 * y1 - x1 * y0
    area = float(cross.sum() / 2.0)
    if area == 0.0:
        return 0.0, origin, (0.0, 0.0, 0.0)
    cx, cy = ((x0 + x1) * cross).sum() / (6.0 * area), ((y0 + y1) * cross).sum() / (6.0 * area)
    xx = float(((x0**2 + x0 * x1 + x1**2) * cross).sum() / 12.0 - area * cx**2)
    yy = float(((y0**2 + y0 * y1 + y1**2) * cross).sum() / 12.0 - area * cy**2)
    xy = float(((x0 * y1 + 2.0 * x0 * y0 + 2.0 * x1 * y1 + x1 * y0) * cross).sum() / 24.0 - area * cx * cy)
    return area, origin + np.array([cx, cy]), (xx, yy, xy)

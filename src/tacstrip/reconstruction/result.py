"""What a reconstruction returns: objects, a status each, and advice in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.geometry.moments import MomentDeviations, deviations, moments, orientation
from tacstrip.geometry.region import outline_paths
from tacstrip.notebook import Drawn, SvgPath

if TYPE_CHECKING:
    from tacstrip.core.outline_model import OutlineModel
    from tacstrip.reconstruction.on_surface import OnSkin

Status: TypeAlias = Literal[
    "ok",  # IoU with the true shape of .8 or more in 95 of 100 cases
    "likely",  # as "ok", but assessed quickly or not at all
    "doubtful",  # a shape is given, but read the advice
    "no contact",
    "too few strips",
    "points",  # no more is known than a place within the contact on each strip
    "too few transitions",
    "shared x",
    "singular",
    "too noisy",
    "short contact",  # CRS-CRP: no strip is touched over 5 % of its length or more
]
Profile: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


class Guarantee(Protocol):
    """What is known of an object where the readings' noise has a bound."""

    @property
    def regions(self) -> list[FloatArray] | None:
        """The guaranteed regions (K, 2) [mm], in the order of the vertices."""

    @property
    def deviations(self) -> MomentDeviations | None:
        """Deviations of area, centroid and orientation, if they are known better than from the covariance."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a known object lies.

    Attributes
    ----------
    x_mm, y_mm
        Of its outline's centroid [mm].
    angle
        By which it is turned from the outline that was given, counter-clockwise, in (-pi, pi] [rad].
    covariance
        Of x, y and angle (3, 3) [mm, mm, rad].
    """

    x_mm: float
    y_mm: float
    angle: float
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another outline that explains the readings.

    Attributes
    ----------
    weight
        Probability that the true outline is like this one (IoU of .8 or more), and like neither the shape shown nor a
        heavier alternative; of several objects, that it is several. With the shape's confidence all weights are 1 at
        most.
    vertices
        Its corners (N, 2) [mm], counter-clockwise.
    pose
        Of a known object, else None; None, too, of its mirror image.
    others
        Outlines (M, 2) [mm] of the other objects, where it is several; of these only what is seen.
    """

    weight: float
    vertices: FloatArray
    pose: Pose | None = None
    others: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, eq=False)
class RecoveredObject(Drawn):
    """One object on the sensor.

    Attributes
    ----------
    strips
        The touched strips it was recovered from, a slice of the scan. Across the seam of a closed tube it goes on
        beyond the last strip: modulo their number they are strips of the scan.
    vertices
        Corners (N, 2) [mm], counter-clockwise from the left-most, x across the seam modulo the circumference; (0, 2)
        where the status forbids a shape.
    profile
        x, l and u (strips in contact,) [mm], or None.
    covariance
        Covariance (2N, 2N) [mm^2] in the order of `vertices.ravel()`, or None where the method has none.
    status
        "ok"; "likely": as far as a quick look tells; "doubtful": a shape is given but may be wrong; else what stood in
        the way.
    advice
        In words, what to do about it, or what is taken for granted; empty when nothing is.
    strip_status
        CRS-CRP: a word per strip in contact, "ok", "short contact" or "not converged"; else empty.
    points, point_deviations
        Status "points": a place within the contact on each of its strips (P, 2) [mm], its own for a contact without
        width, and its standard deviations (P, 2) [mm], NaN where the noise is not known.
    guarantee
        What `guaranteed` is computed from, where the noise has a known bound.
    uniform
        Places in `vertices.ravel()` whose error is uniform, not normal: x of a vertical end, which lies anywhere
        within a pitch.
    model
        The model whose outline this is, where it is no polygon.
    kind
        What the outline is: "polygon", else the vertices draw it, and are no corners: "ellipse"; of one signature also
        "rounded", "disc", "segment of a disc", "rectangle" (with round corners, too), "trapezoid", the last two
        "upright" as well.
    confidence
        Probability that it is one object, and its outline overlaps the true one by an IoU of .8 or more; None where
        that was not assessed, or the readings are not explained.
    alternatives
        Other outlines that explain the readings, the likeliest first.
    pose
        Of a known object (`fit_object`): where it lies.
    hidden, hidden_edges
        Of a piece (method "pieces"): which corners, and which edges from each to the next one, another piece hides
        (N,); their covariance is NaN. Under two layers `hidden` says which vertices no reading determines.
    bounds
        Of a piece that is hidden in part: the smallest and the largest outline (M, 2) [mm] that it can have.
    on_skin
        On a curved skin (`[surface]` in the spec): the outline in space; `area` is then that of the skin.
    faulty
        Channels that were not used, such as "7:v_h": no contact that the others agree on makes their readings.

    Raises
    ------
    ValueError
        Vertices and covariance are not of one size.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> noise = ts.Noise(positional=0.002)
    >>> thing = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=1), sensor, noise).objects[0]
    >>> thing.status, thing.vertices.shape, thing.covariance.shape
    ('ok', (4, 2), (8, 8))
    >>> abs(thing.area - 1700.0) < 3 * thing.deviations[0]
    True
    """

    strips: slice
    vertices: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    profile: Profile | None = None
    covariance: FloatArray | None = None
    status: Status = "ok"
    advice: str = ""
    strip_status: tuple[str, ...] = ()
    points: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    point_deviations: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    guarantee: Guarantee | None = None
    uniform: tuple[int, ...] = ()
    model: type[OutlineModel] | None = None
    kind: str = "polygon"
    confidence: float | None = None
    alternatives: tuple[Alternative, ...] = ()
    pose: Pose | None = None
    hidden: BoolArray | None = None
    hidden_edges: BoolArray | None = None
    bounds: tuple[FloatArray, FloatArray] | None = None
    on_skin: OnSkin | None = None
    faulty: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.covariance is not None and self.covariance.shape != (2 * len(self.vertices),) * 2:
            raise ValueError(
                f"{len(self.vertices)} vertices, and a covariance of shape {self.covariance.shape}"
            )

    def __repr__(self) -> str:
        where = f"strips {self.strips.start} to {self.strips.stop - 1}"
        if not self.found:
            return f"<RecoveredObject: {self.status}, {where}>"
        x, y = self.centroid
        shape = f"{self.outlined}, {self.area:.4g} mm2 at x = {x:.4g}, y = {y:.4g} mm"
        return f"<RecoveredObject: {self.status}, {shape}, {where}>"

    @property
    def found(self) -> bool:
        """Whether there is a shape."""
        return len(self.vertices) > 0

    @property
    def outlined(self) -> str:
        """In words: how many corners the outline has, or what else it is."""
        return f"{len(self.vertices)} corners" if self.kind == "polygon" else self.kind

    @property
    def guaranteed(self) -> list[FloatArray] | None:
        """Per vertex the region (K, 2) [mm] that holds it for certain if no reading is off by more than its bound.

        Computed when first asked for, in some 6 ms. None without such a bound, or where none was found. What exactly
        is guaranteed: `set_membership.regions`.
        """
        return None if self.guarantee is None else self.guarantee.regions

    @property
    def area(self) -> float:
        """Area [mm^2]; 0 without a shape."""
        return moments(self.vertices)[0] if self.on_skin is None else self.on_skin.area_mm2

    @property
    def centroid(self) -> FloatArray:
        """Area centroid (2,) [mm]; NaN without a shape."""
        return moments(self.vertices)[1]

    @property
    def orientation(self) -> float:
        """Angle of the longer principal axis from x, in (-pi/2, pi/2] [rad]; NaN without a shape."""
        return orientation(self.vertices)

    @property
    def deviations(self) -> MomentDeviations | None:
        """Standard deviations of area [mm^2], centroid (2,) [mm] and orientation [rad]; None without a covariance.

        None, too, of a piece that is hidden in part. 1.96 of them to either side hold 95 %, also where an error is not
        normal.
        """
        if self.covariance is None or (self.hidden is not None and self.hidden.any()):
            return None
        sampled = None if self.guarantee is None else self.guarantee.deviations
        found = sampled or deviations(self.vertices, self.covariance, self.uniform)
        if self.on_skin is not None:
            return self.on_skin.area_deviation_mm2, *found[1:]
        if self.pose is None:
            return found
        area, centroid, _ = found  # a rigid outline's axes turn with it, however round it is
        return area, centroid, float(np.sqrt(self.pose.covariance[2, 2]))

    def _paths(self) -> list[SvgPath]:
        return outline_paths([(self.vertices, self.covariance)])


def worst_status(objects: Sequence[RecoveredObject]) -> Status:
    """Return the worst status of a scan's objects; "no contact" without any."""
    if not objects:
        return "no contact"
    failed = [o for o in objects if not o.found]
    worst = [o.status for o in (*failed, *objects) if o.status not in ("ok", "likely")]
    return next(iter(worst), "likely" if any(o.status == "likely" for o in objects) else "ok")


@dataclass(frozen=True)
class Reconstruction(Drawn):
    """All objects of one scan.

    Attributes
    ----------
    method
        "vertex", "profile", ...
    objects
        One per run of touched strips, left to right.
    time_s
        The scan's time [s].
    alternatives
        Of two layers: other scenes that explain the readings nearly as well, the best first, each the outlines
        (N, 2) [mm] of its objects.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> found = ts.profile_reconstruction(ts.simulate(sensor, contact), sensor)
    >>> found.method, found.status, len(found.objects)
    ('profile', 'ok', 1)
    """

    method: str
    objects: tuple[RecoveredObject, ...]
    time_s: float = 0.0
    alternatives: tuple[tuple[FloatArray, ...], ...] = ()

    def __repr__(self) -> str:
        objects = "".join(f", {o!r}" for o in self.objects) if len(self.objects) == 1 else ""
        count = f"{len(self.objects)} object{'' if len(self.objects) == 1 else 's'}"
        return f"<Reconstruction by {self.method} at {self.time_s:.6g} s: {self.status}, {count}{objects}>"

    @property
    def status(self) -> Status:
        """The worst status of its objects; "no contact" without any."""
        return worst_status(self.objects)

    def _paths(self) -> list[SvgPath]:
        return outline_paths([(o.vertices, o.covariance) for o in self.objects])

    @property
    def advice(self) -> str:
        """The advice of all objects, a line each."""
        if not self.objects:
            return "no strip reads a contact; press harder, or check rest_volt and touch_volt in the spec"
        return "\n".join(o.advice for o in self.objects if o.advice)

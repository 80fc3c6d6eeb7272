"""The object that was pressed into a skin, as one scan tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tacstrip.arrays import FloatArray
from tacstrip.contact.press.patch import Patch
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import figures
from tacstrip.reconstruction.result import Status

ROUND = ("sphere", "cylinder")  # of a radius


@dataclass(frozen=True, eq=False)
class SolidFit:
    """The object that explains a scan, with how well that is known.

    Attributes
    ----------
    status, advice
        "ok"; "doubtful": the readings leave much open, or are of another object; "no contact". In words, why.
    solid
        The object at its pose; None without contact.
    patch
        What it touches of the skin, with `l`, `u`, outline and so on.
    names, values, covariance
        What was fitted: "across_mm", "along_mm" of the place, on a plane that touches the skin where the readings are;
        "depth_mm", "log_radius", "turn_rad"; their values (P,) and covariance (P, P).
    area_mm2, area_sigma_mm2
        Of the patch, and its standard deviation.
    force_n, force_sigma_n
        By the skin's stiffness; NaN where the readings do not tell it.
    radius_mm, radius_sigma_mm
        Of a sphere or cylinder; NaN where the readings do not tell it.
    direction, direction_sigma_rad
        From the skin into the object, a unit vector (3,), and its standard deviation in the worse of two ways.
    axis_sigma_rad
        Of the axis of a cylinder or edge, or a box's first side, about the direction; else NaN.
    alternatives
        Other poses that explain the readings nearly as well.
    time_s
        The scan's time [s].
    intervals
        Within what each of "area_mm2", "force_n" and "radius_mm" lies with 95 %: (low, high), of what is told (a ball's
        radius on a tube in 8 of 10 scans only). In "direction_rad" and "axis_rad" how far the direction, and the axis
        about it, are off: (0, at most).

    Examples
    --------
    >>> import tacstrip as ts
    >>> fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.002)
    >>> patch = ts.press(fingertip, ts.Solid.plane().at((20, 0, 20), toward=(-1, 0, -1)), depth_mm=1.0)
    >>> found = ts.fit_solid(ts.simulate(fingertip, patch, noise, rng=1), fingertip, ts.Solid.plane(), noise)
    >>> bool(found.direction @ [0.7071, 0, 0.7071] > 0.9999), round(found.area_mm2)
    (True, 63)
    """

    status: Status
    advice: str
    solid: Solid | None = None
    patch: Patch | None = None
    names: tuple[str, ...] = ()
    values: FloatArray | None = None
    covariance: FloatArray | None = None
    area_mm2: float = math.nan
    area_sigma_mm2: float = math.nan
    force_n: float = math.nan
    force_sigma_n: float = math.nan
    radius_mm: float = math.nan
    radius_sigma_mm: float = math.nan
    direction: FloatArray | None = None
    direction_sigma_rad: float = math.nan
    axis_sigma_rad: float = math.nan
    alternatives: tuple[Solid, ...] = ()
    time_s: float = 0.0
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def axis(self) -> FloatArray | None:
        """Unit vector (3,) along a cylinder's axis or an edge's ridge, to either side; None of others."""
        return None if self.solid is None else self.solid.axis

    @property
    def depth_mm(self) -> float:
        """How deep the object's lowest place lies in the skin; NaN without contact, or where the radius is not told.

        The same patch is a small object's that lies deep, and a large one's that does not.
        """
        if (
            self.values is None
            or self.solid is None
            or (self.solid.kind in ROUND and math.isnan(self.radius_mm))
        ):
            return math.nan
        return float(self.values[self.names.index("depth_mm")])

    def __repr__(self) -> str:
        if self.solid is None:
            return f"<SolidFit: {self.status}>"
        force = "force not told" if math.isnan(self.force_n) else f"{self.force_n:.4g} N"
        area = f"{self.area_mm2:.4g} +- {figures(self.area_sigma_mm2)} mm2"
        return f"<SolidFit: {self.status}, {self.solid.kind}, {area}, {force}>"

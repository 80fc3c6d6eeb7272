"""Reconstruction on a curved skin: by the methods for flat sensors, where strips are even, then laid on the skin.

A strip of any width reads as an even one of which y is L s (`sensor.resistance`). A method for flat sensors is given
that sensor; what it finds is brought back to (x, y) on the skin, in strip coordinates, and into space. An edge that is
straight on the even sensor is taken for the edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ContactError, OptionError
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.implausible import doubted, goes_on
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.reconstruction.seam import BRIDGED, rounds
from tacstrip.scan import Scan
from tacstrip.sensor.resistance import electrical_slopes, ends_from_electrical
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import skin_of

_COLUMNS, _ROWS = 96, 12  # of the quadrature
_STEP = 1e-4  # of the sensor's size, for differences


@dataclass(frozen=True, eq=False)
class OnSkin:
    """An outline on a curved skin, in space.

    Attributes
    ----------
    outline_xyz
        The outline (N, 3) [mm].
    area_mm2
        Of the skin within it.
    centroid_xyz
        Mean of the skin's points within it (3,) [mm], which on a curved skin is a little inside.
    normal
        Mean normal of the skin within it, a unit vector (3,): which way the object lies.
    area_deviation_mm2
        Standard deviation of the area; NaN where the method has none.
    """

    outline_xyz: FloatArray
    area_mm2: float
    centroid_xyz: FloatArray
    normal: FloatArray
    area_deviation_mm2: float = float("nan")


def refuse_stretched(sensor: Sensor, what: str) -> None:
    """Refuse `what`, which moves a flat outline, for a skin on which outlines change where they move: `OptionError`."""
    if sensor.surface is not None and not sensor.surface.isometric:
        raise OptionError(
            f"{what} moves a flat outline, and a {sensor.surface.kind} does not unroll to a rectangle: follow a solid "
            "that is pressed into it by ts.track_solid, or ts.fit_solid in one scan"
        )


def refuse_surface(sensor: Sensor, what: str, instead: str) -> None:
    """Refuse `what`, the start of the message, for a sensor with a `[surface]`: `OptionError`."""
    if sensor.surface is not None:
        raise OptionError(f"{what} cannot take a sensor with a [surface] yet: {instead}")


def on_surface(
    scan: Scan, sensor: Sensor, method: Callable[[Scan, Sensor], Reconstruction]
) -> Reconstruction:
    """Reconstruct on the even, flat sensor that reads the same, and bring the result to the skin."""
    surface = sensor.surface
    assert surface is not None
    scan = scan.checked(sensor)
    n = sensor.strips
    even = replace(sensor, surface=None, contact_lambda_mm=0.0, strip_width_mm=None, calibration=None)
    if sensor.closed:
        named = [name.partition(":") for name in sensor.without]
        again = (f"{int(strip) + n}{colon}{channel}" for strip, colon, channel in named)
        scan, even = rounds(scan, BRIDGED), replace(even, strips=2 * n, without=(*sensor.without, *again))
    found = method(scan, even)
    objects = [_doubted(o, even, sensor) for o in found.objects] if sensor.closed else found.objects
    return replace(found, objects=tuple(_laid(sensor, o) for o in objects))


def _doubted(found: RecoveredObject, even: Sensor, sensor: Sensor) -> RecoveredObject:
    """Return an object of the even sensor, doubted for what is left out beside it round the whole tube."""
    laid_out, around = (goes_on(found.vertices, found.strips, of) for of in (even, sensor))
    if not around:
        return found
    told = found.advice.replace(laid_out, around) if laid_out else found.advice
    status, advice = doubted(found.status, told, around)
    return replace(found, status=status, advice=advice, confidence=None)


@dataclass(frozen=True, eq=False)
class _Chart:
    """An outline on the even sensor, and its way to the skin."""

    sensor: Sensor
    outline: Outline

    def back(self, x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return l and u [mm] on the skin at x."""
        return ends_from_electrical(self.sensor, low, high, x)

    @cached_property
    def _columns(self) -> tuple[FloatArray, FloatArray]:
        """Places and weights of the quadrature across the outline, between its corners."""
        x = np.unique(self.outline.vertices[:, 0])
        count = max(_COLUMNS // max(len(x) - 1, 1), 4)
        node, weight = np.polynomial.legendre.leggauss(count)
        half, middle = 0.5 * np.diff(x)[:, None], 0.5 * (x[1:] + x[:-1])[:, None]
        return (middle + half * node).ravel(), (half * weight).ravel()

    def moments(self) -> tuple[float, FloatArray, FloatArray]:
        """Return area, sum of points and sum of normals over the area."""
        skin, (x, by_x) = skin_of(self.sensor), self._columns
        l, u = self.back(x, *self.outline.ends(x))
        node, weight = np.polynomial.legendre.leggauss(_ROWS)
        y = 0.5 * (l + u)[:, None] + 0.5 * (u - l)[:, None] * node
        across, up = skin.places((x / skin.pitch_mm - 0.5)[:, None], y)
        area = by_x[:, None] * 0.5 * (u - l)[:, None] * weight
        if self.sensor.surface is not None and self.sensor.surface.along == "meridians":
            area = area * skin.stretch(up) * self.sensor.surface.around / (skin.strips * skin.pitch_mm)
        points, normals = skin.points(across, up), skin.normals(across, up)
        return float(area.sum()), *(np.einsum("ij,ijk->k", area, p) for p in (points, normals))

    def ring(self) -> FloatArray:
        """Return the outline in space (N, 3) [mm]."""
        skin = skin_of(self.sensor)
        first, last = self.outline.lower[[0, -1], 0]
        x = np.union1d(np.linspace(first, last, _COLUMNS), self.outline.vertices[:, 0])
        l, u = self.back(x, *self.outline.ends(x))
        strip = x / skin.pitch_mm - 0.5
        ring = [skin.points(*skin.places(strip, y)) for y in (l, u)]
        return np.concatenate([ring[0], ring[1][::-1], ring[0][:1]])


def _laid(sensor: Sensor, found: RecoveredObject) -> RecoveredObject:
    """Return an object of the even sensor on the skin."""
    changed: dict[str, Any] = {"alternatives": (), "guarantee": None, "model": None}
    if found.profile is not None:
        x, low, high = found.profile
        changed["profile"] = (x, *ends_from_electrical(sensor, low, high, x))
    if len(found.points):
        x, y = found.points.T
        changed["points"] = np.stack([x, ends_from_electrical(sensor, y, y, x)[0]], axis=1)
        changed["point_deviations"] = np.full_like(found.points, np.nan)
    if not found.found:
        return replace(found, **changed)
    try:
        outline = Outline.of(found.vertices)
    except ContactError:  # a curve of many points may be too steep for chains
        return replace(found, **changed, vertices=np.empty((0, 2)), covariance=None, status="doubtful",
                       advice="the outline is no function of the strip; see `profile`, or press elsewhere")  # fmt: skip
    chart = _Chart(sensor, outline)
    changed |= _corners(chart, found)
    area, point, normal = chart.moments()
    deviation = float("nan")
    if found.covariance is not None:
        slopes = _area_slopes(chart, found.vertices, area)
        known = np.nan_to_num(found.covariance, nan=0.0, posinf=0.0)
        deviation = math.sqrt(max(float(slopes @ known @ slopes), 0.0))
    changed["on_skin"] = OnSkin(
        chart.ring(), area, point / max(area, 1e-300), normal / np.linalg.norm(normal), deviation
    )
    return replace(found, **changed)


def _corners(chart: _Chart, found: RecoveredObject) -> dict[str, Any]:
    """Return vertices and covariance in strip coordinates on the skin."""
    x, y = found.vertices.T
    low, high = chart.outline.ends(x)
    l, u = chart.back(x, low, high)
    upper = np.abs(y - high) < np.abs(y - low)
    slopes = electrical_slopes(chart.sensor, l, u, x)
    slope = np.where(upper, slopes[1, 1], slopes[0, 0])
    by = np.ones(2 * len(x))
    by[1::2] = 1.0 / np.maximum(slope, 1e-9)
    vertices = np.stack([x, np.where(upper, u, l)], axis=1)
    covariance = None if found.covariance is None else found.covariance * by[:, None] * by
    return {"vertices": vertices, "covariance": covariance}


def _area_slopes(chart: _Chart, vertices: FloatArray, area: float) -> FloatArray:
    """Return the slopes of the area by `vertices.ravel()` on the even sensor; 0 where differences find none."""
    step = _STEP * chart.sensor.length_mm
    slopes = np.zeros(vertices.size)
    for i in range(vertices.size):
        moved = vertices.ravel().copy()
        moved[i] += step
        try:
            slopes[i] = (_Chart(chart.sensor, Outline.of(moved.reshape(-1, 2))).moments()[0] - area) / step
        except ContactError:
            continue
    return slopes

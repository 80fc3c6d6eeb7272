"""The skin in space: points and normals at (strip, y), and the whole of it with what no strip covers.

A plane, a bent sheet or a surface of revolution about z is a map of two coordinates, `across` and `up`: square to the
strips and along them [mm] on planes and sheets, else the angle [rad] round the axis and the arc [mm] of the meridian, 0
where the strips begin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.sensor.spec import Sensor
from tacstrip.sensor.surface import STIFFNESS, THICKNESS_MM, Surface


@dataclass(frozen=True, eq=False)
class Skin:
    """A sensor's skin in space.

    Attributes
    ----------
    surface
        The surface of revolution or sheet; None: a plane.
    strips, pitch_mm, length_mm
        As in the spec.
    across, up
        Extent of the whole skin in both coordinates.
    thickness_mm, stiffness_n_per_mm3
        How deep objects can sink in, and what pressure a depth makes.
    """

    surface: Surface | None
    strips: int
    pitch_mm: float
    length_mm: float
    across: tuple[float, float]
    up: tuple[float, float]
    thickness_mm: float = THICKNESS_MM
    stiffness_n_per_mm3: float = STIFFNESS

    @property
    def round(self) -> bool:
        """Whether `across` is an angle and the skin goes all round."""
        return self.surface is not None and self.surface.kind != "sheet"

    @property
    def lengths_mm(self) -> FloatArray:
        """Every strip's length (strips,) [mm]."""
        if self.surface is None:
            return np.full(self.strips, self.length_mm)
        return self.surface.lengths_mm(self.strips)

    def places(self, strip: FloatArray, y_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `across` and `up` of strip coordinates (0 is the first centre line) and y [mm] along the strip."""
        strip, y = np.asarray(strip, dtype=float), np.asarray(y_mm, dtype=float)
        if self.surface is None or not self.round:
            return (strip + 0.5) * self.pitch_mm, y
        if self.surface.along == "meridians":
            return (strip + 0.5) * self.surface.around / self.strips, y
        up = (strip + 0.5) * self.surface.meridian_mm / self.strips
        return y / self.surface.meridian(up)[0], up

    def strip_places(self, across: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return strip coordinate and y [mm] of places, the inverse of `places`."""
        if self.surface is None or not self.round:
            return across / self.pitch_mm - 0.5, up
        middle = 0.5 * self.surface.around
        angle = middle + np.remainder(across - middle + np.pi, 2.0 * np.pi) - np.pi
        if self.surface.along == "meridians":
            return angle * self.strips / self.surface.around - 0.5, up
        return up * self.strips / self.surface.meridian_mm - 0.5, angle * self.surface.meridian(up)[0]

    def points(self, across: FloatArray, up: FloatArray) -> FloatArray:
        """Return points (..., 3) [mm] at places."""
        if self.surface is None:
            return _vectors(across, up, 0.0)
        if not self.round:
            along, z = (up, across) if self.surface.along == "path" else (across, up)
            x, y, _, _ = self.surface.path(along)
            return _vectors(*np.broadcast_arrays(x, y, z))
        r, z, _, _ = self.surface.meridian(up)
        return _vectors(r * np.cos(across), r * np.sin(across), z)

    def normals(self, across: FloatArray, up: FloatArray) -> FloatArray:
        """Return unit normals (..., 3) off the skin at places."""
        if self.surface is None:
            return np.broadcast_to([0.0, 0.0, 1.0], (*np.broadcast_shapes(across.shape, up.shape), 3))
        if not self.round:
            path = self.surface.along == "path"
            _, _, dx, dy = self.surface.path(up if path else across)
            side = np.full(np.broadcast_shapes(across.shape, up.shape), -1.0 if self.surface.inside else 1.0)
            return _vectors(side * dy, -side * dx, 0.0)
        _, _, dr, dz = self.surface.meridian(up)
        out = -self.surface.outward * dz
        return _vectors(out * np.cos(across), out * np.sin(across), self.surface.outward * dr)

    def stretch(self, up: FloatArray) -> FloatArray:
        """Return mm per unit of `across` at `up`: the radius; area is stretch d(across) d(up)."""
        return np.ones_like(up) if self.surface is None or not self.round else self.surface.meridian(up)[0]

    def places_near(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `across` and `up` of points (..., 3) on or near the skin, along the normal where it is smooth."""
        if self.surface is None:
            return points[..., 0], points[..., 1]
        if not self.round:
            return self._sheet_near(points)
        across = np.arctan2(points[..., 1], points[..., 0])
        r, z = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
        low, high = self.up
        grid = np.linspace(low, high, 721)
        gr, gz, _, _ = self.surface.meridian(grid)
        up = grid[np.argmin((r[..., None] - gr) ** 2 + (z[..., None] - gz) ** 2, axis=-1)]
        for _ in range(3):  # foot of the perpendicular
            mr, mz, dr, dz = self.surface.meridian(up)
            up = np.clip(up + (r - mr) * dr + (z - mz) * dz, low, high)
        return across, up

    def unrolled(self, points: FloatArray) -> FloatArray:
        """Return x, strip times pitch, and y of a line of points (N, 3); NaN where it crosses the seam."""
        strip, y = self.strip_places(*self.places_near(points))
        jump = np.flatnonzero(np.abs(np.diff(strip)) > 0.5 * self.strips)
        return np.insert(np.stack([(strip + 0.5) * self.pitch_mm, y], axis=1), jump + 1, np.nan, axis=0)

    def _sheet_near(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        surface = self.surface
        assert surface is not None
        x, y, length = points[..., 0], points[..., 1], surface.path_length_mm
        grid = np.linspace(0.0, length, 721)
        gx, gy, _, _ = surface.path(grid)
        t = grid[np.argmin((x[..., None] - gx) ** 2 + (y[..., None] - gy) ** 2, axis=-1)]
        for _ in range(3):  # foot of the perpendicular
            px, py, dx, dy = surface.path(t)
            t = np.clip(t + (x - px) * dx + (y - py) * dy, 0.0, length)
        return (points[..., 2], t) if surface.along == "path" else (t, points[..., 2])


def _vectors(x: FloatArray, y: FloatArray, z: FloatArray | float) -> FloatArray:
    """Return vectors (..., 3), in memory components first, as solids take them."""
    found = np.empty((3, *np.broadcast_shapes(x.shape, y.shape, np.shape(z))))
    found[0], found[1], found[2] = x, y, z
    return found.transpose(*range(1, found.ndim), 0)


@lru_cache(maxsize=16)
def _made(surface: Surface | None, strips: int, pitch_mm: float, length_mm: float) -> Skin:
    if surface is None:
        return Skin(None, strips, pitch_mm, length_mm, (0.0, strips * pitch_mm), (0.0, length_mm))
    if surface.kind == "sheet":
        return Skin(
            surface, strips, pitch_mm, length_mm, (0.0, strips * pitch_mm), (0.0, length_mm),
            surface.thickness_mm, surface.stiffness_n_per_mm3,
        )  # fmt: skip
    low = -surface.lead_mm
    return Skin(
        surface, strips, pitch_mm, length_mm, (0.0, 2.0 * math.pi), (low, surface.meridian_mm),
        surface.thickness_mm, surface.stiffness_n_per_mm3,
    )  # fmt: skip


def skin_of(sensor: Sensor) -> Skin:
    """Return the skin of a sensor: of its `[surface]`, its tube, or a plane."""
    surface = sensor.surface
    if surface is None and sensor.radius_mm is not None:
        around = min(math.degrees(sensor.width_mm / sensor.radius_mm), 360.0)
        surface = Surface(
            kind="cylinder", radius_mm=sensor.radius_mm, height_mm=sensor.length_mm, around_deg=around,
            thickness_mm=min(THICKNESS_MM, 0.5 * sensor.radius_mm),
        )  # fmt: skip
    return _made(surface, sensor.strips, sensor.pitch_mm, sensor.length_mm)

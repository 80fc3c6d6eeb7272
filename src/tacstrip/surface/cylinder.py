"""From (strip, y) on the sensor to a point in space and back; how much of a tube a flat object touches.

A plane sensor lies in z = 0. A tube's axis is z, its grounded rim lies in z = 0, and strip 0's outer
edge is at angle 0, so that strip i is at the angle (i + 0.5) pitch / radius.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.errors import SpecError
from tacstrip.sensor.spec import Sensor


def strip_angle(sensor: Sensor, strip: FloatArray) -> FloatArray:
    """Return the angle [rad] round the tube of strip coordinates (0 is the first strip's centre line)."""
    return np.asarray((np.asarray(strip, dtype=float) + 0.5) * sensor.pitch_mm / tube_radius(sensor))


@takes(sensor=Sensor)
def to_cartesian(sensor: Sensor, strip: FloatArray, y_mm: FloatArray) -> FloatArray:
    """Return points (..., 3) [mm] for strip coordinates and positions y along the strip, any shapes."""
    strip, y = np.broadcast_arrays(np.asarray(strip, dtype=float), np.asarray(y_mm, dtype=float))
    if not sensor.kind.cylindrical:
        return np.stack([(strip + 0.5) * sensor.pitch_mm, y, np.zeros_like(y)], axis=-1)
    radius, angle = tube_radius(sensor), strip_angle(sensor, strip)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), y], axis=-1)


@takes(sensor=Sensor)
def from_cartesian(sensor: Sensor, points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return strip coordinates and y [mm] of points (..., 3) [mm], the inverse of `to_cartesian`.

    A point off the surface is taken along the normal. The seam of a tube lies opposite its strips.
    """
    points = np.asarray(points_mm, dtype=float)  # (..., 3)
    if not sensor.kind.cylindrical:
        return np.asarray(points[..., 0] / sensor.pitch_mm - 0.5), points[..., 1]
    middle = 0.5 * sensor.width_mm / tube_radius(sensor)
    angle = np.arctan2(points[..., 1], points[..., 0])
    angle = middle + np.remainder(angle - middle + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(angle * tube_radius(sensor) / sensor.pitch_mm - 0.5), points[..., 2]


def strips_under_flat(sensor: Sensor, depth_mm: float) -> tuple[int, int]:
    """Return the fewest and the most strips of a tube that a flat object can touch: figure 3.10.

    For an object that lies over the strips, away from the outermost ones; off them it touches fewer.

    Parameters
    ----------
    sensor
        A sensor round a tube.
    depth_mm
        How far the flat object sinks in [mm]: the give of rubber and mesh. It then covers the arc whose
        half-angle is acos(1 - depth / radius), and touches each strip that the arc meets.

    Raises
    ------
    SpecError
        The sensor is flat, or the depth is not between 0 and the radius.
    """
    radius = tube_radius(sensor)
    if not 0.0 <= depth_mm <= radius:
        raise SpecError(f"depth_mm = {depth_mm}: must lie between 0 and the radius, {radius} mm")
    arc = 2.0 * radius * np.arccos(1.0 - depth_mm / radius)
    reach = (arc + sensor.strip_width) / sensor.pitch_mm + 1e-12  # in pitches, strips' own width included
    return min(int(reach), sensor.strips), min(int(reach) + 1, sensor.strips)


def tube_radius(sensor: Sensor) -> float:
    """Return the radius [mm], or raise `SpecError` where the sensor is flat."""
    if sensor.radius_mm is None:
        raise SpecError(f"a {sensor.construction} sensor is flat and has no radius_mm; use cyl-crs-m")
    return sensor.radius_mm

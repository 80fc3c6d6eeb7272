"""Frames as JSON for the page, rounded to what a screen can show."""

from __future__ import annotations

from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.geometry.region import regions
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.frame import Frame
from tacstrip.tracking.tracker import LiveObject

_REGION_POINTS = 20
_MAX_REGIONS = 20  # an outline of more vertices is drawn without regions


def sensor_json(sensor: Sensor) -> dict[str, Any]:
    """Return the sensor's properties that the page needs."""
    return {
        "construction": sensor.construction,
        "strips": sensor.strips,
        "strip_base": sensor.strip_base,
        "pitch_mm": sensor.pitch_mm,
        "length_mm": sensor.length_mm,
        "adc_bits": sensor.adc_bits,
        "closed": sensor.closed,
        "signatures": list(sensor.signatures),
    }


def frame_json(frame: Frame) -> dict[str, Any]:
    """Return a frame's readings over Vref, null where nothing touches, and its objects [mm]."""
    return {
        "number": frame.number,
        "time_s": round(frame.raw.time_s, 6),
        "readings": {name: _numbers(frame.scan[name], 5) for name in frame.scan.signatures},
        "objects": [_object(one, frame.sensor) for one in frame.objects],
    }


def _object(one: LiveObject, sensor: Sensor) -> dict[str, Any]:
    shape = one.shape
    told: dict[str, Any] = {"id": one.id, "status": shape.status, "advice": shape.advice}
    told["vertices"] = np.round(shape.vertices, 3).tolist()
    if shape.found:
        told["area"], told["centroid"] = round(shape.area, 2), _numbers(shape.centroid, 2)
        told["regions"] = _regions(shape.vertices, shape.covariance)
    if shape.profile is not None:
        told["profile"] = [_numbers(np.asarray(values), 3) for values in shape.profile]
    return told


def _regions(vertices: FloatArray, covariance: FloatArray | None) -> list[list[list[float]]]:
    if len(vertices) > _MAX_REGIONS:
        return []
    every = regions(vertices, covariance)
    return [np.round(region[:: max(1, len(region) // _REGION_POINTS)], 3).tolist() for region in every]


def _numbers(values: FloatArray, digits: int) -> list[float | None]:
    return [None if value != value else value for value in np.round(values, digits).tolist()]

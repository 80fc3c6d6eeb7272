"""Frames as JSON for the page, rounded to what a screen can show."""

from __future__ import annotations

from typing import Any

import numpy as np

from tacstrip.arrays import plain
from tacstrip.geometry.pose import placed
from tacstrip.geometry.region import coarse_regions
from tacstrip.sensor.layers import AnySensor, Layer, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.frame import Frame
from tacstrip.tracking.live_contact import LiveTrack
from tacstrip.tracking.tracker import LiveObject
from tacstrip.view.solids import KINDS, skin_json


def sensor_json(sensor: AnySensor) -> dict[str, Any]:
    """Return the sensor's properties that the page needs: of each layer its corners (4, 2) [mm], too."""
    unit, curved = unit_of(sensor), isinstance(sensor, Sensor) and sensor.surface is not None
    keys = ("construction", "strips", "strip_base", "adc_bits", "closed", "signatures")
    about = {key: getattr(unit, key) for key in keys}
    layers = sensor.layers if isinstance(sensor, LayeredSensor) else (Layer(sensor=sensor),)
    about["layers"] = [
        {key: getattr(one.sensor, key) for key in ("strips", "pitch_mm", "length_mm")}
        | {"corners": plain(one.corners_mm, 4)}
        for one in layers
    ]
    return about | {"skin": skin_json(unit), "presses": KINDS if curved else None}


def frame_json(frame: Frame) -> dict[str, Any]:
    """Return a frame's readings over Vref, null where nothing touches, its objects and those over time [mm].

    `tracks` is null where those over time are not known.
    """
    return {
        "number": frame.number,
        "time_s": round(frame.raw.time_s, 6),
        "readings": {name: plain(frame.scan[name], 5) for name in frame.scan.signatures},
        "objects": [_object(one, frame.sensor) for one in frame.objects],
        "tracks": None if frame.tracks is None else [_track(one) for one in frame.tracks],
        "searching": frame.searching,
    }


def _track(one: LiveTrack) -> dict[str, Any]:
    """Return an object over time: its outline where it lies, how far its least known corner may be off, and others."""
    there = np.isfinite(one.pose).all()
    return {
        "id": one.id,
        "status": one.status,
        "advice": one.advice,
        "scans": one.scans,
        "corners": len(one.outline),
        "vertices": plain(one.placed, 3) if there else [],
        "alternatives": [
            {"weight": round(a.weight, 3), "vertices": plain(placed(a.vertices, one.pose), 3)}
            for a in one.alternatives
            if there
        ],
        "deviation_mm": plain(one.corner_deviation_mm),
    }


def _object(one: LiveObject, sensor: Sensor) -> dict[str, Any]:
    shape = one.shape
    drawn: dict[str, Any] = {"id": one.id, "status": shape.status, "advice": shape.advice}
    if shape.confidence is not None:
        drawn["confidence"] = round(shape.confidence, 3)
    if shape.alternatives:
        drawn["alternatives"] = [
            {"weight": round(a.weight, 3), "vertices": plain(a.vertices, 3)}
            | ({"others": [plain(outline, 3) for outline in a.others]} if a.others else {})
            for a in shape.alternatives
        ]
    edges = shape.hidden_edges
    if edges is None and shape.hidden is not None:  # of two layers: those that end where no reading tells
        edges = shape.hidden | np.roll(shape.hidden, -1)
    if edges is not None and edges.any():
        drawn["hidden_edges"] = edges.tolist()
    if shape.bounds is not None:
        drawn["bounds"] = [plain(bound, 3) for bound in shape.bounds]
    drawn["vertices"] = plain(shape.vertices, 3)
    if shape.found:
        area = shape.area if shape.on_skin is None else shape.on_skin.area_mm2
        drawn["outlined"] = shape.outlined
        drawn["area"], drawn["centroid"] = round(area, 2), plain(shape.centroid, 2)
        drawn["regions"] = [plain(region, 3) for region in coarse_regions(shape.vertices, shape.covariance)]
    if shape.profile is not None:
        drawn["profile"] = plain(shape.profile, 3)
    return drawn

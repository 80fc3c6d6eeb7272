"""A layout for Foxglove and Lichtblick: the sensor from above, its signatures, areas, health and log."""

from __future__ import annotations

import json
from typing import Any

from tacstrip.sensor.spec import Sensor

_FOVY_DEG = 45.0


def layout_text(sensor: Sensor) -> str:
    """Return the text of a layout file for a sensor."""
    scene, signatures, log = "3D!sensor", "Plot!signatures", "RosOut!log"
    areas, health = "Plot!areas", "Plot!health"
    width_m, length_m = 1e-3 * sensor.width_mm, 1e-3 * sensor.length_mm
    topics = {f"/tacstrip/{name}": {"visible": True} for name in ("sensor", "objects", "tracks", "regions")}
    size_m = max(width_m, length_m)
    panels: dict[str, Any] = {
        scene: {
            "cameraState": {
                "perspective": False, "distance": 1.6 * size_m, "phi": 0, "thetaOffset": 0, "fovy": _FOVY_DEG,
                "targetOffset": [0.5 * width_m, 0.5 * length_m, 0], "target": [0, 0, 0],
                "targetOrientation": [0, 0, 0, 1], "near": 0.01 * size_m, "far": 100.0 * size_m,
            },
            "followMode": "follow-pose", "followTf": "tacstrip", "scene": {}, "transforms": {}, "topics": topics,
            "layers": {}, "publish": {}, "imageMode": {},
        },
        signatures: {
            **_plot({name: f"/tacstrip/signatures.{name}[:]" for name in sensor.signatures}),
            "xAxisVal": "currentCustom", "xAxisPath": {"value": "/tacstrip/signatures.x_mm[:]", "enabled": True},
            "minYValue": 0, "maxYValue": 1,
        },
        areas: _plot({f"area of object {i + 1} [mm²]": f"/tacstrip/shapes.objects[{i}].area_mm2" for i in range(2)}),
        health: _plot({
            "scans/s": "/tacstrip/health.rate_hz", "latency, 99 % [ms]": "/tacstrip/health.latency_p99_ms",
            "lost": "/tacstrip/health.lost", "missed by viewers": "/tacstrip/health.dropped",
        }),
        log: {"searchTerms": [], "minLogLevel": 1, "topicToRender": "/tacstrip/log"},
    }  # fmt: skip
    plots = {"first": areas, "second": health, "direction": "column"}
    below = {"first": plots, "second": log, "direction": "column", "splitPercentage": 66}
    side = {"first": signatures, "second": below, "direction": "column", "splitPercentage": 34}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": scene, "second": side, "direction": "row", "splitPercentage": 55},
    }
    return json.dumps(layout, indent=1, ensure_ascii=False) + "\n"


def _plot(paths: dict[str, str]) -> dict[str, Any]:
    """Return the settings of a plot over time of these message paths, by their labels."""
    return {
        "paths": [
            {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime", "showLine": True}
            for label, path in paths.items()
        ],
        "xAxisVal": "timestamp", "isSynced": False, "showLegend": True, "legendDisplay": "floating",
        "showPlotValuesInLegend": True, "showXAxisLabels": True, "showYAxisLabels": True, "sidebarDimension": 240,
        "followingViewWidth": 30,
    }  # fmt: skip

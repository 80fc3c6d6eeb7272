"""Tracks as GeoJSON, a Feature per object with its poses over time, and as a table, a row per object and scan."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray, plain
from tacstrip.files import write_text
from tacstrip.tracking.result import Track


def track_collection(tracks: Sequence[Track]) -> dict[str, Any]:
    """Return tracks as a GeoJSON FeatureCollection [mm], a Feature per object.

    Parameters
    ----------
    tracks
        Of one recording, as `tacstrip.track` returns them.

    Returns
    -------
    dict
        The geometry is the outline on the sensor in the first scan that shows it, null where there is none. Properties:
        id, status, advice, area_mm2 and its sigma, outline_mm in the object's frame, vertex_sigma_mm, unseen_corner_mm,
        alternatives, motion, offsets over Vref, and poses: of every scan that shows it scan, time_s, x_mm, y_mm,
        angle_rad and their sigmas, centroid_mm of the outline on the sensor, and velocity; where no rigid outline
        explains the scans also `outline_mm` of that scan by itself.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.tracking.geojson import track_collection
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)])
    >>> scans = [ts.simulate(sensor, shape.turned(0.05 * i).placed(50, 50), time_s=0.01 * i) for i in range(12)]
    >>> (feature,) = track_collection(ts.track(scans, sensor))["features"]
    >>> feature["geometry"]["type"], len(feature["properties"]["poses"])
    ('Polygon', 12)
    """
    return {"type": "FeatureCollection", "features": [_feature(track) for track in tracks]}


def write_tracks(path: str | Path, tracks: Sequence[Track]) -> None:
    """Write tracks to a GeoJSON file, as `track_collection` has them."""
    write_text(path, json.dumps(track_collection(tracks), indent=1, allow_nan=False) + "\n")


def track_records(tracks: Sequence[Track]) -> list[dict[str, Any]]:
    """Return a record per object and scan that shows it, as `pandas.DataFrame(records)` takes them.

    Keys: scan, time_s, object (its id), status, corners, area_mm2, x_mm, y_mm and angle_rad of the pose, each with its
    standard deviation (area_sigma_mm2, x_sigma_mm, ...), and centroid_x_mm, centroid_y_mm; None where nothing is known.
    """
    records = []
    for track, feature in zip(tracks, track_collection(tracks)["features"], strict=True):
        about = feature["properties"]
        for pose in about["poses"]:
            record = {
                "scan": pose["scan"],
                "time_s": pose["time_s"],
                "object": track.id,
                "status": track.status,
            }
            record |= {"corners": len(track.outline)}
            record |= {key: about[key] for key in ("area_mm2", "area_sigma_mm2")}
            for name in ("x_mm", "y_mm", "angle_rad"):
                what, unit = name.split("_")
                record |= {name: pose[name], f"{what}_sigma_{unit}": pose["sigma"][name]}
            record["centroid_x_mm"], record["centroid_y_mm"] = pose["centroid_mm"]
            records.append(record)
    return sorted(records, key=lambda record: record["scan"])


def _feature(track: Track) -> dict[str, Any]:
    seen, geometry = np.flatnonzero(track.present), None
    if len(track.outline) and len(seen):
        first = track.placed(int(seen[0]))
        geometry = {"type": "Polygon", "coordinates": [plain([*first, first[0]], 9)]}
    centroids = track.centroids
    sigma = None if track.covariance is None else np.sqrt(np.diag(track.covariance)).reshape(-1, 2)
    properties = {
        "id": track.id,
        "status": track.status,
        "advice": track.advice,
        "kind": track.kind,
        "area_mm2": plain(track.area_mm2),
        "area_sigma_mm2": plain(track.area_deviation_mm2),
        "outline_mm": plain(track.outline, 9),
        "vertex_sigma_mm": None if sigma is None else plain(sigma),
        "unseen_corner_mm": plain(track.unseen_corner_mm),
        "alternatives": [
            {"weight": plain(a.weight), "vertices_mm": plain(a.vertices)} for a in track.alternatives
        ],
        "joint_scans": list(track.joint),
        "motion": track.motion,
        "offsets": {name: plain(values) for name, values in track.offsets.items()},
        "poses": [_pose(track, int(i), centroids[i]) for i in seen],
    }
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _pose(track: Track, scan: int, centroid: FloatArray) -> dict[str, Any]:
    names = ("x_mm", "y_mm", "angle_rad")
    sigma = np.sqrt(np.diag(track.pose_covariances[scan]))
    found: dict[str, Any] = {"scan": scan, "time_s": plain(track.times_s[scan])}
    found |= dict(zip(names, plain(track.poses[scan], 9), strict=True))
    found["sigma"] = dict(zip(names, plain(sigma), strict=True))
    found["centroid_mm"] = plain(centroid, 9)
    if track.by_scan is not None:
        found["outline_mm"] = plain(track.placed(scan), 9)
    return found | {"velocity": plain(track.velocities[scan])}

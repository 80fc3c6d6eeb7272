"""Reconstructions as a table: a row per object and scan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import plain
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError
from tacstrip.geometry.metrics import Mismatch, mismatch
from tacstrip.io.csv_rows import csv_writer
from tacstrip.io.geojson import feature_collection
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject

_NONE: tuple[None, None] = (None, None)


@takes(results=(Reconstruction,))
def object_records(
    results: Sequence[Reconstruction], truth: Contact | None = None, *, around_mm: float | None = None
) -> list[dict[str, Any]]:
    """Return a record per object and scan, as `pandas.DataFrame(records)` takes them.

    Parameters
    ----------
    results
        Reconstructions of successive scans.
    truth
        What touched, if it is known: each object is compared with the polygon of it that is nearest.
    around_mm
        Circumference of a closed tube (`sensor.width_mm`), for `truth` across its seam.

    Returns
    -------
    list of dict
        All with the same keys: scan (the place in `results`), time_s, object (from 1, left to right), method, status,
        confidence, kind (of the outline), corners (how many, of a polygon), area_mm2, centroid_x_mm, centroid_y_mm and
        orientation_rad (of the longer principal axis, from x), each with its standard deviation (area_sigma_mm2, ...);
        of a known object (`tacstrip.fit_object`) also angle_rad, by which it is turned, with angle_sigma_rad; with
        `truth` also iou.
        None where nothing is known, as in GeoJSON; a scan without contact has one record, and an object without a
        shape an iou of 0.

    Raises
    ------
    ContactError
        `truth` holds no polygon.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
    >>> scans = [ts.simulate(sensor, contact.moved(0.0, y), time_s=y) for y in (0.0, 5.0)]
    >>> records = ts.object_records(ts.fit_polygons(scans, sensor), contact)
    >>> [(r["scan"], r["object"], r["corners"], round(r["iou"], 2)) for r in records]
    [(0, 1, 4, 1.0), (1, 1, 4, 0.76)]
    """
    posed = any(o.pose is not None for result in results for o in result.objects)
    features = iter(feature_collection(results)["features"])
    records = []
    for result in results:
        for number, found in enumerate(result.objects or (None,), 1):
            record = _record(next(features)["properties"], found, number, posed)
            if truth is not None:
                record["iou"] = 0.0
                if found is not None and found.found:
                    record["iou"] = nearest_mismatch(found, truth, around_mm).iou
            records.append(record)
    return records


def nearest_mismatch(found: RecoveredObject, truth: Contact, around_mm: float | None = None) -> Mismatch:
    """Compare a shape with the polygon of a contact whose centroid is nearest to its own.

    Raises
    ------
    ContactError
        The contact holds no polygon.
    """
    polygons = [Contact((shape,)) for shape in truth.shapes if shape.area > 0.0]
    if not polygons:
        raise ContactError("holds no polygon to compare with; a line or a point has no outline")
    near = min(polygons, key=lambda c: float(np.hypot(*(c.centroid - found.centroid))))
    return mismatch(near.vertices, found.vertices, around_mm=around_mm)


def write_table(path: str | Path, records: Sequence[dict[str, Any]]) -> None:
    """Write records, all with the same keys, to a CSV file; what is not known is an empty field."""
    with csv_writer(path, list(records[0]) if records else ["scan"]) as out:
        out.writerows(record.values() for record in records)


def _record(about: dict[str, Any], found: RecoveredObject | None, number: int, posed: bool) -> dict[str, Any]:
    """Return a record from a Feature's properties."""
    x, y = about.get("centroid_mm", _NONE)
    x_sigma, y_sigma = about.get("centroid_sigma_mm", _NONE)
    record = {key: about[key] for key in ("scan", "time_s")}
    record["object"] = None if found is None else number
    record |= {key: about.get(key) for key in ("method", "status", "confidence")}
    record["kind"] = about.get("kind")
    record["corners"] = len(found.vertices) if found is not None and found.kind == "polygon" else None
    record |= {key: about.get(key) for key in ("area_mm2", "area_sigma_mm2")}
    record |= {"centroid_x_mm": x, "centroid_x_sigma_mm": x_sigma}
    record |= {"centroid_y_mm": y, "centroid_y_sigma_mm": y_sigma}
    record |= {key: about.get(key) for key in ("orientation_rad", "orientation_sigma_rad")}
    if posed:
        record["angle_rad"] = about.get("pose", {}).get("angle_rad")
        record["angle_sigma_rad"] = about.get("pose_sigma", {}).get("angle_rad")
    return {k: plain(v, 9) if isinstance(v, float) else v for k, v in record.items()}

"""Contacts from WKT and GeoJSON files; reconstructions to GeoJSON, in mm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import takes
from tacstrip.arrays import plain
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError
from tacstrip.files import read_text, why_unreadable, write_text
from tacstrip.reconstruction.result import Alternative, Pose, Reconstruction, RecoveredObject

_UNKNOWN_MM = 1e4  # no sensor is as large: a deviation beyond it says that nothing is known
_READERS = {".wkt": Contact.from_wkt, ".geojson": Contact.from_geojson, ".json": Contact.from_geojson}


def read_contact(path: str | Path) -> Contact:
    """Read a contact from a file.

    Parameters
    ----------
    path
        A .wkt, .geojson or .json file; coordinates in mm.

    Returns
    -------
    Contact

    Raises
    ------
    ContactError
        The file is missing, is neither kind, or does not hold a usable contact.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "object.wkt"
    >>> _ = file.write_text("POLYGON ((0 0, 20 0, 10 30, 0 0))")
    >>> ts.read_contact(file).vertices.tolist()
    [[0.0, 0.0], [20.0, 0.0], [10.0, 30.0]]
    """
    file = Path(path)
    if file.suffix.lower() not in _READERS:
        raise ContactError(f"{path}: a contact is a file that ends in {', '.join(_READERS)}")
    if why := why_unreadable(path):
        raise ContactError(f"{path}: {why}")
    try:
        text = read_text(file)
    except FileNotFoundError:
        raise ContactError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise ContactError(f"{path}: not a text file in UTF-8; save it as UTF-8") from None
    except (OSError, ValueError) as error:
        raise ContactError(f"{path}: cannot be read ({getattr(error, 'strerror', error)})") from None
    if not text.strip():
        raise ContactError(f"{path}: the file is empty")
    try:
        return _READERS[file.suffix.lower()](text)
    except ContactError as error:
        raise ContactError(f"{path}: {error}") from None


_POSE = ("x_mm", "y_mm", "angle_rad")  # of a known object


@takes(results=(Reconstruction,))
def feature_collection(results: Sequence[Reconstruction]) -> dict[str, Any]:
    """Return reconstructions as a GeoJSON FeatureCollection [mm], a Feature per object.

    Parameters
    ----------
    results
        Reconstructions of successive scans.

    Returns
    -------
    dict
        Without a shape the geometry is null, or for the status "points" a MultiPoint with point_sigma_mm. Round
        a closed tube x goes on beyond the circumference where an object lies across the seam. Properties: scan,
        time_s, method, status, advice, and where there is a shape kind (of the outline, such
        as polygon), area_mm2, centroid_mm and orientation_rad (of
        the longer principal axis, from x). Where the shape has a covariance, standard deviations:
        area_sigma_mm2, centroid_sigma_mm, orientation_sigma_rad, and vertex_sigma_mm, x and y of every vertex;
        null for what the readings do not determine. Where it was assessed, confidence, and alternatives: other
        outlines that explain the readings, each with weight and vertices_mm, and where it is of two objects the
        other's in others_mm. Where channels were not used because they contradict all others, their names in
        faulty. Of pieces: hidden, a truth value per
        corner, hidden_edges, one per edge from each corner to the next, and of those that are hidden in part
        smallest_mm and largest_mm, the outlines between which they lie. Of two layers: hidden, whether no
        reading determines a vertex, and other_scenes_mm, the outlines of other scenes that explain the readings.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.io import feature_collection
    >>> sensor = ts.Sensor.load("prototype-crs-crs")
    >>> contact = ts.Contact.polygon([(10.0, 100.0), (55.0, 100.0), (30.0, 200.0)])
    >>> found = ts.fit_polygon(ts.simulate(sensor, contact), sensor)
    >>> feature = feature_collection([found])["features"][0]
    >>> feature["geometry"]["type"], feature["properties"]["method"]
    ('Polygon', 'polygon')
    """
    features = []
    for scan, result in enumerate(results):
        about: dict[str, Any] = {"scan": scan, "time_s": result.time_s, "method": result.method}
        if result.alternatives:
            about["other_scenes_mm"] = [[plain(ring, 6) for ring in scene] for scene in result.alternatives]
        if not result.objects:
            features.append(_feature(None, about | {"status": result.status, "advice": result.advice}))
        features += [_feature(o, about | {"status": o.status, "advice": o.advice}) for o in result.objects]
    return {"type": "FeatureCollection", "features": features}


@takes(results=(Reconstruction,))
def write_geojson(path: str | Path, results: Sequence[Reconstruction]) -> None:
    """Write reconstructions to a GeoJSON file, as `feature_collection` has them.

    Parameters
    ----------
    path
        The file to write.
    results
        Reconstructions of successive scans.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor.load("prototype-crs-crs")
    >>> scan = ts.simulate(sensor, ts.Contact.polygon([(10.0, 100.0), (55.0, 100.0), (30.0, 200.0)]))
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "result.geojson"
    >>> ts.write_geojson(file, [ts.profile_reconstruction(scan, sensor)])
    """
    text = json.dumps(feature_collection(results), indent=1, allow_nan=False)
    write_text(path, text + "\n")


def _deviation(values: npt.ArrayLike, unknown: float = _UNKNOWN_MM) -> Any:
    """Return standard deviations for JSON, None where they say that nothing is known."""
    array = np.asarray(values, dtype=float)
    return plain(np.where(array < unknown, array, np.inf))


def _feature(recovered: RecoveredObject | None, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = None
    if recovered is not None and recovered.found:
        ring = plain([*recovered.vertices, recovered.vertices[0]], 9)
        geometry = {"type": "Polygon", "coordinates": [ring]}
        properties |= {
            "kind": recovered.kind,
            "area_mm2": recovered.area,
            "centroid_mm": plain(recovered.centroid),
            "orientation_rad": recovered.orientation,
        }
        if recovered.deviations is not None:
            area, centroid, turn = recovered.deviations
            properties |= {
                "area_sigma_mm2": _deviation(area, _UNKNOWN_MM**2),
                "centroid_sigma_mm": _deviation(centroid),
                "orientation_sigma_rad": _deviation(turn, np.pi),
            }
        if recovered.covariance is not None:
            properties["vertex_sigma_mm"] = _deviation(np.sqrt(np.diag(recovered.covariance)).reshape(-1, 2))
        if recovered.confidence is not None:
            properties["confidence"] = round(recovered.confidence, 4)
        if recovered.alternatives or recovered.confidence is not None:
            properties["alternatives"] = [_alternative(a) for a in recovered.alternatives]
        if recovered.faulty:
            properties["faulty"] = list(recovered.faulty)
        if recovered.hidden is not None:
            properties["hidden"] = recovered.hidden.tolist()
        if recovered.hidden_edges is not None:
            properties["hidden_edges"] = recovered.hidden_edges.tolist()
        if recovered.bounds is not None:
            properties["smallest_mm"], properties["largest_mm"] = (plain(b, 6) for b in recovered.bounds)
        if recovered.pose is not None:
            sigma = plain(np.sqrt(np.diag(recovered.pose.covariance)))
            properties["pose"] = _pose(recovered.pose)
            properties["pose_sigma"] = dict(zip(_POSE, sigma, strict=True))
    elif recovered is not None and len(recovered.points):
        geometry = {"type": "MultiPoint", "coordinates": plain(recovered.points, 9)}
        properties["point_sigma_mm"] = plain(recovered.point_deviations)
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _alternative(other: Alternative) -> dict[str, Any]:
    found = {"weight": round(other.weight, 4), "vertices_mm": plain(other.vertices, 6)}
    if other.others:
        found["others_mm"] = [plain(outline, 6) for outline in other.others]
    return found if other.pose is None else found | {"pose": _pose(other.pose)}


def _pose(pose: Pose) -> dict[str, float]:
    return dict(zip(_POSE, (pose.x_mm, pose.y_mm, pose.angle), strict=True))

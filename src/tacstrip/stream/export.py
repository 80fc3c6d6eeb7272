"""Export scans and recorded shapes: CSV, NumPy, GeoJSON, JSON lines."""

from __future__ import annotations

import json
import shlex
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, plain
from tacstrip.errors import RecordingError
from tacstrip.files import replacing, write_text
from tacstrip.io.columns import column_name, electrode_names, seconds
from tacstrip.io.geojson import feature_collection
from tacstrip.io.readings import write_scans
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.layers import unit_of
from tacstrip.stream.codes import ELECTRODES, code_shape, code_type, over_vref, top_code
from tacstrip.stream.replay import Recording
from tacstrip.stream.source import RawScan, Shape, Source, TrackedShape

if TYPE_CHECKING:
    from tacstrip.tracking.live_contact import LiveTrack


def write_csv(path: str | Path, source: Source, codes: bool = False) -> int:
    """Write a source as a readings file, in volts or in A/D codes; return the number of scans.

    Strips that the source marks as untouched get empty fields; those that are untouched by `rest_volt` alone keep
    their readings, and the file's reader decides again.
    """
    sensor, names = source.sensor, source.names
    columns = [column_name(name, codes) for name in names if name != ELECTRODES]
    scale = unit_of(sensor).vref_volt / top_code(sensor)

    def fields(raw: RawScan) -> Iterator[list[str]]:
        rows = np.concatenate([raw.codes[n].reshape(sensor.strips, -1) for n in names], axis=1)
        for touched, row in zip(raw.touched, rows.tolist(), strict=True):
            yield [(str(c) if codes else f"{c * scale:.12g}") if touched else "" for c in row]

    scans = ((seconds(raw.time_s), fields(raw)) for raw in source)
    return write_scans(path, sensor, columns or electrode_names(unit_of(sensor), codes), scans)


def write_npz(path: str | Path, source: Source) -> int:
    """Write a source as NumPy arrays (docs/reference/recording-file.md lists them); return the number of scans."""
    sensor = source.sensor
    codes = {name: bytearray() for name in source.names}
    touched, strip_times = bytearray(), bytearray()
    times: list[float] = []
    arrivals: list[float] = []
    sequences: list[int] = []
    searching: list[int] = []
    shapes: list[tuple[int, Shape]] = []
    reconstructed: list[bool] = []
    tracks: list[tuple[int, TrackedShape]] = []
    for raw in source:
        for name, data in codes.items():
            data += raw.codes[name].tobytes()
        touched += raw.touched.tobytes()
        strip_times += b"" if raw.strip_time_s is None else raw.strip_time_s.tobytes()
        shapes += [(len(times), shape) for shape in raw.shapes or ()]
        reconstructed.append(raw.shapes is not None)
        tracks += [(len(times), track) for track in raw.tracks or ()]
        searching.append(-1 if raw.tracks is None and not raw.searching else raw.searching)
        times.append(raw.time_s)
        arrivals.append(np.nan if raw.arrival_s is None else raw.arrival_s)
        sequences.append(raw.sequence)
    many = len(times)

    def arrays() -> Iterator[tuple[str, npt.ArrayLike]]:
        yield "time_s", np.array(times)
        if not np.isnan(arrivals).all():
            yield "arrival_s", np.array(arrivals)
        yield "sequence", np.array(sequences)
        yield "touched", (mask := np.frombuffer(touched, bool).reshape(many, sensor.strips))
        if len(strip_times) == 8 * mask.size:
            yield "strip_time_s", np.frombuffer(strip_times).reshape(mask.shape)
        blocks = {
            name: np.frombuffer(data, code_type(sensor)).reshape(many, *code_shape(sensor, name))
            for name, data in codes.items()
        }
        yield from ((f"code_{name}", block) for name, block in blocks.items())
        yield from over_vref(blocks, mask, sensor).items()
        corners = [shape.vertices for _, shape in shapes]
        yield "polygon_scan", np.array([scan for scan, _ in shapes], dtype=np.int64)
        yield "polygon_known", np.array(reconstructed)
        yield "polygon_status", np.array([shape.status for _, shape in shapes], dtype=str)
        yield "polygon_start", np.cumsum([0, *map(len, corners)])
        yield "polygon_vertices_mm", np.concatenate([np.empty((0, 2)), *corners])
        outlines = [track.outline for _, track in tracks]
        yield "track_scan", np.array([scan for scan, _ in tracks], dtype=np.int64)
        yield "track_searching", np.array(searching, dtype=np.int64)
        yield "track_id", np.array([track.id for _, track in tracks], dtype=np.int64)
        yield "track_status", np.array([track.status for _, track in tracks], dtype=str)
        yield "track_pose", np.array([track.pose for _, track in tracks]).reshape(-1, 3)
        yield "track_start", np.cumsum([0, *map(len, outlines)])
        yield "track_outline_mm", np.concatenate([np.empty((0, 2)), *outlines])
        yield "sensor_toml", np.array(sensor.to_toml())
        yield "origin_ns", np.array(source.origin_ns)

    with replacing(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(array), allow_pickle=False)
    return many


def write_shapes(path: str | Path, source: Recording) -> int:
    """Write the shapes and objects over time stored with the scans as GeoJSON, in mm; return their number.

    Raises
    ------
    RecordingError
        The recording holds none.
    """
    method = source.about.get("method", "")
    scans = list(source)
    collection = feature_collection([as_reconstruction(raw, method) for raw in scans])
    features = [feature for feature in collection["features"] if feature["geometry"] is not None]
    features += [_track_feature(raw.time_s, one) for raw in scans for one in raw.tracks or ()]
    if not features:
        file = shlex.quote(str(source.path))
        raise RecordingError(
            f"{source.path}: it holds no polygons; `tacstrip record {file} -o NEW.mcap --reconstruct METHOD` adds them"
        )
    collection["features"] = features
    write_text(path, json.dumps(collection, indent=1, allow_nan=False) + "\n")
    return len(features)


def json_line(number: int, raw: RawScan, scan: Scan) -> str:
    """Return a scan as one line of JSON: readings over Vref, null where nothing touches, shapes and tracks [mm]."""
    line: dict[str, Any] = {"scan": number, "sequence": raw.sequence, "time_s": round(raw.time_s, 9)}
    if raw.arrival_s is not None:
        line["arrival_s"] = round(raw.arrival_s, 9)
    for name in scan.signatures:
        line[name] = plain(scan[name], 9)
    shapes = [{"status": s.status, "vertices_mm": plain(s.vertices, 6)} for s in raw.shapes or ()]
    line["shapes"] = None if raw.shapes is None else shapes
    if raw.tracks or raw.tracks is None:
        line |= tracks_fields(raw.tracks, raw.searching)
    return json.dumps(line, allow_nan=False)


def as_reconstruction(raw: RawScan, method: str) -> Reconstruction:
    """Return the shapes stored with a scan as a reconstruction; their strips are not known."""
    statuses: list[tuple[Any, FloatArray]] = [(shape.status, shape.vertices) for shape in raw.shapes or ()]
    objects = tuple(RecoveredObject(slice(0, 0), corners, status=status) for status, corners in statuses)
    return Reconstruction(method, objects, raw.time_s)


def tracks_fields(tracks: Sequence[LiveTrack | TrackedShape] | None, searching: int) -> dict[str, Any]:
    """Return the objects over time of a scan as JSON, null where they are not known, and how many are searched for."""
    known = None if tracks is None else [track_fields(one) for one in tracks]
    return {"tracks": known, "searching": searching}


def track_fields(one: LiveTrack | TrackedShape) -> dict[str, Any]:
    """Return an object over time as JSON: its rigid outline [mm], where it lies, and how well it is known."""
    seen, covariance = bool(np.isfinite(one.pose).all()), one.covariance
    x_mm, y_mm, angle = plain(one.pose, 9)
    deviations = None if covariance is None else np.sqrt(covariance.diagonal()).reshape(-1, 2)
    return {
        "id": one.id,
        "status": one.status,
        "scans": one.scans,
        "outline_mm": plain(one.outline, 4),
        "vertex_sigma_mm": None if deviations is None else plain(deviations, 5),
        "pose": {"x_mm": x_mm, "y_mm": y_mm, "angle_rad": angle} if seen else None,
        "vertices_mm": plain(one.placed, 4) if seen else [],
        "advice": one.advice,
    }


def _track_feature(time_s: float, one: TrackedShape) -> dict[str, Any]:
    fields = track_fields(one)
    ring = fields.pop("vertices_mm")
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]} if ring else None
    return {"type": "Feature", "geometry": geometry, "properties": {"time_s": plain(time_s), "track": fields}}

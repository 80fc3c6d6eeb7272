"""The messages of a recording in the encoding of ROS 2 (CDR): codes of a scan, polygons, objects over time.

Codes are stored as reference + change, because a recording of all strips is mostly noise in the low bits: the
reference repeats from message to message and compresses to almost nothing, and the changes are small numbers. Every
message can be read on its own. Polygons are in metres, as ROS requires; z is 0.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError, get_types_from_msg
from rosbags.typesys.store import Typestore

from tacstrip.arrays import FloatArray
from tacstrip.errors import RecordingError
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.layers import AnySensor
from tacstrip.stream.codes import ELECTRODES, code_shape, code_type
from tacstrip.stream.source import CodeArray, RawScan, Shape, TrackedShape

POLYGON = "geometry_msgs/msg/PolygonStamped"
TRACK = "tacstrip_msgs/msg/Track"
SEARCHING = "std_msgs/msg/UInt32"
RECONSTRUCTED = "std_msgs/msg/Bool"
SCANS = {2: "tacstrip_msgs/msg/Scan", 4: "tacstrip_msgs/msg/WideScan"}  # by bytes per code
NAMES = (*SIGNATURES, ELECTRODES)
FRAME = "tacstrip"  # x across the strips, y along them from the grounded end
# Steps per metre that vertices are rounded to; finer bits are noise, which does not compress.
_GRAIN = 2.0**20
NANO = 1_000_000_000  # ns in a second

_COMMON = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Point32": "float32 x\nfloat32 y\nfloat32 z\n",
    "geometry_msgs/msg/Polygon": "Point32[] points\n",
    POLYGON: "std_msgs/Header header\nPolygon polygon\n",
    SEARCHING: "uint32 data\n",
    RECONSTRUCTED: "bool data\n",
}

_SCAN_TEXT = """\
# One scan of a resistive hybrid tactile sensor: A/D codes, strip by strip. What they mean: the attached sensor.toml.
builtin_interfaces/Time stamp  # when the scan began
uint32 sequence                # the source's own number; a gap is a scan that never reached the recorder
uint8[] touched                # per strip: 0 where nothing touches, and the code means nothing
float32[] strip_time           # per strip: when it was read, from stamp [s]; empty if not known
# code = (reference + change) modulo 2^{bits}, and code / (2^adc_bits - 1) is the voltage over Vref. Arrays of what was
# not measured are empty. kh, kl: upper and lower end of the sensing strip. k: the metal. electrodes: all of a sheet's,
# a row per energised strip, those at y = 0 first.
"""


_TRACK_TEXT = """\
# An object over time, as of one scan.
builtin_interfaces/Time stamp  # when the scan began
uint32 id
string status                  # ok, likely, doubtful
string advice
uint32 scans                   # how many tell of the outline
float64[3] pose                # x, y [m], angle [rad]: p lies at R(angle) p + (x, y); NaN where the scan does not tell
float32[] pose_covariance      # (3, 3) [m, m, rad]; empty: not with this scan
float64[] outline              # x, y of every corner, in the object's frame [m]
float32[] covariance           # of the outline (2 N, 2 N) [m^2], of its shape alone; empty: not with this scan
"""
_METRES = np.array([1e-3, 1e-3, 1.0])  # of a pose in mm


def scan_type(sensor: AnySensor) -> str:
    """Return the message type that holds this sensor's codes."""
    return SCANS[code_type(sensor).itemsize]


def definition(name: str) -> bytes:
    """Return the definition of a message type, with those it uses, as an MCAP schema of the encoding ros2msg."""
    own, bar, used = _store().generate_msgdef(name, ros_version=2)[0].partition("=" * 80)
    for width, scan in SCANS.items():
        own = _scan_definition(8 * width) if scan == name else own  # with its comments
    own = _TRACK_TEXT if name == TRACK else own
    return (own + bar + used).encode()


def scan_message(raw: RawScan, sensor: AnySensor, reference: Mapping[str, CodeArray], time_ns: int) -> bytes:
    """Return a scan's codes as a message; `reference` are the codes of a recent scan, or its own."""
    width = code_type(sensor).itemsize
    fields: dict[str, Any] = {}
    for name in NAMES:
        codes = raw.codes.get(name, np.empty(0, code_type(sensor)))
        base = reference.get(name, codes)
        fields[f"{name}_reference"] = base.ravel()
        # The difference wraps here, and again when it is read.
        fields[f"{name}_change"] = (codes - base).view(f"<i{width}").ravel()
    times = np.empty(0) if raw.strip_time_s is None else raw.strip_time_s
    return _write(
        scan_type(sensor),
        stamp=_stamp(time_ns),
        sequence=raw.sequence % 2**32,
        touched=raw.touched.astype(np.uint8),
        strip_time=times.astype("<f4"),
        **fields,
    )


def read_scan(data: bytes, kind: str, sensor: AnySensor, names: tuple[str, ...], time_s: float) -> RawScan:
    """Return the raw scan in a message.

    Raises
    ------
    RecordingError
        It is not such a message, or has another number of strips.
    """
    message = _read(kind, data)
    codes: dict[str, CodeArray] = {}
    for name in names:
        base, change = getattr(message, f"{name}_reference"), getattr(message, f"{name}_change")
        shape = code_shape(sensor, name)
        if not len(base) == len(change) == int(np.prod(shape)):
            raise RecordingError(f"a scan has {len(change)} codes {name} where {shape} belong")
        codes[name] = (base + change.view(base.dtype)).reshape(shape)
    times: FloatArray | None = message.strip_time.astype(np.float64) if len(message.strip_time) else None
    if len(message.touched) != sensor.strips or (times is not None and len(times) != sensor.strips):
        raise RecordingError(f"a scan has {len(message.touched)} strips where the spec has {sensor.strips}")
    return RawScan(time_s, codes, message.touched != 0, message.sequence, times)


def polygon_message(vertices: FloatArray, time_ns: int, frame_id: str = FRAME) -> bytes:
    """Return vertices (N, 2) [mm] as a message."""
    header = _new("std_msgs/msg/Header", stamp=_stamp(time_ns), frame_id=frame_id)
    empty = _write(POLYGON, header=header, polygon=_new("geometry_msgs/msg/Polygon", points=[]))
    points = np.zeros((len(vertices), 3), "<f4")  # x, y, z [m]
    points[:, :2] = np.round(vertices * (1e-3 * _GRAIN)) / _GRAIN
    # The number of points comes last and the points follow it: a Python object per point would take ten times as long.
    return empty[:-4] + struct.pack("<I", len(points)) + points.tobytes()


def read_polygon(data: bytes, status: str) -> Shape:
    """Return the polygon in a message; `RecordingError` where it is not one."""
    points = _read(POLYGON, data).polygon.points
    corners = np.array([(p.x, p.y) for p in points], dtype=np.float64).reshape(-1, 2)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise RecordingError("a polygon has corners that are not numbers, or fewer than three")
    return Shape(status, corners * 1e3)


def track_message(track: TrackedShape, time_ns: int) -> bytes:
    """Return an object over time as a message."""
    pose, shape = track.pose_covariance, track.covariance
    return _write(
        TRACK,
        stamp=_stamp(time_ns),
        id=track.id % 2**32,
        status=track.status,
        advice=track.advice,
        scans=track.scans % 2**32,
        pose=track.pose * _METRES,
        pose_covariance=_floats(None if pose is None else pose * np.outer(_METRES, _METRES)),
        outline=np.asarray(track.outline * 1e-3, dtype=np.float64).ravel(),
        covariance=_floats(None if shape is None else shape * 1e-6),
    )


def read_track(data: bytes) -> TrackedShape:
    """Return the object over time in a message; `RecordingError` where it is not one."""
    message = _read(TRACK, data)
    outline = (
        message.outline.reshape(-1, 2) * 1e3 if len(message.outline) % 2 == 0 else np.full((1, 2), np.nan)
    )
    size = outline.size
    shape = message.covariance.astype(np.float64) * 1e6
    pose = message.pose_covariance.astype(np.float64)
    if not np.isfinite(outline).all() or len(shape) not in (0, size**2) or len(pose) not in (0, 9):
        raise RecordingError(
            "an object over time has corners that are not numbers, or a covariance of another size"
        )
    return TrackedShape(
        int(message.id), message.status, outline, message.pose / _METRES, int(message.scans), message.advice,
        shape.reshape(size, size) if len(shape) else None,
        pose.reshape(3, 3) / np.outer(_METRES, _METRES) if len(pose) else None,
    )  # fmt: skip


def searching_message(count: int) -> bytes:
    """Return as a message how many objects a scan's tracks lack because their shape was still searched for."""
    return _write(SEARCHING, data=count)


def read_searching(data: bytes) -> int:
    """Return the number in such a message; `RecordingError` where it is not one."""
    return int(_read(SEARCHING, data).data)


def reconstructed_message(done: bool) -> bytes:
    """Return as a message whether a scan's shapes are known."""
    return _write(RECONSTRUCTED, data=done)


def read_reconstructed(data: bytes) -> bool:
    """Return what such a message says; `RecordingError` where it is not one."""
    return bool(_read(RECONSTRUCTED, data).data)


def _floats(values: FloatArray | None) -> Any:
    return np.empty(0, "<f4") if values is None else values.astype("<f4").ravel()


@cache
def _store() -> Typestore:
    """Return the message types, made once: making them takes longer than importing the rest of this file."""
    store = Typestore(max_sequence_length=2**24)
    own = {name: _scan_definition(8 * width) for width, name in SCANS.items()}
    for name, text in (_COMMON | own | {TRACK: _TRACK_TEXT}).items():
        store.register(get_types_from_msg(text, name))
    return store


def _scan_definition(bits: int) -> str:
    fields = "".join(f"uint{bits}[] {name}_reference\nint{bits}[] {name}_change\n" for name in NAMES)
    return _SCAN_TEXT.format(bits=bits) + fields


def _stamp(time_ns: int) -> Any:
    seconds, rest = divmod(time_ns, NANO)
    if not -(2**31) <= seconds < 2**31:
        raise RecordingError(
            f"a scan at {seconds} s since 1970 is out of range for a recording; check time_s"
        )
    return _new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)


def _new(name: str, **fields: Any) -> Any:
    return _store().types[name](**fields)


def _write(name: str, **fields: Any) -> bytes:
    return bytes(_store().serialize_cdr(_new(name, **fields), name))


def _read(name: str, data: bytes) -> Any:
    try:
        return _store().deserialize_cdr(data, name)
    except (SerdeError, TypesysError, IndexError, OverflowError, MemoryError) as error:
        raise RecordingError(f"a message is no {name} ({error})") from None

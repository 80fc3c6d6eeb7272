"""Messages of ROS 2's standard packages in their encoding (CDR), as the bridge publishes them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tacstrip.stream.codes import ELECTRODES
from tacstrip.stream.recording.messages import NANO, POLYGON
from tacstrip.stream.source import RawScan

__all__ = ["DIAGNOSTICS", "POLYGON", "READINGS", "TEXT"]
READINGS = "std_msgs/msg/Float32MultiArray"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TEXT = "std_msgs/msg/String"

OK, WARN, ERROR, STALE = range(4)  # of a DiagnosticStatus


class Status(NamedTuple):
    """One DiagnosticStatus: its level, the part that it is of, a sentence, and values by name."""

    level: int
    name: str
    message: str
    values: Mapping[str, object]


@cache
def type_store() -> Typestore:
    """Return the types; these four are the same in every ROS 2 from Humble on."""
    return get_typestore(Stores.ROS2_HUMBLE)


def readings_message(raw: RawScan, names: tuple[str, ...], top: int) -> bytes:
    """Return a scan's uncalibrated readings over Vref, NaN where nothing touches, as a Float32MultiArray.

    A row per signature, named in the label of the first dimension ("kh,kl"), a column per strip; a CRS-CRP sheet has a
    row per energised strip and a column per electrode.
    """
    if ELECTRODES in names:
        codes, labels = raw.codes[ELECTRODES], ("energised strip", "electrode")
        touched = raw.touched[:, None]
    else:
        codes, labels = np.stack([raw.codes[name] for name in names]), (",".join(names), "strip")
        touched = raw.touched
    values = np.where(touched, codes / top, np.nan).astype("<f4")  # (rows, columns)
    rows, columns = values.shape
    sizes = ((labels[0], rows, rows * columns), (labels[1], columns, columns))
    dimensions = [_new("std_msgs/msg/MultiArrayDimension", label=n, size=s, stride=t) for n, s, t in sizes]
    layout = _new("std_msgs/msg/MultiArrayLayout", dim=dimensions, data_offset=0)
    return _write(READINGS, layout=layout, data=values.ravel())


def diagnostics_message(statuses: list[Status], prefix: str, hardware: str, time_ns: int) -> bytes:
    """Return the state of the parts of a sensor as a DiagnosticArray."""
    seconds, rest = divmod(time_ns, NANO)
    stamp = _new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
    return _write(
        DIAGNOSTICS,
        header=_new("std_msgs/msg/Header", stamp=stamp, frame_id=""),
        status=[
            _new(
                "diagnostic_msgs/msg/DiagnosticStatus",
                level=one.level,
                name=f"{prefix}: {one.name}",
                message=one.message,
                hardware_id=hardware,
                values=[
                    _new("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
                    for key, value in one.values.items()
                ],
            )
            for one in statuses
        ],
    )


def text_message(text: str) -> bytes:
    """Return a text as a String."""
    return _write(TEXT, data=text)


def _new(kind: str, /, **fields: Any) -> Any:
    return type_store().types[kind](**fields)


def _write(kind: str, **fields: Any) -> bytes:
    return bytes(type_store().serialize_cdr(_new(kind, **fields), kind))

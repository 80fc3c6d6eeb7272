"""Publish a live stream into a running ROS 2 graph by Cyclone DDS, without ROS: needs `tacstrip[ros2]`.

Only types that every ROS 2 has. An object keeps a number of its own from 0, the lowest free one, while it stays;
polygons come on a topic per number and status, so that whoever reads `polygon` never takes a doubtful one for right.
When an object ends or its status changes, its last topic gets an empty polygon. Polygons and readings have the scan's
time as their DDS source time stamp, too: a Float32MultiArray has no header.
"""

from __future__ import annotations

import os
import platform
import re
import sys
import threading
import time
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, in_words
from tacstrip.stream.bridges import ros_messages as messages
from tacstrip.stream.bridges.ros_messages import ERROR, OK, STALE, WARN, Status
from tacstrip.stream.codes import top_code
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.recording.messages import NANO, polygon_message
from tacstrip.stream.source import DeviceSource, Source

if TYPE_CHECKING:
    from tacstrip.stream.bridges.cyclone import Participant

LOOPBACK = "127.0.0.1"
NAME = "tacstrip"
_POLYGONS = {"ok": "polygon", "likely": "polygon_likely", "doubtful": "polygon_doubtful"}
_DIAGNOSTICS = "diagnostics"
_OBJECTS = 4  # whose topics are there from the beginning
_NOTHING = np.empty((0, 2))
_DIAGNOSTICS_S = 1.0  # between two, as ROS has it
_DOMAIN, _MAX_DOMAIN = "ROS_DOMAIN_ID", 232  # the ports of higher ones do not exist
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_TROUBLES = {
    "skipped": "scan(s) not reconstructed because the computer was behind",
    "unreadable": "scan(s) could not be decoded",
    "lost": "scan(s) lost on the line",
    "corrupt": "broken frame(s) on the line",
    "not_sent": "message(s) not sent because a reader or this computer was behind",
}


class Ros2:
    """Publishes frames and the state of a stream as topics of ROS 2; `send` calls must not overlap.

    Parameters
    ----------
    live
        The stream.
    name
        Namespace of the topics.
    domain
        Domain id; None: `ROS_DOMAIN_ID` of the environment, else 0.
    frame_id
        Frame of the polygons; None: `name`.
    interface
        Network interface by name or address; "auto": the one that Cyclone DDS chooses.

    Attributes
    ----------
    lost
        Messages that were dropped because a reliable reader did not keep up.

    Raises
    ------
    OptionError
        Cyclone DDS is not installed, or a parameter cannot be.
    """

    def __init__(
        self,
        live: Live,
        name: str = NAME,
        domain: int | None = None,
        frame_id: str | None = None,
        interface: str = LOOPBACK,
    ) -> None:
        if not _NAME.fullmatch(name) or "__" in name:
            raise OptionError(
                f"--ros-name {name}: a namespace is words of letters, digits and single _, separated by /, "
                "such as left_hand/skin"
            )
        self._name, self._frame_id = name, _checked_frame(frame_id or name.replace("/", "_"))
        self._dds = _joined(_checked_domain(domain), interface)
        self._live, self.lost = live, 0
        self._source: Source | None = None
        self._numbers: dict[int, int] = {}  # of the objects, by their ids
        self._shown: dict[int, str] = {}  # topic of an object's last polygon, by its number
        self._last: Frame | None = None
        self._dropped = 0
        self._previous: dict[str, int] = {}
        self._ended = threading.Event()
        self._diagnostics = threading.Thread(target=self._watch, name="tacstrip ROS 2", daemon=True)
        self._dds.offer(f"{name}/sensor_description", messages.TEXT, latched=True)
        self._dds.offer(f"{name}/readings", messages.READINGS)
        self._dds.offer(_DIAGNOSTICS, messages.DIAGNOSTICS)
        for number in range(_OBJECTS):
            self._offer_object(number)
        self._announce(live.source)
        self._diagnostics.start()

    def send(self, frame: Frame, dropped: int) -> None:
        """Publish a frame; `dropped` frames were left out before it so far."""
        if self._live.source is not self._source:
            self._announce(self._live.source)
        source = self._source
        assert source is not None
        time_ns = source.origin_ns + round(frame.raw.time_s * NANO)
        self._last, self._dropped = frame, dropped
        readings = messages.readings_message(frame.raw, source.names, top_code(frame.sensor))
        self._write(f"{self._name}/readings", readings, time_ns)
        shapes = {one.id: one.shape for one in frame.objects if one.shape.found}
        self._numbers = {id_: n for id_, n in self._numbers.items() if id_ in shapes}
        topics: dict[int, str] = {}
        for id_, shape in shapes.items():
            taken = set(self._numbers.values())
            number = self._numbers.setdefault(id_, min(set(range(len(taken) + 1)) - taken))
            if number >= _OBJECTS:
                self._offer_object(number)
            topics[number] = f"{self._name}/object_{number}/{_POLYGONS.get(shape.status, 'polygon_doubtful')}"
            self._polygon(topics[number], shape.vertices, time_ns)
        for number, topic in self._shown.items():
            if topics.get(number) != topic:
                self._polygon(topic, _NOTHING, time_ns)
        self._shown = topics

    def close(self) -> None:
        """Say that the stream has ended, wait for the readers of the last messages, and leave the domain."""
        self._ended.set()
        self._diagnostics.join()
        self._dds.close()

    def _announce(self, source: Source) -> None:
        """Publish the spec of a source's sensor, which late readers get too."""
        self._source = source
        text = messages.text_message(source.sensor.to_toml())
        self._write(f"{self._name}/sensor_description", text, time.time_ns())

    def _polygon(self, topic: str, vertices: FloatArray, time_ns: int) -> None:
        data = polygon_message(vertices, time_ns, self._frame_id)
        self._write(topic, data, time_ns)

    def _write(self, topic: str, cdr: bytes, time_ns: int) -> None:
        self.lost += not self._dds.write(topic, cdr, time_ns)

    def _offer_object(self, number: int) -> None:
        for topic in _POLYGONS.values():
            self._dds.offer(f"{self._name}/object_{number}/{topic}", messages.POLYGON)

    def _watch(self) -> None:
        """Publish the diagnostics once a second until the end, and then once more."""
        while True:
            ended = self._ended.wait(_DIAGNOSTICS_S)
            try:
                now_ns = time.time_ns()
                hardware = self._live.source.sensor.construction
                data = messages.diagnostics_message(self.state(), self._name, hardware, now_ns)
                self._write(_DIAGNOSTICS, data, now_ns)
            except Exception as error:
                self._live.notify(f"the diagnostics of ROS 2 ended: {in_words(error)}")
                return
            if ended:
                return

    def state(self) -> list[Status]:
        """Return the state of stream, channels and objects since the last call."""
        live, last = self._live, self._last
        source = live.source
        counts = source.counts._asdict() if isinstance(source, DeviceSource) else {}
        totals = {"skipped": live.late, "unreadable": live.unreadable, **counts}
        totals |= {"not_sent": self._dropped + self.lost}
        more = {name: count - self._previous.get(name, 0) for name, count in totals.items()}
        self._previous = totals
        rate = live.meter.rate_hz
        p50, p99 = live.meter.latency_s(0.5, 0.99)
        level, text = OK, f"{rate:.4g} scans/s"
        troubles = [f"{more[name]} {words}" for name, words in _TROUBLES.items() if more.get(name, 0) > 0]
        if live.error is not None:
            level, text = ERROR, in_words(live.error)
        elif self._ended.is_set():
            level, text = STALE, "the stream has ended"
        elif rate == 0.0:
            level, text = (STALE, "no scan has come yet") if last is None else (ERROR, "no scans come")
        elif troubles:
            level, text = WARN, "; ".join(troubles)
        values: dict[str, object] = {
            "rate_hz": f"{rate:.1f}", "latency_ms_median": f"{1e3 * p50:.2f}", "latency_ms_99": f"{1e3 * p99:.2f}",
            "scans": live.frames, **totals, "message": live.messages[-1][1] if live.messages else "",
        }  # fmt: skip
        statuses = [Status(level, "stream", text, values)]
        if last is not None:
            left_out = last.sensor.without
            text = f"left out: {', '.join(left_out)}" if left_out else "all are used"
            statuses.append(
                Status(WARN if left_out else OK, "channels", text, {"left_out": ", ".join(left_out)})
            )
            numbers = dict(self._numbers)
            for number, one in sorted(
                ((numbers[o.id], o) for o in last.objects if o.id in numbers), key=itemgetter(0)
            ):
                shape = one.shape
                values = {"id": one.id, "status": shape.status, "outline": shape.outlined,
                          "area_mm2": f"{shape.area:.6g}"}  # fmt: skip
                level = OK if shape.status == "ok" else WARN
                statuses.append(Status(level, f"object_{number}", shape.advice or shape.status, values))
        return statuses


def _checked_domain(domain: int | None) -> int:
    name, text = (
        ("--ros-domain", str(domain)) if domain is not None else (_DOMAIN, os.environ.get(_DOMAIN) or "0")
    )
    if not (text.isascii() and text.isdigit() and int(text) <= _MAX_DOMAIN):
        raise OptionError(f"{name} {text}: must be a whole number from 0 to {_MAX_DOMAIN}")
    return int(text)


def _checked_frame(frame_id: str) -> str:
    if not frame_id.isprintable() or frame_id.startswith("/") or any(c.isspace() for c in frame_id):
        raise OptionError(
            f"--ros-frame {frame_id!r}: a frame id has no space and no / before it, such as skin_link"
        )
    return frame_id


def _joined(domain: int, interface: str) -> Participant:
    try:
        from tacstrip.stream.bridges.cyclone import Participant
    except ImportError as error:
        if error.name is None or error.name.partition(".")[0] != "cyclonedds":
            raise
        raise OptionError(
            "--ros2 needs cyclonedds, which is not built for 64-bit ARM on Linux: publish from another computer"
            if sys.platform == "linux" and platform.machine() == "aarch64"
            else "--ros2 needs cyclonedds: pip install 'tacstrip[ros2]', in a checkout make ros2"
        ) from None
    try:
        return Participant(domain, interface)
    except OSError:
        raise OptionError(
            f"--ros-interface {interface}: domain {domain} of ROS 2 cannot be joined on it; give the name or address "
            "of one of this computer's network interfaces, or auto"
        ) from None

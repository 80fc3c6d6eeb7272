"""Frames of a live stream as messages that Foxglove and Lichtblick show: scenes, plots and a log.

Scenes are in metres, in the frame `tacstrip` of the recordings: x across the strips, y along them. A scene is one
entity that every message replaces, so that a viewer which has missed messages shows nothing that is gone.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray, plain
from tacstrip.errors import OptionError
from tacstrip.geometry.moments import moments, principal_angle
from tacstrip.geometry.region import coarse_regions
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.bridges.foxglove.server import Channel, FoxgloveServer
from tacstrip.stream.device.protocol.decoder import Counts
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.recording.messages import FRAME, NANO
from tacstrip.stream.source import DeviceSource
from tacstrip.tracking.live_contact import LiveTrack
from tacstrip.tracking.tracker import LiveObject

PORT = 8765  # that viewers propose
_REGIONS_LAST_NS = NANO // 5
_MAX_STRIPS = 250  # of more strips the gaps are not drawn
_LOGGED = 50  # messages of the log that a new viewer gets
_SHAPE, _DOUBTFUL, _TRACK, _REGION = (0.76, 0.27, 0.05), (0.85, 0.6, 0.0), (0.5, 0.3, 0.75), (0.2, 0.5, 0.85)
_GREY = (0.55, 0.55, 0.55)
_NUMBER, _NUMBERS = {"type": "number"}, {"type": "array", "items": {"type": "number"}}
_WHOLE, _TEXT = {"type": "integer"}, {"type": "string"}
_TIME = {"type": "object", "title": "time", "properties": {"sec": _WHOLE, "nsec": _WHOLE}}
_STEPS = 100_000  # of k
_NONE = 999_999_999  # stands for NaN
_ENCODER = json.JSONEncoder(allow_nan=False)
_HEALTH = "rate_hz latency_p50_ms latency_p99_ms frames late unreadable lost corrupt recorded dropped viewers left_out"


class Foxglove:
    """Sends the frames of a stream to the viewers of a server of its own; calls of `send` must not overlap.

    Parameters
    ----------
    live
        The stream.
    host, port
        The address that viewers connect to; port 0: any free one.

    Attributes
    ----------
    server
        The server.

    Raises
    ------
    OptionError
        foxglove-sdk is not installed, or the server cannot listen on this address.
    """

    def __init__(self, live: Live, host: str = "127.0.0.1", port: int = PORT) -> None:
        try:
            from foxglove import messages
        except ImportError:
            raise OptionError("--foxglove needs foxglove-sdk: pip install 'tacstrip[foxglove]'") from None
        self._live, self._sdk = live, messages
        scene = messages.SceneUpdate.get_schema()
        self._sensor = Channel.of_protobuf("/tacstrip/sensor", scene, keep=1)
        self._objects, self._regions, self._tracks = (
            Channel.of_protobuf(f"/tacstrip/{name}", scene, keep=1)
            for name in ("objects", "regions", "tracks")
        )
        self._log = Channel.of_protobuf("/tacstrip/log", messages.Log.get_schema(), keep=_LOGGED)
        scan = {"timestamp": _TIME, "scan": _WHOLE}
        self._signatures = Channel.of_json(
            "/tacstrip/signatures", "tacstrip.Signatures",
            scan | {"strip": _NUMBERS, "x_mm": _NUMBERS, "kh": _NUMBERS, "kl": _NUMBERS, "k": _NUMBERS},
        )  # fmt: skip
        one = {"type": "object", "properties": {
            "id": _WHOLE, "status": _TEXT, "advice": _TEXT, "corners": _WHOLE, "area_mm2": _NUMBER, "x_mm": _NUMBER,
            "y_mm": _NUMBER, "angle_rad": _NUMBER, "scans": _WHOLE, "deviation_mm": _NUMBER,
        }}  # fmt: skip
        shapes = {name: {"type": "array", "items": one} for name in ("objects", "tracks")}
        self._shapes = Channel.of_json(
            "/tacstrip/shapes", "tacstrip.Shapes", scan | shapes | {"searching": _WHOLE}
        )
        health = dict.fromkeys(_HEALTH.split(), _NUMBER)
        self._health = Channel.of_json("/tacstrip/health", "tacstrip.Health", {"timestamp": _TIME} | health)
        self._shown = ""  # the fingerprint of the sensor that was sent
        self._places = ""  # strips and their places as JSON
        self._said: dict[int, str] = {}  # status and advice by object
        self._last_message = 0
        self._time_ns = self._regions_ns = 0
        channels = (self._sensor, self._objects, self._regions, self._tracks, self._signatures, self._shapes,
                    self._health, self._log)  # fmt: skip
        self.server = FoxgloveServer(channels, host, port, live.notify)
        self.server.on_tick = self._tick  # only now: its thread runs already

    def close(self) -> None:
        """Send the last messages, and end the server."""
        self._tick()
        self.server.close()
        self._live.want_detail(self, False)

    def send(self, frame: Frame) -> None:
        """Send a frame."""
        self._time_ns = time_ns = frame.time_ns
        takes = self.server.takes
        messages = []
        if self._shown != frame.sensor.fingerprint:
            self._begin(frame.sensor, time_ns)
        self._say(frame.objects, time_ns)
        if takes(self._signatures):
            messages.append((self._signatures, self._signature_fields(frame)))
        if takes(self._shapes):
            messages.append((self._shapes, _shape_fields(frame)))
        if takes(self._objects):
            shapes = [(o.id, o.shape.status, o.shape.vertices) for o in frame.objects if o.shape.found]
            messages.append((self._objects, self._scene("objects", time_ns, shapes)))
        # Where the computer was behind, the last ones stay.
        if (frame.tracks is not None or frame.searching) and takes(self._tracks):
            seen = [one for one in frame.tracks or () if np.isfinite(one.pose).all() and len(one.outline)]
            shapes = [(one.id, one.status, one.placed) for one in seen]
            messages.append((self._tracks, self._scene("tracks", time_ns, shapes, _TRACK)))
        self._live.want_detail(self, self.server.wanted(self._regions))
        # Covariances come with some of the frames only; regions without new ones are of what was.
        found = [o.shape for o in frame.objects if o.shape.covariance is not None]
        old = not frame.objects or abs(time_ns - self._regions_ns) > _REGIONS_LAST_NS
        if (found or old) and takes(self._regions):
            self._regions_ns = time_ns
            rings = (ring for shape in found for ring in coarse_regions(shape.vertices, shape.covariance))
            lines = [self._loop(ring, _REGION, 1.5) for ring in rings]
            messages.append((self._regions, self._entity("regions", time_ns, lines)))
        self.server.publish(time_ns, *messages)

    def _begin(self, sensor: Sensor, time_ns: int) -> None:
        """Draw another sensor."""
        self._shown = sensor.fingerprint
        strips = (np.arange(sensor.strips) + sensor.strip_base).tolist()
        self._places = f'"strip": {json.dumps(strips)}, "x_mm": {json.dumps(plain(sensor.x_mm, 4))}'
        width, length = sensor.width_mm, sensor.length_mm
        border = np.array([(0.0, 0.0), (width, 0.0), (width, length), (0.0, length)])
        lines = [self._loop(border, _GREY, 2.0)]
        if sensor.strips <= _MAX_STRIPS:
            x = np.arange(1, sensor.strips) * sensor.pitch_mm
            ends = np.stack([np.repeat(x, 2), np.tile([0.0, length], len(x))], axis=1)
            kind = self._sdk.LinePrimitiveLineType.LineList
            lines.append(self._loop(ends, _GREY, 0.5, kind))
        self.server.publish(time_ns, (self._sensor, self._entity("sensor", time_ns, lines)))

    def _signature_fields(self, frame: Frame) -> bytes:
        values = ", ".join(f'"{name}": [{_as_json(frame.scan[name])}]' for name in frame.scan.signatures)
        seconds, rest = divmod(max(frame.time_ns, 0), NANO)
        stamp = f'"timestamp": {{"sec": {seconds}, "nsec": {rest}}}, "scan": {frame.number}'
        return f"{{{stamp}, {self._places}, {values}}}".encode()

    def _scene(
        self,
        name: str,
        time_ns: int,
        shapes: Iterable[tuple[int, str, FloatArray]],
        colour: tuple[float, float, float] = _SHAPE,
    ) -> bytes:
        """Return outlines with their numbers as a scene; doubtful ones have a colour of their own."""
        sdk, lines, texts = self._sdk, [], []
        for number, status, vertices in shapes:
            sure = status in ("ok", "likely")
            lines.append(self._loop(vertices, colour if sure else _DOUBTFUL, 3.0))
            x, y = (1e-3 * vertices.mean(axis=0)).tolist()
            pose = sdk.Pose(position=sdk.Vector3(x=x, y=y), orientation=sdk.Quaternion(w=1.0))
            text = str(number) if status == "ok" else f"{number}, {status}"
            texts.append(
                sdk.TextPrimitive(
                    pose=pose, billboard=True, font_size=14.0, scale_invariant=True, color=self._colour(_GREY),
                    text=text,
                )
            )  # fmt: skip
        return self._entity(name, time_ns, lines, texts)

    def _loop(
        self, points: FloatArray, colour: tuple[float, float, float], width: float, kind: Any = None
    ) -> Any:
        sdk = self._sdk
        corners = [sdk.Point3(x=x, y=y) for x, y in (1e-3 * points).tolist()]
        return sdk.LinePrimitive(
            type=kind or sdk.LinePrimitiveLineType.LineLoop, thickness=width, scale_invariant=True, points=corners,
            color=self._colour(colour),
        )  # fmt: skip

    def _colour(self, colour: tuple[float, float, float]) -> Any:
        red, green, blue = colour
        return self._sdk.Color(r=red, g=green, b=blue, a=1.0)

    def _entity(self, name: str, time_ns: int, lines: list[Any], texts: Iterable[Any] = ()) -> bytes:
        sdk = self._sdk
        entity = sdk.SceneEntity(
            timestamp=self._timestamp(time_ns), frame_id=FRAME, id=name, lines=lines, texts=[*texts]
        )
        data: bytes = sdk.SceneUpdate(entities=[entity]).encode()
        return data

    def _timestamp(self, time_ns: int) -> Any:
        return self._sdk.Timestamp(**_stamp(time_ns))

    def _say(self, objects: Iterable[LiveObject], time_ns: int) -> None:
        """Log what is new of the objects: those that come or go, and another status."""
        levels = self._sdk.LogLevel
        now = {one.id: ": ".join(filter(None, (one.shape.status, one.shape.advice))) for one in objects}
        if now == self._said:
            return
        sure = ("ok", "likely")
        for number, text in now.items():
            if self._said.get(number, "").partition(":")[0] != (status := text.partition(":")[0]):
                self._write(
                    f"object {number}: {text}", levels.Info if status in sure else levels.Warning, time_ns
                )
        for number in self._said.keys() - now.keys():
            self._write(f"object {number} is gone", levels.Info, time_ns)
        self._said = now

    def _write(self, text: str, level: Any, time_ns: int) -> None:
        log = self._sdk.Log(timestamp=self._timestamp(time_ns), level=level, message=text, name="tacstrip")
        self.server.publish(time_ns, (self._log, log.encode()))

    def _tick(self) -> None:
        """Log the stream's messages, and send its health."""
        live, server = self._live, self.server
        for number, text in list(live.messages):
            if number > self._last_message:
                self._last_message = number
                self._write(text, self._sdk.LogLevel.Warning, self._now_ns())
        if not server.wanted(self._health):
            return
        p50, p99 = live.meter.latency_s(0.5, 0.99)
        wire = live.source.counts if isinstance(live.source, DeviceSource) else Counts()
        recorder = live.recording
        values = (
            live.meter.rate_hz, 1e3 * p50, 1e3 * p99, live.frames, live.late, live.unreadable, wire.lost, wire.corrupt,
            0 if recorder is None else recorder.scans, server.dropped, server.viewers, len(live.source.sensor.without),
        )  # fmt: skip
        fields = {"timestamp": _stamp(self._now_ns()), **dict(zip(_HEALTH.split(), values, strict=True))}
        server.publish(self._now_ns(), (self._health, json.dumps(fields).encode()))

    def _now_ns(self) -> int:
        """Return the time of the last frame, by which viewers order what they get; the computer's before the first."""
        return self._time_ns or time.time_ns()


def _as_json(values: FloatArray) -> str:
    """Return signatures (strips,) to five digits as the elements of a JSON array, null for NaN.

    Whole numbers times 1e-5 are written several times as fast as their decimals.

    Examples
    --------
    >>> _as_json(np.array([0.5, float("nan")]))
    '50000e-5, null'
    """
    steps = np.rint(_STEPS * values)
    steps[np.isnan(values)] = _NONE
    if not len(values) or not np.abs(steps).max() <= _NONE:
        return json.dumps(plain(values, 5))[1:-1]
    return ("e-5, ".join(map(str, steps.astype(int).tolist())) + "e-5").replace(f"{_NONE}e-5", "null")


def _shape_fields(frame: Frame) -> bytes:
    """Return the numbers of the objects of a frame as JSON, for plots."""
    fields = {
        "timestamp": _stamp(frame.time_ns),
        "scan": frame.number,
        "objects": [_of_object(one) for one in frame.objects],
        "searching": frame.searching,
    }
    if frame.tracks is not None:  # which are not known else
        fields["tracks"] = [_of_track(one) for one in frame.tracks]
    return _ENCODER.encode(fields).encode()


def _of_object(one: LiveObject) -> dict[str, Any]:
    shape = one.shape
    about = _about(one.id, shape.status, shape.advice, shape.vertices)
    if shape.found:
        area, (x, y), second = moments(shape.vertices)
        area = area if shape.on_skin is None else shape.on_skin.area_mm2
        values = ("area_mm2", area), ("x_mm", x), ("y_mm", y), ("angle_rad", principal_angle(second))
        about |= {name: _finite(value) for name, value in values}
    return about


def _of_track(one: LiveTrack) -> dict[str, Any]:
    x, y, angle = plain(one.pose, 6)
    about = _about(one.id, one.status, one.advice, one.outline)
    return about | {"scans": one.scans, "area_mm2": _finite(one.area_mm2), "x_mm": x, "y_mm": y, "angle_rad": angle,
                    "deviation_mm": _finite(one.corner_deviation_mm)}  # fmt: skip


def _about(number: int, status: str, advice: str, corners: FloatArray) -> dict[str, Any]:
    return {"id": number, "status": status, "advice": advice, "corners": len(corners)}


def _finite(value: float) -> float | None:
    return round(float(value), 6) if math.isfinite(value) else None


def _stamp(time_ns: int) -> dict[str, int]:
    """Return a time since 1970 as the viewers' messages have it; none is earlier."""
    seconds, rest = divmod(max(time_ns, 0), NANO)
    return {"sec": seconds, "nsec": rest}

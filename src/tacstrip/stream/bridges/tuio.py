"""Send objects as TUIO 1.1 blobs over OSC, profile /tuio/2Dblb, which multitouch programs read.

Positions run from 0 to 1 over the sensor with y downwards from the Vref end, as TUIO defines it; angles [rad] therefore
turn clockwise.
"""

from __future__ import annotations

import math
import socket
from typing import Any, NamedTuple

import numpy as np

from tacstrip.errors import OptionError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.frame import Frame
from tacstrip.tracking.tracker import LiveObject

_ADDRESS = "/tuio/2Dblb"
_SMOOTHING_S = 0.05  # time constant of the velocities


class Blob(NamedTuple):
    """Centre, angle [rad], extents along the axes and area of a blob; all but the angle relative to the sensor."""

    x: float
    y: float
    angle: float
    width: float
    height: float
    area: float


def blob(one: LiveObject, sensor: Sensor) -> Blob | None:
    """Return an object's blob, or None where it has no shape."""
    shape = one.shape
    if not shape.found or not np.isfinite(shape.centroid).all():
        return None
    turn = shape.orientation if math.isfinite(shape.orientation) else 0.0
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    along, across = np.ptp((shape.vertices - shape.centroid) @ axes, axis=0)
    x, y = shape.centroid
    sensor_area = sensor.width_mm * sensor.length_mm
    x = float(x / sensor.width_mm)
    return Blob(
        x % 1.0 if sensor.closed else x, float(1.0 - y / sensor.length_mm), -turn % math.pi,
        float(along / sensor.width_mm), float(across / sensor.length_mm), shape.area / sensor_area,
    )  # fmt: skip


class Tuio:
    """Sends frames to a TUIO receiver; calls must not overlap.

    Parameters
    ----------
    target
        HOST:PORT of the receiver; the standard port of TUIO is 3333.

    Raises
    ------
    OptionError
        The target is not HOST:PORT, or the host is not known.
    """

    def __init__(self, target: str) -> None:
        host, _, port = target.rpartition(":")
        if not (host and port.isascii() and port.isdecimal() and 0 < int(port) < 65536):
            raise OptionError(f"--osc {target}: must be HOST:PORT, such as 127.0.0.1:3333")
        try:
            found = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise OptionError(f"--osc {target}: {error.strerror or error}") from None
        self._address: Any = found[4]
        self._socket = socket.socket(found[0], found[1])
        self._source = f"tacstrip@{socket.gethostname()}"
        self._sent = 0
        self._last: dict[int, tuple[float, Blob, tuple[float, float, float]]] = {}

    def send(self, frame: Frame) -> None:
        """Send a frame as one bundle."""
        self._sent += 1
        self._socket.sendto(self._bundle(frame).dgram, self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _bundle(self, frame: Frame) -> Any:
        from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder

        found = {o.id: b for o in frame.objects if (b := blob(o, frame.sensor)) is not None}
        bundle = OscBundleBuilder(IMMEDIATELY)
        bundle.add_content(_message("source", self._source))
        bundle.add_content(_message("alive", *found))
        for number, one in found.items():
            bundle.add_content(_message("set", number, *self._fields(number, one, frame.raw.time_s)))
        bundle.add_content(_message("fseq", self._sent))
        self._last = {number: self._last[number] for number in found}
        return bundle.build()

    def _fields(self, number: int, now: Blob, time_s: float) -> tuple[float, ...]:
        """Return the fields x y a w h f X Y A m r of a blob, its velocities smoothed."""
        speed, change = (0.0, 0.0, 0.0), (0.0, 0.0)
        last_s, last, last_speed = self._last.get(number, (time_s, now, speed))
        if (passed := time_s - last_s) > 0.0:
            turned = (now.angle - last.angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi
            part = 1.0 - math.exp(-passed / _SMOOTHING_S)
            raw = (now.x - last.x, now.y - last.y, turned)
            vx, vy, va = (v + part * (d / passed - v) for v, d in zip(last_speed, raw, strict=True))
            before = math.hypot(*last_speed[:2])
            change = ((math.hypot(vx, vy) - before) / passed, (va - last_speed[2]) / passed)
            speed = (vx, vy, va)
        self._last[number] = (time_s, now, speed)
        return (*now, *speed, *change)


def _message(command: str, *values: str | int | float) -> Any:
    from pythonosc.osc_message_builder import OscMessageBuilder

    message = OscMessageBuilder(_ADDRESS)
    for value in (command, *values):
        message.add_arg(value, "s" if isinstance(value, str) else "i" if isinstance(value, int) else "f")
    return message.build()

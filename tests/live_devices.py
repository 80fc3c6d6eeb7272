"""Devices for the tests: virtual ones on ports that can be pulled out, answer nonsense, or be of another kind."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import tacstrip as ts
from tacstrip.stream.device.virtual import Loopback, PtyDevice, VirtualDevice

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])


def still(time_s: float) -> ts.Contact:
    return SHAPE


def device(
    sensor: ts.Sensor = SENSOR,
    rate_hz: float = 200.0,
    contact: Callable[[float], ts.Contact] = still,
    clock: Callable[[], float] = time.monotonic,
) -> VirtualDevice:
    noise = ts.Noise(positional=0.002)
    return VirtualDevice(
        sensor,
        lambda: iter(ts.SimulatedSource(sensor, contact, rate_hz, None, noise)),
        rate_hz,
        0.5 / rate_hz,
        clock,
    )


class Stepped(Loopback):
    """A line that gives one scan at each reading, whatever time that takes: no scan waits for a busy computer."""

    def __init__(self, rate_hz: float) -> None:
        self._now_s = 0.0
        super().__init__(device(rate_hz=rate_hz, clock=lambda: self._now_s))

    def read(self, wait_s: float) -> bytes:
        due_s = self.device.wait_s()
        self._now_s += due_s if math.isfinite(due_s) else 0.0
        return super().read(wait_s)


class Line(Loopback):
    """A line that can be cut: after `cut` bytes reading fails, as of a cable pulled out in the middle of a frame."""

    def __init__(self, made: VirtualDevice, cut: int | None = None) -> None:
        super().__init__(made)
        self.left = cut

    def read(self, wait_s: float) -> bytes:
        if self.left is not None and self.left <= 0:
            raise OSError(5, "device reports readiness to read but returned no data")
        data = super().read(wait_s)
        if self.left is not None:
            data, self.left = data[: self.left], self.left - len(data)
        return data


class LinkedPty(PtyDevice):
    """A virtual serial port under a name of its own, so that a device can be plugged in again under the same one."""

    def __init__(self, made: VirtualDevice, link: Path) -> None:
        super().__init__(made)
        link.symlink_to(self.path)
        self.path, self._link = str(link), link

    def close(self) -> None:
        super().close()
        self._link.unlink(missing_ok=True)


class Noise:
    """A line that carries the same bytes again and again, or none."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def read(self, wait_s: float) -> bytes:
        return self.data

    def write(self, data: bytes) -> None:
        """Nobody listens."""

    def close(self) -> None:
        """Nothing is open."""


def with_strips(count: int) -> ts.Sensor:
    return replace(SENSOR, strips=count, pitch_mm=100.0 / count)

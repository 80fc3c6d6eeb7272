"""More devices that misbehave: frames, hellos and numbers as docs/reference/protocol.md allows or forbids them."""

from __future__ import annotations

import select
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from studies.holdout import device_set
from studies.holdout.device_set import ANOTHER, AT, CLOCK, RESTART, Device, Trouble, every, framed, once


@dataclass
class _Behind(Device):
    """A unit whose first answers come behind old hellos of the unit before it, which lay in the adapter."""

    old: int = 1

    def hello(self) -> bytes:
        """Return a hello."""
        own, before = super().hello(), b""
        if self.old:
            self.unit, name = "left-hand", self.unit
            before = super().hello() * self.old
            self.unit, self.old = name, 0
        return before + own


@dataclass
class _Slow(Device):
    """A unit that answers late, if at all, behind an old hello of the unit before it: from when the host asks."""

    late: float = 0.5  # s
    asked: float = 0.0

    def obey(self) -> None:
        """Answer what came so long ago."""
        if not self.asked and select.select([self.host], [], [], 0.0)[0]:
            self.asked = time.monotonic()
            self.unit, name = "left-hand", self.unit
            self.put(self.hello())
            self.unit = name
        if self.asked and time.monotonic() > self.asked + self.late:
            super().obey()


@dataclass
class _Loaded(Device):
    """A device whose host has more to do than it can."""

    busy: list[threading.Thread] = field(default_factory=list)

    def obey(self) -> None:
        """Answer, while threads keep the host's interpreter busy."""
        if not self.busy:
            self.busy = [threading.Thread(target=self._spin, daemon=True) for _ in range(3)]
            for thread in self.busy:
                thread.start()
        super().obey()

    def _spin(self) -> None:
        while self.link.parent.exists():
            sum(range(1000))


def _cold(old: int) -> Trouble:
    return Trouble(
        ANOTHER,
        True,
        make=lambda random: _Behind(unit="right-hand", old=old),
        before=lambda d: b"",
        step=_foreign,
    )


def _late(least: float, most: float, answers: bool = True) -> Trouble:
    return Trouble(
        ANOTHER if answers else "who it is",
        True,
        make=lambda random: _Slow(unit="right-hand", answers=answers, late=random.uniform(least, most)),
        before=lambda d: b"",
        step=_foreign,
        seconds=2.0 + most,
    )


def _taken_over(
    hellos: int = 0, ahead: int = 0, clock: float = 0.0, make: Callable[..., Device] = Device
) -> Trouble:
    """Another unit goes on where the first one was, its number and its clock so far ahead [s]."""

    def do(d: Device, t: float) -> None:
        before = d.clock
        d.unit, d.sequence, d.clock = "right-hand", d.sequence + ahead, lambda t: before(t) + clock
        d.put(d.hello() * hellos)

    return Trouble(ANOTHER, True, onset=AT, make=lambda random: make(), step=once(do))


def _foreign(d: Device, number: int, t: float) -> bytes | None:
    return d.scan(foreign=True) if d.streaming else None


def _idle(d: Device) -> bytes:
    """Say in a hello that nothing is being sent, between scans."""
    d.streaming = False
    data = d.hello()
    d.streaming = True
    return data + d.scan()


def _tested(d: Device) -> bytes:
    body = struct.pack("<HHI", d.strips, 5000, 0) + bytes(d.strips)
    return framed(4, d.sequence, d.stamp(), body) + d.scan()


def _short(d: Device) -> bytes:
    """Send a frame with a right CRC whose strips do not fill its body."""
    body = struct.pack("<HBBI", d.strips + 3, 3, d.bits, 1800) + bytes(9)
    return framed(1, d.sequence, d.stamp(), body) + d.scan()


def _one_zero(d: Device, number: int, t: float) -> bytes:
    """Share the zero between frames."""
    return d.scan()[1:] if number else d.scan()


def _standing(d: Device) -> bytes:
    """Give a scan its forerunner's number."""
    d.sequence -= 1
    return d.scan()


def _leap(d: Device, t: float) -> None:
    d.sequence += 2**31


def _number_alone(d: Device, t: float) -> None:
    """Begin to count anew, with the clock going on: no reset does so."""
    d.sequence = 0


def _coarse(t: float) -> float:
    return 1.0 + 0.016 * int(t / 0.016)


def _hello_of_other_bits(d: Device) -> bytes:
    bits, d.bits = d.bits, 16 if d.bits < 16 else 10
    data = d.hello()
    d.bits = bits
    return data + d.scan()


def _long_span(d: Device) -> bytes:
    """Say that reading the strips took longer than the clock can hold in a period."""
    real, device_set.SPAN = device_set.SPAN, 2**32 - 1
    data = d.scan()
    device_set.SPAN = real
    return data


TROUBLES: dict[str, Trouble] = {
    "another unit behind an old hello": _cold(1),
    "another unit behind three old hellos": _cold(3),
    "another unit, its hello half a second late": _late(0.5, 0.5),
    "another unit, its hello late by .1 to 5 s": _late(0.1, 4.8),
    "another unit, its hello lost": _late(0.1, 0.1, answers=False),
    "another unit than the calibration's": Trouble(
        ANOTHER, True, make=lambda random: Device(unit="right-hand"), step=_foreign, calibrated="left-hand"
    ),
    "a calibration of no named unit": Trouble("names no unit", calibrated="the one with the long cable"),
    "another unit goes on without a gap": _taken_over(),
    "another unit goes on without a gap, busy host": _taken_over(make=_Loaded),
    "another unit goes on and says so twice": _taken_over(hellos=2),
    "another unit goes on after a small gap": _taken_over(ahead=9, clock=0.3),
    "sound, busy host": Trouble(make=lambda random: _Loaded()),
    "hellos that say it is idle": Trouble("told to send", step=every(60, _idle)),
    "results of a test unasked": Trouble("test", counted=True, step=every(40, _tested)),
    "strips that do not fill the body": Trouble("length|kind|corrupt", counted=True, step=every(11, _short)),
    "one zero between frames": Trouble(step=_one_zero),
    "two scans of one number": Trouble(
        "number|duplicate|twice|again", counted=True, step=every(17, _standing)
    ),
    "number leaps by 2^31": Trouble(
        "lost|missing|number|" + RESTART, counted=True, onset=1.5, step=once(_leap)
    ),
    "number anew, clock goes on": Trouble(
        "number|" + RESTART, counted=True, onset=1.5, step=once(_number_alone)
    ),
    "clock in steps of 16 ms": Trouble(make=lambda random: Device(clock=_coarse)),
    "hello of other bits": Trouble(
        "another|bits|hello|" + ANOTHER, True, step=every(150, _hello_of_other_bits)
    ),
    "a span of 71 minutes": Trouble(CLOCK + "|span", counted=True, step=every(13, _long_span)),
}


def score(seed: int, number: int) -> dict[str, Any]:
    """Record one of them."""
    return device_set.score(seed, number, TROUBLES)

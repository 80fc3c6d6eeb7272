"""More devices that misbehave: frames, hellos and numbers as docs/reference/protocol.md allows or forbids them."""

from __future__ import annotations

import struct
import time
from dataclasses import dataclass
from typing import Any

from studies.holdout import device_set
from studies.holdout.device_set import ANOTHER, CLOCK, RESTART, Device, Trouble, every, framed, once


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
    """A unit that is slow to answer, behind an old hello of the unit before it."""

    asked: float = 0.0

    def obey(self) -> None:
        """Answer what came half a second ago."""
        if not self.asked:
            self.asked = time.monotonic()
            self.unit, name = "left-hand", self.unit
            self.put(self.hello())
            self.unit = name
        if time.monotonic() > self.asked + 0.5:
            super().obey()


def _cold(old: int) -> Trouble:
    return Trouble(
        ANOTHER,
        True,
        make=lambda random: _Behind(unit="right-hand", old=old),
        before=lambda d: b"",
        step=_foreign,
    )


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
    "another unit, its hello half a second late": Trouble(
        ANOTHER, True, make=lambda random: _Slow(unit="right-hand"), before=lambda d: b"", step=_foreign
    ),
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

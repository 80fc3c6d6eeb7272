"""What the host asks of the device, and what a frame says that is no scan (docs/protocol.md)."""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from typing import Self, TypeAlias

from tacstrip.errors import OptionError
from tacstrip.stream.device.protocol.frames import Frame, Kind, seal
from tacstrip.stream.device.protocol.messages import Hello, Reply, SelfTest

LONGEST_PERIOD_US = 60_000_000
_PERIOD = struct.Struct("<I")


class Status(enum.IntEnum):
    """How a command went."""

    DONE = 0
    UNKNOWN = 1
    BAD_BODY = 2
    OTHER_VERSION = 3


@dataclass(frozen=True)
class Command:
    """What the host asks of the device.

    Attributes
    ----------
    kind
        IDENTIFY, START, STOP, RATE or TEST.
    sequence
        The host's own number, which the reply repeats.
    period_us
        RATE alone: from scan to scan [us], 0 for as fast as it goes.
    """

    kind: int
    sequence: int = 0
    period_us: int | None = None

    def encode(self, time_us: int = 0) -> bytes:
        """Return the frame.

        Raises
        ------
        OptionError
            It is no command, or a rate without a period of 0 to a minute.
        """
        if not Kind.IDENTIFY <= self.kind <= Kind.TEST:
            raise OptionError(f"kind {self.kind:#04x} is no command; commands are 0x81 to 0x85")
        if (self.kind == Kind.RATE) != (self.period_us is not None):
            raise OptionError("period_us belongs to the command RATE, and only to it")
        if self.period_us is None:
            return seal(self.kind, b"", self.sequence, time_us)
        if not 0 <= self.period_us <= LONGEST_PERIOD_US:
            raise OptionError(f"period_us = {self.period_us}: must be 0 to {LONGEST_PERIOD_US}")
        return seal(self.kind, _PERIOD.pack(self.period_us), self.sequence, time_us)

    @classmethod
    def parse(cls, frame: Frame) -> Self | None:
        """Return the command, or None where the body does not fit it."""
        wanted = _PERIOD.size if frame.kind == Kind.RATE else 0
        if len(frame.body) != wanted:
            return None
        return cls(frame.kind, frame.sequence, _PERIOD.unpack(frame.body)[0] if wanted else None)


Message: TypeAlias = Hello | Reply | SelfTest | Command


def parsed(frame: Frame) -> Message | None:
    """Return what a frame says, or None where it is a scan, of no known kind, or its body does not fit."""
    if frame.kind in _PARSERS:
        return _PARSERS[frame.kind].parse(frame.body)
    return Command.parse(frame) if Kind.IDENTIFY <= frame.kind <= Kind.TEST else None


_PARSERS: dict[int, type[Hello | Reply | SelfTest]] = {
    Kind.HELLO: Hello,
    Kind.REPLY: Reply,
    Kind.TESTED: SelfTest,
}

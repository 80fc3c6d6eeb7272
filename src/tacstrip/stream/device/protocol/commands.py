"""Commands from the host to the device, and the parser of all messages that are not scans (docs/protocol.md)."""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from typing import Self, TypeAlias

from tacstrip.errors import OptionError
from tacstrip.stream.device.protocol.frames import Kind, WireFrame, encode_frame
from tacstrip.stream.device.protocol.messages import Hello, Reply, SelfTest

MAX_PERIOD_US = 60_000_000
_PERIOD = struct.Struct("<I")


class Status(enum.IntEnum):
    """Outcome of a command."""

    DONE = 0
    UNKNOWN = 1
    BAD_BODY = 2
    OTHER_VERSION = 3


@dataclass(frozen=True)
class Command:
    """A command from the host to the device.

    Attributes
    ----------
    kind
        IDENTIFY, START, STOP, RATE or TEST.
    sequence
        The host's number of the command; the reply repeats it.
    period_us
        Of RATE only: time from scan to scan [us]; 0: as fast as possible.
    """

    kind: int
    sequence: int = 0
    period_us: int | None = None

    def encode(self, time_us: int = 0) -> bytes:
        """Return the frame.

        Raises
        ------
        OptionError
            The kind is not a command, or the period of RATE is not 0 to one minute.
        """
        if not Kind.IDENTIFY <= self.kind <= Kind.TEST:
            raise OptionError(f"kind {self.kind:#04x} is no command; commands are 0x81 to 0x85")
        if (self.kind == Kind.RATE) != (self.period_us is not None):
            raise OptionError("period_us belongs to the command RATE, and only to it")
        if self.period_us is None:
            return encode_frame(self.kind, b"", self.sequence, time_us)
        if not 0 <= self.period_us <= MAX_PERIOD_US:
            raise OptionError(f"period_us = {self.period_us}: must be 0 to {MAX_PERIOD_US}")
        return encode_frame(self.kind, _PERIOD.pack(self.period_us), self.sequence, time_us)

    @classmethod
    def parse(cls, frame: WireFrame) -> Self | None:
        """Return the command, or None where the body does not fit it."""
        size = _PERIOD.size if frame.kind == Kind.RATE else 0
        if len(frame.body) != size:
            return None
        return cls(frame.kind, frame.sequence, _PERIOD.unpack(frame.body)[0] if size else None)


Message: TypeAlias = Hello | Reply | SelfTest | Command


def parse_message(frame: WireFrame) -> Message | None:
    """Return the message of a frame; None where it is a scan, of unknown kind, or its body has the wrong length."""
    if frame.kind in _PARSERS:
        return _PARSERS[frame.kind].parse(frame.body)
    return Command.parse(frame) if Kind.IDENTIFY <= frame.kind <= Kind.TEST else None


_PARSERS: dict[int, type[Hello | Reply | SelfTest]] = {
    Kind.HELLO: Hello,
    Kind.REPLY: Reply,
    Kind.TESTED: SelfTest,
}

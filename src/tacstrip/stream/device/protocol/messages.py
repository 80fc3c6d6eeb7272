"""Messages but scans: identification, replies, self-test, commands, and their parser (docs/reference/protocol.md)."""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass, field, replace
from typing import Self, TypeAlias

import numpy as np

from tacstrip.arrays import BoolArray
from tacstrip.errors import OptionError
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.stream.device.protocol.frames import Kind, WireFrame, encode_frame

MAX_PERIOD_US = 60_000_000
_BITS = {name: 1 << i for i, name in enumerate(SIGNATURES)}  # kh 1, kl 2, k 4
_HELLO = struct.Struct("<HB5BHIIII16s16s")
_REPLY = struct.Struct("<BIBI")
_TESTED = struct.Struct("<HHI")
_PERIOD = struct.Struct("<I")


@dataclass(frozen=True, kw_only=True)
class Hello:
    """Identification of a device: sent when it starts, and on request.

    Attributes
    ----------
    construction, unit_name
        Up to 16 characters of ASCII each.
    strips, signatures, adc_bits
        Contents of its scans.
    version
        Version of the firmware.
    streaming
        Whether it is sending scans.
    supply_mv
        Its Vref [mV]; 0 where it cannot measure that.
    baud
        Speed of the line [baud].
    period_us
        Time from scan to scan [us]; 0: as fast as possible.
    cycle_us
        Time to read all strips [us].
    late
        Number of scans since the last start that began a period or more too late.
    number
        Of the scan that comes next, as the frame's header says; not part of the body.
    """

    construction: str
    strips: int
    signatures: tuple[str, ...]
    adc_bits: int
    version: tuple[int, int, int] = (1, 0, 0)
    streaming: bool = False
    supply_mv: int = 0
    baud: int = 0
    period_us: int = 0
    cycle_us: int = 0
    late: int = 0
    unit_name: str = "tacstrip"
    number: int = field(default=0, compare=False)

    def encode(self, sequence: int = 0, time_us: int = 0) -> bytes:
        """Return the frame. `sequence` is the number of the scan that comes next.

        Raises
        ------
        OptionError
            A value does not fit its field.
        """
        names = (_encoded("construction", self.construction), _encoded("unit_name", self.unit_name))
        numbers = (self.supply_mv, self.baud, self.period_us, self.cycle_us, self.late)
        head = (self.strips, mask_of(self.signatures), self.adc_bits, *self.version, self.streaming)
        return encode_frame(Kind.HELLO, _packed("hello", _HELLO, *head, *numbers, *names), sequence, time_us)

    @classmethod
    def parse(cls, body: bytes) -> Self | None:
        """Return the message, or None where the body has the wrong length."""
        if len(body) != _HELLO.size:
            return None
        strips, mask, bits, *version, streaming, supply, baud, period, cycle, late, kind, name = (
            _HELLO.unpack(body)
        )
        return cls(
            construction=_decoded(kind), strips=strips, signatures=names_of(mask), adc_bits=bits,
            version=(version[0], version[1], version[2]), streaming=bool(streaming), supply_mv=supply, baud=baud,
            period_us=period, cycle_us=cycle, late=late, unit_name=_decoded(name),
        )  # fmt: skip


@dataclass(frozen=True)
class Reply:
    """Reply to a command: its kind and sequence, the status, and a number (see docs/reference/protocol.md)."""

    command: int
    command_sequence: int
    status: int
    value: int

    def encode(self, sequence: int = 0, time_us: int = 0) -> bytes:
        """Return the frame; arguments and errors as of `Hello.encode`."""
        body = _packed("reply", _REPLY, self.command, self.command_sequence, self.status, self.value)
        return encode_frame(Kind.REPLY, body, sequence, time_us)

    @classmethod
    def parse(cls, body: bytes) -> Self | None:
        """Return the message, or None where the body has the wrong length."""
        return cls(*_REPLY.unpack(body)) if len(body) == _REPLY.size else None


@dataclass(frozen=True, eq=False)
class SelfTest:
    """Result of the self-test.

    Attributes
    ----------
    supply_mv
        Vref [mV]; 0 where the device cannot measure it.
    late
        Number of late scans, as of `Hello`.
    held
        By signature, the strips (strips,) whose line did not follow its pull-up and pull-down.
    """

    supply_mv: int
    late: int
    held: dict[str, BoolArray]

    def encode(self, sequence: int = 0, time_us: int = 0) -> bytes:
        """Return the frame; arguments and errors as of `Hello.encode`."""
        flags = np.sum([np.asarray(v) * _BITS[name] for name, v in self.held.items()], axis=0)
        body = _packed("test", _TESTED, len(flags), self.supply_mv, self.late)
        return encode_frame(Kind.TESTED, body + flags.astype(np.uint8).tobytes(), sequence, time_us)

    @classmethod
    def parse(cls, body: bytes) -> Self | None:
        """Return the message, or None where the body has the wrong length."""
        if len(body) < _TESTED.size:
            return None
        strips, supply, late = _TESTED.unpack_from(body)
        flags = np.frombuffer(body, np.uint8, offset=_TESTED.size)
        if len(flags) != strips:
            return None
        return cls(supply, late, {name: (flags & bit) > 0 for name, bit in _BITS.items()})


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
        message = _PARSERS[frame.kind].parse(frame.body)
        return replace(message, number=frame.sequence) if isinstance(message, Hello) else message
    return Command.parse(frame) if Kind.IDENTIFY <= frame.kind <= Kind.TEST else None


_PARSERS: dict[int, type[Hello | Reply | SelfTest]] = {
    Kind.HELLO: Hello,
    Kind.REPLY: Reply,
    Kind.TESTED: SelfTest,
}


def mask_of(signatures: tuple[str, ...]) -> int:
    """Return signatures as bits, 1 kh, 2 kl, 4 k; those of other names raise `OptionError`."""
    if unknown := [name for name in signatures if name not in _BITS]:
        raise OptionError(f"{unknown[0]!r} does not go over the wire; what does: {', '.join(_BITS)}")
    return sum(_BITS[name] for name in set(signatures))


def names_of(mask: int) -> tuple[str, ...]:
    """Return the signatures of bits."""
    return tuple(name for name, bit in _BITS.items() if mask & bit)


def _packed(name: str, layout: struct.Struct, *values: object) -> bytes:
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise OptionError(f"a number does not fit its field of a {name} frame ({error})") from None


def is_name(text: str) -> bool:
    """Return whether a device can have this name."""
    return 0 < len(text) <= 16 and text.isascii() and text.isprintable()


def _encoded(name: str, value: str) -> bytes:
    if value and not is_name(value):
        raise OptionError(f"{name} = {value!r}: must be up to 16 printable ASCII characters")
    return value.encode()


def _decoded(field: bytes) -> str:
    """Return a device's text with a mark in place of each byte that is none, such as an escape for a terminal."""
    text = field.rstrip(b"\0").decode("ascii", "replace")
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)

"""Messages from the device other than scans: identification, replies to commands, self-test (docs/protocol.md)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Self

import numpy as np

from tacstrip.arrays import BoolArray
from tacstrip.errors import OptionError
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.stream.device.protocol.frames import Kind, encode_frame

_BITS = {name: 1 << i for i, name in enumerate(SIGNATURES)}  # kh 1, kl 2, k 4
_HELLO = struct.Struct("<HB5BHIIII16s16s")
_REPLY = struct.Struct("<BIBI")
_TESTED = struct.Struct("<HHI")


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
        try:
            return encode_frame(Kind.HELLO, _HELLO.pack(*head, *numbers, *names), sequence, time_us)
        except struct.error as error:
            raise OptionError(f"a number does not fit its field of a hello frame ({error})") from None

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
    """Reply to a command: its kind and sequence, the status, and a number (see docs/protocol.md)."""

    command: int
    command_sequence: int
    status: int
    value: int

    def encode(self, sequence: int = 0, time_us: int = 0) -> bytes:
        """Return the frame; arguments and errors as of `Hello.encode`."""
        try:
            body = _REPLY.pack(self.command, self.command_sequence, self.status, self.value)
        except struct.error as error:
            raise OptionError(f"a number does not fit its field of a reply frame ({error})") from None
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
        try:
            body = _TESTED.pack(len(flags), self.supply_mv, self.late) + flags.astype(np.uint8).tobytes()
        except struct.error as error:
            raise OptionError(f"a number does not fit its field of a test frame ({error})") from None
        return encode_frame(Kind.TESTED, body, sequence, time_us)

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


def mask_of(signatures: tuple[str, ...]) -> int:
    """Return signatures as bits, 1 kh, 2 kl, 4 k; those of other names raise `OptionError`."""
    if unknown := [name for name in signatures if name not in _BITS]:
        raise OptionError(f"{unknown[0]!r} does not go over the wire; what does: {', '.join(_BITS)}")
    return sum(_BITS[name] for name in set(signatures))


def names_of(mask: int) -> tuple[str, ...]:
    """Return the signatures of bits."""
    return tuple(name for name, bit in _BITS.items() if mask & bit)


def _encoded(name: str, value: str) -> bytes:
    if not (value.isascii() and value.isprintable() and len(value) <= 16):
        raise OptionError(f"{name} = {value!r}: must be up to 16 printable ASCII characters")
    return value.encode()


def _decoded(field: bytes) -> str:
    return field.rstrip(b"\0").decode("ascii", "replace")

"""Decode the bytes of a device into scans and messages (docs/protocol.md)."""

from __future__ import annotations

import struct
from typing import NamedTuple, TypeAlias

from tacstrip.stream.device.protocol.frames import VERSION, Kind, check_frame, parse_frame
from tacstrip.stream.device.protocol.messages import Hello, Message, parse_message
from tacstrip.stream.device.protocol.scans import LAYOUT, ScanBatch, layout_of

MAX_FRAME_BYTES = 2**15  # between two zeros; a scan of 4,096 strips and two signatures has 17,000
# A scan number further ahead or behind means that the device has restarted; so do two consecutive numbers that are
# less far behind.
MAX_AHEAD, MAX_BEHIND = 2**16, 2**10
_KIND_AT, _SEQUENCE_AT = 1, struct.Struct("<xxI")


class Counts(NamedTuple):
    """What a decoder has received so far.

    Attributes
    ----------
    frames
        Intact frames that were decoded.
    corrupt
        Byte sequences between zeros that are not an intact frame, except the first, which may begin in mid-frame.
    lost
        Missing scans, by the gaps in their numbers; corrupt ones are included.
    out_of_order
        Single scans whose number had come before; they are discarded.
    unknown
        Intact frames of another version, of unknown kind or with a body of wrong length; they are discarded.
    restarts
        Number of times that the device has restarted its count.
    """

    frames: int = 0
    corrupt: int = 0
    lost: int = 0
    out_of_order: int = 0
    unknown: int = 0
    restarts: int = 0


Received: TypeAlias = ScanBatch | Message


class Decoder:
    """Decodes bytes as they come, in pieces of any length, and resynchronises after corrupt ones.

    Memory is bounded: more than `MAX_FRAME_BYTES` bytes without a zero are discarded.

    Attributes
    ----------
    counts
        What it has received so far.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._dropping = False  # until the next zero
        self._began = False  # a zero was seen
        self._next: int | None = None  # the scan number that is due
        self._clock_us: int | None = None  # of the newest scan, not wrapped
        # A scan with an old number; the next tells whether the device restarted.
        self._behind: bytes | None = None
        self.counts = Counts()

    def _count(self, **more: int) -> None:
        self.counts = Counts(*(n + more.get(name, 0) for name, n in self.counts._asdict().items()))

    def feed(self, data: bytes) -> list[Received]:
        """Return the scans, in batches, and messages of the frames that these bytes complete, in order."""
        *pieces, rest = (self._rest + data).split(b"\0")
        out: list[Received] = []
        batch: list[bytes] = []
        for piece in pieces:
            if self._dropping or not piece:
                self._dropping, self._began = False, True
                continue
            plain = check_frame(piece)
            if plain is None:
                self._count(corrupt=self._began)
            elif plain[0] == VERSION and plain[_KIND_AT] == Kind.SCAN:
                self._take_scan(plain, batch, out)
            else:
                self._flush(batch, out)
                self._take_message(plain, out)
            self._began = True
        self._flush(batch, out)
        if len(rest) > MAX_FRAME_BYTES or self._dropping:
            self._count(corrupt=not self._dropping and self._began)
            self._dropping, rest = True, b""
        self._rest = rest
        return out

    def _take_scan(self, plain: bytes, batch: list[bytes], out: list[Received]) -> None:
        layout = layout_of(plain[LAYOUT])
        if layout is None or layout.itemsize != len(plain):
            self._count(unknown=1)
            return
        number = _number(plain)
        if number != self._next and self._next is not None:
            step = (number - self._next + 2**31) % 2**32 - 2**31
            if -MAX_BEHIND <= step < 0:
                self._count(out_of_order=1)
                before, self._behind = self._behind, plain
                if before is None or not 0 < (ahead := (number - _number(before)) % 2**32) <= MAX_BEHIND:
                    return
                self._count(out_of_order=-2, lost=ahead - 1)
                self._restart(batch, out)
                batch.append(before)
            elif 0 < step < MAX_AHEAD:
                self._count(lost=step)
            else:
                self._restart(batch, out)
        self._next, self._behind = (number + 1) % 2**32, None
        if batch and batch[0][LAYOUT] != plain[LAYOUT]:
            self._flush(batch, out)
        batch.append(plain)

    def _take_message(self, plain: bytes, out: list[Received]) -> None:
        frame = parse_frame(plain)
        message = parse_message(frame) if frame.version == VERSION else None
        if message is None:
            self._count(unknown=1)
            return
        if isinstance(message, Hello):
            if frame.sequence == 0 and self._next:
                self._restart([], out)
            if self._next is None or frame.sequence == 0:
                self._next, self._behind = frame.sequence, None
        self._count(frames=1)
        out.append(message)

    def _restart(self, batch: list[bytes], out: list[Received]) -> None:
        self._flush(batch, out)
        self._count(restarts=1)
        self._clock_us = None

    def _flush(self, batch: list[bytes], out: list[Received]) -> None:
        """Append the collected scans, all of one layout, to the output as one batch."""
        if not batch:
            return
        scans = ScanBatch.of(batch, self._clock_us, self.counts.restarts)
        self._clock_us = int(scans.time_us[-1])
        self._count(frames=len(scans))
        out.append(scans)
        batch.clear()


def _number(plain: bytes) -> int:
    number: int = _SEQUENCE_AT.unpack_from(plain)[0]
    return number

"""Decode the bytes of a device into scans and messages (docs/reference/protocol.md)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from tacstrip.stream.device.protocol.frames import VERSION, Kind, check_frame, parse_frame
from tacstrip.stream.device.protocol.messages import Hello, Message, parse_message
from tacstrip.stream.device.protocol.order import OrderedScan, ScanOrder
from tacstrip.stream.device.protocol.scans import LAYOUT, ScanBatch, layout_of

MAX_FRAME_BYTES = 2**15  # between two zeros; a scan of 4,096 strips and two signatures has 17,000
_KIND_AT = 1


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
        Scans that came after a later one: put in their place, or, where that has been given up, lost.
    unknown
        Intact frames of another version, of unknown kind or with a body of wrong length; they are discarded.
    restarts
        Number of times that the device has restarted its count.
    duplicates
        Scans that came again, byte by byte; they are discarded.
    misnumbered
        Scans whose number cannot be, as their times show; they are kept as they came.
    out_of_range
        Scans with a code above 2^bits - 1; they are discarded.
    """

    frames: int = 0
    corrupt: int = 0
    lost: int = 0
    out_of_order: int = 0
    unknown: int = 0
    restarts: int = 0
    duplicates: int = 0
    misnumbered: int = 0
    out_of_range: int = 0


Received: TypeAlias = ScanBatch | Message


class Decoder:
    """Decodes bytes as they come, in pieces of any length, and resynchronises after corrupt ones.

    Memory is bounded: more than `MAX_FRAME_BYTES` bytes without a zero are discarded. Scans behind a gap in the
    numbers wait for a moment, as the missing one may still come.

    Attributes
    ----------
    counts
        What it has received so far.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._dropping = False  # until the next zero
        self._began = False  # a zero was seen
        self._order = ScanOrder(self._count)
        self._clock_us: int | None = None  # of the newest scan, not wrapped
        self.counts = Counts()

    def _count(self, **more: int) -> None:
        self.counts = Counts(*(n + more.get(name, 0) for name, n in self.counts._asdict().items()))

    def feed(self, data: bytes) -> list[Received]:
        """Return the scans, in batches, and messages of the frames that these bytes complete, in order.

        Without bytes, as nothing came for a while: the scans that wait for a missing one.
        """
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
        if not data:
            self._append(self._order.release(), batch, out)
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
        else:
            self._append(self._order.take(plain), batch, out)

    def _append(self, scans: Iterator[OrderedScan], batch: list[bytes], out: list[Received]) -> None:
        for plain, restarted in scans:
            if restarted:
                self._flush(batch, out, before_restart=True)
                self._clock_us = None
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
            if self._order.next is None:
                self._order.next = frame.sequence
            elif frame.sequence == 0 and self._order.next:
                self._order.announced = True
        self._count(frames=1)
        out.append(message)

    def _flush(self, batch: list[bytes], out: list[Received], before_restart: bool = False) -> None:
        """Append the collected scans, all of one layout, to the output as one batch."""
        if not batch:
            return
        restarts = self.counts.restarts - before_restart
        scans = ScanBatch.of(batch, self._clock_us, restarts)
        self._clock_us = int(scans.time_us[-1])
        good = scans.in_range()
        self._count(frames=len(scans), out_of_range=len(scans) - len(good))
        if len(good):
            out.append(good)
        batch.clear()

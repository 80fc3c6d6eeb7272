"""A device that misbehaves, from docs/reference/protocol.md alone: own frames, COBS and CRC, on the test's clock."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

from one_clock import Clock

BITS, STRIPS = 10, 6
Trouble = Callable[["Rogue", int, bytes], list[bytes]]


def _shifted(value: int) -> int:
    for _ in range(8):
        value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return value


_SHIFTED = [_shifted(byte << 8) for byte in range(256)]


def crc(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ _SHIFTED[value >> 8 ^ byte]
    return value


def frame(
    kind: int, number: int, time_us: int, body: bytes, version: int = 1, empty_block: bool = False
) -> bytes:
    """A frame between its zeros; with `empty_block` after a full last one, as some encoders write it."""
    plain = struct.pack("<BBII", version, kind, number % 2**32, time_us % 2**32) + body
    plain += struct.pack(">H", crc(plain))
    out, block = bytearray(), bytearray()
    full = False
    for byte in plain:
        full = False
        if byte:
            block.append(byte)
        if not byte or len(block) == 254:
            out += bytes([len(block) + 1]) + block
            full = bool(byte)
            block.clear()
    if not full or empty_block:
        out += bytes([len(block) + 1]) + block
    return b"\0" + bytes(out) + b"\0"


class Rogue:
    """Sends a scan each period; what it does with the bytes of scan i is the trouble's.

    The codes of a scan say which it is; `sent` has those whose frame was sent intact.
    """

    def __init__(
        self, clock: Clock, trouble: Trouble = lambda device, i, data: [data], period_us: int = 10_000,
        name: bytes = b"left", stamp: Callable[[int], int] = int, number: Callable[[int], int] = int,
    ) -> None:  # fmt: skip
        self.clock, self.trouble, self.period_us, self.name = clock, trouble, period_us, name
        self.stamp, self.number = stamp, number
        self.random = np.random.default_rng(2)
        self.boot_s, self.start_s = clock.now_s - 3.21, 0.0
        self.streaming, self.i = False, 0
        self.out, self.heard, self.commands = b"", b"", list[int]()
        self.deaf_to: set[int] = set()
        self.refuses: set[int] = set()
        self.keep: list[bytes] = []
        self.silent = False
        self.supply_mv = 5000
        self.late = 0

    @property
    def now_us(self) -> int:
        return self.stamp(round((self.clock.now_s - self.boot_s) * 1e6))

    def scan(
        self,
        i: int,
        codes: np.ndarray | None = None,
        strips: int = STRIPS,
        padding: int = 0,
        span_us: int = 500,
    ) -> bytes:
        values = np.full(2 * strips, 1, "<u2") if codes is None else codes
        values[:2] = i % 1000, i // 1000
        body = (
            struct.pack("<HBBI", strips, 3, BITS, span_us)
            + bytes([0x3F | padding])
            + values.astype("<u2").tobytes()
        )
        return frame(1, self.number(i), self.now_us, body)

    def hello(
        self, streaming: bool | None = None, number: int | None = None, name: bytes | None = None
    ) -> bytes:
        on = self.streaming if streaming is None else streaming
        body = struct.pack("<HBBBBBBHI", STRIPS, 3, BITS, 7, 0, 0, on, self.supply_mv, 0)
        body += struct.pack("<III", self.period_us, 700, self.late)
        body += struct.pack("16s16s", b"crs-crs", self.name if name is None else name)
        return frame(2, self.number(self.i) if number is None else number, self.now_us, body)

    def write(self, data: bytes) -> None:
        *pieces, self.heard = (self.heard + data).split(b"\0")
        for piece in filter(None, pieces):
            plain, at = bytearray(), 0
            while at < len(piece):
                plain += piece[at + 1 : at + piece[at]] + b"\0"
                at += piece[at]
            kind, number = plain[1], plain[2:6]
            self.commands.append(kind)
            if kind in self.deaf_to:
                continue
            if kind == 0x81:
                self.out += self.hello()
                continue
            status = kind in self.refuses
            if kind in (0x82, 0x83) and not status:
                self.streaming, self.start_s = kind == 0x82, self.clock.now_s
            if kind == 0x84 and not status:
                self.period_us = int.from_bytes(plain[10:14], "little")
            body = bytes([kind]) + number + bytes([2 if status else 0]) + struct.pack("<I", self.period_us)
            self.out += frame(3, self.number(self.i), self.now_us, body)

    def read(self, wait_s: float) -> bytes:
        if not self.out and self.streaming and not self.silent:
            due_s = self.start_s + self.period_us * 1e-6
            if due_s - self.clock.now_s > wait_s:
                self.clock.now_s += wait_s
                return b""
            self.clock.now_s = max(due_s, self.clock.now_s)
            self.start_s = due_s
            self.out += b"".join(self.trouble(self, self.i, self.scan(self.i)))
            self.i += 1
        elif not self.out:
            self.clock.now_s += wait_s
        data, self.out = self.out, b""
        return data

    def close(self) -> None:
        """Nothing is open."""

"""Scans on the wire: layout of the frames, batches of them as arrays, and encoding (docs/reference/protocol.md)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray
from tacstrip.errors import OptionError
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.stream.device.protocol.frames import HEADER, Kind, encode_frame
from tacstrip.stream.device.protocol.messages import mask_of, names_of
from tacstrip.stream.source import CodeArray, RawScan

MAX_STRIPS = 4096
LAYOUT = slice(HEADER.size, HEADER.size + 4)  # the bytes of a frame that define its layout
_SCAN = struct.Struct("<HBBI")  # strips, signatures, bits, span [us]
_EVERY = mask_of(tuple(SIGNATURES))


@dataclass(frozen=True, eq=False)
class ScanBatch:
    """Consecutive scans of one layout.

    Attributes
    ----------
    sequence
        Numbers of the scans (scans,).
    time_us
        Time of the first strip's reading (scans,) [us], by the device's clock, which counts from its start.
    span_us
        Time from the first strip to the last (scans,) [us]; those between are read at equal intervals.
    touched
        Touched strips (scans, strips).
    codes
        A/D codes by signature (scans, strips).
    adc_bits
        Codes run from 0 to 2^adc_bits - 1.
    restarts
        `Counts.restarts` at their arrival; a new value means that the device's clock has restarted.
    """

    sequence: npt.NDArray[np.uint32]
    time_us: npt.NDArray[np.int64]
    span_us: npt.NDArray[np.uint32]
    touched: BoolArray
    codes: Mapping[str, CodeArray]
    adc_bits: int
    restarts: int

    def __len__(self) -> int:
        return len(self.sequence)

    @classmethod
    def of(cls, frames: list[bytes], before_us: int | None, restarts: int) -> Self:
        """Return frames of one valid layout as a batch.

        `before_us` is the time of the previous scan, from which the wrapped 32-bit times continue; no gap may be longer
        than half their range, 35 minutes.
        """
        layout = layout_of(frames[0][LAYOUT])
        assert layout is not None
        rows = np.frombuffer(b"".join(frames), layout)
        strips, mask, bits, _ = _SCAN.unpack_from(frames[0], HEADER.size)
        touched = np.unpackbits(rows["touched"], axis=1, count=strips, bitorder="little").view(np.bool_)
        codes = {name: rows["codes"][:, i] for i, name in enumerate(names_of(mask))}
        raw = rows["time_us"]
        before = int(raw[0]) if before_us is None else before_us
        previous = np.concatenate((np.array([before % 2**32], np.uint32), raw[:-1]))
        # Differences are modulo 2^32; as signed numbers they take the shorter direction.
        times = before + np.cumsum((raw - previous).astype(np.int32), dtype=np.int64)
        return cls(rows["sequence"], times, rows["span_us"], touched, codes, bits, restarts)

    def in_range(self) -> Self:
        """Return the scans none of whose codes is above 2^adc_bits - 1."""
        top = 2**self.adc_bits - 1
        bad = np.zeros(len(self), dtype=bool)
        for values in self.codes.values():
            bad |= values.max(axis=1) > top
        if not bad.any():
            return self
        fields = {name: getattr(self, name)[~bad] for name in ("sequence", "time_us", "span_us", "touched")}
        return replace(self, codes={name: values[~bad] for name, values in self.codes.items()}, **fields)

    def scans(self) -> Iterator[RawScan]:
        """Yield the scans, their times by the device's clock."""
        strips = self.touched.shape[1]
        steps = np.arange(strips) / max(strips - 1, 1) * 1e-6
        offsets = self.span_us[:, None] * steps  # (scans, strips) [s]
        times, numbers = (self.time_us / 1e6).tolist(), self.sequence.tolist()
        for i, (time_s, number) in enumerate(zip(times, numbers, strict=True)):
            codes = {name: values[i] for name, values in self.codes.items()}
            yield RawScan(time_s, codes, self.touched[i], number, offsets[i])


@lru_cache(maxsize=64)
def layout_of(key: bytes) -> np.dtype[Any] | None:
    """Return the layout of a scan's header and body, from the body's first 4 bytes; None where they are invalid."""
    if len(key) != 4:
        return None
    strips, mask, bits = struct.unpack("<HBB", key)
    signatures = names_of(mask)
    if not (1 <= strips <= MAX_STRIPS and 1 <= mask <= _EVERY and 1 <= bits <= 16):
        return None
    head = [("version", "u1"), ("kind", "u1"), ("sequence", "<u4"), ("time_us", "<u4")]
    body = [("strips", "<u2"), ("signatures", "u1"), ("bits", "u1"), ("span_us", "<u4")]
    fields = [("touched", "u1", ((strips + 7) // 8,)), ("codes", "<u2", (len(signatures), strips))]
    return np.dtype(head + body + fields)


def encode_scan(scan: RawScan, adc_bits: int, sequence: int | None = None) -> bytes:
    """Return the frame of a scan; `sequence` is the scan's own by default.

    Raises
    ------
    OptionError
        It has codes that the protocol does not know, more than `MAX_STRIPS` strips, or a code that needs more bits.
    """
    names = names_of(mask_of(tuple(scan.codes)))
    codes = np.stack([scan.codes[name] for name in names])
    strips = len(scan.touched)
    if not 1 <= strips <= MAX_STRIPS:
        raise OptionError(f"{strips} strips: a scan on the wire has 1 to {MAX_STRIPS}")
    if not 1 <= adc_bits <= 16 or codes.max() >= 2**adc_bits:
        raise OptionError(f"adc_bits = {adc_bits}: must be 1 to 16, and enough for the code {codes.max()}")
    first, last = (0.0, 0.0) if scan.strip_time_s is None else scan.strip_time_s[[0, -1]].tolist()
    body = _SCAN.pack(strips, mask_of(names), adc_bits, round((last - first) * 1e6))
    touched = np.packbits(scan.touched, bitorder="little").tobytes()
    number = scan.sequence if sequence is None else sequence
    time_us = round((scan.time_s + first) * 1e6)
    return encode_frame(Kind.SCAN, body + touched + codes.astype("<u2").tobytes(), number, time_us)

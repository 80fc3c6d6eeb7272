"""Where an MCAP file's records go on after damaged bytes."""

from __future__ import annotations

import re
import struct
from typing import IO

from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
LARGEST = 2**26  # bytes; no record or chunk of ours comes near
FRAME = struct.Struct("<BQ")
_FOOTER = 20  # bytes
_SUMMARY = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX)  # what it may begin with
_BLOCK = 2**14  # small: files that make us look often must not make us read much
# Length, two times, size, checksum, compression, size: numbers below 2^32 show as zero bytes, which garbage lacks.
_CHUNK = re.compile(
    rb"\x06.{4}\0{4}.{16}.{4}\0{4}.{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd).{4}\0{4}", re.DOTALL
)
_LONGEST = 53  # bytes that the pattern takes at most


def head(file: IO[bytes], at: int, size: int) -> tuple[int, int] | None:
    """Return opcode and length of the record at a place, None where no whole record can be."""
    file.seek(at)
    data = file.read(FRAME.size)
    if len(data) < FRAME.size:
        return None
    opcode, length = FRAME.unpack(data)
    over = at + FRAME.size + length > size
    ends = opcode == Opcode.FOOTER and at + FRAME.size + _FOOTER + len(MAGIC) != size
    return None if opcode == 0 or over or ends or length > LARGEST else (opcode, length)


def is_chunk(body: bytes) -> bool:
    """Tell whether a record's body is laid out as a chunk's, whatever its opcode says."""
    data = FRAME.pack(Opcode.CHUNK, len(body)) + body[:_LONGEST]
    return (found := _CHUNK.match(data)) is not None and _fits(found)


def resume(file: IO[bytes], since: int, size: int) -> int | None:
    """Return where records go on: at the next chunk, else at the summary or the footer; None if nowhere.

    Parameters
    ----------
    file, size
        The file and its length.
    since
        Where to look from.
    """
    at = since
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK + _LONGEST)
        start = 0
        while (found := _CHUNK.search(block, start)) is not None:
            if _fits(found) and head(file, at + found.start(), size) is not None:
                return at + found.start()
            start = found.start() + 1
        at += _BLOCK
    return _end(file, since, size)


def _fits(found: re.Match[bytes]) -> bool:
    """Check that a chunk's inner and outer lengths agree."""
    data = found.group()
    _, length = FRAME.unpack_from(data)
    (inner,) = struct.unpack("<Q", data[-8:])
    return int(length) == len(data) - FRAME.size + int(inner)


def _end(file: IO[bytes], since: int, size: int) -> int | None:
    """Return where the summary starts, or else the footer, where the file ends as an MCAP file does."""
    footer = size - len(MAGIC) - _FOOTER - FRAME.size
    if footer < since or head(file, footer, size) != (Opcode.FOOTER, _FOOTER):
        return None
    (summary,) = struct.unpack("<Q", file.read(8))
    first = head(file, summary, size) if since <= summary < footer else None
    return summary if first is not None and first[0] in _SUMMARY else footer

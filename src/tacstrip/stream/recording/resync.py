"""Find where the records of an MCAP file continue after damaged bytes."""

from __future__ import annotations

import re
import struct
from typing import IO

from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 2**26  # bytes of a record; ours are far smaller
RECORD_HEAD = struct.Struct("<BQ")
_FOOTER = 20  # bytes
_SUMMARY = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX)  # what it may begin with
_BLOCK = 2**14  # small: a file that needs many searches must not need much reading
# Length, two times, size, CRC, compression, size: lengths below 2^32 have zero bytes, which garbage lacks.
_CHUNK = re.compile(
    rb"\x06.{4}\0{4}.{16}.{4}\0{4}.{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd).{4}\0{4}", re.DOTALL
)
_MAX_MATCH = 53  # most bytes that the pattern matches


def head(file: IO[bytes], at: int, size: int) -> tuple[int, int] | None:
    """Return opcode and length of the record at an offset; None where no whole record can be there."""
    file.seek(at)
    data = file.read(RECORD_HEAD.size)
    if len(data) < RECORD_HEAD.size:
        return None
    opcode, length = RECORD_HEAD.unpack(data)
    over = at + RECORD_HEAD.size + length > size
    ends = opcode == Opcode.FOOTER and at + RECORD_HEAD.size + _FOOTER + len(MAGIC) != size
    return None if opcode == 0 or over or ends or length > MAX_RECORD_BYTES else (opcode, length)


def is_chunk(body: bytes) -> bool:
    """Return whether a record's body has the layout of a chunk, whatever its opcode."""
    data = RECORD_HEAD.pack(Opcode.CHUNK, len(body)) + body[:_MAX_MATCH]
    return (found := _CHUNK.match(data)) is not None and _fits(found)


def resume(file: IO[bytes], since: int, size: int) -> int | None:
    """Return where records continue: at the next chunk, else at the summary or the footer; None if nowhere.

    Parameters
    ----------
    file, size
        The file and its length.
    since
        Offset where the search begins.
    """
    at = since
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK + _MAX_MATCH)
        start = 0
        while (found := _CHUNK.search(block, start)) is not None:
            if _fits(found) and head(file, at + found.start(), size) is not None:
                return at + found.start()
            start = found.start() + 1
        at += _BLOCK
    return _end(file, since, size)


def _fits(found: re.Match[bytes]) -> bool:
    """Return whether a chunk's inner and outer lengths agree."""
    data = found.group()
    _, length = RECORD_HEAD.unpack_from(data)
    (inner,) = struct.unpack("<Q", data[-8:])
    return int(length) == len(data) - RECORD_HEAD.size + int(inner)


def _end(file: IO[bytes], since: int, size: int) -> int | None:
    """Return the offset of the summary, or else of the footer; None where the file lacks the end of an MCAP file."""
    footer = size - len(MAGIC) - _FOOTER - RECORD_HEAD.size
    if footer < since or head(file, footer, size) != (Opcode.FOOTER, _FOOTER):
        return None
    (summary,) = struct.unpack("<Q", file.read(8))
    first = head(file, summary, size) if since <= summary < footer else None
    return summary if first is not None and first[0] in _SUMMARY else footer

"""Read the records of an MCAP file, cut or damaged as it may be, with bounded memory and time.

The mcap package parses single records. Its StreamReader is not used: it takes the memory that a compressed chunk
claims, does not check attachments' CRC, and cannot resume after damage (docs/decisions/). This reader reads a cut
file up to the cut, and a damaged one past the damage: it looks for where records continue.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema, Statistics

from tacstrip.errors import RecordingError
from tacstrip.files import why_unreadable

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
_BROKEN = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError)


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


_MAX_READ_FACTOR = 8  # times the file's length: a limit for files made to be read again and again
_READERS: dict[int, Any] = {
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.STATISTICS: Statistics,
}


@dataclass
class Condition:
    """Condition of a file; complete once it was read to its end.

    Attributes
    ----------
    whole
        Whether the file has the end of an MCAP file.
    good_bytes
        Offset of the end of the last whole record.
    total_bytes
        Length of the file.
    damage
        Description and offset of each damaged place before that.
    """

    whole: bool
    good_bytes: int
    total_bytes: int
    damage: list[str]

    @property
    def lost_bytes(self) -> int:
        """Number of bytes after the last whole record of a file without its end."""
        return 0 if self.whole else self.total_bytes - self.good_bytes


class Records:
    """The records of a file's data section and of its summary: iterate once, then read `condition`.

    It yields attachments, metadata, schemas, channels, statistics and messages, the contents of chunks one by one; a
    damaged record is skipped and described in `condition`.

    Raises
    ------
    RecordingError
        The file cannot be read or is not an MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if why := why_unreadable(path):
            raise RecordingError(f"{path}: {why}")
        try:
            self._file: IO[bytes] = self.path.open("rb")
            size = self.path.stat().st_size
            start = self._file.read(len(MAGIC))
        except FileNotFoundError:
            raise RecordingError(f"{path}: no such file") from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror})") from None
        self.condition = Condition(False, len(MAGIC), size, [])
        if start != MAGIC:
            self.close()
            what = "the file is empty" if not start else "not a recording: it does not begin as an MCAP file"
            if self.path.suffix.lower() == ".csv":
                what = "is readings (CSV), not a recording: `tacstrip record SENSOR READINGS -o FILE.mcap` makes one"
            raise RecordingError(f"{path}: {what}")

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()

    def __iter__(self) -> Iterator[McapRecord]:
        now, size = self.condition, self.condition.total_bytes
        at = last = now.good_bytes  # offset where a record should begin, and where the previous one began
        trusted = True  # the previous record's length is right, so that no record begins inside it
        fault = ""  # what is wrong with it
        budget = _MAX_READ_FACTOR * size
        with self._file:
            while budget > 0:
                if (found := head(self._file, at, size)) is None:
                    to = resume(self._file, at if trusted else last + 1, size)
                    if to is None:
                        break
                    begin = last if fault or to < at else at
                    now.damage.append(f"{to - begin} bytes from byte {begin} on are damaged")
                    at, trusted, fault = to, False, ""
                    continue
                now.damage += [fault] if fault else []
                opcode, body = found[0], self._file.read(found[1])
                budget -= len(body)
                fault = ""
                try:
                    yield from _records(opcode, body)
                except _BROKEN as error:
                    fault = f"the record at byte {at} is damaged ({str(error) or 'cut short'})"
                trusted = is_chunk(body) or (opcode == Opcode.ATTACHMENT and not fault)
                last, at = at, at + RECORD_HEAD.size + len(body)
                now.good_bytes = at
                if opcode == Opcode.FOOTER:
                    now.whole = self._file.read(len(MAGIC) + 1) == MAGIC
                    break
            now.damage += [fault] if fault else []


def _chunk_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of each record in a chunk; raise `ValueError` where they do not fill it."""
    file, size = io.BytesIO(data), len(data)
    at = 0
    while at < size:
        frame = head(file, at, size)
        if frame is None:
            raise ValueError("the chunk ends in the middle of a record")
        yield frame[0], file.read(frame[1])
        at += RECORD_HEAD.size + frame[1]


def _records(opcode: int, body: bytes) -> Iterator[McapRecord]:
    """Yield the contents of one record; raise one of `_BROKEN` where it is damaged."""
    if opcode == Opcode.MESSAGE:
        yield Message.read(ReadDataStream(io.BytesIO(body)), len(body))
        return
    if opcode not in _READERS:
        if not is_chunk(body):
            return
        opcode = Opcode.CHUNK  # only its opcode is damaged; its checksum covers the rest
    if opcode == Opcode.ATTACHMENT and body[-4:] != struct.pack("<I", zlib.crc32(body[:-4])):
        raise ValueError("the attachment's checksum is wrong")
    record = _READERS[opcode].read(ReadDataStream(io.BytesIO(body)))
    if not isinstance(record, Chunk):
        yield record
        return
    for inner, content in _chunk_records(_decompressed(record)):
        if inner != Opcode.CHUNK:
            yield from _records(inner, content)


def _decompressed(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == "zstd":
        reader = zstandard.ZstdDecompressor(max_window_size=MAX_RECORD_BYTES).stream_reader(data)
        data = reader.read(min(chunk.uncompressed_size, MAX_RECORD_BYTES))
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r:.20} is not supported, only zstd")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the chunk's checksum is wrong")
    return data

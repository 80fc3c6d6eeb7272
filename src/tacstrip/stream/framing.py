"""The records of an MCAP file, read so that no file, however broken, can take the memory or hang the reader.

The mcap package reads what a record holds. Its readers trust the lengths in the file, need its end, and do not check
attachments; ours reads a cut file up to where it was cut, and a damaged one past the damage.
"""

from __future__ import annotations

import io
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
from tacstrip.stream.resync import FRAME, LARGEST, MAGIC, head, is_chunk, resume

_MOST_READ = 8  # times the file's length: however the damage was made, reading ends
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
    """In what state a file is; complete once it was read to its end.

    Attributes
    ----------
    whole
        It ends as an MCAP file does.
    good_bytes
        Where the last whole record ends.
    total_bytes
        The file's length.
    damage
        What had to be left out before that, in words, with its place.
    """

    whole: bool
    good_bytes: int
    total_bytes: int
    damage: list[str]

    @property
    def lost_bytes(self) -> int:
        """Bytes after the last whole record of a file that does not end as it should."""
        return 0 if self.whole else self.total_bytes - self.good_bytes


class Records:
    """The records of a file's data section and of its summary: iterate once, then read `condition`.

    Attachments, metadata, schemas, channels and messages are given, messages out of their chunks; a record that is
    damaged is left out and told in `condition`.

    Raises
    ------
    RecordingError
        The file cannot be read or is no MCAP file.
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
            raise RecordingError(f"{path}: {what}")

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()

    def __iter__(self) -> Iterator[McapRecord]:
        now, size = self.condition, self.condition.total_bytes
        at = last = now.good_bytes  # where a record should begin, and where the one before it began
        sure = True  # that one's length is right, so that nothing is looked for inside it
        told = ""  # what is wrong with it
        left = _MOST_READ * size
        with self._file:
            while left > 0:
                if (frame := head(self._file, at, size)) is None:
                    to = resume(self._file, at if sure else last + 1, size)
                    if to is None:
                        break
                    begin = last if told or to < at else at
                    now.damage.append(f"{to - begin} bytes from byte {begin} on are damaged")
                    at, sure, told = to, False, ""
                    continue
                now.damage += [told] if told else []
                opcode, body = frame[0], self._file.read(frame[1])
                left -= len(body)
                told = ""
                try:
                    yield from _records(opcode, body)
                except _BROKEN as error:
                    told = f"the record at byte {at} is damaged ({str(error) or 'cut short'})"
                sure = is_chunk(body) or (opcode == Opcode.ATTACHMENT and not told)
                last, at = at, at + FRAME.size + len(body)
                now.good_bytes = at
                if opcode == Opcode.FOOTER:
                    now.whole = self._file.read(len(MAGIC) + 1) == MAGIC
                    break
            now.damage += [told] if told else []


_BROKEN = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError)


def _frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Give opcode and body of each record in a chunk; raises ValueError where they do not fill it."""
    file, size = io.BytesIO(data), len(data)
    at = 0
    while at < size:
        frame = head(file, at, size)
        if frame is None:
            raise ValueError("the chunk ends in the middle of a record")
        yield frame[0], file.read(frame[1])
        at += FRAME.size + frame[1]


def _records(opcode: int, body: bytes) -> Iterator[McapRecord]:
    """Give what one record holds; raises one of `_BROKEN` where it is damaged."""
    if opcode == Opcode.MESSAGE:
        yield Message.read(_stream(body), len(body))
        return
    if opcode not in _READERS:
        if not is_chunk(body):
            return
        opcode = Opcode.CHUNK  # only its opcode is damaged; its checksum guards the rest
    if opcode == Opcode.ATTACHMENT and body[-4:] != struct.pack("<I", zlib.crc32(body[:-4])):
        raise ValueError("the attachment's checksum is wrong")
    record = _READERS[opcode].read(_stream(body))
    if not isinstance(record, Chunk):
        yield record
        return
    data = _unpacked(record)
    for inner, content in _frames(data):
        if inner != Opcode.CHUNK:
            yield from _records(inner, content)


def _unpacked(chunk: Chunk) -> bytes:
    if chunk.compression not in ("zstd", ""):
        raise ValueError(f"compression {chunk.compression!r:.20} is not known here, only zstd")
    if chunk.compression == "zstd":
        reader = zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(chunk.data)
        data = reader.read(min(chunk.uncompressed_size, LARGEST))
    else:
        data = chunk.data
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the chunk's checksum is wrong")
    return data


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))

"""The records of an MCAP file, read so that no file, however broken, can take the memory or hang the reader.

The mcap package reads what a record holds. Its readers trust the lengths in the file, need its end, and do not check
attachments; ours reads a cut file up to where it was cut.
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
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema

from tacstrip.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
LARGEST = 2**26  # bytes; no record or chunk of ours comes near
_FRAME = struct.Struct("<BQ")
_READERS: dict[int, Any] = {
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
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
        Records that had to be left out, in words, with their place.
    """

    whole: bool
    good_bytes: int
    total_bytes: int
    damage: list[str]

    @property
    def lost_bytes(self) -> int:
        """Bytes after the last whole record of a file that was cut."""
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
        now = self.condition
        with self._file:
            for at, opcode, body in _frames(self._file, now.total_bytes):
                try:
                    yield from _records(opcode, body)
                except _BROKEN as error:
                    now.damage.append(f"the record at byte {at} is damaged ({str(error) or 'cut short'})")
                now.good_bytes = self._file.tell()
                if opcode == Opcode.FOOTER:
                    now.whole = self._file.read(len(MAGIC) + 1) == MAGIC
                    return


_BROKEN = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError)


def _frames(file: IO[bytes], size: int) -> Iterator[tuple[int, int, bytes]]:
    """Give place, opcode and body of each whole record, up to the first that is cut or longer than can be."""
    at = file.tell()
    while len(head := file.read(_FRAME.size)) == _FRAME.size:
        opcode, length = _FRAME.unpack(head)
        if length > min(LARGEST, size - at - _FRAME.size) or opcode == 0:
            return
        yield at, opcode, file.read(length)
        at += _FRAME.size + length


def _records(opcode: int, body: bytes) -> Iterator[McapRecord]:
    """Give what one record holds; raises one of `_BROKEN` where it is damaged."""
    if opcode == Opcode.MESSAGE:
        yield Message.read(_stream(body), len(body))
        return
    if opcode not in _READERS:
        return
    if opcode == Opcode.ATTACHMENT and body[-4:] != struct.pack("<I", zlib.crc32(body[:-4])):
        raise ValueError("the attachment's checksum is wrong")
    record = _READERS[opcode].read(_stream(body))
    if not isinstance(record, Chunk):
        yield record
        return
    data = _unpacked(record)
    for _, inner, content in _frames(io.BytesIO(data), len(data)):
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

"""Write an MCAP file that is complete after every flush, so that it stays readable when a write fails."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from io import FileIO
from pathlib import Path
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, Writer

from tacstrip.errors import RecordingError
from tacstrip.stream.recording.resync import MAGIC

CHUNK_BYTES = 65536


class _EndedFile:
    """A file that is a complete MCAP file after every `flush`: the data, then an end that the next flush overwrites.

    The end says that there is no index. Its space is allocated already, so that a full disk cannot refuse it.
    """

    def __init__(self, path: Path, force: bool) -> None:
        self.raw = FileIO(path, "w" if force else "x")
        self.saved = 0  # bytes on disk before the end
        self._buffer = bytearray()
        ending = RecordBuilder()
        DataEnd(0).write(ending)
        Footer(0, 0, 0).write(ending)
        self._end = bytes(ending.end()) + MAGIC  # type: ignore[no-untyped-call]

    def write(self, data: bytes) -> int:
        self._buffer += data
        return len(data)

    def tell(self) -> int:
        return self.saved + len(self._buffer)

    def flush(self) -> None:
        """Write the buffer to disk."""
        if self._buffer:
            self._write(bytes(self._buffer) + self._end)
            self.saved = self.tell()
            self._buffer.clear()

    def finish(self) -> None:
        """Write the buffer, which has an end of its own, and close."""
        self._write(bytes(self._buffer))
        self.saved = self.tell()
        self.raw.truncate(self.saved)
        self.raw.close()

    def rescue(self) -> None:
        """After a failed write: end the file after the data that had been saved, and close."""
        with suppress(OSError):  # if this fails too, `recover` reads the rest
            self._write(self._end)
            self.raw.truncate(self.saved + len(self._end))
        with suppress(OSError):
            self.raw.close()

    def _write(self, data: bytes) -> None:
        self.raw.seek(self.saved)
        left = memoryview(data)
        while left:
            left = left[self.raw.write(left) :]


def already_there(path: str | Path) -> str:
    """Return the message that a file is not overwritten."""
    return f"{path} exists already; choose another name, or overwrite it with --force (force=True)"


class McapFile:
    """A new MCAP file of profile ros2, compressed by zstd; `writer` writes into it, within `guard`.

    Parameters
    ----------
    path
        The file to make.
    force
        Overwrite an existing file.

    Raises
    ------
    RecordingError
        The file exists already and `force` is not set.
    OSError
        It cannot be made.
    """

    def __init__(self, path: str | Path, force: bool = False) -> None:
        self.path = Path(path)
        try:
            self._file = _EndedFile(self.path, force)
        except FileExistsError:
            raise RecordingError(already_there(path)) from None
        # `flush` ends the chunks; the writer's own limit would end them in between.
        self.writer = Writer(cast(IO[Any], self._file), chunk_size=2**62, compression=CompressionType.ZSTD)
        with self.guard():
            self.writer.start(profile="ros2", library=f"tacstrip {version('tacstrip')}")

    @property
    def closed(self) -> bool:
        """Whether the file is complete."""
        return self._file.raw.closed

    @property
    def size_bytes(self) -> int:
        """Bytes on disk so far."""
        return self._file.saved

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Context for writing: when a write fails, end the file with the data saved before, and raise the error."""
        try:
            yield
        except OSError as error:
            self._file.rescue()
            raise OSError(error.errno, error.strerror, str(self.path)) from error

    def flush(self) -> None:
        """End the chunk and write everything to disk."""
        with self.guard():
            self.writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """End the file with its index; may be called twice."""
        if not self.closed:
            with self.guard():
                self.writer.finish()  # type: ignore[no-untyped-call]
                self._file.finish()

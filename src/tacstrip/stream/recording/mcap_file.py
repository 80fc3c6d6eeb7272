"""Write an MCAP file that is complete after every flush, so that it stays readable when a write fails."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from io import FileIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, Writer

from tacstrip.errors import RecordingError
from tacstrip.stream.recording.records import MAGIC

CHUNK_BYTES = 65536
SYNC_S = 1.0  # at most, until what is written is on a durable file's disk: a power cut loses no more


def already_there(path: str | Path) -> str:
    """Return the message that a file is not overwritten."""
    return f"{path} exists already; choose another name, or overwrite it with --force (force=True)"


class McapFile:
    """A new MCAP file of profile ros2, compressed by zstd; `writer` writes into it, within `guard`.

    After every `flush` it is a complete file: the data, then an end without index that the next flush overwrites. The
    end's space is allocated already, so that a full disk cannot refuse it.

    Parameters
    ----------
    path
        The file to make.
    force
        Overwrite an existing file.
    durable
        Wait every second until the disk itself has the data, so that a power cut loses no more than that.

    Attributes
    ----------
    size_bytes
        Bytes of data on disk so far.

    Raises
    ------
    RecordingError
        The file exists already and `force` is not set.
    OSError
        It cannot be made.
    """

    def __init__(self, path: str | Path, force: bool = False, durable: bool = False) -> None:
        self.path = Path(path)
        self._durable, self._synced_s, self._synced_bytes = durable, -math.inf, 0
        self.size_bytes = 0
        try:
            self._raw = FileIO(self.path, "w" if force else "x")
        except FileExistsError:
            raise RecordingError(already_there(path)) from None
        end = RecordBuilder()
        DataEnd(0).write(end)
        Footer(0, 0, 0).write(end)
        self._end = bytes(end.end()) + MAGIC  # type: ignore[no-untyped-call]
        self._buffer = bytearray()
        stream: Any = SimpleNamespace(
            write=self._buffer.extend, tell=lambda: self.size_bytes + len(self._buffer), flush=self._save
        )
        # `flush` ends the chunks; the writer's own limit would end them in between.
        self.writer = Writer(stream, chunk_size=2**62, compression=CompressionType.ZSTD)
        with self.discarded_on_error(), self.guard():
            self.writer.start(profile="ros2", library=f"tacstrip {version('tacstrip')}")

    @property
    def closed(self) -> bool:
        """Whether the file is complete."""
        return self._raw.closed

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Context for writing: when a write fails, end the file with the data saved before, and raise the error."""
        try:
            yield
        except OSError as error:
            with suppress(OSError):  # if this fails too, `recover` reads the rest
                self._write_end()
            with suppress(OSError):
                self._raw.close()
            raise OSError(error.errno, error.strerror, str(self.path)) from error

    @contextmanager
    def discarded_on_error(self) -> Iterator[None]:
        """Context for the beginning, without which the file is none: when it fails, there is no file."""
        try:
            yield
        except BaseException:
            with suppress(OSError):
                self._raw.close()
                if self.path.is_file():
                    self.path.unlink()
            raise

    def flush(self) -> None:
        """End the chunk and write everything to disk."""
        with self.guard():
            self.writer.flush()  # type: ignore[no-untyped-call]
        self.sync()

    def sync(self) -> None:
        """Have the disk save what a durable file holds, once a second."""
        if time.monotonic() - self._synced_s >= SYNC_S:
            with self.guard():
                self._sync()

    def close(self) -> None:
        """End the file with its index; may be called twice."""
        if not self.closed:
            with self.guard():
                self.writer.finish()  # type: ignore[no-untyped-call]
                self._write(bytes(self._buffer))  # the index is an end
                self._raw.truncate(self.size_bytes + len(self._buffer))
                self.size_bytes += len(self._buffer)
                self._buffer.clear()
                self._sync()
                self._raw.close()

    def cut_back(self, size_bytes: int) -> None:
        """End the file, without an index, with what it held when it had this size after a flush."""
        self._buffer.clear()
        self.size_bytes = size_bytes
        with self.guard():
            self._write_end()
            self._sync()
            self._raw.close()

    def _write_end(self) -> None:
        self._write(self._end)
        self._raw.truncate(self.size_bytes + len(self._end))

    def _sync(self) -> None:
        """Wait until the disk has the data of a durable file, and the first time its name, too."""
        if not self._durable or self._synced_bytes == self.size_bytes:
            return
        os.fsync(self._raw.fileno())
        if self._synced_s == -math.inf and hasattr(os, "O_DIRECTORY"):
            folder = os.open(self.path.parent, os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        self._synced_s, self._synced_bytes = time.monotonic(), self.size_bytes

    def _save(self) -> None:
        if self._buffer:
            self._write(bytes(self._buffer) + self._end)
            self.size_bytes += len(self._buffer)
            self._buffer.clear()

    def _write(self, data: bytes) -> None:
        self._raw.seek(self.size_bytes)
        left = memoryview(data)
        while left:
            left = left[self._raw.write(left) :]

"""An MCAP file being written: whole after every flush, so that it stays readable when a write fails."""

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
from tacstrip.stream.resync import MAGIC

CHUNK_BYTES = 65536


class _Ended:
    """A file that is a whole MCAP file after every `flush`: what was written, then an end that the next flush replaces.

    The end says that there is no index. Its place is taken already, so that a full disk cannot refuse it.
    """

    def __init__(self, path: Path, force: bool) -> None:
        self.raw = FileIO(path, "w" if force else "x")
        self.saved = 0  # bytes before the end
        self._waiting = bytearray()
        ending = RecordBuilder()
        DataEnd(0).write(ending)
        Footer(0, 0, 0).write(ending)
        self._end = bytes(ending.end()) + MAGIC  # type: ignore[no-untyped-call]

    def write(self, data: bytes) -> int:
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        return self.saved + len(self._waiting)

    def flush(self) -> None:
        """Put on disk what was written."""
        if self._waiting:
            self._put(bytes(self._waiting) + self._end)
            self.saved = self.tell()
            self._waiting.clear()

    def finish(self) -> None:
        """Put the rest on disk, an end of its own with it, and close."""
        self._put(bytes(self._waiting))
        self.saved = self.tell()
        self.raw.truncate(self.saved)
        self.raw.close()

    def rescue(self) -> None:
        """After a failed write: end the file after what had been saved, and close."""
        with suppress(OSError):  # where not even this goes, `recover` reads what there is
            self._put(self._end)
            self.raw.truncate(self.saved + len(self._end))
        with suppress(OSError):
            self.raw.close()

    def _put(self, data: bytes) -> None:
        self.raw.seek(self.saved)
        left = memoryview(data)
        while left:
            left = left[self.raw.write(left) :]


def already_there(path: str | Path) -> str:
    """Say that a file is not written over."""
    return f"{path} exists already; choose another name, or add --force (force=True) to write over it"


class McapFile:
    """A new MCAP file of the profile ros2, zstd; `writer` writes into it, inside `guard`.

    Parameters
    ----------
    path
        The file to make.
    force
        Write over a file that is there.

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
            self._file = _Ended(self.path, force)
        except FileExistsError:
            raise RecordingError(already_there(path)) from None
        # Chunks are ended by `flush`: the writer's own limit would end them behind our back.
        self.writer = Writer(cast(IO[Any], self._file), chunk_size=2**62, compression=CompressionType.ZSTD)
        with self.guard():
            self.writer.start(profile="ros2", library=f"tacstrip {version('tacstrip')}")

    @property
    def closed(self) -> bool:
        """Whether the file is finished."""
        return self._file.raw.closed

    @property
    def size_bytes(self) -> int:
        """What is on disk by now."""
        return self._file.saved

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Write in here: when a write fails, the file ends with what was saved before, and the error goes on."""
        try:
            yield
        except OSError as error:
            self._file.rescue()
            raise OSError(error.errno, error.strerror, str(self.path)) from error

    def flush(self) -> None:
        """End the chunk and put everything on disk."""
        with self.guard():
            self.writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """End the file with its index; may be called twice."""
        if not self.closed:
            with self.guard():
                self.writer.finish()  # type: ignore[no-untyped-call]
                self._file.finish()

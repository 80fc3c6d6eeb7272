"""A recording made beside a live stream, in a thread of its own so that a slow disk delays nothing else."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from tacstrip.errors import in_words
from tacstrip.stream.mailbox import Mailbox
from tacstrip.stream.recording import Recorder
from tacstrip.stream.source import RawScan

_WAITING = 20_000  # scans that may wait for the disk; then the source waits too
_NAP_S = 0.005  # a few scans at once: more would keep a core from the stream


class DiskWriter:
    """Records whatever it is given; nothing given is dropped while the disk takes it.

    Parameters
    ----------
    recorder
        The open recording; closed here.
    tell
        Called, in the writing thread, with what a user should know.
    """

    def __init__(self, recorder: Recorder, tell: Callable[[str], None]) -> None:
        self._recorder, self._tell = recorder, tell
        self._box: Mailbox[RawScan] = Mailbox(_WAITING, keep=True)
        self.failed = False
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tacstrip recorder", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file."""
        return self._recorder.path

    @property
    def scans(self) -> int:
        """Scans recorded by now."""
        return self._recorder.scans

    @property
    def size_bytes(self) -> int:
        """What is on disk by now."""
        return self._recorder.size_bytes

    def add(self, raw: RawScan) -> None:
        """Record a scan; waits where the disk is 20,000 scans behind."""
        self._box.put(raw)

    def close(self) -> None:
        """Write everything that waits, end the file and say what it holds."""
        self._box.close()
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        recorder = self._recorder
        try:
            with recorder:
                ended = False
                while not ended:
                    ended = self._end.wait(_NAP_S)
                    for raw in self._box.get_all():
                        recorder.add(raw)
                    recorder.idle(_NAP_S)
        except Exception as error:
            self.failed = True
            self._box.close()
            why, advice = in_words(error), ""
            if isinstance(error, OSError):
                why, advice = error.strerror or why, "; make room, or record to another disk"
            self._tell(
                f"recording to {recorder.path} ended: {why}. {recorder.saved_scans} scan(s) are saved in it{advice}"
            )
            return
        self._tell(f"{recorder.path}: {recorder.scans} scan(s), {recorder.size_bytes / 1e6:.3g} MB")

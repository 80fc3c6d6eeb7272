"""A recording written in a thread of its own, so that a slow disk does not delay a live stream."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from dataclasses import replace

from tacstrip.errors import in_words
from tacstrip.stream.live.bounded_queue import BoundedQueue
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import RawScan, TrackedShape
from tacstrip.tracking.live_contact import LiveTrack

_QUEUE_SCANS = 20_000  # that may wait for the disk; a longer queue makes the stream wait
_DETAIL_S = 0.1  # between two covariances of an object over time: they take longer than all else
_OBJECTS = 100  # whose last covariance is remembered
_BATCH_S = 0.005  # between two writes: larger batches would keep a core from the stream


class BackgroundRecorder:
    """Writes scans to a recording in the background; no scan is dropped unless writing fails.

    Parameters
    ----------
    recorder
        The open recording; closed by the writing thread.
    notify
        Called, in the writing thread, with messages for the user, and their level.

    Attributes
    ----------
    recorder
        As given.
    failed
        Whether writing failed; the recording then ends with the scans that had been saved.
    """

    def __init__(self, recorder: Recorder, notify: Callable[..., None]) -> None:
        self.recorder, self._notify = recorder, notify
        self.failed, self._take_back = False, 0
        self._queue: BoundedQueue[tuple[RawScan, tuple[LiveTrack, ...] | None]] = BoundedQueue(
            _QUEUE_SCANS, keep=True
        )
        self._detailed: dict[int, tuple[float, int]] = {}  # time and corners of each object's last covariance
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tacstrip recorder", daemon=True)
        self._thread.start()

    def add(self, raw: RawScan, tracks: tuple[LiveTrack, ...] | None = ()) -> None:
        """Record a scan and its objects over time, None: not known; waits while 20,000 scans wait for the disk."""
        self._queue.put((raw, tracks))

    def close(self, take_back: int = 0) -> None:
        """Write all scans that wait, complete the file without the last `take_back` and report its contents."""
        self._take_back = take_back
        self._queue.close()
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        recorder = self.recorder
        try:
            with recorder:
                ended = False
                while not ended:
                    ended = self._end.wait(_BATCH_S)
                    for raw, tracks in self._queue.get_all():
                        stored = None if tracks is None else tuple(self._stored(one) for one in tracks)
                        recorder.add(replace(raw, tracks=stored))
                    recorder.idle(_BATCH_S)
                recorder.take_back(self._take_back)
        except Exception as error:
            self.failed = True
            self._queue.close()
            reason, advice = in_words(error), ""
            if isinstance(error, OSError):
                reason, advice = error.strerror or reason, "; make room, or record to another disk"
            saved = f"{recorder.saved_scans} scan(s) are saved in it{advice}"
            self._notify(f"recording to {recorder.path} ended: {reason}. {saved}")
        else:
            size_mb = recorder.size_bytes / 1e6
            self._notify(f"{recorder.path}: {recorder.scans} scan(s), {size_mb:.3g} MB", logging.INFO)

    def _stored(self, one: LiveTrack) -> TrackedShape:
        """Return an object as it is stored: ten times a second with its covariances."""
        shape = TrackedShape(one.id, one.status, one.outline, one.pose, one.scans, one.advice)
        time_s, corners = self._detailed.get(one.id, (math.nan, 0))
        if abs(one.time_s - time_s) < _DETAIL_S and corners == len(one.outline):
            return shape
        self._detailed = dict(list(self._detailed.items())[-_OBJECTS:]) | {
            one.id: (one.time_s, len(one.outline))
        }
        return replace(shape, covariance=one.covariance, pose_covariance=one.pose_covariance)

"""From a source to whoever watches: one thread reads, calibrates, recovers and hands on; whoever takes has its own.

What comes while a scan is worked on waits in the operating system, which holds tens of milliseconds of it. Queues are
bounded: the recording's waits for the disk, all others let the oldest go and count it.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.errors import TacstripError, in_words
from tacstrip.reconstruction.methods import chosen_method
from tacstrip.stream.device.source import SerialSource
from tacstrip.stream.live.background_recorder import DiskWriter
from tacstrip.stream.live.bounded_queue import Mailbox
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.latency import Meter
from tacstrip.stream.live.readings import Readings
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import RawScan, Shape, Source, paced
from tacstrip.tracking.tracker import Tracker

_LATE_S, _MANY = 0.02, 3  # scans that waited longer, or with more behind them, are recorded without objects
_DETAIL_S = 1.0 / 80.0  # covariances are worked out so often, where anybody looks
_WAIT_S = 0.1  # the longest wait for a frame at a time
_SWITCH_S = 0.0001  # between threads; Python's own 5 ms would show as latency


class Live:
    """A running stream; use it in `with`. Iterating gives the newest frames.

    Parameters
    ----------
    source
        Where scans come from.
    method, noise
        As of `Tracker`.
    drift
        Whether drift is followed, where the calibration allows it.
    speed
        Of recordings and readings files: times their own pace; infinite: as fast as it goes.
    then
        Asked for the next source when one has ended; None ends the stream.
    tell
        Called, from any thread, with what a user should know, a line each.

    Attributes
    ----------
    frames, late, unreadable
        Scans that came; those whose objects were not recovered because the computer was behind; those that are no
        readings.
    error
        What ended the stream, or went wrong as its source was closed, of whatever kind; None where nothing did.
        Iterating raises it, after the last frame.
    recording_failed
        Whether a recording broke off.
    messages
        The last things told, each with its number.
    meter
        Rate and latency.
    detail
        Whether somebody looks: then covariances are worked out, 80 times a second.
    """

    @takes(noise=Noise)
    def __init__(
        self,
        source: Source,
        method: str | None = None,
        noise: Noise | None = None,
        drift: bool = True,
        speed: float = 1.0,
        then: Callable[[], Source | None] = lambda: None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.source = source
        self.method, self.noise = method, noise
        self.frames = self.late = self.unreadable = 0
        self.error: BaseException | None = None
        self.recording_failed = False
        self.messages: deque[tuple[int, str]] = deque(maxlen=20)
        self.detail = self._started = self._over = False
        self._drift, self._speed, self._then, self._tell = drift, speed, then, tell
        self._told = 0
        self._outlets: list[Mailbox[Frame]] = []
        self._detailed: list[Mailbox[Frame]] = []
        self.meter = Meter()
        self._stopped, self._writing = threading.Event(), threading.Lock()
        self._writer: DiskWriter | None = None
        self._thread = threading.Thread(target=self._run, name="tacstrip stream", daemon=True)
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="tacstrip search")
        self._detailed_s = 0.0
        self._own = self.outlet()
        self._switch_s = sys.getswitchinterval()

    def outlet(self, size: int = 1, detailed: bool = False) -> Mailbox[Frame]:
        """Return a queue of the newest frames, so many at most; `detailed`: of those with covariances alone."""
        box: Mailbox[Frame] = Mailbox(size)
        (self._detailed if detailed else self._outlets).append(box)
        if self._over:
            box.close()
        return box

    def start(self) -> None:
        """Begin to read."""
        self._started = True
        sys.setswitchinterval(min(self._switch_s, _SWITCH_S))
        self._thread.start()

    def stop(self) -> None:
        """End the stream and the recording, and let go of the source; may be called twice.

        What the source raises as it is closed is told, and kept as `error`.
        """
        self._stopped.set()
        try:
            self.source.close()
        except Exception as error:
            self._fail(error)
        if self._started:
            self._thread.join()
            sys.setswitchinterval(self._switch_s)
        self._beside.shutdown(cancel_futures=True)
        self.stop_recording()
        self._close_outlets()

    @property
    def running(self) -> bool:
        """Whether frames may still come."""
        return self._thread.is_alive()

    def record(self, path: str | Path, about: Mapping[str, str] | None = None, force: bool = False) -> None:
        """Begin a recording of all scans from now on; errors as of `Recorder`."""
        source, told = self.source, {"source": "live", "method": self.method or "best", **(about or {})}
        recorder = Recorder(path, source.sensor, source.names, source.origin_ns, told, force)
        with self._writing:
            previous, self._writer = self._writer, DiskWriter(recorder, self.tell)
        self._end(previous)

    def stop_recording(self) -> None:
        """End the recording, if there is one."""
        with self._writing:
            writer, self._writer = self._writer, None
        self._end(writer)

    def _end(self, writer: DiskWriter | None) -> None:
        if writer is not None:
            writer.close()
            self.recording_failed |= writer.failed

    @property
    def recording(self) -> DiskWriter | None:
        """The recording that is being made."""
        writer = self._writer
        return None if writer is None or writer.failed else writer

    @property
    def method_name(self) -> str:
        """The method that is used."""
        return chosen_method(self.method, self.source.sensor)

    def use(self, method: str | None) -> None:
        """Recover by another method from now on."""
        self.method = method
        self._tracker = Tracker(self.source.sensor, method, self.noise, self._beside)

    def tell(self, text: str) -> None:
        """Tell a user something."""
        self._told += 1
        self.messages.append((self._told, text))
        try:
            self._tell(text)
        except Exception as error:
            self._fail(error)
            self._stopped.set()
            with suppress(Exception):  # the first error counts
                self.source.close()

    def __iter__(self) -> Iterator[Frame]:
        if self._started:
            yield from self._newest()
        else:
            with self:
                yield from self._newest()

    def _newest(self) -> Iterator[Frame]:
        while not self._own.closed or len(self._own):
            if (frame := self._own.get(_WAIT_S)) is not None:
                yield frame
        if self.error is not None:
            raise self.error

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            source: Source | None = self.source
            while source is not None and not self._stopped.is_set():
                self._begin(source)
                self._pass(source)
                source = None if self._stopped.is_set() else self._then()
        except BaseException as error:
            self._fail(error)
        try:
            self.source.close()
        except BaseException as error:
            self._fail(error)
        self.stop_recording()
        self._close_outlets()

    def _close_outlets(self) -> None:
        self._over = True
        for box in (*self._outlets, *self._detailed):
            box.close()

    def _fail(self, error: BaseException) -> None:
        """Keep and tell what went wrong first; what follows from it is not told."""
        if self.error is None:
            self.error = error
            self.tell(
                str(error) if isinstance(error, TacstripError) else f"the stream broke off: {in_words(error)}"
            )

    def _pass(self, source: Source) -> None:
        """Pass the scans of a source on, to its end."""
        device = source if isinstance(source, SerialSource) else None
        if device:
            device.tell = self.tell
        for raw in source if device else paced(source, self._speed, self._stopped.is_set):
            arrived_s, waiting = (device.arrived_s, device.waiting) if device else (time.perf_counter(), 0)
            self._take(raw, arrived_s, waiting)

    def _begin(self, source: Source) -> None:
        self.source = source
        if self.frames:
            self.stop_recording()  # it is of another sensor
        self.meter = Meter()
        self._readings = Readings(source.sensor, self._drift)
        self._tracker = Tracker(source.sensor, self.method, self.noise, self._beside)

    def _take(self, raw: RawScan, arrived_s: float, waiting: int) -> None:
        now_s = time.perf_counter()
        self.meter.arrived(arrived_s)
        number, self.frames = self.frames, self.frames + 1
        if now_s - arrived_s > _LATE_S or waiting >= _MANY:
            self.late += 1
            self._save(raw)
            return
        detail = self.detail and now_s - self._detailed_s >= _DETAIL_S
        if detail:
            self._detailed_s = now_s
        try:
            scan = self._readings.scan(raw)
            objects = self._tracker.update(scan, detail)
        except Exception as error:
            self._save(raw)
            if not isinstance(error, TacstripError):
                raise
            self.unreadable += 1
            if self.unreadable == 1:
                self.tell(f"scan {number} cannot be used: {error}")
            return
        ready_s = time.perf_counter()
        self.meter.done(ready_s - arrived_s)
        frame = Frame(number, raw, self._readings.sensor, scan, objects, ready_s - arrived_s, ready_s)
        for box in (*self._outlets, *(self._detailed if detail else ())):
            box.put(frame)
        shapes = tuple(Shape(o.shape.status, o.shape.vertices) for o in objects if o.shape.found)
        self._save(raw, shapes)

    def _save(self, raw: RawScan, shapes: tuple[Shape, ...] = ()) -> None:
        writer = self._writer
        if writer is not None:
            writer.add(replace(raw, shapes=shapes))

"""From a source to whoever watches: read, record, calibrate, recover, hand on; each in a thread, queues bounded."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self, TypeAlias

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.errors import TacstripError
from tacstrip.reconstruct.methods import best_method
from tacstrip.stream.disk import DiskWriter
from tacstrip.stream.frame import Frame
from tacstrip.stream.mailbox import Mailbox
from tacstrip.stream.readings import Readings
from tacstrip.stream.recording import Recorder
from tacstrip.stream.serial_source import SerialSource
from tacstrip.stream.source import RawScan, Shape, Source, paced
from tacstrip.stream.tracking import Tracker

_WAITING = 4096  # scans between reading and recovering; then the source waits
_LATE_S = 0.02  # who waited longer, and is not the newest, is recorded without its objects
_DETAIL_S = 1.0 / 60.0  # covariances are worked out so often, where anybody looks
_SWITCH_S = 0.0005  # Python's own 5 ms would show as latency
_LATENCIES = 2048

Begin: TypeAlias = Source


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
        What ended the stream, or None.
    messages
        The last things told.
    """

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
        self.messages: deque[tuple[int, str]] = deque(maxlen=20)
        self.detail = False
        self._drift, self._speed, self._then, self._tell = drift, speed, then, tell
        self._told = 0
        self._work: Mailbox[tuple[RawScan, float] | Source] = Mailbox(_WAITING, keep=True)
        self._outlets: list[Mailbox[Frame]] = []
        self._latencies: deque[float] = deque(maxlen=_LATENCIES)
        self._arrivals: deque[float] = deque(maxlen=_LATENCIES)
        self._stopped = threading.Event()
        self._writing = threading.Lock()
        self._writer: DiskWriter | None = None
        self._threads = [
            threading.Thread(target=self._guarded, args=(job,), name=f"tacstrip {name}", daemon=True)
            for name, job in (("reader", self._read), ("recovery", self._recover))
        ]
        self._detailed_s = 0.0
        self._own: Mailbox[Frame] | None = None

    def outlet(self, size: int = 1) -> Mailbox[Frame]:
        """Return a queue of the newest frames, so many at most."""
        box: Mailbox[Frame] = Mailbox(size)
        self._outlets.append(box)
        return box

    def start(self) -> None:
        """Begin to read."""
        self._switch_s = sys.getswitchinterval()
        sys.setswitchinterval(min(self._switch_s, _SWITCH_S))
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End the stream and the recording, and let go of the source; may be called twice."""
        self._stopped.set()
        self.source.close()
        for thread in self._threads:
            if thread.ident is not None and thread is not threading.current_thread():
                thread.join()
        self.stop_recording()
        sys.setswitchinterval(self._switch_s)

    @property
    def running(self) -> bool:
        """Whether frames may still come."""
        return any(thread.is_alive() for thread in self._threads)

    def record(self, path: str | Path, about: Mapping[str, str] | None = None, force: bool = False) -> None:
        """Begin a recording of all scans from now on; errors as of `Recorder`."""
        source = self.source
        told = {"source": "live", "method": self.method or "best", **(about or {})}
        recorder = Recorder(path, source.sensor, source.names, source.origin_ns, told, force)
        with self._writing:
            previous, self._writer = self._writer, DiskWriter(recorder, self.tell)
        if previous is not None:
            previous.close()

    def stop_recording(self) -> None:
        """End the recording, if there is one."""
        with self._writing:
            writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    @property
    def recording(self) -> DiskWriter | None:
        """The recording that is being made."""
        writer = self._writer
        return None if writer is None or writer.failed else writer

    @property
    def rate_hz(self) -> float:
        """Scans a second, lately."""
        times = list(self._arrivals)
        if len(times) < 2 or times[-1] <= times[0] or time.perf_counter() - times[-1] > 1.0:
            return 0.0
        return (len(times) - 1) / (times[-1] - times[0])

    def latency_s(self, *parts: float) -> list[float]:
        """Return quantiles of the time from a scan's last byte to its objects [s], of the last 2,048 scans."""
        values = list(self._latencies)
        return np.quantile(values, parts).tolist() if values else [0.0] * len(parts)

    @property
    def searches(self) -> int:
        """How often corners were searched, and not only followed."""
        return self._tracker.searches

    @property
    def method_name(self) -> str:
        """The method that is used."""
        return self.method or best_method(self.source.sensor)

    def use(self, method: str | None) -> None:
        """Recover by another method from now on."""
        self.method = method
        self._tracker = Tracker(self.source.sensor, method, self.noise)

    def tell(self, text: str) -> None:
        """Tell a user something."""
        self._told += 1
        self.messages.append((self._told, text))
        self._tell(text)

    def __iter__(self) -> Iterator[Frame]:
        box = self._own = self._own or self.outlet()
        while self.running or len(box):
            if (frame := box.get(0.1)) is not None:
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

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BaseException as error:
            self.error = self.error or error
            self._stopped.set()
            if not isinstance(error, TacstripError | OSError):
                raise
        finally:
            self._work.close()

    def _read(self) -> None:
        source: Source | None = self.source
        while source is not None and not self._stopped.is_set():
            self.source = source
            self._work.put(source)
            device = source if isinstance(source, SerialSource) else None
            scans = source if device else paced(source, self._speed, self._stopped.is_set)
            for raw in scans:
                arrived_s = device.arrived_s if device else time.perf_counter()
                if self._stopped.is_set() or not self._work.put((raw, arrived_s)):
                    source.close()
                    if not device:
                        break
            source.close()
            source = None if self._stopped.is_set() else self._then()

    def _recover(self) -> None:
        while not self._work.closed or len(self._work):
            item = self._work.get(0.1)
            if item is None:
                continue
            if isinstance(item, tuple):
                self._take(*item)
            else:
                self._begin(item)

    def _begin(self, source: Source) -> None:
        if self.frames and self._writer is not None:
            self.stop_recording()  # its spec is another's
        self._readings = Readings(source.sensor, self._drift)
        self._tracker = Tracker(source.sensor, self.method, self.noise)

    def _take(self, raw: RawScan, arrived_s: float) -> None:
        now_s = time.perf_counter()
        self._arrivals.append(arrived_s)
        number, self.frames = self.frames, self.frames + 1
        if now_s - arrived_s > _LATE_S and len(self._work):  # not the newest
            self.late += 1
            self._save(raw)
            return
        detail = self.detail and now_s - self._detailed_s >= _DETAIL_S
        if detail:
            self._detailed_s = now_s
        try:
            scan = self._readings.scan(raw)
            objects = self._tracker.update(scan, detail)
        except TacstripError as error:
            self.unreadable += 1
            if self.unreadable == 1:
                self.tell(f"scan {number} cannot be used: {error}")
            self._save(raw)
            return
        latency_s = time.perf_counter() - arrived_s
        self._latencies.append(latency_s)
        frame = Frame(number, raw, self._readings.sensor, scan, objects, latency_s)
        for box in self._outlets:
            box.put(frame)
        shapes = tuple(Shape(o.shape.status, o.shape.vertices) for o in objects if o.shape.found)
        self._save(raw, shapes)

    def _save(self, raw: RawScan, shapes: tuple[Shape, ...] = ()) -> None:
        writer = self._writer
        if writer is not None:
            writer.add(replace(raw, shapes=shapes))

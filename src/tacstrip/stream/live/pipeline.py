"""The live pipeline: one thread reads, decodes, reconstructs and distributes; each consumer has a thread of its own.

Bytes that arrive while a scan is processed wait in the operating system, which holds tens of milliseconds of them.
Queues are bounded: that of the recording waits for the disk, all others discard their oldest frame and count it.
"""

from __future__ import annotations

import logging
import math
import sys
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.core.binding import exported
from tacstrip.errors import OptionError, PortError, TacstripError, in_words
from tacstrip.reconstruction.methods import chosen_method
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.background_recorder import BackgroundRecorder
from tacstrip.stream.live.bounded_queue import BoundedQueue
from tacstrip.stream.live.drift import DriftCorrectingDecoder
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.latency import LatencyMeter
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import LOGGER, DeviceSource, RawScan, Shape, Source, paced
from tacstrip.tracking.layered import LayeredTracker, tracker_of
from tacstrip.tracking.live import LiveTracks
from tacstrip.tracking.live_contact import LiveTrack
from tacstrip.tracking.tracker import Tracker

# Scans that waited longer, or with more behind them, are recorded without objects.
_LATE_S, _MAX_BACKLOG = 0.02, 3
_DETAIL_S = 1.0 / 80.0  # between two frames with covariances, while a consumer wants them
_MOST_KNOWN = 100  # objects over time that are remembered
_AT_REST = ("recording", "file")  # clocks of sources whose next scan is there before its time
_SWITCH_S = 0.0001  # between threads; Python's default of 5 ms would show as latency (docs/decisions/)


class Live:
    """A live stream; use it in `with` or `async with`. Iterating it, by `for` or `async for`, gives the newest frames.

    Parameters
    ----------
    source
        Source of the scans.
    method, noise
        As of `Tracker`.
    drift
        Whether to remove drift, where the calibration allows it.
    speed
        Playback speed of a source that is not a device, relative to its own times; infinite: as fast as possible.
    next_source
        Called for another source when one has ended; None ends the stream.
    on_message
        Called, from any thread, with messages for the user, a line each; None: the logger "tacstrip".
    creep
        Whether to take the creep of contacts that are held still out of their readings.
    tracks
        Whether to fuse the scans of each object into one rigid outline, where the construction has a closed form, the
        sensor one layer, and the core is compiled.
    searches
        Runs the searches of a sensor of two layers, which take a second and more each: best a process, as
        `concurrent.futures` has them. None: a thread.

    Attributes
    ----------
    source, method, noise
        Those in use.
    frames, late, unreadable
        Number of scans that came, that were not reconstructed because the computer was behind, and that could not be
        decoded.
    untracked
        Number of frames whose `tracks` were not known: the computer was behind, or the first search had not ended.
    error
        The exception that ended the stream, or that closing its source raised; None where there was none. Iterating
        raises it, after the last frame.
    recording_failed
        Whether a recording failed.
    messages
        The latest messages for the user, each with its number.
    meter
        Rate and latency.
    known
        The latest objects over time, by their numbers.

    Examples
    --------
    >>> import math
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
    >>> source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=20)
    >>> with ts.Live(source, speed=math.inf) as stream:
    ...     newest = list(stream)[-1]
    >>> stream.frames, len(newest.objects)
    (20, 1)
    """

    @takes(noise=Noise)
    def __init__(
        self,
        source: Source,
        method: str | None = None,
        noise: Noise | None = None,
        drift: bool = True,
        speed: float = 1.0,
        next_source: Callable[[], Source | None] = lambda: None,
        on_message: Callable[[str], None] | None = None,
        *,
        creep: bool = False,
        tracks: bool = True,
        searches: Executor | None = None,
    ) -> None:
        self.method, self.noise = method, noise
        self.frames = self.late = self.unreadable = self.untracked = 0
        self.error: BaseException | None = None
        self.recording_failed = False
        self._want_detail: set[object] = set()
        self._at_end: list[Callable[[], object]] = []
        self.messages: deque[tuple[int, str]] = deque(maxlen=20)
        self.known: dict[int, LiveTrack] = {}
        self._creep, self._wants_tracks, self._fuses = creep, tracks, False
        self._last = False  # the scan in hand is the last one
        self._tracks: LiveTracks | None = None
        self._drift, self._speed, self._next_source, self._on_message = drift, speed, next_source, on_message
        self._n_messages = 0
        self._newest: BoundedQueue[Frame] = BoundedQueue(1)
        self._queues = [self._newest]
        self._detailed_queues: list[BoundedQueue[Frame]] = []
        self._stopped, self._writing = threading.Event(), threading.Lock()
        self._writers: tuple[BackgroundRecorder, ...] = ()
        self._thread = threading.Thread(target=self._run, name="tacstrip stream", daemon=True)
        self._searches = ThreadPoolExecutor(1, thread_name_prefix="tacstrip search")
        self._layer_searches = searches or self._searches
        self._fusing = ThreadPoolExecutor(1, thread_name_prefix="tacstrip tracks")
        self._detail_s = 0.0
        self._begun_s = math.inf
        self._switch_s = sys.getswitchinterval()
        self._take_over(source)

    def _take_over(self, source: Source) -> None:
        self.source = source
        self.meter = LatencyMeter()
        self._decoder = DriftCorrectingDecoder(source.sensor, self._drift, self._creep)
        self._tracker = self._new_tracker(self.method)
        self.known = {}
        sensor = source.sensor
        fuses = self._wants_tracks and isinstance(sensor, Sensor) and sensor.kind.closed_form
        fuses = fuses and (sensor.surface is None or sensor.surface.isometric)
        # In NumPy a search takes minutes: the stream would fall behind meanwhile, and could not end before it.
        self._fuses = fuses and exported("rigid_descend") is not None
        self._tracks = LiveTracks(source.sensor, self.noise, executor=self._fusing) if self._fuses else None

    def _new_tracker(self, method: str | None) -> Tracker | LayeredTracker:
        sensor = self.source.sensor
        executor = self._searches if isinstance(sensor, Sensor) else self._layer_searches
        return tracker_of(sensor, method, self.noise, executor)

    def subscribe(self, size: int = 1, detailed: bool = False) -> BoundedQueue[Frame]:
        """Return a queue of the newest frames.

        Parameters
        ----------
        size
            Largest number of frames that wait; then the oldest is discarded.
        detailed
            Only frames with covariances.
        """
        queue: BoundedQueue[Frame] = BoundedQueue(size)
        (self._detailed_queues if detailed else self._queues).append(queue)
        if self._newest.closed:
            queue.close()
        return queue

    def want_detail(self, who: object, wanted: bool) -> None:
        """Say whether somebody wants covariances, which are computed 80 times a second while anybody does."""
        (self._want_detail.add if wanted else self._want_detail.discard)(who)

    def start(self) -> None:
        """Begin to read."""
        sys.setswitchinterval(min(self._switch_s, _SWITCH_S))
        self._thread.start()

    def stop(self) -> None:
        """End the stream and the recording, and close the source; may be called twice.

        An exception of the source while it is closed becomes a message, and is kept as `error`.
        """
        self._stopped.set()
        try:
            self.source.close()
        except Exception as error:
            self._fail(error)
        finally:
            if self._thread.ident is not None:
                self._thread.join()
                sys.setswitchinterval(self._switch_s)
            for executor in (self._searches, self._fusing):
                executor.shutdown(cancel_futures=True)
            self._end()
            for function in self._at_end:
                function()

    def at_end(self, function: Callable[[], object]) -> None:
        """Call a function when the stream has been stopped and all frames were handed out."""
        self._at_end.append(function)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the stream ends by itself, at most `timeout_s` [s]; return whether it has.

        Raises
        ------
        Exception
            What ended it, where that was an error.
        """
        self._thread.join(timeout_s)
        if self.error is not None:
            raise self.error
        return not self.running

    @property
    def tracking(self) -> bool:
        """Whether the scans of each object are fused into one outline."""
        return self._tracks is not None

    @property
    def running(self) -> bool:
        """Whether frames may still come."""
        return self._thread.is_alive()

    @property
    def stuck_s(self) -> float:
        """How long the scan in hand has been worked on [s]; 0 between two scans."""
        return max(time.perf_counter() - self._begun_s, 0.0)

    def record(
        self,
        path: str | Path,
        about: Mapping[str, str] | None = None,
        force: bool = False,
        durable: bool = False,
    ) -> Recorder:
        """Begin a recording of all scans from now on, beside others; parameters and errors as of `Recorder`."""
        source, notes = (
            self.source,
            {"source": "live", "method": chosen_method(self.method, self.source.sensor), **(about or {})},
        )
        recorder = Recorder(path, source.sensor, source.names, source.origin_ns, notes, force, durable)
        writer = BackgroundRecorder(recorder, self.notify)
        with self._writing:
            self._writers = (*self._writers, writer)
        return recorder

    def stop_recording(self, recorder: Recorder | None = None) -> None:
        """End a recording, if it is in progress; None: all. Scans that may be another unit's are taken back."""
        with self._writing:
            ended = [w for w in self._writers if recorder is None or w.recorder is recorder]
            self._writers = tuple(w for w in self._writers if w not in ended)
        take_back = self.error.unconfirmed if isinstance(self.error, PortError) else 0
        for writer in ended:
            writer.close(take_back)
            self.recording_failed |= writer.failed

    @property
    def recordings(self) -> tuple[Recorder, ...]:
        """The recordings in progress, in the order in which they were begun."""
        return tuple(writer.recorder for writer in self._writers if not writer.failed)

    @property
    def recording(self) -> Recorder | None:
        """The recording in progress that was begun first."""
        return next(iter(self.recordings), None)

    @property
    def method_name(self) -> str:
        """The method in use."""
        return chosen_method(self.method, self.source.sensor)

    def use(self, method: str | None) -> None:
        """Reconstruct by another method from now on."""
        self._tracker = self._new_tracker(method)
        self.method = method

    def leave_out(self, names: tuple[str, ...]) -> None:
        """Do without these channels from the next scan on, named as in the spec's `without`; they are recorded."""
        if not isinstance(self.source.sensor, Sensor):
            raise OptionError(
                "of two layers no channel is left out while they stream: write it into the spec"
            )
        replace(self.source.sensor, without=names)  # which refuses channels that it has not
        self._decoder.left_out = names

    def notify(self, text: str, level: int = logging.WARNING) -> None:
        """Send a message to the user."""
        self._n_messages += 1
        self.messages.append((self._n_messages, text))
        try:
            if self._on_message is None:
                LOGGER.log(level, text)
            else:
                self._on_message(text)
        except Exception as error:
            self._fail(error)
            self._stopped.set()
            with suppress(Exception):  # the first error counts
                self.source.close()

    def __iter__(self) -> Iterator[Frame]:
        if self._thread.ident is None:
            with self:
                yield from self
            return
        yield from self._newest
        if self.error is not None:
            raise self.error

    async def __aiter__(self) -> AsyncIterator[Frame]:
        if self._thread.ident is None:
            async with self:
                async for frame in self:
                    yield frame
            return
        async for frame in self._newest:
            yield frame
        if self.error is not None:
            raise self.error

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    async def __aenter__(self) -> Self:
        self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        from asyncio import get_running_loop, shield

        # `stop` waits for the disk. It ends the stream also where this task is cancelled, as asyncio.run does with the
        # one that closes a loop that was left.
        await shield(get_running_loop().run_in_executor(None, self.stop))

    def _run(self) -> None:
        try:
            self._read(self.source)
            while not self._stopped.is_set() and (source := self._next_source()) is not None:
                self.stop_recording()  # it is of another sensor
                self._take_over(source)
                self._read(source)
        except BaseException as error:
            self._fail(error)
        try:
            self.source.close()
        except BaseException as error:
            self._fail(error)
        self._end()

    def _end(self) -> None:
        self.stop_recording()
        self._newest.close()  # first: whoever subscribes from now on finds the stream ended
        for queue in (*self._queues, *self._detailed_queues):
            queue.close()

    def _fail(self, error: BaseException) -> None:
        """Keep the first error and report it; later ones follow from it."""
        if self.error is None:
            self.error = error
            broke = "" if isinstance(error, TacstripError) else "the stream broke off: "
            self.notify(f"{broke}{in_words(error)}")

    def _read(self, source: Source) -> None:
        """Process the scans of a source until it ends."""
        if isinstance(source, DeviceSource):
            source.on_message = self.notify
            for raw in source:
                self._take(raw, source.arrived_s, source.waiting)
        else:
            ahead = getattr(source, "clock", "") in _AT_REST
            scans = self._ahead(source) if ahead else source
            for raw in paced(scans, self._speed, self._stopped.is_set):
                self._take(raw, time.perf_counter(), 0)

    def _ahead(self, scans: Iterable[RawScan]) -> Iterator[RawScan]:
        """Yield scans, and note which is the last one."""
        held: RawScan | None = None
        for raw in scans:
            if held is not None:
                yield held
            held = raw
        if held is not None:
            self._last = True
            yield held
            self._last = False

    def _take(self, raw: RawScan, arrived_s: float, waiting: int) -> None:
        self._begun_s = time.perf_counter()
        self._process(raw, arrived_s, waiting)
        self._begun_s = math.inf

    def _process(self, raw: RawScan, arrived_s: float, waiting: int) -> None:
        now_s = time.perf_counter()
        self.meter.arrived(arrived_s)
        number, self.frames = self.frames, self.frames + 1
        if now_s - arrived_s > _LATE_S or waiting >= _MAX_BACKLOG:
            self.late += 1
            self._save(raw)
            return
        detail = bool(self._want_detail) and now_s - self._detail_s >= _DETAIL_S
        if detail:
            self._detail_s = now_s
        try:
            scan = self._decoder.decode(raw)
            objects = self._tracker.update(scan, detail)
        except Exception as error:
            self._save(raw)
            if isinstance(error, BrokenExecutor) and isinstance(self._tracker, LayeredTracker):
                self._layer_searches = self._searches
                self._tracker.search_by(self._searches)
                self.notify("the process that searches for objects is gone: searches go on in this one")
                return
            if not isinstance(error, TacstripError):
                raise
            self.unreadable += 1
            if self.unreadable == 1:
                self.notify(f"scan {number} cannot be used: {error}")
            return
        ready_s, source = time.perf_counter(), self.source
        tracks, searching = (None, 0) if waiting else self._tracked(scan)
        self.untracked += self._fuses and tracks is None
        ready_s = ready_s if self._last else time.perf_counter()  # less what the last scan waits for searches
        self.meter.done(ready_s - arrived_s)
        frame = Frame(number, raw, self._decoder.sensor, scan, objects, ready_s - arrived_s, ready_s, tracks,
                      source.origin_ns, getattr(source, "clock", "source"),
                      getattr(source, "device", ""), searching=searching)  # fmt: skip
        for queue in (*self._queues, *(self._detailed_queues if detail else ())):
            queue.put(frame)
        shapes = tuple(Shape(o.shape.status, o.shape.vertices) for o in objects if o.shape.found)
        self._save(raw, shapes, tracks, searching)

    def _tracked(self, scan: Scan) -> tuple[tuple[LiveTrack, ...] | None, int]:
        """Return the objects over time, None where they are not known, and how many more are searched for."""
        if self._tracks is None:
            return None, 0
        try:
            found = self._tracks.update(scan, wait=self._last)
        except Exception as error:  # without them the stream goes on
            self._tracks = None
            self.notify(f"objects are not tracked any more: {in_words(error)}")
            return None, 0
        for one in found:
            self.known.pop(one.id, None)
            self.known[one.id] = one
        if len(self.known) > _MOST_KNOWN:
            del self.known[next(iter(self.known))]
        searching = self._tracks.searching
        return (None if searching and not found else found), searching

    def _save(
        self,
        raw: RawScan,
        shapes: tuple[Shape, ...] | None = None,
        tracks: tuple[LiveTrack, ...] | None = None,
        searching: int = 0,
    ) -> None:
        """Give a scan to the recordings; without `shapes`, and without `tracks`, these are not known."""
        for writer in self._writers:
            stored = tracks if self._fuses else ()
            writer.add(replace(raw, shapes=shapes, tracks=(), searching=searching), stored)

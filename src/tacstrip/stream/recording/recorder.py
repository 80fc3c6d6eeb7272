"""Write a recording: codes and polygons in one self-describing MCAP file (docs/reference/recording-file.md)."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import numpy as np

from tacstrip.arguments import takes
from tacstrip.errors import PortError, RecordingError
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.recording import messages
from tacstrip.stream.recording.mcap_file import CHUNK_BYTES, McapFile
from tacstrip.stream.source import CodeArray, RawScan, Shape, paced

FORMAT = "1"
SPEC = "sensor.toml"  # name of the attachment
ABOUT = "tacstrip"  # name of the metadata
SCAN_TOPIC = "/tacstrip/scan"
_ENDINGS = {"ok": "", "likely": "_likely", "doubtful": "_doubtful"}
POLYGON_TOPICS = {status: f"/tacstrip/polygon{ending}" for status, ending in _ENDINGS.items()}
TRACK_TOPIC = "/tacstrip/track"
SEARCHING_TOPIC = "/tacstrip/searching"
RECONSTRUCTED_TOPIC = "/tacstrip/reconstructed"
TRACK_POLYGON_TOPICS = {status: f"/tacstrip/track_polygon{ending}" for status, ending in _ENDINGS.items()}
MAX_AGE_S = 0.08  # longest time that a scan waits in memory, so that a killed recorder loses less than 0.1 s
_FLUSHES = 4096  # that may be taken back: minutes


class Recorder:
    """A recording being made; use it in `with`, or `close` it.

    Parameters
    ----------
    path
        The new file, .mcap.
    sensor
        The sensor of the scans; it is stored in the file, and its `adc_bits` must be set.
    names
        Names of the codes that every scan has.
    origin_ns
        Unix time of time_s = 0 [ns].
    about
        Notes on the scans for the reader of the file: texts by key.
    force
        Overwrite an existing file.
    durable
        Have the disk itself hold all but the last second at any time, so that a power cut loses no more.

    Attributes
    ----------
    path
        The file.
    scans, polygons, tracks
        Number of scans, of polygons and of objects over time, one a scan, recorded so far.
    saved_scans
        Number of scans on disk.

    Raises
    ------
    RecordingError
        The file exists already, the sensor has no `adc_bits`, or a scan's time is out of range.
    OSError
        Writing failed, as on a full disk. The scans saved until then are a complete recording.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> source = ts.SimulatedSource(sensor, lambda time_s: ts.Contact.polygon([(8, 40), (32, 40), (20, 70)]), scans=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "session.mcap"
    ...     with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
    ...         for raw in source:
    ...             recorder.add(raw)
    >>> recorder.scans
    5
    """

    @takes(sensor=Sensor | LayeredSensor)
    def __init__(
        self,
        path: str | Path,
        sensor: AnySensor,
        names: tuple[str, ...],
        origin_ns: int,
        about: Mapping[str, str] | None = None,
        force: bool = False,
        durable: bool = False,
    ) -> None:
        if sensor.adc_bits is None:
            raise RecordingError(
                "a recording holds A/D codes: set adc_bits in the spec (stream.codes.with_converter)"
            )
        self.scans = 0
        self.polygons = self.tracks = 0
        self.saved_scans = 0
        self._sensor = sensor
        self._origin_ns = origin_ns
        self._reconstructs = bool((about or {}).get("method"))
        self._file = McapFile(path, force, durable)
        self.path = self._file.path
        own = {"format": FORMAT, "names": ",".join(names), "origin_ns": str(origin_ns)}
        self._reference: Mapping[str, CodeArray] = {}
        self._waiting_bytes = 0
        # Scans, polygons, tracks and bytes at each.
        self._flushed: deque[tuple[int, int, int, int]] = deque(maxlen=_FLUSHES)
        self._first_s = 0.0  # time of the first scan that waits, by its own clock
        self._since = 0.0  # and by the monotonic clock
        with self._file.discarded_on_error():
            self._begin({**(about or {}), **own})

    def _begin(self, about: Mapping[str, str]) -> None:
        writer, now = self._file.writer, time.time_ns()
        made = datetime.fromtimestamp(now / messages.NANO, UTC).isoformat(timespec="seconds")

        def schema_of(kind: str) -> int:
            return int(writer.register_schema(kind, "ros2msg", messages.definition(kind)))

        with self._file.guard():
            writer.add_attachment(now, now, SPEC, "application/toml", self._sensor.to_toml().encode())
            writer.add_metadata(ABOUT, {**about, "made": made})
            schema = schema_of(messages.scan_type(self._sensor))
            self._scan_channel = writer.register_channel(SCAN_TOPIC, "cdr", schema)
            schema = schema_of(messages.POLYGON)
            self._polygon_channels, self._track_polygon_channels = (
                {
                    status: writer.register_channel(topic, "cdr", schema, {"status": status, "unit": "m"})
                    for status, topic in topics.items()
                }
                for topics in (POLYGON_TOPICS, TRACK_POLYGON_TOPICS)
            )
            self._track_channel = writer.register_channel(TRACK_TOPIC, "cdr", schema_of(messages.TRACK))
            schema = schema_of(messages.SEARCHING)
            self._searching_channel = writer.register_channel(SEARCHING_TOPIC, "cdr", schema)
            schema = schema_of(messages.RECONSTRUCTED)
            self._reconstructed_channel = writer.register_channel(RECONSTRUCTED_TOPIC, "cdr", schema)
        self.flush()

    @property
    def size_bytes(self) -> int:
        """Bytes on disk so far."""
        return self._file.size_bytes

    def add(self, raw: RawScan) -> None:
        """Record one scan with its polygons and objects over time."""
        try:
            now_ns = self._origin_ns + round(raw.time_s * messages.NANO)
            came_s = raw.time_s if raw.arrival_s is None else raw.arrival_s
            came_ns = self._origin_ns + round(came_s * messages.NANO)
            came_ns += came_ns == now_ns and raw.arrival_s is not None  # equal: not known
        except (OverflowError, ValueError):
            raise RecordingError(
                f"scan {raw.sequence} has the time {raw.time_s} s; a recording needs finite times"
            ) from None
        if not self._reference:
            self._reference, self._first_s, self._since = raw.codes, raw.time_s, time.monotonic()
        parts = [(self._scan_channel, messages.scan_message(raw, self._sensor, self._reference, now_ns))]
        shapes, tracks = raw.shapes or (), raw.tracks or ()
        for shape in shapes:
            channel = self._polygon_channels.get(shape.status, self._polygon_channels["doubtful"])
            parts.append((channel, messages.polygon_message(shape.vertices, now_ns)))
        known = raw.shapes is not None
        if not shapes and known != self._reconstructs:
            parts.append((self._reconstructed_channel, messages.reconstructed_message(known)))
        for track in tracks:
            parts.append((self._track_channel, messages.track_message(track, now_ns)))
            if len(track.outline) and np.isfinite(track.pose).all():
                status = track.status if track.status in TRACK_POLYGON_TOPICS else "doubtful"
                corners = messages.polygon_message(track.placed, now_ns)
                parts.append((self._track_polygon_channels[status], corners))
        if raw.tracks is None or raw.searching:
            parts.append((self._searching_channel, messages.searching_message(raw.searching)))
        with self._file.guard():
            for channel, data in parts:
                self._file.writer.add_message(channel, now_ns, data, came_ns, self.scans % 2**32)
        self.scans += 1
        self.polygons += len(shapes)
        self.tracks += len(tracks)
        self._waiting_bytes += sum(len(data) for _, data in parts)
        age_s = max(abs(raw.time_s - self._first_s), time.monotonic() - self._since)
        # The first scan is written at once: from then on the file is a recording.
        if self.scans == 1 or self._waiting_bytes >= CHUNK_BYTES or age_s >= MAX_AGE_S:
            self.flush()

    def idle(self, wait_s: float) -> None:
        """Announce that no scan comes for `wait_s` [s]: write what would become too old by then."""
        if self._reference and time.monotonic() + wait_s - self._since >= MAX_AGE_S:
            self.flush()
        self._file.sync()

    def flush(self) -> None:
        """Write all scans to disk."""
        self._file.flush()
        self._reference, self._waiting_bytes, self.saved_scans = {}, 0, self.scans
        self._flushed.append((self.scans, self.polygons, self.tracks, self.size_bytes))

    def take_back(self, scans: int) -> None:
        """Complete the file without its last scans, as they may be another unit's; up to 0.1 s more go with them."""
        if self._file.closed or not scans:
            return
        kept = [state for state in self._flushed if state[0] <= self.scans - scans] or [self._flushed[0]]
        self.scans, self.polygons, self.tracks, size_bytes = kept[-1]
        self.saved_scans = self.scans
        self._file.cut_back(size_bytes)

    def close(self) -> None:
        """Complete the file; may be called twice."""
        if not self._file.closed:
            self.flush()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, where: object) -> None:
        self.take_back(error.unconfirmed if isinstance(error, PortError) else 0)
        self.close()


def with_shapes(scans: Iterable[RawScan], sensor: AnySensor, method: str) -> Iterator[RawScan]:
    """Yield each scan with the shapes that a method reconstructs from it, in place of its stored ones.

    Raises
    ------
    OptionError, SignatureError
        At the first scan: the method does not exist, or does not suit this sensor.
    """
    # Late: recordings are made and read without it.
    from tacstrip.reconstruction.methods import quick_options, reconstruct

    for raw in scans:
        found = reconstruct(decode(raw, sensor), sensor, method=method, **quick_options(method)).objects
        yield replace(raw, shapes=tuple(Shape(o.status, o.vertices) for o in found if o.found))


def record(
    scans: Iterable[RawScan],
    recorder: Recorder,
    speed: float = math.inf,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Record scans until they end or `stop` returns True.

    Parameters
    ----------
    scans
        A source, or any raw scans.
    recorder
        The recording; the caller closes it.
    speed
        Pace relative to the scans' own times; infinite: as fast as possible.
    stop
        Called before every scan and at least 20 times a second.

    Raises
    ------
    RecordingError, OSError
        As of `Recorder`; and whatever the source raises.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> source = ts.SimulatedSource(sensor, lambda time_s: ts.Contact.polygon([(8, 40), (32, 40), (20, 70)]), scans=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "session.mcap"
    ...     with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
    ...         ts.record(source, recorder)
    >>> recorder.scans
    5
    """
    for raw in paced(scans, speed, stop, recorder.idle):
        recorder.add(raw)

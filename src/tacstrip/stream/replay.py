"""Read recordings and readings files as sources of scans."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from tacstrip.arguments import takes
from tacstrip.errors import RecordingError, SpecError
from tacstrip.io.readings import read_readings
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import ELECTRODES, encode, rounding, with_converter
from tacstrip.stream.framing import Condition, Records
from tacstrip.stream.messages import NAMES, POLYGON, SCANS, read_polygon, read_scan
from tacstrip.stream.recording import ABOUT, FORMAT, NANO, POLYGON_TOPICS, SCAN_TOPIC, SPEC
from tacstrip.stream.source import RawScan, Shape

_EPOCH_S = 1e9  # a readings file whose times are above this counts them from 1970
_STATUS = {topic: status for status, topic in POLYGON_TOPICS.items()}


class Recording:
    """A recording as a source; a cut one is read up to its last whole chunk. Iterate it once.

    Parameters
    ----------
    path
        The file.
    sensor
        Another spec for the same codes, such as one calibrated later; by default the one in the file.

    Attributes
    ----------
    sensor, names, origin_ns
        As of every source.
    about
        What the recorder said of its scans: texts by key.

    Raises
    ------
    RecordingError
        The file is no recording of tacstrip, or is damaged; also while it is iterated. Or `sensor` has other
        strips or A/D bits than the codes.
    """

    @takes(sensor=Sensor)
    def __init__(self, path: str | Path, sensor: Sensor | None = None) -> None:
        self.path = Path(path)
        self._records = Records(path)
        self._scans = self._read()
        self.about: dict[str, str] = {}
        self._own: Sensor | None = None
        self._names: tuple[str, ...] = ()
        self._origin_ns = 0
        self._ahead = next(self._scans, None)  # reads what stands before the first scan
        if self._own is None or not self._names:
            self._stop(f"it has no attachment {SPEC} and no metadata {ABOUT!r}: not a recording of tacstrip")
        self._own = self._checked(sensor or self.sensor)

    @property
    def sensor(self) -> Sensor:
        """The sensor that the codes are read with."""
        assert self._own is not None
        return self._own

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the codes."""
        return self._names

    @property
    def origin_ns(self) -> int:
        """Unix time of time_s = 0 [ns]."""
        return self._origin_ns

    @property
    def condition(self) -> Condition:
        """The state of the file; known once the last scan was read."""
        return self._records.condition

    def __iter__(self) -> Iterator[RawScan]:
        if self._ahead is not None:
            yield self._ahead
        yield from self._scans

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._records.close()

    def _read(self) -> Iterator[RawScan]:
        """Give the scans with the polygons that follow each."""
        schemas: dict[int, str] = {}
        channels: dict[int, Channel] = {}
        last: RawScan | None = None
        shapes: list[Shape] = []
        for record in self._records:
            if self.condition.damage:
                break
            match record:
                case Attachment(name=name) if name == SPEC:
                    self._own = self._spec(record.data)
                case Metadata(name=name) if name == ABOUT:
                    self._told(record.metadata)
                case Schema():
                    schemas[record.id] = record.name
                case Channel():
                    channels[record.id] = record
                case Message() if (channel := channels.get(record.channel_id)) is not None:
                    kind = schemas.get(channel.schema_id, "")
                    if channel.topic == SCAN_TOPIC and kind in SCANS.values():
                        if last is not None:
                            yield replace(last, shapes=tuple(shapes))
                        last, shapes = self._scan(record, kind), []
                    elif channel.topic in _STATUS and kind == POLYGON and last is not None:
                        shapes.append(self._shape(record, _STATUS[channel.topic]))
                case _:
                    pass
        if self.condition.damage:
            self._stop(f"{self.condition.damage[0]}; `tacstrip recover` keeps what is whole")
        if last is not None:
            yield replace(last, shapes=tuple(shapes))

    def _scan(self, message: Message, kind: str) -> RawScan:
        if self._own is None or not self._names:
            self._stop(f"scans come before the attachment {SPEC} and the metadata {ABOUT!r}")
        time_s = (message.log_time - self._origin_ns) / NANO
        try:
            return read_scan(message.data, kind, self.sensor, self._names, time_s)
        except RecordingError as error:
            self._stop(str(error))

    def _shape(self, message: Message, status: str) -> Shape:
        try:
            return read_polygon(message.data, status)
        except RecordingError as error:
            self._stop(str(error))

    def _spec(self, data: bytes) -> Sensor:
        try:
            return with_converter(Sensor.from_dict(tomllib.loads(data.decode())))
        except (SpecError, ValueError, RecursionError) as error:
            self._stop(f"its attachment {SPEC} is no sensor spec ({error})")

    def _told(self, about: dict[str, str]) -> None:
        self.about = about
        self._names = tuple(about.get("names", "").split(","))
        if about.get("format") != FORMAT:
            self._stop(f"its format is {about.get('format')!r:.20}; this tacstrip reads format {FORMAT}")
        if unknown := [name for name in self._names if name not in NAMES]:
            self._stop(f"it has codes of the name {unknown[0]!r:.20}; known are: {', '.join(NAMES)}")
        origin = about.get("origin_ns", "")
        if not (origin.isascii() and origin.isdigit() and len(origin) < 20 and int(origin) < 2**63):
            self._stop(f"its origin_ns is {origin!r:.20}, not a time since 1970 [ns]")
        self._origin_ns = int(origin)

    def _checked(self, sensor: Sensor) -> Sensor:
        for key in ("construction", "strips", "adc_bits"):
            mine, given = getattr(self.sensor, key), getattr(with_converter(sensor), key)
            if mine != given:
                self._stop(f"its codes are of a sensor with {key} = {mine}, and the spec given has {given}")
        for name in self._names:
            if name not in sensor.signatures and (name != ELECTRODES or sensor.kind.closed_form):
                self._stop(f"it has codes {name}, which a {sensor.construction} sensor does not measure")
        return with_converter(sensor)

    def _stop(self, why: str) -> NoReturn:
        self.close()
        raise RecordingError(f"{self.path}: {why}")


class ReadingsSource:
    """The scans of a readings file (CSV) as a source.

    Attributes
    ----------
    rounded_steps
        The furthest that a reading lies from its code, in steps of the converter; above 0.01 the file held more
        than the converter's bits.

    Raises
    ------
    ReadingError
        As of `read_readings`.
    """

    @takes(sensor=Sensor)
    def __init__(self, path: str | Path, sensor: Sensor) -> None:
        self.sensor = with_converter(sensor)
        # As it was measured: touch and calibration are looked at anew by whoever reads the codes.
        plain = replace(self.sensor, calibration=None, rest_volt=None, touch_volt=None)
        scans = read_readings(path, plain)
        self._scans = [encode(scan, plain, number) for number, scan in enumerate(scans)]
        self.names = tuple(self._scans[0].codes)
        self.origin_ns = 0 if scans[0].time_s > _EPOCH_S else time.time_ns()
        self.rounded_steps = max(rounding(scan, plain) for scan in scans)

    def __iter__(self) -> Iterator[RawScan]:
        return iter(self._scans)

    def close(self) -> None:
        """Nothing is open."""


def open_source(path: str | Path, sensor: Sensor | None = None) -> Recording | ReadingsSource:
    """Open a recording (.mcap) or a readings file (.csv), which needs a sensor.

    Raises
    ------
    RecordingError, ReadingError
        As of both; or the file's ending is neither.
    """
    match Path(path).suffix.lower():
        case ".mcap":
            return Recording(path, sensor)
        case ".csv" if sensor is not None:
            return ReadingsSource(path, sensor)
        case ".csv":
            raise RecordingError(
                f"{path}: a readings file does not say what sensor it is of; name its spec before it"
            )
        case _:
            raise RecordingError(f"{path}: scans are read from a file that ends in .mcap or .csv")

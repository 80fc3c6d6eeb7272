"""Recordings and readings files as sources of scans."""

from __future__ import annotations

import itertools
import shlex
import time
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn, cast

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from tacstrip.arguments import takes
from tacstrip.errors import RecordingError, SpecError
from tacstrip.io.columns import BEGIN_SPEC, OTHER_FORM
from tacstrip.io.readings import read_unchecked
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import ELECTRODES, encode, quantisation_error, with_converter
from tacstrip.stream.recording.messages import (
    NAMES,
    NANO,
    POLYGON,
    RECONSTRUCTED,
    SCANS,
    SEARCHING,
    TRACK,
    read_polygon,
    read_reconstructed,
    read_scan,
    read_searching,
    read_track,
)
from tacstrip.stream.recording.recorder import (
    ABOUT,
    FORMAT,
    POLYGON_TOPICS,
    RECONSTRUCTED_TOPIC,
    SCAN_TOPIC,
    SEARCHING_TOPIC,
    SPEC,
    TRACK_TOPIC,
)
from tacstrip.stream.recording.records import Condition, Records
from tacstrip.stream.source import RawScan

_EPOCH_S = 1e9  # a readings file whose times are above this counts them from 1970
_STATUS = {topic: status for status, topic in POLYGON_TOPICS.items()}


class Recording:
    """A recording as a source; of a cut file, the scans up to its last whole chunk. Iterate it once.

    Parameters
    ----------
    path
        The file.
    sensor
        Another spec to decode the codes with, such as one calibrated later; None: the one in the file.

    Attributes
    ----------
    sensor, names, origin_ns
        As of every source.
    about
        What the recorder noted about the scans: texts by key.

    Raises
    ------
    RecordingError
        The file is not a recording of tacstrip, or is damaged; also while iterating. Or `sensor` has another
        construction, number of strips or `adc_bits` than the codes.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> from tacstrip.stream import decode
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> contact = ts.Contact.polygon([(8, 40), (32, 40), (20, 70)])
    >>> source = ts.SimulatedSource(sensor, lambda time_s: contact, scans=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "session.mcap"
    ...     with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
    ...         ts.record(source, recorder)
    ...     recording = ts.Recording(file)
    ...     scans = [decode(raw, recording.sensor) for raw in recording]
    >>> len(scans), scans[0].signatures
    (5, ('k',))
    """

    clock = "recording"

    @takes(sensor=Sensor | LayeredSensor)
    def __init__(self, path: str | Path, sensor: AnySensor | None = None) -> None:
        self.path = Path(path)
        self._records = Records(path)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._rest = self._undamaged()
        spec: bytes | None = None
        about: dict[str, str] | None = None
        for record in self._rest:
            match record:
                case Attachment(name=name) if name == SPEC:
                    spec = record.data
                case Metadata(name=name) if name == ABOUT:
                    about = record.metadata
                case Message():
                    self._rest = itertools.chain([record], self._rest)
                    break
                case _:
                    self._note(record)
        if spec is None or about is None:
            self._fail(
                f"it has no attachment {SPEC} or no metadata {ABOUT!r}: not a recording of tacstrip; "
                f"`tacstrip import {shlex.quote(str(self.path))} SENSOR -o readings.csv` says what makes readings of it"
            )
        self.about = about
        self.names = self._names_in(about)
        self.origin_ns = self._origin_in(about)
        # Of two layers what takes one refuses it; the type of all others spares them to ask.
        self.sensor = cast(Sensor, self._matching(sensor, self._sensor_in(spec)))

    @property
    def condition(self) -> Condition:
        """The condition of the file; complete once the last scan was read."""
        return self._records.condition

    def __iter__(self) -> Iterator[RawScan]:
        """Yield each scan with the polygons and objects over time that follow it."""
        last: RawScan | None = None
        usual = () if self.about.get("method") else None  # without a method nothing was reconstructed
        for record in self._rest:
            self._note(record)
            if not isinstance(record, Message) or (channel := self._channels.get(record.channel_id)) is None:
                continue
            schema = self._schemas.get(channel.schema_id, "")
            if channel.topic == SCAN_TOPIC and schema in SCANS.values():
                if last is not None:
                    yield last
                time_s = (record.log_time - self.origin_ns) / NANO
                arrival_s = (record.publish_time - self.origin_ns) / NANO
                with self._located():
                    last = read_scan(record.data, schema, self.sensor, self.names, time_s)
                arrived = record.publish_time != record.log_time
                last = replace(last, shapes=usual, arrival_s=arrival_s if arrived else None)
            elif channel.topic in _STATUS and schema == POLYGON and last is not None:
                with self._located():
                    shape = read_polygon(record.data, _STATUS[channel.topic])
                last = replace(last, shapes=(*(last.shapes or ()), shape))
            elif channel.topic == RECONSTRUCTED_TOPIC and schema == RECONSTRUCTED and last is not None:
                with self._located():
                    known = read_reconstructed(record.data)
                last = replace(last, shapes=last.shapes or (() if known else None))
            elif channel.topic == TRACK_TOPIC and schema == TRACK and last is not None:
                with self._located():
                    track = read_track(record.data)
                last = replace(last, tracks=(*(last.tracks or ()), track))
            elif channel.topic == SEARCHING_TOPIC and schema == SEARCHING and last is not None:
                with self._located():
                    searching = read_searching(record.data)
                last = replace(last, tracks=last.tracks or None, searching=searching)
        if last is not None:
            yield last

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._records.close()

    def _undamaged(self) -> Iterator[McapRecord]:
        """Yield the records of the file; raise `RecordingError` where it is damaged."""
        for record in self._records:
            self._refuse_damage()
            yield record
        self._refuse_damage()

    def _refuse_damage(self) -> None:
        if self.condition.damage:
            self._fail(f"{self.condition.damage[0]}; `tacstrip recover` keeps what is whole")

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record.name
        elif isinstance(record, Channel):
            self._channels[record.id] = record

    def _sensor_in(self, spec: bytes) -> AnySensor:
        try:
            return with_converter(Sensor.from_dict(tomllib.loads(spec.decode())))
        except (SpecError, ValueError, RecursionError) as error:
            self._fail(f"its attachment {SPEC} is no sensor spec ({error})")

    def _names_in(self, about: Mapping[str, str]) -> tuple[str, ...]:
        if about.get("format") != FORMAT:
            self._fail(f"its format is {about.get('format')!r:.20}; this tacstrip reads format {FORMAT}")
        names = tuple(about.get("names", "").split(","))
        if unknown := [name for name in names if name not in NAMES]:
            self._fail(f"it has codes of the name {unknown[0]!r:.20}; known are: {', '.join(NAMES)}")
        return names

    def _origin_in(self, about: Mapping[str, str]) -> int:
        origin = about.get("origin_ns", "")
        if not (origin.isascii() and origin.isdigit() and len(origin) < 20 and int(origin) < 2**63):
            self._fail(f"its origin_ns is {origin!r:.20}, not a time since 1970 [ns]")
        return int(origin)

    def _matching(self, given: AnySensor | None, stored: AnySensor) -> AnySensor:
        """Return the sensor to decode with; refuse one that the codes cannot be of."""
        sensor = stored if given is None else with_converter(given)
        if isinstance(stored, Sensor) != isinstance(sensor, Sensor):
            own, other = ("two layers", "one") if isinstance(sensor, Sensor) else ("one layer", "two")
            self._fail(f"its codes are of a sensor of {own}, and the spec given has {other}")
        for key in ("construction", "strips", "adc_bits"):
            if getattr(stored, key) != getattr(sensor, key):
                self._fail(
                    f"its codes are of a sensor with {key} = {getattr(stored, key)}, and the spec given has "
                    f"{getattr(sensor, key)}"
                )
        for name in self.names:
            if name not in sensor.signatures and (name != ELECTRODES or unit_of(sensor).kind.closed_form):
                self._fail(f"it has codes {name}, which a {sensor.construction} sensor does not measure")
        return sensor

    @contextmanager
    def _located(self) -> Iterator[None]:
        """Name the file in errors of its messages."""
        try:
            yield
        except RecordingError as error:
            self._fail(str(error))

    def _fail(self, reason: str) -> NoReturn:
        self.close()
        raise RecordingError(f"{self.path}: {reason}")


class ReadingsSource:
    r"""The scans of a readings file (CSV) as a source.

    Attributes
    ----------
    rounded_steps
        Largest distance of a reading from its code, in steps of the converter; above 0.01 the file held more than the
        converter's bits.

    Raises
    ------
    ReadingError
        As of `tacstrip.read_readings`.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> from tacstrip.stream import ReadingsSource
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "readings.csv"
    ...     _ = file.write_text("scan,time_s,strip,code\n0,0.0,0,512\n0,0.0,1,\n")
    ...     [raw.codes["k"].tolist() for raw in ReadingsSource(file, sensor)]
    [[512, 0]]
    """

    clock = "file"

    @takes(sensor=Sensor | LayeredSensor)
    def __init__(self, path: str | Path, sensor: AnySensor) -> None:
        whole = with_converter(sensor)
        self.sensor = cast(Sensor, whole)  # as of `Recording`
        # The codes are stored as measured: calibration and touch thresholds are applied when they are decoded.
        bare: dict[str, Any] = {"calibration": None, "rest_volt": None, "touch_volt": None}
        plain = whole.changed(**bare) if isinstance(whole, LayeredSensor) else replace(whole, **bare)
        scans = read_unchecked(path, plain)
        self._scans = [encode(scan, plain, number) for number, scan in enumerate(scans)]
        self.names = tuple(self._scans[0].codes)
        self.origin_ns = 0 if scans[0].time_s > _EPOCH_S else time.time_ns()
        self.rounded_steps = max(quantisation_error(scan, plain) for scan in scans)

    def __iter__(self) -> Iterator[RawScan]:
        return iter(self._scans)

    def close(self) -> None:
        """Nothing is open."""


def open_source(path: str | Path, sensor: AnySensor | None = None) -> Recording | ReadingsSource:
    """Open a recording (.mcap) or a readings file (.csv), which needs a sensor.

    Raises
    ------
    RecordingError, ReadingError
        As of both; or the file has another ending.
    """
    match Path(path).suffix.lower():
        case ".mcap":
            return Recording(path, sensor)
        case ".csv" if sensor is not None:
            return ReadingsSource(path, sensor)
        case ".csv":
            raise RecordingError(
                f"{path}: a readings file does not say what sensor it is of; name its spec before it: sensor.toml "
                f"{path} ({BEGIN_SPEC})"
            )
        case _:
            raise RecordingError(
                f"{path}: scans are read from a file that ends in .mcap or .csv. {OTHER_FORM}"
            )

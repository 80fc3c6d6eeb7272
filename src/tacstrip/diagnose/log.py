"""Readings as the doctor takes them: raw, of every source, before anything is refused or called untouched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.columns import ELECTRODES, INDEX, Column, finite, strip_index, value_columns
from tacstrip.io.rows import Row, find, read_csv
from tacstrip.scan import Scan
from tacstrip.sensor.raw import apply_calibration, invert_calibration, touched
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import top_code
from tacstrip.stream.source import RawScan

_STRETCH, _STRETCHES = 2048, 16  # scans of a stretch, and how many of them a long recording leaves


@dataclass(frozen=True, eq=False)
class Log:
    """What a sensor read over a while.

    Attributes
    ----------
    sensor
        Its spec.
    time_s
        Time of each scan (scans,) [s].
    raw
        What the converter gave over Vref, by signature (scans, strips). Below 0 and above 1 are kept; NaN where there
        is no reading.
    touched
        Which strips are touched (scans, strips): those with a reading, further than `touch_volt` from rest where the
        spec has a rest level.

    Raises
    ------
    ReadingError
        There is no scan, or the arrays do not fit the sensor and each other.
    """

    sensor: Sensor
    time_s: FloatArray
    raw: Mapping[str, FloatArray]
    touched: BoolArray

    def __post_init__(self) -> None:
        shape = (len(self.time_s), self.sensor.strips)
        if not self.raw or not len(self.time_s):
            raise ReadingError("there is no scan to examine")
        for name, values in (*self.raw.items(), ("touched", self.touched)):
            if values.shape != shape:
                raise ReadingError(f"{name} has shape {values.shape}; give (scans, strips), here {shape}")
        for name in self.raw:
            self.sensor.check_signature(name)
        if not any(np.isfinite(values).any() for values in self.raw.values()):
            raise ReadingError(
                "there is no reading in any scan: nothing touched the sensor, or nothing came through"
            )

    @classmethod
    def of(cls, sensor: Sensor, time_s: FloatArray, raw: Mapping[str, FloatArray]) -> Log:
        """Make a log of raw readings over Vref (scans, strips); the spec says what is touched."""
        return cls(sensor, time_s, raw, touched(sensor, raw))

    @classmethod
    def of_scans(cls, sensor: Sensor, scans: Sequence[Scan]) -> Log:
        """Make a log of scans; the sensor's calibration, if it has one, is undone.

        Raises
        ------
        ReadingError, SignatureError
            There is none, or one is not of this sensor or has other signatures than the first.
        """
        if not scans:
            raise ReadingError("there is no scan to examine")
        for scan in scans:
            scan.check(sensor)
            if scan.signatures != scans[0].signatures:
                raise ReadingError("the scans have different signatures; examine those of one kind together")
        stacked = {name: np.stack([scan[name] for scan in scans]) for name in scans[0].signatures}
        there = np.stack([scan.touched for scan in scans])
        return cls(
            sensor, np.array([scan.time_s for scan in scans]), invert_calibration(sensor, stacked), there
        )

    @classmethod
    def of_codes(cls, sensor: Sensor, scans: Iterable[RawScan]) -> Log:
        """Make a log of raw scans, as recordings and serial ports give them; of very many, stretches evenly spread.

        Raises
        ------
        ReadingError
            There is none.
        """
        top = top_code(sensor)
        kept = _spread(scans)
        if not kept:
            raise ReadingError("there is no scan to examine")
        raw: dict[str, FloatArray] = {}
        for name in kept[0].codes:
            raw |= _own(name, np.stack([scan.codes[name] for scan in kept]) / top)
        if sensor.rest_volt is None:
            there = np.stack([scan.touched for scan in kept])
            raw = {name: np.where(there, values, np.nan) for name, values in raw.items()}
        return cls.of(sensor, np.array([scan.time_s for scan in kept]), raw)

    @property
    def k(self) -> dict[str, FloatArray]:
        """Readings corrected by the sensor's calibration (scans, strips), NaN where nothing touches."""
        raw = {name: np.where(self.touched, values, np.nan) for name, values in self.raw.items()}
        return raw if self.sensor.calibration is None else apply_calibration(self.sensor, raw)

    def part(self, most: int) -> Log:
        """Return at most so many scans: 8 stretches of neighbouring ones, evenly spread."""
        count = len(self.time_s)
        if count <= most:
            return self
        long = most // 8
        start = np.linspace(0, count - long, 8).astype(int)
        keep = (start[:, None] + np.arange(long)).ravel()
        raw = {name: values[keep] for name, values in self.raw.items()}
        return Log(self.sensor, self.time_s[keep], raw, self.touched[keep])


def read_log(path: str | Path, sensor: Sensor) -> Log:
    """Read a readings file (CSV) without refusing any voltage.

    Of a CRS-CRP sheet's electrodes each strip's own two are kept.

    Raises
    ------
    ReadingError
        The file cannot be read, or lacks a column or a strip; the message names the line and the way out.
    """
    return read_csv(path, "readings", lambda header, rows: _parse(header, rows, sensor))


def _parse(header: list[str], rows: Iterator[Row], sensor: Sensor) -> Log:
    index = [find(header, name) for name in INDEX]
    columns = value_columns(header, sensor)
    time_s: list[float] = []
    lines: list[FloatArray] = []
    seen: dict[int, int] = {}
    number: str | None = None
    for line, row in rows:
        scan, time_text, strip_text = (row[i] for i in index)
        if scan != number:
            _whole(seen, number, sensor)
            seen, number = {}, scan
            time_s.append(finite(time_text, line, "time_s"))
            lines.append(np.full((len(columns), sensor.strips), np.nan))
        strip = strip_index(strip_text, line, sensor)
        if strip in seen:
            raise ReadingError(
                f"line {line}: strip {strip_text} of scan {scan} is already on line {seen[strip]}"
            )
        seen[strip] = line
        lines[-1][:, strip] = [_field(row[c.index], line, c) for c in columns]
    if number is None:
        raise ReadingError("the file has a header but no readings")
    _whole(seen, number, sensor)
    values = np.stack(lines, axis=1)  # (columns, scans, strips)
    if columns[0].signature == ELECTRODES:
        return Log.of(sensor, np.array(time_s), _own("electrodes", np.moveaxis(values, 0, 2)))
    raw = {c.signature: v for c, v in zip(columns, values, strict=True)}
    return Log.of(sensor, np.array(time_s), raw)


def _field(text: str, line: int, column: Column) -> float:
    return finite(text, line, column.name) * column.scale if text else float("nan")


def _whole(seen: Mapping[int, int], number: str | None, sensor: Sensor) -> None:
    if number is not None and len(seen) < sensor.strips:
        missing = next(i for i in range(sensor.strips) if i not in seen) + sensor.strip_base
        raise ReadingError(
            f"scan {number} has no line for strip {missing}; an untouched strip needs its line too, with empty fields"
        )


def _spread(scans: Iterable[RawScan]) -> list[RawScan]:
    """Keep some 8 to 16 stretches, evenly spread, of a stream whose length nobody knows beforehand."""
    kept: list[list[RawScan]] = []
    every = 1
    for number, scan in enumerate(scans):
        stretch, at = divmod(number, _STRETCH)
        if stretch % every:
            continue
        if at == 0:
            if len(kept) == _STRETCHES:
                kept, every = kept[::2], 2 * every
                if stretch % every:
                    continue
            kept.append([])
        kept[-1].append(scan)
    return [scan for part in kept for scan in part]


def _own(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Return each strip's own two of a sheet's electrodes (scans, strips, 2 strips); else the values as they are."""
    if values.ndim == 2:
        return {name: values}
    each = np.arange(values.shape[1])
    return {"kh": values[:, each, len(each) + each], "kl": values[:, each, each]}

"""Readings as the doctor takes them: raw, from every source, none refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.errors import ReadingError
from tacstrip.io.columns import ELECTRODES, Column, finite, value_columns
from tacstrip.io.csv_rows import Row, read_csv
from tacstrip.io.readings import scan_lines
from tacstrip.scan import Scan
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.raw import apply_calibration, invert_calibration, touched
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import top_code
from tacstrip.stream.source import RawScan

_NO_VOLTAGE = 1e6  # times Vref: what no fault and no wrong unit makes of a reading
_STRETCH, _STRETCHES = 2048, 16  # scans of a stretch, and how many stretches are kept of a long recording


@dataclass(frozen=True, eq=False)
class Log:
    """Raw readings of a sensor over time.

    Attributes
    ----------
    sensor
        Its spec.
    time_s
        Time of each scan (scans,) [s].
    raw
        Raw readings over Vref by signature (scans, strips), those below 0 and above 1 too; NaN where there is none.
    touched
        Which strips are touched (scans, strips): those with a reading, further than `touch_volt` from rest where the
        spec has a rest level.
    missing
        What of the recording could not be read, in words; empty where it is whole.

    Raises
    ------
    ReadingError
        There is no scan, or the arrays do not fit the sensor and each other.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import Log
    >>> sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=10.0, length_mm=100.0)
    >>> log = Log.of(sensor, np.array([0.0, 0.01]), {"k": np.array([[0.3, 0.4, np.nan], [0.3, 0.4, 1.2]])})
    >>> log.touched.sum(axis=0)
    array([2, 2, 1])
    """

    sensor: Sensor
    time_s: FloatArray
    raw: Mapping[str, FloatArray]
    touched: BoolArray
    missing: str = ""

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
        raw = leave_out(sensor, raw)
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
        stacked = leave_out(
            sensor, {name: np.stack([scan[name] for scan in scans]) for name in scans[0].signatures}
        )
        there = np.stack([scan.touched for scan in scans])
        time_s = np.array([scan.time_s for scan in scans])
        return cls(sensor, time_s, invert_calibration(sensor, stacked), there)

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
            raw |= _own_electrodes(name, np.stack([scan.codes[name] for scan in kept]) / top)
        if sensor.rest_volt is None:
            there = np.stack([scan.touched for scan in kept])
            raw = {name: np.where(there, values, np.nan) for name, values in raw.items()}
        return cls.of(sensor, np.array([scan.time_s for scan in kept]), raw)

    @property
    def k(self) -> dict[str, FloatArray]:
        """Readings corrected by the sensor's calibration (scans, strips), NaN where nothing touches."""
        raw = {name: np.where(self.touched, values, np.nan) for name, values in self.raw.items()}
        return (
            raw
            if self.sensor.calibration is None and self.sensor.converter is None
            else apply_calibration(self.sensor, raw)
        )

    def part(self, most: int) -> Log:
        """Return at most so many scans: 8 stretches of neighbouring ones, evenly spread."""
        count = len(self.time_s)
        if count <= most:
            return self
        long = most // 8
        start = np.linspace(0, count - long, 8).astype(int)
        return self.kept((start[:, None] + np.arange(long)).ravel())

    def kept(self, scans: IntArray | BoolArray) -> Log:
        """Return some scans alone."""
        raw = {name: values[scans] for name, values in self.raw.items()}
        return replace(self, time_s=self.time_s[scans], raw=raw, touched=self.touched[scans])


@takes(path=Path | str)
def read_log(path: str | Path, sensor: Sensor) -> Log:
    r"""Read a readings file (CSV) without refusing any voltage.

    Of a CRS-CRP sheet's electrodes each strip's own two are kept. A last scan that lacks strips, as where writing was
    broken off, is not used, and `missing` says so.

    Raises
    ------
    ReadingError
        The file cannot be read, or lacks a column or a strip; the message names the line and the way out.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import read_log
    >>> sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=10.0, length_mm=100.0)
    >>> with open("readings.csv", "w", encoding="utf-8") as file:
    ...     size = file.write("scan,time_s,strip,v_out\n0,0.0,0,2.5\n1,0.1,0,6.0\n")
    >>> read_log("readings.csv", sensor).raw["k"].ravel()
    array([0.5, 1.2])
    """
    return read_csv(path, "readings", lambda header, rows: _log(header, rows, sensor))


def _log(header: list[str], rows: Iterator[Row], sensor: Sensor) -> Log:
    columns = value_columns(header, sensor)
    scans = list(scan_lines(header, rows, columns, sensor, _any_voltage))
    missing = ""
    if len(scans) > 1 and not scans[-1].strip_lines.all():
        cut = scans.pop()
        there = f"{np.count_nonzero(cut.strip_lines)} of {sensor.strips} strips"
        missing = f"the file is cut: its last scan, {cut.number}, has {there} and is not used"
    for scan in scans:
        scan.check_complete(sensor)
    time_s = np.array([scan.time_s for scan in scans])
    values = np.stack([scan.values for scan in scans], axis=1)  # (columns, scans, strips)
    if columns[0].signature == ELECTRODES:
        raw = _own_electrodes("electrodes", np.moveaxis(values, 0, 2))
    else:
        raw = {c.signature: v for c, v in zip(columns, values, strict=True)}
    return replace(Log.of(sensor, time_s, raw), missing=missing)


def _any_voltage(text: str, line: int, column: Column) -> float:
    """Return a field over Vref, in range or not; NaN where it is empty."""
    found = finite(text, line, column.name) * column.scale if text else float("nan")
    if abs(found) > _NO_VOLTAGE:
        raise ReadingError(
            f"line {line}: {column.name} = {text}{column.unit} is no voltage; mend or empty it"
        )
    return found


def _spread(scans: Iterable[RawScan]) -> list[RawScan]:
    """Keep some 8 to 16 stretches, evenly spread, of a stream of unknown length."""
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


def _own_electrodes(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Return each strip's own two of a sheet's electrodes (scans, strips, 2 strips); else the values as they are."""
    if values.ndim == 2:
        return {name: values}
    each = np.arange(values.shape[1])
    return {"kh": values[:, each, len(each) + each], "kl": values[:, each, each]}

"""Readings as CSV: a header, then a line per strip and scan.

Columns: scan, time_s, strip, and volts (v_h, v_l or v_out) or A/D codes (code_h, code_l or code); one of
v_h and v_l alone is a single-measurement. Of a CRS-CRP sheet all electrodes may be there instead: v_l_0, v_l_1, ...
at y = 0 and v_h_0, ... at y = L (or code_l_0, ...). Other columns are passed over, unless their
name is nearly that of a column that is missing. An empty field means that nothing touches the strip. Codes run from 0
to 2^adc_bits - 1, which reads Vref.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.files import replacing
from tacstrip.io.columns import (
    ELECTRODES,
    INDEX,
    Column,
    electrode_names,
    finite,
    strip_index,
    value,
    value_columns,
)
from tacstrip.io.rows import Row, find, read_csv
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.raw import apply_calibration, invert_calibration
from tacstrip.sensor.spec import Sensor


@takes(sensor=Sensor)
def read_readings(path: str | Path, sensor: Sensor) -> list[Scan]:
    """Read a readings file; the sensor's calibration, if it has one, corrects what the file holds.

    Raises
    ------
    ReadingError
        The file cannot be read, lacks a column or a strip, or has a value that cannot be; the message
        names the line and the way out.
    """
    example = ",".join([*INDEX, *(SIGNATURES[name].volt_column for name in sensor.signatures)])
    return read_csv(path, "readings", lambda header, rows: _scans(header, rows, sensor), example)


@takes(sensor=Sensor, scans=(Scan,))
def write_readings(path: str | Path, sensor: Sensor, scans: Sequence[Scan]) -> None:
    """Write scans as raw volts, which `read_readings` corrects again where the sensor has a calibration.

    Every strip has its line, an empty field where nothing touches.
    """
    names = scans[0].signatures
    whole = scans[0].electrodes is not None
    columns = electrode_names(sensor) if whole else [SIGNATURES[n].volt_column for n in names]
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow([*INDEX, *columns])
        for number, scan in enumerate(scans):
            raw = invert_calibration(sensor, {n: scan[n] for n in names})
            read = np.stack(list(raw.values()), axis=1) if scan.electrodes is None else scan.electrodes
            volts = read * sensor.vref_volt  # (strips, columns)
            for strip, row in enumerate(volts):
                fields = ("" if np.isnan(v) else f"{v:.9g}" for v in row)
                out.writerow([number, f"{scan.time_s:.9g}", strip + sensor.strip_base, *fields])


@dataclass
class _Open:
    """The scan being read."""

    number: str
    time_s: float
    line: int
    values: FloatArray  # (columns, strips)
    seen: list[int]  # line of each strip, 0 before it came


def _scans(header: list[str], rows: Iterator[Row], sensor: Sensor) -> list[Scan]:
    index = [find(header, name) for name in INDEX]
    columns = value_columns(header, sensor)
    scans: list[Scan] = []
    numbers: set[str] = set()
    now: _Open | None = None
    for line, row in rows:
        number, time_text, strip_text = (row[i] for i in index)
        if now is None or number != now.number:
            if now is not None:
                scans.append(_close(now, columns, sensor))
            if number in numbers:
                raise ReadingError(
                    f"line {line}: scan {number} comes again; the lines of a scan must be together"
                )
            numbers.add(number)
            values = np.full((len(columns), sensor.strips), np.nan)
            time_s = finite(time_text, line, "time_s")
            now = _Open(number, time_s, line, values, [0] * sensor.strips)
        strip = strip_index(strip_text, line, sensor)
        if now.seen[strip]:
            raise ReadingError(
                f"line {line}: strip {strip_text} of scan {number} is already on line {now.seen[strip]}"
            )
        now.seen[strip] = line
        now.values[:, strip] = [value(row[c.index], line, c) for c in columns]
    if now is None:
        raise ReadingError("the file has a header but no readings")
    return [*scans, _close(now, columns, sensor)]


def _close(scan: _Open, columns: list[Column], sensor: Sensor) -> Scan:
    """Finish a scan: every strip must be there, with all its readings or with none."""
    if 0 in scan.seen:
        missing = scan.seen.index(0) + sensor.strip_base
        raise ReadingError(
            f"scan {scan.number} (from line {scan.line}) has no line for strip {missing}; an untouched strip "
            "needs its line too, with empty fields"
        )
    empty = np.isnan(scan.values)
    for strip in np.flatnonzero(empty.any(axis=0) & ~empty.all(axis=0)):
        have, lack = (columns[int(i)].name for i in (empty[:, strip].argmin(), empty[:, strip].argmax()))
        raise ReadingError(
            f"line {scan.seen[strip]}: strip {strip + sensor.strip_base} has {have} but no {lack}; give both or neither"
        )
    raw = {c.name: v for c, v in zip(columns, scan.values, strict=True)}
    if columns[0].signature == ELECTRODES:
        return Scan.of_electrodes(
            np.stack(list(apply_calibration(sensor, raw).values()), axis=1), scan.time_s
        )
    raw = {c.signature: raw[c.name] for c in columns}
    return Scan(**apply_calibration(sensor, raw), time_s=scan.time_s)

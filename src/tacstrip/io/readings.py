"""Readings as CSV: a header, then a line per strip and scan.

Columns: scan, time_s, strip, and volts (v_h, v_l or v_out) or A/D codes (code_h, code_l or code); one of
v_h and v_l alone is a single-measurement. Of a CRS-CRP sheet all electrodes may be there instead: v_l_0, v_l_1, ...
at y = 0 and v_h_0, ... at y = L (or code_l_0, ...). Other columns are passed over. An empty field means that nothing
touches the strip. Codes run from 0 to 2^adc_bits - 1, which reads Vref.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.io.columns import ELECTRODES, INDEX, Column, electrode_names, finite, value, value_columns
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor


def read_readings(path: str | Path, sensor: Sensor) -> list[Scan]:
    """Read a readings file.

    Raises
    ------
    ReadingError
        The file cannot be read, lacks a column or a strip, or has a value that cannot be; the message
        names the line and the way out.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            return _scans(_rows(file), sensor)
    except FileNotFoundError:
        raise ReadingError(f"{path}: no such file") from None
    except (UnicodeDecodeError, csv.Error):
        raise ReadingError(f"{path}: not a text file in UTF-8; readings are CSV with a header line") from None
    except OSError as error:
        raise ReadingError(f"{path}: cannot be read ({error.strerror})") from None
    except ReadingError as error:
        raise ReadingError(f"{path}: {error}") from None


def write_readings(path: str | Path, sensor: Sensor, scans: Sequence[Scan]) -> None:
    """Write scans as volts; every strip has its line, an empty field where nothing touches."""
    names = scans[0].signatures
    whole = scans[0].electrodes is not None
    columns = electrode_names(sensor) if whole else [SIGNATURES[n].volt_column for n in names]
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow([*INDEX, *columns])
        for number, scan in enumerate(scans):
            read = np.stack([scan[n] for n in names], axis=1) if scan.electrodes is None else scan.electrodes
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


def _rows(file: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(file, strict=True)
    for row in reader:
        if any("\0" in field for field in row):
            raise ReadingError(f"line {reader.line_num}: not text; readings are CSV with a header line")
        if row:
            yield reader.line_num, [field.strip() for field in row]


def _scans(rows: Iterator[tuple[int, list[str]]], sensor: Sensor) -> list[Scan]:
    _, header = next(rows, (0, None))
    if header is None:
        raise ReadingError("the file is empty; it needs a header line and a line per strip and scan")
    if len(header) == 1 and (other := next((c for c in ";\t|" if c in header[0]), None)):
        raise ReadingError(
            f"columns are separated by {other!r}; separate them by commas, with decimal points"
        )
    if twice := [name for name in header if name and header.count(name) > 1]:
        raise ReadingError(f"column {twice[0]!r} is there twice; leave one out")
    index = [_find(header, name) for name in INDEX]
    columns = value_columns(header, sensor)
    scans: list[Scan] = []
    numbers: set[str] = set()
    now: _Open | None = None
    for line, row in rows:
        if len(row) != len(header):
            why = "is the file cut off?" if len(row) < len(header) else "are there decimal commas?"
            raise ReadingError(f"line {line} has {len(row)} fields and the header {len(header)}: {why}")
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
        strip = _strip(strip_text, line, sensor)
        if now.seen[strip]:
            raise ReadingError(
                f"line {line}: strip {strip_text} of scan {number} is already on line {now.seen[strip]}"
            )
        now.seen[strip] = line
        now.values[:, strip] = [value(row[c.index], line, c) for c in columns]
    if now is None:
        raise ReadingError("the file has a header but no readings")
    return [*scans, _close(now, columns, sensor)]


def _find(header: list[str], name: str) -> int:
    if name not in header:
        raise ReadingError(f"column {name!r} is missing; the header has: {', '.join(header)}")
    return header.index(name)


def _strip(text: str, line: int, sensor: Sensor) -> int:
    first, last = sensor.strip_base, sensor.strip_base + sensor.strips - 1
    try:
        strip = int(text)
    except ValueError:
        raise ReadingError(f"line {line}: strip is {text!r}, not a whole number") from None
    if not first <= strip <= last:
        raise ReadingError(
            f"line {line}: strip {strip} is out of range {first} to {last}; check strips and strip_base in the spec"
        )
    return strip - first


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
    if sensor.rest_volt is not None and sensor.touch_volt is not None:
        away = np.abs(scan.values * sensor.vref_volt - sensor.rest_volt)
        scan.values[:, ~(away > sensor.touch_volt).any(axis=0)] = np.nan
    if columns[0].signature == ELECTRODES:
        return Scan.of_electrodes(scan.values.T, scan.time_s)
    return Scan(**{c.signature: v for c, v in zip(columns, scan.values, strict=True)}, time_s=scan.time_s)

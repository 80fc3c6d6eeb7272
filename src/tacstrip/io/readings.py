"""Readings as CSV: a header, then a line per strip and scan.

Columns: scan, time_s, strip, and volts (v_h, v_l or v_out) or A/D codes (code_h, code_l or code); one of
v_h and v_l alone is a single-measurement. Other columns are passed over. An empty field means that nothing
touches the strip. Codes run from 0 to 2^adc_bits - 1, which reads Vref.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_INDEX = ("scan", "time_s", "strip")


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
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow([*_INDEX, *(SIGNATURES[n].volt_column for n in names)])
        for number, scan in enumerate(scans):
            volts = np.stack([scan[n] for n in names], axis=1) * sensor.vref_volt  # (strips, signatures)
            for strip, row in enumerate(volts):
                fields = ("" if np.isnan(v) else f"{v:.9g}" for v in row)
                out.writerow([number, f"{scan.time_s:.9g}", strip + sensor.strip_base, *fields])


@dataclass(frozen=True)
class _Column:
    index: int
    name: str
    signature: str
    scale: float  # field times scale is over Vref
    top: float  # largest legal field
    unit: str


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
    index = [_find(header, name) for name in _INDEX]
    columns = _value_columns(header, sensor)
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
            time_s = _finite(time_text, line, "time_s")
            now = _Open(number, time_s, line, values, [0] * sensor.strips)
        strip = _strip(strip_text, line, sensor)
        if now.seen[strip]:
            raise ReadingError(
                f"line {line}: strip {strip_text} of scan {number} is already on line {now.seen[strip]}"
            )
        now.seen[strip] = line
        now.values[:, strip] = [_value(row[c.index], line, c, sensor) for c in columns]
    if now is None:
        raise ReadingError("the file has a header but no readings")
    return [*scans, _close(now, columns, sensor)]


def _find(header: list[str], name: str) -> int:
    if name not in header:
        raise ReadingError(f"column {name!r} is missing; the header has: {', '.join(header)}")
    return header.index(name)


def _value_columns(header: list[str], sensor: Sensor) -> list[_Column]:
    volts = [n for n in SIGNATURES if SIGNATURES[n].volt_column in header]
    codes = [n for n in SIGNATURES if SIGNATURES[n].code_column in header]
    wanted = ", ".join(SIGNATURES[n].volt_column for n in sensor.signatures)
    wanted += " (or codes: " + ", ".join(SIGNATURES[n].code_column for n in sensor.signatures) + ")"
    if volts and codes:
        raise ReadingError("the header has both volts and codes; leave one kind out")
    if not volts and not codes:
        raise ReadingError(f"a column of readings is missing: {wanted}; the header has: {', '.join(header)}")
    for name in volts + codes:
        if name not in sensor.signatures:
            raise ReadingError(
                f"column {SIGNATURES[name].volt_column if volts else SIGNATURES[name].code_column!r} "
                f"does not belong to a {sensor.construction} sensor; it has: {wanted}"
            )
    if volts:
        v = sensor.vref_volt
        return [
            _Column(header.index(c), c, n, 1.0 / v, v, " V")
            for n in volts
            if (c := SIGNATURES[n].volt_column)
        ]
    if sensor.adc_bits is None:
        raise ReadingError(
            "the readings are A/D codes, and the spec has no adc_bits; add it, for example adc_bits = 12"
        )
    top = 2.0**sensor.adc_bits - 1.0
    return [
        _Column(header.index(c), c, n, 1.0 / top, top, "") for n in codes if (c := SIGNATURES[n].code_column)
    ]


def _finite(text: str, line: int, name: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise ReadingError(f"line {line}: {name} is {text!r}, not a number") from None
    if not math.isfinite(number):
        raise ReadingError(
            f"line {line}: {name} is {text!r}; leave the field empty where nothing touches"
            if name not in _INDEX
            else f"line {line}: {name} is {text!r}, not a finite number"
        )
    return number


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


def _value(text: str, line: int, column: _Column, sensor: Sensor) -> float:
    if not text:
        return float("nan")
    number = _finite(text, line, column.name)
    if not 0.0 <= number <= column.top * (1.0 + 1e-9):
        hint = "is it in millivolts, or an A/D code?" if column.unit and number > column.top else ""
        hint = hint or ("check adc_bits in the spec" if not column.unit else "check the wiring and vref_volt")
        raise ReadingError(
            f"line {line}: {column.name} = {text}{column.unit} is outside 0 to {column.top:.6g}{column.unit}; {hint}"
        )
    if not column.unit and number != round(number):
        raise ReadingError(f"line {line}: {column.name} = {text} is not a whole number; codes are counts")
    return min(number * column.scale, 1.0)


def _close(scan: _Open, columns: list[_Column], sensor: Sensor) -> Scan:
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
    return Scan(**{c.signature: v for c, v in zip(columns, scan.values, strict=True)}, time_s=scan.time_s)

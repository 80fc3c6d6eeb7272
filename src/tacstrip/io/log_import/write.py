"""Scans of a log as a readings file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tacstrip.arrays import BoolArray
from tacstrip.errors import OptionError
from tacstrip.io.columns import INDEX, seconds
from tacstrip.io.csv_rows import csv_writer
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import IN_VOLTS, OF_VREF
from tacstrip.io.log_import.scans import LogScan
from tacstrip.sensor.spec import Sensor

_OFFSET = 0.005  # over Vref: so far outside 0 to Vref, a reading is one at that end
_COLUMNS = {"h": ("v_h", "code_h"), "l": ("v_l", "code_l"), "out": ("v_out", "code")}


def write_log(
    path: Path, scans: Sequence[LogScan], mapping: ColumnMapping, vref_volt: float, strip_base: int
) -> None:
    """Write scans as readings (CSV): in volts, or in codes where the log has these.

    Parameters
    ----------
    path
        The file.
    scans, mapping
        Of the log.
    vref_volt
        Of readings that are over Vref.
    strip_base
        Number of the first strip in the file.
    """
    header, lines = as_readings(scans, mapping, vref_volt, strip_base)
    with csv_writer(path, header) as out:
        for row in lines:
            out.writerow(row)


def as_readings(
    scans: Sequence[LogScan], mapping: ColumnMapping, vref_volt: float, strip_base: int
) -> tuple[list[str], Iterator[list[str]]]:
    """Return the header and the lines of a readings file; parameters as of `write_log`."""
    codes = mapping.unit == "code" and not mapping.adc_bits and mapping.scale == 1.0
    scale = 1.0 if codes else in_volts(mapping, vref_volt)
    return [*INDEX, *(_COLUMNS[c][codes] for c in mapping.channels)], rows(
        scans, strip_base, scale, mapping.timed
    )


def in_volts(mapping: ColumnMapping, vref_volt: float, adc_bits: int | None = None) -> float:
    """Return the volts of one unit of the log's readings; of another Vref than the spec's, so that ratios hold."""
    if mapping.unit == "code":
        volts = vref_volt / (2.0 ** (mapping.adc_bits or adc_bits or 1) - 1.0)
    elif mapping.unit in OF_VREF:
        volts = vref_volt * OF_VREF[mapping.unit]
    else:
        volts = IN_VOLTS[mapping.unit] * (vref_volt / mapping.vref_volt if mapping.vref_volt else 1.0)
    return mapping.scale * volts


def at_rest(scans: Sequence[LogScan], mapping: ColumnMapping, sensor: Sensor | None) -> list[LogScan]:
    """Return scans from 0 V up, with readings that an offset, or noise about rest, puts outside 0 to Vref at that end.

    Raises
    ------
    OptionError
        They are measured from Vref down, and no spec says Vref.
    """
    if sensor is None:
        if mapping.from_vref:
            raise OptionError(
                "readings that are measured from Vref down: name the sensor's spec, which says Vref"
            )
        return list(scans)
    top = sensor.vref_volt / in_volts(mapping, sensor.vref_volt, sensor.adc_bits)
    if mapping.from_vref:
        scans = [LogScan(scan.time_s, top - scan.values, scan.line) for scan in scans]
    low, high = -_OFFSET, 1.0 + _OFFSET
    if sensor.rest_volt is not None and sensor.touch_volt is not None:
        low = min(low, (sensor.rest_volt - sensor.touch_volt) / sensor.vref_volt)
        high = max(high, (sensor.rest_volt + sensor.touch_volt) / sensor.vref_volt)
    clipped = []
    for scan in scans:
        values = scan.values
        near = (values >= low * top) & (values <= high * top)
        clipped.append(LogScan(scan.time_s, np.where(near, np.clip(values, 0.0, top), values), scan.line))
    return clipped


def touched(scans: Sequence[LogScan], mapping: ColumnMapping, sensor: Sensor | None) -> list[BoolArray]:
    """Return which strips of each scan something touches, (strips,): by `rest_volt` and `touch_volt`, where given."""
    if sensor is None or sensor.rest_volt is None or sensor.touch_volt is None:
        return [np.asarray(np.isfinite(s.values).any(axis=1)) for s in scans]
    scale, rest = in_volts(mapping, sensor.vref_volt, sensor.adc_bits), sensor.rest_volt
    return [np.asarray((np.abs(s.values * scale - rest) > sensor.touch_volt).any(axis=1)) for s in scans]


def rows(
    scans: Sequence[LogScan], strip_base: int, scale: float = 1.0, timed: bool = True
) -> Iterator[list[str]]:
    """Yield the lines of a readings file: scan, time, strip, readings, empty where nothing touches or has no time."""
    for number, scan in enumerate(scans):
        # A strip with one reading of two keeps it; the verbs take it with that one.
        for strip, values in enumerate(scan.values, strip_base):
            yield [
                str(number),
                seconds(scan.time_s) if timed else "",
                str(strip),
                *("" if np.isnan(v) else f"{v * scale:.9g}" for v in values),
            ]

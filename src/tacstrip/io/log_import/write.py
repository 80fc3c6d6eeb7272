"""Scans of a log as a readings file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tacstrip.io.columns import INDEX, seconds
from tacstrip.io.csv_rows import csv_writer
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import IN_VOLTS, OF_VREF
from tacstrip.io.log_import.scans import LogScan

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
    codes = mapping.unit == "code" and not mapping.adc_bits
    of_code = vref_volt / (2.0**mapping.adc_bits - 1.0) if mapping.adc_bits else 1.0
    scale = IN_VOLTS | {"code": of_code} | {unit: vref_volt * part for unit, part in OF_VREF.items()}
    return [*INDEX, *(_COLUMNS[c][codes] for c in mapping.channels)], rows(
        scans, strip_base, scale[mapping.unit]
    )


def rows(scans: Sequence[LogScan], strip_base: int, scale: float = 1.0) -> Iterator[list[str]]:
    """Yield the lines of a readings file: scan, time, strip, readings, empty where nothing touches."""
    for number, scan in enumerate(scans):
        # A strip with one reading of two keeps it; the verbs take it with that one.
        for strip, values in enumerate(scan.values, strip_base):
            yield [
                str(number),
                seconds(scan.time_s),
                str(strip),
                *("" if np.isnan(v) else f"{v * scale:.9g}" for v in values),
            ]

"""Readings as CSV: a header, then a line per strip and scan.

Columns: scan, time_s (which a single scan may lack; empty throughout where no times are known), strip, and volts
(v_h, v_l or v_out) or A/D codes (code_h, code_l or code); one of v_h and v_l alone is a single-measurement. Of a
CRS-CRP sheet all electrodes may be there instead: v_l_0, v_l_1, ... at y = 0 and v_h_0, ... at y = L (or code_l_0,
...). Other columns are passed over, unless their name is nearly that of a column that is missing. Empty fields mean
that nothing touches the strip; one of v_h and v_l alone, that the other channel is left out. Codes run from 0 to
2^adc_bits - 1, which reads Vref.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ReadingError
from tacstrip.io.column_names import nearly
from tacstrip.io.columns import (
    ELECTRODES,
    INDEX,
    OTHER_FORM,
    PLACE,
    POSITIONS,
    TIME,
    Column,
    electrode_names,
    finite,
    seconds,
    value,
    value_columns,
)
from tacstrip.io.csv_rows import Row, csv_writer, find, read_csv
from tacstrip.io.strip_columns import strip_fields, strip_reader
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.raw import apply_calibration, invert_calibration
from tacstrip.sensor.spec import Sensor


class Frame(Protocol):
    """What is used of a pandas DataFrame."""

    @property
    def columns(self) -> Iterable[Any]: ...  # noqa: D102
    def __getitem__(self, name: Any, /) -> Iterable[Any]: ...


_SAME = 0.01  # of the pitch: positions are rounded


def read_unchecked(path: str | Path | Frame, sensor: AnySensor) -> list[Scan]:
    """Read a readings file or a table as `tacstrip.read_readings` does, and warn of nothing."""
    if not isinstance(path, str | Path):
        header = [str(name) for name in path.columns]
        if isinstance(sensor, Sensor) and not set(INDEX) <= set(header):
            return _of_other_form(path, sensor)
        return _scans(header, _lines(path), sensor)
    columns, _ = strip_fields(sensor)
    example = ",".join([*INDEX[:-1], *columns, *(SIGNATURES[name].volt_column for name in sensor.signatures)])
    return read_csv(path, "readings", lambda header, rows: _scans(header, rows, sensor), example)


def _of_other_form(frame: Frame, sensor: Sensor) -> list[Scan]:
    """Return the scans of a table of somebody's form; `ReadingError` asks for what it does not tell."""
    from tacstrip.io.log_import.containers import of_columns  # late: files have no need of it
    from tacstrip.io.log_import.guess import propose
    from tacstrip.io.log_import.questions import Unanswered
    from tacstrip.io.log_import.write import as_readings

    columns = {name: _values(level) for name, level in _levels(getattr(frame, "index", None))}
    columns |= {str(name): _values(frame[name]) for name in frame.columns}
    try:
        found = propose(of_columns(columns), sensor)
    except Unanswered as open_:
        asked = "; ".join(question.text for question in open_.questions)
        raise ReadingError(
            f"the table does not say: {asked}. Name its columns so, or save it and import the file"
        ) from None
    header, rows = as_readings(found.scans, found.mapping, sensor.vref_volt, sensor.strip_base)
    return _scans(header, enumerate(rows, 1), sensor)


def _levels(index: Any) -> Iterator[tuple[str, Iterable[Any]]]:
    """Yield the levels of a table's index that have a name, or are times."""
    names = list(getattr(index, "names", [getattr(index, "name", None)]))
    times = hasattr(index, "tz") or hasattr(index, "total_seconds")
    for n, name in enumerate(names):
        if name is not None or times:
            yield str(name or "time"), index.get_level_values(n) if len(names) > 1 else index


def _values(column: Iterable[Any]) -> Iterable[Any]:
    """Return the values of a table's column, lists as such, which Polars has as columns within it."""
    return cast("Iterable[Any]", column.to_list()) if hasattr(column, "to_list") else column


def _lines(frame: Frame) -> Iterator[Row]:
    """Yield a table's rows as the lines of a file, counted from 1."""
    for n, row in enumerate(zip(*(frame[name] for name in frame.columns), strict=True), 1):
        yield n, [_field(v) for v in row]


def _field(value: Any) -> str:
    """Return what a file would hold for a table's value; tables have 3.0 for 3, and three kinds of nothing."""
    if value is None or value is getattr(sys.modules.get("pandas"), "NA", None) or value != value:
        return ""
    whole = isinstance(value, Real) and value == value // 1
    return str(int(value)) if whole else str(value)


@takes(sensor=Sensor | LayeredSensor, scans=(Scan,))
def write_readings(path: str | Path, sensor: AnySensor, scans: Sequence[Scan]) -> None:
    """Write scans as raw volts (CSV), which `read_readings` corrects again where the sensor has a calibration.

    Every strip has its line, an empty field where nothing touches.

    Parameters
    ----------
    path
        The file to write.
    sensor, scans
        The sensor, and scans of it, one or more, with the same signatures.

    Raises
    ------
    ReadingError
        There is no scan.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0, vref_volt=5.0)
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "readings.csv"
    >>> ts.write_readings(file, sensor, [ts.Scan(k=np.array([0.5, np.nan]))])
    >>> print(file.read_text(), end="")
    scan,time_s,strip,v_out
    0,0,0,2.5
    0,0,1,
    """
    if not scans:
        raise ReadingError(f"{path}: there is no scan to write")
    names = scans[0].signatures
    whole, unit = scans[0].electrodes is not None, unit_of(sensor)
    columns = electrode_names(unit) if whole else [SIGNATURES[n].volt_column for n in names]

    def fields(scan: Scan) -> Iterator[list[str]]:
        read = {n: scan[n] for n in names} if scan.electrodes is None else {ELECTRODES: scan.electrodes}
        raw = np.column_stack([*invert_calibration(unit, read).values()])
        for row in raw * unit.vref_volt:  # (columns,) [V]
            yield ["" if np.isnan(v) else f"{v:.9g}" for v in row]

    write_scans(path, sensor, columns, ((seconds(scan.time_s), fields(scan)) for scan in scans))


def write_scans(
    path: str | Path,
    sensor: AnySensor,
    columns: Sequence[str],
    scans: Iterable[tuple[str, Iterable[list[str]]]],
) -> int:
    """Write a readings file of each scan's time and its fields strip by strip; return the number of scans."""
    count, (places, named) = 0, strip_fields(sensor)
    with csv_writer(path, [*INDEX[:-1], *places, *columns]) as out:
        for time_text, strips in scans:
            for place, fields in zip(named, strips, strict=True):
                out.writerow([count, time_text, *place, *fields])
            count += 1
    return count


@dataclass(eq=False)
class ScanLines:
    """The lines of one scan.

    Attributes
    ----------
    number, line, time_s
        Its number in the file, the file's line where it begins, and its time [s].
    values
        Values of the fields (columns, strips).
    strip_lines
        The file's line of each strip (strips,), 0 where there is none.
    """

    number: str
    line: int
    time_s: float
    values: FloatArray
    strip_lines: IntArray

    def check_complete(self, sensor: AnySensor) -> None:
        """Refuse a scan that lacks a strip: `ReadingError` names it."""
        if not self.strip_lines.all():
            missing = sensor.where(int(self.strip_lines.argmin()))
            raise ReadingError(
                f"scan {self.number} (from line {self.line}) has no line for {missing}"
                "; an untouched strip needs its line too, with empty fields, and all lines of a scan must be together"
            )


def scan_lines(
    header: list[str],
    rows: Iterator[Row],
    columns: Sequence[Column],
    sensor: AnySensor,
    parse: Callable[[str, int, Column], float],
) -> Iterator[ScanLines]:
    """Yield a file's scans, complete or not; `parse` returns the value of a field on a line in a column.

    Raises
    ------
    ReadingError
        There is none, or a line has no time or no strip, or a strip for the second time; there are several scans, and
        no column of times.
    """
    if wrong := "" if TIME in header else nearly(header, [TIME], PLACE):
        raise ReadingError(wrong)
    number_at, strip_of = find(header, "scan"), strip_reader(header, sensor)
    find(header, "strip")
    time_at = header.index(TIME) if TIME in header else None  # without times: a single scan
    places = next(((name, header.index(name)) for name in POSITIONS if name in header), None)
    if isinstance(sensor, LayeredSensor):
        places = None  # of which layer they are nobody says
    first: dict[int, float] = {}  # where the strips of the first scan lie, if the file says so
    scan: ScanLines | None = None
    written = ""
    for line, row in rows:
        number, time_text = row[number_at], "0" if time_at is None else row[time_at]
        if scan is None or number != scan.number:
            if scan is not None:
                if time_at is None:
                    raise ReadingError(
                        f"column {TIME!r} is missing: line {line} begins a second scan, {number}; give every scan its "
                        f"time in seconds, or one scan a file. {OTHER_FORM}"
                    )
                yield scan
            if first and places is not None and isinstance(sensor, Sensor):
                _check_positions(places[0], first, sensor)
                places = None
            values = np.full((len(columns), sensor.strips), np.nan)
            time_s = _time(time_text, line, None if scan is None else written)
            written = time_text
            scan = ScanLines(number, line, time_s, values, np.zeros(sensor.strips, dtype=np.int64))
        elif time_text != written:
            _time(time_text, line, written)  # a strip's own time, which is passed over
        strip = strip_of(row, line)
        if earlier := scan.strip_lines[strip]:
            raise ReadingError(
                f"line {line}: {sensor.where(strip)} of scan {number} is already on line {earlier}"
            )
        scan.strip_lines[strip] = line
        if places is not None:
            first[strip] = finite(row[places[1]], line, places[0])
        scan.values[:, strip] = [parse(row[c.index], line, c) for c in columns]
    if scan is None:
        raise ReadingError("the file has a header but no readings")
    if places is not None and isinstance(sensor, Sensor):
        _check_positions(places[0], first, sensor)
    yield scan


def _time(text: str, line: int, before: str | None) -> float:
    """Return a scan's time [s]; 0 where it is empty, as it must be then on all lines (`before`: what the last had)."""
    if before is not None and (text == "") != (before == ""):
        has, lacks = ("a time", "none") if text else ("no time", "one")
        raise ReadingError(
            f"line {line} has {has}, and those above it {lacks}: give every scan its time_s in seconds, or leave it "
            "empty on all lines"
        )
    return finite(text, line, TIME) if text else 0.0


def _check_positions(name: str, places: Mapping[int, float], sensor: Sensor) -> None:
    """Refuse a file whose positions contradict its strips' numbers, or the spec's pitch by a unit."""
    x = [places[strip] for strip in sorted(places)]
    step = float(np.median(np.diff(x))) if len(x) > 1 else 0.0
    if step < 0.0:
        raise ReadingError(
            f"{name} falls from {max(x):.6g} to {min(x):.6g} while the strips' numbers rise: strip "
            f"{sensor.strip_base} lies at x = 0; number the strips in the order of {name}"
        )
    for unit, mm in (("centimetres", 10.0), ("metres", 1000.0)):
        for text, given in ((name, step * mm), ("pitch_mm in the spec", step / mm)):
            if step and abs(given / sensor.pitch_mm - 1.0) < _SAME:
                raise ReadingError(
                    f"{name} rises by {step:.6g} from strip to strip, and pitch_mm is {sensor.pitch_mm:.6g}: is {text} "
                    f"in {unit}? All lengths are millimetres"
                )


def _scans(header: list[str], rows: Iterator[Row], sensor: AnySensor) -> list[Scan]:
    columns = value_columns(header, unit_of(sensor))
    scans: list[Scan] = []
    numbers: set[str] = set()
    for lines in scan_lines(header, rows, columns, sensor, value):
        if lines.number in numbers:
            raise ReadingError(
                f"line {lines.line}: scan {lines.number} comes again; the lines of a scan must be together"
            )
        numbers.add(lines.number)
        lines.check_complete(sensor)
        scans.append(_scan(lines, columns, unit_of(sensor)))
    return scans


def _scan(lines: ScanLines, columns: list[Column], sensor: Sensor) -> Scan:
    """Return a complete scan. A strip with one reading of two counts with that one."""
    empty = np.isnan(lines.values)
    for strip in np.flatnonzero(empty.any(axis=0) & ~empty.all(axis=0)):
        if sensor.kind.closed_form:
            break
        have, lack = (columns[int(i)].name for i in (empty[:, strip].argmin(), empty[:, strip].argmax()))
        raise ReadingError(
            f"line {lines.strip_lines[strip]}: strip {strip + sensor.strip_base} has {have} but no {lack}; "
            "give both or neither"
        )
    whole = columns[0].signature == ELECTRODES
    raw = {c.name if whole else c.signature: v for c, v in zip(columns, lines.values, strict=True)}
    read = apply_calibration(sensor, raw)
    if whole:
        return Scan.of_electrodes(np.stack(list(read.values()), axis=1), lines.time_s)
    return Scan(**read, time_s=lines.time_s)

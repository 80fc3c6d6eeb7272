"""Checks for input that is valid but probably a mistake: metres for millimetres, exchanged columns, missing readings.

Each function returns a warning, or an empty text where it finds nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.io.columns import value, value_columns
from tacstrip.io.csv_rows import Row, read_csv
from tacstrip.io.readings import Frame, scan_lines
from tacstrip.reconstruction.implausible import scale_hint
from tacstrip.scan import Scan, time_goes_back
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.exchanged import exchanged, read_twice
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.left_out import channel_name, left_out
from tacstrip.sensor.raw import apply_calibration, invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor

_PITCH_MM = 0.1  # nobody cuts strips as fine
_LENGTH_MM = 2.0  # nor as short
_LONGEST_MM = 1e4  # nor as long, nor so many that they are as wide
_MANY, _STUBBY = 8, 3.0  # strips, and pitches, below which so many strips are seldom long
# Width of strips of such a pitch, half their length; the commonest sensor is ten centimetres wide.
_TINY_MM = 10.0
_SMALL = 0.01  # of the sensor's shorter side: a contact in metres is a thousandth of itself
_CORNER = 0.1  # of the sensor: one in centimetres lies within this, whatever it is and wherever it was to be
_VREF_VOLT = 2.0  # above it, volts that all stay below 1 are seldom volts
_END_BYTES, _FEW_ENDS = 65536, 8  # of a file's end that is looked at; numbers there, at least
_SOME = 20  # scans of a file of which outlines are looked at
_NAMED = 5  # channels that a warning names
_SLOW_S, _FEW_TIMES = 5.0, 4  # from scan to scan, and times: whole ones that rise so fast may be milliseconds
_MS_S = 2000.0  # a step above it would be microseconds
# Steps [s] that somebody sets; of ms nobody does.
_OF_MINUTES = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0)


def unlikely_lengths(sensor: AnySensor) -> str:
    """Return a warning where a spec's lengths, or one of them, seem to be in another unit."""
    if isinstance(sensor, LayeredSensor):
        return next(filter(None, (unlikely_lengths(layer.sensor) for layer in sensor.layers)), "")
    said = f"pitch_mm = {sensor.pitch_mm:.6g}, length_mm = {sensor.length_mm:.6g}: "
    if sensor.pitch_mm < _PITCH_MM:
        return f"{said}mm, not m? {_in_mm(sensor, 1000.0)}"
    if max(sensor.length_mm, sensor.width_mm) > _LONGEST_MM:
        return f"{said}mm, not micrometres? {_in_mm(sensor, 1e-3)}"
    if sensor.length_mm < max(_LENGTH_MM, sensor.pitch_mm):
        if_m = f"; if the length is in metres, write length_mm = {1000.0 * sensor.length_mm:.6g}"
        return (
            f"{said}a strip shorter than the pitch, or than 2 mm? All lengths in a spec are millimetres{if_m}"
        )
    if sensor.strips >= _MANY and sensor.length_mm < _STUBBY * sensor.pitch_mm:
        return (
            f"{said}strips hardly longer than they are apart? All lengths in a spec are millimetres; if the length is "
            f"in centimetres, write length_mm = {10.0 * sensor.length_mm:.6g}"
        )
    tiny = sensor.width_mm <= _TINY_MM or sensor.length_mm < 2.0 * _TINY_MM
    if sensor.pitch_mm < 10.0 * _PITCH_MM and tiny:
        return f"{said}mm, not cm? {_in_mm(sensor, 10.0)}"
    return ""


def _in_mm(sensor: Sensor, times: float) -> str:
    """Say what the lengths of a spec in another unit are in millimetres."""
    right = f"pitch_mm = {times * sensor.pitch_mm:.6g}, length_mm = {times * sensor.length_mm:.6g}"
    return f"All lengths in a spec are millimetres; if so, write {right}"


def unlikely_contact(contact: Contact, sensor: Sensor) -> str:
    """Return a warning where a contact's coordinates seem to be in metres or centimetres; points have no size."""
    x0, y0, x1, y1 = shapely.GeometryCollection(list(contact.shapes)).bounds
    size, shorter = max(x1 - x0, y1 - y0), min(sensor.width_mm, sensor.length_mm)
    corner = x0 >= 0.0 and x1 < _CORNER * sensor.width_mm and y0 >= 0.0 and y1 < _CORNER * sensor.length_mm
    if not 0.0 < size < (_CORNER * max(sensor.width_mm, sensor.length_mm) if corner else _SMALL * shorter):
        return ""
    unit, where = ("metres", "") if size < _SMALL * shorter else ("centimetres", " at x = y = 0")
    return (
        f"the contact is {size:.3g} mm large{where}, on a sensor of {sensor.width_mm:.6g} x {sensor.length_mm:.6g} mm: "
        f"is it in {unit}? Coordinates are millimetres"
    )


def unlikely_places(places_mm: FloatArray, sensor: Sensor) -> str:
    """Return a warning where the places (n, 3) from which something is pressed seem to be in metres or centimetres."""
    reach, shorter = float(np.abs(places_mm).max()), min(sensor.width_mm, sensor.length_mm)
    if not 0.0 < reach < (_CORNER if len(places_mm) > 1 else _SMALL) * shorter:
        return ""
    unit = "metres" if reach < _SMALL * shorter else "centimetres"
    return (
        f"the object is pressed within {reach:.3g} mm of x = y = z = 0, on a skin of {sensor.width_mm:.6g} x "
        f"{sensor.length_mm:.6g} mm: is that in {unit}? Positions are millimetres"
    )


def over_vref(path: str | Path, sensor: Sensor, largest: float) -> str:
    """Return a warning where a file's volts seem to be over Vref; `largest` is its largest reading over Vref."""
    if sensor.vref_volt <= _VREF_VOLT or not 0.0 < largest * sensor.vref_volt <= 1.0:
        return ""
    # A/D codes have no unit to be mistaken.
    if not read_csv(path, "readings", lambda header, rows: value_columns(header, sensor)[0].unit):
        return ""
    return (
        f"{path}: no reading is above 1 V, and vref_volt is {sensor.vref_volt:.6g}: are they over Vref? "
        "The columns hold volts; readings over Vref are read with vref_volt = 1 in the spec, or by "
        "`tacstrip import ... --answer unit=fraction`"
    )


def unlikely_times(path: str | Path, time_s: FloatArray) -> str:
    """Return a warning where times of scans (scans,) [s] seem to be milliseconds, or microseconds.

    Examples
    --------
    >>> unlikely_times("r.csv", np.arange(5) * 20.0)[:73]
    'r.csv: scans would come every 20 s, all at whole seconds: is the time in '
    >>> unlikely_times("r.csv", np.arange(5) * 0.02), unlikely_times("r.csv", np.arange(5) * 60.0)
    ('', '')
    """
    time_s = time_s[np.isfinite(time_s)]
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) < _FEW_TIMES - 1 or step < _SLOW_S or (time_s != np.round(time_s)).any():
        return ""
    if step in _OF_MINUTES and not (steps % step).any():  # scans may be left out
        return ""
    unit, short = ("milliseconds", "ms") if step <= _MS_S else ("microseconds", "us")
    return (
        f"{path}: scans would come every {step:g} s, all at whole seconds: is the time in {unit}? If so, "
        f"divide it, or `tacstrip import ... --answer time_unit={short}`; if scans come so seldom, leave it"
    )


def half_read(path: str | Path, sensor: Sensor, names: Sequence[str]) -> str:
    """Return a warning where readings have only one of the sensor's two signatures."""
    lack = [name for name in sensor.signatures if name not in names]
    have = [SIGNATURES[name] for name in names if name in sensor.signatures]
    if not lack or not have:
        return ""
    missing = SIGNATURES[lack[0]]
    return f"using {have[0].volt_column} only: {path} has no {missing.volt_column} (or {missing.code_column})"


def one_reading(path: str | Path, sensor: Sensor, scans: Sequence[Scan]) -> str:
    """Say which strips have one reading of two, where the spec does not leave the other channel out."""
    out = left_out(sensor)
    found = []
    for name in scans[0].signatures:
        empty = np.any([s.half_read & np.isnan(s[name]) for s in scans], axis=0) & ~out.get(
            name, np.array(False)
        )
        found += [channel_name(int(strip), name, sensor.strip_base) for strip in np.flatnonzero(empty)]
    if not found:
        return ""
    names = ", ".join(found[:_NAMED]) + (", ..." if len(found) > _NAMED else "")
    return f"{path}: {names} is empty where the strip's other channel has a reading; the strip counts with that one"


def readings_suspicions(
    path: str | Path | Frame,
    sensor: AnySensor,
    scans: Sequence[Scan],
    *,
    one_signature: bool = False,
    scale: bool = False,
) -> list[str]:
    """Say where readings are probably not what was meant.

    Parameters
    ----------
    path
        The readings file or the table that they were read from.
    sensor, scans
        As the caller was given them: of two layers, or one.
    one_signature
        Only one signature is wanted: that the other is missing is no fault.
    scale
        Look for readings of another scale, too; where outlines are found, they tell that better (`doubt_scale`).

    Returns
    -------
    list of str
        One a check, "" where nothing is to be told.
    """
    file = path if isinstance(path, str | Path) else "the table"
    unit, names = unit_of(sensor), scans[0].signatures
    raw = invert_calibration(unit, {name: np.stack([scan[name] for scan in scans]) for name in names})
    found = [] if one_signature else [half_read(file, unit, names)]
    times_s = np.array([scan.time_s for scan in scans])
    found += [unlikely_times(file, times_s), clock_back(file, times_s)]
    if not isinstance(sensor, LayeredSensor):
        told = misread(file, sensor, raw)
        hint = other_scale(sensor, raw) if scale and not any(told) else ""
        found += [one_reading(file, sensor, scans), *told, f"{file}: {hint}" if hint else ""]
    return [*found, *implausible(file, unit, raw)]


def clock_back(path: str | Path, times_s: FloatArray) -> str:
    """Return a warning where the times of a file's scans (scans,) [s] go back."""
    told = time_goes_back(times_s)
    return f"{path}: {told}" if told else ""


def misread(path: str | Path, sensor: Sensor, raw: Mapping[str, FloatArray]) -> list[str]:
    """Return warnings, each or empty, where a readings file's numbers are probably not what its columns say.

    Parameters
    ----------
    path, sensor
        The file, readings (.csv) or a recording, which has no text, and its sensor.
    raw
        Its raw readings over Vref by signature (scans, strips), NaN where nothing touches.
    """
    if Path(path).suffix.lower() == ".mcap" or not Path(path).is_file():  # a pipe is read once
        return []
    largest = max(float(np.nanmax(values, initial=0.0)) for values in raw.values())
    return [over_vref(path, sensor, largest), backwards(path, sensor), unfinished(path)]


def implausible(path: str | Path, sensor: Sensor, raw: Mapping[str, FloatArray]) -> list[str]:
    """Return warnings where readings are none of this sensor touched by something; arguments as of `misread`."""
    return [f"{path}: {one}" for one in (exchanged(raw), read_twice(raw), rest_hint(sensor, raw)) if one]


def other_scale(sensor: Sensor, raw: Mapping[str, FloatArray]) -> str:
    """Return a hint where raw readings over Vref look as if they were of another scale (`scale_hint`).

    By signature (scans, strips), NaN where nothing touches.
    """
    if sensor.surface is not None:
        return ""  # outlines would be needed
    touched = np.flatnonzero(np.any([np.isfinite(values).any(axis=1) for values in raw.values()], axis=0))
    if len(touched):
        touched = touched[np.unique(np.linspace(0, len(touched) - 1, _SOME).astype(int))]
    read = apply_calibration(sensor, {name: values[touched] for name, values in raw.items()})
    clipped = {name: np.clip(values, 0.0, 1.0) for name, values in read.items()}
    scans = [Scan(**{name: k[i] for name, k in clipped.items()}) for i in range(len(touched))]
    return scale_hint(scans, None, sensor)


def unfinished(path: str | Path) -> str:
    """Return a warning where a file's last number seems to be cut: no line end, and fewer digits than all others."""
    with Path(path).open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - _END_BYTES))
        *lines, last = file.read().decode(errors="replace").splitlines(keepends=True)[1:] or [""]
    fields = [line.strip().rsplit(",", 2)[1:] for line in lines if "," in line]
    own, beside = ([len(digits) for row in fields if (digits := row[at].partition(".")[2])] for at in (-1, 0))
    # Of few lines the column beside tells as much, where it has no fewer digits.
    others = own + beside if own and beside and min(beside) >= min(own) else own
    number = last.rpartition(",")[2].strip()
    least = min(others, default=0)
    ended = not number or last.endswith(("\n", "\r"))
    if ended or len(others) < _FEW_ENDS or len(number.partition(".")[2]) >= least:
        return ""
    return (
        f"{path}: the last line has no line end, and its last number, {number}, fewer digits than the "
        "others: is the file cut off?"
    )


def backwards(path: str | Path, sensor: Sensor) -> str:
    """Return a warning where the lines of a readings file count its strips down."""

    def falls(header: list[str], rows: Iterator[Row]) -> bool:
        scan = next(scan_lines(header, rows, [], sensor, value))
        return sensor.strips > 1 and bool((np.diff(scan.strip_lines) < 0).all())

    if not read_csv(path, "readings", falls):
        return ""
    return f"{path}: {counted_down(sensor.strip_base, sensor.strip_base + sensor.strips - 1)}"


def counted_down(first: int, last: int) -> str:
    """Say what lines that count strips down, from the last to the first, are taken for."""
    return (
        f"its lines count the strips down, from {last} to {first}; each is taken by its number, and strip {first} lies "
        "at x = 0. If it does not, number the strips the other way round"
    )

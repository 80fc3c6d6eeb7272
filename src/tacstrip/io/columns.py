"""Columns of a readings file: which there are, and what a field of theirs means."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tacstrip.errors import ReadingError, number, shortened
from tacstrip.io.column_names import nearly
from tacstrip.scan import max_rounding
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

TIME = "time_s"
INDEX = ("scan", TIME, "strip")
OTHER_FORM = "A log of another form? `tacstrip import LOG SENSOR -o READINGS` makes readings of it"
BEGIN_SPEC = "`tacstrip init` begins one"
LAYER = "layer"  # the column of a sensor of two layers, before that of the strip
PLACE = (*INDEX, LAYER, "l_mm", "w_mm")  # columns that are no readings

POSITIONS = ("x_mm", "pos_mm", "position_mm")  # where a strip lies, as a file may have it too
ELECTRODES = "electrodes"  # stands for a signature where all of a sheet's electrodes were read


@dataclass(frozen=True)
class Column:
    """One column of readings: `field * scale` is over Vref, `top` the largest field but for rounding, `slack`."""

    index: int
    name: str
    signature: str
    scale: float
    top: float
    unit: str
    slack: float = 0.0


def column_name(signature: str, codes: bool = False) -> str:
    """Return the column of a signature, in volts or in A/D codes."""
    return SIGNATURES[signature].code_column if codes else SIGNATURES[signature].volt_column


def electrode_names(sensor: Sensor, codes: bool = False) -> list[str]:
    """Return the columns of all electrodes of a sheet: those at y = 0, strip by strip, then those at y = L."""
    ends = [column_name(name, codes) for name in ("kl", "kh")]
    numbers = range(sensor.strip_base, sensor.strip_base + sensor.strips)
    return [f"{end}_{number}" for end in ends for number in numbers]


def value_columns(header: list[str], sensor: Sensor) -> list[Column]:
    """Return the header's columns of readings, in the order of the signatures or of the electrodes.

    Raises
    ------
    ReadingError
        There is none, there are both volts and codes, one is not of this sensor, or one is nearly, not quite, the
        name of a column that is missing.
    """
    volts = _named(header, sensor, codes=False)
    codes = _named(header, sensor, codes=True)
    by_kind = [[column_name(name, codes) for name in sensor.signatures] for codes in (False, True)]
    wanted = "{} (or codes: {})".format(*map(", ".join, by_kind))
    if volts and codes:
        raise ReadingError("the header has both volts and codes; leave one kind out")
    found = volts or codes
    if misspelt := _misspelt(header, sensor, found):
        raise ReadingError(misspelt)
    if not found:
        raise ReadingError(
            f"a column of readings is missing: {wanted}; the header has: {shortened(header)}. {OTHER_FORM}"
        )
    for name, signature in found.items():
        if signature not in (*sensor.signatures, ELECTRODES):
            raise ReadingError(
                f"column {name!r} does not belong to a {sensor.construction} sensor; it has: {wanted}"
            )
    if codes and sensor.adc_bits is None:
        raise ReadingError(
            "the readings are A/D codes, and the spec has no adc_bits; add it, for example adc_bits = 12"
        )
    top = 2.0 ** (sensor.adc_bits or 0) - 1.0 if codes else sensor.vref_volt
    unit, slack = ("", 0.0) if codes else (" V", top * max_rounding(sensor.adc_bits))
    return [Column(header.index(name), name, s, 1.0 / top, top, unit, slack) for name, s in found.items()]


def _named(header: list[str], sensor: Sensor, codes: bool) -> dict[str, str]:
    """Return the columns of one kind that are there, name to signature."""
    if not sensor.kind.closed_form:
        names = electrode_names(sensor, codes)
        there = set(names) & set(header)
        if lack := [name for name in names if name not in header] if there else []:
            raise ReadingError(
                nearly(header, lack, names, letters=False)
                or f"column {lack[0]!r} is missing: give all {len(names)} electrodes, or each strip's own two"
            )
        if there:
            return dict.fromkeys(names, ELECTRODES)
    return {column: name for name in SIGNATURES if (column := column_name(name, codes)) in header}


def _misspelt(header: list[str], sensor: Sensor, found: dict[str, str]) -> str:
    """Return an error message for a column that is probably a misspelt one of the sensor; an empty text where none is.

    Ignored like other unknown columns, it would silently leave the sensor with half of its readings.
    """
    if ELECTRODES in found.values():
        return ""
    every = {column_name(name, codes) for name in SIGNATURES for codes in (False, True)}
    kinds = [[column_name(name, codes) for name in sensor.signatures] for codes in (False, True)]
    # Where volts are there, a column that is nearly one of codes is passed over, and the other way round.
    wanted = [n for kind in kinds if not found or set(kind) & set(found) for n in kind if n not in header]
    if misspelt := nearly(header, wanted, {*PLACE, *every}):
        return misspelt
    if found or sensor.kind.closed_form:
        return ""
    sheet = [*electrode_names(sensor), *electrode_names(sensor, codes=True)]
    return nearly(header, sheet, sheet, letters=False)


def strip_index(text: str, line: int, sensor: Sensor) -> int:
    """Return a strip's number in a file as its place from 0, or raise `ReadingError` with its line."""
    first, last = sensor.strip_base, sensor.strip_base + sensor.strips - 1
    try:
        number(text)
        strip = int(text)
    except ValueError:
        raise ReadingError(f"line {line}: strip is {text!r}, not a whole number") from None
    if not first <= strip <= last:
        raise ReadingError(
            f"line {line}: strip {strip} is out of range {first} to {last}; check strips and strip_base in the spec"
        )
    return strip - first


def seconds(time_s: float) -> str:
    """Return a time as a text, to 1 ns as far as its digits go: also one that counts from 1970."""
    return repr(float(round(time_s, 9))).removesuffix(".0")


def finite(text: str, line: int, name: str) -> float:
    """Return a field as a finite number, or raise `ReadingError` with its line."""
    try:
        found = number(text)
    except ValueError:
        raise ReadingError(f"line {line}: {name} is {text!r}, not a number") from None
    if not math.isfinite(found):
        raise ReadingError(
            f"line {line}: {name} is {text!r}; leave the field empty where nothing touches"
            if name not in PLACE
            else f"line {line}: {name} is {text!r}, not a finite number"
        )
    return found


def value(text: str, line: int, column: Column) -> float:
    """Return a field over Vref, NaN where it is empty, or raise `ReadingError` with its line."""
    if not text:
        return float("nan")
    found = finite(text, line, column.name)
    if not -column.slack <= found <= column.top + column.slack:
        hint = (
            "is it in millivolts or percent, or an A/D code? `tacstrip import` reads these"
            if column.unit and found > column.top
            else ""
        )
        hint = hint or ("check adc_bits in the spec" if not column.unit else "check the wiring and vref_volt")
        raise ReadingError(
            f"line {line}: {column.name} = {text}{column.unit} is outside 0 to {column.top:.6g}{column.unit}; {hint}"
        )
    if not column.unit and found != round(found):
        raise ReadingError(f"line {line}: {column.name} = {text} is not a whole number; codes are counts")
    return min(max(found * column.scale, 0.0), 1.0)

"""Checks for input that is valid but probably a mistake: metres for millimetres, exchanged columns, missing readings.

Each function returns a warning, or an empty text where it finds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.io.columns import value_columns
from tacstrip.io.csv_rows import read_csv
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import channel_name, left_out
from tacstrip.sensor.spec import Sensor

_PITCH_MM = 0.1  # nobody cuts strips as fine
_LENGTH_MM = 2.0  # nor as short, or shorter than they are wide
_SMALL = 0.01  # of the sensor's shorter side: a contact in metres is a thousandth of itself
_VREF_VOLT = 2.0  # above it, volts that all stay below 1 are seldom volts
_NOISE = 0.005  # of Vref: P.U. profile I
_NAMED = 5  # channels that a warning names
_FEW = 4  # touched strips: of fewer, noise alone can exchange most


def in_metres(sensor: Sensor) -> str:
    """Return a warning where a spec's lengths seem to be in metres."""
    if sensor.pitch_mm >= _PITCH_MM and sensor.length_mm >= max(_LENGTH_MM, sensor.pitch_mm):
        return ""
    return (
        f"pitch_mm = {sensor.pitch_mm:.6g}, length_mm = {sensor.length_mm:.6g}: mm, not m? "
        "All lengths in a spec are millimetres"
    )


def contact_in_metres(contact: Contact, sensor: Sensor) -> str:
    """Return a warning where a contact is so small that its coordinates seem to be in metres; points have no size."""
    x0, y0, x1, y1 = shapely.GeometryCollection(list(contact.shapes)).bounds
    size = max(x1 - x0, y1 - y0)
    if not 0.0 < size < _SMALL * min(sensor.width_mm, sensor.length_mm):
        return ""
    return (
        f"the contact is {size:.3g} mm large, on a sensor of {sensor.width_mm:.6g} x {sensor.length_mm:.6g} mm: is it "
        "in metres? Coordinates are millimetres"
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
        "The columns hold volts"
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


def exchanged(scans: Sequence[Scan], noise: Noise | None = None) -> str:
    """Return a warning where k_h is below k_l, beyond noise, on most strips of a scan, which no sensor can measure."""
    beyond = max(_NOISE, noise.quantisation + noise.positional if noise is not None else 0.0)
    found: list[tuple[int, int, int]] = []
    for number, scan in enumerate(scans):
        if scan.kh is None or scan.kl is None:
            return ""
        below, touched = int((scan.kh < scan.kl - beyond).sum()), int(scan.touched.sum())
        if touched >= _FEW and 2 * below > touched:
            found.append((number, below, touched))
    if not found:
        return ""
    number, below, touched = found[0]
    more = f" of scan {number}, and so in {len(found) - 1} scan(s) more" if len(found) > 1 else ""
    return f"k_h is below k_l on {below} of {touched} strips{more}: are the columns exchanged?"


def largest(scans: Sequence[Scan]) -> float:
    """Return the largest reading of scans over Vref, 0 where nothing touches."""
    values = np.concatenate([scan[name] for scan in scans for name in scan.signatures])
    return float(np.nanmax(values)) if np.isfinite(values).any() else 0.0

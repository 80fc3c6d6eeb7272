"""Tables 6.1, 6.5 and 6.7 from simulated calibration runs, 6.8-6.11 from the twins, and the tube's points.

A run touches every strip at the unit marks, a centimetre each, over w = 0, 5 and 10 units (6.1.1); on the tube with
w = 0 only (6.3.1). The twin's reading is the closed form, plus an error drawn from P.U. profile II, plus the printed
offset, clipped at 0 and Vref; the thesis' mean offsets are then fitted to it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.offsets import mean_offsets
from tacstrip.contact.noise import add_reading_errors
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.data.published import offsets_volt, published
from tacstrip.io.runs import Runs
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.chapter6.tables import PROFILE_II
from tacstrip.thesis.chapter6.twin import (
    LINES,
    PLACINGS,
    PROTOTYPES,
    REGIONS,
    calibrated,
    line_errors,
    raw_scan,
    region_errors,
    twin,
)

UNIT_MM = 10.0
_HALF_DIGIT_VOLT = 0.0005
_HALF_DIGIT_PERCENT = 0.05


def widths_mm(sensor: Sensor) -> tuple[float, ...]:
    """Return the lengths w of the thesis' calibration contacts [mm]."""
    return (0.0,) if sensor.kind.cylindrical else (0.0, 5.0 * UNIT_MM, 10.0 * UNIT_MM)


def calibration_runs(sensor: Sensor, random: np.random.Generator) -> Runs:
    """Return the readings of a twin's calibration contacts, all strips at every mark."""
    marks = [
        (l, w) for w in widths_mm(sensor) for l in np.arange(UNIT_MM, sensor.length_mm, UNIT_MM)
        if l + w < sensor.length_mm
    ]  # fmt: skip
    l_mm, w_mm = np.repeat(np.array(marks).T[:, :, None], sensor.strips, axis=2)  # (contacts, strips)
    ideal = signatures(sensor, l_mm, l_mm + w_mm)
    noisy = {name: add_reading_errors(k, PROFILE_II, random) for name, k in ideal.items()}
    raw = invert_calibration(sensor, noisy)
    return Runs(l_mm=l_mm, w_mm=w_mm, raw=raw, line=np.zeros(l_mm.shape, dtype=np.intp), rest={})


def calibration_rows(seeds: int) -> list[dict[str, Any]]:
    """Return, for tables 6.1, 6.5 and 6.7, the offsets [V] that the runs give: median, p05, p95, inside."""
    found = {name: _offsets(name, seeds) for name in PROTOTYPES}
    rows = []
    for printed in published()["calibration"]:
        volt = found[printed["sensor"]][printed["signature"]]  # (seeds, strips)
        median, low, high = np.percentile(volt, [50.0, 5.0, 95.0], axis=0)
        offsets = offsets_volt(printed["sensor"], printed["signature"])
        inside = (low - _HALF_DIGIT_VOLT <= offsets) & (offsets <= high + _HALF_DIGIT_VOLT)
        ours = {"median": median, "p05": low, "p95": high, "inside": inside}
        rows.append({"offset_volt": {name: values.tolist() for name, values in ours.items()}})
    return rows


def residual_rows() -> list[dict[str, Any]]:
    """Return, for tables 6.8-6.11, the errors [% of Vref] of the twins' calibrated readings.

    They are put in as printed; where they differ, a raw reading would have been below 0 or above Vref.
    """
    read = [values for name, placings in PLACINGS.items() for values in _rectangle_errors(name, placings)]
    read += list(_line_errors())
    rows = []
    for printed, ours in zip(published()["residual"], read, strict=True):
        same = np.abs(np.array(printed["percent_of_vref"]) - ours) <= _HALF_DIGIT_PERCENT
        inside = [None if np.isnan(v) else bool(s) for v, s in zip(ours, same, strict=True)]
        rows.append({"percent_of_vref": ours.tolist(), "inside": inside})
    return rows


def prototype_rows() -> list[dict[str, Any]]:
    """Return the geometry of the shipped specs under the keys of the printed one."""
    return [
        {
            "strips": s.strips,
            "strip_width_cm": s.strip_width / 10.0,
            "strip_length_cm": s.length_mm / 10.0,
            "digital_extent_cm": s.width_mm / 10.0,
            "elements_per_cm": 10.0 / s.pitch_mm,
            "radius_cm": None if s.radius_mm is None else s.radius_mm / 10.0,
            "spec": spec,
        }
        for s, spec in ((twin(name), spec) for name, spec in PROTOTYPES.items())
    ]


def recovered_points() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the tube's points: true y, y from raw and from calibrated readings, (4 lines, 2 points) each [mm].

    A point touches with w = 0, where (3.7) is k = l / L: the straight line of figure 6.34.
    """
    sensor = twin("Cyl-CRS-M")
    true, raw, good = (np.empty((len(LINES), 2)) for _ in range(3))
    for i, line in enumerate(LINES):
        strips, true[i] = [strip for strip, _ in line], [y for _, y in line]
        scan = raw_scan(sensor, line_contact(sensor, i), {"k": _on_strips(i)})
        raw[i] = scan["k"][strips] * sensor.length_mm
        good[i] = calibrated(sensor, scan)["k"][strips] * sensor.length_mm
    return true, raw, good


def line_contact(sensor: Sensor, line: int) -> Contact:
    """Return the two points of a line on the tube."""
    return Contact.points([(sensor.x_mm[strip], y) for strip, y in LINES[line]])


def _offsets(name: str, seeds: int) -> dict[str, FloatArray]:
    """Return the mean offsets of simulated runs, (seeds, strips) [V], by signature."""
    sensor = twin(name)
    plain = replace(sensor, calibration=None)
    runs = (calibration_runs(sensor, np.random.default_rng([6, seed])) for seed in range(seeds))
    fits = [mean_offsets(plain, made) for made in runs]
    volt = sensor.vref_volt
    return {s: volt * np.array([fit.channel(s).offset for fit in fits]) for s in sensor.signatures}


def _rectangle_errors(name: str, placings: dict[str, Any]) -> list[FloatArray]:
    """Return the calibrated readings' errors [% of Vref], signature by signature, region by region."""
    sensor, placing = twin(name), next(iter(placings.values()))
    plain = replace(sensor, calibration=None)
    found = []
    for signature in sorted(sensor.signatures):
        for region in REGIONS:
            contact = placing.contact(sensor, region)
            read = calibrated(sensor, raw_scan(sensor, contact, region_errors(name, region)))
            none = {s: np.zeros(sensor.strips) for s in sensor.signatures}
            found.append(100.0 * (read[signature] - raw_scan(plain, contact, none)[signature]))
    return found


def _line_errors() -> FloatArray:
    """Return the calibrated readings' errors on the tube (4 lines, strips) [% of Vref]; NaN untouched."""
    true, _, good = recovered_points()
    sensor = twin("Cyl-CRS-M")
    errors = np.full((len(LINES), sensor.strips), np.nan)
    for i, line in enumerate(LINES):
        errors[i, [strip for strip, _ in line]] = 100.0 * (good[i] - true[i]) / sensor.length_mm
    return errors


def _on_strips(line: int) -> FloatArray:
    errors = np.zeros(twin("Cyl-CRS-M").strips)
    errors[[strip for strip, _ in LINES[line]]] = line_errors()[line]
    return errors

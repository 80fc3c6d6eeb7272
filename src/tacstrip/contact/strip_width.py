"""Strips as wide as they are: where ideal contact on a thin strip would end that reads the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.footprint import footprint, on_sensor
from tacstrip.contact.shape import Contact
from tacstrip.contact.slant import PARTS, STEEPEST, edge_read
from tacstrip.sensor.spec import Sensor

_STRAIGHT = 1e-3  # of the width: an edge that bends by less is straight
_LONG = 2.0  # widths: over a shorter contact both edges know of each other
_LENGTHS = 4.0  # and so many lambda


@dataclass(frozen=True, eq=False)
class WideEnds:
    """What wide strips read of contacts.

    Attributes
    ----------
    l, u
        Ends of the ideal contact that reads the same (contacts, strips) [mm]; NaN where nothing touches.
    exact
        Where this is so to 1e-4 of Vref: the strip is covered over its whole width, by straight edges far from each
        other. Others are off by some 3e-3 where the width is 1 % of the length, by 1e-2 at 5 %, rarely more.
    """

    l: FloatArray
    u: FloatArray
    exact: BoolArray


def wide(sensor: Sensor, contacts: Sequence[Contact]) -> bool:
    """Whether strips are to be taken as wide: the spec gives a width, and areas touch, which have an edge across it."""
    if sensor.surface is not None:  # on a curved skin strips count as their centre lines
        return False
    return sensor.strip_width_mm is not None and all(s.area > 0.0 for c in contacts for s in c.shapes)


def wide_ends(sensor: Sensor, contacts: Sequence[Contact]) -> WideEnds:
    """Return what wide strips read of areas, by lines across the width; errors as of `footprint`."""
    width, lam = sensor.strip_width, sensor.contact_lambda_mm
    kept = [on_sensor(sensor, c) for c in contacts]
    size = (len(contacts), sensor.strips, PARTS + 1)
    low, high = np.full(size, np.nan), np.full(size, np.nan)
    for line, across in enumerate(width * (np.arange(PARTS + 1) / PARTS - 0.5)):
        moved = [c.moved(-float(across), 0.0) for c in kept]
        inside = [i for i, c in enumerate(moved) if max(s.bounds[2] for s in c.shapes) >= 0.0]
        inside = [i for i in inside if min(s.bounds[0] for s in moved[i].shapes) <= sensor.width_mm]
        if inside:
            l, u = footprint(sensor, [moved[i] for i in inside])
            low[inside, :, line], high[inside, :, line] = l, u
    read = edge_read(low, width, -1.0, lam), edge_read(high, width, 1.0, lam)
    l, u = (np.clip(end, 0.0, sensor.length_mm) for end in read)
    exact = closed_form_fits(sensor, low, high)
    touched = np.isfinite(l)
    u = np.where(touched, np.maximum(l, u), np.nan)
    return WideEnds(l, u, np.asarray(exact & touched))


def closed_form_fits(sensor: Sensor, low: FloatArray, high: FloatArray) -> BoolArray:
    """Whether strips under edges at even places across the width (..., places) [mm] read as `edge_read` says (...).

    They do if covered over the whole width by straight edges that are level, or far from each other and the border.
    """
    width, lam = sensor.strip_width, sensor.contact_lambda_mm
    bent = np.maximum(*(np.abs(np.diff(edge, 2, axis=-1)).max(axis=-1, initial=0.0) for edge in (low, high)))
    steep = np.maximum(*(np.ptp(edge, axis=-1) for edge in (low, high)))
    apart = (high - low).min(axis=-1) >= _LONG * width + _LENGTHS * lam
    border = np.minimum(low.min(axis=-1), sensor.length_mm - high.max(axis=-1)) >= _LONG * width
    steepest = STEEPEST * width if lam > 0.0 else np.inf
    level = steep <= _STRAIGHT * width
    return np.asarray((bent <= _STRAIGHT * width) & (level | apart & border & (steep < steepest)))

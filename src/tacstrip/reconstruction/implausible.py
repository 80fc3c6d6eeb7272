"""Results to doubt whatever the fit: readings that cannot be meant, and ends beside strips that are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.exchanged import exchanged
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor

_OF_RUNS = ("polygon", "profile", "vertex")  # methods that take an object to end where its strips do
_MUCH_MORE = 0.2  # of its area: an IoU of .8 is what "ok" promises


def doubt_implausible(result: Reconstruction, scan: Scan, sensor: Sensor) -> Reconstruction:
    """Return the result; where the readings are implausible "doubtful" in place of "ok", and with advice."""
    hint = implausible_hint(scan, sensor, result.status not in ("ok", "likely") or bool(result.advice))
    if not hint and not sensor.without:
        return result

    def doubted(found: RecoveredObject) -> RecoveredObject:
        beside = goes_on(found.vertices, found.strips, sensor) if result.method in _OF_RUNS else ""
        advice = "; ".join(filter(None, (found.advice, beside, hint)))
        if not (beside or hint):
            return found
        status = "doubtful" if found.status in ("ok", "likely") else found.status
        return replace(found, status=status, advice=advice, confidence=None if beside else found.confidence)

    return replace(result, objects=tuple(map(doubted, result.objects)))


def goes_on(vertices: FloatArray, strips: slice, sensor: Sensor) -> str:
    """Say that an object may go on under strips that are left out, if by much: a convex one widens no faster."""
    unread = left_out_wholly(sensor)
    if not unread.any() or len(vertices) < 3:
        return ""
    x, closed = sensor.x_mm, sensor.closed
    polygon, more, names = shapely.Polygon(vertices).buffer(0.0), 0.0, []
    for last, step in ((strips.start, -1), (strips.stop - 1, 1)):
        beside: list[int] = []
        at = last + step
        while (
            (closed or 0 <= at < sensor.strips) and unread[at % sensor.strips] and len(beside) < sensor.strips
        ):
            beside.append(at % sensor.strips)
            at += step
        if not beside:
            continue
        origin = x[0] + last * sensor.pitch_mm
        # A little within the strip's centre line, for the outline may end there.
        width, inner = (_chord(polygon, origin - step * d * sensor.pitch_mm, sensor) for d in (0.01, 1.0))
        slope = width - inner if strips.stop - strips.start > 1 else 0.0
        ahead = np.maximum(width + slope * np.arange(1, len(beside) + 1), 0.0)
        more += float(ahead.sum()) * sensor.pitch_mm
        names += [str(s + sensor.strip_base) for s in beside]
    if more <= _MUCH_MORE * polygon.area:
        return ""
    return (
        f"strip {', '.join(names)} beside it is left out, so nobody knows whether it goes on there, by {more:.0f} mm2 "
        "at most if it is convex: mend the strip, or put the object elsewhere"
    )


def _chord(polygon: shapely.Geometry, x_mm: float, sensor: Sensor) -> float:
    line = shapely.LineString([(x_mm, -sensor.length_mm), (x_mm, 2.0 * sensor.length_mm)])
    return float(polygon.intersection(line).length)


def implausible_hint(scan: Scan, sensor: Sensor, failed: bool) -> str:
    """Say why readings cannot be meant, nothing where they can; `failed`: whether their result is doubted anyway."""
    read = {name: scan[name] for name in scan.signatures}
    hint = exchanged(read) if sensor.kind.closed_form else ""
    if scan.touched.all() and not hint:
        hint = rest_hint(sensor, invert_calibration(sensor, read), failed)
    if scan.moved:
        hint = (
            f"the contact moved while {scan.averaged} scans were averaged: half of the channels changed by "
            f"{100.0 * scan.moved:.2g} % of Vref or more; average fewer"
        )
    return hint

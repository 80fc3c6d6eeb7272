"""Results to doubt whatever the fit: readings that cannot be meant, and ends beside strips that are left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject, Status
from tacstrip.scan import Scan
from tacstrip.sensor.exchanged import exchanged, read_twice
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor

_OF_RUNS = ("polygon", "profile", "vertex")  # methods that take an object to end where its strips do
_MUCH_MORE = 0.2  # of its area: an IoU of .8 is what "ok" promises
_TOLD = 2.0  # deviations of the area: it is said that an end is open where more may hide there
_LEAST_VOLT = 1.5  # Vref below which readings over Vref are hardly smaller than volts
_BITS = (8, 10, 12, 14)  # of converters that are common
_ASPECT = 0.55  # standard deviation of the logarithm of objects' extent along the strips over that across
_BORDER = 0.05  # of the smaller scale: what ends below it may be cut by the border, and looks flat for that
SCALE = "all that touches is flat and lies near y = 0"
_STRANGE = "does not fit its neighbours"  # in advice: what an untouched strip with readings looks like
_WIDE = 2.5  # strips: narrower ones do not tell
_PLACES = 3  # more of them are not taken for more
_ODDS = 4.0  # logarithm of the odds beyond which readings are taken for another scale's


def doubt_implausible(result: Reconstruction, scan: Scan, sensor: Sensor) -> Reconstruction:
    """Return the result; where the readings are implausible "doubtful" in place of "ok", and with advice."""
    # An untouched strip with readings contradicts the others in both, a faulty channel in one.
    told = [o.advice for o in result.objects if not o.faulty]
    strange = any(_STRANGE in advice for advice in told)
    failed = strange or result.status not in ("ok", "likely")
    # Nor does one pass for the border of strips at rest: without it a contact explains all others, be it not for sure.
    explained = all(o.status in ("ok", "likely") or o.confidence is not None for o in result.objects)
    faulty = explained and not strange and any(o.faulty for o in result.objects)
    hint = implausible_hint(scan, sensor, failed, [o.vertices for o in result.objects], faulty)
    if not hint and not sensor.without:
        return result

    def judged(found: RecoveredObject) -> RecoveredObject:
        beside = goes_on(found.vertices, found.strips, sensor) if result.method in _OF_RUNS else ""
        why = "; ".join(filter(None, (beside, hint)))
        if result.method in _OF_RUNS:
            found = _with_open_ends(found, sensor, bool(beside))
        if not why:
            return found
        status, advice = doubted(found.status, found.advice, why)
        return replace(found, status=status, advice=advice, confidence=None)

    return replace(result, objects=tuple(map(judged, result.objects)))


def doubt_scale(
    results: Sequence[Reconstruction], scans: Sequence[Scan], sensor: Sensor
) -> list[Reconstruction]:
    """Return the results of a whole file, doubted where all scans together are of another scale (`scale_hint`)."""
    outlines = [o.vertices for result in results for o in result.objects]
    hint = scale_hint(scans, outlines, sensor)
    if not hint:
        return list(results)

    def judged(found: RecoveredObject) -> RecoveredObject:
        told = SCALE in found.advice
        status, advice = doubted(found.status, found.advice, "" if told else hint)
        return replace(found, status=status, advice=advice, confidence=None)

    return [replace(result, objects=tuple(map(judged, result.objects))) for result in results]


def doubt_strips(
    results: Sequence[Reconstruction], strips: Sequence[int], hint: str, sensor: Sensor
) -> list[Reconstruction]:
    """Return the results of a file, those doubted that have to do with any of these strips; `hint` says why.

    That are objects on them, and where they are touched those that end beside them.
    """

    def near(found: RecoveredObject, beyond: int) -> bool:
        on = range(found.strips.start - beyond, found.strips.stop + beyond)
        return bool({i % sensor.strips if sensor.closed else i for i in on} & set(strips))

    def judged(found: RecoveredObject) -> RecoveredObject:
        status, advice = doubted(found.status, found.advice, hint)
        return replace(found, status=status, advice=advice, confidence=None)

    def of_scan(result: Reconstruction) -> Reconstruction:
        if not any(near(found, 0) for found in result.objects):
            return result
        return replace(result, objects=tuple(judged(o) if near(o, 1) else o for o in result.objects))

    return [of_scan(result) for result in results]


def doubted(status: Status, advice: str, hint: str) -> tuple[Status, str]:
    """Return a status, "doubtful" in place of "ok" or "likely", and an advice with a hint that is not in it yet."""
    known = not hint or hint in advice
    doubt: Status = "doubtful" if hint and status in ("ok", "likely") else status
    return doubt, advice if known else "; ".join(filter(None, (advice, hint)))


def scale_hint(scans: Sequence[Scan], outlines: Sequence[FloatArray] | None, sensor: Sensor) -> str:
    """Say that readings are probably of another scale: over Vref where volts were meant, or codes of fewer bits.

    So read, all that touches lies near y = 0 and is as many times flatter. The odds are those of random objects at
    random places; what the border may cut, or is two strips wide, says nothing.

    Parameters
    ----------
    scans, outlines
        One scan or many, and what was found of them, (N, 2) [mm]: where readings alone do not tell l and u. None where
        nobody looked: then one signature, which lies between l and u, tells the place alone.
    sensor
        Its `vref_volt` and `adc_bits` may be wrong.
    """
    most = max(
        (float(np.fmax.reduce(scan[n], initial=0.0)) for scan in scans for n in scan.signatures), default=0.0
    )
    bits = sensor.adc_bits or 0
    scales = {2.0 ** (n - bits): f"codes of {n} bits (write adc_bits = {n})" for n in _BITS if n < bits}
    if sensor.vref_volt >= _LEAST_VOLT:
        scales[1.0 / sensor.vref_volt] = "over Vref, 0 to 1, in place of volts (write vref_volt = 1)"
    scales = {scale: said for scale, said in scales.items() if 0.0 < most <= scale + 1e-9}
    if not scales:
        return ""
    both = sensor.kind.closed_form and sensor.surface is None and all(len(s.signatures) > 1 for s in scans)
    if both:
        read = ((scan, closed_ends(sensor, scan["kh"], scan["kl"])) for scan in scans)
        boxes = [box for scan, (l, u) in read for box in _boxes(scan, sensor, l, u)]
    elif outlines is None:
        ends = [
            [scan[n] * sensor.length_mm for n in (scan.signatures[-1], scan.signatures[0])] for scan in scans
        ]
        boxes = [box for scan, (l, u) in zip(scans, ends, strict=True) for box in _boxes(scan, sensor, l, u)]
    else:
        boxes = [(*o.min(axis=0), *o.max(axis=0)) for o in outlines if len(o)]
    if not (flat := outlines is not None or both):  # a contact that reads as rest on some strips is in pieces
        boxes = [box for box in boxes if box[2] - box[0] > _WIDE * sensor.pitch_mm]
    odds = {scale: _odds(boxes, scale, sensor, flat) for scale in sorted(scales, reverse=True)}
    if max(odds.values()) <= _ODDS:
        return ""
    said = [scales[scale] for scale, of in odds.items() if of > max(odds.values()) - _ODDS]
    return (
        f"no reading is above {most:.2g} of Vref, and {SCALE}: probably the readings are {' or '.join(said)}; else "
        "press elsewhere too"
    )


def _boxes(scan: Scan, sensor: Sensor, l: FloatArray, u: FloatArray) -> list[tuple[float, ...]]:
    """Return the least x and y and the greatest of each run of strips [mm], from its contacts' ends (strips,)."""
    found: list[tuple[float, ...]] = []
    half = 0.5 * sensor.pitch_mm
    for run in scan.runs():
        x = sensor.x_mm[run]
        if np.isfinite(l[run]).any():
            found.append((x[0] - half, float(np.nanmin(l[run])), x[-1] + half, float(np.nanmax(u[run]))))
    return found


def _odds(boxes: Sequence[tuple[float, ...]], scale: float, sensor: Sensor, by_shape: bool) -> float:
    """Return the logarithm of the odds that readings are `scale` times what they should be, `by_shape` or place."""
    length, flat, ends = sensor.length_mm, [] if by_shape else [0.0], [1.0, 0.0]
    for x0, y0, x1, y1 in boxes:
        ends = [min(ends[0], y0 / length), max(ends[1], y1 / length)]
        if by_shape and x1 - x0 > _WIDE * sensor.pitch_mm and y0 > _BORDER * scale * length:
            aspect = math.log(max(y1 - y0, 1e-3 * length) / (x1 - x0))
            flat.append((aspect**2 - (aspect - math.log(scale)) ** 2) / (2.0 * _ASPECT**2))
    if not flat or not boxes:
        return -math.inf
    height = min(ends[1] - ends[0], 0.99)
    place = math.log((1.0 - height) / max(scale - height, 0.25 * scale))  # all over the strips, or only low
    return float(np.median(flat)) + place * min(_apart(boxes), _PLACES)


def _apart(boxes: Sequence[tuple[float, ...]]) -> int:
    """Return how many boxes (x0, y0, x1, y1) lie apart from all counted before: places that were chosen anew."""
    found: list[tuple[float, ...]] = []
    for x0, y0, x1, y1 in boxes:
        if len(found) < _PLACES and all(x1 < a or c < x0 or y1 < b or d < y0 for a, b, c, d in found):
            found.append((x0, y0, x1, y1))
    return len(found)


@dataclass(frozen=True, eq=False)
class _OpenEnd:
    """An end of an object beside strips that are left out: their names, and where it was read last.

    Attributes
    ----------
    names
        Of the strips that are left out, from the object on.
    line_mm
        Centre line of the outermost strip that was read [mm].
    step
        -1 towards smaller x, 1 towards greater x.
    more_mm2
        How much larger a convex object is at most that goes on under them [mm^2].
    """

    names: tuple[str, ...]
    line_mm: float
    step: int
    more_mm2: float


def _open_ends(vertices: FloatArray, strips: slice, sensor: Sensor) -> list[_OpenEnd]:
    """Return the ends beside strips left out, which may be touched; a convex object widens no faster there."""
    unread = left_out_wholly(sensor)
    if not unread.any() or len(vertices) < 3:
        return []
    x, closed = sensor.x_mm, sensor.closed
    polygon, found = shapely.Polygon(vertices).buffer(0.0), []
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
        names = tuple(str(s + sensor.strip_base) for s in beside)
        found.append(_OpenEnd(names, origin, step, float(ahead.sum()) * sensor.pitch_mm))
    return found


def goes_on(vertices: FloatArray, strips: slice, sensor: Sensor) -> str:
    """Say that an object may go on under strips that are left out, if by much: a convex one widens no faster."""
    ends = _open_ends(vertices, strips, sensor)
    more = sum(end.more_mm2 for end in ends)
    if not ends or more <= _MUCH_MORE * shapely.Polygon(vertices).buffer(0.0).area:
        return ""
    return (
        f"strip {_named(ends)} beside it is left out, so nobody knows whether it goes on there, by {more:.0f} mm2 "
        "at most if it is convex: mend the strip, or put the object elsewhere"
    )


def _with_open_ends(found: RecoveredObject, sensor: Sensor, said: bool) -> RecoveredObject:
    """Return an object whose covariance tells that its ends under strips left out are not known, and an advice.

    The fit takes it to end before the next strip, and if that is left out it may end anywhere up to the next one that
    is read: its area grows by anything from 0 to `_OpenEnd.more_mm2`, whose root mean square is added, as a shift in x
    of what lies beyond the outermost strip that was read. No vertex is then guaranteed. `said`: whether the advice says
    so anyway.
    """
    ends = _open_ends(found.vertices, found.strips, sensor)
    if found.covariance is None or not any(end.more_mm2 > 0.0 for end in ends):
        return found
    known = found.deviations
    vertices, covariance, uniform = found.vertices, found.covariance.copy(), set(found.uniform)
    grown = 0.5 * (np.roll(vertices[:, 1], -1) - np.roll(vertices[:, 1], 1))  # of the area with each x [mm]
    for end in ends:
        beyond = end.step * vertices[:, 0]
        moved = beyond >= min(end.step * end.line_mm, float(beyond.max()))
        shift = np.zeros_like(vertices)
        shift[moved, 0] = end.more_mm2 / math.sqrt(3.0) / max(abs(float(grown[moved].sum())), 1e-9)
        covariance += np.outer(shift, shift)
        uniform -= set(np.flatnonzero(shift).tolist())
    opened = replace(found, covariance=covariance, guarantee=None, uniform=tuple(sorted(uniform)))
    more = sum(end.more_mm2 for end in ends)
    if said or known is None or more <= _TOLD * known[0]:
        return opened
    told = (
        f"strip {_named(ends)}, left out, may be touched: there the outline is open, and its area larger by "
        f"{more:.0f} mm2 at most if it is convex, which the deviations count"
    )
    return replace(opened, advice="; ".join(filter(None, (found.advice, told))))


def _named(ends: Sequence[_OpenEnd]) -> str:
    return ", ".join(name for end in ends for name in end.names)


def _chord(polygon: shapely.Geometry, x_mm: float, sensor: Sensor) -> float:
    line = shapely.LineString([(x_mm, -sensor.length_mm), (x_mm, 2.0 * sensor.length_mm)])
    return float(polygon.intersection(line).length)


def implausible_hint(
    scan: Scan, sensor: Sensor, failed: bool, outlines: Sequence[FloatArray] = (), faulty: bool = False
) -> str:
    """Say why readings cannot be meant, nothing where they can.

    `failed`: whether their result is doubted anyway; `outlines` (N, 2) [mm]: what was found of them; `faulty`: whether
    without a channel that makes no contact with the others.
    """
    read = {name: scan[name] for name in scan.signatures}
    hint = exchanged(read) if sensor.kind.closed_form else ""
    if failed and not hint:
        hint = read_twice(read)
    if not (hint or faulty) and any(not math.isnan(k[0]) for k in read.values()) and scan.touched.all():
        hint = rest_hint(sensor, invert_calibration(sensor, read), failed)
    if scan.moved:
        hint = (
            f"the contact moved while {scan.averaged} scans were averaged: half of the channels changed by "
            f"{100.0 * scan.moved:.2g} % of Vref or more; average fewer"
        )
    return hint or scale_hint([scan], outlines, sensor)

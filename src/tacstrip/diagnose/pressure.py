"""A sensor whose readings are of pressure, and not of position."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log

_FADES = 0.6  # of the highest reading: position does not fade so far at a contact's rims, pressure does
_RIMS, _STARTS = 0.25, 0.8  # of the contacts, and of the presses
_FEWEST_CONTACTS, _FEWEST_PRESSES = 20, 4
_WIDE = 4  # strips: of wider contacts the second-highest reading counts
_PRESS = 6  # scans
# Over Vref: the highest reading of a contact that is looked at, and the least of a strip in contact.
_LEAST = 0.03
_CLEARLY = 0.15  # over Vref: what a contact reads at some time
_LEAVES, _LOW = 60, 0.8  # times that contacts come to a strip or leave it; of the highest reading, then
# Of these times at least: the strip's reading is low and that of one so near is high.
_SIDEWAYS, _AWAY = 0.1, 6


def pressure(log: Log) -> Iterator[Finding]:
    """Say so where readings grow from rest to a peak and back, across every contact and during every press.

    A reading of position has a value as soon as there is contact: at its rim, and at a press' start. One sign alone
    is not enough: an arch fades at both rims wherever it lies, and a rolling contact at both ends of its press.
    """
    rest = (log.sensor.rest_volt or 0.0) / log.sensor.vref_volt
    rims, starts = [], []
    for values in log.raw.values():
        away = np.abs(np.where(log.touched, values, np.nan) - rest)
        rims.append(_across(away, log.touched))
        starts.append(_during(away))
    fades, starting = min(rims), min(starts)
    sideways = min(_leaves_low(np.where(log.touched, values, np.nan)) for values in log.raw.values())
    if sideways > _SIDEWAYS:
        evidence = (
            f"contacts that come to a strip or leave it read low there, {100 * sideways:.3g} % of them or more "
            "beside strips that read high: readings grow with pressure, and do not say where the contact lies"
        )
        yield Finding("pressure", (), evidence, {"sideways": sideways})
    elif fades > _RIMS and starting > _STARTS:
        evidence = f"readings fade to rest at both rims of {100 * fades:.3g} % of the contacts"
        evidence += f" and at an end of {100 * starting:.3g} % of the presses"
        evidence += ": they grow with pressure, and do not say where the contact lies along the strips"
        yield Finding("pressure", (), evidence, {"rims": fades, "starts": starting})


def _across(away: FloatArray, touched: BoolArray) -> float:
    """Return the share of contacts three strips wide or more that fade at both rims; -1 where there are too few."""
    padded = np.pad(touched, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    rows, first = np.nonzero(change == 1)
    last = np.nonzero(change == -1)[1] - 1
    inside = np.flatnonzero((last - first >= 2) & (first > 0) & (last < touched.shape[1] - 1))
    inside = inside[:: max(len(inside) // 2000, 1)]
    found = []  # strip of the peak, and whether the rims fade
    for row, a, b in zip(rows[inside], first[inside], last[inside], strict=True):
        part = away[row, a : b + 1]
        if np.isfinite(part).all() and part.max() > _LEAST:
            high = part.max() if len(part) < _WIDE else np.sort(part)[-2]
            found.append((a + int(np.argmax(part)), int(max(part[0], part[-1]) < _FADES * high)))
    if not found:
        return -1.0
    strip, fade = np.array(found).T
    fade = fade[strip != np.bincount(strip).argmax()]  # one strip may be ill
    return float(np.mean(fade)) if len(fade) >= _FEWEST_CONTACTS else -1.0


def _during(away: FloatArray) -> float:
    """Return the share of presses that begin or end below the peak on the strip they press longest; -1 of few."""
    there = np.isfinite(away).any(axis=1)
    change = np.diff(np.pad(there, 1).astype(np.int8))
    fades = []
    for a, b in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1), strict=True):
        part = away[a:b]
        one = part[:, int(np.argmax(np.isfinite(part).sum(axis=0)))]
        one = one[np.isfinite(one)]
        if len(one) >= _PRESS and one.max() > _LEAST:
            fades.append(max(one[0], one[-1]) < 0.8 * one.max())
    return float(np.mean(fades)) if len(fades) >= _FEWEST_PRESSES else -1.0


def _visited(values: FloatArray) -> BoolArray:
    """Return where strips (scans, strips) are touched by contacts that read clearly more than nothing meanwhile.

    A contact at the ground end reads next to nothing, and its noise alone comes and goes.
    """
    there = np.ascontiguousarray((values > _LEAST).T)
    change = np.diff(np.pad(there, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (strip, first), last = np.nonzero(change == 1), np.nonzero(change == -1)[1]
    out = np.zeros_like(there)
    for i, a, b in zip(strip, first, last, strict=True):
        out[i, a:b] = values[a:b, i].max() > _CLEARLY
    return np.asarray(out.T)


def _leaves_low(values: FloatArray) -> float:
    """Return how often a contact reads low on a strip that it comes to or leaves while it reads high beside it.

    A contact that leaves over the end at Vref reads Vref, and one that leaves sideways what it read all along. -1
    where contacts come and go too seldom, or read high then. Readings (scans, strips) are NaN where untouched.
    """
    values = np.nan_to_num(values)
    there = _visited(values)
    change = np.diff(np.pad(there, ((1, 1), (0, 0))).astype(np.int8), axis=0)
    first, last = change[:-1] == 1, change[1:] == -1
    first[0], last[-1] = False, False  # not seen to come or to leave
    scan, strip = np.nonzero(first | last)
    if len(scan) < _LEAVES or len(np.unique(strip)) < 0.5 * values.shape[1]:
        return -1.0
    top, own = float(np.quantile(values[there], 0.98)), values[scan, strip]
    if np.quantile(own, 0.9) > _LOW * top:
        return -1.0
    low = np.zeros((2, len(scan)), dtype=bool)
    for which, side in enumerate((-1, 1)):
        # The second-highest beside: one strip may be ill.
        first, second = own.copy(), own.copy()
        same = np.ones(len(scan), dtype=bool)  # one contact: another finger may lie higher
        for away in range(1, _AWAY + 1):
            at = strip + side * away
            same &= (at >= 0) & (at < values.shape[1])
            same[same] &= there[scan[same], at[same]]
            new = values[scan[same], at[same]]
            second[same] = np.maximum(second[same], np.minimum(first[same], new))
            first[same] = np.maximum(first[same], new)
        low[which] = (second > 0.5 * top) & (own < 0.5 * second)
    # A leg of an object may lie low on one side; pressure fades on both.
    return float(2.0 * low.mean(axis=1).min())

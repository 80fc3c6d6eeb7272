"""A sensor whose readings are of pressure, and not of position."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log

_FADES = 0.6  # of the highest reading: position does not fade so far at a contact's rims, pressure does
_RIMS = 0.25  # of the contacts: of position, 6 % at most fade at both rims
_RIMS_TOO, _STARTS = 0.08, 0.8  # of the contacts, where so many of the presses fade too
_BUMP, _BUMPS = 0.92, 0.7  # rims over the middle, and share of the contacts that ought to have a dip there
_LOW = 0.45  # over Vref: below, a convex contact's k has a dip in the middle, as k_l has anywhere
_FEWEST_CONTACTS, _FEWEST_PRESSES = 20, 4
_WIDE = 4  # strips: of wider contacts the second-highest reading counts
_PRESS = 6  # scans
_LEAST = 0.03  # over Vref: the highest reading of a contact that is looked at


def pressure(log: Log) -> Iterator[Finding]:
    """Say so where readings grow from rest to a peak and back, across every contact and during every press.

    A reading of position has a value as soon as there is contact: at the contact's rim, and at a press' start.
    """
    rest = (log.sensor.rest_volt or 0.0) / log.sensor.vref_volt
    rims, starts, bumps = [], [], []
    for name, values in log.raw.items():
        away = np.abs(np.where(log.touched, values, np.nan) - rest)
        fade, bump = _across(away, log.touched, np.inf if name == "kl" else _LOW)
        rims.append(fade)
        starts.append(_during(away))
        bumps += [bump] if name != "kh" else []
    fades, starting = min(rims), min(starts)
    bumping = min(bumps, default=-1.0)
    if (
        fades > _RIMS
        or (fades > _RIMS_TOO and starting > _STARTS)
        or (fades > _RIMS_TOO and bumping > _BUMPS)
    ):
        evidence = f"readings fade to rest at both rims of {100 * fades:.3g} % of the contacts"
        if starting > 0.0:
            evidence += f" and at an end of {100 * starting:.3g} % of the presses"
        evidence += ": they grow with pressure, and do not say where the contact lies along the strips"
        yield Finding("pressure", (), evidence, {"rims": fades, "starts": starting, "bumps": bumping})


def _across(away: FloatArray, touched: BoolArray, low: float) -> tuple[float, float]:
    """Return the share of contacts three strips wide or more that fade at both rims, and of low ones with a bump.

    -1 where there are too few.
    """
    padded = np.pad(touched, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    rows, first = np.nonzero(change == 1)
    last = np.nonzero(change == -1)[1] - 1
    inside = np.flatnonzero((last - first >= 2) & (first > 0) & (last < touched.shape[1] - 1))
    inside = inside[:: max(len(inside) // 2000, 1)]
    found = []  # strip of the peak, whether the rims fade, and whether there is a bump: -1 where it does not count
    for row, a, b in zip(rows[inside], first[inside], last[inside], strict=True):
        part = away[row, a : b + 1]
        if np.isfinite(part).all() and part.max() > _LEAST:
            rim, middle = max(part[0], part[-1]), float(np.median(part[1:-1]))
            high = part.max() if len(part) < _WIDE else np.sort(part)[-2]
            bump = int(rim < _BUMP * middle) if middle < low else -1
            found.append((a + int(np.argmax(part)), int(rim < _FADES * high), bump))
    if not found:
        return -1.0, -1.0
    strip, fade, bump = np.array(found).T
    others = strip != np.bincount(strip).argmax()  # one strip may be ill
    return _share(fade[others]), _share(bump[others & (bump >= 0)])


def _share(of: IntArray) -> float:
    return float(np.mean(of)) if len(of) >= _FEWEST_CONTACTS else -1.0


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

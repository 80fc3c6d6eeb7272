"""Tracks on strips of some width: rigid outlines are fitted to centre lines, so what the width adds is taken away.

How much that is, is known once the outline and its poses are: so they are found, what the strips' width adds there is
taken from the readings, and they are found again, until this changes no more. On strips that are wide beside the pitch
it may never end; then the outline over time is not to be trusted, and that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.strip_width import remove_width_effect
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.result import Track
from tacstrip.tracking.single_scans import SingleScans

_ROUNDS, _SETTLED = 5, 0.3  # of taking it away, until it changes by less [sigma, root mean square]
_FEWEST = 2  # strips whose centre lines an outline covers
_TAKEN = "strips are {width:g} mm wide: what that adds to the readings was taken away as this outline says"
_NOT_TAKEN = (
    "strips are {width:g} mm wide, and what that adds to the readings could not be told from the shape: read the scans "
    "one by one (`single`)"
)


def tracked_on_wide_strips(
    scans: list[Scan],
    sensor: Sensor,
    noise: Noise | None,
    sigma: float | None,
    track: Callable[[list[Scan], Sensor], list[Track]],
) -> list[Track]:
    """Return the tracks that `track` finds in readings of centre lines, at best "likely".

    Parameters
    ----------
    scans, sensor, noise
        What was read on strips of `strip_width_mm`.
    sigma
        Of a reading over Vref; None: not known, and then a converter's step.
    track
        Finds tracks in scans of a sensor whose strips are lines.
    """
    thin, lines = replace(sensor, strip_width_mm=None), scans
    least = _SETTLED * (sigma or max(sensor.adc_step, 1e-3))
    last = np.inf
    for number in range(_ROUNDS):
        tracks = track(lines, thin)
        before, lines = lines, list(scans)
        changes = [_take_away(one, scans, before, lines, sensor) for one in tracks]
        change = max(changes, default=0.0)
        if change < least or change == np.inf or (number and change >= last):
            break
        last = change
    return [
        _judged(one, change < least, scans, sensor, noise)
        for one, change in zip(tracks, changes, strict=True)
    ]


def _take_away(
    one: Track, scans: Sequence[Scan], before: Sequence[Scan], lines: list[Scan], sensor: Sensor
) -> float:
    """Put what lines under an object would read into `lines`; return by how much that changes, inf where unknown.

    Strips that its outline covers at their sides only read nothing then.
    """
    if sensor.closed or len(one.outline) < 3:
        return np.inf
    x, half, changes = sensor.x_mm, 0.5 * sensor.strip_width, [np.zeros(0)]
    for i in np.flatnonzero(one.present).tolist():
        corners = placed(one.outline, one.poses[i])
        near = (x > corners[:, 0].min() - half) & (x < corners[:, 0].max() + half)
        under = near & scans[i].touched & (x > corners[:, 0].min()) & (x < corners[:, 0].max())
        if i in one.joint or under.sum() < _FEWEST:
            return np.inf
        try:
            outline = Outline.of(corners)
        except ContactError:  # a concave one
            return np.inf
        now = {name: scans[i].reading(name)[under] for name in scans[i].signatures}
        thin = remove_width_effect(sensor, outline, x[under], now)
        kept: dict[str, Any] = {name: np.where(near, np.nan, lines[i].reading(name)) for name in thin}
        for name, k in thin.items():
            kept[name][under] = np.clip(k, 0.0, 1.0)
            changes.append(kept[name][under] - before[i].reading(name)[under])
        lines[i] = replace(lines[i], **kept)
    squares = np.concatenate(changes) ** 2
    return float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else np.inf


def _judged(one: Track, settled: bool, scans: Sequence[Scan], sensor: Sensor, noise: Noise | None) -> Track:
    """Return a track with the strips' width in its status; single scans are read as they were."""
    width = sensor.strip_width
    runs = {i: _run(one, i, scans[i], sensor) for i in np.flatnonzero(one.present).tolist()}
    runs = {i: run for i, run in runs.items() if run.stop}
    alone = SingleScans(scans, runs, sensor, noise)
    if settled and one.status in ("ok", "likely"):
        advice = "; ".join(filter(None, [one.advice, _TAKEN.format(width=width)]))
        return replace(one, status="likely", advice=advice)
    open_ = "" if settled else _NOT_TAKEN.format(width=width)
    advice = "; ".join(filter(None, [one.advice, open_]))
    return replace(
        one, status="doubtful", advice=advice, by_scan=alone if not settled or one.by_scan else None
    )


def _run(one: Track, number: int, scan: Scan, sensor: Sensor) -> slice:
    """Return the strips that an object lies on in a scan."""
    x = placed(one.outline, one.poses[number])[:, 0] if len(one.outline) else sensor.x_mm
    own = np.flatnonzero(
        scan.touched
        & (np.abs(sensor.x_mm - 0.5 * (x.min() + x.max())) <= 0.5 * (np.ptp(x) + sensor.pitch_mm))
    )
    return slice(int(own[0]), int(own[-1]) + 1) if len(own) else slice(0, 0)

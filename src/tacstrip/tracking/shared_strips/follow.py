"""Objects that share strips: who is there, and where, from scans in which each was alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.hull import MOST_OBJECTS
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.shared_strips.joint_fit import Scene
from tacstrip.tracking.shared_strips.known import Alone, Shared
from tacstrip.tracking.shared_strips.minima import (
    against_rivals,
    as_likely,
    as_smooth,
    astray,
    criterion_of,
    explored,
    of_rivals,
    smoother,
    smoother_too,
)
from tacstrip.tracking.shared_strips.rows import Rows, fitted_about, rows_of, unexplained
from tacstrip.tracking.shared_strips.settled import joint, settled, without_unseen
from tacstrip.tracking.shared_strips.summary import told
from tacstrip.tracking.shared_strips.window import of_window

# Scans alone on both sides of a window, and of an object, that are fitted along.
_AROUND, _MOST_ALONE = 20, 60
_GUESSES = 2  # rivals that are followed by where the outlines found explain too little


def follow(
    known: Sequence[Alone],
    readings: Mapping[int, FloatArray],
    touched: BoolArray,
    sensor: Sensor,
    names: tuple[str, ...],
    sigma: float,
    distribution: str,
) -> list[Shared | None] | None:
    """Return for each known object what scans add in which objects share strips.

    Parameters
    ----------
    known
        Objects, at most 8.
    readings
        Of the scans in question (S, n), NaN where nothing touches or what touches is not in question.
    touched
        Strips of all scans (T, n).
    sensor, names, sigma, distribution
        Of the readings.

    Returns
    -------
    list of Shared or None
        None for an object that is in none of these scans; no list where the known objects do not explain them.
    """
    for guess in _guesses(known[:MOST_OBJECTS]):
        rows = rows_of(guess, readings, touched, sensor, names, sigma)
        found = _followed(rows, guess, readings, distribution)
        if found is not None:
            return found
    return None


def _guesses(known: Sequence[Alone]) -> Iterator[Sequence[Alone]]:
    """Yield known objects, then with one of them by the outline of a rival: with a wrong one the scans do not fit."""
    yield known
    others = [(i, k, rival) for k, one in enumerate(known) for i, rival in enumerate(one.rivals)]
    for _, k, rival in sorted(others, key=lambda other: other[:2])[:_GUESSES]:
        own = known[k]
        rest = ((own.corners, own.poses), *(o for o in own.rivals if o is not rival))
        yield [*known[:k], replace(own, corners=rival[0], poses=rival[1], rivals=rest), *known[k + 1 :]]


def _followed(
    rows: Rows, known: Sequence[Alone], readings: Mapping[int, FloatArray], distribution: str
) -> list[Shared | None] | None:
    """Return for each known object what its rows add; None where the objects do not explain them."""
    open_rows = unexplained(rows, known, readings)
    windows = [
        w for w in np.split(open_rows, np.flatnonzero(np.diff(rows.numbers[open_rows]) > 1) + 1) if len(w)
    ]
    if not windows:
        return None
    alike = list[tuple[IntArray, Scene]]()
    for window in windows:
        found = of_window(rows, window, _MOST_ALONE if len(windows) == 1 else _AROUND)
        if found is None:
            return None
        scene, chosen, others = found
        rows.poses[chosen] = np.where(scene.present[..., None], scene.poses, np.nan)
        rows.outlines = scene.outlines
        alike += others
    there: BoolArray = np.isfinite(rows.poses[..., 0])
    part = np.asarray(there[np.concatenate(windows)].any(axis=0))
    if len(windows) > 1:
        chosen = fitted_about(rows, np.concatenate(windows), part, _MOST_ALONE)
        scene = settled(rows.of(chosen), joint(rows, chosen))
    some, both = rows.of(chosen), np.asarray(~rows.alone[chosen].any(axis=1))
    scene = smoother(some, without_unseen(some, scene, both))
    rivals, alike = as_smooth(some, chosen, scene, alike, both)
    scene, *rivals = sorted([scene, *rivals], key=lambda s: criterion_of(some, s))
    for k in np.flatnonzero(part):
        scene, *more = against_rivals(some, scene, int(k))
        rivals += more
    scene, *more = explored(some, scene, part)
    scene, rivals = smoother_too(some, scene, [*rivals, *more])
    scene, *more = astray(some, scene, part)
    rivals += more
    outlines = of_rivals(some, scene, rivals)
    alike += [(chosen, s) for s in as_likely(some, scene, rivals)]
    return told(rows, chosen, scene, part, alike, outlines, distribution)

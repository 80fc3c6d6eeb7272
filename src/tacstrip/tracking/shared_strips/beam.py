"""Where known objects may lie from scan to scan while they share strips: several hypotheses at a time.

From a scan in which it is known who lies where, on and on: poses go on as they went and are fitted to what all read
together. Where that fails, an object may have come or gone, and one that came may lie anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.hull import MOST_OBJECTS, HullScans, fit_hull_poses
from tacstrip.core.rigid import loss
from tacstrip.reconstruction.contact_ends import closed_ends

_WIDTH, _AT_FIRST, _FIRST = 8, 24, 5  # hypotheses kept, and in so many scans after something came
_STEP = np.array([0.013, 0.013, 0.03])  # of the size, and [rad]: how far poses are off from where they went
SAME = np.array([0.02, 0.02, 0.05])  # of the size, and [rad]: hypotheses that are one
_SOFT, _COARSE, _ROUGH = 0.005, 0.01, 0.033  # tolerances of edges over the size, ever less is known
_EVENT = 25.0  # of chi square: what it must gain that an object comes or goes
_BAD, _SPREAD = 6.0, 5.0  # chi square of a scan beyond its readings, and times its deviation
_ANGLES, _PLACES = 24, 8  # at which an object that comes is tried, places across the strips at most
_BRANCHED = 3  # hypotheses that an object may come to or go from
_CAUCHY = 6.0
_BACK = 3  # scans that a velocity is of
_JIGGLES = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.04, 0, 0.1),
        (-0.04, 0, -0.1),
        (0, 0.04, -0.1),
        (0, -0.04, 0.1),
        (0, 0, 0.25),
        (0, 0, -0.25),
    ]
)


@dataclass(frozen=True, eq=False)
class Way:
    """One hypothesis.

    Attributes
    ----------
    poses
        Of all objects, scan by scan (K, 3); NaN where one is absent.
    cost
        Of all scans so far.
    since
        Scans since something came or went.
    before
        The cost without the last scan.
    """

    poses: tuple[FloatArray, ...]
    cost: float = 0.0
    since: int = 99
    before: float = 0.0

    @cached_property
    def present(self) -> tuple[int, ...]:
        """Numbers of the objects that are there now."""
        return tuple(int(i) for i in np.flatnonzero(np.isfinite(self.poses[-1][:, 0])))

    @cached_property
    def expected(self) -> FloatArray:
        """Where they will be in the next scan (K, 3)."""
        last = found = self.poses[-1]
        for back in range(1, min(_BACK, len(self.poses) - 1) + 1):
            moved = (last - self.poses[-1 - back]) / back
            found = np.where(np.isfinite(moved), last + moved, found)
        return found


def ways(
    scans: HullScans, outlines: Sequence[FloatArray], start: Sequence[FloatArray], order: Iterable[int]
) -> list[Way]:
    """Return hypotheses, the best first, from known poses before on over scans in an order.

    Parameters
    ----------
    scans
        Readings of all objects together.
    outlines
        Of all objects (N_k, 2) [mm].
    start
        Poses (K, 3) in the last scans before, ending with the one next to the first of the order.
    order
        Numbers of the scans.
    """
    sizes = np.array([float(np.ptp(o, axis=0).max()) for o in outlines])
    going = [Way(tuple(start))]
    for number in order:
        one = scans.of([number])
        going = _pruned(_continued(one, outlines, sizes, going), sizes)
    return going


def _continued(
    scan: HullScans, outlines: Sequence[FloatArray], sizes: FloatArray, going: list[Way]
) -> list[Way]:
    """Return what all hypotheses become in the next scan."""
    readings = float(scan.scans.readings[0])
    most = readings + _SPREAD * np.sqrt(readings) + _BAD
    found = [_fitted(scan, outlines, sizes, w, w.expected) for w in going if w.present]
    if found and min(f.cost - f.before for f in found) <= most:
        return found
    for way in sorted(going, key=lambda w: w.cost)[:_BRANCHED]:
        if len(there := way.present):
            found += _jiggled(scan, outlines, sizes, way)
        for k in there if len(there) > 1 else ():
            expected = way.expected.copy()
            expected[k] = np.nan
            found.append(
                _fitted(scan, outlines, sizes, replace(way, cost=way.cost + _EVENT, since=0), expected)
            )
        newest = [way]
        for _ in range(MOST_OBJECTS):  # several may come at once
            newest = [
                come
                for w in newest
                for k in range(len(outlines))
                if k not in w.present
                for come in _come(scan, outlines, sizes, way, w, k)
            ]
            found += newest
            newest = sorted(newest, key=lambda w: w.cost)[:_BRANCHED]
            if not newest or newest[0].cost - newest[0].before <= most + _EVENT:
                break
    return found


def _fitted(
    scan: HullScans, outlines: Sequence[FloatArray], sizes: FloatArray, way: Way, expected: FloatArray
) -> Way:
    return _tried(scan, outlines, sizes, way, expected, expected[None], _CAUCHY, _SOFT, 1.0)[0]


def _jiggled(scan: HullScans, outlines: Sequence[FloatArray], sizes: FloatArray, way: Way) -> list[Way]:
    """Return a hypothesis that went on less smoothly."""
    scale = np.stack([sizes, sizes, np.ones(len(sizes))], axis=1)
    starts = [way.expected]
    for k in way.present:
        for jiggle in _JIGGLES[1:]:
            other = way.expected.copy()
            other[k] += jiggle * scale[k]
            starts.append(other)
    tried = _tried(scan, outlines, sizes, way, way.expected, np.stack(starts), _CAUCHY, _SOFT, 4.0)
    return sorted(tried, key=lambda w: w.cost)[:_BRANCHED]


def _tried(
    scan: HullScans,
    outlines: Sequence[FloatArray],
    sizes: FloatArray,
    way: Way,
    expected: FloatArray,
    starts: FloatArray,
    cauchy: float,
    tolerance: float,
    loose: float,
) -> list[Way]:
    """Return the hypotheses where descents from starts (M, K, 3) end."""
    on = np.flatnonzero(np.isfinite(expected[:, 0]))
    scale = _STEP * np.stack([sizes[on], sizes[on], np.ones(len(on))], axis=1) * loose
    if way.since < _FIRST:
        scale = 2.0 * scale
    poses, costs = fit_hull_poses(
        scan, [outlines[int(k)] for k in on], starts[None][:, :, on], expected[on], 1.0 / scale**2,
        loss(scan.scans, tolerance * float(sizes[on].max()), cauchy), 10,
    )  # fmt: skip
    found = []
    for pose, cost in zip(poses[0], costs[0], strict=True):
        every = np.full(expected.shape, np.nan)
        every[on] = pose
        found.append(Way((*way.poses, every), way.cost + float(cost), way.since + 1, way.cost))
    return found


def _come(
    scan: HullScans, outlines: Sequence[FloatArray], sizes: FloatArray, before: Way, way: Way, k: int
) -> list[Way]:
    """Return hypotheses of an object that came, after others that came in the same scan: anywhere that is touched.

    `before` is how it was before this scan, `way` the same or what others made of it that came in this scan too.
    """
    on = np.array(sorted((*way.present, k)))
    starts = _places(scan, outlines[k])
    others = before.expected if way is before else way.poses[-1]
    expected = np.where(on[:, None] == k, 0.0, others[on])
    scale = _STEP * np.stack([sizes[on], sizes[on], np.ones(len(on))], axis=1)
    weight = np.where(on[:, None] == k, 0.0, 1.0 / scale**2)
    poses = np.broadcast_to(expected, (len(starts), *expected.shape)).copy()
    poses[:, on == k] = starts[:, None]
    some, size = [outlines[int(i)] for i in on], float(sizes[on].max())
    rough = loss(scan.scans, _ROUGH * size, 3.0, 0.15)
    fits, costs = fit_hull_poses(scan, some, poses[None], expected, weight, rough, 6)
    best = np.argsort(costs[0], kind="stable")[: len(starts) // 3]
    fits, costs = fit_hull_poses(
        scan, some, fits[:, best], expected, weight, loss(scan.scans, _COARSE * size, 4.0), 10
    )
    fits, costs = fit_hull_poses(
        scan, some, fits, expected, weight, loss(scan.scans, _SOFT * size, _CAUCHY), 6
    )
    found = []
    for i in np.argsort(costs[0], kind="stable"):
        every = np.full(others.shape, np.nan)
        every[on] = fits[0, i]
        events = _EVENT * (len(on) - len(before.present))
        found.append(Way((*before.poses, every), before.cost + float(costs[0, i]) + events, 0, before.cost))
    return _pruned(found, sizes)


def _places(scan: HullScans, outline: FloatArray) -> FloatArray:
    """Return poses (M, 3) all round of an outline over the strips that are touched, at their highest and lowest."""
    sensor, k = scan.scans.sensor, scan.scans.k[0]
    touched = np.flatnonzero(np.isfinite(k).any(axis=0))
    x = scan.scans.x_mm[touched]
    if len(k) == 2:
        l, u = (np.nan_to_num(e[touched]) for e in closed_ends(sensor, k[0], k[1]))
        low, high = float(l.min()), float(u.max())
    else:
        middle = np.nan_to_num(k[0, touched]) * sensor.length_mm
        low, high = float(middle.min()), float(middle.max())
    found = []
    for angle in np.arange(_ANGLES) * (2.0 * np.pi / _ANGLES):
        cos, sin = np.cos(angle), np.sin(angle)
        turned = outline @ np.array([[cos, sin], [-sin, cos]])
        (x0, y0), (x1, y1) = turned.min(axis=0), turned.max(axis=0)
        first, last = x[0] - 0.5 * sensor.pitch_mm - x0, x[-1] + 0.5 * sensor.pitch_mm - x1
        places = int(np.clip(np.ceil(abs(last - first) / (0.35 * (x1 - x0))) + 1, 2, _PLACES))
        levels = (high - y1, low - y0) if len(k) == 2 else (low - 0.5 * (y0 + y1), high - 0.5 * (y0 + y1))
        found += [(at, y, angle) for at in np.linspace(first, last, places) for y in levels]
    return np.array(found)


def _pruned(found: list[Way], sizes: FloatArray) -> list[Way]:
    """Return the best hypotheses that differ."""
    same = SAME * np.stack([sizes, sizes, np.ones(len(sizes))], axis=1)
    order = sorted(found, key=lambda w: w.cost)
    last, kept = np.stack([w.poses[-1] for w in order]) / same, list[int]()
    for i, way in enumerate(order):
        alike = [j for j in kept if order[j].present == way.present]
        if not alike or (np.nanmax(np.abs(last[i] - last[alike]), axis=(1, 2)) > 1.0).all():
            kept.append(i)
        if len(kept) >= (_AT_FIRST if way.since < _FIRST else _WIDTH):
            break
    return [order[i] for i in kept]

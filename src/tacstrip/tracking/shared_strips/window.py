"""A run of scans in which objects share strips: ways through it by beam search, and the joint fit of the best."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.tracking.shared_strips.beam import SAME, Way, ways
from tacstrip.tracking.shared_strips.joint_fit import Scene
from tacstrip.tracking.shared_strips.minima import ALIKE, against_rivals
from tacstrip.tracking.shared_strips.rows import Rows, fitted_about, with_poses
from tacstrip.tracking.shared_strips.settled import joint, not_explained, settled

_BEFORE = 4  # scans before a window that its beam begins with
_CANDIDATES = 3  # of each direction that are fitted
# Of chi square: that something came or went, and most for a jump into what follows.
_EVENT, _FAR = 25.0, 100.0
_WORST = 0.05  # of the scans that may stay unexplained
# Candidates, best of each direction; where they leave so many of the scans none will do.
_FIRST, _HOPELESS = 2, 0.5


def of_window(
    rows: Rows, window: IntArray, most: int
) -> tuple[Scene, IntArray, list[tuple[IntArray, Scene]]] | None:
    """Return the best scene about a window, its rows, and others that explain the window as well, with theirs."""
    fits: list[tuple[Scene, float, IntArray]] = []
    for tried, (poses, events) in enumerate(_candidates(rows, window)):
        if any(_same_way(poses, scene, np.searchsorted(own, window), rows.sizes) for scene, _, own in fits):
            continue
        if tried >= _FIRST and all(
            len(not_explained(rows.of(own).hull, scene)) > _HOPELESS * len(window) for scene, _, own in fits
        ):
            return None
        trial = with_poses(rows, window, poses)
        part = np.asarray(np.isfinite(poses[..., 0]).any(axis=0))
        chosen = fitted_about(trial, window, part, most)
        scene = joint(trial, chosen)
        fits.append((scene, scene.cost + events, chosen))
    if not fits:
        return None
    fits.sort(key=lambda fit: fit[1])
    (best, cost, chosen), some = fits[0], rows.of(fits[0][2])
    others = [(own, scene) for scene, worse, own in fits[1:] if worse - cost < ALIKE]
    allowed = _WORST * len(window) + 1
    best = settled(some, best)
    for k in range(len(rows.rivals)):  # what scans alone leave open, all scans may decide
        if len(not_explained(some.hull, best)) > allowed and best.present[:, k].any():
            best = against_rivals(some, best, k)[0]
    return (best, chosen, others) if len(not_explained(some.hull, best)) <= allowed else None


def _same_way(poses: FloatArray, scene: Scene, at: IntArray, sizes: FloatArray) -> bool:
    """Whether poses (W, K, 3) are where a scene that was fitted has them in its rows `at` (W,)."""
    there = np.isfinite(poses[..., 0])
    if (there != scene.present[at]).any():
        return False
    off = poses - scene.poses[at]
    off[..., 2] = (off[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return bool((np.abs(off) <= SAME * np.stack([sizes, sizes, np.ones(len(sizes))], axis=1))[there].all())


def _candidates(rows: Rows, window: IntArray) -> list[tuple[FloatArray, float]]:
    """Return poses (W, K, 3) in a window that may be, and what they cost because something comes or goes.

    The best of each direction come first.
    """
    first, last = int(window[0]), int(window[-1])
    follows = rows.follows
    found: list[list[tuple[FloatArray, float]]] = []
    for sign, edge in ((-1, first), (1, last)):
        start: list[FloatArray] = []
        row = edge + sign
        while 0 <= row < len(follows) and len(start) < _BEFORE and follows[row + (sign < 0)]:
            start.insert(0, rows.poses[row])
            row += sign
        empty = not start
        if empty:
            start = [np.full(rows.poses.shape[1:], np.nan)]
        order = window if sign < 0 else window[::-1]
        if empty and sign > 0:
            continue  # nothing is known behind it, and from in front it was tried
        ended = ways(rows.hull, rows.outlines, start, order)
        scored = sorted(
            ((w.cost + _jump(rows, w, last + 1 if sign < 0 else first - 1, follows), w) for w in ended),
            key=lambda p: p[0],
        )
        own = [np.stack(way.poses[len(start) :])[::-sign] for _, way in scored[:_CANDIDATES]]
        found.append([(poses, _EVENT * _events(rows, window, poses)) for poses in own])
    return [one for alike in zip_longest(*found) for one in alike if one is not None]


def _jump(rows: Rows, way: Way, after: int, follows: BoolArray) -> float:
    """Return what it costs that a hypothesis goes on as the row after it is known."""
    if not 0 <= after < len(rows.numbers):
        return 0.0
    pose, cost = rows.poses[after], 0.0
    scale = 0.05 * np.stack([rows.sizes, rows.sizes, np.ones(len(rows.sizes))], axis=1)
    for k in range(len(pose)):
        now, then = np.isfinite(pose[k, 0]), k in way.present
        if now != then:
            cost += _EVENT
        elif now:
            off = way.expected[k] - pose[k]
            off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi
            cost += min(float(((off / scale[k]) ** 2).sum()), _FAR)
    return cost


def _events(rows: Rows, window: IntArray, poses: FloatArray) -> int:
    """Return how often something comes or goes."""
    every = rows.poses.copy()
    every[window] = poses
    a, b = max(int(window[0]) - 1, 0), min(int(window[-1]) + 2, len(every))
    there = np.isfinite(every[a:b, :, 0])
    return int((there[1:] != there[:-1]).sum())

"""Stretches at the ends of one contact that a rigid outline explains, where none explains all of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.found import Found
from tacstrip.tracking.rigid.search import LEAST_STRIPS, rigid_stretch
from tacstrip.tracking.rigid.starts import Starts

FEWEST = 5  # scans of a stretch
# Sigmas that a strip counts at most; times the usual change, and sigmas more, that is a jump.
_MOST, _JUMP = 50.0, 3.0
_JUMPS, _PARTS = 3, (2, 3, 4, 6)  # jumps that are tried, and parts of all scans
# Sigmas of one reading, and strips side by side, that change from scan to scan.
_SUDDEN, _NEW = 6.0, LEAST_STRIPS


def lone_ends(
    scans: RigidScans, distribution: str, ends: tuple[bool, ...] = (False, True), *, both: bool = False
) -> list[tuple[range, Found]]:
    """Return the scans at the beginning (False) and at the end that one rigid outline each explains, and these.

    `both`: one end without the other is of no use. None are searched for where nothing comes or goes.
    """
    changes = _sudden_changes(scans)
    if not len(changes):
        return []
    total, jumps = len(scans.k), _jumps(scans)
    every = [_End(scans, distribution, last) for last in ends]

    def room(end: _End) -> int:  # no scan shows each of two by itself
        return total - sum(other.found for other in every if other is not end)

    def planned(end: _End) -> list[int]:
        # What explains a stretch explains its parts, and up to the first sudden change all scans show one object. But
        # not all that is put down changes readings suddenly, and of few scans the search may fail: then the jumps.
        most = room(end)
        cuts = sorted({n for j in jumps if FEWEST <= (n := end.length(j)) <= most}, reverse=True)
        end.cuts = [n for n in cuts if n < total]
        end.parts = [n for p in _PARTS if FEWEST <= (n := total // p) <= most and n not in cuts]
        lengths = [*end.cuts, *end.parts]
        if not lengths:
            return []
        first = end.length(int(changes[-1 if end.last else 0]))
        shortest = max(min(lengths), min(first, max(lengths)))
        return [shortest, *(n for n in end.cuts[::-1] if n != shortest and 2 * n > shortest)]

    if both and not all(any(end.begun(n).promising for n in planned(end)) for end in every):
        return []
    for end in every:
        end.tried = planned(end)
        end.searched(end.tried, 1)
        if both and not end.found and (not end.tried or end.begun(end.tried[0]).hopeless):
            return []
    failed = [end for end in every if not end.found]
    if both and failed and (len(failed) > 1 or len(changes) == 1):
        return []  # hardly ever does the search fail for both, and what takes turns at one change shares no scan
    for end in failed:
        if not end.searched([n for n in end.tried[:1] if n <= room(end)], 2) and both:
            return []
    for end in every:
        if end.found:
            shorter = end.tried[: end.tried.index(end.found)]
            end.searched(
                [n for n in (*end.cuts, *end.parts) if end.found < n <= room(end) and n not in shorter]
            )
        if end.found and end.found not in end.cuts:
            # a jump says where a stretch ends: a search may have failed that stays short of it
            end.searched([n for n in end.cuts[::-1] if end.found < n <= room(end)], 1)
    return [end.best for end in every if end.best is not None]


@dataclass(eq=False)
class _End:
    """Stretches at the beginning of all scans, or at their end, and the one that was found.

    Attributes
    ----------
    cuts, parts
        Lengths up to jumps, and parts of all scans.
    tried
        Those which must be explained for any other to be.
    """

    scans: RigidScans
    distribution: str
    last: bool
    best: tuple[range, Found] | None = None
    cuts: list[int] = field(default_factory=list)
    parts: list[int] = field(default_factory=list)
    tried: list[int] = field(default_factory=list)
    starts: dict[int, Starts] = field(default_factory=dict)

    @property
    def found(self) -> int:
        """How many scans it has."""
        return 0 if self.best is None else len(self.best[0])

    def length(self, scan: int) -> int:
        """Return how many scans there are up to one, or from it on."""
        return len(self.scans.k) - scan if self.last else scan

    def searched(self, lengths: list[int], effort: int = 0) -> bool:
        """Whether a rigid outline explains one of some lengths: the first such becomes the best."""
        for length in lengths:
            one = rigid_stretch(self.begun(length), self.distribution, effort)
            if one is not None:
                self.best = self.scans_of(length), one
                return True
        return False

    def scans_of(self, length: int) -> range:
        """Return the scans of so long a stretch."""
        total = len(self.scans.k)
        return range(total - length, total) if self.last else range(length)

    def begun(self, length: int) -> Starts:
        """Return what a search of so long a stretch begins with."""
        if length not in self.starts:
            self.starts[length] = Starts(self.scans.of(np.array(self.scans_of(length))))
        return self.starts[length]


def _sudden_changes(scans: RigidScans) -> IntArray:
    """Return the scans in which something may be put down beside an object, or lifted; all, where it moves erratically.

    A strip that another object begins to cover jumps by their distance and its width, or new strips are touched, while
    the readings of one that deforms or moves on change as in the scans before and after. A strip is no evidence beside
    scans in which it is not touched: where an edge nearly along it comes over it, it is read from end to end at once.
    """
    if Starts(scans).erratic:
        return np.arange(1, len(scans.k))
    change = np.nan_to_num(np.abs(np.diff(scans.k, axis=0)) / scans.sigma, nan=np.inf)
    beside = np.zeros_like(change)
    beside[1:] = change[:-1]
    beside[:-1] = np.maximum(beside[:-1], change[1:])
    change[np.isinf(change)] = 0.0
    touched = np.asarray(np.isfinite(scans.k).any(axis=1))
    new: IntArray = np.cumsum(touched[1:] != touched[:-1], axis=1)
    many = new[:, _NEW - 1 :] - np.pad(new, ((0, 0), (1, 0)))[:, :-_NEW]
    jumps = (change > _SUDDEN + 2.0 * beside).any(axis=(1, 2))
    return np.flatnonzero(jumps | (many == _NEW).any(axis=1)) + 1


def _jumps(scans: RigidScans) -> list[int]:
    """Return the scans in which much more changes than usual, the largest changes first."""
    now, before = scans.k[1:], scans.k[:-1]
    change = np.abs(now - before) / scans.sigma
    either = np.isfinite(now) | np.isfinite(before)
    change = np.where(np.isfinite(change), np.minimum(change, _MOST), np.where(either, _MOST, 0.0))
    size: FloatArray = change.sum(axis=(1, 2)) / np.maximum(either.sum(axis=(1, 2)), 1)
    large = np.flatnonzero(size > _JUMP * np.median(size) + _JUMP)
    return [int(i) + 1 for i in large[np.argsort(-size[large], kind="stable")][:_JUMPS]]

"""Follow objects from scan to scan: each keeps its number, and the fit begins where the last one ended.

A search for corners takes 3 ms, following one 0.2. A search is made where an object appears, where the followed outline
no longer explains the readings, and now and then, for a corner that is no longer needed shows in nothing else. All but
the first kind can be made beside the stream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.reconstruction.methods import chosen_method, reconstruct
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.update import Followed, Lost, follow, started

SEARCH_EVERY_S = 0.5
SOONEST_S = 0.05  # after a search that did not help; twice as long each time, up to `SEARCH_EVERY_S`
SEARCHED_AGAIN = "the outline no longer explains the readings; it is being searched anew"


@dataclass(frozen=True, eq=False)
class LiveObject:
    """An object with the number that it keeps while it stays on the sensor, from 1."""

    id: int
    shape: RecoveredObject


@dataclass
class _Track:
    id: int
    shape: RecoveredObject
    runs: int  # of touched strips; above 1 where strips inside are silent
    followed: Followed | None


class Tracker:
    """Recovers the objects of scans that come one after the other.

    Parameters
    ----------
    sensor
        What the scans are of.
    method
        "polygon", "vertex" or "profile"; None: the best for the sensor. Polygons are followed, the others are made
        anew from each scan and only keep their numbers.
    noise
        Of the readings; None: taken from what the fits leave over.
    beside
        Where searches are made that need not be waited for; None: at once, in `update`.

    Attributes
    ----------
    searches
        How many there were.

    Raises
    ------
    OptionError, SignatureError
        With the first scan: there is no such method, or it is not for this sensor.
    """

    @takes(sensor=Sensor, noise=Noise)
    def __init__(
        self,
        sensor: Sensor,
        method: str | None = None,
        noise: Noise | None = None,
        beside: Executor | None = None,
    ) -> None:
        self.sensor, self.noise = sensor, noise
        self.method = chosen_method(method, sensor)
        self.searches = 0
        self._beside = beside
        self._pending: Future[list[_Track]] | None = None
        self._tracks: list[_Track] = []
        self._ids = 0
        self._searched_s = -math.inf
        self._wait_s = SOONEST_S

    def update(self, scan: Scan, detail: bool = False) -> tuple[LiveObject, ...]:
        """Return the objects of the next scan, left to right; with `detail` followed ones have a covariance too."""
        if self.method != "polygon":
            self._number(
                _tracks(reconstruct(scan, self.sensor, self.noise, method=self.method).objects, scan)
            )
            return self._objects()
        runs = scan.runs()
        if self._pending is not None and self._pending.done():
            found, self._pending = self._pending.result(), None
            if _spans(found, runs) is not None:
                self._number(found)
        if not self._follow(scan, runs, detail):
            self._pending = None  # older than what is found now
            self._count_search(scan)
            self._number(self._search(scan))
        return self._objects()

    def _objects(self) -> tuple[LiveObject, ...]:
        return tuple(LiveObject(t.id, t.shape) for t in self._tracks)

    def _follow(self, scan: Scan, runs: Sequence[slice], detail: bool) -> bool:
        """Follow every object; False where a search must be made at once."""
        spans = _spans(self._tracks, runs)
        if spans is None:
            return False
        since = scan.time_s - self._searched_s
        due = bool(self._tracks) and not 0.0 <= since < SEARCH_EVERY_S
        for track, span in zip(self._tracks, spans, strict=True):
            explained = False
            if track.followed is not None:
                try:
                    track.followed, explained = follow(track.followed, scan, self.sensor, span, detail)
                except Lost:
                    return False
                track.shape = track.followed.shape
            if not explained:
                due |= since >= self._wait_s
                if track.followed is not None:
                    track.shape = replace(track.shape, status="doubtful", advice=SEARCHED_AGAIN)
        if not due:
            return True
        if self._beside is None:
            return False
        if self._pending is None:
            self._count_search(scan)
            self._pending = self._beside.submit(self._search, scan)
        return True

    def _count_search(self, scan: Scan) -> None:
        """Note when a search is made: after one that came soon, the next may come later."""
        self.searches += 1
        soon = 0.0 <= scan.time_s - self._searched_s < 2.0 * self._wait_s
        self._wait_s = min(2.0 * self._wait_s, SEARCH_EVERY_S) if soon else SOONEST_S
        self._searched_s = scan.time_s

    def _search(self, scan: Scan) -> list[_Track]:
        found = _tracks(reconstruct(scan, self.sensor, self.noise, method=self.method).objects, scan)
        for track in found:
            track.followed = started(track.shape, scan, self.sensor)
        return found

    def _number(self, found: list[_Track]) -> None:
        """Take new tracks for the old ones: each gets the number of the one that it overlaps most."""
        old = {t.id: t.shape.strips for t in self._tracks}
        for track in found:
            shared = {i: _overlap(strips, track.shape.strips) for i, strips in old.items()}
            number = max(shared, key=lambda i: shared[i], default=0)
            if not shared.get(number):
                self._ids += 1
                number = self._ids
            old.pop(number, None)
            track.id = number
        self._tracks = found


def _tracks(objects: Sequence[RecoveredObject], scan: Scan) -> list[_Track]:
    """Return objects, not numbered yet, with how many runs of strips each covers."""
    starts = [run.start for run in scan.runs()]
    counts = [sum(o.strips.start <= at < o.strips.stop for at in starts) for o in objects]
    return [_Track(0, o, max(n, 1), None) for o, n in zip(objects, counts, strict=True)]


def _spans(tracks: Sequence[_Track], runs: Sequence[slice]) -> list[slice] | None:
    """Return the strips that each track has now, or None where runs and tracks do not match one to one."""
    spans, left = [], list(runs)
    for track in tracks:
        own, left = left[: track.runs], left[track.runs :]
        if len(own) < track.runs or not _overlap(track.shape.strips, slice(own[0].start, own[-1].stop)):
            return None
        spans.append(slice(own[0].start, own[-1].stop))
    return None if left else spans


def _overlap(a: slice, b: slice) -> int:
    """Return how many strips two spans share; neighbours count as sharing one."""
    return max(0, int(min(a.stop, b.stop) - max(a.start, b.start)) + 1)

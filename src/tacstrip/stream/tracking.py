"""Follow objects from scan to scan: each keeps its number, and the fit begins where the last one ended.

A search for corners takes 2 ms, following one 0.2. A search is made where an object appears, where the followed outline
no longer explains the readings, and now and then, for a corner that is no longer needed shows in nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tacstrip.contact.noise import Noise
from tacstrip.reconstruct.methods import best_method, recover
from tacstrip.reconstruct.result import RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.following import Followed, Lost, follow, started

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

    Raises
    ------
    OptionError, SignatureError
        With the first scan: there is no such method, or it is not for this sensor.
    """

    def __init__(self, sensor: Sensor, method: str | None = None, noise: Noise | None = None) -> None:
        self.sensor, self.noise = sensor, noise
        self.method = method or best_method(sensor)
        self.searches = 0
        self._tracks: list[_Track] = []
        self._ids = 0
        self._searched_s = -float("inf")
        self._wait_s = SOONEST_S

    def update(self, scan: Scan, detail: bool = False) -> tuple[LiveObject, ...]:
        """Return the objects of the next scan, left to right; with `detail` followed ones have a covariance too."""
        if self.method != "polygon":
            self._adopt(recover(scan, self.sensor, self.method, self.noise).objects, scan)
        elif not self._follow(scan, detail):
            self._search(scan)
        return tuple(LiveObject(t.id, t.shape) for t in self._tracks)

    def _follow(self, scan: Scan, detail: bool) -> bool:
        """Follow every object; False where a search is due."""
        spans = self._spans(scan.runs())
        since = scan.time_s - self._searched_s
        if spans is None or (self._tracks and not 0.0 <= since < SEARCH_EVERY_S):
            return False
        for track, span in zip(self._tracks, spans, strict=True):
            if track.followed is None:
                if since >= self._wait_s:
                    return False
                continue
            try:
                track.followed, explained = follow(track.followed, scan, self.sensor, span, detail)
            except Lost:
                return False
            track.shape = track.followed.shape
            if not explained:
                if since >= self._wait_s:
                    self._wait_s = min(2.0 * self._wait_s, SEARCH_EVERY_S)
                    return False
                track.shape = _doubtful(track.shape)
        return True

    def _spans(self, runs: Sequence[slice]) -> list[slice] | None:
        """Return the strips of each track in order, or None where runs and tracks do not match one to one."""
        spans, left = [], list(runs)
        for track in self._tracks:
            own, left = left[: track.runs], left[track.runs :]
            if len(own) < track.runs or not _overlap(track.shape.strips, slice(own[0].start, own[-1].stop)):
                return None
            spans.append(slice(own[0].start, own[-1].stop))
        return None if left else spans

    def _search(self, scan: Scan) -> None:
        self.searches += 1
        since = scan.time_s - self._searched_s
        if not 0.0 <= since < SEARCH_EVERY_S:
            self._wait_s = SOONEST_S
        self._searched_s = scan.time_s
        self._adopt(recover(scan, self.sensor, self.method, self.noise).objects, scan)
        for track in self._tracks:
            track.followed = started(track.shape, scan, self.sensor)

    def _adopt(self, objects: Sequence[RecoveredObject], scan: Scan) -> None:
        """Give new shapes the numbers of the old ones that they overlap most."""
        old = {t.id: t.shape.strips for t in self._tracks}
        runs = scan.runs()
        tracks = []
        for shape in objects:
            shared = {i: _overlap(strips, shape.strips) for i, strips in old.items()}
            number = max(shared, key=lambda i: shared[i], default=0)
            if not shared.get(number):
                self._ids += 1
                number = self._ids
            old.pop(number, None)
            count = sum(shape.strips.start <= r.start < shape.strips.stop for r in runs)
            tracks.append(_Track(number, shape, max(count, 1), None))
        self._tracks = tracks


def _overlap(a: slice, b: slice) -> int:
    """Return how many strips two spans share; neighbours count as sharing one."""
    return max(0, min(a.stop, b.stop) - max(a.start, b.start) + 1)


def _doubtful(shape: RecoveredObject) -> RecoveredObject:
    return RecoveredObject(
        shape.strips, shape.vertices, shape.profile, shape.covariance, "doubtful", SEARCHED_AGAIN
    )

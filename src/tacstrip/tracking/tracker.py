"""Track objects from scan to scan: each keeps its number, and its fit starts from the previous scan's.

A search for vertices takes 3 ms, an update from the previous scan 0.2. A search is made when an object appears, when
the tracked outline no longer explains the readings, and at regular intervals, because nothing else reveals a vertex
that is no longer needed. All but the first kind can run in the background.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.reconstruction.methods import chosen_method, quick_options, reconstruct
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.seam import BRIDGED, unrolled
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.update import TrackLost, TrackState, initialise, update

SEARCH_INTERVAL_S = 0.5
MIN_SEARCH_INTERVAL_S = 0.05  # after a search that did not help; doubles each time, up to `SEARCH_INTERVAL_S`
SEARCHED_AGAIN = "the outline no longer explains the readings; a new search is under way"


@dataclass(frozen=True, eq=False)
class LiveObject:
    """An object with the number that it keeps while it stays on the sensor.

    Attributes
    ----------
    id
        Its number, counted from 1; no number is used twice.
    shape
        The reconstructed object: vertices [mm], profile, status and advice.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.tracking import Tracker
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(25, 35), (60, 22), (78, 56), (45, 76)])
    >>> (one,) = Tracker(sensor).update(ts.simulate(sensor, contact))
    >>> one.id, one.shape.status
    (1, 'ok')
    """

    id: int
    shape: RecoveredObject


@dataclass
class _Track:
    id: int
    shape: RecoveredObject
    runs: int  # of touched strips; above 1 where strips within the object read nothing
    state: TrackState | None


class Tracker:
    """Reconstructs the objects of successive scans of one sensor.

    Parameters
    ----------
    sensor
        The sensor that the scans were made with.
    method
        "polygon", "vertex" or "profile"; None: the best for the sensor. Polygons are updated from scan to scan; the
        other methods reconstruct each scan on its own, and objects only keep their numbers.
    noise
        Noise of the readings; None: estimated from the residuals of the fits.
    executor
        Runs the searches whose result can wait; None: every search runs at once, in `update`.

    Attributes
    ----------
    searches
        Number of searches so far.

    Raises
    ------
    OptionError
        The method does not exist. From the first `update`, also `SignatureError`: it does not suit this sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.tracking import Tracker
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(25, 35), (60, 22), (78, 56), (45, 76)])
    >>> tracker = Tracker(sensor)
    >>> for i in range(3):
    ...     scan = ts.simulate(sensor, contact.moved(0.1 * i, 0.0), ts.Noise(positional=0.002), rng=i, time_s=0.001 * i)
    ...     objects = tracker.update(scan)
    >>> [(one.id, one.shape.status, len(one.shape.vertices)) for one in objects]
    [(1, 'ok', 4)]
    """

    @takes(sensor=Sensor, noise=Noise)
    def __init__(
        self,
        sensor: Sensor,
        method: str | None = None,
        noise: Noise | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.sensor, self.noise = sensor, noise
        self.method = chosen_method(method, sensor)
        self.searches = 0
        self._executor = executor
        self._pending: Future[list[_Track]] | None = None
        self._tracks: list[_Track] = []
        self._ids = 0
        self._searched_s = -math.inf
        self._wait_s = MIN_SEARCH_INTERVAL_S

    def update(self, scan: Scan, detail: bool = False) -> tuple[LiveObject, ...]:
        """Return the objects of the next scan, in the order of their strips.

        Parameters
        ----------
        scan
            The next scan.
        detail
            Compute the covariance of updated polygons too.
        """
        scan = scan.checked(self.sensor)
        if (
            self.method != "polygon" or self.sensor.surface is not None
        ):  # a curved skin's: each scan on its own
            self._assign_ids(_tracks(self._reconstructed(scan), scan))
            return self._numbered()
        runs = self._laid_out(scan)[0].runs()
        if self._pending is not None and self._pending.done():
            found, self._pending = self._pending.result(), None
            if _spans(found, runs) is not None:
                self._assign_ids(found)
        if not self._update_all(scan, runs, detail):
            self._pending = None  # superseded by this search
            self._count_search(scan)
            self._assign_ids(self._search(scan))
        return self._numbered()

    def _numbered(self) -> tuple[LiveObject, ...]:
        return tuple(LiveObject(t.id, t.shape) for t in self._tracks)

    def _update_all(self, scan: Scan, runs: Sequence[slice], detail: bool) -> bool:
        """Update every object from its previous state; return False where a search must be made at once."""
        spans = _spans(self._tracks, runs)
        if spans is None:
            return False
        laid_out, surface = self._laid_out(scan)
        since = scan.time_s - self._searched_s
        due = bool(self._tracks) and not 0.0 <= since < SEARCH_INTERVAL_S
        for track, span in zip(self._tracks, spans, strict=True):
            explained = False
            if track.state is not None:
                try:
                    track.state, explained = update(track.state, laid_out, surface, span, detail)
                except TrackLost:
                    return False
                track.shape = track.state.shape
            if not explained:
                due |= since >= self._wait_s
                if track.state is not None:
                    track.shape = replace(
                        track.shape, status="doubtful", advice=SEARCHED_AGAIN, confidence=None
                    )
        if not due:
            return True
        if self._executor is None:
            return False
        if self._pending is None:
            self._count_search(scan)
            self._pending = self._executor.submit(self._search, scan)
        return True

    def _count_search(self, scan: Scan) -> None:
        """Note the time of a search; frequent searches lengthen the wait before the next."""
        self.searches += 1
        soon = 0.0 <= scan.time_s - self._searched_s < 2.0 * self._wait_s
        self._wait_s = min(2.0 * self._wait_s, SEARCH_INTERVAL_S) if soon else MIN_SEARCH_INTERVAL_S
        self._searched_s = scan.time_s

    def _reconstructed(self, scan: Scan) -> tuple[RecoveredObject, ...]:
        quick = quick_options(self.method)
        return reconstruct(scan, self.sensor, self.noise, method=self.method, **quick).objects

    def _search(self, scan: Scan) -> list[_Track]:
        objects = self._reconstructed(scan)
        across = max((o.strips.stop - self.sensor.strips for o in objects), default=0)
        laid_out, surface = unrolled(scan, self.sensor, turn=max(across, 0))
        found = _tracks(objects, laid_out)
        for track in found:
            track.state = initialise(track.shape, laid_out, surface)
        return found

    def _assign_ids(self, found: list[_Track]) -> None:
        """Replace the tracks by new ones; each takes the number of the old track that it overlaps most."""
        old = {t.id: t.shape.strips for t in self._tracks}
        for track in found:
            shared = {i: self._shared(strips, track.shape.strips) for i, strips in old.items()}
            number = max(shared, key=lambda i: shared[i], default=0)
            if not shared.get(number):
                self._ids += 1
                number = self._ids
            old.pop(number, None)
            track.id = number
        self._tracks = found

    def _laid_out(self, scan: Scan) -> tuple[Scan, Sensor]:
        """Return a scan and its sensor with contacts across a closed tube's seam in one piece."""
        return unrolled(scan, self.sensor, BRIDGED if any(t.runs > 1 for t in self._tracks) else 0)

    def _shared(self, a: slice, b: slice) -> int:
        """Return the overlap of two spans; round a closed tube, at whichever side of the seam they are counted."""
        n = self.sensor.strips
        turns = (-n, 0, n) if self.sensor.closed else (0,)
        return max(_overlap(slice(a.start + t, a.stop + t), b) for t in turns)


def _tracks(objects: Sequence[RecoveredObject], scan: Scan) -> list[_Track]:
    """Return objects as tracks without number, each with its number of runs of touched strips."""
    starts = [run.start for run in scan.runs()]
    counts = [sum(o.strips.start <= at < o.strips.stop for at in starts) for o in objects]
    return [_Track(0, o, max(n, 1), None) for o, n in zip(objects, counts, strict=True)]


def _spans(tracks: Sequence[_Track], runs: Sequence[slice]) -> list[slice] | None:
    """Return the strips of each track in this scan, or None where runs and tracks do not match one to one."""
    spans, left = [], list(runs)
    for track in tracks:
        own, left = left[: track.runs], left[track.runs :]
        if len(own) < track.runs or not _overlap(track.shape.strips, slice(own[0].start, own[-1].stop)):
            return None
        spans.append(slice(own[0].start, own[-1].stop))
    return None if left else spans


def _overlap(a: slice, b: slice) -> int:
    """Return the number of strips that two spans share; adjacent spans count as sharing one."""
    return max(0, int(min(a.stop, b.stop) - max(a.start, b.start)) + 1)

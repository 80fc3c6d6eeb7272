"""Track objects on two layers from scan to scan: each keeps its number, its polygon follows the readings.

To follow takes about a millisecond, a search a second, so searches run in the background; what came meanwhile is
followed from the scan that was searched. The first is a quick one: until the next, "likely" is the best status.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.reconstruction.layered.estimate import fit_layers
from tacstrip.reconstruction.layered.update import SceneState, begin, follow
from tacstrip.reconstruction.methods import chosen_method
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.tracking.tracker import SEARCH_INTERVAL_S, SEARCHED_AGAIN, LiveObject, Tracker

_SEARCHED = "what touches is being searched for"
_REST = 2.0  # times what the last search took, until the next where nothing calls for it
_MOST_SINCE = 12  # scans that are kept while a search runs


class LayeredTracker:
    """Reconstructs the objects of successive scans of a sensor of two layers.

    Parameters
    ----------
    sensor
        The sensor that the scans were made with.
    noise
        Noise of the readings; None: the spec's, else estimated from the readings.
    executor
        Runs the searches, in threads or, better, processes; None: every search runs at once, in `update`.

    Attributes
    ----------
    searches
        Number of searches so far.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.tracking import LayeredTracker
    >>> sensor = ts.Sensor.load("layered-crs-crs")
    >>> contact = ts.Contact.polygon([(20, 20), (45, 25), (30, 50)])
    >>> contact += ts.Contact.polygon([(35, 60), (70, 55), (60, 80)])
    >>> noise = ts.Noise(positional=0.002)
    >>> tracker = LayeredTracker(sensor, noise)
    >>> for i in range(3):
    ...     scan = ts.simulate(sensor, contact.moved(0.1 * i, 0.0), noise, rng=i, time_s=0.01 * i)
    ...     objects = tracker.update(scan)
    >>> [(one.id, one.shape.status, len(one.shape.vertices)) for one in objects], tracker.searches
    ([(1, 'likely', 3), (2, 'likely', 3)], 1)
    """

    @takes(sensor=LayeredSensor, noise=Noise)
    def __init__(
        self, sensor: LayeredSensor, noise: Noise | None = None, executor: Executor | None = None
    ) -> None:
        self.sensor, self.noise = sensor, sensor.noise if noise is None else noise
        self.searches = 0
        self._executor = executor
        self._pending: Future[tuple[Reconstruction, SceneState | None]] | None = None
        self._since: list[Scan] = []  # while a search runs
        self._state: SceneState | None = None
        self._objects: tuple[LiveObject, ...] = ()
        self._ids = 0
        self._searched_s, self._wait_s = -math.inf, SEARCH_INTERVAL_S

    def update(self, scan: Scan, detail: bool = False) -> tuple[LiveObject, ...]:
        """Return the objects of the next scan, left to right.

        Parameters
        ----------
        scan
            The next scan.
        detail
            Compute covariances too.
        """
        scan = scan.checked(self.sensor.unit)
        if not scan.touched.any():
            self._pending, self._state, self._objects = None, None, ()
            return ()
        explained = False
        if self._state is not None:
            self._state, explained = follow(self._state, scan, self.sensor, self.noise, detail)
            shapes = self._state.objects if explained else _doubted(self._state.objects)
            self._objects = tuple(LiveObject(o.id, s) for o, s in zip(self._objects, shapes, strict=True))
        elif not self._objects:
            touched = np.flatnonzero(scan.touched[self.sensor.slices[0]])
            where = slice(int(touched[0]), int(touched[-1]) + 1) if len(touched) else slice(0, 1)
            self._renew((RecoveredObject(where, status="too few strips", advice=_SEARCHED),))
        self._search_on(scan, explained, detail)
        return tuple(sorted(self._objects, key=lambda o: _left(o.shape)))

    def search_by(self, executor: Executor | None) -> None:
        """Search by another executor from now on; a search that is under way is given up."""
        self._executor, self._pending = executor, None

    def _search_on(self, scan: Scan, explained: bool, detail: bool) -> None:
        """Take what a search has found, and begin another one where it is time."""
        if self._pending is not None:
            self._since.append(scan)
            if len(self._since) > _MOST_SINCE:
                del self._since[:-1:2]
            if not self._pending.done():
                return
            (found, state), self._pending = self._pending.result(), None
            self._wait_s = max(SEARCH_INTERVAL_S, _REST * (scan.time_s - self._searched_s))
            self._adopt(found, state, explained, detail)
        elif not explained or not 0.0 <= scan.time_s - self._searched_s < self._wait_s:
            self.searches += 1
            self._searched_s, self._since = scan.time_s, []
            wanted = scan, self.sensor, self.noise, self._state is None
            if self._executor is None:
                self._adopt(*_searched(*wanted), explained, detail)
            else:
                self._pending = self._executor.submit(_searched, *wanted)

    def _adopt(self, found: Reconstruction, state: SceneState | None, explained: bool, detail: bool) -> None:
        """Go on with what a search found, unless only what was followed explains the readings."""
        well = True
        for number, scan in enumerate(self._since):
            if state is not None:
                last = number == len(self._since) - 1
                state, well = follow(state, scan, self.sensor, self.noise, detail and last)
        if explained and (state is None or not well):
            return
        self._state = state
        shapes = found.objects if state is None else state.objects
        self._renew(shapes if well else _doubted(shapes))

    def _renew(self, shapes: tuple[RecoveredObject, ...]) -> None:
        """Replace the objects; each takes the number of the old one that it overlaps most."""
        old = {o.id: _area(o.shape) for o in self._objects}
        numbered = []
        for shape in shapes:
            area = _area(shape)
            shared = {number: area.intersection(other).area for number, other in old.items()}
            number = max(shared, key=lambda i: shared[i], default=0)
            if not shared.get(number) and not (number and old[number].is_empty):
                self._ids += 1
                number = self._ids
            old.pop(number, None)
            numbered.append(LiveObject(number, shape))
        self._objects = tuple(numbered)


def tracker_of(
    sensor: AnySensor,
    method: str | None = None,
    noise: Noise | None = None,
    executor: Executor | None = None,
) -> Tracker | LayeredTracker:
    """Return what tracks the objects on a sensor of one layer or of two; parameters and errors as of `Tracker`."""
    if isinstance(sensor, LayeredSensor):
        chosen_method(method, sensor)
        return LayeredTracker(sensor, noise, executor)
    return Tracker(sensor, method, noise, executor)


def _searched(
    scan: Scan, sensor: LayeredSensor, noise: Noise | None, quick: bool
) -> tuple[Reconstruction, SceneState | None]:
    """Return what a search finds in a scan, and the state to go on from; for another process, too."""
    found = fit_layers(scan, sensor, noise, assessment="fast" if quick else "thorough")
    return found, begin(found, scan, sensor, noise)


def _doubted(shapes: tuple[RecoveredObject, ...]) -> tuple[RecoveredObject, ...]:
    return tuple(replace(s, status="doubtful", advice=SEARCHED_AGAIN, confidence=None) for s in shapes)


def _area(shape: RecoveredObject) -> shapely.Polygon:
    return shapely.Polygon(shape.vertices).buffer(0.0) if shape.found else shapely.Polygon()


def _left(shape: RecoveredObject) -> float:
    return float(shape.vertices[:, 0].min()) if shape.found else 0.0

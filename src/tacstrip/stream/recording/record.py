"""From a source to a recorder: shapes beside the codes, at the pace that is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from tacstrip.reconstruction.methods import reconstruct
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import RawScan, Shape, paced


def with_shapes(scans: Iterable[RawScan], sensor: Sensor, method: str) -> Iterator[RawScan]:
    """Give each scan with the shapes that a method recovers from it, in place of those it had.

    Raises
    ------
    OptionError, SignatureError
        At the first scan: there is no such method, or it is not for this sensor.
    """
    for raw in scans:
        found = reconstruct(decode(raw, sensor), sensor, method=method).objects
        yield replace(raw, shapes=tuple(Shape(o.status, o.vertices) for o in found if o.found))


def record(
    scans: Iterable[RawScan],
    recorder: Recorder,
    speed: float = math.inf,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Record scans until they end or `stop` says so; errors as of `Recorder` and of the source."""
    for raw in paced(scans, speed, stop, recorder.idle):
        recorder.add(raw)

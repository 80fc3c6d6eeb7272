"""Pass scans from a source to a recorder, with reconstructed shapes if wanted, and paced."""

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
    """Yield each scan with the shapes that a method reconstructs from it, in place of its stored ones.

    Raises
    ------
    OptionError, SignatureError
        At the first scan: the method does not exist, or does not suit this sensor.
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
    """Record scans until they end or `stop` returns True.

    Parameters
    ----------
    scans
        A source, or any raw scans.
    recorder
        The recording; the caller closes it.
    speed
        Pace relative to the scans' own times; infinite: as fast as possible.
    stop
        Called before every scan and at least 20 times a second.

    Raises
    ------
    RecordingError, OSError
        As of `Recorder`; and whatever the source raises.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> source = ts.SimulatedSource(sensor, lambda time_s: ts.Contact.polygon([(8, 40), (32, 40), (20, 70)]), scans=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "session.mcap"
    ...     with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
    ...         ts.record(source, recorder)
    >>> recorder.scans
    5
    """
    for raw in paced(scans, speed, stop, recorder.idle):
        recorder.add(raw)

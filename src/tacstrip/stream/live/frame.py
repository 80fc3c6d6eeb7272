"""What the live pipeline hands on: a scan, its readings, the objects found in it."""

from __future__ import annotations

from dataclasses import dataclass

from tacstrip.arrays import touched_strips
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.source import RawScan
from tacstrip.tracking.tracker import LiveObject


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """A scan with what was made of it.

    Attributes
    ----------
    number
        Of the scan since the stream began, from 0.
    raw
        A/D codes, with the time of each strip where it is known.
    sensor, scan
        What it was read with, and the readings.
    objects
        What touches the sensor, left to right; each keeps its number while it stays.
    latency_s
        From the arrival of its last byte to `objects` [s].
    ready_s
        When `objects` were there, by `time.perf_counter` [s].
    """

    number: int
    raw: RawScan
    sensor: Sensor
    scan: Scan
    objects: tuple[LiveObject, ...]
    latency_s: float
    ready_s: float

    def __repr__(self) -> str:
        count = f"{len(self.objects)} object{'' if len(self.objects) == 1 else 's'}"
        strips, late = touched_strips(self.scan.touched), f"{1e3 * self.latency_s:.3g} ms"
        return f"<Frame {self.number} at {self.raw.time_s:.6g} s: {count}, {strips}, after {late}>"

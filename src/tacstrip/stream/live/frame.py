"""A scan of a live stream with its readings and the objects found in it."""

from __future__ import annotations

from dataclasses import dataclass

from tacstrip.arrays import touched_strips
from tacstrip.reconstruction.result import Status, worst_status
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.recording.messages import FRAME, NANO
from tacstrip.stream.source import RawScan
from tacstrip.tracking.live_contact import LiveTrack
from tacstrip.tracking.tracker import LiveObject


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One scan of a live stream, decoded and reconstructed.

    Attributes
    ----------
    number
        Number of the scan since the stream began, counted from 0.
    raw
        A/D codes, with the time of each strip where it is known.
    sensor, scan
        The sensor with its calibration at that time, of two layers a `LayeredSensor`, and the readings over Vref.
    objects
        Objects that touch the sensor, in the order of their strips; each keeps its number while it stays.
    latency_s
        Time from the arrival of the scan's last byte until `objects` were ready [s].
    ready_s
        When `objects` were ready, by `time.perf_counter` [s].
    tracks
        Objects over time, as of this scan: one rigid outline each from all scans so far, in the order of their strips.
        Those of whose scans too few told are not there. None: not known, because the computer was behind, the first
        search for a shape has not ended, or objects are not tracked.
    origin_ns
        Unix time of `raw.time_s` = 0 [ns].
    clock
        Whose clock `raw.time_s` and `time_ns` go by: "device" (its intervals, set by the computer's clock when the
        stream began), "computer" (the device's is faulty), "recording", "file" or "simulation"; "source" where a
        source of your own does not say, by an attribute `clock`.
    device
        Name of the unit that the scan came from; empty where it has none.
    searching
        Number of objects that `tracks` lacks because the search for their first shape has not ended.
    frame_id, unit
        The coordinates' frame, as in recordings (x across the strips, y along them from the grounded end), and the
        unit of all lengths.

    Examples
    --------
    >>> import math
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=20)
    >>> frames = list(ts.live(source=source, speed=math.inf))
    >>> frames[-1].number, len(frames[-1].objects)
    (19, 1)
    >>> frames[-1].clock, frames[-1].frame_id, frames[-1].unit
    ('simulation', 'tacstrip', 'mm')
    """

    number: int
    raw: RawScan
    sensor: Sensor
    scan: Scan
    objects: tuple[LiveObject, ...]
    latency_s: float
    ready_s: float
    tracks: tuple[LiveTrack, ...] | None = None
    origin_ns: int = 0
    clock: str = "source"
    device: str = ""
    frame_id: str = FRAME
    unit: str = "mm"
    searching: int = 0

    @property
    def status(self) -> Status:
        """The worst status of `objects`; "no contact" without any."""
        return worst_status([one.shape for one in self.objects])

    @property
    def time_ns(self) -> int:
        """When the scan began [ns since 1970], by `clock`."""
        return self.origin_ns + round(self.raw.time_s * NANO)

    def __repr__(self) -> str:
        count = f"{len(self.objects)} object{'' if len(self.objects) == 1 else 's'}"
        strips, late = touched_strips(self.scan.touched), f"{1e3 * self.latency_s:.3g} ms"
        return f"<Frame {self.number} at {self.raw.time_s:.6g} s: {count}, {strips}, after {late}>"

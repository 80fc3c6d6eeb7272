"""Sources of raw scans: what a simulation, a recording and a device have in common."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, touched_strips
from tacstrip.geometry.pose import placed
from tacstrip.sensor.spec import Sensor

if TYPE_CHECKING:
    from tacstrip.stream.device.protocol.decoder import Counts

LOGGER = logging.getLogger("tacstrip")  # messages for the user, a line each
CodeArray: TypeAlias = npt.NDArray[np.unsignedinteger[Any]]

_POLL_S = 0.05  # longest sleep before a stop is noticed


@dataclass(frozen=True)
class Shape:
    """A polygon that was stored with a scan.

    Attributes
    ----------
    status
        "ok", "likely" or "doubtful".
    vertices
        Vertices (N, 2) [mm], counter-clockwise.

    Examples
    --------
    >>> import numpy as np
    >>> from tacstrip.stream import Shape
    >>> Shape("ok", np.array([(0.0, 0.0), (20.0, 0.0), (10.0, 30.0)])).vertices.shape
    (3, 2)
    """

    status: str
    vertices: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class TrackedShape:
    """An object over time as of one scan, as it was stored with that.

    Attributes
    ----------
    id
        Its number.
    status
        "ok", "likely" or "doubtful".
    outline
        Corners (N, 2) [mm], in the object's frame; none where no shape is known.
    pose
        x, y [mm] and angle [rad] (3,): a point p of the outline lies at R(angle) p + (x, y) on the sensor. NaN where
        the scan does not tell.
    scans
        How many scans tell of the outline.
    advice
        In words; empty when all is well.
    covariance
        Of `outline.ravel()` (2 N, 2 N) [mm^2]; None where it was not stored with this scan.
    pose_covariance
        Of the pose (3, 3) [mm, mm, rad]; None where it was not stored with this scan.

    Examples
    --------
    >>> import numpy as np
    >>> from tacstrip.stream import TrackedShape
    >>> corners, pose = np.array([(0.0, 0.0), (20.0, 0.0), (10.0, 30.0)]), np.array([50.0, 40.0, 0.1])
    >>> TrackedShape(1, "ok", corners, pose, scans=50).scans
    50
    """

    id: int
    status: str
    outline: FloatArray
    pose: FloatArray
    scans: int = 0
    advice: str = ""
    covariance: FloatArray | None = None
    pose_covariance: FloatArray | None = None

    @property
    def placed(self) -> FloatArray:
        """The corners (N, 2) [mm] on the sensor; NaN where the scan does not tell."""
        return placed(self.outline, self.pose)


@dataclass(frozen=True, eq=False, slots=True)
class RawScan:
    """The A/D codes of one sampling cycle.

    Attributes
    ----------
    time_s
        Begin of the cycle [s], counted from the source's `origin_ns`.
    codes
        A/D codes by name: "kh", "kl", "k" (strips,), or "electrodes" (strips, 2 strips) of a CRS-CRP sheet.
    touched
        Strips that are touched, by the source (strips,). The codes of the others are meaningless, unless the spec
        has `rest_volt`: then all codes count, and touch is decided from them.
    sequence
        The source's own number of the scan; a gap in the numbers means lost scans.
    strip_time_s
        Time of each strip's reading (strips,) [s], counted from `time_s`; None where it is not known.
    shapes
        Polygons that are stored with the scan, as a recording may have them. None: they are not known, for nothing was
        reconstructed, the computer was behind or the readings could not be used.
    arrival_s
        When it arrived by the computer's clock [s], counted from the source's `origin_ns`; None where it came from no
        device. `time_s` has the intervals of the device's clock, which may gain or lose seconds an hour.
    tracks
        Objects over time that are stored with the scan, as a recording may have them. None: they were not known when
        the scan was recorded, for the computer was behind or the search for their shape had not ended.
    searching
        Number of objects that `tracks` lacks because the search for their first shape had not ended.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import encode
    >>> sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> scan = ts.Scan(k=[0.25, 0.5, float("nan")])
    >>> encode(scan, sensor, sequence=7).codes["k"].tolist()
    [256, 512, 0]
    """

    time_s: float
    codes: Mapping[str, CodeArray]
    touched: BoolArray
    sequence: int = 0
    strip_time_s: FloatArray | None = None
    shapes: tuple[Shape, ...] | None = None
    arrival_s: float | None = None
    tracks: tuple[TrackedShape, ...] | None = ()
    searching: int = 0

    def __repr__(self) -> str:
        strips = f"{len(self.touched)} strips at {self.time_s:.6g} s: {touched_strips(self.touched)}"
        return f"<RawScan {self.sequence} of {strips}, codes {', '.join(self.codes)}>"


class Source(Protocol):
    """Scans in the order of their times; iterate it once, then close it.

    Any object with these members is a source.

    Examples
    --------
    >>> import time
    >>> import tacstrip as ts
    >>> from tacstrip.stream import encode
    >>> class Still:
    ...     sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    ...     names, origin_ns = ("k",), time.time_ns()
    ...
    ...     def __iter__(self):
    ...         yield from (encode(ts.Scan(k=[0.25, 0.5], time_s=0.01 * i), self.sensor, i) for i in range(3))
    ...
    ...     def close(self):
    ...         pass
    >>> with ts.Live(Still(), speed=float("inf")) as stream:
    ...     frames = list(stream)
    >>> stream.frames
    3
    """

    @property
    def sensor(self) -> Sensor:
        """The sensor; its `adc_bits` are set."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the codes that every scan has."""

    @property
    def origin_ns(self) -> int:
        """Unix time of time_s = 0 [ns]."""

    def __iter__(self) -> Iterator[RawScan]:
        """Yield the scans; any exception raised here ends the stream."""

    def close(self) -> None:
        """Close the file or the device; may be called twice."""


@runtime_checkable
class DeviceSource(Source, Protocol):
    """A source that sets the pace itself, such as a device on a port: its scans are taken as they arrive.

    Attributes
    ----------
    on_message
        Called with messages for the user, a line each.
    arrived_s
        Arrival of the last scan's bytes, by `time.perf_counter` [s].
    waiting
        Number of newer scans that were read together with the last one; above 0 where the reader is behind.
    """

    on_message: Callable[[str], None]
    arrived_s: float
    waiting: int

    @property
    def counts(self) -> Counts:
        """Number of frames that came, and that were lost or corrupt."""


def paced(
    scans: Iterable[RawScan],
    speed: float = 1.0,
    stop: Callable[[], bool] = lambda: False,
    idle: Callable[[float], None] = lambda wait_s: None,
) -> Iterator[RawScan]:
    """Yield scans at the pace of their times, or `speed` times as fast.

    A scan that is late follows at once; none is left out.

    Parameters
    ----------
    scans
        Scans in the order of their times; one whose time runs backwards follows at once.
    speed
        Above 0; infinite: as fast as possible.
    stop
        Called before every scan and at least 20 times a second; True ends the stream.
    idle
        Called before every wait, with its length [s].

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import encode, paced
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> scans = [encode(ts.Scan(k=[0.25, 0.5], time_s=0.01 * i), sensor, i) for i in range(3)]
    >>> [raw.sequence for raw in paced(scans, speed=2.0)]  # takes 10 ms
    [0, 1, 2]
    """
    start = first = None
    for scan in scans:
        if start is None or first is None:
            start, first = time.monotonic(), scan.time_s
        due = start + (scan.time_s - first) / speed
        if (wait := due - time.monotonic()) > 0.0:
            idle(wait)
        while not stop() and (wait := due - time.monotonic()) > 0.0:
            time.sleep(min(wait, _POLL_S))
        if stop():
            return
        yield scan

"""What every source of scans hands on, be it simulated, recorded or a serial port: raw scans with their times."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, touched_strips
from tacstrip.sensor.spec import Sensor

CodeArray: TypeAlias = npt.NDArray[np.unsignedinteger[Any]]

_NAP = 0.05  # s; the longest sleep before a stop is noticed


@dataclass(frozen=True)
class Shape:
    """A polygon that came with a scan: corners (N, 2) [mm], counter-clockwise, and "ok" or "doubtful"."""

    status: str
    vertices: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class RawScan:
    """What the A/D converter read in one sampling cycle.

    Attributes
    ----------
    time_s
        When the cycle began [s], counted from the source's `origin_ns`.
    codes
        A/D codes by name: "kh", "kl", "k" (strips,), or "electrodes" (strips, 2 strips) of a CRS-CRP sheet.
    touched
        Which strips the source says are touched (strips,). The code of one that is not means nothing, unless
        the spec has `rest_volt`: then every code counts, and touch is decided from them.
    sequence
        The source's own number of the scan; a gap tells of scans that were lost on the way.
    strip_time_s
        When each strip was read (strips,) [s], counted from `time_s`; None where that is not known.
    shapes
        Polygons that the source had beside the codes, as a recording may.
    """

    time_s: float
    codes: Mapping[str, CodeArray]
    touched: BoolArray
    sequence: int = 0
    strip_time_s: FloatArray | None = None
    shapes: tuple[Shape, ...] = ()

    def __repr__(self) -> str:
        strips = f"{len(self.touched)} strips at {self.time_s:.6g} s: {touched_strips(self.touched)}"
        return f"<RawScan {self.sequence} of {strips}, codes {', '.join(self.codes)}>"


class Source(Protocol):
    """Scans in the order of their time; iterate it once, then close it."""

    @property
    def sensor(self) -> Sensor:
        """What is measured with; its `adc_bits` are set."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the codes that every scan has."""

    @property
    def origin_ns(self) -> int:
        """Unix time of time_s = 0 [ns]."""

    def __iter__(self) -> Iterator[RawScan]:
        """Give the scans; errors that end the stream, of any kind, are raised here."""

    def close(self) -> None:
        """Let go of the file or the device; may be called twice."""


def paced(
    scans: Iterable[RawScan],
    speed: float = 1.0,
    stop: Callable[[], bool] = lambda: False,
    idle: Callable[[float], None] = lambda wait_s: None,
) -> Iterator[RawScan]:
    """Hand scans on when their time has come, `speed` times as fast as they were made.

    A scan that is late is handed on at once, and none is left out.

    Parameters
    ----------
    scans
        Scans in the order of their time; those whose times go backwards are not waited for.
    speed
        Above 0; infinite: as fast as it goes.
    stop
        Asked before every scan and at least 20 times a second; True ends the stream.
    idle
        Called before every wait, with its length [s].
    """
    start = first = None
    for scan in scans:
        if start is None or first is None:
            start, first = time.monotonic(), scan.time_s
        due = start + (scan.time_s - first) / speed
        if (wait := due - time.monotonic()) > 0.0:
            idle(wait)
        while not stop() and (wait := due - time.monotonic()) > 0.0:
            time.sleep(min(wait, _NAP))
        if stop():
            return
        yield scan

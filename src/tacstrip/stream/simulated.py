"""A sensor that is not there: a contact that moves on it, read at a rate."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, Rng, generator
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import readings, simulate
from tacstrip.stream.codes import encode, to_codes, with_converter
from tacstrip.stream.source import RawScan

_IDEAL = Noise()


@dataclass(frozen=True)
class Drag:
    """A contact that is dragged along a path, to its end and back again, and turns as it goes.

    Attributes
    ----------
    contact
        What moves; its centroid follows the path.
    path
        Way points (M, 2) [mm]; one point stands still.
    seconds
        From the path's start to its end [s].
    turn_rad_s
        Turn counter-clockwise [rad/s].
    """

    contact: Contact
    path: npt.ArrayLike
    seconds: float
    turn_rad_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < math.inf:
            raise OptionError(f"seconds = {self.seconds}: a drag takes a time above 0")

    def __call__(self, time_s: float) -> Contact:
        """Return the contact as it lies at a time [s]."""
        points = np.atleast_2d(np.asarray(self.path, dtype=float))  # (M, 2)
        there_and_back = 1.0 - abs(time_s / self.seconds % 2.0 - 1.0)
        x, y = _along(points, there_and_back)
        moved = self.contact.placed(x, y)
        return moved.turned(self.turn_rad_s * time_s, about=(x, y)) if self.turn_rad_s else moved


class SimulatedSource:
    """A simulated sensor as a source.

    Parameters
    ----------
    sensor
        The sensor; without `adc_bits` it has a converter of 16 bits.
    contact
        What touches it at a time [s]: a `Drag`, or any function.
    rate_hz
        Scans a second.
    scans
        How many; None: without end.
    noise, rng, model, electrodes
        As of `simulate`.
    origin_ns
        Unix time of the first scan [ns]; by default now.
    ahead
        How many scans are made at once, where the closed forms serve; 1 for a contact that somebody moves meanwhile.

    Raises
    ------
    OptionError
        A rate that is not above 0, or an option that does not exist; `ContactError` while it is iterated, when the
        contact leaves the sensor.
    """

    @takes(sensor=Sensor, noise=Noise)
    def __init__(
        self,
        sensor: Sensor,
        contact: Callable[[float], Contact],
        rate_hz: float = 100.0,
        scans: int | None = None,
        noise: Noise = _IDEAL,
        rng: Rng = 0,
        model: Literal["closed", "network"] | None = None,
        electrodes: Literal["own", "all"] = "own",
        origin_ns: int | None = None,
        ahead: int = 64,
    ) -> None:
        if not 0.0 < rate_hz < math.inf:
            raise OptionError(f"rate_hz = {rate_hz}: must be above 0")
        for name, value in {"scans": scans, "ahead": ahead}.items():
            if value is not None and value < 1:
                raise OptionError(f"{name} = {value}: must be 1 or more")
        self.sensor = with_converter(sensor)
        self.origin_ns = time.time_ns() if origin_ns is None else origin_ns
        self._contact, self._rate_hz, self._scans = contact, rate_hz, scans
        self._noise, self._random = noise, generator(rng)
        self._model, self._electrodes = model, electrodes
        self._ahead = ahead if self.sensor.kind.closed_form and model != "network" else 1
        self._first = self._scan(0)  # finds what is wrong before anything is recorded
        self.names = tuple(self._first.codes)

    def __iter__(self) -> Iterator[RawScan]:
        yield self._first
        number = 1
        while self._scans is None or number < self._scans:
            count = self._ahead if self._scans is None else min(self._ahead, self._scans - number)
            yield from self._block(number, count) if count > 1 else [self._scan(number)]
            number += count

    def close(self) -> None:
        """Nothing is open."""

    def _scan(self, number: int) -> RawScan:
        time_s = number / self._rate_hz
        scan = simulate(
            self.sensor, self._contact(time_s), self._noise, rng=self._random, model=self._model, time_s=time_s,
            electrodes=self._electrodes,
        )  # fmt: skip
        return encode(scan, self.sensor, number)

    def _block(self, first: int, count: int) -> Iterator[RawScan]:
        """Give many scans, made at once with the closed forms: thirty times as fast as one by one."""
        numbers = range(first, first + count)
        contacts = [self._contact(number / self._rate_hz) for number in numbers]
        touch = footprint(self.sensor, contacts)
        values = readings(self.sensor, touch.l, touch.u, self._noise, self._random)
        touched = ~np.isnan(touch.l)
        if any(np.isnan(v[touched]).any() for v in values.values()):  # a short: `simulate` says where
            yield from (self._scan(number) for number in numbers)
            return
        codes = to_codes(invert_calibration(self.sensor, values), self.sensor)
        for i, number in enumerate(numbers):
            own = {name: rows[i] for name, rows in codes.items()}
            yield RawScan(number / self._rate_hz, own, touched[i], number)


def _along(points: FloatArray, part: float) -> tuple[float, float]:
    """Return the point at a part of a path's length, 0 to 1."""
    if len(points) == 1:
        return float(points[0, 0]), float(points[0, 1])
    point = shapely.line_interpolate_point(shapely.LineString(points), part, normalized=True)
    return point.x, point.y

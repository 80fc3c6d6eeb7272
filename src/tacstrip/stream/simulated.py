"""A simulated sensor as a source: a contact that moves on it, sampled at a fixed rate."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, NoiseProcess, Rng
from tacstrip.contact.press.patch import Patch
from tacstrip.contact.shape import Contact
from tacstrip.contact.strip_width import wide, wide_ends
from tacstrip.errors import OptionError
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import readings, simulate
from tacstrip.stream.codes import encode, to_codes, with_converter
from tacstrip.stream.source import RawScan

_IDEAL = Noise()


@dataclass(frozen=True)
class Drag:
    """A contact that moves along a path to its end and back again, and turns.

    Attributes
    ----------
    contact
        The contact; its centroid follows the path.
    path
        Way points (M, 2) [mm]; with one point the contact does not move.
    seconds
        Time from the path's start to its end [s].
    turn_rad_s
        Angular velocity, counter-clockwise [rad/s].

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import Drag
    >>> drag = Drag(ts.Contact.polygon([(0, 0), (6, 0), (3, 6)]), [(10, 50), (30, 50)], seconds=2.0)
    >>> [drag(time_s).centroid.round(6).tolist() for time_s in (0.0, 1.0, 3.0)]
    [[10.0, 50.0], [20.0, 50.0], [20.0, 50.0]]
    """

    contact: Contact
    path: npt.ArrayLike
    seconds: float
    turn_rad_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < math.inf:
            raise OptionError(f"seconds = {self.seconds}: must be above 0")

    def __call__(self, time_s: float) -> Contact:
        """Return the contact at a time [s]."""
        points = np.atleast_2d(np.asarray(self.path, dtype=float))  # (M, 2)
        there_and_back = 1.0 - abs(time_s / self.seconds % 2.0 - 1.0)
        x, y = points[0].tolist()
        if len(points) > 1:
            path = shapely.LineString(points)
            ((x, y),) = path.interpolate(there_and_back, normalized=True).coords
        moved = self.contact.placed(x, y)
        return moved.turned(self.turn_rad_s * time_s, about=(x, y)) if self.turn_rad_s else moved


class SimulatedSource:
    """A simulated sensor as a source.

    Parameters
    ----------
    sensor
        The sensor; a spec without `adc_bits` gets a converter of 16 bits.
    contact
        Function of time [s] that returns the contact, such as a `Drag`, or the patch of a solid (`press`).
    rate_hz
        Scan rate [Hz].
    scans
        Number of scans; None: endless.
    noise, rng, model, electrodes
        As of `simulate`; errors that last go on from scan to scan.
    origin_ns
        Unix time of the first scan [ns]; None: now.
    ahead
        Number of scans that are computed together, where the closed forms apply; 1: one by one, for a changing contact.

    Raises
    ------
    OptionError
        A number is out of range, or an option does not exist.
    ContactError
        The contact is not on the sensor; also while iterating.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=365.0, adc_bits=10)
    >>> contact = ts.Contact.polygon([(10, 100), (50, 100), (30, 200)])
    >>> source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=100.0, scans=3)
    >>> [(raw.sequence, raw.time_s) for raw in source]
    [(0, 0.0), (1, 0.01), (2, 0.02)]
    """

    clock = "simulation"

    @takes(sensor=Sensor | LayeredSensor, noise=Noise)
    def __init__(
        self,
        sensor: AnySensor,
        contact: Callable[[float], Contact | Patch],
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
        whole = with_converter(sensor)
        self.sensor = cast(Sensor, whole)  # of two layers what takes one refuses it
        self.origin_ns = time.time_ns() if origin_ns is None else origin_ns
        self._contact, self._rate_hz, self._scans = contact, rate_hz, scans
        self._process = NoiseProcess(noise, unit_of(whole), rng)
        self._model, self._electrodes = model, electrodes
        together = isinstance(whole, Sensor) and whole.kind.closed_form and model != "network"
        self._ahead = ahead if together else 1
        self._first = self._scan(0)  # raises errors before anything is recorded
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
            self.sensor, self._contact(time_s), model=self._model, time_s=time_s,
            electrodes=self._electrodes, process=self._process,
        )  # fmt: skip
        return encode(scan, self.sensor, number)

    def _ends(self, contacts: list[Contact | Patch]) -> tuple[FloatArray, FloatArray]:
        """Return l and u (contacts, strips) [mm]."""
        flat = [c for c in contacts if isinstance(c, Contact)]
        if len(flat) == len(contacts):
            by_width = wide(self.sensor, flat)
            ends = wide_ends(self.sensor, flat) if by_width else footprint(self.sensor, flat)
            return ends.l, ends.u
        each = [(c.l, c.u) if isinstance(c, Patch) else tuple(footprint(self.sensor, c)) for c in contacts]
        l, u = zip(*each, strict=True)
        return np.stack(l), np.stack(u)

    def _block(self, first: int, count: int) -> Iterator[RawScan]:
        """Yield scans that the closed forms compute together, thirty times as fast as one by one."""
        numbers = range(first, first + count)
        contacts = [self._contact(number / self._rate_hz) for number in numbers]
        l, u = self._ends(contacts)
        times_s = np.array(numbers) / self._rate_hz
        values = readings(self.sensor, l, u, process=self._process, time_s=times_s)
        touched = ~np.isnan(l)
        if any(np.isnan(v[touched]).any() for v in values.values()):
            yield from map(self._scan, numbers)  # a short circuit: `simulate` names the strip
            return
        codes = to_codes(invert_calibration(self.sensor, values), self.sensor)
        for i, number in enumerate(numbers):
            own = {name: rows[i] for name, rows in codes.items()}
            yield RawScan(number / self._rate_hz, own, touched[i], number)

"""The simulated sensor that a page controls: its construction, its noise, and the objects on it."""

from __future__ import annotations

import functools
import operator
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import Patch
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import with_converter
from tacstrip.stream.device.source import SerialSource
from tacstrip.stream.device.virtual import Loopback, VirtualDevice
from tacstrip.stream.simulated import SimulatedSource
from tacstrip.stream.source import RawScan
from tacstrip.view.solids import Pressed, first_solid, together

MAX_STRIPS, MAX_OBJECTS, MAX_VERTICES = 1000, 8, 40
_BLOCK_S = 0.01  # duration of the scans that are computed together
_SHEET_HZ, _SHEET_STRIPS = 20.0, 24  # a network of a sheet is computed so fast on any computer
_READ_SHARE = 0.5  # of the period, to read all strips

_SETTINGS = ("construction", "strips", "noise", "rate_hz")

Ring = list[tuple[float, float]]


@dataclass(frozen=True)
class Settings:
    """Settings of the simulator; a change of `sensor` or `rate_hz` begins a new stream."""

    sensor: AnySensor
    rate_hz: float = 1000.0
    noise: Noise = field(default_factory=lambda: Noise(positional=0.005))


class Simulator:
    """Holds the settings and the objects; every method may be called from any thread.

    Attributes
    ----------
    settings
        The present settings.
    objects
        Vertices of each object [mm]; of a sensor with a `[surface]` the solids that are pressed into it.
    """

    def __init__(self, settings: Settings, objects: Sequence[Any] | None = None, seed: int = 0) -> None:
        self.settings = _feasible(settings)
        sensor = settings.sensor
        self._asked: dict[str, Any] = {
            "construction": sensor.construction,
            "strips": sensor.strips,
            "rate_hz": settings.rate_hz,
        }
        self.objects: list[Any] = []
        self._shown: list[Any] = []
        self.device: VirtualDevice | None = None
        self._lock = threading.Lock()
        self._contact: Contact | Patch | None = None
        self._random = np.random.default_rng(seed)
        self.place(self._example() if objects is None else objects)

    def _example(self) -> Sequence[Any]:
        sensor = self.settings.sensor
        unit = unit_of(sensor)
        return example(sensor) if unit.surface is None else [asdict(one) for one in first_solid(unit)]

    @property
    def truth(self) -> list[Any]:
        """The objects as a page draws them: vertices, or solids with their outlines."""
        with self._lock:
            return self._shown

    def place(self, objects: Sequence[Any]) -> None:
        """Replace the objects on the sensor.

        Raises
        ------
        OptionError, ContactError
            They are not polygons or solids, or too many, or a solid does not fit; the objects then stay as they are.
        """
        if unit_of(self.settings.sensor).surface is not None:
            self._press(objects)
            return
        if len(objects) > MAX_OBJECTS or any(len(ring) > MAX_VERTICES for ring in objects):
            raise OptionError(f"at most {MAX_OBJECTS} objects of {MAX_VERTICES} vertices")
        contacts = [Contact.polygon(ring) for ring in objects]
        contact = functools.reduce(operator.add, contacts) if contacts else None
        with self._lock:
            self.objects = [[(float(x), float(y)) for x, y in ring] for ring in objects]
            self._contact, self._shown = contact, self.objects

    def _press(self, objects: Sequence[Any]) -> None:
        if len(objects) > MAX_OBJECTS:
            raise OptionError(f"at most {MAX_OBJECTS} objects")
        sensor, solids = unit_of(self.settings.sensor), [Pressed.of(one) for one in objects]
        patches = [one.press(sensor) for one in solids]
        shown = [one.json(sensor, patch) for one, patch in zip(solids, patches, strict=True)]
        with self._lock:
            self.objects, self._shown = solids, shown
            self._contact = together(patches) if patches else None

    def change(self, wanted: Mapping[str, Any]) -> bool:
        """Change settings by name; return whether that needs a new stream.

        Raises
        ------
        TacstripError
            The setting does not exist, or cannot have this value; nothing is changed.
        """
        now, asked = self.settings, self._asked | dict(wanted)
        if unknown := [key for key in wanted if key not in _SETTINGS]:
            raise OptionError(one_of("setting", unknown[0], _SETTINGS))
        sensor = now.sensor
        if "construction" in wanted or "strips" in wanted:
            if isinstance(sensor, LayeredSensor):
                raise OptionError("of two layers, construction and strips are the spec's: change them there")
            sensor = sensor_of(asked["construction"], asked["strips"], sensor)
            if "strips" in wanted and sensor.strips < wanted["strips"]:
                raise OptionError(
                    f"strips = {wanted['strips']}: a sheet is computed as a network: 2 to {_SHEET_STRIPS}"
                )
        noise = Noise(positional=wanted["noise"]) if "noise" in wanted else now.noise
        new = _feasible(Settings(sensor, _rate(asked["rate_hz"]), noise))
        if "rate_hz" in wanted and new.rate_hz < wanted["rate_hz"]:
            raise OptionError(
                f"rate_hz = {wanted['rate_hz']}: a sheet is computed as a network: 1 to {_SHEET_HZ:g}"
            )
        restart = (new.sensor, new.rate_hz) != (now.sensor, now.rate_hz)
        # What a sheet cannot have comes back with the next construction that can.
        self.settings, self._asked = new, {key: asked[key] for key in self._asked}
        if restart and unit_of(new.sensor).surface is not None:
            self.place([asdict(one) for one in self.objects if isinstance(one, Pressed)])
        return restart

    def source(self) -> SerialSource:
        """Return a new source: a virtual device in the same program."""
        device = self.virtual_device()
        return SerialSource(lambda: Loopback(device), self.settings.sensor)

    def virtual_device(self) -> VirtualDevice:
        """Return a new device with the present settings; its objects may move meanwhile."""
        now = self.settings
        span_s = _READ_SHARE / now.rate_hz
        self.device = VirtualDevice(now.sensor, lambda: self._scans(now), now.rate_hz, span_s)
        return self.device

    @property
    def problem(self) -> str:
        """Why the objects cannot be simulated; empty where they can."""
        return "" if self.device is None else self.device.problem

    def _scans(self, now: Settings) -> Iterator[RawScan]:
        """Yield scans of the objects; objects and noise may change meanwhile."""
        ahead = max(1, round(_BLOCK_S * now.rate_hz))
        while True:
            noise = self.settings.noise
            options = (now.rate_hz, None, noise, self._random)
            for raw in SimulatedSource(now.sensor, self._now, *options, ahead=ahead):
                yield raw
                if self.settings.noise is not noise:
                    break

    def _now(self, time_s: float) -> Contact | Patch:
        with self._lock:
            contact = self._contact
        if contact is None:
            raise ContactError("no object is on the sensor")
        return contact


def sensor_of(construction: str, strips: Any, like: Sensor) -> Sensor:
    """Return a sensor of this construction, of the size of `like`."""
    if construction not in CONSTRUCTIONS:
        raise OptionError(one_of("construction", construction, CONSTRUCTIONS))
    kind = CONSTRUCTIONS[construction]
    if like.surface is not None and (kind.cylindrical or not kind.closed_form):
        raise OptionError(
            f"construction = {construction}: the skin has a [surface], which a {construction} cannot"
        )
    max_count = MAX_STRIPS if kind.closed_form else _SHEET_STRIPS
    if not isinstance(strips, int) or not 2 <= strips <= MAX_STRIPS:
        raise OptionError(f"strips = {strips}: must be 2 to {MAX_STRIPS}")
    count = min(strips, max_count)
    pitch, length = like.width_mm / count, like.length_mm
    given: dict[str, Any] = {}
    if (surface := like.surface) is not None:
        pitch, length, given = surface.pitch_mm(count), surface.length_mm(count), {"surface": surface}
    if "radius_mm" in kind.keys:
        given["radius_mm"] = like.width_mm / 3.0
    if not kind.closed_form:
        given |= {"contact_lambda_mm": 0.02 * like.length_mm, "resistivity_ratio": 100.0}
    return Sensor(
        construction=construction, strips=count, pitch_mm=pitch, length_mm=length,
        vref_volt=like.vref_volt, adc_bits=like.adc_bits, **given,
    )  # fmt: skip


def example(sensor: AnySensor) -> list[Ring]:
    """Return a first object, in the middle of the sensor; of two layers two, which share strips of the first."""
    quadrangle = [(0.22, 0.38), (0.62, 0.22), (0.80, 0.55), (0.45, 0.76)]
    if not isinstance(sensor, LayeredSensor):
        return [[(x * sensor.width_mm, y * sensor.length_mm) for x, y in quadrangle]]
    first = sensor.layers[0]
    size = (first.sensor.width_mm, first.sensor.length_mm)
    pair = [(0.21, 0.21), (0.47, 0.26), (0.31, 0.52)], [(0.36, 0.62), (0.73, 0.57), (0.62, 0.83)]
    return [[(x, y) for x, y in first.to_whole(np.multiply(ring, size)).tolist()] for ring in pair]


def _rate(rate_hz: Any) -> float:
    if not isinstance(rate_hz, int | float) or not 1.0 <= rate_hz <= 5000.0:
        raise OptionError(f"rate_hz = {rate_hz}: must be 1 to 5000")
    return float(rate_hz)


def _feasible(settings: Settings) -> Settings:
    """Return the settings with a converter, and the rate limited to what a network can be solved at."""
    sensor = with_converter(settings.sensor)
    rate = settings.rate_hz if unit_of(sensor).kind.closed_form else min(settings.rate_hz, _SHEET_HZ)
    return replace(settings, sensor=sensor, rate_hz=rate)

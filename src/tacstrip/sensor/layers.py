"""A sensor of two layers: one strip sensor laid across another, `[[layer]]` tables in the spec file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.errors import SpecError
from tacstrip.files import write_text
from tacstrip.notebook import Drawn, SvgPath, strip_paths
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.noise import Noise
from tacstrip.sensor.spec import FORMAT, KEYS, LAYER, NOISE, OWN_KEYS, Sensor

# Where a layer lies, key to the comment in the file.
PLACEMENT = {
    "angle_deg": "by which it is turned anticlockwise in the frame of the whole",
    "x_mm": "where its own x = 0, y = 0 lies in the frame of the whole",
    "y_mm": "likewise",
}
_COUNT = 2
_CROSSED_DEG = 90.0
_LEAST_CROSSING_DEG = 10.0  # nearer to parallel a second layer says along the strips what the first one says
_SHARED = ("construction", "vref_volt", "adc_bits", "rest_volt", "touch_volt", "strip_base")  # of one unit


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One layer: a strip sensor and its place in the frame of the whole.

    Attributes
    ----------
    sensor
        Its strips, in a frame of their own: x across them, y along.
    angle_deg
        By which that frame is turned anticlockwise [degrees].
    x_mm, y_mm
        Where its origin lies in the frame of the whole [mm].

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> one = ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0)
    >>> layer = ts.Layer(sensor=one, angle_deg=90.0, x_mm=96.0)
    >>> layer.to_layer(np.array([96.0, 10.0])).tolist()
    [10.0, 0.0]
    """

    sensor: Sensor
    angle_deg: float = 0.0
    x_mm: float = 0.0
    y_mm: float = 0.0

    @cached_property
    def rotation(self) -> FloatArray:
        """The matrix (2, 2) that takes directions of the layer to those of the whole."""
        turn = math.radians(self.angle_deg)
        c, s = math.cos(turn), math.sin(turn)
        return np.round(np.array([[c, -s], [s, c]]), 15)  # a right angle is one

    @property
    def origin_mm(self) -> FloatArray:
        """Where x = 0, y = 0 of the layer lies in the whole (2,) [mm]."""
        return np.array([self.x_mm, self.y_mm])

    def to_layer(self, points_mm: FloatArray) -> FloatArray:
        """Return points (..., 2) [mm] of the whole in the frame of the layer."""
        return np.asarray((points_mm - self.origin_mm) @ self.rotation)

    def to_whole(self, points_mm: FloatArray) -> FloatArray:
        """Return points (..., 2) [mm] of the layer in the frame of the whole."""
        return np.asarray(points_mm @ self.rotation.T + self.origin_mm)

    @property
    def corners_mm(self) -> FloatArray:
        """Corners (4, 2) [mm] of its surface in the frame of the whole."""
        width, length = self.sensor.width_mm, self.sensor.length_mm
        return self.to_whole(np.array([(0.0, 0.0), (width, 0.0), (width, length), (0.0, length)]))


@dataclass(frozen=True, kw_only=True)
class LayeredSensor(Drawn):
    """Two strip sensors on each other, read by one unit; `Sensor.load` makes one of a spec with two `[[layer]]` tables.

    A scan of it has the strips of layer 0, then those of layer 1; `split` takes it apart. What touches lies in the
    frame of the whole, which is that of layer 0 where the spec does not place it elsewhere.

    Attributes
    ----------
    layers
        Two, of one construction, reference voltage and converter.
    noise
        What errors the readings have, where that was measured.

    Raises
    ------
    SpecError
        The layers cannot be read by one unit or do not cross; the message names layer and key.

    Examples
    --------
    >>> import tacstrip as ts
    >>> one = ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0)
    >>> sensor = ts.LayeredSensor.crossed(one)
    >>> sensor.strips, sensor.layers[1].angle_deg
    (64, 90.0)
    """

    layers: tuple[Layer, ...]
    noise: Noise | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        if len(self.layers) != _COUNT:
            raise SpecError(
                f"{len(self.layers)} [[layer]] table(s): give two, or one sensor without such a table"
            )
        first, second = (layer.sensor for layer in self.layers)
        for number, layer in enumerate(self.layers):
            _check_layer(number, layer)
        for key in _SHARED:
            if (a := getattr(first, key)) != (b := getattr(second, key)):
                raise SpecError(
                    f"layer 1: {key} = {b}, and layer 0 has {a}: one unit reads both, so give one value"
                )
        turn = (self.layers[1].angle_deg - self.layers[0].angle_deg) % 180.0
        if min(turn, 180.0 - turn) < _LEAST_CROSSING_DEG:
            raise SpecError(
                f"layer 1: angle_deg = {self.layers[1].angle_deg:g}: its strips run along those of layer 0; turn it "
                f"by {_LEAST_CROSSING_DEG:g} degrees or more, best by 90"
            )
        both = [shapely.Polygon(layer.corners_mm) for layer in self.layers]
        if not shapely.intersection(*both).area > 0.0:
            raise SpecError(
                "layer 1: x_mm and y_mm put it beside layer 0, and nothing can touch both; place it over it"
            )

    def __repr__(self) -> str:
        parts = [f"{x.sensor.fingerprint}, turned by {x.angle_deg:g} deg" for x in self.layers]
        return f"<LayeredSensor: {'; '.join(parts)}{', noise known' if self.noise else ''}>"

    def _paths(self) -> list[SvgPath]:
        own = [(x, strip_paths(x.sensor.strips, x.sensor.pitch_mm, x.sensor.strip_width, x.sensor.length_mm))
               for x in self.layers]  # fmt: skip
        return [
            replace(path, points=layer.to_whole(path.points), opacity=0.5 * path.opacity)
            for layer, paths in own
            for path in paths
        ]

    @classmethod
    def crossed(cls, sensor: Sensor, angle_deg: float = _CROSSED_DEG) -> LayeredSensor:
        """Return a sensor with a second layer like it, turned about its middle by an angle [degrees]."""
        noise, bare = sensor.noise, replace(sensor, noise=None)
        return cls(layers=(Layer(sensor=bare), _centred(bare, angle_deg, Layer(sensor=bare))), noise=noise)

    @property
    def strips(self) -> int:
        """Strips of both layers."""
        return sum(layer.sensor.strips for layer in self.layers)

    @property
    def construction(self) -> str:
        """The construction of both layers."""
        return self.layers[0].sensor.construction

    @property
    def signatures(self) -> tuple[str, ...]:
        """Names of the signatures that both layers measure."""
        return self.layers[0].sensor.signatures

    @property
    def adc_bits(self) -> int | None:
        """Resolution of the unit's A/D converter."""
        return self.layers[0].sensor.adc_bits

    def changed(self, **keys: Any) -> LayeredSensor:
        """Return the sensor with keys of the unit changed in both layers, such as `adc_bits`."""
        layers = tuple(replace(layer, sensor=replace(layer.sensor, **keys)) for layer in self.layers)
        return replace(self, layers=layers)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The strips of each layer in a scan of the whole."""
        ends = np.cumsum([layer.sensor.strips for layer in self.layers]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    @cached_property
    def unit(self) -> Sensor:
        """All strips as the unit reads them, one after another: what knows voltages and codes, but no places."""
        first = self.layers[0].sensor
        without = []
        for part, layer in zip(self.slices, self.layers, strict=True):
            for name in layer.sensor.without:
                strip, colon, channel = name.partition(":")
                without.append(f"{int(strip) + part.start}{colon}{channel}")
        return replace(first, strips=self.strips, without=tuple(without), noise=self.noise)

    def where(self, strip: int) -> str:
        """Return the name of a strip of a scan, counted from 0: its layer, and its number there."""
        number = next(k for k, part in enumerate(self.slices) if strip < part.stop)
        return f"strip {strip - self.slices[number].start + self.layers[number].sensor.strip_base} of layer {number}"

    @property
    def fingerprint(self) -> str:
        """What recordings and readings must agree with."""
        return "; ".join(f"{x.sensor.fingerprint}, {x.angle_deg:g} deg" for x in self.layers)

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any]) -> LayeredSensor:
        """Make a sensor from a spec file's keys and values.

        Keys outside the tables hold for both layers; what the second table leaves out is as in the first one.
        """
        tables = raw[LAYER]
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise SpecError("layer: write each layer as a table of its own, headed [[layer]]")
        if unknown := [key for key in raw if key not in (*KEYS, NOISE, LAYER)]:
            raise SpecError(
                f"unknown key {unknown[0]!r} beside [[layer]] tables; the keys are: {', '.join([*KEYS, NOISE, LAYER])}"
            )
        if "format" not in raw:
            raise SpecError("key 'format' is missing; it stands above the [[layer]] tables")
        common = {key: value for key, value in raw.items() if key not in (LAYER, NOISE)}
        layers: list[Layer] = []
        known: dict[str, Any] = common
        for number, table in enumerate(tables):
            keys = [*(k for k in KEYS if k != "format"), *PLACEMENT]
            if unknown := [key for key in table if key not in keys]:
                raise SpecError(
                    f"layer {number}: unknown key {unknown[0]!r}; the keys are: {', '.join(keys)}"
                )
            known = known | {key: value for key, value in table.items() if key not in PLACEMENT}
            try:
                layers.append(_placed(Sensor.from_dict(known), table, layers))
            except SpecError as error:
                raise SpecError(f"layer {number}: {error}") from None
        noise = Noise.from_dict(raw[NOISE]) if NOISE in raw else None
        return cls(layers=tuple(layers), noise=noise)

    def to_toml(self) -> str:
        """Return the spec file's text."""
        first = self.layers[0].sensor
        lines = ["# A resistive hybrid tactile sensor of two layers, for tacstrip. Millimetres and volts."]
        lines.append(_line("format", FORMAT))
        shared = {k: v for k in _SHARED if (v := getattr(first, k)) is not None}
        lines += [_line(k, v) for k, v in shared.items() if (k, v) != ("strip_base", 0)]  # the default
        for layer in self.layers:
            lines += ["", "[[layer]]"]
            for key in KEYS:
                value = getattr(layer.sensor, key)
                own = key not in OWN_KEYS or key in first.kind.keys
                if own and key not in (*_SHARED, "format") and value not in (None, ()):
                    lines.append(_line(key, value))
            lines += [_line(key, getattr(layer, key), comment) for key, comment in PLACEMENT.items()]
        text = "\n".join(lines) + "\n"
        return text if self.noise is None else f"{text}\n{self.noise.to_toml()}"

    def save(self, path: str | Path) -> None:
        """Write the spec file."""
        write_text(path, self.to_toml())


AnySensor: TypeAlias = Sensor | LayeredSensor


def unit_of(sensor: AnySensor) -> Sensor:
    """Return what knows a sensor's voltages and codes: the sensor itself, or of two layers all strips in a row."""
    return sensor.unit if isinstance(sensor, LayeredSensor) else sensor


def _centred(sensor: Sensor, angle_deg: float, below: Layer) -> Layer:
    """Return a layer turned by an angle whose middle lies on that of the layer below."""
    placed = Layer(sensor=sensor, angle_deg=angle_deg)
    x, y = (below.corners_mm.mean(axis=0) - placed.corners_mm.mean(axis=0)).round(9).tolist()
    return replace(placed, x_mm=x, y_mm=y)


def _placed(sensor: Sensor, table: Mapping[str, Any], below: list[Layer]) -> Layer:
    """Return a layer where its table says; by default the first one as it is, the second across and over its middle."""
    given: dict[str, Any] = {}
    for key in PLACEMENT:
        if key in table:
            value = table[key]
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise SpecError(f"{key} = {value!r}: must be a finite number")
            given[key] = float(value)
    if not below:
        return Layer(sensor=sensor, **given)
    across = _centred(sensor, given.get("angle_deg", below[0].angle_deg + _CROSSED_DEG), below[0])
    return replace(across, **given)


def _check_layer(number: int, layer: Layer) -> None:
    sensor = layer.sensor
    if not sensor.kind.closed_form or sensor.kind.cylindrical:
        flat = ", ".join(c.name for c in CONSTRUCTIONS.values() if c.closed_form and not c.cylindrical)
        raise SpecError(f"layer {number}: construction = {sensor.construction}: layers are one of: {flat}")
    if sensor.calibration is not None:
        raise SpecError(f"layer {number}: a calibration belongs to a sensor of one layer; take the table out")
    if sensor.noise is not None:
        raise SpecError(f"layer {number}: [noise] is the unit's: write it beside the [[layer]] tables")


def _line(key: str, value: object, comment: str = "") -> str:
    text = repr(value) if isinstance(value, int | float) else json.dumps(value, ensure_ascii=False)
    comment = comment or KEYS[key][1]
    return f"{f'{key} = {text}':<32} # {comment}"

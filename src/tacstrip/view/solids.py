"""Solids that a page presses into the simulated sensor's skin, and the skin in space as the page draws it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np

from tacstrip.arrays import FloatArray, finite_runs, plain
from tacstrip.contact.press.patch import Patch, press
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import Skin, skin_of

_MADE: dict[str, Callable[[float], Solid]] = {  # of its size [mm]
    "plane": lambda _: Solid.plane(),
    "sphere": Solid.sphere,
    "cylinder": Solid.cylinder,
    "edge": lambda _: Solid.edge(),
    "cone": lambda _: Solid.cone(),
    "box": lambda size: Solid.box((size, 0.5 * size, 0.5 * size)),
}
KINDS = tuple(_MADE)
_COLUMNS, _ROWS = 65, 10  # of the skin as it is drawn, at most across
_OUTLINE = 48  # points of an outline
_REACH = 0.35  # of the skin's size: how far an endless solid is drawn to either side


@dataclass(frozen=True)
class Pressed:
    """A solid that is pressed along the skin's normal.

    Attributes
    ----------
    solid
        Its kind.
    x_mm, y_mm
        Where it is pressed, in strip coordinates: strip times pitch, and along the strip [mm].
    depth_mm
        How far, from its first touch.
    turn_deg
        How it is turned about the normal.
    size_mm
        Radius, or a box's side, which is half as long and high the other ways.
    """

    solid: str
    x_mm: float
    y_mm: float
    depth_mm: float
    turn_deg: float = 0.0
    size_mm: float = 4.0

    @classmethod
    def of(cls, raw: Any) -> Self:
        """Make it from a page's request: `OptionError` where that cannot be."""
        if not isinstance(raw, Mapping) or not set(raw) <= {*cls.__annotations__}:
            raise OptionError(f"a solid has {', '.join(cls.__annotations__)}")
        if raw.get("solid") not in KINDS:
            raise OptionError(one_of("solid", raw.get("solid"), KINDS))
        for name in cls.__annotations__:
            value = raw.get(name, 0.0) if name != "solid" else 0.0
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise OptionError(f"{name} = {value!r}: must be a number")
        try:
            return cls(**raw)
        except TypeError:
            raise OptionError(f"a solid has {', '.join(cls.__annotations__)}") from None

    def press(self, sensor: Sensor) -> Patch:
        """Press it: `ContactError` where it does not meet the skin, or sinks in too deep."""
        skin, strip = skin_of(sensor), self.x_mm / sensor.pitch_mm - 0.5
        if sensor.closed:
            strip = (strip + 0.5) % sensor.strips - 0.5
        strip = min(max(strip, -0.5), sensor.strips - 0.5)
        along = min(max(self.y_mm, 0.0), float(skin.lengths_mm[min(max(round(strip), 0), sensor.strips - 1)]))
        place = skin.places(np.array(strip), np.array(along))
        normal = skin.normals(*place)
        solid, turn = _MADE[self.solid](self.size_mm), math.radians(self.turn_deg)
        placed = solid.at(skin.points(*place), toward=-normal, turn_rad=turn)
        return press(sensor, placed, depth_mm=self.depth_mm)

    def json(self, sensor: Sensor, patch: Patch) -> dict[str, Any]:
        """Return it and its patch for the page: the outline unrolled and in space, and lines of the solid."""
        skin, outline = skin_of(sensor), patch.outline_xyz
        outline = outline[:: max(1, len(outline) // _OUTLINE)] if len(outline) else np.full((1, 3), np.nan)
        rings = [skin.unrolled(piece) for piece in finite_runs(np.concatenate([outline, outline[:1]]), 2)]
        size = float(np.ptp(_grid(skin)[0].reshape(-1, 3), axis=0).max())
        solid = patch.solid
        lines = [line @ solid.axes + solid.position_mm for line in _wire(solid, _REACH * size)]
        return {
            **asdict(self),
            "rings": [plain(part, 2) for ring in rings for part in finite_runs(ring, 2)],
            "lines": [plain(line, 2) for line in lines],
            "area_mm2": round(patch.area_mm2, 2), "force_n": round(patch.force_n, 3),
        }  # fmt: skip


def first_solid(sensor: Sensor) -> list[Pressed]:
    """Return a first solid in the middle of the skin; none where even a ball cannot be pressed there."""
    thick = skin_of(sensor).thickness_mm
    x, y = (0.5 * (sensor.strips // 2 * 2 + 1) - 0.5) * sensor.pitch_mm, 0.4 * sensor.length_mm
    for kind in ("cylinder", "sphere"):
        one = Pressed(kind, x, y, 0.5 * thick, 70.0, round(4.0 / 3.0 * thick, 3))
        try:
            one.press(sensor)
        except ContactError:
            continue
        return [one]
    return []


def together(patches: Sequence[Patch]) -> Patch:
    """Return patches as one that touches strips from the lowest to the highest end, which is what strips read."""
    l, u = np.fmin.reduce([p.l for p in patches]), np.fmax.reduce([p.u for p in patches])
    return replace(patches[0], l=l, u=u)


def skin_json(sensor: Sensor) -> dict[str, Any] | None:
    """Return the skin in space: points [mm] of a grid, across and along the strips; None of a plane."""
    skin = skin_of(sensor)
    return None if skin.surface is None else _as_json(skin)


@lru_cache(maxsize=4)
def _as_json(skin: Skin) -> dict[str, Any]:
    points, lengths, outward = _grid(skin)
    return {"points": plain(points, 2), "lengths": plain(lengths, 3), "outward": outward}


@lru_cache(maxsize=4)
def _grid(skin: Skin) -> tuple[FloatArray, FloatArray, int]:
    """Return points (C, R, 3), the length of a strip at each column (C,), and 1 where columns x rows face outwards."""
    columns = min(max(skin.strips, 32), _COLUMNS - 1) + 1
    strip = np.linspace(-0.5, skin.strips - 0.5, columns)
    lengths = np.interp(strip, np.arange(skin.strips), skin.lengths_mm)
    place = skin.places(strip[:, None], lengths[:, None] * np.linspace(0.0, 1.0, _ROWS))
    points = skin.points(*place)
    c, r = columns // 2, _ROWS // 2
    facing = np.cross(points[c + 1, r] - points[c, r], points[c, r + 1] - points[c, r])
    across, up = (v[c, r] for v in np.broadcast_arrays(*place))
    return points, lengths, 1 if float(facing @ skin.normals(across, up)) > 0.0 else -1


def _wire(solid: Solid, reach: float) -> list[FloatArray]:
    """Return lines (N, 3) that show a solid, in its own frame [mm]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    cos, sin, zero = np.cos(turn), np.sin(turn), np.zeros(25)
    ends = np.array([-reach, reach])
    if solid.kind == "sphere":
        r = solid.size[0]
        rings = [(cos, sin, zero), (cos, zero, sin), (zero, cos, sin)]
        return [np.stack([r * a, r * b, r * c + r], axis=1) for a, b, c in rings]
    if solid.kind == "cylinder":
        r = solid.size[0]
        circles = [np.stack([np.full(25, at), r * sin, r - r * cos], axis=1) for at in ends]
        return circles + [np.stack([ends, *(np.full(2, v) for v in (r * s, r - r * c))], axis=1)
                        for s, c in ((0, 1), (1, 0), (0, -1), (-1, 0))]  # fmt: skip
    if solid.kind == "box":
        a, b, c = solid.size
        base = 0.5 * np.array([[-a, -b, 0], [a, -b, 0], [a, b, 0], [-a, b, 0], [-a, -b, 0]])
        top = base + np.array([0.0, 0.0, c])
        return [base, top, *(np.stack([base[i], top[i]]) for i in range(4))]
    if solid.kind == "cone":
        side, up = reach * math.sin(0.5 * solid.size[0]), reach * math.cos(0.5 * solid.size[0])
        base = np.stack([side * cos, side * sin, np.full(25, up)], axis=1)
        return [base, *(np.stack([base[i], np.zeros(3)]) for i in (0, 6, 12, 18))]
    half = 0.5 * solid.size[0] if solid.kind == "edge" else 0.5 * math.pi
    side, up = reach * math.sin(half), reach * math.cos(half)
    corners = [(-side, up), (0.0, 0.0), (side, up)]
    return [np.array([[x, y, z] for y, z in corners]) for x in ends] + [
        np.array([[x, y, z] for x in ends]) for y, z in corners
    ]

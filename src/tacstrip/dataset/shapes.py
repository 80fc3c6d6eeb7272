"""Contacts drawn at random, by distributions that a data set's card can name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self, TypeAlias

from tacstrip.arguments import refuse_positional
from tacstrip.core.binding import SHAPE_CORNERS, SHAPE_OBJECTS, ShapeLaws
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.sensor.spec import Sensor

Range: TypeAlias = float | tuple[float, float]

KINDS = ("none", "polygon", "circle", "ellipse", "line", "points")  # by their number in labels
DRAWN = KINDS[1:4]
_SIZES = (0.2, 0.6)  # of what the sensor has room for


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """Contacts drawn at random: `n` scans of scenes with one object or several, each wholly on the sensor.

    A range is a number, or two: the least and the greatest, and every value between is as likely. Polygons have their
    corners on an ellipse, so they are convex. What is drawn depends on the seed and on the scene's number alone.

    Attributes
    ----------
    n
        Number of scans.
    kinds
        "polygon", "circle" or "ellipse", or how often each of them comes: {"polygon": 0.8, "ellipse": 0.2}.
    corners
        Corners of a polygon, 3 to 16; each number is as likely.
    objects
        Objects of a scene, 0 to 8.
    size_mm
        Diameter of the circle round an object [mm]. None: 20 to 60 % of the lesser of the sensor's length and its
        width, shared by the objects.
    aspect
        Short axis over the long one of ellipses and of polygons' ellipses, above 0 to 1.
    turn_rad
        Direction of the long axis, counter-clockwise from x [rad].
    x_mm, y_mm
        Where centres are [mm], as far as the whole object is on the sensor. None: anywhere. x for one object only, or
        for objects that need not be apart.
    irregularity
        0: corners at equal angles, seen from the centre of the circle that is stretched to the ellipse; 1: each up to
        half a step off, so that two may nearly meet.
    apart
        Objects have strips of their own: their circles keep `gap_mm` [mm] between them across the strips, two pitches
        by default. False: they may share strips, which read the hull.
    frames, period_s
        Scans of a scene, and the time between them [s]. Objects move straight from one drawn place to another, `travel`
        (0 to 1) of the way, and turn on it by up to `spin_rad` either way.

    Raises
    ------
    OptionError
        A value is impossible; the message names it.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> scans = ts.simulate_many(sensor, ts.Shapes(n=3, corners=4), rng=1)
    >>> scans.kh.shape, scans.labels.vertices.shape
    ((3, 100), (3, 1, 4, 2))
    """

    n: int
    kinds: str | Mapping[str, float] = "polygon"
    corners: int | tuple[int, int] = (3, 8)
    objects: int | tuple[int, int] = 1
    size_mm: Range | None = None
    aspect: Range = (0.5, 1.0)
    turn_rad: Range = (0.0, 2.0 * math.pi)
    x_mm: Range | None = None
    y_mm: Range | None = None
    irregularity: float = 0.6
    apart: bool = True
    gap_mm: float | None = None
    frames: int = 1
    period_s: float = 0.01
    travel: float = 1.0
    spin_rad: float = 0.0

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse values without a name: `ArgumentError`."""
        refuse_positional("ts.Shapes", values, "ts.Shapes(n=1000), or corners=, size_mm=, kinds=")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        self._whole("n", self.n, 1, 2**62)
        self._whole("frames", self.frames, 1, 2**31)
        for name, least, most in (("corners", 3, SHAPE_CORNERS), ("objects", 0, SHAPE_OBJECTS)):
            for value in self._pair(name):
                self._whole(name, value, least, most)
        for name in ("size_mm", "aspect", "turn_rad", "x_mm", "y_mm"):
            if getattr(self, name) is not None:
                self._pair(name)
        narrow, round_ = self._pair("aspect")
        limits: tuple[tuple[str, bool, str], ...] = (
            ("size_mm", self.size_mm is None or self._pair("size_mm")[0] > 0.0, "must be above 0"),
            ("aspect", narrow > 0.0 and round_ <= 1.0, "must be above 0 to 1"),
            ("irregularity", _within(self.irregularity, 1.0), "must be 0 to 1"),
            ("gap_mm", self.gap_mm is None or _within(self.gap_mm), "must be 0 or more"),
            ("period_s", _within(self.period_s) and self.period_s > 0.0, "must be above 0"),
            ("travel", _within(self.travel, 1.0), "must be 0 to 1"),
            ("spin_rad", _within(self.spin_rad), "must be 0 or more"),
            ("apart", isinstance(self.apart, bool), "must be True or False"),
        )
        for name, good, advice in limits:
            if not good:
                raise OptionError(f"{name} = {getattr(self, name)!r}: {advice}")
        if self.x_mm is not None and self.apart and self._pair("objects")[1] > 1:
            raise OptionError(
                f"x_mm = {self.x_mm}: several objects apart are spread over the whole sensor; give apart=False too"
            )
        _ = self.shares

    @property
    def shares(self) -> dict[str, float]:
        """How often each kind comes; the sum is 1."""
        given = {self.kinds: 1.0} if isinstance(self.kinds, str) else self.kinds
        if not isinstance(given, Mapping) or not given:
            raise OptionError(
                f'kinds = {given!r}: give a kind, or how often each comes: {{"polygon": 0.8, "circle": 0.2}}'
            )
        for name, share in given.items():
            if name not in DRAWN:
                raise OptionError(one_of("kind", name, DRAWN))
            if not _within(share):
                raise OptionError(f"kinds: the share of {name} is {share!r}; give 0 or more")
        if not (total := sum(given.values())) > 0.0:
            raise OptionError("kinds: all shares are 0")
        return {name: share / total for name, share in given.items()}

    @property
    def scenes(self) -> int:
        """Number of scenes, each of `frames` scans."""
        return -(-self.n // self.frames)

    def laws(self, sensor: Sensor) -> ShapeLaws:
        """Return the distributions on a sensor, as the core takes them.

        Raises
        ------
        ContactError
            The sensor has no room for such objects.
        """
        objects, corners = self._pair("objects"), self._pair("corners")
        gap = 2.0 * sensor.pitch_mm if self.gap_mm is None else self.gap_mm
        lanes = max(objects[1], 1) if self.apart else 1
        room = min((sensor.width_mm - (lanes - 1) * gap) / lanes, sensor.length_mm)
        size = tuple(share * room for share in _SIZES) if self.size_mm is None else self._pair("size_mm")
        if not size[1] <= room:
            several = f" for {lanes} objects side by side, {gap:.6g} mm apart," if lanes > 1 else ""
            raise ContactError(
                f"size_mm up to {size[1]:.6g}: the sensor ({sensor.width_mm:.6g} mm across, {sensor.length_mm:.6g} mm "
                f"along){several} has room for {max(room, 0.0):.6g}; give smaller objects, or fewer; all "
                "lengths are millimetres"
            )
        places = []
        for name, extent in (("x_mm", sensor.width_mm), ("y_mm", sensor.length_mm)):
            low, high = (0.0, extent) if getattr(self, name) is None else self._pair(name)
            if low > extent - 0.5 * size[1] or high < 0.5 * size[1]:
                raise ContactError(
                    f"{name} = {getattr(self, name)}: an object of {size[1]:.6g} mm lies wholly on the sensor with its "
                    f"centre from {0.5 * size[1]:.6g} to {extent - 0.5 * size[1]:.6g} mm only"
                )
            places.append((low, high))
        share = self.shares
        polygons = share.get("polygon", 0.0)
        round_ = 1.0 if "ellipse" not in share else polygons + share.get("circle", 0.0)
        return ShapeLaws(
            1.0 if polygons == round_ == 1.0 else polygons, round_, corners, objects, self.frames, self.apart, size,
            self._pair("aspect"), self._pair("turn_rad"), *places, self.irregularity, gap, self.travel, self.spin_rad,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return what was given, for a file: tuples as lists."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items() if v is not None}

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any]) -> Self:
        """Make it from a table of a study file; errors as of the class, and `OptionError` for an unknown key."""
        known = [field.name for field in fields(cls)]
        if unknown := [key for key in raw if key not in known]:
            raise OptionError(f"unknown key {unknown[0]!r} in [shapes]; the keys are: {', '.join(known)}")
        values: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in raw.items()}
        if "n" not in values:
            raise OptionError("n is missing: the number of scans")
        return cls(**values)

    def _pair(self, name: str) -> tuple[Any, Any]:
        value = getattr(self, name)
        pair = tuple(value) if isinstance(value, tuple | list) else (value, value)
        if len(pair) != 2 or not all(_number(v) for v in pair) or not pair[0] <= pair[1]:
            raise OptionError(f"{name} = {value!r}: give a number, or two, the least and the greatest")
        return pair[0], pair[1]

    def _whole(self, name: str, value: Any, least: int, most: int) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            limit = f"{least} to {most}" if most < 2**31 else f"{least} or more"
            raise OptionError(f"{name} = {value!r}: must be a whole number, {limit}")


def _within(value: Any, most: float = math.inf) -> bool:
    return _number(value) and 0.0 <= value <= most


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)

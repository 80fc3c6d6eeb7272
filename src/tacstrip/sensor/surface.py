"""The `[surface]` table of a spec: a skin that is a surface of revolution or a bent sheet, and its strips' resistance.

The surface's meridian is a curve (r, z) of its arc t [mm]: an arc of a circle, or straight pieces. Strips lie along
meridians, from one end of it to the other, or round along parallels. With b(y) a strip's width, its resistance from
the grounded end is R(y), the integral of dy / b; s = R(y) / R(L) is what the closed forms know of y. A sheet is a plane
curve, its path, drawn along z: it only bends, so that its strips are even.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np

from tacstrip.arguments import refuse_positional
from tacstrip.arrays import FloatArray
from tacstrip.errors import SpecError, one_of

_EVEN = 1e-9  # slope of a radius that is no slope
_FAR = 1e6  # mm: no skin is so large, and none so small as 1 / it
_ROUND = ("sphere", "cylinder", "cone", "revolution")
_ALONG = {"sheet": ("path", "extrusion")}  # of kinds; of others:
_ALONG_ROUND = ("meridians", "parallels")
_OF_POINTS = ("profile_mm", "path_mm")
_PER_PIECE = 64  # points of a path's curve between two that are given
# Keys of the table, with the comment beside them, and the kinds that have them; none: all.
KEYS: dict[str, tuple[str, tuple[str, ...]]] = {
    "kind": ("sphere, cylinder, cone, revolution: of a profile, or sheet: bent along a path", ()),
    "along": ("strips lie along meridians or parallels; of a sheet along its path, or extrusion: along z", ()),
    "radius_mm": (
        "of the sphere or cylinder; of the cone at the strips' grounded end",
        ("sphere", "cylinder", "cone"),
    ),
    "tip_deg": ("from the sphere's pole to where the strips begin, grounded", ("sphere",)),
    "rim_deg": ("from the sphere's pole to where they end", ("sphere",)),
    "end_radius_mm": ("of the cone at the strips' other end", ("cone",)),
    "height_mm": ("of cone, cylinder or sheet, along z", ("cylinder", "cone", "sheet")),
    "path_mm": ("[[x, y], ...], a smooth path through them; from above its skin is on the right", ("sheet",)),
    "profile_mm": ("[[r, z], ...], straight in between, from the grounded end", ("revolution",)),
    "around_deg": ("how far the strips reach round the axis", _ROUND),
    "inside": ("true: the skin is the inner side, of a sheet the left one", ()),
    "tapered": ("true: meridian strips are as wide as their share of the circumference; false: as wide everywhere",
                _ROUND),
    "thickness_mm": ("of the soft skin: nothing can sink in deeper", ()),
    "stiffness_n_per_mm3": ("of the skin as an elastic foundation: pressure over depth", ()),
}  # fmt: skip
_NEEDS = {
    "sphere": ("radius_mm",),
    "cylinder": ("radius_mm", "height_mm"),
    "cone": ("radius_mm", "end_radius_mm", "height_mm"),
    "revolution": ("profile_mm",),
    "sheet": ("path_mm", "height_mm"),
}
THICKNESS_MM, STIFFNESS = 3.0, 0.1  # of a skin whose spec says nothing: rubber of 0.3 MPa


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A surface of revolution about z, or a bent sheet, that strips cover; lengths [mm], angles [degrees].

    The pole of a sphere is up. Strip 0 begins at the x axis and the others follow anticlockwise; along parallels, strip
    0 is the one next to the meridian's grounded end, and every strip begins, grounded, at the x axis.

    Raises
    ------
    SpecError
        A key is missing, impossible, or does not belong to the kind of surface.

    Examples
    --------
    >>> fingertip = Surface(kind="sphere", radius_mm=10.0)
    >>> round(fingertip.meridian_mm, 4)
    13.6136
    """

    kind: Literal["sphere", "cylinder", "cone", "revolution", "sheet"]
    along: Literal["", "meridians", "parallels", "path", "extrusion"] = ""  # "": the first that the kind has
    radius_mm: float | None = None
    tip_deg: float = 12.0
    rim_deg: float = 90.0
    end_radius_mm: float | None = None
    height_mm: float | None = None
    profile_mm: tuple[tuple[float, float], ...] | None = None
    around_deg: float = 360.0
    inside: bool = False
    tapered: bool = True
    thickness_mm: float = THICKNESS_MM
    stiffness_n_per_mm3: float = STIFFNESS
    path_mm: tuple[tuple[float, float], ...] | None = None

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse values without a name: `ArgumentError`."""
        refuse_positional("Surface", values, 'Surface(kind="sphere", radius_mm=10.0)')
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if self.kind not in _NEEDS:
            raise SpecError(f"surface.{one_of('kind', self.kind, _NEEDS)}")
        ways = _ALONG.get(self.kind, _ALONG_ROUND)
        object.__setattr__(self, "along", self.along or ways[0])
        if self.along not in ways:
            raise SpecError(f"surface.{one_of('along', self.along, ways)}")
        for field in fields(self):
            value, kinds = getattr(self, field.name), KEYS[field.name][1]
            if kinds and self.kind not in kinds and value != field.default:
                raise SpecError(
                    f"surface.{field.name} does not belong to a {self.kind}, only to: {', '.join(kinds)}"
                )
            if field.name in _NEEDS[self.kind] and value is None:
                raise SpecError(f"surface.{field.name} is missing: a {self.kind} needs it")
            if field.name in ("inside", "tapered"):
                if not isinstance(value, bool):
                    raise SpecError(f"surface.{field.name} = {value!r}: must be true or false")
            elif (
                value is not None and isinstance(field.default, float | None) and field.name not in _OF_POINTS
            ):
                _positive(self, field.name)
        if self.profile_mm is not None:
            object.__setattr__(self, "profile_mm", _profile(self.profile_mm))
        if self.path_mm is not None:
            object.__setattr__(self, "path_mm", _points("path_mm", self.path_mm, "[x, y]"))
        _check(self)

    @classmethod
    def from_dict(cls, raw: Any) -> Self:
        """Make it from a spec file's `[surface]` table; `SpecError` where that cannot be."""
        if not isinstance(raw, Mapping):
            raise SpecError("surface: must be a table")
        if unknown := [key for key in raw if key not in KEYS]:
            raise SpecError(f"unknown key {unknown[0]!r} in [surface]; the keys are: {', '.join(KEYS)}")
        if "kind" not in raw:
            raise SpecError(f"surface.kind is missing; it is one of: {', '.join(_NEEDS)}")
        return cls(**raw)

    def to_toml(self) -> str:
        """Return the `[surface]` table of a spec file, with a comment per key."""
        lines = ["[surface]"]
        for key, (comment, kinds) in KEYS.items():
            if not kinds or self.kind in kinds:
                lines.append(f"{f'{key} = {json.dumps(getattr(self, key))}':<32} # {comment}")
        return "\n".join(lines) + "\n"

    @property
    def around(self) -> float:
        """Angle that the strips reach round the axis [rad]."""
        return math.radians(self.around_deg)

    @property
    def closed(self) -> bool:
        """Whether meridian strips go all round, so that the last lies beside the first."""
        return self.along == "meridians" and self.around_deg >= 360.0 - 1e-9

    @property
    def even(self) -> bool:
        """Whether strips are as wide everywhere."""
        return self.kind == "sheet" or not self.tapered

    @property
    def isometric(self) -> bool:
        """Whether it unrolls to a rectangle of even strips: a rigid outline is the same wherever it lies."""
        return self.kind in ("sheet", "cylinder")

    @cached_property
    def _curve(self) -> tuple[FloatArray, FloatArray]:
        """A sheet's path: arcs (K,) [mm], and x, y and the unit tangent there (K, 4)."""
        from scipy.interpolate import CubicSpline

        given = np.array(self.path_mm)
        chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(given, axis=0).T))])
        spline = CubicSpline(chord, given, bc_type="not-a-knot" if len(given) > 3 else "natural")
        at = np.interp(
            np.linspace(0, len(given) - 1, _PER_PIECE * (len(given) - 1) + 1), range(len(given)), chord
        )
        speed = np.hypot(*spline(at, 1).T)
        middle = np.hypot(*spline(0.5 * (at[1:] + at[:-1]), 1).T)
        arcs = np.cumsum(np.diff(at) / 6.0 * (speed[1:] + 4.0 * middle + speed[:-1]))  # by Simpson
        return np.concatenate([[0.0], arcs]), np.concatenate(
            [spline(at), spline(at, 1) / speed[:, None]], axis=1
        )

    @cached_property
    def path_length_mm(self) -> float:
        """Arc of a sheet's path [mm]."""
        return float(self._curve[0][-1])

    def path(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return x, y [mm] and the unit tangent (dx, dy) at arcs t [mm] of a sheet's path, straight beyond its ends."""
        arcs, curve = self._curve
        t = np.asarray(t, dtype=float)
        at = np.clip(np.searchsorted(arcs, t, side="right") - 1, 0, len(arcs) - 2)
        a, b, long = curve[at], curve[at + 1], (arcs[at + 1] - arcs[at])
        share = np.clip((t - arcs[at]) / long, 0.0, 1.0)
        beyond = (t - np.clip(t, 0.0, arcs[-1]))[..., None]
        # Hermite's cubic between two points of the curve.
        u, long = share[..., None], long[..., None]
        place = (1 + 2 * u) * (1 - u) ** 2 * a[..., :2] + u**2 * (3 - 2 * u) * b[..., :2]
        place = place + long * (u * (1 - u) ** 2 * a[..., 2:] + u**2 * (u - 1) * b[..., 2:])
        way = (1 - u) * a[..., 2:] + u * b[..., 2:]
        way = way / np.linalg.norm(way, axis=-1, keepdims=True)
        place = place + beyond * way
        return place[..., 0], place[..., 1], way[..., 0], way[..., 1]

    @cached_property
    def _pieces(self) -> FloatArray:
        """Ends (K, 2) [mm] of a meridian's straight pieces, r and z."""
        if self.kind == "revolution":
            return np.array(self.profile_mm)
        assert self.radius_mm is not None
        end = self.end_radius_mm if self.kind == "cone" else self.radius_mm
        return np.array([(self.radius_mm, 0.0), (end, self.height_mm or 0.0)])

    @cached_property
    def _arcs(self) -> FloatArray:
        """Arc [mm] at the ends of the straight pieces (K,)."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self._pieces, axis=0).T))])

    @cached_property
    def meridian_mm(self) -> float:
        """Arc of the meridian that strips cover [mm]; of a sheet its strips' length."""
        if self.kind == "sheet":
            return self.path_length_mm if self.along == "path" else float(self.height_mm or 0.0)
        if self.kind == "sphere":
            return float(self.radius_mm or 0.0) * math.radians(self.rim_deg - self.tip_deg)
        return float(self._arcs[-1])

    @cached_property
    def lead_mm(self) -> float:
        """Arc of the meridian from its pole to the strips [mm]: skin without strips; 0 where it has no pole."""
        return float(self.radius_mm or 0.0) * math.radians(self.tip_deg) if self.kind == "sphere" else 0.0

    def meridian(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return r, z [mm] and the unit tangent (dr, dz) at arcs t [mm], 0 where the strips begin."""
        t = np.asarray(t, dtype=float)
        if self.kind == "sphere":
            radius = float(self.radius_mm or 1.0)
            polar = math.radians(self.tip_deg) + t / radius
            sin, cos = np.sin(polar), np.cos(polar)
            return radius * sin, radius * cos, cos, -sin
        at = np.searchsorted(self._arcs[1:-1], t, side="right")
        (dr, dz), (r, z) = self._tangents.T[:, at], self._pieces.T[:, at]
        after = t - self._arcs[at]
        return r + after * dr, z + after * dz, dr, dz

    @cached_property
    def _tangents(self) -> FloatArray:
        return np.asarray(np.diff(self._pieces, axis=0) / np.diff(self._arcs)[:, None])

    @cached_property
    def outward(self) -> float:
        """Sign of the normal (-dz, dr) that points off the skin, the way objects come from."""
        rises = self.kind != "sphere" and self._pieces[-1, 1] > self._pieces[0, 1]
        return -1.0 if rises != self.inside else 1.0

    def lengths_mm(self, strips: int) -> FloatArray:
        """Return every strip's length (strips,) [mm]."""
        if self.along != "parallels":
            return np.full(strips, self.meridian_mm)
        return np.asarray(self.meridian(self.parallels_mm(strips))[0] * self.around)

    def parallels_mm(self, strips: int) -> FloatArray:
        """Return the arcs of the meridian [mm] at which strips along parallels have their centre lines (strips,)."""
        return np.asarray((np.arange(strips) + 0.5) * self.meridian_mm / strips)

    def length_mm(self, strips: int) -> float:
        """Return the length of a strip, of parallels the longest one [mm]."""
        return float(self.lengths_mm(strips).max())

    def pitch_mm(self, strips: int) -> float:
        """Return the distance from centre line to centre line [mm]; of meridians where they are widest apart."""
        if self.kind == "sheet":
            return (float(self.height_mm or 0.0) if self.along == "path" else self.path_length_mm) / strips
        if self.along == "parallels":
            return self.meridian_mm / strips
        return self._radii[1] * self.around / strips

    @cached_property
    def _radii(self) -> tuple[float, float]:
        """Least and greatest radius of the meridian [mm]."""
        if self.kind != "sphere":
            return float(self._pieces[:, 0].min()), float(self._pieces[:, 0].max())
        tip, rim = math.radians(self.tip_deg), math.radians(self.rim_deg)
        greatest = 1.0 if tip <= 0.5 * math.pi <= rim else max(math.sin(tip), math.sin(rim))
        return min(math.sin(tip), math.sin(rim)) * (r := float(self.radius_mm or 0.0)), greatest * r

    def check_strips(self, strips: int, pitch_mm: float, length_mm: float, strip_width_mm: float) -> None:
        """Refuse strips that do not fit on it: `SpecError`."""
        for key, given, right in (
            ("pitch_mm", pitch_mm, self.pitch_mm(strips)),
            ("length_mm", length_mm, self.length_mm(strips)),
        ):
            if abs(given / right - 1.0) > 1e-3:
                raise SpecError(
                    f"{key} = {given}: on this surface {strips} strips have {right:.6g}; leave the key out, or mend "
                    "[surface]"
                )
        if self.along != "meridians" or self.tapered:
            return
        narrowest = self._radii[0] * self.around / strips
        if strip_width_mm > narrowest * (1.0 + 1e-9):
            raise SpecError(
                f"strips of {strip_width_mm:.4g} mm overlap where {strips} meridians come as near as {narrowest:.4g} "
                "mm: make them narrower (strip_width_mm), fewer, or surface.tapered = true"
            )

    @cached_property
    def resistance(self) -> float:
        """Integral of dy / r along the whole of a tapered meridian strip: its resistance but for a factor."""
        first, last = self._integral(np.array([0.0, self.meridian_mm]))
        return float(last - first)

    def accumulated_resistance(self, y: FloatArray) -> FloatArray:
        """Return s (0 to 1) at y [mm] along meridian strips; y and s of any shape."""
        y = np.asarray(y, dtype=float)
        if self.even:
            return np.asarray(y / self.meridian_mm)
        return np.asarray((self._integral(y) - self._integral(np.zeros(()))) / self.resistance)

    def accumulated_inverse(self, s: FloatArray) -> FloatArray:
        """Return y [mm] along meridian strips at s."""
        s = np.asarray(s, dtype=float)
        if self.even:
            return np.asarray(s * self.meridian_mm)
        f = self._integral(np.zeros(())) + s * self.resistance
        if self.kind == "sphere":
            radius = float(self.radius_mm or 1.0)
            return np.asarray(radius * (2.0 * np.arctan(np.exp(f)) - math.radians(self.tip_deg)))
        at = np.clip(np.searchsorted(self._integrals, f, side="right") - 1, 0, len(self._integrals) - 2)
        r, dr, f = self._pieces[at, 0], self._tangents[at, 0], f - self._integrals[at]
        even = np.abs(dr) < _EVEN
        slope = np.where(even, 1.0, dr)
        return np.asarray(self._arcs[at] + r * np.where(even, f, np.expm1(f * slope) / slope))

    @cached_property
    def _integrals(self) -> FloatArray:
        """Integral of dt / r at the ends of the straight pieces (K,)."""
        r, dr, long = self._pieces[:-1, 0], self._tangents[:, 0], np.diff(self._arcs)
        return np.concatenate([[0.0], np.cumsum(_over_radius(long, r, dr))])

    def _integral(self, t: FloatArray) -> FloatArray:
        """Return the integral of dt / r along the meridian, but for a constant."""
        if self.kind == "sphere":
            return np.asarray(
                np.log(np.tan(0.5 * (math.radians(self.tip_deg) + t / float(self.radius_mm or 1.0))))
            )
        at = np.searchsorted(self._arcs[1:-1], t, side="right")
        own = _over_radius(t - self._arcs[at], self._pieces[at, 0], self._tangents[at, 0])
        return np.asarray(self._integrals[at] + own)


def _over_radius(long: FloatArray, r: FloatArray, dr: FloatArray) -> FloatArray:
    """Return the integral of dt / (r + dr t) from 0 to `long`."""
    even = np.abs(dr) < _EVEN
    slope = np.where(even, 1.0, dr)
    return np.where(even, long / r, np.log1p(np.where(even, 0.0, long * slope / r)) / slope)


def _positive(s: Surface, key: str) -> None:
    value = getattr(s, key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise SpecError(f"surface.{key} = {value!r}: must be a number above 0")
    if not 1.0 / _FAR <= value <= _FAR:
        raise SpecError(f"surface.{key} = {value}: must be {1.0 / _FAR:g} to {_FAR:g}")
    object.__setattr__(s, key, float(value))


def _points(key: str, points: Any, form: str) -> tuple[tuple[float, float], ...]:
    try:
        found = tuple((float(a), float(b)) for a, b in points)
    except (TypeError, ValueError):
        raise SpecError(f"surface.{key}: give points, [{form}, {form}, ...]") from None
    if len(found) < 2 or not np.isfinite(found).all() or np.abs(found).max() > _FAR:
        raise SpecError(f"surface.{key}: needs two points {form} or more, of finite numbers to {_FAR:g}")
    if (np.hypot(*np.diff(np.array(found), axis=0).T) < 1e-9).any():
        raise SpecError(f"surface.{key}: two points after each other are the same")
    return found


def _profile(points: Any) -> tuple[tuple[float, float], ...]:
    found = _points("profile_mm", points, "[r, z]")
    for i, (r, _) in enumerate(found):
        if not 1.0 / _FAR <= r <= _FAR:
            raise SpecError(
                f"surface.profile_mm: r = {r:g} at point {i + 1}; strips need a radius above 0, where they have a width"
            )
    return found


def _check_sheet(s: Surface) -> None:
    import shapely

    arcs, curve = s._curve
    line = shapely.LineString(curve[:, :2])
    if not line.is_simple:
        raise SpecError(
            "surface.path_mm: the sheet crosses itself; give points in the order in which it passes them"
        )
    turn = np.diff(np.unwrap(np.arctan2(curve[:, 3], curve[:, 2]))) / np.diff(arcs)  # 1 / radius, to the left
    bent = float((-turn if s.inside else turn).max())  # towards the side under the skin
    if bent * s.thickness_mm >= 1.0:
        raise SpecError(
            f"surface.thickness_mm = {s.thickness_mm}: must be below the radius to which the sheet is bent, "
            f"{1.0 / bent:.3g} mm at the narrowest"
        )


def _check(s: Surface) -> None:
    if s.kind == "sheet":
        _check_sheet(s)
        return
    if s.around_deg > 360.0:
        raise SpecError(f"surface.around_deg = {s.around_deg}: must not exceed 360, or strips overlap")
    if s.along == "parallels" and s.around_deg > 359.0:
        raise SpecError(
            f"surface.around_deg = {s.around_deg}: strips along parallels have an end at Vref and one at ground, which "
            "must not touch: at most 359, such as 350"
        )
    if s.kind == "sphere" and not 0.0 < s.tip_deg < s.rim_deg < 180.0:
        raise SpecError(
            f"surface.tip_deg = {s.tip_deg}, rim_deg = {s.rim_deg}: must be 0 < tip_deg < rim_deg < 180, for strips "
            "have no width at a pole"
        )
    if s.inside and s.radius_mm is not None and s.thickness_mm > 100.0 * s.radius_mm:
        raise SpecError(f"surface.thickness_mm = {s.thickness_mm}: is it in millimetres?")
    if not s.inside and s.thickness_mm >= s._radii[1]:
        raise SpecError(
            f"surface.thickness_mm = {s.thickness_mm}: must be below the surface's radius, {s._radii[1]:g} mm"
        )

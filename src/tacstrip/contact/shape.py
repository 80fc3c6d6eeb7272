"""What touches the sensor: polygons, lines and points, several at once, placed, turned and dragged."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import FloatArray, numbers
from tacstrip.contact.parse_errors import why_not_geojson, why_not_wkt
from tacstrip.errors import ArgumentError, ContactError
from tacstrip.notebook import GREY, Drawn, SvgPath

_KINDS = {"Polygon": "polygon", "LineString": "line", "Point": "point"}
_FAR = 1e9  # mm; GEOS fails on numbers whose squares overflow


@dataclass(frozen=True)
class Contact(Drawn):
    """A set of closed shapes on the sensor's surface, in [mm]; y = 0 is the grounded end.

    Make one with `polygon`, `line`, `points`, `from_wkt` or `from_geojson`, and join several with `+`.

    Attributes
    ----------
    shapes
        Shapely polygons, line strings and points; none is empty, none crosses itself.

    Examples
    --------
    >>> Contact.polygon([(10, 20), (30, 20), (30, 50)]).centroid.round(3).tolist()
    [23.333, 30.0]
    """

    shapes: tuple[BaseGeometry, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.shapes, tuple) or not all(isinstance(s, BaseGeometry) for s in self.shapes):
            raise ArgumentError(
                "ts.Contact(...) takes a tuple of Shapely shapes; of coordinates write ts.Contact.polygon([(x, y), "
                "...]), .line or .points, of a file ts.read_contact(file)"
            )

    def __repr__(self) -> str:
        counts = Counter(_KINDS.get(s.geom_type, s.geom_type) for s in self.shapes)
        parts = [f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in counts.items()]
        if len(self.shapes) == 1 and counts["polygon"]:
            parts = [f"polygon of {len(shapely.get_exterior_ring(self.shapes[0]).coords) - 1} vertices"]
        x0, y0, x1, y1 = shapely.GeometryCollection(list(self.shapes)).bounds
        return f"<Contact: {', '.join(parts)}, x {x0:.4g} to {x1:.4g}, y {y0:.4g} to {y1:.4g} mm>"

    def _paths(self) -> list[SvgPath]:
        found = []
        for shape in self.shapes:
            area = shape.geom_type == "Polygon"
            parts = shapely.get_rings(shape) if area else [shape]
            rings = [np.vstack([shapely.get_coordinates(part), [(np.nan, np.nan)]]) for part in parts]
            found.append(SvgPath(np.concatenate(rings), stroke=GREY, fill=GREY if area else "none", closed=area,
                              width=1.5 if area else 4.0))  # fmt: skip
        return found

    @classmethod
    def polygon(cls, vertices: npt.ArrayLike, *, holes: Sequence[npt.ArrayLike] = ()) -> Self:
        """Make an area contact from its corners (N, 2) [mm], in either direction, closed or not.

        Raises
        ------
        ContactError
            Fewer than three corners, a number that is not finite, no area, or sides that cross.
        """
        shell = _coordinates(vertices, 3, "a polygon")
        return cls._checked([shapely.Polygon(shell, [_coordinates(h, 3, "a hole") for h in holes])])

    @classmethod
    def line(cls, path: npt.ArrayLike) -> Self:
        """Make a line contact from its points (N, 2) [mm], N at least 2."""
        return cls._checked([shapely.LineString(_coordinates(path, 2, "a line"))])

    @classmethod
    def points(cls, points: npt.ArrayLike) -> Self:
        """Make point contacts from (N, 2) [mm], or one from (2,)."""
        return cls._checked([shapely.Point(p) for p in _coordinates(points, 1, "points")])

    @classmethod
    def from_wkt(cls, text: str) -> Self:
        """Read well-known text: POLYGON, LINESTRING, POINT, their MULTI kinds and GEOMETRYCOLLECTION."""
        try:
            # GEOS reads hexadecimal numbers, if not on all systems.
            if re.search(r"\b[+-]?0x", text, re.IGNORECASE):
                raise ValueError
            with np.errstate(over="ignore", invalid="ignore"):  # 1e999 is infinite, and refused as that
                geometry = shapely.from_wkt(text)
        except (shapely.GEOSException, NotImplementedError, ValueError, TypeError):
            raise ContactError(why_not_wkt(str(text))) from None
        return cls._checked([geometry])

    @classmethod
    def from_geojson(cls, source: str | Mapping[str, Any]) -> Self:
        """Read GeoJSON, text or parsed: a geometry, a Feature or a FeatureCollection, in [mm]."""
        try:
            parsed = json.loads(source) if isinstance(source, str) else source
        except json.JSONDecodeError as error:
            raise ContactError(f"not JSON: {error}. Is the file complete?") from None
        except (ValueError, RecursionError):
            raise ContactError(
                "not GeoJSON: a number has thousands of digits, or lists are nested too deeply"
            ) from None
        try:
            geometry = shapely.from_geojson(json.dumps(parsed, allow_nan=False))
        except (shapely.GEOSException, ValueError, TypeError, RecursionError):
            raise ContactError(why_not_geojson(parsed)) from None
        return cls._checked([geometry])

    @classmethod
    def _checked(cls, geometries: Iterable[BaseGeometry]) -> Self:
        parts = [p for g in geometries for p in _parts(g)]
        if not parts:
            raise ContactError("the contact is empty: it needs at least one polygon, line or point")
        for number, part in enumerate(parts, start=1):
            name = f"shape {number} of {len(parts)}"
            if not np.all(np.abs(shapely.get_coordinates(part)) < _FAR):
                raise ContactError(f"{name} has a coordinate that is not a finite number below 1e9 mm")
            if part.geom_type == "Polygon" and shapely.convex_hull(part).area == 0.0:
                raise ContactError(f"{name} has no area; make it a line")
            if part.geom_type == "LineString" and part.length == 0.0:
                raise ContactError(f"{name} has no length; make it a point")
            if not shapely.is_valid(part):
                why = shapely.is_valid_reason(part)
                where = why.replace("Self-intersection", "crosses itself at ")
                fix = "list its corners in order round it" if where != why else "correct its rings there"
                raise ContactError(f"{name}: {where}; {fix}")
        return cls(tuple(parts))

    def __add__(self, other: Contact) -> Contact:
        return Contact(self.shapes + other.shapes)

    @property
    def vertices(self) -> FloatArray:
        """Corners (N, 2) [mm] of the only polygon, counter-clockwise, not closed.

        Raises
        ------
        ContactError
            The contact is not exactly one polygon.
        """
        if len(self.shapes) != 1 or self.shapes[0].geom_type != "Polygon":
            raise ContactError(f"the contact has {len(self.shapes)} shape(s) and is not exactly one polygon")
        ring = shapely.get_exterior_ring(self.shapes[0])
        corners: FloatArray = shapely.get_coordinates(ring)[:-1]
        return corners if shapely.is_ccw(ring) else corners[::-1]

    @property
    def centroid(self) -> FloatArray:
        """Centroid (2,) [mm] of all shapes together; of the areas alone where there are any."""
        point = shapely.centroid(shapely.GeometryCollection(list(self.shapes)))
        return np.array([point.x, point.y])

    def moved(self, dx_mm: float, dy_mm: float) -> Contact:
        """Return the contact moved by (dx, dy) [mm]."""
        return self._mapped(lambda xy: xy + np.array([dx_mm, dy_mm]))

    def placed(self, x_mm: float, y_mm: float) -> Contact:
        """Return the contact with its centroid at (x, y) [mm]."""
        dx, dy = np.array([x_mm, y_mm]) - self.centroid
        return self.moved(dx, dy)

    def turned(self, angle_rad: float, about: tuple[float, float] | None = None) -> Contact:
        """Return the contact turned counter-clockwise by an angle [rad], about its centroid by default."""
        if not np.isfinite(angle_rad):
            raise ContactError("a contact can be turned by a finite angle only")
        centre = self.centroid if about is None else np.asarray(about, dtype=float)
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        rotation = np.array([[c, s], [-s, c]])  # for row vectors
        return self._mapped(lambda xy: (xy - centre) @ rotation + centre)

    def dragged(self, path: npt.ArrayLike, steps: int, turn_rad: float = 0.0) -> list[Contact]:
        """Return the contact at `steps` places evenly spaced along a path, turning as it goes.

        Parameters
        ----------
        path
            Way points (M, 2) [mm] for the centroid, M at least 2.
        steps
            Number of places, both ends of the path included; 2 or more.
        turn_rad
            Turn from one place to the next, counter-clockwise [rad]; the first place is not turned.
        """
        line = shapely.LineString(_coordinates(path, 2, "a path"))
        if steps < 2:
            raise ContactError(f"steps = {steps}: dragging needs at least 2 places")
        stops = shapely.line_interpolate_point(line, np.linspace(0.0, line.length, steps))
        return [self.placed(p.x, p.y).turned(i * turn_rad) for i, p in enumerate(stops)]

    def clipped(self, width_mm: float, height_mm: float, surface: str) -> Contact:
        """Return what lies on a surface that spans x 0 to width and y 0 to height [mm].

        An area that only grazes the edge is off it.

        Raises
        ------
        ContactError
            All of it lies outside; `surface` is what the message calls it.
        """
        box = shapely.box(0.0, 0.0, width_mm, height_mm)
        inside = [
            part
            for shape in self.shapes
            for part in shapely.get_parts(shapely.intersection(shape, box))
            if not part.is_empty and (part.area > 0.0 or shape.area == 0.0)
        ]
        if not inside:
            x0, y0, x1, y1 = shapely.GeometryCollection(list(self.shapes)).bounds
            raise ContactError(
                f"the contact (x {x0:.6g} to {x1:.6g}, y {y0:.6g} to {y1:.6g} mm) lies outside the {surface} "
                f"(x 0 to {width_mm:.6g}, y 0 to {height_mm:.6g} mm); move it, or check its unit: mm"
            )
        return Contact(tuple(inside))

    def _mapped(self, change: Any) -> Contact:
        if not all(np.abs(change(shapely.get_coordinates(s))).max() < _FAR for s in self.shapes):
            raise ContactError("a contact can be moved or turned by finite numbers only, within 1e9 mm")
        return Contact(tuple(shapely.transform(shape, change) for shape in self.shapes))


def _parts(geometry: BaseGeometry) -> list[BaseGeometry]:
    """Take collections apart into polygons, line strings and points; drop empty ones and z."""
    if geometry is None or geometry.is_empty:
        return []
    if hasattr(geometry, "geoms"):
        return [p for g in geometry.geoms for p in _parts(g)]
    if geometry.geom_type == "LinearRing":
        geometry = shapely.LineString(geometry)
    return [shapely.force_2d(geometry)]


def _coordinates(values: npt.ArrayLike, least: int, what: str) -> FloatArray:
    try:
        array = numbers(values)
    except (TypeError, ValueError):
        raise ContactError(f"{what} needs numbers: a list of (x_mm, y_mm)") from None
    if array.shape == (2,):
        array = array[np.newaxis]
    if array.ndim != 2 or array.shape[1] != 2:
        raise ContactError(f"{what} needs a list of (x_mm, y_mm), not an array of shape {array.shape}")
    if not np.all(np.isfinite(array)):
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise ContactError(f"{what} has a coordinate that is not a finite number, at point {bad + 1}")
    if len(array) < least:
        raise ContactError(f"{what} needs at least {least} points, not {len(array)}")
    return array

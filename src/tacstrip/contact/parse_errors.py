"""Why a text is no contact, in plain words in place of the reading library's own."""

from __future__ import annotations

import math
import re
from typing import Any

from tacstrip.errors import is_number

_PLAIN = ("POINT", "LINESTRING", "POLYGON")
_WKT = (*_PLAIN, *(f"MULTI{kind}" for kind in _PLAIN), "GEOMETRYCOLLECTION")
_WKT_EXAMPLE = "POLYGON ((20 30, 70 25, 60 80, 20 30))"
_FEW = "a line needs two points or more, and a polygon's ring must end with its first point again"

# GeoJSON geometry: an example of its coordinates.
_COORDINATES = {
    "Point": "[20, 30]",
    "MultiPoint": "[[20, 30], [70, 25]]",
    "LineString": "[[20, 30], [70, 25]]",
    "MultiLineString": "[[[20, 30], [70, 25]]]",
    "Polygon": "[[[20, 30], [70, 25], [60, 80], [20, 30]]]",
    "MultiPolygon": "[[[[20, 30], [70, 25], [60, 80], [20, 30]]]]",
}
_HOLDERS = {"Feature": "geometry", "FeatureCollection": "features", "GeometryCollection": "geometries"}
_OTHER = "its geometry cannot be read"
_JSON_EXAMPLE = f'{{"type": "Polygon", "coordinates": {_COORDINATES["Polygon"]}}}'


def why_not_wkt(text: str) -> str:
    """Return what is wrong with a text that is not well-known text, and an example of one that is."""
    word = re.match(r"[^\s(]*", text.strip())
    begins = word.group() if word else ""
    if begins.upper() not in _WKT:
        why = f"it begins with {begins!r:.20}, and must with one of {', '.join(_WKT)}"
    elif text.count("(") != text.count(")"):
        why = f"{text.count('(')} brackets open and {text.count(')')} close, so it is not complete"
    elif _unfinished(text):
        why = _FEW
    else:
        why = (
            "a point is two numbers with a space between, points have a comma between, a polygon has two pairs of "
            "brackets, and nothing follows the last bracket"
        )
    return f"not well-known text: {why}. A right one: {_WKT_EXAMPLE}"


def why_not_geojson(parsed: Any) -> str:
    """Return what is wrong with parsed JSON that is not GeoJSON, and an example of what is."""
    try:
        why = _fault(parsed) or _OTHER
    except RecursionError:
        why = "it is nested too deeply"
    return f"not GeoJSON: {why}. A right one: {_JSON_EXAMPLE}"


def _unfinished(text: str) -> bool:
    """Whether all points are good and a ring is not closed, or a line has one point only."""
    rings = [[p.split() for p in ring.split(",")] for ring in re.findall(r"\(([^()]*)\)", text)]
    good = all(len(p) > 1 and all(map(is_number, p)) for ring in rings for p in ring)
    if "POLYGON" in text.upper():
        return good and "((" in text.replace(" ", "") and any(ring[0] != ring[-1] for ring in rings)
    return good and "LINESTRING" in text.upper() and any(len(ring) < 2 for ring in rings)


def _fault(parsed: Any) -> str:
    """Go down to the geometry that is wrong and say what is; nothing where all seems right."""
    kinds = [*_COORDINATES, *_HOLDERS]
    if not isinstance(parsed, dict):
        return f'an object {{"type": ...}} is needed, and this is {_what(parsed)}'
    kind = parsed.get("type")
    if kind not in kinds:
        found = f'its "type" is {kind!r:.20}' if "type" in parsed else 'it has no "type"'
        return f"{found}; the types are: {', '.join(kinds)}"
    key = _HOLDERS.get(kind, "coordinates")
    if key not in parsed:
        return f'a {kind} needs "{key}"'
    inside = parsed[key]
    if kind == "Feature":
        return _fault(inside)
    if kind in _HOLDERS:
        if not isinstance(inside, list):
            return f'"{key}" of a {kind} must be a list, not {_what(inside)}'
        for part in inside:
            if kind == "FeatureCollection" and (not isinstance(part, dict) or part.get("type") != "Feature"):
                return '"features" must hold Features: {"type": "Feature", "geometry": ...}'
            if deeper := _fault(part):
                return deeper
        return ""
    example = _COORDINATES[kind]
    if not _nested(inside, len(example) - len(example.lstrip("["))):
        return f'"coordinates" of a {kind} are numbers nested as in {example}'
    if not _finite(inside):
        return "a coordinate is not a finite number"
    rings = inside if kind == "Polygon" else [r for p in inside for r in p] if kind == "MultiPolygon" else []
    lines = [inside] if kind == "LineString" else inside if kind == "MultiLineString" else []
    few = any(len(line) < 2 for line in lines) or any(len(r) < 4 or r[0] != r[-1] for r in rings)
    return _FEW if few else ""


def _nested(values: Any, depth: int) -> bool:
    """Whether values are lists in lists, so deep, of points of two or three numbers."""
    if not isinstance(values, list):
        return False
    if depth > 1:
        return all(_nested(v, depth - 1) for v in values)
    return len(values) in (2, 3) and all(type(v) in (int, float) for v in values)


def _finite(values: Any) -> bool:
    return all(map(_finite, values)) if isinstance(values, list) else abs(values) < math.inf


def _what(value: Any) -> str:
    names = {list: "a list", str: "a text", bool: "true or false", type(None): "null"}
    return names.get(type(value), "a number" if isinstance(value, int | float) else type(value).__name__)

"""Contacts: from corners, WKT and GeoJSON, placed, turned and dragged; and what each refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import FIXED, areas, texts
from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError

RECTANGLE = [(10.0, 20.0), (50.0, 20.0), (50.0, 40.0), (10.0, 40.0)]
HOLE = [(20.0, 25.0), (30.0, 25.0), (30.0, 35.0), (20.0, 35.0)]


def rotated(xy: FloatArray, angle: float, about: npt.ArrayLike) -> FloatArray:
    x, y = (xy - np.asarray(about)).T
    z = (x + 1.0j * y) * np.exp(1.0j * angle)
    return np.asarray(np.stack((z.real, z.imag), axis=1) + about, dtype=float)


def kinds(contact: Contact) -> list[str]:
    return [shape.geom_type for shape in contact.shapes]


# Making.


def test_a_polygon_is_counter_clockwise_from_either_direction_closed_or_not() -> None:
    for corners in (RECTANGLE, RECTANGLE[::-1], [*RECTANGLE, RECTANGLE[0]], np.array(RECTANGLE)):
        vertices = Contact.polygon(corners).vertices
        assert vertices.shape == (4, 2)
        assert {tuple(v) for v in vertices} == set(RECTANGLE)
        x, y = vertices.T
        assert 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() == 800.0  # 40 x 20, and above 0


def test_a_hole_takes_its_area_away() -> None:
    contact = Contact.polygon(RECTANGLE, holes=[HOLE])
    assert contact.shapes[0].area == 800.0 - 100.0
    np.testing.assert_allclose(contact.centroid, (30.0 + 5.0 * 100.0 / 700.0, 30.0), rtol=1e-14)


def test_lines_and_points() -> None:
    line = Contact.line([(0.0, 0.0), (3.0, 4.0), (3.0, 9.0)])
    assert (kinds(line), line.shapes[0].length) == (["LineString"], 10.0)
    points = Contact.points([(1.0, 2.0), (5.0, 6.0)])
    assert kinds(points) == ["Point", "Point"]
    np.testing.assert_array_equal(points.centroid, (3.0, 4.0))
    np.testing.assert_array_equal(Contact.points((1.0, 2.0)).centroid, (1.0, 2.0))


def test_adding_joins_and_leaves_both_as_they_were() -> None:
    a, b = Contact.polygon(RECTANGLE), Contact.points([(1.0, 2.0), (3.0, 4.0)])
    both = a + b
    assert both.shapes == a.shapes + b.shapes
    assert (len(a.shapes), len(b.shapes)) == (1, 2)
    np.testing.assert_array_equal(both.centroid, (30.0, 30.0))  # the area's alone


def test_only_one_polygon_has_vertices() -> None:
    for contact in (Contact.polygon(RECTANGLE) + Contact.polygon(HOLE), Contact.line(RECTANGLE)):
        with pytest.raises(ContactError) as caught:
            _ = contact.vertices
        count = len(contact.shapes)
        assert str(caught.value) == f"the contact has {count} shape(s) and is not exactly one polygon"


# WKT and GeoJSON.


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("POINT (1 2)", ["POINT (1 2)"]),
        ("POINT Z (1 2 3)", ["POINT (1 2)"]),
        ("POINT M (1 2 3)", ["POINT (1 2)"]),
        ("MULTIPOINT ((1 2), (3 4))", ["POINT (1 2)", "POINT (3 4)"]),
        ("LINESTRING (0 0, 1 1)", ["LINESTRING (0 0, 1 1)"]),
        ("LINESTRING ZM (0 0 1 1, 1 1 1 1)", ["LINESTRING (0 0, 1 1)"]),
        ("LINEARRING (0 0, 1 0, 1 1, 0 0)", ["LINESTRING (0 0, 1 0, 1 1, 0 0)"]),
        ("MULTILINESTRING ((0 0, 1 1), (2 2, 3 3))", ["LINESTRING (0 0, 1 1)", "LINESTRING (2 2, 3 3)"]),
        ("POLYGON Z ((0 0 1, 1 0 2, 1 1 3, 0 0 1))", ["POLYGON ((0 0, 1 0, 1 1, 0 0))"]),
        (
            "MULTIPOLYGON (((0 0, 2 0, 2 2, 0 0)), ((1 1, 3 1, 3 3, 1 1)))",  # may overlap
            ["POLYGON ((0 0, 2 0, 2 2, 0 0))", "POLYGON ((1 1, 3 1, 3 3, 1 1))"],
        ),
        (
            "GEOMETRYCOLLECTION (POINT (1 2), POLYGON EMPTY, GEOMETRYCOLLECTION (LINESTRING (0 0, 1 1)))",
            ["POINT (1 2)", "LINESTRING (0 0, 1 1)"],
        ),
    ],
)
def test_wkt_is_taken_apart(text: str, expected: list[str]) -> None:
    contact = Contact.from_wkt(text)
    assert [shapely.to_wkt(shape, trim=True) for shape in contact.shapes] == expected


TRIANGLE: dict[str, Any] = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}
POINT_3D: dict[str, Any] = {"type": "Point", "coordinates": [1, 2, 3]}
TWO_LINES: dict[str, Any] = {"type": "MultiLineString", "coordinates": [[[0, 0], [1, 1]], [[2, 2], [3, 3]]]}


def feature(geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": {"name": "any"}, "geometry": geometry}


@pytest.mark.parametrize("as_text", [True, False])
@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (TRIANGLE, ["POLYGON ((0 0, 1 0, 1 1, 0 0))"]),
        (POINT_3D, ["POINT (1 2)"]),
        (feature(TRIANGLE), ["POLYGON ((0 0, 1 0, 1 1, 0 0))"]),
        (TWO_LINES, ["LINESTRING (0 0, 1 1)", "LINESTRING (2 2, 3 3)"]),
        ({"type": "MultiPoint", "coordinates": [[1, 2], [3, 4]]}, ["POINT (1 2)", "POINT (3 4)"]),
        (
            {"type": "MultiPolygon", "coordinates": [TRIANGLE["coordinates"]] * 2},
            ["POLYGON ((0 0, 1 0, 1 1, 0 0))"] * 2,
        ),
        (
            {"type": "FeatureCollection", "features": [feature(POINT_3D), feature(TWO_LINES)]},
            ["POINT (1 2)", "LINESTRING (0 0, 1 1)", "LINESTRING (2 2, 3 3)"],
        ),
        (
            {"type": "GeometryCollection", "geometries": [POINT_3D, TRIANGLE]},
            ["POINT (1 2)", "POLYGON ((0 0, 1 0, 1 1, 0 0))"],
        ),
    ],
)
def test_geojson_is_taken_apart(source: dict[str, Any], expected: list[str], as_text: bool) -> None:
    contact = Contact.from_geojson(json.dumps(source) if as_text else source)
    assert [shapely.to_wkt(shape, trim=True) for shape in contact.shapes] == expected


@settings(FIXED, max_examples=25)
@given(areas((-50.0, -50.0, 50.0, 50.0)))
def test_shapely_s_own_text_is_read_back(contact: Contact) -> None:
    whole = shapely.GeometryCollection(list(contact.shapes))
    for again in (Contact.from_wkt(shapely.to_wkt(whole)), Contact.from_geojson(shapely.to_geojson(whole))):
        for before, after in zip(contact.shapes, again.shapes, strict=True):
            assert after.equals_exact(before, tolerance=1e-5)  # WKT is written with six decimals


# Placing, turning, dragging.


def test_moving_keeps_the_shape() -> None:
    moved = (Contact.polygon(RECTANGLE, holes=[HOLE]) + Contact.points((1.0, 1.0))).moved(5.0, -7.0)
    expected = Contact.polygon(np.add(RECTANGLE, (5.0, -7.0)), holes=[np.add(HOLE, (5.0, -7.0))])
    assert moved == expected + Contact.points((6.0, -6.0))


@settings(FIXED, max_examples=25)
@given(areas((-50.0, -50.0, 50.0, 50.0)), st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
def test_placing_puts_the_centroid_there(contact: Contact, x: float, y: float) -> None:
    placed = contact.placed(x, y)
    np.testing.assert_allclose(placed.centroid, (x, y), atol=1e-9)
    shift = placed.centroid - contact.centroid
    for before, after in zip(contact.shapes, placed.shapes, strict=True):
        before_xy, after_xy = shapely.get_coordinates(before), shapely.get_coordinates(after)
        np.testing.assert_allclose(after_xy - before_xy, np.broadcast_to(shift, before_xy.shape), atol=1e-9)


def test_a_quarter_turn_is_counter_clockwise() -> None:
    turned = Contact.points([(3.0, 1.0), (1.0, 1.0)]).turned(np.pi / 2, about=(1.0, 1.0))
    np.testing.assert_allclose(shapely.get_coordinates(turned.shapes), [(1.0, 3.0), (1.0, 1.0)], atol=1e-15)


@settings(FIXED, max_examples=25)
@given(areas((-50.0, -50.0, 50.0, 50.0)), st.floats(-7.0, 7.0))
def test_turning_is_about_the_centroid(contact: Contact, angle: float) -> None:
    turned = contact.turned(angle)
    np.testing.assert_allclose(turned.centroid, contact.centroid, atol=1e-9)
    for before, after in zip(contact.shapes, turned.shapes, strict=True):
        expected = rotated(shapely.get_coordinates(before), angle, contact.centroid)
        np.testing.assert_allclose(shapely.get_coordinates(after), expected, atol=1e-9)


def test_dragging_along_a_bent_path() -> None:
    contact = Contact.polygon(RECTANGLE)
    places = contact.dragged([(0.0, 0.0), (30.0, 0.0), (30.0, 40.0)], steps=8, turn_rad=0.3)
    expected = [(0, 0), (10, 0), (20, 0), (30, 0), (30, 10), (30, 20), (30, 30), (30, 40)]  # 10 mm each
    np.testing.assert_allclose([place.centroid for place in places], expected, atol=1e-12)
    about = np.asarray(contact.vertices) - contact.centroid
    for step, (place, centre) in enumerate(zip(places, expected, strict=True)):
        np.testing.assert_allclose(place.vertices, rotated(about, 0.3 * step, (0, 0)) + centre, atol=1e-12)


@pytest.mark.parametrize(
    ("drag", "message"),
    [
        (lambda c: c.dragged([(0, 0), (1, 1)], 1), "steps = 1: dragging needs at least 2 places"),
        (lambda c: c.dragged([(0, 0)], 5), "a path needs at least 2 points, not 1"),
        (
            lambda c: c.dragged([(0, 0), (np.nan, 1)], 5),
            "a path has a coordinate that is not a finite number, at point 2",
        ),
    ],
)
def test_impossible_drags(drag: Callable[[Contact], object], message: str) -> None:
    with pytest.raises(ContactError) as caught:
        drag(Contact.polygon(RECTANGLE))
    assert str(caught.value) == message


# What is refused.

WKT_HELP = ". A right one: POLYGON ((20 30, 70 25, 60 80, 20 30))"
GEOJSON_HELP = '. A right one: {"type": "Polygon", "coordinates": [[[20, 30], [70, 25], [60, 80], [20, 30]]]}'
NOT_CLOSED = "a line needs two points or more, and a polygon's ring must end with its first point again"
WKT_KINDS = "POINT, LINESTRING, POLYGON, MULTIPOINT, MULTILINESTRING, MULTIPOLYGON, GEOMETRYCOLLECTION"
KINDS = (
    "Point, MultiPoint, LineString, MultiLineString, Polygon, MultiPolygon, Feature, FeatureCollection, "
    "GeometryCollection"
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Contact.polygon([(0, 0), (2, 2), (2, 0), (0, 2)]),
            "shape 1 of 1: crosses itself at [1 1]; list its corners in order round it",
        ),
        (
            lambda: Contact.polygon([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)]),
            "shape 1 of 1: Ring crosses itself at [2 0]; list its corners in order round it",
        ),
        (
            lambda: Contact.polygon(RECTANGLE, holes=[np.add(HOLE, 100.0)]),
            "shape 1 of 1: Hole lies outside shell[120 125]; correct its rings there",
        ),
        (lambda: Contact.polygon([(0, 0), (1, 0)]), "a polygon needs at least 3 points, not 2"),
        (lambda: Contact.polygon(RECTANGLE, holes=[[(0, 0)]]), "a hole needs at least 3 points, not 1"),
        (lambda: Contact.polygon([(0, 0), (1, 0), (3, 0)]), "shape 1 of 1 has no area; make it a line"),
        (lambda: Contact.polygon([(5, 5)] * 3), "shape 1 of 1 has no area; make it a line"),
        (
            lambda: Contact.polygon([(0, 0), (1, 0), (1, np.inf), (np.nan, 1)]),
            "a polygon has a coordinate that is not a finite number, at point 3",
        ),
        (
            lambda: Contact.polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)]),
            "a polygon needs a list of (x_mm, y_mm), not an array of shape (3, 3)",
        ),
        (
            lambda: Contact.polygon([]),
            "a polygon needs a list of (x_mm, y_mm), not an array of shape (0,)",
        ),
        (lambda: Contact.polygon("POLYGON"), "a polygon needs numbers: a list of (x_mm, y_mm)"),
        (lambda: Contact.line([(0, 0)]), "a line needs at least 2 points, not 1"),
        (lambda: Contact.line((0, 0)), "a line needs at least 2 points, not 1"),
        (lambda: Contact.line([(3, 4), (3, 4)]), "shape 1 of 1 has no length; make it a point"),
        (
            lambda: Contact.polygon([(1e300, 0), (-1e300, 1), (0, 1e300)]),
            "shape 1 of 1 has a coordinate that is not a finite number below 1e9 mm",
        ),
        (lambda: Contact.points([(1, 2), (3,)]), "points needs numbers: a list of (x_mm, y_mm)"),
        (
            lambda: Contact.points([(1, 2), (-np.inf, 3)]),
            "points has a coordinate that is not a finite number, at point 2",
        ),
        (lambda: Contact.points([]), "points needs a list of (x_mm, y_mm), not an array of shape (0,)"),
    ],
)  # fmt: skip
def test_impossible_corners(make: Callable[[], Contact], message: str) -> None:
    with pytest.raises(ContactError) as caught:
        make()
    assert str(caught.value) == message


EMPTY = "the contact is empty: it needs at least one polygon, line or point"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("POLYGON EMPTY", EMPTY),
        ("GEOMETRYCOLLECTION (POINT EMPTY)", EMPTY),
        (
            "POLYGON ((0 0, 1 0, 1 1",
            f"not well-known text: 2 brackets open and 0 close, so it is not complete{WKT_HELP}",
        ),
        ("", f"not well-known text: it begins with '', and must with one of {WKT_KINDS}{WKT_HELP}"),
        ("POLYGON ((0 0, 1 0, 1 1))", f"not well-known text: {NOT_CLOSED}{WKT_HELP}"),
        (
            "POINT (0x10 5)",
            "not well-known text: a point is two numbers with a space between, points have a comma between, a polygon "
            f"has two pairs of brackets, and nothing follows the last bracket{WKT_HELP}",
        ),
        (
            "RECTANGLE (0 0, 1 1)",
            f"not well-known text: it begins with 'RECTANGLE', and must with one of {WKT_KINDS}{WKT_HELP}",
        ),
        (
            "CIRCULARSTRING (0 0, 1 1, 2 0)",
            f"not well-known text: it begins with 'CIRCULARSTRING', and must with one of {WKT_KINDS}{WKT_HELP}",
        ),
        (
            "MULTIPOINT ((1 1), (nan nan))",
            "shape 2 of 2 has a coordinate that is not a finite number below 1e9 mm",
        ),
        (
            "LINESTRING (0 0, 1e999 1)",
            "shape 1 of 1 has a coordinate that is not a finite number below 1e9 mm",
        ),
        (
            "MULTIPOLYGON (((0 0, 1 0, 1 1, 0 0)), ((0 0, 2 2, 2 0, 0 2, 0 0)))",
            "shape 2 of 2: crosses itself at [1 1]; list its corners in order round it",
        ),
    ],
)
def test_impossible_wkt(text: str, message: str) -> None:
    with pytest.raises(ContactError) as caught:
        Contact.from_wkt(text)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            '{"type": "Point", "coordinates": [1, ',
            "not JSON: Expecting value: line 1 column 38 (char 37). Is the file complete?",
        ),
        ("", "not JSON: Expecting value: line 1 column 1 (char 0). Is the file complete?"),
        ("POINT (1 2)", "not JSON: Expecting value: line 1 column 1 (char 0). Is the file complete?"),
        ('{"type": "FeatureCollection", "features": []}', EMPTY),
        ('{"type": "Point", "coordinates": []}', EMPTY),
        (
            '{"type": "Topology"}',
            f"""not GeoJSON: its "type" is 'Topology'; the types are: {KINDS}{GEOJSON_HELP}""",
        ),
        (
            '{"type": "Point", "coordinates": [1]}',
            f'not GeoJSON: "coordinates" of a Point are numbers nested as in [20, 30]{GEOJSON_HELP}',
        ),
        (
            '{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]}',
            f"not GeoJSON: {NOT_CLOSED}{GEOJSON_HELP}",
        ),
    ],
)
def test_impossible_geojson(source: str, message: str) -> None:
    with pytest.raises(ContactError) as caught:
        Contact.from_geojson(source)
    assert str(caught.value) == message


def test_numbers_in_geojson_are_finite() -> None:
    for number in ("NaN", "Infinity", "1e999"):
        with pytest.raises(ContactError) as caught:
            Contact.from_geojson(f'{{"type": "Point", "coordinates": [{number}, 1]}}')
        assert str(caught.value) == f"not GeoJSON: a coordinate is not a finite number{GEOJSON_HELP}"


@pytest.mark.parametrize(
    "source",
    ["{}", "[]", "3", "null", '"Point"', '{"type": 3}', '{"type": "Feature"}', '{"features": []}',
     '{"type": ["Point"]}', '{"type": "GeometryCollection", "geometries": [3]}',
     '{"type": "GeometryCollection", "geometries": [' * 400 + "1" + "]}" * 400,
     '{"type": "Feature", "geometry": null}', '{"type": "Point", "coordinates": ["1", 2]}'],
)  # fmt: skip
def test_json_that_is_not_geojson(source: str) -> None:
    with pytest.raises(ContactError) as caught:
        Contact.from_geojson(source)
    assert str(caught.value).startswith("not GeoJSON: ")
    assert str(caught.value).endswith(GEOJSON_HELP)
    assert "xception" not in str(caught.value)


@pytest.mark.parametrize(
    "source", ["[" * 100_000 + "]" * 100_000, '{"type": "Point", "coordinates": [1, ' + "9" * 5000 + "]}"]
)
def test_json_beyond_all_bounds(source: str) -> None:
    with pytest.raises(
        ContactError, match="a number has thousands of digits, or lists are nested too deeply"
    ):
        Contact.from_geojson(source)


# Noise in, ContactError or a good contact out.


def check(make: Callable[[], Contact]) -> None:
    try:
        contact = make()
    except ContactError:
        return
    assert contact.shapes
    for shape in contact.shapes:
        assert shape.geom_type in ("Polygon", "LineString", "Point")
        assert shape.is_valid
        assert not shape.is_empty
        assert not shape.has_z
        assert np.isfinite(shapely.get_coordinates(shape)).all()


WKT_WORDS = st.sampled_from(
    ["POINT", "LINESTRING", "POLYGON", "MULTIPOINT", "MULTIPOLYGON", "GEOMETRYCOLLECTION", "EMPTY", "Z", "ZM",
     "CIRCULARSTRING", "CURVEPOLYGON", "(", "((", ")", "))", ",", " ", "0", "1 2", "3 0", "4 4", "-1 5",
     "nan", "1e999", "1e300 -1e300", "1e-320", "0 0, 4 0, 4 4, 0 0"]
)  # fmt: skip
GOOD_WKT = "MULTIPOLYGON (((0 0, 4 0, 4 4, 0 4, 0 0), (1 1, 1 2, 2 2, 1 1)), ((5 5, 6 5, 6 6, 5 5)))"


@st.composite
def mutated(draw: st.DrawFn, text: str, bits: list[str]) -> str:
    """Cut pieces out of a good text and put others in."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = draw(st.integers(start, min(start + 6, len(text))))
        text = text[:start] + draw(st.sampled_from(bits)) + text[end:]
    return text


@settings(FIXED, max_examples=50)
@given(
    st.one_of(
        texts(),
        st.lists(WKT_WORDS, max_size=12).map(" ".join),
        mutated(GOOD_WKT, ["", "(", ")", ",", " ", "9", "-", "1e999", "nan", "Z", "EMPTY", "\0"]),
    )
)
def test_no_wkt_brings_another_error(text: str) -> None:
    check(lambda: Contact.from_wkt(text))


NUMBERS = st.integers(-5, 5) | st.floats()
COORDINATES = st.recursive(NUMBERS, lambda inner: st.lists(inner, max_size=4), max_leaves=12)
RINGS = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, max_size=5).map(
    lambda r: [*r, r[0]]
)
TYPES = st.sampled_from(["Point", "LineString", "Polygon", "MultiPoint", "MultiLineString", "MultiPolygon"])
GEOMETRIES = st.recursive(
    st.one_of(
        st.fixed_dictionaries({"type": TYPES, "coordinates": COORDINATES}),
        st.fixed_dictionaries({"type": st.just("Polygon"), "coordinates": st.lists(RINGS, max_size=2)}),
        st.fixed_dictionaries({"type": st.just("LineString"), "coordinates": RINGS}),
        st.none(),
        texts(max_size=4),
    ),
    lambda inner: st.one_of(
        st.fixed_dictionaries({"type": st.just("Feature"), "geometry": inner, "properties": st.just({})}),
        st.fixed_dictionaries(
            {"type": st.just("FeatureCollection"), "features": st.lists(inner, max_size=3)}
        ),
        st.fixed_dictionaries(
            {"type": st.just("GeometryCollection"), "geometries": st.lists(inner, max_size=3)}
        ),
    ),
    max_leaves=4,
)
GOOD_GEOJSON = json.dumps({"type": "FeatureCollection", "features": [feature(TRIANGLE), feature(TWO_LINES)]})


@settings(FIXED, max_examples=50)
@given(GEOMETRIES)
def test_no_parsed_geojson_brings_another_error(source: Any) -> None:
    check(lambda: Contact.from_geojson(source))


@settings(FIXED, max_examples=50)
@given(
    st.one_of(
        texts(),
        mutated(
            GOOD_GEOJSON, ["", "{", "}", "[", "]", ",", '"', "9", "-", "1e999", "NaN", "null", "\\u0000"]
        ),
    )
)
def test_no_geojson_text_brings_another_error(source: str) -> None:
    check(lambda: Contact.from_geojson(source))

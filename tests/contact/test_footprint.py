"""Where a contact touches each strip, against Shapely's own intersection with every strip."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry.base import BaseGeometry

from strategies import FIXED, areas
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import Footprint, footprint
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError
from tacstrip.sensor.spec import Sensor

SENSOR = Sensor(construction="crs-crs", strips=24, pitch_mm=2.0, length_mm=80.0, strip_width_mm=1.2)
BOX = (0.0, 0.0, 48.0, 80.0)
MERGE = 1e-8  # [mm] pieces nearer than this are one


def intervals(geometry: BaseGeometry) -> list[tuple[float, float]]:
    """Return the y-ranges of the parts of a geometry."""
    if geometry.is_empty:
        return []
    if hasattr(geometry, "geoms"):
        return [interval for part in geometry.geoms for interval in intervals(part)]
    return [(geometry.bounds[1], geometry.bounds[3])]


def count_apart(ranges: list[tuple[float, float]]) -> int:
    count, reach = 0, -np.inf
    for low, high in sorted(ranges):
        count += low > reach + MERGE
        reach = max(reach, high)
    return count


def by_shapely(sensor: Sensor, contact: Contact) -> tuple[FloatArray, FloatArray, IntArray]:
    """Cut every strip's centre line, or its band for what is thin, with every shape: l, u and the pieces."""
    l, u = np.full(sensor.strips, np.nan), np.full(sensor.strips, np.nan)
    pieces = np.zeros(sensor.strips, dtype=np.int64)
    for strip, x in enumerate(sensor.x_mm):
        line = shapely.LineString([(x, 0.0), (x, sensor.length_mm)])
        half = 0.5 * sensor.strip_width
        band = shapely.box(x - half, 0.0, x + half, sensor.length_mm)
        ranges = [
            interval
            for shape in contact.shapes
            for interval in intervals(shape.intersection(line if shape.geom_type == "Polygon" else band))
        ]
        if ranges:
            l[strip], u[strip] = min(r[0] for r in ranges), max(r[1] for r in ranges)
        pieces[strip] = count_apart(ranges)
    return l, u, pieces


def assert_as_shapely(sensor: Sensor, contact: Contact, clipped: bool = False) -> Footprint:
    touch = footprint(sensor, contact)
    l, u, pieces = by_shapely(sensor, contact)
    np.testing.assert_allclose(touch.l, l, atol=1e-9)
    np.testing.assert_allclose(touch.u, u, atol=1e-9)
    np.testing.assert_array_equal(touch.pieces, pieces)
    assert touch.clipped == clipped
    return touch


# Areas.


@settings(FIXED, max_examples=30)
@given(areas((20.0, 20.0, 28.0, 60.0), convex=True))
def test_convex_polygons(contact: Contact) -> None:
    assert_as_shapely(SENSOR, contact)


@settings(FIXED, max_examples=30)
@given(areas((16.0, 16.0, 32.0, 64.0)))
def test_any_polygons(contact: Contact) -> None:
    assert_as_shapely(SENSOR, contact)


@settings(FIXED, max_examples=60)
@given(areas((14.0, 14.0, 34.0, 66.0), step=1.0))
def test_polygons_with_corners_and_edges_on_centre_lines(contact: Contact) -> None:
    assert_as_shapely(SENSOR, contact)  # the centre lines are the odd whole numbers


def strips_of(touch: Footprint) -> list[int]:
    return [int(i) for i in np.flatnonzero(~np.isnan(touch.l))]


def test_end_vertices_on_centre_lines_touch_with_no_width() -> None:
    touch = footprint(SENSOR, Contact.polygon([(5.0, 10.0), (9.0, 20.0), (15.0, 12.0)]))
    assert strips_of(touch) == [2, 3, 4, 5, 6, 7]
    np.testing.assert_array_equal((touch.l[[2, 7]], touch.u[[2, 7]]), [(10.0, 12.0), (10.0, 12.0)])
    assert touch.u[4] == 20.0
    np.testing.assert_allclose(touch.u[[3, 5, 6]], [15.0, 20.0 - 8.0 / 3.0, 20.0 - 16.0 / 3.0], rtol=1e-14)
    np.testing.assert_array_equal(touch.pieces[2:8], 1)


def test_vertical_edges_on_centre_lines_touch_over_their_length() -> None:
    touch = footprint(SENSOR, Contact.polygon([(5.0, 10.0), (9.0, 12.0), (9.0, 30.0), (5.0, 20.0)]))
    assert strips_of(touch) == [2, 3, 4]
    np.testing.assert_array_equal(touch.l[2:5], (10.0, 11.0, 12.0))
    np.testing.assert_array_equal(touch.u[2:5], (20.0, 25.0, 30.0))


def test_a_polygon_between_two_centre_lines_touches_nothing() -> None:
    touch = footprint(SENSOR, Contact.polygon([(5.1, 10.0), (6.9, 10.0), (6.0, 20.0)]))
    assert strips_of(touch) == []
    assert np.isnan(touch.u).all()
    np.testing.assert_array_equal(touch.pieces, 0)
    assert not touch.clipped


@pytest.mark.parametrize("pitch", [0.1, 40.0 / 9.0, 1.0 / 3.0, 6.5])
def test_centre_lines_that_binary_numbers_cannot_name_are_met(pitch: float) -> None:
    sensor = Sensor(construction="crs-m", strips=1000, pitch_mm=pitch, length_mm=100.0)
    for first, last in [(0, 2), (331, 373), (996, 999)]:
        left, right = sensor.x_mm[first], (last + 0.5) * sensor.pitch_mm
        touch = footprint(sensor, Contact.polygon([(left, 50.0), (right, 40.0), (right, 70.0)]))
        assert strips_of(touch) == list(range(first, last + 1))
        assert (touch.l[first], touch.u[first]) == (50.0, 50.0)
        assert (touch.l[last], touch.u[last]) == (40.0, 70.0)


def test_overlapping_areas_are_one_piece() -> None:
    low = Contact.polygon([(4.0, 10.0), (12.0, 10.0), (12.0, 20.0), (4.0, 20.0)])
    for other, pieces in [
        (low.moved(0.0, 5.0), 1),
        (low.moved(0.0, 10.0), 1),  # they share an edge
        (low.moved(0.0, 10.5), 2),
        (low, 1),
        (Contact.line([(4.0, 15.0), (12.0, 15.0)]), 1),
        (Contact.line([(4.0, 25.0), (12.0, 25.0)]), 2),
    ]:
        touch = footprint(SENSOR, low + other)
        assert strips_of(touch) == [2, 3, 4, 5]
        np.testing.assert_array_equal(touch.pieces[2:6], pieces)


# Holes.


def ring_with(hole: list[tuple[float, float]]) -> Contact:
    return Contact.polygon([(4.0, 10.0), (20.0, 10.0), (20.0, 50.0), (4.0, 50.0)], holes=[hole])


def test_a_hole_makes_two_pieces_and_leaves_the_hull() -> None:
    contact = ring_with([(8.0, 20.0), (14.0, 20.0), (14.0, 40.0), (8.0, 40.0)])
    touch = assert_as_shapely(SENSOR, contact)
    np.testing.assert_array_equal(touch.l[2:10], 10.0)
    np.testing.assert_array_equal(touch.u[2:10], 50.0)
    np.testing.assert_array_equal(touch.pieces[2:10], [1, 1, 2, 2, 2, 1, 1, 1])


@pytest.mark.parametrize(
    ("hole", "pieces"),
    [
        ([(7.0, 30.0), (11.0, 20.0), (11.0, 40.0)], [1, 1, 2, 1, 1]),  # its edge on a centre line is contact
        ([(7.0, 20.0), (11.0, 30.0), (7.0, 40.0)], [1, 1, 2, 1, 1]),
        ([(7.0, 30.0), (9.0, 20.0), (11.0, 30.0), (9.0, 40.0)], [1, 1, 2, 1, 1]),  # its corner too
    ],
)
def test_the_edge_of_a_hole_is_contact(hole: list[tuple[float, float]], pieces: list[int]) -> None:
    touch = assert_as_shapely(SENSOR, ring_with(hole))
    np.testing.assert_array_equal(touch.pieces[2:7], pieces)


@settings(FIXED, max_examples=30)
@given(st.integers(8, 15), st.integers(20, 30), st.integers(1, 4), st.integers(1, 9), st.integers(-4, 4))
def test_holes_anywhere(x: int, y: int, width: int, height: int, slant: int) -> None:
    hole = [(x, y), (x + width, y + slant), (x + width, y + slant + height), (x, y + height)]
    assert_as_shapely(SENSOR, ring_with([(float(a), float(b)) for a, b in hole]))


# Lines and points touch the whole width of a strip.


@settings(FIXED, max_examples=40)
@given(st.lists(st.tuples(st.integers(1, 996), st.integers(1, 996)), min_size=2, max_size=6, unique=True))
def test_lines(path: list[tuple[int, int]]) -> None:
    assert_as_shapely(SENSOR, Contact.line(np.array(path) / 997.0 * (48.0, 80.0)))


@settings(FIXED, max_examples=30)
@given(st.lists(st.tuples(st.integers(1, 996), st.integers(1, 996)), min_size=1, max_size=6))
def test_points(points: list[tuple[int, int]]) -> None:
    assert_as_shapely(SENSOR, Contact.points(np.array(points) / 997.0 * (48.0, 80.0)))


@settings(FIXED, max_examples=40)
@given(areas((16.0, 16.0, 32.0, 64.0)), st.integers(1, 996), st.integers(1, 996))
def test_areas_lines_and_points_together(contact: Contact, x: int, y: int) -> None:
    place = np.array([x, y]) / 997.0 * (40.0, 70.0)
    thin = Contact.line([place, np.add(place, (7.3, 4.1))]) + Contact.points(place)
    assert_as_shapely(SENSOR, contact + thin)


@pytest.mark.parametrize(
    ("x", "strips"),
    [
        (5.0, [2]),
        (4.4, [2]),
        (5.6, [2]),
        (4.39, []),
        (5.61, []),
        (6.0, []),
        (6.4, [3]),
        (0.0, []),
        (48.0, []),
    ],
)
def test_a_point_touches_from_edge_to_edge_of_a_strip(x: float, strips: list[int]) -> None:
    touch = footprint(SENSOR, Contact.points((x, 33.0)))
    assert strips_of(touch) == strips
    np.testing.assert_array_equal(touch.l[strips], 33.0)
    np.testing.assert_array_equal(touch.u[strips], 33.0)


def test_strips_without_gaps_share_a_point_on_their_edge() -> None:
    sensor = Sensor(construction="crs-crs", strips=24, pitch_mm=2.0, length_mm=80.0)
    assert strips_of(footprint(sensor, Contact.points((6.0, 33.0)))) == [2, 3]
    assert strips_of(footprint(sensor, Contact.points((6.01, 33.0)))) == [3]


def test_a_slanted_line_is_as_long_as_the_strip_is_wide() -> None:
    touch = footprint(SENSOR, Contact.line([(4.0, 20.0), (8.0, 24.0)]))  # one mm up a mm across
    assert strips_of(touch) == [2, 3]
    np.testing.assert_allclose(touch.l[2:4], (20.4, 22.4), rtol=1e-14)
    np.testing.assert_allclose(touch.u[2:4], (21.6, 23.6), rtol=1e-14)


def test_a_line_along_a_strip() -> None:
    touch = footprint(SENSOR, Contact.line([(5.3, 60.0), (5.3, 20.0)]))
    assert strips_of(touch) == [2]
    assert (touch.l[2], touch.u[2]) == (20.0, 60.0)


# Off the sensor.


@settings(FIXED, max_examples=40)
@given(areas((-6.0, -10.0, 54.0, 90.0)))
def test_what_sticks_out_is_clipped(contact: Contact) -> None:
    whole = shapely.GeometryCollection(list(contact.shapes))
    if not whole.intersects(shapely.box(*BOX)):
        with pytest.raises(ContactError, match="lies outside the sensor"):
            footprint(SENSOR, contact)
        return
    assert_as_shapely(SENSOR, contact, clipped=not shapely.box(*BOX).covers(whole))


def test_a_line_that_sticks_out_is_clipped() -> None:
    touch = assert_as_shapely(SENSOR, Contact.line([(4.0, -10.0), (15.0, 100.0)]), clipped=True)
    assert (np.nanmin(touch.l), np.nanmax(touch.u)) == (0.0, 80.0)


def test_a_contact_may_reach_the_edges_without_being_clipped() -> None:
    touch = assert_as_shapely(SENSOR, Contact.polygon([(0, 0), (48, 0), (48, 80), (0, 80)]), clipped=False)
    np.testing.assert_array_equal(touch.l, 0.0)
    np.testing.assert_array_equal(touch.u, 80.0)


def test_a_comb_that_sticks_out_reads_in_pieces() -> None:
    # Two teeth on the sensor; what joins them lies off it.
    comb = [(-4, 10), (20, 10), (20, 20), (-2, 20), (-2, 30), (20, 30), (20, 40), (-4, 40)]
    touch = assert_as_shapely(SENSOR, Contact.polygon(comb), clipped=True)
    np.testing.assert_array_equal(touch.pieces[:10], 2)
    np.testing.assert_array_equal((touch.l[:10], touch.u[:10]), ([10.0] * 10, [40.0] * 10))


OUTSIDE = re.escape(
    "the contact (x 60 to 72.5, y 10 to 20 mm) lies outside the sensor (x 0 to 48, y 0 to 80 mm); "
    "move it, or check its unit: mm"
)


def test_a_contact_wholly_off_the_sensor_is_refused() -> None:
    off = Contact.polygon([(60.0, 10.0), (72.5, 10.0), (70.0, 20.0)])
    with pytest.raises(ContactError, match=f"^{OUTSIDE}$"):
        footprint(SENSOR, off)
    on = Contact.points((10.0, 10.0))
    with pytest.raises(ContactError, match=f"^{OUTSIDE}$"):
        footprint(SENSOR, [on, off])


def test_a_shape_off_the_sensor_is_dropped_beside_one_on_it() -> None:
    on, off = Contact.points((11.0, 10.0)), Contact.points((60.0, 10.0))
    touch = footprint(SENSOR, on + off)
    assert (strips_of(touch), touch.clipped) == ([5], True)


# Many at once.


@settings(FIXED, max_examples=25)
@given(st.lists(areas((-6.0, -10.0, 54.0, 90.0)), min_size=1, max_size=5), st.booleans())
def test_a_batch_is_its_contacts_one_by_one(contacts: list[Contact], with_thin: bool) -> None:
    if with_thin:
        contacts = [
            *contacts,
            Contact.line([(3.3, 4.4), (41.0, 7.0)]),
            Contact.points([(5.1, 6.0), (7.2, 9.0)]),
        ]
    contacts = [c + Contact.points((24.6, 40.0)) for c in contacts]  # on the sensor, each of them
    touch = footprint(SENSOR, contacts)
    assert touch.l.shape == touch.u.shape == touch.pieces.shape == (len(contacts), 24)
    alone = [footprint(SENSOR, contact) for contact in contacts]
    np.testing.assert_array_equal(touch.l, [one.l for one in alone])
    np.testing.assert_array_equal(touch.u, [one.u for one in alone])
    np.testing.assert_array_equal(touch.pieces, [one.pieces for one in alone])
    assert touch.clipped == any(one.clipped for one in alone)


def test_one_contact_iterates_as_l_and_u() -> None:
    touch = footprint(SENSOR, Contact.polygon([(5.0, 10.0), (9.0, 20.0), (15.0, 12.0)]))
    l, u = touch
    assert l is touch.l
    assert u is touch.u
    assert l.shape == u.shape == touch.pieces.shape == (24,)


def test_an_empty_batch_is_empty() -> None:
    touch = footprint(SENSOR, [])
    assert touch.l.shape == touch.u.shape == (0, 24)
    assert not touch.clipped

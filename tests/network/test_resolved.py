"""Strips resolved across their width: exact limits, orders of convergence, and what a slanted edge reads."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.special import digamma, zeta

import tacstrip as ts
from studies.budget import PROFILE_I
from studies.width import RULES, edge_shift, footprints, rule_errors, steepest
from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.contact.slant import _digamma, slant_shift
from tacstrip.network.strips.resolved import MOST, Cells, wide_measurements, wide_readings
from tacstrip.sensor import lower_and_width

B, L = 10.0, 100.0  # width and length of the strips [mm]
SIZE: dict[str, Any] = {"strips": 3, "pitch_mm": B, "length_mm": L}
PAIR = ts.Sensor(construction="crs-crs", **SIZE)
METAL = ts.Sensor(construction="crs-m", **SIZE)


def on_strip(*corners: tuple[float, float]) -> ts.Contact:
    """Make a contact of corners (x, y) on strip 1, x from its left side."""
    return ts.Contact.polygon([(B + x, y) for x, y in corners])


def above(slope: float, l: float = 25.0, u: float = 60.0) -> ts.Contact:
    """Make a contact that is level below, and slanted above with its middle at u."""
    return on_strip((0, l), (B, l), (B, u + 0.5 * B * slope), (0, u - 0.5 * B * slope))


def read_ends(sensor: ts.Sensor, contact: ts.Contact, across: int | None = None) -> tuple[float, float]:
    """Return l', u' of strip 1: the ideal contact that reads the same."""
    read = wide_readings(sensor, contact, across=across)
    l, w = lower_and_width(read["kh"], read["kl"], sensor.length_mm, sensor.sensing_ratio)
    return float(l[1]), float(l[1] + w[1])


# What is exact


@pytest.mark.parametrize("across", [1, 2, 7, None])
@pytest.mark.parametrize("ends", [(25.0, 60.0), (0.0, 33.3), (70.1, 100.0), (50.0, 50.001)])
@pytest.mark.parametrize(
    "sensor", [PAIR, replace(PAIR, resistivity_ratio=0.2), replace(PAIR, strip_width_mm=3.0), METAL]
)
def test_edges_straight_across_read_the_closed_form(
    sensor: ts.Sensor, ends: tuple[float, float], across: int | None
) -> None:
    low, high = ends
    block = on_strip((-B, low), (2 * B, low), (2 * B, high), (-B, high))
    expected = signatures(sensor, *ts.footprint(sensor, block))
    for name, values in wide_readings(sensor, block, across=across).items():
        np.testing.assert_allclose(values, expected[name], rtol=0, atol=1e-9)


def test_two_pieces_read_as_their_hull() -> None:
    """As the closed forms say: the gap shares the current as the contact does."""
    two = above(0.0, 20.0, 30.0) + above(0.0, 55.0, 80.0)
    np.testing.assert_allclose(read_ends(PAIR, two, 8), (20.0, 80.0), atol=1e-7)


@pytest.mark.parametrize("slope", [0.2, 1.0, -1.0, 3.0])
def test_a_slanted_edge_reads_beyond_its_middle_as_the_conformal_map_says(slope: float) -> None:
    """A corner of 90 degrees + the slope's angle between contact and free side gives the order: 180 / that angle."""
    exact = 60.0 + B * float(slant_shift(slope))
    errors = np.array([abs(read_ends(PAIR, above(slope), n)[1] - exact) for n in (8, 16, 32, 64)]) / B
    orders = np.log2(errors[:-1] / errors[1:])
    corner = 90.0 + np.rad2deg(np.arctan(abs(slope)))
    np.testing.assert_allclose(orders, 180.0 / corner, atol=0.13)
    assert errors[2] < 0.002 * max(1.0, slope**2)


def test_an_apex_reads_as_an_edge_of_half_the_strip() -> None:
    """Its flanks mirror each other in the centre line, which no current crosses."""
    apex = on_strip((0, 25), (B, 25), (B, 55), (0.5 * B, 65), (0, 55))
    exact = 60.0 + 0.5 * B * float(slant_shift(2.0))
    assert read_ends(PAIR, apex, 64)[1] == pytest.approx(exact, abs=0.004 * B)
    half = replace(PAIR, pitch_mm=0.5 * B)
    edge = ts.Contact.polygon([(5, 25), (10, 25), (10, 65), (5, 55)])
    assert read_ends(half, edge, 32)[1] == pytest.approx(read_ends(PAIR, apex, 64)[1], abs=1e-3)


@pytest.mark.parametrize(("x", "shift"), [(0.0, np.log(4.0) / np.pi), (0.5, np.log(2.0) / np.pi)])
def test_a_line_along_the_strip_reads_shorter(x: float, shift: float) -> None:
    """Along a side or the middle: the current has to come together (by conformal mapping)."""
    x = min(max(x * B, 1e-6), B - 1e-6) + B
    along = ts.Contact.line([(x, 20.0), (x, 80.0)])
    coarse, fine = (np.array(read_ends(PAIR, along, n)) for n in (32, 64))
    exact = np.array([20.0 + shift * B, 80.0 - shift * B])
    assert np.abs(fine - exact).max() < 0.02 * B
    np.testing.assert_allclose(np.abs(coarse - exact) / np.abs(fine - exact), 2.0, atol=0.2)  # a tip: order 1


def test_the_digamma_function_is_scipys() -> None:
    x = np.concatenate([np.geomspace(1e-12, 1.0, 500), np.linspace(0.001, 1.0, 500)])
    np.testing.assert_allclose(_digamma(x), digamma(x), rtol=1e-14, atol=1e-14)


def test_slant_shift_between_its_limits() -> None:
    slope = np.array([0.0, 1e-3, 1.0, -1.0, 1e4])
    expected = [
        0.0,
        7e-6 * zeta(3) / np.pi**3,
        np.log(2.0) / np.pi,
        np.log(2.0) / np.pi,
        0.5e4 - np.log(4.0) / np.pi,
    ]
    np.testing.assert_allclose(slant_shift(slope), expected, rtol=1e-6, atol=1e-12)
    steep = np.geomspace(1e-2, 1e3, 60)
    below_hull = 0.5 * steep - slant_shift(steep)
    assert np.all(np.diff(below_hull) > 0.0)
    assert below_hull[-1] < np.log(4.0) / np.pi


# Contact resistance


@pytest.mark.parametrize(
    ("slope", "decay"), [(1.0, 0.05), (0.3, 0.2), (3.0, 0.2), (1.0, 0.667), (0.3, 2.0), (3.0, 2.0)]
)
def test_slant_shift_with_contact_resistance_is_the_networks(slope: float, decay: float) -> None:
    assert edge_shift(slope, decay, 48) == pytest.approx(float(slant_shift(slope, decay)), abs=2e-3)


def test_slant_shift_with_contact_resistance_between_its_limits() -> None:
    slope = np.array([0.0, 0.5, -0.5, 2.0, 20.0])
    np.testing.assert_allclose(slant_shift(slope, 1e-7), slant_shift(slope), atol=1e-4)
    shifts = np.array([slant_shift(slope, decay) for decay in (0.0, 0.1, 0.5, 2.0, 50.0)])
    assert np.all(np.diff(shifts[:, 1:], axis=0) < 0.0)
    np.testing.assert_allclose(shifts[-1, 1:4], slope[1:4] ** 2 / (12.0 * 50.0), rtol=0.02)  # alike across


@pytest.mark.parametrize("sensor", [PAIR, replace(PAIR, resistivity_ratio=3.0), METAL])
def test_contact_resistance_converges_to_the_closed_form_with_the_second_power(sensor: ts.Sensor) -> None:
    sensor = replace(sensor, contact_lambda_mm=3.0)
    exact = signatures(sensor, *ts.footprint(sensor, above(0.0)))
    for name, values in exact.items():
        errors = [abs(wide_readings(sensor, above(0.0), across=n)[name][1] - values[1]) for n in (8, 16, 32)]
        assert errors[-1] < 1e-4
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.4)


@pytest.mark.parametrize(("lam", "slope"), [(2.0, 1.0), (10.0, 3.0)])
def test_contact_resistance_under_a_slanted_edge_has_the_second_order(lam: float, slope: float) -> None:
    shifts = np.array([edge_shift(slope, lam / B, n) for n in (8, 16, 32, 64)])
    steps = np.abs(np.diff(shifts))
    assert steps[-1] < 1e-3
    assert np.log2(steps[0] / steps[-1]) / 2.0 == pytest.approx(2.0, abs=0.35)


def test_a_long_lambda_reads_the_average_position_and_none_reads_beyond() -> None:
    """The thesis' "average position" (5.1.1) is the limit of contact resistance over far more than the edge."""
    shifts = [edge_shift(1.0, lam, 24) for lam in (0.0, 0.1, 0.5, 2.0, 8.0)]
    assert np.all(np.diff(shifts) < 0.0)
    assert shifts[0] == pytest.approx(0.2206, abs=0.003)
    assert shifts[-1] == pytest.approx(0.0, abs=0.012)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 6.0]), st.floats(0.05, 20.0))
def test_any_shape_reads_as_one_ideal_contact_on_rubber_and_on_metal(
    seed: int, lam: float, ratio: float
) -> None:
    corners = np.random.default_rng(seed).uniform((4.0, 15.0), (26.0, 85.0), (3, 2))
    (x0, y0), (x1, y1), (x2, y2) = corners
    assume(abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) > 40.0)
    shape = ts.Contact.polygon(corners)
    pair = replace(PAIR, contact_lambda_mm=lam)
    low, high = _all_ends(pair, shape)
    np.testing.assert_allclose(
        _all_ends(replace(pair, resistivity_ratio=ratio), shape), (low, high), atol=2e-6
    )
    k = wide_readings(replace(METAL, contact_lambda_mm=lam), shape, across=6)["k"]
    np.testing.assert_allclose(k, low / (L - (high - low)), atol=1e-8)


def _all_ends(sensor: ts.Sensor, shape: ts.Contact) -> tuple[FloatArray, FloatArray]:
    read = wide_readings(sensor, shape, across=6)
    l, w = lower_and_width(read["kh"], read["kl"], L, sensor.sensing_ratio)
    return l, l + w


# What touches, and what cannot be


def test_a_strip_reads_where_any_part_of_it_is_touched() -> None:
    narrow = ts.Contact.polygon([(12, 30), (23, 30), (23, 70), (12, 70)])
    touched = ~np.isnan(wide_readings(PAIR, narrow, across=8)["kh"])
    np.testing.assert_array_equal(touched, [False, True, True])
    assert np.isnan(ts.footprint(PAIR, narrow).l[2])  # its centre line is free
    grazing = ts.Contact.polygon([(10, 30), (20, 30), (20, 70), (10, 70)])
    np.testing.assert_array_equal(np.isnan(wide_readings(PAIR, grazing, across=8)["kh"]), [True, False, True])
    gaps = replace(PAIR, strip_width_mm=2.0)
    between = ts.Contact.polygon([(12, 30), (13, 30), (13, 70), (12, 70)])
    assert not wide_measurements(gaps, between)


def test_a_speck_reads_its_place() -> None:
    speck = on_strip((4.0, 40.0), (4.01, 40.0), (4.0, 40.01))
    for sensor in (PAIR, replace(PAIR, contact_lambda_mm=1.0)):
        np.testing.assert_allclose(read_ends(sensor, speck, 8), 40.0, atol=0.05)


def test_what_hangs_over_the_sensor_is_cut_away() -> None:
    over = on_strip((0, -20), (B, -20), (B, 40), (0, 40))
    np.testing.assert_allclose(read_ends(PAIR, over, 4), (0.0, 40.0), atol=1e-7)


@pytest.mark.parametrize(
    ("sensor", "contact", "across", "error", "words"),
    [
        (PAIR, above(1.0), 0, ts.OptionError, f"across = 0: must be a whole number, 1 to {MOST}"),
        (PAIR, above(1.0), 2.5, ts.OptionError, "across = 2.5"),
        (PAIR, above(1.0), MOST + 1, ts.OptionError, f"1 to {MOST}"),
        (PAIR, above(1.0).moved(500, 0), None, ts.ContactError, "lies outside the sensor"),
        (
            PAIR,
            ts.Contact.points([(15, 50)]),
            None,
            ts.ContactError,
            "a point reads its own y .* give an area",
        ),
        (
            replace(PAIR, contact_lambda_mm=1.0),
            ts.Contact.line([(10, 50), (20, 50)]),
            None,
            ts.ContactError,
            "a line has no area to conduct over: give an area",
        ),
        (METAL, above(0.0, 0.0, 100.0), 4, ts.NetworkError, "strip 1: .* shorts Vref to ground"),
        (
            ts.Sensor(construction="crs-crp", contact_lambda_mm=1.0, resistivity_ratio=100.0, **SIZE),
            above(1.0),
            None,
            ts.NetworkError,
            "a crs-crp sensor's strips are coupled by the sheet",
        ),
    ],
)
def test_what_cannot_be_is_refused(
    sensor: ts.Sensor, contact: ts.Contact, across: Any, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        wide_readings(sensor, contact, across=across)


# The rules of thumb


def test_the_centre_line_is_good_up_to_the_steepest_edge() -> None:
    width = 0.03
    slope = np.tan(np.deg2rad(steepest(PROFILE_I, width)))
    assert edge_shift(slope, 0.0, 64) * width == pytest.approx(PROFILE_I, rel=0.01)


def test_the_rules_on_one_slanted_contact() -> None:
    covered, ends = footprints(PAIR, above(1.0))
    np.testing.assert_allclose(covered, [0.0, 1.0, 0.0])
    expected = {"centre line": 60.0, "mean over the width": 60.0, "mean, slant counted": 62.206, "hull": 65.0}
    for rule in RULES:
        low, high = ends[rule]
        assert (low[1], high[1]) == pytest.approx((25.0, expected[rule]), abs=0.03)


def test_the_slant_explains_what_the_centre_line_misses() -> None:
    sensor = replace(PAIR, strips=8, length_mm=200.0)
    errors = rule_errors(sensor, 4, 70.0, across=12)
    typical = {rule: float(np.median(np.abs(ends))) for rule, (ends, _) in errors.items()}
    assert typical["mean, slant counted"] < 0.1 * typical["centre line"] < 0.1 * typical["hull"]
    assert np.max(errors["hull"][0]) < np.log(4.0) / np.pi * B + 0.1
    parts = rule_errors(sensor, 4, 70.0, across=12, part=True)
    assert np.isnan(parts["centre line"][0]).any()
    assert not np.isnan(parts["hull"][0]).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "centre", "slant", "hull"),
    [
        (ts.Sensor.load("prototype-crs-crs"), 0.071, 0.002, 0.173),
        (ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0), 0.327, 0.011, 0.868),
    ],
    ids=["prototype", "b = 5 % of L"],
)
def test_the_rules_over_random_contacts(sensor: ts.Sensor, centre: float, slant: float, hull: float) -> None:
    """The table of docs/science/physics.md: medians, in % of L."""
    errors = rule_errors(sensor, 100, 60.0, across=24)
    typical = {rule: 100.0 * np.median(np.abs(ends)) / sensor.length_mm for rule, (ends, _) in errors.items()}
    expected = {"centre line": centre, "mean, slant counted": slant, "hull": hull}
    assert {rule: typical[rule] for rule in expected} == pytest.approx(expected, abs=0.001)
    assert np.max(errors["hull"][0]) < np.log(4.0) / np.pi * sensor.strip_width


def test_cells_hold_the_areas_that_intersections_have() -> None:
    grid = Cells(np.linspace(0.0, 5.0, 8), np.array([0.0, 1.0, 4.0, 4.5, 7.0, 10.0]))
    area = shapely.Polygon(
        [(0.0, 1.0), (5.0, 0.5), (4.0, 9.0), (2.0, 6.0)], [[(2.0, 2.0), (3.0, 2.0), (3.0, 4.2)]]
    )
    both = shapely.union(area, shapely.box(0.0, 9.0, 1.0, 9.5))
    side, level = (np.concatenate([a[:1], 0.5 * (a[1:] + a[:-1]), a[-1:]]) for a in (grid.x, grid.y))
    boxes = shapely.box(side[:-1], level[:-1, None], side[1:], level[1:, None])
    np.testing.assert_allclose(grid.shares(both), shapely.area(shapely.intersection(both, boxes)), atol=1e-13)

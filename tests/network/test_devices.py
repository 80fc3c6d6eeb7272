from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, NetworkError, OptionError
from tacstrip.network.devices.digital_array import (
    ISOLATIONS,
    ArrayWiring,
    phantoms,
    scan_array,
    switch_currents,
)
from tacstrip.network.devices.four_wire import four_wire
from tacstrip.network.grid import tactels
from tacstrip.sensor.closed_form import k_metal
from tacstrip.thesis import chapter2


def box(x0: float, y0: float, x1: float, y1: float) -> Contact:
    return Contact.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


# 2.1: the analog four-wire sensor


@pytest.mark.parametrize("read", ["both", "low", "high"])
@pytest.mark.parametrize("at", [(30.0, 12.0), (0.0, 40.0), (120.0, 0.0), (2.0, 78.0)])
def test_a_point_on_a_node_reads_its_own_position(at: tuple[float, float], read: Any) -> None:
    ours = four_wire(
        120.0, 80.0, Contact.points([at]), cells=(60, 40), sheet_ratio=3.0, point_squares=0.4, read=read
    )
    np.testing.assert_allclose((ours.x_mm, ours.y_mm), at, atol=1e-8)
    np.testing.assert_allclose((ours.x_volt, ours.y_volt), (at[0] / 120.0, at[1] / 80.0), atol=1e-10)
    assert not ours.clipped


def test_a_point_between_nodes_reads_within_half_a_cell() -> None:
    for at in np.random.default_rng(3).uniform((0.0, 0.0), (90.0, 60.0), (20, 2)):
        ours = four_wire(90.0, 60.0, Contact.points(at), cells=30)
        assert max(abs(ours.x_mm - at[0]), abs(ours.y_mm - at[1])) <= 1.5 + 1e-9


@pytest.mark.parametrize(
    "pair", [[(30, 50), (70, 50)], [(20, 30), (80, 70)], [(50, 10), (50, 90)], [(20, 30), (70, 80)]]
)
def test_two_symmetric_points_read_as_the_midpoint(pair: list[tuple[float, float]]) -> None:
    ours = four_wire(100.0, 100.0, Contact.points(pair), cells=50)
    np.testing.assert_allclose((ours.x_mm, ours.y_mm), np.mean(pair, axis=0), atol=1e-9)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
def test_two_points_anywhere_read_as_one_on_the_line_between_them(ratio: float) -> None:
    """Also for sheets of different resistance: both measurements weigh the two alike."""
    rng, shares = np.random.default_rng(1), []
    for _ in range(8):
        a, b = 4.0 * rng.integers(1, 24, (2, 2))
        ours = four_wire(100.0, 100.0, Contact.points([a, b]), cells=25, sheet_ratio=ratio)
        d, r = b - a, np.array([ours.x_mm, ours.y_mm]) - a
        assert abs(d[0] * r[1] - d[1] * r[0]) / np.hypot(*d) < 1e-8
        shares.append(r @ d / (d @ d))
    assert min(shares) > 0.3
    assert max(shares) < 0.7
    assert np.ptp(shares) > 0.001  # near the middle, not in it


def test_one_bar_reads_beside_the_line_but_within_the_box() -> None:
    ours = [
        four_wire(100.0, 100.0, Contact.points([(20, 40), (60, 80)]), cells=50, read=read)
        for read in ("low", "high")
    ]
    for one in ours:
        assert 20.0 < one.x_mm < 60.0
        assert 40.0 < one.y_mm < 80.0
        assert abs((one.y_mm - 40.0) - (one.x_mm - 20.0)) > 0.5


def test_three_points_read_as_one_inside_their_triangle() -> None:
    p = np.array([(20.0, 20.0), (80.0, 30.0), (40.0, 90.0)])
    ours = four_wire(100.0, 100.0, Contact.points(p), cells=50)
    corners = np.vstack([p.T, np.ones(3)])
    weights = np.linalg.solve(corners, [ours.x_mm, ours.y_mm, 1.0])
    assert weights.min() > 0.2
    assert weights.max() < 0.5


@pytest.mark.parametrize(("ratio", "squares"), [(1.0, 0.0), (4.0, 0.0), (0.5, 0.3)])
def test_the_point_is_the_mean_with_weights_from_the_resistances_between_the_contacts(
    ratio: float, squares: float
) -> None:
    """Dense matrices of the bare sheets, and the closed form M^-1 1 instead of a joined network."""
    nx, ny, w, h = 7, 5, 70.0, 40.0
    nodes = [(1, 1), (5, 4), (4, 2), (2, 4)]
    xy = np.array([(i * w / nx, j * h / ny) for i, j in nodes])
    top = _dense_sheet(nx, ny, w, h, 1.0, bars_over_x=True)
    bottom = _dense_sheet(nx, ny, w, h, ratio, bars_over_x=False)
    which = [j * (nx + 1) + i for i, j in nodes]
    m = (top + bottom)[np.ix_(which, which)] + squares * np.eye(len(nodes))
    weights = np.linalg.solve(m, np.ones(len(nodes)))
    expected = weights @ xy / weights.sum()
    ours = four_wire(w, h, Contact.points(xy), cells=(nx, ny), sheet_ratio=ratio, point_squares=squares)
    np.testing.assert_allclose((ours.x_mm, ours.y_mm), expected, atol=1e-9)


def _dense_sheet(nx: int, ny: int, w: float, h: float, squares: float, bars_over_x: bool) -> FloatArray:
    """Return the resistance matrix of a sheet's nodes with its bars grounded; 0 on the bars."""
    n = (nx + 1) * (ny + 1)
    laplace, dx, dy = np.zeros((n, n)), w / nx, h / ny
    for j in range(ny + 1):
        for i in range(nx + 1):
            for di, dj in ((1, 0), (0, 1)):
                if i + di <= nx and j + dj <= ny:
                    g = dy / dx if di else dx / dy
                    g *= 0.5 if (j in (0, ny) if di else i in (0, nx)) else 1.0
                    a, b = j * (nx + 1) + i, (j + dj) * (nx + 1) + i + di
                    laplace[[a, b], [a, b]] += g / squares
                    laplace[[a, b], [b, a]] -= g / squares
    column, row = np.arange(n) % (nx + 1), np.arange(n) // (nx + 1)
    free = np.flatnonzero((column % nx > 0) if bars_over_x else (row % ny > 0))
    result = np.zeros((n, n))
    result[np.ix_(free, free)] = np.linalg.inv(laplace[np.ix_(free, free)])
    return result


def test_on_one_row_of_cells_the_other_sheet_is_metal() -> None:
    """All its nodes lie on its bars, so that (3.8) holds, and for two lines the divider by hand."""
    area = four_wire(100.0, 80.0, box(20, 0, 50, 80), cells=(20, 1))
    lines = Contact.line([(20, 0), (20, 80)]) + Contact.line([(50, 0), (50, 80)])
    expected = float(k_metal(np.array(20.0), np.array(30.0), 100.0))
    assert area.x_volt == pytest.approx(expected, abs=1e-12)
    assert four_wire(100.0, 80.0, lines, cells=(20, 1)).x_volt == pytest.approx(expected, abs=1e-12)
    r, (x1, x2), w, per_mm = 0.7, (20.0, 50.0), 100.0, 1.0 / 80.0
    current = (x2 - x1) / w / (per_mm * (x2 - x1) * (w - (x2 - x1)) / w + 2.0 * r)
    by_hand = x1 / w + current * (per_mm * x1 * (x2 - x1) / w + r)
    ours = four_wire(w, 80.0, lines, cells=(20, 1), point_squares=r)
    assert ours.x_volt == pytest.approx(by_hand, abs=1e-12)


def test_a_contact_with_resistance_converges_to_the_closed_form_with_the_second_power() -> None:
    lam, ratio = 5.0, 1.0  # metal below: only the top sheet counts in the decay length
    exact = float(k_metal(np.array(20.0), np.array(40.0), 100.0, lam * np.sqrt(1.0 + ratio)))
    errors = [
        abs(four_wire(100.0, 80.0, box(20, 0, 60, 80), cells=(n, 1), contact_lambda_mm=lam).x_volt - exact)
        for n in (20, 40, 80, 160)
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.85) & (orders < 2.1)), orders
    assert errors[-1] < 5e-5


def test_refinement_converges_with_four_thirds_at_a_rectangles_corners() -> None:
    """Voltages between the sheets go with r^(2/3) round the corner of 270 degrees: errors with h^(4/3)."""
    two = box(20, 25, 50, 55) + box(70, 60, 80, 80)
    x = [four_wire(100.0, 100.0, two, cells=n).x_volt for n in (20, 40, 80, 160)]
    steps = np.diff(x)
    assert np.log2(steps[1] / steps[2]) == pytest.approx(4.0 / 3.0, abs=0.1)
    assert abs(steps[-1]) < 2e-4


def test_areas_count_once_and_by_what_they_cover() -> None:
    one = four_wire(100.0, 100.0, box(20, 20, 60, 50), contact_lambda_mm=4.0, cells=25)
    twice = box(20, 20, 45, 50) + box(35, 20, 60, 50)
    np.testing.assert_allclose(
        (one.x_mm, one.y_mm),
        (lambda r: (r.x_mm, r.y_mm))(four_wire(100.0, 100.0, twice, contact_lambda_mm=4.0, cells=25)),
        atol=1e-9,
    )
    centred = four_wire(100.0, 100.0, box(31, 33, 69, 67), cells=40, contact_lambda_mm=2.0)
    np.testing.assert_allclose((centred.x_mm, centred.y_mm), (50.0, 50.0), atol=1e-8)
    speck = four_wire(100.0, 100.0, box(33.1, 41.1, 33.4, 41.2), cells=50)  # covers no node
    assert abs(speck.x_mm - 33.25) <= 2.0
    assert abs(speck.y_mm - 41.15) <= 2.0


def test_what_lies_off_the_sheets_is_cut_away_and_told() -> None:
    ours = four_wire(100.0, 80.0, Contact.points([(40, 20), (400, 20)]), cells=(50, 40))
    assert ours.clipped
    np.testing.assert_allclose((ours.x_mm, ours.y_mm), (40.0, 20.0), atol=1e-8)
    message = (
        "the contact (x 400 to 400, y 20 to 20 mm) lies outside the sheets (x 0 to 100, y 0 to 80 mm); "
        "move it, or check its unit: mm"
    )
    with pytest.raises(ContactError, match=re.escape(message)):
        four_wire(100.0, 80.0, Contact.points([(400, 20)]))


def test_a_contact_that_shorts_the_supply_is_refused() -> None:
    with pytest.raises(ContactError, match=r"shorts Vref to ground.*keep it off the sheets' edges"):
        four_wire(100.0, 80.0, box(0, 0, 100, 80))
    soft = four_wire(100.0, 80.0, box(0, 0, 100, 80), contact_lambda_mm=5.0)
    np.testing.assert_allclose((soft.x_mm, soft.y_mm), (50.0, 40.0), atol=1e-8)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"cells": 0}, OptionError, "cells = 0: must be a whole number, 1 to 1000"),
        ({"cells": (5, 2.5)}, OptionError, "cells[1] = 2.5: must be a whole number, 1 to 1000"),
        ({"cells": (5,)}, OptionError, "cells = (5,): give one number, or two: (along x, along y)"),
        ({"cells": True}, OptionError, "cells = True: must be a whole number"),
        ({"read": "top"}, OptionError, "read 'top' does not exist; choose one of: both, low, high"),
        ({"sheet_ratio": 0.0}, NetworkError, "sheet_ratio = 0.0: must be a finite number above 0"),
        ({"sheet_ratio": 1e12}, NetworkError, "the network's resistances lie a factor of"),
        (
            {"contact_lambda_mm": -1.0},
            NetworkError,
            "contact_lambda_mm = -1.0: must be 0 (ideal) or a finite",
        ),
        ({"point_squares": float("nan")}, NetworkError, "point_squares = nan: must be 0 (ideal) or a finite"),
        ({"point_squares": 1e-30}, NetworkError, "take 0 for an ideal contact"),
        ({"width_mm": 0.0}, OptionError, "width_mm = 0.0: must be a finite number of mm above 0"),
        ({"height_mm": float("inf")}, OptionError, "height_mm = inf: must be a finite number of mm above 0"),
    ],
)
def test_four_wire_refuses_what_cannot_be(
    change: dict[str, Any], error: type[Exception], message: str
) -> None:
    arguments: dict[str, Any] = {"width_mm": 100.0, "height_mm": 80.0, "contact": Contact.points([(40, 20)])}
    with pytest.raises(error, match=re.escape(message)):
        four_wire(**arguments | change)


# 2.2: the digital array


def connected(pattern: BoolArray) -> BoolArray:
    """Tell which rows and columns closed switches join, over any number of steps: no network."""
    reach = pattern.copy()
    while True:
        more = (reach.astype(int) @ pattern.T.astype(int) @ reach.astype(int) > 0) | reach
        if np.array_equal(more, reach):
            return reach
        reach = more


def random_patterns(count: int, seed: int) -> list[BoolArray]:
    rng = np.random.default_rng(seed)
    return [rng.random(rng.integers(1, 10, 2)) < rng.uniform(0.05, 0.6) for _ in range(count)]


def test_figure_2_4_three_closed_switches_close_a_fourth() -> None:
    pattern = chapter2.PARALLEL_PATH
    read = scan_array(pattern)
    assert np.argwhere(read.closed & ~pattern).tolist() == [[1, 1]]
    assert phantoms(pattern) == 1
    # By hand: Vref - contact - column j + 1 (load) - two contacts - column j (load).
    contact, load = 100.0, 1e5
    path = 1.0 / (1.0 / load + 1.0 / (2.0 * contact + load))
    first = path / (path + contact)
    np.testing.assert_allclose(
        read.volts[1], [0.0, first * load / (load + 2.0 * contact), first, 0.0], atol=1e-12
    )
    flow = switch_currents(pattern, 1)
    assert flow[2, 1] == pytest.approx(-flow[2, 2])  # into row i + 1 and out of it again
    assert flow[2, 2] < 0.0
    for isolation in ("diodes", "zero-potential"):
        np.testing.assert_array_equal(scan_array(pattern, isolation=isolation).closed, pattern)
        assert phantoms(pattern, isolation=isolation) == 0
    assert not np.any(switch_currents(pattern, 1, "diodes")[2])


@pytest.mark.parametrize("wire_ohm", [0.0, 0.5])
def test_without_isolation_a_tactel_reads_closed_where_row_and_column_are_connected(wire_ohm: float) -> None:
    wiring, more = ArrayWiring(load_ohm=1e9, wire_ohm=wire_ohm), 0
    for pattern in random_patterns(60, seed=4):
        read, rule = scan_array(pattern, isolation="none", wiring=wiring), connected(pattern)
        np.testing.assert_array_equal(read.closed, rule)
        assert np.all(np.where(rule, read.volts > 0.999, np.abs(read.volts) < 1e-6))
        assert phantoms(pattern, isolation="none", wiring=wiring) == np.sum(rule & ~pattern)
        more += int(np.sum(rule & ~pattern))
    assert more > 200


@pytest.mark.parametrize("isolation", ["diodes", "zero-potential"])
@pytest.mark.parametrize("wire_ohm", [0.0, 0.5])
def test_with_isolation_an_array_reads_what_is_closed(isolation: str, wire_ohm: float) -> None:
    wiring = ArrayWiring(wire_ohm=wire_ohm)
    for pattern in random_patterns(25, seed=5):
        np.testing.assert_array_equal(scan_array(pattern, isolation=isolation, wiring=wiring).closed, pattern)


def test_ideal_diodes_carry_forward_current_only_and_feed_the_loads() -> None:
    for pattern in random_patterns(15, seed=6):
        volts = scan_array(pattern, isolation="diodes", wiring=ArrayWiring(wire_ohm=2.0)).volts
        for row in range(len(pattern)):
            flow = switch_currents(pattern, row, "diodes", ArrayWiring(wire_ohm=2.0))
            assert flow.min() >= 0.0
            np.testing.assert_allclose(flow.sum(axis=0) / 100.0 * 1e5, volts[row], atol=1e-9)
            assert not np.any(np.delete(flow, row, axis=0) > 1e-12)


def test_one_closed_switch_reads_as_its_divider() -> None:
    pattern = np.zeros((4, 5), dtype=bool)
    pattern[1, 3] = True
    wiring = ArrayWiring(contact_ohm=200.0, wire_ohm=3.0, load_ohm=1e4)
    wires = 3.0 * (3 + 2)  # along row 1 to column 3, down from row 1 to row 3
    for isolation in ("none", "diodes"):
        expected = 1e4 / (1e4 + 200.0 + wires)
        assert scan_array(pattern, isolation=isolation, wiring=wiring).volts[1, 3] == pytest.approx(
            expected, abs=1e-12
        )
    zero = scan_array(pattern, isolation="zero-potential", wiring=wiring)
    assert zero.volts[1, 3] == pytest.approx(200.0 / (200.0 + wires), abs=1e-12)
    assert zero.volts.sum() == pytest.approx(zero.volts[1, 3])
    assert scan_array(pattern, isolation="zero-potential").volts.max() == 1.0


def test_nothing_closed_reads_nothing_and_all_closed_reads_all() -> None:
    for isolation in ISOLATIONS:
        for wire in (0.0, 1.0):
            wiring = ArrayWiring(wire_ohm=wire)
            empty, full = (
                scan_array(np.full((3, 4), v), isolation=isolation, wiring=wiring) for v in (False, True)
            )
            assert not empty.closed.any()
            assert not empty.volts.any()
            assert full.closed.all()


def test_long_wires_lose_contacts_at_zero_potential() -> None:
    """Grounded rows drain what a column's wire holds above 0 V: the price of this isolation."""
    pattern = np.ones((64, 64), dtype=bool)
    read = scan_array(pattern, isolation="zero-potential", wiring=ArrayWiring(wire_ohm=1.0)).closed
    assert read[-1, 0]
    assert not read[0, -1]


def test_a_solid_object_reads_as_its_bounding_box_without_isolation() -> None:
    pattern = tactels(chapter2.OBJECT, 20, 20, 5.0)
    rows, columns = np.any(pattern, axis=1, keepdims=True), np.any(pattern, axis=0, keepdims=True)
    np.testing.assert_array_equal(scan_array(pattern).closed, rows & columns)
    assert pattern.sum() == 94
    assert phantoms(pattern) == 62


def test_an_area_closes_tactels_by_their_centre_and_thin_contacts_by_their_square() -> None:
    area = tactels(box(5, 0, 15, 4.9), 3, 4, 10.0)  # centres at x = 5 and 15 on its edge, y = 5 above it
    assert not area.any()
    assert np.argwhere(tactels(box(5, 0, 15, 5), 3, 4, 10.0)).tolist() == [[0, 0], [0, 1]]
    assert np.argwhere(tactels(Contact.points([(39, 11)]), 3, 4, 10.0)).tolist() == [[1, 3]]
    assert np.argwhere(tactels(Contact.points([(20, 5)]), 3, 4, 10.0)).tolist() == [[0, 1], [0, 2]]
    assert np.argwhere(tactels(Contact.line([(1, 1), (9, 29)]), 3, 4, 10.0)).tolist() == [
        [0, 0],
        [1, 0],
        [2, 0],
    ]
    with pytest.raises(ContactError, match=re.escape("lies outside the array (x 0 to 40, y 0 to 30 mm)")):
        tactels(Contact.points([(41, 5)]), 3, 4, 10.0)
    with pytest.raises(OptionError, match="rows = 0: must be a whole number, 1 to 1000"):
        tactels(Contact.points([(1, 1)]), 0, 4, 10.0)
    with pytest.raises(OptionError, match=r"pitch_mm = -1\.0: must be a finite number of mm above 0"):
        tactels(Contact.points([(1, 1)]), 3, 4, -1.0)


@pytest.mark.parametrize(
    ("wiring", "message"),
    [
        ({"contact_ohm": 0.0}, "contact_ohm = 0.0: must be a finite number, above 0"),
        ({"wire_ohm": -1.0}, "wire_ohm = -1.0: must be a finite number, 0 (ideal) or more"),
        ({"load_ohm": float("inf")}, "load_ohm = inf: must be a finite number, above 0"),
        ({"load_ohm": 1e15}, "load_ohm = 1e+15: further apart than a factor of 1e+10"),
        ({"wire_ohm": 1e-20}, "bring them together, or take wire_ohm = 0"),
        (
            {"load_ohm": 50.0},
            "threshold = 0.5: must be above 0 and below 0.333333, which a closed switch alone",
        ),
        ({"threshold": 0.0}, "threshold = 0.0: must be above 0"),
        ({"threshold": float("nan")}, "threshold = nan: must be above 0"),
    ],
)
def test_a_wiring_that_cannot_be_is_refused(wiring: dict[str, float], message: str) -> None:
    with pytest.raises(NetworkError, match=re.escape(message)):
        ArrayWiring(**wiring)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ([True, False], "pattern: an array of shape (2,); give (rows, columns)"),
        (np.zeros((0, 3)), "pattern: an array of shape (0, 3)"),
        ([[1, 2]], "pattern: holds something else than true and false (or 1 and 0)"),
        ([[1.0, float("nan")]], "pattern: holds something else"),
        ([["yes"]], "pattern: holds something else"),
        ([[1, 0], [1]], "pattern: its rows differ in length"),
    ],
)
def test_a_pattern_that_cannot_be_is_refused(pattern: Any, message: str) -> None:
    with pytest.raises(NetworkError, match=re.escape(message)):
        scan_array(pattern)


def test_an_isolation_or_a_row_that_does_not_exist_is_refused() -> None:
    for ask in (scan_array, phantoms):
        with pytest.raises(OptionError) as error:
            ask([[True]], isolation="magic")
        assert str(error.value) == (
            "isolation 'magic' does not exist; choose one of: none, diodes, zero-potential"
        )
    with pytest.raises(OptionError, match="row = 1: the array has rows 0 to 0"):
        switch_currents([[True]], 1)

"""The bare sheet and contacts on it: both ways against each other, dense algebra and numbers worked by hand."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies import sheet as module
from studies.sheet import Sheet, Touch, by_factor, by_green, solve
from tacstrip.arrays import FloatArray
from tacstrip.errors import ContactError, NetworkError


def laplacian(sheet: Sheet) -> FloatArray:
    node = np.arange(sheet.columns * sheet.rows).reshape(sheet.columns, sheet.rows)
    matrix = np.zeros((node.size, node.size))
    for a, b, g in ((node[:-1], node[1:], sheet.across), (node[:, :-1], node[:, 1:], sheet.along)):
        for i, j in zip(a.ravel(), b.ravel(), strict=True):
            matrix[[i, j], [i, j]] += g
            matrix[[i, j], [j, i]] -= g
    return matrix


def random_touch(sheet: Sheet, count: int, seed: int = 0, sets: tuple[int, ...] = ()) -> Touch:
    random = np.random.default_rng(seed)
    node = random.choice(sheet.columns * sheet.rows, count, replace=False)
    ohm = random.choice([0.0, 0.3, 5.0], count)
    return Touch(node // sheet.rows, node % sheet.rows, ohm, random.uniform(0.0, 1.0, (count, *sets)))


@pytest.mark.parametrize("sheet", [Sheet(7, 5, 2.0, 0.3), Sheet(1, 6), Sheet(6, 1, 0.2, 9.0), Sheet(1, 1)])
def test_the_green_block_is_the_pseudo_inverse(sheet: Sheet) -> None:
    column, row = (i.ravel() for i in np.indices((sheet.columns, sheet.rows)))
    np.testing.assert_allclose(sheet.green(column, row), np.linalg.pinv(laplacian(sheet)), rtol=0, atol=1e-12)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.floats(-2, 2),
    st.floats(0, 1),
    st.integers(0, 99),
    st.booleans(),
)
def test_both_ways_agree(columns: int, rows: int, power: float, part: float, seed: int, many: bool) -> None:
    sheet = Sheet(columns, rows, across=10.0**power)
    touch = random_touch(sheet, max(1, int(part * columns * rows)), seed, (3,) if many else ())
    green, factor = by_green(sheet, touch), by_factor(sheet, touch)
    assert green.shape == factor.shape == (columns, rows, *touch.volt.shape[1:])
    np.testing.assert_allclose(green, factor, rtol=0, atol=1e-10)


def test_both_ways_agree_on_a_large_sheet() -> None:
    sheet = Sheet(100, 100)
    for count in (1, 70, 400):
        touch = random_touch(sheet, count)
        np.testing.assert_allclose(by_green(sheet, touch), by_factor(sheet, touch), rtol=0, atol=1e-11)


def test_a_row_of_three_worked_by_hand() -> None:
    """1 - ohm 2 - node 0 - ohm 0.5 - node 1 - ohm 0.5 - node 2 - ohm 1 - 0: a divider of 4 ohm."""
    touch = Touch(np.array([0, 2]), np.array([0, 0]), np.array([2.0, 1.0]), np.array([1.0, 0.0]))
    np.testing.assert_allclose(solve(Sheet(3, 1, across=2.0), touch).ravel(), [0.5, 0.375, 0.25], atol=1e-15)


def test_one_node_takes_the_whole_sheet_along() -> None:
    touch = Touch(np.array([3]), np.array([2]), np.array([7.0]), np.array([0.4]))
    np.testing.assert_allclose(solve(Sheet(9, 8), touch), 0.4, atol=1e-14)


def test_a_sheet_of_one_node_held_ideally() -> None:
    touch = Touch(np.array([0]), np.array([0]), np.array([0.0]), np.array([0.4]))
    for way in (by_green, by_factor):
        np.testing.assert_allclose(way(Sheet(1, 1), touch), 0.4, atol=1e-15)


def test_held_nodes_hold_and_no_current_is_lost() -> None:
    sheet = Sheet(15, 11, 1.0, 3.0)
    touch = random_touch(sheet, 30)
    potentials = solve(sheet, touch)
    ideal = touch.ohm == 0.0
    np.testing.assert_allclose(potentials[touch.column, touch.row][ideal], touch.volt[ideal], atol=1e-13)
    into = (laplacian(sheet) @ potentials.ravel()).reshape(15, 11)
    assert into.sum() == pytest.approx(0.0, abs=1e-12)
    real = ~ideal
    drop = touch.volt[real] - potentials[touch.column, touch.row][real]
    np.testing.assert_allclose(into[touch.column, touch.row][real], drop / touch.ohm[real], atol=1e-12)
    into[touch.column, touch.row] = 0.0
    np.testing.assert_allclose(into, 0.0, atol=1e-12)


def test_few_nodes_go_by_green_and_many_by_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = []
    for way in ("by_green", "by_factor"):
        monkeypatch.setattr(module, way, lambda sheet, touch, way=way: taken.append(way))
    for count in (1, 128, 129, 400):
        solve(Sheet(20, 20), random_touch(Sheet(20, 20), count))
    assert taken == ["by_green", "by_green", "by_factor", "by_factor"]


SHEET = Sheet(4, 3)
GOOD = {"column": [0, 1], "row": [0, 1], "ohm": [0.0, 1.0], "volt": [0.0, 1.0]}


@pytest.mark.parametrize("way", [solve, by_green, by_factor])
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"column": [], "row": [], "ohm": [], "volt": []}, "the contact touches no node: the sheet floats"),
        ({"column": [0, 4]}, "node (4, 1) is off the sheet: columns 0 to 3, rows 0 to 2"),
        ({"row": [-1, 1]}, "node (0, -1) is off the sheet"),
        ({"column": [1, 1], "row": [2, 2]}, "a node is touched twice"),
        ({"ohm": [1.0, -1.0]}, "ohm = -1 at node (1, 1): must be 0 (ideal) or more"),
        ({"ohm": [1.0, np.nan]}, "ohm = nan at node (1, 1)"),
        ({"ohm": [1.0, np.inf]}, "ohm = inf at node (1, 1)"),
        ({"volt": [1.0, np.nan]}, "volt has values that are not finite"),
        ({"volt": [1.0]}, "give one value of each per touched node"),
    ],
)
def test_contacts_that_cannot_be(way: type, changed: dict[str, list[float]], message: str) -> None:
    given = GOOD | changed
    touch = Touch(
        np.array(given["column"], dtype=np.int64),
        np.array(given["row"], dtype=np.int64),
        np.array(given["ohm"], dtype=float),
        np.array(given["volt"], dtype=float),
    )
    with pytest.raises(ContactError, match=re.escape(message)):
        way(SHEET, touch)


def test_sheets_that_cannot_be() -> None:
    with pytest.raises(NetworkError, match="a sheet of 0 x 3 nodes: give 1 x 1 or more"):
        Sheet(0, 3)
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(NetworkError, match=r"across = .*: a conductance must be finite and above 0"):
            Sheet(2, 2, across=wrong)

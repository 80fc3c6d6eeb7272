"""Strips under ideal contact by boundary integrals: against the conformal map, symmetry and bounds."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from tacstrip.contact.resolved_ends import resolved_ends
from tacstrip.contact.slant import edge_read, slant_shift

B, L = 10.0, 400.0


def ends(*shapes: shapely.Geometry) -> tuple[float, float]:
    found = resolved_ends(shapes, 0.5 * B, B, L)
    assert found is not None
    return found


@pytest.mark.parametrize("slope", [0.0, 0.3, -1.0, 2.0, 6.0])
def test_a_slanted_edge_reads_as_the_conformal_map_says(slope: float) -> None:
    rise = 0.5 * B * slope
    l, u = ends(shapely.Polygon([(0, 100 - rise), (B, 100 + rise), (B, 250), (0, 250)]))
    assert l == pytest.approx(100.0 - B * float(slant_shift(slope)), abs=1e-3 * B)
    assert u == pytest.approx(250.0, abs=1e-4 * B)


def test_two_pieces_read_as_their_hull_and_a_mirrored_contact_alike() -> None:
    low = shapely.Polygon([(0, 50), (B, 56), (B, 80), (0, 70)])
    high = shapely.Polygon([(0, 200), (B, 190), (B, 220), (0, 230)])
    assert ends(low, high) == pytest.approx((ends(low)[0], ends(high)[1]), abs=1e-3 * B)
    turned = shapely.transform(low, lambda xy: np.array([B, L]) - xy)
    assert ends(turned) == pytest.approx(tuple(L - end for end in ends(low)[::-1]), abs=1e-6)


def test_an_apex_reads_as_an_edge_of_half_the_strip() -> None:
    apex = shapely.Polygon([(0, 100), (B, 100), (B, 200), (0.5 * B, 210), (0, 200)])
    assert ends(apex)[1] == pytest.approx(205.0 + 0.5 * B * float(slant_shift(2.0)), abs=1e-3 * B)


def test_an_upright_side_within_the_strip_reads_short_of_its_ends() -> None:
    """A contact along one side, of half the width or a hundredth: nearer to ln 4 / pi of the width, the thinner."""
    short = [ends(shapely.box(0.0, 100.0, wide * B, 300.0))[0] - 100.0 for wide in (0.9, 0.5, 0.1, 0.001)]
    assert np.all(np.diff([0.0, *short]) > 0.0)
    assert short[-1] == pytest.approx(B * np.log(4.0) / np.pi, abs=5e-3 * B)


def test_an_image_in_the_bar_counts_only_near_it() -> None:
    """The bar is even: a straight edge is not changed by it, a slanted one is where it is within a width."""

    def shift(middle: float) -> float:
        slanted = shapely.Polygon([(0, middle - 4), (B, middle + 4), (B, 200), (0, 200)])
        return ends(slanted)[0] - middle

    assert shift(60.0) == pytest.approx(shift(29.9), abs=1e-6 * B)
    assert abs(shift(5.0) - shift(60.0)) > 1e-3 * B


@pytest.mark.parametrize(
    "shape",
    [
        shapely.LineString([(0, 50), (B, 80)]),
        shapely.Polygon([(0, 0), (B, 0), (B, 50), (0, 60)]),
        shapely.box(0.0, 0.0, B, L),
        shapely.box(2.0 * B, 50.0, 3.0 * B, 80.0),
    ],
)
def test_what_cannot_be_solved_so_is_left(shape: shapely.Geometry) -> None:
    """Lines, contacts that reach a bar or both, and those beside the strip."""
    assert resolved_ends([shape], 0.5 * B, B, L) is None


def test_ends_are_rounded_beyond_what_threads_and_processors_change() -> None:
    """Fits that repeat with them would part at the last bit, to other corner counts."""
    angles = np.sort(np.random.default_rng(8).uniform(0.0, 2.0 * np.pi, (20, 6)), axis=1)
    for each in angles:
        shape = shapely.Polygon(np.stack([5.0 + 12.0 * np.cos(each), 100.0 + 30.0 * np.sin(each)], axis=1))
        digits = np.array(ends(shape)) / B * 1e7
        np.testing.assert_allclose(digits, digits.round(), atol=1e-5)


def test_no_edge_reads_beyond_its_furthest_point() -> None:
    """An upright side within the strip has a slope beyond any table; its edge reads between its heights."""
    height = np.full(17, np.nan)
    height[9:] = np.linspace(80.0, 20.0, 8)
    for lam in (0.0, 3.0):
        assert 20.0 <= edge_read(height, 1.0, -1.0, lam) <= edge_read(height, 1.0, 1.0, lam) <= 80.0


@pytest.mark.parametrize("slope", [0.3, 3.0, 33.3, 49.0])
def test_an_edge_cut_into_parts_reads_as_the_whole_edge(slope: float) -> None:
    height = np.linspace(-0.5, 0.5, 17) * slope
    assert edge_read(height, 1.0, 1.0, 0.0) == pytest.approx(slant_shift(slope), abs=3e-4)

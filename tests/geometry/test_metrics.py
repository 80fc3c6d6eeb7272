from __future__ import annotations

import dataclasses
import tracemalloc
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tacstrip.errors import ContactError, OptionError
from tacstrip.geometry.metrics import (
    clean_polygon,
    column_iou,
    errors_of_many,
    mismatch,
    mismatch_coefficient,
    pairwise_column_iou,
)
from tacstrip.geometry.moments import moments

if TYPE_CHECKING:
    from collections.abc import Callable

    from tacstrip.arrays import FloatArray

FIXED = settings(derandomize=True, deadline=None, max_examples=50)
SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
TRIANGLE = np.array([(0.0, 0.0), (6.0, 0.0), (0.0, 3.0)])
LETTER_L = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)])
# Ten corners that curl until the right end crosses the upper arm; total turning 2 pi, overlap 1 mm^2.
CURL = np.array([(0, 0), (6, 0), (6, 6), (5, 6), (5, 1), (1, 1), (1, 4), (7, 4), (7, 5), (0, 5)], dtype=float)


@st.composite
def polygons(draw: st.DrawFn, most: int = 7) -> FloatArray:
    """Star-shaped polygons about (12, -7) with 3 to `most` corners, convex or not."""
    n = draw(st.integers(3, most))
    draws = st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n)
    angle = (np.arange(n) + 0.4 * np.array(draw(draws))) * 2.0 * np.pi / n
    radius = 2.0 + 3.0 * np.array(draw(draws))
    return np.stack((12.0 + radius * np.cos(angle), -7.0 + radius * np.sin(angle)), axis=1)


def regular(n: int, radius: float = 1.0) -> FloatArray:
    angle = np.arange(n) * 2.0 * np.pi / n
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=1)


def turned(vertices: FloatArray, angle: float, about: npt.ArrayLike = (0.0, 0.0)) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    center = np.asarray(about, dtype=np.float64)
    moved: FloatArray = (vertices - center) @ np.array([(c, s), (-s, c)]) + center
    return moved


def rectangle(width: float, height: float) -> FloatArray:
    return np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])


# Turning functions the slow way: headings of sides looked up along the boundary.


def turning_function(vertices: FloatArray) -> tuple[FloatArray, Callable[[FloatArray], FloatArray], float]:
    """Return the corners' places [parts of the perimeter], theta(s) for any s, and the sum of all |turns|."""
    side = np.roll(vertices, -1, axis=0) - vertices
    ends = np.cumsum(np.hypot(*side.T))
    ends /= ends[-1]
    heading = np.unwrap(np.append(np.arctan2(side[:, 1], side[:, 0]), np.arctan2(side[0, 1], side[0, 0])))

    def theta(s: FloatArray) -> FloatArray:
        rounds = np.floor(s)
        found: FloatArray = heading[np.searchsorted(ends[:-1], s - rounds)] + 2.0 * np.pi * rounds
        return found

    return ends, theta, float(np.abs(np.diff(heading)).sum())


def distance_at(a: FloatArray, b: FloatArray, start: float) -> float:
    """Return the L1 distance for one start, with the best rotation among all that could be the best."""
    (corners_a, theta_a, _), (corners_b, theta_b, _) = turning_function(a), turning_function(b)
    cuts = np.unique(np.concatenate(([0.0, 1.0], (corners_a - start) % 1.0, corners_b % 1.0)))
    middle, length = 0.5 * (cuts[1:] + cuts[:-1]), np.diff(cuts)
    difference = theta_a(middle + start) - theta_b(middle)
    return float((np.abs(difference[:, np.newaxis] - difference) * length[:, np.newaxis]).sum(axis=0).min())


@settings(FIXED, max_examples=25)
@given(polygons(), polygons())
def test_mc_is_the_least_of_a_scan_over_starts(a: FloatArray, b: FloatArray) -> None:
    starts = 200
    scan = min(distance_at(a, b, start) for start in np.arange(starts) / starts)
    steepest = turning_function(a)[2]  # |d distance / d start| is at most the sum of all |turns|
    exact = mismatch_coefficient(a, b)
    assert exact <= scan + 1e-9
    assert scan - exact <= 0.5 * steepest / starts


@pytest.mark.parametrize("sides", [(1.0, 1.0), (3.0, 1.0), (1.0, 10.0), (1e4, 1.0)])
def test_mc_of_a_square_and_a_rectangle(sides: tuple[float, float]) -> None:
    # With one corner together, the two opposite sides that are longer than a quarter round by p - 1/4 each
    # see a difference of pi/2; elsewhere it is 0, the median.
    p = max(sides) / (2.0 * sum(sides))
    assert mismatch_coefficient(SQUARE, rectangle(*sides)) == pytest.approx(np.pi * (p - 0.25), abs=1e-12)


def test_mc_of_a_square_and_an_equilateral_triangle() -> None:
    # Differences pi/6, -pi/3, pi/3, -pi/6, pi/2, 0 over 3, 1, 2, 2, 1, 3 twelfths of the perimeter; median 0.
    assert mismatch_coefficient(regular(3), SQUARE) == pytest.approx(7.0 * np.pi / 36.0, abs=1e-12)


def test_mc_does_not_depend_on_how_the_work_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = mismatch_coefficient(LETTER_L, CURL)
    for chunk in (1, 40, 100, 16 * 59, 16 * 60):  # 16 corners, 60 starts
        monkeypatch.setattr("tacstrip.geometry.metrics._CHUNK", chunk)
        assert mismatch_coefficient(LETTER_L, CURL) == whole
    assert whole > 0.5


@FIXED
@given(polygons())
def test_a_polygon_matches_itself(a: FloatArray) -> None:
    same = mismatch(a, a)
    assert (same.mc, same.mc_length, same.aoe, same.ape) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-12)


@FIXED
@given(polygons(), polygons(), polygons())
def test_mc_is_a_metric(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    ab, bc, ac = mismatch_coefficient(a, b), mismatch_coefficient(b, c), mismatch_coefficient(a, c)
    assert min(ab, bc, ac) >= 0.0
    assert ac <= ab + bc + 1e-9
    assert mismatch_coefficient(b, a) == pytest.approx(ab, abs=1e-12)


@FIXED
@given(
    a=polygons(),
    b=polygons(),
    angle=st.floats(-np.pi, np.pi),
    scale=st.floats(1e-3, 1e3),
    shift=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
)
def test_mc_knows_only_shape(
    a: FloatArray, b: FloatArray, angle: float, scale: float, shift: tuple[float, float]
) -> None:
    moved = scale * (turned(b, angle) + shift)
    assert mismatch_coefficient(a, moved) == pytest.approx(mismatch_coefficient(a, b), abs=1e-8)


def close(vertices: FloatArray) -> FloatArray:
    return np.concatenate((vertices, vertices[:1]))


def repeat(vertices: FloatArray) -> FloatArray:
    return np.repeat(vertices, [1 + k % 3 for k in range(len(vertices))], axis=0)


def subdivide(vertices: FloatArray) -> FloatArray:
    after = np.roll(vertices, -1, axis=0)
    return np.stack((vertices, 0.7 * vertices + 0.3 * after, 0.1 * vertices + 0.9 * after), axis=1).reshape(
        -1, 2
    )


WRITINGS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "other start": lambda v: np.roll(v, 2, axis=0),
    "clockwise": lambda v: v[::-1],
    "closed": close,
    "closed, clockwise": lambda v: close(v)[::-1],
    "repeated points": repeat,
    "points on sides": subdivide,
    "all": lambda v: close(repeat(subdivide(v))),
}


@pytest.mark.parametrize("writing", WRITINGS)
@settings(FIXED, max_examples=20)
@given(a=polygons(), b=polygons())
def test_the_way_a_polygon_is_written_does_not_matter(writing: str, a: FloatArray, b: FloatArray) -> None:
    written, plain = mismatch(a, WRITINGS[writing](b)), mismatch(a, b)
    assert (written.mc, written.ape) == pytest.approx((plain.mc, plain.ape), abs=1e-8)
    assert written.mc_length == pytest.approx(plain.mc_length, abs=1e-6)


def test_clean_polygon_keeps_corners_only() -> None:
    for write in WRITINGS.values():
        cleaned = clean_polygon(write(LETTER_L))
        assert moments(cleaned)[0] == pytest.approx(18.0)
        first = int(np.argmin(np.hypot(*cleaned.T)))  # the corner (0, 0)
        np.testing.assert_allclose(np.roll(cleaned, -first, axis=0), LETTER_L, atol=1e-12)


def test_mc_length_is_mc_times_the_mean_perimeter() -> None:
    found = mismatch(SQUARE, rectangle(3.0, 1.0))  # perimeters 8 and 8
    assert found.mc_length == pytest.approx(8.0 * np.pi / 8.0)
    assert mismatch(SQUARE, rectangle(6.0, 2.0)).mc_length == pytest.approx(12.0 * np.pi / 8.0)


@FIXED
@given(polygons(most=6), st.floats(-0.1, 0.1), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_a_known_motion_is_found_exactly(a: FloatArray, angle: float, dx: float, dy: float) -> None:
    moved = turned(a, angle, about=moments(clean_polygon(a))[1]) + np.array((dx, dy))
    found = mismatch(a, moved)
    assert found.mc == pytest.approx(0.0, abs=1e-8)
    assert found.aoe == pytest.approx(abs(angle), abs=1e-9)
    assert found.ape == pytest.approx(np.hypot(dx, dy), abs=1e-9)


@pytest.mark.parametrize("degrees", [-50.0, -10.0, 0.0, 30.0, 59.0])
@pytest.mark.parametrize("kind", ["area", "vertices"])
def test_aoe_of_a_turned_triangle(degrees: float, kind: Any) -> None:
    found = mismatch(TRIANGLE, turned(TRIANGLE, np.radians(degrees), about=(30.0, 4.0)), centroid=kind)
    assert found.aoe == pytest.approx(np.radians(abs(degrees)), abs=1e-12)


def test_aoe_takes_corners_for_partners_by_the_least_squares_pairing() -> None:
    # A quarter turn maps the square onto itself: no mismatch. Far beyond half a side the pairing slips on.
    assert mismatch(SQUARE, turned(SQUARE, 0.5 * np.pi)).aoe == pytest.approx(0.0, abs=1e-12)
    assert mismatch(SQUARE, turned(SQUARE, np.radians(50.0))).aoe == pytest.approx(np.radians(40.0))


def test_aoe_takes_the_first_of_equally_far_corners() -> None:
    square = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    kite = np.array([(2.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (0.0, -1.0)])  # mean of the corners (0, 0)
    assert mismatch(square, kite, centroid="vertices").aoe == pytest.approx(np.pi / 4.0 - np.arctan(0.5))
    assert mismatch(np.roll(square, -1, axis=0), kite, centroid="vertices").aoe == pytest.approx(
        0.0, abs=1e-12
    )


@pytest.mark.parametrize("angle", np.linspace(0.0, 6.0, 7))
def test_rounding_does_not_choose_among_equally_far_corners(angle: float) -> None:
    square, kite = (
        turned(SQUARE, angle),
        turned(np.array([(0.0, 0.0), (2.0, 0.0), (3.0, 2.0), (0.0, 2.0)]), angle),
    )
    # Mean of the kite's corners (1.25, 1): the first reference lines point to (-1, -1) and (-1.25, -1).
    found = mismatch(square / 3.0 + 0.1, kite, centroid="vertices")
    assert found.aoe == pytest.approx(np.pi / 4.0 - np.arctan(0.8), abs=1e-9)


def test_aoe_with_unequal_corner_counts_takes_the_nearest() -> None:
    # From the centroid the triangle's farthest corner is (4, -1); nearest to it is the square's (2, -2).
    assert mismatch(TRIANGLE, 2.0 * SQUARE).aoe == pytest.approx(np.pi / 4.0 - np.arctan(0.25))


def test_centroids() -> None:
    apart = mismatch(LETTER_L, SQUARE)
    assert apart.ape == pytest.approx(np.hypot(33.0 / 18.0 - 1.0, 42.0 / 18.0 - 1.0))
    assert mismatch(LETTER_L, SQUARE, centroid="vertices").ape == pytest.approx(
        np.hypot(4.0 / 3.0, 5.0 / 3.0)
    )


def test_far_from_the_origin_no_digits_are_lost() -> None:
    far = mismatch(LETTER_L + 1e6, SQUARE + 1e6)
    assert far.ape == pytest.approx(mismatch(LETTER_L, SQUARE).ape, abs=1e-9)
    cleaned = clean_polygon(0.7 * SQUARE[::-1] + 1e6)  # counter-clockwise whichever way it was listed
    assert moments(cleaned)[0] == pytest.approx(1.96, rel=1e-8)


def test_iou_and_hausdorff_of_squares() -> None:
    beside = mismatch(SQUARE, SQUARE + np.array((1.0, 0.0)))
    assert (beside.iou, beside.hausdorff) == pytest.approx((1.0 / 3.0, 1.0))
    within = mismatch(5.0 * SQUARE, 2.0 * SQUARE + 3.0)
    assert (within.iou, within.hausdorff) == pytest.approx((0.16, 3.0 * np.sqrt(2.0)))
    apart = mismatch(SQUARE, SQUARE + 10.0)
    assert (apart.iou, apart.hausdorff) == pytest.approx((0.0, 10.0 * np.sqrt(2.0)))


def test_hausdorff_looks_between_corners() -> None:
    # A frame with a pocket cut along the diagonal y = x + 0.2: its point (4.9, 5.1) is 4.9 from the square.
    pocket = [
        (0, 0),
        (10, 0),
        (10, 10),
        (0, 10),
        (0, 5),
        (0.1, 5),
        (0.1, 9.9),
        (9.7, 9.9),
        (0.1, 0.3),
        (0.1, 4.9),
    ]
    found = mismatch(5.0 * SQUARE, [*pocket, (0, 4.9)]).hausdorff
    longest = 9.6 * np.sqrt(2.0)
    assert 4.9 - longest / 200.0 <= found <= 4.9 + 1e-12


def test_iou_of_a_polygon_that_overlaps_itself_counts_the_overlap_once() -> None:
    found = mismatch(3.0 * SQUARE, CURL)
    assert found.iou == pytest.approx(19.0 / 37.0)
    assert found.hausdorff == pytest.approx(2.0)  # from (3, 4) to the square's top side, y = 6


def test_mismatch_is_frozen_and_leaves_companions_until_asked() -> None:
    found = mismatch(SQUARE, TRIANGLE)
    assert "iou" not in vars(found)
    assert found.iou == vars(found)["iou"]
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.mc = 0.0  # type: ignore[misc]
    assert repr(found).startswith("Mismatch(mc=")
    assert "array" not in repr(found)


BOW_TIE = [(0, 0), (4, 4), (4, 0), (0, 2)]
PENTAGRAM = regular(5)[[0, 2, 4, 1, 3]]
BROKEN: dict[str, tuple[Any, str]] = {
    "empty": (np.empty((0, 2)), "has fewer than three distinct corners; give at least three"),
    "two corners": ([(0, 0), (1, 1), (1, 1), (0, 0)], "has fewer than three distinct corners"),
    "one corner": ([(1, 1)] * 5, "has fewer than three distinct corners"),
    "a line": ([(0, 0), (1, 1), (3, 3)], "has no area: its corners lie on one line, .* in their order along"),
    "a rounded line": ([(0, 0), (0.1, 0.3), (0.7, 2.1)], "has no area"),
    "there and back": ([(0, 0), (1, 1), (0, 0), (1, 1)], "has no area"),
    "even bow-tie": ([(0, 0), (1, 1), (1, 0), (0, 1)], "has no area: .* or its sides cross"),
    "bow-tie": (
        BOW_TIE,
        r"turns by -?[\d.e-]+ pi, not 2 pi: its sides cross; give its corners in their order",
    ),
    "pentagram": (PENTAGRAM, "turns by 4 pi, not 2 pi: its sides cross"),
    "nan": ([(0, 0), (1, 0), (np.nan, 1)], r"has corner 2 at \[nan +1\.\]; remove it or give finite numbers"),
    "inf": ([(0, -np.inf), (1, 0), (0, 1)], r"has corner 0 at \[ *0\. +-inf\]"),
    "3-D": (np.zeros((4, 3)), r"is an array of shape \(4, 3\); give its corners as \(N, 2\) \[mm\]"),
    "flat": ([0, 0, 1, 0, 0, 1], r"is an array of shape \(6,\)"),
    "ragged": ([(0, 0), (1, 0), (0,)], r"is not an \(N, 2\) array of numbers \[mm\]: .*inhomogeneous"),
    "text": ("POLYGON", r"is not an \(N, 2\) array of numbers \[mm\]: could not convert"),
}


@pytest.mark.parametrize("broken", BROKEN)
def test_what_is_no_polygon_is_named(broken: str) -> None:
    vertices, message = BROKEN[broken]
    with pytest.raises(ContactError, match=f"^the original polygon {message}"):
        mismatch(vertices, SQUARE)
    with pytest.raises(ContactError, match=f"^the recovered polygon {message}"):
        mismatch(SQUARE, vertices)
    with pytest.raises(ContactError, match=f"^polygon b {message}"):
        mismatch_coefficient(SQUARE, vertices)
    with pytest.raises(ContactError, match=f"^the polygon {message}"):
        clean_polygon(vertices)


def test_corners_must_be_finite() -> None:
    with pytest.raises(ContactError, match=r"^the polygon has corner 1 at \[inf +0\.\]"):
        clean_polygon([(0, 0), (np.inf, 0), (0, 1)])


def test_an_unknown_centroid_is_refused() -> None:
    message = "^centroid 'middle' does not exist; choose one of: area, vertices$"
    with pytest.raises(OptionError, match=message):
        mismatch(SQUARE, SQUARE, centroid="middle")  # type: ignore[arg-type]


def test_a_raw_profile_of_1000_points() -> None:
    tracemalloc.start()
    found = mismatch(regular(6, 10.0), regular(1000, 10.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # On a circle theta grows evenly, against steps of pi/3: a mean difference of pi/12 from the median.
    assert found.mc == pytest.approx(np.pi / 12.0, abs=1e-3)
    assert found.aoe == pytest.approx(0.0, abs=1e-9)
    assert found.ape == pytest.approx(0.0, abs=1e-9)
    assert peak < 100e6


def test_a_spike_without_width_is_dropped() -> None:
    """A noisy profile can end in strips where l = u: they enclose nothing and turn nothing."""
    square = [(0, 0), (2, 0), (2, 2), (0, 2)]
    spiked = [(0, 0), (2, 0), (2, 2), (2, 5), (2, 7), (2, 5), (2, 2), (0, 2)]
    np.testing.assert_allclose(clean_polygon(spiked), clean_polygon(square))
    assert mismatch(square, spiked).mc == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("corners", "sides"), [(5, 5), (4, 6)])
def test_errors_of_many_are_those_of_each(corners: int, sides: int) -> None:
    """Clockwise ones and repeated corners among them; NaN where there is no polygon."""
    random = np.random.default_rng(2)
    original = regular(corners, 10.0) * [1.0, 1.3]
    many = regular(sides, 8.0) + random.normal(0.0, 1.0, (20, sides, 2))
    many[3] = many[3, ::-1]
    many[4, 1] = many[4, 0]
    many[5] = 1.0
    many[6, [1, 2]] = many[6, [2, 1]]
    errors = errors_of_many(original, many)
    assert np.flatnonzero(np.isnan(errors).any(axis=1)).tolist() == [5, 6]
    for k in set(range(20)) - {5, 6}:
        m = mismatch(original, many[k])
        np.testing.assert_allclose(errors[k], [m.mc, m.aoe, m.ape], rtol=0, atol=1e-12)


def test_overlaps_of_all_pairs_are_those_of_each() -> None:
    ends = np.sort(np.random.default_rng(1).random((7, 2, 30)), axis=1)
    ends[:2, :, :20], ends[2, :, 20:] = 0.0, 0.0  # two of them apart from a third one
    each = [[column_iou(a, b) for b in ends] for a in ends]
    np.testing.assert_array_equal(pairwise_column_iou(ends), each)
    assert pairwise_column_iou(ends)[0, 2] == 0.0

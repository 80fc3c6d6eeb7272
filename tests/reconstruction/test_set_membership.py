"""Bounded noise: the set of outlines that explain every reading, its sample, its regions, its emptiness."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import tacstrip as ts
from strategies import FIXED
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import digitise
from tacstrip.core.binding import exported
from tacstrip.core.hit_and_run import hit_and_run, plain_hit_and_run
from tacstrip.core.polytope import (
    MOST_DIMENSIONS,
    analytic_centre,
    feasible_part,
    largest,
    lowest,
    minimax,
    plain_analytic_centre,
    plain_feasible_part,
    plain_lowest,
    plain_minimax,
)
from tacstrip.geometry.moments import moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance, vertex_rms
from tacstrip.reconstruction.set_membership import estimate
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds, reading_bound
from tacstrip.reconstruction.set_membership.estimate import Bounded, fewest, refine, within
from tacstrip.reconstruction.set_membership.feasible_set import FeasibleSet, feasible_set, plain_feasible_set
from tacstrip.reconstruction.set_membership.outlines import (
    draw_outlines,
    plain_draw_outlines,
    plain_scatter,
    scatter,
)

L = 1000.0
PENTAGON = Outline.of([(30.3, 400.0), (60.2, 250.0), (118.7, 300.0), (92.4, 720.0), (48.9, 640.0)])
SHAPES = {
    "pentagon": PENTAGON,
    "square": Outline.of([(30.3, 200.0), (110.6, 260.0), (110.6, 700.0), (30.3, 640.0)]),
    "concave": Outline.of([(30.3, 300.0), (80.2, 300.0), (110.7, 600.0), (70.1, 480.0), (50.2, 800.0)]),
}


def a_sensor(construction: str = "crs-crs", pitch: float = 1.0, **changed: Any) -> ts.Sensor:
    size = {"strips": round(160 / pitch), "pitch_mm": pitch, "length_mm": L, "adc_bits": 12}
    return ts.Sensor(construction=construction, **(size | changed))


def readings_of(
    outline: Outline, sensor: ts.Sensor, reach: float, seed: int
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Centre lines and readings of an outline, with errors uniform within +-reach."""
    random = np.random.default_rng(seed)
    x = sensor.x_mm[outline.touches(sensor.x_mm)]
    ideal = ts.signatures(sensor, *outline.ends(x))
    return x, {
        n: digitise(k + random.uniform(-reach, reach, len(x)), sensor.adc_bits) for n, k in ideal.items()
    }


def a_band(
    outline: Outline, sensor: ts.Sensor, noise: ts.Noise, seed: int, names: tuple[str, ...] | None = None
) -> ReadingBounds:
    x, readings = readings_of(outline, sensor, noise.positional, seed)
    return ReadingBounds.of(sensor, x, {name: readings[name] for name in names or sensor.signatures}, noise)


def refined(outline: Outline, band: ReadingBounds, noise: ts.Noise) -> Bounded:
    """Refine from the truth, as wrong as least squares would be."""
    bound = vertex_covariance(outline, band.sensor, reading_sigma(noise, band.sensor), tuple(band.low))
    found = refine(outline, bound, band)
    assert found is not None
    return found


NOISE = ts.Noise(positional=0.005)
CASES = {
    "both": ("crs-crs", {}, None),
    "kh": ("crs-crs", {}, ("kh",)),
    "k": ("crs-m", {}, None),
    "unequal, resistive": ("crs-crs", {"resistivity_ratio": 2.0, "contact_lambda_mm": 20.0}, None),
}


# Bounds and lines


def test_errors_add_up_to_a_trapezoid() -> None:
    sensor = a_sensor(adc_bits=None)
    assert reading_bound(ts.Noise(quantisation=0.001, positional=0.005), sensor) == pytest.approx(
        (0.006, 0.004)
    )
    assert reading_bound(ts.Noise(quantisation=0.005, positional=0.005), sensor) == pytest.approx((0.01, 0.0))
    assert reading_bound(ts.Noise(), a_sensor(adc_bits=1)) == pytest.approx((0.5, 0.5))
    assert reading_bound(ts.Noise(), sensor) == (0.0, 0.0)


def test_bounds_stay_in_what_a_reading_can_be() -> None:
    x = np.arange(3.0)
    band = ReadingBounds.of(
        a_sensor(adc_bits=None), x, {"kh": np.array([0.0, 0.5, 1.0])}, ts.Noise(positional=0.1)
    )
    np.testing.assert_allclose(band.low["kh"], [0.0, 0.4, 0.9])
    np.testing.assert_allclose(band.high["kh"], [0.1, 0.6, 1.0])
    np.testing.assert_allclose(band.windows, [[-1.0, 0.0], [2.0, 3.0]])


@pytest.mark.parametrize("shape", SHAPES)
def test_lines_are_an_outline_and_back(shape: str) -> None:
    outline = SHAPES[shape]
    lines, heights = EdgeLines.of(outline)
    vertical_x = np.array([outline.lower[0, 0], outline.lower[-1, 0]])
    for found, chain in zip(lines.chains(heights, vertical_x), (outline.lower, outline.upper), strict=True):
        np.testing.assert_allclose(found, chain, rtol=0, atol=1e-9)
    kinks = [*outline.lower[1:-1, 0], *outline.upper[1:-1, 0]]
    np.testing.assert_allclose(lines.cross(heights)[: len(kinks)], kinks)
    assert lines.vertical == ((True, True) if shape == "square" else (False, False))
    many = np.stack([heights, heights + 1.0])
    np.testing.assert_allclose(
        lines.chains(many, np.stack([vertical_x, vertical_x]))[0][1], outline.lower + np.array([0.0, 1.0])
    )


def test_zones_end_halfway_and_at_the_outer_strips() -> None:
    lines, _ = EdgeLines.of(PENTAGON)
    band = ReadingBounds(a_sensor(), np.arange(31.0, 119.0), {}, {}, 0.0)
    zones = within(lines, np.array([60.2, 48.9, 92.4]), np.array([5.0, 30.0, 100.0]), band)
    np.testing.assert_allclose(zones, [[55.2, 65.2], [31.0, 70.65], [70.65, 118.0]])
    outside = within(lines, np.array([0.0, 48.9, 92.4]), np.zeros(3), band)
    assert np.all(outside[:, 1] - outside[:, 0] >= 0.5)


# The set


def heights_of(outline: Outline, lines: EdgeLines) -> FloatArray:
    """Heights of an outline's edges at the abscissae of other lines."""
    edges = [(c[i], c[i + 1]) for c in (outline.lower, outline.upper) for i in range(len(c) - 1)]
    heights = [
        a[1] + (b[1] - a[1]) * (reach - a[0]) / (b[0] - a[0])
        for (a, b), reach in zip(edges, lines.reach, strict=True)
    ]
    return np.concatenate(heights)


def holds(bounds: FeasibleSet, heights: FloatArray) -> bool:
    either = np.any(bounds.either_a @ heights <= bounds.either_b, axis=1)
    return bool(np.all(bounds.a @ heights <= bounds.b) and np.all(either))


@pytest.mark.parametrize("case", ["both", "kh", "k"])
@pytest.mark.parametrize("shape", ["pentagon", "concave"])
def test_the_set_is_what_explains_every_reading(shape: str, case: str) -> None:
    """Outlines near the truth lie in the set if, and only if, all their readings are within the band."""
    construction, changed, names = CASES[case]
    truth, sensor = SHAPES[shape], a_sensor(construction, **changed)
    band = a_band(truth, sensor, NOISE, 3, names)
    lines, _ = EdgeLines.of(truth)
    kinks = np.array([*truth.lower[1:-1, 0], *truth.upper[1:-1, 0]])
    bounds = feasible_set(
        band, lines, np.stack([kinks - 3.3, kinks + 3.3], axis=1), np.zeros((3, len(band.x)))
    )
    assert len(bounds.either_b) > 0
    random = np.random.default_rng(0)
    counts = [0, 0]
    for size in np.repeat([0.0, 0.03, 0.1, 0.3, 1.0], 60):
        off = size * random.uniform(-1.0, 1.0, truth.vertices.shape) * [1.0, 8.0]
        moved = Outline.of(truth.vertices + off)
        if not moved.touches(band.x).all():
            continue
        made = ts.signatures(sensor, *moved.ends(band.x))
        explains = all(np.all((made[n] >= band.low[n]) & (made[n] <= band.high[n])) for n in band.low)
        assert holds(bounds, heights_of(moved, lines)) == explains
        counts[explains] += 1
    assert min(counts) > 20


@pytest.mark.parametrize("case", CASES)
def test_the_truth_is_always_in_the_set(case: str) -> None:
    construction, changed, names = CASES[case]
    sensor = a_sensor(construction, **changed)
    for shape, truth in SHAPES.items():
        if names is not None and shape != "pentagon":
            continue
        lines, heights = EdgeLines.of(truth)
        kinks = np.array([*truth.lower[1:-1, 0], *truth.upper[1:-1, 0]])
        zones = np.stack([kinks - 4.0, kinks + 4.0], axis=1)
        for seed in range(10):
            band = a_band(truth, sensor, NOISE, seed, names)
            l, u = truth.ends(np.clip(band.x, truth.lower[0, 0], truth.lower[-1, 0]))
            expected = (u - l) * np.random.default_rng(seed).uniform(0.9, 1.1)
            widths = np.stack([expected, np.minimum(u - l, expected), np.maximum(u - l, expected)])
            assert holds(feasible_set(band, lines, zones, widths), heights)


# Points inside


def a_polytope(seed: int, size: int = 6, rows: int = 60) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    a = random.standard_normal((rows, size)) * 10.0 ** random.uniform(-1, 1, (rows, 1))
    return a, a @ random.standard_normal(size) + np.linalg.norm(a, axis=1) * random.uniform(0.01, 1.0, rows)


@pytest.mark.parametrize("seed", range(10))
def test_minimax_finds_a_point_or_knows_that_there_is_none(seed: int) -> None:
    a, b = a_polytope(seed)
    far = 100.0 * np.ones(6)
    at, worst, empty = minimax(a, b, far, 1.0)
    assert worst == pytest.approx((a @ at - b).max())
    assert worst < 0.0
    assert not empty
    rows = np.hstack([a, -np.ones((len(a), 1))])
    least = linprog([0.0] * 6 + [1.0], A_ub=rows, b_ub=b, bounds=(None, None)).fun
    for lack in (0.01, 1.0):
        _, worst, empty = minimax(a, b + least - lack, far, 1.0)
        assert empty
        assert worst > 0.0
        at, worst, empty = minimax(a, b + least + lack, far, 1.0)
        assert (worst < 0.0, empty) == (True, False)


def test_a_set_without_inside_is_none() -> None:
    a = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert minimax(a, np.array([1.0, -1.0, 1.0, 1.0]), np.zeros(2), 1.0)[2]


def test_of_equal_bounds_the_first_are_near_and_in_order() -> None:
    """A partial sort leaves the order open, and with it which bound meets which random number."""
    values = np.array([1.0, 3.0, 2.0, 3.0, 2.0, 2.0, 0.0])
    np.testing.assert_array_equal(largest(values, 4), [1, 2, 3, 4])
    np.testing.assert_array_equal(largest(values, 99), np.arange(7))
    many = np.random.default_rng(0).integers(0, 50, 5000).astype(float)
    np.testing.assert_array_equal(largest(many, 700), np.sort(np.argsort(-many, kind="stable")[:700]))


def test_the_centre_of_a_box_is_its_middle() -> None:
    a, b = np.vstack([np.eye(3), -np.eye(3)]), np.array([3.0, 2.0, 1.0, 1.0, 0.0, 1.0])
    middle, curvature = analytic_centre(a, b, np.array([2.9, 0.1, -0.9]))
    np.testing.assert_allclose(middle, [1.0, 1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(curvature, np.diag([2 / 4, 2 / 1, 2 / 1]), rtol=1e-2, atol=1e-9)


# The walk


Walk = tuple[
    tuple[FloatArray, FloatArray, FloatArray],
    tuple[FloatArray, FloatArray, FloatArray],
    FloatArray,
    FloatArray,
]


def a_bent_set(pairs: bool = True, edge: float = 0.0) -> Walk:
    """The square |z| <= 1 less its quadrant z > 0.2, as a pair of which one holds; middle and curvature."""
    rows = np.vstack([np.eye(2), -np.eye(2)]), np.ones(4), np.full(4, edge)
    either = np.eye(2)[None][: int(pairs)], np.full((int(pairs), 2), 0.2), np.zeros(int(pairs))
    return rows, either, np.zeros(2), np.eye(2)


@pytest.mark.parametrize("edge", [0.0, 0.1])
@pytest.mark.parametrize("size", [2, 9, 30])
def test_the_compiled_walk_is_the_plain_one(size: int, edge: float) -> None:
    """To the last bit: a walk makes much of a rounding error."""
    random = np.random.default_rng(size)
    root = random.normal(size=(size, size)) + 3.0 * np.eye(size)
    rows = random.normal(size=(200, size)), random.uniform(0.5, 1.0, 200), np.full(200, edge)
    either = random.normal(size=(60, 2, size)), random.uniform(0.1, 1.0, (60, 2)), np.full(60, edge)
    given = rows, either, 0.001 * random.normal(size=size), root @ root.T
    np.testing.assert_array_equal(hit_and_run(*given, 30), plain_hit_and_run(*given, 30))


def test_the_walk_reaches_every_part_of_a_bent_set_as_often() -> None:
    z = hit_and_run(*a_bent_set(), 40_000)
    assert not np.any((z > 0.2).all(axis=1))
    # Three quarters by size: of 4 - 0.64 the arms have 0.8 x 1.2 each, the rest is 1.44.
    shares = [(z[:, 0] > 0.2).mean(), (z[:, 1] > 0.2).mean(), (z < 0.2).all(axis=1).mean()]
    np.testing.assert_allclose(shares, np.array([0.96, 0.96, 1.44]) / 3.36, atol=0.01)


def test_the_walk_follows_an_error_that_fades_towards_its_bound() -> None:
    """Flat up to 0.6, then falling to 0 at 1: the trapezoid of two uniform errors of 0.8 and 0.2."""
    z = hit_and_run(*a_bent_set(pairs=False, edge=0.4), 40_000)[:, 0]
    assert z.var() == pytest.approx((0.8**2 + 0.2**2) / 3.0, rel=0.03)
    assert (np.abs(z) < 0.6).mean() == pytest.approx(1.2 / 1.6, abs=0.01)


def test_a_curvature_that_is_none_is_told() -> None:
    rows, either, middle, _ = a_bent_set()
    for walk in (hit_and_run, plain_hit_and_run):
        with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
            walk(rows, either, middle, np.zeros((2, 2)))


# Linear programs


@pytest.mark.parametrize("least", [lowest, plain_lowest])
@pytest.mark.parametrize("seed", range(10))
def test_linear_programs_agree_with_scipy(seed: int, least: Callable[..., float]) -> None:
    a, b = a_polytope(seed, 8, 120)
    b = np.linalg.norm(a, axis=1) * np.random.default_rng(seed).uniform(0.1, 1.0, len(b))
    at, active = np.zeros(8), np.full(8, -1)
    for form in np.random.default_rng(seed).standard_normal((6, 8)):
        value = least(form, a, b, at, active)  # from where the last one ended
        assert value == pytest.approx(linprog(form, A_ub=a, b_ub=b, bounds=(None, None)).fun, rel=1e-8)
        assert np.all(a @ at <= b + 1e-6)


@pytest.mark.parametrize("least", [lowest, plain_lowest])
@pytest.mark.parametrize("seed", range(10))
def test_a_form_that_the_met_rows_all_but_carry(seed: int, least: Callable[..., float]) -> None:
    """What they leave of it is as short as its rounding, and more rows than they pass through the edge they meet in."""
    random = np.random.default_rng(seed)
    a, b = a_polytope(seed, 8, 120)
    b = np.linalg.norm(a, axis=1) * random.uniform(0.5, 1.0, len(b))
    at, active = np.zeros(8), np.full(8, -1)
    least(random.standard_normal(8), a, b, at, active)
    met = active[active >= 0][:4]
    mixed = random.uniform(0.1, 1.0, (40, 4))
    a, b = np.vstack([a[met], mixed @ a[met], a]), np.concatenate([b[met], mixed @ b[met], b])
    for rest in (1.5e-9, 3e-9, 1e-8):
        form = -a[:4].sum(axis=0) / np.abs(a[:4].sum(axis=0)).max() + rest * random.standard_normal(8)
        value = least(form, a, b, np.zeros(8), np.full(8, -1))
        assert value == pytest.approx(linprog(form, A_ub=a, b_ub=b, bounds=(None, None)).fun, rel=1e-6)


def test_a_form_without_a_least_value() -> None:
    a = np.array([[1.0, 0.0], [0.0, 1.0]])
    for least in (lowest, plain_lowest):
        assert least(np.array([1.0, 0.0]), a, np.ones(2), np.zeros(2), np.full(2, -1)) == -np.inf


# The estimate


def test_the_known_bound_halves_the_error() -> None:
    """300 strips, both signatures, 1 %: pooled over 30 scans below half the Gaussian bound, and calibrated."""
    noise, sensor = ts.Noise(positional=0.01), a_sensor(pitch=0.295)
    squares, distances, inside = [], [], []
    for seed in range(30):
        found = refined(PENTAGON, a_band(PENTAGON, sensor, noise, seed), noise)
        off = found.outline.vertices - PENTAGON.vertices
        squares.append((off**2).sum(axis=1).mean())
        for i, d in enumerate(off):
            distance = d @ np.linalg.solve(found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2], d)
            distances.append(distance)
            inside.append(distance < found.radii[i])
    bound = vertex_rms(vertex_covariance(PENTAGON, sensor, reading_sigma(noise, sensor)))
    assert np.sqrt(np.mean(squares)) < 0.5 * bound
    assert 1.5 < np.mean(distances) < 2.6  # 2 for a covariance that is right
    assert 0.9 < np.mean(inside) < 0.99


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shape", SHAPES)
def test_guaranteed_regions_hold_the_truth(shape: str, case: str) -> None:
    construction, changed, names = CASES[case]
    sensor, truth = a_sensor(construction, **changed), SHAPES[shape]
    if len(sensor.signatures if names is None else names) == 1 and shape != "pentagon":
        pytest.skip("one signature is for convex shapes without vertical edges")
    for seed in range(8):
        found = refined(truth, a_band(truth, sensor, NOISE, seed, names), NOISE)
        regions = found.regions
        assert regions is not None
        for region, vertex, mean in zip(regions, truth.vertices, found.outline.vertices, strict=True):
            area = shapely.Polygon(region)
            assert area.is_valid
            assert area.distance(shapely.Point(vertex)) < 1e-9
            assert area.distance(shapely.Point(mean)) < 1e-3 * np.sqrt(area.area)
        assert found.regions is regions  # made once


def test_a_kink_that_the_readings_do_not_confine_has_no_region() -> None:
    """A quadrilateral whose upper corner is all but straight."""
    truth = Outline.of([(30.3, 300.0), (70.0, 200.0), (118.7, 300.0), (75.0, 301.0)])
    band = a_band(truth, a_sensor(), ts.Noise(positional=0.02), 0)
    assert refined(truth, band, ts.Noise(positional=0.02)).regions is None


def test_fewest_vertices_that_explain_the_readings() -> None:
    noise, sensor = NOISE, a_sensor()
    corners = PENTAGON.vertices
    candidates = [Outline.of(np.delete(corners, out, axis=0)) for out in ((3, 4), 4)] + [PENTAGON]
    given = [(o, vertex_covariance(o, sensor, reading_sigma(noise, sensor))) for o in candidates]
    band = a_band(PENTAGON, sensor, noise, 1)
    found = fewest(given, band)
    assert found is not None
    assert found[0] == 2
    assert len(found[1].outline.vertices) == 5
    assert fewest(given[:2], band) is None


def test_a_wrong_bound_is_an_alarm() -> None:
    sensor = a_sensor()
    x, readings = readings_of(PENTAGON, sensor, 0.01, 0)
    bound = vertex_covariance(PENTAGON, sensor, 0.005)
    assert refine(PENTAGON, bound, ReadingBounds.of(sensor, x, readings, ts.Noise(positional=0.005))) is None
    assert (
        refine(PENTAGON, bound, ReadingBounds.of(sensor, x, readings, ts.Noise(positional=0.01))) is not None
    )


def test_readings_that_are_missing_widen_the_set() -> None:
    sensor = a_sensor()
    band = a_band(PENTAGON, sensor, NOISE, 2)
    whole = refined(PENTAGON, band, NOISE)
    again = refined(PENTAGON, band, NOISE)
    np.testing.assert_array_equal(whole.outline.vertices, again.outline.vertices)
    low, high = (
        {n: np.where(abs(band.x - 55.0) < 15.0, np.nan, k) for n, k in side.items()}
        for side in (band.low, band.high)
    )
    band = replace(band, low=low, high=high)
    assert vertex_rms(refined(PENTAGON, band, NOISE).covariance) > vertex_rms(whole.covariance)


def test_a_set_that_a_hidden_corner_leaves_small_is_not_told_to_be_sure() -> None:
    """Four corners of five: what the bound just leaves had an area up to 13 deviations off, and 5.8 at most now."""
    sensor = a_sensor(pitch=4.0)
    corners = np.array([(20.0, 350.0), (140.0, 330.0), (130.0, 700.0), (40.0, 740.0)])
    few = Outline.of(corners)
    truth = Outline.of(np.insert(corners, 1, (80.0, 335.0), axis=0))
    area, off = moments(truth.vertices)[0], []
    for seed in range(40):
        bound = vertex_covariance(few, sensor, reading_sigma(NOISE, sensor))
        found = refine(few, bound, a_band(truth, sensor, NOISE, seed))
        if found is not None and found.deviations is not None:
            off.append(abs(moments(found.outline.vertices)[0] - area) / found.deviations[0])
    assert len(off) > 10
    assert max(off) < 7.0


def test_regions_for_pictures_hold_95_percent_of_the_set() -> None:
    found = refined(PENTAGON, a_band(PENTAGON, a_sensor(), NOISE, 0), NOISE)
    block, scaled = found.covariance[:2, :2], found.region_covariance[:2, :2]
    np.testing.assert_allclose(scaled, block * found.radii[0] / 5.99146, rtol=1e-4)


@settings(FIXED, max_examples=40)
@given(
    st.integers(0, 10_000),
    st.sampled_from(sorted(SHAPES)),
    st.sampled_from(sorted(SHAPES)),
    st.floats(-6.0, -1.0),
    st.sampled_from([0.9, 1.5]),
    st.booleans(),
)
def test_whatever_is_read_there_is_an_answer(
    seed: int, shape: str, taken_for: str, exponent: float, excess: float, lost: bool
) -> None:
    """Another shape, errors beyond the bound, half of the readings lost: a refined outline on the sensor, or none."""
    random = np.random.default_rng(seed)
    sensor, outline, bound = a_sensor(pitch=2.0), SHAPES[taken_for], 10.0**exponent
    x, readings = readings_of(SHAPES[shape], sensor, excess * bound, seed)
    if lost:
        for values in readings.values():
            values[random.random(len(values)) < 0.5] = np.nan
    spread = np.diag(10.0 ** random.uniform(-4.0, 4.0, outline.vertices.size))
    found = refine(outline, spread, ReadingBounds.of(sensor, x, readings, ts.Noise(positional=bound)))
    if found is not None:
        assert np.isfinite(found.covariance).all()
        assert found.outline.vertices[:, 1].min() > -1e-6 * L
        assert found.outline.vertices[:, 1].max() < (1.0 + 1e-6) * L
        assert found.regions is None or all(np.isfinite(region).all() for region in found.regions)


@pytest.mark.skipif(exported("bounded") is None, reason="the core is not compiled here")
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shape", SHAPES)
def test_one_call_of_the_core_does_as_the_steps(
    shape: str, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    construction, changed, names = CASES[case]
    at_once, core = 0, exported("bounded")
    assert core is not None
    for seed, pitch in enumerate((1.0, 4.0, 0.25)):
        sensor = a_sensor(construction, pitch, **changed)
        band = a_band(SHAPES[shape], sensor, NOISE, seed, names)
        bound = vertex_covariance(SHAPES[shape], sensor, reading_sigma(NOISE, sensor), tuple(band.low))
        at_once += estimate.in_one_call(core, SHAPES[shape], bound, band) is not None
        got, truth = refine(SHAPES[shape], bound, band), estimate.plain_refine(SHAPES[shape], bound, band)
        assert (got is None) == (truth is None)
        if got is None or truth is None:
            continue
        assert (got.fallback is None) == (truth.fallback is None)
        assert (got.deviations is None) == (truth.deviations is None)
        for mine, theirs in (
            (got.outline.lower, truth.outline.lower),
            (got.outline.upper, truth.outline.upper),
            (got.points, truth.points),
            (got.covariance, truth.covariance),
            (got.radii, truth.radii),
        ):
            np.testing.assert_allclose(mine, theirs, rtol=1e-7, atol=1e-9 * L)
        if got.deviations is not None and truth.deviations is not None:
            np.testing.assert_allclose(np.hstack(got.deviations), np.hstack(truth.deviations), rtol=1e-7)
        np.testing.assert_array_equal(got.lines.reach, truth.lines.reach)
        monkeypatch.setattr(estimate, "_ROOM", 0)  # it asks for what it lacks
        again = refine(SHAPES[shape], bound, band)
        assert again is not None
        np.testing.assert_array_equal(again.covariance, got.covariance)
        monkeypatch.undo()
    assert at_once


# Everywhere the same

_FITS = """
import numpy as np, tacstrip as ts
print(np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"])
noise = ts.Noise(positional=0.004, quantisation=0.001)
for seed in range(12):
    sensor = ts.Sensor(construction="crs-crs", strips=30 + 20 * seed, pitch_mm=100.0 / (30 + 20 * seed),
                       length_mm=100.0, contact_lambda_mm=2.0 * (seed % 3 == 2))
    contact = ts.Contact.polygon([(2.0, 40.0), (35.0 + seed, 20.0), (97.0, 35.0), (60.0, 80.0 - seed)])
    for found in ts.fit_polygon(ts.simulate(sensor, contact, noise, rng=seed), sensor, noise).objects:
        print(found.vertices.tobytes().hex(), found.covariance.tobytes().hex())
        print(found.status, found.deviations)
"""


def test_no_other_linear_algebra_moves_an_outline() -> None:
    """OpenBLAS has other kernels for other processors, and they round differently."""
    if platform.machine() != "x86_64":
        pytest.skip("the kernels named here are of x86-64")
    if exported("fit_runs") is None:
        pytest.skip("without the compiled core NumPy's linear algebra is used")
    said = []
    for kernels in ("Prescott", "Haswell"):
        surroundings = {**os.environ, "OPENBLAS_CORETYPE": kernels, "OPENBLAS_NUM_THREADS": "1"}
        said.append(subprocess.check_output([sys.executable, "-c", _FITS], env=surroundings, text=True))
    if "openblas" not in said[0].partition("\n")[0]:
        pytest.skip("NumPy was not built with OpenBLAS here")
    assert len(said[0].splitlines()) > 10
    assert said[0] == said[1]


def a_set(
    shape: str, case: str, seed: int
) -> tuple[Outline, ReadingBounds, EdgeLines, FloatArray, FloatArray, FloatArray]:
    """An outline, its band, lines and heights, and zones and widths for `feasible_set`; some readings are missing."""
    construction, changed, names = CASES[case]
    outline, random = SHAPES[shape], np.random.default_rng(seed)
    band = a_band(outline, a_sensor(construction, **changed), NOISE, seed, names)
    low = {name: np.where(random.random(len(k)) < 0.1, np.nan, k) for name, k in band.low.items()}
    lines, heights = EdgeLines.of(outline)
    x = np.array([*outline.lower[1:-1, 0], *outline.upper[1:-1, 0]])
    zones = within(lines, x, random.uniform(0.0, 40.0, len(x)), band)
    zones += random.uniform(-5.0, 5.0, zones.shape) * (seed % 2)  # that overlap, or are empty
    expected = np.interp(band.x, *outline.upper.T) - np.interp(band.x, *outline.lower.T)
    return (
        outline,
        replace(band, low=low),
        lines,
        heights,
        zones,
        np.multiply.outer([1.0, 0.8, 1.3], expected),
    )


def test_more_heights_than_the_core_takes_are_for_numpy() -> None:
    """Every coordinate of a walk moves, and what is found is inside."""
    size = MOST_DIMENSIONS + 3
    a, b = a_polytope(0, size, 110)  # of 112 the walk meets all
    at, outside, empty = minimax(a, b, np.full(size, 5.0), 1.0)
    assert (outside < 0.0, empty) == (True, False)
    centre, curvature = analytic_centre(a, b, at)
    none = np.zeros((0, 2, size)), np.zeros((0, 2)), np.zeros(0)
    found, rounds = feasible_part((a, b), none[:2], np.full(size, 5.0), 1.0, 8)
    assert found is not None
    assert rounds == 1
    np.testing.assert_allclose(found[0], centre, atol=1e-6)
    points = hit_and_run((a, b, np.zeros(len(b))), none, centre, curvature, 20)
    assert (points @ a.T <= b + 1e-9).all()  # but for rounding
    assert (np.ptp(points, axis=0) > 0.0).all()
    around = hit_and_run(
        (np.vstack([np.eye(size), -np.eye(size)]), np.ones(2 * size), np.zeros(2 * size)),
        none,
        np.zeros(size),
        np.eye(size),
        20,
    )
    assert (np.ptp(around, axis=0) > 0.5).all()


def test_more_corners_than_the_set_is_searched_for_are_least_squares() -> None:
    angle = (np.arange(14) + 0.3) * (2.0 * np.pi / 14)
    corners = np.stack([500.0 + 400.0 * np.cos(angle), 500.0 + 400.0 * np.sin(angle)], axis=1)
    sensor, noise = a_sensor(pitch=2.5, strips=400, adc_bits=None), ts.Noise(positional=1e-4)
    scan = ts.simulate(sensor, ts.Contact.polygon(corners), noise, rng=0)
    (found,), (plain,) = (ts.fit_polygon(scan, sensor, noise, bounded=b).objects for b in (True, False))
    assert len(found.vertices) == 14
    np.testing.assert_array_equal(found.vertices, plain.vertices)
    assert (found.status, plain.status) == ("doubtful", "ok")
    assert "more than 12 vertices is not held against the noise's bound" in found.advice


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("case", CASES)
def test_the_compiled_set_is_the_plain_one(shape: str, case: str) -> None:
    for seed in range(3):
        _, band, lines, _, zones, widths = a_set(shape, case, seed)
        got, truth = (make(band, lines, zones, widths) for make in (feasible_set, plain_feasible_set))
        assert len(truth.either_edge) > 0 or not len(lines.turns)
        for field in fields(FeasibleSet):
            values = getattr(got, field.name), getattr(truth, field.name)
            np.testing.assert_allclose(*values, rtol=1e-12, atol=1e-12, err_msg=field.name)


@pytest.mark.parametrize("shape", SHAPES)
def test_compiled_outlines_and_their_scatter_are_the_plain_ones(shape: str) -> None:
    _, band, lines, heights, *_ = a_set(shape, "both", 0)
    random, reach = np.random.default_rng(0), np.array([1.0, 30.0])
    points = heights + random.uniform(-reach[:, None, None], reach[:, None, None], (2, 600, len(heights)))
    for near in (points[0], points[1], np.repeat(heights[None], 600, axis=0)):
        got, truth = (draw(near, lines, band) for draw in (draw_outlines, plain_draw_outlines))
        assert (got is None) == (truth is None)
        if got is None or truth is None:
            continue
        for one, other in zip(got, truth, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)
        mean = Outline(*(chain.mean(axis=0) for chain in truth))
        (covariance, radii, moments), plain = (find(mean, *truth) for find in (scatter, plain_scatter))
        size = np.abs(plain[0]).max()
        np.testing.assert_allclose(covariance, plain[0], rtol=1e-9, atol=1e-12 * size)
        if near is not points[0] and near is not points[1]:
            continue  # all alike: what is left is rounding
        np.testing.assert_allclose(radii, plain[1], rtol=1e-9)
        np.testing.assert_allclose(np.hstack(moments), np.hstack(plain[2]), rtol=1e-9)


def test_points_that_do_not_tell_of_vertices_make_no_outlines() -> None:
    """Most make an edge that crosses hardly a strip vertical, or cross outside of their windows."""
    _, band, lines, heights, *_ = a_set("pentagon", "both", 0)
    few = np.repeat(heights[None], 600, axis=0)
    few[30:, 0] += 1e3
    for draw in (draw_outlines, plain_draw_outlines):
        assert draw(few, lines, band) is None


@pytest.mark.parametrize("seed", range(5))
def test_points_inside_and_centres_are_the_plain_ones(seed: int) -> None:
    random = np.random.default_rng(seed)
    size, count, either = 4 + 6 * seed, 300 + 200 * seed, 20 * seed
    a, b = a_polytope(seed, size, count)
    middle = minimax(a, b, np.zeros(size), 1.0)[0]
    pair_a = random.normal(size=(either, 2, size))
    pair_b = pair_a @ middle + np.stack([random.uniform(-1.0, 1.0, either), np.full(either, 0.1)], axis=1)
    start = middle + 10.0 * random.normal(size=size)
    for limit in (b, b - 3.0):
        (at, outside, empty), (plain_at, plain_outside, plain_empty) = (
            find(a, limit, start, 1.0) for find in (minimax, plain_minimax)
        )
        np.testing.assert_allclose(at, plain_at, rtol=0, atol=1e-9)
        assert outside == pytest.approx(plain_outside, abs=1e-9)
        assert empty == plain_empty
    for got, truth in zip(analytic_centre(a, b, middle), plain_analytic_centre(a, b, middle), strict=True):
        np.testing.assert_allclose(got, truth, rtol=1e-7, atol=1e-9)
    for begin, is_found in ((middle, True), (start, None)):
        given = (a, b), (pair_a, pair_b), begin, 1.0, 8
        (found, rounds), (plain, plain_rounds) = feasible_part(*given), plain_feasible_part(*given)
        assert (rounds, found is None) == (plain_rounds, plain is None)
        assert found is not None or not is_found
        if found is not None and plain is not None:
            np.testing.assert_allclose(found[0], plain[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", [6, 17])
def test_few_readings_that_happen_to_be_far_off_still_have_a_set(seed: int) -> None:
    """Their squares sum up to more than sigma says on average, and each is within the bound: that is no alarm."""
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    noise = ts.Noise(positional=0.01)
    contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
    scan = ts.simulate(sensor, contact, noise, rng=seed)
    (found,) = ts.fit_polygon(scan, sensor, noise, assessment="none").objects
    assert (found.status, found.advice) == ("likely", "")
    assert found.guarantee is not None

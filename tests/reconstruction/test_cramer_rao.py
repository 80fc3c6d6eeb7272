"""The Cramer-Rao bound of vertices, against differences, a Monte Carlo and cases that cannot be told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tacstrip as ts
from polygons import convex_polygon, from_left
from strategies import FIXED, ratios, spans
from studies.crp_spans import own_electrodes
from studies.wide_uses import differences
from tacstrip.arrays import FloatArray
from tacstrip.errors import ContactError, ReadingError, SignatureError
from tacstrip.fisher import covariance
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import (
    reading_sigma,
    vertex_covariance,
    vertex_jacobian,
    vertex_rms,
)
from tacstrip.reconstruction.noise_covariance import signature_jacobians

SQUARE = [(10.0, 20.0), (50.0, 20.0), (50.0, 60.0), (10.0, 60.0)]
KITE = [(10.2, 50.0), (30.4, 22.0), (70.9, 60.0), (48.3, 85.0)]


def a_sensor(construction: str = "crs-crs", **changed: Any) -> ts.Sensor:
    return ts.Sensor(
        construction=construction, **({"strips": 200, "pitch_mm": 0.5, "length_mm": 100.0} | changed)
    )


# Outlines


def test_an_outline_keeps_the_order_of_its_vertices() -> None:
    for start in range(4):
        for way in (1, -1):
            given_vertices = np.roll(np.array(KITE), start, axis=0)[::way]
            outline = Outline.of(given_vertices)
            np.testing.assert_array_equal(outline.vertices, KITE)
            lower, upper = outline.indices
            np.testing.assert_array_equal(outline.vertices[lower], outline.lower)
            np.testing.assert_array_equal(outline.vertices[upper], outline.upper)
    assert not outline.lower.flags.writeable


def test_a_vertical_edge_has_two_vertices_on_one_x() -> None:
    for start in range(4):
        outline = Outline.of(np.roll(np.array(SQUARE), start, axis=0))
        np.testing.assert_array_equal(outline.vertices, SQUARE)
        np.testing.assert_array_equal(outline.upper, [SQUARE[3], SQUARE[2]])
    lower, upper = outline.indices
    assert (lower.tolist(), upper.tolist()) == ([0, 1], [3, 2])
    half = Outline.of([(0, 1), (0, 0), (2, 1)])
    np.testing.assert_array_equal(half.vertices, [(0, 0), (2, 1), (0, 1)])
    np.testing.assert_array_equal(
        half.ends(np.array([0.0, 1.0, 2.0, 3.0])), [[0, 0.5, 1, np.nan], [1, 1, 1, np.nan]]
    )


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([(0, 0), (1, 0)], "three or more"),
        ([(0, 0), (4, 0), (1, 1), (4, 3), (0, 3)], "more than one edge ends at x = 4 mm"),
        ([(0, 0), (4, 2), (4, 0), (0, 2.5)], "not x-monotone|passes above"),
        ([(0, 0), (1, 2), (3, -2), (4, 0), (3, 4), (1, 1)], "passes above the upper one at x = 1 mm"),
        ([(0, 0), (4, 0), (3, 1), (3.5, 2), (0, 3)], "upper chain does not ascend at x = 3 mm"),
        ([(0, 0), (0, 1), (0, 2)], "more than one edge ends at x = 0 mm"),
        ([(0, 0), (np.nan, 1), (0, 2)], "finite"),
    ],
)
def test_what_is_no_outline_is_refused(vertices: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        Outline.of(vertices)


def test_chains_that_do_not_meet_are_refused() -> None:
    with pytest.raises(ContactError, match="begin on one x"):
        Outline(np.array([(0.0, 0.0), (1.0, 0.0)]), np.array([(0.1, 1.0), (1.0, 1.0)]))


@FIXED
@given(st.integers(0, 10_000), st.integers(3, 8))
def test_ends_and_slopes_agree_with_the_footprint_and_differences(seed: int, corners: int) -> None:
    sensor = a_sensor(strips=100, pitch_mm=10.0, length_mm=1000.0)
    vertices = from_left(convex_polygon(seed, corners))
    outline = Outline.of(vertices)
    np.testing.assert_array_equal(outline.vertices, vertices)
    l, u = ts.footprint(sensor, ts.Contact.polygon(vertices))
    np.testing.assert_allclose(outline.ends(sensor.x_mm), (l, u), rtol=0, atol=1e-9)
    x = np.linspace(vertices[:, 0].min(), vertices[:, 0].max(), 7)[1:-1]
    by_l, by_u = outline.jacobian(x)
    step = 1e-5
    for at in range(vertices.size):
        moved = [vertices.ravel().copy() for _ in range(2)]
        moved[0][at] += step
        moved[1][at] -= step
        (l1, u1), (l0, u0) = (Outline.of(m.reshape(-1, 2)).ends(x) for m in moved)
        np.testing.assert_allclose(by_l[:, at], (l1 - l0) / (2 * step), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(by_u[:, at], (u1 - u0) / (2 * step), rtol=1e-6, atol=1e-6)
    assert np.isnan(outline.jacobian(np.array([-1.0]))[0]).all()


# Slopes of readings


@FIXED
@given(
    spans(100.0, 0.5), ratios(), st.just(0.0) | st.floats(0.1, 100.0), st.sampled_from(["crs-crs", "crs-m"])
)
def test_slopes_of_readings_agree_with_differences(
    span: tuple[float, float], ratio: float, lam: float, construction: str
) -> None:
    own = {"resistivity_ratio": ratio} if construction == "crs-crs" else {}
    sensor = a_sensor(construction, contact_lambda_mm=lam, **own)
    l, u = np.array([span[0]]), np.array([span[0] + span[1] + 1e-3])

    def at(dl: float, du: float) -> dict[str, FloatArray]:
        return ts.signatures(sensor, l + dl, u + du)

    step = 1e-4
    for name, (by_l, by_u) in signature_jacobians(sensor, l, u).items():
        numeric_l = (at(step, 0)[name] - at(-step, 0)[name]) / (2 * step)
        numeric_u = (at(0, step)[name] - at(0, -step)[name]) / (2 * step)
        np.testing.assert_allclose(by_l, numeric_l, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(by_u, numeric_u, rtol=1e-4, atol=1e-9)


# The bound


def test_what_is_not_told_is_infinite_and_the_rest_is_not() -> None:
    """Two readings of p0 + p1, and one of p2: p0 and p1 are open, p2 has its bound."""
    told = covariance(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]]) / 0.1)
    assert np.diag(told)[:2].tolist() == [np.inf, np.inf]
    assert told[2, 2] == pytest.approx((0.1 / 4.0) ** 2)
    assert np.isnan(told[0, 1])
    assert np.isnan(told[0, 2])
    nothing = covariance(np.zeros((1, 2)))
    assert np.diag(nothing).tolist() == [np.inf, np.inf]
    assert covariance(np.zeros((3, 0))).shape == (0, 0)


def test_parameters_of_different_units_are_all_told() -> None:
    slopes = np.array([[1e-9, 0.0], [1e-9, 1e9]])
    np.testing.assert_allclose(covariance(slopes), np.linalg.inv(slopes) @ np.linalg.inv(slopes).T, rtol=1e-9)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.inf, np.nan])
def test_noise_must_be_above_0(sigma: float) -> None:
    with pytest.raises(ReadingError, match="finite number above 0"):
        vertex_covariance(Outline.of(KITE), a_sensor(), sigma)


def test_a_signature_that_is_not_there_is_refused() -> None:
    with pytest.raises(SignatureError, match="has no signature 'k'"):
        vertex_covariance(Outline.of(KITE), a_sensor(), 1e-3, ["k"])


def test_more_noise_fewer_strips_and_one_signature_cost_precision() -> None:
    outline, sensor = Outline.of(KITE), a_sensor()
    both = vertex_covariance(outline, sensor, 1e-3)
    assert both.shape == (8, 8)
    np.testing.assert_allclose(both, both.T)
    least = np.diag(both)
    for worse in (
        vertex_covariance(outline, sensor, 2e-3),
        vertex_covariance(outline, sensor, 1e-3, ["kh"]),
        vertex_covariance(outline, sensor, 1e-3, ["kl"]),
        vertex_covariance(outline, sensor, 1e-3, x_mm=sensor.x_mm[::2]),
    ):
        assert np.all(np.diag(worse) > least)
        assert np.isfinite(worse).all()
        assert vertex_rms(worse) > vertex_rms(both)
    assert vertex_rms(both) == pytest.approx(np.sqrt(least.sum() / 4.0))


def test_the_ends_of_one_signature_lean_on_the_touched_strips() -> None:
    """In a triangle from k_h the middle of the pitch is all that is known of the ends' x."""
    outline = Outline.of([(10.2, 50.0), (40.4, 22.0), (70.9, 60.0)])
    fine, coarse = (
        vertex_covariance(outline, a_sensor(strips=n, pitch_mm=100.0 / n), 1e-9, ["kh"]) for n in (400, 200)
    )
    assert np.sqrt(coarse[0, 0]) <= 0.5 / np.sqrt(12.0) * (1 + 1e-9)
    assert fine[0, 0] <= coarse[0, 0]


def test_a_vertical_edge_has_one_x() -> None:
    outline, sensor = Outline.of(SQUARE), a_sensor()
    found = vertex_covariance(outline, sensor, 1e-3)
    np.testing.assert_allclose(found[0], found[6], rtol=1e-9)
    np.testing.assert_allclose(found[2, 4], found[2, 2], rtol=1e-9)
    assert found[0, 0] <= 0.5**2 / 12.0 * (1 + 1e-9)


def test_vertices_that_no_strip_tells_are_known_to_a_pitch_across() -> None:
    """Two strips touch it: four readings for eight numbers; the rest is where strips are."""
    found = vertex_covariance(Outline.of(KITE), a_sensor(strips=3, pitch_mm=30.0), 1e-3)
    np.testing.assert_allclose(np.diag(found)[::2], 30.0**2 / 12.0, rtol=1e-6)
    assert np.isfinite(found).all()


def test_vertices_that_no_reading_tells_are_infinite() -> None:
    found = vertex_covariance(Outline.of(KITE), a_sensor(strips=1, pitch_mm=80.0), 1e-3, ["kh"])
    assert np.isinf(np.diag(found)).any()
    assert np.isinf(vertex_rms(found))


def test_least_squares_scatters_as_the_bound_says() -> None:
    """Gauss-Newton from the truth, with the same prior, on 400 scans: variances within 5 sigma of theirs."""
    sensor, sigma, trials = a_sensor("crs-m"), 2e-4, 400
    outline = Outline.of(KITE)
    x = sensor.x_mm[outline.touches(sensor.x_mm)]
    bound = vertex_covariance(outline, sensor, sigma)
    truth = outline.vertices.ravel()
    random = np.random.default_rng(1)
    k0 = ts.signatures(sensor, *outline.ends(x))["k"]
    prior = np.zeros(8)
    prior[[0, 4]] = 12.0 / sensor.pitch_mm**2
    found = np.empty((trials, 8))
    for row in found:
        measured = k0 + sigma * random.standard_normal(len(x))
        guess = truth.copy()
        aim = truth + sensor.pitch_mm / np.sqrt(12.0) * random.standard_normal(8)
        for _ in range(4):
            at = Outline.of(guess.reshape(-1, 2))
            inside = at.touches(x)
            l, u = at.ends(x[inside])
            by_l, by_u = at.jacobian(x[inside])
            a, b = signature_jacobians(sensor, l, u)["k"]
            slope = a[:, None] * by_l + b[:, None] * by_u
            left = measured[inside] - ts.signatures(sensor, l, u)["k"]
            told = slope.T @ slope / sigma**2 + np.diag(prior)
            guess = guess + np.linalg.solve(told, slope.T @ left / sigma**2 + prior * (aim - guess))
        row[:] = guess - truth
    ratio = found.var(axis=0) / np.diag(bound)
    assert np.all(np.abs(ratio - 1.0) < 5.0 * np.sqrt(2.0 / trials)), ratio


def test_the_noise_of_a_reading() -> None:
    noise = ts.Noise(quantisation=0.003, positional=0.004)
    assert reading_sigma(noise, a_sensor()) == pytest.approx(0.005 / np.sqrt(3.0))
    assert reading_sigma(ts.Noise(), a_sensor(adc_bits=1)) == pytest.approx(1.0 / np.sqrt(12.0))
    normal = ts.Noise(positional=0.004, distribution="normal")
    drawn = ts.simulate(
        a_sensor(strips=2000), ts.Contact.polygon([(1, 40), (999, 40), (999, 60), (1, 60)]), normal
    )
    assert drawn.kh is not None
    assert np.nanstd(drawn.kh) == pytest.approx(reading_sigma(normal, a_sensor()), rel=0.05)


def test_without_a_closed_form_the_network_says_what_the_vertices_move() -> None:
    """CRS-CRP: slopes of its readings by the vertices against differences of its network."""
    sensor = a_sensor("crs-crp", strips=12, pitch_mm=8.0, resistivity_ratio=100.0, contact_lambda_mm=4.0)
    outline = Outline.of(KITE)
    slope = vertex_jacobian(outline, sensor)
    touched = outline.touches(sensor.x_mm)
    assert slope.shape == (2 * touched.sum(), 8)
    np.testing.assert_array_equal(vertex_jacobian(outline, sensor, ["kl"]), slope[touched.sum() :])
    np.testing.assert_array_equal(
        vertex_jacobian(outline, sensor, x_mm=sensor.x_mm[3:5]), slope[[2, 3, 10, 11]]
    )
    step = 1e-3
    for at in range(8):
        moved = []
        for sign in (1.0, -1.0):
            v = outline.vertices.ravel().copy()
            v[at] += sign * step
            kh, kl = own_electrodes(sensor, *Outline.of(v.reshape(-1, 2)).ends(sensor.x_mm))
            moved.append(np.concatenate([kh[touched], kl[touched]]))
        np.testing.assert_allclose(slope[:, at], (moved[0] - moved[1]) / (2.0 * step), rtol=1e-4, atol=1e-8)
    assert np.isfinite(vertex_covariance(outline, sensor, 1e-3)).all()


@pytest.mark.parametrize(
    ("construction", "lam", "vertices"),
    [
        ("crs-crs", 0.0, [(11, 30), (69, 30), (69, 70), (11, 70)]),
        ("crs-crs", 0.0, [(30, 20), (45, 50), (38, 75)]),
        ("crs-m", 0.0, [(30, 20), (45, 50), (38, 75)]),
        ("crs-m", 1.0, [(30, 20), (45, 50), (38, 75)]),
        ("crs-m", 1.0, [(22, 1), (69, 9), (69, 18), (22, 14)]),
    ],
)
def test_limits_of_wide_strips_are_those_of_resolved_ones(
    construction: str, lam: float, vertices: list[tuple[float, float]]
) -> None:
    """A vertex that moves by its deviation moves readings as `wide_readings` say, to 1e-4 of Vref.

    Strips that corners lie on or that are covered in part were off by 1.2e-3 and 1e-2, on metal by 3e-4.
    """
    sensor = a_sensor(
        construction=construction, strips=16, pitch_mm=5.0, strip_width_mm=4.0, contact_lambda_mm=lam
    )
    outline = Outline.of(vertices)
    slope = vertex_jacobian(outline, sensor)
    deviation = np.sqrt(np.diag(vertex_covariance(outline, sensor, 0.003)))
    step = 0.02
    for at in range(slope.shape[1]):
        found = differences(sensor, outline, at, step)
        assert found is not None
        np.testing.assert_allclose(slope[:, at] * deviation[at], found * deviation[at], atol=1e-4)

"""The closed forms of chapter 3 against hand-computed numbers, resistor networks and their own inverses."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import FIXED, ratios, spans
from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import (
    end_weights,
    k_h,
    k_l,
    k_metal,
    lower_and_width,
    lower_from_width,
    sensing_share,
    transfer_length,
    width_from_lower,
)

L = 100.0
LAMBDAS = st.just(0.0) | st.floats(-2.0, 2.0).map(lambda e: 10.0**e)  # [mm]
ROUNDING = 1e-14  # of a reading, over Vref


def at(value: float) -> FloatArray:
    return np.array(value)


# Numbers worked by hand for L = 100, l = 20, w = 30.


@pytest.mark.parametrize(
    ("ratio", "upper", "lower"),
    [
        (1.0, 7 / 17, 4 / 17),  # 35 / 85 and 20 / 85
        (2.0, 4 / 9, 2 / 9),  # the contact is 2/3 of w: (20 + 20) / 90 and 20 / 90
        (0.25, 26 / 76, 20 / 76),  # a fifth of w: (20 + 6) / (50 + 6 + 20)
        (0.0, 2 / 7, 2 / 7),  # metal: 20 / 70 at both ends
    ],
)
def test_readings_worked_by_hand(ratio: float, upper: float, lower: float) -> None:
    assert k_h(at(20.0), at(30.0), L, ratio) == pytest.approx(upper, rel=1e-15)
    assert k_l(at(20.0), at(30.0), L, ratio) == pytest.approx(lower, rel=1e-15)


def test_metal_reading_worked_by_hand() -> None:
    assert k_metal(at(20.0), at(30.0), L) == pytest.approx(2 / 7, rel=1e-15)


@pytest.mark.parametrize(("ratio", "share"), [(0.0, 0.0), (0.25, 0.2), (1.0, 0.5), (4.0, 0.8)])
def test_sensing_share(ratio: float, share: float) -> None:
    assert sensing_share(ratio) == pytest.approx(share, rel=1e-15)


def test_erosion_is_half_a_short_contact_and_lambda_of_a_long_one() -> None:
    assert transfer_length(at(0.02), 10.0) == pytest.approx(0.01, rel=1e-6)
    assert transfer_length(at(900.0), 10.0) == pytest.approx(10.0, rel=1e-15)
    assert transfer_length(at(20.0), 10.0) == pytest.approx(
        10.0 * (np.e**2 - 1.0) / (np.e**2 + 1.0), rel=1e-15
    )
    assert transfer_length(at(20.0), 0.0) == 0.0


# The equations as the thesis prints them.


@FIXED
@given(spans(L))
def test_equal_strips_are_3_3_and_3_4(span: tuple[float, float]) -> None:
    l, w = span
    assert k_h(at(l), at(w), L) == pytest.approx((l + w / 2) / (L - w / 2), abs=ROUNDING)
    assert k_l(at(l), at(w), L) == pytest.approx(l / (L - w / 2), abs=ROUNDING)


@FIXED
@given(spans(L), st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_unequal_strips_are_3_5_and_3_6(span: tuple[float, float], rho_0: float, rho_1: float) -> None:
    l, w = span
    alpha = rho_0 * rho_1 / (rho_0 + rho_1)
    below = rho_0 * (L - l - w) + alpha * w + rho_0 * l
    ratio = rho_1 / rho_0
    assert k_h(at(l), at(w), L, ratio) == pytest.approx((rho_0 * l + alpha * w) / below, abs=ROUNDING)
    assert k_l(at(l), at(w), L, ratio) == pytest.approx(rho_0 * l / below, abs=ROUNDING)


@FIXED
@given(spans(L, margin=0.01))
def test_metal_is_3_8(span: tuple[float, float]) -> None:
    l, w = span
    assert k_metal(at(l), at(w), L) == pytest.approx(l / (L - w), abs=1e-11)  # D is 0.02 mm at the least


@FIXED
@given(spans(L), ratios(), LAMBDAS)
def test_readings_are_ordered_and_within_vref(
    span: tuple[float, float], ratio: float, contact_lambda: float
) -> None:
    l, w = at(span[0]), at(span[1])
    upper, lower = k_h(l, w, L, ratio, contact_lambda), k_l(l, w, L, ratio, contact_lambda)
    assert -ROUNDING <= lower <= upper + ROUNDING <= 1.0 + 2.0 * ROUNDING


def test_a_full_contact_shorts_metal_only() -> None:
    assert np.isnan(k_metal(at(0.0), at(L), L))
    assert k_metal(at(0.0), at(L), L, contact_lambda=5.0) == pytest.approx(0.5, abs=ROUNDING)
    assert k_h(at(0.0), at(L), L) == 1.0
    assert k_l(at(0.0), at(L), L) == 0.0


# Networks of resistors, solved by Kirchhoff's current law.


def node_voltages(count: int, resistors: list[tuple[int, int, float]]) -> FloatArray:
    """Solve a network whose node 0 is the ground and node 1 is at 1 V; the others float."""
    g = np.zeros((count, count))
    for a, b, ohm in resistors:
        g[[a, b], [a, b]] += 1.0 / ohm
        g[[a, b], [b, a]] -= 1.0 / ohm
    v = np.zeros(count)
    v[1] = 1.0
    v[2:] = np.linalg.solve(g[2:, 2:], -g[2:, 1])
    return v


@FIXED
@given(spans(L, margin=1.0), st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_ideal_contact_is_its_network(span: tuple[float, float], rho_0: float, rho_1: float) -> None:
    l, w = span[0], max(span[1], 1e-3)
    l = min(l, L - 0.5 - w)
    low, high = 2, 3
    v = node_voltages(
        4,
        [
            (0, low, rho_0 * l),
            (low, high, rho_0 * w),
            (low, high, rho_1 * w),
            (high, 1, rho_0 * (L - l - w)),
        ],
    )
    assert k_h(at(l), at(w), L, rho_1 / rho_0) == pytest.approx(v[high], abs=1e-10)
    assert k_l(at(l), at(w), L, rho_1 / rho_0) == pytest.approx(v[low], abs=1e-10)
    metal = node_voltages(3, [(0, 2, rho_0 * l), (2, 1, rho_0 * (L - l - w))])
    assert k_metal(at(l), at(w), L) == pytest.approx(metal[2], abs=1e-10)


def ladder(l: float, w: float, rho_0: float, rho_1: float, g: float, rungs: int) -> tuple[float, float]:
    """Return the voltages of the second layer at u and at l for a contact of g per ohm and mm.

    Two rails of `rungs` nodes each, joined by rungs; rho_1 = 0 makes the second rail one node.
    """
    dy = w / (rungs - 1)
    strip = np.arange(2, 2 + rungs)
    layer = strip + rungs if rho_1 else np.full(rungs, 2 + rungs)
    resistors = [(0, strip[0], rho_0 * l), (strip[-1], 1, rho_0 * (L - l - w))]
    resistors += [(a, b, rho_0 * dy) for a, b in pairwise(strip)]
    if rho_1:
        resistors += [(a, b, rho_1 * dy) for a, b in pairwise(layer)]
    end = np.isin(strip, strip[[0, -1]])
    resistors += [
        (a, b, 1.0 / (g * dy * (0.5 if e else 1.0))) for a, b, e in zip(strip, layer, end, strict=True)
    ]
    v = node_voltages(int(layer.max()) + 1, resistors)
    return float(v[layer[-1]]), float(v[layer[0]])


@pytest.mark.parametrize(
    ("l", "w", "rho_0", "rho_1", "contact_lambda"),
    [
        (20.0, 40.0, 1.0, 1.0, 5.0),
        (55.0, 40.0, 3.0, 6.0, 8.0),
        (5.0, 30.0, 2.0, 0.3, 20.0),  # most of the contact is within lambda of an end
        (15.0, 50.0, 1.5, 0.0, 6.0),  # metal
        (60.0, 12.0, 1.0, 0.0, 12.0),
    ],
)
def test_contact_resistance_is_a_ladder_of_two_thousand_nodes(
    l: float, w: float, rho_0: float, rho_1: float, contact_lambda: float
) -> None:
    g = 1.0 / ((rho_0 + rho_1) * contact_lambda**2)
    upper, lower = ladder(l, w, rho_0, rho_1, g, rungs=1000)
    ratio = rho_1 / rho_0
    assert k_h(at(l), at(w), L, ratio, contact_lambda) == pytest.approx(upper, abs=1e-5)
    assert k_l(at(l), at(w), L, ratio, contact_lambda) == pytest.approx(lower, abs=1e-5)
    assert k_h(at(l), at(w), L, ratio) != pytest.approx(upper, abs=1e-3)  # the ideal form is not good enough
    if not rho_1:
        assert k_metal(at(l), at(w), L, contact_lambda) == pytest.approx(upper, abs=1e-5)


# Inverses. The tolerances follow a reading that is wrong by rounding through the exact derivatives.


def width_tolerance(w: float, contact_lambda: float, ideal_error: float) -> float:
    """Return the error of w for one of w - 2 T: d(w - 2T)/dw = tanh^2(w / 2 lambda), and a cubic near 0."""
    if contact_lambda == 0.0:
        return ideal_error
    slope = np.tanh(w / (2.0 * contact_lambda)) ** 2
    cubic = 2.0 * np.cbrt(12.0 * contact_lambda**2 * ideal_error)
    return float(min(2.0 * ideal_error / slope if slope else np.inf, cubic) + ideal_error)


@settings(FIXED, max_examples=50)
@given(spans(L), ratios(), LAMBDAS)
def test_lower_and_width_invert_both_readings(
    span: tuple[float, float], ratio: float, contact_lambda: float
) -> None:
    l, w = span
    kh = k_h(at(l), at(w), L, ratio, contact_lambda)
    kl = k_l(at(l), at(w), L, ratio, contact_lambda)
    found_l, found_w = lower_and_width(kh, kl, L, ratio, contact_lambda)
    error = ROUNDING * L * (1.0 + ratio) / ratio
    tolerance = width_tolerance(w, contact_lambda, error)
    assert found_w == pytest.approx(w, abs=tolerance)
    assert found_l == pytest.approx(l, abs=tolerance)
    assert k_h(found_l, found_w, L, ratio, contact_lambda) == pytest.approx(kh, abs=10 * ROUNDING)
    assert k_l(found_l, found_w, L, ratio, contact_lambda) == pytest.approx(kl, abs=10 * ROUNDING)


@FIXED
@given(spans(L))
def test_equal_strips_invert_as_4_36_prints(span: tuple[float, float]) -> None:
    kh, kl = float(k_h(at(span[0]), at(span[1]), L)), float(k_l(at(span[0]), at(span[1]), L))
    l, w = lower_and_width(at(kh), at(kl), L)
    matrix = np.array([[1.0, (1.0 + kh) / 2.0], [1.0, kl / 2.0]])
    solved = np.linalg.solve(matrix, np.array([kh * L, kl * L]))
    assert (float(l), float(w)) == pytest.approx(tuple(solved), abs=1e-11)


@pytest.mark.parametrize("contact_lambda", [0.0, 5.0])
def test_noise_below_zero_width_is_not_clipped(contact_lambda: float) -> None:
    l, w = lower_and_width(at(0.40), at(0.41), L, contact_lambda=contact_lambda)
    assert w < -1.0
    assert k_h(l, w, L, 1.0, contact_lambda) == pytest.approx(0.40, abs=ROUNDING)
    assert k_l(l, w, L, 1.0, contact_lambda) == pytest.approx(0.41, abs=ROUNDING)


@settings(FIXED, max_examples=50)
@given(spans(L, margin=0.01), LAMBDAS)
def test_lower_from_width_inverts_metal(span: tuple[float, float], contact_lambda: float) -> None:
    l, w = span
    k = k_metal(at(l), at(w), L, contact_lambda)
    assert lower_from_width(k, at(w), L, contact_lambda) == pytest.approx(l, abs=1e-11)


@settings(FIXED, max_examples=50)
@given(spans(L, margin=0.01), LAMBDAS)
def test_width_from_lower_inverts_metal(span: tuple[float, float], contact_lambda: float) -> None:
    l, w = span
    k = float(k_metal(at(l), at(w), L, contact_lambda))
    slope = k  # of k (L - w + 2 T) - l - T, in w
    if contact_lambda:
        slope += (1.0 - 2.0 * k) * 0.5 * (1.0 - np.tanh(w / (2.0 * contact_lambda)) ** 2)
    found = width_from_lower(at(k), at(l), L, contact_lambda)
    assert found == pytest.approx(w, abs=ROUNDING * L / slope)


@pytest.mark.parametrize("w", [0.2, 2.0, 10.0, 60.0])
def test_width_from_lower_at_the_ground_with_contact_resistance(w: float) -> None:
    # There k is small and (3.8)'s own w, the obvious first guess, far off: Newton from it never came back.
    k = k_metal(at(0.0), at(w), L, contact_lambda=5.0)
    assert width_from_lower(k, at(0.0), L, contact_lambda=5.0) == pytest.approx(w, abs=1e-9)


@pytest.mark.parametrize("contact_lambda", [0.0, 5.0])
def test_a_reading_of_zero_says_nothing_of_the_width(contact_lambda: float) -> None:
    w = width_from_lower(np.array([0.0, 0.25]), np.array([0.0, 20.0]), L, contact_lambda)
    assert np.isnan(w[0])
    assert k_metal(at(20.0), w[1], L, contact_lambda) == pytest.approx(0.25, abs=ROUNDING)


# Weights of the linear chain.


@FIXED
@given(spans(L), ratios(), st.booleans())
def test_chain_weights_make_the_reading_linear(
    span: tuple[float, float], ratio: float, at_upper_end: bool
) -> None:
    l, w = span
    k = (k_h if at_upper_end else k_l)(at(l), at(w), L, ratio)
    c_l, c_u = end_weights(k, at_upper_end, ratio)
    assert c_l * l + c_u * (l + w) == pytest.approx(k * L, abs=1e-11)
    assert c_l + c_u == pytest.approx(1.0, abs=ROUNDING)


@FIXED
@given(spans(L, margin=0.01))
def test_chain_weights_of_metal(span: tuple[float, float]) -> None:
    l, w = span
    k = k_metal(at(l), at(w), L)
    c_l, c_u = end_weights(k, False, 0.0)
    assert c_l * l + c_u * (l + w) == pytest.approx(k * L, abs=1e-9)


@pytest.mark.parametrize("k", [0.05, 0.3, 0.5, 0.93])
@pytest.mark.parametrize(
    ("at_upper_end", "ratio", "above", "below"),
    [  # (a_ii, b_i / L) of step 3 in 4.2.4 for a vertex above and one below, as printed
        (
            True,
            1.0,
            lambda k: ((1 + k) / (1 - k), 2 * k / (1 - k)),
            lambda k: ((1 - k) / (1 + k), 2 * k / (1 + k)),
        ),
        (False, 1.0, lambda k: (k / (2 - k), 2 * k / (2 - k)), lambda k: ((2 - k) / k, 2.0)),
        (False, 0.0, lambda k: (k / (1 - k), k / (1 - k)), lambda k: ((1 - k) / k, 1.0)),
    ],
    ids=["3a kh", "3b kl", "3c k"],
)
def test_chain_weights_are_step_3(
    k: float,
    at_upper_end: bool,
    ratio: float,
    above: Callable[[float], tuple[float, float]],
    below: Callable[[float], tuple[float, float]],
) -> None:
    c_l, c_u = (float(c) for c in end_weights(at(k), at_upper_end, ratio))
    assert (c_u / c_l, k / c_l) == pytest.approx(above(k), rel=1e-13)
    assert (c_l / c_u, k / c_u) == pytest.approx(below(k), rel=1e-13)


# What kinks show: the design's table of d k / d u and d k / d l.


@pytest.mark.parametrize(("l", "w"), [(20.0, 30.0), (1.0, 5.0), (70.0, 28.0)])
def test_kink_factors(l: float, w: float) -> None:
    u, h = l + w, 1e-4
    two, one = 2.0 * L - w, L - w  # the two denominators D
    table: list[tuple[Callable[[float, float], float], float, float]] = [
        (lambda l, u: float(k_h(at(l), at(u - l), L)), 2 * (L + l) / two**2, 2 * (L - u) / two**2),
        (lambda l, u: float(k_l(at(l), at(u - l), L)), 2 * l / two**2, 2 * (2 * L - u) / two**2),
        (lambda l, u: float(k_metal(at(l), at(u - l), L)), l / one**2, (L - u) / one**2),
    ]
    for reading, by_u, by_l in table:
        assert (reading(l, u + h) - reading(l, u - h)) / (2 * h) == pytest.approx(by_u, rel=1e-6)
        assert (reading(l + h, u) - reading(l - h, u)) / (2 * h) == pytest.approx(by_l, rel=1e-6)


# Arrays.


def test_nan_passes_through_and_spares_its_neighbours() -> None:
    l, w = np.array([20.0, np.nan, 30.0]), np.array([30.0, np.nan, 10.0])
    for contact_lambda in (0.0, 4.0):
        kh, kl = k_h(l, w, L, 1.0, contact_lambda), k_l(l, w, L, 1.0, contact_lambda)
        k = k_metal(l, w, L, contact_lambda)
        back_l, back_w = lower_and_width(kh, kl, L, 1.0, contact_lambda)
        c_l, c_u = end_weights(kh, True, 1.0)
        for result in (kh, kl, k, back_l, back_w, c_l, c_u):
            np.testing.assert_array_equal(np.isnan(result), [False, True, False])
        np.testing.assert_allclose(back_l, l, atol=1e-9)
        np.testing.assert_allclose(back_w, w, atol=1e-9)
        np.testing.assert_allclose(width_from_lower(k, l, L, contact_lambda), w, atol=1e-9)
        np.testing.assert_allclose(lower_from_width(k, w, L, contact_lambda), l, atol=1e-9)


@pytest.mark.parametrize("contact_lambda", [0.0, 4.0])
def test_strips_and_scans_broadcast(contact_lambda: float) -> None:
    rng = np.random.default_rng(3)
    l, w = rng.uniform(5.0, 40.0, 6), rng.uniform(0.0, 50.0, (4, 6))  # (strips,) and (scans, strips)
    kh, kl = k_h(l, w, L, 1.5, contact_lambda), k_l(l, w, L, 1.5, contact_lambda)
    k = k_metal(l, w, L, contact_lambda)
    assert kh.shape == kl.shape == k.shape == (4, 6)
    for scan in range(4):
        np.testing.assert_array_equal(kh[scan], k_h(l, w[scan], L, 1.5, contact_lambda))
        np.testing.assert_array_equal(kl[scan], k_l(l, w[scan], L, 1.5, contact_lambda))
        np.testing.assert_array_equal(k[scan], k_metal(l, w[scan], L, contact_lambda))
    back_l, back_w = lower_and_width(kh, kl, L, 1.5, contact_lambda)
    np.testing.assert_allclose(back_l, np.broadcast_to(l, (4, 6)), atol=1e-3)
    np.testing.assert_allclose(back_w, w, atol=2e-3)  # a short contact with resistance reads w^3
    width = width_from_lower(k, l, L, contact_lambda)
    assert width.shape == (4, 6)
    np.testing.assert_allclose(width, w, atol=1e-9)


def test_rounding_takes_no_closed_form_beyond_0_or_1() -> None:
    """A contact that ends at L reads 1, one that begins at 0 reads 0, whatever its sum rounds to."""
    random = np.random.default_rng(0)
    assert k_h(at(10.000551647029065), at(32 - 10.000551647029065), 32.0) == 1.0
    for length in (32.0, 1000.0, 0.07):
        l = np.concatenate(
            [random.uniform(0.0, length, 20_000), length * 10.0 ** random.uniform(-9, 0, 20_000)]
        )
        for read in (
            k_h(l, length - l, length),
            k_h(l, length - l, length, 0.3),
            k_metal(l, length - l, length),
        ):
            assert np.nanmax(read) <= 1.0
    beyond = k_h(np.array([30.0]), np.array([2.001]), 32.0)  # no rounding: the contact is too long
    assert beyond[0] > 1.0

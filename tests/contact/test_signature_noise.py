"""The pseudo-centres of section 4.1 and the errors of section 5.1."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from strategies import FIXED, ratios, spans
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, add_reading_errors, add_transition_errors, digitise, generator
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import geometric_centre, pseudo_centres, signatures
from tacstrip.errors import OptionError
from tacstrip.sensor.spec import Sensor

L = 1000.0
RUBBER = Sensor(construction="crs-crs", strips=1000, pitch_mm=1.0, length_mm=L)
METAL = Sensor(construction="crs-m", strips=1000, pitch_mm=1.0, length_mm=L)
TUBE = Sensor(construction="cyl-crs-m", strips=20, pitch_mm=1.0, length_mm=L, radius_mm=4.0)
ROUNDING = 1e-9  # [mm] on 1000 mm


def at(span: tuple[float, float]) -> tuple[FloatArray, FloatArray, float]:
    """Return l and u as arrays, and w."""
    l, w = span
    return np.array([l]), np.array([l + w]), w


# Signatures.


@FIXED
@given(spans(L))
def test_kh_pseudo_centre_is_4_1_and_above_the_geometric_one(span: tuple[float, float]) -> None:
    l, u, w = at(span)
    centre = pseudo_centres(RUBBER, l, u)["kh"]
    assert centre == pytest.approx((l + w / 2.0) * L / (L - w / 2.0), abs=ROUNDING)
    assert centre >= geometric_centre(l, u) - ROUNDING


@FIXED
@given(spans(L))
def test_kl_pseudo_centre_is_4_2_and_below_the_geometric_one(span: tuple[float, float]) -> None:
    l, u, w = at(span)
    centre, kl = pseudo_centres(RUBBER, l, u)["kl"], signatures(RUBBER, l, u)["kl"]
    assert centre == pytest.approx(l + kl * w / 2.0, abs=ROUNDING)
    assert centre <= geometric_centre(l, u) + ROUNDING


@pytest.mark.parametrize("sensor", [METAL, TUBE], ids=lambda s: s.construction)
def test_k_pseudo_centre_is_4_3_and_above_the_geometric_one_past_the_middle(sensor: Sensor) -> None:
    @FIXED
    @given(spans(L, margin=0.01))
    def identities(span: tuple[float, float]) -> None:
        l, u, w = at(span)
        centre, k = pseudo_centres(sensor, l, u)["k"], signatures(sensor, l, u)["k"]
        assert centre == pytest.approx(l + k * w, abs=1e-7)  # L - w is 0.02 mm at the least
        assume(abs(k[0] - 0.5) > 1e-6 and w > 1e-3)
        assert (centre > geometric_centre(l, u)) == (k > 0.5)

    identities()


@FIXED
@given(spans(L), ratios())
def test_unequal_strips_keep_their_share_of_the_contact(span: tuple[float, float], ratio: float) -> None:
    # (4.1) and (4.2) with the contact's a w for w / 2: a = ratio / (1 + ratio) of it on the strip.
    l, u, w = at(span)
    a = ratio / (1.0 + ratio)
    sensor = Sensor(construction="crs-crs", strips=1, pitch_mm=1.0, length_mm=L, resistivity_ratio=ratio)
    centres, k = pseudo_centres(sensor, l, u), signatures(sensor, l, u)
    assert centres["kh"] == pytest.approx(l + a * w + k["kh"] * (1.0 - a) * w, abs=ROUNDING)
    assert centres["kl"] == pytest.approx(l + k["kl"] * (1.0 - a) * w, abs=ROUNDING)


def test_signatures_know_the_contact_resistance_of_the_spec() -> None:
    # It reads as the ideal contact, shorter by T = lambda tanh(w / 2 lambda) at both ends.
    l, u = np.array([200.0]), np.array([500.0])
    t = 40.0 * np.tanh(300.0 / 80.0)
    for ideal in (RUBBER, METAL):
        keys = {"strips": 1, "pitch_mm": 1.0, "length_mm": L, "contact_lambda_mm": 40.0}
        real = Sensor(construction=ideal.construction, **keys)  # type: ignore[arg-type]
        expected = signatures(ideal, l + t, u - t)
        for name, k in signatures(real, l, u).items():
            assert k == pytest.approx(expected[name], rel=1e-13)


@pytest.mark.parametrize("sensor", [RUBBER, METAL, TUBE], ids=lambda s: s.construction)
def test_signatures_have_the_shape_of_l_and_keep_its_gaps(sensor: Sensor) -> None:
    l = np.array([[100.0, np.nan, 300.0], [np.nan, 200.0, 0.0]])
    u = l + np.array([[50.0, np.nan, 0.0], [np.nan, 100.0, 40.0]])
    found = signatures(sensor, l, u)
    assert tuple(found) == sensor.signatures
    for k in found.values():
        np.testing.assert_array_equal(np.isnan(k), np.isnan(l))
    np.testing.assert_array_equal(geometric_centre(l, u), [[125.0, np.nan, 300.0], [np.nan, 250.0, 20.0]])


def test_metal_tied_to_both_ends_reads_nothing() -> None:
    k = signatures(METAL, np.array([0.0, 0.0]), np.array([L, L - 1.0]))["k"]
    np.testing.assert_array_equal(np.isnan(k), [True, False])


@pytest.mark.parametrize(
    ("corners", "upper", "jump"),
    [
        (
            [(300, 300), (600, 350), (500, 400), (400, 600)],
            True,
            -2.0 - 3.0,
        ),  # slopes of the edges at x = 400
        ([(300, 300), (400, 200), (600, 350), (500, 400)], False, 0.75 + 1.0),
    ],
    ids=["upper", "lower"],
)
def test_a_vertex_kinks_every_signature_as_the_design_says(
    corners: list[tuple[int, int]], upper: bool, jump: float
) -> None:
    touch = footprint(RUBBER, Contact.polygon(np.add(corners, (0.5, 0.0))))  # corners on centre lines
    l, u = float(touch.l[400]), float(touch.u[400])
    two, one = 2.0 * L - (u - l), L - (u - l)  # the two denominators D
    for sensor, name, by_u, by_l in [
        (RUBBER, "kh", 2.0 * (L + l) / two**2, 2.0 * (L - u) / two**2),
        (RUBBER, "kl", 2.0 * l / two**2, 2.0 * (2.0 * L - u) / two**2),
        (METAL, "k", l / one**2, (L - u) / one**2),
    ]:
        k = signatures(sensor, touch.l, touch.u)[name][398:403]
        # Two strips on each side give the slopes to second order.
        right, left = (-3 * k[2] + 4 * k[3] - k[4]) / 2.0, (3 * k[2] - 4 * k[1] + k[0]) / 2.0
        assert right - left == pytest.approx((by_u if upper else by_l) * jump, rel=1e-3)


# Errors on readings.

MANY = np.full(200_000, 0.4)
BOTH = pytest.mark.parametrize("distribution", ["uniform", "normal"])
Distribution = Literal["uniform", "normal"]


@pytest.mark.parametrize("noise", [Noise(quantisation=0.02), Noise(positional=0.02)], ids=["cqe", "pu"])
def test_a_uniform_error_fills_its_bounds(noise: Noise) -> None:
    error = add_reading_errors(MANY, noise, np.random.default_rng(1)) - MANY
    assert np.abs(error).max() <= 0.02 * (1.0 + 1e-12)
    assert np.abs(error).max() > 0.0199
    assert error.var() == pytest.approx(0.02**2 / 3.0, rel=0.01)
    assert error.mean() == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(np.histogram(error, 10, (-0.02, 0.02))[0], 20_000, rtol=0.03)


def test_a_normal_error_has_the_same_variance_and_no_bounds() -> None:
    error = (
        add_reading_errors(MANY, Noise(quantisation=0.02, distribution="normal"), np.random.default_rng(2))
        - MANY
    )
    assert error.var() == pytest.approx(0.02**2 / 3.0, rel=0.01)
    assert (np.abs(error) > 0.02).mean() == pytest.approx(0.0833, abs=0.003)  # beyond sqrt(3) sigma
    assert ((error / error.std()) ** 4).mean() == pytest.approx(3.0, abs=0.1)


@BOTH
def test_the_two_errors_are_independent(distribution: Distribution) -> None:
    # One shared draw would give (0.02 + 0.01)^2 / 3 instead of the sum of the two variances.
    noise = Noise(quantisation=0.02, positional=0.01, distribution=distribution)
    error = add_reading_errors(MANY, noise, np.random.default_rng(3)) - MANY
    assert error.var() == pytest.approx((0.02**2 + 0.01**2) / 3.0, rel=0.01)


@BOTH
def test_readings_get_errors_of_their_own(distribution: Distribution) -> None:
    k = np.full((2, 50_000), 0.4)
    error = (
        add_reading_errors(k, Noise(quantisation=0.02, distribution=distribution), np.random.default_rng(4))
        - k
    )
    assert abs(np.corrcoef(error)[0, 1]) < 0.02
    assert abs(np.corrcoef(error[0, 1:], error[0, :-1])[0, 1]) < 0.02


def test_errors_neither_clip_nor_fill_gaps() -> None:
    k = np.array([0.0, 1.0, np.nan] * 1000)
    noisy = add_reading_errors(k, Noise(positional=0.1), np.random.default_rng(5))
    np.testing.assert_array_equal(np.isnan(noisy), np.isnan(k))
    assert np.nanmin(noisy) < -0.09
    assert np.nanmax(noisy) > 1.09


def test_no_noise_changes_nothing() -> None:
    k, x = np.array([0.1, np.nan, 1.0]), np.array([3.0, 7.0])
    np.testing.assert_array_equal(add_reading_errors(k, Noise(), np.random.default_rng(0)), k)
    np.testing.assert_array_equal(
        add_reading_errors(k, Noise(transition_mm=5.0), np.random.default_rng(0)), k
    )
    np.testing.assert_array_equal(add_transition_errors(x, Noise(), np.random.default_rng(0)), x)
    np.testing.assert_array_equal(
        add_transition_errors(x, Noise(quantisation=0.1, positional=0.1), np.random.default_rng(0)), x
    )


def test_errors_leave_what_they_were_given() -> None:
    k = np.array([0.1, 0.2])
    add_reading_errors(k, Noise(quantisation=0.1, positional=0.1), np.random.default_rng(0))
    digitise(k, 2)
    np.testing.assert_array_equal(k, [0.1, 0.2])


# Errors on transitions.


def test_transitions_move_within_their_error() -> None:
    x = np.linspace(100.0, 900.0, 100_000)
    error = add_transition_errors(x, Noise(transition_mm=5.0), np.random.default_rng(6)) - x
    assert 4.99 < np.abs(error).max() <= 5.0 + ROUNDING
    assert error.var() == pytest.approx(25.0 / 3.0, rel=0.02)
    normal = (
        add_transition_errors(x, Noise(transition_mm=5.0, distribution="normal"), np.random.default_rng(7))
        - x
    )
    assert normal.var() == pytest.approx(25.0 / 3.0, rel=0.02)
    assert np.abs(normal).max() > 10.0


# Seeds.


def test_a_seed_returns_its_errors_and_another_does_not() -> None:
    def draw(seed: int | np.random.Generator) -> FloatArray:
        return add_reading_errors(MANY[:100], Noise(quantisation=0.01, positional=0.01), generator(seed))

    np.testing.assert_array_equal(draw(11), draw(11))
    assert (draw(11) != draw(12)).all()
    going_on = generator(11)
    assert generator(going_on) is going_on
    np.testing.assert_array_equal(draw(going_on), draw(11))
    assert (draw(going_on) != draw(11)).all()


# The A/D converter.


@pytest.mark.parametrize("bits", [1, 2, 8, 12, 16, 32])
def test_a_converter_rounds_to_its_codes(bits: int) -> None:
    k = np.linspace(0.0, 1.0, 10_007)
    read = digitise(k, bits)
    top = 2**bits - 1
    np.testing.assert_allclose(read * top, np.round(read * top), atol=1e-6)
    assert np.abs(read - k).max() <= 0.5 / top + 1e-15
    assert (read[0], read[-1]) == (0.0, 1.0)
    assert (np.diff(read) >= 0.0).all()
    if bits <= 8:
        assert len(np.unique(read)) == 2**bits
        assert np.abs(read - k).max() > 0.49 / top


def test_two_bits_by_hand() -> None:
    k = np.array([0.0, 0.16, 0.17, 0.49, 0.51, 0.83, 0.84, 1.0])
    np.testing.assert_allclose(digitise(k, 2) * 3.0, [0, 0, 1, 1, 2, 2, 3, 3], rtol=1e-15)


@pytest.mark.parametrize("bits", [None, 1, 12])
def test_readings_are_clipped_to_the_reference(bits: int | None) -> None:
    read = digitise(np.array([-0.3, -1e-12, 1.0 + 1e-12, 1.7, np.nan]), bits)
    np.testing.assert_array_equal(read, [0.0, 0.0, 1.0, 1.0, np.nan])


def test_without_a_converter_readings_keep_every_digit() -> None:
    k = np.random.default_rng(8).uniform(0.0, 1.0, 100)
    np.testing.assert_array_equal(digitise(k, None), k)


# What is refused.


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"distribution": "gauss"}, "distribution 'gauss' does not exist; choose one of: uniform, normal"),
        ({"quantisation": -0.01}, "quantisation = -0.01: must be 0 or more"),
        ({"positional": float("nan")}, "positional = nan: must be 0 or more"),
        ({"transition_mm": float("inf")}, "transition_mm = inf: must be 0 or more"),
        ({"transition_mm": -5}, "transition_mm = -5: must be 0 or more"),
        ({"quantisation": 1.5}, "quantisation = 1.5: a fraction of Vref, 0.01 for 1 %"),
        ({"positional": 5}, "positional = 5: a fraction of Vref, 0.01 for 1 %"),
    ],
)
def test_impossible_noise(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError) as caught:
        Noise(**keys)
    assert str(caught.value) == message


@settings(FIXED, max_examples=25)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1e6), st.sampled_from(["uniform", "normal"]))
def test_possible_noise_is_kept(q: float, p: float, t: float, distribution: Distribution) -> None:
    noise = Noise(quantisation=q, positional=p, transition_mm=t, distribution=distribution)
    assert (noise.quantisation, noise.positional, noise.transition_mm) == (q, p, t)
    assert noise.distribution == distribution

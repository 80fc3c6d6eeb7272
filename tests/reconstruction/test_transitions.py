"""The gradient rule, and transitions given by the caller."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.reconstruction.vertex.transitions import by_gradient, transitions_of_runs

SENSOR = ts.Sensor(construction="crs-crs", strips=400, pitch_mm=1.0, length_mm=400.0)
CORNERS = np.array([(80.5, 200.0), (160.5, 110.0), (300.5, 180.0), (220.5, 290.0)])


def _signature(name: str, noise: ts.Noise | None = None, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(CORNERS), noise or ts.Noise(), rng=seed)
    run = scan.runs()[0]
    return SENSOR.x_mm[run], scan[name][run]


@pytest.mark.parametrize("name", ["kh", "kl"])
def test_clean_kinks_are_found_to_a_strip(name: str) -> None:
    """The ends are known to half a pitch; a kink between curved sections to half a strip."""
    found = by_gradient(*_signature(name), pitch_mm=1.0)
    np.testing.assert_allclose(found, np.sort(CORNERS[:, 0]), atol=0.51)


@pytest.mark.parametrize("name", ["kh", "kl"])
def test_kinks_under_profile_i_are_found_near_by(name: str) -> None:
    counts, errors = [], []
    for seed in range(100):
        found = by_gradient(*_signature(name, ts.Noise(positional=0.005), seed), pitch_mm=1.0)
        counts.append(len(found))
        if len(found) == 4:
            errors.append(np.abs(found - np.sort(CORNERS[:, 0]))[1:-1].max())
    assert np.mean(np.array(counts) == 4) >= 0.9
    assert np.median(errors) < 5.0  # of 220 strips: the thesis' transition error


@pytest.mark.parametrize("seed", range(20))
def test_noise_alone_has_no_transitions(seed: int) -> None:
    """A straight signature under noise: at 4 standard deviations a false find is rare."""
    random = np.random.default_rng(seed)
    k = 0.5 + random.uniform(-0.01, 0.01, 200)
    assert len(by_gradient(np.arange(0.5, 200), k, 1.0)) == 2


def test_a_constant_or_short_signature() -> None:
    for n in (1, 2, 4, 5, 9):
        found = by_gradient(np.arange(0.5, n), np.full(n, 0.5), 1.0)
        np.testing.assert_allclose(found, [0.0, n])


def test_pitch_scales_everything() -> None:
    x, k = _signature("kh")
    np.testing.assert_allclose(by_gradient(6.5 * x, k, 6.5), 6.5 * by_gradient(x, k, 1.0), rtol=1e-9)


def test_given_transitions_go_to_the_nearest_object() -> None:
    k = np.full(400, np.nan)
    k[50:80] = k[200:260] = 0.5
    given = [48.0, 60.0, 83.0, 190.0, 230.0, 262.0]
    first, second = transitions_of_runs(ts.Scan(kh=k), SENSOR, "kh", given)
    np.testing.assert_array_equal(first, given[:3])
    np.testing.assert_array_equal(second, given[3:])


def test_the_gradient_rule_by_name() -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(CORNERS))
    (found,) = transitions_of_runs(scan, SENSOR, "kh", "gradient")
    np.testing.assert_array_equal(found, by_gradient(*_signature("kh"), pitch_mm=1.0))


def test_auto_finds_the_vertices_of_the_fitted_polygon() -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(CORNERS))
    (found,) = transitions_of_runs(scan, SENSOR, "kh", "auto")
    true = np.sort([x for x, _ in CORNERS])
    np.testing.assert_allclose(found[1:-1], true[1:-1], atol=1e-6)
    np.testing.assert_allclose(found[[0, -1]], true[[0, -1]], atol=1.0)  # a pitch: what touched strips tell
    noisy = ts.simulate(SENSOR, ts.Contact.polygon(CORNERS), ts.Noise(positional=0.005), rng=1)
    (found,) = transitions_of_runs(noisy, SENSOR, "kh", "auto", ts.Noise(positional=0.005))
    np.testing.assert_allclose(found, true, atol=4.0)

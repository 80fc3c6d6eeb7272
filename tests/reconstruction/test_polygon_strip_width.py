"""The polygon fit on strips as wide as they are, resolved by networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.geometry.outline import Outline
from tacstrip.network.strips.resolved import wide_readings
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.strip_width import equivalent_ends, remove_width_effect

SIZE = {"strips": 40, "pitch_mm": 3.25, "length_mm": 130.0, "strip_width_mm": 3.0, "contact_lambda_mm": 2.0}
SENSORS = {name: ts.Sensor(construction=name, **SIZE) for name in ("crs-crs", "crs-m")}  # type: ignore[arg-type]
TRUTH = np.array([(14.0, 60.0), (55.0, 22.0), (117.0, 48.0), (80.0, 96.0), (35.0, 88.0)])


@pytest.fixture(scope="module", params=SENSORS)
def unit(request: pytest.FixtureRequest) -> tuple[ts.Sensor, dict[str, FloatArray]]:
    sensor = SENSORS[request.param]
    return sensor, wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)


def test_the_closed_form_of_a_wide_strip_is_the_networks(
    unit: tuple[ts.Sensor, dict[str, FloatArray]],
) -> None:
    """But for strips that are covered in part, or have a corner on them."""
    sensor, read = unit
    outline, x = Outline.of(TRUTH), sensor.x_mm
    wide = signatures(sensor, *equivalent_ends(sensor, outline, x))
    thin = signatures(sensor, *(np.interp(x, *c.T) for c in (outline.lower, outline.upper)))
    far = np.abs(x[:, None] - TRUTH[:, 0]).min(axis=1) > sensor.strip_width
    inside = np.isfinite(next(iter(read.values()))) & far
    assert np.count_nonzero(inside) > 15
    for name, k in read.items():
        off, plainly = (np.abs(model[name] - k)[inside].max() for model in (wide, thin))
        assert off < 5e-4
        assert off < 0.2 * plainly


def test_without_noise_the_vertices_come_back() -> None:
    sensor = SENSORS["crs-crs"]
    read = wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)
    wide, thin = (
        fit_polygon(ts.Scan(time_s=0.0, **read), sensor, None, vertices=5, wide=w).objects[0]
        for w in (True, False)
    )
    error, plainly = (np.sqrt(((o.vertices - Outline.of(TRUTH).vertices) ** 2).mean()) for o in (wide, thin))
    assert error < 0.1 * plainly
    assert error < 0.01 * sensor.pitch_mm


def test_noisy_readings_are_used_up_to_the_bound_and_regions_hold(
    unit: tuple[ts.Sensor, dict[str, FloatArray]],
) -> None:
    sensor, read = unit
    noise, truth = ts.Noise(positional=0.003), Outline.of(TRUTH).vertices
    bound = np.trace(vertex_covariance(Outline.of(TRUTH), sensor, reading_sigma(noise, sensor)))
    random = np.random.default_rng(2)
    squares, inside = [], []
    for _ in range(60):
        noisy = {name: k + random.uniform(-0.003, 0.003, len(k)) for name, k in read.items()}
        o = fit_polygon(
            ts.Scan(time_s=0.0, **noisy), sensor, noise, bounded=False, vertices=5, wide=True
        ).objects[0]
        assert o.covariance is not None
        error = o.vertices - truth
        squares.append((error**2).sum())
        for i, e in enumerate(error):
            inside.append(e @ np.linalg.pinv(o.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]) @ e < 5.991)
    assert np.sqrt(np.median(squares) / bound) < 1.25
    assert np.mean(inside) > 0.85


def test_bounds_and_bridges_know_of_the_width() -> None:
    sensor = SENSORS["crs-crs"]
    read = wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)
    random = np.random.default_rng(3)
    noisy = {name: k + random.uniform(-0.005, 0.005, len(k)) for name, k in read.items()}
    for k in noisy.values():
        k[20] = np.nan
    o = fit_polygon(ts.Scan(time_s=0.0, **noisy), sensor, ts.Noise(positional=0.005), wide=True).objects[0]
    assert o.strips == slice(4, 36)
    assert "20 reads nothing inside" in o.advice or "21 reads nothing inside" in o.advice
    assert o.guarantee is not None
    assert ts.mismatch(TRUTH, o.vertices).iou > 0.96


def test_what_the_width_adds_vanishes_with_it() -> None:
    sensor = replace(SENSORS["crs-crs"], strip_width_mm=1e-6)
    readings = {"kh": np.array([0.5, 0.6]), "kl": np.array([0.4, 0.5])}
    thin = remove_width_effect(sensor, Outline.of(TRUTH), np.array([50.0, 70.0]), readings)
    for name, k in readings.items():
        np.testing.assert_allclose(thin[name], k, atol=1e-7)


def test_few_strips_and_garbage() -> None:
    sensor, random = SENSORS["crs-crs"], np.random.default_rng(5)
    for strips in range(1, 40, 3):
        k = np.full((2, 40), np.nan)
        k[:, 40 - strips :] = random.uniform(size=(2, strips))
        for o in fit_polygon(ts.Scan(kh=k[0], kl=k[1]), sensor, wide=True).objects:
            assert o.status == "ok" or o.advice
            if o.found:
                assert o.vertices[:, 1].min() >= 0.0
                assert o.vertices[:, 1].max() <= sensor.length_mm

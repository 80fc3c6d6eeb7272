"""Errors that strips share and that last, in covariances, bounds, status and advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import NoiseProcess
from tacstrip.design.limits import limits
from tacstrip.errors import ReadingError
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.reconstruction.noise_covariance import Averaging, averaging_advice, reading_covariance
from tacstrip.simulation import readings

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
TRUTH = np.array([(14.0, 36.0), (62.0, 21.0), (83.0, 58.0), (40.0, 80.0)])
CONTACT = ts.Contact.polygon(TRUTH)
ALL = ts.Noise(
    white=0.003, white_shared=0.2, wander=(0.002, 0.001), wander_s=(3.0, 100.0), wander_shared=0.3,
    wander_by_signature=0.4, offset=0.002, gain=0.004, edge_mm=0.3, edge_correlation_mm=6.0, blur_mm=0.3,
    hum=0.002, hum_hz=3.3,
)  # fmt: skip


def means(noise: ts.Noise, count: int, period_s: float, trials: int) -> list[ts.Scan]:
    """Return means of so many scans of a contact that rests, each of a sensor of its own."""
    found = []
    l, u = (np.tile(end, (count, 1)) for end in ts.footprint(SENSOR, CONTACT))
    for seed in range(trials):
        times_s = 7.0 * seed + period_s * np.arange(count)
        k = readings(SENSOR, l, u, process=NoiseProcess(noise, SENSOR, seed), time_s=times_s)
        scans = [ts.Scan(kh=h, kl=low, time_s=t) for h, low, t in zip(k["kh"], k["kl"], times_s, strict=True)]
        found.append(ts.Scan.mean(scans))
    return found


@pytest.mark.parametrize("count", [1, 6])
def test_the_covariance_is_that_of_readings_drawn(count: int) -> None:
    drawn = means(ALL, count, 0.7, 250)
    there = drawn[0].touched
    k = np.array([np.concatenate([s["kh"][there], s["kl"][there]]) for s in drawn])
    x = SENSOR.x_mm[there]
    averaging = Averaging.of(drawn[0])
    assert averaging.count == count
    assert averaging.span_s == pytest.approx(0.7 * (count - 1))
    wanted = reading_covariance(ALL, SENSOR, x, ts.Outline.of(TRUTH).ends(x), ("kh", "kl"), averaging)
    found = np.cov(k.T)
    scale = np.sqrt(np.diag(wanted))
    off = (found - wanted) / np.outer(scale, scale)
    assert np.abs(np.diag(off)).mean() < 0.12
    assert np.sqrt((off**2).mean()) < 0.1
    assert (
        np.abs(wanted / np.outer(scale, scale) - np.eye(len(wanted))).mean() > 0.15
    )  # much to be right about


def held(
    scans: list[ts.Scan], noise: ts.Noise | None, vertices: int | None = None
) -> tuple[FloatArray, Sequence[str]]:
    """Return how often 95 % regions of the corners, and of the area, hold the truth, and the status of each."""
    inside, areas, status = [], [], []
    area = 0.5 * np.sum(TRUTH[:, 0] * np.roll(TRUTH[:, 1], -1) - np.roll(TRUTH[:, 0], -1) * TRUTH[:, 1])
    for scan in scans:
        found = ts.fit_polygon(scan, SENSOR, noise, vertices=vertices).objects[0]
        status.append(found.status)
        if len(found.vertices) != 4:
            continue
        assert found.covariance is not None
        assert found.deviations is not None
        for i, off in enumerate(found.vertices - TRUTH):
            own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
            inside.append(off @ np.linalg.solve(own, off) < 5.991)
        areas.append(abs(found.area - area) < 1.96 * found.deviations[0])
    return np.array([np.mean(inside), np.mean(areas)]), status


RUBBER = ts.Noise(white=0.0066, wander=0.0033, wander_s=18.0, wander_shared=0.2)


@pytest.mark.parametrize(("noise", "count"), [(RUBBER, 1), (RUBBER, 16), (ALL, 1), (ALL, 6)])
def test_regions_hold_for_single_scans_and_for_means(noise: ts.Noise, count: int) -> None:
    found, status = held(means(noise, count, 1.75, 60), noise)
    assert found == pytest.approx(0.95, abs=0.055)
    assert status.count("ok") >= 54


def test_regions_of_a_mean_that_say_nothing_of_the_floor_are_too_small() -> None:
    """What was wrong: white noise alone, averaged away."""
    white = ts.Noise(white=0.0074)
    scans = means(RUBBER, 64, 0.5, 20)
    assert held(scans, white, vertices=4)[0][0] < 0.8
    assert held(scans, RUBBER, vertices=4)[0][0] > 0.88


def test_the_noise_of_the_spec_is_taken_where_none_is_given() -> None:
    scan = means(ALL, 1, 1.0, 1)[0]
    by_spec = ts.fit_polygon(scan, replace(SENSOR, noise=ALL)).objects[0]
    given = ts.fit_polygon(scan, SENSOR, ALL).objects[0]
    assert by_spec.covariance is not None
    np.testing.assert_array_equal(by_spec.covariance, given.covariance)
    alone = ts.fit_polygon(scan, replace(SENSOR, noise=ALL), ts.Noise(white=0.003), vertices=4).objects[0]
    assert alone.covariance is not None
    assert np.trace(alone.covariance) < 0.9 * np.trace(by_spec.covariance)


def test_the_bound_counts_what_strips_share_and_fits_reach_it() -> None:
    outline = ts.Outline.of(TRUTH)
    single = ts.vertex_covariance(outline, SENSOR, reading_sigma(ts.Noise(white=0.003), SENSOR))
    same = ts.vertex_covariance(outline, SENSOR, ts.Noise(white=0.003))
    np.testing.assert_allclose(same, single, rtol=1e-6, atol=1e-9)
    shared = ts.vertex_covariance(outline, SENSOR, ALL)
    np.testing.assert_array_equal(limits(SENSOR, outline, ALL)[-1].covariance, shared)
    errors = [
        found.vertices - TRUTH
        for scan in means(ALL, 1, 1.0, 60)
        if len((found := ts.fit_polygon(scan, SENSOR, ALL).objects[0]).vertices) == 4
    ]
    rms = float(np.sqrt(np.mean(np.sum(np.square(errors), axis=2))))
    assert 0.85 < rms / ts.vertex_rms(shared) < 1.4


def test_bounded_estimates_are_for_independent_bounded_errors_of_single_scans() -> None:
    uniform = ts.Noise(positional=0.003)
    scan = ts.simulate(SENSOR, CONTACT, uniform, rng=1)
    assert ts.fit_polygon(scan, SENSOR, uniform).objects[0].guaranteed is not None
    both = replace(uniform, wander=0.001)
    assert ts.fit_polygon(scan, SENSOR, both).objects[0].guaranteed is None
    mean = ts.Scan.mean([ts.simulate(SENSOR, CONTACT, uniform, rng=i) for i in range(4)])
    assert ts.fit_polygon(mean, SENSOR, uniform).objects[0].guaranteed is None


def test_advice_promises_no_more_than_the_floor_allows() -> None:
    floor = ts.Noise(white=0.006, wander=0.003, wander_s=100.0)
    assert averaging_advice(ts.Noise(white=0.006), SENSOR, Averaging()) == "average more scans"
    assert "tacstrip noise" in averaging_advice(None, SENSOR, Averaging())
    some = averaging_advice(floor, SENSOR, Averaging())
    assert some == "average 16 scans (more hardly help: an error of 0.3 % of Vref stays)"
    assert averaging_advice(floor, SENSOR, Averaging(16, 1.0)).startswith(
        "averaging more scans does not help"
    )
    triangle = ts.Contact.polygon([(14.0, 46.0), (42.0, 41.0), (83.0, 48.0)])
    scans = [ts.simulate(SENSOR, triangle, floor, rng=seed) for seed in range(6)]
    said = [ts.fit_polygon(ts.Scan(kh=s["kh"]), SENSOR, floor).objects[0].advice for s in scans]
    assert all(some in a for a in said)
    assert not any("average more" in a for a in said)


def test_noise_that_is_not_given_has_a_floor_and_a_ceiling() -> None:
    coarse = replace(SENSOR, adc_bits=6)
    exact = ts.fit_polygon(ts.simulate(replace(SENSOR, strips=20), CONTACT), coarse).objects[0]
    assert exact.covariance is not None
    bound = ts.vertex_covariance(ts.Outline.of(TRUTH), coarse, reading_sigma(ts.Noise(), coarse))
    assert ts.vertex_rms(exact.covariance) > 0.8 * ts.vertex_rms(bound)
    wild = [
        ts.fit_polygon(ts.simulate(SENSOR, CONTACT, ts.Noise(white=0.05), rng=i), SENSOR).status
        for i in range(6)
    ]
    assert "ok" not in wild


# Means.


def test_a_mean_leaves_strays_and_strips_out_that_are_seldom_touched() -> None:
    k = np.full((20, 3), 0.4) + np.random.default_rng(0).normal(0.0, 1e-3, (20, 3))
    k[3, 0], k[:15, 2] = 0.9, np.nan
    mean = ts.Scan.mean([ts.Scan(k=row, time_s=0.5 * i) for i, row in enumerate(k)])
    assert mean["k"][:2] == pytest.approx(0.4, abs=1e-3)
    assert np.isnan(mean["k"][2])
    assert (mean.averaged, mean.span_s, mean.time_s) == (20, 9.5, 4.75)


def test_what_has_no_mean() -> None:
    with pytest.raises(ReadingError, match="no scan"):
        ts.Scan.mean([])
    with pytest.raises(ReadingError, match="same signatures"):
        ts.Scan.mean([ts.Scan(k=np.full(1, 0.1)), ts.Scan(kh=np.full(1, 0.1))])
    with pytest.raises(ReadingError, match="averaged = 0"):
        ts.Scan(k=np.full(1, 0.1), averaged=0)


def test_a_mean_of_a_contact_that_moved_is_doubted() -> None:
    noise = ts.Noise(positional=0.005)
    moving = [ts.simulate(SENSOR, CONTACT.moved(0.0, 1.5 * i), noise, rng=i) for i in range(8)]
    mean = ts.Scan.mean(moving)
    assert mean.moved > 0.025
    found = ts.fit_polygon(mean, SENSOR, noise)
    assert found.status == "doubtful"
    assert "the contact moved while 8 scans were averaged" in found.advice
    noisy = ts.Noise(positional=0.02)
    assert ts.Scan.mean([ts.simulate(SENSOR, CONTACT, noisy, rng=i) for i in range(8)]).moved == 0.0
    with pytest.raises(ts.ArgumentError, match=r"Scan\.mean takes scans"):
        ts.Scan.mean(5)  # type: ignore[arg-type]

"""Errors that last from scan to scan, and those that strips share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import NoiseProcess, add_reading_errors
from tacstrip.errors import OptionError

SENSOR = ts.Sensor(construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=100.0)
FLAT = {"kh": np.full(200, 0.5), "kl": np.full(200, 0.4)}
WIDE = ts.Contact.polygon([(-5.0, 30.0), (205.0, 30.0), (205.0, 70.0), (-5.0, 70.0)])


def errors(noise: ts.Noise, times_s: FloatArray, seed: int = 1) -> FloatArray:
    """Return errors (scans, signatures, strips) of readings in the middle."""
    process = NoiseProcess(noise, SENSOR, seed)
    drawn = process.add({n: np.tile(k, (len(times_s), 1)) for n, k in FLAT.items()}, times_s)
    return np.stack([drawn[n] - FLAT[n] for n in FLAT], axis=1)


def read_ends(scan: ts.Scan) -> tuple[FloatArray, FloatArray]:
    """Return l and u [mm] by the formula of design.md."""
    span = 1.0 + scan["kh"] - scan["kl"]
    return 100.0 * scan["kl"] / span, 100.0 * (2.0 * scan["kh"] - scan["kl"]) / span


def test_errors_of_section_5_1_are_drawn_as_they_were() -> None:
    noise = ts.Noise(quantisation=0.001, positional=0.005)
    random = np.random.default_rng(5)
    before = {name: add_reading_errors(k, noise, random) for name, k in FLAT.items()}
    now = NoiseProcess(noise, SENSOR, 5).add(FLAT)
    for name, k in before.items():
        np.testing.assert_array_equal(now[name], k)


def test_white_noise_and_the_share_that_channels_have_in_common() -> None:
    e = errors(ts.Noise(white=0.01, white_shared=0.3), np.arange(400.0))
    assert e.std() == pytest.approx(0.01, rel=0.05)
    assert e.mean(axis=(1, 2)).var() == pytest.approx(0.3e-4, rel=0.25)
    assert abs(np.corrcoef(e[:-1, 0, 0], e[1:, 0, 0])[0, 1]) < 0.15


def test_the_zero_wanders_with_its_time_constant() -> None:
    times_s = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 300))  # uneven times, too
    e = errors(ts.Noise(wander=(0.01, 0.02), wander_s=(2.0, 50.0)), times_s).reshape(300, -1)
    assert (e**2).mean() == pytest.approx(5e-4, rel=0.15)
    for lag in (1, 10, 40):
        apart = times_s[lag:] - times_s[:-lag]
        wanted = (1e-4 * np.exp(-apart / 2.0) + 4e-4 * np.exp(-apart / 50.0)).mean()
        assert (e[lag:] * e[:-lag]).mean() == pytest.approx(wanted, rel=0.25)


def test_a_wander_that_all_channels_share() -> None:
    e = errors(ts.Noise(wander=0.01, wander_s=1.0, wander_shared=1.0), np.arange(20.0))
    assert np.ptp(e, axis=(1, 2)).max() < 1e-15
    assert e[:, 0, 0].std() > 0.003


def test_a_wander_that_the_strips_of_one_signature_share() -> None:
    e = errors(ts.Noise(wander=0.01, wander_s=1.0, wander_by_signature=1.0), np.arange(200.0))
    assert np.ptp(e, axis=2).max() < 1e-15
    assert e.std() == pytest.approx(0.01, rel=0.2)
    assert abs(np.corrcoef(e[:, 0, 0], e[:, 1, 0])[0, 1]) < 0.25


def test_offset_and_gain_stay_as_they_are() -> None:
    offset = errors(ts.Noise(offset=0.01), np.arange(3.0))
    assert np.ptp(offset) < 1e-15
    assert abs(offset[0, 0, 0]) > 1e-4
    gain = errors(ts.Noise(gain=0.02), np.arange(3.0))
    np.testing.assert_allclose(gain[0], gain[2], atol=1e-15)
    np.testing.assert_allclose(gain[0, 0] / 0.5, gain[0, 1] / 0.4, atol=1e-12)  # one gain a strip
    assert (gain[0, 0] / 0.5).std() == pytest.approx(0.02, rel=0.2)


def test_hum_has_its_frequency_and_strength() -> None:
    times_s = np.arange(0.0, 1.0, 0.002)
    e = errors(ts.Noise(hum=0.01, hum_hz=50.0), times_s)[:, 0, 0]
    assert e.std() == pytest.approx(0.01, rel=1e-6)
    assert int(np.abs(np.fft.rfft(e)).argmax()) == 50


def test_strays_are_as_many_and_as_large() -> None:
    e = errors(ts.Noise(strays=0.01, stray_size=0.2), np.arange(200.0))
    assert (e != 0.0).mean() == pytest.approx(0.01, rel=0.1)
    assert e[e != 0.0].std() == pytest.approx(0.2, rel=0.1)


def test_soft_edges_move_both_readings_as_the_closed_form_says_and_neighbours_alike() -> None:
    noise = ts.Noise(edge_mm=0.5, edge_correlation_mm=2.0)
    moved = []
    for seed in range(40):
        scan = ts.simulate(SENSOR, WIDE, noise, rng=seed)
        moved.append(np.stack(read_ends(scan)) - [[30.0], [70.0]])
    ends = np.array(moved)  # (40, 2, strips)
    assert ends.std() == pytest.approx(0.5, rel=0.05)
    for lag in (1, 4):
        assert (ends[..., lag:] * ends[..., :-lag]).mean() / 0.25 == pytest.approx(
            np.exp(-lag / 2.0), abs=0.06
        )
    assert abs((ends[:, 0] * ends[:, 1]).mean()) / 0.25 < 0.08


def test_blur_moves_all_ends_out_or_in_together() -> None:
    scan = ts.simulate(SENSOR, WIDE, ts.Noise(blur_mm=1.0), rng=3)
    l, u = read_ends(scan)
    np.testing.assert_allclose(l - 30.0, 70.0 - u, atol=1e-9)
    assert np.ptp(l) < 1e-9 < abs(l[0] - 30.0)


def test_errors_are_clipped_at_zero_and_vref() -> None:
    low = ts.Contact.polygon([(-5.0, 0.0), (205.0, 0.0), (205.0, 2.0), (-5.0, 2.0)])
    scan = ts.simulate(SENSOR, low, ts.Noise(white=0.05), rng=0)
    assert scan["kl"].min() == 0.0
    assert 0.3 < (scan["kl"] == 0.0).mean() < 0.7


NOISE = ts.Noise(white=0.001, wander=0.01, wander_s=1.0, offset=0.005, edge_mm=0.3, hum=0.002)


def test_a_source_goes_on_from_scan_to_scan_and_a_seed_returns_it() -> None:
    def run(seed: int, ahead: int) -> FloatArray:
        source = ts.SimulatedSource(SENSOR, lambda _: WIDE, 50.0, 40, NOISE, seed, ahead=ahead)
        return np.stack([raw.codes["kh"] for raw in source]) / 65535.0

    first = run(7, 64)
    np.testing.assert_array_equal(first, run(7, 64))
    assert (first != run(8, 64)).any()
    for k in (first, run(7, 1)):  # together or one by one: the same process, other draws
        step, long = (np.diff(k[::every], axis=0).std() for every in (1, 30))
        assert step < 0.5 * long


def test_the_network_has_the_same_soft_edges() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0)
    contact = ts.Contact.polygon([(2.0, 30.0), (38.0, 30.0), (38.0, 70.0), (2.0, 70.0)])
    noise = ts.Noise(edge_mm=1.0, blur_mm=0.5)
    closed, network = (ts.simulate(sensor, contact, noise, rng=4, model=m) for m in ("closed", "network"))
    np.testing.assert_allclose(closed["kh"], network["kh"], atol=1e-3)
    assert np.abs(closed["kh"] - ts.simulate(sensor, contact)["kh"]).max() > 2e-3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"white": -1.0}, "white = -1.0: must be 0 or more"),
        ({"wander": 2.0}, "wander = 2.0: a fraction of Vref, 0.01 for 1 %"),
        ({"wander_shared": 1.5}, "wander_shared = 1.5: a share of the variance, 0 to 1"),
        (
            {"wander_shared": 0.6, "wander_by_signature": 0.5},
            "wander_shared and wander_by_signature: together",
        ),
        ({"wander": 0.1, "wander_s": 0.0}, "wander_s = 0: a time constant must be above 0"),
        (
            {"wander": (0.1, 0.2), "wander_s": (1.0, 2.0, 3.0)},
            "wander has 2 processes and wander_s 3 time constants",
        ),
        ({"edge_mm": float("nan")}, "edge_mm = nan: must be 0 or more"),
    ],
)
def test_impossible_parts(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError) as caught:
        ts.Noise(**keys)
    assert str(caught.value).startswith(message)


def test_a_sheet_has_no_soft_edges() -> None:
    sheet = ts.Sensor(construction="crs-crp", strips=4, pitch_mm=5.0, length_mm=100.0, contact_lambda_mm=1.0)
    with pytest.raises(OptionError, match="edge_mm"):
        ts.simulate(sheet, ts.Contact.polygon([(2, 30), (18, 30), (18, 60)]), ts.Noise(edge_mm=1.0))

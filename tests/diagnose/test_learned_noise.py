"""The noise learned from a recording, against errors that `noise_generator` makes by other means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import tacstrip as ts
from noise_generator import Rubber
from polygons import many_fits
from tacstrip.diagnose import LearnedNoise, Log, learn_noise
from tacstrip.diagnose.allan import allan_deviation, processes, variogram
from tacstrip.errors import ReadingError

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
TRUTH = np.array([(14.0, 36.0), (62.0, 21.0), (83.0, 58.0), (40.0, 80.0)])
CONTACT = ts.Contact.polygon(TRUTH)


def learned(rubber: Rubber, seed: int = 0, seconds: float = 60.0, period_s: float = 0.25) -> LearnedNoise:
    """Return what a still press of some seconds tells."""
    random = np.random.default_rng(seed)
    return learn_noise(
        Log.of_scans(SENSOR, rubber.scans(random, SENSOR, CONTACT, int(seconds / period_s), period_s))
    )


def test_white_noise_is_that_and_nothing_else() -> None:
    found = [learned(Rubber(white=0.005), seed) for seed in range(4)]
    for one in found:
        assert one.noise.white == pytest.approx(0.005, rel=0.03)
        assert one.sure["white"] < 0.02
        assert one.noise.white_shared < 0.05
        assert one.noise.edge_mm < 0.05
        assert sum(s**2 for s, _ in one.noise.processes) < 0.3 * 0.005**2
        assert (one.noise.hum, one.noise.strays) == (0.0, 0.0)


def test_a_wander_is_told_from_white_noise_with_what_channels_share() -> None:
    rubber = Rubber(white=0.005, lorentz=0.004, lorentz_s=5.0, shared=0.4)
    found = [learned(rubber, seed, 240.0) for seed in range(4)]
    assert np.mean([one.noise.white for one in found]) == pytest.approx(0.005, rel=0.05)
    # What the strips' differences add, slower than the recording, is another matter.
    within = [[(s**2, t) for s, t in one.noise.processes if t < 200.0] for one in found]
    assert np.sqrt(np.mean([sum(v for v, _ in p) for p in within])) == pytest.approx(0.004, rel=0.25)
    assert np.mean([one.noise.wander_shared for one in found]) == pytest.approx(0.4, abs=0.15)
    assert np.mean([one.noise.wander_by_signature for one in found]) < 0.1
    times = [np.average([t for _, t in p], weights=[v for v, _ in p]) for p in within]
    assert 2.5 < np.median(times) < 12.0


def test_strays_and_hum_are_counted_and_do_not_pass_for_noise() -> None:
    rubber = Rubber(white=0.003, strays=0.004)
    random = np.random.default_rng(3)
    scans = rubber.scans(random, SENSOR, CONTACT, 6000, 0.0033)
    hum = [0.004 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 50.0 * scan.time_s + 0.3) for scan in scans]
    noisy = [ts.Scan(kh=s["kh"] + h, kl=s["kl"] + h, time_s=s.time_s) for s, h in zip(scans, hum, strict=True)
             if (s["kh"] + h)[s.touched].max() < 1.0 and (s["kl"] + h)[s.touched].min() > 0.0]  # fmt: skip
    found = learn_noise(Log.of_scans(SENSOR, noisy)).noise
    assert found.hum == pytest.approx(0.004, rel=0.1)
    assert found.hum_hz == 50.0
    assert found.strays == pytest.approx(0.004, rel=0.3)
    assert 0.1 < found.stray_size < 0.3
    assert found.white == pytest.approx(0.003, rel=0.1)


@pytest.mark.parametrize("scan", [0, 1, -2, -1])
def test_a_stray_in_the_first_or_last_scans_is_no_noise(scan: int) -> None:
    """As where the converter's first reading is of another line."""
    random = np.random.default_rng(928)
    log = Log.of_scans(SENSOR, Rubber(white=0.002).scans(random, SENSOR, CONTACT, 240, 0.25))
    raw = {name: values.copy() for name, values in log.raw.items()}
    raw["kh"][scan, 8] = 1.0
    found = learn_noise(replace(log, raw=raw)).noise
    assert found.white == pytest.approx(0.002, rel=0.05)
    assert sum(sigma**2 for sigma, _ in found.processes) < 0.3 * 0.002**2
    assert found.strays == pytest.approx(1.0 / np.isfinite(raw["kh"]).sum() / 2.0, rel=0.05)


@many_fits
def test_soft_edges_are_told_by_the_strips() -> None:
    found = [learned(Rubber(white=0.002, edge_mm=0.5), seed, period_s=1.0).noise for seed in range(5)]
    assert np.sqrt(np.mean([n.edge_mm**2 for n in found])) == pytest.approx(0.5, rel=0.4)
    assert all(2.0 < n.edge_correlation_mm < 16.0 for n in found)
    none = [learned(Rubber(white=0.002), seed, period_s=1.0).noise.edge_mm for seed in range(2)]
    assert max(none) < 0.15


@many_fits
def test_regions_with_the_noise_learned_hold_for_single_scans_and_for_means() -> None:
    """The fast version of studies/noise.py."""
    inside: dict[int, list[bool]] = {1: [], 64: []}
    for seed, rubber in enumerate(
        [Rubber(flicker=0.0011, strays=0.0003), Rubber(flicker=0.0011, edge_mm=0.5)] * 3
    ):
        noise = learned(rubber, seed, period_s=0.5).noise
        random = np.random.default_rng(100 + seed)
        for count, hits in inside.items():
            for _ in range(4):
                scan = ts.Scan.mean(rubber.scans(random, SENSOR, CONTACT, count, 0.5))
                found = ts.fit_polygon(scan, replace(SENSOR, noise=noise)).objects[0]
                if len(found.vertices) == 4:
                    assert found.covariance is not None
                    for i, off in enumerate(found.vertices - TRUTH):
                        own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
                        hits.append(bool(off @ np.linalg.solve(own, off) < 5.991))
    for hits in inside.values():
        assert len(hits) > 80
        assert 0.88 < np.mean(hits) <= 1.0


# What a recording cannot tell.


def test_a_recording_that_tells_too_little_says_so() -> None:
    few = Rubber().scans(np.random.default_rng(0), SENSOR, CONTACT, 20, 0.1)
    with pytest.raises(ReadingError, match="20 scans tell nothing of the noise: record a minute"):
        learn_noise(Log.of_scans(SENSOR, few))
    short = learned(Rubber(), seconds=12.0)
    assert any(text.startswith("a wander of 11.8 s or longer") for text in short.unidentifiable)
    assert any("common offset" in text for text in short.unidentifiable)
    assert any(text.startswith("hum: 4 scans a second") for text in short.unidentifiable)


def test_a_contact_that_moves_is_no_noise() -> None:
    scans = [
        ts.simulate(SENSOR, CONTACT.moved(0.0, 0.15 * i), ts.Noise(white=0.003), rng=i, time_s=0.5 * i)
        for i in range(120)
    ]
    with pytest.raises(ReadingError, match="moves, or creeps"):
        learn_noise(Log.of_scans(SENSOR, scans))
    still = [replace(s, time_s=0.0) for s in scans]
    with pytest.raises(ReadingError, match="time_s"):
        learn_noise(Log.of_scans(SENSOR, still))


@pytest.mark.parametrize(("dx", "turn"), [(0.0, 0.001), (0.03, 0.0), (0.0, 0.0005)])
def test_a_contact_that_creeps_slowly_is_no_wander(dx: float, turn: float) -> None:
    """By 7 or 3.5 degrees, or 3.6 mm across the strips, ever more slowly: half of the channels change little."""
    about = TRUTH.mean(axis=0)
    scans = []
    for i in range(120):
        far = 120.0 * np.log1p(i / 20.0) / np.log1p(6.0)
        cosine, sine = np.cos(turn * far), np.sin(turn * far)
        corners = (TRUTH - about) @ [[cosine, sine], [-sine, cosine]] + about + [dx * far, 0.0]
        contact = ts.Contact.polygon(corners)
        scans.append(ts.simulate(SENSOR, contact, ts.Noise(white=0.002), rng=i, time_s=0.5 * i))
    with pytest.raises(ReadingError, match=r"the contact creeps: [89]\d % of the slow change"):
        learn_noise(Log.of_scans(SENSOR, scans))


def test_untouched_strips_tell_the_converters_noise_only() -> None:
    sensor = replace(SENSOR, rest_volt=0.0, touch_volt=1.0, adc_bits=10)
    raw = np.abs(np.random.default_rng(0).normal(0.01, 0.002, (100, 20)))
    found = learn_noise(Log.of(sensor, np.arange(100.0), {"kh": raw, "kl": raw[::-1]}))
    assert not found.touched
    assert "nothing touches" in found.unidentifiable[0]
    assert found.noise.edge_mm == 0.0


@pytest.mark.parametrize(("strips", "sides"), [(5, 4), (6, 4), (7, 4), (7, 5), (9, 5), (8, 4)])
def test_the_misfit_of_a_wrong_shape_on_few_strips_is_no_noise(strips: int, sides: int) -> None:
    """Six strips under a quadrilateral tell a triangle only, whose misfit was a wander of 10 % of Vref once."""
    sensor = ts.Sensor(construction="crs-crs", strips=12, pitch_mm=8.0, length_mm=90.0)
    around = 2.0 * np.pi * np.arange(sides) / sides + 0.4
    shape = np.stack([np.cos(around), np.sin(around)], axis=1)
    wide = 4.0 * (strips - 0.5) / np.abs(shape[:, 0]).max()
    contact = ts.Contact.polygon(np.array([48.0, 45.0]) + shape * [wide, 26.0])
    noise = ts.Noise(positional=0.004)
    scans = [ts.simulate(sensor, contact, noise, rng=900 + i, time_s=0.5 * i) for i in range(140)]
    found = learn_noise(Log.of_scans(sensor, scans))
    assert found.noise.white == pytest.approx(0.004 / np.sqrt(3.0), rel=0.06)
    assert max((sigma for sigma, _ in found.noise.processes), default=0.0) < 0.003
    assert found.noise.edge_mm < 0.3


def test_a_shape_that_is_wrong_by_more_than_noise_is_said() -> None:
    scans = [ts.simulate(SENSOR, CONTACT, ts.Noise(white=0.003), rng=i, time_s=0.5 * i) for i in range(140)]
    found = learn_noise(Log.of_scans(SENSOR, scans), vertices=3)
    assert (found.noise.edge_mm, found.noise.processes) == (0.0, ())
    assert "static" not in found.sure
    assert any("too far for noise" in said for said in found.unidentifiable)


# Over time.


def test_the_allan_deviation_of_white_noise_falls_and_of_a_walk_rises() -> None:
    random = np.random.default_rng(0)
    values = random.normal(0.0, 1.0, (8192, 4))
    counts, white = allan_deviation(values)
    np.testing.assert_allclose(white[:8] * np.sqrt(counts[:8, None]), 1.0, rtol=0.15)
    walk = allan_deviation(np.cumsum(values, axis=0))[1]
    np.testing.assert_allclose(walk[4:8] / np.sqrt(counts[4:8, None] / 3.0), 1.0, rtol=0.25)
    values[random.uniform(size=values.shape) < 0.05] = np.nan
    np.testing.assert_allclose(allan_deviation(values)[1][:6], white[:6], rtol=0.1)


def test_a_variogram_and_its_processes_by_hand() -> None:
    lags_s = np.geomspace(0.1, 30.0, 25)
    own = 4.0 + 9.0 * (1.0 - np.exp(-lags_s / 2.0))
    variance, shared, time_s = processes(lags_s, own, 0.5 * own[:, None], 60.0)
    assert variance.sum() == pytest.approx(13.0, rel=0.05)
    assert variance[0] == pytest.approx(4.0, rel=0.1)
    assert shared.sum() == pytest.approx(6.5, rel=0.1)
    assert np.average(time_s[1:], weights=variance[1:]) == pytest.approx(2.0, rel=0.5)
    lags, half, together = variogram(np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0]]))
    assert (lags.tolist(), half.tolist(), together.tolist()) == ([1, 2], [0.5, 0.0], [[0.5, 0.5], [0.0, 0.0]])
    rows = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, -1.0], [0.0, 0.0, 0.0]])
    assert variogram(rows, ["k_h", "k_h", "k_l"])[2].tolist() == [[-0.5, 0.5]]


def test_a_wander_that_neighbours_share_is_said_and_is_no_error_of_the_ends() -> None:
    ideal = ts.simulate(SENSOR, CONTACT)
    random, keep = np.random.default_rng(1), np.exp(-0.25 / 60.0)
    new = gaussian_filter1d(random.normal(size=(2, 4240, 20)), 2.0, axis=2, mode="wrap")  # two strips
    new /= new.std()
    slow = np.zeros_like(new)
    for t in range(1, new.shape[1]):
        slow[:, t] = keep * slow[:, t - 1] + 0.004 * np.sqrt(1.0 - keep**2) * new[:, t]
    raw = {
        name: ideal[name] + slow[i, -240:] + 0.002 * random.normal(size=(240, 20))
        for i, name in enumerate(("kh", "kl"))
    }
    found = learn_noise(Log.of(SENSOR, 0.25 * np.arange(240.0), raw))
    assert found.noise.edge_mm == 0.0
    assert any("neighbouring strips share" in said for said in found.unidentifiable)
    own = learned(Rubber(white=0.005, lorentz=0.004, lorentz_s=60.0), 2)
    assert not any("neighbouring strips share" in said for said in own.unidentifiable)


def test_readings_that_are_no_volts_of_the_sensor_are_refused() -> None:
    raw = {name: np.full((140, 20), 0.5) for name in ("kh", "kl")}
    raw["kh"][3, 2] = 1e300
    with pytest.raises(ReadingError, match="v_h reads 1e\\+300 times vref_volt: these are no volts"):
        learn_noise(Log.of(SENSOR, 0.5 * np.arange(140.0), raw))


@pytest.mark.parametrize("seed", [0, 2])
def test_corners_of_a_mean_on_few_strips_are_no_errors_that_last(seed: int) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, adc_bits=10)
    contact = ts.Contact.polygon([(12, 22), (86, 34), (72, 78), (30, 70)])
    scans = [ts.simulate(sensor, contact, ts.Noise(white=0.0017), rng=1000 * seed + i) for i in range(300)]
    raw = {name: np.stack([scan[name] for scan in scans]) for name in ("kh", "kl")}
    learned = learn_noise(Log.of(sensor, np.arange(0.0, 60.0, 0.2), raw))
    assert not any("errors that do not change" in text for text in learned.unidentifiable)
    assert learned.noise.edge_mm < 0.05

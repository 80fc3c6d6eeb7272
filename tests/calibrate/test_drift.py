"""Touch detection learned from untouched strips; drift found again, at rest, under a reference, and while streaming."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.calibrate import DriftEstimator, rezero
from tacstrip.calibrate.touch import undetectable_mm
from tacstrip.sensor import Channel
from tacstrip.sensor.raw import apply_calibration, invert_calibration, touched

LEVEL = {"kh": np.array([0.05, 0.01, 0.02, 0.03]), "kl": np.array([0.04, 0.01, 0.02, 0.01])}
PLAIN = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.5, length_mm=325.0, vref_volt=5.0)
OFFSETS = tuple(Channel(signature=n, offset=tuple(v)) for n, v in LEVEL.items())
UNIT = replace(PLAIN, calibration=ts.Calibration(channels=OFFSETS))
SIGMA = 0.0005


def at_rest(scans: int, shift: float = 0.0, seed: int = 0) -> dict[str, FloatArray]:
    rng = np.random.default_rng(seed)
    return {n: np.clip(v + shift + rng.normal(0.0, SIGMA, (scans, 4)), 0.0, 1.0) for n, v in LEVEL.items()}


LEARNED = ts.learn_touch(UNIT, at_rest(400), source="when, from what")


def test_touch_is_learned_from_untouched_strips() -> None:
    calibration = LEARNED.calibration
    assert calibration is not None
    assert calibration.touch == "when, from what"
    np.testing.assert_allclose(calibration.channel("kh").rest[0], 0.05, atol=1e-4)
    np.testing.assert_allclose(calibration.channel("kl").noise, SIGMA, rtol=0.15)
    assert calibration.channel("kh").offset == tuple(LEVEL["kh"])
    assert LEARNED.touch_volt == pytest.approx(6.0 * SIGMA * 5.0, rel=0.2)
    assert not touched(LEARNED, at_rest(5000, seed=1)).any()
    pressed = {n: v.copy() for n, v in at_rest(50, seed=2).items()}
    pressed["kl"][:, 2] += 0.005
    np.testing.assert_array_equal(touched(LEARNED, pressed), np.tile([False, False, True, False], (50, 1)))


def test_where_a_point_contact_reads_as_rest() -> None:
    low, high = undetectable_mm(LEARNED)
    np.testing.assert_allclose(low, 0.0)  # rest is the offset: contacts at the ground look like none
    assert LEARNED.touch_volt is not None
    np.testing.assert_allclose(high, LEARNED.touch_volt / 5.0 * 325.0, atol=0.5)
    channels = (Channel(signature="kh", rest=(0.9,) * 4), Channel(signature="kl", rest=(0.1,) * 4))
    far = replace(LEARNED, calibration=ts.Calibration(channels=channels))
    assert np.isnan(undetectable_mm(far)).all()  # no reading is near both


def test_what_is_not_at_rest_is_refused() -> None:
    with pytest.raises(ts.ReadingError, match="strip 0 has 9 untouched readings of kh; at least 10"):
        ts.learn_touch(UNIT, at_rest(9))
    moving = at_rest(100)
    moving["kl"][:, 1] = np.linspace(0.0, 0.5, 100)
    with pytest.raises(ts.ReadingError, match="strip 1 is not at rest: its kl varies by 19 % of Vref"):
        ts.learn_touch(replace(UNIT, strip_base=0), moving)


def test_a_touch_in_passing_does_not_spoil_the_level() -> None:
    raw = at_rest(200)
    raw["kh"][50:60, 1] = 0.6
    calibration = ts.learn_touch(UNIT, raw).calibration
    assert calibration is not None
    np.testing.assert_allclose(calibration.channel("kh").rest[1], np.median(raw["kh"][:, 1]), atol=2e-4)


def test_rezero_finds_the_shift_of_untouched_strips() -> None:
    raw = at_rest(100, 0.01, seed=3)
    raw["kh"][:, 3], raw["kl"][:, 3] = 0.6, 0.5  # something lies on strip 3
    sensor, measured = rezero(LEARNED, raw, source="later")
    np.testing.assert_array_equal(measured, [True, True, True, False])
    assert sensor.calibration is not None
    assert sensor.calibration.zeroed == "later"
    np.testing.assert_allclose(sensor.calibration.channel("kh").drift, [0.01, 0.01, 0.01, 0.0], atol=3e-4)
    again, _ = rezero(sensor, raw, source="later")
    assert again == sensor  # the drift is since the calibration, not since the last time
    k = {n: np.full(4, 0.5) for n in LEVEL}
    for name, values in apply_calibration(sensor, {n: k[n] + LEVEL[n] + 0.01 for n in k}).items():
        np.testing.assert_allclose(values[:3], k[name][:3], atol=3e-4)


def test_rezero_by_a_reference_contact() -> None:
    places = np.full(4, 100.0)
    raw = invert_calibration(UNIT, ts.signatures(PLAIN, places, places + 50.0))
    shifted = {n: np.tile(v - 0.02, (20, 1)) for n, v in raw.items()}
    sensor, measured = rezero(UNIT, shifted, source="bar", reference=(100.0, 50.0))
    assert measured.all()
    assert sensor.calibration is not None
    for channel in sensor.calibration.channels:
        np.testing.assert_allclose(channel.drift, -0.02, atol=1e-12)


def test_what_cannot_be_rezeroed() -> None:
    with pytest.raises(ts.OptionError, match="no calibration to re-zero"):
        rezero(PLAIN, at_rest(20))
    with pytest.raises(
        ts.OptionError, match="does not know the untouched strips' level: learn it with --touch"
    ):
        rezero(UNIT, at_rest(20))
    with pytest.raises(ts.OptionError, match="--reference 300 50 is not on strips of 325 mm"):
        rezero(UNIT, at_rest(20), source="", reference=(300.0, 50.0))
    with pytest.raises(ts.ReadingError, match="no strip is untouched"):
        rezero(LEARNED, at_rest(20, 0.3))


def test_the_stream_follows_a_drift_and_no_touch() -> None:
    """0.6 % of Vref in 10 minutes, and strip 1 pressed in the middle: the drift lags by rate times time constant."""
    estimator = DriftEstimator(LEARNED, time_constant_s=10.0)
    rng = np.random.default_rng(4)
    for i in range(6000):
        time_s = 0.1 * i
        raw = {n: v + 1e-5 * time_s + rng.normal(0.0, SIGMA, 4) for n, v in LEVEL.items()}
        if 200.0 < time_s < 260.0:
            for values in raw.values():
                values[1] = 0.4
        estimator.update(raw, time_s)
    for drift in estimator.drift.values():
        np.testing.assert_allclose(drift, 0.006 - 1e-4, atol=2e-4)
    sensor = estimator.zeroed("stream")
    assert sensor.calibration is not None
    assert sensor.calibration.zeroed == "stream, 6000 scans"
    assert sensor.calibration.channel("kh").drift == tuple(estimator.drift["kh"])
    assert not touched(sensor, at_rest(100, 0.006)).any()


def test_the_stream_goes_on_from_an_earlier_drift() -> None:
    sensor, _ = rezero(LEARNED, at_rest(100, 0.01), source="before")
    estimator = DriftEstimator(sensor, settle_s=0.0)
    for i in range(100):
        estimator.update({n: v + 0.01 for n, v in LEVEL.items()}, 0.1 * i)
    np.testing.assert_allclose(estimator.drift["kh"], 0.01, atol=2e-4)


def test_an_estimator_needs_a_level_and_a_time() -> None:
    with pytest.raises(ts.OptionError, match="learn it with --touch"):
        DriftEstimator(UNIT)
    with pytest.raises(ts.OptionError, match="time_constant_s must be above 0"):
        DriftEstimator(LEARNED, time_constant_s=0.0)


def noisy_rest(seed: int, scans: int, level: float, shift: FloatArray | float = 0.0) -> dict[str, FloatArray]:
    """Return a rest as real rubber and a 10-bit converter read it: wander, neighbours alike, strays, cut off at 0."""
    rng = np.random.default_rng(seed)
    shape = (scans, UNIT.strips)
    error = rng.normal(0.0, 0.006, shape) + np.cumsum(rng.normal(0.0, 2e-4, shape), axis=0)
    error += 0.2 * np.roll(error, 1, axis=1)
    error[rng.random(shape) < 0.002] += 0.15
    read = np.clip(np.round((level + shift + error) * 1023.0) / 1023.0, 0.0, 1.0)
    return dict.fromkeys(UNIT.signatures, read)


def test_strays_and_a_rail_do_not_move_the_touch_level() -> None:
    for level in (0.0, 0.1):
        learned = ts.learn_touch(UNIT, noisy_rest(3, 600, level))
        assert learned.touch_volt is not None
        assert 5.0 * 0.006 < learned.touch_volt / UNIT.vref_volt < 10.0 * 0.006
        assert learned.calibration is not None
        assert all(0.004 < s < 0.012 for s in learned.calibration.channel("kh").noise)


def test_drift_since_the_calibration_is_known_within_two_seconds() -> None:
    learned = ts.learn_touch(UNIT, noisy_rest(4, 600, 0.1))
    shift = np.linspace(-0.012, 0.012, UNIT.strips)
    estimator = DriftEstimator(learned)
    readings = noisy_rest(5, 60, 0.1, shift)
    for i in range(60):
        estimator.update({n: v[i] for n, v in readings.items()}, 0.05 * i)
    np.testing.assert_allclose(estimator.drift["kh"], shift, atol=6e-3)


def test_a_held_press_is_not_zeroed_away() -> None:
    estimator = DriftEstimator(LEARNED)
    raw = at_rest(200)
    for i in range(200):
        estimator.update({n: v[i] for n, v in raw.items()}, 0.05 * i)
    before = estimator.drift["kh"]
    for i in range(3000):
        held = {
            n: v[i % 200] + np.array([0.4 + 1e-5 * i] + [0.0] * (UNIT.strips - 1)) for n, v in raw.items()
        }
        estimator.update(held, 10.0 + 0.05 * i)
    assert estimator.drift["kh"][0] == before[0]

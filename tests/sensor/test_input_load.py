"""What converter inputs that draw current take from k_h and k_l, against the contact's network solved node by node."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import k_h, k_l
from tacstrip.sensor.input_load import lost_to_load, without_load


def network(l: float, w: float, ratio: float, load: float) -> FloatArray:
    """Return k_h and k_l, from the conductances between the contact's two ends and the two lines."""
    low, high, low_line, high_line = range(4)
    above, matrix, right = 1.0 - l - w, np.zeros((4, 4)), np.zeros(4)
    for a, b, ohm in (
        (low, high, ratio / (1.0 + ratio) * w),
        (low, low_line, ratio * l),
        (high, high_line, ratio * above),
    ):
        matrix[[a, b, a, b], [a, b, b, a]] += np.array([1.0, 1.0, -1.0, -1.0]) / ohm
    ground = np.array([1.0 / l, 1.0 / above, load, load])  # the second to Vref
    right[high] = 1.0 / above
    return np.asarray(np.linalg.solve(matrix + np.diag(ground), right)[[high_line, low_line]], float)


@pytest.mark.parametrize("ratio", [0.01, 0.5, 1.0, 2.0, 100.0])
def test_the_loss_is_that_of_the_network(ratio: float) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        l, w = random.uniform(0.05, 0.5), random.uniform(0.01, 0.4)
        ideal = np.array([k(np.array(l), np.array(w), 1.0, ratio) for k in (k_h, k_l)])
        read = network(l, w, ratio, 0.01)
        lost = np.array(lost_to_load(np.array(l), np.array(w), ratio, 0.01))
        assert lost == pytest.approx(ideal - read, abs=1e-12)
        assert np.array(without_load(read[0], read[1], ratio, 0.01)) == pytest.approx(ideal, abs=1e-12)


@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
def test_noise_of_contacts_without_length_stays_as_it_is(ratio: float) -> None:
    at = np.linspace(0.05, 0.95, 19)
    read = [at - lost for lost in lost_to_load(at, np.zeros(19), ratio, 0.002)]
    noisy = np.array(without_load(read[0] - 0.001, read[1] + 0.001, ratio, 0.002))
    assert np.abs(noisy[1] - noisy[0]).max() < 0.002 * 1.5
    assert np.abs(noisy - at).max() < 0.001 * 1.5


def test_a_contacts_own_resistance_carries_both_currents() -> None:
    """k_h and k_l of a point lose the same, the drop times what is left of both."""
    l, drop = np.array(0.3), 0.02
    high, low = (0.3 - lost for lost in lost_to_load(l, np.array(0.0), 1.0, 0.0, drop))
    assert 0.3 - high == pytest.approx(drop * (high + low))
    assert high == pytest.approx(low)


def test_a_spec_keeps_the_load_and_corrects_by_it() -> None:
    unit = ts.Calibration(load=0.004)
    sensor = ts.Sensor(construction="crs-crs", strips=2, pitch_mm=5.0, length_mm=100.0, calibration=unit)
    assert "load = 0.004" in sensor.to_toml()
    kh, kl = np.array([0.4, 0.7]), np.array([0.3, 0.5])
    raw = unit.distort_pair(kh, kl, 1.0)
    assert all((r < k - 2e-4).all() for r, k in zip(raw, (kh, kl), strict=True))
    assert np.array(unit.correct_pair(*raw, 1.0)) == pytest.approx(np.array([kh, kl]), abs=1e-9)


def test_loads_that_cannot_be() -> None:
    with pytest.raises(ts.SpecError, match=r"load: must be 0 to 0\.05"):
        ts.Calibration(load=0.2)
    with pytest.raises(ts.SpecError, match="only k_h and k_l together"):
        ts.Sensor(
            construction="crs-m",
            strips=2,
            pitch_mm=5.0,
            length_mm=100.0,
            calibration=ts.Calibration(load=0.01),
        )

"""Where little is read, one strip is not told from others."""

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.diagnose import Log, diagnose
from tacstrip.diagnose.hum import _mains_lines
from tacstrip.diagnose.noise import _POWERS, _deviations, _one_noise


@pytest.mark.parametrize(("scans", "told"), [(20, False), (400, True)])
def test_noise_of_few_scans_is_not_known_to_be_white(scans: int, told: bool) -> None:
    values = np.random.default_rng(4).normal(size=(scans, 3))
    values[:, 2] = np.nan  # a channel that is left out says nothing against the strip's other one
    since = np.zeros((scans, 3), int)
    each = {order: _deviations(values, since, order, power) for order, power in _POWERS.items()}
    assert _one_noise(each, np.isfinite(values)).tolist() == [told, told, True]


@pytest.mark.parametrize("known", [1, 2, 3])
def test_a_line_stands_out_among_other_strips_only(known: int) -> None:
    """Of 30 times the power near it, on strip 0; jumps of a sound contact's ends make as much."""
    count = np.tile(np.where(np.arange(6) < known, 400.0, 0.0), (4, 1))
    power = np.stack([1e-4 * count, 1e-4 * count])  # on the line, near it; segments, strips
    power[0, :, 0] *= 30.0
    found = list(_mains_lines([power, power * 0.0], [count, count * 0.0], 0.002, True))
    assert [f.strips for f in found] == [(0,)] * (known > 2)


def test_a_reading_far_beyond_vref_is_asked_about_and_leaves_the_rest_examined() -> None:
    """Of twelve scans with hardly any motion: in double precision nothing else counts beside it."""
    sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
    contact = ts.Contact.polygon([(6.0, 28.0), (32.0, 30.0), (34.0, 52.0), (12.0, 60.0)])
    scans = [ts.simulate(sensor, contact.moved(0.05 * t, 0.3 * t)) for t in range(12)]
    raw = {
        name: np.round(np.stack([scan[name] for scan in scans]) * 4095.0) / 4095.0 for name in ("kh", "kl")
    }
    raw["kh"][5, 1] = 2e5
    report = diagnose(Log.of(sensor, np.linspace(0.0, 0.11, 12), raw))
    assert [(q.strips, q.causes) for q in report.questions] == [((1,), ("wrong-vref",))]

"""Where little is read, one strip is not told from others."""

import numpy as np
import pytest

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

"""A contact that moves during a scan."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from studies.motion import skewed

CRS = ts.Sensor(
    construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=325.0, adc_bits=12, resistivity_ratio=0.4
)
BLOCK = ts.Contact.polygon([(0, 120), (65, 120), (65, 200), (0, 200)])


def test_a_moving_contact_is_sheared() -> None:
    l, u = skewed(CRS, BLOCK, (0.0, 1000.0), scan_s=0.01)
    np.testing.assert_allclose(l, 120.0 + np.arange(10.0), atol=1e-9)
    np.testing.assert_allclose(u - l, 80.0, atol=1e-9)
    still = skewed(CRS, BLOCK, (0.0, 0.0), 0.01)
    np.testing.assert_array_equal(still, np.stack(list(ts.footprint(CRS, BLOCK))))
    with pytest.raises(ts.ContactError, match="lies outside the sensor"):
        skewed(CRS, BLOCK, (0.0, 1e6), 0.01)

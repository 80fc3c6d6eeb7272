"""CRS-CRP against a sheet of nine columns a pitch, laid out with SciPy alone: its errors are as large as it says."""

from __future__ import annotations

import numpy as np

from studies.crp_sheet import STRIPS, L, a_sensor, fine_sheet, spans, wide_ends
from tacstrip.network.crp import inversion as crp


def test_clean_readings_of_a_finer_sheet() -> None:
    """A mesh of one column a pitch is off by .16 % of L in the median (own), and by .27 (all electrodes)."""
    sensor, each = a_sensor(2.0), np.arange(STRIPS)
    ((l, u),) = spans(sensor, 1, seed=11)
    k = fine_sheet(2.0, l, u, 300)
    own, every = crp.invert(sensor, k[each, STRIPS + each], k[each, each]), crp.invert_all(sensor, k)
    for found in (own, every):
        error = np.abs(np.r_[found.l - l, found.u - u][wide_ends(l, u)]) / L
        assert np.median(error) < 2e-4
        assert error.max() < 1e-3

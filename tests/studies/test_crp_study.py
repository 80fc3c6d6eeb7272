"""The studies of CRS-CRP: the error map, a strip's bounds, the sheet's potentials, and their pictures."""

from __future__ import annotations

import numpy as np
import pytest

from studies import crp_spans
from studies.crp import (
    FIGURES,
    SHAPES,
    SIGMA,
    a_sensor,
    end_bounds,
    error_map,
    sheet_potentials,
)
from tacstrip.contact.footprint import footprint


def test_the_map_is_its_own_mirror_image() -> None:
    """The sensor has two mirrors: one swaps l and u, the other swaps strips."""
    small = a_sensor(strips=6)
    found = error_map("own", small, wide=4, places=5, rows=25)
    assert found.l.shape == found.u.shape == (6, 5)
    np.testing.assert_allclose(found.y_percent, [10, 30, 50, 70, 90])
    np.testing.assert_allclose(found.l, found.u[:, ::-1], rtol=1e-6)
    np.testing.assert_allclose(found.l, found.l[::-1], rtol=1e-6)


def test_a_map_of_one_position_is_that_contact_s_bound() -> None:
    small = a_sensor(strips=4)
    found = error_map("all", small, wide=4, long_percent=30.0, places=3, rows=25)
    l, u = np.full(4, 35.0), np.full(4, 65.0)
    covariance = crp_spans.covariance(small, l, u, SIGMA, "all", 25)
    np.testing.assert_allclose(np.r_[found.l[:, 1], found.u[:, 1]], np.sqrt(np.diag(covariance)), rtol=1e-9)


def test_all_electrodes_know_every_end_better_and_the_middle_worst() -> None:
    own, every = (error_map(e, places=5, rows=25) for e in ("own", "all"))
    for end in ("l", "u"):
        assert np.all(getattr(every, end) < getattr(own, end))
    assert own.l[:, 2].min() > own.l[:, 0].max()
    assert own.l[10, 2] > own.l[1, 2]


def test_bounds_are_nan_beside_the_contact() -> None:
    sensor = a_sensor()
    l, u = footprint(sensor, SHAPES["triangle"])
    bound = end_bounds(sensor, l, u, "own", 25)
    np.testing.assert_array_equal(np.isnan(bound), np.isnan([l, u]))
    assert np.nanmin(bound) > 0.0


def test_the_sheet_ends_in_what_the_electrodes_read() -> None:
    sensor = a_sensor()
    l, u = footprint(sensor, SHAPES["hexagon"])
    kh, kl = crp_spans.own_electrodes(sensor, l, u)
    sheet = sheet_potentials(7, l, u)
    assert (sheet[7, 0], sheet[7, -1]) == pytest.approx((kl[7], kh[7]), rel=1e-12)
    # A current flows through the sheet from the contact's upper end to its lower one, and nowhere else in or out.
    assert np.ptp(sheet[7]) > 2.0 * np.ptp(sheet[0])


@pytest.mark.parametrize("name", ["crp_strip_bounds", "crp_sheet"])
def test_a_picture_shows_what_its_study_found(name: str) -> None:
    sensor = a_sensor()
    l, u = footprint(sensor, SHAPES["hexagon"])
    axes = FIGURES[name]().axes
    lines = [line for ax in axes for line in ax.get_lines()]
    if name == "crp_strip_bounds":
        expected = end_bounds(sensor, l, u, "own")[0]
        label = "l, own electrodes"
    else:
        expected = sheet_potentials(7, l, u)[7]
        label = f"all strips: k_h = {expected[-1]:.3f}"
    (line,) = [line for line in lines if line.get_label() == label]
    np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=float), expected)

"""Pictures of a calibration's report: legends beside the points, graphs that do not exaggerate, and which there are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_unit import CRS, grids, runs_of

import tacstrip as ts
from drawn import check_above
from tacstrip.calibrate.unit import Calibrated
from tacstrip.plot.calibration import (
    along_figure,
    calibration_graphs,
    graphed,
    left_figure,
)
from tacstrip.report.calibration import write_report

PLACES = [(10.0, 0.0), (310.0, 0.0), (150.0, 50.0), (10.0, 100.0), (70.0, 100.0), (200.0, 100.0)]


@pytest.fixture(scope="module")
def unit() -> Calibrated:
    sensor = replace(CRS, strips=24)
    l, w = grids(sensor, PLACES)
    raw = {name: k + 0.02 for name, k in ts.signatures(sensor, l, l + w).items()}
    raw["kh"][2, 20] += 0.004  # what is left is largest here
    return ts.calibrate_unit(sensor, runs_of(sensor, PLACES, raw, 0.0005), "offset")


def test_legends_lie_above_the_points(unit: Calibrated) -> None:
    for figure in (left_figure(unit), along_figure(unit)):
        for axes in figure.axes:
            check_above(figure, axes)
    figure = calibration_graphs(unit, 0)
    check_above(figure, figure.axes[0])


def test_a_single_point_is_not_blown_up(unit: Calibrated) -> None:
    for axes in calibration_graphs(unit, 0).axes:
        assert np.ptp(axes.get_ylim()) >= 0.2 * CRS.vref_volt - 1e-9
        assert np.ptp(axes.get_xlim()) >= CRS.length_mm


def test_the_report_says_which_strips_have_graphs(unit: Calibrated, tmp_path: Path) -> None:
    assert len(graphed(unit)) == 12
    assert 20 in graphed(unit)
    page = write_report(unit, tmp_path).read_text(encoding="utf-8")
    assert "Calibration graphs of 12 of the 24 strips: those with the largest residuals." in page
    assert "Calibration graphs of strip 20" in page

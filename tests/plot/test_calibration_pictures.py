"""Pictures of a calibration's report: legends beside the points, graphs that do not exaggerate, and which there are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from drawn import check_above
from tacstrip.calibrate.unit import Calibrated
from tacstrip.contact.signature import signatures
from tacstrip.io.runs import Runs
from tacstrip.plot.calibrations import (
    calibration_graphs,
    graphed_strips,
    residuals_along_strips,
    residuals_by_strip,
)
from tacstrip.report.calibration import write_report

CRS = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=6.5, length_mm=325.0, vref_volt=6.05)
PLACES = [(10.0, 0.0), (310.0, 0.0), (150.0, 50.0), (10.0, 100.0), (70.0, 100.0), (200.0, 100.0)]


@pytest.fixture(scope="module")
def unit() -> Calibrated:
    l, w = np.repeat(np.array(PLACES).T[:, :, None], CRS.strips, axis=2)  # (places, strips)
    raw = {name: k + 0.02 for name, k in signatures(CRS, l, l + w).items()}
    raw["kh"][2, 20] += 0.004  # the largest residual is here
    random = np.random.default_rng(1)
    read = {name: np.clip(k + random.uniform(-0.0005, 0.0005, k.shape), 0.0, 1.0) for name, k in raw.items()}
    runs = Runs(l, w, read, np.arange(l.size).reshape(l.shape) + 2, {})
    return ts.calibrate_unit(CRS, runs, model="offset")


def test_legends_lie_above_the_points(unit: Calibrated) -> None:
    for figure in (residuals_by_strip(unit), residuals_along_strips(unit)):
        for axes in figure.axes:
            check_above(figure, axes)
    figure = calibration_graphs(unit, 0)
    check_above(figure, figure.axes[0])


def test_a_single_point_is_not_blown_up(unit: Calibrated) -> None:
    for axes in calibration_graphs(unit, 0).axes:
        assert np.ptp(axes.get_ylim()) >= 0.2 * CRS.vref_volt - 1e-9
        assert np.ptp(axes.get_xlim()) >= CRS.length_mm


def test_the_report_says_which_strips_have_graphs(
    unit: Calibrated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(graphed_strips(unit)) == 12
    assert 20 in graphed_strips(unit)
    monkeypatch.setattr("tacstrip.plot.calibrations._MOST_STRIPS", 2)
    first, second = graphed_strips(unit)
    page = write_report(unit, tmp_path).read_text(encoding="utf-8")
    assert "Calibration graphs of 2 of the 24 strips: those with the largest residuals." in page
    assert f"Calibration graphs of strip {first}" in page
    assert f"Calibration graphs of strip {second}" in page

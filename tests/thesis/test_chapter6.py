"""Chapter 6 again: the twins' tables, figures 6.1-6.35, and claims that can be refuted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.calibrate.offsets import mean_offsets
from tacstrip.data.published import Experiment, experiments, published
from tacstrip.thesis.captions import caption
from tacstrip.thesis.chapter6 import figures
from tacstrip.thesis.chapter6.tables import (
    MEASURES,
    VARIANTS,
    Variant,
    applies,
    at_nominal,
    calibration_runs,
    prototype_rows,
    recovered_points,
    residual_rows,
    run_experiment,
    widths_mm,
)
from tacstrip.thesis.chapter6.twin import PLACINGS, twin

BY_FIGURE = {e.figure: e for e in experiments()}
NUMBER = {e.figure: i for i, e in enumerate(experiments())}
Made = tuple[Path, dict[str, Any]]


def test_experiments_are_the_printed_ones() -> None:
    assert len(experiments()) == 16
    assert {e.table for e in experiments()} == {"6.2", "6.3", "6.4", "6.6"}
    assert BY_FIGURE["6.5"].printed == {"mc": 0.692, "aoe": 0.385, "ape": 1.545}
    assert not BY_FIGURE["6.30"].calibrated
    assert BY_FIGURE["6.21"].signature is None


@pytest.mark.parametrize("figure", [e.figure for e in experiments() if e.sensor == "CRS-CRS"])
def test_without_errors_and_with_true_transitions_the_rectangle_comes_back(figure: str) -> None:
    e = BY_FIGURE[figure]
    if e.algorithm == "vertex":
        contact, _, vertices = at_nominal(e, Variant(errors="none", method="section"))
        assert ts.mismatch(contact.vertices, vertices).hausdorff < 1e-6
    else:  # at the nearest strips, which are not where the corners are
        contact, _, vertices = at_nominal(e, Variant(errors="none"))
        m = ts.mismatch(contact.vertices, vertices)
        assert m.ape < 1.0
        assert m.aoe < 0.03


def test_variants_change_one_thing_at_a_time() -> None:
    kh, profile, raw, metal = (BY_FIGURE[f] for f in ("6.5", "6.17", "6.6", "6.27"))

    def names(e: Experiment) -> set[str]:
        return {n for n, v in VARIANTS.items() if applies(v, e)}

    assert names(metal) == set(VARIANTS)
    assert set(VARIANTS) - names(kh) == {"overhanging", "overhanging, found transitions"}
    assert "found transitions" not in names(profile)
    assert names(raw) == {"true transitions", "found transitions", "polygon"}


def test_a_row_that_was_not_calibrated_is_the_other_rows_variant() -> None:
    ours, other = (run_experiment(NUMBER[f], 3) for f in ("6.6", "6.5"))
    for measure in MEASURES:
        assert ours[measure] == other["variants"]["not calibrated"][measure]


def test_rows_repeat_and_places_differ() -> None:
    number = NUMBER["6.13"]
    ours = run_experiment(number, 4)
    assert ours == run_experiment(number, 4)
    assert ours["ape"]["p05"] < ours["ape"]["median"] < ours["ape"]["p95"]
    assert sum(ours["worst_vertex"]) == pytest.approx(1.0 - ours["failed"])
    one = run_experiment(number, 1)
    assert one["ape"]["p05"] == one["ape"]["p95"]
    assert one["ape"]["p05"] != one["nominal"]["ape"]


def test_inside_is_judged_on_the_range() -> None:
    e, ours = BY_FIGURE["6.13"], run_experiment(NUMBER["6.13"], 5)
    for measure, printed in MEASURES.items():
        low, high = ours[measure]["p05"], ours[measure]["p95"]
        assert ours["inside"][measure] == (low - 0.0005 <= e.printed[printed] <= high + 0.0005)
    assert set(ours["inside"].values()) == {True, False}  # both happen here


def test_calibration_runs_are_the_thesis() -> None:
    runs = calibration_runs(twin("CRS-CRS"), np.random.default_rng(0))
    marks = {w: runs.l_mm[runs.w_mm[:, 0] == w, 0].tolist() for w in (0.0, 50.0, 100.0)}
    assert marks == {w: [10.0 * i for i in range(1, n + 1)] for w, n in ((0.0, 32), (50.0, 27), (100.0, 22))}
    assert widths_mm(twin("Cyl-CRS-M")) == (0.0,)


@pytest.mark.parametrize("name", ["CRS-CRS", "CRS-M", "Cyl-CRS-M"])
def test_small_offsets_come_back_from_the_runs_and_large_ones_meet_vref(name: str) -> None:
    sensor = twin(name)
    assert sensor.calibration is not None
    fits = [
        mean_offsets(
            ts.Sensor.load(f"prototype-{name.lower()}"), calibration_runs(sensor, np.random.default_rng(seed))
        )
        for seed in range(20)
    ]
    for signature in sensor.signatures:
        true = np.array(sensor.calibration.channel(signature).offset)
        found = np.mean([fit.channel(signature).offset for fit in fits], axis=0)
        small = true < 0.02
        np.testing.assert_allclose(found[small], true[small], atol=0.001)
        np.testing.assert_allclose(found, true, atol=0.003)
        if signature == "kh":
            assert np.all(found[~small] < true[~small])


def test_printed_residuals_come_out_of_the_twins() -> None:
    for printed, ours in zip(published()["residual"], residual_rows(), strict=True):
        np.testing.assert_allclose(ours["percent_of_vref"], printed["percent_of_vref"], atol=1e-9)
        assert all(v in (True, None) for v in ours["inside"])


def test_prototypes_agree_with_print() -> None:
    for printed, ours in zip(published()["prototype"], prototype_rows(), strict=True):
        for key, value in ours.items():
            if key in printed:
                assert value == pytest.approx(printed[key], abs=0.05)


def test_points_on_the_tube_are_off_by_the_printed_errors() -> None:
    true, raw, good = recovered_points()
    np.testing.assert_allclose(good - true, [[-0.5, -0.9], [-0.4, -0.6], [-0.3, 0.4], [0.3, -0.4]], atol=1e-9)
    assert np.abs(raw - true).max() > 5.0


def test_every_figure_of_chapter_6_is_drawn() -> None:
    drawn = figures.FIGURES
    assert set(drawn) == {f"6.{n}" for n in range(1, 36)}
    assert all(len(caption(draw)) > 20 for draw in drawn.values())


@pytest.mark.parametrize("figure", ["6.5", "6.17", "6.22", "6.29", "6.10"])
def test_a_recovery_shows_what_the_table_measures(figure: str) -> None:
    e = figures.RECOVERIES[figure]
    contact, _, vertices = at_nominal(e, Variant(raw=not e.calibrated))
    drawing = figures.recovery(figure)
    shapes, readings = drawing.axes[0], drawing.axes[-1]
    lines = {str(line.get_label()): np.asarray(line.get_xydata()) for line in shapes.lines}
    (label,) = [n for n in lines if n.startswith(("V.R.", "P.R., at"))]
    np.testing.assert_allclose(lines[label][:-1], vertices)
    np.testing.assert_allclose(lines["original"][:-1], contact.vertices)
    assert f"{ts.mismatch(contact.vertices, vertices).aoe:.3f}" in label
    assert any("polygon fit" in n for n in lines)
    assert any("in print" in n for n in lines) == bool(e.printed)
    assert readings.get_xlabel() == "x [mm]"
    assert len(drawing.axes) == 1 + len(PLACINGS[e.sensor])


def test_a_noisy_signature_is_raw_beside_calibrated() -> None:
    axes = figures.noisy("6.12").axes[0]
    y = {str(line.get_label()): np.asarray(line.get_ydata()) for line in axes.lines}
    offsets = next(c["offset_volt"] for c in published()["calibration"] if c["signature"] == "kl")
    np.testing.assert_allclose(y["as read"] - y["calibrated"], np.array(offsets) / 6.05, atol=1e-12)
    assert np.abs(y["calibrated"] - y["without errors"]).max() == pytest.approx(0.012)


def test_a_calibration_graph_shows_the_printed_offset_and_vref() -> None:
    axes = figures.FIGURES["6.2"]().axes[0]
    lines = {str(line.get_label()): line for line in axes.lines}
    l, volt = np.asarray(lines["expected"].get_xydata()).T
    np.testing.assert_allclose(volt, 6.05 * l / 32.5, atol=1e-9)
    assert np.asarray(lines["twin"].get_ydata()).max() == pytest.approx(6.05)
    np.testing.assert_allclose(np.asarray(lines["+ 0.345 V"].get_ydata()) - volt, 0.345)


def test_the_tubes_points_lie_on_its_surface() -> None:
    figure = figures.FIGURES["6.35"]()
    space: Any = figure.axes[0]
    for line in space.lines:
        x, y, _ = line.get_data_3d()
        np.testing.assert_allclose(np.hypot(x, y), 9.0)
    assert len(space.lines) == 3 * 4

"""Rounded outlines from one signature: told apart from polygons, in their place where they explain the readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.binding import exported
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.polygon.run import fit_run
from tacstrip.reconstruction.posterior.assessment import ENOUGH_OF_ONE, doubts
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline
from tacstrip.reconstruction.posterior.rounded import _library, draw_rounded

SENSOR = ts.Sensor(construction="crs-m", strips=40, pitch_mm=2.5, length_mm=100.0)
NOISE = ts.Noise(positional=0.002)
_T = 2.0 * np.pi * np.arange(120) / 120
_CAP = np.stack(
    [r * np.sign(f(_T)) * np.abs(f(_T)) ** (2.0 / 2.6) for r, f in ((30.0, np.cos), (22.0, np.sin))]
)
CAP = _CAP.T @ np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]]) + [50.0, 48.0]
SCAN = ts.simulate(SENSOR, ts.Contact.polygon(CAP), NOISE, rng=0)
needs_core = pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")


def test_outlines_of_the_families_are_convex_and_fill_a_unit_box() -> None:
    _, _, chains = _library(2000)
    np.testing.assert_allclose(chains.min(axis=1), np.tile([0.0, -0.5], (len(chains), 1)), atol=1e-12)
    np.testing.assert_allclose(chains.max(axis=1), np.tile([1.0, 0.5], (len(chains), 1)), atol=1e-12)
    half = chains.shape[1] // 2
    ring = np.concatenate([chains[:, :half], chains[:, : half - 1 : -1]], axis=1)
    step = np.roll(ring, -1, axis=1) - ring
    after = np.roll(step, -1, axis=1)
    turn = step[..., 0] * after[..., 1] - step[..., 1] * after[..., 0]
    assert turn.min() > -1e-5


@needs_core
def test_a_rounded_square_of_one_signature_is_recovered() -> None:
    """Its best polygon has the same readings, 8 corners and less than half of its area."""
    found = ts.fit_polygon(SCAN, SENSOR, NOISE).objects[0]
    assert found.model is FamilyOutline
    assert found.status == "ok"
    assert found.confidence is not None
    assert ts.mismatch(CAP, found.vertices).iou > 0.8
    assert found.covariance is not None
    assert "looks rounded" in found.advice
    assert found.confidence + sum(a.weight for a in found.alternatives) < 1.0 + 1e-9


@needs_core
@pytest.mark.parametrize(("signature", "rng"), [("kl", 1), ("kh", 2), ("kl", 3)])
def test_a_stadium_is_ok_as_a_rounded_outline_or_a_regular_one(signature: str, rng: int) -> None:
    stadium = np.array(shapely.LineString([(30, 40), (70, 55)]).buffer(18, quad_segs=24).exterior.coords)[:-1]
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon(stadium), NOISE, rng=rng)
    one = ts.Scan(kh=scan.kh) if signature == "kh" else ts.Scan(kl=scan.kl)
    found = ts.fit_polygon(one, sensor, NOISE).objects[0]
    assert found.model is FamilyOutline
    assert found.status == "ok"
    assert ts.mismatch(stadium, found.vertices).iou > 0.9
    assert found.confidence is not None
    assert found.confidence >= ENOUGH_OF_ONE["thorough"]


@needs_core
def test_a_count_of_vertices_that_is_given_keeps_its_outline_and_that_outlines_confidence() -> None:
    found = ts.fit_polygon(SCAN, SENSOR, NOISE, vertices=6).objects[0]
    assert len(found.vertices) == 6
    assert ts.mismatch(CAP, found.vertices).iou < 0.8
    assert found.status == "doubtful"
    assert found.confidence is None or found.confidence < 0.5


@pytest.mark.parametrize("quick", [False, True])
def test_polygons_leave_rounded_outlines_far_behind(quick: bool) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon([(15, 20), (85, 45), (40, 80)]), NOISE, rng=5)
    touched = scan.touched
    problem = FitProblem.of(sensor, sensor.x_mm[touched], {"kh": scan["kh"][touched]}, 0.002 / np.sqrt(3.0))
    half, x = 0.5 * problem.pitch, np.linspace(0.0, 1.0, 30)
    box = np.stack([np.full(30, 0.3), np.full(30, 0.6)])
    window = (-half, half, 1.0 - half, 1.0 + half)
    assert draw_rounded(problem, window, x, box, quick=quick).misfit > 3.0


def test_a_quick_assessment_heeds_rounded_outlines_that_explain_the_readings() -> None:
    touched = SCAN.touched
    run = fit_run(SENSOR, SENSOR.x_mm[touched], {"k": SCAN["k"][touched]}, 0.002 / np.sqrt(3.0))
    assert isinstance(run.problem, FitProblem)
    half, x = 0.5 * run.problem.pitch, np.linspace(0.0, 1.0, 30)
    box = np.stack([np.full(30, 0.3), np.full(30, 0.6)])
    drawn = draw_rounded(run.problem, (-half, half, 1.0 - half, 1.0 + half), x, box, quick=True)
    one = drawn.ends[drawn.commonest()]

    def sure(ends: FloatArray, misfit: float) -> float:
        rounded = replace(drawn, misfit=misfit)
        return doubts(0.95, run, run.model, 5.0, ends, rounded=rounded).probability("fast")

    away = np.where(one[1:] > one[:1], one * [[1.0], [0.6]], 0.0)
    assert sure(away, 1.0) < sure(away, 30.0)
    assert sure(away, 1.0) < sure(one, 1.0)

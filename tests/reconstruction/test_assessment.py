"""Whether one signature's `ok` can be relied on: what lowers the confidence, and what does not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.binding import exported
from tacstrip.core.ellipse import Ellipse
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.polygon.run import fit_run
from tacstrip.reconstruction.posterior.assessment import ENOUGH_OF_ONE, Effort, doubts

SENSOR = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
NOISE = ts.Noise(positional=0.003)
OVAL = 20.0 * np.stack(
    [f(np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)) for f in (np.cos, np.sin)], axis=1
)


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
@pytest.mark.parametrize(
    ("outline", "trusted"),
    [
        ([(15, 35), (60, 15), (88, 50), (40, 85)], True),
        ([(15, 50), (85, 20), (60, 50), (85, 80)], False),  # k_h hides the inward corner
    ],
    ids=["convex", "concave"],
)
def test_one_signature_is_trusted_where_it_is_right(
    outline: list[tuple[float, float]], trusted: bool
) -> None:
    contact, noise = ts.Contact.polygon(outline), ts.Noise(positional=0.006)
    scan = ts.Scan(kh=ts.simulate(SENSOR, contact, noise, rng=5).kh)
    found = ts.fit_polygon(scan, SENSOR, noise).objects[0]
    assert (found.status == "ok") == trusted
    assert (ts.mismatch(outline, found.vertices).iou > 0.8) == trusted


@pytest.mark.parametrize("effort", ["thorough", "fast"])
def test_many_corners_and_an_ellipse_that_is_hardly_better_are_doubted(effort: Effort) -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(OVAL + 50.0), NOISE, rng=1)
    touched = scan.touched
    run = fit_run(SENSOR, SENSOR.x_mm[touched], {"kh": scan["kh"][touched]}, 0.003 / np.sqrt(3.0))
    assert isinstance(run.problem, FitProblem)
    assert run.selection is not None
    polygon = run.selection.chosen
    assert isinstance(polygon, PolygonFit)
    ends = np.array([[0.3, 0.3, 0.4], [0.5, 0.7, 0.6]])
    by_corners = [doubts(0.98, run, polygon, n, ends).probability(effort) for n in (3, 5, 6, 9, 12, 40)]
    assert by_corners[:-1] == sorted(by_corners[:-1], reverse=True)
    assert by_corners[0] > by_corners[-2] == by_corners[-1]
    assert doubts(0.98, run, run.ellipse, 42, ends).probability(effort) > by_corners[4]
    shares = [doubts(iou, run, polygon, 4, ends).probability(effort) for iou in (0.0, 0.3, 0.7, 1.0)]
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < 0.1
    assert ENOUGH_OF_ONE[effort] < shares[-1] < 1.0


@pytest.mark.parametrize("effort", ["thorough", "fast"])
def test_what_an_inward_corner_leaves_is_doubted(effort: Effort) -> None:
    """One signature takes a notch for readings to leave out, or for an outline that is too high."""
    scan = ts.simulate(SENSOR, ts.Contact.polygon([(15, 35), (60, 15), (88, 50), (40, 85)]), NOISE, rng=5)
    touched = scan.touched
    run = fit_run(SENSOR, SENSOR.x_mm[touched], {"kh": scan["kh"][touched]}, 0.003 / np.sqrt(3.0))
    some, higher = np.array([[0.4, 0.4], [0.6, 0.6]]), np.array([[0.1, 0.1], [0.9, 0.9]])
    as_it_is = doubts(0.95, run, run.model, 4.0, some).probability(effort)
    without = replace(run, excluded=np.eye(1, touched.sum(), 9, dtype=np.bool_))
    assert doubts(0.95, without, run.model, 4.0, some).probability(effort) < as_it_is - 0.1
    assert doubts(0.95, run, run.model, 4.0, higher).probability(effort) < as_it_is


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
@pytest.mark.parametrize("effort", ["thorough", "fast"])
def test_few_strips_of_one_signature_are_never_ok(effort: Effort) -> None:
    """However probable: a superellipse is read as an ellipse (3 of 6 that were ok so were wrong)."""
    few = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    noise = ts.Noise(positional=1e-4)
    scan = ts.Scan(kh=ts.simulate(few, ts.Contact.polygon(1.5 * OVAL + 50.0), noise, rng=1).kh)
    found = ts.fit_polygon(scan, few, noise, assessment=effort).objects[0]
    assert found.model is Ellipse
    assert found.confidence is not None
    assert found.confidence > ENOUGH_OF_ONE[effort]
    assert found.status == "doubtful"
    assert f"probability of {found.confidence:.2f} it" in found.advice
    assert "fewer than 12 strips with one signature even outlines as sure as that are wrong" in found.advice


@pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")
def test_an_ellipse_at_the_border_may_be_cut_off_there() -> None:
    """One signature of a trapezoid over the border reads like an ellipse that just reaches it."""
    confidences = []
    for off in (0.0, 20.0):
        contact = ts.Contact.polygon(OVAL - (OVAL[:, 0].min(), 0.0) + (SENSOR.x_mm[0] + off, 50.0))
        scan = ts.Scan(kh=ts.simulate(SENSOR, contact, NOISE, rng=3).kh)
        found = ts.fit_polygon(scan, SENSOR, NOISE, assessment="fast").objects[0]
        assert found.model is Ellipse
        assert found.confidence is not None
        confidences.append(found.confidence)
    at_border, away = (np.log(c / (1.0 - c)) for c in confidences)  # log odds
    assert away > at_border + 2.0


def test_advice_asks_for_a_second_signature_only_where_the_sensor_has_one() -> None:
    square = ts.Contact.polygon([(20, 20), (70, 20), (70, 70), (20, 70)])
    for kind, wanted in (("crs-crs", "use both signatures"), ("crs-m", "use finer strips or two signatures")):
        sensor = ts.Sensor(construction=kind, strips=12, pitch_mm=8.0, length_mm=100.0)
        noise = ts.Noise(positional=0.005)
        scan = ts.simulate(sensor, square, noise, rng=1)
        one = ts.Scan(k=scan["k"]) if kind == "crs-m" else ts.Scan(kl=scan["kl"])
        found = ts.fit_polygon(one, sensor, noise, assessment="fast").objects[0]
        assert found.status == "doubtful"
        assert re.findall("use .*?signatures", found.advice)[0] == wanted


@pytest.mark.parametrize("seed", range(3))
def test_ends_between_few_strips_leave_doubt(seed: int) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=7, pitch_mm=100 / 7, length_mm=100.0)
    contact = ts.Contact.polygon([(27, 30), (73, 36), (73, 66), (27, 60)])
    noise = ts.Noise(positional=0.002)
    scan = ts.simulate(sensor, contact, noise, rng=seed)
    (found,) = ts.fit_polygon(scan, sensor, noise, assessment="fast").objects
    assert found.confidence is not None
    assert found.confidence < 0.9  # an end may lie anywhere between two strips

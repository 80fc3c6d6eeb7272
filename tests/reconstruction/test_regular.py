"""Regular outlines of one signature: their closed forms, their evidence, and where they are the estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import affinity

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.binding import exported
from tacstrip.core.problem import FitProblem
from tacstrip.core.regular import regular_values, sample_regular
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline
from tacstrip.reconstruction.posterior.regular.draws import averaged, draw_regular
from tacstrip.reconstruction.posterior.regular.kinds import KINDS, NUMBERS, Outlines
from tacstrip.reconstruction.posterior.regular.ovals import Ovals
from tacstrip.reconstruction.posterior.regular.placement import Placement
from tacstrip.reconstruction.posterior.regular.rectangles import Rectangles
from tacstrip.reconstruction.posterior.regular.trapezoids import Trapezoids

SENSOR = ts.Sensor(construction="crs-m", strips=30, pitch_mm=4.0, length_mm=100.0, contact_lambda_mm=1.0)
NOISE = ts.Noise(positional=0.002)
DISC = shapely.Point(62.0, 45.0).buffer(30.0, quad_segs=64)
needs_core = pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")


def _problem(shape: shapely.Polygon, sensor: ts.Sensor = SENSOR) -> FitProblem:
    outline = np.array(shape.exterior.coords)[:-1]
    scan = ts.simulate(sensor, ts.Contact.polygon(outline), NOISE, rng=3)
    on = scan.touched
    return FitProblem.of(sensor, sensor.x_mm[on], {"k": scan["k"][on]}, 0.002 / np.sqrt(3.0))


def _window(problem: FitProblem) -> tuple[float, float, float, float]:
    half = 0.5 * problem.pitch
    return -half, half, 1.0 - half, 1.0 + half


def _held(shape: shapely.Polygon, own: Ovals | Rectangles | Trapezoids) -> None:
    """Hold box and ends of the first of some outlines to a polygon's."""
    left, low, right, high = shape.bounds
    np.testing.assert_allclose([float(v[0]) for v in own.box], [left, right, low, high], atol=2e-3)
    x = np.linspace(left, right, 9)[1:-1]
    ends = [np.array(v[0], dtype=float) for v in own.ends(x[None])]
    cuts = [shapely.LineString([(at, -9.0), (at, 9.0)]).intersection(shape).bounds for at in x]
    np.testing.assert_allclose(ends, np.array(cuts)[:, [1, 3]].T, atol=4e-3)


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.6])
def test_ends_of_turned_rounded_rectangles(radius: float) -> None:
    number = (radius / 0.6 + 0.4) / 1.5  # of the radius over the half height
    z = np.full((1, NUMBERS), 0.0)
    z[0, [2, 3, 4]] = np.log(0.6 / 0.35) / np.log(0.35**-2), 0.15, number
    core = shapely.box(-1.0 + radius, -0.6 + radius, 1.0 - radius, 0.6 - radius) if radius < 0.6 else None
    core = core or shapely.LineString([(-0.4, 0.0), (0.4, 0.0)])
    shape = affinity.rotate(core.buffer(radius, quad_segs=64), 54.0, origin=(0, 0))
    _held(shape, Rectangles.of(np.array([4]), z))


def test_ends_of_a_trapezoid() -> None:
    z = np.zeros((1, NUMBERS))
    z[0, [2, 3, 4, 5]] = 0.5, 0.6, 0.25, 0.5
    shape = shapely.Polygon([(-1, -1), (1, -1), (-0.3 + 0.6, 1), (-0.3, 1)])
    _held(affinity.rotate(shape, 216.0, origin=(0, 0)), Trapezoids.of(np.array([6]), z))


@pytest.mark.parametrize("turn", [0.0, 0.2, 0.45, 0.7, 0.95])
def test_ends_of_segments_and_ellipses(turn: float) -> None:
    z = np.zeros((1, NUMBERS))
    z[0, [2, 3, 4]] = 0.5, turn, 0.6
    disc = shapely.Point(0, 0).buffer(1.0, quad_segs=96)
    cut = shapely.clip_by_rect(disc, -2.0, -2.0, -0.6 + 1.5 * 0.6, 2.0)
    _held(affinity.rotate(cut, 360.0 * turn, origin=(0, 0)), Ovals.of(np.array([2]), z))
    ellipse = affinity.rotate(affinity.scale(disc, 1.0, np.sqrt(0.35)), 180.0 * turn, origin=(0, 0))
    _held(ellipse, Ovals.of(np.array([1]), z))


@needs_core
@pytest.mark.parametrize("lam", [0.0, 1.0])
def test_values_of_outlines_are_those_of_their_readings(lam: float) -> None:
    """Half chi squares of all kinds, and that prior and place are an integral of the likelihood over places."""
    problem = averaged(_problem(DISC, replace(SENSOR, contact_lambda_mm=lam)))
    place, random = Placement.of(problem, _window(problem)), np.random.default_rng(2)
    some = Outlines(np.arange(700) % 7, random.random(700) < 0.5, random.random((700, NUMBERS)))
    found = regular_values(problem, place.compiled, some.kind, some.over, some.z)
    assert found is not None
    log, misfit, lowest = found.T
    fits = log > -1e8
    assert (misfit[~fits] > 1e8).all()  # what is higher than the strip explains nothing
    assert not fits.all()
    assert set(some.kind[fits & ~some.over]) == set(some.kind[fits & some.over]) == set(range(7))

    def half_chi_square(at: FloatArray) -> FloatArray:
        l, u = np.moveaxis(place.ends(some, at, problem.x), 1, 0)
        off = (problem.readings_of(l, u)[:, 0] - problem.k[0]) * problem.root_weight[0]
        missed = np.count_nonzero(u <= l, axis=1)
        return np.asarray(0.5 * (off**2).sum(axis=1) + np.where(missed > 1, 1e3 * missed, 0.0))

    np.testing.assert_allclose(misfit[fits], half_chi_square(lowest)[fits], rtol=2e-3 if lam else 1e-6)
    on = place.placed(some, problem.x)
    room = 1.0 - on.height
    free = fits & (on.border < 2) & (lowest > 0.0) & (lowest < room) & on.there.all(axis=1) & (room > 0.02)
    assert free.sum() > 20
    width = 0.1 * np.minimum(lowest, room - lowest)
    low, middle, high = (half_chi_square(lowest + o * width)[free] for o in (-1.0, 0.0, 1.0))
    curvature = (low + high - 2.0 * middle) / width[free] ** 2
    expected = 0.5 * np.log(2.0 * np.pi / curvature) - np.log(room[free])
    np.testing.assert_allclose(log[free], expected, atol=1e-2 if lam else 1e-4)
    np.testing.assert_allclose(high, low, atol=2e-3 * middle.max())


@needs_core
def test_the_evidence_is_the_integral_of_the_likelihood() -> None:
    """Of a disc, by its two ends, against their grid."""
    problem = averaged(_problem(DISC))
    place = Placement.of(problem, _window(problem)).compiled
    drawn = sample_regular(problem, place, 100, -np.inf, seed=1)
    assert drawn is not None
    assert drawn.done[0]
    middles = (np.arange(120) + 0.5) / 120
    z = np.zeros((120**2, NUMBERS))
    z[:, 0], z[:, 1] = np.repeat(middles, 120), np.tile(middles, 120)
    kind, over = np.zeros(len(z), dtype=np.int64), np.zeros(len(z), dtype=bool)
    values = regular_values(problem, place, kind, over, z)
    assert values is not None
    exponent = values[:, 0] - values[:, 1]
    evidence = exponent.max() + np.log(np.exp(exponent - exponent.max()).mean())
    assert drawn.evidence[0] == pytest.approx(evidence, abs=0.4)


@needs_core
def test_a_disc_is_found_and_a_pentagon_is_none_of_them() -> None:
    problem = _problem(DISC)
    found = draw_regular(problem, _window(problem), np.linspace(0.0, 1.0, 40), 1.0)
    assert found is not None
    assert found.misfit < 2.0
    assert found.advantage > -25.0
    outline = found.outline(found.commonest())
    assert outline.kind in KINDS
    ring = np.concatenate([(c := outline.chains_mm(problem))[0], c[1][::-1]])
    shape = shapely.Polygon(ring)
    assert shape.intersection(DISC).area / shape.union(DISC).area > 0.9
    problem = _problem(shapely.Polygon([(15, 40), (40, 15), (90, 20), (105, 50), (50, 85)]))
    found = draw_regular(problem, _window(problem), np.linspace(0.0, 1.0, 40), 1.0)
    assert found is not None
    assert found.advantage < -25.0
    assert found.misfit > 2.0


@needs_core
def test_half_a_disc_of_one_signature_is_given_as_one() -> None:
    disc = shapely.Point(60.0, 45.0).buffer(30.0, quad_segs=64)
    shape = shapely.clip_by_rect(disc, 0.0, 45.0, 120.0, 100.0)
    outline = np.array(shape.exterior.coords)[:-1]
    noise = ts.Noise(positional=0.001)
    scan = ts.simulate(SENSOR, ts.Contact.polygon(outline), noise, rng=4)
    found = ts.fit_polygon(scan, SENSOR, noise).objects[0]
    assert found.model is FamilyOutline
    assert found.kind == "segment of a disc"
    assert ts.mismatch(outline, found.vertices).iou > 0.95


@needs_core
def test_an_upright_rounded_rectangle_of_one_signature_is_given_as_one() -> None:
    """Its best polygon overlaps it by .04: only the round corners tell how high it is, and not well."""
    shape = shapely.box(45.0, 48.0, 75.0, 62.0).buffer(10.0, quad_segs=32)
    outline, noise = np.array(shape.exterior.coords)[:-1], ts.Noise(positional=0.0005)
    scan = ts.simulate(SENSOR, ts.Contact.polygon(outline), noise, rng=2)
    found = ts.fit_polygon(scan, SENSOR, noise).objects[0]
    assert found.model is FamilyOutline
    assert found.kind == "upright rectangle"
    assert "looks like an upright rectangle" in found.advice
    assert ts.mismatch(outline, found.vertices).iou > 0.6
    assert found.covariance is not None
    assert found.covariance.shape == (found.vertices.size, found.vertices.size)


@needs_core
def test_an_upright_rectangle_of_any_height_is_right_in_three_of_ten() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon([(15, 30), (65, 30), (65, 70), (15, 70)]), NOISE, rng=5)
    found = ts.fit_polygon(ts.Scan(kh=scan["kh"]), sensor, NOISE).objects[0]
    assert (found.kind, found.status) == ("upright rectangle", "doubtful")
    assert found.confidence == pytest.approx(0.3)
    assert found.deviations is not None
    assert 1.96 * found.deviations[2] > np.pi / 2  # higher than it is wide, or wider than high

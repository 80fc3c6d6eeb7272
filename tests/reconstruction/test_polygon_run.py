"""A whole run in one call of the core does what its steps do one by one: noise, outliers, polygons, ellipse."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from polygons import convex_polygon
from tacstrip.arrays import FloatArray
from tacstrip.core.binding import exported
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.swept_area import swept_share
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.polygon.convexity import inward_corners
from tacstrip.reconstruction.polygon.run import ModelInMm, RunFit, fit_run, plain_fit_run

pytestmark = pytest.mark.skipif(exported("fit_runs") is None, reason="the core is not compiled here")
_ANGLE = np.linspace(0.0, 6.2, 60)
ROUND = 500.0 + 300.0 * np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)


def _spoil(k: FloatArray, how: str, random: np.random.Generator) -> None:
    """Put faults into readings (n,): stuck, missing, impossible, or so many that they are no outliers."""
    places = (
        0
        if len(k) < 4
        else {"stuck": 1, "missing": 2, "impossible": 1, "rough": len(k) // 2, "clean": 0}[how]
    )
    at = random.choice(len(k), places, replace=False)
    k[at] = {"missing": np.nan, "impossible": 7.0}.get(how, 0.9) if how != "rough" else random.random(places)


def _check_in_mm(run: RunFit, sensor: ts.Sensor) -> None:
    """What the core says of a run's polygon is what Python says of it."""
    assert run.model is not None
    assert run.selection is not None
    told, truth = run.model_mm, ModelInMm.of(run.model, run.problem)
    np.testing.assert_allclose(told.lower, truth.lower, rtol=0.0, atol=1e-12 * sensor.length_mm)
    np.testing.assert_allclose(told.upper, truth.upper, rtol=0.0, atol=1e-12 * sensor.length_mm)
    assert told.height == pytest.approx(truth.height, rel=1e-12)
    if not isinstance(run.model, PolygonFit):
        assert told.inward is None
        return
    assert told.inward == any(map(len, inward_corners(run.selection.chosen)))
    if told.covariance is None or told.height <= 0.0:
        return
    wanted, vertices = (
        run.model.plain_covariance(run.problem, sensor),
        Outline(told.lower, told.upper).vertices,
    )
    scale = np.sqrt(wanted.diagonal())
    np.testing.assert_allclose(
        told.covariance / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-9
    )
    assert told.swept == pytest.approx(swept_share(vertices, told.covariance), rel=1e-9)


@pytest.mark.parametrize("how", ["clean", "stuck", "missing", "impossible", "rough"])
@pytest.mark.parametrize("sigma", [None, 0.004])
@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_a_run_is_fitted_as_step_by_step(construction: str, sigma: float | None, how: str) -> None:
    shapes = [
        (ROUND, 30),
        *((convex_polygon(seed, 3 + seed), strips) for seed, strips in enumerate((7, 24, 200))),
    ]
    for seed, (outline, strips) in enumerate(shapes):
        sensor = ts.Sensor(
            construction=construction,
            strips=strips,
            pitch_mm=1000.0 / strips,
            length_mm=1000.0,
            contact_lambda_mm=20.0 * (seed == 1),
            adc_bits=12,
        )
        scan = ts.simulate(sensor, ts.Contact.polygon(outline), ts.Noise(positional=0.004), rng=seed)
        for strips_of_run in scan.runs():
            readings = {name: scan[name][strips_of_run].copy() for name in scan.signatures}
            _spoil(readings[scan.signatures[0]], how, np.random.default_rng(seed))
            got, truth = (
                fit(sensor, sensor.x_mm[strips_of_run], readings, sigma) for fit in (fit_run, plain_fit_run)
            )
            np.testing.assert_array_equal(got.excluded, truth.excluded)
            assert got.sigma == pytest.approx(truth.sigma, rel=1e-6)
            assert got.ellipse_advantage == pytest.approx(truth.ellipse_advantage, rel=1e-6, abs=1e-6)
            np.testing.assert_allclose(got.problem.k, truth.problem.k, atol=1e-12)
            np.testing.assert_allclose(got.problem.weight, truth.problem.weight, rtol=2e-6)
            np.testing.assert_allclose(got.residuals, truth.residuals, atol=1e-5)
            assert (got.selection is None) == (truth.selection is None)
            if got.selection is None or truth.selection is None:
                continue
            assert (got.selection.best, got.selection.equal) == (truth.selection.best, truth.selection.equal)
            np.testing.assert_allclose(got.selection.chosen.theta, truth.selection.chosen.theta, atol=1e-6)
            assert got.residual_sums == pytest.approx(truth.residual_sums, rel=1e-5)
            _check_in_mm(got, sensor)
            assert got.model is not None
            np.testing.assert_allclose(got.residuals, got.model.residuals(got.problem), atol=1e-9)

"""An ellipse's outline is drawn with corners; its moments are the ellipse's own."""

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.ellipse import Ellipse
from tacstrip.reconstruction.polygon.run import fit_run

SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)


@pytest.mark.parametrize("ratio", [1.1, 1.6])
@pytest.mark.parametrize("angle", [-0.5, 0.9])
def test_the_drawn_outline_has_the_area_and_orientation_of_the_ellipse(ratio: float, angle: float) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    a, b = 25.0 * np.sqrt(ratio) * np.cos(turn), 25.0 / np.sqrt(ratio) * np.sin(turn)
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    contact = ts.Contact.polygon(np.stack([a, b], axis=1) @ rotation + 50.0)
    noise = ts.Noise(positional=1e-3)
    found = ts.fit_polygon(ts.simulate(SENSOR, contact), SENSOR, noise, bounded=False).objects[0]
    assert found.model is not None
    assert found.orientation == pytest.approx(angle, abs=1e-3)  # .012-.019 with corners moved in y alone
    assert found.area == pytest.approx(np.pi * 625.0, rel=1e-4)
    assert repr(found).startswith("<RecoveredObject: ok, ellipse, ")
    (record,) = ts.object_records([ts.Reconstruction("polygon", (found,))])
    assert (record["kind"], record["corners"]) == ("ellipse", None)


@pytest.mark.parametrize("seed", [1, 4])
def test_deviations_are_those_of_a_markov_chain(seed: int) -> None:
    """By slopes alone they are .8 (seed 1) and 1.3 to 1.8 times as large: heights bend with where the ends lie."""
    random, turn = np.random.default_rng(seed), np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    sensor = ts.Sensor(construction="crs-crs", strips=30, pitch_mm=4.0, length_mm=120.0)
    c, s = np.cos(angle := random.uniform(0.2, 1.2)), np.sin(angle)
    outline = np.stack([30.0 * np.cos(turn), 20.0 * np.sin(turn)], axis=1) @ [[c, s], [-s, c]]
    contact = ts.Contact.polygon(outline + np.array([60.0 + random.uniform(-3.0, 3.0), 60.0]))
    scan = ts.simulate(sensor, contact, ts.Noise(positional=0.002), rng=seed)
    run = fit_run(sensor, sensor.x_mm[scan.touched], {"kh": scan["kh"][scan.touched]}, 0.002 / np.sqrt(3.0))
    best, problem = run.model, run.problem
    assert isinstance(best, Ellipse)

    def half_cost(parameters: FloatArray) -> float:
        return 0.5 * float((replace(best, parameters=parameters).residuals(problem) ** 2).sum())

    step = 0.9 * np.linalg.cholesky(np.linalg.inv(best.information))
    at, cost, chain = best.parameters, half_cost(best.parameters), []
    for _ in range(6000):
        trial = at + step @ random.normal(size=5)
        inside = np.abs(trial[:2] - (0.0, 1.0)).max() < 0.5 * problem.pitch and 0.0 < trial[4] < 0.5
        if inside and np.log(random.random()) < cost - (new := half_cost(trial)):
            at, cost = trial, new
        chain.append(at)
    drawn = [np.concatenate(replace(best, parameters=p).chains_mm(problem)) for p in chain[500::5]]
    off = np.square(drawn - np.concatenate(best.chains_mm(problem))).mean(axis=0)
    told = best.covariance(problem, sensor).diagonal()
    assert np.sqrt(told[1::2].sum() / off[1:-1, 1].sum()) == pytest.approx(1.0, abs=0.12)
    assert np.sqrt(told[::2].sum() / off[1:-1, 0].sum()) == pytest.approx(1.0, abs=0.12)


def test_a_disc_is_told_from_an_oval_by_its_slant_and_axes() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    found = []
    for flat in (1.0, 0.8):
        contact = ts.Contact.polygon(25.0 * np.stack([np.cos(turn), flat * np.sin(turn)], axis=1) + 50.0)
        kh = ts.simulate(SENSOR, contact, ts.Noise(positional=1e-3), rng=1).kh
        assert kh is not None
        on = np.isfinite(kh)
        run = fit_run(SENSOR, SENSOR.x_mm[on], {"kh": kh[on]}, 1e-3 / np.sqrt(3.0))
        assert isinstance(run.model, Ellipse)
        found.append(run.model.disc_evidence(run.problem))
    disc, oval = found
    assert disc > 4.0
    assert oval < -4.0

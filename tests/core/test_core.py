"""The compiled core does what its NumPy truth does, and the truth is that of the closed forms."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Lock

import numpy as np
import pytest

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import (
    END_ENTRIES,
    MAX_VERTICES,
    POLYGON,
    _without_turn,
    at,
    exported,
    search_workspace,
    taking_turns,
)
from tacstrip.core.cost import heights, normal_equations
from tacstrip.core.descent import descend, ordered
from tacstrip.core.ellipse import fit_ellipse, plain_fit_ellipse
from tacstrip.core.outliers import isolated_outliers, plain_isolated_outliers, plain_spikes, spikes
from tacstrip.core.polygon_fit import PolygonFit, plain_refine, refine
from tacstrip.core.problem import FitProblem
from tacstrip.core.score_test import NEW, TRIED, candidates, places
from tacstrip.core.search import fit_counts, plain_fit_counts
from tacstrip.core.swept_area import plain_swept_areas, swept_areas
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.closed_form import k_h, k_l, k_metal
from tacstrip.sensor.spec import Sensor

MODELS = (
    ("both", 1.0, 0.0),
    ("both", 5.0, 0.02),
    ("upper", 1.0, 0.0),
    ("upper", 0.2, 0.05),
    ("lower", 1.0, 0.01),
    ("metal", 0.0, 0.0),
    ("metal", 0.0, 0.03),
)
needs_core = pytest.mark.skipif(exported("refine") is None, reason="the core is not compiled here")


def _empty(model: tuple[str, float, float], n: int, rows: int = 0) -> FitProblem:
    """Return a problem without readings."""
    kind, ratio, lam = model
    a = ratio / (1.0 + ratio)
    shares = {"both": [a, 0.0], "upper": [a], "lower": [0.0], "metal": [0.0]}[kind]
    x, shape = (np.arange(n) + 0.5) / n, (len(shares), n)
    weight = np.full(shape, 1.0 / 0.005**2)
    return FitProblem(
        x, np.zeros(shape), weight, 1.0 / n, np.array(shares), 1.0 - a, lam, 0.0, float(n), 60.0
    )


def _case(
    seed: int, model: tuple[str, float, float], vertical_ends: tuple[int, int] = (0, 0), n: int = 60
) -> tuple[PolygonFit, FitProblem]:
    """Draw a polygon with vertices on both chains, and readings near it, some left out."""
    random, problem = np.random.default_rng(seed), _empty(model, n)
    m = int(random.integers(1, 6))
    x = np.sort(random.uniform(0.05, 0.95, m))
    chain = random.integers(0, 2, m)
    y = np.where(chain == 1, random.uniform(0.55, 0.8, m), random.uniform(0.15, 0.45, m))
    left, right = random.uniform(0.45, 0.55, 2)
    ends = [0.002, left, left + 0.1 * vertical_ends[0], 0.997, right, right + 0.1 * vertical_ends[1]]
    theta = np.concatenate([ends, np.stack([x, y], axis=1).ravel()])
    fit = PolygonFit(theta, chain, np.array(vertical_ends, dtype=np.int64), np.inf)
    k = fit.readings(problem) + random.normal(0.0, 0.005, problem.k.shape)
    weight = random.uniform(0.5, 2.0, k.shape) * problem.weight
    return fit, _with(problem, k, np.where(random.uniform(size=k.shape) < 0.1, 0.0, weight))


def _with(problem: FitProblem, k: FloatArray, weight: FloatArray) -> FitProblem:
    return FitProblem(
        problem.x,
        k,
        weight,
        problem.pitch,
        problem.shares,
        problem.narrow,
        problem.lam,
        0.0,
        problem.width_mm,
        60.0,
    )


def _batch(fit: PolygonFit) -> tuple[FloatArray, IntArray, IntArray]:
    return fit.theta[None], fit.chain[None], fit.vertical_ends


@pytest.mark.parametrize("which", MODELS)
def test_readings_and_their_slopes_are_those_of_the_closed_forms(which: tuple[str, float, float]) -> None:
    kind, ratio, lam = which
    problem, random = _empty(which, 50), np.random.default_rng(0)
    l = random.uniform(0.0, 0.5, (3, 50))
    u = l + random.uniform(0.0, 0.5, (3, 50))
    forms = [k_h, k_l] if kind == "both" else [k_h if kind == "upper" else k_l]
    if kind == "metal":
        wanted = k_metal(l, u - l, 1.0, lam)[:, None]
    else:
        wanted = np.stack([form(l, u - l, 1.0, ratio, lam) for form in forms], axis=1)
    by_l, by_u, k = problem.jacobian(l, u)
    np.testing.assert_allclose(k, wanted, atol=1e-12)
    step = 1e-6
    for slope, dl, du in ((by_l, step, 0.0), (by_u, 0.0, step)):
        difference = problem.readings_of(l + dl, u + du) - problem.readings_of(l - dl, u - du)
        np.testing.assert_allclose(slope, difference / (2.0 * step), atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("vertical_ends", [(0, 0), (1, 0), (1, 1)])
def test_heights_pass_through_the_vertices_and_their_slopes_are_differences(
    vertical_ends: tuple[int, int],
) -> None:
    fit, problem = _case(1, MODELS[0], vertical_ends)
    theta, chain, sides = _batch(fit)
    for side, (height, slope) in enumerate(heights(theta, chain, sides, problem.x)):
        np.testing.assert_allclose(height[0], fit.ends(problem.x)[side], atol=1e-12)
        for i in range(theta.shape[1]):
            step = np.zeros(theta.shape)
            step[0, i] = 1e-7
            up, down = (heights(theta + sign * step, chain, sides, problem.x)[side][0] for sign in (1, -1))
            np.testing.assert_allclose(slope[0, :, i], (up - down)[0] / 2e-7, atol=1e-5)


@pytest.mark.parametrize("which", MODELS)
def test_the_gradient_is_half_the_cost_s_slope(which: tuple[str, float, float]) -> None:
    fit, problem = _case(1, which, (1, 0))
    theta, chain, vertical_ends = _batch(fit)
    gradient = normal_equations(theta, chain, vertical_ends, problem)[2][0]
    for i in range(theta.shape[1]):
        step = np.zeros(theta.shape)
        step[0, i] = 1e-6
        up, down = (
            normal_equations(theta + sign * step, chain, vertical_ends, problem)[0][0] for sign in (1, -1)
        )
        assert gradient[i] == pytest.approx(-(up - down) / 4e-6, rel=1e-4, abs=1e-4 * np.abs(gradient).max())


@needs_core
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_normal_equations_agree(which: tuple[str, float, float], seed: int) -> None:
    fit, problem = _case(seed, which, (seed % 2, seed // 3), 60 + seed)
    theta, chain, vertical_ends = _batch(fit)
    if seed > 3:  # chains that cross
        theta[:, END_ENTRIES + 1 :: 2] = 1.0 - theta[:, END_ENTRIES + 1 :: 2]
    wanted = normal_equations(theta, chain, vertical_ends, problem)
    core, record, size = (
        exported("normal_equations"),
        PolygonFit(theta[0], chain[0], vertical_ends, 0.0).record,
        theta.shape[1],
    )
    assert core is not None
    matrix, gradient = np.empty((size, size)), np.empty(size)
    cost = core(problem.compiled, at(record), 1, at(matrix), at(gradient))
    assert cost == pytest.approx(wanted[0][0], rel=1e-10)
    for got, truth in ((matrix, wanted[1][0]), (gradient, wanted[2][0])):
        np.testing.assert_allclose(got, truth, rtol=1e-9, atol=1e-10 * np.abs(truth).max())
    fit = PolygonFit(theta[0], chain[0], vertical_ends, 0.0)
    without = normal_equations(theta, chain, vertical_ends, problem, prior=False)[1][0]
    np.testing.assert_allclose(
        fit.information(problem), without, rtol=1e-9, atol=1e-10 * np.abs(without).max()
    )


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_core)])
def test_a_rounding_error_at_a_pointed_end_is_no_overlap(compiled: bool) -> None:
    """A pointed end may lie on the last strip, where l = u: rounding decides which of them comes out larger."""
    fit, problem = _case(1, MODELS[1])
    fit.theta[3], found = problem.x[-1], []
    for height in fit.theta[4] + np.spacing(fit.theta[4]) * np.arange(20):
        fit.theta[4:6] = height
        plain = normal_equations(*_batch(fit), problem, prior=False)[1][0]
        found.append(fit.information(problem) if compiled else plain)
    for matrix in found[1:]:
        np.testing.assert_allclose(matrix, found[0], rtol=1e-9, atol=1e-9 * np.abs(found[0]).max())


@needs_core
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("which", MODELS)
def test_descents_agree(which: tuple[str, float, float], seed: int) -> None:
    fit, problem = _case(seed, which, (seed % 2, seed // 4))
    fit.theta[END_ENTRIES:] += np.random.default_rng(seed).normal(0.0, 0.02, len(fit.theta) - END_ENTRIES)
    theta, chain, cost = descend(*_batch(fit), problem, 12, 1e-6, np.inf)
    core, record = exported("descend"), fit.record
    assert core is not None
    assert core(problem.compiled, at(record), 12, 1e-6, np.inf) == pytest.approx(cost[0], rel=1e-9)
    found = PolygonFit.of_record(record)
    np.testing.assert_array_equal(found.chain, chain[0])
    np.testing.assert_allclose(found.theta, theta[0], atol=1e-9)


@pytest.mark.parametrize("do", [refine, plain_refine])
def test_a_descent_ends_in_a_minimum(do: object) -> None:
    assert callable(do)
    fit, problem = _case(2, MODELS[0])
    found = do(fit, problem)
    random = np.random.default_rng(0)
    near = found.theta + random.normal(0.0, 1e-3, (200, len(found.theta)))
    near[:, [2, 5]] = near[:, [1, 4]]
    chain = np.tile(found.chain, (200, 1))
    assert (normal_equations(near, chain, found.vertical_ends, problem)[0] >= found.cost - 1e-4).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_the_score_test_finds_the_best_places(which: tuple[str, float, float], seed: int) -> None:
    whole, problem = _case(seed, which)
    m = whole.n_interior - 1  # a vertex is missing
    fit = plain_refine(
        PolygonFit(whole.theta[: END_ENTRIES + 2 * m], whole.chain[:m], whole.vertical_ends, 0.0), problem
    )
    every = candidates(fit.theta, fit.chain, fit.vertical_ends, problem, np.arange(1, len(problem.x) - 1))
    starts, chains = places(fit.theta, fit.chain, fit.vertical_ends, False, problem)
    gains = {(c.strip, c.upper): c.gain for c in every}
    strips = np.searchsorted(problem.x, starts[:, -2])
    found = [gains[int(i), int(c[-1])] for i, c in zip(strips, chains, strict=True)]
    assert max(found) == pytest.approx(max(gains.values()), rel=1e-9)
    core = exported("places")
    if core is None:
        return
    record, compiled, workspace = fit.record, np.empty(TRIED, POLYGON), search_workspace()
    assert core(problem.compiled, at(record), 0, at(compiled), at(workspace)) == len(starts)
    wanted = {(int(i), int(c[-1])): s for i, c, s in zip(strips, chains, starts, strict=True)}
    thetas = [start["theta"][: END_ENTRIES + 2 * m + 2] for start in compiled[: len(starts)]]
    which_places = [
        (int(np.searchsorted(problem.x, theta[-2])), int(start["upper"][m]))
        for theta, start in zip(thetas, compiled, strict=False)
    ]
    gained = sorted(gains[place] for place in which_places)
    assert gained == pytest.approx(sorted(found), rel=1e-6)  # places of equal gain are equally good
    for place, theta in zip(which_places, thetas, strict=True):
        if place in wanted:
            np.testing.assert_allclose(theta, wanted[place], atol=1e-6)


def test_a_gain_is_what_a_descent_gains_from_a_small_kink() -> None:
    """By its definition: the least cost with the hat's height free, in the linear model."""
    whole, problem = _case(3, MODELS[0])
    fit = plain_refine(PolygonFit(whole.theta[:-2], whole.chain[:-1], whole.vertical_ends, 0.0), problem)
    (best,) = sorted(
        candidates(fit.theta, fit.chain, fit.vertical_ends, problem, np.arange(1, 59)), key=lambda c: c.gain
    )[-1:]
    assert NEW < 1.0
    shifted = np.concatenate([fit.theta + 1e-3 * best.shift, [problem.x[best.strip], 0.0]])
    lifted = _lifted(fit, shifted, best.upper, 1e-3 * best.height)
    gain = fit.cost - normal_equations(*_batch(lifted), problem)[0][0]
    assert gain == pytest.approx(2e-3 * best.gain, rel=0.02)


def _lifted(fit: PolygonFit, theta: FloatArray, upper: int, height: float) -> PolygonFit:
    """Put the last vertex of theta on a chain, and so much above it."""
    inner = theta[END_ENTRIES:-2].reshape(-1, 2)[fit.chain == upper]
    knots = np.array([theta[[0, 1 + upper]], *inner, theta[[3, 4 + upper]]])
    theta[-1] = np.interp(theta[-2], *knots.T) + height
    new, chain = ordered(theta[None], np.append(fit.chain, upper)[None])
    return PolygonFit(new[0], chain[0], fit.vertical_ends, np.inf)


def _convex(seed: int, model: tuple[str, float, float], n: int) -> FitProblem:
    """Return noisy readings of a convex polygon with one to three vertices on each chain."""
    random, problem = np.random.default_rng(seed), _empty(model, n)
    outline = []
    for sign in (-1.0, 1.0):
        angle = np.sort(random.uniform(0.3, np.pi - 0.3, random.integers(1, 4)))
        x, y = 0.5 - 0.5 * np.cos(angle), 0.5 + sign * random.uniform(0.2, 0.4) * np.sin(angle)
        outline.append((np.array([0.0, *x, 1.0]), np.array([0.5, *y, 0.5])))
    k = problem.readings_of(*(np.interp(problem.x, *chain) for chain in outline))
    return _with(problem, k + random.normal(0.0, 0.005, k.shape), problem.weight)


@needs_core
@pytest.mark.parametrize("which", MODELS)
def test_searches_agree(which: tuple[str, float, float]) -> None:
    asked = (True, None), (False, None), (True, 5)
    # Counts that are given, and searches by stages, whatever the model.
    more = which in (MODELS[0], MODELS[-1])
    for seed, (n, those) in enumerate([(14, asked), (60, asked[: 3 if more else 1]), (340, asked[:more])]):
        problem = _convex(seed, which, n)
        for known, n_vertices in those:
            compiled, plain = (
                do(problem, known, n_vertices=n_vertices) for do in (fit_counts, plain_fit_counts)
            )
            assert (compiled.best, compiled.equal) == (plain.best, plain.equal)
            got, truth = compiled.chosen, plain.chosen
            assert compiled.scores[compiled.best] == pytest.approx(plain.scores[plain.best], rel=1e-9)
            np.testing.assert_array_equal(got.vertical_ends, truth.vertical_ends)
            np.testing.assert_array_equal(got.chain, truth.chain)
            np.testing.assert_allclose(got.theta, truth.theta, atol=1e-9)
            off = (problem.k - got.readings(problem)) * problem.root_weight
            np.testing.assert_allclose(got.residuals(problem), off, atol=1e-9)


@needs_core
def test_searches_of_readings_without_noise_agree() -> None:
    """By stages, on strips that are averaged and on such that are left out."""
    for n in (60, 700):
        fit, problem = _case(4, MODELS[0], (0, 1), n)
        exact = _with(problem, fit.readings(problem), np.full(problem.k.shape, 1e10))
        compiled, plain = fit_counts(exact), plain_fit_counts(exact)
        assert compiled.chosen.n_interior == plain.chosen.n_interior
        np.testing.assert_allclose(compiled.chosen.theta, plain.chosen.theta, atol=1e-9)


@needs_core
@pytest.mark.parametrize("which", MODELS)
def test_ellipses_agree(which: tuple[str, float, float]) -> None:
    problem = _empty(which, 81)
    t = (problem.x - 0.5) / 0.5
    half = 0.2 * np.sqrt(1.0 - t * t)
    k = problem.readings_of(0.5 + 0.1 * t - half, 0.5 + 0.1 * t + half)
    problem = _with(problem, k + np.random.default_rng(1).normal(0.0, 0.005, k.shape), problem.weight)
    start = fit_counts(problem).chosen
    got, truth = fit_ellipse(start, problem), plain_fit_ellipse(start, problem)
    assert got.cost == pytest.approx(truth.cost, rel=1e-9)
    np.testing.assert_allclose(got.parameters, truth.parameters, atol=1e-9)
    np.testing.assert_allclose(got.information, truth.information, rtol=1e-6)


def test_an_ellipse_is_fitted_from_the_outline_of_an_ellipse() -> None:
    """As tracking does: an outline of more vertices than a search takes."""
    problem = _empty(MODELS[0], 81)
    t = (problem.x - 0.5) / 0.5
    half = 0.2 * np.sqrt(1.0 - t * t)
    problem = _with(problem, problem.readings_of(0.5 - half, 0.5 + half), problem.weight)
    first = fit_ellipse(fit_counts(problem).chosen, problem)
    start = PolygonFit.of(Outline(*first.chains_mm(problem)), problem)
    assert start.n_interior > MAX_VERTICES
    np.testing.assert_allclose(fit_ellipse(start, problem).parameters, first.parameters, atol=1e-4)
    assert np.abs(start.residuals(problem)).max() < 3.0


def test_the_information_of_an_ellipse_is_that_of_its_readings() -> None:
    sensor = Sensor(construction="crs-crs", strips=80, pitch_mm=1.0, length_mm=60.0, resistivity_ratio=2.0)
    t = np.linspace(-79 / 80, 79 / 80, 80)
    middle, half = 0.5 + 0.1 * t, 0.2 * np.sqrt(1.0 - t * t)
    x = sensor.x_mm
    empty = FitProblem.of(sensor, x, {"kh": np.zeros(80), "kl": np.zeros(80)}, 0.002)
    k = empty.readings_of(middle - half, middle + half) + np.random.default_rng(1).normal(0.0, 0.002, (2, 80))
    problem = FitProblem.of(sensor, x, {"kh": k[0], "kl": k[1]}, 0.002)
    ellipse = fit_ellipse(fit_counts(problem).chosen, problem)
    np.testing.assert_allclose(ellipse.parameters[2:], [0.5, 0.1, 0.2], atol=0.003)
    for i in (2, 3, 4):  # the ends' x move strips in and out, where differences do not exist
        sides = []
        for sign in (-1.0, 1.0):
            p = ellipse.parameters.copy()
            p[i] += sign * 1e-6
            sides.append(type(ellipse)(p, 0.0, ellipse.information).residuals(problem).ravel())
        slope = (sides[1] - sides[0]) / 2e-6
        assert ellipse.information[i, i] == pytest.approx(slope @ slope, rel=1e-5)


@needs_core
def test_outliers_agree() -> None:
    random = np.random.default_rng(5)
    for n in (3, 4, 5, 20, 200):
        for wild in (0, 1, 3, n):
            k = np.linspace(0.2, 0.6, n) + random.normal(0.0, 0.002, n)
            k[random.integers(0, n, wild)] += random.choice([-0.2, 0.1, np.nan, np.inf], wild)
            np.testing.assert_array_equal(spikes(k, 0.002), plain_spikes(k, 0.002))
            residuals = random.normal(0.0, 1.0, (2, n))
            residuals[random.integers(0, 2, wild), random.integers(0, n, wild)] *= 20.0
            np.testing.assert_array_equal(isolated_outliers(residuals), plain_isolated_outliers(residuals))


@needs_core
def test_chains_are_those_of_numpy_to_the_bit() -> None:
    random = np.random.default_rng(5)
    for seed in range(40):
        fit, problem = _case(seed, MODELS[0], (seed % 2, seed // 2 % 2))
        theta = fit.theta.copy()
        theta[1:3], theta[4:6] = random.random((2, 2))  # ends and chains that cross
        theta[END_ENTRIES + 1 :: 2] = random.random(fit.n_interior)
        fit = PolygonFit.of_record(PolygonFit(theta, fit.chain, fit.vertical_ends, 0.0).record)
        got = (*fit.chains, *fit.chains_mm(problem))
        for chain, plain in zip(got, (*fit.plain_chains(), *fit.plain_chains_mm(problem)), strict=True):
            np.testing.assert_array_equal(chain, plain)


@needs_core
@pytest.mark.parametrize("vertical_ends", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_covariances_agree(vertical_ends: tuple[int, int]) -> None:
    sensor = Sensor(construction="crs-crs", strips=70, pitch_mm=1.0, length_mm=60.0)
    fit, problem = _case(6, MODELS[0], vertical_ends, 60)
    if not sum(vertical_ends):
        fit.theta[END_ENTRIES + 2] = (
            fit.theta[END_ENTRIES] + 0.5 / 60
        )  # an edge that crosses one strip or none
    outline = Outline(*fit.chains_mm(problem))
    got = fit.linear_covariance(problem, sensor)
    wanted = covariance_with_x_priors(outline, sensor, fit.information_root(problem))
    scale = np.sqrt(wanted.diagonal())
    np.testing.assert_allclose(got / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-6)


@needs_core
def test_covariances_of_loose_edges_agree() -> None:
    """Of edges across two or three strips, of which the edges beside explain some."""
    random, loose, n = np.random.default_rng(3), 0, 60
    sensor = Sensor(construction="crs-crs", strips=n, pitch_mm=1.0, length_mm=60.0)
    for seed in range(200):
        fit, problem = _case(seed, MODELS[seed % len(MODELS)], (seed % 2, seed // 2 % 2), n)
        chain = np.array([side for side in (0, 1) for _ in range(3)])
        x = np.concatenate(
            [at + np.array([0.0, 1.5, 3.0]) * random.uniform(0.7, 1.6) / n for at in (0.3, 0.6)]
        )
        y = np.where(chain == 0, 0.25, 0.75) + random.normal(0.0, 0.01, 6)
        theta = np.concatenate([fit.theta[:END_ENTRIES], np.stack([x, y], axis=1).ravel()])
        made = PolygonFit(theta, chain, fit.vertical_ends, 0.0)
        weight = np.full(problem.k.shape, 10.0 ** random.uniform(2.0, 6.0))
        weight[:, random.integers(0, n)] = 0.0
        problem = _with(problem, made.readings(problem), weight)
        loose += made._with_loose_edges(problem) is not made
        got, truth = made.covariance(problem, sensor), made.plain_covariance(problem, sensor)
        scale = np.sqrt(truth.diagonal())
        np.testing.assert_allclose(got / np.outer(scale, scale), truth / np.outer(scale, scale), atol=1e-9)
    assert 20 < loose < 180


def test_loose_edges_lie_where_they_did_when_another_strip_is_left_out() -> None:
    """Halfway between the strips beside them: the second strip, far away, has no say."""
    problem, n = _empty(MODELS[0], 60), 60
    chain = np.array([0, 0, 0, 1])
    inner = [(0.3, 0.25), (0.3 + 2.6 / n, 0.251), (0.7, 0.2), (0.5, 0.8)]
    theta = np.array([0.002, 0.5, 0.5, 0.997, 0.5, 0.5, *np.ravel(inner)])
    order = np.argsort(theta[END_ENTRIES::2], kind="stable")
    theta[END_ENTRIES:] = theta[END_ENTRIES:].reshape(-1, 2)[order].ravel()
    made = PolygonFit(theta, chain[order], np.zeros(2, dtype=np.int64), 0.0)
    problem = _with(problem, made.readings(problem), np.full((2, n), 1e2))
    there = np.arange(n) != 1
    without = replace(
        problem, x=problem.x[there], k=problem.k[:, there].copy(), weight=problem.weight[:, there].copy()
    )
    loose = made._with_loose_edges(problem)
    assert loose is not made
    np.testing.assert_allclose(made._with_loose_edges(without).theta, loose.theta, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rank", [8, 5])
def test_swept_areas_agree_and_scatter_as_the_covariance_says(rank: int) -> None:
    random = np.random.default_rng(rank)
    root = random.normal(size=(8, rank))
    covariance = root @ root.T
    vertices = np.array([(0.0, 0.0), (90.0, 10.0), (80.0, 70.0), (10.0, 60.0)])
    off, areas = swept_areas(vertices, covariance)
    plain, plain_areas = plain_swept_areas(vertices, covariance)
    np.testing.assert_allclose(
        off, plain, rtol=0.0, atol=1e-6
    )  # what rounding leaves of a rank that is not full
    np.testing.assert_allclose(areas, plain_areas, rtol=1e-6)
    drawn = off.reshape(len(off), -1)
    spread = np.sqrt(np.diag(covariance))
    assert np.abs(np.cov(drawn.T) - covariance).max() < 0.5 * spread.max() ** 2  # of 64 draws
    # No more than a strip along each edge, as wide as its further end moves, and its ends' own.
    moved = vertices + off
    apart = np.abs([_area(m) - _area(vertices) for m in moved])
    assert (apart <= areas).all()


def _area(v: FloatArray) -> float:
    return float(0.5 * (v[:, 0] * np.roll(v[:, 1], -1) - np.roll(v[:, 0], -1) * v[:, 1]).sum())


def test_vertices_are_brought_into_order_with_their_chains() -> None:
    theta = np.array([[0.0, 0.5, 0.5, 1.0, 0.5, 0.5, 0.7, 0.1, 0.2, 0.9, 0.4, 0.3]])
    found, chain = ordered(theta, np.array([[0, 1, 0]]))
    assert found[0, END_ENTRIES:].tolist() == [0.2, 0.9, 0.4, 0.3, 0.7, 0.1]
    assert chain[0].tolist() == [1, 0, 0]


def test_threads_do_not_disturb_each_other() -> None:
    problems = [_convex(seed, MODELS[seed % len(MODELS)], 40 + seed) for seed in range(16)]
    wanted = [fit_counts(problem).chosen.theta.tobytes() for problem in problems]
    with ThreadPoolExecutor(4) as threads:
        for _ in range(3):
            found = threads.map(lambda problem: fit_counts(problem).chosen.theta.tobytes(), problems)
            assert list(found) == wanted


def test_a_turn_is_given_up_in_long_calls_alone() -> None:
    turn = Lock()
    locked = _without_turn(turn.locked)
    with taking_turns(turn):
        assert turn.locked()
        assert not locked()
        assert turn.locked()
        with pytest.raises(ZeroDivisionError):
            _without_turn(lambda: 1 // 0)()
        assert turn.locked()
        with taking_turns(Lock()):
            pass
        assert not locked()  # the outer one again
    assert not turn.locked()
    with turn:
        assert locked()  # a thread that takes no turns leaves those of others alone

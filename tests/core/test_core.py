"""The compiled core does what its NumPy truth does, and the truth is that of the closed forms."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported, search_workspace
from tacstrip.core.descent import descend, ordered, plain_refine, refine
from tacstrip.core.ellipse import fit_ellipse, plain_fit_ellipse
from tacstrip.core.equations import heights, information, normal_equations
from tacstrip.core.fit import ENDS, MOST, POLYGON, Fit
from tacstrip.core.outliers import misfits, plain_misfits, plain_spikes, spikes
from tacstrip.core.problem import Signal
from tacstrip.core.score import NEW, TRIED, candidates, places
from tacstrip.core.search import fit_counts, plain_fit_counts
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import with_ends
from tacstrip.reconstruction.polygon.fit import fitted_covariance, information_root, untangled
from tacstrip.sensor.circuit import k_h, k_l, k_metal
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


def _empty(model: tuple[str, float, float], n: int, rows: int = 0) -> Signal:
    """Return a signal without readings."""
    kind, ratio, lam = model
    a = ratio / (1.0 + ratio)
    shares = {"both": [a, 0.0], "upper": [a], "lower": [0.0], "metal": [0.0]}[kind]
    x, shape = (np.arange(n) + 0.5) / n, (len(shares), n)
    weight = np.full(shape, 1.0 / 0.005**2)
    return Signal(x, np.zeros(shape), weight, 1.0 / n, np.array(shares), 1.0 - a, lam, 0.0, float(n), 60.0)


def _case(
    seed: int, model: tuple[str, float, float], blunt: tuple[int, int] = (0, 0), n: int = 60
) -> tuple[Fit, Signal]:
    """Draw a polygon with vertices on both chains, and readings near it, some left out."""
    random, signal = np.random.default_rng(seed), _empty(model, n)
    m = int(random.integers(1, 6))
    x = np.sort(random.uniform(0.05, 0.95, m))
    chain = random.integers(0, 2, m)
    y = np.where(chain == 1, random.uniform(0.55, 0.8, m), random.uniform(0.15, 0.45, m))
    left, right = random.uniform(0.45, 0.55, 2)
    ends = [0.002, left, left + 0.1 * blunt[0], 0.997, right, right + 0.1 * blunt[1]]
    theta = np.concatenate([ends, np.stack([x, y], axis=1).ravel()])
    fit = Fit(theta, chain, np.array(blunt, dtype=np.int64), np.inf)
    k = fit.readings(signal) + random.normal(0.0, 0.005, signal.k.shape)
    weight = random.uniform(0.5, 2.0, k.shape) * signal.weight
    return fit, _with(signal, k, np.where(random.uniform(size=k.shape) < 0.1, 0.0, weight))


def _with(signal: Signal, k: FloatArray, weight: FloatArray) -> Signal:
    return Signal(
        signal.x,
        k,
        weight,
        signal.pitch,
        signal.shares,
        signal.narrow,
        signal.lam,
        0.0,
        signal.width_mm,
        60.0,
    )


def _batch(fit: Fit) -> tuple[FloatArray, IntArray, IntArray]:
    return fit.theta[None], fit.chain[None], fit.blunt


@pytest.mark.parametrize("which", MODELS)
def test_readings_and_their_slopes_are_those_of_the_closed_forms(which: tuple[str, float, float]) -> None:
    kind, ratio, lam = which
    signal, random = _empty(which, 50), np.random.default_rng(0)
    l = random.uniform(0.0, 0.5, (3, 50))
    u = l + random.uniform(0.0, 0.5, (3, 50))
    forms = [k_h, k_l] if kind == "both" else [k_h if kind == "upper" else k_l]
    if kind == "metal":
        wanted = k_metal(l, u - l, 1.0, lam)[:, None]
    else:
        wanted = np.stack([form(l, u - l, 1.0, ratio, lam) for form in forms], axis=1)
    by_l, by_u, k = signal.slopes(l, u)
    np.testing.assert_allclose(k, wanted, atol=1e-12)
    step = 1e-6
    for slope, dl, du in ((by_l, step, 0.0), (by_u, 0.0, step)):
        difference = signal.readings_of(l + dl, u + du) - signal.readings_of(l - dl, u - du)
        np.testing.assert_allclose(slope, difference / (2.0 * step), atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("blunt", [(0, 0), (1, 0), (1, 1)])
def test_heights_pass_through_the_vertices_and_their_slopes_are_differences(blunt: tuple[int, int]) -> None:
    fit, signal = _case(1, MODELS[0], blunt)
    theta, chain, sides = _batch(fit)
    for side, (height, slope) in enumerate(heights(theta, chain, sides, signal.x)):
        np.testing.assert_allclose(height[0], fit.ends(signal.x)[side], atol=1e-12)
        for i in range(theta.shape[1]):
            step = np.zeros(theta.shape)
            step[0, i] = 1e-7
            up, down = (heights(theta + sign * step, chain, sides, signal.x)[side][0] for sign in (1, -1))
            np.testing.assert_allclose(slope[0, :, i], (up - down)[0] / 2e-7, atol=1e-5)


@pytest.mark.parametrize("which", MODELS)
def test_the_gradient_is_half_the_cost_s_slope(which: tuple[str, float, float]) -> None:
    fit, signal = _case(1, which, (1, 0))
    theta, chain, blunt = _batch(fit)
    gradient = normal_equations(theta, chain, blunt, signal)[2][0]
    for i in range(theta.shape[1]):
        step = np.zeros(theta.shape)
        step[0, i] = 1e-6
        up, down = (normal_equations(theta + sign * step, chain, blunt, signal)[0][0] for sign in (1, -1))
        assert gradient[i] == pytest.approx(-(up - down) / 4e-6, rel=1e-4, abs=1e-4 * np.abs(gradient).max())


@needs_core
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_normal_equations_agree(which: tuple[str, float, float], seed: int) -> None:
    fit, signal = _case(seed, which, (seed % 2, seed // 3), 60 + seed)
    theta, chain, blunt = _batch(fit)
    if seed > 3:  # chains that cross
        theta[:, ENDS + 1 :: 2] = 1.0 - theta[:, ENDS + 1 :: 2]
    wanted = normal_equations(theta, chain, blunt, signal)
    core, record, size = (
        exported("normal_equations"),
        Fit(theta[0], chain[0], blunt, 0.0).record,
        theta.shape[1],
    )
    assert core is not None
    matrix, gradient = np.empty((size, size)), np.empty(size)
    cost = core(signal.problem, at(record), 1, at(matrix), at(gradient))
    assert cost == pytest.approx(wanted[0][0], rel=1e-10)
    for got, truth in ((matrix, wanted[1][0]), (gradient, wanted[2][0])):
        np.testing.assert_allclose(got, truth, rtol=1e-9, atol=1e-10 * np.abs(truth).max())
    fit = Fit(theta[0], chain[0], blunt, 0.0)
    without = normal_equations(theta, chain, blunt, signal, prior=False)[1][0]
    np.testing.assert_allclose(
        information(fit, signal), without, rtol=1e-9, atol=1e-10 * np.abs(without).max()
    )


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_core)])
def test_a_rounding_error_at_a_pointed_end_is_no_overlap(compiled: bool) -> None:
    """A pointed end may lie on the last strip, where l = u: rounding decides which of them comes out larger."""
    fit, signal = _case(1, MODELS[1])
    fit.theta[3], found = signal.x[-1], []
    for height in fit.theta[4] + np.spacing(fit.theta[4]) * np.arange(20):
        fit.theta[4:6] = height
        plain = normal_equations(*_batch(fit), signal, prior=False)[1][0]
        found.append(information(fit, signal) if compiled else plain)
    for matrix in found[1:]:
        np.testing.assert_allclose(matrix, found[0], rtol=1e-9, atol=1e-9 * np.abs(found[0]).max())


@needs_core
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("which", MODELS)
def test_descents_agree(which: tuple[str, float, float], seed: int) -> None:
    fit, signal = _case(seed, which, (seed % 2, seed // 4))
    fit.theta[ENDS:] += np.random.default_rng(seed).normal(0.0, 0.02, len(fit.theta) - ENDS)
    theta, chain, cost = descend(*_batch(fit), signal, 12, 1e-6, np.inf)
    core, record = exported("descend"), fit.record
    assert core is not None
    assert core(signal.problem, at(record), 12, 1e-6, np.inf) == pytest.approx(cost[0], rel=1e-9)
    found = Fit.of_record(record)
    np.testing.assert_array_equal(found.chain, chain[0])
    np.testing.assert_allclose(found.theta, theta[0], atol=1e-9)


@pytest.mark.parametrize("do", [refine, plain_refine])
def test_a_descent_ends_in_a_minimum(do: object) -> None:
    assert callable(do)
    fit, signal = _case(2, MODELS[0])
    found = do(fit, signal)
    random = np.random.default_rng(0)
    near = found.theta + random.normal(0.0, 1e-3, (200, len(found.theta)))
    near[:, [2, 5]] = near[:, [1, 4]]
    chain = np.tile(found.chain, (200, 1))
    assert (normal_equations(near, chain, found.blunt, signal)[0] >= found.cost - 1e-4).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_the_score_test_finds_the_best_places(which: tuple[str, float, float], seed: int) -> None:
    whole, signal = _case(seed, which)
    m = whole.count - 1  # a vertex is missing
    fit = plain_refine(Fit(whole.theta[: ENDS + 2 * m], whole.chain[:m], whole.blunt, 0.0), signal)
    every = candidates(fit.theta, fit.chain, fit.blunt, signal, np.arange(1, len(signal.x) - 1))
    starts, chains = places(fit.theta, fit.chain, fit.blunt, False, signal)
    gains = {(c.strip, c.upper): c.gain for c in every}
    strips = np.searchsorted(signal.x, starts[:, -2])
    found = [gains[int(i), int(c[-1])] for i, c in zip(strips, chains, strict=True)]
    assert max(found) == pytest.approx(max(gains.values()), rel=1e-9)
    core = exported("places")
    if core is None:
        return
    record, compiled, workspace = fit.record, np.empty(TRIED, POLYGON), search_workspace()
    assert core(signal.problem, at(record), 0, at(compiled), at(workspace)) == len(starts)
    wanted = {(int(i), int(c[-1])): s for i, c, s in zip(strips, chains, starts, strict=True)}
    thetas = [start["theta"][: ENDS + 2 * m + 2] for start in compiled[: len(starts)]]
    which_places = [
        (int(np.searchsorted(signal.x, theta[-2])), int(start["upper"][m]))
        for theta, start in zip(thetas, compiled, strict=False)
    ]
    gained = sorted(gains[place] for place in which_places)
    assert gained == pytest.approx(sorted(found), rel=1e-6)  # places of equal gain are equally good
    for place, theta in zip(which_places, thetas, strict=True):
        if place in wanted:
            np.testing.assert_allclose(theta, wanted[place], atol=1e-6)


def test_a_gain_is_what_a_descent_gains_from_a_small_kink() -> None:
    """By its definition: the least cost with the hat's height free, in the linear model."""
    whole, signal = _case(3, MODELS[0])
    fit = plain_refine(Fit(whole.theta[:-2], whole.chain[:-1], whole.blunt, 0.0), signal)
    (best,) = sorted(
        candidates(fit.theta, fit.chain, fit.blunt, signal, np.arange(1, 59)), key=lambda c: c.gain
    )[-1:]
    assert NEW < 1.0
    shifted = np.concatenate([fit.theta + 1e-3 * best.shift, [signal.x[best.strip], 0.0]])
    lifted = _lifted(fit, shifted, best.upper, 1e-3 * best.height)
    gain = fit.cost - normal_equations(*_batch(lifted), signal)[0][0]
    assert gain == pytest.approx(2e-3 * best.gain, rel=0.02)


def _lifted(fit: Fit, theta: FloatArray, upper: int, height: float) -> Fit:
    """Put the last vertex of theta on a chain, and so much above it."""
    inner = theta[ENDS:-2].reshape(-1, 2)[fit.chain == upper]
    knots = np.array([theta[[0, 1 + upper]], *inner, theta[[3, 4 + upper]]])
    theta[-1] = np.interp(theta[-2], *knots.T) + height
    new, chain = ordered(theta[None], np.append(fit.chain, upper)[None])
    return Fit(new[0], chain[0], fit.blunt, np.inf)


def _convex(seed: int, model: tuple[str, float, float], n: int) -> Signal:
    """Return noisy readings of a convex polygon with one to three vertices on each chain."""
    random, signal = np.random.default_rng(seed), _empty(model, n)
    outline = []
    for sign in (-1.0, 1.0):
        angle = np.sort(random.uniform(0.3, np.pi - 0.3, random.integers(1, 4)))
        x, y = 0.5 - 0.5 * np.cos(angle), 0.5 + sign * random.uniform(0.2, 0.4) * np.sin(angle)
        outline.append((np.array([0.0, *x, 1.0]), np.array([0.5, *y, 0.5])))
    k = signal.readings_of(*(np.interp(signal.x, *chain) for chain in outline))
    return _with(signal, k + random.normal(0.0, 0.005, k.shape), signal.weight)


@needs_core
@pytest.mark.parametrize("which", MODELS)
def test_searches_agree(which: tuple[str, float, float]) -> None:
    for seed, n in enumerate((14, 60, 340)):
        signal = _convex(seed, which, n)
        for known, corners in ((True, None), (False, None), (True, 5)):
            compiled, plain = (do(signal, known, corners=corners) for do in (fit_counts, plain_fit_counts))
            assert (compiled.best, compiled.equal) == (plain.best, plain.equal)
            got, truth = compiled.chosen, plain.chosen
            assert compiled.scores[compiled.best] == pytest.approx(plain.scores[plain.best], rel=1e-9)
            np.testing.assert_array_equal(got.blunt, truth.blunt)
            np.testing.assert_array_equal(got.chain, truth.chain)
            np.testing.assert_allclose(got.theta, truth.theta, atol=1e-9)
            off = (signal.k - got.readings(signal)) * signal.root_weight
            np.testing.assert_allclose(got.residuals(signal), off, atol=1e-9)


@needs_core
def test_searches_of_readings_without_noise_agree() -> None:
    """By stages, on strips that are averaged and on such that are left out."""
    for n in (60, 700):
        fit, signal = _case(4, MODELS[0], (0, 1), n)
        exact = _with(signal, fit.readings(signal), np.full(signal.k.shape, 1e10))
        compiled, plain = fit_counts(exact), plain_fit_counts(exact)
        assert compiled.chosen.count == plain.chosen.count
        np.testing.assert_allclose(compiled.chosen.theta, plain.chosen.theta, atol=1e-9)


@needs_core
@pytest.mark.parametrize("which", MODELS)
def test_ellipses_agree(which: tuple[str, float, float]) -> None:
    signal = _empty(which, 81)
    t = (signal.x - 0.5) / 0.5
    half = 0.2 * np.sqrt(1.0 - t * t)
    k = signal.readings_of(0.5 + 0.1 * t - half, 0.5 + 0.1 * t + half)
    signal = _with(signal, k + np.random.default_rng(1).normal(0.0, 0.005, k.shape), signal.weight)
    start = fit_counts(signal).chosen
    got, truth = fit_ellipse(start, signal), plain_fit_ellipse(start, signal)
    assert got.cost == pytest.approx(truth.cost, rel=1e-9)
    np.testing.assert_allclose(got.parameters, truth.parameters, atol=1e-9)
    np.testing.assert_allclose(got.information, truth.information, rtol=1e-6)


def test_an_ellipse_is_fitted_from_the_outline_of_an_ellipse() -> None:
    """As tracking does: an outline of more vertices than a search takes."""
    signal = _empty(MODELS[0], 81)
    t = (signal.x - 0.5) / 0.5
    half = 0.2 * np.sqrt(1.0 - t * t)
    signal = _with(signal, signal.readings_of(0.5 - half, 0.5 + half), signal.weight)
    first = fit_ellipse(fit_counts(signal).chosen, signal)
    start = Fit.of(Outline(*first.outline(signal)[:2]), signal)
    assert start.count > MOST
    np.testing.assert_allclose(fit_ellipse(start, signal).parameters, first.parameters, atol=1e-4)
    assert np.abs(start.residuals(signal)).max() < 3.0


def test_the_information_of_an_ellipse_is_that_of_its_readings() -> None:
    sensor = Sensor(construction="crs-crs", strips=80, pitch_mm=1.0, length_mm=60.0, resistivity_ratio=2.0)
    t = np.linspace(-79 / 80, 79 / 80, 80)
    middle, half = 0.5 + 0.1 * t, 0.2 * np.sqrt(1.0 - t * t)
    x = sensor.x_mm
    empty = Signal.of(sensor, x, {"kh": np.zeros(80), "kl": np.zeros(80)}, 0.002)
    k = empty.readings_of(middle - half, middle + half) + np.random.default_rng(1).normal(0.0, 0.002, (2, 80))
    signal = Signal.of(sensor, x, {"kh": k[0], "kl": k[1]}, 0.002)
    oval = fit_ellipse(fit_counts(signal).chosen, signal)
    np.testing.assert_allclose(oval.parameters[2:], [0.5, 0.1, 0.2], atol=0.003)
    for i in (2, 3, 4):  # the ends' x move strips in and out, where differences do not exist
        sides = []
        for sign in (-1.0, 1.0):
            p = oval.parameters.copy()
            p[i] += sign * 1e-6
            sides.append(type(oval)(p, 0.0, oval.information).residuals(signal).ravel())
        slope = (sides[1] - sides[0]) / 2e-6
        assert oval.information[i, i] == pytest.approx(slope @ slope, rel=1e-5)


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
            np.testing.assert_array_equal(misfits(residuals), plain_misfits(residuals))


@needs_core
@pytest.mark.parametrize("blunt", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_covariances_agree(blunt: tuple[int, int]) -> None:
    sensor = Sensor(construction="crs-crs", strips=70, pitch_mm=1.0, length_mm=60.0)
    fit, signal = _case(6, MODELS[0], blunt, 60)
    if not sum(blunt):
        fit.theta[ENDS + 2] = fit.theta[ENDS] + 0.5 / 60  # an edge that crosses one strip or none
    outline = Outline(*untangled(*fit.polygon(signal)))
    got = fitted_covariance(fit, outline, signal, sensor)
    wanted = with_ends(outline, sensor, information_root(fit, signal))
    scale = np.sqrt(wanted.diagonal())
    np.testing.assert_allclose(got / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-6)


def test_vertices_are_brought_into_order_with_their_chains() -> None:
    theta = np.array([[0.0, 0.5, 0.5, 1.0, 0.5, 0.5, 0.7, 0.1, 0.2, 0.9, 0.4, 0.3]])
    found, chain = ordered(theta, np.array([[0, 1, 0]]))
    assert found[0, ENDS:].tolist() == [0.2, 0.9, 0.4, 0.3, 0.7, 0.1]
    assert chain[0].tolist() == [1, 0, 0]


def test_threads_do_not_disturb_each_other() -> None:
    signals = [_convex(seed, MODELS[seed % len(MODELS)], 40 + seed) for seed in range(16)]
    wanted = [fit_counts(signal).chosen.theta.tobytes() for signal in signals]
    with ThreadPoolExecutor(4) as threads:
        for _ in range(3):
            found = threads.map(lambda signal: fit_counts(signal).chosen.theta.tobytes(), signals)
            assert list(found) == wanted
